//! What a stage leaves behind for the next one, and for a run that starts there.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{Cut, PipelineError, Stage};
use crate::config::RunConfig;
use crate::files::write_whole;
use crate::footprint::{DetectionSummary, FootprintLayer, Tracks};
use crate::ids::BuildingId;
use crate::issue::Issue;
use crate::optimise::{LevelGain, Solution};
use crate::output::sha256_hex;
use crate::terrain::GroundLevel;

/// Outlines with their ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FootprintStage {
    /// The layer; footprints in its order.
    pub layer: FootprintLayer,
    /// Ground under each footprint of the layer; `None` where the terrain has none.
    pub ground: Vec<Option<GroundLevel>>,
    /// What was said about the ground.
    pub issues: Vec<Issue>,
    /// Roof outlines as the photos show them, which move with the heights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracks: Option<Tracks>,
    /// How much was found in photos; `None` for a layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detection: Option<DetectionSummary>,
    /// Buildings whose outlines were taken apart, and why; filled while heights are found.
    #[serde(skip)]
    pub levels: Vec<(BuildingId, LevelGain)>,
}

impl FootprintStage {
    /// Of outlines that were not found in photos.
    #[must_use]
    pub fn of_layer(layer: FootprintLayer, ground: Vec<Option<GroundLevel>>, issues: Vec<Issue>) -> Self {
        Self { layer, ground, issues, tracks: None, detection: None, levels: Vec::new() }
    }
}

/// Heights of the buildings whose ground is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeightStage {
    /// Position in the layer of each building that was solved.
    pub solved: Vec<usize>,
    /// How outlines were taken apart before the last round of solving, round by round; positions count the layer as it
    /// was left by the round before.
    #[serde(default)]
    pub cuts: Vec<Vec<Cut>>,
    /// Outlines that were taken apart and joined again, as the heights of their parts did not bear it out.
    #[serde(default)]
    pub joined: Vec<String>,
    /// The solution, one height per building of `solved`; its views are positions in the survey.
    pub solution: Solution,
    /// Views whose photo could not be read where roofs were settled by photos, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unread_photos: Vec<(usize, String)>,
    /// What the ground says against the priors' declared direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubt: Option<Issue>,
}

impl HeightStage {
    /// Without a single building.
    pub(super) fn empty() -> Self {
        Self {
            solved: Vec::new(),
            cuts: Vec::new(),
            joined: Vec::new(),
            solution: Solution::default(),
            unread_photos: Vec::new(),
            doubt: None,
        }
    }
}

#[derive(Serialize)]
struct Written<'a, T> {
    sizeup: &'a str,
    settings_sha256: String,
    data: &'a T,
}

#[derive(Deserialize)]
struct Read<T> {
    sizeup: String,
    settings_sha256: String,
    data: T,
}

fn path_of(config: &RunConfig, stage: Stage) -> PathBuf {
    config.project.output.join("stages").join(format!("{}.json", stage.name()))
}

/// Hash of the settings that a stage and those before it depend on, whatever folder a command was given in.
fn settings_sha256(config: &RunConfig, stage: Stage) -> String {
    let config = config.saved();
    let survey = serde_json::json!([config.project.crs, config.survey]);
    let footprints = serde_json::json!([config.footprints, config.terrain, config.dtm, config.ground]);
    let heights = serde_json::json!([config.prior, config.optimise, config.seed]);
    let parts: &[serde_json::Value] = match stage {
        Stage::Survey => &[survey],
        Stage::Footprints => &[survey, footprints],
        Stage::Heights | Stage::Output => &[survey, footprints, heights],
    };
    let text: Vec<String> = parts.iter().map(ToString::to_string).collect();
    sha256_hex(text.join("\n").as_bytes())
}

/// Writes what a stage found.
pub(super) fn write<T: Serialize>(config: &RunConfig, stage: Stage, data: &T) -> Result<(), PipelineError> {
    let written = Written { sizeup: env!("CARGO_PKG_VERSION"), settings_sha256: settings_sha256(config, stage), data };
    write_whole(&path_of(config, stage), |out| {
        serde_json::to_writer(&mut *out, &written)?;
        out.write_all(b"\n")
    })?;
    Ok(())
}

/// Reads what an earlier run of a stage found, if it was made with the same settings by the same version.
pub(super) fn read<T: DeserializeOwned>(config: &RunConfig, stage: Stage) -> Result<T, PipelineError> {
    let path = path_of(config, stage);
    let unusable = |message: String| PipelineError::Artefact { path: path.clone(), message, stage: stage.name() };
    let file = File::open(&path).map_err(|e| unusable(e.to_string()))?;
    let read: Read<T> = serde_json::from_reader(BufReader::new(file)).map_err(|e| unusable(e.to_string()))?;
    if read.sizeup != env!("CARGO_PKG_VERSION") {
        return Err(unusable(format!("made by sizeup {}, this is {}", read.sizeup, env!("CARGO_PKG_VERSION"))));
    }
    if read.settings_sha256 != settings_sha256(config, stage) {
        return Err(unusable("made with other settings".to_owned()));
    }
    Ok(read.data)
}
