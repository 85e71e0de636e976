//! Heights without evidence: one for all, or what the neighbours have.

use glam::DVec2;

use super::without_views;
use sizeup_heights::optimise::{Problem, Reason, Solution};
use sizeup_heights::stats;

/// The same height for every building, metres.
#[must_use]
pub fn constant(problem: &Problem<'_>, height_m: f64) -> Solution {
    without_views(vec![Some(height_m); problem.scene.prisms.len()], Some(Reason::Guessed))
}

/// Each building gets the median height of the `n` nearest buildings of a reference, itself left out. `reference` holds
/// map positions of centres and heights, metres; a centre within `same_m` of the building's own is the building itself.
#[must_use]
pub fn neighbourhood(problem: &Problem<'_>, reference: &[(DVec2, f64)], n: usize, same_m: f64) -> Solution {
    let origin = problem.scene.origin.0.truncate();
    let height = |prism: &sizeup_heights::scene::Prism| {
        let centre = prism.centre_at(prism.ground_z).as_dvec3().truncate() + origin;
        let mut near: Vec<(f64, f64)> = reference
            .iter()
            .map(|(at, height_m)| (at.distance(centre), *height_m))
            .filter(|(d, _)| *d > same_m)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        stats::median(&near.iter().take(n).map(|(_, height_m)| *height_m).collect::<Vec<_>>())
    };
    without_views(problem.scene.prisms.iter().map(height).collect(), Some(Reason::Guessed))
}
