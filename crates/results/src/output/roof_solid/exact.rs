//! Faces that are planar on the grid, to the last digit.
//!
//! The grid bends a sloped face of four corners and more by up to half a quantum. `CityJSON` validators allow for that (val3dity: 1 cm),
//! databases do not: SFCGAL, which `PostGIS` asks, takes 1e-9 m, and no more digits help, as map coordinates in double precision are
//! 9e-10 m apart. A triangle is always planar, so a bent face becomes triangles. They have the corners of the face, all of them, so
//! the solid stays closed.

use super::super::prism::GridFace;
use super::super::triangles::keeping_corners;

/// Faces of which each is exactly planar; `None` where one cannot be divided.
pub(super) fn split_bent(faces: &[GridFace]) -> Option<Vec<GridFace>> {
    let mut split = Vec::new();
    for face in faces {
        if is_planar(face) {
            split.push(face.clone());
        } else {
            split.extend(keeping_corners(face)?);
        }
    }
    Some(split)
}

/// Whether all corners are in one plane, exactly.
fn is_planar(face: &GridFace) -> bool {
    let mut corners = face.rings.iter().flatten();
    let Some(first) = corners.next() else { return true };
    let away: Vec<[i128; 3]> = corners.map(|p| std::array::from_fn(|axis| i128::from(p[axis] - first[axis]))).collect();
    let Some(along) = away.iter().find(|v| **v != [0; 3]) else { return true };
    let Some(normal) = away.iter().map(|v| cross(*along, *v)).find(|normal| *normal != [0; 3]) else { return true };
    away.iter().all(|v| (0..3).map(|axis| normal[axis] * v[axis]).sum::<i128>() == 0)
}

fn cross(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
    std::array::from_fn(|axis| {
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        a[i] * b[j] - a[j] * b[i]
    })
}
