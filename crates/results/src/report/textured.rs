//! The textured city in the page: binary glTF, which the viewer reads as well.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use crate::output::grid::OutputGrid;
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
    #[serde(skip_serializing_if = "Option::is_none")]
    ground: Option<String>,
    /// Positions of the buildings that it shows.
    shown: Vec<usize>,
}

impl TexturedData {
    /// Data of a city; `None` for one that is too large, or that no photo shows.
    ///
    /// # Errors
    /// [`OutputError`]: pictures that cannot be read.
    pub fn of(
        records: &[BuildingRecord],
        grid: &OutputGrid,
        textured: &TexturedCity,
    ) -> Result<Option<Self>, OutputError> {
        let Some(view) = MapView::of(records, grid, textured)? else { return Ok(None) };
        let n_bytes = view.buildings.len() + view.ground.as_ref().map_or(0, Vec::len);
        Ok((n_bytes <= MOST_BYTES).then(|| Self {
            buildings: STANDARD.encode(&view.buildings),
            ground: view.ground.map(|ground| STANDARD.encode(ground)),
            shown: view.shown,
        }))
    }
}
