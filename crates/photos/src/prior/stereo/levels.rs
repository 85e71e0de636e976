//! The heights of the planes that a view is swept with.
//!
//! A neighbour sees a point at height `z` move along a line as `z` changes, by much more near the camera than near the
//! ground. Levels therefore lie evenly in the inverse of the distance below the camera, in which steps on that line are
//! even too:
//!
//! ```text
//! 1 / (C.z − z(k)) = 1 / (C.z − z(0)) + k · step        C: the view's projection centre
//! ```

use std::ops::RangeInclusive;

use glam::{DMat3, DVec2};
use serde::Serialize;

use super::sweep::{homography, position};
use super::{BELOW_GROUND_M, StereoConfig};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::picture::PosedCamera;
use sizeup_heights::raster::Raster;

/// Greatest move of a neighbour's pixels from one level to the next, pixels: less repeats, more skips.
const STEP_PX: f64 = 0.75;
/// Levels at which it is probed how far pixels move.
const N_PROBES: usize = 65;
/// Pixels along a side of the view for which it is probed.
const PROBED_SIDE: usize = 4;
/// Fewest levels that a range of heights is divided into.
const LEAST_LEVELS: usize = 8;
/// Share of its clearance above the highest ground within which a camera sees no roof from above.
const BESIDE_CAMERA_SHARE: f64 = 0.05;
/// Share of the clearance above the ground that surfaces found at half the size may be off by.
const SPARE_SHARE: f64 = 0.02;

/// Heights of planes, ascending, evenly spaced in the inverse of the distance below the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Levels {
    /// Level of the view's projection centre, metres.
    camera_z_m: f64,
    /// Lowest level, metres.
    pub from_m: f64,
    /// The highest, metres; below the camera.
    pub to_m: f64,
    /// Number of levels, at least two.
    pub n: usize,
}

impl Levels {
    /// The planes of a view, `None` if it has no ground in sight. Their ends are whole metres: a part of a terrain model
    /// gives the same ones as the whole, most of the time.
    pub(super) fn of(
        reference: &PosedCamera,
        others: &[PosedCamera],
        terrain: &Terrain,
        config: &StereoConfig,
    ) -> Option<Self> {
        let (lowest, highest) = ground_in_sight(reference, terrain)?;
        let camera_z_m = reference.camera_from_map.centre().z;
        let from_m = (lowest - BELOW_GROUND_M).floor();
        let beside_camera_m = camera_z_m - BESIDE_CAMERA_SHARE * (camera_z_m - highest).abs();
        let to_m = (highest + config.max_height_m).ceil().min(beside_camera_m);
        (to_m > from_m).then(|| Self::between(from_m, to_m, reference, others, config.max_levels))
    }

    /// As many as it takes for no neighbour to move by more than a fraction of a pixel from one to the next.
    fn between(from_m: f64, to_m: f64, reference: &PosedCamera, others: &[PosedCamera], max_levels: usize) -> Self {
        let few = Self { camera_z_m: reference.camera_from_map.centre().z, from_m, to_m, n: N_PROBES };
        let longest_px = others.iter().map(|other| few.longest_step_px(reference, other)).fold(0.0, f64::max);
        let n = (longest_px * (N_PROBES - 1) as f64 / STEP_PX).ceil() as usize + 1;
        Self { n: n.clamp(LEAST_LEVELS, max_levels), ..few }
    }

    /// Longest move of a pixel of the view in a neighbour from one level to the next, while it sees it.
    fn longest_step_px(&self, reference: &PosedCamera, other: &PosedCamera) -> f64 {
        let size =
            |ideal: &PosedCamera| DVec2::new(f64::from(ideal.camera.width_px), f64::from(ideal.camera.height_px));
        let homographies: Vec<DMat3> =
            (0..self.n).map(|level| homography(reference, other, self.height_m(level as f64))).collect();
        let of_pixel = |i: usize| {
            let share = (DVec2::new((i % PROBED_SIDE) as f64, (i / PROBED_SIDE) as f64) + 0.5) / PROBED_SIDE as f64;
            let place = |homography: &DMat3| {
                let place = position(homography, share * size(reference))?;
                (place.cmpge(DVec2::ZERO).all() && place.cmple(size(other)).all()).then_some(place)
            };
            let places: Vec<Option<DVec2>> = homographies.iter().map(place).collect();
            places.windows(2).filter_map(|pair| Some((pair[1]? - pair[0]?).length())).fold(0.0, f64::max)
        };
        (0..PROBED_SIDE * PROBED_SIDE).map(of_pixel).fold(0.0, f64::max)
    }

    /// The part in which a picture of half the size found surfaces, and a share of their range above them, with planes as
    /// fine as this picture needs; all of them where it found nothing.
    pub(super) fn around(
        &self,
        found_m: &Raster<f32>,
        above_share: f64,
        reference: &PosedCamera,
        others: &[PosedCamera],
        config: &StereoConfig,
    ) -> Self {
        let found = found_m.data().iter().filter(|z| !z.is_nan()).map(|z| f64::from(*z));
        let [least, most] = found.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, m], z| [l.min(z), m.max(z)]);
        if least > most {
            return *self;
        }
        let spare_m = SPARE_SHARE * (self.camera_z_m - least);
        let from_m = (least - spare_m).floor().max(self.from_m);
        let to_m = (most + above_share * (most - least) + spare_m).ceil().min(self.to_m);
        Self::between(from_m, to_m, reference, others, config.max_levels)
    }

    /// Height of a level with a fraction.
    pub(super) fn height_m(&self, level: f64) -> f64 {
        self.camera_z_m - 1.0 / (self.inverse(self.from_m) + level * self.step())
    }

    /// The level of a height, with a fraction; outside the levels where the height is.
    pub(super) fn level(&self, z_m: f64) -> f64 {
        (self.inverse(z_m.min(self.to_m)) - self.inverse(self.from_m)) / self.step()
    }

    /// From one level to the next around a height, metres.
    pub(super) fn step_m(&self, z_m: f64) -> f64 {
        (self.camera_z_m - z_m).powi(2) * self.step()
    }

    /// The levels that lie within so many steps of coarser ones around a level.
    pub(super) fn near(&self, level: usize, n_steps: f64, coarser: &Self) -> RangeInclusive<usize> {
        let around = (n_steps * coarser.step() / self.step()).ceil() as usize;
        level.saturating_sub(around)..=(level + around).min(self.n - 1)
    }

    /// About a metre apart at height 0, for a camera so high above it.
    #[cfg(test)]
    pub(super) fn every_metre(camera_z_m: f64) -> Self {
        Self { camera_z_m, from_m: -2.0, to_m: 20.0, n: 28 }
    }

    /// Some between two heights.
    #[cfg(test)]
    pub(super) fn from_to(camera_z_m: f64, from_m: f64, to_m: f64) -> Self {
        Self { camera_z_m, from_m, to_m, n: 50 }
    }

    fn step(&self) -> f64 {
        (self.inverse(self.to_m) - self.inverse(self.from_m)) / (self.n - 1) as f64
    }

    fn inverse(&self, z_m: f64) -> f64 {
        1.0 / (self.camera_z_m - z_m)
    }
}

/// Lowest and highest ground where the view looks; the whole terrain's where it says nothing there.
fn ground_in_sight(reference: &PosedCamera, terrain: &Terrain) -> Option<(f64, f64)> {
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

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;

    /// Straight down from 100 m, so far east; 400 × 300 pixels, 300 of them to a metre at a metre.
    fn above(east_m: f64) -> PosedCamera {
        let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        PosedCamera {
            camera: Camera::pinhole(400, 300, 300.0),
            camera_from_map: Rigid::from_rotation_and_centre(rotation, DVec3::new(east_m, 0.0, 100.0)),
        }
    }

    fn levels(other: &PosedCamera, max_height_m: f64) -> Levels {
        let config = StereoConfig { max_height_m, max_levels: 255, ..StereoConfig::default() };
        Levels::of(&above(0.0), std::slice::from_ref(other), &Terrain::Constant(0.0), &config).unwrap()
    }

    #[test]
    fn every_level_moves_a_neighbours_pixels_by_the_same() {
        let (here, there) = (above(0.0), above(20.0));
        let levels = levels(&there, 60.0);
        let place = |k: usize| {
            position(&homography(&here, &there, levels.height_m(k as f64)), DVec2::new(200.0, 150.0)).unwrap()
        };
        let steps: Vec<f64> = (1..levels.n).map(|k| (place(k) - place(k - 1)).length()).collect();
        assert!(steps.iter().all(|step| (step - steps[0]).abs() < 1e-9 && *step <= STEP_PX), "{steps:?}");
        assert_eq!([levels.height_m(0.0), levels.height_m((levels.n - 1) as f64)].map(f64::round), [-5.0, 60.0]);
        // By the intercept theorem a metre is 0.6 px on the ground and 3.75 px 60 m above it.
        assert!((levels.step_m(0.0) / levels.step_m(60.0) - 6.25).abs() < 1e-9);
        assert!((levels.level(levels.height_m(7.3)) - 7.3).abs() < 1e-9);
    }

    #[test]
    fn a_neighbour_that_does_not_see_the_middle_of_the_view_asks_for_levels_too() {
        let aside = levels(&above(90.0), 30.0);
        assert!(aside.n > 50, "{aside:?}");
    }

    #[test]
    fn levels_keep_to_where_surfaces_were_found_and_to_all_where_there_were_none() {
        let (here, there) = (above(0.0), above(20.0));
        let all = levels(&there, 60.0);
        let mut found = Raster::filled(4, 4, f32::NAN);
        let config = StereoConfig { max_levels: 255, ..StereoConfig::default() };
        let around =
            |found: &Raster<f32>, share: f64| all.around(found, share, &here, std::slice::from_ref(&there), &config);
        assert_eq!(around(&found, 0.5), all);
        found.data_mut()[..2].copy_from_slice(&[0.0, 20.0]);
        let part = around(&found, 0.5);
        assert_eq!((part.from_m, part.to_m), (-2.0, 32.0));
        assert!(part.n < all.n && (part.step_m(0.0) / all.step_m(0.0) - 1.0).abs() < 0.05, "{part:?} of {all:?}");
    }
}
