//! Triangles of a plane polygon, by ear clipping, and where it looks.

use glam::DVec3;

/// Area vector of a ring in space (Newell's method): twice its area long, counter-clockwise towards its tip.
#[must_use]
pub fn area_vector(ring: &[DVec3]) -> DVec3 {
    let Some(&origin) = ring.first() else { return DVec3::ZERO };
    ring.windows(2).map(|edge| (edge[0] - origin).cross(edge[1] - origin)).sum()
}

/// Returns the triangles of a polygon, as positions among the corners of all rings: the exterior first, then its holes, each open. They may
/// turn either way. A polygon without area has none.
#[must_use]
pub fn triangulate<R: IntoIterator<Item = [f64; 2]>>(rings: impl IntoIterator<Item = R>) -> Vec<[usize; 3]> {
    let (mut corners, mut starts): (Vec<[f64; 2]>, Vec<usize>) = (Vec::new(), Vec::new());
    for ring in rings {
        starts.push(corners.len());
        corners.extend(ring);
    }
    let holes = starts.get(1..).unwrap_or_default();
    let triangles = earcutr::earcut(corners.as_flattened(), holes, 2).unwrap_or_default();
    triangles.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_with_a_hole_is_covered_once() {
        let square = |low: f64, high: f64| vec![[low, low], [high, low], [high, high], [low, high]];
        let rings = [square(0.0, 4.0), square(1.0, 3.0)];
        let corners = rings.concat();
        let area = |[a, b, c]: [usize; 3]| {
            let [a, b, c] = [corners[a], corners[b], corners[c]];
            (0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))).abs()
        };
        let triangles = triangulate(rings.iter().cloned());
        assert_eq!(triangles.len(), 8);
        assert_eq!(triangles.into_iter().map(area).sum::<f64>(), 12.0);
        assert!(triangulate(Vec::<Vec<[f64; 2]>>::new()).is_empty());
    }
}
