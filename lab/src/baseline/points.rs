//! Heights from a point cloud, as tools for laser scans do it: a percentile of the points inside a footprint.

use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use glam::DVec3;

use super::without_views;
use sizeup_geo::cloud::points_in;
use sizeup_heights::optimise::{Problem, Solution};
use sizeup_heights::scene::{Prism, Scene};
use sizeup_heights::stats;

/// A cloud cut by a scene's footprints.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentedCloud {
    /// Points of each building, map frame, metres, in the scene's order.
    pub points: Vec<Vec<DVec3>>,
    /// Ground level of each building, map frame, metres.
    pub ground_m: Vec<f64>,
}

impl SegmentedCloud {
    /// Cuts map-frame points by a scene's footprints; points within `inset_m` of a footprint are left out.
    #[must_use]
    pub fn new(scene: &Scene, points: &[DVec3], inset_m: f64) -> Self {
        let footprints: Vec<MultiPolygon<f64>> =
            scene.prisms.iter().map(|prism| footprint(prism, scene.origin.0)).collect();
        let ground = |prism: &Prism| f64::from(prism.ground_z) + scene.origin.0.z;
        Self { points: points_in(points, &footprints, inset_m), ground_m: scene.prisms.iter().map(ground).collect() }
    }
}

/// A prism's footprint in the map frame.
fn footprint(prism: &Prism, origin: DVec3) -> MultiPolygon<f64> {
    let ring = |ring: &[glam::Vec2]| {
        ring.iter()
            .map(|c| Coord { x: f64::from(c.x) + origin.x, y: f64::from(c.y) + origin.y })
            .collect::<LineString<f64>>()
    };
    let mut rings = prism.rings().map(ring);
    let exterior = rings.next().unwrap_or_else(|| LineString::new(Vec::new()));
    MultiPolygon::new(vec![Polygon::new(exterior, rings.collect())])
}

/// Height of each building: a percentile (0 to 100) of its points' levels minus its ground; none below `min_points`.
#[must_use]
pub fn percentile(problem: &Problem<'_>, cloud: &SegmentedCloud, percent: f64, min_points: usize) -> Solution {
    let bounds = problem.scene.bounds;
    let height = |(points, ground_m): (&Vec<DVec3>, &f64)| {
        let z: Vec<f64> = points.iter().map(|p| p.z).collect();
        let roof_m = stats::quantile(&z, percent / 100.0).filter(|_| z.len() >= min_points)?;
        Some((roof_m - ground_m).clamp(f64::from(bounds.min_m), f64::from(bounds.max_m)))
    };
    without_views(cloud.points.iter().zip(&cloud.ground_m).map(height).collect(), None)
}
