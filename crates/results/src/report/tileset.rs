//! The tileset to show of a folder: the one it holds, or one made of its city.

use std::path::{Path, PathBuf};

use super::ServeError;
use crate::output::read::{ReadOptions, RecordFile};
use crate::output::textured::TexturedCity;
use crate::output::tiles3d::{self, Heights, Tiles3dConfig};
use crate::output::{CityModel, Lineage};
use sizeup_geo::files::FileError;
use sizeup_survey::Survey;

/// The file that makes a folder a tileset.
pub(super) const TILESET: &str = "tileset.json";
/// The city of a result, and where its tiles are put if it has none.
const CITY: &str = "city.city.json";
const MADE: &str = "stages/view";

/// The folder of a tileset: `folder` itself, one made of its textured city, the first below it that is one, or one made of its
/// `city.city.json`. Those that are made are for looking at only: where heights count from does not matter to a viewer without a globe.
///
/// # Errors
/// [`ServeError`].
pub fn tileset_of(folder: &Path) -> Result<PathBuf, ServeError> {
    if folder.join(TILESET).is_file() {
        return Ok(folder.to_owned());
    }
    let made = folder.join(MADE);
    let textured = TexturedCity::of_result(folder)?;
    if textured.is_some() && folder.join(CITY).is_file() {
        make(&folder.join(CITY), &made, textured.as_ref())?;
        return Ok(made);
    }
    let entries = std::fs::read_dir(folder).map_err(FileError::on("cannot read", folder))?;
    let mut below: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    below.sort();
    if let Some(found) = below.into_iter().find(|path| path.join(TILESET).is_file()) {
        return Ok(found);
    }
    let city = folder.join(CITY);
    if !city.is_file() {
        return Err(ServeError::NoTileset { path: folder.to_owned() });
    }
    make(&city, &made, textured.as_ref())?;
    Ok(made)
}

fn make(city: &Path, folder: &Path, textured: Option<&TexturedCity>) -> Result<(), ServeError> {
    let file = RecordFile::open(city, ReadOptions::default())?;
    let Some(crs) = file.crs().cloned() else { return Err(ServeError::NoCrs { path: city.to_owned() }) };
    file.check_units(&crs)?;
    let lineage: Lineage = file.lineage().unwrap_or_default();
    let survey = Survey::default();
    let model = CityModel { records: &file, crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    let config = Tiles3dConfig { heights: Heights::GeoidHeight(0.0), ..Tiles3dConfig::default() };
    tiles3d::write_textured(folder, &model, &config, textured)?;
    Ok(())
}
