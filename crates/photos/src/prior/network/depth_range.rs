//! The depths at which a network that matches photos looks for a view's surfaces.
//!
//! ```text
//! nearest  = 0.95 · least depth at which a ray of the view meets the level of the tallest possible roofs
//! farthest = 1.05 · greatest depth at which one meets the lowest ground
//! ```
//!
//! Depth along the optical axis, metres. Roofs reach at most nine tenths of the way from the highest ground to the camera, so
//! that a low flight has a range at all.

use glam::DVec2;

use sizeup_survey::View;

/// Most of the way from the ground to the camera that roofs may take.
const ROOM_FOR_ROOFS: f64 = 0.9;
/// Share added on both sides: terrain and poses are not exact.
const SPARE: f64 = 0.05;
/// A ray that rises, or meets the ground farther than this many times the nearest depth, sees what no height comes from.
const FARTHEST_OF_NEAREST: f64 = 8.0;
/// Rays per side of the view, its borders among them.
const LATTICE: usize = 5;

/// Nearest and farthest depth, metres, over ground between these heights with roofs of up to `tallest_m` on it; `None` for a view that looks at none, or stands
/// below it.
pub(super) fn of(view: &View, (lowest_m, highest_m): (f64, f64), tallest_m: f64) -> Option<[f64; 2]> {
    let centre = view.camera_from_map.centre();
    let roofs_m = highest_m + tallest_m.min(ROOM_FOR_ROOFS * (centre.z - highest_m));
    let at = |i: usize, extent: u32| i as f64 / (LATTICE - 1) as f64 * f64::from(extent);
    let falls = (0..LATTICE * LATTICE).filter_map(|i| {
        let pixel = DVec2::new(at(i % LATTICE, view.camera.width_px), at(i / LATTICE, view.camera.height_px));
        let ray = view.camera_from_map.rotation.transpose() * view.camera.unproject(pixel)?;
        (ray.z < 0.0).then_some(-ray.z)
    });
    let (least, most) = falls.fold((f64::INFINITY, 0.0_f64), |(least, most), fall| (least.min(fall), most.max(fall)));
    let nearest_m = (centre.z - roofs_m) / most * (1.0 - SPARE);
    let farthest_m = (centre.z - lowest_m) / least * (1.0 + SPARE);
    let is_usable = most > 0.0 && nearest_m > 0.0 && nearest_m.is_finite();
    is_usable.then(|| [nearest_m, farthest_m.min(nearest_m * FARTHEST_OF_NEAREST)])
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3};

    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;

    fn view(tilt_deg: f64, z_m: f64) -> View {
        let down = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        View {
            id: "a".into(),
            camera: Arc::new(Camera::pinhole(400, 300, 300.0)),
            camera_from_map: Rigid::from_rotation_and_centre(
                DMat3::from_rotation_x(tilt_deg.to_radians()) * down,
                DVec3::new(0.0, 0.0, z_m),
            ),
            image: None,
        }
    }

    #[test]
    fn a_view_straight_down_looks_from_the_tallest_roof_to_the_ground() {
        let [nearest, farthest] = of(&view(0.0, 110.0), (10.0, 10.0), 50.0).unwrap();
        assert!((nearest - 47.5).abs() < 1e-9 && (farthest - 105.0).abs() < 1e-9, "{nearest} {farthest}");
    }

    #[test]
    fn the_horizon_does_not_take_the_range_to_infinity_and_a_camera_below_ground_has_none() {
        let [nearest, farthest] = of(&view(70.0, 110.0), (10.0, 10.0), 50.0).unwrap();
        assert!((farthest / nearest - FARTHEST_OF_NEAREST).abs() < 1e-9);
        assert!(of(&view(0.0, 5.0), (10.0, 10.0), 50.0).is_none());
        assert!(of(&view(180.0, 110.0), (10.0, 10.0), 50.0).is_none());
    }
}
