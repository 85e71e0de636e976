//! How well the neighbours agree with a view at every height level.
//!
//! A pixel `u` of the view, seen through the plane at height `z`, lies in a neighbour at `H(z)·u`. With projection
//! centres `C`, `M = Rᵣᵀ·Kᵣ⁻¹` (pixel to direction in the map), `m` its third row and `B = Kₛ·Rₛ·M`:
//!
//! ```text
//! H(z) = (Kₛ·Rₛ·(Cᵣ − Cₛ)) ⊗ m + (z − Cᵣ.z)·B
//! ```

use std::ops::Range;
use std::sync::Arc;

use glam::{DMat3, DVec2};
use serde::Serialize;

use super::StereoConfig;
use super::correlate::{Neighbour, Tile, WORST, Windows};
use super::picture::{Ideal, Picture};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::raster::Raster;

/// How far a neighbour's pixels may move from one level to the next, pixels: less repeats, more skips.
const STEP_PX: f64 = 0.75;
/// Rows and columns compared at a time: what is known of so many pixels stays in the processor's cache, and a tile of a
/// finer picture holds few surfaces.
const TILE_PX: [usize; 2] = [28, 84];
/// Around a height that the coarse picture found, levels of its own that are tried again.
const AROUND_LEVELS: f64 = 1.5;
/// Pixels of the coarse picture that make a height worth trying in a tile.
const LEAST_COARSE_PX: usize = 4;

/// Mismatch per pixel and level: pixel-major, so that a pixel's levels lie together.
#[derive(Debug)]
pub(super) struct Volume {
    pub width: usize,
    pub height: usize,
    pub n_levels: usize,
    /// 0 (same) to [`super::correlate::WORST`], `[(row · width + col) · n_levels + level]`.
    pub costs: Vec<u8>,
}

/// Heights of the planes that are tried, evenly spaced, ascending.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Levels {
    /// The lowest, metres.
    pub from_m: f64,
    /// The highest, metres.
    pub to_m: f64,
    /// How many, at least two.
    pub n: usize,
}

impl Levels {
    /// From one level to the next, metres.
    pub(super) fn step_m(&self) -> f64 {
        (self.to_m - self.from_m) / (self.n - 1) as f64
    }

    /// Height of a level with a fraction.
    pub(super) fn height_m(&self, level: f64) -> f64 {
        self.from_m + (self.to_m - self.from_m) * level / (self.n - 1) as f64
    }
}

/// The planes of a view, `None` if it has no ground in sight. Their ends are whole metres: a part of a terrain model
/// gives the same ones as the whole, most of the time.
pub(super) fn levels(reference: &Ideal, others: &[Ideal], terrain: &Terrain, config: &StereoConfig) -> Option<Levels> {
    let (lowest, highest) = ground_in_sight(reference, terrain)?;
    let camera_z = reference.camera_from_map.centre().z;
    let from_m = (lowest - config.below_ground_m).floor();
    // A roof as high as the camera could not be seen from above.
    let to_m = (highest + config.max_height_m).ceil().min(camera_z - 0.05 * (camera_z - highest).abs());
    if to_m <= from_m {
        return None;
    }
    let middle = DVec2::new(f64::from(reference.camera.width_px), f64::from(reference.camera.height_px)) / 2.0;
    let moved_px = others.iter().filter_map(|other| {
        let at = |z: f64| position(&homography(reference, other, z), middle);
        Some((at(to_m)? - at(from_m)?).length())
    });
    let longest_px = moved_px.fold(0.0, f64::max);
    let n = ((longest_px / STEP_PX).ceil() as usize + 1).clamp(8, config.max_levels);
    Some(Levels { from_m, to_m, n })
}

/// Lowest and highest ground where the view looks; the whole terrain's where it says nothing there.
fn ground_in_sight(reference: &Ideal, terrain: &Terrain) -> Option<(f64, f64)> {
    const SIDE: u32 = 16;
    let (lowest, highest) = terrain.range()?;
    let pose = &reference.camera_from_map;
    let (centre, to_map) = (pose.centre(), pose.rotation.transpose());
    let camera = &reference.camera;
    let mut sees_ground = false;
    let mut range: Option<(f64, f64)> = None;
    for i in 0..SIDE * SIDE {
        let at = |i: u32, extent: u32| (f64::from(i) + 0.5) / f64::from(SIDE) * f64::from(extent);
        let pixel = DVec2::new(at(i % SIDE, camera.width_px), at(i / SIDE, camera.height_px));
        let Some(ray) = camera.unproject(pixel).map(|ray| to_map * ray) else { continue };
        // Both ends of the terrain's range, since the ray may meet the ground anywhere between.
        for z in [lowest, highest] {
            let depth = (z - centre.z) / ray.z;
            if depth <= 0.0 || !depth.is_finite() {
                continue;
            }
            sees_ground = true;
            let place = centre + depth * ray;
            if let Some(ground) = terrain.height_at(place.x, place.y) {
                let (low, high) = range.unwrap_or((ground, ground));
                range = Some((low.min(ground), high.max(ground)));
            }
        }
    }
    sees_ground.then(|| range.unwrap_or((lowest, highest)))
}

/// What the picture of half the size has found: of each tile, the heights that are worth trying.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coarse<'a> {
    /// Heights, metres; `NaN` where it is in doubt.
    pub heights_m: &'a Raster<f32>,
    /// From one of its levels to the next, metres.
    pub step_m: f64,
}

impl Coarse<'_> {
    /// Per level whether it is tried in a tile. A tile without any height has all of them.
    fn wanted(&self, levels: &Levels, rows: &Range<usize>, cols: &Range<usize>) -> Vec<bool> {
        let part = |r: &Range<usize>, n: usize| (r.start / 2).saturating_sub(2)..(r.end / 2 + 2).min(n);
        let (rows, cols) = (part(rows, self.heights_m.height()), part(cols, self.heights_m.width()));
        let mut n_found = vec![0_usize; levels.n];
        for row in rows.clone() {
            let heights = &self.heights_m.data()[row * self.heights_m.width()..][cols.clone()];
            for z in heights.iter().filter(|z| !z.is_nan()) {
                let level = (f64::from(*z) - levels.from_m) / levels.step_m();
                n_found[(level.round().max(0.0) as usize).min(levels.n - 1)] += 1;
            }
        }
        let around = (AROUND_LEVELS * self.step_m / levels.step_m()).ceil() as usize;
        let mut wanted = vec![false; levels.n];
        for (level, _) in n_found.iter().enumerate().filter(|(_, n)| **n >= LEAST_COARSE_PX) {
            wanted[level.saturating_sub(around)..(level + around + 1).min(levels.n)].fill(true);
        }
        if !wanted.contains(&true) {
            wanted.fill(true);
        }
        wanted
    }
}

/// What is swept.
pub(super) struct Sweep<'a> {
    /// The view.
    pub reference: &'a Picture,
    /// Its neighbours.
    pub others: &'a [Arc<Picture>],
    /// Where these looked from: their own poses, or corrected ones.
    pub ideals: &'a [Ideal],
    /// The planes.
    pub levels: &'a Levels,
    /// What is known already.
    pub coarse: Option<Coarse<'a>>,
}

impl Sweep<'_> {
    /// The mismatch of every pixel with its neighbours at every level; the worst where a level is not tried. On one
    /// thread: views are many.
    pub(super) fn volume(&self, radius_px: usize) -> Volume {
        let Self { reference, others, levels, .. } = *self;
        let (width, height) = (reference.grey().width(), reference.grey().height());
        let windows = Windows::new(reference.grey(), radius_px);
        let neighbours: Vec<Neighbour> = others.iter().map(|other| Neighbour::new(other.grey())).collect();
        let homographies: Vec<Vec<DMat3>> = (0..levels.n)
            .map(|level| {
                let z_m = levels.height_m(level as f64);
                self.ideals.iter().map(|ideal| homography(reference.ideal(), ideal, z_m)).collect()
            })
            .collect();
        let mut costs = vec![WORST; width * height * levels.n];
        let starts = |n: usize, step: usize| (0..n).step_by(step).map(move |start| start..(start + step).min(n));
        for rows in starts(height, TILE_PX[0]) {
            for cols in starts(width, TILE_PX[1]) {
                let wanted = self.coarse.map(|coarse| coarse.wanted(levels, &rows, &cols));
                let mut tile = Tile::new(&windows, rows.clone(), cols.clone(), neighbours.len());
                for level in (0..levels.n).filter(|level| wanted.as_ref().is_none_or(|wanted| wanted[*level])) {
                    tile.forget();
                    for (neighbour, homography) in neighbours.iter().zip(&homographies[level]) {
                        tile.compare(neighbour, homography);
                    }
                    for (row, of_row) in rows.clone().zip(tile.costs().chunks_exact(cols.len())) {
                        for (col, cost) in cols.clone().zip(of_row) {
                            costs[(row * width + col) * levels.n + level] = *cost;
                        }
                    }
                }
            }
        }
        Volume { width, height, n_levels: levels.n, costs }
    }
}

pub(super) fn homography(reference: &Ideal, other: &Ideal, z_m: f64) -> DMat3 {
    let (here, there) = (&reference.camera_from_map, &other.camera_from_map);
    let map_from_pixel = here.rotation.transpose() * reference.calibration().inverse();
    let pixel_from_map = other.calibration() * there.rotation;
    let shift = pixel_from_map * (here.centre() - there.centre());
    let m = map_from_pixel.row(2);
    let through = pixel_from_map * map_from_pixel;
    // Negated, because rays go down (`m·u < 0`) and a point in front shall have a positive last coordinate.
    let outer = DMat3::from_cols(shift * m.x, shift * m.y, shift * m.z);
    -(outer + through * (z_m - here.centre().z))
}

fn position(homography: &DMat3, pixel: DVec2) -> Option<DVec2> {
    let p = *homography * pixel.extend(1.0);
    (p.z > 0.0).then(|| p.truncate() / p.z)
}
