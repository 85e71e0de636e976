//! Results of the footprint stage and of the height stage, and their files: a later run starts from them.

use std::borrow::Cow;
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use geo_types::{LineString, Polygon};
use glam::DVec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::recipes::{Decisive, StageFiles};
use super::{PhotoGround, PipelineError, Stage};
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
    pub photo_ground: PhotoGround,
}

impl FootprintStage {
    /// Stage of footprints that were not found in photos.
    #[must_use]
    pub fn of_layer(layer: FootprintLayer, ground: Vec<Option<GroundLevel>>, issues: Vec<Issue>) -> Self {
        Self {
            layer,
            ground,
            issues,
            tracks: None,
            detection: None,
            levels: Vec::new(),
            photo_ground: PhotoGround::default(),
        }
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
    pub ground: PhotoGround,
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
            ground: PhotoGround::default(),
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

    /// The survey with its photos moved onto the footprints.
    pub(super) fn moved<'a>(&self, survey: &'a Survey) -> Cow<'a, Survey> {
        let by = self.moved_m();
        if by == DVec3::ZERO {
            return Cow::Borrowed(survey);
        }
        let mut survey = survey.clone();
        for view in &mut survey.views {
            view.camera_from_map = view.camera_from_map.moved(by);
        }
        Cow::Owned(survey)
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
