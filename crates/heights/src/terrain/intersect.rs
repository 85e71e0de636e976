//! Where a ray meets the ground.
//!
//! The ray is followed in steps of half a cell from where it sinks below the highest ground, until it is below the ground
//! under it; bisection then finds the place to a tenth of a millimetre. Frame: map, metres.

use glam::DVec3;

use super::Terrain;

/// Steps per cell while looking for the crossing: ground between two samples is no lower than a bilinear patch.
const STEPS_PER_CELL: f64 = 2.0;
/// Halvings of a step: 2⁻⁴⁰ of any step is nothing.
const MAX_BISECTIONS: usize = 40;
/// Distance at which the search ends, metres.
const EXACT_M: f64 = 1e-4;
/// Longest search, in steps: a ray over flat country that never sinks.
const MAX_STEPS: usize = 100_000;

impl Terrain {
    /// The first point of `origin + t · direction`, `t > 0`, on the ground; `None` for rays that do not come down onto
    /// it, and where the terrain has no value on the way.
    #[must_use]
    pub fn meets(&self, origin: DVec3, direction: DVec3) -> Option<DVec3> {
        if direction.z >= 0.0 || !origin.is_finite() || !direction.is_finite() {
            return None;
        }
        let at_level = |z: f64| origin + (z - origin.z) / direction.z * direction;
        let (low, high, cell_m) = match self {
            Self::Constant(z) => return (origin.z > *z).then(|| at_level(*z)),
            Self::Grid(dem) => {
                let (x, y) = dem.cell_m();
                let (low, high) = dem.range();
                (low, high, x.min(y))
            }
        };
        if origin.z <= low {
            return None;
        }
        let above = |p: DVec3| Some(p.z - self.height_at(p.x, p.y)?);
        let start = if origin.z > high { at_level(high) } else { origin };
        let end = at_level(low);
        let across_m = (end - start).truncate().length();
        let n = ((across_m * STEPS_PER_CELL / cell_m).ceil() as usize).clamp(1, MAX_STEPS);
        let mut upper = start;
        // A ray may come in over the border of the terrain: it counts from where there is any.
        let mut is_over = above(upper).is_some_and(|a| a >= 0.0);
        for i in 1..=n {
            let lower = start + (end - start) * (i as f64 / n as f64);
            match above(lower) {
                Some(a) if a <= 0.0 => return is_over.then(|| self.between(upper, lower)),
                Some(_) => is_over = true,
                None => is_over = false,
            }
            upper = lower;
        }
        // The lowest ground itself, up to rounding.
        is_over.then(|| self.between(upper, upper))
    }

    /// The crossing between a point above the ground and one below it.
    fn between(&self, mut upper: DVec3, mut lower: DVec3) -> DVec3 {
        for _ in 0..MAX_BISECTIONS {
            if (upper - lower).length() < EXACT_M {
                break;
            }
            let middle = 0.5 * (upper + lower);
            let is_above = self.height_at(middle.x, middle.y).is_none_or(|z| middle.z > z);
            if is_above {
                upper = middle;
            } else {
                lower = middle;
            }
        }
        0.5 * (upper + lower)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::raster::Raster;
    use crate::terrain::Dem;

    fn hills() -> Terrain {
        let height =
            |col: usize, row: usize| (10.0 * ((col as f64) / 9.0).sin() + 6.0 * ((row as f64) / 7.0).cos()) as f32;
        let heights = (0..100).flat_map(|row| (0..100).map(move |col| height(col, row))).collect();
        Terrain::Grid(Dem::new(Raster::from_vec(100, 100, heights).unwrap(), 0.0, 200.0, 2.0, 2.0).unwrap())
    }

    proptest! {
        #[test]
        fn the_place_is_on_the_ray_and_on_the_ground_and_nothing_is_in_between(
            x in 60.0..140.0_f64, y in 60.0..140.0_f64, dx in -1.0..1.0_f64, dy in -1.0..1.0_f64
        ) {
            let terrain = hills();
            let (origin, direction) = (DVec3::new(x, y, 60.0), DVec3::new(dx, dy, -1.0));
            let Some(place) = terrain.meets(origin, direction) else {
                // Only a ray that leaves the terrain meets nothing.
                let far = origin + 80.0 * direction;
                prop_assert!(far.x < 1.0 || far.y < 1.0 || far.x > 199.0 || far.y > 199.0);
                return Ok(());
            };
            let t = origin.z - place.z;
            prop_assert!((origin + t * direction - place).length() < 1e-6);
            prop_assert!((terrain.height_at(place.x, place.y).unwrap() - place.z).abs() < 1e-3);
            for i in 0..200 {
                let p = origin + t * (f64::from(i) / 200.0) * direction;
                // A ray may graze a bilinear patch between two samples by less than this.
                prop_assert!(terrain.height_at(p.x, p.y).is_none_or(|z| p.z > z - 0.05), "{i}");
            }
        }
    }

    #[test]
    fn rays_up_beside_and_below_the_terrain_meet_nothing() {
        let terrain = hills();
        assert_eq!(terrain.meets(DVec3::new(100.0, 100.0, 50.0), DVec3::new(0.0, 0.0, 1.0)), None);
        assert_eq!(terrain.meets(DVec3::new(500.0, 100.0, 50.0), DVec3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(terrain.meets(DVec3::new(100.0, 100.0, -50.0), DVec3::new(0.0, 0.0, -1.0)), None);
        let flat = Terrain::Constant(3.0);
        let place = flat.meets(DVec3::new(0.0, 0.0, 13.0), DVec3::new(0.5, 0.0, -1.0)).unwrap();
        assert_eq!(place, DVec3::new(5.0, 0.0, 3.0));
    }
}
