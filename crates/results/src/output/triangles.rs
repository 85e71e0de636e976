//! Triangles of faces, for graphics cards.

use glam::DVec3;

use super::planar::cross;
use super::prism::GridFace;
use sizeup_geo::triangles::triangulate;

/// Twice the area of a ring as a vector: where it looks.
pub fn newell(ring: &[DVec3]) -> DVec3 {
    let from = ring[0];
    ring.windows(2).map(|edge| (edge[0] - from).cross(edge[1] - from)).sum()
}

/// Triangles of a face of any direction, counter-clockwise seen from outside, as positions among all corners.
pub fn of_face(face: &GridFace) -> Vec<[usize; 3]> {
    let first = face.rings[0][0];
    let from_first = |p: &[i64; 3]| DVec3::from_array(std::array::from_fn(|axis| (p[axis] - first[axis]) as f64));
    let exterior: Vec<DVec3> = face.rings[0].iter().map(from_first).collect();
    let normal = newell(&exterior);
    // Seen along the axis that it looks along most, from outside.
    let (x, y) = match normal.abs().max_position() {
        0 if normal.x > 0.0 => (1, 2),
        0 => (2, 1),
        1 if normal.y > 0.0 => (2, 0),
        1 => (0, 2),
        _ if normal.z > 0.0 => (0, 1),
        _ => (1, 0),
    };
    let along = |ring: &Vec<[i64; 3]>| ring.iter().map(|p| [p[x], p[y]]).collect();
    let rings: Vec<Vec<[i64; 2]>> = face.rings.iter().map(along).collect();
    of_rings(&rings)
}

/// Triangles of a footprint, counter-clockwise seen from above, as positions among all corners.
pub fn of_rings(rings: &[Vec<[i64; 2]>]) -> Vec<[usize; 3]> {
    let corners = rings.concat();
    // From the first corner, so that no precision is lost far from the origin.
    let [x0, y0] = corners[0];
    let from_first = |&[x, y]: &[i64; 2]| [(x - x0) as f64, (y - y0) as f64];
    let triangles = triangulate(rings.iter().map(|ring| ring.iter().map(from_first)));
    let counter_clockwise = |[a, b, c]: [usize; 3]| {
        if cross(corners[a], corners[b], corners[c]) < 0 { [a, c, b] } else { [a, b, c] }
    };
    triangles.into_iter().map(counter_clockwise).collect()
}
