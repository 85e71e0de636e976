//! Footprints in photos against true ones: the protocol of the paper's Table 1, and detection beside it.
//!
//! In each photo, found and true instances are paired one to one so that their intersections over union add up to the most.
//! For each true instance `g` with its counterpart `m`, by the pixels that they cover:
//!
//! ```text
//! P = |m ∩ g| / |m|    R = |m ∩ g| / |g|    IoU = |m ∩ g| / |m ∪ g|    F1 = 2 P R / (P + R)
//! ```
//!
//! An instance without a counterpart has 0 in all four. *By building* is the mean over all true instances of all photos, *by
//! photo* the mean over photos of each photo's mean. *Detection* counts instead: a pair of `IoU ≥ 0.5` is a hit, precision the
//! hits per instance found, recall per true one; only it sees instances where no building is.
//!
//! That the paper's numbers are areas follows from the numbers. For areas `IoU = 1 / (1/P + 1/R − 1)`; counts of hits know no
//! such law. Its Table 1, in per cent, and what the law makes of its P and R:
//!
//! | | P | R | `IoU`, printed | by the law | F1, printed | `2PR/(P+R)` |
//! |---|---|---|---|---|---|---|
//! | `FPSAM` | 81.49 | 85.38 | 70.89 | 71.51 | 81.90 | 83.39 |
//! | `SAM 3` | 62.34 | 89.86 | 58.98 | 58.24 | 71.69 | 73.61 |
//! | `OBM` | 60.32 | 80.56 | 53.36 | 52.66 | 67.45 | 68.99 |
//!
//! F1 lies below that of the means in every row, as a mean of single F1 does. Whether that mean is over buildings or photos,
//! and what a missed building counts, the paper does not say: both means are given, and a miss counts 0.

use std::collections::BTreeMap;
use std::fmt;

use geo::Area as _;
use geo_types::MultiPolygon;
use serde::{Deserialize, Serialize};

use super::footprints::{FootprintPair, HIT_IOU, best_pairs, match_footprints};

/// Definitions of the numbers, by name.
pub const PHOTO_DEFINITIONS: [(&str, &str); 4] = [
    (
        "area",
        "of each true instance and its counterpart in the photo: shared area over that of both (IoU), over what was found \
         (precision), over the true one (recall), and 2PR/(P+R); 0 without a counterpart",
    ),
    ("by building, by photo", "means over all true instances; over photos, of each photo's mean"),
    ("pairs", "one to one in each photo, so that their IoU add up to the most"),
    ("detection", "pairs of IoU >= 0.5 are hits: hits over instances found, over true ones, and their harmonic mean"),
];

/// Areas of one photo's instances.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PhotoAreas {
    /// True instances' areas, pixels².
    pub truth: Vec<f64>,
    /// Areas of the instances found, pixels².
    pub found: Vec<f64>,
    /// Index of a true instance, of one found, and what both cover, pixels².
    pub shared: Vec<(usize, usize, f64)>,
}

impl PhotoAreas {
    /// Areas of footprints in pixels; those that enclose nothing are left out.
    #[must_use]
    pub fn of(found: &[MultiPolygon<f64>], truth: &[MultiPolygon<f64>]) -> Self {
        let usable = |all: &[MultiPolygon<f64>]| -> Vec<MultiPolygon<f64>> {
            all.iter().filter(|o| o.unsigned_area() > 0.0).cloned().collect()
        };
        let (found, truth) = (usable(found), usable(truth));
        let areas = |all: &[MultiPolygon<f64>]| all.iter().map(geo::Area::unsigned_area).collect();
        let shared = match_footprints(&found, &truth).into_iter().map(|p| (p.truth, p.result, p.shared_m2));
        Self { shared: shared.collect(), truth: areas(&truth), found: areas(&found) }
    }

    fn pairs(&self) -> Vec<FootprintPair> {
        let mut overlaps = vec![Vec::new(); self.truth.len()];
        for &(truth, result, shared) in self.shared.iter().filter(|(_, _, shared)| *shared > 0.0) {
            let iou = shared / (self.truth[truth] + self.found[result] - shared);
            overlaps[truth].push(FootprintPair { truth, result, shared_m2: shared, iou });
        }
        best_pairs(&overlaps, self.found.len())
    }
}

/// Measures of areas in a photo, each 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct AreaMeasures {
    /// Intersection over union of the building pixels.
    pub iou: f64,
    /// Area shared, over the area found.
    pub precision: f64,
    /// Area shared, over the true area.
    pub recall: f64,
    /// Harmonic mean of the two, of each instance.
    pub f1: f64,
}

impl AreaMeasures {
    fn of(pair: &FootprintPair, areas: &PhotoAreas) -> Self {
        let precision = pair.shared_m2 / areas.found[pair.result];
        let recall = pair.shared_m2 / areas.truth[pair.truth];
        Self { iou: pair.iou, precision, recall, f1: 2.0 * precision * recall / (precision + recall) }
    }

    /// The sum of some over a number that may be larger, of those that are 0.
    fn mean(of: impl Iterator<Item = Self>, n: usize) -> Self {
        let sum = of.fold(Self::default(), |a, b| Self {
            iou: a.iou + b.iou,
            precision: a.precision + b.precision,
            recall: a.recall + b.recall,
            f1: a.f1 + b.f1,
        });
        let share = |v: f64| if n == 0 { 0.0 } else { v / n as f64 };
        Self { iou: share(sum.iou), precision: share(sum.precision), recall: share(sum.recall), f1: share(sum.f1) }
    }
}

/// Measures of detection in photos, each 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct DetectionMeasures {
    /// Hits per instance found.
    pub precision: f64,
    /// Hits per true instance.
    pub recall: f64,
    /// Harmonic mean of the two.
    pub f1: f64,
}

impl DetectionMeasures {
    fn of(n_hits: usize, n_found: usize, n_truth: usize) -> Self {
        let share = |part: usize, whole: usize| if whole == 0 { 0.0 } else { part as f64 / whole as f64 };
        Self {
            precision: share(n_hits, n_found),
            recall: share(n_hits, n_truth),
            f1: share(2 * n_hits, n_found + n_truth),
        }
    }
}

/// Quality of footprints in photos; definitions in the module's text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotoEvaluation {
    /// Photos with true instances.
    pub n_photos: usize,
    /// Photos without: only their instances found count, as wrong detections.
    pub n_photos_without: usize,
    /// Number of true instances.
    pub n_truth: usize,
    /// Number of instances found.
    pub n_found: usize,
    /// True instances with a counterpart of any overlap.
    pub n_pairs: usize,
    /// Pairs with an intersection over union of at least a half.
    pub n_hits: usize,
    /// Areas, mean over true instances.
    pub area_by_building: AreaMeasures,
    /// Areas, mean over photos.
    pub area_by_photo: AreaMeasures,
    /// Hits of all photos together.
    pub detection: DetectionMeasures,
    /// Hits, mean over photos.
    pub detection_by_photo: DetectionMeasures,
    /// Mean intersection over union of the hits alone.
    pub iou_of_hits: f64,
    /// Definitions of the numbers, by name.
    #[serde(default)]
    pub definitions: BTreeMap<String, String>,
}

/// Compares instances, photo by photo.
#[must_use]
pub fn evaluate_photos(photos: &[PhotoAreas]) -> PhotoEvaluation {
    let pairs: Vec<(&PhotoAreas, Vec<FootprintPair>)> = photos.iter().map(|areas| (areas, areas.pairs())).collect();
    let measured = |areas: &PhotoAreas, pairs: &[FootprintPair]| -> Vec<AreaMeasures> {
        pairs.iter().map(|p| AreaMeasures::of(p, areas)).collect()
    };
    let hits = |pairs: &[FootprintPair]| pairs.iter().filter(|p| p.iou >= HIT_IOU).count();
    let with_truth: Vec<&(&PhotoAreas, Vec<FootprintPair>)> =
        pairs.iter().filter(|(a, _)| !a.truth.is_empty()).collect();
    let n_photos = with_truth.len();
    let n_truth = photos.iter().map(|a| a.truth.len()).sum();
    let n_found = photos.iter().map(|a| a.found.len()).sum();
    let n_hits = pairs.iter().map(|(_, p)| hits(p)).sum();
    let of_photos = with_truth.iter().map(|(a, p)| AreaMeasures::mean(measured(a, p).into_iter(), a.truth.len()));
    let of_photo = |a: &PhotoAreas, p: &[FootprintPair]| DetectionMeasures::of(hits(p), a.found.len(), a.truth.len());
    let detected: Vec<DetectionMeasures> = with_truth.iter().map(|(a, p)| of_photo(a, p)).collect();
    let mean_of = |f: fn(&DetectionMeasures) -> f64| detected.iter().map(f).sum::<f64>() / n_photos.max(1) as f64;
    let hit_ious = pairs.iter().flat_map(|(_, p)| p).map(|p| p.iou).filter(|iou| *iou >= HIT_IOU);
    PhotoEvaluation {
        n_photos,
        n_photos_without: photos.len() - n_photos,
        n_truth,
        n_found,
        n_pairs: pairs.iter().map(|(_, p)| p.len()).sum(),
        n_hits,
        area_by_building: AreaMeasures::mean(pairs.iter().flat_map(|(a, p)| measured(a, p)), n_truth),
        area_by_photo: AreaMeasures::mean(of_photos, n_photos),
        detection: DetectionMeasures::of(n_hits, n_found, n_truth),
        detection_by_photo: DetectionMeasures {
            precision: mean_of(|d| d.precision),
            recall: mean_of(|d| d.recall),
            f1: mean_of(|d| d.f1),
        },
        iou_of_hits: hit_ious.sum::<f64>() / n_hits.max(1) as f64,
        definitions: PHOTO_DEFINITIONS.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect(),
    }
}

impl fmt::Display for PhotoEvaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |v: f64| format!("{:.1} %", 100.0 * v);
        writeln!(
            f,
            "Footprints in photos: {} found, {} true, in {} photos ({} without true ones)",
            self.n_found,
            self.n_truth,
            self.n_photos + self.n_photos_without,
            self.n_photos_without
        )?;
        for (name, m) in [("by building", &self.area_by_building), ("by photo", &self.area_by_photo)] {
            let [iou, p, r, f1] = [m.iou, m.precision, m.recall, m.f1].map(percent);
            writeln!(f, "  area, {name}: IoU {iou}, precision {p}, recall {r}, F1 {f1}")?;
        }
        for (name, m) in [("of all photos", &self.detection), ("by photo", &self.detection_by_photo)] {
            let [p, r, f1] = [m.precision, m.recall, m.f1].map(percent);
            writeln!(f, "  detection at IoU 0.5, {name}: precision {p}, recall {r}, F1 {f1}")?;
        }
        writeln!(f, "  {} hits, their IoU {}", self.n_hits, percent(self.iou_of_hits))?;
        self.definitions.iter().try_for_each(|(name, text)| writeln!(f, "  {name}: {text}"))
    }
}

#[cfg(test)]
mod tests {
    use geo_types::Rect;

    use super::*;

    fn house(x: f64, width: f64) -> MultiPolygon<f64> {
        Rect::new((x, 0.0), (x + width, 10.0)).to_polygon().into()
    }

    fn assert_near(found: [f64; 4], expected: [f64; 4]) {
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    /// By hand. Photo 1: a house of 10 × 10 found 2 beside itself (80 shared of 120), one missed, one invented. Photo 2: one
    /// house found twice as wide (100 shared of 200). Photo 3: no house, and one found.
    #[test]
    fn measures_by_building_and_by_photo_are_those_of_a_hand_calculation() {
        let photos = [
            PhotoAreas::of(&[house(2.0, 10.0), house(100.0, 10.0)], &[house(0.0, 10.0), house(50.0, 10.0)]),
            PhotoAreas::of(&[house(0.0, 20.0)], &[house(0.0, 10.0)]),
            PhotoAreas::of(&[house(0.0, 20.0)], &[]),
        ];
        let found = evaluate_photos(&photos);
        let four = |m: AreaMeasures| [m.iou, m.precision, m.recall, m.f1];
        let (iou, f1) = (2.0 / 3.0, 2.0 / 3.0);
        assert_near(
            four(found.area_by_building),
            [(iou + 0.5) / 3.0, (0.8 + 0.5) / 3.0, (0.8 + 1.0) / 3.0, (0.8 + f1) / 3.0],
        );
        assert_near(four(found.area_by_photo), [f64::midpoint(iou / 2.0, 0.5), 0.45, 0.7, f64::midpoint(0.4, f1)]);
        let d = found.detection;
        assert_near(
            [d.precision, d.recall, d.f1, found.iou_of_hits],
            [0.5, 2.0 / 3.0, 4.0 / 7.0, f64::midpoint(iou, 0.5)],
        );
        let d = found.detection_by_photo;
        assert_near([d.precision, d.recall, d.f1, 0.0], [0.75, 0.75, 0.75, 0.0]);
        let counts =
            [found.n_photos, found.n_photos_without, found.n_truth, found.n_found, found.n_pairs, found.n_hits];
        assert_eq!(counts, [2, 1, 3, 4, 2, 2]);
    }

    /// Two houses, two footprints over both: the sum over the photo is greatest with each its own, though the first footprint fits
    /// the second house best.
    #[test]
    fn pairs_are_the_best_for_the_photo_not_for_each_house() {
        let shared = vec![(0, 0, 60.0), (1, 0, 80.0), (1, 1, 70.0)];
        let found = evaluate_photos(&[PhotoAreas { truth: vec![100.0; 2], found: vec![100.0; 2], shared }]);
        assert_eq!(found.n_pairs, 2);
        assert_near([found.area_by_building.recall, 0.0, 0.0, 0.0], [0.65, 0.0, 0.0, 0.0]);
    }

    /// The law that tells areas from counts, in one pair.
    #[test]
    fn areas_follow_the_law_of_iou_from_precision_and_recall() {
        let found = evaluate_photos(&[PhotoAreas::of(&[house(3.0, 12.0)], &[house(0.0, 10.0)])]).area_by_building;
        assert!((found.iou - 1.0 / (1.0 / found.precision + 1.0 / found.recall - 1.0)).abs() < 1e-12);
        // 7 of 12 found and of 10 true.
        assert_near([found.precision, found.recall, found.iou, 0.0], [7.0 / 12.0, 0.7, 7.0 / 15.0, 0.0]);
    }
}
