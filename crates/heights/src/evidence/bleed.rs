//! How far a prior's near sides bleed over their edges, measured where the edges are known without any height.
//!
//! ```text
//! edge(x; d, w) = ramp · near(x − d) + (1 − ramp) · far(x − d),  ramp = 1 on the near side of d, 0 on the far side, w px on either side of d between
//! offset        = d of the least Σ (α · edge(x; d, w) + β − prior(x))² over d, w, α and β
//! ```
//!
//! with x pixels across a vertical wall corner, near side first, and `near` and `far` the inverse depths of the model on either side, drawn on
//! past the corner in their own direction. A corner's vertical edge that is the building's side in a view stays where it is whatever the height,
//! so a depth edge seen beside it is the prior's own doing. Walls recede from their corners, so what has bled is not as near as the corner: the
//! wall drawn on says how near. Priors that bleed over make every building wider *and taller*; [`crate::evidence`] takes the bleeding back before
//! heights are compared.

use std::ops::RangeInclusive;

use glam::{DVec2, Vec2};

use crate::prior::DepthPrior;
use crate::render::PlacedCamera;
use crate::render::image::SceneTracer;
use crate::scene::Scene;
use crate::stats;

use crate::evidence::nearness_at;

/// Half width of the profile across an edge, pixels of the working image.
const HALF_WIDTH_PX: i32 = 7;
/// Samples across an edge, a pixel apart.
type Profile = [f64; 2 * HALF_WIDTH_PX as usize];
/// Shares of the wall's height at which profiles are taken. The wall of a gable ends at two thirds of the block that stands for it, and
/// above its eave no corner is left: 0.3 to 0.75 told a fifth less in villages.
const LEVELS: RangeInclusive<f32> = 0.2..=0.55;
/// Levels lie apart by a power of two of metres, about this share of the height, from the ground up: what is seen at one does not depend on the
/// height, which is not the same in all tiles.
const LEVEL_STEP: f32 = 0.05;
/// How far an edge may be smeared to either side, pixels: with one width alone, sharp edges or blurred ones looked moved.
const SMEARS_PX: [f64; 3] = [1.0, 2.0, 3.0];
/// Moves of the edge that are tried: this many pixels apart, and so many steps from where the model has it.
const STEP_PX: f64 = 0.5;
const MOVES: RangeInclusive<i32> = -4..=10;
/// Samples at an end that tell which way a wall goes on.
const N_END: usize = 3;
/// Least difference in depth across the edge, as a share of the depth.
const MIN_JUMP: f32 = 0.015;
/// Bleeding is told in steps of this many to a pixel.
const STEPS_PER_PX: f64 = 10.0;
/// Fewer profiles do not tell. With 40, and the median of all views for the others, simulated priors that bleed gave the same
/// accuracy (and 0 for the others less: 0.7 m in place of 0.5 m), but a height then depended on the views of its tile.
const MIN_PROFILES: usize = 20;
/// A view whose edges seem to have moved farther, pixels, shows none: its prior slopes from the walls to beyond the profiles' ends, as stereo does over
/// what it did not match. What seemed to have moved by five pixels over a real block had not moved at all.
const MAX_BLEEDING_PX: f64 = 4.0;
/// A view has to bleed over by at least this share of what single corners differ by: a network moves all its edges alike, crowns and sheds
/// beside walls some of them. Over a laser surface with trees, whose priors do not bleed, views had 0.3 of it and heights were 0.08 m worse;
/// in towns with footprints of 0.3 m corner errors, whose priors do, 1 to 1.5, and with a share of 1 heights were 0.05 m worse. Asked of edges
/// drawn inwards too, which is what footprints that are too large look like, it made a village 0.14 m worse.
const SHARE_OF_SCATTER: f64 = 0.6;
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

    /// The offsets of one view's depth edges from the walls of some buildings, by corner, pixels of the working image,
    /// positive where near sides bleed over.
    pub fn offsets(
        &self,
        placed: &PlacedCamera,
        prior: &DepthPrior,
        buildings: impl Iterator<Item = usize>,
    ) -> Vec<Vec<f64>> {
        let corners = buildings.flat_map(|b| side_corners(self.scene, self.heights_m, placed, b));
        let of_corner = |edges: Vec<WallEdge>| -> Vec<f64> {
            edges.iter().filter_map(|edge| offset(&self.tracer, placed, prior, edge)).collect()
        };
        corners.map(of_corner).filter(|offsets| !offsets.is_empty()).collect()
    }
}

/// The bleeding of a view: the median of its offsets, by corner; 0 where it has too few to tell, shows no edges, or bleeds over by less
/// than its corners contradict each other. No other view has a say, so a view's value does not depend on what else is solved with it;
/// and as it is told to a tenth of a pixel, which is less than its own uncertainty, hardly ever on single heights far away.
#[must_use]
pub fn bleeding_px(of_corners: &[Vec<f64>]) -> f64 {
    let offsets = of_corners.concat();
    let median_px = stats::median(&offsets).filter(|_| offsets.len() >= MIN_PROFILES).unwrap_or(0.0);
    let is_clear = || median_px <= 0.0 || median_px >= SHARE_OF_SCATTER * scatter_px(of_corners);
    let is_told = median_px.abs() <= MAX_BLEEDING_PX && is_clear();
    if is_told { (median_px * STEPS_PER_PX).round() / STEPS_PER_PX } else { 0.0 }
}

/// The spread of single corners as one standard deviation, pixels: levels of one corner err together.
fn scatter_px(of_corners: &[Vec<f64>]) -> f64 {
    let medians: Vec<f64> = of_corners.iter().filter_map(|offsets| stats::median(offsets)).collect();
    let Some(middle) = stats::median(&medians) else { return f64::INFINITY };
    let deviations: Vec<f64> = medians.iter().map(|median| (median - middle).abs()).collect();
    stats::SIGMA_PER_MAD * stats::median(&deviations).unwrap_or(f64::INFINITY)
}

/// A place on a wall corner's vertical edge that is the side of a building in a view.
struct WallEdge {
    building: usize,
    /// Image position, and the direction out of the building, unit length.
    at: DVec2,
    outward: DVec2,
}

fn side_corners(scene: &Scene, heights_m: &[f32], placed: &PlacedCamera, building: usize) -> Vec<Vec<WallEdge>> {
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
        let mut of_corner = Vec::new();
        let project = |p: Vec2, z: f32| placed.project(p.extend(z).as_dvec3());
        for level_m in levels_m(heights_m[building]) {
            let z = prism.ground_z + level_m;
            let (Some(at), Some(above), Some(inside)) =
                (project(corner, z), project(corner, z + 0.5), project(0.5 * (previous + next), z))
            else {
                continue;
            };
            let Some(up) = (above - at).try_normalize() else { continue };
            let side = up.perp();
            let outward = if side.dot(inside - at) > 0.0 { -side } else { side };
            of_corner.push(WallEdge { building, at, outward });
        }
        found.push(of_corner);
    }
    found
}

/// Heights above ground, metres, at which profiles are taken on walls of a height.
fn levels_m(height_m: f32) -> impl Iterator<Item = f32> {
    let step_m = (LEVEL_STEP * height_m).log2().round().exp2();
    let (first, last) = ((LEVELS.start() * height_m / step_m).ceil(), (LEVELS.end() * height_m / step_m).floor());
    (first as u32..=last as u32).map(move |i| i as f32 * step_m)
}

/// The offset of the prior's edge; `None` where the model has no clean edge there, or the prior sees none.
fn offset(tracer: &SceneTracer<'_>, placed: &PlacedCamera, prior: &DepthPrior, edge: &WallEdge) -> Option<f64> {
    let mut scratch = Vec::new();
    let (mut seen, mut rendered) = (Profile::default(), Profile::default());
    let (mut nearest, mut farthest) = (f32::INFINITY, 0.0_f32);
    // From the edge outwards on either side: most that are no clean edges are none close by.
    let steps = (0..HALF_WIDTH_PX).flat_map(|away| [-1 - away, away]);
    for step in steps {
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
        let at = (step + HALF_WIDTH_PX) as usize;
        rendered[at] = f64::from(depth.recip());
        seen[at] = f64::from(nearness_at(placed, prior, pixel));
        if nearest < farthest * (1.0 + MIN_JUMP) || !seen[at].is_finite() {
            return None;
        }
    }
    moved_by(&seen, &rendered)
}

/// By how many samples the edge in the middle of a rendered profile has to be moved to look like the seen one, but for a scale and an offset;
/// `None` where it looks like it nowhere.
fn moved_by(seen: &Profile, rendered: &Profile) -> Option<f64> {
    let likeness = |by: f64, smear_px: f64| explained(seen, &with_edge_at(rendered, by, smear_px));
    let tried = SMEARS_PX.iter().flat_map(|&smear_px| MOVES.map(move |i| (STEP_PX * f64::from(i), smear_px)));
    let likest = tried.map(|(by, smear_px)| (likeness(by, smear_px), by, smear_px)).max_by(|a, b| a.0.total_cmp(&b.0));
    let (most, by, smear_px) = likest.filter(|likest| likest.0 > 0.0)?;
    let around = [likeness(by - STEP_PX, smear_px), most, likeness(by + STEP_PX, smear_px)];
    Some(stats::parabola_peak(by, STEP_PX, around))
}

/// A rendered profile with its edge moved from the middle and smeared: the wall drawn on past its corner, the far side as it ends.
fn with_edge_at(rendered: &Profile, by: f64, smear_px: f64) -> Profile {
    let (near, far) = rendered.split_at(rendered.len() / 2);
    std::array::from_fn(|i| {
        // From the moved edge, whose two neighbours lie half a sample beside it.
        let x = i as f64 + 0.5 - near.len() as f64 - by;
        let near_share = (0.5 - 0.5 * x / smear_px).clamp(0.0, 1.0);
        let far_at = (x - 0.5).clamp(0.0, far.len() as f64 - 1.0);
        near_share * drawn_on(near, x + near.len() as f64 - 0.5) + (1.0 - near_share) * drawn_on(far, far_at)
    })
}

/// Samples at a place between them, or beyond in the direction of the last [`N_END`].
fn drawn_on(samples: &[f64], at: f64) -> f64 {
    let last = samples.len() - 1;
    let slope = |from: usize, to: usize| (samples[to] - samples[from]) / (to - from) as f64;
    if at <= 0.0 {
        samples[0] + at * slope(0, N_END - 1)
    } else if at >= last as f64 {
        samples[last] + (at - last as f64) * slope(last + 1 - N_END, last)
    } else {
        let i = at as usize;
        samples[i] + (at - i as f64) * slope(i, i + 1)
    }
}

/// The share of the variance of some values that a scale (not a negative one) and an offset of a model explain.
fn explained(values: &Profile, model: &Profile) -> f64 {
    let mean_of = |profile: &Profile| profile.iter().sum::<f64>() / profile.len() as f64;
    let (mean, model_mean) = (mean_of(values), mean_of(model));
    let (mut shared, mut of_values, mut of_model) = (0.0, 0.0, 0.0);
    for (value, model) in values.iter().zip(model) {
        shared += (value - mean) * (model - model_mean);
        of_values += (value - mean).powi(2);
        of_model += (model - model_mean).powi(2);
    }
    if shared > 0.0 { shared * shared / (of_values * of_model) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall that recedes to its corner, over ground: what a prior shows whose near side is grown by so much and blurred, at another scale.
    fn profiles(bleeding_px: f64, blur_px: f64) -> (Profile, Profile) {
        let wall = |x: f64| 0.9 - 0.05 * x;
        let (far, finer) = (0.1, 20.0);
        let at = |i: usize| i as f64 + 0.5 - f64::from(HALF_WIDTH_PX);
        let rendered = std::array::from_fn(|i| if at(i) < 0.0 { wall(at(i)) } else { far });
        // Grown: what is nearest within the bleeding, so the whole wall moves outwards.
        let grown = |x: f64| if x < bleeding_px { wall(x - bleeding_px) } else { far };
        let blurred = |x: f64| {
            let offsets = (-100..=100).map(|k| f64::from(k) / finer);
            let (mut sum, mut weights) = (0.0, 0.0);
            for offset in offsets {
                let weight = (-0.5 * (offset / blur_px).powi(2)).exp();
                sum += weight * grown(x + offset);
                weights += weight;
            }
            sum / weights
        };
        let seen = std::array::from_fn(|i| 3.0 + 0.4 * blurred(at(i)));
        (seen, rendered)
    }

    #[test]
    fn edges_are_told_where_they_are_though_walls_recede_and_priors_are_blurred() {
        for bleeding_px in [-1.0, 0.0, 0.7, 2.0, 3.2] {
            for blur_px in [0.3, 0.8, 1.5] {
                let (seen, rendered) = profiles(bleeding_px, blur_px);
                let told_px = moved_by(&seen, &rendered).expect("an edge");
                assert!((told_px - bleeding_px).abs() < 0.25, "{bleeding_px} px, blurred by {blur_px}: {told_px}");
            }
        }
    }

    /// Tiles give a wall slightly different heights: what is seen at a level must not depend on them.
    #[test]
    fn walls_of_nearly_the_same_height_are_looked_at_in_the_same_places() {
        let [low, high] = [7.6, 7.9].map(|height_m| levels_m(height_m).collect::<Vec<f32>>());
        assert_eq!(low, [2.0, 2.5, 3.0, 3.5, 4.0]);
        assert_eq!(high, low);
        for height_m in [1.9, 3.0, 5.7, 11.0, 90.0] {
            let levels: Vec<f32> = levels_m(height_m).collect();
            assert!((5..=11).contains(&levels.len()), "{height_m}: {levels:?}");
            assert!(levels.iter().all(|level_m| LEVELS.contains(&(level_m / height_m))), "{height_m}: {levels:?}");
        }
    }

    #[test]
    fn a_view_bleeds_by_the_median_of_its_own_edges_if_it_shows_enough_of_them() {
        let corners = |offsets: &[f64]| -> Vec<Vec<f64>> { offsets.chunks(4).map(<[f64]>::to_vec).collect() };
        let offsets: Vec<f64> = (0..MIN_PROFILES).map(|i| 1.26 + 0.1 * (i % 3) as f64 - 0.1).collect();
        assert_eq!(bleeding_px(&corners(&offsets)), 1.3);
        assert_eq!(bleeding_px(&corners(&offsets[1..])), 0.0);
        assert_eq!(bleeding_px(&[]), 0.0);
        let at_the_end: Vec<f64> = (0..MIN_PROFILES).map(|i| if i % 3 == 0 { 0.4 } else { 5.0 }).collect();
        assert_eq!(bleeding_px(&corners(&at_the_end)), 0.0, "edges that are nowhere in the profiles");
    }

    /// Twelve corners, a third of which have a crown beside them, which stands out as bleeding does.
    #[test]
    fn corners_that_contradict_each_other_do_not_bleed_over_however_many_they_are() {
        let of =
            |px: &[f64]| -> Vec<Vec<f64>> { px.iter().map(|px| vec![px - 0.1, *px, *px, *px, px + 0.1]).collect() };
        let beside_trees = [-0.7, 2.4, 0.6, 0.8, -1.2, 2.8, -0.4, 0.3, 4.1, 3.2, -1.0, 0.9];
        assert_eq!(bleeding_px(&of(&beside_trees)), 0.0);
        assert_eq!(bleeding_px(&of(&beside_trees.map(|px| -px))), -0.7, "edges drawn inwards");
        let agreed = [0.7, 1.4, 0.9, 1.0, 0.8];
        assert_eq!(bleeding_px(&of(&agreed)), 0.9);
        assert_eq!(bleeding_px(&of(&agreed.map(|px| -px))), -0.9);
    }
}
