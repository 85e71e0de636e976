//! The convex hull of points in space.
//!
//! Incremental (Clarkson and Shor): from a tetrahedron on, each point outside replaces the faces it sees by a fan over
//! their horizon. Expected `n log n` faces for points in random order; each point looks at all faces, which is quick
//! enough for the few thousand points of a building.

use std::collections::BTreeSet;

use glam::DVec3;

/// Points nearer than this to a face are on it, as a share of the points' extent.
const ON_FACE: f64 = 1e-9;

/// Why points have no hull with a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum HullError {
    /// Fewer than four points, or all in one plane.
    #[error("{n_points} points span no volume")]
    Flat {
        /// Number of points given.
        n_points: usize,
    },
}

#[derive(Debug, Clone, Copy)]
struct HullFace {
    corners: [usize; 3],
    normal: DVec3,
    offset: f64,
}

/// Triangles of the hull, counter-clockwise seen from outside.
///
/// # Errors
/// [`HullError::Flat`].
pub fn convex_hull(points: &[DVec3]) -> Result<Vec<[DVec3; 3]>, HullError> {
    let flat = HullError::Flat { n_points: points.len() };
    let start = tetrahedron(points).ok_or(flat)?;
    let extent = points.iter().map(|p| p.distance(points[start[0]])).fold(0.0, f64::max);
    let on_face = ON_FACE * extent;
    let inside = start.iter().map(|&i| points[i]).sum::<DVec3>() / 4.0;
    let face = |corners: [usize; 3]| {
        let [a, b, c] = corners.map(|i| points[i]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        if normal.dot(inside - a) > 0.0 {
            HullFace { corners: [corners[0], corners[2], corners[1]], normal: -normal, offset: -normal.dot(a) }
        } else {
            HullFace { corners, normal, offset: normal.dot(a) }
        }
    };
    let [a, b, c, d] = start;
    let mut faces: Vec<HullFace> = [[a, b, c], [a, b, d], [a, c, d], [b, c, d]].map(face).to_vec();
    for (i, p) in points.iter().enumerate() {
        let sees = |f: &HullFace| f.normal.dot(*p) - f.offset > on_face;
        if !faces.iter().any(sees) {
            continue;
        }
        let (seen, kept): (Vec<HullFace>, Vec<HullFace>) = faces.into_iter().partition(sees);
        let edges_of = |f: &HullFace| [0, 1, 2].map(|k| (f.corners[k], f.corners[(k + 1) % 3]));
        let edges: BTreeSet<(usize, usize)> = seen.iter().flat_map(edges_of).collect();
        // The horizon: edges of seen faces whose other side is not seen.
        let horizon = edges.iter().filter(|(from, to)| !edges.contains(&(*to, *from)));
        faces = kept;
        faces.extend(horizon.map(|&(from, to)| face([from, to, i])).filter(|f| f.normal != DVec3::ZERO));
    }
    Ok(faces.iter().map(|f| f.corners.map(|i| points[i])).collect())
}

/// Four points that span a volume: far apart, so that the first faces are sound.
fn tetrahedron(points: &[DVec3]) -> Option<[usize; 4]> {
    let farthest = |distance: &dyn Fn(DVec3) -> f64| {
        let best = (0..points.len()).max_by(|&a, &b| distance(points[a]).total_cmp(&distance(points[b])))?;
        (distance(points[best]) > 0.0).then_some(best)
    };
    let a = 0;
    let origin = *points.first()?;
    let b = farthest(&|p| p.distance(origin))?;
    let along = (points[b] - origin).normalize_or_zero();
    let extent = points[b].distance(origin);
    let c = farthest(&|p| (p - origin).reject_from(along).length())?;
    let normal = along.cross(points[c] - origin).normalize_or_zero();
    let d = farthest(&|p| (p - origin).dot(normal).abs())?;
    ((points[d] - origin).dot(normal).abs() > ON_FACE * extent).then_some([a, b, c, d])
}

#[cfg(test)]
mod tests {
    use rand::Rng as _;

    use super::*;

    fn volume(triangles: &[[DVec3; 3]]) -> f64 {
        let o = triangles[0][0];
        triangles.iter().map(|[a, b, c]| (*a - o).dot((*b - o).cross(*c - o)) / 6.0).sum()
    }

    #[test]
    fn a_box_full_of_points_has_the_boxs_hull() {
        let mut rng = sizeup_heights::seed::stream(1, "hull test", &[]);
        let mut points: Vec<DVec3> =
            (0..8).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * 10.0).collect();
        points.extend((0..500).map(|_| DVec3::new(rng.random(), rng.random(), rng.random()) * 10.0));
        // On faces and edges too.
        points.extend([DVec3::new(5.0, 5.0, 10.0), DVec3::new(0.0, 5.0, 0.0), DVec3::new(10.0, 3.0, 4.0)]);
        let hull = convex_hull(&points).unwrap();
        assert!((volume(&hull) - 1000.0).abs() < 1e-6, "{}", volume(&hull));
    }

    #[test]
    fn every_point_lies_inside_the_hull_of_a_ball() {
        let mut rng = sizeup_heights::seed::stream(2, "hull test", &[]);
        let mut normal = || -> f64 { (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0 };
        let points: Vec<DVec3> = (0..400).map(|_| DVec3::new(normal(), normal(), normal())).collect();
        let hull = convex_hull(&points).unwrap();
        for [a, b, c] in &hull {
            let n = (*b - *a).cross(*c - *a).normalize();
            assert!(points.iter().all(|p| (*p - *a).dot(n) < 1e-6));
        }
        // Closed: Euler's formula for triangles.
        let corners: BTreeSet<_> = hull.iter().flatten().map(|p| p.to_array().map(f64::to_bits)).collect();
        assert_eq!(hull.len(), 2 * corners.len() - 4);
    }

    #[test]
    fn points_in_a_plane_have_no_hull() {
        let flat: Vec<DVec3> = (0..20).map(|i| DVec3::new(f64::from(i % 5), f64::from(i / 5), 3.0)).collect();
        assert_eq!(convex_hull(&flat), Err(HullError::Flat { n_points: 20 }));
        assert!(convex_hull(&[]).is_err());
    }
}
