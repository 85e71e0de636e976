//! Buildings as bodies: what surface and volume measures compare.
//!
//! | from | triangles | prisms |
//! |---|---|---|
//! | a record of ours, a footprint with ground and height | of the extruded footprint | one |
//! | `CityJSON`, any level of detail | of the surfaces | one per roof of the lowest level of detail whose roofs are all level |
//! | OBJ | of the faces, one body per object or group | none |
//!
//! Frame: the project's map frame, metres; levels in the file's vertical reference.

mod files;
mod triangulate;

use geo_types::{MultiPolygon, Polygon};
use glam::DVec3;

pub use files::{SolidError, Solids, read_solids, write_obj};
pub use triangulate::triangulate;

use sizeup_results::output::BuildingRecord;

/// A face of a body counts as its bottom if it faces down within 60° of the vertical and nothing says otherwise.
const BOTTOM_COSINE: f64 = 0.5;

/// A triangle, counter-clockwise seen from outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Corners, metres, counter-clockwise seen from outside.
    pub corners: [DVec3; 3],
    /// Part of the ground face: no camera sees it.
    pub is_bottom: bool,
}

impl Facet {
    /// Area of the triangle, m².
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        let [a, b, c] = self.corners;
        0.5 * (b - a).cross(c - a).length()
    }
}

/// A prism with upright walls, as volumes are measured with.
#[derive(Debug, Clone, PartialEq)]
pub struct UprightPrism {
    /// Plan of the prism, metres.
    pub footprint: Polygon<f64>,
    /// Lower and upper level.
    pub levels_m: [f64; 2],
}

/// Body of one building: its surface, and the prisms it is made of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Solid {
    /// Id of the building in its file.
    pub id: String,
    /// Triangles of its surface.
    pub facets: Vec<Facet>,
    /// The same body as prisms that do not overlap; empty if it is not made of upright prisms.
    pub prisms: Vec<UprightPrism>,
}

impl Solid {
    /// A footprint between two levels; `None` if it has no thickness or no footprint.
    #[must_use]
    pub fn extruded(id: &str, footprint: &MultiPolygon<f64>, levels_m: [f64; 2]) -> Option<Self> {
        if footprint.0.is_empty() || levels_m[1] <= levels_m[0] {
            return None;
        }
        let prisms: Vec<UprightPrism> =
            footprint.iter().map(|p| UprightPrism { footprint: p.clone(), levels_m }).collect();
        let facets = prisms.iter().flat_map(UprightPrism::facets).collect();
        Some(Self { id: id.to_owned(), facets, prisms })
    }

    /// Prisms, as they are: they must not overlap.
    #[must_use]
    pub fn of_prisms(id: &str, prisms: Vec<UprightPrism>) -> Self {
        let facets = prisms.iter().flat_map(UprightPrism::facets).collect();
        Self { id: id.to_owned(), facets, prisms }
    }

    /// The body of a record, from its lowest ground to its roof; `None` without height or footprint.
    #[must_use]
    pub fn of_record(record: &BuildingRecord) -> Option<Self> {
        let footprint = MultiPolygon::new(vec![record.footprint.clone()?]);
        let base_m = record.base_z_m.or(record.ground_z_m)?;
        Self::extruded(&record.id, &footprint, [base_m, record.roof_z_m()?])
    }

    /// From triangles alone; bottoms are told by their normals.
    #[must_use]
    pub fn of_triangles(id: &str, triangles: impl IntoIterator<Item = [DVec3; 3]>) -> Self {
        let facet = |corners: [DVec3; 3]| Facet { corners, is_bottom: faces_down(corners) };
        Self { id: id.to_owned(), facets: triangles.into_iter().map(facet).collect(), prisms: Vec::new() }
    }
}

/// Whether a triangle faces down within 60° of the vertical.
fn faces_down([a, b, c]: [DVec3; 3]) -> bool {
    (b - a).cross(c - a).normalize_or_zero().z < -BOTTOM_COSINE
}

impl UprightPrism {
    /// Bottom, top and walls.
    fn facets(&self) -> Vec<Facet> {
        let [low, high] = self.levels_m;
        let ring = |line: &geo_types::LineString<f64>, z: f64| -> Vec<DVec3> {
            let closed = line.0.len() > 1 && line.0.first() == line.0.last();
            line.0[..line.0.len() - usize::from(closed)].iter().map(|c| DVec3::new(c.x, c.y, z)).collect()
        };
        let lines: Vec<_> = std::iter::once(self.footprint.exterior()).chain(self.footprint.interiors()).collect();
        let top: Vec<Vec<DVec3>> = lines.iter().map(|line| ring(line, high)).collect();
        let mut facets = Vec::new();
        for mut t in triangulate(&top) {
            // Whichever way round the footprint is given.
            if (t[1] - t[0]).cross(t[2] - t[0]).z < 0.0 {
                t.swap(1, 2);
            }
            facets.push(Facet { corners: t, is_bottom: false });
            let below = [t[0], t[2], t[1]].map(|p| p.truncate().extend(low));
            facets.push(Facet { corners: below, is_bottom: true });
        }
        for (i, corners) in top.iter().enumerate() {
            let area: f64 = (0..corners.len())
                .map(|k| corners[k].truncate().perp_dot(corners[(k + 1) % corners.len()].truncate()))
                .sum();
            // Walls face away from the body: outwards of the exterior, into courtyards.
            let is_reversed = (area > 0.0) != (i == 0);
            for k in 0..corners.len() {
                let (mut a, mut b) = (corners[k], corners[(k + 1) % corners.len()]);
                if is_reversed {
                    std::mem::swap(&mut a, &mut b);
                }
                let (a0, b0) = (a.truncate().extend(low), b.truncate().extend(low));
                facets.push(Facet { corners: [a0, b0, b], is_bottom: false });
                facets.push(Facet { corners: [a0, b, a], is_bottom: false });
            }
        }
        facets
    }
}

#[cfg(test)]
pub(super) mod tests {
    use geo_types::polygon;

    use super::*;

    /// A closed box with its lowest corner at `x, y, z`, metres.
    pub fn block(id: &str, [x, y, z]: [f64; 3], [w, d, h]: [f64; 3]) -> Solid {
        let footprint = polygon![(x: x, y: y), (x: x + w, y: y), (x: x + w, y: y + d), (x: x, y: y + d)];
        Solid::extruded(id, &MultiPolygon::new(vec![footprint]), [z, z + h]).unwrap()
    }

    /// Volume by the divergence theorem.
    pub fn volume_m3(facets: &[Facet]) -> f64 {
        let o = facets[0].corners[0];
        facets.iter().map(|f| (f.corners[0] - o).dot((f.corners[1] - o).cross(f.corners[2] - o)) / 6.0).sum()
    }

    #[test]
    fn an_extruded_courtyard_is_closed_and_faces_outwards() {
        let footprint = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 0.0, y: 9.0), (x: 9.0, y: 9.0), (x: 9.0, y: 0.0)],
            interiors: [[(x: 3.0, y: 3.0), (x: 6.0, y: 3.0), (x: 6.0, y: 6.0), (x: 3.0, y: 6.0)]],
        );
        let solid = Solid::extruded("a", &MultiPolygon::new(vec![footprint]), [2.0, 5.0]).unwrap();
        assert!((volume_m3(&solid.facets) - 72.0 * 3.0).abs() < 1e-9);
        let area: f64 = solid.facets.iter().map(Facet::area_m2).sum();
        assert!((area - (2.0 * 72.0 + 3.0 * (36.0 + 12.0))).abs() < 1e-9);
        assert_eq!(Solid::extruded("a", &MultiPolygon::new(vec![]), [2.0, 5.0]), None);
    }
}
