//! The files of the contract: `tiles.json`, what lies in `tiles/`, and the word that a tile is done.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::TilesError;
use crate::config::RunConfig;
use crate::pipeline::{Frame, PartHashes};
use crate::recipe::Recipe;
use sizeup_footprints::RefusedFootprint;
use sizeup_geo::files::{FileError, remove_litter};
use sizeup_geo::hashes::{Content, Hashes};
use sizeup_geo::issue::Issue;
use sizeup_geo::paths;
use sizeup_geo::terrain::MapBox;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::ids::ViewId;
use sizeup_heights::scene::HeightBounds;
use sizeup_results::output::tiles3d::Heights;
use sizeup_results::output::{InputFile, Status};
use sizeup_survey::View;

/// Plan of a city.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Recipe that it was made from.
    pub made_by: Recipe,
    /// Origin of the local frame that all tiles share, map frame, metres.
    pub origin_m: [f64; 3],
    /// Least and greatest height that is looked for, metres.
    pub heights_m: [f32; 2],
    /// Distance between the places where the photos are searched for ground, metres.
    pub ground_spacing_m: f64,
    /// Width of the halo, metres.
    pub halo_m: f64,
    /// Distance around a core within which views are taken in, metres.
    pub view_margin_m: f64,
    /// The configuration, paths resolved.
    pub config: RunConfig,
    /// Treatment of heights in the merge.
    pub tileset: Tileset,
    /// Files that all tiles share, with their hashes at the time of the plan.
    pub inputs: Vec<InputFile>,
    /// Files that all priors depend on: a network's graph and its weights.
    pub prior_files: Vec<PathBuf>,
    /// Features whose ids are not what their attribute says, by the layer's own number.
    pub renamed: BTreeMap<u64, String>,
    /// Buildings with a footprint.
    pub n_buildings: usize,
    /// Views with a usable pose.
    pub n_views: usize,
    /// In the order in which they are merged.
    pub tiles: Vec<Tile>,
}

/// Whether the city gets 3D Tiles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tileset {
    /// No 3D Tiles were written.
    LeftOut,
    /// With heights that are this.
    Written(Heights),
}

/// One tile of the plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tile {
    /// Name, unique in the plan.
    pub id: String,
    /// Whose buildings it writes.
    pub core: MapBox,
    /// Whose buildings it solves.
    pub halo: MapBox,
    /// Buildings of the core.
    pub n_buildings: usize,
    /// Buildings of core and halo.
    pub n_solved: usize,
    /// Views that show the core or its surroundings.
    pub n_views: usize,
    /// Estimate of the memory it needs, megabytes.
    pub memory_mb: u64,
    /// Hash of its `views.json`.
    pub views_sha256: String,
    /// Hashes of what it reads of the files that all tiles share.
    pub reads: PartHashes,
}

/// The views of a tile, poses in the project's CRS.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct TileViews {
    /// In the order of the survey.
    pub views: Vec<View>,
    /// Their positions in the whole survey, where a prior's name depends on them; else empty, so that a photo more
    /// elsewhere changes nothing here.
    pub positions: Vec<usize>,
    /// Files that their priors are made from, sorted.
    pub priors: BTreeSet<PathBuf>,
    /// Photos that are read for roofs and ground, sorted.
    pub photos: BTreeSet<PathBuf>,
}

impl TileViews {
    /// Positions of the views by their names.
    #[must_use]
    pub fn positions_by_name(&self) -> HashMap<ViewId, usize> {
        self.views.iter().zip(&self.positions).map(|(view, &at)| (view.id.clone(), at)).collect()
    }
}

/// Records of the city that belong to none of its tiles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Common {
    /// Every view of the survey.
    pub views: Vec<View>,
    /// Buildings without a usable footprint.
    pub refused: Vec<RefusedFootprint>,
    /// Issues of poses and footprints.
    pub issues: Vec<Issue>,
}

/// The word that a tile is done, written last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// Id of the tile.
    pub tile: String,
    /// Everything that it was made from.
    pub made_by: Recipe,
    /// Files by name, with their hashes.
    pub outputs: BTreeMap<String, String>,
    /// Buildings that it writes.
    pub n_buildings: usize,
    /// Buildings with a height.
    pub n_heights: usize,
    /// Buildings by what became of them.
    pub by_status: BTreeMap<Status, usize>,
    /// Views whose prior was used.
    pub n_used_views: usize,
    /// 0, or 5 where some buildings or photos have no result.
    pub exit_code: u8,
}

/// Paths of a city's files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    folder: PathBuf,
}

impl Layout {
    /// In the folder of the results.
    #[must_use]
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// The folder of the results.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Path of the plan, `tiles.json`.
    #[must_use]
    pub fn manifest(&self) -> PathBuf {
        self.folder.join("tiles.json")
    }

    /// Path of what belongs to no tile.
    #[must_use]
    pub fn common(&self) -> PathBuf {
        self.folder.join("tiles").join("common.json")
    }

    /// Path of a tile's folder.
    #[must_use]
    pub fn tile(&self, id: &str) -> PathBuf {
        self.folder.join("tiles").join(id)
    }

    /// Path of a tile's views.
    #[must_use]
    pub fn views(&self, id: &str) -> PathBuf {
        self.tile(id).join("views.json")
    }

    /// The word that a tile is done.
    #[must_use]
    pub fn done(&self, id: &str) -> PathBuf {
        self.folder.join("tiles").join(format!("{id}.done.json"))
    }

    /// Path of the outcome of the last try to run a tile that has not come to its end.
    #[must_use]
    pub fn attempt(&self, id: &str) -> PathBuf {
        self.folder.join("tiles").join(format!("{id}.try.json"))
    }

    /// Path of what is known of the files that something was made from: a tile, the `"plan"`, or the `"city"`.
    #[must_use]
    pub fn hashes(&self, of: &str) -> PathBuf {
        self.folder.join("tiles").join("hashes").join(format!("{of}.json"))
    }

    /// Path of what is settled once for the city.
    #[must_use]
    pub fn frame(&self) -> PathBuf {
        self.folder.join("tiles").join("frame.json")
    }

    /// The lock of a tile, or of the whole (`"city"`).
    #[must_use]
    pub fn lock(&self, of: &str) -> PathBuf {
        self.folder.join("tiles").join("locks").join(of)
    }

    /// Result of the merge.
    #[must_use]
    pub fn merged(&self) -> PathBuf {
        self.folder.join("city.done.json")
    }

    /// Reads the plan, whichever program made it.
    ///
    /// # Errors
    /// [`TilesError::Plan`] where there is none, or none that this program can read.
    pub fn read_manifest(&self) -> Result<Manifest, TilesError> {
        let path = self.manifest();
        let manifest: Manifest = read_json(&path)?;
        if let Some(tile) = manifest.tiles.iter().find(|tile| paths::single(&tile.id).is_none()) {
            let message = format!("a tile is called {:?}: expected the name of a folder below tiles/", tile.id);
            return Err(TilesError::Plan { path, message });
        }
        Ok(manifest)
    }

    /// Reads the word that a tile is done; `None` where there is none, or not a whole one.
    #[must_use]
    pub fn read_done(&self, id: &str) -> Option<Done> {
        let done: Done = read_json(&self.done(id)).ok()?;
        let names_its_own = done.tile == id && done.outputs.keys().all(|name| paths::within(name).is_some());
        names_its_own.then_some(done)
    }
}

impl Manifest {
    /// The tile of this name.
    ///
    /// # Errors
    /// [`TilesError::NoSuchTile`].
    pub fn tile(&self, id: &str) -> Result<&Tile, TilesError> {
        let found = self.tiles.iter().find(|tile| tile.id == id);
        found.ok_or_else(|| TilesError::NoSuchTile { id: id.to_owned() })
    }

    /// Frame that all tiles share.
    #[must_use]
    pub fn frame(&self) -> Frame {
        let [min_m, max_m] = self.heights_m;
        Frame {
            origin: LocalOrigin(self.origin_m.into()),
            bounds: HeightBounds { min_m, max_m },
            ground_spacing_m: self.ground_spacing_m,
        }
    }
}

impl Done {
    /// The first of the tile's files that is not the one that was written, and what is the matter with it.
    #[must_use]
    pub fn fault(&self, layout: &Layout, hashes: &Hashes) -> Option<String> {
        fault_of(&layout.tile(&self.tile), &self.outputs, hashes)
    }
}

/// The first of some files, by name and hash, that is not the one that was written, and what is the matter with it.
pub(super) fn fault_of(folder: &Path, files: &BTreeMap<String, String>, hashes: &Hashes) -> Option<String> {
    if let Some(name) = files.keys().find(|name| paths::within(name).is_none()) {
        return Some(format!("damaged: it names {name:?}, which is no file of its folder"));
    }
    files.iter().find_map(|(name, sha256)| match hashes.of(&folder.join(name)) {
        Ok(found) if found.sha256 == *sha256 => None,
        Ok(_) => Some(format!("damaged: {name} is not the file that was written")),
        Err(_) => Some(format!("damaged: {name} is missing")),
    })
}

/// Reads one of the plan's files.
pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, TilesError> {
    let unusable = |message: String| TilesError::Plan { path: path.to_owned(), message };
    let file = File::open(path).map_err(|e| unusable(e.to_string()))?;
    serde_json::from_reader(BufReader::new(file)).map_err(|e| unusable(e.to_string()))
}

/// SHA-256 of a file, hexadecimal.
pub(super) fn hash_of(path: &Path) -> Result<String, FileError> {
    Content::of(path).map(|content| content.sha256).map_err(FileError::on("cannot read", path))
}

/// Removes what a writer that was killed left in a folder: only for those who hold its lock.
pub(super) fn sweep_litter(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(".partial-") {
            remove_litter(&entry.path());
        }
    }
}
