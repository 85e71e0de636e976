//! How well the neighbours agree with a view at every height level.
//!
//! A pixel `u` of the view, seen through the plane at height `z`, lies in a neighbour at `H(z)·u`. With projection
//! centres `C`, `M = Rᵣᵀ·Kᵣ⁻¹` (pixel to direction in the map), `m` its third row and `B = Kₛ·Rₛ·M`:
//!
//! ```text
//! H(z) = (Kₛ·Rₛ·(Cᵣ − Cₛ)) ⊗ m + (z − Cᵣ.z)·B
//! ```

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use serde::Serialize;

use super::StereoConfig;
use super::correlate::{Neighbour, Strip, Windows};
use super::picture::{Ideal, Picture};
use crate::camera::Camera;
use crate::terrain::Terrain;

/// How far a neighbour's pixels may move from one level to the next, pixels: less repeats, more skips.
const STEP_PX: f64 = 0.75;
/// Rows compared at a time: what is known of so many pixels stays in the processor's cache.
const STRIP_ROWS: usize = 24;

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

/// The mismatch of every pixel with its neighbours at every level. On one thread: views are many, and each takes some
/// 60 MB meanwhile.
pub(super) fn volume(reference: &Picture, others: &[Arc<Picture>], levels: &Levels, radius_px: usize) -> Volume {
    let (width, height) = (reference.grey().width(), reference.grey().height());
    let windows = Windows::new(reference.grey(), radius_px);
    let neighbours: Vec<Neighbour> = others.iter().map(|other| Neighbour::new(other.grey())).collect();
    let mut costs = vec![0; width * height * levels.n];
    for (i, costs) in costs.chunks_mut(STRIP_ROWS * width * levels.n).enumerate() {
        let first_row = i * STRIP_ROWS;
        let mut strip = Strip::new(&windows, first_row..(first_row + STRIP_ROWS).min(height), neighbours.len());
        for level in 0..levels.n {
            let z_m = levels.height_m(level as f64);
            strip.forget();
            for (neighbour, other) in neighbours.iter().zip(others) {
                strip.compare(neighbour, &homography(reference.ideal(), other.ideal(), z_m));
            }
            strip.write_costs(costs.iter_mut().skip(level).step_by(levels.n));
        }
    }
    Volume { width, height, n_levels: levels.n, costs }
}

fn homography(reference: &Ideal, other: &Ideal, z_m: f64) -> DMat3 {
    let calibration = |camera: &Camera| {
        DMat3::from_cols(
            DVec3::new(camera.fx_px, 0.0, 0.0),
            DVec3::new(0.0, camera.fy_px, 0.0),
            DVec3::new(camera.cx_px, camera.cy_px, 1.0),
        )
    };
    let (here, there) = (&reference.camera_from_map, &other.camera_from_map);
    let map_from_pixel = here.rotation.transpose() * calibration(&reference.camera).inverse();
    let pixel_from_map = calibration(&other.camera) * there.rotation;
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
