//! Surfaces: how far the result's walls and roofs are from the reference's, and how much of those it covers.
//!
//! Both surfaces are sampled uniformly by area with the same density; each sample's distance to the *other surface* is
//! exact (nearest point of the nearest triangle), so a perfect result has distance 0 whatever the density. Ground faces
//! are left out: no camera sees them.

use std::collections::BTreeMap;

use glam::DVec3;
use rand::Rng as _;
use rayon::prelude::*;
use rstar::{AABB, PointDistance, RTree, RTreeObject};
use serde::{Deserialize, Serialize};

use super::solid::Facet;
use sizeup_heights::seed;
use sizeup_heights::stats;

/// Meaning of each number.
pub const SURFACE_DEFINITIONS: [(&str, &str); 5] = [
    (
        "error_90_m",
        "90th percentile of the distances from samples of the result's walls and roofs to the reference's surface",
    ),
    ("error_95_m", "95th percentile of the same"),
    ("completeness_05", "share of samples of the reference's walls and roofs within 0.5 m of the result's surface"),
    ("completeness_1", "share of the same within 1 m"),
    ("density_per_m2", "samples per m2 on either side, uniform by area, seeded; ground faces are left out"),
];

/// Samples per m² wished for.
const DENSITY_PER_M2: f64 = 25.0;
/// Most samples of a side: a large scene is sampled thinner.
const MOST_SAMPLES: f64 = 400_000.0;

/// Distances between the surfaces of result and reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SurfaceEvaluation {
    /// Distance that 90 % of the result's samples stay within, metres.
    pub error_90_m: f64,
    /// Distance that 95 % of the result's samples stay within, metres.
    pub error_95_m: f64,
    /// Share within 0.5 m.
    pub completeness_05: f64,
    /// Share within 1 m.
    pub completeness_1: f64,
    /// Mean distance from the result to the reference, metres.
    pub error_mean_m: f64,
    /// Samples per m² of either surface.
    pub density_per_m2: f64,
    /// Samples of result and reference.
    pub n_samples: [usize; 2],
    /// Meaning of each number.
    pub definitions: BTreeMap<String, String>,
}

/// A surface as it is measured to.
pub enum TargetSurface<'a> {
    /// The triangles themselves, searched for the nearest.
    Facets(&'a [Facet]),
    /// Points: distances are to the nearest, so they do not fall below half the points' spacing.
    Points(&'a [DVec3]),
}

/// A triangle in the search tree.
#[derive(Debug, Clone, Copy)]
struct SearchTriangle([DVec3; 3]);

impl RTreeObject for SearchTriangle {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        let [a, b, c] = self.0;
        AABB::from_corners(a.min(b).min(c).to_array(), a.max(b).max(c).to_array())
    }
}

impl PointDistance for SearchTriangle {
    fn distance_2(&self, point: &[f64; 3]) -> f64 {
        let p = DVec3::from_array(*point);
        (p - nearest_on_triangle(p, self.0)).length_squared()
    }
}

/// The point of a triangle nearest to `p` (Ericson, Real-Time Collision Detection, 2005, section 5.1.5: by the region of
/// the plane that `p` projects to).
#[must_use]
pub fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 && (d4 - d3) + (d5 - d6) > 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    if sum == 0.0 {
        return a; // a triangle without area, whose edges were looked at above
    }
    a + ab * (vb / sum) + ac * (vc / sum)
}

/// Compares the surface of a result with a reference's; `None` if either has no surface.
#[must_use]
pub fn evaluate_surface(result: &[Facet], reference: &TargetSurface<'_>, root_seed: u64) -> Option<SurfaceEvaluation> {
    let seen = |facets: &[Facet]| facets.iter().filter(|f| !f.is_bottom).copied().collect::<Vec<_>>();
    let area = |facets: &[Facet]| facets.iter().map(Facet::area_m2).sum::<f64>();
    let result = seen(result);
    let reference_facets = match reference {
        TargetSurface::Facets(facets) => seen(facets),
        TargetSurface::Points(_) => Vec::new(),
    };
    let density = DENSITY_PER_M2.min(MOST_SAMPLES / area(&result).max(area(&reference_facets)).max(1.0));
    let from_result = samples(&result, density, root_seed);
    let from_reference = match reference {
        TargetSurface::Facets(_) => samples(&reference_facets, density, root_seed ^ 1),
        TargetSurface::Points(points) => points.to_vec(),
    };
    if from_result.is_empty() || from_reference.is_empty() {
        return None;
    }
    let to_result = to_facets(&from_reference, &result);
    let to_reference = match reference {
        TargetSurface::Facets(_) => to_facets(&from_result, &reference_facets),
        TargetSurface::Points(points) => {
            let tree = RTree::bulk_load(points.iter().map(DVec3::to_array).collect());
            let nearest = |p: &DVec3| {
                tree.nearest_neighbor(&p.to_array()).map_or(f64::NAN, |q| p.distance(DVec3::from_array(*q)))
            };
            from_result.par_iter().map(nearest).collect()
        }
    };
    let within = |limit: f64| to_result.iter().filter(|d| **d <= limit).count() as f64 / to_result.len() as f64;
    Some(SurfaceEvaluation {
        error_90_m: stats::quantile(&to_reference, 0.9)?,
        error_95_m: stats::quantile(&to_reference, 0.95)?,
        completeness_05: within(0.5),
        completeness_1: within(1.0),
        error_mean_m: stats::mean(&to_reference)?,
        density_per_m2: density,
        n_samples: [from_result.len(), from_reference.len()],
        definitions: SURFACE_DEFINITIONS.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect(),
    })
}

fn to_facets(points: &[DVec3], facets: &[Facet]) -> Vec<f64> {
    let tree = RTree::bulk_load(facets.iter().map(|f| SearchTriangle(f.corners)).collect());
    let nearest = |p: &DVec3| {
        let p = p.to_array();
        tree.nearest_neighbor(&p).map_or(f64::NAN, |t| t.distance_2(&p).sqrt())
    };
    points.par_iter().map(nearest).collect()
}

/// Uniform by area: each triangle has its area times the density, the fraction by chance.
fn samples(facets: &[Facet], density: f64, root_seed: u64) -> Vec<DVec3> {
    let mut points = Vec::new();
    for (i, facet) in facets.iter().enumerate() {
        let mut rng = seed::stream(root_seed, "surface samples", &[i as u64]);
        let n = (facet.area_m2() * density + rng.random::<f64>()).floor() as usize;
        let [a, b, c] = facet.corners;
        points.extend((0..n).map(|_| {
            let (u, v): (f64, f64) = (rng.random(), rng.random());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            a + (b - a) * u + (c - a) * v
        }));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::solid::tests::block;

    #[test]
    fn a_surface_is_at_no_distance_from_itself() {
        let town = block("a", [0.0; 3], [10.0, 8.0, 12.0]);
        let s = evaluate_surface(&town.facets, &TargetSurface::Facets(&town.facets), 1).unwrap();
        assert!(s.error_95_m < 1e-9 && s.completeness_05 == 1.0 && s.density_per_m2 == 25.0, "{s:?}");
    }

    #[test]
    fn a_roof_that_is_two_metres_too_high() {
        // Result: a box of 12 m, reference: 10 m, both 10 × 10 m. Of the result's 100 m² of roof all is 2 m off; of its
        // 480 m² of walls the top 2 m (80 m²) is off by up to 2 m. So 180 of 580 m² are off: percentile 90 lies on the
        // roof. Of the reference's 500 m² the roof is 2 m off except where it is nearer to the walls beside it.
        let (result, reference) = (block("a", [0.0; 3], [10.0, 10.0, 12.0]), block("a", [0.0; 3], [10.0, 10.0, 10.0]));
        let s = evaluate_surface(&result.facets, &TargetSurface::Facets(&reference.facets), 1).unwrap();
        assert!((s.error_90_m - 2.0).abs() < 1e-9 && (s.error_95_m - 2.0).abs() < 1e-9, "{s:?}");
        // The result's walls pass by the reference's roof: within 0.5 m of them 1 − 0.81 of the roof is covered, within
        // 1 m 1 − 0.64.
        assert!((s.completeness_05 - (400.0 + 19.0) / 500.0).abs() < 0.005, "{s:?}");
        assert!((s.completeness_1 - (400.0 + 36.0) / 500.0).abs() < 0.005, "{s:?}");
        assert!((s.error_mean_m - (100.0 * 2.0 + 80.0 * 1.0) / 580.0).abs() < 0.01, "{s:?}");
    }

    #[test]
    fn nearest_points_lie_on_faces_edges_and_corners() {
        let t = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0];
        let near = |x, y, z| nearest_on_triangle(DVec3::new(x, y, z), t).to_array();
        assert_eq!(near(1.0, 1.0, 5.0), [1.0, 1.0, 0.0]);
        assert_eq!(near(1.0, -3.0, 2.0), [1.0, 0.0, 0.0]);
        assert_eq!(near(-1.0, -1.0, 0.0), [0.0; 3]);
        assert_eq!(near(4.0, 4.0, 1.0), [2.0, 2.0, 0.0]);
        assert_eq!(near(9.0, -1.0, 0.0), [4.0, 0.0, 0.0]);
    }

    #[test]
    fn a_dense_cloud_stands_for_the_surface() {
        let a = block("a", [0.0; 3], [10.0, 8.0, 12.0]);
        let seen: Vec<Facet> = a.facets.iter().filter(|f| !f.is_bottom).copied().collect();
        let points = samples(&seen, 100.0, 7);
        let s = evaluate_surface(&a.facets, &TargetSurface::Points(&points), 1).unwrap();
        assert!(s.error_95_m < 0.15 && s.completeness_05 == 1.0, "{s:?}");
    }
}
