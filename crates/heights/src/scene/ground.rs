//! The ground in the local frame, and where a ray meets it.

use glam::{DVec2, Vec2};

use crate::frames::LocalOrigin;
use crate::raster::Raster;
use crate::ray::Ray;
use crate::terrain::Terrain;

/// Cells along a side of the blocks that a ray can skip at once, the largest first.
const BLOCK_SIZES: [usize; 2] = [16, 4];
/// Anchors are rounded to this, metres.
const ANCHOR_STEP_M: f64 = 1e-6;

/// Ground heights, local frame, metres.
#[derive(Debug, Clone)]
pub enum LocalGround {
    /// A level plane at this height, metres.
    Level(f32),
    /// Heights at the nodes of a grid, bilinear between them.
    GroundGrid(GroundGrid),
}

/// Node `(col, row)` lies at `anchor + (first + (col, row)) · cell`: row 0 is the *southernmost*. The anchor is the node next
/// to the local origin, so that a position falls on the same place of a cell whatever rectangle was cut out.
#[derive(Debug, Clone)]
pub struct GroundGrid {
    /// `NaN` = no ground known here.
    heights: Raster<f32>,
    anchor: Vec2,
    /// The south-western node, counted from the anchor; whole numbers.
    first: Vec2,
    cell: Vec2,
    /// By size, the highest node of each block of cells; −∞ where nothing is known.
    block_tops: [Raster<f32>; BLOCK_SIZES.len()],
    top: f32,
}

/// A ray over the grid, in cells from the south-western node.
struct Walk<'a> {
    ray: &'a Ray,
    origin: Vec2,
    direction: Vec2,
    inverse: Vec2,
}

impl Walk<'_> {
    /// Ray parameter at which the ray leaves the square of `size` cells that it is in at `t`, with a nudge so that it always moves on:
    /// kilometres away, as a view of a whole city is, a ten-thousandth of a cell is less than the next number.
    fn exit(&self, t: f32, size: f32) -> f32 {
        let nudge = (1e-4 * self.inverse.abs().min_element()).max(2.0 * f32::EPSILON * t);
        let inside = self.origin + (t + nudge) * self.direction;
        let square = (inside / size).floor() * size;
        let far = Vec2::select(self.direction.cmpgt(Vec2::ZERO), square + size, square);
        let exits = (far - self.origin) * self.inverse;
        let exits = Vec2::select(self.direction.abs().cmpgt(Vec2::splat(1e-9)), exits, Vec2::INFINITY);
        exits.min_element().max(t + nudge)
    }

    /// Position in cells, half-way between two distances.
    fn between(&self, t: f32, next: f32) -> Vec2 {
        self.origin + 0.5 * (t + next) * self.direction
    }
}

impl LocalGround {
    /// Cuts a terrain to a map rectangle (`low` to `high`, metres) and moves it to the local frame.
    #[must_use]
    pub fn new(terrain: &Terrain, origin: LocalOrigin, low: DVec2, high: DVec2) -> Self {
        match terrain {
            Terrain::Constant(z_m) => Self::Level((z_m - origin.0.z) as f32),
            Terrain::Grid(dem) => {
                let (west, north) = dem.corner_m();
                let (cell_x, cell_y) = dem.cell_m();
                let all = dem.heights_m();
                // First and last node of the cut, counted from the west and from the north.
                let node = |m: f64, n: usize| m.clamp(0.0, (n - 1) as f64) as usize;
                let col0 = node(((low.x - west) / cell_x - 0.5).floor(), all.width());
                let col1 = node(((high.x - west) / cell_x - 0.5).ceil(), all.width());
                let row0 = node(((north - high.y) / cell_y - 0.5).floor(), all.height());
                let row1 = node(((north - low.y) / cell_y - 0.5).ceil(), all.height());
                let (width, height) = (col1 - col0 + 1, row1 - row0 + 1);
                let mut heights = Raster::filled(width, height, f32::NAN);
                for row in 0..height {
                    for col in 0..width {
                        let z_m = f64::from(all[(col0 + col, row1 - row)]);
                        heights[(col, row)] = (z_m - origin.0.z) as f32;
                    }
                }
                let cell = DVec2::new(cell_x, cell_y);
                let south_west = DVec2::new(
                    west + (col0 as f64 + 0.5) * cell_x - origin.0.x,
                    north - (row1 as f64 + 0.5) * cell_y - origin.0.y,
                );
                let first = (south_west / cell).round();
                // Other cuts of the same terrain come to the same anchor but for the rounding of large coordinates.
                let anchor = ((south_west - first * cell) / ANCHOR_STEP_M).round() * ANCHOR_STEP_M;
                Self::GroundGrid(GroundGrid::new(heights, anchor.as_vec2(), first.as_vec2(), cell.as_vec2()))
            }
        }
    }

    /// Height at a position; `NaN` where none is known.
    #[must_use]
    pub fn height_at(&self, position: Vec2) -> f32 {
        match self {
            Self::Level(z) => *z,
            Self::GroundGrid(grid) => grid.height_at(position),
        }
    }

    /// Ray parameter at which a ray that looks down first meets the ground; `None` if it never does.
    #[must_use]
    pub fn meets(&self, ray: &Ray) -> Option<f32> {
        if ray.direction.z >= 0.0 {
            return None;
        }
        match self {
            Self::Level(z) => {
                let t = (z - ray.origin.z) / ray.direction.z;
                (t > 0.0).then_some(t)
            }
            Self::GroundGrid(grid) => grid.meets(ray),
        }
    }
}

impl GroundGrid {
    fn new(heights: Raster<f32>, anchor: Vec2, first: Vec2, cell: Vec2) -> Self {
        let block_tops = BLOCK_SIZES.map(|size| highest_of_blocks(&heights, size));
        let top = block_tops[0].data().iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Self { heights, anchor, first, cell, block_tops, top }
    }

    /// Position in cells from the south-western node.
    fn in_cells(&self, position: Vec2) -> Vec2 {
        // Taking whole numbers off is exact, so the fraction does not depend on the cut.
        (position - self.anchor) / self.cell - self.first
    }

    fn height_at(&self, position: Vec2) -> f32 {
        let p = self.in_cells(position);
        let last = Vec2::new((self.heights.width() - 1) as f32, (self.heights.height() - 1) as f32);
        // A ray's last point over the grid may be rounded to just beside it.
        let beside = Vec2::splat(1e-3);
        if !(p.cmpge(-beside).all() && p.cmple(last + beside).all()) {
            return f32::NAN;
        }
        let p = p.clamp(Vec2::ZERO, last);
        let col = (p.x as usize).min(self.heights.width().saturating_sub(2));
        let row = (p.y as usize).min(self.heights.height().saturating_sub(2));
        let (fx, fy) = (p.x - col as f32, p.y - row as f32);
        let at = |c: usize, r: usize| self.heights[(c.min(self.heights.width() - 1), r.min(self.heights.height() - 1))];
        let south = at(col, row) + (at(col + 1, row) - at(col, row)) * fx;
        let north = at(col, row + 1) + (at(col + 1, row + 1) - at(col, row + 1)) * fx;
        south + (north - south) * fy
    }

    /// Walks the cells under the ray from where it sinks below the highest ground; blocks whose highest node stays
    /// below the ray are skipped at once.
    fn meets(&self, ray: &Ray) -> Option<f32> {
        let extent = Vec2::new((self.heights.width() - 1) as f32, (self.heights.height() - 1) as f32);
        let origin = self.in_cells(ray.origin.truncate());
        let direction = ray.direction.truncate() / self.cell;
        if direction.abs().max_element() < 1e-6 * ray.direction.z.abs() {
            let t = (self.height_at(ray.origin.truncate()) - ray.origin.z) / ray.direction.z;
            return (t > 0.0).then_some(t); // false for NaN, where no ground is known
        }
        let walk = Walk { ray, origin, direction, inverse: direction.recip() };
        // The stretch of the ray over the grid.
        let (a, b) = (-origin * walk.inverse, (extent - origin) * walk.inverse);
        let enter = a.min(b).max_element().max((self.top - ray.origin.z) / ray.direction.z).max(0.0);
        let leave = a.max(b).min_element();
        if enter <= leave && self.clearance(ray, enter) <= 0.0 && enter > 0.0 {
            return Some(enter);
        }
        self.meets_within(&walk, 0, enter, leave)
    }

    /// The same between two distances, looking at blocks of this size and then at smaller ones.
    fn meets_within(&self, walk: &Walk<'_>, size_idx: usize, from: f32, until: f32) -> Option<f32> {
        let mut t = from;
        while t < until {
            let Some(size) = BLOCK_SIZES.get(size_idx) else {
                let next = walk.exit(t, 1.0).min(until);
                if self.clearance(walk.ray, next) <= 0.0 {
                    return Some(self.meets_in_cell(walk, t, next));
                }
                t = next;
                continue;
            };
            let next = walk.exit(t, *size as f32).min(until);
            if walk.ray.at(next).z <= self.block_top(size_idx, walk.between(t, next)) {
                let met = self.meets_within(walk, size_idx + 1, t, next);
                if met.is_some() {
                    return met;
                }
            }
            t = next;
        }
        None
    }

    /// Ray parameter at which a ray sinks below the ground in the cell that it crosses from `low` (above the ground) to `high`
    /// (not above). It is worked out of the cell and the ray alone, so that it is the same number whatever was cut out around
    /// the cell: heights that are kept to the millimetre would round another way for a last bit.
    fn meets_in_cell(&self, walk: &Walk<'_>, low: f32, high: f32) -> f32 {
        // Rounding may put it just outside.
        let beside = (1e-3 * walk.inverse.abs().min_element()).max(4.0 * f32::EPSILON * high);
        let clearance = self.clearance_in_cell(walk.ray, walk.between(low, high));
        let sinks = |t: &f64| 2.0 * clearance[0] * t + clearance[1] < 0.0;
        let around = f64::from(low) - f64::from(beside)..=f64::from(high) + f64::from(beside);
        let met = roots(clearance).into_iter().flatten().find(|t| around.contains(t) && sinks(t));
        met.map_or(high, |t| t as f32)
    }

    /// Height of a ray above the ground of the cell at a position in cells, as a polynomial of the ray parameter: quadratic,
    /// linear and constant term.
    fn clearance_in_cell(&self, ray: &Ray, in_cells: Vec2) -> [f64; 3] {
        let last = Vec2::new(self.heights.width() as f32 - 2.0, self.heights.height() as f32 - 2.0);
        let node = in_cells.floor().clamp(Vec2::ZERO, last.max(Vec2::ZERO));
        let (col, row) = (node.x as usize, node.y as usize);
        let at = |c: usize, r: usize| {
            f64::from(self.heights[(c.min(self.heights.width() - 1), r.min(self.heights.height() - 1))])
        };
        let south_west = at(col, row);
        let (east, north) = (at(col + 1, row) - south_west, at(col, row + 1) - south_west);
        let twist = at(col + 1, row + 1) - south_west - east - north;
        let cell = self.cell.as_dvec2();
        let corner = self.anchor.as_dvec2() + (self.first + node).as_dvec2() * cell;
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let from = (origin.truncate() - corner) / cell;
        let by = direction.truncate() / cell;
        [
            -twist * by.x * by.y,
            direction.z - east * by.x - north * by.y - twist * (from.x * by.y + from.y * by.x),
            origin.z - south_west - east * from.x - north * from.y - twist * from.x * from.y,
        ]
    }

    /// Height of a ray above the ground; `NaN` where no ground is known.
    fn clearance(&self, ray: &Ray, t: f32) -> f32 {
        let at = ray.at(t);
        at.z - self.height_at(at.truncate())
    }

    fn block_top(&self, size_idx: usize, in_cells: Vec2) -> f32 {
        let (tops, size) = (&self.block_tops[size_idx], BLOCK_SIZES[size_idx] as f32);
        let block = |p: f32, n: usize| ((p.max(0.0) / size) as usize).min(n - 1);
        tops[(block(in_cells.x, tops.width()), block(in_cells.y, tops.height()))]
    }
}

/// Highest node of each block of so many cells; −∞ where nothing is known.
fn highest_of_blocks(heights: &Raster<f32>, size: usize) -> Raster<f32> {
    let n_blocks = |n: usize| n.saturating_sub(1).div_ceil(size).max(1);
    let (width, height) = (heights.width(), heights.height());
    let mut tops = Raster::filled(n_blocks(width), n_blocks(height), f32::NEG_INFINITY);
    for row in 0..height {
        for col in 0..width {
            // A node on a block's border belongs to the cells, and so to the blocks, on both sides.
            let blocks = |i: usize, n: usize| [i.saturating_sub(1) / size, (i / size).min(n - 1)];
            for block_row in blocks(row, tops.height()) {
                for block_col in blocks(col, tops.width()) {
                    let top = &mut tops[(block_col, block_row)];
                    *top = top.max(heights[(col, row)]);
                }
            }
        }
    }
    tops
}

/// Roots of `[a, b, c] · (t², t, 1)`, ascending.
fn roots([a, b, c]: [f64; 3]) -> Option<[f64; 2]> {
    let root = (b * b - 4.0 * a * c).sqrt();
    let q = -0.5 * (b + root.copysign(b));
    let [one, other] = [c / q, q / a];
    (!root.is_nan()).then(|| [one.min(other), one.max(other)])
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use proptest::prelude::*;

    use super::*;
    use crate::terrain::Dem;

    fn hills() -> LocalGround {
        let (n, cell) = (90, 2.0);
        let z = |e: f64, n: f64| 5.0 * (e / 23.0).sin() + 4.0 * (n / 31.0).cos() + 0.02 * e;
        let heights: Vec<f32> = (0..n * n)
            .map(|i| z((f64::from(i % n) + 0.5) * cell, (f64::from(n - i / n) - 0.5) * cell) as f32)
            .collect();
        let dem = Dem::new(Raster::from_vec(n as usize, n as usize, heights).unwrap(), 0.0, 180.0, cell, cell).unwrap();
        let terrain = Terrain::Grid(dem);
        LocalGround::new(&terrain, LocalOrigin(DVec3::ZERO), DVec2::ZERO, DVec2::splat(180.0))
    }

    proptest! {
        #[test]
        fn a_walk_always_moves_on_however_far_away_its_ray_began(
            far_m in 1.0..60_000.0_f32, east in -1.0..1.0_f32, north in -1.0..1.0_f32, down in 0.05..1.0_f32, cell_m in 0.5..20.0_f32
        ) {
            prop_assume!(east.abs().max(north.abs()) > 0.01, "upright rays do not walk");
            let direction = Vec3::new(east, north, -down);
            let ray = Ray::new(-far_m * direction, direction);
            let (origin, in_cells) = (ray.origin.truncate() / cell_m, direction.truncate() / cell_m);
            let walk = Walk { ray: &ray, origin, direction: in_cells, inverse: in_cells.recip() };
            for size in [1.0, 8.0, 64.0] {
                let mut t = 0.9 * far_m;
                for _ in 0..50 {
                    let next = walk.exit(t, size);
                    prop_assert!(next > t, "{t} again, by squares of {size} cells");
                    t = next;
                }
            }
        }
    }

    #[test]
    fn a_ray_meets_the_same_ground_whatever_was_cut_out() {
        let (n, cell) = (90_u32, 2.0);
        let (west, north) = (565_000.0, 5_932_180.0);
        let heights: Vec<f32> =
            (0..n * n).map(|i| ((i % n) as f32 / 7.0).sin() * 4.0 + (i / n) as f32 * 0.05).collect();
        let dem =
            Dem::new(Raster::from_vec(n as usize, n as usize, heights).unwrap(), west, north, cell, cell).unwrap();
        let terrain = Terrain::Grid(dem);
        let origin = LocalOrigin(DVec3::new(565_093.0, 5_932_071.0, 3.0));
        let cut = |low: f64, high: f64| {
            let corner = DVec2::new(west, north - 180.0);
            LocalGround::new(&terrain, origin, corner + low, corner + high)
        };
        let (whole, part) = (cut(0.0, 180.0), cut(41.0, 139.0));
        let mut n_met = 0;
        for i in 0..400_u32 {
            let turn = i as f32 * 0.7;
            let eye = Vec3::new((i % 20) as f32 * 1.5 - 15.0, (i / 20) as f32 * 1.5 - 15.0, 45.0);
            let ray = Ray::new(eye, Vec3::new(0.3 * turn.cos(), 0.3 * turn.sin(), -1.0));
            if let Some(t) = part.meets(&ray) {
                assert_eq!(whole.meets(&ray), Some(t), "ray {i}");
                n_met += 1;
            }
        }
        assert!(n_met > 300, "{n_met}");
    }

    proptest! {
        /// Against marching in centimetres.
        #[test]
        fn a_ray_stops_where_fine_marching_stops(
            x in 20.0..160.0_f32, y in 20.0..160.0_f32,
            dx in -1.5..1.5_f32, dy in -1.5..1.5_f32,
        ) {
            let ground = hills();
            let ray = Ray::new(Vec3::new(x, y, 60.0), Vec3::new(dx, dy, -1.0));
            let marched = (4000..8000).map(|i| i as f32 * 0.01).find(|&t| ray.at(t).z <= ground.height_at(ray.at(t).truncate()));
            // Hits within 5 cm of the grid's border may fall to either side of it.
            let is_inside = |t: &f32| {
                let p = ray.at(*t).truncate();
                p.min_element() > 1.05 && p.max_element() < 178.95
            };
            match (ground.meets(&ray).filter(is_inside), marched.filter(is_inside)) {
                (Some(found), Some(marched)) => prop_assert!((found - marched).abs() < 0.05, "{found} {marched}"),
                (found, marched) => prop_assert!(found.or(marched).is_none_or(|t| !is_inside(&(t + 0.1)))),
            }
        }
    }

    #[test]
    fn a_vertical_ray_meets_the_height_below_it() {
        let ground = hills();
        let t = ground.meets(&Ray::new(Vec3::new(50.3, 71.7, 100.0), Vec3::new(0.0, 0.0, -1.0))).unwrap();
        assert!((100.0 - t - ground.height_at(Vec2::new(50.3, 71.7))).abs() < 1e-3);
    }

    #[test]
    fn upward_rays_and_rays_beside_the_grid_meet_nothing() {
        let ground = hills();
        assert_eq!(ground.meets(&Ray::new(Vec3::new(50.0, 50.0, 100.0), Vec3::Z)), None);
        assert_eq!(ground.meets(&Ray::new(Vec3::new(-50.0, 50.0, 10.0), Vec3::new(0.0, 0.0, -1.0))), None);
    }
}
