//! Volumes: how much of two sets of bodies is common. Three measures, none of which is another's equal.

use std::collections::BTreeMap;

use geo::{Area, BooleanOps, BoundingRect};
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};
use serde::{Deserialize, Serialize};

use super::columns::{ColumnGrid, Columns};
use super::solid::{Solid, UprightPrism};

/// Meaning of each number.
pub const VOLUME_DEFINITIONS: [(&str, &str); 6] = [
    (
        "prism_iou",
        "exact: volume common to the upright prisms of both, over the volume of either (plan overlay times common \
         levels); only where both are made of prisms",
    ),
    ("prism_iou_per_building", "mean over matched buildings of the same, building by building"),
    (
        "voxel_iou",
        "voxels whose centres lie in both, over voxels in either; inside by winding number along upright lines; any \
         closed mesh; voxel sizes in metres",
    ),
    (
        "column_iou",
        "sum over columns of 0.5 m of the lesser height over the sum of the greater; height: top minus bottom",
    ),
    ("volume_m3", "volume of the columns' stretches inside: result, reference"),
    ("open_share", "share of the columns through a mesh with holes, result and reference: voxels need closed meshes"),
];

/// Sides of voxels that volumes are counted with, metres.
const VOXELS_M: [f64; 2] = [0.5, 1.0];
/// Share of columns with an open mesh above which volumes are not computed.
const MOST_OPEN: f64 = 0.01;

/// Volumes that the bodies of result and reference have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VolumeEvaluation {
    /// Exact, over the whole scene; `None` where a body is not made of prisms.
    pub prism_iou: Option<f64>,
    /// Volume that prisms of one set share with each other, m³: result, reference. It is counted twice above.
    pub self_overlap_m3: Option<[f64; 2]>,
    /// Mean over matched buildings; `None` where there is none, or a body is not made of prisms.
    pub prism_iou_per_building: Option<f64>,
    /// By voxel size in metres.
    pub voxel_iou: BTreeMap<String, f64>,
    /// Columns of 0.5 m.
    pub column_iou: f64,
    /// Result and reference, m³.
    pub volume_m3: [f64; 2],
    /// Share of columns whose mesh is open: result, reference.
    pub open_share: [f64; 2],
    /// Meaning of each number.
    pub definitions: BTreeMap<String, String>,
}

/// Why volumes cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VolumeError {
    /// The mesh is not closed.
    #[error("{:.0} % of the columns through the {side} go in and never come out: its meshes have holes, or faces the wrong way round", 100.0 * share)]
    Open {
        /// Side with the open meshes: `result` or `reference`.
        side: &'static str,
        /// Share of the columns that go in and never come out, 0 to 1.
        share: f64,
    },
    /// There is nothing to compare, or far too much.
    #[error("the bodies span no area, or one too large for columns of {cell_m} m")]
    Extent {
        /// Side of a column.
        cell_m: f64,
    },
}

/// Compares two sets of bodies; `matched` are pairs of positions in them.
///
/// # Errors
/// [`VolumeError`].
///
/// # Panics
/// Never: there is at least one voxel size.
pub fn evaluate_volume(
    result: &[Solid],
    reference: &[Solid],
    matched: &[(usize, usize)],
) -> Result<VolumeEvaluation, VolumeError> {
    let mut voxel_iou = BTreeMap::new();
    let mut fine = None;
    for cell_m in VOXELS_M {
        let grid = ColumnGrid::around(result, reference, cell_m).ok_or(VolumeError::Extent { cell_m })?;
        let both = [Columns::through(result, &grid), Columns::through(reference, &grid)];
        for (columns, side) in both.iter().zip(["result", "reference"]) {
            let share = columns.n_open as f64 / columns.n_met.max(1) as f64;
            if share > MOST_OPEN {
                return Err(VolumeError::Open { side, share });
            }
        }
        voxel_iou.insert(cell_m.to_string(), iou_of_voxels(&both[0], &both[1], cell_m));
        fine.get_or_insert((both, cell_m));
    }
    let (fine, cell_m) = fine.expect("at least one voxel size");
    let volume = |c: &Columns| c.stretches.iter().map(|s| s.2 - s.1).sum::<f64>() * cell_m * cell_m;
    let prisms = |solids: &[Solid]| -> Option<Vec<UprightPrism>> {
        let all_prismatic = solids.iter().all(|s| !s.prisms.is_empty());
        all_prismatic.then(|| solids.iter().flat_map(|s| s.prisms.iter().cloned()).collect())
    };
    let as_prisms = prisms(result).zip(prisms(reference));
    let per_building: Option<Vec<f64>> = matched
        .iter()
        .map(|&(r, t)| {
            let (r, t) = (&result[r].prisms, &reference[t].prisms);
            (!r.is_empty() && !t.is_empty()).then(|| prism_iou(r, t))
        })
        .collect();
    Ok(VolumeEvaluation {
        prism_iou: as_prisms.as_ref().map(|(r, t)| prism_iou(r, t)),
        self_overlap_m3: as_prisms.as_ref().map(|(r, t)| [self_overlap_m3(r), self_overlap_m3(t)]),
        prism_iou_per_building: per_building.and_then(|ious| sizeup_heights::stats::mean(&ious)),
        voxel_iou,
        column_iou: iou_of_columns(&fine[0], &fine[1]),
        volume_m3: [volume(&fine[0]), volume(&fine[1])],
        open_share: [0, 1].map(|i| fine[i].n_open as f64 / fine[i].n_met.max(1) as f64),
        definitions: VOLUME_DEFINITIONS.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect(),
    })
}

fn prism_volume_m3(prism: &UprightPrism) -> f64 {
    prism.footprint.unsigned_area() * (prism.levels_m[1] - prism.levels_m[0])
}

fn common_m3(a: &UprightPrism, b: &UprightPrism) -> f64 {
    let thickness = a.levels_m[1].min(b.levels_m[1]) - a.levels_m[0].max(b.levels_m[0]);
    if thickness <= 0.0 {
        return 0.0;
    }
    a.footprint.intersection(&b.footprint).unsigned_area() * thickness
}

type Box2 = GeomWithData<Rectangle<[f64; 2]>, usize>;

fn tree_of(prisms: &[UprightPrism]) -> RTree<Box2> {
    let box_of = |(i, prism): (usize, &UprightPrism)| {
        let bounds = prism.footprint.bounding_rect()?;
        let corners = Rectangle::from_corners([bounds.min().x, bounds.min().y], [bounds.max().x, bounds.max().y]);
        Some(GeomWithData::new(corners, i))
    };
    RTree::bulk_load(prisms.iter().enumerate().filter_map(box_of).collect())
}

/// Volume common to the pairs of two sets, those with `a < b` only if `is_same`.
fn common_of_sets_m3(a: &[UprightPrism], b: &[UprightPrism], is_same: bool) -> f64 {
    let tree = tree_of(b);
    let mut sum = 0.0;
    for (i, prism) in a.iter().enumerate() {
        let Some(bounds) = prism.footprint.bounding_rect() else { continue };
        let around = AABB::from_corners([bounds.min().x, bounds.min().y], [bounds.max().x, bounds.max().y]);
        let mut near: Vec<usize> = tree.locate_in_envelope_intersecting(&around).map(|c| c.data).collect();
        near.sort_unstable();
        sum += near.into_iter().filter(|&k| !is_same || k > i).map(|k| common_m3(prism, &b[k])).sum::<f64>();
    }
    sum
}

fn self_overlap_m3(prisms: &[UprightPrism]) -> f64 {
    common_of_sets_m3(prisms, prisms, true)
}

/// Exact where the prisms of one set do not overlap each other.
#[must_use]
pub fn prism_iou(a: &[UprightPrism], b: &[UprightPrism]) -> f64 {
    let common = common_of_sets_m3(a, b, false);
    let total: f64 = a.iter().chain(b).map(prism_volume_m3).sum();
    common / (total - common)
}

/// Number of voxel centres `(k + ½) · size` lie in a stretch.
fn centres_in(from: f64, to: f64, size: f64) -> i64 {
    let first = |level: f64| (level / size - 0.5).ceil() as i64;
    (first(to) - first(from)).max(0)
}

/// The stretches of one cell.
type OfCell<'a> = &'a [(u32, f64, f64)];

/// Walks the cells of two sets of columns together.
fn by_cell<'a>(a: &'a Columns, b: &'a Columns) -> impl Iterator<Item = (OfCell<'a>, OfCell<'a>)> + 'a {
    let (mut i, mut k) = (0, 0);
    std::iter::from_fn(move || {
        let (next_a, next_b) = (a.stretches.get(i).map(|s| s.0), b.stretches.get(k).map(|s| s.0));
        let cell = match (next_a, next_b) {
            (Some(x), Some(y)) => x.min(y),
            (x, y) => x.or(y)?,
        };
        let take = |stretches: &'a [(u32, f64, f64)], from: &mut usize| {
            let start = *from;
            while stretches.get(*from).is_some_and(|s| s.0 == cell) {
                *from += 1;
            }
            &stretches[start..*from]
        };
        Some((take(&a.stretches, &mut i), take(&b.stretches, &mut k)))
    })
}

fn iou_of_voxels(a: &Columns, b: &Columns, size: f64) -> f64 {
    let (mut common, mut total) = (0_i64, 0_i64);
    for (of_a, of_b) in by_cell(a, b) {
        let count = |stretches: &[(u32, f64, f64)]| stretches.iter().map(|s| centres_in(s.1, s.2, size)).sum::<i64>();
        let pairs = of_a.iter().flat_map(|x| of_b.iter().map(move |y| (x, y)));
        let shared: i64 = pairs
            .map(|(x, y)| (x.1.max(y.1), x.2.min(y.2)))
            .filter(|(from, to)| to > from)
            .map(|(from, to)| centres_in(from, to, size))
            .sum();
        common += shared;
        total += count(of_a) + count(of_b) - shared;
    }
    common as f64 / total.max(1) as f64
}

fn iou_of_columns(a: &Columns, b: &Columns) -> f64 {
    let height = |stretches: &[(u32, f64, f64)]| match (stretches.first(), stretches.last()) {
        (Some(first), Some(last)) => last.2 - first.1,
        _ => 0.0,
    };
    let (least, greatest) = by_cell(a, b).fold((0.0, 0.0), |(least, greatest), (of_a, of_b)| {
        let (x, y) = (height(of_a), height(of_b));
        (least + f64::min(x, y), greatest + f64::max(x, y))
    });
    least / f64::max(greatest, f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::solid::tests::block;

    #[test]
    fn a_body_is_equal_to_itself_by_every_measure() {
        let town = [block("a", [0.0, 0.0, 3.0], [10.0, 8.0, 12.0]), block("b", [10.0, 0.0, 3.0], [7.0, 8.0, 4.3])];
        let v = evaluate_volume(&town, &town, &[(0, 0), (1, 1)]).unwrap();
        assert!((v.prism_iou.unwrap() - 1.0).abs() < 1e-12 && (v.prism_iou_per_building.unwrap() - 1.0).abs() < 1e-12);
        assert!(v.voxel_iou.values().all(|iou| *iou == 1.0) && v.column_iou == 1.0);
        assert!((v.volume_m3[0] - (960.0 + 240.8)).abs() < 1e-6, "{:?}", v.volume_m3);
    }

    #[test]
    fn half_the_height_or_half_the_ground_is_half_the_volume() {
        let whole = [block("a", [0.0, 0.0, 0.0], [10.0, 10.0, 20.0])];
        for half in [[10.0, 10.0, 10.0], [5.0, 10.0, 20.0]] {
            let v = evaluate_volume(&[block("a", [0.0, 0.0, 0.0], half)], &whole, &[(0, 0)]).unwrap();
            assert!((v.prism_iou.unwrap() - 0.5).abs() < 1e-12);
            assert!(v.voxel_iou.values().all(|iou| (iou - 0.5).abs() < 1e-12), "{v:?}");
            assert!((v.column_iou - 0.5).abs() < 1e-12);
        }
    }

    #[test]
    fn a_lifted_body_differs_in_volume_but_not_in_its_columns() {
        // 20 m high, lifted by 10 m: a third in common; column heights are the same.
        let (low, high) = (block("a", [0.0; 3], [10.0, 10.0, 20.0]), block("a", [0.0, 0.0, 10.0], [10.0, 10.0, 20.0]));
        let v = evaluate_volume(&[high], &[low], &[(0, 0)]).unwrap();
        assert!((v.prism_iou.unwrap() - 1.0 / 3.0).abs() < 1e-12);
        assert!(v.voxel_iou.values().all(|iou| (iou - 1.0 / 3.0).abs() < 1e-12));
        assert_eq!(v.column_iou, 1.0);
    }

    #[test]
    fn a_mesh_with_a_hole_is_refused() {
        let mut open = block("a", [0.0; 3], [10.0, 10.0, 20.0]);
        open.facets.retain(|f| !f.is_bottom);
        let error = evaluate_volume(&[block("a", [0.0; 3], [10.0, 10.0, 20.0])], &[open], &[]).unwrap_err();
        assert!(matches!(error, VolumeError::Open { side: "reference", share } if share == 1.0), "{error}");
    }

    #[test]
    fn touching_and_overlapping_bodies_count_once() {
        let whole = [block("a", [0.0; 3], [10.0, 10.0, 20.0])];
        let parts = [block("l", [0.0; 3], [6.0, 10.0, 20.0]), block("r", [5.0, 0.0, 0.0], [5.0, 10.0, 20.0])];
        let v = evaluate_volume(&parts, &whole, &[]).unwrap();
        assert!(v.voxel_iou.values().all(|iou| *iou == 1.0), "{v:?}");
        assert!((v.self_overlap_m3.unwrap()[0] - 200.0).abs() < 1e-9);
    }
}
