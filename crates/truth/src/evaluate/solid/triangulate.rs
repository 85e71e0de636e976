//! Planar polygons in space to triangles: ears are clipped in the coordinate plane that the polygon faces most.

use glam::DVec3;

use sizeup_geo::triangles::{self, area_vector};

/// Triangles of an exterior ring and its holes (rings not closed), in the exterior's sense. A ring without area has
/// none.
#[must_use]
pub fn triangulate(rings: &[Vec<DVec3>]) -> Vec<[DVec3; 3]> {
    let Some(exterior) = rings.first() else { return Vec::new() };
    let facing = area_vector(exterior);
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
