//! Which photos a view is compared with.
//!
//! A wide angle between two rays gives precise heights and dissimilar pictures, a narrow one the opposite. The score
//! of a candidate is the share of the view's ground that it sees, weighted by a bell over the angle under which they
//! see it (best at 15°) and by how alike their resolutions are.

use glam::{DVec2, DVec3};

use crate::survey::View;
use crate::terrain::Terrain;

/// Angle between two rays at which pictures are alike and heights are precise, radians.
const BEST_ANGLE_RAD: f64 = 0.26;
/// Width of the bell over `ln(angle)`.
const ANGLE_SPREAD: f64 = 0.7;
/// Angles below which a height error explodes, and above which pictures have little in common, radians.
const ANGLES_RAD: std::ops::Range<f64> = 0.035..0.9;
/// Least score worth comparing.
const LEAST_SCORE: f64 = 0.05;
/// Ground points per side of the view.
const GRID: usize = 5;

/// Up to `n` of `views`, best first; the view itself is never one. Each is chosen for what it adds: ground that others
/// see already counts by the square root, so that the view's corners get neighbours too.
pub(super) fn choose<'a>(view: &View, views: &'a [View], terrain: &Terrain, n: usize) -> Vec<&'a View> {
    let ground = ground_points(view, terrain);
    let mut candidates: Vec<(&View, Vec<f64>)> = views
        .iter()
        .filter(|other| other.id != view.id)
        .map(|other| (other, ground.iter().map(|place| score(view, other, *place)).collect::<Vec<f64>>()))
        .filter(|(_, scores)| share_of_lattice(scores.iter()) > LEAST_SCORE)
        .collect();
    candidates.sort_by(|a, b| a.0.id.cmp(&b.0.id));
    let mut chosen = Vec::with_capacity(n);
    let mut covered = vec![0.0_f64; ground.len()];
    while chosen.len() < n && !candidates.is_empty() {
        let gain =
            |scores: &[f64]| -> f64 { scores.iter().zip(&covered).map(|(s, c)| (c + s).sqrt() - c.sqrt()).sum() };
        let gains: Vec<f64> = candidates.iter().map(|(_, scores)| gain(scores)).collect();
        // Ties go to the first name.
        let best = (0..gains.len()).rev().max_by(|&a, &b| gains[a].total_cmp(&gains[b])).unwrap_or(0);
        let (other, scores) = candidates.remove(best);
        covered.iter_mut().zip(scores).for_each(|(c, s)| *c += s);
        chosen.push(other);
    }
    chosen
}

/// Of the whole lattice, so that rays into the sky count as ground not seen.
fn share_of_lattice<'a>(scores: impl Iterator<Item = &'a f64>) -> f64 {
    scores.sum::<f64>() / (GRID * GRID) as f64
}

/// Where a lattice of the view's pixels meets level ground at the terrain's middle height.
pub(super) fn ground_points(view: &View, terrain: &Terrain) -> Vec<DVec3> {
    let Some((lowest, highest)) = terrain.range() else { return Vec::new() };
    let ground_z = f64::midpoint(lowest, highest);
    let centre = view.camera_from_map.centre();
    let to_map = view.camera_from_map.rotation.transpose();
    let at = |i: usize, extent: u32| (i as f64 + 0.5) / GRID as f64 * f64::from(extent);
    let pixels =
        (0..GRID * GRID).map(|i| DVec2::new(at(i % GRID, view.camera.width_px), at(i / GRID, view.camera.height_px)));
    let place = |pixel: DVec2| {
        let ray = to_map * view.camera.unproject(pixel)?;
        let depth = (ground_z - centre.z) / ray.z;
        (depth > 0.0 && depth.is_finite()).then(|| centre + depth * ray)
    };
    pixels.filter_map(place).collect()
}

/// How useful another view is at one place on the ground, 0 to 1.
fn score(view: &View, other: &View, place: DVec3) -> f64 {
    let (here, there) = (view.camera_from_map.centre(), other.camera_from_map.centre());
    let is_seen =
        other.camera.project(other.camera_from_map.point(place)).is_some_and(|pixel| other.camera.contains(pixel));
    let angle_rad = (here - place).angle_between(there - place);
    if !is_seen || !ANGLES_RAD.contains(&angle_rad) {
        return 0.0;
    }
    let off = (angle_rad / BEST_ANGLE_RAD).ln() / ANGLE_SPREAD;
    let size_ratio = (here.distance(place) * other.camera.fx_px * f64::from(view.camera.width_px))
        / (there.distance(place) * view.camera.fx_px * f64::from(other.camera.width_px));
    (-0.5 * off * off).exp() * size_ratio.min(1.0 / size_ratio)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use crate::camera::Camera;
    use crate::frames::Rigid;

    /// Straight down from 100 m above ground, this far east.
    fn view(name: &str, east_m: f64) -> View {
        let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        View {
            id: name.into(),
            camera: Arc::new(Camera::pinhole(400, 300, 300.0)),
            camera_from_map: Rigid::from_rotation_and_centre(rotation, DVec3::new(east_m, 0.0, 100.0)),
            image: None,
        }
    }

    #[test]
    fn fair_angles_come_first_and_twins_and_strangers_not_at_all() {
        let views = [view("self", 0.0), view("twin", 0.5), view("far", 60.0), view("fair", 27.0), view("away", 300.0)];
        let chosen = choose(&views[0], &views, &Terrain::Constant(0.0), 9);
        assert_eq!(chosen.iter().map(|v| v.id.0.as_str()).collect::<Vec<_>>(), ["fair", "far"]);
    }
}
