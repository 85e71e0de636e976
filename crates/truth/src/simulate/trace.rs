//! True depth: what each pixel's ray meets, and where it would meet the ground if nothing stood there.

use glam::DVec2;
use rayon::prelude::*;

use sizeup_heights::camera::Camera;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

use super::eye::Eye;
use super::scene::{SeenObject, TracedScene};

/// The truth behind one depth prior: `H × W`, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueDepth {
    /// z-depth of what is seen, metres; `NaN` = sky.
    pub depth_m: Raster<f32>,
    /// z-depth of the ground along the same ray, metres; `NaN` = none.
    pub ground_m: Raster<f32>,
    /// Objects that pixels show.
    pub seen: Raster<SeenObject>,
}

/// Traces one view at a camera's size (the view's own, or the same lens reduced).
pub(super) fn true_depth(scene: &TracedScene, view: &View, camera: &Camera) -> TrueDepth {
    let eye = Eye::new(view, camera, scene);
    let (width, height) = (camera.width_px as usize, camera.height_px as usize);
    let pixels: Vec<(f32, f32, SeenObject)> = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let (ground, first) = eye.look(scene, pixel);
            let t = |hit: Option<super::scene::SurfaceHit>| hit.map_or(f32::NAN, |h| h.t);
            (t(first), t(ground), first.map_or(SeenObject::Sky, |h| h.surface.seen()))
        })
        .collect();
    let image = |f: fn(&(f32, f32, SeenObject)) -> f32| {
        Raster::from_vec(width, height, pixels.iter().map(f).collect()).expect("one value per pixel")
    };
    let seen = pixels.iter().map(|p| p.2).collect();
    TrueDepth {
        depth_m: image(|p| p.0),
        ground_m: image(|p| p.1),
        seen: Raster::from_vec(width, height, seen).expect("one value per pixel"),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use geo::Contains;
    use geo_types::Point;
    use glam::DVec3;

    use super::*;
    use crate::simulate::building::{BuildingKind, Placement, SimulatedBuilding};
    use crate::simulate::form::{self, BuildingForm, Rect};
    use crate::simulate::relief::MapRect;
    use crate::simulate::town::SimulatedTown;
    use crate::simulate::{ground_contact, pose};
    use sizeup_geo::terrain::Terrain;
    use sizeup_heights::camera::Distortion;
    use sizeup_heights::ids::BuildingIdx;

    const CENTRE: DVec2 = DVec2::new(565_500.0, 5_932_500.0);

    fn world(form: &BuildingForm) -> SimulatedTown {
        let terrain = Terrain::Constant(20.0);
        let at = Placement { origin: CENTRE, angle_rad: 0.3 };
        let building = SimulatedBuilding::raise(form, &at, &terrain, BuildingKind::House, "a".into());
        let extent = MapRect::around(CENTRE, 20.0, 20.0);
        SimulatedTown { buildings: vec![building], terrain, streets: None, extent, crs: "EPSG:25832".to_owned() }
    }

    fn view(tilt_deg: f64, distortion: Distortion) -> View {
        let camera = Camera { distortion, ..Camera::pinhole(160, 120, 140.0) };
        let back = 100.0 * f64::to_radians(tilt_deg).tan();
        let centre = (CENTRE - DVec2::new(0.0, back)).extend(120.0);
        let camera_from_map = pose(centre, 0.0, f64::to_radians(tilt_deg));
        View { id: "a.jpg".into(), camera: Arc::new(camera), camera_from_map, image: None }
    }

    /// Point where a pixel's ray meets a level, and the z-depth there.
    fn on_level(view: &View, col: usize, row: usize, z_m: f64) -> (DVec3, f64) {
        let ray = view.camera.unproject(DVec2::new(col as f64 + 0.5, row as f64 + 0.5)).unwrap();
        let direction = view.camera_from_map.rotation.transpose() * ray;
        let centre = view.camera_from_map.centre();
        let s = (z_m - centre.z) / direction.z;
        (centre + s * direction, s)
    }

    #[test]
    fn the_depth_of_a_flat_roof_is_where_its_plane_is() {
        let world = world(&form::flat(vec![Rect::sized(-8.0, -5.0, 16.0, 10.0).ring()], 12.0));
        let scene = TracedScene::new(&world, &[]);
        let brown = Distortion::Brown { k1: -0.08, k2: 0.02, k3: 0.0, p1: 1e-3, p2: -5e-4 };
        for (tilt_deg, lens) in [(0.0, Distortion::None), (45.0, Distortion::None), (45.0, brown)] {
            let view = view(tilt_deg, lens);
            let truth = true_depth(&scene, &view, &view.camera);
            let mut n_roof = 0;
            for (row, col) in (0..120).flat_map(|r| (0..160).map(move |c| (r, c))) {
                let (roof, depth) = on_level(&view, col, row, 32.0);
                let (ground, ground_depth) = on_level(&view, col, row, 20.0);
                assert!((f64::from(truth.ground_m[(col, row)]) - ground_depth).abs() < 2e-3);
                if world.buildings[0].footprint.contains(&Point::new(roof.x, roof.y)) {
                    n_roof += 1;
                    assert!((f64::from(truth.depth_m[(col, row)]) - depth).abs() < 2e-3, "{tilt_deg} {col} {row}");
                    assert_eq!(truth.seen[(col, row)], SeenObject::Building(BuildingIdx(0)));
                } else if truth.seen[(col, row)] == SeenObject::Ground {
                    assert!(!world.buildings[0].footprint.contains(&Point::new(ground.x, ground.y)));
                }
            }
            assert!(n_roof > 100, "{n_roof}");
        }
    }

    #[test]
    fn a_building_hides_the_ground_by_its_volume_in_every_direction() {
        // Seen from very far above, the roof's pixels times their size are the footprint's area.
        let world = world(&form::gable(Rect::sized(-8.0, -5.0, 16.0, 10.0), 6.0, 9.0));
        let scene = TracedScene::new(&world, &[]);
        let far = pose(CENTRE.extend(20.0 + 4000.0), 0.2, 0.0);
        let camera = Arc::new(Camera::pinhole(200, 200, 40_000.0));
        let view = View { id: "a.jpg".into(), camera, camera_from_map: far, image: None };
        let truth = true_depth(&scene, &view, &view.camera);
        let building = SeenObject::Building(BuildingIdx(0));
        let seen = truth.seen.data().iter().zip(truth.depth_m.data()).filter(|(s, _)| **s == building);
        let (mut area, mut volume) = (0.0, 0.0);
        for (_, &depth) in seen {
            let pixel_m2 = (f64::from(depth) / 40_000.0).powi(2);
            area += pixel_m2;
            volume += pixel_m2 * (4000.0 - f64::from(depth));
        }
        assert!((area - 160.0).abs() < 1.0, "{area}");
        assert!((volume - 160.0 * 7.5).abs() < 10.0, "{volume}");
    }

    #[test]
    fn masks_show_the_footprint_on_the_ground_not_the_roof() {
        let world = world(&form::flat(vec![Rect::sized(-8.0, -5.0, 16.0, 10.0).ring()], 30.0));
        let view = view(10.0, Distortion::None);
        let mask = ground_contact(&view, &world.buildings, &world.terrain);
        let mut n_inside = 0;
        for (row, col) in (0..120).flat_map(|r| (0..160).map(move |c| (r, c))) {
            let (ground, _) = on_level(&view, col, row, 20.0);
            let inside = world.buildings[0].footprint.contains(&Point::new(ground.x, ground.y));
            assert_eq!(mask[(col, row)], u16::from(inside));
            n_inside += usize::from(inside);
        }
        assert!(n_inside > 100, "{n_inside}");
    }
}
