//! One view as the optimiser uses it: its ray profiles, and the prior sampled along them.

use std::sync::OnceLock;

use glam::DVec2;
use rayon::prelude::*;

use super::calibrate::Calibration;
use super::straighten::{GroundFits, PriorShape};
use crate::prior::{DepthPrior, PriorKind};
use crate::raster::Raster;
use crate::ray::Ray;
use crate::render::PlacedCamera;
use crate::render::profile::{ProfileRay, Profiles};

/// No ray in this block of pixels.
const NO_RAY: u32 = u32::MAX;

/// A view with its prior.
#[derive(Debug, Clone)]
pub struct Evidence<'a> {
    /// Rays of the view, with the intervals in which they pass through prisms.
    pub profiles: &'a Profiles,
    /// Per ray: the prior as something that grows towards the camera (inverse depth up to an affine map); `NaN` = none.
    pub nearness: Vec<f32>,
    /// Per ray: the prior as something that grows away from the camera, as the paper's D; `NaN` = none.
    pub farness: Vec<f32>,
    /// Per ray: whether the photo shows the green of leaves there; empty where that is not known, or it does so nowhere.
    green: Vec<bool>,
    /// Whether the prior is depth, of which `nearness` is the inverse.
    pub(super) is_depth: bool,
    /// Whether the prior has been straightened along the ground.
    pub was_bent: bool,
    /// Size of a pixel of the prior or of the working image, whichever is larger, in pixels of the working image.
    pub pixel_px: f64,
    /// Mapping of the prior to metres by the ground alone, once somebody has asked.
    pub(super) on_ground: OnceLock<Option<Calibration>>,
    /// The buildings whose footprints rays cross, ascending: those of a view, not those of the scene.
    crossed: Vec<u32>,
    /// Which rays cross the footprint of `crossed[i]`: `rays_of[start[i]..start[i + 1]]`.
    start: Vec<u32>,
    rays_of: Vec<u32>,
    /// Ray of each block of `stride × stride` pixels, row by row, or [`NO_RAY`].
    blocks: Vec<u32>,
    blocks_wide: usize,
    stride_px: usize,
}

impl<'a> Evidence<'a> {
    /// Samples a prior along a view's rays. `bleeding_px` is by how many pixels of the working image near sides bleed over
    /// their edges, see [`super::bleed`].
    #[must_use]
    pub fn new(
        placed: &PlacedCamera,
        profiles: &'a Profiles,
        prior: &DepthPrior,
        bleeding_px: f64,
        stride_px: usize,
    ) -> Self {
        let nearness: Vec<f32> =
            profiles.rays.par_iter().map(|ray| without_bleeding(placed, prior, ray.centre(), bleeding_px)).collect();
        let farness = nearness.iter().map(|n| farness_of(prior.kind, *n)).collect();

        let mut pairs: Vec<(u32, u32)> = ray_building_pairs(profiles).map(|(ray, building)| (building, ray)).collect();
        pairs.sort_unstable();
        let (mut crossed, mut start) = (Vec::new(), Vec::new());
        for (at, (building, _)) in (0..).zip(&pairs) {
            if crossed.last() != Some(building) {
                crossed.push(*building);
                start.push(at);
            }
        }
        start.push(pairs.len() as u32);
        let rays_of = pairs.into_iter().map(|(_, ray)| ray).collect();

        let blocks_wide = (placed.camera.width_px as usize).div_ceil(stride_px);
        let blocks_high = (placed.camera.height_px as usize).div_ceil(stride_px);
        let mut blocks = vec![NO_RAY; blocks_wide * blocks_high];
        for (ray, r) in (0..).zip(&profiles.rays) {
            let [col, row] = r.pixel.map(|p| usize::from(p) / stride_px);
            blocks[row * blocks_wide + col] = ray;
        }
        let on_ground = OnceLock::new();
        let (green, was_bent) = (Vec::new(), false);
        let pixel_px = (f64::from(placed.camera.width_px) / prior.values.width() as f64).max(1.0);
        Self {
            profiles,
            nearness,
            farness,
            green,
            is_depth: prior.kind == PriorKind::Depth,
            was_bent,
            pixel_px,
            on_ground,
            crossed,
            start,
            rays_of,
            blocks,
            blocks_wide,
            stride_px,
        }
    }

    /// Samples what pixels of the view's photo are green, of whatever size it is.
    pub(super) fn see_green(&mut self, placed: &PlacedCamera, green: &Raster<bool>) {
        let scale_x = green.width() as f64 / f64::from(placed.camera.width_px);
        let scale_y = green.height() as f64 / f64::from(placed.camera.height_px);
        let at = |ray: &ProfileRay| {
            let centre = ray.centre();
            green.get((centre.x * scale_x) as usize, (centre.y * scale_y) as usize).is_some_and(|is_green| *is_green)
        };
        let seen: Vec<bool> = self.profiles.rays.iter().map(at).collect();
        self.green = if seen.contains(&true) { seen } else { Vec::new() };
    }

    /// Whether the photo shows the green of leaves anywhere.
    #[must_use]
    pub(super) fn sees_green(&self) -> bool {
        !self.green.is_empty()
    }

    /// Whether the photo shows the green of leaves along a ray.
    #[must_use]
    pub(super) fn is_green(&self, ray: u32) -> bool {
        self.green.get(ray as usize).is_some_and(|is_green| *is_green)
    }

    /// Replaces the prior by the inverse depth that it stands for, where the priors of its survey have another shape.
    pub(super) fn straighten(&mut self, fits: &GroundFits, shape: PriorShape) {
        let Some(curve) = fits.curve(shape) else { return };
        self.nearness.iter_mut().for_each(|p| *p = curve.inverse_depth(f64::from(*p)) as f32);
        self.farness = self.nearness.iter().map(|n| farness_of(PriorKind::InverseDepth, *n)).collect();
        self.was_bent = true;
    }

    /// A ray of the view's own camera.
    #[must_use]
    pub fn ray(&self, placed: &PlacedCamera, ray_idx: u32) -> Ray {
        let centre = self.profiles.rays[ray_idx as usize].centre();
        placed.ray(centre).expect("only pixels that have a ray are sampled")
    }

    /// The area of the image that so many of the rays stand for, pixels squared.
    #[must_use]
    pub fn area_px(&self, n_rays: usize) -> f64 {
        (n_rays * self.stride_px * self.stride_px) as f64
    }

    /// The rays that cross a building's footprint below its greatest height, ascending.
    #[must_use]
    pub fn rays_of(&self, building: u32) -> &[u32] {
        match self.crossed.binary_search(&building) {
            Ok(at) => &self.rays_of[self.start[at] as usize..self.start[at + 1] as usize],
            Err(_) => &[],
        }
    }

    /// The buildings whose footprints some rays cross, ascending.
    #[must_use]
    pub fn crossed(&self) -> &[u32] {
        &self.crossed
    }

    /// Some rays and those within `dilate_px` of one of them, ascending.
    #[must_use]
    pub fn rays_around(&self, own: &[u32], dilate_px: usize) -> Vec<u32> {
        let pixel_of = |ray: u32| self.profiles.rays[ray as usize].pixel;
        let block_of = |pixel: [u16; 2]| pixel.map(|p| usize::from(p) / self.stride_px);
        let reach = dilate_px.div_ceil(self.stride_px);
        let blocks_high = self.blocks.len() / self.blocks_wide;
        let Some(first) = own.first() else { return Vec::new() };
        let bounds = own.iter().map(|&r| pixel_of(r)).fold([pixel_of(*first); 2], |[low, high], p| {
            [[low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]]
        });
        let bounds = bounds.map(block_of);
        let low = bounds[0].map(|c| c.saturating_sub(reach));
        let high = [(bounds[1][0] + reach).min(self.blocks_wide - 1), (bounds[1][1] + reach).min(blocks_high - 1)];
        let (width, height) = (high[0] - low[0] + 1, high[1] - low[1] + 1);

        // Dilation by a square, one axis after the other.
        let mut across = vec![0_u16; width * height];
        for &ray in own {
            let [col, row] = block_of(pixel_of(ray));
            let (from, to) = (col.saturating_sub(reach).max(low[0]), (col + reach).min(high[0]));
            across[(row - low[1]) * width..][from - low[0]..=to - low[0]].fill(1);
        }
        let row_of = |row: usize| &across[row * width..(row + 1) * width];
        let mut n_near = vec![0_u16; width]; // by column: rows within reach that are filled there
        let mut rays = Vec::with_capacity(width * height / 2);
        for row in 0..height + reach {
            if row < height {
                n_near.iter_mut().zip(row_of(row)).for_each(|(n, filled)| *n += filled);
            }
            if row > 2 * reach {
                n_near.iter_mut().zip(row_of(row - 2 * reach - 1)).for_each(|(n, filled)| *n -= filled);
            }
            let Some(middle) = row.checked_sub(reach) else { continue };
            let blocks = &self.blocks[(middle + low[1]) * self.blocks_wide + low[0]..][..width];
            rays.extend(blocks.iter().zip(&n_near).filter(|&(&ray, &n)| n > 0 && ray != NO_RAY).map(|(&ray, _)| ray));
        }
        rays
    }
}

/// The prior at a position of the working image, as something that grows towards the camera; `NaN` = none.
#[must_use]
pub fn nearness_at(placed: &PlacedCamera, prior: &DepthPrior, pixel: DVec2) -> f32 {
    let x = pixel.x * prior.values.width() as f64 / f64::from(placed.camera.width_px);
    let y = pixel.y * prior.values.height() as f64 / f64::from(placed.camera.height_px);
    let value = prior.values.bilinear(x, y);
    match prior.kind {
        PriorKind::Depth if value > 0.0 => value.recip(),
        PriorKind::Depth => f32::NAN,
        PriorKind::InverseDepth => value,
    }
}

/// The same as something that grows away from the camera, as the paper's D; `NaN` = none.
#[must_use]
pub fn farness_at(placed: &PlacedCamera, prior: &DepthPrior, pixel: DVec2) -> f32 {
    farness_of(prior.kind, nearness_at(placed, prior, pixel))
}

fn farness_of(kind: PriorKind, nearness: f32) -> f32 {
    match kind {
        PriorKind::Depth => nearness.recip(),
        PriorKind::InverseDepth => -nearness,
    }
}

/// [`nearness_at`] with near sides cut back by `bleeding_px` (the least value within so many pixels), or grown by as much if
/// negative.
fn without_bleeding(placed: &PlacedCamera, prior: &DepthPrior, pixel: DVec2, bleeding_px: f64) -> f32 {
    let mut extreme = nearness_at(placed, prior, pixel);
    let mut radius = bleeding_px.abs();
    while radius > 0.0 {
        let n = (std::f64::consts::TAU * radius).ceil();
        for k in 0..n as usize {
            let around = pixel + radius * DVec2::from_angle(std::f64::consts::TAU * k as f64 / n);
            let value = nearness_at(placed, prior, around);
            // Comparisons with NaN are false: places without a prior have no say.
            if (bleeding_px > 0.0 && value < extreme) || (bleeding_px < 0.0 && value > extreme) {
                extreme = value;
            }
        }
        radius -= 1.0;
    }
    extreme
}

/// Each (ray, building) once, by ray.
fn ray_building_pairs(profiles: &Profiles) -> impl Iterator<Item = (u32, u32)> + '_ {
    (0..profiles.rays.len()).flat_map(|ray| {
        let intervals = profiles.intervals(ray);
        let is_first = move |i: &usize| intervals[..*i].iter().all(|c| c.building != intervals[*i].building);
        (0..intervals.len()).filter(is_first).map(move |i| (ray as u32, intervals[i].building))
    })
}
