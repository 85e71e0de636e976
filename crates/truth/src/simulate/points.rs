//! A sparse cloud as multi-view matching leaves it: places on surfaces, with noise, gaps where nothing can be matched, and
//! some blunders.
//!
//! Instances: building `i` is `i + 1`; ground, trees and cars have none, 0 in the file.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use sizeup_geo::cloud::Cloud;
use sizeup_heights::seed;
use sizeup_survey::View;

use super::chance::{between, happens, normal};
use super::config::PointConfig;
use super::eye::Eye;
use super::scene::{SeenObject, TracedScene};

/// Views a place must be seen in to be matched.
const LEAST_VIEWS: usize = 3;

/// The cloud, in the order of the views.
pub(super) fn scatter(scene: &TracedScene, views: &[View], config: &PointConfig, root_seed: u64) -> Cloud {
    let eyes: Vec<Eye> = views.iter().map(|view| Eye::new(view, &view.camera, scene)).collect();
    let found: Vec<Option<(DVec3, u32)>> = (0..views.len() * config.per_view)
        .into_par_iter()
        .map(|i| point(scene, views, &eyes[i % views.len()], i, config, root_seed))
        .collect();
    let (points, instances) = found.into_iter().flatten().map(|(at, i)| (at, Some(i).filter(|i| *i > 0))).unzip();
    Cloud { points, instances, ..Cloud::default() }
}

fn point(
    scene: &TracedScene,
    views: &[View],
    eye: &Eye,
    i: usize,
    config: &PointConfig,
    root_seed: u64,
) -> Option<(DVec3, u32)> {
    let mut rng = seed::stream(root_seed, "cloud", &[i as u64]);
    let camera = &views[i % views.len()].camera;
    let pixel = DVec2::new(
        between(&mut rng, 0.0, f64::from(camera.width_px)),
        between(&mut rng, 0.0, f64::from(camera.height_px)),
    );
    let hit = eye.look(scene, pixel).1?;
    let at = eye.ray(pixel)?.at(hit.t);
    if is_gap(at.as_dvec3(), config, root_seed) {
        return None;
    }
    let position = at.as_dvec3() + scene.origin.0;
    let sees = |view: &&View| {
        let from = (view.camera_from_map.centre() - scene.origin.0).as_vec3();
        view.pixel_of(position).is_some() && !scene.is_hidden(from, at)
    };
    if views.iter().filter(sees).take(LEAST_VIEWS).count() < LEAST_VIEWS {
        return None;
    }
    let sd = if happens(&mut rng, config.blunder_share) { config.blunder_m } else { config.noise_m };
    let error = sd * DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng));
    let instance = match hit.surface.seen() {
        SeenObject::Building(b) => b.at() as u32 + 1,
        SeenObject::Sky | SeenObject::Ground | SeenObject::Clutter => 0,
    };
    Some((position + error, instance))
}

/// Whether a place lies in a patch that nothing can be matched on; patches are cubes.
fn is_gap(at: DVec3, config: &PointConfig, root_seed: u64) -> bool {
    let cell = (at / config.gap_m).floor().as_i64vec3().to_array().map(|c| c as u64);
    happens(&mut seed::stream(root_seed, "cloud gaps", &cell), config.gap_share)
}
