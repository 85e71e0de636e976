//! Tie points as structure from motion leaves them: places on surfaces, seen in several photos, with small errors.

use glam::DVec2;
use rayon::prelude::*;

use sizeup_heights::seed;
use sizeup_survey::{TiePoint, View};

use super::chance::{between, normal};
use super::eye::Eye;
use super::scene::TracedScene;

/// Standard deviation of an observed position, pixels per axis.
const PIXEL_SD: f64 = 0.4;
/// Views a point must be seen in.
const LEAST_VIEWS: usize = 3;
/// Most views that a point is seen in.
const MOST_VIEWS: usize = 12;

/// At most `n` points, seen in three or more views each.
pub(super) fn collect(scene: &TracedScene, views: &[View], n: usize, root_seed: u64) -> Vec<TiePoint> {
    if views.is_empty() {
        return Vec::new();
    }
    let eyes: Vec<Eye> = views.iter().map(|view| Eye::new(view, &view.camera, scene)).collect();
    let tracks: Vec<Option<TiePoint>> =
        (0..n).into_par_iter().map(|i| track(scene, views, &eyes, i, root_seed)).collect();
    tracks.into_iter().flatten().collect()
}

fn track(scene: &TracedScene, views: &[View], eyes: &[Eye], i: usize, root_seed: u64) -> Option<TiePoint> {
    let mut rng = seed::stream(root_seed, "tie point", &[i as u64]);
    let first = &views[i % views.len()];
    let pixel = DVec2::new(
        between(&mut rng, 0.0, f64::from(first.camera.width_px)),
        between(&mut rng, 0.0, f64::from(first.camera.height_px)),
    );
    let eye = &eyes[i % views.len()];
    let at = eye.ray(pixel)?.at(eye.look(scene, pixel).1?.t);
    let position = at.as_dvec3() + scene.origin.0;
    let mut sightings = Vec::new();
    let mut errors = 0.0;
    for (k, view) in views.iter().enumerate() {
        if sightings.len() == MOST_VIEWS {
            break;
        }
        let Some(seen_at) = view.pixel_of(position) else { continue };
        let eye = (view.camera_from_map.centre() - scene.origin.0).as_vec3();
        if scene.is_hidden(eye, at) {
            continue;
        }
        let error = PIXEL_SD * DVec2::new(normal(&mut rng), normal(&mut rng));
        errors += error.length();
        sightings.push((k, seen_at + error));
    }
    let error_px = errors / sightings.len().max(1) as f64;
    (sightings.len() >= LEAST_VIEWS).then_some(TiePoint { position, sightings, error_px })
}
