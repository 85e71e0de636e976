//! Borders between regions as arcs that both regions share.

use std::collections::HashMap;

use geo_types::Coord;

use super::partition::{Key, LabelledRing};

/// A border between the same two regions from one junction to the next, or all around.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Arc {
    /// The region on its left as the partition has it.
    pub label: u32,
    /// The region on the other side.
    pub beyond: u32,
    /// Points; a closed arc repeats the first one.
    pub points: Vec<Coord<f64>>,
    /// Key of the first point.
    pub first: Key,
    /// Key of the last point.
    pub last: Key,
    /// Whether it meets no junction.
    pub is_closed: bool,
}

/// All arcs, and how rings are made of them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Arcs {
    /// Every arc, once; a border of two regions is the lower label's.
    pub arcs: Vec<Arc>,
    /// Per ring, its arcs in order: position, and whether it runs backwards.
    pub rings: Vec<Vec<(usize, bool)>>,
}

impl Arcs {
    /// Cuts rings at their junctions.
    pub(super) fn of(rings: &[LabelledRing]) -> Self {
        let mut arcs: Vec<Arc> = Vec::new();
        let mut by_first_line: HashMap<(Key, Key), usize> = HashMap::new();
        let mut of_rings = vec![Vec::new(); rings.len()];
        for is_second_look in [false, true] {
            for (r, ring) in rings.iter().enumerate() {
                for piece in pieces(ring) {
                    // The lower label owns the border; its neighbour's piece is the same one backwards.
                    let is_owner = piece.beyond == 0 || piece.label < piece.beyond;
                    let keys = &piece.keys;
                    if is_owner && !is_second_look {
                        by_first_line.insert((keys[0], keys[1]), arcs.len());
                        arcs.push(piece.into_arc());
                    } else if is_second_look {
                        let line =
                            if is_owner { (keys[0], keys[1]) } else { (keys[keys.len() - 1], keys[keys.len() - 2]) };
                        of_rings[r].extend(by_first_line.get(&line).map(|&arc| (arc, !is_owner)));
                    }
                }
            }
        }
        Self { arcs, rings: of_rings }
    }

    /// The arcs of a ring.
    pub(super) fn of_ring(&self, ring: usize) -> Vec<usize> {
        self.rings[ring].iter().map(|(arc, _)| *arc).collect()
    }
}

/// A stretch of a ring between junctions, ends included.
struct RingPiece {
    label: u32,
    beyond: u32,
    points: Vec<Coord<f64>>,
    keys: Vec<Key>,
    is_closed: bool,
}

impl RingPiece {
    fn into_arc(self) -> Arc {
        let Self { label, beyond, points, keys, is_closed } = self;
        Arc { label, beyond, points, first: keys[0], last: keys[keys.len() - 1], is_closed }
    }
}

fn pieces(ring: &LabelledRing) -> Vec<RingPiece> {
    let n = ring.points.len();
    let cuts: Vec<usize> = (0..n).filter(|&i| ring.keys[i].is_junction()).collect();
    let piece = |from: usize, to: usize, is_closed: bool| {
        let at = || (from..=to).map(|i| i % n);
        RingPiece {
            label: ring.label,
            beyond: ring.beyond[from % n],
            points: at().map(|i| ring.points[i]).collect(),
            keys: at().map(|i| ring.keys[i]).collect(),
            is_closed,
        }
    };
    if cuts.is_empty() {
        let start = start_of_closed(ring);
        return vec![piece(start, start + n, true)];
    }
    (0..cuts.len())
        .map(|i| {
            let (from, to) = (cuts[i], cuts[(i + 1) % cuts.len()]);
            piece(from, if to > from { to } else { to + n }, false)
        })
        .collect()
}

/// Start of a closed arc: at the point farthest from its middle, a corner; the same for both of its regions.
fn start_of_closed(ring: &LabelledRing) -> usize {
    let n = ring.points.len();
    let (mut low, mut high) = (ring.points[0], ring.points[0]);
    for p in &ring.points {
        low = Coord { x: low.x.min(p.x), y: low.y.min(p.y) };
        high = Coord { x: high.x.max(p.x), y: high.y.max(p.y) };
    }
    let middle = (low + high) / 2.0;
    let distance = |i: usize| (ring.points[i] - middle).x.hypot((ring.points[i] - middle).y);
    (0..n)
        .max_by(|&a, &b| distance(a).total_cmp(&distance(b)).then_with(|| ring.keys[b].cmp(&ring.keys[a])))
        .expect("a ring has points")
}
