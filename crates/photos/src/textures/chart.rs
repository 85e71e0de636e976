//! A surface cut into texels, and into cells of several texels that visibility is found for.

use glam::{UVec2, Vec2, Vec3};

use super::SurfaceKind;
use super::atlas::MOST_SIDE_PX;
use super::scene::{LIFT_M, SurfaceScene};

/// Texels around a surface, so that neither filtering nor the blocks of JPEG mix neighbours on a page.
pub(super) const GUTTER_PX: u32 = 2;
/// Side of the cells that visibility and agreement are found for, metres: smaller than cars and crowns of trees. Photos
/// rarely agree better than to some tenths of a metre on blocks, whose walls lack sills and balconies.
const CELL_M: f64 = 0.5;
/// Fewest texels along a cell.
const LEAST_CELL_PX: u32 = 4;

/// A cell with a part of the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Middle of its texels on the surface, in the plane, metres.
    pub at: Vec2,
    /// Texels on the surface; 0 for a cell beside it.
    pub n_texels: u32,
    /// Whether it stands against a neighbour.
    pub is_party: bool,
}

/// A surface as a grid. Row 0 is the uppermost.
#[derive(Debug)]
pub(super) struct Chart {
    /// Side of a texel, metres: that of the town, or larger where the surface is too large for a page.
    pub texel_m: f32,
    /// Columns and rows, gutters included.
    pub size: UVec2,
    /// Place in the plane of the upper left corner of the grid, metres.
    corner: Vec2,
    /// A bit per texel, row by row: whether its middle is on the surface.
    inside: Vec<u8>,
    /// Texels along a cell.
    pub cell_px: u32,
    /// Columns and rows of cells.
    pub cells_size: UVec2,
    /// Cells, row by row.
    pub cells: Vec<Cell>,
}

impl Chart {
    /// The chart of a surface of a scene.
    pub fn of(scene: &SurfaceScene, surface: usize, texel_m: f64) -> Self {
        let facet = &scene.facets[surface];
        let (low, high) = facet.bounds();
        let extent = (high - low).max(Vec2::ZERO);
        let most_m = f64::from(extent.max_element());
        let texel_m = texel_m.max(most_m / f64::from(MOST_SIDE_PX - 2 * GUTTER_PX - 1));
        let n = |length: f32| (f64::from(length) / texel_m).ceil().max(1.0) as u32 + 2 * GUTTER_PX;
        let size = UVec2::new(n(extent.x), n(extent.y));
        let gutter_m = GUTTER_PX as f32 * texel_m as f32;
        let corner = Vec2::new(low.x - gutter_m, high.y + gutter_m);
        let cell_px = ((CELL_M / texel_m).round() as u32).max(LEAST_CELL_PX);
        let cells_size = UVec2::new(size.x.div_ceil(cell_px), size.y.div_ceil(cell_px));
        let mut chart =
            Self { texel_m: texel_m as f32, size, corner, inside: Vec::new(), cell_px, cells_size, cells: Vec::new() };
        let row = |y: u32| facet.contains_each((0..size.x).map(|x| chart.place(x, y)).collect());
        chart.inside = packed(size, (0..size.y).flat_map(row));
        let cell = |i: u32| {
            let of_cell = || chart.texels_of(i).filter(|(x, y)| chart.is_inside(*x, *y));
            let n_texels = of_cell().count() as u32;
            let at = of_cell().map(|(x, y)| chart.place(x, y)).sum::<Vec2>() / n_texels.max(1) as f32;
            let in_front = facet.point(at) + LIFT_M * facet.normal;
            let is_party =
                n_texels > 0 && facet.kind == SurfaceKind::Wall && scene.is_inside_neighbour(in_front, facet.building);
            Cell { at, n_texels, is_party }
        };
        chart.cells = (0..cells_size.x * cells_size.y).map(cell).collect();
        chart
    }

    /// Middle of a texel in the plane, metres.
    pub fn place(&self, x: u32, y: u32) -> Vec2 {
        self.corner + self.texel_m * Vec2::new(x as f32 + 0.5, -(y as f32 + 0.5))
    }

    /// A place in the plane as texels from the upper left corner.
    pub fn texels_at(&self, place: Vec2) -> Vec2 {
        let off = (place - self.corner) / self.texel_m;
        Vec2::new(off.x, -off.y)
    }

    pub fn is_inside(&self, x: u32, y: u32) -> bool {
        let texel = (y * self.size.x + x) as usize;
        self.inside[texel / 8] & (1 << (texel % 8)) != 0
    }

    /// Columns and rows of the texels of a cell.
    pub fn texels_of(&self, cell: u32) -> impl Iterator<Item = (u32, u32)> + use<> {
        let (cx, cy) = (cell % self.cells_size.x, cell / self.cells_size.x);
        let (size, n) = (self.size, self.cell_px);
        let columns = move || cx * n..((cx + 1) * n).min(size.x);
        (cy * n..((cy + 1) * n).min(size.y)).flat_map(move |y| columns().map(move |x| (x, y)))
    }

    /// Returns the number of texels of a cell.
    pub fn n_texels_of(&self, cell: u32) -> u32 {
        let [first, last] = self.corners_of(cell);
        (last[0] - first[0] + 1) * (last[1] - first[1] + 1)
    }

    /// First and last texel of a cell.
    pub fn corners_of(&self, cell: u32) -> [[u32; 2]; 2] {
        let (cx, cy) = (cell % self.cells_size.x, cell / self.cells_size.x);
        let end = |at: u32, size: u32| ((at + 1) * self.cell_px).min(size) - 1;
        [[cx * self.cell_px, cy * self.cell_px], [end(cx, self.size.x), end(cy, self.size.y)]]
    }

    /// The cells beside one, of the same grid.
    pub fn beside(&self, cell: usize) -> impl Iterator<Item = usize> + use<> {
        let (width, height) = (self.cells_size.x as usize, self.cells_size.y as usize);
        let (x, y) = (cell % width, cell / width);
        let left = (x > 0).then(|| cell - 1);
        let right = (x + 1 < width).then(|| cell + 1);
        let above = (y > 0).then(|| cell - width);
        let below = (y + 1 < height).then(|| cell + width);
        [left, right, above, below].into_iter().flatten()
    }

    /// A point of the surface in front of a cell, local frame.
    pub fn in_front(&self, scene: &SurfaceScene, surface: usize, cell: usize) -> Vec3 {
        let facet = &scene.facets[surface];
        facet.point(self.cells[cell].at) + LIFT_M * facet.normal
    }
}

/// Packs whether texels are on the surface into a bit each.
fn packed(size: UVec2, texels: impl Iterator<Item = bool>) -> Vec<u8> {
    let mut bits = vec![0; ((size.x * size.y) as usize).div_ceil(8)];
    texels.enumerate().filter(|(_, is_set)| *is_set).for_each(|(texel, _)| bits[texel / 8] |= 1 << (texel % 8));
    bits
}

#[cfg(test)]
impl Chart {
    /// A chart without gutters or cells, all of which is on the surface.
    pub(super) fn filled(size: UVec2) -> Self {
        let inside = packed(size, std::iter::repeat_n(true, (size.x * size.y) as usize));
        let (corner, cells_size) = (Vec2::ZERO, UVec2::ZERO);
        Self { texel_m: 0.1, size, corner, inside, cell_px: LEAST_CELL_PX, cells_size, cells: Vec::new() }
    }
}
