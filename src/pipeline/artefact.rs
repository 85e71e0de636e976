//! What a stage leaves behind for the next one, and for a run that starts there.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use geo_types::{LineString, Polygon};
use glam::DVec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{GroundTold, PipelineError, Stage, contents, settings};
use crate::config::RunConfig;
use crate::recipe::Recipe;
use sizeup_footprints::{DetectionSummary, FootprintLayer, Tracks};
use sizeup_geo::files::write_whole;
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::GroundLevel;
use sizeup_heights::estimate::{Part, Split};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::ids::BuildingId;
use sizeup_heights::optimise::{LayerShift, LevelGain, LevelOff, Solution};
use sizeup_survey::Survey;

/// Footprints with their ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FootprintStage {
    /// The layer; footprints in its order.
    pub layer: FootprintLayer,
    /// Ground under each footprint of the layer; `None` where the terrain has none.
    pub ground: Vec<Option<GroundLevel>>,
    /// Issues of the ground.
    pub issues: Vec<Issue>,
    /// Roof contours as the photos show them, which move with the heights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracks: Option<Tracks>,
    /// Counts of what was found in photos; `None` for a layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detection: Option<DetectionSummary>,
    /// Buildings whose footprints were split, and why; filled while heights are found.
    #[serde(skip)]
    pub levels: Vec<(BuildingId, LevelGain)>,
    /// Terrain by the photos, which `ground` and the scene are corrected by; filled before heights are found, and kept with them.
    #[serde(skip)]
    pub told: GroundTold,
}

impl FootprintStage {
    /// Stage of footprints that were not found in photos.
    #[must_use]
    pub fn of_layer(layer: FootprintLayer, ground: Vec<Option<GroundLevel>>, issues: Vec<Issue>) -> Self {
        Self { layer, ground, issues, tracks: None, detection: None, levels: Vec::new(), told: GroundTold::default() }
    }
}

/// Heights of the buildings whose ground is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeightStage {
    /// Where the local frame of the solution's roofs lies in the map.
    pub origin: LocalOrigin,
    /// Position in the layer of each building that was solved.
    pub solved: Vec<usize>,
    /// Buildings and parts of buildings, in the order of `solved`; their `building` counts the footprints with a ground, unsplit.
    pub parts: Vec<Part>,
    /// Footprints that were split, and why.
    #[serde(default)]
    pub splits: Vec<Split>,
    /// Footprints that were split and joined again, because the heights of their parts did not differ.
    #[serde(default)]
    pub joined: Vec<(usize, Vec<usize>)>,
    /// The solution, one height per building of `solved`; its views are positions in the survey.
    pub solution: Solution,
    /// Views whose photo could not be read where roofs were settled by photos, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unread_photos: Vec<(usize, String)>,
    /// Doubt of the ground about the priors' declared direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubt: Option<Issue>,
    /// Shift of the footprint layer against the photos: these were moved onto it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layer_shift: Option<LayerShift>,
    /// Terrain by the photos.
    #[serde(default)]
    pub ground: GroundTold,
}

impl HeightStage {
    /// Without a single building.
    pub(super) fn empty() -> Self {
        Self {
            origin: LocalOrigin(DVec3::ZERO),
            solved: Vec::new(),
            parts: Vec::new(),
            splits: Vec::new(),
            joined: Vec::new(),
            solution: Solution::default(),
            unread_photos: Vec::new(),
            doubt: None,
            ground: GroundTold::default(),
            layer_shift: None,
        }
    }

    /// Error of the terrain's level by depth alone, where no photo shows the ground: it is not corrected.
    pub(super) fn level_off(&self) -> Option<LevelOff> {
        self.solution.level_off.filter(|_| self.ground.off_m.is_empty())
    }

    /// How far the photos were moved onto the footprints, map frame, metres.
    pub(super) fn moved_m(&self) -> DVec3 {
        self.layer_shift.map_or(DVec3::ZERO, |shift| shift.on_ground())
    }
}

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

fn path_of(config: &RunConfig, stage: Stage) -> PathBuf {
    config.project.output.join("stages").join(format!("{}.json", stage.name()))
}

/// Recipe of a stage and those before it: settings, whatever folder a command was given in, and what their files hold.
fn recipe(config: &RunConfig, stage: Stage, survey: &Survey) -> Recipe {
    let mut recipe = Recipe::new(&settings::of_stage(config, stage));
    contents::add(&mut recipe, config, stage, survey);
    recipe
}

/// Writes what a stage found with a survey.
pub(super) fn write<T: Serialize>(
    config: &RunConfig,
    stage: Stage,
    survey: &Survey,
    data: &T,
) -> Result<(), PipelineError> {
    write_made_by(config, stage, recipe(config, stage, survey), data)
}

fn write_made_by<T: Serialize>(
    config: &RunConfig,
    stage: Stage,
    made_by: Recipe,
    data: &T,
) -> Result<(), PipelineError> {
    let written = WrittenArtefact { made_by, data };
    write_whole(&path_of(config, stage), |out| {
        serde_json::to_writer(&mut *out, &written)?;
        out.write_all(b"\n")
    })?;
    Ok(())
}

/// Reads what an earlier run of a stage found with a survey, if it was made from what there is now and holds together.
pub(super) fn read<T: DeserializeOwned + Coherent>(
    config: &RunConfig,
    stage: Stage,
    survey: &Survey,
) -> Result<T, PipelineError> {
    let read = read_any(config, stage)?;
    check(config, stage, &read, survey)?;
    Ok(read.data)
}

/// Writes a survey, its photos named from the folder of the results as in the configuration beside them.
pub(super) fn write_survey(config: &RunConfig, survey: &Survey) -> Result<(), PipelineError> {
    let mut saved = survey.clone();
    for path in saved.views.iter_mut().filter_map(|view| view.image.as_mut()) {
        *path = config.saved_path(path);
    }
    // The recipe is of the files as they are found from here.
    write_made_by(config, Stage::Survey, recipe(config, Stage::Survey, survey), &saved)
}

/// Reads the survey that an earlier run left behind, as [`read`].
pub(super) fn read_survey(config: &RunConfig) -> Result<Survey, PipelineError> {
    let mut read: Read<Survey> = read_any(config, Stage::Survey)?;
    for path in read.data.views.iter_mut().filter_map(|view| view.image.as_mut()) {
        *path = config.found_path(path);
    }
    check(config, Stage::Survey, &read, &read.data)?;
    Ok(read.data)
}

fn read_any<T: DeserializeOwned>(config: &RunConfig, stage: Stage) -> Result<Read<T>, PipelineError> {
    let file = File::open(path_of(config, stage)).map_err(|e| unusable(config, stage, e.to_string()))?;
    serde_json::from_reader(BufReader::new(file)).map_err(|e| unusable(config, stage, e.to_string()))
}

/// Refuses what was made by another recipe than the one of now, and what does not hold together.
fn check<T: Coherent>(config: &RunConfig, stage: Stage, read: &Read<T>, survey: &Survey) -> Result<(), PipelineError> {
    match recipe(config, stage, survey).why_stale(&read.made_by) {
        Some(why) => Err(unusable(config, stage, format!("stale: {why}"))),
        None => read.data.check().map_err(|why| unusable(config, stage, format!("altered: {why}"))),
    }
}

/// Error of an artefact that cannot be used.
fn unusable(config: &RunConfig, stage: Stage, message: String) -> PipelineError {
    PipelineError::Artefact { path: path_of(config, stage), message, stage: stage.name() }
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
    /// Whether all its positions are those of views of the survey, and of footprints with a ground.
    ///
    /// # Errors
    /// [`PipelineError::Artefact`].
    pub(super) fn check_positions(
        &self,
        config: &RunConfig,
        survey: &Survey,
        footprints: &FootprintStage,
    ) -> Result<(), PipelineError> {
        let solution = &self.solution;
        let told = solution.failed_views.iter().chain(&self.unread_photos).map(|(view, _)| view);
        let said = solution.heights.iter().flat_map(|height| &height.views).chain(&solution.used_views);
        let n_views = survey.views.len();
        let n_buildings = footprints.ground.iter().flatten().count();
        let named = self.parts.iter().map(|part| part.building).chain(self.splits.iter().map(|split| split.building));
        let mut named = named.chain(self.joined.iter().map(|(building, _)| *building));
        let message = if let Some(view) = said.chain(told).find(|&&view| view >= n_views) {
            format!("altered: view {view} of {n_views}")
        } else if let Some(at) = named.find(|&at| at >= n_buildings) {
            format!("altered: building {at} of {n_buildings}")
        } else {
            return Ok(());
        };
        Err(unusable(config, Stage::Heights, message))
    }
}
