//! Which photos a view is looked at together with: by stereo, and by networks that take several.
//!
//! A wide angle between two rays gives precise heights and dissimilar pictures, a narrow one the opposite. The score
//! of a candidate is the share of the view's ground that it sees, weighted by a bell over the angle under which they
//! see it (best at 15°) and by how alike their resolutions are.

use glam::{DVec2, DVec3};

use sizeup_geo::terrain::Terrain;
use sizeup_survey::View;

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

/// Views of a survey that can be each other's neighbours.
#[derive(Debug)]
pub(crate) struct Neighbours {
    views: Vec<View>,
    /// Area that each can see of the ground at `ground_z_m`; `None` where that has no end.
    extents: Vec<Option<ViewExtent>>,
    /// The terrain's middle height; `None` without any.
    ground_z_m: Option<f64>,
}

impl Neighbours {
    pub(crate) fn new(views: Vec<View>, terrain: &Terrain) -> Self {
        let ground_z_m = terrain.range().map(|(lowest, highest)| f64::midpoint(lowest, highest).round());
        let extents = views.iter().map(|view| ViewExtent::of(view, ground_z_m?)).collect();
        Self { views, extents, ground_z_m }
    }

    /// Up to `n` views, best first; the view itself is never one. Each is chosen for what it adds: ground that others
    /// see already counts by the square root, so that the view's corners get neighbours too.
    pub(crate) fn choose(&self, view: &View, n: usize) -> Vec<&View> {
        let Some(ground_z_m) = self.ground_z_m else { return Vec::new() };
        let ground = ground_points(view, ground_z_m);
        let sees_some = |extent: &Option<ViewExtent>| {
            extent.as_ref().is_none_or(|extent| ground.iter().any(|place| extent.contains(place.truncate())))
        };
        let mut candidates: Vec<(&View, Vec<f64>)> = self
            .views
            .iter()
            .zip(&self.extents)
            .filter(|(other, extent)| other.id != view.id && sees_some(extent))
            .map(|(other, _)| (other, ground.iter().map(|place| score(view, other, *place)).collect::<Vec<f64>>()))
            .filter(|(_, scores)| share_of_lattice(scores.iter()) > LEAST_SCORE)
            .collect();
        candidates.sort_by(|a, b| a.0.id.cmp(&b.0.id));
        most_useful(candidates, ground.len(), n)
    }
}

/// One after the other, each for what it adds to those before it.
fn most_useful(mut candidates: Vec<(&View, Vec<f64>)>, n_places: usize, n: usize) -> Vec<&View> {
    let mut chosen = Vec::with_capacity(n);
    let mut covered = vec![0.0_f64; n_places];
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

/// A rectangle on the map that holds all that a view sees of level ground: a quick no for most pairs of views.
#[derive(Debug, Clone, Copy)]
struct ViewExtent {
    least: DVec2,
    most: DVec2,
}

impl ViewExtent {
    /// Excess over the corners' rectangle: a lens can bend the borders outwards.
    const SPARE: f64 = 0.1;

    /// `None` where the view meets the horizon.
    fn of(view: &View, ground_z_m: f64) -> Option<Self> {
        let (width, height) = (f64::from(view.camera.width_px), f64::from(view.camera.height_px));
        let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
        let mut extent = Self { least: DVec2::INFINITY, most: DVec2::NEG_INFINITY };
        for (x, y) in corners {
            let place = on_ground(view, DVec2::new(x, y), ground_z_m)?.truncate();
            extent = Self { least: extent.least.min(place), most: extent.most.max(place) };
        }
        let spare = (extent.most - extent.least) * Self::SPARE;
        Some(Self { least: extent.least - spare, most: extent.most + spare })
    }

    fn contains(&self, place: DVec2) -> bool {
        place.cmpge(self.least).all() && place.cmple(self.most).all()
    }
}

/// Share of the whole lattice, so that rays into the sky count as ground not seen.
fn share_of_lattice<'a>(scores: impl Iterator<Item = &'a f64>) -> f64 {
    scores.sum::<f64>() / (GRID * GRID) as f64
}

/// Points where a lattice of the view's pixels meets level ground.
fn ground_points(view: &View, ground_z_m: f64) -> Vec<DVec3> {
    let at = |i: usize, extent: u32| (i as f64 + 0.5) / GRID as f64 * f64::from(extent);
    let pixels =
        (0..GRID * GRID).map(|i| DVec2::new(at(i % GRID, view.camera.width_px), at(i / GRID, view.camera.height_px)));
    pixels.filter_map(|pixel| on_ground(view, pixel, ground_z_m)).collect()
}

/// Point where the ray of a pixel meets level ground.
fn on_ground(view: &View, pixel: DVec2, ground_z_m: f64) -> Option<DVec3> {
    let centre = view.camera_from_map.centre();
    let ray = view.camera_from_map.rotation.transpose() * view.camera.unproject(pixel)?;
    let depth = (ground_z_m - centre.z) / ray.z;
    (depth > 0.0 && depth.is_finite()).then(|| centre + depth * ray)
}

/// Usefulness of another view at one place on the ground, 0 to 1.
fn score(view: &View, other: &View, place: DVec3) -> f64 {
    let (here, there) = (view.camera_from_map.centre(), other.camera_from_map.centre());
    let is_seen = other.pixel_of(place).is_some();
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
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;

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
        let survey = Neighbours::new(views.to_vec(), &Terrain::Constant(0.0));
        let chosen = survey.choose(&views[0], 9);
        assert_eq!(chosen.iter().map(|v| v.id.0.as_str()).collect::<Vec<_>>(), ["fair", "far"]);
    }
}
