//! Rays against the ground: two triangles between every four cell centres of the DTM, walked cell by cell.
//!
//! A ray can meet the ground only between its lowest and its highest level, which is a few cells of the way: much
//! faster than a hierarchy over hundreds of thousands of triangles, and the same surface.
//! Source: Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987.

use glam::{DVec3, IVec2, UVec2, Vec2, Vec3};

use sizeup_geo::terrain::Terrain;
use sizeup_heights::raster::Raster;
use sizeup_heights::ray::Ray;

use super::scene::crossing;

/// Levels are searched this far beyond the lowest and highest cell, metres.
const SLACK_M: f32 = 0.01;
/// Constant ground reaches this far, metres.
const CONSTANT_REACH_M: f32 = 20_000.0;

/// The ground in the `Local` frame, `f32`, metres.
#[derive(Debug)]
pub(super) struct SimulatedGround {
    /// At grid nodes, row 0 northernmost; `NaN` = none.
    heights: Raster<f32>,
    /// The first node: west, north.
    corner: Vec2,
    cell: Vec2,
    low: f32,
    high: f32,
}

impl SimulatedGround {
    pub fn new(terrain: &Terrain, origin: DVec3) -> Self {
        match terrain {
            Terrain::Constant(z) => {
                let z = (z - origin.z) as f32;
                let corner = Vec2::new(-CONSTANT_REACH_M, CONSTANT_REACH_M);
                let cell = Vec2::splat(2.0 * CONSTANT_REACH_M);
                Self { heights: Raster::filled(2, 2, z), corner, cell, low: z, high: z }
            }
            Terrain::Grid(dem) => {
                let ((west, north), (cell_x, cell_y)) = (dem.corner_m(), dem.cell_m());
                let heights = dem.heights_m().map(|&z| (f64::from(z) - origin.z) as f32);
                let known = || heights.data().iter().copied().filter(|z| !z.is_nan());
                let (low, high) = (known().fold(f32::INFINITY, f32::min), known().fold(f32::NEG_INFINITY, f32::max));
                let first = DVec3::new(west + 0.5 * cell_x, north - 0.5 * cell_y, 0.0) - origin;
                let cell = Vec2::new(cell_x as f32, cell_y as f32);
                Self { heights, corner: first.truncate().as_vec2(), cell, low, high }
            }
        }
    }

    /// Ray parameter and upward normal where a ray first meets the ground before `t_max`.
    pub fn nearest(&self, ray: &Ray, t_max: f32) -> Option<(f32, Vec3)> {
        let n_cells = UVec2::new(self.heights.width() as u32, self.heights.height() as u32).as_ivec2() - 1;
        let (t_in, t_out) = self.clip(ray, n_cells, t_max)?;
        // Node coordinates: x eastwards, y southwards, one per cell.
        let flip = Vec2::new(1.0, -1.0);
        let start = (ray.at(t_in).truncate() - self.corner) * flip / self.cell;
        let way = ray.direction.truncate() * flip / self.cell;
        let mut at = start.floor().as_ivec2().clamp(IVec2::ZERO, n_cells - 1);
        let step = IVec2::new(if way.x < 0.0 { -1 } else { 1 }, if way.y < 0.0 { -1 } else { 1 });
        let border = (at + step.max(IVec2::ZERO)).as_vec2();
        // Where the ray leaves the cell, and how much longer each further cell takes; infinite along a zero.
        let mut next = Vec2::select(way.cmpeq(Vec2::ZERO), Vec2::INFINITY, t_in + (border - start) / way);
        let per_cell = (1.0 / way).abs();
        let mut enter = t_in;
        loop {
            let leave = next.min_element();
            if self.is_reached(ray, at, enter, leave.min(t_out))
                && let Some(hit) = self.cell_hit(ray, at, t_max)
            {
                return Some(hit);
            }
            enter = leave;
            if leave > t_out {
                return None;
            }
            if next.x <= next.y {
                at.x += step.x;
                next.x += per_cell.x;
            } else {
                at.y += step.y;
                next.y += per_cell.y;
            }
            if at.cmplt(IVec2::ZERO).any() || at.cmpge(n_cells).any() {
                return None;
            }
        }
    }

    /// The part of a ray over the grid and between the lowest and the highest ground.
    fn clip(&self, ray: &Ray, n_cells: IVec2, t_max: f32) -> Option<(f32, f32)> {
        let size = n_cells.as_vec2() * self.cell;
        let min = Vec3::new(self.corner.x, self.corner.y - size.y, self.low - SLACK_M);
        let max = Vec3::new(self.corner.x + size.x, self.corner.y, self.high + SLACK_M);
        let inverse = ray.direction.recip();
        let (a, b) = ((min - ray.origin) * inverse, (max - ray.origin) * inverse);
        let t_in = a.min(b).max_element().max(0.0);
        let t_out = a.max(b).min_element().min(t_max);
        (t_in <= t_out).then_some((t_in, t_out))
    }

    /// Whether a ray comes near the levels of a cell's corners while it is over the cell.
    fn is_reached(&self, ray: &Ray, at: IVec2, enter: f32, leave: f32) -> bool {
        let corner = |dx: i32, dy: i32| self.heights[((at.x + dx) as usize, (at.y + dy) as usize)];
        let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        let (z0, z1) = (ray.origin.z + enter * ray.direction.z, ray.origin.z + leave * ray.direction.z);
        let (lowest, highest) = (z0.min(z1) - SLACK_M, z0.max(z1) + SLACK_M);
        lowest <= a.max(b).max(c.max(d)) && highest >= a.min(b).min(c.min(d))
    }

    fn cell_hit(&self, ray: &Ray, at: IVec2, t_max: f32) -> Option<(f32, Vec3)> {
        let node = |dx: i32, dy: i32| {
            let (col, row) = ((at.x + dx) as usize, (at.y + dy) as usize);
            let plan = self.corner + Vec2::new(col as f32, -(row as f32)) * self.cell;
            plan.extend(self.heights[(col, row)])
        };
        let (nw, ne, sw, se) = (node(0, 0), node(1, 0), node(0, 1), node(1, 1));
        let hit = |a: Vec3, b: Vec3, c: Vec3| {
            let t = crossing(ray, &[a, b - a, c - a], t_max)?;
            Some((t, (b - a).cross(c - a).normalize()))
        };
        match (hit(sw, se, ne), hit(sw, ne, nw)) {
            (Some(a), Some(b)) => Some(if a.0 <= b.0 { a } else { b }),
            (a, b) => a.or(b),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_geo::terrain::Dem;

    fn waves() -> SimulatedGround {
        let z = |i: usize| (((i % 40) as f32) * 0.9).sin() * 4.0 + ((i / 40) as f32 * 0.7).cos() * 3.0;
        let heights = Raster::from_vec(40, 30, (0..1200).map(z).collect()).unwrap();
        SimulatedGround::new(
            &Terrain::Grid(Dem::new(heights, 100.0, 300.0, 5.0, 4.0).unwrap()),
            DVec3::new(200.0, 240.0, 0.0),
        )
    }

    #[test]
    fn walking_the_cells_finds_just_what_trying_all_of_them_finds() {
        let ground = waves();
        let mut rng = sizeup_heights::seed::stream(3, "test", &[]);
        let mut n_hits = 0;
        for _ in 0..3000 {
            let mut draw = |low: f64, high: f64| crate::simulate::chance::between(&mut rng, low, high) as f32;
            let origin = Vec3::new(draw(-140.0, 140.0), draw(-100.0, 100.0), draw(-9.0, 60.0));
            let ray = Ray::new(origin, Vec3::new(draw(-1.0, 1.0), draw(-1.0, 1.0), draw(-1.0, 0.2)));
            let all = (0..29).flat_map(|y| (0..39).map(move |x| IVec2::new(x, y)));
            let expected = all.filter_map(|at| ground.cell_hit(&ray, at, f32::MAX)).map(|h| h.0).reduce(f32::min);
            let found = ground.nearest(&ray, f32::MAX).map(|h| h.0);
            assert_eq!(found.is_some(), expected.is_some(), "{ray:?}");
            if let (Some(a), Some(b)) = (found, expected) {
                assert!((a - b).abs() <= 1e-3 * b.max(1.0), "{a} {b}");
                n_hits += 1;
            }
        }
        assert!(n_hits > 500, "{n_hits}");
    }
}
