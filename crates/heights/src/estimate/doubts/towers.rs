//! Heights far above all that is around: a tower, or a false match that looks like one.

use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::optimise::{Reason, Solution};
use crate::scene::{Prism, Scene};

/// Buildings within this are around, metres, between middles; of fewer nothing is said.
const AROUND_M: f64 = 150.0;
const MIN_AROUND: usize = 4;
/// How far above all of them but one is far: a multiple, and metres.
const FAR_SHARE: f64 = 3.0;
const FAR_M: f64 = 25.0;

/// Marks heights that stand far above all around, unless the photos refined them: priors alone show no such thing reliably.
pub fn mark_towers(scene: &Scene, solution: &mut Solution) {
    let middle = |prism: &Prism| prism.centre_at(0.0).truncate().as_dvec2().to_array();
    let known = scene.prisms.iter().zip(&solution.heights);
    let known: Vec<GeomWithData<[f64; 2], (usize, f64)>> = known
        .enumerate()
        .filter_map(|(b, (prism, solved))| Some(GeomWithData::new(middle(prism), (b, solved.height_m?))))
        .collect();
    let tree = RTree::bulk_load(known);
    for (b, (prism, solved)) in scene.prisms.iter().zip(&mut solution.heights).enumerate() {
        let Some(height_m) = solved.height_m.filter(|_| solved.raised_m.is_none()) else { continue };
        let mut around: Vec<f64> = tree
            .locate_within_distance(middle(prism), AROUND_M * AROUND_M)
            .filter(|near| near.data.0 != b)
            .map(|near| near.data.1)
            .collect();
        around.sort_by(|a, b| b.total_cmp(a));
        // But one: false matches make towers in pairs, too.
        let tall_m = around.get(1).copied().unwrap_or(0.0);
        if around.len() >= MIN_AROUND && height_m > (FAR_SHARE * tall_m).max(tall_m + FAR_M) {
            solved.doubt(Reason::AboveAllAround);
        }
    }
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};
    use geo_types::Polygon;

    use super::*;
    use crate::optimise::SolvedHeight;
    use crate::scene::HeightBounds;
    use crate::terrain::{GroundLevel, Terrain};

    /// Houses of some heights in a row, 30 m from one to the next.
    fn doubtful(heights_m: &[f64], settled: Option<usize>) -> Vec<usize> {
        let house = |i: usize| {
            let x = 30.0 * i as f64;
            Rect::new(coord! { x: x, y: 0.0 }, coord! { x: x + 12.0, y: 12.0 }).to_polygon()
        };
        let houses: Vec<Polygon<f64>> = (0..heights_m.len()).map(house).collect();
        let ground = GroundLevel::flat(0.0);
        let on_ground: Vec<_> = houses.iter().map(|house| (house, ground)).collect();
        let bounds = HeightBounds { min_m: 2.0, max_m: 150.0 };
        let scene = Scene::new(&on_ground, &Terrain::Constant(0.0), bounds, 10.0);
        let of = |(i, h): (usize, &f64)| SolvedHeight {
            height_m: Some(*h),
            raised_m: (settled == Some(i)).then_some(0.1),
            ..SolvedHeight::default()
        };
        let heights = heights_m.iter().enumerate().map(of).collect();
        let mut solution = Solution { heights, ..Solution::default() };
        mark_towers(&scene, &mut solution);
        let has = |i: &usize| solution.heights[*i].reasons == [Reason::AboveAllAround];
        (0..heights_m.len()).filter(has).collect()
    }

    #[test]
    fn one_height_far_above_all_around_is_doubtful_unless_the_photos_settled_it() {
        let street = [12.0, 19.0, 145.4, 5.0, 12.0, 10.0];
        assert_eq!(doubtful(&street, None), [2]);
        assert_eq!(doubtful(&street, Some(2)), Vec::<usize>::new());
        assert_eq!(doubtful(&[12.0, 19.0, 145.4, 5.0, 61.7, 10.0, 8.0], None), [2, 4]);
        assert_eq!(doubtful(&[12.0, 60.0, 80.0, 5.0, 70.0, 12.0], None), Vec::<usize>::new(), "three towers");
        assert_eq!(doubtful(&[4.0, 4.0, 15.0, 5.0, 4.0], None), Vec::<usize>::new(), "a block among bungalows");
        assert_eq!(doubtful(&[4.0, 60.0, 5.0], None), Vec::<usize>::new(), "two neighbours are no town");
    }
}
