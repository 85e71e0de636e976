//! Settings of each stage: the sections of the configuration that it needs, and nothing else.
//!
//! [`RunSettings`](super::RunSettings) is built once, where a command enters the pipeline. From there on each stage gets its own
//! settings, so that no stage reads those of another.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use crate::config::{FootprintPlace, OutputConfig, ProjectConfig, ResultFolder};
use sizeup_footprints::{FootprintConfig, FootprintSource};
use sizeup_geo::crs::Crs;
use sizeup_geo::terrain::{GroundConfig, TerrainConfig};
use sizeup_heights::estimate::MethodSettings;
use sizeup_heights::scene::HeightsConfig;
use sizeup_photos::align::AlignConfig;
use sizeup_photos::dtm::DtmConfig;
use sizeup_photos::prior::PriorConfig;
use sizeup_results::output::HeightReference;
use sizeup_results::output::fallback::FallbackConfig;
use sizeup_survey::{SurveyConfig, View, ViewKind};

/// Kind of the depth that heights are measured in.
#[derive(Debug, Clone, Copy)]
pub struct DepthKind {
    /// Whether it is in metres, with nothing left to calibrate.
    pub is_in_metres: bool,
    /// Whether it comes from matching the photos with each other.
    pub from_photos: bool,
}

/// Settings of the survey: poses and their photos.
#[derive(Debug, Clone)]
pub struct SurveySettings<'a> {
    /// Files of the poses, and their conventions.
    pub config: &'a SurveyConfig,
    /// The project's CRS.
    pub crs: &'a Crs,
    /// How poses are aligned with their photos.
    pub align: &'a AlignConfig,
    /// Whether a run checks how well its poses fit the photos.
    pub is_aligned: bool,
    /// Whether depth comes from matching the photos with each other.
    pub from_photos: bool,
    /// The terrain as configured.
    pub terrain: &'a TerrainConfig,
    /// Folder of the results.
    pub folder: ResultFolder<'a>,
    /// Whether pictures are drawn.
    pub draws_pictures: bool,
}

/// Declared places of poses and footprints, to explain inputs that are far apart.
#[derive(Debug, Clone, Copy)]
pub struct PlaceSettings<'a> {
    /// The project's CRS.
    pub crs: &'a Crs,
    /// CRS of the poses, where it is declared.
    pub survey_crs: Option<&'a Crs>,
    /// The footprint layer, where there is one.
    pub layer: Option<&'a FootprintConfig>,
    /// Level of the ground, where it is known roughly, metres.
    pub level_m: Option<f64>,
}

/// Settings of the ground under buildings and rays.
#[derive(Debug, Clone)]
pub struct GroundSettings<'a> {
    /// The project's CRS.
    pub crs: &'a Crs,
    /// The terrain of the run: as configured, or the model that the run makes from its photos.
    pub terrain: Cow<'a, TerrainConfig>,
    /// Which level of the terrain a building's height counts from.
    pub level: GroundConfig,
    /// Ground in the photos that the run's own terrain model was made from; `None` where the terrain was made by others.
    pub squares: Option<PathBuf>,
}

impl<'a> GroundSettings<'a> {
    /// `own` is the folder of the terrain model that the run makes, if it makes one.
    pub(super) fn of(
        crs: &'a Crs,
        given: &'a TerrainConfig,
        level: GroundConfig,
        own: Option<ResultFolder<'a>>,
    ) -> Self {
        let TerrainConfig { margin_m, min_cell_m, .. } = *given;
        let terrain = match own {
            Some(folder) => Cow::Owned(TerrainConfig { margin_m, min_cell_m, ..TerrainConfig::dtm(folder.dtm()) }),
            None => Cow::Borrowed(given),
        };
        Self { crs, terrain, level, squares: own.map(|folder| folder.dtm_squares()) }
    }

    /// Whether the terrain is a model that others made: its error is small, unless the photos contradict it.
    #[must_use]
    pub fn is_model(&self) -> bool {
        self.squares.is_none() && self.terrain.dtm.is_some()
    }

    /// The same with cells of the terrain at least so wide, metres.
    #[must_use]
    pub(super) fn coarser(&self, min_cell_m: f64) -> Self {
        let mut coarse = self.clone();
        let terrain = coarse.terrain.to_mut();
        terrain.min_cell_m = terrain.min_cell_m.max(min_cell_m);
        coarse
    }
}

/// Settings of the terrain model from photos.
#[derive(Debug, Clone)]
pub struct DtmSettings<'a> {
    /// The model of a run; `None` where it makes none.
    pub model: Option<&'a DtmConfig>,
    /// Declared places of poses and footprints.
    pub places: PlaceSettings<'a>,
    /// The terrain that it starts from.
    pub terrain: &'a TerrainConfig,
    /// Kind of the depth that heights are measured in.
    pub depth: DepthKind,
    /// Folder of the results.
    pub folder: ResultFolder<'a>,
    /// Whether a picture of it is drawn.
    pub draws_picture: bool,
}

/// Settings of the footprints.
#[derive(Debug, Clone)]
pub struct FootprintSettings<'a> {
    /// The layer, masks or network that they come from.
    pub source: &'a FootprintSource,
    /// Ground under them.
    pub ground: GroundSettings<'a>,
    /// Declared places of poses and footprints.
    pub places: PlaceSettings<'a>,
    /// Depth for networks that need it.
    pub prior: &'a PriorConfig,
    /// Range of heights, which limits that depth.
    pub heights: &'a HeightsConfig,
    /// Folder of the results.
    pub folder: ResultFolder<'a>,
    /// Whether pictures are drawn.
    pub draws_pictures: bool,
}

/// Settings of the scene that rays meet.
#[derive(Debug, Clone)]
pub struct SceneSettings<'a> {
    /// Ground under buildings and rays.
    pub ground: GroundSettings<'a>,
    /// Declared places of poses and footprints.
    pub places: PlaceSettings<'a>,
    /// Range of heights.
    pub heights: &'a HeightsConfig,
    /// Kind of the depth that heights are measured in.
    pub depth: DepthKind,
}

/// Settings of the heights.
#[derive(Debug, Clone)]
pub struct HeightSettings<'a> {
    /// Settings of the scene that rays meet.
    pub scene: SceneSettings<'a>,
    /// Source of the footprints: some move with the heights.
    pub footprints: &'a FootprintSource,
    /// Folder of the photos.
    pub images: Option<&'a Path>,
    /// Source of the depth priors.
    pub prior: &'a PriorConfig,
    /// Solver and refinement by photos.
    pub method: MethodSettings,
    /// Root of every random choice.
    pub seed: u64,
}

impl HeightSettings<'_> {
    /// Whether the photo of a view is read while heights are estimated: for roofs, for vegetation, or for the ground.
    #[must_use]
    pub fn reads_photo(&self, view: &View) -> bool {
        let masks_vegetation = self.method.optimise.leaves_out_vegetation() && view.kind() == ViewKind::Oblique;
        let checks_ground = self.scene.ground.squares.is_none();
        (self.method.refines_roofs() || masks_vegetation || checks_ground) && view.image.is_some()
    }
}

/// Settings of the records: one per building.
#[derive(Debug, Clone, Copy)]
pub struct RecordSettings<'a> {
    /// Whether the terrain is a model that others made.
    pub ground_is_model: bool,
    /// Level of the roof that a height is of.
    pub height_reference: HeightReference,
    /// Place of footprints that are known to be off.
    pub place: FootprintPlace,
    /// Heights of buildings that could not be measured.
    pub fallback: &'a FallbackConfig,
}

/// Settings of the writers.
#[derive(Debug, Clone)]
pub struct OutputSettings<'a> {
    /// Formats and pictures.
    pub config: &'a OutputConfig,
    /// Ground under the city.
    pub ground: GroundSettings<'a>,
    /// Folder of the results.
    pub folder: ResultFolder<'a>,
    /// The whole configuration, as saved beside the results.
    pub config_toml: String,
}

/// Origin of results, for their lineage.
#[derive(Debug, Clone)]
pub struct Origin<'a> {
    /// CRS, vertical datum and date.
    pub project: &'a ProjectConfig,
    /// Which level of the terrain heights count from.
    pub ground: GroundConfig,
    /// Root of every random choice.
    pub seed: u64,
    /// Hash of the configuration as saved beside the results.
    pub config_sha256: String,
}
