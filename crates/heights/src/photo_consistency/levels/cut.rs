//! The rectangle that gains most by one surface inside and another outside.

use geo::CoordsIter as _;
use geo_types::{Coord, LineString, Polygon};
use glam::DVec2;

use super::grid::Grid;
use super::surfaces::RoofSurface;
use crate::stats::mean;

/// Smallest part, m².
pub(super) const MIN_PART_M2: f64 = 6.0;
/// Lines along each axis that rectangles are tried between; their sides then move cell by cell.
const N_LINES: usize = 16;
/// Mean step at the border of a part, metres.
const MIN_STEP_M: f64 = 0.8;
/// Sides move to corners of the outline this near, metres.
const SNAP_M: f64 = 0.6;
/// Sides move by at most so many cells: two windows.
const MOVE_CELLS: isize = 4;
/// Least mean score that others are divided by.
const LEAST_USUAL: f64 = 0.1;
/// Beyond all outlines, metres.
const BEYOND_M: f64 = 1e4;

/// Columns and rows of cells, from and up to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CellRectangle {
    low: [usize; 2],
    high: [usize; 2],
}

impl CellRectangle {
    pub fn contains(&self, cell: [usize; 2]) -> bool {
        (0..2).all(|axis| (self.low[axis]..self.high[axis]).contains(&cell[axis]))
    }
}

/// A cut of a region.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    /// Gain over the best single surface, cells of full agreement.
    pub gain: f64,
    /// Cells of the smaller side.
    pub n_smaller: f64,
    pub rectangle: CellRectangle,
    /// Surfaces inside and outside.
    pub surfaces: [usize; 2],
}

/// The best cut of a region that has a step at its border and leaves both sides in one piece.
pub(super) fn best(grid: &Grid, is_in: &[bool], surfaces: &[RoofSurface]) -> Option<Cut> {
    let tables = Tables::new(grid, is_in, surfaces);
    let mut cuts = tables.best_by_surfaces();
    cuts.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    cuts.into_iter().filter(|cut| cut.gain > 0.0).map(|cut| tables.moved(cut)).find(|cut| {
        are_whole(grid, is_in, cut.rectangle)
            && step_m(grid, is_in, cut, surfaces).is_some_and(|step_m| step_m >= MIN_STEP_M)
    })
}

/// Whether the cells of a region inside a rectangle hang together, and those outside of it.
fn are_whole(grid: &Grid, is_in: &[bool], rectangle: CellRectangle) -> bool {
    let mut sides: Vec<Option<bool>> = vec![None; grid.mask.len()];
    for (&i, _) in grid.cells.iter().zip(is_in).filter(|(_, is_in)| **is_in) {
        sides[i] = Some(rectangle.contains(grid.column_row(i)));
    }
    // Slivers at slanted walls are none of the pieces.
    let mut n_large = 0;
    let min_cells = MIN_PART_M2 / 2.0 / grid.cell_m.powi(2);
    for first in 0..sides.len() {
        let Some(side) = sides[first].take() else { continue };
        let mut open = vec![first];
        let mut n_cells = 0.0;
        while let Some(i) = open.pop() {
            n_cells += 1.0;
            for beside in [i - 1, i + 1, i - grid.width, i + grid.width] {
                if sides[beside] == Some(side) {
                    sides[beside] = None;
                    open.push(beside);
                }
            }
        }
        n_large += usize::from(n_cells >= min_cells);
    }
    n_large == 2
}

/// Mean step along the border of a cut, metres; of the means of both sides where these do not touch.
fn step_m(grid: &Grid, is_in: &[bool], cut: &Cut, surfaces: &[RoofSurface]) -> Option<f64> {
    let mut inner = vec![false; grid.mask.len()];
    for (&i, is_in) in grid.cells.iter().zip(is_in) {
        inner[i] = *is_in && cut.rectangle.contains(grid.column_row(i));
    }
    let [inside, outside] = cut.surfaces.map(|s| &surfaces[s].heights_m);
    let at_border = grid.cells.iter().enumerate().filter(|&(at, &i)| {
        is_in[at] && !inner[i] && [i - 1, i + 1, i - grid.width, i + grid.width].iter().any(|&beside| inner[beside])
    });
    let steps_m: Vec<f64> = at_border.map(|(at, _)| f64::from((inside[at] - outside[at]).abs())).collect();
    mean(&steps_m).or_else(|| {
        let [inside, outside] = cut.surfaces.map(|s| surfaces[s].mean_m(is_in));
        Some((inside - outside).abs())
    })
}

/// Sums over all rectangles from a corner, by surface.
struct Tables {
    width: usize,
    sums: Vec<Vec<f32>>,
    n_cells: Vec<f32>,
    /// Sum over the whole region, by surface, and its cells.
    totals: Vec<f32>,
    n_all: f32,
    min_cells: f32,
    /// Around the region.
    reach: CellRectangle,
}

impl Tables {
    fn new(grid: &Grid, is_in: &[bool], surfaces: &[RoofSurface]) -> Self {
        let width = grid.width + 1;
        let table = |value: &dyn Fn(usize) -> f32| {
            let mut dense = vec![0.0_f32; grid.mask.len()];
            for (at, &i) in grid.cells.iter().enumerate().filter(|(at, _)| is_in[*at]) {
                dense[i] = value(at);
            }
            let mut sums = vec![0.0_f32; width * (grid.height + 1)];
            for (row, values) in dense.chunks_exact(grid.width).enumerate() {
                let mut of_row = 0.0;
                for (column, value) in values.iter().enumerate() {
                    of_row += value;
                    sums[(row + 1) * width + column + 1] = sums[row * width + column + 1] + of_row;
                }
            }
            sums
        };
        let sums: Vec<Vec<f32>> = surfaces.iter().map(|surface| table(&|at| surface.scores[at])).collect();
        let n_cells = table(&|_| 1.0);
        let last = |table: &Vec<f32>| table.last().copied().unwrap_or(0.0);
        let mut reach = CellRectangle { low: [usize::MAX; 2], high: [0; 2] };
        for (&i, _) in grid.cells.iter().zip(is_in).filter(|(_, is_in)| **is_in) {
            for (axis, at) in grid.column_row(i).into_iter().enumerate() {
                reach.low[axis] = reach.low[axis].min(at);
                reach.high[axis] = reach.high[axis].max(at + 1);
            }
        }
        Self {
            width,
            totals: sums.iter().map(last).collect(),
            n_all: last(&n_cells),
            sums,
            n_cells,
            min_cells: (MIN_PART_M2 / grid.cell_m.powi(2)) as f32,
            reach,
        }
    }

    fn sum(&self, table: &[f32], CellRectangle { low, high }: CellRectangle) -> f32 {
        let at = |column: usize, row: usize| table[row * self.width + column];
        at(high[0], high[1]) - at(low[0], high[1]) - at(high[0], low[1]) + at(low[0], low[1])
    }

    fn is_large(&self, rectangle: CellRectangle) -> bool {
        self.n_smaller(rectangle) >= f64::from(self.min_cells)
    }

    fn n_smaller(&self, rectangle: CellRectangle) -> f64 {
        let n = self.sum(&self.n_cells, rectangle);
        f64::from(n.min(self.n_all - n))
    }

    fn one(&self) -> f32 {
        self.totals.iter().copied().fold(0.0, f32::max)
    }

    fn gain(&self, rectangle: CellRectangle, [inside, outside]: [usize; 2]) -> f64 {
        let of = |surface: usize| self.sum(&self.sums[surface], rectangle);
        f64::from(of(inside) + self.totals[outside] - of(outside) - self.one())
    }

    /// The best rectangle between some lines for each two surfaces.
    fn best_by_surfaces(&self) -> Vec<Cut> {
        let lines = [0, 1].map(|axis| {
            let (low, size) = (self.reach.low[axis], self.reach.high[axis].saturating_sub(self.reach.low[axis]));
            let n = size.clamp(1, N_LINES);
            (0..=n).map(|i| low + (i * size + n / 2) / n).collect::<Vec<usize>>()
        });
        let n = self.sums.len();
        let mut best: Vec<Option<(f32, CellRectangle)>> = vec![None; n * n];
        let mut within = vec![0.0; n];
        for (from, &u0) in lines[0].iter().enumerate() {
            for &u1 in &lines[0][from + 1..] {
                for (from, &v0) in lines[1].iter().enumerate() {
                    for &v1 in &lines[1][from + 1..] {
                        let rectangle = CellRectangle { low: [u0, v0], high: [u1, v1] };
                        if !self.is_large(rectangle) {
                            continue;
                        }
                        for (within, table) in within.iter_mut().zip(&self.sums) {
                            *within = self.sum(table, rectangle);
                        }
                        for (inside, of_inside) in within.iter().enumerate() {
                            for (outside, of_outside) in within.iter().enumerate() {
                                let both = of_inside + self.totals[outside] - of_outside;
                                let best = &mut best[inside * n + outside];
                                if best.is_none_or(|(most, _)| both > most) {
                                    *best = Some((both, rectangle));
                                }
                            }
                        }
                    }
                }
            }
        }
        let one = self.one();
        let cut = |(at, best): (usize, Option<(f32, CellRectangle)>)| {
            let (both, rectangle) = best?;
            let surfaces = [at / n, at % n];
            let n_smaller = self.n_smaller(rectangle);
            (surfaces[0] != surfaces[1]).then_some(Cut { gain: f64::from(both - one), n_smaller, rectangle, surfaces })
        };
        best.into_iter().enumerate().filter_map(cut).collect()
    }

    /// The cut with its sides moved until nothing is gained.
    fn moved(&self, mut cut: Cut) -> Cut {
        let size = |axis: usize| self.reach.high[axis] - self.reach.low[axis];
        let mut step = size(0).max(size(1)).div_ceil(2 * N_LINES);
        while step > 0 {
            let mut is_better = false;
            for axis in 0..2 {
                for (is_low, forward) in [(true, true), (true, false), (false, true), (false, false)] {
                    let mut rectangle = cut.rectangle;
                    let line = if is_low { &mut rectangle.low[axis] } else { &mut rectangle.high[axis] };
                    let to = if forward { *line + step } else { line.saturating_sub(step) };
                    *line = to.clamp(self.reach.low[axis], self.reach.high[axis]);
                    if rectangle.low[axis] >= rectangle.high[axis] || !self.is_large(rectangle) {
                        continue;
                    }
                    let gain = self.gain(rectangle, cut.surfaces);
                    if gain > cut.gain {
                        (cut.gain, cut.rectangle, is_better) = (gain, rectangle, true);
                    }
                }
            }
            if !is_better {
                step /= 2;
            }
        }
        cut.n_smaller = self.n_smaller(cut.rectangle);
        cut
    }
}

/// The rectangle of a cut: its sides lie where both surfaces explain the photos alike, or on corners of the outline near
/// there, and beyond the outline where the region ends first.
pub(super) fn place(
    grid: &Grid,
    is_in: &[bool],
    cut: &Cut,
    [inside, outside]: &[RoofSurface; 2],
    outline: &Polygon<f64>,
) -> MapRectangle {
    let is_inner: Vec<bool> = grid.cells.iter().map(|&i| cut.rectangle.contains(grid.column_row(i))).collect();
    // Each surface against what it reaches on its own side: the one with more texture would push the border away else.
    let usual = |surface: &RoofSurface, on_inner: bool| {
        let own = (0..is_in.len()).filter(|&at| is_in[at] && is_inner[at] == on_inner);
        let scores: Vec<f64> = own.map(|at| f64::from(surface.scores[at])).collect();
        mean(&scores).unwrap_or(1.0).max(LEAST_USUAL) as f32
    };
    let (usual_inside, usual_outside) = (usual(inside, true), usual(outside, false));
    let mut leads = vec![f32::NAN; grid.mask.len()];
    for (at, &i) in grid.cells.iter().enumerate().filter(|(at, _)| is_in[*at]) {
        leads[i] = inside.scores[at] / usual_inside - outside.scores[at] / usual_outside;
    }
    let corners: Vec<DVec2> = outline.coords_iter().map(|c| grid.along(DVec2::new(c.x, c.y))).collect();
    let sides = Sides { grid, leads, corners, rectangle: cut.rectangle };
    let side = |of_axis: &dyn Fn(usize) -> f64| DVec2::new(of_axis(0), of_axis(1));
    MapRectangle { low: side(&|axis| sides.low(axis)), high: side(&|axis| sides.high(axis)) }
}

/// A rectangle along the grid's axes, metres from its corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapRectangle {
    low: DVec2,
    high: DVec2,
}

impl MapRectangle {
    /// Whether it holds the middle of a cell.
    pub fn contains(&self, grid: &Grid, i: usize) -> bool {
        let place = grid.along(grid.middle(i));
        place.cmpge(self.low).all() && place.cmplt(self.high).all()
    }

    /// In the map.
    pub fn polygon(&self, grid: &Grid) -> Polygon<f64> {
        let Self { low, high } = *self;
        let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
        let corner = |along: DVec2| {
            let place = grid.at(along);
            Coord { x: place.x, y: place.y }
        };
        Polygon::new(LineString::new(corners.map(corner).to_vec()), Vec::new())
    }
}

/// Scores that place the sides of a rectangle.
struct Sides<'a> {
    grid: &'a Grid,
    /// By how much the inner surface scores more than the outer one; `NaN` outside the region.
    leads: Vec<f32>,
    /// Corners of the outline along the grid's axes, metres.
    corners: Vec<DVec2>,
    rectangle: CellRectangle,
}

impl Sides<'_> {
    fn low(&self, axis: usize) -> f64 {
        let line = self.rectangle.low[axis];
        let is_last = (0..line).all(|before| self.lead(axis, before).is_none());
        if is_last { -BEYOND_M } else { self.snapped(axis, line as f64 - self.beyond(axis, |k| line as isize - 1 - k)) }
    }

    fn high(&self, axis: usize) -> f64 {
        let line = self.rectangle.high[axis];
        let is_last = (line..self.n_lines(axis)).all(|beyond| self.lead(axis, beyond).is_none());
        if is_last { BEYOND_M } else { self.snapped(axis, line as f64 + self.beyond(axis, |k| line as isize + k)) }
    }

    fn n_lines(&self, axis: usize) -> usize {
        if axis == 0 { self.grid.width } else { self.grid.height }
    }

    /// Mean lead over a line of cells beside the rectangle; `None` where the region has none there.
    fn lead(&self, axis: usize, line: usize) -> Option<f64> {
        let across = 1 - axis;
        let cell = |k: usize| if axis == 0 { k * self.grid.width + line } else { line * self.grid.width + k };
        let along = (self.rectangle.low[across]..self.rectangle.high[across]).map(|k| self.leads[cell(k)]);
        let known: Vec<f64> = along.filter(|lead| !lead.is_nan()).map(f64::from).collect();
        mean(&known)
    }

    /// How far beyond a side, cells, the inner surface goes on to explain the photos better; negative if it ends before. `line` is the
    /// line of cells so far beyond the side.
    fn beyond(&self, axis: usize, line: impl Fn(isize) -> isize) -> f64 {
        let lead = |k: isize| {
            usize::try_from(line(k)).ok().filter(|l| *l < self.n_lines(axis)).and_then(|l| self.lead(axis, l))
        };
        // Gained by a side moved to here, against one at the near end of the search.
        let (mut gained, mut best) = (0.0, (0.0, -MOVE_CELLS));
        for k in -MOVE_CELLS..MOVE_CELLS {
            gained += lead(k).unwrap_or(0.0);
            if gained > best.0 {
                best = (gained, k + 1);
            }
        }
        let (_, side) = best;
        let shift = match lead(side - 1).zip(lead(side)) {
            Some((inner, outer)) if inner > 0.0 && outer < 0.0 => inner / (inner - outer) - 0.5,
            _ => 0.0,
        };
        side as f64 + shift
    }

    /// A line, cells, as metres; on a corner of the outline that is near.
    fn snapped(&self, axis: usize, line: f64) -> f64 {
        let at = line * self.grid.cell_m;
        let near = self.corners.iter().map(|corner| corner[axis]).filter(|corner| (corner - at).abs() <= SNAP_M);
        near.min_by(|a, b| (a - at).abs().total_cmp(&(b - at).abs())).unwrap_or(at)
    }
}
