//! What lies in a folder: files by what they may be, from their names alone.

use std::fs;
use std::path::{Path, PathBuf};

use super::InitError;
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_survey::{POSE_EXTENSIONS, is_photo, is_result};

/// Folders nested deeper than this below the one that is named are not looked into: `flight/1_initial/params` is two deep.
const MAX_DEPTH: usize = 3;
/// Folders in which photogrammetry leaves copies of photos, textures and thumbnails, lower case.
const PASSED_OVER: [&str; 14] = [
    "undistorted",
    "dense",
    "stereo",
    "submodels",
    "odm_texturing",
    "odm_texturing_25d",
    "odm_meshing",
    "odm_filterpoints",
    "entwine_pointcloud",
    "thumbnails",
    "thumbs",
    "prior-cache",
    "masks",
    "__macosx",
];
/// Extensions of layers that may hold footprints.
const LAYERS: [&str; 7] = ["gpkg", "geojson", "shp", "fgb", "gml", "osm", "pbf"];
/// Extensions of rasters that may hold the ground.
const RASTERS: [&str; 5] = ["tif", "tiff", "asc", "img", "hgt"];
/// Extensions of videos, in lower case.
const VIDEOS: [&str; 8] = ["mp4", "mov", "avi", "mkv", "m4v", "mts", "lrv", "lrf"];

/// Files that may be of use in a folder, each list sorted.
#[derive(Debug, Default)]
pub(super) struct Inventory {
    /// The folder that was looked into.
    pub root: PathBuf,
    /// It and the folders below it.
    pub folders: Vec<PathBuf>,
    /// Pictures that are no maps.
    pub photos: Vec<PathBuf>,
    /// Files that may hold poses.
    pub poses: Vec<PathBuf>,
    /// Files that may hold footprints.
    pub layers: Vec<PathBuf>,
    /// Files that may hold the ground.
    pub rasters: Vec<PathBuf>,
    /// Number of videos.
    pub n_videos: usize,
    /// Number of all files.
    pub n_files: usize,
}

impl Inventory {
    /// Looks into a folder, and at the layers and rasters beside it in `beside`.
    pub(super) fn of(root: &Path, beside: Option<&Path>) -> Result<Self, InitError> {
        let refuse = |found, hint| InitError::NoFolder { path: root.to_owned(), found, hint };
        if root.is_file() {
            return Err(refuse("a file", "name the folder that it lies in"));
        }
        if !root.is_dir() {
            return Err(refuse("nothing", "is the path right? It counts from the folder where the command is given"));
        }
        let mut found = Self { root: root.to_owned(), ..Self::default() };
        found.walk(root, 0)?;
        if let Some(beside) = beside {
            let mut around = Self::default();
            around.take_files(&entries(beside)?);
            found.layers.extend(around.layers);
            found.rasters.extend(around.rasters);
        }
        found.sort_maps_out();
        Ok(found)
    }

    fn walk(&mut self, folder: &Path, depth: usize) -> Result<(), InitError> {
        let entries = match entries(folder) {
            Ok(entries) => entries,
            // A folder that may not be read is somebody else's, unless it is the one that was named.
            Err(_) if depth > 0 => return Ok(()),
            Err(error) => return Err(error.into()),
        };
        if is_result(folder) {
            return Ok(());
        }
        self.folders.push(folder.to_owned());
        self.take_files(&entries);
        let below = entries.iter().filter(|path| path.is_dir() && depth < MAX_DEPTH && !is_passed_over(path));
        below.into_iter().try_for_each(|path| self.walk(path, depth + 1))
    }

    fn take_files(&mut self, entries: &[PathBuf]) {
        for path in entries.iter().filter(|path| path.is_file() && !name_of(path).starts_with('.')) {
            self.n_files += 1;
            let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
            let is_one_of = |known: &[&str]| known.contains(&extension.as_str());
            let lists = [
                (is_photo(path), &mut self.photos),
                (is_one_of(&POSE_EXTENSIONS), &mut self.poses),
                (is_one_of(&LAYERS), &mut self.layers),
                (is_one_of(&RASTERS), &mut self.rasters),
            ];
            lists.into_iter().filter(|(may_be, _)| *may_be).for_each(|(_, list)| list.push(path.clone()));
            self.n_videos += usize::from(is_one_of(&VIDEOS));
        }
    }

    /// A raster with a place on a map is no photo, and one without is no terrain.
    fn sort_maps_out(&mut self) {
        let may_be_photo = |path: &PathBuf| is_photo(path);
        self.rasters.retain(|path| !may_be_photo(path) || is_map(path));
        let rasters = &self.rasters;
        self.photos.retain(|path| !rasters.contains(path));
    }
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let failed = || FileError::on("cannot read folder", folder);
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed())? {
        paths.push(entry.map_err(failed())?.path());
    }
    paths.sort();
    Ok(paths)
}

fn is_map(path: &Path) -> bool {
    RasterFile::open(path).is_ok_and(|file| file.grid().is_ok())
}

fn is_passed_over(folder: &Path) -> bool {
    let name = name_of(folder).to_ascii_lowercase();
    name.starts_with('.') || PASSED_OVER.contains(&name.as_str())
}

/// The last part of a path as text.
pub(super) fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}
