//! Which raster holds the ground: one band of heights with a CRS where the photos are, that is not called a surface model.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::InitError;
use super::folder::{Inventory, name_of};
use super::place::PhotoPlaces;
use sizeup_geo::crs::Crs;
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_geo::terrain::{self, MapBox, TerrainConfig, TerrainError};

/// Parts of names of terrain models, lower case.
const TERRAIN: [&str; 11] = ["dtm", "dgm", "dhm", "mnt", "mdt", "nmt", "dem", "terrain", "ground", "bare", "gelaende"];
/// Parts of names of models with roofs and trees on them.
const SURFACE: [&str; 11] =
    ["dsm", "dom", "mns", "mds", "nmpt", "ndsm", "chm", "surface", "hag", "canopy", "normalised"];

/// A raster that is taken as the ground.
#[derive(Debug, Clone, Serialize)]
pub struct TerrainFile {
    /// Path of the raster's file.
    pub path: PathBuf,
    /// Why the raster was taken.
    pub why: String,
    /// Zero of its heights, where it says.
    pub vertical: Option<String>,
    /// Whether its name says that it is terrain.
    pub is_named: bool,
    /// CRS of the raster; `None` where it names none.
    #[serde(skip)]
    pub crs: Option<Crs>,
    /// Way to state the unit of its heights, where positions are in feet and nothing says it.
    #[serde(skip)]
    pub how_to_state_unit: Option<String>,
}

/// A raster that is not taken.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PassedRaster {
    /// Path of the raster's file.
    pub path: PathBuf,
    /// Why the raster was not taken.
    pub why: String,
}

/// Outcome of a look at the rasters.
#[derive(Debug, Default)]
pub(super) struct GroundChoice {
    pub chosen: Option<TerrainFile>,
    pub passed: Vec<PassedRaster>,
}

/// Kind of a raster by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Called {
    Terrain,
    Surface,
    Neither,
}

/// Chooses among the rasters of a folder; `place` is where the photos are.
pub(super) fn choose(inventory: &Inventory, place: &PhotoPlaces) -> GroundChoice {
    let mut choice = GroundChoice::default();
    let mut usable = Vec::new();
    for path in &inventory.rasters {
        match look(path, place) {
            _ if called(path) == Called::Surface => choice.pass(
                path,
                "its name says surface model: roofs and trees would count as ground; a terrain model (DTM) is needed"
                    .to_owned(),
            ),
            Ok(found) => usable.push(found),
            Err(why) => choice.pass(path, why),
        }
    }
    usable.sort_by_key(|found| (!found.is_named, found.path.clone()));
    let mut usable = usable.into_iter();
    choice.chosen = usable.next();
    for found in usable {
        choice.pass(&found.path, format!("{}; one is enough", found.why));
    }
    choice
}

impl GroundChoice {
    fn pass(&mut self, path: &Path, why: String) {
        self.passed.push(PassedRaster { path: path.to_owned(), why });
    }
}

/// The terrain model that somebody named: it has to be readable and to lie where the photos are.
pub(super) fn named(path: &Path, place: &PhotoPlaces) -> Result<TerrainFile, InitError> {
    look(path, place).map_err(|reason| InitError::Named {
        option: "--dtm",
        path: path.to_owned(),
        reason: format!("{reason}\nhint: expected one band of heights with a CRS where the photos are; `gdalinfo` shows what a file holds"),
    })
}

/// Whether a file's name says surface model.
pub(super) fn is_called_surface(path: &Path) -> bool {
    called(path) == Called::Surface
}

fn called(path: &Path) -> Called {
    let name = name_of(path).to_lowercase();
    let parts: Vec<&str> = name.split(|c: char| !c.is_alphabetic()).collect();
    // The folder's name is not asked: ODM puts dtm.tif and dsm.tif into `odm_dem`.
    let has = |words: &[&str]| words.iter().any(|word| parts.contains(word) || (word.len() > 3 && name.contains(word)));
    match (has(&SURFACE), has(&TERRAIN)) {
        (true, _) => Called::Surface,
        (false, true) => Called::Terrain,
        (false, false) => Called::Neither,
    }
}

fn look(path: &Path, place: &PhotoPlaces) -> Result<TerrainFile, String> {
    let plain =
        |e: &dyn std::fmt::Display| e.to_string().split("\nhint:").next().unwrap_or_default().replace('\n', " ");
    let file = RasterFile::open(path).map_err(|e| plain(&e))?;
    if file.n_bands() != 1 {
        return Err(format!("it has {} bands, as pictures have; heights have one", file.n_bands()));
    }
    let crs = file.crs().map_err(|e| plain(&e))?.ok_or("it has no CRS")?;
    let sample = file.sample_type(1).map_err(|e| plain(&e))?;
    if !sample.is_float && sample.bits < 16 {
        return Err(format!("its cells have {} bits: too few for heights", sample.bits));
    }
    let grid = file.grid().map_err(|e| plain(&e))?;
    let (width, height) = file.size();
    let (east, south) = (grid.west + grid.cell_x * width as f64, grid.north - grid.cell_y * height as f64);
    let covered = MapBox { west_m: grid.west, south_m: south, east_m: east, north_m: grid.north };
    if !matches!(place, PhotoPlaces::Nowhere) {
        let wanted = place
            .bounds_in(&crs)
            .ok_or_else(|| format!("{} cannot be held against where the photos are", crs.name()))?;
        let is_apart = wanted.east_m < covered.west_m
            || wanted.west_m > covered.east_m
            || wanted.north_m < covered.south_m
            || wanted.south_m > covered.north_m;
        if is_apart {
            return Err("it lies elsewhere than the photos".to_owned());
        }
    }
    let is_named = called(path) == Called::Terrain;
    let steps = if sample.is_float { "" } else { " (whole metres)" };
    let (unit, how_to_state_unit) = match terrain::height_unit_m(&TerrainConfig::dtm(path)) {
        Err(TerrainError::HeightUnit { hint, .. }) => {
            ("; nothing says whether heights are feet or metres".to_owned(), Some(hint))
        }
        Ok(unit_m) if unit_m != 1.0 => (format!("; heights are converted to metres from units of {unit_m:.9} m"), None),
        // What else is wrong is told when it is read.
        Ok(_) | Err(_) => (String::new(), None),
    };
    let why = format!(
        "one band of heights{steps} where the photos are{}{unit}",
        if is_named { ", named as terrain" } else { "" }
    );
    Ok(TerrainFile {
        path: path.to_owned(),
        why,
        vertical: crs.vertical_name().map(str::to_owned),
        is_named,
        crs: Some(crs),
        how_to_state_unit,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_terrain_from_surface() {
        let of = |name: &str| called(Path::new(name));
        for name in ["dtm.tif", "DGM1_565_5933.tif", "odm_dem/dtm.tif", "my-terrain.tif", "dgm1_32_565.asc"] {
            assert_eq!(of(name), Called::Terrain, "{name}");
        }
        for name in ["dsm.tif", "DOM1.tif", "bdom_surface.tif", "nDSM_2024.tif", "dtm_dsm.tif"] {
            assert_eq!(of(name), Called::Surface, "{name}");
        }
        assert_eq!(of("heights.tif"), Called::Neither);
        assert_eq!(of("domain.tif"), Called::Neither);
    }
}
