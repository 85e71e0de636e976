//! Planar polygons in space to triangles: ears are clipped in the coordinate plane that the polygon faces most.

use glam::DVec3;

use sizeup_geo::triangles;

/// Area vector of a ring (Newell's method): twice its area long, counter-clockwise towards its tip.
#[must_use]
pub fn normal(ring: &[DVec3]) -> DVec3 {
    let Some(&origin) = ring.first() else { return DVec3::ZERO };
    ring.windows(2).map(|edge| (edge[0] - origin).cross(edge[1] - origin)).sum()
}

/// Triangles of an exterior ring and its holes (rings not closed), in the exterior's sense. A ring without area has
/// none.
#[must_use]
pub fn triangulate(rings: &[Vec<DVec3>]) -> Vec<[DVec3; 3]> {
    let Some(exterior) = rings.first() else { return Vec::new() };
    let facing = normal(exterior);
    let a = facing.abs();
    if a.max_element() == 0.0 {
        return Vec::new();
    }
    let origin = exterior[0];
    let flat = |p: DVec3| {
        let p = p - origin;
        if a.z >= a.x && a.z >= a.y {
            [p.x, p.y]
        } else if a.x >= a.y {
            [p.y, p.z]
        } else {
            [p.z, p.x]
        }
    };
    let points: Vec<DVec3> = rings.iter().flatten().copied().collect();
    let triangles = triangles::triangulate(rings.iter().map(|ring| ring.iter().map(|p| flat(*p))));
    let corners = triangles.into_iter().map(|t| t.map(|i| points[i]));
    corners.map(|t| if (t[1] - t[0]).cross(t[2] - t[0]).dot(facing) < 0.0 { [t[0], t[2], t[1]] } else { t }).collect()
}
