//! Regions of a label image as polygons that share their borders: marching squares with many labels at once.
//!
//! Nodes are cell centres, each with a label (0 = outside). Where two neighbouring nodes differ, a *crossing* lies
//! between them; within each square of four nodes the crossings are joined:
//!
//! ```text
//! two labels     one line between two crossings; at a saddle the lower label stays connected
//! three or four  lines from every crossing to a junction in the middle; equal labels across the diagonal stay
//!                connected instead
//! ```
//!
//! So no ring ever touches itself, and neighbours have the same points. Lorensen & Cline 1987 (doi:10.1145/37401.37422)
//! in the plane; the many-label case after Hege et al. 1997 (ZIB SC 97-05), reduced to two dimensions.
//! Frame: that of the nodes, `x` to the right along rows, `y` along columns; a node `(col, row)` is at
//! `(col + 0.5, row + 0.5)`. Everything beyond the raster is label 0.

use geo_types::Coord;

use sizeup_heights::raster::Raster;

/// A point of the partition: its key tells the same point of two regions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Key(u64);

/// Kinds of what lies at a key.
const KINDS: u64 = 3;
const RIGHT: u64 = 0;
const BELOW: u64 = 1;
const JUNCTION: u64 = 2;

impl Key {
    /// Whether three or more regions meet here.
    pub(super) fn is_junction(self) -> bool {
        self.0 % KINDS == JUNCTION
    }
}

/// One closed ring with its region on the left, seen with `y` *down* (to the right with `y` up).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LabelledRing {
    /// Label of the region on the ring's left.
    pub label: u32,
    /// Points without repetition of the first.
    pub points: Vec<Coord<f64>>,
    /// Key of each point, in the same order; the same point of two regions has one key.
    pub keys: Vec<Key>,
    /// The label on the other side of each line, from its point to the next.
    pub beyond: Vec<u32>,
}

/// A directed line with `label` on its left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Half {
    label: u32,
    from: Key,
    to: Key,
    beyond: u32,
}

/// Place of the border between two neighbouring nodes of labels `a` and `b`: the share of the way, 0 to 1 exclusive.
pub(super) type Crossing<'a> = &'a dyn Fn([usize; 2], u32, [usize; 2], u32) -> f64;

/// All rings of all labels but 0, by label, in a fixed order.
pub(super) fn rings(labels: &Raster<u32>, crossing: Crossing<'_>) -> Vec<LabelledRing> {
    let grid = NodeGrid { labels, crossing };
    let mut halves = grid.halves();
    halves.sort_unstable();
    let mut is_used = vec![false; halves.len()];
    let mut rings = Vec::new();
    for start in 0..halves.len() {
        if is_used[start] || halves[start].label == 0 {
            continue;
        }
        let label = halves[start].label;
        let mut ring = LabelledRing { label, points: Vec::new(), keys: Vec::new(), beyond: Vec::new() };
        let mut at = start;
        while !is_used[at] {
            is_used[at] = true;
            let half = halves[at];
            ring.points.push(grid.position(half.from));
            ring.keys.push(half.from);
            ring.beyond.push(half.beyond);
            // Each region passes each point once, so its line from there is the only one.
            at = halves.partition_point(|h| (h.label, h.from) < (label, half.to));
        }
        rings.push(ring);
    }
    rings
}

/// The node grid with a frame of label 0 around it.
struct NodeGrid<'a> {
    labels: &'a Raster<u32>,
    crossing: Crossing<'a>,
}

impl NodeGrid<'_> {
    /// Label of a node of the framed grid.
    fn label(&self, col: usize, row: usize) -> u32 {
        let inner = |i: usize| i.wrapping_sub(1);
        self.labels.get(inner(col), inner(row)).copied().unwrap_or(0)
    }

    fn key(&self, col: usize, row: usize, kind: u64) -> Key {
        Key((row as u64 * (self.labels.width() as u64 + 2) + col as u64) * KINDS + kind)
    }

    /// Lines of every square of nodes that holds more than one label.
    fn halves(&self) -> Vec<Half> {
        let (width, height) = (self.labels.width(), self.labels.height());
        let mut halves = Vec::new();
        for row in 0..=height {
            if row > 0 && row < height {
                // Squares within one label are nearly all: look for the others two rows at a time.
                let above = &self.labels.data()[(row - 1) * width..row * width];
                let below = &self.labels.data()[row * width..(row + 1) * width];
                self.square(0, row, &mut halves);
                for col in 1..width {
                    let first = above[col - 1];
                    if first != above[col] || first != below[col - 1] || first != below[col] {
                        self.square(col, row, &mut halves);
                    }
                }
                self.square(width, row, &mut halves);
            } else {
                (0..=width).for_each(|col| self.square(col, row, &mut halves));
            }
        }
        halves
    }

    /// The square whose upper left node is `(col, row)` of the framed grid.
    fn square(&self, col: usize, row: usize, halves: &mut Vec<Half>) {
        // Around the square with `y` down: left to right on top, then down, back and up.
        let nodes =
            [self.label(col, row), self.label(col + 1, row), self.label(col + 1, row + 1), self.label(col, row + 1)];
        let sides = [
            self.key(col, row, RIGHT),
            self.key(col + 1, row, BELOW),
            self.key(col, row + 1, RIGHT),
            self.key(col, row, BELOW),
        ];
        let differs = [0, 1, 2, 3].map(|i| nodes[i] != nodes[(i + 1) % 4]);
        let n_crossings = differs.iter().filter(|d| **d).count();
        let mut join = |from: Key, to: Key, left: u32, right: u32| {
            halves.push(Half { label: left, from, to, beyond: right });
            halves.push(Half { label: right, from: to, to: from, beyond: left });
        };
        // Side `i` lies between nodes `i` and `i + 1`: who leaves the square through it has node `i` on the left.
        match n_crossings {
            0 => {}
            2 => {
                let crossed: Vec<usize> = (0..4).filter(|&i| differs[i]).collect();
                let (i, j) = (crossed[0], crossed[1]);
                join(sides[j], sides[i], nodes[(j + 1) % 4], nodes[j]);
            }
            4 if nodes[0] == nodes[2] || nodes[1] == nodes[3] => {
                // Which diagonal stays connected; the nodes of the other one are cut off.
                let keeps_first = nodes[0] == nodes[2] && (nodes[1] != nodes[3] || nodes[0] < nodes[1]);
                for cut in if keeps_first { [1, 3] } else { [0, 2] } {
                    let (before, after) = ((cut + 3) % 4, cut);
                    join(sides[before], sides[after], nodes[cut], nodes[(cut + 1) % 4]);
                }
            }
            _ => {
                let middle = self.key(col, row, JUNCTION);
                for i in (0..4).filter(|&i| differs[i]) {
                    join(middle, sides[i], nodes[i], nodes[(i + 1) % 4]);
                }
            }
        }
    }

    fn position(&self, key: Key) -> Coord<f64> {
        let (cell, kind) = (key.0 / KINDS, key.0 % KINDS);
        let stride = self.labels.width() as u64 + 2;
        let (col, row) = ((cell % stride) as usize, (cell / stride) as usize);
        // The framed grid's first node is at (-0.5, -0.5).
        let (x, y) = (col as f64 - 0.5, row as f64 - 0.5);
        let along = |to: [usize; 2]| {
            let (a, b) = (self.label(col, row), self.label(to[0], to[1]));
            let inner = |i: usize| i.wrapping_sub(1);
            let is_framed = |c: usize, r: usize| self.labels.get(inner(c), inner(r)).is_none();
            if is_framed(col, row) || is_framed(to[0], to[1]) {
                return 0.5; // the raster's own border
            }
            (self.crossing)([col - 1, row - 1], a, [to[0] - 1, to[1] - 1], b).clamp(0.001, 0.999)
        };
        match kind {
            RIGHT => Coord { x: x + along([col + 1, row]), y },
            BELOW => Coord { x, y: y + along([col, row + 1]) },
            _ => {
                // The mean of the square's crossings.
                let mut sum = Coord { x: 0.0, y: 0.0 };
                let mut n = 0.0;
                let sides = [
                    ([col, row], [col + 1, row], RIGHT),
                    ([col + 1, row], [col + 1, row + 1], BELOW),
                    ([col, row + 1], [col + 1, row + 1], RIGHT),
                    ([col, row], [col, row + 1], BELOW),
                ];
                for (from, to, kind) in sides {
                    if self.label(from[0], from[1]) != self.label(to[0], to[1]) {
                        sum = sum + self.position(self.key(from[0], from[1], kind));
                        n += 1.0;
                    }
                }
                sum / n
            }
        }
    }
}

/// Half way: all that labels without values can tell.
pub(super) fn half_way(_: [usize; 2], _: u32, _: [usize; 2], _: u32) -> f64 {
    0.5
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    /// Twice the signed area, positive for rings that run clockwise with `y` down.
    fn twice_area(ring: &LabelledRing) -> f64 {
        let n = ring.points.len();
        (0..n).map(|i| (ring.points[i], ring.points[(i + 1) % n])).map(|(a, b)| a.x * b.y - b.x * a.y).sum()
    }

    fn image(text: &str) -> Raster<u32> {
        let rows: Vec<&str> = text.split_whitespace().collect();
        let cells = rows.iter().flat_map(|row| row.chars().map(|c| c.to_digit(10).unwrap())).collect();
        Raster::from_vec(rows[0].len(), rows.len(), cells).unwrap()
    }

    #[test]
    fn a_block_with_a_courtyard_has_two_rings_of_the_right_area() {
        let rings = rings(&image("11111 11011 11111"), &half_way);
        assert_eq!(rings.len(), 2);
        let areas: Vec<f64> = rings.iter().map(|r| 0.5 * twice_area(r)).collect();
        // 5 × 3 cells with the corners cut by an eighth each; a hole of one cell is a rhombus of half a cell.
        assert!(areas.contains(&14.5) || areas.contains(&-14.5), "{areas:?}");
        assert!((areas.iter().sum::<f64>().abs() - 14.0).abs() < 1e-12, "{areas:?}");
    }

    #[test]
    fn row_houses_share_the_points_of_their_wall() {
        let rings = rings(&image("1122 1122 1122"), &half_way);
        assert_eq!(rings.len(), 2);
        let shared: Vec<Coord<f64>> = rings[0].points.iter().filter(|p| rings[1].points.contains(p)).copied().collect();
        assert!(shared.len() >= 3 && shared.iter().all(|p| (p.x - 2.0).abs() < 0.3), "{shared:?}");
        assert_eq!(rings[0].keys.iter().filter(|k| k.is_junction()).count(), 2);
    }

    proptest! {
        #[test]
        fn every_region_is_enclosed_and_every_border_is_shared(
            cells in prop::collection::vec(0..4_u32, 6 * 5)
        ) {
            let labels = Raster::from_vec(6, 5, cells).unwrap();
            let rings = rings(&labels, &half_way);
            // The area of a region is that of its nodes up to what the corners cut off.
            let mut area: BTreeMap<u32, f64> = BTreeMap::new();
            for ring in &rings {
                *area.entry(ring.label).or_default() += 0.5 * twice_area(ring);
                let mut keys = ring.keys.clone();
                keys.sort_unstable();
                keys.dedup();
                prop_assert_eq!(keys.len(), ring.keys.len(), "a ring touches itself");
            }
            let sign = area.values().sum::<f64>().signum();
            for label in 1..4 {
                let n = labels.data().iter().filter(|l| **l == label).count() as f64;
                let found = sign * area.get(&label).copied().unwrap_or(0.0);
                prop_assert!((found - n).abs() <= 0.5 * n + 1e-9, "{label}: {found} for {n} cells");
            }
            let mut lines: BTreeMap<(Key, Key), u32> = BTreeMap::new();
            for ring in &rings {
                for i in 0..ring.keys.len() {
                    let (a, b) = (ring.keys[i], ring.keys[(i + 1) % ring.keys.len()]);
                    prop_assert_eq!(lines.insert((a, b), ring.label), None);
                }
            }
            for (&(a, b), &label) in &lines {
                if let Some(other) = lines.get(&(b, a)) {
                    prop_assert_ne!(label, *other);
                }
            }
        }
    }
}
