//! The files that stages are made from, by what they hold: parts of their recipes.
//!
//! What a file holds is known from `stages/hashes.json` while its size, inode and times are those at which it was hashed, so
//! that a run that starts late reads no photo to learn that none has changed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::settings::{FootprintSettings, HeightSettings, SurveySettings};
use super::{Stage, footprints};
use crate::config::ResultFolder;
use crate::recipe::{ABSENT, Recipe};
use sizeup_footprints::FootprintSource;
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::source;
use sizeup_geo::hashes::Hashes;
use sizeup_photos::prior::PriorConfig;
use sizeup_survey::{Survey, View, ViewKind};

/// Files that the stages are made from.
#[derive(Debug, Clone)]
pub(super) struct StageFiles<'a> {
    pub folder: ResultFolder<'a>,
    pub survey: SurveySettings<'a>,
    pub footprints: FootprintSettings<'a>,
    pub heights: HeightSettings<'a>,
}

impl StageFiles<'_> {
    /// Adds the files that a stage and those before it are made from to its recipe.
    pub fn add(&self, recipe: &mut Recipe, stage: Stage, survey: &Survey) {
        let files: Vec<(&str, PathBuf)> = self.files(stage, survey).into_iter().collect();
        let (path, hashes) = (self.folder.stage_file("hashes.json"), Hashes::new());
        hashes.load(&path);
        let sha256 = |path: &Path| hashes.of(path).map_or_else(|_| ABSENT.to_owned(), |content| content.sha256);
        let hashed: Vec<String> = files.par_iter().map(|(_, path)| sha256(path)).collect();
        for ((role, path), sha256) in files.iter().zip(hashed) {
            recipe.add(format!("{role} {}", self.folder.saved(path).display()), sha256);
        }
        if hashes.n_bytes_read() > 0
            && let Err(error) = keep(&hashes, &path)
        {
            // Then they are read again the next time.
            tracing::warn!("{error}");
        }
    }

    fn files(&self, stage: Stage, survey: &Survey) -> BTreeSet<(&'static str, PathBuf)> {
        let Self { survey: poses, footprints, heights, .. } = self;
        let prior = heights.prior;
        let mut files = BTreeSet::new();
        let of_poses = files_of(&poses.config.path);
        files.extend(of_poses.into_iter().filter(|path| path.is_file()).map(|path| ("survey", path)));
        let photos = |is_read: &dyn Fn(&View) -> bool| -> Vec<(&'static str, PathBuf)> {
            let read = survey.views.iter().filter(|view| is_read(view));
            read.filter_map(|view| Some(("photo", view.image.clone()?))).collect()
        };
        if poses.is_aligned || poses.from_photos {
            files.extend(photos(&|_| true));
        }
        if stage >= Stage::Footprints {
            let layers = footprints::files(footprints.source, survey);
            files.extend(layers.iter().flat_map(|path| source::files_of(path)).map(|path| ("footprints", path)));
            files
                .extend(poses.terrain.dtm.iter().flat_map(|path| source::files_of(path)).map(|path| ("terrain", path)));
            let makes_dtm = footprints.ground.squares.is_some();
            let finds = matches!(footprints.source, FootprintSource::Network(_));
            if finds {
                let of_each = prior.file_of_each(&survey.views).unwrap_or_default();
                let nadir = survey.views.iter().zip(of_each).filter(|(view, _)| view.kind() == ViewKind::Nadir);
                let files_of_depth = prior.shared_files().into_iter().chain(nadir.filter_map(|(_, path)| path));
                files.extend(files_of_depth.map(|path| ("depth", path)));
            }
            files.extend(photos(&|view| makes_dtm || (finds && view.kind() == ViewKind::Nadir)));
        }
        if stage >= Stage::Heights {
            files.extend(prior.shared_files().into_iter().map(|path| ("prior", path)));
            // Settings that cannot work are refused where priors are read.
            let priors = prior.file_of_each(&survey.views).unwrap_or_default();
            let from_all = matches!(*prior.chosen(), PriorConfig::Stereo(_));
            let of_views = survey.views.iter().zip(priors);
            let kind = survey.kind_for_heights();
            let used = of_views.filter(|(view, _)| from_all || view.kind() == kind);
            files.extend(used.filter_map(|(_, path)| Some(("prior", path?))));
            files.extend(photos(&|view| heights.reads_photo(view)));
        }
        files
    }
}

fn keep(hashes: &Hashes, path: &Path) -> Result<(), FileError> {
    let all = hashes.paths();
    hashes.save(path, all.iter().map(PathBuf::as_path))
}

/// The file itself, or the files of a folder.
#[must_use]
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    match std::fs::read_dir(path) {
        Ok(entries) => entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|p| p.is_file()).collect(),
        Err(_) => vec![path.to_owned()],
    }
}
