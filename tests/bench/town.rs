//! A grid of buildings like the paper's scenes, shared by the benchmarks.

use std::f64::consts::{FRAC_PI_2, PI};

use geo_types::polygon;
use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::frames::Rigid;
use sizeup::optimise::ViewInput;
use sizeup::render::PlacedCamera;
use sizeup::scene::{HeightBounds, Scene};
use sizeup::terrain::{GroundLevel, Terrain};

/// `side × side` buildings of 5 to 45 m, 35 m apart, and obliques from four sides 150 m above ground.
pub fn town(side: u32, n_stations: u32) -> (Scene, Vec<f32>, Vec<ViewInput>) {
    let polygons: Vec<_> = (0..side * side)
        .map(|i| {
            let (x, y) = (f64::from(i % side) * 35.0, f64::from(i / side) * 35.0);
            let (w, d) = (14.0 + f64::from(i * 7 % 9), 11.0 + f64::from(i * 5 % 11));
            polygon![(x: x, y: y), (x: x + w, y: y), (x: x + w, y: y + d), (x: x, y: y + d)]
        })
        .collect();
    let truth = (0..side * side).map(|i| 5.0 + (i * 13 % 40) as f32).collect();
    let ground = GroundLevel::flat(0.0);
    let footprints: Vec<_> = polygons.iter().map(|p| (p, ground)).collect();
    let bounds = HeightBounds { min_m: 2.0, max_m: 120.0 };
    let scene = Scene::new(&footprints, &Terrain::Constant(0.0), bounds, 500.0);
    let extent = f64::from(side) * 35.0;
    let mut views = Vec::new();
    for station in 0..n_stations * n_stations {
        for heading in 0..4 {
            let along = |i: u32| (f64::from(i) + 0.5) / f64::from(n_stations) * extent;
            let turn = DMat3::from_rotation_z(f64::from(heading) * FRAC_PI_2);
            let rotation = DMat3::from_rotation_x(PI - FRAC_PI_2 / 2.0) * turn;
            let look = rotation.transpose() * DVec3::Z;
            let target = DVec3::new(along(station % n_stations), along(station / n_stations), 0.0);
            let pose = Rigid::from_rotation_and_centre(rotation, target - look * (150.0 / -look.z));
            let placed = PlacedCamera::new(Camera::pinhole(448, 336, 360.0), pose, scene.origin);
            views.push(ViewInput { placed, is_oblique: true, key: views.len() as u64 });
        }
    }
    (scene, truth, views)
}
