//! Cells over an outline, along the direction of its walls.

use geo::Area as _;
use geo_types::{LineString, Polygon};
use glam::DVec2;

use super::evidence::RADIUS;

/// Side of a cell, metres: an annex of 8 m² has 32.
const CELL_M: f64 = 0.5;
/// Most cells, about; larger outlines have larger cells.
const MAX_CELLS: f64 = 1500.0;
/// Walls within this of a direction follow it: sine of the angle.
const ALONG: f64 = 0.1;

/// Cells over an outline, row-major, with a margin of half a comparison window.
pub(super) struct Grid {
    origin: DVec2,
    pub axes: [DVec2; 2],
    pub cell_m: f64,
    pub width: usize,
    pub height: usize,
    /// Cells whose middle is inside, ascending.
    pub cells: Vec<usize>,
    /// 1 in these, 0 elsewhere.
    pub mask: Vec<f32>,
}

impl Grid {
    pub fn new(outline: &Polygon<f64>) -> Self {
        let along = main_direction(outline);
        let axes = [along, along.perp()];
        let reach = |axis: DVec2| {
            let on = || outline.exterior().coords().map(|c| DVec2::new(c.x, c.y).dot(axis));
            (on().fold(f64::INFINITY, f64::min), on().fold(f64::NEG_INFINITY, f64::max))
        };
        let cell_m = CELL_M.max((outline.unsigned_area() / MAX_CELLS).sqrt());
        let [(u, n_u), (v, n_v)] = axes.map(|axis| {
            let (low, high) = reach(axis);
            let n = ((high - low) / cell_m).ceil().max(1.0);
            // Both ends share what whole cells reach beyond.
            (0.5 * (low + high - n * cell_m) - RADIUS as f64 * cell_m, n as usize + 2 * RADIUS)
        });
        let origin = u * axes[0] + v * axes[1];
        let mut grid =
            Self { origin, axes, cell_m, width: n_u, height: n_v, cells: Vec::new(), mask: vec![0.0; n_u * n_v] };
        for row in 0..grid.height {
            let crossings = grid.crossings(outline, row);
            let first = row * grid.width;
            let is_inside = |i: &usize| {
                let u = grid.middle(*i).dot(axes[0]);
                crossings.iter().filter(|crossing| **crossing < u).count() % 2 == 1
            };
            let inside: Vec<usize> = (first..first + grid.width).filter(is_inside).collect();
            grid.cells.extend(inside);
        }
        for &i in &grid.cells {
            grid.mask[i] = 1.0;
        }
        grid
    }

    /// Where the middle line of a row crosses the outline, along the first axis.
    fn crossings(&self, outline: &Polygon<f64>, row: usize) -> Vec<f64> {
        let v = self.middle(row * self.width).dot(self.axes[1]);
        let rings = std::iter::once(outline.exterior()).chain(outline.interiors());
        let crossing = |[a, b]: [DVec2; 2]| {
            let (from, to) = (a.dot(self.axes[1]), b.dot(self.axes[1]));
            ((from <= v) != (to <= v)).then(|| a.lerp(b, (v - from) / (to - from)).dot(self.axes[0]))
        };
        rings.flat_map(walls).filter_map(crossing).collect()
    }

    pub fn column_row(&self, i: usize) -> [usize; 2] {
        [i % self.width, i / self.width]
    }

    /// Middle of a cell, map frame.
    pub fn middle(&self, i: usize) -> DVec2 {
        let [column, row] = self.column_row(i);
        self.at(DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * self.cell_m)
    }

    /// Place of the map, by metres along the axes from the grid's corner; and back.
    pub fn at(&self, along: DVec2) -> DVec2 {
        self.origin + along.x * self.axes[0] + along.y * self.axes[1]
    }

    pub fn along(&self, place: DVec2) -> DVec2 {
        let from_corner = place - self.origin;
        DVec2::new(from_corner.dot(self.axes[0]), from_corner.dot(self.axes[1]))
    }

    pub fn area_m2(&self) -> f64 {
        self.cells.len() as f64 * self.cell_m.powi(2)
    }
}

fn walls(ring: &LineString<f64>) -> impl Iterator<Item = [DVec2; 2]> {
    ring.lines().map(|wall| [wall.start, wall.end].map(|c| DVec2::new(c.x, c.y)))
}

/// The direction that the greatest length of walls follows or is square to.
fn main_direction(outline: &Polygon<f64>) -> DVec2 {
    let walls: Vec<DVec2> = walls(outline.exterior()).map(|[a, b]| b - a).filter(|wall| wall.length() > 0.0).collect();
    let following_m = |direction: DVec2| -> f64 {
        let of_wall = |wall: &DVec2| {
            let off = wall.dot(direction).abs().min(wall.perp_dot(direction).abs()) / wall.length();
            // The nearer to the direction, the more: the middle of a bundle wins.
            (1.0 - off / ALONG).max(0.0) * wall.length()
        };
        walls.iter().map(of_wall).sum()
    };
    let directions = walls.iter().map(|wall| wall.normalize());
    directions.max_by(|a, b| following_m(*a).total_cmp(&following_m(*b))).unwrap_or(DVec2::X)
}
