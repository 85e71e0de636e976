//! Footprints as a main body with wings: L, T, U and their like, whose gables run into each other.
//!
//! ```text
//! main body   the largest rectangle of the footprint that is longer one way; its ridge runs along it
//! wing        a rectangle that is left beside it; its ridge leaves the main body at right angles
//! rise(p)     greatest of  half width − |p across the ridge|  over those whose rectangle p lies in;
//!             a wing's reaches into the main body as far as its ridge
//! ```
//!
//! Coordinates are along the axes of the smallest rectangle around the footprint, metres.

use glam::{Mat2, Vec2};

use crate::scene::Prism;

/// Corners whose coordinates differ by less lie on one line, metres.
pub(crate) const SAME_LINE_M: f32 = 0.6;
/// Lines either way at most: more is no simple footprint.
const MOST_LINES: usize = 8;
/// The part of a footprint that rectangles may leave out or add.
const MOST_OFF: f32 = 0.1;
/// The least part of a footprint that is a main body.
const LEAST_MAIN: f32 = 0.3;

/// A gable over a rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WingGable {
    pub low: Vec2,
    pub high: Vec2,
    /// Low and high corner of where it is the roof: beyond the rectangle where walls lie a little off its lines, but not where it
    /// ends in another one's.
    pub reach: [Vec2; 2],
    /// Whether the ridge runs along the first axis.
    pub is_along_x: bool,
}

impl WingGable {
    /// Over a rectangle that stands alone.
    pub fn new(low: Vec2, high: Vec2, is_along_x: bool) -> Self {
        Self { low, high, reach: [low - SAME_LINE_M, high + SAME_LINE_M], is_along_x }
    }

    pub fn half_width_m(&self) -> f32 {
        let size = self.high - self.low;
        0.5 * if self.is_along_x { size.y } else { size.x }
    }

    /// Distance of a place of the rectangle from the nearer eave, metres; 0 beside the rectangle.
    fn rise_m(&self, at: Vec2) -> f32 {
        let is_within = at.cmpge(self.reach[0]).all() && at.cmple(self.reach[1]).all();
        let off = (at - 0.5 * (self.low + self.high)).abs();
        let across = if self.is_along_x { off.y } else { off.x };
        if is_within { (self.half_width_m() - across).max(0.0) } else { 0.0 }
    }
}

/// A main body with its wings.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Wings(Vec<WingGable>);

impl Wings {
    /// Half the width of the widest, metres: how far the highest ridge is from its eaves.
    pub fn run_m(&self) -> f32 {
        self.0.iter().map(WingGable::half_width_m).fold(0.0, f32::max)
    }

    /// The main body's gable, then the wings'.
    pub fn gables(&self) -> &[WingGable] {
        &self.0
    }

    /// Distance of a place inwards from the eaves, metres.
    pub fn rise_m(&self, at: Vec2) -> f32 {
        self.0.iter().map(|gable| gable.rise_m(at)).fold(0.0, f32::max)
    }

    /// Gables of a footprint: with the main body along either axis, where there is one; none of a plain rectangle, of a footprint with a
    /// courtyard or with walls askew.
    pub fn of(prism: &Prism, axes: Mat2) -> Vec<Self> {
        WallLattice::of(prism, axes).map_or_else(Vec::new, |lattice| {
            [true, false].into_iter().filter_map(|is_along_x| lattice.wings(is_along_x)).collect()
        })
    }
}

/// A footprint on the lines that its walls lie on.
struct WallLattice {
    xs: Vec<f32>,
    ys: Vec<f32>,
    /// Whether a cell is inside the footprint, row by row.
    is_inside: Vec<bool>,
}

/// Cells of a lattice: columns and rows, from and to (exclusive).
type Cells = [usize; 4];

/// Whether both ends of every wall are on one line.
fn walls_are_straight(corners: &[Vec2]) -> bool {
    corners.windows(2).all(|wall| (wall[1] - wall[0]).abs().min_element() <= SAME_LINE_M)
}

impl WallLattice {
    fn of(prism: &Prism, axes: Mat2) -> Option<Self> {
        let mut rings = prism.rings();
        let (exterior, None) = (rings.next()?, rings.next()) else { return None };
        let corners: Vec<Vec2> = exterior.iter().map(|corner| axes * *corner).collect();
        let lines = |axis: usize| lines(corners.iter().map(|corner| corner[axis]).collect());
        let lattice = Self { xs: lines(0), ys: lines(1), is_inside: Vec::new() };
        let (n_cols, n_rows) = (lattice.xs.len().checked_sub(1)?, lattice.ys.len().checked_sub(1)?);
        let is_simple = (2..MOST_LINES * MOST_LINES).contains(&(n_cols * n_rows));
        if !is_simple || n_cols >= MOST_LINES || n_rows >= MOST_LINES {
            return None;
        }
        let cell = |i: usize| [i % n_cols, i % n_cols + 1, i / n_cols, i / n_cols + 1];
        let is_inside = |i: usize| {
            let (low, high) = lattice.corners(cell(i));
            prism.contains(axes.transpose() * (0.5 * (low + high)))
        };
        let is_inside: Vec<bool> = (0..n_cols * n_rows).map(is_inside).collect();
        let lattice = Self { is_inside, ..lattice };
        let of_cells = lattice.area_m2(|_| true);
        // By walls that are askew the two differ: both ways, since cells are inside by their middles.
        let is_rectangular = (of_cells - prism.area_m2()).abs() <= MOST_OFF * of_cells && walls_are_straight(&corners);
        is_rectangular.then_some(lattice)
    }

    fn corners(&self, [from_col, to_col, from_row, to_row]: Cells) -> (Vec2, Vec2) {
        (Vec2::new(self.xs[from_col], self.ys[from_row]), Vec2::new(self.xs[to_col], self.ys[to_row]))
    }

    fn n_cols(&self) -> usize {
        self.xs.len() - 1
    }

    fn area_m2(&self, counts: impl Fn(usize) -> bool) -> f32 {
        let cells = (0..self.is_inside.len()).filter(|i| self.is_inside[*i] && counts(*i));
        cells.map(|i| self.size(self.cell(i)).element_product()).sum()
    }

    fn cell(&self, i: usize) -> Cells {
        let (col, row) = (i % self.n_cols(), i / self.n_cols());
        [col, col + 1, row, row + 1]
    }

    fn size(&self, cells: Cells) -> Vec2 {
        let (low, high) = self.corners(cells);
        high - low
    }

    fn of_cells([from_col, to_col, from_row, to_row]: Cells, n_cols: usize) -> impl Iterator<Item = usize> {
        (from_row..to_row).flat_map(move |row| (from_col..to_col).map(move |col| row * n_cols + col))
    }

    /// The largest rectangle that is longer along an axis, and what is left beside it.
    fn wings(&self, is_along_x: bool) -> Option<Wings> {
        let (n_cols, n_rows) = (self.n_cols(), self.ys.len() - 1);
        let ways = |n: usize| (0..n).flat_map(move |from| (from + 1..=n).map(move |to| [from, to]));
        let all = ways(n_cols).flat_map(|cols| ways(n_rows).map(move |rows| [cols[0], cols[1], rows[0], rows[1]]));
        let is_within = |cells: &Cells| Self::of_cells(*cells, n_cols).all(|i| self.is_inside[i]);
        // Half of a rectangle is no main body: it reaches as far as it can every way.
        let can_grow = |&[from_col, to_col, from_row, to_row]: &Cells| {
            from_col > 0 && is_within(&[from_col - 1, from_col, from_row, to_row])
                || to_col < n_cols && is_within(&[to_col, to_col + 1, from_row, to_row])
                || from_row > 0 && is_within(&[from_col, to_col, from_row - 1, from_row])
                || to_row < n_rows && is_within(&[from_col, to_col, to_row, to_row + 1])
        };
        let is_main = |cells: &Cells| {
            let size = self.size(*cells);
            (size.x >= size.y) == is_along_x && is_within(cells) && !can_grow(cells)
        };
        let area = |cells: &Cells| self.size(*cells).element_product();
        let main = all.filter(is_main).max_by(|a, b| area(a).total_cmp(&area(b)))?;
        if area(&main) < LEAST_MAIN * self.area_m2(|_| true) {
            return None;
        }
        let (low, high) = self.corners(main);
        let mut gables = vec![WingGable::new(low, high, is_along_x)];
        let mut is_taken = vec![false; self.is_inside.len()];
        Self::of_cells(main, n_cols).for_each(|i| is_taken[i] = true);
        while let Some(first) = (0..is_taken.len()).find(|i| self.is_inside[*i] && !is_taken[*i]) {
            gables.push(self.wing(first, main, &gables[0], &mut is_taken)?);
        }
        (gables.len() > 1).then(|| Wings((0..gables.len()).map(|i| among(i, &gables)).collect()))
    }

    /// The wing that a cell belongs to; `None` if it is no rectangle, or does not lie beside the main body.
    fn wing(&self, first: usize, main: Cells, body: &WingGable, is_taken: &mut [bool]) -> Option<WingGable> {
        let n_cols = self.n_cols();
        let [mut from_col, mut to_col, mut from_row, mut to_row] = self.cell(first);
        let (mut open, mut n_cells) = (vec![first], 0);
        is_taken[first] = true;
        while let Some(i) = open.pop() {
            let (col, row) = (i % n_cols, i / n_cols);
            n_cells += 1;
            (from_col, to_col) = (from_col.min(col), to_col.max(col + 1));
            (from_row, to_row) = (from_row.min(row), to_row.max(row + 1));
            let beside = [
                (col > 0).then(|| i - 1),
                (col + 1 < n_cols).then(|| i + 1),
                i.checked_sub(n_cols),
                Some(i + n_cols).filter(|i| *i < is_taken.len()),
            ];
            for next in beside.into_iter().flatten() {
                if self.is_inside[next] && !is_taken[next] {
                    is_taken[next] = true;
                    open.push(next);
                }
            }
        }
        if n_cells != (to_col - from_col) * (to_row - from_row) {
            return None;
        }
        let (mut low, mut high) = self.corners([from_col, to_col, from_row, to_row]);
        let middle = 0.5 * (body.low + body.high);
        // A ridge leaves the main body at right angles; where that is along it there is no other slope to run into.
        let leaves_along_x = to_col == main[0] || from_col == main[1];
        let is_beside = leaves_along_x || to_row == main[2] || from_row == main[3];
        if leaves_along_x != body.is_along_x {
            let axis = usize::from(!leaves_along_x);
            if low[axis] < middle[axis] {
                high[axis] = middle[axis];
            } else {
                low[axis] = middle[axis];
            }
        }
        is_beside.then(|| WingGable::new(low, high, leaves_along_x))
    }
}

/// One of several gables, which ends at a side of its rectangle that lies in another one's.
fn among(i: usize, gables: &[WingGable]) -> WingGable {
    let mut gable = gables[i];
    for axis in 0..2 {
        for (side, end, way) in [(0, gable.low, -1.0), (1, gable.high, 1.0)] {
            let (mut from, mut to) = (gable.low, gable.high);
            from[axis] = end[axis] + way * 0.5 * SAME_LINE_M;
            to[axis] = from[axis];
            // Walls that are in line lie a little off it.
            let lies_in = |at: Vec2, other: &WingGable| {
                at.cmpge(other.low - SAME_LINE_M).all() && at.cmple(other.high + SAME_LINE_M).all()
            };
            let goes_on = |(j, other): (usize, &WingGable)| j != i && lies_in(from, other) && lies_in(to, other);
            if gables.iter().enumerate().any(goes_on) {
                gable.reach[side][axis] = end[axis];
            }
        }
    }
    gable
}

/// The lines on which coordinates lie, ascending.
fn lines(mut values: Vec<f32>) -> Vec<f32> {
    values.sort_by(f32::total_cmp);
    let mut lines: Vec<Vec<f32>> = Vec::new();
    for value in values {
        match lines.last_mut() {
            Some(line) if value - line[line.len() - 1] < SAME_LINE_M => line.push(value),
            _ => lines.push(vec![value]),
        }
    }
    lines.iter().map(|line| line.iter().sum::<f32>() / line.len() as f32).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use geo_types::{Coord, LineString, Polygon};
    use glam::DVec3;

    use super::*;
    use crate::frames::LocalOrigin;
    use crate::roofs::smallest_rectangle;
    use crate::terrain::GroundLevel;

    /// A footprint, turned by some angle as houses are.
    pub(crate) fn prism(corners: &[(f64, f64)], turn_rad: f64) -> Prism {
        let (sin, cos) = turn_rad.sin_cos();
        let turned = |&(x, y): &(f64, f64)| Coord { x: cos * x - sin * y, y: sin * x + cos * y };
        let polygon = Polygon::new(LineString::new(corners.iter().map(turned).collect()), Vec::new());
        Prism::new(&polygon, GroundLevel::flat(0.0), LocalOrigin(DVec3::ZERO))
    }

    /// A house of 12 by 8 m with a wing of 6 by 5 m on its south side, its west end in line with the house's.
    pub(crate) const HOUSE: [(f64, f64); 6] =
        [(0.0, -5.0), (6.0, -5.0), (6.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)];

    #[test]
    fn a_wings_gable_runs_into_the_main_bodys() {
        for turn in [0.0, 0.4, 2.0] {
            let prism = prism(&HOUSE, turn);
            let (axes, ..) = smallest_rectangle(&prism);
            let (sin, cos) = (turn as f32).sin_cos();
            let at = |x: f32, y: f32| axes * Vec2::new(cos * x - sin * y, sin * x + cos * y);
            // The main body is 12 by 8 m: its ridge, 4 m within, runs along the 12. Either axis of the rectangle may be that.
            let wings = Wings::of(&prism, axes);
            let has_eave_in_the_north = |w: &&Wings| (w.rise_m(at(1.5, 7.5)) - 0.5).abs() < 0.01;
            let house = wings.iter().find(has_eave_in_the_north).unwrap();
            assert_eq!(wings.len(), 2, "the 13 by 6 m from north to south may be the main body as well");
            assert!((house.run_m() - 4.0).abs() < 1e-3);
            let rises = [
                ((9.0, 1.0), 1.0),  // on the slope beside the wing
                ((9.0, 7.5), 0.5),  // at the other eave
                ((3.0, -4.9), 3.0), // on the wing's ridge, at its gable end
                ((1.0, -2.0), 1.0),
                ((3.0, 2.0), 3.0), // where the wing's ridge runs over the main body's slope
                ((3.0, 3.6), 3.6), // behind its end
                ((0.5, 1.0), 1.0), // the main body's slope, higher than the wing's
            ];
            for ((x, y), rise_m) in rises {
                assert!(
                    (house.rise_m(at(x, y)) - rise_m).abs() < 1e-3,
                    "{turn}: ({x}, {y}) {}",
                    house.rise_m(at(x, y))
                );
            }
        }
    }

    #[test]
    fn plain_rectangles_courtyards_and_walls_askew_have_no_wings() {
        let n = |corners: &[(f64, f64)]| {
            let prism = prism(corners, 0.3);
            Wings::of(&prism, smallest_rectangle(&prism).0).len()
        };
        assert_eq!(n(&[(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)]), 0);
        // A corner that is 0.3 m off is that of a rectangle still.
        assert_eq!(n(&[(0.0, 0.0), (12.0, 0.3), (12.2, 8.0), (6.0, 8.1), (0.0, 8.0)]), 0);
        assert_eq!(n(&[(0.0, 0.0), (12.0, 0.0), (16.0, 8.0), (0.0, 8.0)]), 0);
        assert_eq!(n(&[(0.0, -5.0), (6.0, -5.0), (9.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)]), 0);
        assert!(n(&HOUSE) >= 1);
        // T and U.
        assert!(
            n(&[(0.0, 0.0), (5.0, 0.0), (5.0, -4.0), (9.0, -4.0), (9.0, 0.0), (14.0, 0.0), (14.0, 7.0), (0.0, 7.0)])
                >= 1
        );
        let u = [(0.0, 0.0), (4.0, 0.0), (4.0, 6.0), (10.0, 6.0), (10.0, 0.0), (14.0, 0.0), (14.0, 12.0), (0.0, 12.0)];
        assert!(n(&u) >= 1);
    }
}
