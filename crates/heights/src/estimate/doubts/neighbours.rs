//! Small footprints that took the roof of another building: a shed at the wall of a house covers a few rays of each photo, and the
//! house's roof edge explains these better than its own.

use glam::Vec2;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree, RTreeObject as _};

use crate::optimise::{Reason, Solution, SolvedHeight};
use crate::scene::{Prism, Scene};

/// A footprint is small where it has less than this: pixels of the working images on the ground, and m².
const SMALL_PX: f64 = 120.0;
const SMALL_M2: f32 = 40.0;
/// So much larger is a building whose roof a small footprint may have taken.
const LARGER: f32 = 2.0;
/// Buildings touch that are no farther apart than this: metres, and pixels of the working images.
const TOUCH_M: f64 = 1.0;
const TOUCH_PX: f64 = 2.0;
/// Least deviation of a height from a roof that is another one, metres; two standard deviations of both else.
const SAME_M: f64 = 0.5;
const SIGMAS: f64 = 2.0;
/// Height over width, the root of the area, from which a small building takes a roof beside it to explain it, and from which nothing
/// does.
const TALL: f64 = 1.25;
const TOWERING: f64 = 2.5;

/// Marks small footprints as high as a larger roof that they touch, and those much higher than wide. Photos that refined a height
/// have seen a roof there.
pub fn mark_small(scene: &Scene, solution: &mut Solution) {
    let boxes = scene.prisms.iter().enumerate().map(|(b, prism)| GeomWithData::new(box_of(prism, 0.0), b));
    let tree = RTree::bulk_load(boxes.collect());
    let is_taken = |b: usize, solved: &SolvedHeight| -> Option<bool> {
        let (prism, height_m, pixel_m) = (&scene.prisms[b], solved.height_m?, solved.doubts.pixel_m);
        let area_m2 = prism.area_m2();
        let slenderness = height_m / f64::from(area_m2).sqrt();
        let is_small = area_m2 < SMALL_M2 && f64::from(area_m2) < SMALL_PX * pixel_m.powi(2);
        if !is_small || slenderness < TALL {
            return Some(false);
        }
        let reach_m = TOUCH_M.max(TOUCH_PX * pixel_m) as f32;
        let envelope = box_of(prism, reach_m).envelope();
        let mut near = tree.locate_in_envelope_intersecting(&envelope).map(|near| near.data).filter(|&near| near != b);
        let has_roof_of = |near: usize| -> Option<bool> {
            let (other, of_other) = (&scene.prisms[near], &solution.heights[near]);
            let other_m = of_other.height_m?;
            let (eave_m, ridge_m) = of_other.roof.map_or((other_m, other_m), |roof| (roof.eave_m, roof.ridge_m));
            let sigma_m = solved.sigma_m.unwrap_or(0.0).hypot(of_other.sigma_m.unwrap_or(0.0));
            let within_m = SAME_M.max(SIGMAS * sigma_m);
            let above_other_m = height_m + f64::from(prism.ground_z - other.ground_z);
            let is_as_high = (eave_m - within_m..=ridge_m + within_m).contains(&above_other_m);
            Some(is_as_high && other.area_m2() > LARGER * area_m2 && distance_m(prism, other) <= reach_m)
        };
        Some(slenderness >= TOWERING || near.any(|near| has_roof_of(near) == Some(true)))
    };
    let taken: Vec<usize> = solution
        .heights
        .iter()
        .enumerate()
        .filter(|(b, solved)| solved.raised_m.is_none() && is_taken(*b, solved) == Some(true))
        .map(|(b, _)| b)
        .collect();
    taken.into_iter().for_each(|b| solution.heights[b].doubt(Reason::RoofOfNeighbour));
}

fn box_of(prism: &Prism, margin_m: f32) -> Rectangle<[f32; 2]> {
    let bounds = prism.bounds_below(0.0);
    let (low, high) = (bounds.min.truncate() - margin_m, bounds.max.truncate() + margin_m);
    Rectangle::from_aabb(AABB::from_corners(low.to_array(), high.to_array()))
}

/// Distance of two footprints, metres; 0 where a corner of one lies in the other.
fn distance_m(a: &Prism, b: &Prism) -> f32 {
    let to_edge = |point: Vec2, (from, to): (Vec2, Vec2)| {
        let edge = to - from;
        let share = ((point - from).dot(edge) / edge.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        point.distance(from + share * edge)
    };
    let from_corners = |of: &Prism, to: &Prism| {
        let corners = of.edges().map(|(corner, _)| corner);
        let near = corners.map(|c| {
            if to.contains(c) { 0.0 } else { to.edges().map(|e| to_edge(c, e)).fold(f32::INFINITY, f32::min) }
        });
        near.fold(f32::INFINITY, f32::min)
    };
    from_corners(a, b).min(from_corners(b, a))
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};
    use geo_types::Polygon;

    use super::*;
    use crate::optimise::Doubts;
    use crate::scene::HeightBounds;
    use crate::terrain::{GroundLevel, Terrain};

    /// Whether a building of `2.5 × width_m`, `height_m` high, at the wall of a house of 10 m or so far from it, is doubtful.
    fn is_doubtful(width_m: f64, height_m: f64, gap_m: f64, pixel_m: f64, raised_m: Option<f64>) -> bool {
        let rect = |x: f64, y: f64, w: f64, d: f64| -> Polygon<f64> {
            Rect::new(coord! { x: x, y: y }, coord! { x: x + w, y: y + d }).to_polygon()
        };
        let (house, shed) = (rect(0.0, 0.0, 12.0, 10.0), rect(12.0 + gap_m, 2.0, 2.5, width_m));
        let ground = GroundLevel::flat(0.0);
        let bounds = HeightBounds { min_m: 2.0, max_m: 150.0 };
        let scene = Scene::new(&[(&house, ground), (&shed, ground)], &Terrain::Constant(0.0), bounds, 10.0);
        let doubts = Doubts { pixel_m, ..Doubts::default() };
        let of = |height_m: f64, raised_m: Option<f64>| SolvedHeight {
            height_m: Some(height_m),
            sigma_m: Some(0.3),
            raised_m,
            doubts,
            ..SolvedHeight::default()
        };
        let mut solution = Solution { heights: vec![of(10.0, None), of(height_m, raised_m)], ..Solution::default() };
        mark_small(&scene, &mut solution);
        assert_eq!(solution.heights[0].reasons, []);
        solution.heights[1].reasons == [Reason::RoofOfNeighbour]
    }

    #[test]
    fn a_small_footprint_as_high_as_the_roof_that_it_touches_is_doubtful() {
        assert!(is_doubtful(5.0, 10.3, 0.0, 0.5, None));
        assert!(!is_doubtful(5.0, 2.6, 0.0, 0.5, None), "a shed");
        assert!(!is_doubtful(5.0, 6.5, 0.0, 0.5, None), "another height than the house's");
        assert!(!is_doubtful(5.0, 10.3, 0.0, 0.2, None), "large in the photos");
        assert!(!is_doubtful(20.0, 10.3, 0.0, 0.5, None), "a house of its own");
        assert!(!is_doubtful(5.0, 10.3, 0.0, 0.5, Some(0.1)), "the photos show a roof there");
    }

    #[test]
    fn a_small_footprint_that_towers_beside_nothing_is_doubtful() {
        assert!(is_doubtful(4.0, 13.0, 40.0, 0.5, None));
        assert!(!is_doubtful(4.0, 5.0, 40.0, 0.5, None));
    }
}
