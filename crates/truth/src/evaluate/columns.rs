//! Upright columns through closed meshes: where each is inside, by winding number.
//!
//! Along the vertical line through a cell's centre every crossing of a face that looks down enters a body, every
//! crossing of one that looks up leaves one. Inside is where the sum is not 0, so overlapping and touching bodies of one
//! set count once. Whether a line meets a triangle is decided edge by edge with the same arithmetic for both triangles
//! of an edge: no line slips through a seam or counts it twice.

use glam::{DVec2, DVec3};

use super::solid::Solid;

/// Centres are moved off the cells' middles by this share of a cell, so that corners on round numbers lie beside them.
const OFF_CENTRE: [f64; 2] = [0.003_7, 0.006_1];
/// Most cells of a grid.
const MOST_CELLS: usize = 200_000_000;

/// A grid of columns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColumnGrid {
    /// South-western corner, and the level that voxels count from.
    pub origin: DVec3,
    /// Number of columns along x and along y.
    pub size: [usize; 2],
    /// Side of a cell, metres.
    pub cell_m: f64,
}

impl ColumnGrid {
    /// Covers two sets of bodies; `None` for no bodies, or more than two hundred million cells.
    #[must_use]
    pub fn around(a: &[Solid], b: &[Solid], cell_m: f64) -> Option<Self> {
        let corners = || a.iter().chain(b).flat_map(|s| &s.facets).flat_map(|f| f.corners);
        let low = corners().reduce(DVec3::min)?;
        let high = corners().reduce(DVec3::max)?;
        // Cells on round numbers: the result does not depend on which bodies there are.
        let origin = (low / cell_m).floor() * cell_m;
        let n = |extent: f64| (extent / cell_m).ceil().max(1.0) as usize;
        let size = [n(high.x - origin.x), n(high.y - origin.y)];
        (size[0].checked_mul(size[1])? <= MOST_CELLS).then_some(Self { origin, size, cell_m })
    }

    fn centre(&self, col: usize, row: usize) -> DVec2 {
        DVec2::new(col as f64 + 0.5 + OFF_CENTRE[0], row as f64 + 0.5 + OFF_CENTRE[1]) * self.cell_m
    }
}

/// Stretches of a grid's columns inside a set of bodies: levels above the grid's origin, ascending, by cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// `(cell, from, to)`, sorted; cell = row · width + column.
    pub stretches: Vec<(u32, f64, f64)>,
    /// Columns that meet a body.
    pub n_met: usize,
    /// Columns whose winding number does not come back to 0: the mesh has holes there.
    pub n_open: usize,
}

impl Columns {
    /// Through all bodies of a set.
    #[must_use]
    pub fn through(solids: &[Solid], grid: &ColumnGrid) -> Self {
        let mut crossings: Vec<(u32, f64, i32)> = Vec::new();
        for facet in solids.iter().flat_map(|s| &s.facets) {
            cross(facet.corners.map(|p| p - grid.origin), grid, &mut crossings);
        }
        crossings.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(b.2.cmp(&a.2)));
        let mut columns = Self { stretches: Vec::new(), n_met: 0, n_open: 0 };
        for of_cell in crossings.chunk_by(|a, b| a.0 == b.0) {
            columns.n_met += 1;
            let mut winding = 0;
            let mut from = 0.0;
            for &(cell, level, change) in of_cell {
                let before = winding;
                winding += change;
                if before == 0 {
                    from = level;
                } else if winding == 0 && level > from {
                    match columns.stretches.last_mut() {
                        Some(last) if last.0 == cell && last.2 == from => last.2 = level,
                        _ => columns.stretches.push((cell, from, level)),
                    }
                }
            }
            columns.n_open += usize::from(winding != 0);
        }
        columns
    }
}

/// Adds where the columns meet a triangle: +1 where it looks down, −1 where it looks up.
fn cross(corners: [DVec3; 3], grid: &ColumnGrid, crossings: &mut Vec<(u32, f64, i32)>) {
    let plan = corners.map(DVec3::truncate);
    let low = plan[0].min(plan[1]).min(plan[2]) / grid.cell_m;
    let high = plan[0].max(plan[1]).max(plan[2]) / grid.cell_m;
    let twice_area = (plan[1] - plan[0]).perp_dot(plan[2] - plan[0]);
    if twice_area == 0.0 {
        return; // a wall
    }
    let first = |v: f64| (v - 1.0).floor().max(0.0) as usize;
    let last = |v: f64, n: usize| ((v + 1.0).ceil().max(0.0) as usize).min(n);
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let change = if twice_area > 0.0 { -1 } else { 1 };
    for row in first(low.y)..last(high.y, grid.size[1]) {
        for col in first(low.x)..last(high.x, grid.size[0]) {
            let p = grid.centre(col, row);
            let sides = [0, 1, 2].map(|i| is_left(plan[i], plan[(i + 1) % 3], p));
            if sides == [twice_area > 0.0; 3] {
                let away = p - plan[0];
                let level = corners[0].z - (normal.x * away.x + normal.y * away.y) / normal.z;
                crossings.push(((row * grid.size[0] + col) as u32, level, change));
            }
        }
    }
}

/// Whether a point lies left of the line from `a` to `b`; never the same answer for both directions.
fn is_left(a: DVec2, b: DVec2, p: DVec2) -> bool {
    let is_forward = (a.x, a.y) < (b.x, b.y);
    let (from, to) = if is_forward { (a, b) } else { (b, a) };
    ((to - from).perp_dot(p - from) >= 0.0) == is_forward
}
