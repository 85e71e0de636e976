//! Results of the stages on disk: a later run starts from them.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use geo_types::{LineString, Polygon};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::contents::StageFiles;
use super::recipes::Decisive;
use super::{FootprintStage, HeightStage, PipelineError, Stage};
use crate::recipe::Recipe;
use sizeup_geo::files::write_whole;
use sizeup_geo::terrain::GroundLevel;
use sizeup_survey::Survey;

#[derive(Serialize)]
struct WrittenArtefact<'a, T> {
    made_by: Recipe,
    data: &'a T,
}

#[derive(Deserialize)]
struct Read<T> {
    made_by: Recipe,
    data: T,
}

/// Results of a run's stages on disk, each with the recipe that it was made by.
#[derive(Debug, Clone)]
pub(super) struct Artefacts<'a> {
    pub decisive: Decisive,
    pub files: StageFiles<'a>,
}

impl Artefacts<'_> {
    fn path_of(&self, stage: Stage) -> PathBuf {
        self.files.folder.stage_file(format!("{}.json", stage.name()))
    }

    /// Recipe of a stage and those before it: settings, and the contents of their files.
    fn recipe(&self, stage: Stage, survey: &Survey) -> Recipe {
        let mut recipe = Recipe::new(&self.decisive.of_stage(stage));
        self.files.add(&mut recipe, stage, survey);
        recipe
    }

    /// Writes the result of a stage for a survey.
    pub fn write<T: Serialize>(&self, stage: Stage, survey: &Survey, data: &T) -> Result<(), PipelineError> {
        self.write_made_by(stage, self.recipe(stage, survey), data)
    }

    fn write_made_by<T: Serialize>(&self, stage: Stage, made_by: Recipe, data: &T) -> Result<(), PipelineError> {
        let written = WrittenArtefact { made_by, data };
        write_whole(&self.path_of(stage), |out| {
            serde_json::to_writer(&mut *out, &written)?;
            out.write_all(b"\n")
        })?;
        Ok(())
    }

    /// Reads the result of an earlier run of a stage, if its input is still the same and it holds together.
    pub fn read<T: DeserializeOwned + Coherent>(&self, stage: Stage, survey: &Survey) -> Result<T, PipelineError> {
        let read = self.read_any(stage)?;
        self.check(stage, &read, survey)?;
        Ok(read.data)
    }

    /// Writes a survey, its photos named from the folder of the results as in the configuration beside them.
    pub fn write_survey(&self, survey: &Survey) -> Result<(), PipelineError> {
        let mut saved = survey.clone();
        for path in saved.views.iter_mut().filter_map(|view| view.image.as_mut()) {
            *path = self.files.folder.saved(path);
        }
        // The recipe is of the files as they are found from here.
        self.write_made_by(Stage::Survey, self.recipe(Stage::Survey, survey), &saved)
    }

    /// Reads the survey of an earlier run, as [`Self::read`].
    pub fn read_survey(&self) -> Result<Survey, PipelineError> {
        let mut read: Read<Survey> = self.read_any(Stage::Survey)?;
        for path in read.data.views.iter_mut().filter_map(|view| view.image.as_mut()) {
            *path = self.files.folder.found(path);
        }
        self.check(Stage::Survey, &read, &read.data)?;
        Ok(read.data)
    }

    fn read_any<T: DeserializeOwned>(&self, stage: Stage) -> Result<Read<T>, PipelineError> {
        let file = File::open(self.path_of(stage)).map_err(|e| self.unusable(stage, e.to_string()))?;
        serde_json::from_reader(BufReader::new(file)).map_err(|e| self.unusable(stage, e.to_string()))
    }

    /// Refuses a result of another recipe than the present one, and one that does not hold together.
    fn check<T: Coherent>(&self, stage: Stage, read: &Read<T>, survey: &Survey) -> Result<(), PipelineError> {
        match self.recipe(stage, survey).why_stale(&read.made_by) {
            Some(why) => Err(self.unusable(stage, format!("stale: {why}"))),
            None => read.data.check().map_err(|why| self.unusable(stage, format!("altered: {why}"))),
        }
    }

    /// Reads heights and checks that their views and buildings are those of the survey and of the footprints.
    pub fn read_heights(&self, survey: &Survey, footprints: &FootprintStage) -> Result<HeightStage, PipelineError> {
        let heights: HeightStage = self.read(Stage::Heights, survey)?;
        match heights.misplaced(survey, footprints) {
            Some(why) => Err(self.unusable(Stage::Heights, format!("altered: {why}"))),
            None => Ok(heights),
        }
    }

    /// Error of an artefact that cannot be used.
    fn unusable(&self, stage: Stage, message: String) -> PipelineError {
        PipelineError::Artefact { path: self.path_of(stage), message, stage: stage.name() }
    }
}

/// Farther from the origin no projected CRS has land, metres.
const MOST_M: f64 = 1e8;
/// Largest difference of a rotation's determinant from 1.
const ROTATION_WITHIN: f64 = 1e-6;

/// Check of a run's file, which anybody may have altered: whatever later stages take for granted is held against it.
pub(super) trait Coherent {
    /// Says what does not fit.
    fn check(&self) -> Result<(), String>;
}

impl Coherent for Survey {
    fn check(&self) -> Result<(), String> {
        for view in &self.views {
            view.camera.validate().map_err(|e| format!("{}: {e}", view.id))?;
            let is_rotation = (view.camera_from_map.rotation.determinant() - 1.0).abs() < ROTATION_WITHIN;
            if !(is_rotation && view.centre().abs().max_element() < MOST_M) {
                return Err(format!("the pose of {}", view.id));
            }
        }
        Ok(())
    }
}

impl Coherent for FootprintStage {
    fn check(&self) -> Result<(), String> {
        let n_footprints = self.layer.footprints.len();
        if self.ground.len() != n_footprints {
            return Err(format!("{n_footprints} footprints, ground under {}", self.ground.len()));
        }
        let is_near = |number: f64| number.abs() < MOST_M;
        let is_ring = |ring: &LineString| {
            ring.0.len() >= 4 && ring.is_closed() && ring.coords().all(|c| is_near(c.x) && is_near(c.y))
        };
        let is_sound = |polygon: &Polygon| is_ring(polygon.exterior()) && polygon.interiors().iter().all(is_ring);
        if let Some(footprint) = self.layer.footprints.iter().find(|footprint| !is_sound(&footprint.polygon)) {
            return Err(format!("the footprint of {}", footprint.id.0));
        }
        let is_nowhere = |ground: &&GroundLevel| !(is_near(ground.reference_m) && is_near(ground.lowest_m));
        match self.ground.iter().flatten().find(is_nowhere) {
            Some(ground) => Err(format!("a ground of {} m", ground.reference_m)),
            None => Ok(()),
        }
    }
}

impl Coherent for HeightStage {
    fn check(&self) -> Result<(), String> {
        let n_heights = self.solution.heights.len();
        if self.parts.len() != n_heights {
            return Err(format!("{n_heights} heights of {}", self.parts.len()));
        }
        let is_in_order = self.parts.is_sorted_by_key(|part| part.building);
        if is_in_order { Ok(()) } else { Err("the order of the buildings".to_owned()) }
    }
}

impl HeightStage {
    /// A position that is not of a view of the survey, or not of a footprint with a ground.
    fn misplaced(&self, survey: &Survey, footprints: &FootprintStage) -> Option<String> {
        let solution = &self.solution;
        let unused = solution.failed_views.iter().chain(&self.unread_photos).map(|(view, _)| view);
        let used = solution.heights.iter().flat_map(|height| &height.views).chain(&solution.used_views);
        let n_views = survey.views.len();
        if let Some(view) = used.chain(unused).find(|&&view| view >= n_views) {
            return Some(format!("view {view} of {n_views}"));
        }
        let n_buildings = footprints.ground.iter().flatten().count();
        let parts = self.parts.iter().map(|part| part.building).chain(self.splits.iter().map(|split| split.building));
        let mut buildings = parts.chain(self.joined.iter().map(|(building, _)| *building));
        buildings.find(|&at| at >= n_buildings).map(|at| format!("building {at} of {n_buildings}"))
    }
}
