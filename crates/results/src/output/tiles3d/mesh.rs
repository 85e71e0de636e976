//! Blocks as triangles for a graphics card: flat-shaded, closed, counter-clockwise seen from outside.
//!
//! Axes are glTF's: x east, y up, z south, metres from the city's local frame.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::OutputError;
use super::super::grid::OutputGrid;
use super::super::prism::{GridFace, SnappedPrism};
use super::super::triangles;
use super::place::TilesetPlace;

/// One building, ready to be placed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TileBuilding {
    /// The solid on the output grid, as a block.
    pub prism: SnappedPrism,
    /// Faces of it with its roof, where that has another form.
    pub roofed: Option<Vec<GridFace>>,
    /// Attributes, in the order of the columns.
    pub values: Vec<Value>,
    /// Height that colours it, metres.
    pub height_m: f64,
}

/// The triangles of one tile. Vertex attributes have one entry per vertex.
#[derive(Debug, Default)]
pub struct TileMesh {
    /// Positions of the vertices, metres.
    pub positions: Vec<DVec3>,
    /// Unit normals of the vertices.
    pub normals: Vec<DVec3>,
    /// Which building of the tile.
    pub features: Vec<u32>,
    /// Vertices of the triangles, three each.
    pub indices: Vec<u32>,
}

/// glTF's axes from east, north, up.
fn gltf_from_enu(p: DVec3) -> DVec3 {
    DVec3::new(p.x, p.z, -p.y)
}

impl TileMesh {
    /// The blocks of a tile; feature `i` is block `i`.
    ///
    /// # Errors
    /// [`OutputError::Crs`] for a position outside the CRS's domain.
    pub fn of<'a>(
        blocks: impl Iterator<Item = &'a TileBuilding>,
        grid: &OutputGrid,
        place: &TilesetPlace,
    ) -> Result<Self, OutputError> {
        let mut mesh = Self::default();
        for (feature, block) in blocks.enumerate() {
            match &block.roofed {
                Some(faces) => mesh.add_faces(faces, feature as u32, grid, place)?,
                None => mesh.add(&block.prism, feature as u32, grid, place)?,
            }
        }
        Ok(mesh)
    }

    fn add(
        &mut self,
        prism: &SnappedPrism,
        feature: u32,
        grid: &OutputGrid,
        place: &TilesetPlace,
    ) -> Result<(), OutputError> {
        let rings = prism.footprint().rings();
        let corners: Vec<[i64; 2]> = rings.iter().flatten().copied().collect();
        let n = corners.len();
        let at_level = |level: i64| corners.iter().map(move |&[x, y]| DVec3::from_array(grid.metres([x, y, level])));
        let mut points: Vec<DVec3> = at_level(prism.base()).chain(at_level(prism.roof())).collect();
        place.to_local(&mut points)?;
        for point in &mut points {
            *point = gltf_from_enu(*point);
        }
        let (base, roof) = points.split_at(n);

        let triangles = triangles::of_rings(rings);
        let up = (roof[0] - base[0]).normalize();
        self.flat(roof, up, feature, &triangles);
        let turned: Vec<[usize; 3]> = triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        self.flat(base, -up, feature, &turned);
        let mut first = 0;
        for ring in rings {
            for i in 0..ring.len() {
                let (from, to) = (first + i, first + (i + 1) % ring.len());
                let wall = [base[from], base[to], roof[to], roof[from]];
                let normal = (wall[1] - wall[0]).cross(wall[3] - wall[0]).normalize();
                self.flat(&wall, normal, feature, &[[0, 1, 2], [0, 2, 3]]);
            }
            first += ring.len();
        }
        Ok(())
    }

    fn add_faces(
        &mut self,
        faces: &[GridFace],
        feature: u32,
        grid: &OutputGrid,
        place: &TilesetPlace,
    ) -> Result<(), OutputError> {
        for face in faces {
            let corners = face.rings.iter().flatten();
            let mut points: Vec<DVec3> = corners.map(|p| DVec3::from_array(grid.metres(*p))).collect();
            place.to_local(&mut points)?;
            for point in &mut points {
                *point = gltf_from_enu(*point);
            }
            let normal = triangles::newell(&points[..face.rings[0].len()]).normalize_or_zero();
            self.flat(&points, normal, feature, &triangles::of_face(face));
        }
        Ok(())
    }

    /// A face of one normal.
    fn flat(&mut self, points: &[DVec3], normal: DVec3, feature: u32, triangles: &[[usize; 3]]) {
        let first = self.positions.len();
        self.positions.extend(points);
        self.normals.extend(std::iter::repeat_n(normal, points.len()));
        self.features.extend(std::iter::repeat_n(feature, points.len()));
        self.indices.extend(triangles.iter().flatten().map(|&i| (first + i) as u32));
    }

    /// Smallest and largest coordinates.
    #[must_use]
    pub fn bounds(&self) -> [DVec3; 2] {
        let low = self.positions.iter().copied().reduce(DVec3::min);
        let high = self.positions.iter().copied().reduce(DVec3::max);
        [low.unwrap_or_default(), high.unwrap_or_default()]
    }
}
