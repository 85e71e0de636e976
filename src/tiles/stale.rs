//! What the plan, a tile and the merge would be made from now: compared with what they were made from, they are done or
//! stale ([`Recipe::why_stale`]).

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::TilesError;
use super::attempt::Attempt;
use super::manifest::{Common, Done, Layout, Manifest, Tile, TileViews, Tileset, fault_of, read_json};
use super::merge::Merged;
use super::status::{TileState, TileStatus};
use crate::pipeline::{RunSettings, files_of, photos_for_city_report};
use crate::recipe::{ABSENT, Recipe};
use crate::tiles::Lock;
use sizeup_geo::files::{FileError, is_virtual};
use sizeup_geo::geodata::source;
use sizeup_geo::hashes::{Content, Hashes};
use sizeup_results::output::sha256_hex;

/// How much of what earlier processes knew of files is believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Trust {
    /// Files whose size, inode and times are those at which they were hashed are taken as the same.
    #[default]
    Known,
    /// Nothing: every file is read.
    Nothing,
}

/// A plan beside the files that it was made from and what has been made of it.
pub struct StaleCheck<'a> {
    pub layout: &'a Layout,
    pub manifest: &'a Manifest,
    pub hashes: &'a Hashes,
    /// Settings that decide the result of a tile.
    of_part: Value,
}

/// Knowledge of files, from some lists that earlier processes left behind.
pub fn known<'a>(layout: &Layout, trust: Trust, of: impl Iterator<Item = &'a str>) -> Hashes {
    let hashes = Hashes::new();
    if trust == Trust::Known {
        of.for_each(|name| hashes.load(&layout.hashes(name)));
    }
    hashes
}

impl<'a> StaleCheck<'a> {
    pub fn new(layout: &'a Layout, manifest: &'a Manifest, hashes: &'a Hashes) -> Self {
        let of_part = RunSettings::of(&manifest.config).of_part().clone();
        Self { layout, manifest, hashes, of_part }
    }

    /// Why the plan is stale; `None` where it is not.
    pub fn plan(&self) -> Option<String> {
        self.wanted_plan().why_stale(&self.manifest.made_by)
    }

    fn wanted_plan(&self) -> Recipe {
        let config = &self.manifest.config;
        let inputs = self.manifest.inputs.iter().map(|file| (file.role.clone(), PathBuf::from(&file.path)));
        // A folder of poses may have got more, and so may what lies beside layers and terrain.
        let poses = files_of(&config.survey.path).into_iter().filter(|path| path.is_file());
        let sources = [("footprints", config.footprints.file()), ("terrain", config.terrain.dtm.clone())];
        let beside = sources.into_iter().flat_map(|(role, path)| {
            let files = path.map(|path| source::files_of(&path)).unwrap_or_default();
            files.into_iter().map(move |path| (role.to_owned(), path))
        });
        let poses = poses.map(|path| ("survey".to_owned(), path));
        let all: BTreeSet<(String, PathBuf)> = inputs.chain(poses).chain(beside).collect();
        let mut wanted = self.manifest.made_by.clone().by_this_program();
        for (role, path) in &all {
            wanted.add(part_name(role, path), self.sha256(path));
        }
        wanted
    }

    /// Recipe that a tile would be made from now.
    ///
    /// # Errors
    /// [`TilesError::Plan`] where its views are not those of the plan.
    pub fn tile(&self, tile: &Tile) -> Result<Recipe, TilesError> {
        Ok(self.tile_of(tile, &self.views(tile)?))
    }

    /// The views of a tile.
    ///
    /// # Errors
    /// [`TilesError::Plan`] where they are not those of the plan.
    pub fn views(&self, tile: &Tile) -> Result<TileViews, TilesError> {
        let path = self.layout.views(&tile.id);
        if self.sha256(&path) != tile.views_sha256 {
            return Err(TilesError::Plan {
                path,
                message: "it is not the one that the plan was written with".to_owned(),
            });
        }
        read_json(&path)
    }

    pub fn tile_of(&self, tile: &Tile, views: &TileViews) -> Recipe {
        let manifest = self.manifest;
        // Without photos the ground is not searched.
        let ground_spacing_m = (!views.photos.is_empty()).then_some(manifest.ground_spacing_m);
        let frame = (manifest.origin_m, manifest.heights_m, ground_spacing_m);
        let part = |of: &Option<Content>| of.as_ref().map_or_else(|| ABSENT.to_owned(), |part| part.sha256.clone());
        let mut recipe = Recipe::new(&self.of_part)
            .with("the frame", hash_of_text(&frame))
            .with("the tile's place", hash_of_text(&(tile.core, tile.halo)))
            .with("its views", &tile.views_sha256)
            .with("its footprints", &tile.reads.footprints.sha256)
            .with("its terrain", part(&tile.reads.terrain))
            .with("its reviews", part(&tile.reads.reviews));
        for (role, path) in files_of_tile(manifest, views) {
            recipe.add(part_name(role, &path), self.sha256(&path));
        }
        recipe
    }

    /// State of a tile.
    pub fn status(&self, tile: &Tile) -> TileStatus {
        let mut status = TileStatus::of(tile);
        status.runner = Lock::holder_of(&self.layout.lock(&tile.id));
        if status.runner.is_some() {
            status.state = TileState::Running;
            return status;
        }
        let done = self.layout.read_done(&tile.id);
        let why = match (self.tile(tile), &done) {
            (Err(error), _) => Some(error.to_string()),
            (Ok(wanted), done) => {
                status.input_sha256 = Some(wanted.sha256());
                done.as_ref().and_then(|done| self.why_not_done(&wanted, done))
            }
        };
        let attempt = Attempt::read(self.layout, &tile.id);
        (status.state, status.why) = match (done, why, attempt) {
            (Some(done), None, _) => {
                status.exit_code = Some(done.exit_code);
                (TileState::Done, None)
            }
            (_, _, Some(attempt)) => {
                (status.exit_code, status.n_tries) = (attempt.exit_code, attempt.n_tries);
                (TileState::Failed, Some(attempt.cause))
            }
            (Some(_), why, None) => (TileState::Stale, why),
            (None, why, None) => (TileState::Waiting, why),
        };
        status
    }

    /// Why a tile that was done is no longer; `None` where it is.
    pub fn why_not_done(&self, wanted: &Recipe, done: &Done) -> Option<String> {
        wanted.why_stale(&done.made_by).or_else(|| done.fault(self.layout, self.hashes))
    }

    /// Recipe that a merge of some tiles would be made from now.
    ///
    /// # Errors
    /// [`TilesError::Plan`] where the views of all cannot be read.
    pub fn merge(&self, done: &[Option<Done>], tileset: Tileset) -> Result<Recipe, TilesError> {
        let shared = [("the plan", self.layout.manifest()), ("what belongs to no tile", self.layout.common())];
        let mut recipe = Recipe::new(&serde_json::json!({ "tileset": tileset }));
        for (name, path) in shared {
            recipe.add(name, self.sha256(&path));
        }
        for (tile, done) in self.manifest.tiles.iter().zip(done) {
            let sha256 = done.as_ref().map_or_else(|| ABSENT.to_owned(), hash_of_text);
            recipe.add(format!("tile {}", tile.id), sha256);
        }
        // The list of photos; hashes of those that were read are kept beside the merged files.
        let common: Common = read_json(&self.layout.common())?;
        let photos = photos_for_city_report(&common.views);
        if self.manifest.config.output.report.page && !photos.is_empty() {
            recipe.add("the list of photos from above", hash_of_text(&photos));
        }
        Ok(recipe)
    }

    /// Why what was merged is not what would be merged now; `None` where it is.
    pub fn why_not_merged(&self, wanted: &Recipe, merged: &Merged) -> Option<String> {
        let folder = self.layout.folder();
        let changed = || {
            let mut photos = merged.photos.iter();
            photos.find(|(photo, sha256)| self.sha256(Path::new(photo)) != **sha256)
        };
        let outputs = || fault_of(folder, &merged.outputs, self.hashes);
        let photo = || changed().map(|(photo, _)| format!("photo {photo} has changed"));
        wanted.why_stale(&merged.made_by).or_else(outputs).or_else(photo)
    }

    /// Leaves what is known of a tile's files behind.
    ///
    /// # Errors
    /// [`FileError`] where it cannot be written.
    pub fn keep_hashes(&self, tile: &Tile, views: &TileViews, done: &Done) -> Result<(), FileError> {
        let folder = self.layout.tile(&tile.id);
        let outputs = done.outputs.keys().map(|name| folder.join(name));
        let read = files_of_tile(self.manifest, views).into_iter().map(|(_, path)| path);
        let files: Vec<PathBuf> = read.chain(outputs).chain([self.layout.views(&tile.id)]).collect();
        self.hashes.save(&self.layout.hashes(&tile.id), files.iter().map(PathBuf::as_path))
    }

    /// Leaves what is known of the plan's input and of what was merged behind.
    ///
    /// # Errors
    /// [`FileError`] where it cannot be written.
    pub fn keep_hashes_of_city(&self, merged: Option<&Merged>) -> Result<(), FileError> {
        let inputs = self.manifest.inputs.iter().map(|file| PathBuf::from(&file.path));
        let names = merged.into_iter().flat_map(|merged| merged.outputs.keys());
        let outputs = names.map(|name| self.layout.folder().join(name));
        let photos = merged.into_iter().flat_map(|merged| merged.photos.keys().map(PathBuf::from));
        let shared = [self.layout.manifest(), self.layout.common()];
        for (of, files) in
            [("plan", inputs.collect::<Vec<_>>()), ("city", outputs.chain(photos).chain(shared).collect())]
        {
            self.hashes.save(&self.layout.hashes(of), files.iter().map(PathBuf::as_path))?;
        }
        Ok(())
    }

    /// Hash of a file, or that it is not there.
    fn sha256(&self, path: &Path) -> String {
        self.hashes.of(path).map_or_else(|_| ABSENT.to_owned(), |content| content.sha256)
    }
}

/// Files that a tile is made from, apart from those that all tiles share.
fn files_of_tile(manifest: &Manifest, views: &TileViews) -> Vec<(&'static str, PathBuf)> {
    let shared = manifest.prior_files.iter().map(|path| ("prior", path.clone()));
    let priors = views.priors.iter().map(|path| ("prior", path.clone()));
    // Textures are of all photos that show the tile.
    let painted = views.views.iter().filter(|_| manifest.config.output.textures.enabled);
    let painted = painted.filter_map(|view| view.image.as_ref()).filter(|image| !is_virtual(image));
    let photos: BTreeSet<&PathBuf> = views.photos.iter().chain(painted).collect();
    let photos = photos.into_iter().map(|path| ("photo", path.clone()));
    shared.chain(priors).chain(photos).collect()
}

/// How a file is called among the parts of a recipe.
pub fn part_name(role: &str, path: &Path) -> String {
    format!("{role} {}", path.display())
}

fn hash_of_text(value: &impl serde::Serialize) -> String {
    sha256_hex(serde_json::json!(value).to_string().as_bytes())
}
