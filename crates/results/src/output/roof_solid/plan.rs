//! Patches on the grid: every edge of one is an edge of its neighbour or of the footprint, and ends where theirs do.

use std::collections::{BTreeMap, BTreeSet};

use geo::orient::{Direction, Orient as _};
use geo_types::{LineString, MultiPolygon};
use glam::DVec2;

use sizeup_heights::optimise::RoofPlane;

use super::super::footprint::{Ring, SnappedFootprint};
use super::super::planar::cross;
use super::{BuildingFrame, Point};

/// Corners nearer to each other, or to an edge, are one, metres: well below what a validator lets a face bend by.
const MERGE_M: f64 = 0.004;
/// Planes whose levels at a node differ by less meet there, metres.
const MEET_M: f64 = 0.05;

/// A part of the footprint under one plane.
pub(super) struct Patch {
    /// Position of the plane among the roof's.
    pub plane: usize,
    /// Exterior counter-clockwise, holes clockwise.
    pub rings: Vec<Ring>,
}

/// All patches of a footprint.
pub(super) struct RoofPlan {
    pub patches: Vec<Patch>,
    /// The plane to the left of each edge, either way.
    pub left_of: BTreeMap<[Point; 2], usize>,
    /// Each edge of the footprint as the nodes along it, both ends among them.
    pub border: Vec<Vec<Point>>,
}

impl RoofPlan {
    /// `None` where the patches do not fit together on the grid.
    pub fn of(footprint: &SnappedFootprint, patches: &[MultiPolygon<f64>], frame: &BuildingFrame<'_>) -> Option<Self> {
        let mut nodes = PlanNodes::of(footprint, frame);
        let mut drawn: Vec<(usize, Vec<Ring>)> = Vec::new();
        for (plane, patch) in patches.iter().enumerate() {
            for polygon in patch {
                let polygon = polygon.orient(Direction::Default);
                let mut ring = |ring: &LineString<f64>| -> Ring {
                    let corners = ring.coords().skip(1).map(|c| DVec2::new(c.x, c.y));
                    corners.map(|corner| nodes.nearest_or_new(corner)).collect()
                };
                let rings = std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(&mut ring).collect();
                drawn.push((plane, rings));
            }
        }
        let mut plan = Self { patches: Vec::new(), left_of: BTreeMap::new(), border: Vec::new() };
        for (plane, rings) in drawn {
            let mut rings = rings.iter().map(|ring| nodes.along_ring(ring)).filter(|ring| ring.len() >= 3).peekable();
            if rings.peek().is_none() {
                continue;
            }
            let rings: Vec<Ring> = rings.collect();
            for edge in rings.iter().flat_map(edges) {
                if plan.left_of.insert(edge, plane).is_some() {
                    return None;
                }
            }
            plan.patches.push(Patch { plane, rings });
        }
        plan.border = footprint.rings().iter().flat_map(edges).map(|[a, b]| nodes.along(a, b)).collect();
        plan.is_whole().then_some(plan)
    }

    /// Whether each edge has a patch on its left, and another one or the footprint's outside on its right.
    fn is_whole(&self) -> bool {
        let rim: BTreeSet<[Point; 2]> =
            self.border.iter().flat_map(|nodes| nodes.windows(2).map(|edge| [edge[0], edge[1]])).collect();
        let has_other_side = |edge: &[Point; 2]| self.left_of.contains_key(&[edge[1], edge[0]]) != rim.contains(edge);
        rim.iter().all(|edge| self.left_of.contains_key(edge)) && self.left_of.keys().all(has_other_side)
    }
}

/// The edges of a ring.
pub(super) fn edges(ring: &Ring) -> impl Iterator<Item = [Point; 2]> {
    ring.iter().zip(ring.iter().cycle().skip(1)).map(|(from, to)| [*from, *to])
}

/// Nodes at which edges end.
struct PlanNodes<'a> {
    frame: &'a BuildingFrame<'a>,
    /// Those of the footprint first.
    all: Vec<Point>,
    /// Edges of the footprint, its inside to the left.
    border: Vec<[Point; 2]>,
}

impl<'a> PlanNodes<'a> {
    fn of(footprint: &SnappedFootprint, frame: &'a BuildingFrame<'a>) -> Self {
        let corners = footprint.rings().iter().flatten().copied().collect();
        Self { frame, all: corners, border: footprint.rings().iter().flat_map(edges).collect() }
    }

    fn nearest_or_new(&mut self, at: DVec2) -> Point {
        if let Some(node) = self.near(at) {
            return node;
        }
        // A corner beside the footprint lies on it.
        let on_wall = |wall: &[Point; 2]| {
            let [from, to] = wall.map(|p| self.frame.metres(p));
            let along = to - from;
            let share = ((at - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            let foot = from + share * along;
            (foot.distance(at) <= MERGE_M).then(|| self.inside_of(*wall, foot))
        };
        let node = self.border.iter().find_map(on_wall).unwrap_or_else(|| self.frame.point(at));
        self.near(self.frame.metres(node)).unwrap_or_else(|| {
            self.all.push(node);
            node
        })
    }

    /// The place of the grid next to one on a wall that is inside: a neighbour at the same wall, whose nodes are elsewhere,
    /// must not share volume with this one, be it a few cubic centimetres (val3dity 601). On a slanting wall no place is taken
    /// for one on it: written in metres it may be beside it, by the last digit.
    fn inside_of(&self, [from, to]: [Point; 2], foot: DVec2) -> Point {
        let nearest = self.frame.point(foot);
        if from[0] == to[0] || from[1] == to[1] {
            return nearest;
        }
        let around = (-1..=1).flat_map(|x| (-1..=1).map(move |y| [nearest[0] + x, nearest[1] + y]));
        let distance = |p: &Point| self.frame.metres(*p).distance(foot);
        let inside = around.filter(|p| cross(from, to, *p) > 0);
        inside.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(nearest)
    }

    fn near(&self, at: DVec2) -> Option<Point> {
        let distances = self.all.iter().map(|node| (self.frame.metres(*node).distance(at), *node));
        let nearest = distances.min_by(|(a, _), (b, _)| a.total_cmp(b));
        nearest.filter(|(distance, _)| *distance <= MERGE_M).map(|(_, node)| node)
    }

    /// The nodes from one to another, both among them.
    fn along(&self, from: Point, to: Point) -> Vec<Point> {
        let [a, b] = [from, to].map(|p| self.frame.metres(p));
        let (length, along) = ((b - a).length(), (b - a).normalize_or_zero());
        let on_edge = |node: &Point| {
            let off = self.frame.metres(*node) - a;
            let way = off.dot(along);
            let is_on = way > 0.0 && way < length && off.perp_dot(along).abs() <= MERGE_M;
            (is_on && *node != from && *node != to).then_some((way, *node))
        };
        let mut between: Vec<(f64, Point)> = self.all.iter().filter_map(on_edge).collect();
        between.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let between = between.into_iter().map(|(_, node)| node);
        std::iter::once(from).chain(between).chain(std::iter::once(to)).collect()
    }

    /// A ring with all nodes on its edges, without repeated ones and without ways there and back.
    fn along_ring(&self, ring: &Ring) -> Ring {
        let mut nodes: Ring = Vec::new();
        for [from, to] in edges(ring) {
            for node in self.along(from, to).into_iter().skip(1) {
                match nodes.len() {
                    n if n > 0 && nodes[n - 1] == node => {}
                    n if n > 1 && nodes[n - 2] == node => {
                        nodes.pop();
                    }
                    _ => nodes.push(node),
                }
            }
        }
        // The seam.
        while nodes.len() >= 3 {
            let n = nodes.len();
            if nodes[0] == nodes[n - 1] || nodes[n - 2] == nodes[0] {
                nodes.pop();
            } else if nodes[n - 1] == nodes[1] {
                nodes.remove(0);
            } else {
                break;
            }
        }
        nodes
    }
}

/// The levels of the planes at the nodes that their patches touch, on the grid.
pub(super) struct NodeLevels {
    by_node: BTreeMap<Point, BTreeMap<usize, i64>>,
}

impl NodeLevels {
    pub fn of(plan: &RoofPlan, planes: &[RoofPlane], ground_z_m: f64, frame: &BuildingFrame<'_>) -> Self {
        let mut touching: BTreeMap<Point, BTreeSet<usize>> = BTreeMap::new();
        for patch in &plan.patches {
            for node in patch.rings.iter().flatten() {
                touching.entry(*node).or_default().insert(patch.plane);
            }
        }
        let at_node = |(node, touching): (Point, BTreeSet<usize>)| {
            let height_m = |plane: &usize| planes[*plane].height_m(frame.metres(node));
            let mut heights: Vec<(f64, usize)> = touching.iter().map(|plane| (height_m(plane), *plane)).collect();
            heights.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            let meet = |a: &(f64, usize), b: &(f64, usize)| b.0 - a.0 < MEET_M;
            let levels = heights.chunk_by(meet).flat_map(|group| {
                let mean_m = group.iter().map(|(height_m, _)| height_m).sum::<f64>() / group.len() as f64;
                let level = frame.grid.level(ground_z_m + mean_m);
                group.iter().map(move |(_, plane)| (*plane, level))
            });
            (node, levels.collect())
        };
        Self { by_node: touching.into_iter().map(at_node).collect() }
    }

    /// A plane at a node.
    pub fn level(&self, node: Point, plane: usize) -> i64 {
        self.by_node[&node][&plane]
    }

    /// The corner of a plane at a node.
    pub fn at(&self, node: Point, plane: usize) -> [i64; 3] {
        [node[0], node[1], self.level(node, plane)]
    }

    /// The corners of all planes at a node strictly between two levels, from the first to the second.
    pub fn between(&self, node: Point, from: i64, to: i64) -> Vec<[i64; 3]> {
        let levels: BTreeSet<i64> = self.by_node[&node].values().copied().collect();
        let within = levels.into_iter().filter(|level| *level > from.min(to) && *level < from.max(to));
        let mut within: Vec<[i64; 3]> = within.map(|level| [node[0], node[1], level]).collect();
        if from > to {
            within.reverse();
        }
        within
    }

    /// Lowest level of all, in steps of the grid.
    pub fn lowest(&self) -> Option<i64> {
        self.by_node.values().flat_map(BTreeMap::values).copied().min()
    }
}
