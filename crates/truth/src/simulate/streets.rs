//! The street grid of a procedural town: blocks between streets of one direction and streets across them.
//!
//! Street frame: `u` along the town's heading, `v` across it, metres from the town's centre.

use glam::DVec2;
use rand_chacha::ChaCha8Rng;

use super::building::Placement;
use super::chance::between;

/// Width of the pavement along every block, metres.
pub(super) const PAVEMENT_M: f64 = 2.2;

/// Cover of the ground at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Land {
    /// A carriageway: metres from its axis, and along it.
    Road { across_m: f64, along_m: f64 },
    /// Crossing of two streets.
    Crossing,
    /// Slabs along the carriageway.
    Pavement,
    /// Inside a block, with the block's column and row.
    Block { col: usize, row: usize },
    /// Land outside the grid of streets.
    Open,
}

/// Widths along one axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rhythm {
    /// Shortest and longest block, metres.
    pub block_m: (f64, f64),
    /// Distance between the blocks, metres.
    pub street_m: f64,
}

/// Streets of a town and the blocks between them.
#[derive(Debug, Clone)]
pub(super) struct StreetPlan {
    /// From the street frame to the map.
    pub placement: Placement,
    /// Blocks along `u`: low and high end, ascending.
    pub columns: Vec<(f64, f64)>,
    /// Blocks along `v`: low and high end, ascending.
    pub rows: Vec<(f64, f64)>,
}

impl StreetPlan {
    /// `n × n` blocks around the origin.
    pub fn new(placement: Placement, n: usize, u: Rhythm, v: Rhythm, rng: &mut ChaCha8Rng) -> Self {
        let mut cut = |rhythm: Rhythm| {
            let mut blocks = Vec::with_capacity(n);
            let mut at = 0.0;
            for _ in 0..n {
                let end = at + between(rng, rhythm.block_m.0, rhythm.block_m.1);
                blocks.push((at, end));
                at = end + rhythm.street_m;
            }
            let middle = 0.5 * (at - rhythm.street_m);
            blocks.iter().map(|(a, b)| (a - middle, b - middle)).collect::<Vec<_>>()
        };
        let columns = cut(u);
        let rows = cut(v);
        Self { placement, columns, rows }
    }

    /// Columns and rows of the blocks, from the middle of the town outwards.
    pub fn blocks_from_the_middle(&self) -> Vec<(usize, usize)> {
        let mut blocks: Vec<(usize, usize)> =
            (0..self.rows.len()).flat_map(|row| (0..self.columns.len()).map(move |col| (col, row))).collect();
        let distance = |&(col, row): &(usize, usize)| {
            let middle = |(a, b): (f64, f64)| 0.5 * (a + b);
            DVec2::new(middle(self.columns[col]), middle(self.rows[row])).length()
        };
        blocks.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        blocks
    }

    /// Drops the blocks outside the smallest rectangle of blocks around `used`.
    pub fn keep(&mut self, used: &[(usize, usize)]) {
        let range = |pick: fn(&(usize, usize)) -> usize| {
            used.iter().map(pick).min().zip(used.iter().map(pick).max()).map(|(low, high)| low..=high)
        };
        if let (Some(columns), Some(rows)) = (range(|b| b.0), range(|b| b.1)) {
            self.columns = self.columns[columns].to_vec();
            self.rows = self.rows[rows].to_vec();
        }
    }

    /// Cover of the ground at a map position.
    pub fn land(&self, map: DVec2) -> Land {
        let p = DVec2::from_angle(-self.placement.angle_rad).rotate(map - self.placement.origin);
        match (locate(&self.columns, p.x), locate(&self.rows, p.y)) {
            (StreetPosition::Outside, _) | (_, StreetPosition::Outside) => Land::Open,
            (StreetPosition::Street(_), StreetPosition::Street(_)) => Land::Crossing,
            (StreetPosition::Street(across_m), _) => road_or_pavement(across_m, p.y),
            (_, StreetPosition::Street(across_m)) => road_or_pavement(across_m, p.x),
            (StreetPosition::Block(col), StreetPosition::Block(row)) => Land::Block { col, row },
        }
    }
}

/// Position along one axis; a street is told with the distance from its axis over its half width.
enum StreetPosition {
    Outside,
    Block(usize),
    Street([f64; 2]),
}

fn locate(blocks: &[(f64, f64)], x: f64) -> StreetPosition {
    let next = blocks.partition_point(|b| b.1 < x);
    match blocks.get(next) {
        Some(b) if b.0 <= x => StreetPosition::Block(next),
        Some(b) if next > 0 => {
            let a = blocks[next - 1].1;
            StreetPosition::Street([x - 0.5 * (a + b.0), 0.5 * (b.0 - a)])
        }
        _ => StreetPosition::Outside,
    }
}

fn road_or_pavement([across_m, half_m]: [f64; 2], along_m: f64) -> Land {
    if across_m.abs() > half_m - PAVEMENT_M { Land::Pavement } else { Land::Road { across_m, along_m } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_heights::seed;

    #[test]
    fn the_land_changes_at_the_kerbs() {
        let placement = Placement { origin: DVec2::new(1000.0, 2000.0), angle_rad: 0.4 };
        let rhythm = Rhythm { block_m: (60.0, 60.0), street_m: 12.0 };
        let plan = StreetPlan::new(placement, 2, rhythm, rhythm, &mut seed::stream(1, "test", &[]));
        let at = |u: f64, v: f64| plan.land(placement.point(DVec2::new(u, v)));
        assert!(matches!(at(-30.0, -30.0), Land::Block { col: 0, row: 0 }));
        assert!(matches!(at(30.0, -30.0), Land::Block { col: 1, row: 0 }));
        assert_eq!(at(0.0, 0.0), Land::Crossing);
        assert_eq!(at(5.0, 30.0), Land::Pavement);
        assert!(matches!(at(3.0, 30.0), Land::Road { across_m, .. } if (across_m - 3.0).abs() < 1e-9));
        assert_eq!(at(100.0, 0.0), Land::Open);
    }
}
