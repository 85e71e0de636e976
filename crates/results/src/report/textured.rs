//! The textured city in the page: binary glTF, which the viewer reads as well.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::city::origin;
use crate::output::grid::{OutputGrid, SCALE_M};
use crate::output::textured::TexturedCity;
use crate::output::tiles3d::MapView;
use crate::output::{BuildingRecord, OutputError};

/// Most bytes of the textured city in the page, which browsers have to read whole; larger cities are for `sizeup view`. A first choice.
const MOST_BYTES: usize = 30_000_000;

/// Textured city as the page's script wants it.
#[derive(Debug, Serialize)]
pub(super) struct TexturedData {
    /// Buildings, binary glTF in base64; features are positions of buildings.
    buildings: String,
    /// Pieces of the ground in the same form, without features.
    grounds: Vec<String>,
    /// Positions of the buildings that it shows.
    shown: Vec<usize>,
}

impl TexturedData {
    /// Data of a city, JSON; `null` for one that is too large, or that no photo shows.
    ///
    /// # Errors
    /// [`OutputError`]: pictures that cannot be read.
    pub fn json(records: &[BuildingRecord], textured: Option<&TexturedCity>) -> Result<String, OutputError> {
        let grid = OutputGrid { scale_m: SCALE_M, origin_m: origin(records) };
        let data = textured.map(|textured| Self::of(records, &grid, textured)).transpose()?.flatten();
        Ok(serde_json::to_string(&data).unwrap_or_default())
    }

    fn of(records: &[BuildingRecord], grid: &OutputGrid, textured: &TexturedCity) -> Result<Option<Self>, OutputError> {
        let view = MapView::of(records, grid, textured, MOST_BYTES)?;
        Ok(view.map(|view| Self {
            buildings: STANDARD.encode(&view.buildings),
            grounds: view.grounds.iter().map(|ground| STANDARD.encode(ground)).collect(),
            shown: view.shown,
        }))
    }
}
