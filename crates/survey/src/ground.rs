//! What a photo shows on the ground: its footprint on a level plane, and where its axis meets the terrain.
//!
//! The footprint is followed through the lens model in steps, because distorted edges are curved. Rays at or above the
//! horizon never meet the ground: they end at a stated angle off the nadir.

use glam::{DVec2, DVec3};

use super::View;
use sizeup_geo::terrain::Terrain;

/// Points per image side of a footprint.
const STEPS_PER_SIDE: usize = 8;
/// Rays flatter than this off the nadir end there: 80° is 5.7 flying heights away.
pub const MAX_OFF_NADIR_DEG: f64 = 80.0;
/// Steps of the search for the terrain along an axis; each halves the error, metres at first.
const AXIS_STEPS: usize = 12;

/// Footprint of the photo on the plane at `ground_m`, easting and northing, open ring; empty where the camera is below
/// the plane or its lens model covers no corner.
#[must_use]
pub fn footprint(view: &View, ground_m: f64) -> Vec<DVec2> {
    let (w, h) = (f64::from(view.camera.width_px), f64::from(view.camera.height_px));
    let corners = [DVec2::ZERO, DVec2::new(w, 0.0), DVec2::new(w, h), DVec2::new(0.0, h)];
    let mut ring = Vec::with_capacity(4 * STEPS_PER_SIDE);
    for (i, corner) in corners.iter().enumerate() {
        let next = corners[(i + 1) % 4];
        for step in 0..STEPS_PER_SIDE {
            let pixel = corner.lerp(next, step as f64 / STEPS_PER_SIDE as f64);
            ring.extend(on_plane(view, pixel, ground_m));
        }
    }
    ring
}

/// Point where the ray through a pixel meets the plane at `ground_m`.
pub(super) fn on_plane(view: &View, pixel: DVec2, ground_m: f64) -> Option<DVec2> {
    let ray = view.camera_from_map.inverse().vector(view.camera.unproject(pixel)?);
    let centre = view.camera_from_map.centre();
    let height_m = centre.z - ground_m;
    (height_m > 0.0).then(|| centre.truncate() + reach(ray, height_m))
}

/// Horizontal way of a ray until it is `height_m` down, cut at [`MAX_OFF_NADIR_DEG`].
fn reach(ray: DVec3, height_m: f64) -> DVec2 {
    let furthest_m = height_m * MAX_OFF_NADIR_DEG.to_radians().tan();
    let aside = ray.truncate();
    let descends = -ray.z;
    if descends > 0.0 && aside.length() * height_m <= furthest_m * descends {
        aside * (height_m / descends)
    } else {
        aside.normalize_or_zero() * furthest_m
    }
}

/// Point of the terrain that the image's centre looks at, easting and northing; `None` where the camera is below the ground.
#[must_use]
pub fn centre_on_ground(view: &View, terrain: &Terrain) -> Option<DVec2> {
    let camera = &view.camera;
    let pixel = DVec2::new(f64::from(camera.width_px) / 2.0, f64::from(camera.height_px) / 2.0);
    let position = view.camera_from_map.centre();
    let (low_m, high_m) = terrain.range()?;
    let mut ground_m = terrain.height_at(position.x, position.y).unwrap_or(0.5 * (low_m + high_m));
    let mut place = on_plane(view, pixel, ground_m)?;
    for _ in 0..AXIS_STEPS {
        let Some(there_m) = terrain.height_at(place.x, place.y) else { break };
        ground_m = 0.5 * (ground_m + there_m);
        place = on_plane(view, pixel, ground_m)?;
    }
    Some(place)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;
    use sizeup_heights::ids::ViewId;

    fn view(tilt_deg: f64) -> View {
        // Image top to the north, tilted towards it.
        let nadir = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let rotation = DMat3::from_rotation_x(-tilt_deg.to_radians()) * nadir;
        View {
            id: ViewId::from("a"),
            camera: Arc::new(Camera::pinhole(400, 300, 1000.0)),
            camera_from_map: Rigid::from_rotation_and_centre(rotation, DVec3::new(1000.0, 2000.0, 150.0)),
            image: None,
        }
    }

    #[test]
    fn a_nadir_photo_covers_its_size_over_focal_length_times_height() {
        let footprint = footprint(&view(0.0), 50.0);
        let low = footprint.iter().copied().reduce(DVec2::min).unwrap();
        let high = footprint.iter().copied().reduce(DVec2::max).unwrap();
        assert!((low - DVec2::new(980.0, 1985.0)).length() < 1e-9, "{low}");
        assert!((high - DVec2::new(1020.0, 2015.0)).length() < 1e-9, "{high}");
    }

    #[test]
    fn an_oblique_axis_meets_the_ground_at_height_times_the_tangent() {
        let place = centre_on_ground(&view(45.0), &Terrain::Constant(50.0)).unwrap();
        assert!((place - DVec2::new(1000.0, 2100.0)).length() < 1e-9, "{place}");
    }

    #[test]
    fn rays_at_the_horizon_end_somewhere() {
        let footprint = footprint(&view(85.0), 50.0);
        assert!(footprint.iter().all(|p| p.distance(DVec2::new(1000.0, 2000.0)) < 600.0));
        assert!(super::footprint(&view(0.0), 200.0).is_empty(), "a camera below the plane sees none of it");
    }
}
