//! Pictures of a result as PNG: a map of the heights, one of the survey, a depth panel of one view, prism edges over a photo,
//! charts, a map of errors, and contact sheets of buildings.
//!
//! Colours come from maps that are even in lightness and readable by colour-blind people ([`colour`]).

mod canvas;
mod chart;
mod class_map;
pub mod colour;
mod error_map;
mod map;
mod overlay;
mod pairs;
mod panel;
mod photo;
mod plan;
mod relief;
mod scale;
mod sheet;
mod survey;
mod warning;

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, RgbImage};

use super::OutputError;
use sizeup_geo::files::{FileError, write_whole};

pub use chart::{Chart, SERIES_COLOURS, Series, Stroke, chart};
pub use class_map::{MapClass, MapHeadings, class_map};
pub use error_map::error_map;
pub use map::{MapConfig, map};
pub use overlay::{OverlayConfig, Polyline, overlay};
pub use pairs::{PicturedPair, beside, pairs_picture};
pub use panel::{PanelConfig, PanelDepths, depth_panel, depth_picture};
pub use photo::{PhotoCrop, photo_of};
pub use relief::relief_map;
pub use sheet::{SHEET_PHOTO_PX, SHEET_PHOTOS, SheetBuilding, SheetPhoto, contact_sheet};
pub use survey::survey_map;
pub use warning::warned;

/// Width of the maps of a survey and of the ground, pixels.
const SHEET_PX: u32 = 1600;

/// Writes a picture as PNG, whole or not at all.
///
/// # Errors
/// [`OutputError::File`].
pub fn write_png(path: &Path, picture: &RgbImage) -> Result<(), OutputError> {
    let mut png = Cursor::new(Vec::new());
    let encoded = picture.write_to(&mut png, ImageFormat::Png).map_err(std::io::Error::other);
    encoded.map_err(FileError::on("cannot encode", path))?;
    write_whole(path, |out| out.write_all(png.get_ref()))?;
    Ok(())
}
