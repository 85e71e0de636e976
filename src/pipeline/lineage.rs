//! Origin of results: program, settings and the files that a run read.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::contents::files_of;
use super::settings::Origin;
use super::{HeightStage, PipelineError, RunSettings, footprints};
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::source;
use sizeup_photos::prior::Priors;
use sizeup_results::output::{InputFile, Lineage};
use sizeup_survey::{Survey, flight_day};

/// Origin of a run's results: the files that it read, and its settings.
pub(super) fn lineage(
    settings: &RunSettings<'_>,
    command: &str,
    survey: &Survey,
    heights: &HeightStage,
    priors: &Priors,
) -> Result<Lineage, PipelineError> {
    let mut files: BTreeSet<(&str, PathBuf)> = BTreeSet::new();
    files.extend(files_of(&settings.survey.config.path).into_iter().map(|path| ("survey", path)));
    let footprint_files = footprints::files(settings.footprints.source, survey);
    files.extend(footprint_files.iter().flat_map(|path| source::files_of(path)).map(|path| ("footprints", path)));
    files.extend(
        settings
            .footprints
            .ground
            .terrain
            .dtm
            .iter()
            .flat_map(|path| source::files_of(path))
            .map(|path| ("terrain", path)),
    );
    files.extend(settings.reviews.iter().map(|reviews| ("reviews", reviews.path.clone())));
    for &view in &heights.solution.used_views {
        files.extend(priors.file_of(&survey.views[view])?.map(|path| ("prior", path)));
    }
    let hashed = |(role, path): &(&str, PathBuf)| -> Result<InputFile, FileError> {
        let path_saved = settings.output.folder.saved(path).display().to_string();
        Ok(InputFile { path: path_saved, ..InputFile::hash(role, path)? })
    };
    let inputs: Result<Vec<InputFile>, FileError> =
        files.iter().filter(|(_, path)| path.is_file()).map(hashed).collect();
    let photos = survey.views.iter().filter_map(|view| view.image.as_ref());
    Ok(settings.origin.lineage(command, inputs?).of_day(|| flight_day(photos)))
}

impl Origin<'_> {
    /// Lineage of a result that was made from some files.
    #[must_use]
    pub fn lineage(&self, command: &str, inputs: Vec<InputFile>) -> Lineage {
        let crs = &self.project.crs;
        let vertical = self.project.vertical_reference.clone();
        Lineage {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: crate::recipe::commit().map(str::to_owned),
            command: command.to_owned(),
            config_sha256: self.config_sha256.clone(),
            inputs,
            crs: crs.definition().to_owned(),
            vertical_reference: vertical
                .or_else(|| crs.vertical_name().map(str::to_owned))
                .unwrap_or_else(|| "not stated".to_owned()),
            height_definition: format!(
                "roof level minus ground level; ground level: {}; roof level: mean over the roof",
                serde_json::to_string(&self.ground.reference).unwrap_or_default().trim_matches('"')
            ),
            seed: self.seed,
            reference_date: self.project.reference_date.clone(),
            source: None,
        }
    }
}
