//! Triangles of faces: for graphics cards, and such that keep solids closed.

use geo::TriangulateDelaunay as _;
use geo::triangulate_delaunay::DelaunayTriangulationConfig;
use geo_types::{Coord, LineString, Polygon, Triangle};
use glam::DVec3;

use super::grid::OutputGrid;
use super::planar::cross;
use super::prism::GridFace;
use sizeup_geo::triangles::{area_vector, triangulate};

/// Vector area of a face: as long as its area, m², and upright to it, outwards.
pub fn area_m2(face: &GridFace, grid: &OutputGrid) -> DVec3 {
    let first = face.rings[0][0];
    let metres =
        |p: &[i64; 3]| DVec3::from_array(std::array::from_fn(|axis| (p[axis] - first[axis]) as f64)) * grid.scale_m;
    let of_ring = |ring: &Vec<[i64; 3]>| area_vector(&ring.iter().map(metres).collect::<Vec<_>>()) / 2.0;
    face.rings.iter().map(of_ring).sum()
}

/// Triangles of a face of any direction, counter-clockwise seen from outside, as positions among all corners.
pub fn of_face(face: &GridFace) -> Vec<[usize; 3]> {
    let first = face.rings[0][0];
    let from_first = |p: &[i64; 3]| DVec3::from_array(std::array::from_fn(|axis| (p[axis] - first[axis]) as f64));
    let exterior: Vec<DVec3> = face.rings[0].iter().map(from_first).collect();
    let normal = area_vector(&exterior);
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

/// Triangles of a face, looking as it does, with no corners but its own; `None` where two corners coincide seen across the face.
pub fn keeping_corners(face: &GridFace) -> Option<Vec<GridFace>> {
    let first = face.rings[0][0];
    let from_first = |p: &[i64; 3]| DVec3::from_array(std::array::from_fn(|axis| (p[axis] - first[axis]) as f64));
    let normal = area_vector(&face.rings[0].iter().map(from_first).collect::<Vec<_>>());
    let dropped = normal.abs().max_position();
    let [x, y] = [(dropped + 1) % 3, (dropped + 2) % 3];
    let faces_away = normal[dropped] < 0.0;
    let plan = |p: &[i64; 3]| Coord { x: (p[x] - first[x]) as f64, y: (p[y] - first[y]) as f64 };
    let mut rings = face.rings.iter().map(|ring| ring.iter().map(plan).collect::<LineString<f64>>());
    let polygon = Polygon::new(rings.next()?, rings.collect());
    let corner = |at: Coord<f64>| {
        let mut found = face.rings.iter().flatten().filter(|p| plan(p) == at);
        found.next().filter(|_| found.next().is_none()).copied()
    };
    let of = |triangle: Triangle<f64>| {
        let mut ring: Vec<[i64; 3]> = triangle.to_array().into_iter().map(corner).collect::<Option<_>>()?;
        if (plan_area(&triangle) < 0.0) != faces_away {
            ring.reverse();
        }
        Some(GridFace { rings: vec![ring], ..*face })
    };
    let made = polygon.constrained_triangulation(DelaunayTriangulationConfig::default()).ok()?;
    made.into_iter().map(of).collect()
}

/// Twice the signed area of a triangle in the plan.
fn plan_area(triangle: &Triangle<f64>) -> f64 {
    let [a, b, c] = triangle.to_array();
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}
