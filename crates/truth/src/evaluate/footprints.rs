//! Footprints against reference footprints: areas, detection, and corners.
//!
//! Pairs are one to one and chosen so that their intersections over union add up to the most (Kuhn 1955,
//! doi:10.1002/nav.3800020109); pairs that share nothing are none. For each building `g` of the reference with its
//! counterpart `m`:
//!
//! ```text
//! P = area(m ∩ g) / area(m)    R = area(m ∩ g) / area(g)    IoU = area(m ∩ g) / area(m ∪ g)    F1 = 2 P R / (P + R)
//! ```
//!
//! A building without a counterpart has 0 in all four; means are over all buildings of the reference. These area
//! measures do not see footprints where no building is: *detection* counts those, with a pair of `IoU ≥ 0.5` as a hit.
//! Buildings without a footprint, or with one that encloses nothing, are left out and counted.
//! The error of a corner is the distance of each reference corner of a hit to the nearest corner of its counterpart.

use std::collections::BTreeMap;
use std::fmt;

use geo::{Area as _, BooleanOps as _, BoundingRect as _};
use geo_types::MultiPolygon;
use rayon::prelude::*;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};
use serde::{Deserialize, Serialize};

use sizeup_geo::groups::Groups;
use sizeup_heights::stats::{mean, quantile};

/// Intersection over union from which a pair is a hit.
pub const HIT_IOU: f64 = 0.5;

/// Meaning of each number.
pub const FOOTPRINT_DEFINITIONS: [(&str, &str); 5] = [
    (
        "pairs",
        "one result per reference building, so that their IoU add up to the most; a building without a counterpart has 0 in \
         all area measures",
    ),
    ("iou", "shared area over the area of both together, mean over the reference's buildings"),
    (
        "precision, recall, f1",
        "shared area over the result's, over the reference's, and 2PR/(P+R) of each building; means",
    ),
    ("detection", "pairs of IoU >= 0.5 are hits: hits over results, over reference buildings, and their harmonic mean"),
    ("corners", "distance of each reference corner of a hit to the nearest corner of its counterpart"),
];

/// Quality of footprints; definitions in the module's text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FootprintEvaluation {
    /// Buildings of the reference.
    pub n_truth: usize,
    /// Buildings of the result.
    pub n_results: usize,
    /// Buildings of result and reference without a usable footprint, which are left out of everything.
    #[serde(default)]
    pub n_without_footprint: [usize; 2],
    /// Mean intersection over union, buildings without a counterpart count 0.
    pub iou: f64,
    /// Mean share of a result's footprint that the reference shares, 0 to 1.
    pub precision: f64,
    /// Mean share of a reference's footprint that the result shares, 0 to 1.
    pub recall: f64,
    /// Mean of the single buildings' F1.
    pub f1: f64,
    /// Mean intersection over union of the hits alone.
    pub iou_of_hits: f64,
    /// Pairs with an intersection over union of at least a half.
    pub n_hits: usize,
    /// Hits per building of the result.
    pub detection_precision: f64,
    /// Hits per building of the reference.
    pub detection_recall: f64,
    /// Harmonic mean of the two.
    pub detection_f1: f64,
    /// Median distance of a hit's reference corner to the nearest corner found, metres; `None` without hits.
    pub corner_median_m: Option<f64>,
    /// 90th percentile of the same.
    pub corner_p90_m: Option<f64>,
    /// Corners of the hits over corners of their references.
    pub corner_ratio: Option<f64>,
    /// Meaning of each number.
    #[serde(default)]
    pub definitions: BTreeMap<String, String>,
}

/// A pair of one reference building and one result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootprintPair {
    /// Position in the reference.
    pub truth: usize,
    /// Position in the result.
    pub result: usize,
    /// Area that both cover, m²; pixels² of footprints in a photo.
    pub shared_m2: f64,
    /// Intersection over union, 0 to 1.
    pub iou: f64,
}

/// Compares footprints, one or several polygons each, in one horizontal CRS in metres.
#[must_use]
pub fn evaluate_footprints<S>(results: &[S], truth: &[S]) -> FootprintEvaluation
where
    S: Clone + Into<MultiPolygon<f64>>,
{
    let usable = |footprints: &[S]| -> Vec<MultiPolygon<f64>> {
        let footprints = footprints.iter().cloned().map(Into::into);
        footprints.filter(|o: &MultiPolygon<f64>| o.unsigned_area() > 0.0).collect()
    };
    let n_given = [results.len(), truth.len()];
    let (results, truth) = (&usable(results), &usable(truth));
    let pairs = match_footprints(results, truth);
    let (mut iou, mut precision, mut recall, mut f1) = (0.0, 0.0, 0.0, 0.0);
    for pair in &pairs {
        let p = pair.shared_m2 / results[pair.result].unsigned_area();
        let r = pair.shared_m2 / truth[pair.truth].unsigned_area();
        iou += pair.iou;
        precision += p;
        recall += r;
        f1 += 2.0 * p * r / (p + r);
    }
    let of_truth = |sum: f64| if truth.is_empty() { 0.0 } else { sum / truth.len() as f64 };
    let hits: Vec<&FootprintPair> = pairs.iter().filter(|p| p.iou >= HIT_IOU).collect();
    let share = |n: usize| if n == 0 { 0.0 } else { hits.len() as f64 / n as f64 };
    let (dp, dr) = (share(results.len()), share(truth.len()));
    let corners = |footprint: &MultiPolygon<f64>| -> Vec<[f64; 2]> {
        let rings = footprint.iter().flat_map(|p| std::iter::once(p.exterior()).chain(p.interiors()));
        rings.flat_map(|ring| ring.0.iter().skip(1)).map(|c| [c.x, c.y]).collect()
    };
    let mut errors_m = Vec::new();
    let (mut n_found, mut n_true) = (0, 0);
    for pair in &hits {
        let (found, wanted) = (corners(&results[pair.result]), corners(&truth[pair.truth]));
        n_found += found.len();
        n_true += wanted.len();
        let nearest =
            |w: &[f64; 2]| found.iter().map(|f| (f[0] - w[0]).hypot(f[1] - w[1])).fold(f64::INFINITY, f64::min);
        errors_m.extend(wanted.iter().map(nearest));
    }
    FootprintEvaluation {
        n_truth: truth.len(),
        n_results: results.len(),
        n_without_footprint: [n_given[0] - results.len(), n_given[1] - truth.len()],
        iou: of_truth(iou),
        precision: of_truth(precision),
        recall: of_truth(recall),
        f1: of_truth(f1),
        iou_of_hits: mean(&hits.iter().map(|p| p.iou).collect::<Vec<_>>()).unwrap_or(0.0),
        n_hits: hits.len(),
        detection_precision: dp,
        detection_recall: dr,
        detection_f1: if dp + dr > 0.0 { 2.0 * dp * dr / (dp + dr) } else { 0.0 },
        corner_median_m: quantile(&errors_m, 0.5),
        corner_p90_m: quantile(&errors_m, 0.9),
        corner_ratio: (n_true > 0).then(|| f64::from(n_found as u32) / f64::from(n_true as u32)),
        definitions: FOOTPRINT_DEFINITIONS
            .iter()
            .map(|(name, text)| ((*name).to_owned(), (*text).to_owned()))
            .collect(),
    }
}

/// One-to-one pairs with the greatest sum of intersections over union, in the reference's order.
#[must_use]
pub fn match_footprints(results: &[MultiPolygon<f64>], truth: &[MultiPolygon<f64>]) -> Vec<FootprintPair> {
    let entries = results.iter().enumerate().filter_map(|(i, polygon)| {
        let rect = polygon.bounding_rect()?;
        Some(GeomWithData::new(Rectangle::from_corners(rect.min().into(), rect.max().into()), i))
    });
    let tree: RTree<GeomWithData<Rectangle<[f64; 2]>, usize>> = RTree::bulk_load(entries.collect());
    let overlaps: Vec<Vec<FootprintPair>> = truth
        .par_iter()
        .enumerate()
        .map(|(t, polygon)| {
            let Some(rect) = polygon.bounding_rect() else { return Vec::new() };
            let bounds = AABB::from_corners(rect.min().into(), rect.max().into());
            let mut near: Vec<usize> = tree.locate_in_envelope_intersecting(&bounds).map(|e| e.data).collect();
            near.sort_unstable();
            let pair = |result: usize| {
                let shared_m2 = polygon.intersection(&results[result]).unsigned_area();
                let joint_m2 = polygon.unsigned_area() + results[result].unsigned_area() - shared_m2;
                (shared_m2 > 0.0).then(|| FootprintPair { truth: t, result, shared_m2, iou: shared_m2 / joint_m2 })
            };
            near.into_iter().filter_map(pair).collect()
        })
        .collect();
    best_pairs(&overlaps, results.len())
}

/// One-to-one pairs among overlaps, one list per building of the reference.
pub(super) fn best_pairs(overlaps: &[Vec<FootprintPair>], n_results: usize) -> Vec<FootprintPair> {
    let mut pairs: Vec<FootprintPair> = islands(overlaps, n_results).iter().flat_map(|island| assign(island)).collect();
    pairs.sort_by_key(|pair| pair.truth);
    pairs
}

/// Overlaps that share buildings, directly or through others: each island is assigned on its own.
fn islands(overlaps: &[Vec<FootprintPair>], n_results: usize) -> Vec<Vec<FootprintPair>> {
    let n = overlaps.len();
    let mut groups = Groups::new(n + n_results);
    for pair in overlaps.iter().flatten() {
        groups.join(pair.truth, n + pair.result);
    }
    let mut islands: Vec<Vec<FootprintPair>> = vec![Vec::new(); n + n_results];
    for pair in overlaps.iter().flatten() {
        islands[groups.first_of(pair.truth)].push(*pair);
    }
    islands.retain(|island| !island.is_empty());
    islands
}

/// The assignment of an island: shortest augmenting paths over costs `1 − IoU`, rows the reference.
fn assign(island: &[FootprintPair]) -> Vec<FootprintPair> {
    let index = |of: fn(&FootprintPair) -> usize| {
        let mut all: Vec<usize> = island.iter().map(of).collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    let (rows, columns) = (index(|p| p.truth), index(|p| p.result));
    // As many columns more as there are rows, at the cost of no counterpart.
    let (n, m) = (rows.len(), columns.len() + rows.len());
    let mut cost = vec![1.0; n * m];
    for pair in island {
        let (Ok(i), Ok(j)) = (rows.binary_search(&pair.truth), columns.binary_search(&pair.result)) else { continue };
        cost[i * m + j] = 1.0 - pair.iou;
    }
    let (mut u, mut v) = (vec![0.0; n + 1], vec![0.0; m + 1]);
    // Row of each column, from 1; column 0 holds the row that looks for one.
    let mut row_of = vec![0_usize; m + 1];
    for i in 1..=n {
        row_of[0] = i;
        let mut at = 0;
        let mut least = vec![f64::INFINITY; m + 1];
        let mut came_from = vec![0_usize; m + 1];
        let mut is_done = vec![false; m + 1];
        while row_of[at] != 0 {
            is_done[at] = true;
            let row = row_of[at];
            let (mut step, mut next) = (f64::INFINITY, 0);
            for j in (1..=m).filter(|&j| !is_done[j]) {
                let reduced = cost[(row - 1) * m + j - 1] - u[row] - v[j];
                if reduced < least[j] {
                    (least[j], came_from[j]) = (reduced, at);
                }
                if least[j] < step {
                    (step, next) = (least[j], j);
                }
            }
            for j in 0..=m {
                if is_done[j] {
                    u[row_of[j]] += step;
                    v[j] -= step;
                } else {
                    least[j] -= step;
                }
            }
            at = next;
        }
        while at != 0 {
            row_of[at] = row_of[came_from[at]];
            at = came_from[at];
        }
    }
    let is_chosen = |pair: &&FootprintPair| {
        let (i, j) = (rows.binary_search(&pair.truth), columns.binary_search(&pair.result));
        matches!((i, j), (Ok(i), Ok(j)) if row_of[j + 1] == i + 1)
    };
    island.iter().filter(is_chosen).copied().collect()
}

impl fmt::Display for FootprintEvaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |v: f64| format!("{:.1} %", 100.0 * v);
        writeln!(f, "Footprints: {} in the result, {} in the reference", self.n_results, self.n_truth)?;
        let [of_results, of_truth] = self.n_without_footprint;
        if of_results + of_truth > 0 {
            writeln!(
                f,
                "  left out, without a usable footprint: {of_results} of the result, {of_truth} of the reference"
            )?;
        }
        writeln!(
            f,
            "  area, mean over the reference: IoU {}, precision {}, recall {}, F1 {}",
            percent(self.iou),
            percent(self.precision),
            percent(self.recall),
            percent(self.f1)
        )?;
        writeln!(
            f,
            "  detection at IoU 0.5: precision {}, recall {}, F1 {}; IoU of hits {}",
            percent(self.detection_precision),
            percent(self.detection_recall),
            percent(self.detection_f1),
            percent(self.iou_of_hits)
        )?;
        if let (Some(median), Some(p90), Some(ratio)) = (self.corner_median_m, self.corner_p90_m, self.corner_ratio) {
            writeln!(f, "  corners of hits: median {median:.2} m, P90 {p90:.2} m, {ratio:.2} found per true corner")?;
        }
        self.definitions.iter().try_for_each(|(name, text)| writeln!(f, "  {name}: {text}"))
    }
}

#[cfg(test)]
mod tests {
    use geo_types::Rect;
    use proptest::prelude::*;

    use super::*;

    fn house(x: f64, width: f64) -> MultiPolygon<f64> {
        Rect::new((x, 0.0), (x + width, 10.0)).to_polygon().into()
    }

    #[test]
    fn measures_of_a_shifted_house_are_those_of_a_hand_calculation() {
        // 10 × 10 m moved by 2 m: 80 m² shared of 120 m²; a second one is missed, a third invented.
        let found =
            evaluate_footprints(&[house(2.0, 10.0), house(100.0, 10.0)], &[house(0.0, 10.0), house(50.0, 10.0)]);
        assert!((found.iou - 0.5 * 80.0 / 120.0).abs() < 1e-12, "{found:?}");
        assert!((found.precision - 0.4).abs() < 1e-12 && (found.f1 - 0.4).abs() < 1e-12);
        assert_eq!((found.n_hits, found.detection_precision, found.detection_recall), (1, 0.5, 0.5));
        assert_eq!(found.corner_median_m, Some(2.0));
    }

    #[test]
    fn the_footprints_themselves_are_perfect_and_empty_ones_count_apart() {
        let town = [
            house(0.0, 10.0),
            house(10.0, 5.0),
            MultiPolygon::new(vec![house(30.0, 4.0).0[0].clone(), house(40.0, 4.0).0[0].clone()]),
        ];
        let nothing = [house(0.0, 0.0), MultiPolygon::new(Vec::new())];
        let found = evaluate_footprints(&[&town[..], &nothing[..1]].concat(), &[&nothing[..], &town[..]].concat());
        assert_eq!((found.n_results, found.n_truth, found.n_without_footprint), (3, 3, [1, 2]));
        let all = [found.iou, found.precision, found.recall, found.f1, found.iou_of_hits, found.detection_f1];
        assert!(all.iter().all(|v| (v - 1.0).abs() < 1e-9), "{found}");
        assert_eq!((found.corner_p90_m, found.corner_ratio), (Some(0.0), Some(1.0)));
        let none = evaluate_footprints(&town[..0], &town);
        assert_eq!((none.iou, none.detection_f1, none.corner_median_m), (0.0, 0.0, None));
    }

    #[test]
    fn one_footprint_stands_for_one_house_only() {
        // A merged footprint over two houses counts for one of them.
        let found = evaluate_footprints(&[house(0.0, 20.0)], &[house(0.0, 10.0), house(10.0, 10.0)]);
        assert!((found.iou - 0.25).abs() < 1e-12 && (found.recall - 0.5).abs() < 1e-12, "{found:?}");
    }

    proptest! {
        /// Against trying all assignments.
        #[test]
        fn the_assignment_is_the_best_there_is(shares in prop::collection::vec(0.0..1.0_f64, 12)) {
            let island: Vec<FootprintPair> = (0..12)
                .map(|i| FootprintPair { truth: i / 4, result: i % 4, shared_m2: 1.0, iou: shares[i] })
                .collect();
            let found: f64 = assign(&island).iter().map(|p| p.iou).sum();
            let mut best = 0.0_f64;
            for a in 0..4 {
                for b in (0..4).filter(|&b| b != a) {
                    for c in (0..4).filter(|&c| c != a && c != b) {
                        best = best.max(shares[a] + shares[4 + b] + shares[8 + c]);
                    }
                }
            }
            prop_assert!((found - best).abs() < 1e-9, "{found} {best}");
        }
    }
}
