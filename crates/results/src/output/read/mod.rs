//! Reading results and references back: our own files losslessly to the millimetre, and those of others.
//!
//! | file | id | footprint | height |
//! |---|---|---|---|
//! | `CityJSON`, `CityJSONSeq` | key of the object | ground surfaces in plan | `height_m`, else measured on the surfaces |
//! | any vector layer of GDAL | attribute | polygon | attribute |

mod own;
mod stream;
mod surfaces;

use std::io::Read as _;
use std::path::{Path, PathBuf};

use geo::{CoordsIter as _, MapCoords};
use geo_types::{Coord, Geometry, MultiPolygon};
use serde_json::{Map as JsonMap, Value};

use super::OutputError;
use super::cityjson::read::CityFile;
use sizeup_geo::crs::{Crs, CrsError, Transform};
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::vector::{Feature, FeatureGeometry, VectorError, VectorLayer, plain_text};

pub use stream::RecordFile;
pub use surfaces::{BuildingLevels, measure};

/// Names under which an id is looked for when none is given.
const ID_FIELDS: [&str; 4] = ["id", "ID", "identificatie", "gml_id"];

/// Layers that are taken from a file with several when none is named: ours, of a city and of footprints from photos.
const OWN_LAYERS: [&str; 2] = ["buildings", "footprints"];

/// Files of a result's folder: of a run, or of a merged city.
pub const RESULTS: &[&str] = &["city.city.json", "city.city.jsonl", "city.gpkg"];
/// Those of them that are `CityJSON`.
pub const CITYJSON_RESULTS: &[&str] = &["city.city.json", "city.city.jsonl"];
/// That of them with several layers.
pub const LAYERED_RESULTS: &[&str] = &["city.gpkg"];

/// The file of a result: itself, or the first of `names` that its folder holds. Folders that are layers, point clouds or 3D Tiles stay
/// what they are.
///
/// # Errors
/// [`ReadError::NoResult`].
pub fn result_file(path: &Path, names: &'static [&'static str]) -> Result<PathBuf, ReadError> {
    let Ok(entries) = std::fs::read_dir(path) else { return Ok(path.to_owned()) };
    if let Some(found) = names.iter().map(|name| path.join(name)).find(|file| file.is_file()) {
        return Ok(found);
    }
    let is_of_layer = |file: &Path| {
        let extension = file.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        ["shp", "gdbtable", "las", "laz"].contains(&extension.as_str())
            || file.file_name().is_some_and(|name| name == "tileset.json")
    };
    let is_layer = entries.filter_map(Result::ok).any(|entry| is_of_layer(&entry.path()));
    if is_layer { Ok(path.to_owned()) } else { Err(ReadError::NoResult { path: path.to_owned(), names }) }
}

/// One building of a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FoundBuilding {
    /// Id of the building in its file.
    pub id: String,
    /// The building that it is a part of, where our files say so.
    pub part_of: Option<String>,
    /// Footprint in the file's CRS.
    pub footprint: Option<MultiPolygon<f64>>,
    /// Levels measured on its surfaces, where it has some.
    pub levels: Option<BuildingLevels>,
    /// Attributes as they stand.
    pub attributes: JsonMap<String, Value>,
}

/// The buildings of a file.
#[derive(Debug, Clone, Default)]
pub struct FoundBuildings {
    /// The file that was read.
    pub path: PathBuf,
    /// CRS, where it states one.
    pub crs: Option<Crs>,
    /// Buildings in the file's order.
    pub buildings: Vec<FoundBuilding>,
}

/// Options for reading a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReadOptions<'a> {
    /// Layer of a vector file with several; ours by default.
    pub layer: Option<&'a str>,
    /// Attribute that holds the id of a vector feature; one of the usual names, else the feature number, by default.
    pub id_field: Option<&'a str>,
    /// Level of detail of `CityJSON` geometry; the highest there is by default.
    pub lod: Option<&'a str>,
}

/// Why a file's buildings cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// It cannot be read.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// GDAL cannot read it.
    #[error(transparent)]
    Vector(#[from] VectorError),
    /// It is what is written and not read.
    #[error("{} is 3D Tiles, which are written and not read\nhint: give what they were made of, the city's CityJSON (.json, .jsonl) or GeoPackage (.gpkg)", path.display())]
    Tiles3d {
        /// Path of the folder or file.
        path: PathBuf,
    },
    /// The folder holds no result.
    #[error("{} holds no result: none of {}\nhint: name the folder that `sizeup run` or `sizeup tiles merge` wrote, or the file itself", path.display(), names.join(", "))]
    NoResult {
        /// The folder that was named.
        path: PathBuf,
        /// Names of the files that were looked for.
        names: &'static [&'static str],
    },
    /// It has no CRS.
    #[error("{} has no CRS, so its footprints cannot be compared\nhint: state it with `ogr2ogr -a_srs EPSG:… out.gpkg {}`, or match by id", path.display(), path.display())]
    NoCrs {
        /// The file that was read.
        path: PathBuf,
    },
    /// CRS that cannot be brought to the project's.
    #[error("cannot bring {} to the project's CRS", path.display())]
    Crs {
        /// The file that was read.
        path: PathBuf,
        /// Why its positions cannot be brought there.
        #[source]
        source: CrsError,
    },
    /// It does not say in what unit its heights are.
    #[error("{} counts positions in feet and does not say in what it counts heights\nhint: state a CRS with both parts, such as EPSG:2263+6360", path.display())]
    HeightUnit {
        /// The file that was read.
        path: PathBuf,
    },
    /// Positions or heights are in feet, where metres are written.
    #[error("{} counts in feet ({crs}), and results are written in metres\nhint: bring it into a CRS in metres first, as `cjio IN crs_reproject EPSG save OUT` does", path.display())]
    Feet {
        /// The file that was read.
        path: PathBuf,
        /// CRS of the file.
        crs: String,
    },
    /// It lacks an attribute.
    #[error("{} has no attribute {field:?}; it has {}\nhint: name the attribute that holds the {what}", path.display(), if available.is_empty() { "none".to_owned() } else { available.join(", ") })]
    NoField {
        /// The file that was read.
        path: PathBuf,
        /// Attribute that was asked for.
        field: String,
        /// Purpose of the attribute, in words.
        what: &'static str,
        /// Attributes that the file has.
        available: Vec<String>,
    },
}

impl FoundBuildings {
    /// Reads the buildings of a `CityJSON` file (by its extension `json` or `jsonl` and content) or a vector layer.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn read(path: &Path, options: &ReadOptions<'_>) -> Result<Self, ReadError> {
        require_readable(path)?;
        if is_cityjson(path)? {
            let city = CityFile::read(path)?;
            let buildings = surfaces::buildings(&city, options.lod);
            return Ok(Self { path: path.to_owned(), crs: city.crs, buildings });
        }
        let (mut layer, id_field) = open_layer(path, options)?;
        let crs = layer.crs()?;
        let of_feature = |feature| FoundBuilding::from_feature(feature, id_field.as_deref());
        let buildings = layer.features().map(of_feature).collect();
        Ok(Self { path: path.to_owned(), crs, buildings })
    }

    /// Moves all footprints into another CRS (horizontally: heights are differences and stay); measured levels become metres.
    ///
    /// # Errors
    /// [`ReadError::NoCrs`] for a file without one, [`ReadError::Crs`] where no accurate transformation is known,
    /// [`ReadError::HeightUnit`] where the unit of levels is not known.
    pub fn into_crs(mut self, target: &Crs) -> Result<Self, ReadError> {
        let has_footprints = self.buildings.iter().any(|b| b.footprint.is_some());
        if !has_footprints {
            return Ok(self);
        }
        let Some(from) = &self.crs else { return Err(ReadError::NoCrs { path: self.path }) };
        let failed = |source| ReadError::Crs { path: self.path.clone(), source };
        let transform = Transform::new(from, target).map_err(failed)?;
        let has_levels = self.buildings.iter().any(|b| b.levels.is_some());
        let unit_m = if has_levels { height_unit_m(&self.path, from)? } else { 1.0 };
        for building in &mut self.buildings {
            building.levels = building.levels.map(|levels| levels.scaled(unit_m));
            if let Some(footprint) = &building.footprint {
                let moved = footprint.try_map_coords(|p| transform.point(p.x, p.y).map(|(x, y)| Coord { x, y }));
                building.footprint = Some(moved.map_err(failed)?);
            }
        }
        self.crs = Some(target.clone());
        Ok(self)
    }
}

impl FoundBuilding {
    /// A feature with its id from an attribute, or else its number in the layer.
    fn from_feature(feature: Feature, id_field: Option<&str>) -> Self {
        let stated = id_field.and_then(|field| feature.attributes.get(field)).filter(|id| !id.is_null());
        let id = match stated {
            Some(stated) => plain_text(stated),
            None => feature.fid.map_or_else(String::new, |fid| fid.to_string()),
        };
        let footprint = match feature.geometry {
            FeatureGeometry::Shape(Geometry::Polygon(polygon)) => Some(MultiPolygon::new(vec![polygon])),
            FeatureGeometry::Shape(Geometry::MultiPolygon(polygons)) => Some(polygons),
            FeatureGeometry::Shape(_) | FeatureGeometry::Missing | FeatureGeometry::Unsupported(_) => None,
        };
        // Corners that are no numbers enclose nothing.
        let is_number = |c: Coord<f64>| c.x.is_finite() && c.y.is_finite();
        let footprint = footprint.filter(|footprint| footprint.coords_iter().all(is_number));
        let part_of = feature.attributes.get("part_of").and_then(Value::as_str);
        let part_of = part_of.filter(|whole| !whole.is_empty()).map(str::to_owned);
        Self { id, part_of, footprint, levels: None, attributes: feature.attributes }
    }
}

/// Metres per unit of the levels in a file.
///
/// # Errors
/// [`ReadError::HeightUnit`] where positions are in feet and nothing is said of heights.
pub fn height_unit_m(path: &Path, crs: &Crs) -> Result<f64, ReadError> {
    match crs.height_unit_m() {
        Some(unit_m) => Ok(unit_m),
        None if crs.is_metric() => Ok(1.0),
        None => Err(ReadError::HeightUnit { path: path.to_owned() }),
    }
}

/// Whether levels and footprints measured in a CRS are metres.
///
/// # Errors
/// As [`height_unit_m`]; [`ReadError::Feet`] where they are feet.
fn require_metres(path: &Path, crs: &Crs) -> Result<(), ReadError> {
    let unit_m = height_unit_m(path, crs)?;
    if crs.is_metric() && unit_m == 1.0 {
        return Ok(());
    }
    Err(ReadError::Feet { path: path.to_owned(), crs: crs.to_string() })
}

/// The layer, and the name of the attribute that holds the id.
fn open_layer(path: &Path, options: &ReadOptions<'_>) -> Result<(VectorLayer, Option<String>), ReadError> {
    let layer = match VectorLayer::open(path, options.layer) {
        Err(several @ VectorError::Layer { .. }) if options.layer.is_none() => {
            OWN_LAYERS.iter().find_map(|name| VectorLayer::open(path, Some(name)).ok()).ok_or(several)?
        }
        opened => opened?,
    };
    let fields: Vec<String> = layer.field_names().map(str::to_owned).collect();
    let has = |name: &str| fields.iter().any(|field| field == name);
    let id_field = match options.id_field {
        Some(field) if !has(field) => {
            let (path, field) = (path.to_owned(), field.to_owned());
            return Err(ReadError::NoField { path, field, what: "id", available: fields });
        }
        Some(field) => Some(field),
        None => ID_FIELDS.into_iter().find(|name| has(name)),
    };
    let id_field = id_field.map(str::to_owned);
    Ok((layer, id_field))
}

/// Refuses a folder of 3D Tiles or a file of it, which GDAL would refuse without a word of what it is.
fn require_readable(path: &Path) -> Result<(), ReadError> {
    let is_tileset = path.join("tileset.json").is_file() || path.file_name().is_some_and(|name| name == "tileset.json");
    let is_tile = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("b3dm"));
    if is_tileset || is_tile { Err(ReadError::Tiles3d { path: path.to_owned() }) } else { Ok(()) }
}

/// Whether a path names a sequence.
pub(super) fn is_sequence(path: &Path) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case("jsonl"))
}

fn is_cityjson(path: &Path) -> Result<bool, OutputError> {
    let is_json = path.extension().is_some_and(|found| found.eq_ignore_ascii_case("json"));
    // GeoJSON shares the extension; the name is near the start in practice, but may be anywhere.
    let holds_city = || contains(path, b"\"CityObjects\"").map_err(FileError::on("cannot read", path));
    Ok(is_sequence(path) || (is_json && holds_city()?))
}

/// Whether a file holds some bytes, read piece by piece.
fn contains(path: &Path, needle: &[u8]) -> std::io::Result<bool> {
    let mut file = std::fs::File::open(path)?;
    let mut window = Vec::with_capacity((1 << 20) + needle.len());
    loop {
        // The end of the piece before stays, in case the needle lies across.
        let kept = window.len().min(needle.len() - 1);
        window.drain(..window.len() - kept);
        if std::io::Read::by_ref(&mut file).take(1 << 20).read_to_end(&mut window)? == 0 {
            return Ok(false);
        }
        if window.windows(needle.len()).any(|bytes| bytes == needle) {
            return Ok(true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_stands_for_the_result_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let none = result_file(folder.path(), RESULTS).unwrap_err().to_string();
        assert!(none.contains("holds no result") && none.contains("city.city.json"), "{none}");
        std::fs::write(at("city.gpkg"), "").unwrap();
        assert_eq!(result_file(folder.path(), RESULTS).unwrap(), at("city.gpkg"));
        assert!(result_file(folder.path(), CITYJSON_RESULTS).is_err());
        std::fs::write(at("city.city.json"), "").unwrap();
        assert_eq!(result_file(folder.path(), RESULTS).unwrap(), at("city.city.json"));
        assert_eq!(result_file(&at("a.city.json"), RESULTS).unwrap(), at("a.city.json"), "files are named as before");
        let layer = folder.path().join("layer");
        std::fs::create_dir(&layer).unwrap();
        std::fs::write(layer.join("a.shp"), "").unwrap();
        assert_eq!(result_file(&layer, RESULTS).unwrap(), layer, "a folder that GDAL reads");
    }

    #[test]
    fn a_city_in_feet_is_refused_and_one_in_metres_is_not() {
        let check = |definition: &str| require_metres(Path::new("a.city.json"), &Crs::parse(definition).unwrap());
        assert!(check("EPSG:7415").is_ok() && check("EPSG:28992").is_ok());
        assert!(matches!(check("EPSG:2263"), Err(ReadError::HeightUnit { .. })), "nothing is said of heights");
        for feet in ["EPSG:2263+6360", "EPSG:32118+6360", "EPSG:2263+5703"] {
            assert!(matches!(check(feet), Err(ReadError::Feet { .. })), "{feet}");
        }
    }
}
