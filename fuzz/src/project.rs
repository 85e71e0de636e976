//! What the stages of a run leave behind, read back by a run that starts at its last stage.

use std::fs;
use std::sync::LazyLock;

use serde_json::Value;
use sizeup::config::RunConfig;
use sizeup::pipeline::{self, RunOptions, Stage};
use sizeup::simulate::{SimulateConfig, simulate};
use tempfile::TempDir;

/// The stages that leave something behind.
pub const STAGES: [(&str, Stage); 3] =
    [("survey", Stage::Survey), ("footprints", Stage::Footprints), ("heights", Stage::Heights)];

/// A finished run of two buildings under six photos.
pub struct Project {
    folder: TempDir,
    config: RunConfig,
}

impl Project {
    /// Simulates and runs it.
    pub fn new() -> Self {
        let folder =
            tempfile::Builder::new().prefix("sizeup-fuzz-").tempdir_in(super::place()).expect("a folder can be made");
        let mut town = SimulateConfig::default();
        town.town.n_buildings = 2;
        town.flight.n_views = Some(6);
        (town.camera.width_px, town.camera.height_px) = (64, 48);
        town.prior.longest_px = 64;
        town.terrain.margin_m = 400.0;
        town.images.enabled = false;
        simulate(&town, folder.path(), &|_, _| {}).expect("a town can be simulated");
        let small = ["optimise.working_px=64", "output.pictures=false", "output.report.page=false"].map(str::to_owned);
        let config = RunConfig::load(&folder.path().join("sizeup.toml"), &small).expect("the settings are sound");
        let project = Self { folder, config };
        project.run(Stage::Survey).expect("the run is sound");
        project
    }

    fn run(&self, from: Stage) -> Result<pipeline::RunSummary, pipeline::PipelineError> {
        let options = RunOptions { from, until: Stage::Output, command: "fuzz".to_owned() };
        pipeline::run(&self.config, &options, &|_| {})
    }

    /// What a stage left behind, with what it was made by.
    pub fn artefact(&self, stage: &str) -> Value {
        let text = fs::read(self.path(stage)).expect("the stage left it behind");
        serde_json::from_slice(&text).expect("it is JSON")
    }

    fn path(&self, stage: &str) -> std::path::PathBuf {
        self.folder.path().join("result/stages").join(format!("{stage}.json"))
    }
}

/// Runs the last stage on other findings of an earlier one.
pub fn read_stage(stage: Stage, bytes: &[u8]) {
    static PROJECT: LazyLock<(Project, [(Stage, String, Value); 3])> = LazyLock::new(|| {
        let project = Project::new();
        let artefacts = STAGES.map(|(name, stage)| (stage, name.to_owned(), project.artefact(name)));
        (project, artefacts)
    });
    let (project, artefacts) = &*PROJECT;
    let Some((_, name, artefact)) = artefacts.iter().find(|(of, ..)| *of == stage) else { return };
    let made_by = artefact["made_by"].to_string();
    let text = [b"{\"made_by\":", made_by.as_bytes(), b",\"data\":", bytes, b"}"].concat();
    fs::write(project.path(name), text).expect("a file in memory can be written");
    drop(super::read(project.run(Stage::Output)));
}
