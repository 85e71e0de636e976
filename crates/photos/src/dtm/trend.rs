//! Trend of the ground: the lowest level that many squares share, with its slope.
//!
//! Squares lie on the ground, on roofs without a footprint, on crowns, or are false matches. Roofs and false matches have
//! many levels; the ground has one, which changes slowly:
//!
//! ```text
//! for each node, over the squares around it:
//! n(a, c)  squares with |z − a·Δ − c| ≤ WINDOW_M / 2, weighted by distance        a: slope, c: level at the node
//! c(a)     the lowest c with n(a, c) ≥ LOWEST_SHARE · max n(a, ·)
//! plane    the a with the most n(a, c(a)), fitted to the squares in its window
//! ```
//!
//! Planes that join make surfaces; the one with the most support is the ground. Heights are metres above the rough terrain.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::surface::plane;
use super::{GroundSquare, SquareOutcome};
use sizeup_geo::groups::Groups;

/// From one node to the next, in spacings of squares.
const NODE_SPACINGS: f64 = 4.0;
/// Squares count by a Gaussian of this width and up to this distance, both in spacings.
const WIDTH_SPACINGS: f64 = 4.0;
const REACH_SPACINGS: f64 = 10.0;
/// Fewer squares around a node, or on its plane, tell no ground.
const MIN_SQUARES: usize = 12;
const MIN_ON_PLANE: usize = 8;
/// Share of the weight around a node that its plane has to hold: where most squares are on roofs, the ground is unknown.
const LEAST_SHARE: f64 = 0.35;
/// Width of the window in which squares share a level, metres: matching errors, and the curvature of hills.
const WINDOW_M: f64 = 1.5;
/// A lower level is the ground if it has this share of the most squares on any level.
const LOWEST_SHARE: f64 = 0.5;
/// Slopes that are tried: steps along each axis.
const SLOPE_STEP: f64 = 0.04;
const N_SLOPES: i32 = 7;
/// A plane of this slope is an e-th as likely as a level one: slopes join roofs of different heights by chance.
const STEEP: f64 = 0.25;
/// Planes join if they differ by no more than this half-way between their nodes: metres, and per metre to there.
const AGREE_M: f64 = 0.5;
const AGREE_SLOPE: f64 = 0.01;
/// A surface with this share of the support of the largest one is ground too.
const TERRACE_SHARE: f64 = 0.5;
/// Neighbours of a node, and how far the trend reaches beyond nodes, in node spacings.
const NEIGHBOURS: f64 = 2.3;
const BEYOND: f64 = 6.0;
/// A square farther from the trend than this is not ground, metres: what a plane misses of hills.
const OFF_TREND_M: f64 = 2.0;

/// Ground plane around a node.
#[derive(Debug, Clone, Copy)]
struct NodePlane {
    /// Slopes along x and y, and level at the node, metres.
    plane: DVec3,
    /// Weighted number of squares on it.
    support: f64,
}

/// Smooth surface that squares on the ground lie close to.
#[derive(Debug, Default)]
pub(super) struct GroundTrend {
    nodes: RTree<GeomWithData<[f64; 2], NodePlane>>,
    node_spacing_m: f64,
}

impl GroundTrend {
    /// Trend of squares that lie so far apart, metres.
    pub fn of(squares: &[GroundSquare], spacing_m: f64) -> Self {
        let known =
            squares.iter().filter_map(|square| Some(GeomWithData::new(square.at.to_array(), square.height_m()?)));
        let known: RTree<GeomWithData<[f64; 2], f64>> = RTree::bulk_load(known.collect());
        let node_spacing_m = NODE_SPACINGS * spacing_m;
        let mut places: Vec<[i64; 2]> =
            squares.iter().map(|square| (square.at / node_spacing_m).round().to_array().map(|c| c as i64)).collect();
        places.sort_unstable();
        places.dedup();
        let fit = |place: &[i64; 2]| {
            let at = DVec2::new(place[0] as f64, place[1] as f64) * node_spacing_m;
            let reach_m = REACH_SPACINGS * spacing_m;
            let mut around: Vec<(DVec2, f64)> = known
                .locate_within_distance(at.to_array(), reach_m * reach_m)
                .map(|square| (DVec2::from_array(*square.geom()) - at, square.data))
                .collect();
            around.sort_by(|a, b| a.0.x.total_cmp(&b.0.x).then(a.0.y.total_cmp(&b.0.y)));
            Some(GeomWithData::new(at.to_array(), lowest_plane(&around, WIDTH_SPACINGS * spacing_m)?))
        };
        let nodes: Vec<GeomWithData<[f64; 2], NodePlane>> = places.par_iter().filter_map(fit).collect();
        let kept = best_supported(&nodes, NEIGHBOURS * node_spacing_m);
        Self { nodes: RTree::bulk_load(kept), node_spacing_m }
    }

    /// Level of the trend at a place, metres; `None` far from all nodes.
    pub fn at(&self, place: DVec2) -> Option<f64> {
        let near_m = NEIGHBOURS * self.node_spacing_m;
        let mut near = self.nodes.nearest_neighbor_iter_with_distance_2(&place.to_array()).peekable();
        let nearest_m = near.peek()?.1.sqrt();
        if nearest_m > BEYOND * self.node_spacing_m {
            return None;
        }
        let reach_m = nearest_m + near_m;
        let (mut sum, mut weights) = (0.0, 0.0);
        for (node, distance2) in near.take_while(|(_, distance2)| distance2.sqrt() <= reach_m) {
            let offset = place - DVec2::from_array(*node.geom());
            // A plane says little beyond its squares.
            let offset = offset.clamp_length_max(near_m);
            let weight = node.data.support * (-0.5 * distance2 / (0.5 * near_m).powi(2)).exp().max(1e-9);
            sum += weight * level(node.data.plane, offset);
            weights += weight;
        }
        (weights > 0.0).then(|| sum / weights)
    }

    /// Marks squares that lie far from the trend.
    pub fn leave_out_what_is_off(&self, squares: &mut [GroundSquare]) {
        for square in squares {
            let SquareOutcome::Ground(z_m) = square.outcome else { continue };
            if self.at(square.at).is_none_or(|trend_m| (z_m - trend_m).abs() > OFF_TREND_M) {
                square.outcome = SquareOutcome::Outlier(z_m);
            }
        }
    }
}

/// The nodes whose planes join to the surface with the most support, and those of other surfaces that have nearly as much: terraces.
fn best_supported(nodes: &[GeomWithData<[f64; 2], NodePlane>], reach_m: f64) -> Vec<GeomWithData<[f64; 2], NodePlane>> {
    let places = nodes.iter().enumerate().map(|(i, node)| GeomWithData::new(*node.geom(), i));
    let tree: RTree<GeomWithData<[f64; 2], usize>> = RTree::bulk_load(places.collect());
    let mut surfaces = Groups::new(nodes.len());
    for (i, node) in nodes.iter().enumerate() {
        for other in tree.locate_within_distance(*node.geom(), reach_m * reach_m) {
            let half = 0.5 * (DVec2::from_array(*other.geom()) - DVec2::from_array(*node.geom()));
            let step_m = level(node.data.plane, half) - level(nodes[other.data].data.plane, -half);
            if step_m.abs() <= AGREE_M + AGREE_SLOPE * half.length() {
                surfaces.join(i, other.data);
            }
        }
    }
    let mut support = vec![0.0; nodes.len()];
    (0..nodes.len()).for_each(|i| support[surfaces.first_of(i)] += nodes[i].data.support);
    let most = support.iter().copied().fold(0.0, f64::max);
    let is_kept = |i: &usize| support[surfaces.first_of(*i)] >= TERRACE_SHARE * most;
    let kept: Vec<usize> = (0..nodes.len()).filter(is_kept).collect();
    kept.into_iter().map(|i| nodes[i]).collect()
}

fn level(plane: DVec3, offset: DVec2) -> f64 {
    plane.truncate().dot(offset) + plane.z
}

/// The lowest plane that many of the heights around a node share.
fn lowest_plane(around: &[(DVec2, f64)], width_m: f64) -> Option<NodePlane> {
    if around.len() < MIN_SQUARES {
        return None;
    }
    let weight = |offset: DVec2| (-0.5 * offset.length_squared() / (width_m * width_m)).exp();
    let sum_of = |squares: &[(DVec2, f64)]| squares.iter().map(|(offset, _)| weight(*offset)).sum::<f64>();
    let slopes = (-N_SLOPES..=N_SLOPES).flat_map(|i| (-N_SLOPES..=N_SLOPES).map(move |j| (i, j)));
    let slopes = slopes.filter(|(i, j)| i * i + j * j <= N_SLOPES * N_SLOPES);
    let of_slope = |(i, j): (i32, i32)| {
        let slope = SLOPE_STEP * DVec2::new(f64::from(i), f64::from(j));
        let mut levels: Vec<(f64, f64)> =
            around.iter().map(|(offset, z_m)| (z_m - slope.dot(*offset), weight(*offset))).collect();
        levels.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (support, level_m) = lowest_level(&levels)?;
        Some((support * (-slope.length() / STEEP).exp(), slope.extend(level_m)))
    };
    let (_, start) = slopes.filter_map(of_slope).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let on_plane: Vec<(DVec2, f64)> =
        around.iter().filter(|(offset, z_m)| (z_m - level(start, *offset)).abs() <= 0.5 * WINDOW_M).copied().collect();
    if on_plane.len() < MIN_ON_PLANE {
        return None;
    }
    let support = sum_of(&on_plane);
    if support < LEAST_SHARE * sum_of(around) {
        return None;
    }
    Some(NodePlane { plane: plane(&on_plane, width_m, |_| 1.0)?, support })
}

/// Support and middle of the lowest window of sorted levels that holds much of the weight of the fullest one.
fn lowest_level(levels: &[(f64, f64)]) -> Option<(f64, f64)> {
    let mut windows = Vec::with_capacity(levels.len());
    let (mut end, mut held) = (0, 0.0);
    for start in 0..levels.len() {
        while end < levels.len() && levels[end].0 <= levels[start].0 + WINDOW_M {
            held += levels[end].1;
            end += 1;
        }
        windows.push(held);
        held -= levels[start].1;
    }
    let most = windows.iter().copied().fold(0.0, f64::max);
    let first = windows.iter().position(|held| *held >= LOWEST_SHARE * most)?;
    // The fullest window that overlaps the first one.
    let overlaps = |i: &usize| levels[*i].0 <= levels[first].0 + WINDOW_M;
    let best = (first..levels.len()).take_while(overlaps).max_by(|a, b| windows[*a].total_cmp(&windows[*b]))?;
    Some((windows[best], levels[best].0 + 0.5 * WINDOW_M))
}
