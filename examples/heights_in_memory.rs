//! Heights of two buildings from footprints, poses and depth maps in memory: no file, no GDAL, no network.
//!
//! `cargo run --release --example heights_in_memory`. The depth maps are rendered here; a program of yours has a network's.

#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use geo_types::{Polygon, polygon};
use glam::DVec3;
use sizeup::heights::prelude::*;
use sizeup::render::{PlacedCamera, image::SceneTracer};
use sizeup::scene::{HeightBounds, Scene};

const GROUND_M: f64 = 48.0;
const TRUE_HEIGHTS_M: [f32; 2] = [9.0, 21.5];

fn main() {
    let house = polygon![(x: 0.0, y: 0.0), (x: 12.0, y: 0.0), (x: 12.0, y: 10.0), (x: 0.0, y: 10.0)];
    let tower = polygon![(x: 25.0, y: 5.0), (x: 45.0, y: 5.0), (x: 45.0, y: 22.0), (x: 25.0, y: 22.0)];
    let terrain = Terrain::Constant(GROUND_M);
    let views = photos_around(DVec3::new(22.0, 11.0, GROUND_M), &[&house, &tower], &terrain);

    let buildings = [house, tower].map(|footprint| Building { footprint, ground: GroundLevel::flat(GROUND_M) });
    let heights = estimate_heights(&buildings, &terrain, &views, &Settings::default());

    for (solved, truth_m) in heights.iter().zip(TRUE_HEIGHTS_M) {
        let (height_m, sigma_m) = (solved.height_m().unwrap(), solved.sigma_m().unwrap());
        println!("{height_m:.2} ± {sigma_m:.2} m from {} photos (truth {truth_m} m)", solved.views().len());
        assert!((height_m - f64::from(truth_m)).abs() < 0.5, "within half a metre");
    }
}

/// Eight oblique photos around a place, each with a depth map that is right up to scale and shift.
fn photos_around(place: DVec3, footprints: &[&Polygon<f64>], terrain: &Terrain) -> Vec<View> {
    let camera = Camera::pinhole(400, 300, 380.0);
    let grounded: Vec<_> = footprints.iter().map(|footprint| (*footprint, GroundLevel::flat(GROUND_M))).collect();
    let scene = Scene::new(&grounded, terrain, HeightBounds { min_m: 2.0, max_m: 60.0 }, 200.0);
    let tracer = SceneTracer::new(&scene, &TRUE_HEIGHTS_M);
    let photo = |i: u32| {
        let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_4).sin_cos();
        let camera_from_map = Rigid::looking_at(place + DVec3::new(90.0 * cos, 90.0 * sin, 110.0), place);
        let depth = tracer.render(&PlacedCamera::new(camera.clone(), camera_from_map, scene.origin)).depth;
        let prior = DepthPrior {
            values: depth.map(|metres| 0.02 * metres + 0.7),
            kind: PriorKind::Depth,
            geometry: PriorGeometry::ZDepth,
        };
        View {
            name: format!("photo {i}"),
            camera: camera.clone(),
            camera_from_map,
            prior: Some(prior),
            picture: None,
            green: None,
        }
    };
    (0..8).map(photo).collect()
}
