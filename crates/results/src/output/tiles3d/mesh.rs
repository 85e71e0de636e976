//! Blocks as triangles for a graphics card: flat-shaded, closed, counter-clockwise seen from outside.
//!
//! Axes are glTF's: x east, y up, z south, metres from the city's local frame.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::OutputError;
use super::super::grid::OutputGrid;
use super::super::palette::Palette;
use super::super::picture::colour::{Rgb, height_colour};
use super::super::prism::{GridFace, SnappedPrism};
use super::super::textured::{FacePaint, TexturedGround};
use super::super::triangles;
use super::place::TilesetPlace;
use sizeup_geo::triangles::area_vector;

/// One building, ready to be placed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TileBuilding {
    /// The solid on the output grid, as a block.
    pub prism: SnappedPrism,
    /// Faces of it: those with its roof, where that has another form, and those of a textured block.
    pub roofed: Option<Vec<GridFace>>,
    /// Looks of these faces, in their order; empty where it has the colour of its height.
    pub paints: Vec<FacePaint>,
    /// Attributes, in the order of the columns.
    pub values: Vec<Value>,
    /// Height that colours it, metres.
    pub height_m: f64,
}

impl TileBuilding {
    /// Plain colours of it.
    pub fn colours(&self) -> impl Iterator<Item = Rgb> + '_ {
        let plain = self.paints.iter().filter_map(|paint| match paint {
            FacePaint::Plain(colour) => Some(*colour),
            FacePaint::Picture { .. } => None,
        });
        plain.chain(self.paints.is_empty().then(|| height_colour(self.height_m)))
    }
}

/// Material of triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Material {
    /// The picture of plain colours.
    Palette,
    /// A picture of textures, by its position.
    Page(usize),
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
    /// Places of the vertices on the picture of their material: shares from its upper left corner.
    pub uv: Vec<[f32; 2]>,
    /// Vertices of the triangles of each material, three each.
    pub indices: BTreeMap<Material, Vec<u32>>,
}

/// Look of one face.
#[derive(Clone, Copy)]
enum Look<'a> {
    Plain([f32; 2]),
    Picture(usize, &'a [Vec<[f32; 2]>]),
}

/// glTF's axes from east, north, up.
fn gltf_from_enu(p: DVec3) -> DVec3 {
    DVec3::new(p.x, p.z, -p.y)
}

impl TileMesh {
    /// The blocks of a tile; feature `i` is block `i`. The palette has their plain colours.
    ///
    /// # Errors
    /// [`OutputError::Crs`] for a position outside the CRS's domain.
    pub fn of(
        blocks: &[TileBuilding],
        palette: &Palette,
        grid: &OutputGrid,
        place: &TilesetPlace,
    ) -> Result<Self, OutputError> {
        let mut mesh = Self::default();
        for (feature, block) in blocks.iter().enumerate() {
            let first = mesh.positions.len();
            match &block.roofed {
                Some(faces) => mesh.add_faces(faces, (block, palette), (grid, place))?,
                None => {
                    let look = Look::Plain(palette.uv(height_colour(block.height_m)));
                    mesh.add(&block.prism, look, grid, place)?;
                }
            }
            mesh.features.extend(std::iter::repeat_n(feature as u32, mesh.positions.len() - first));
        }
        Ok(mesh)
    }

    /// The ground of a textured city, from its nodes in the tileset's axes; it has no features.
    pub fn of_ground(ground: &TexturedGround, nodes: &[DVec3]) -> Self {
        let positions: Vec<DVec3> = nodes.iter().map(|p| gltf_from_enu(*p)).collect();
        let uv = (0..nodes.len()).map(|i| ground.share(i).as_vec2().to_array()).collect();
        let normals = vec![DVec3::Y; nodes.len()];
        Self {
            positions,
            normals,
            uv,
            features: Vec::new(),
            indices: BTreeMap::from([(Material::Page(0), ground.triangles())]),
        }
    }

    fn add(
        &mut self,
        prism: &SnappedPrism,
        look: Look<'_>,
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
        self.flat(roof, up, look, &triangles);
        let turned: Vec<[usize; 3]> = triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        self.flat(base, -up, look, &turned);
        let mut first = 0;
        for ring in rings {
            for i in 0..ring.len() {
                let (from, to) = (first + i, first + (i + 1) % ring.len());
                let wall = [base[from], base[to], roof[to], roof[from]];
                let normal = (wall[1] - wall[0]).cross(wall[3] - wall[0]).normalize();
                self.flat(&wall, normal, look, &[[0, 1, 2], [0, 2, 3]]);
            }
            first += ring.len();
        }
        Ok(())
    }

    fn add_faces(
        &mut self,
        faces: &[GridFace],
        (block, palette): (&TileBuilding, &Palette),
        (grid, place): (&OutputGrid, &TilesetPlace),
    ) -> Result<(), OutputError> {
        for (i, face) in faces.iter().enumerate() {
            let look = match block.paints.get(i) {
                Some(FacePaint::Picture { page, uv }) => Look::Picture(*page, uv),
                Some(FacePaint::Plain(colour)) => Look::Plain(palette.uv(*colour)),
                None => Look::Plain(palette.uv(height_colour(block.height_m))),
            };
            let corners = face.rings.iter().flatten();
            let mut points: Vec<DVec3> = corners.map(|p| DVec3::from_array(grid.metres(*p))).collect();
            place.to_local(&mut points)?;
            for point in &mut points {
                *point = gltf_from_enu(*point);
            }
            let normal = area_vector(&points[..face.rings[0].len()]).normalize_or_zero();
            self.flat(&points, normal, look, &triangles::of_face(face));
        }
        Ok(())
    }

    /// A face of one normal.
    fn flat(&mut self, points: &[DVec3], normal: DVec3, look: Look<'_>, triangles: &[[usize; 3]]) {
        let first = self.positions.len();
        self.positions.extend(points);
        self.normals.extend(std::iter::repeat_n(normal, points.len()));
        let material = match look {
            Look::Plain(uv) => {
                self.uv.extend(std::iter::repeat_n(uv, points.len()));
                Material::Palette
            }
            Look::Picture(page, uv) => {
                self.uv.extend(uv.iter().flatten());
                Material::Page(page)
            }
        };
        let indices = self.indices.entry(material).or_default();
        indices.extend(triangles.iter().flatten().map(|&i| (first + i) as u32));
    }

    /// Positions of the pictures that it has.
    pub fn pages(&self) -> impl Iterator<Item = usize> + '_ {
        self.indices.keys().filter_map(|material| match material {
            Material::Page(page) => Some(*page),
            Material::Palette => None,
        })
    }

    /// Smallest and largest coordinates.
    #[must_use]
    pub fn bounds(&self) -> [DVec3; 2] {
        let low = self.positions.iter().copied().reduce(DVec3::min);
        let high = self.positions.iter().copied().reduce(DVec3::max);
        [low.unwrap_or_default(), high.unwrap_or_default()]
    }
}
