//! How far a prior's near sides bleed over their edges, measured where the edges are known without any height.
//!
//! ```text
//! area(p) = Σ (p − far) / (near − far) · dx      over −W..W pixels across a vertical wall corner, near side first
//! offset  = area(prior) − area(rendered)
//! ```
//!
//! A corner's vertical edge that is the building's side in a view stays where it is whatever the height, so a depth edge
//! seen beside it is the prior's own doing. The area under the profile is blind to a symmetric blur. Priors that bleed
//! over make every building wider *and taller*; [`super::evidence`] takes the bleeding back before heights are compared.

use glam::{DVec2, Vec2};

use crate::prior::DepthPrior;
use crate::render::PlacedCamera;
use crate::render::image::SceneTracer;
use crate::scene::Scene;
use crate::stats;

use super::evidence::nearness_at;

/// Half width of the profile across an edge, pixels of the working image.
const HALF_WIDTH_PX: i32 = 7;
/// Samples next to each end of the profile that make its two levels.
const N_LEVEL: usize = 3;
/// Shares of the wall's height at which profiles are taken. The wall of a gable ends at two thirds of the block that stands for it: the upper one
/// then tells too little. Without it (0.3 to 0.6), villages that bleed were 0.1 m better, and flat roofs, which are low, as much worse.
const LEVELS: [f32; 4] = [0.3, 0.45, 0.6, 0.75];
/// Least difference in depth across the edge, as a share of the depth.
const MIN_JUMP: f32 = 0.015;
/// Spills are told in steps of this many to a pixel.
const STEPS_PER_PX: f64 = 10.0;
/// Fewer profiles do not tell. With 40, and the median of all views for the others, simulated priors that bleed gave the same
/// accuracy (and 0 for the others less: 0.7 m in place of 0.5 m), but a height then depended on the views of its tile.
const MIN_PROFILES: usize = 20;

/// Roofs as they stand, to look for edges in.
pub struct Edges<'a> {
    scene: &'a Scene,
    heights_m: &'a [f32],
    tracer: SceneTracer<'a>,
}

impl<'a> Edges<'a> {
    /// For heights above ground, metres, one per building.
    #[must_use]
    pub fn new(scene: &'a Scene, heights_m: &'a [f32]) -> Self {
        Self { scene, heights_m, tracer: SceneTracer::new(scene, heights_m) }
    }

    /// The offsets of one view's depth edges from the walls of some buildings, pixels of the working image, positive
    /// where near sides bleed over.
    pub fn offsets(
        &self,
        placed: &PlacedCamera,
        prior: &DepthPrior,
        buildings: impl Iterator<Item = usize>,
    ) -> Vec<f64> {
        let edges = buildings.flat_map(|b| side_edges(self.scene, self.heights_m, placed, b));
        edges.filter_map(|edge| offset(&self.tracer, placed, prior, &edge)).collect()
    }
}

/// The bleeding of a view: the median of its offsets, 0 where it has too few to tell. No other view has a say, so a view's
/// value does not depend on what else is solved with it; and as it is told to a tenth of a pixel, which is less than its own
/// uncertainty, hardly ever on single heights far away.
#[must_use]
pub fn bleeding_px(offsets: &[f64]) -> f64 {
    let median_px = Some(offsets).filter(|offsets| offsets.len() >= MIN_PROFILES).and_then(stats::median);
    median_px.map_or(0.0, |median_px| (median_px * STEPS_PER_PX).round() / STEPS_PER_PX)
}

/// A place on a wall corner's vertical edge that is the side of a building in a view.
struct WallEdge {
    building: usize,
    /// Image position, and the direction out of the building, unit length.
    at: DVec2,
    outward: DVec2,
}

fn side_edges(scene: &Scene, heights_m: &[f32], placed: &PlacedCamera, building: usize) -> Vec<WallEdge> {
    let prism = &scene.prisms[building];
    let mut found = Vec::new();
    let Some(ring) = prism.rings().next() else { return found };
    let corners = &ring[..ring.len() - 1];
    let eye = placed.eye().truncate().as_vec2();
    for (i, &corner) in corners.iter().enumerate() {
        let previous = corners[(i + corners.len() - 1) % corners.len()];
        let next = corners[(i + 1) % corners.len()];
        // Both neighbours on one side of the line of sight: the corner is the building's outermost one here.
        let sight = corner - eye;
        let (a, b) = (sight.perp_dot(previous - corner), sight.perp_dot(next - corner));
        if a * b <= 0.0 {
            continue;
        }
        let project = |p: Vec2, z: f32| placed.project(p.extend(z).as_dvec3());
        for level in LEVELS {
            let z = prism.ground_z + level * heights_m[building];
            let (Some(at), Some(above), Some(inside)) =
                (project(corner, z), project(corner, z + 0.5), project(0.5 * (previous + next), z))
            else {
                continue;
            };
            let Some(up) = (above - at).try_normalize() else { continue };
            let side = up.perp();
            let outward = if side.dot(inside - at) > 0.0 { -side } else { side };
            found.push(WallEdge { building, at, outward });
        }
    }
    found
}

/// The offset of the prior's edge; `None` where the model has no clean edge there, or the prior sees none.
fn offset(tracer: &SceneTracer<'_>, placed: &PlacedCamera, prior: &DepthPrior, edge: &WallEdge) -> Option<f64> {
    let mut scratch = Vec::new();
    let (mut seen, mut rendered) = (Vec::new(), Vec::new());
    let (mut nearest, mut farthest) = (f32::INFINITY, 0.0_f32);
    for step in -HALF_WIDTH_PX..HALF_WIDTH_PX {
        let pixel = edge.at + (f64::from(step) + 0.5) * edge.outward;
        let (depth, face) = tracer.trace(&placed.ray(pixel)?, &mut scratch);
        let is_own = face.building().is_some_and(|b| b.at() == edge.building);
        if !depth.is_finite() || is_own != (step < 0) {
            return None;
        }
        if step < 0 {
            farthest = farthest.max(depth);
        } else {
            nearest = nearest.min(depth);
        }
        rendered.push(f64::from(depth.recip()));
        seen.push(f64::from(nearness_at(placed, prior, pixel)));
    }
    if nearest < farthest * (1.0 + MIN_JUMP) || seen.iter().any(|p| !p.is_finite()) {
        return None;
    }
    Some(area(&seen)? - area(&rendered)?)
}

/// Area under a profile scaled from 1 at its near end to 0 at its far end, in samples.
fn area(profile: &[f64]) -> Option<f64> {
    let near = stats::mean(&profile[..N_LEVEL])?;
    let far = stats::mean(&profile[profile.len() - N_LEVEL..])?;
    (near > far).then(|| profile.iter().map(|p| (p - far) / (near - far)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_bleeds_by_the_median_of_its_own_edges_if_it_has_enough_of_them() {
        let offsets: Vec<f64> = (0..MIN_PROFILES).map(|i| 1.26 + 0.1 * (i % 3) as f64 - 0.1).collect();
        assert_eq!(bleeding_px(&offsets), 1.3);
        assert_eq!(bleeding_px(&offsets[1..]), 0.0);
        assert_eq!(bleeding_px(&[]), 0.0);
    }
}
