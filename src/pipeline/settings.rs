//! Settings of each stage: the sections of the configuration that it needs, and nothing else.
//!
//! [`RunSettings`] is built once, where a command enters the pipeline. From there on each stage gets its own settings, so that no
//! stage reads those of another.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::PipelineError;
use super::artefact::Artefacts;
use super::recipes::Decisive;
use crate::config::{FootprintPlace, OutputConfig, ProjectConfig, ResultFolder, RunConfig};
use sizeup_footprints::{FootprintConfig, FootprintSource};
use sizeup_geo::crs::Crs;
use sizeup_geo::terrain::{GroundConfig, TerrainConfig};
use sizeup_heights::estimate::MethodSettings;
use sizeup_heights::scene::HeightsConfig;
use sizeup_photos::align::{AlignConfig, AlignWhen};
use sizeup_photos::dtm::DtmConfig;
use sizeup_photos::prior::PriorConfig;
use sizeup_results::output::HeightReference;
use sizeup_results::output::fallback::FallbackConfig;
use sizeup_results::output::reviews::ReviewsConfig;
use sizeup_results::output::sha256_hex;
use sizeup_survey::{Survey, SurveyConfig};

/// Settings of all stages, each on its own.
#[derive(Debug, Clone)]
pub struct RunSettings<'a> {
    /// Settings of the survey.
    pub survey: SurveySettings<'a>,
    /// Settings of the terrain model from photos.
    pub dtm: DtmSettings<'a>,
    /// Settings of the footprints.
    pub footprints: FootprintSettings<'a>,
    /// Settings of the heights.
    pub heights: HeightSettings<'a>,
    /// Settings of the records.
    pub records: RecordSettings<'a>,
    /// Settings of the writers.
    pub output: OutputSettings<'a>,
    /// Decisions of people about single buildings.
    pub reviews: Option<&'a ReviewsConfig>,
    /// Origin of the results.
    pub origin: Origin<'a>,
    /// Results of the stages on disk.
    pub(super) artefacts: Artefacts<'a>,
}

impl<'a> RunSettings<'a> {
    /// Splits a configuration into the settings of its stages.
    #[must_use]
    pub fn of(config: &'a RunConfig) -> Self {
        let folder = config.result_folder();
        let crs = &config.project.crs;
        let depth = DepthKind { is_in_metres: config.prior.is_in_metres(), from_photos: config.prior.matches_photos() };
        let method = MethodSettings { optimise: config.optimise.clone(), refinement: config.refinement.clone() };
        let is_aligned = match config.align.when {
            AlignWhen::Auto => depth.from_photos || method.refines_roofs(),
            AlignWhen::Always => true,
            AlignWhen::Never => false,
        };
        let survey = SurveySettings {
            config: &config.survey,
            crs,
            align: &config.align,
            is_aligned,
            from_photos: depth.from_photos,
            terrain: &config.terrain,
            makes_dtm: config.dtm.is_some(),
            folder,
            draws_pictures: config.output.pictures,
        };
        let places = PlaceSettings {
            crs,
            survey_crs: config.survey.crs.as_ref(),
            layer: layer_of(&config.footprints),
            level_m: config.terrain.constant_m,
        };
        let ground = GroundSettings::of(crs, &config.terrain, config.ground, config.dtm.is_some().then_some(folder));
        let dtm = DtmSettings {
            model: config.dtm.as_ref(),
            places,
            terrain: &config.terrain,
            depth,
            folder,
            draws_picture: config.output.pictures,
        };
        let footprints = FootprintSettings {
            source: &config.footprints,
            ground: ground.clone(),
            places,
            prior: &config.prior,
            heights: &config.heights,
            folder,
            draws_pictures: config.output.pictures,
        };
        let heights = HeightSettings {
            scene: SceneSettings { ground: ground.clone(), places, heights: &config.heights, depth },
            footprints: &config.footprints,
            images: config.survey.images.as_deref(),
            prior: &config.prior,
            method,
            seed: config.seed,
        };
        let records = RecordSettings {
            ground_is_model: ground.is_model(),
            height_reference: config.optimise.height_reference,
            place: config.output.footprints,
            fallback: &config.output.fallback,
        };
        let config_toml = config.saved().to_toml();
        let origin = Origin {
            project: &config.project,
            ground: config.ground,
            seed: config.seed,
            config_sha256: sha256_hex(config_toml.as_bytes()),
        };
        let output = OutputSettings { config: &config.output, ground, folder, config_toml };
        let artefacts = Artefacts {
            folder,
            decisive: Decisive::of(config, is_aligned),
            survey: survey.clone(),
            footprints: footprints.clone(),
            heights: heights.clone(),
        };
        let reviews = config.reviews.as_ref();
        Self { survey, dtm, footprints, heights, records, output, reviews, origin, artefacts }
    }

    /// Settings that decide the result of a part of a city.
    #[must_use]
    pub fn of_part(&self) -> &Value {
        &self.artefacts.decisive.of_part
    }

    /// Reads the survey of an earlier run of its stage.
    ///
    /// # Errors
    /// [`PipelineError::Artefact`].
    pub fn survey(&self) -> Result<Survey, PipelineError> {
        self.artefacts.read_survey()
    }
}

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
    /// Whether the run makes a terrain model from the photos.
    pub makes_dtm: bool,
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
    fn of(crs: &'a Crs, given: &'a TerrainConfig, level: GroundConfig, own: Option<ResultFolder<'a>>) -> Self {
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
    /// The scene.
    pub scene: SceneSettings<'a>,
    /// Source of the footprints: some move with the heights.
    pub footprints: &'a FootprintSource,
    /// Folder of the photos.
    pub images: Option<&'a Path>,
    /// Depth priors.
    pub prior: &'a PriorConfig,
    /// Solver and refinement by photos.
    pub method: MethodSettings,
    /// Root of every random choice.
    pub seed: u64,
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

fn layer_of(source: &FootprintSource) -> Option<&FootprintConfig> {
    match source {
        FootprintSource::Layer(layer) => Some(layer),
        FootprintSource::Masks(_) | FootprintSource::Network(_) => None,
    }
}
