//! The door of the pipeline: a configuration, split into the settings of the stages.

use serde_json::Value;

use super::PipelineError;
use super::artefacts::Artefacts;
use super::recipes::Decisive;
use super::recipes::StageFiles;
use super::settings::{
    DepthKind, DtmSettings, FootprintSettings, GroundSettings, HeightSettings, Origin, OutputSettings, PlaceSettings,
    RecordSettings, SceneSettings, SurveySettings,
};
use crate::config::RunConfig;
use sizeup_footprints::{FootprintConfig, FootprintSource};
use sizeup_heights::estimate::MethodSettings;
use sizeup_photos::align::AlignWhen;
use sizeup_results::output::reviews::ReviewsConfig;
use sizeup_results::output::sha256_hex;
use sizeup_survey::Survey;

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
        let files =
            StageFiles { folder, survey: survey.clone(), footprints: footprints.clone(), heights: heights.clone() };
        let artefacts = Artefacts { decisive: Decisive::of(config, is_aligned), files };
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

fn layer_of(source: &FootprintSource) -> Option<&FootprintConfig> {
    match source {
        FootprintSource::Layer(layer) => Some(layer),
        FootprintSource::Masks(_) | FootprintSource::Network(_) => None,
    }
}
