//! A textured city in the map, for the report: binary glTF around an origin instead of tiles on a globe.

use glam::DVec3;

use super::super::grid::OutputGrid;
use super::super::prism::{MIN_THICKNESS_M, SnappedPrism};
use super::super::textured::TexturedCity;
use super::super::{BuildingRecord, OutputError};
use super::content::Contents;
use super::glb::Precision;
use super::mesh::TileBuilding;
use super::place::TilesetPlace;

/// A textured city as it is shown in the map: binary glTF around an origin.
pub(crate) struct MapView {
    /// Buildings; features are positions of records.
    pub buildings: Vec<u8>,
    /// The ground around the buildings, piece by piece.
    pub grounds: Vec<Vec<u8>>,
    /// Positions of the records that it shows.
    pub shown: Vec<usize>,
}

impl MapView {
    /// View of the records that have textures; `None` where none has, or where it would have more than some bytes. What is too much is as from
    /// far away: first the ground, then the buildings.
    ///
    /// # Errors
    /// [`OutputError`]: pictures that cannot be read.
    pub fn of(
        records: &[BuildingRecord],
        grid: &OutputGrid,
        textured: &TexturedCity,
        most_bytes: usize,
    ) -> Result<Option<Self>, OutputError> {
        let [of_buildings, of_grounds] = textured.n_bytes()?.map(|n| n as usize);
        let is_far = |n_bytes: usize| n_bytes > most_bytes;
        let block = |record: &BuildingRecord| {
            let prism = SnappedPrism::of(record, grid, MIN_THICKNESS_M).ok()?;
            let found = textured.solid(&record.id, &prism, grid).transpose()?;
            let block = |(faces, paints)| TileBuilding {
                prism,
                roofed: Some(faces),
                paints,
                values: Vec::new(),
                height_m: 0.0,
            };
            Some(found.map(block))
        };
        let found = records.iter().enumerate().filter_map(|(i, record)| Some((i, block(record)?)));
        let found = found.map(|(i, block)| Ok((i, block?))).collect::<Result<Vec<_>, OutputError>>()?;
        let (shown, blocks): (Vec<usize>, Vec<TileBuilding>) = found.into_iter().unzip();
        if shown.is_empty() {
            return Ok(None);
        }
        let contents = Contents {
            grid,
            place: &TilesetPlace::in_map(DVec3::from_array(grid.origin_m)),
            properties: None,
            precision: Precision::Float,
            textured: Some(textured),
        };
        let mut mesh = contents.mesh(&blocks)?;
        mesh.of.features.iter_mut().for_each(|feature| *feature = shown[*feature as usize] as u32);
        let far = if is_far(of_buildings) { contents.far_pictures(&mesh.of)? } else { None };
        let pictures = far.map_or_else(|| contents.pictures(&mesh.of), |(far, _)| Ok(far))?;
        let buildings = contents.of(&mesh, &blocks, "buildings", &pictures).bytes;
        let mut grounds = Vec::new();
        for i in 0..textured.grounds.len() {
            let far = if is_far(of_buildings + of_grounds) { contents.far_ground(textured, i)? } else { None };
            let ground = far.map_or_else(|| contents.ground(textured, i), |(ground, _)| Ok(ground))?;
            grounds.push(ground.bytes);
        }
        let view = Self { buildings, grounds, shown };
        let n_bytes = view.buildings.len() + view.grounds.iter().map(Vec::len).sum::<usize>();
        Ok((n_bytes <= most_bytes).then_some(view))
    }
}
