//! Stacked prisms from slabs of a building's points, as `ProxyRecon` describes its proxies.
//!
//! ```text
//! slab i      all points with z ≥ z_max − (i + 1) · dz,   dz = (z_max − z_min) / n     (from the top down, cumulative)
//! main slab   the first; then each whose successor's hull has at least `growth` times its area; the last
//! prisms      hull of a main slab between its own level and that of the main slab above
//! ```
//!
//! Our own code after the published description. The lowest prism goes down to the ground.

use geo::{Area, ConvexHull};
use geo_types::{MultiPoint, Point, Polygon};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of the slabs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SlabConfig {
    /// Slabs per building, 2 or more.
    pub n_slabs: usize,
    /// A slab starts a new prism if the next one's hull is at least this many times as large.
    pub growth: f64,
}

impl Default for SlabConfig {
    fn default() -> Self {
        Self { n_slabs: 30, growth: 1.1 }
    }
}

/// One prism of the stack.
#[derive(Debug, Clone, PartialEq)]
pub struct Slab {
    /// Convex footprint, counter-clockwise.
    pub footprint: Polygon<f64>,
    /// Lower and upper level, metres.
    pub levels_m: [f64; 2],
}

/// The stack of a building, from the top down; empty for points without extent.
#[must_use]
pub fn stacked_prisms(points: &[DVec3], ground_m: f64, config: &SlabConfig) -> Vec<Slab> {
    let z = || points.iter().map(|p| p.z);
    let (low, high) = (z().fold(f64::INFINITY, f64::min), z().fold(f64::NEG_INFINITY, f64::max));
    let n = config.n_slabs.max(2);
    if points.len() < 3 || high <= low {
        return Vec::new();
    }
    let step = (high - low) / n as f64;
    let hull = |i: usize| {
        // The last slab holds every point, whatever the rounding.
        let level = if i + 1 == n { low } else { high - (i + 1) as f64 * step };
        let above: MultiPoint<f64> = points.iter().filter(|p| p.z >= level).map(|p| Point::new(p.x, p.y)).collect();
        (above.convex_hull(), level)
    };
    let hulls: Vec<(Polygon<f64>, f64)> = (0..n).map(hull).collect();
    let areas: Vec<f64> = hulls.iter().map(|(footprint, _)| footprint.unsigned_area()).collect();
    let grows = |i: &usize| areas[i + 1] >= config.growth * areas[*i];
    let mut mains: Vec<usize> = (0..n - 1).filter(grows).collect();
    mains.push(n - 1);
    let mut top = high;
    let mut slabs = Vec::new();
    for main in mains {
        let bottom = if main == n - 1 { ground_m.min(low) } else { hulls[main].1 };
        // The first points of a roof may not span an area.
        if areas[main] > 0.0 && top > bottom {
            slabs.push(Slab { footprint: hulls[main].0.clone(), levels_m: [bottom, top] });
            top = bottom;
        }
    }
    slabs
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on the roofs of a podium of 20 × 20 × 6 m with a tower of 8 × 8 m up to 30 m on it.
    fn podium_and_tower() -> Vec<DVec3> {
        let grid = |w: f64, z: f64| {
            (0..441).map(move |i| DVec3::new(f64::from(i % 21) * w / 20.0, f64::from(i / 21) * w / 20.0, z))
        };
        let wall = (0..=24).flat_map(|i| {
            [[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]].map(|[x, y]| DVec3::new(x, y, 6.0 + f64::from(i)))
        });
        grid(20.0, 6.0).chain(grid(8.0, 30.0)).chain(wall).collect()
    }

    #[test]
    fn a_tower_on_a_podium_is_two_prisms() {
        let slabs = stacked_prisms(&podium_and_tower(), 0.0, &SlabConfig::default());
        assert_eq!(slabs.len(), 2, "{slabs:?}");
        assert!((slabs[0].footprint.unsigned_area() - 64.0).abs() < 1e-9 && slabs[0].levels_m[1] == 30.0);
        assert!((slabs[1].footprint.unsigned_area() - 400.0).abs() < 1e-9);
        assert_eq!(slabs[1].levels_m[0], 0.0);
        // The podium's roof is found to one slab of 24 m / 30.
        assert!((slabs[1].levels_m[1] - 6.0).abs() < 0.81, "{slabs:?}");
    }

    #[test]
    fn points_on_a_level_make_no_prism() {
        assert!(stacked_prisms(&[DVec3::ZERO, DVec3::X, DVec3::Y], 0.0, &SlabConfig::default()).is_empty());
    }
}
