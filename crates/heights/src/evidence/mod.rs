//! One view as the optimiser uses it: its ray profiles, and the prior sampled along them.

pub(crate) mod bleed;
pub(crate) mod calibrate;
pub(crate) mod straighten;
pub(crate) mod vegetation;

use std::ops::Range;
use std::sync::OnceLock;

use glam::DVec2;
use rayon::prelude::*;

use crate::config::DILATE_PX;
use crate::evidence::calibrate::Calibration;
use crate::evidence::straighten::{GroundFits, PriorShape};
use crate::prior::{DepthPrior, PriorKind};
use crate::raster::Raster;
use crate::ray::Ray;
use crate::render::PlacedCamera;
use crate::render::profile::{ProfileRay, Profiles};

/// No ray in this block of pixels.
const NO_RAY: u32 = u32::MAX;

/// A view's prior at the pixels of its rays. It does not depend on footprints, so it is sampled once.
#[derive(Debug)]
pub struct SampledPrior {
    /// By block of `stride × stride` pixels, row by row: inverse depth up to an affine map; `NaN` = none.
    nearness: Vec<f32>,
    is_depth: bool,
    pixel_px: f64,
    /// How it runs along the ground, once somebody has asked.
    fits: OnceLock<GroundFits>,
}

impl SampledPrior {
    /// Samples a prior along a view's rays. `bleeding_px` is by how many pixels of the working image near sides bleed over
    /// their edges, see [`crate::evidence::bleed`].
    #[must_use]
    pub fn new(
        placed: &PlacedCamera,
        profiles: &Profiles,
        prior: &DepthPrior,
        bleeding_px: f64,
        stride_px: usize,
    ) -> Self {
        let blocks = Blocks::of(placed, stride_px);
        let (places, is_grown) = (places_around(bleeding_px.abs()), bleeding_px < 0.0);
        let at = |ray: &ProfileRay| without_bleeding(placed, prior, ray.centre(), &places, is_grown);
        let along: Vec<f32> = profiles.rays.par_iter().map(at).collect();
        let mut nearness = vec![f32::NAN; blocks.n()];
        for (ray, value) in profiles.rays.iter().zip(along) {
            nearness[blocks.at(ray)] = value;
        }
        Self {
            nearness,
            is_depth: prior.kind == PriorKind::Depth,
            pixel_px: (f64::from(placed.camera.width_px) / prior.values.width() as f64).max(1.0),
            fits: OnceLock::new(),
        }
    }

    /// How the prior runs along the ground of its view, where somebody has asked.
    pub(crate) fn known_fits(&self) -> Option<&GroundFits> {
        self.fits.get()
    }

    /// How the prior runs along the ground of its view.
    pub(crate) fn fits(&self, evidence: &Evidence<'_>) -> &GroundFits {
        self.fits.get_or_init(|| GroundFits::along_ground(evidence))
    }
}

/// Blocks of `stride × stride` pixels of an image, row by row; each holds one ray at most.
#[derive(Debug, Clone, Copy)]
struct Blocks {
    stride_px: usize,
    wide: usize,
    high: usize,
}

impl Blocks {
    fn of(placed: &PlacedCamera, stride_px: usize) -> Self {
        let [wide, high] =
            [placed.camera.width_px, placed.camera.height_px].map(|px| (px as usize).div_ceil(stride_px));
        Self { stride_px, wide, high }
    }

    fn n(self) -> usize {
        self.wide * self.high
    }

    /// Column and row of the block that a ray belongs to.
    fn place(self, ray: &ProfileRay) -> [usize; 2] {
        ray.pixel.map(|p| usize::from(p) / self.stride_px)
    }

    /// Position of that block.
    fn at(self, ray: &ProfileRay) -> usize {
        let [col, row] = self.place(ray);
        row * self.wide + col
    }
}

/// A view with its prior.
#[derive(Debug, Clone)]
pub struct Evidence<'a> {
    /// Rays of the view, with the intervals in which they pass through prisms.
    pub profiles: &'a Profiles,
    /// Per ray: the prior as something that grows towards the camera (inverse depth up to an affine map); `NaN` = none.
    pub nearness: Vec<f32>,
    /// Per ray: whether the photo shows the green of leaves there; empty where that is not known, or it does so nowhere.
    green: Vec<bool>,
    /// Whether the prior is depth, of which `nearness` is the inverse.
    pub(crate) is_depth: bool,
    /// Whether the prior has been straightened along the ground.
    pub was_bent: bool,
    /// Size of a pixel of the prior or of the working image, whichever is larger, in pixels of the working image.
    pub pixel_px: f64,
    /// Mapping of the prior to metres by the ground alone, once somebody has asked, and the belief in what stands out
    /// (0 to 1).
    pub(crate) on_ground: OnceLock<Option<(Calibration, f32)>>,
    /// The buildings whose footprints rays cross, ascending: those of a view, not those of the scene.
    crossed: Vec<u32>,
    /// Which rays cross the footprint of `crossed[i]`: `rays_of[start[i]..start[i + 1]]`.
    start: Vec<u32>,
    rays_of: Vec<u32>,
    /// Level to which each of them sinks over the footprint, local frame, metres.
    sinks_to: Vec<f32>,
    /// The rays in and around each of `crossed`, once somebody has asked.
    around: Vec<OnceLock<Box<[u32]>>>,
    blocks: Blocks,
    /// Ray of each block, or [`NO_RAY`].
    ray_of: Vec<u32>,
}

impl<'a> Evidence<'a> {
    /// From a prior that was sampled along the same view's rays, through whatever footprints.
    #[must_use]
    pub fn new(placed: &PlacedCamera, profiles: &'a Profiles, prior: &SampledPrior, stride_px: usize) -> Self {
        let blocks = Blocks::of(placed, stride_px);
        let mut ray_of = vec![NO_RAY; blocks.n()];
        for (ray, r) in (0..).zip(&profiles.rays) {
            ray_of[blocks.at(r)] = ray;
        }
        let FootprintRays { crossed, start, rays_of, sinks_to } = FootprintRays::of(profiles);
        let around = vec![OnceLock::new(); crossed.len()];
        Self {
            profiles,
            nearness: profiles.rays.iter().map(|ray| prior.nearness[blocks.at(ray)]).collect(),
            green: Vec::new(),
            is_depth: prior.is_depth,
            was_bent: false,
            pixel_px: prior.pixel_px,
            on_ground: OnceLock::new(),
            crossed,
            start,
            rays_of,
            sinks_to,
            around,
            blocks,
            ray_of,
        }
    }

    /// The same evidence along rays of the same pixels that run elsewhere.
    #[must_use]
    pub fn along<'b>(&self, profiles: &'b Profiles) -> Evidence<'b> {
        let Self { blocks, is_depth, was_bent, pixel_px, .. } = *self;
        let mut ray_of = vec![NO_RAY; blocks.n()];
        let same: Vec<Option<usize>> = (0..)
            .zip(&profiles.rays)
            .map(|(ray, r)| {
                let at = blocks.at(r);
                ray_of[at] = ray;
                (self.ray_of[at] != NO_RAY).then_some(self.ray_of[at] as usize)
            })
            .collect();
        let FootprintRays { crossed, start, rays_of, sinks_to } = FootprintRays::of(profiles);
        let around = vec![OnceLock::new(); crossed.len()];
        let green = if self.sees_green() {
            same.iter().map(|same| same.is_some_and(|ray| self.green[ray])).collect()
        } else {
            Vec::new()
        };
        Evidence {
            profiles,
            nearness: same.iter().map(|same| same.map_or(f32::NAN, |ray| self.nearness[ray])).collect(),
            green,
            is_depth,
            was_bent,
            pixel_px,
            on_ground: OnceLock::new(),
            crossed,
            start,
            rays_of,
            sinks_to,
            around,
            blocks,
            ray_of,
        }
    }

    /// The prior along a ray as something that grows away from the camera, as the paper's D; `NaN` = none.
    #[must_use]
    pub fn farness(&self, ray: usize) -> f32 {
        let kind = if self.is_depth && !self.was_bent { PriorKind::Depth } else { PriorKind::InverseDepth };
        farness_of(kind, self.nearness[ray])
    }

    /// Samples what pixels of the view's photo are green, of whatever size it is.
    pub(crate) fn see_green(&mut self, placed: &PlacedCamera, green: &Raster<bool>) {
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
    pub(crate) fn sees_green(&self) -> bool {
        !self.green.is_empty()
    }

    /// Whether the photo shows the green of leaves along a ray.
    #[must_use]
    pub(crate) fn is_green(&self, ray: u32) -> bool {
        self.green.get(ray as usize).is_some_and(|is_green| *is_green)
    }

    /// Replaces the prior by the inverse depth that it stands for, where the priors of its survey have another shape.
    pub(crate) fn straighten(&mut self, fits: &GroundFits, shape: PriorShape) {
        let Some(curve) = fits.curve(shape) else { return };
        self.nearness.iter_mut().for_each(|p| *p = curve.inverse_depth(f64::from(*p)) as f32);
        self.was_bent = true;
    }

    /// A ray of the view's own camera.
    #[must_use]
    pub fn ray(&self, placed: &PlacedCamera, ray_idx: u32) -> Ray {
        let centre = self.profiles.rays[ray_idx as usize].centre();
        placed.ray(centre).expect("only pixels that have a ray are sampled")
    }

    /// Whether a ray has a prior and meets the ground.
    #[must_use]
    pub(crate) fn is_known(&self, ray: usize) -> bool {
        self.nearness[ray].is_finite() && self.profiles.rays[ray].ground.is_finite()
    }

    /// The area of the image that so many of the rays stand for, pixels squared.
    #[must_use]
    pub fn area_px(&self, n_rays: usize) -> f64 {
        (n_rays * self.blocks.stride_px * self.blocks.stride_px) as f64
    }

    /// The rays that cross a building's footprint below its greatest height, ascending.
    #[must_use]
    pub fn rays_of(&self, building: u32) -> &[u32] {
        &self.rays_of[self.positions(building)]
    }

    /// Those of them that come below a level within the footprint, local frame, metres.
    #[must_use]
    pub fn rays_below(&self, building: u32, z: f32) -> Vec<u32> {
        let positions = self.positions(building);
        let of_building = self.rays_of[positions.clone()].iter().zip(&self.sinks_to[positions]);
        of_building.filter(|(_, to)| **to < z).map(|(ray, _)| *ray).collect()
    }

    /// Positions of a building's rays in the list of all.
    fn positions(&self, building: u32) -> Range<usize> {
        let of = |at: usize| self.start[at] as usize..self.start[at + 1] as usize;
        self.crossed.binary_search(&building).map_or(0..0, of)
    }

    /// The buildings whose footprints some rays cross, ascending.
    #[must_use]
    pub fn crossed(&self) -> &[u32] {
        &self.crossed
    }

    /// The rays that cross a building's footprint and those around them, ascending; sought once, as each full sweep asks for them.
    pub(crate) fn rays_around_building(&self, building: u32) -> &[u32] {
        let Ok(at) = self.crossed.binary_search(&building) else { return &[] };
        self.around[at].get_or_init(|| self.rays_around(self.rays_of(building), DILATE_PX).into())
    }

    /// Some rays and those within `dilate_px` of one of them, ascending; of all these only those that have a prior and meet the ground.
    #[must_use]
    pub fn rays_around(&self, own: &[u32], dilate_px: usize) -> Vec<u32> {
        let place_of = |ray: u32| self.blocks.place(&self.profiles.rays[ray as usize]);
        let Blocks { stride_px, wide, high } = self.blocks;
        let reach = dilate_px.div_ceil(stride_px);
        let Some(first) = own.first() else { return Vec::new() };
        let bounds = own.iter().map(|&r| place_of(r)).fold([place_of(*first); 2], |[low, high], p| {
            [[low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]]
        });
        let low = bounds[0].map(|c| c.saturating_sub(reach));
        let high = [(bounds[1][0] + reach).min(wide - 1), (bounds[1][1] + reach).min(high - 1)];
        let (width, height) = (high[0] - low[0] + 1, high[1] - low[1] + 1);

        // Dilation by a square, one axis after the other.
        let mut across = vec![0_u16; width * height];
        for &ray in own {
            let [col, row] = place_of(ray);
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
            let blocks = &self.ray_of[(middle + low[1]) * wide + low[0]..][..width];
            let is_near = |&(&ray, &n): &(&u32, &u16)| n > 0 && ray != NO_RAY && self.is_known(ray as usize);
            rays.extend(blocks.iter().zip(&n_near).filter(is_near).map(|(&ray, _)| ray));
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

/// Places around a pixel up to a distance away, pixels: rings a pixel apart, from the outermost inwards.
fn places_around(farthest_px: f64) -> Vec<DVec2> {
    let radii =
        std::iter::successors(Some(farthest_px), |radius| Some(radius - 1.0)).take_while(|radius| *radius > 0.0);
    let ring = |radius: f64| {
        let n = (std::f64::consts::TAU * radius).ceil();
        (0..n as usize).map(move |k| radius * DVec2::from_angle(std::f64::consts::TAU * k as f64 / n))
    };
    radii.flat_map(ring).collect()
}

/// [`nearness_at`] with near sides cut back to the least value at places around, or grown to the greatest if `is_grown`.
fn without_bleeding(placed: &PlacedCamera, prior: &DepthPrior, pixel: DVec2, places: &[DVec2], is_grown: bool) -> f32 {
    let mut extreme = nearness_at(placed, prior, pixel);
    for place in places {
        let value = nearness_at(placed, prior, pixel + *place);
        // Comparisons with NaN are false: places without a prior have no say.
        if if is_grown { value > extreme } else { value < extreme } {
            extreme = value;
        }
    }
    extreme
}

/// Rays by the footprint that they cross.
struct FootprintRays {
    crossed: Vec<u32>,
    start: Vec<u32>,
    rays_of: Vec<u32>,
    sinks_to: Vec<f32>,
}

impl FootprintRays {
    fn of(profiles: &Profiles) -> Self {
        let n_buildings = profiles.highest_building().map_or(0, |last| last as usize + 1);
        let mut n_rays = vec![0_u32; n_buildings];
        for (_, building, _) in crossings(profiles) {
            n_rays[building as usize] += 1;
        }
        let crossed: Vec<u32> = (0..).zip(&n_rays).filter(|(_, n)| **n > 0).map(|(building, _)| building).collect();
        let mut start = vec![0];
        let mut next = vec![0_usize; n_buildings];
        for &building in &crossed {
            let before = start[start.len() - 1];
            next[building as usize] = before as usize;
            start.push(before + n_rays[building as usize]);
        }
        let n = start[crossed.len()] as usize;
        let (mut rays_of, mut sinks_to) = (vec![0; n], vec![0.0; n]);
        for (ray, building, to) in crossings(profiles) {
            let at = &mut next[building as usize];
            (rays_of[*at], sinks_to[*at]) = (ray, to);
            *at += 1;
        }
        Self { crossed, start, rays_of, sinks_to }
    }
}

/// Each ray and building once, by ray, with the level to which the ray sinks over the footprint.
fn crossings(profiles: &Profiles) -> impl Iterator<Item = (u32, u32, f32)> + '_ {
    (0..profiles.rays.len()).flat_map(move |ray| {
        let intervals = profiles.intervals(ray);
        // By where they begin: the last one of a footprint ends last.
        let is_last = move |i: &usize| intervals[i + 1..].iter().all(|c| c.building != intervals[*i].building);
        let crossing = move |i: usize| {
            let over = intervals[i];
            (ray as u32, over.building, profiles.level(ray, over.leave))
        };
        (0..intervals.len()).filter(is_last).map(crossing)
    })
}
