//! What a stage leaves behind for the next one, and for a run that starts there.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{Cut, GroundTold, PipelineError, Stage, poses};
use crate::config::RunConfig;
use crate::recipe::{ABSENT, Recipe};
use sizeup_footprints::{DetectionSummary, FootprintLayer, Tracks};
use sizeup_geo::files::write_whole;
use sizeup_geo::hashes::Content;
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::GroundLevel;
use sizeup_heights::ids::BuildingId;
use sizeup_heights::optimise::{LevelGain, Solution};

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
    /// Buildings whose outlines were split, and why; filled while heights are found.
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
    /// How outlines were split before the last round of solving, round by round; positions count the layer as it
    /// was left by the round before.
    #[serde(default)]
    pub cuts: Vec<Vec<Cut>>,
    /// Outlines that were split and joined again, as the heights of their parts did not bear it out.
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
    /// What the photos say of the terrain.
    #[serde(default)]
    pub ground: GroundTold,
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
            ground: GroundTold::default(),
        }
    }
}

#[derive(Serialize)]
struct Written<'a, T> {
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

/// What a stage and those before it are made from: settings, whatever folder a command was given in, and the files that hold
/// outlines and terrain as a whole. Poses and priors, of which there may be any number, are known by their settings.
fn recipe(config: &RunConfig, stage: Stage) -> Recipe {
    let saved = config.saved();
    let mut settings = serde_json::json!({ "project": { "crs": saved.project.crs }, "survey": saved.survey });
    let mut files = Vec::new();
    if poses::asks(config) {
        settings["align"] = serde_json::json!({ "settings": saved.align, "ground": saved.terrain });
    }
    if stage >= Stage::Footprints {
        settings["footprints"] = serde_json::json!(saved.footprints);
        settings["terrain"] = serde_json::json!(saved.terrain);
        settings["dtm"] = serde_json::json!(saved.dtm);
        settings["ground"] = serde_json::json!(saved.ground);
        files.extend(config.footprints.file().map(|path| ("footprints", path)));
        files.extend(config.terrain.dtm.clone().map(|path| ("terrain", path)));
    }
    if stage >= Stage::Heights {
        settings["heights"] = serde_json::json!(saved.heights);
        settings["prior"] = serde_json::json!(*saved.prior.chosen());
        settings["optimise"] = serde_json::json!(saved.optimise);
        settings["seed"] = serde_json::json!(saved.seed);
    }
    let mut recipe = Recipe::new(&settings);
    for (role, path) in files.iter().filter(|(_, path)| path.is_file()) {
        let sha256 = Content::of(path).map_or_else(|_| ABSENT.to_owned(), |content| content.sha256);
        recipe.add(format!("{role} {}", config.saved_path(path).display()), sha256);
    }
    recipe
}

/// Writes what a stage found.
pub(super) fn write<T: Serialize>(config: &RunConfig, stage: Stage, data: &T) -> Result<(), PipelineError> {
    let written = Written { made_by: recipe(config, stage), data };
    write_whole(&path_of(config, stage), |out| {
        serde_json::to_writer(&mut *out, &written)?;
        out.write_all(b"\n")
    })?;
    Ok(())
}

/// Reads what an earlier run of a stage found, if it was made from what there is now.
pub(super) fn read<T: DeserializeOwned>(config: &RunConfig, stage: Stage) -> Result<T, PipelineError> {
    let path = path_of(config, stage);
    let unusable = |message: String| PipelineError::Artefact { path: path.clone(), message, stage: stage.name() };
    let file = File::open(&path).map_err(|e| unusable(e.to_string()))?;
    let read: Read<T> = serde_json::from_reader(BufReader::new(file)).map_err(|e| unusable(e.to_string()))?;
    match recipe(config, stage).why_stale(&read.made_by) {
        Some(why) => Err(unusable(format!("stale: {why}"))),
        None => Ok(read.data),
    }
}
