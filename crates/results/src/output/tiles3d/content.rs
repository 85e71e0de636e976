//! Contents of tiles: buildings and grounds as binary glTF, with the pictures of a textured city.

use std::collections::BTreeMap;

use glam::DVec3;
use serde_json::Value;

use super::super::OutputError;
use super::super::grid::OutputGrid;
use super::super::palette::Palette;
use super::super::textured::{TexturedCity, TexturedGround};
use super::glb::{GlbTile, Precision, glb};
use super::mesh::{TileBuilding, TileMesh};
use super::metadata::NamedColumns;
use super::place::TilesetPlace;

/// Name of the tile of the ground.
pub const GROUND: &str = "ground";

/// Binary glTF of a tile.
pub struct Content {
    pub bytes: Vec<u8>,
    /// Box of its vertices, in glTF's axes.
    pub bounds: [DVec3; 2],
}

/// Pictures of triangles, JPEG, by their position among all.
pub type Pictures = BTreeMap<usize, Vec<u8>>;

/// Triangles and their plain colours.
pub struct PaintedMesh {
    pub of: TileMesh,
    palette: Palette,
}

/// Makes the contents of the tiles of a city.
pub struct Contents<'a> {
    pub grid: &'a OutputGrid,
    pub place: &'a TilesetPlace,
    /// Columns of the buildings' attributes; `None` for contents without attributes.
    pub properties: Option<&'a NamedColumns>,
    pub precision: Precision,
    pub textured: Option<&'a TexturedCity>,
}

impl Contents<'_> {
    /// Triangles of some blocks; feature `i` is block `i`.
    pub fn mesh(&self, blocks: &[TileBuilding]) -> Result<PaintedMesh, OutputError> {
        let palette = Palette::of(blocks.iter().flat_map(TileBuilding::colours));
        Ok(PaintedMesh { of: TileMesh::of(blocks, &palette, self.grid, self.place)?, palette })
    }

    /// The content of a tile of some blocks, of their triangles and pictures.
    pub fn of(&self, mesh: &PaintedMesh, blocks: &[TileBuilding], name: &str, pictures: &Pictures) -> Content {
        let rows: Vec<&[Value]> = blocks.iter().map(|block| block.values.as_slice()).collect();
        let PaintedMesh { of: mesh, palette } = mesh;
        let tile = GlbTile { mesh, rows: &rows, palette, pictures, properties: self.properties, name };
        Content { bytes: glb(&tile, self.precision), bounds: mesh.bounds() }
    }

    /// Reads the pictures that a mesh has.
    pub fn pictures(&self, mesh: &TileMesh) -> Result<Pictures, OutputError> {
        let Some(textured) = self.textured else { return Ok(Pictures::new()) };
        mesh.pages().map(|page| Ok((page, textured.picture(page)?))).collect()
    }

    /// The same as they are seen from far away, and the side of the largest of their pixels, metres; `None` where those are hardly smaller.
    pub fn far_pictures(&self, mesh: &TileMesh) -> Result<Option<(Pictures, f64)>, OutputError> {
        let Some(textured) = self.textured else { return Ok(None) };
        let (mut pictures, mut most_m) = (Pictures::new(), 0.0_f64);
        for page in mesh.pages() {
            let picture = match textured.far_picture(page)? {
                Some((far, px_m)) => {
                    most_m = most_m.max(px_m);
                    far
                }
                None => textured.picture(page)?,
            };
            pictures.insert(page, picture);
        }
        Ok((most_m > 0.0).then_some((pictures, most_m)))
    }

    /// The content of a ground of a textured city.
    pub fn ground(&self, textured: &TexturedCity, i: usize) -> Result<Content, OutputError> {
        let (ground, jpeg) = textured.ground(i)?;
        self.of_ground(&ground, jpeg)
    }

    /// The same for far away, and the side of its pixels, metres; `None` where that is hardly smaller.
    pub fn far_ground(&self, textured: &TexturedCity, i: usize) -> Result<Option<(Content, f64)>, OutputError> {
        let far = textured.far_ground(i)?;
        far.map(|(ground, jpeg, px_m)| Ok((self.of_ground(&ground, jpeg)?, px_m))).transpose()
    }

    fn of_ground(&self, ground: &TexturedGround, jpeg: Vec<u8>) -> Result<Content, OutputError> {
        let mut points = ground.nodes();
        self.place.to_local(&mut points)?;
        let mesh = TileMesh::of_ground(ground, &points);
        let (palette, pictures) = (&Palette::default(), &Pictures::from([(0, jpeg)]));
        let tile = GlbTile { mesh: &mesh, rows: &[], palette, pictures, properties: None, name: GROUND };
        Ok(Content { bytes: glb(&tile, self.precision), bounds: mesh.bounds() })
    }
}
