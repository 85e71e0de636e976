//! One footprint per building from all views that show it.
//!
//! Views vote on every cell of a fine grid: with coverage `cᵥ` of the cell by the building's footprint in view `v`, weight
//! `wᵥ` and what the view sees of the cell `sᵥ`,
//!
//! ```text
//! f(cell) = Σᵥ wᵥ cᵥ / Σᵥ wᵥ sᵥ
//! ```
//!
//! The footprint is where `f = ½`: half the votes say building on this side, half on that side. Across a wall this is
//! the weighted *median* of the views' walls, so a view whose mask bleeds or is ragged moves it little; and because only
//! views that see a cell vote on it, parts that image borders cut off complement each other.
//!
//! Buildings that may touch share one grid. A cell belongs to the building with the highest `f` if those of all
//! buildings together reach ½; borders between two buildings lie where their votes are equal. Neighbours therefore
//! have the same border, point by point, and neither gap nor overlap remains between them.

use std::collections::HashMap;

use geo::line_measures::{Distance as _, Euclidean};
use geo::{Area as _, BoundingRect as _};
use geo_types::{Coord, Polygon};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::{GeomWithData, Rectangle};

use super::candidate::{FootprintCandidate, SeenGround, bounds, envelope};
use super::cluster::{self, Cluster, Dropped};
use super::coverage::Scratch;
use super::partition;
use super::shape::{self, DrawingRules};
use super::votes::Votes;
use sizeup_geo::groups::Groups;
use sizeup_heights::raster::Raster;

/// How candidates of many views become one footprint per building.
#[derive(Debug, Clone, PartialEq)]
pub struct ConsensusConfig {
    /// Least intersection over union of two candidates that are the same building, 0 to 1.
    pub min_iou: f64,
    /// Least share of the views that see a place and show a building there, 0 to 1; below it there is none.
    pub min_support: f64,
    /// Cell of the grid that views vote on, metres; 0.02 to 2. Borders lie between cells, so this is no resolution.
    pub cell_m: f64,
    /// Cells of one building's grid at most; larger buildings get wider cells.
    pub max_cells: usize,
    /// Buildings closer than this are drawn together and share their border, metres.
    pub neighbour_m: f64,
    /// Tolerance of the footprints, metres on the ground; 0.01 to 10.
    pub tolerance_m: f64,
    /// Walls within this of their building's main direction or across it are turned into it, degrees; 0 leaves all walls
    /// as they are.
    pub snap_deg: f64,
    /// Most that drawing may move a corner, metres.
    pub max_shift_m: f64,
    /// Most that drawing may change a building's area, as a share of it, 0 to 1.
    pub max_area_change: f64,
    /// Courtyards below this are filled, m².
    pub min_hole_m2: f64,
    /// Least area of a building, m².
    pub min_area_m2: f64,
    /// Corners are snapped to multiples of this, metres, so that what is valid here is valid in the files. Above 0.
    pub grid_m: f64,
    /// For roof contours: heights that are tried until a building's own is known, metres; at each, the views' footprints of a
    /// roof fit together more or less well.
    pub roof_heights_m: &'static [f64],
}

impl ConsensusConfig {
    /// The values of every run. `min_iou` and `min_support` are studied in `lab/footprint-network.md`, the drawing in the test
    /// `footprint_accuracy`.
    pub const STANDARD: Self = Self {
        min_iou: 0.45,
        min_support: 0.34,
        cell_m: 0.2,
        max_cells: 1 << 18,
        neighbour_m: 0.6,
        tolerance_m: 0.4,
        snap_deg: 12.0,
        max_shift_m: 0.8,
        max_area_change: 0.1,
        min_hole_m2: 4.0,
        min_area_m2: 4.0,
        grid_m: 0.001,
        roof_heights_m: &[3.0, 5.0, 7.0, 9.0, 12.0, 15.0, 19.0, 24.0, 30.0, 38.0, 48.0, 60.0, 80.0, 100.0],
    };
}

impl Default for ConsensusConfig {
    fn default() -> Self {
        Self::STANDARD
    }
}

/// A building that views agree on.
#[derive(Debug, Clone, PartialEq)]
pub struct Consensus {
    /// Footprint; exterior counter-clockwise, holes clockwise. Map frame, metres.
    pub polygon: Polygon<f64>,
    /// Positions of its candidates.
    pub members: Vec<usize>,
    /// Distinct views that show it.
    pub n_views: usize,
    /// Views that see its place.
    pub n_seen: usize,
    /// Mean intersection over union of its candidates with the footprint, each within its own view.
    pub agreement: f64,
    /// Whether no single view shows it whole.
    pub is_assembled: bool,
    /// Area of what views agree on beside the footprint, in pieces that touch it in a corner at most, m².
    pub left_out_m2: f64,
}

/// All buildings, from west to east, and what was left out.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Agreed {
    /// One footprint per building, from west to east.
    pub buildings: Vec<Consensus>,
    /// Clusters without a building.
    pub dropped: Dropped,
}

/// One footprint per building from the candidates of all views.
#[must_use]
pub fn agree(candidates: &[FootprintCandidate], seen: &[SeenGround], config: &ConsensusConfig) -> Agreed {
    let (clusters, dropped) = cluster::cluster(candidates, seen, config);
    let mut buildings = draw(&clusters, candidates, seen, config);
    sort(&mut buildings);
    Agreed { buildings, dropped }
}

/// Sorts the buildings from west to east.
fn sort(buildings: &mut [Consensus]) {
    let place = |c: &Consensus| c.polygon.bounding_rect().map_or([0.0; 2], |r| [r.min().x, r.min().y]);
    buildings.sort_by(|a, b| {
        let (a, b) = (place(a), place(b));
        a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
    });
}

/// The same for footprints at a height that is not known yet: `levels` holds all candidates at several heights. Footprints of
/// one roof lie on top of each other at its own height and beside each other at any other, so each building is taken at
/// the height where its candidates fit best; a candidate belongs to one building.
pub(super) fn agree_at_some_level(
    levels: &[Vec<FootprintCandidate>],
    seen: &[SeenGround],
    config: &ConsensusConfig,
) -> Agreed {
    /// Share of a cluster's candidates that better fitting ones may have taken.
    const MOST_TAKEN: f64 = 0.4;
    let n = levels.first().map_or(0, Vec::len);
    let mut dropped = Dropped::default();
    let mut all: Vec<(f64, usize, Cluster)> = Vec::new();
    for (level, candidates) in levels.iter().enumerate() {
        let (clusters, left) = cluster::cluster(candidates, seen, config);
        if level == 0 {
            dropped = left;
        }
        let fits = cluster::fits(&clusters, candidates);
        all.extend(fits.into_iter().zip(clusters).map(|(fit, cluster)| (fit, level, cluster)));
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.members.cmp(&b.2.members)));
    let mut is_taken = vec![false; n];
    let mut clusters = Vec::new();
    for (_, level, cluster) in all {
        let free: Vec<usize> = cluster.members.iter().copied().filter(|&m| !is_taken[m]).collect();
        let n_taken = cluster.members.len() - free.len();
        if free.is_empty() || n_taken as f64 > MOST_TAKEN * cluster.members.len() as f64 {
            continue;
        }
        for &m in &free {
            is_taken[m] = true;
        }
        let mut views: Vec<usize> = free.iter().map(|&m| levels[level][m].view).collect();
        views.sort_unstable();
        views.dedup();
        let is_supported = views.len() as f64 >= config.min_support * cluster.n_seen as f64;
        if is_supported {
            let members = free.into_iter().map(|m| level * n + m).collect();
            clusters.push(cluster.with_members(members, views.len()));
        }
    }
    let candidates: Vec<FootprintCandidate> = levels.iter().flatten().cloned().collect();
    let mut buildings = draw(&clusters, &candidates, seen, config);
    buildings.iter_mut().flat_map(|b| &mut b.members).for_each(|m| *m %= n.max(1));
    sort(&mut buildings);
    Agreed { buildings, dropped }
}

/// Draws the footprints of clusters, neighbours together.
pub(super) fn draw(
    clusters: &[Cluster],
    candidates: &[FootprintCandidate],
    seen: &[SeenGround],
    config: &ConsensusConfig,
) -> Vec<Consensus> {
    let groups = groups(clusters, config.neighbour_m);
    let drawn: Vec<Vec<Consensus>> = groups
        .par_iter()
        .map_init(Scratch::default, |scratch, group| {
            let members: Vec<&Cluster> = group.iter().map(|&i| &clusters[i]).collect();
            draw_group(&members, candidates, seen, config, scratch)
        })
        .collect();
    drawn.into_iter().flatten().collect()
}

/// Draws buildings whose candidates are known: a number of the caller's own, and positions of candidates.
pub(super) fn draw_fixed(
    buildings: &[(usize, Vec<usize>)],
    candidates: &[FootprintCandidate],
    seen: &[SeenGround],
    config: &ConsensusConfig,
) -> Vec<(usize, Polygon<f64>)> {
    let clusters: Vec<Cluster> = buildings.iter().map(|(_, members)| Cluster::of(members, candidates)).collect();
    // No two buildings share a candidate.
    let numbers: HashMap<usize, usize> = buildings.iter().filter_map(|(i, m)| Some((*m.first()?, *i))).collect();
    let number = |members: &[usize]| numbers.get(members.first()?).copied();
    let drawn = draw(&clusters, candidates, seen, config);
    drawn.into_iter().filter_map(|c| Some((number(&c.members)?, c.polygon))).collect()
}

/// Clusters that may touch, directly or through others.
fn groups(clusters: &[Cluster], neighbour_m: f64) -> Vec<Vec<usize>> {
    let boxes: Vec<_> = clusters.iter().map(|c| bounds(&c.shape)).collect();
    let grown = |(low, high): ([f64; 2], [f64; 2])| (low.map(|v| v - neighbour_m), high.map(|v| v + neighbour_m));
    let entries = boxes.iter().enumerate().filter_map(|(i, b)| Some((i, (*b)?)));
    let tree = RTree::bulk_load(
        entries.map(|(i, b)| GeomWithData::new(Rectangle::from_aabb(envelope(b)), i)).collect::<Vec<_>>(),
    );
    let pairs: Vec<Vec<usize>> = (0..clusters.len())
        .into_par_iter()
        .map(|i| {
            let Some(own) = boxes[i] else { return Vec::new() };
            let near = tree.locate_in_envelope_intersecting(&envelope(grown(own))).map(|e| e.data).filter(|&j| j > i);
            let is_close = |&j: &usize| Euclidean.distance(&clusters[i].shape, &clusters[j].shape) <= neighbour_m;
            let mut close: Vec<usize> = near.filter(is_close).collect();
            close.sort_unstable();
            close
        })
        .collect();
    let mut sets = Groups::new(clusters.len());
    for (i, close) in pairs.iter().enumerate() {
        for &j in close {
            sets.join(i, j);
        }
    }
    let mut groups: Vec<Vec<usize>> = vec![Vec::new(); clusters.len()];
    for i in 0..clusters.len() {
        groups[sets.first_of(i)].push(i);
    }
    groups.retain(|g| !g.is_empty());
    groups
}

fn draw_group(
    group: &[&Cluster],
    candidates: &[FootprintCandidate],
    seen: &[SeenGround],
    config: &ConsensusConfig,
    scratch: &mut Scratch,
) -> Vec<Consensus> {
    let largest_m2 = group
        .iter()
        .filter_map(|c| bounds(&c.shape))
        .map(|(low, high)| (high[0] - low[0]) * (high[1] - low[1]))
        .fold(0.0, f64::max);
    let cell_m = config.cell_m.max((largest_m2 / config.max_cells as f64).sqrt());
    let votes: Vec<Votes> = group.iter().map(|c| Votes::count(c, candidates, seen, cell_m, scratch)).collect();
    let first_col = votes.iter().map(|v| v.window.first_col).min().unwrap_or(0);
    let first_row = votes.iter().map(|v| v.window.first_row).min().unwrap_or(0);
    let after_col = votes.iter().map(|v| v.window.first_col + v.window.width.cast_signed() as i64).max().unwrap_or(1);
    let after_row = votes.iter().map(|v| v.window.first_row + v.window.height.cast_signed() as i64).max().unwrap_or(1);
    let (width, height) = ((after_col - first_col) as usize, (after_row - first_row) as usize);

    // Sum and winner of the votes on each cell.
    let mut sum = vec![0.0_f32; width * height];
    let mut best = vec![0.0_f32; width * height];
    let mut labels = Raster::filled(width, height, 0_u32);
    for (label, votes) in (1_u32..).zip(&votes) {
        let window = &votes.window;
        let (left, bottom) = ((window.first_col - first_col) as usize, (window.first_row - first_row) as usize);
        for (row, shares) in votes.share.chunks_exact(window.width).enumerate() {
            let from = (bottom + row) * width + left;
            for (i, &share) in (from..).zip(shares) {
                sum[i] += share;
                if share > best[i] {
                    best[i] = share;
                    labels.data_mut()[i] = label;
                }
            }
        }
    }
    labels.data_mut().iter_mut().zip(&sum).filter(|(_, s)| **s < 0.5).for_each(|(label, _)| *label = 0);

    let vote = |label: u32, [col, row]: [usize; 2]| {
        f64::from(
            votes[label as usize - 1].at(first_col + col.cast_signed() as i64, first_row + row.cast_signed() as i64),
        )
    };
    let total = |[col, row]: [usize; 2]| f64::from(sum[row * width + col]);
    let crossing = |from: [usize; 2], a: u32, to: [usize; 2], b: u32| {
        // How far `a` leads at both ends; it leads at the first and not at the second.
        let lead = |at: [usize; 2]| match (a, b) {
            (0, _) => 0.5 - total(at),
            (_, 0) => total(at) - 0.5,
            _ => vote(a, at) - vote(b, at),
        };
        let (here, there) = (lead(from), lead(to));
        if here - there > 1e-9 { here / (here - there) } else { 0.5 }
    };
    let mut rings = partition::rings(&labels, &crossing);
    for point in rings.iter_mut().flat_map(|r| &mut r.points) {
        *point = Coord { x: (first_col as f64 + point.x) * cell_m, y: (first_row as f64 + point.y) * cell_m };
    }
    let rules = DrawingRules {
        tolerance_m: config.tolerance_m,
        snap_deg: config.snap_deg,
        max_shift_m: config.max_shift_m,
        max_area_change: config.max_area_change,
        min_hole_m2: config.min_hole_m2,
    };
    let shaped = shape::shape(&rings, rules);
    group
        .iter()
        .zip(&votes)
        .zip(1_u32..)
        .filter_map(|((cluster, votes), label)| {
            let parts = || shaped.iter().filter(|s| s.label == label);
            // What hangs on by a corner only is mostly a blot of some mask; how much it is, is told.
            let largest = parts().max_by(|a, b| a.polygon.unsigned_area().total_cmp(&b.polygon.unsigned_area()))?;
            let all_m2: f64 = parts().map(|part| part.polygon.unsigned_area()).sum();
            let others: Vec<_> = shaped.iter().filter(|s| s.label != label).map(|s| &s.polygon).collect();
            let polygon = votes.without_doubtful_holes(&largest.polygon, &others, scratch);
            Some(Consensus {
                agreement: votes.agreement(&polygon, scratch),
                polygon,
                members: cluster.members.clone(),
                n_views: cluster.n_views,
                n_seen: cluster.n_seen,
                is_assembled: cluster.members.iter().all(|&m| candidates[m].is_cut),
                left_out_m2: all_m2 - largest.polygon.unsigned_area(),
            })
        })
        .collect()
}
