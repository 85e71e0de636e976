//! Opening files through GDAL: with the drivers that a file's extension names, and never over the network unless that is
//! allowed ([`crate::limits`]).
//!
//! GDAL itself goes by content: text named `dtm.tif` may be the description of a map server, which it then asks. And files
//! may refer to others (VRT), which it opens with whatever driver fits. So, unless remote input is allowed,
//!
//! * every driver but those of common file formats is taken out of GDAL, for the whole process;
//! * GDAL's file systems of servers see no file, whoever asks for one.

use std::path::{Path, PathBuf};
use std::sync::{Once, OnceLock};

use gdal::config::set_config_option;
use gdal::{Dataset, DatasetOptions, Driver, DriverManager, GdalOpenFlags, Metadata as _};

use crate::limits::Limits;

/// Drivers of formats that are files, read or written; none of them asks a server by itself.
const LOCAL: &[&str] = &[
    "AAIGrid",
    "AIG",
    "Arrow",
    "BMP",
    "BT",
    "COG",
    "CSV",
    "DTED",
    "DXF",
    "EHdr",
    "ENVI",
    "ESRI Shapefile",
    "ESRIJSON",
    "ERS",
    "FlatGeobuf",
    "GML",
    "GPKG",
    "GPX",
    "GRASSASCIIGrid",
    "GS7BG",
    "GSAG",
    "GSBG",
    "GTiff",
    "GeoJSON",
    "GeoJSONSeq",
    "HFA",
    "ISIS3",
    "JP2OpenJPEG",
    "JPEG",
    "KML",
    "LIBERTIFF",
    "LIBKML",
    "MBTiles",
    "MEM",
    "MapInfo File",
    "Memory",
    "OSM",
    "OpenEXR",
    "OpenFileGDB",
    "PNG",
    "PNM",
    "Parquet",
    "SQLite",
    "SRTMHGT",
    "TopoJSON",
    "USGSDEM",
    "VRT",
    "WEBP",
    "XYZ",
];
/// Extensions of drivers that GDAL has not on record.
const MORE_EXTENSIONS: [(&str, &str); 3] = [("AIG", "adf"), ("GTiff", "dng"), ("CSV", "tsv")];
/// Drivers of formats that are folders or archives: their paths have no telling extension.
const FOLDERS: [&str; 4] = ["AIG", "ESRI Shapefile", "GPKG", "OpenFileGDB"];
/// Drivers of pictures that refer to no other file: photos are read as any of them, whichever the survey's names say.
const PICTURES: [&str; 5] = ["BMP", "GTiff", "JPEG", "PNG", "WEBP"];
/// GDAL's file systems of servers.
const SERVERS: [&str; 9] = ["curl", "s3", "gs", "az", "adls", "oss", "swift", "hdfs", "webhdfs"];

/// Kind of file to be opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DatasetKind {
    /// A raster: cells in bands.
    Raster,
    /// Layers of vector features.
    Vector,
}

/// Why a path is not given to GDAL.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// It is on a server.
    #[error("{} is on a server\nhint: `--allow-remote`, or `allow_remote = true` in `[limits]`, lets sizeup ask it", path.display())]
    Remote {
        /// Address that was to be opened.
        path: PathBuf,
    },
    /// Nothing reads files of that name.
    #[error(
        "{}: no format of {what} has the extension {extension:?}\n\
         hint: files are read as what their extension says; rename it, or convert it with GDAL (a .vrt of layers, and what asks \
         servers, only with `--allow-remote`)",
        path.display()
    )]
    Extension {
        /// Path that was to be opened.
        path: PathBuf,
        /// Kind that was looked for: `rasters` or `layers`.
        what: &'static str,
        /// Extension of the path, as it is written.
        extension: String,
    },
}

/// Why a file is not open.
pub(super) enum OpenError {
    Refused(Refusal),
    Gdal(gdal::errors::GdalError),
}

/// Opens a file for reading.
pub(super) fn open(path: &Path, kind: DatasetKind) -> Result<Dataset, OpenError> {
    open_with(path, kind, &[])
}

/// As [`open`], with options of the file's driver.
pub(super) fn open_with(path: &Path, kind: DatasetKind, options: &[&str]) -> Result<Dataset, OpenError> {
    crate::gdal_log::route_messages();
    shut_doors();
    may_be_asked(path).map_err(OpenError::Refused)?;
    let drivers = drivers_for(path, kind);
    if drivers.is_empty() {
        let what = if kind == DatasetKind::Raster { "rasters" } else { "layers" };
        let (path, extension) = (path.to_owned(), extension(path));
        return Err(OpenError::Refused(Refusal::Extension { path, what, extension }));
    }
    let open_flags = match kind {
        DatasetKind::Raster => GdalOpenFlags::GDAL_OF_RASTER,
        DatasetKind::Vector => GdalOpenFlags::GDAL_OF_VECTOR,
    } | GdalOpenFlags::GDAL_OF_VERBOSE_ERROR;
    let open_options = (!options.is_empty()).then_some(options);
    let options =
        DatasetOptions { open_flags, allowed_drivers: Some(&drivers), open_options, ..DatasetOptions::default() };
    Dataset::open_ex(path, options).map_err(OpenError::Gdal)
}

/// Holds a path against what input may ask of servers.
///
/// # Errors
/// [`Refusal::Remote`] for one that is on a server where that is not allowed.
pub fn may_be_asked(path: &Path) -> Result<(), Refusal> {
    let is_refused = !Limits::now().allow_remote && is_remote(path);
    if is_refused { Err(Refusal::Remote { path: path.to_owned() }) } else { Ok(()) }
}

/// Whether a path leads to a server, also from within an archive.
fn is_remote(path: &Path) -> bool {
    let text = path.to_string_lossy().to_ascii_lowercase();
    let is_server = |place: &str| SERVERS.iter().any(|server| place.starts_with(server));
    text.contains("://") || text.split("/vsi").skip(1).any(is_server)
}

/// The extension as it stands, lower case; empty without one.
fn extension(path: &Path) -> String {
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_ascii_lowercase())
}

/// The drivers that a path's extension names.
fn drivers_for(path: &Path, kind: DatasetKind) -> Vec<&'static str> {
    let extension = extension(path);
    let is_container = extension == "zip" || (extension.is_empty() && path.is_dir());
    let fits = |format: &&DriverFormats| match kind {
        DatasetKind::Raster => format.is_raster,
        DatasetKind::Vector => format.is_vector,
    };
    let named = |format: &DriverFormats| format.extensions.contains(&extension);
    let is_picture = formats().iter().any(|format| PICTURES.contains(&format.name.as_str()) && named(format));
    let names_it = |format: &&DriverFormats| {
        let name = format.name.as_str();
        named(format) || (is_picture && PICTURES.contains(&name)) || (is_container && FOLDERS.contains(&name))
    };
    formats().iter().filter(fits).filter(names_it).map(|format| format.name.as_str()).collect()
}

/// Formats that one of GDAL's drivers reads.
struct DriverFormats {
    name: String,
    extensions: Vec<String>,
    is_raster: bool,
    is_vector: bool,
}

/// GDAL's drivers, as many as there are when the first file is opened.
fn formats() -> &'static [DriverFormats] {
    static FORMATS: OnceLock<Vec<DriverFormats>> = OnceLock::new();
    FORMATS.get_or_init(|| DriverManager::all().map(|driver| format_of(&driver)).collect())
}

fn format_of(driver: &Driver) -> DriverFormats {
    let item = |key: &str| driver.metadata_item(key, "").unwrap_or_default();
    let name = driver.short_name();
    let more = MORE_EXTENSIONS.iter().filter(|(of, _)| *of == name).map(|(_, extension)| (*extension).to_owned());
    let listed = format!("{} {}", item("DMD_EXTENSIONS"), item("DMD_EXTENSION")).to_ascii_lowercase();
    let extensions = listed.split_whitespace().map(str::to_owned).chain(more).collect();
    let is = |key: &str| item(key) == "YES";
    DriverFormats { name, extensions, is_raster: is("DCAP_RASTER"), is_vector: is("DCAP_VECTOR") }
}

/// Closes the ways to servers, before the first file is opened.
fn shut_doors() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        if Limits::now().allow_remote {
            return;
        }
        let strangers: Vec<Driver> =
            DriverManager::all().filter(|driver| !LOCAL.contains(&driver.short_name().as_str())).collect();
        strangers.iter().for_each(DriverManager::deregister_driver);
        // No name ends in this, so nothing is on any server.
        let options =
            [("CPL_VSIL_CURL_ALLOWED_EXTENSIONS", ".remote-input-is-not-allowed"), ("GML_DOWNLOAD_WFS_SCHEMA", "NO")];
        for (key, value) in options {
            // Fails only for a name with a NUL byte.
            let _ = set_config_option(key, value);
        }
    });
}
