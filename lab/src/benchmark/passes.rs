//! The worth of each pass of the solver: heights and processor time with one pass changed at a time.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::accuracy::word;
use super::scene::{simulated, user_seconds};
use super::{BenchmarkError, SceneJob, SuitePlan, TellScenes};
use sizeup::config::RunConfig;
use sizeup::pipeline::{self, RunOptions, Stage};
use sizeup_geo::files::{FileError, write_json, write_whole};
use sizeup_heights::scene::RoofForm;
use sizeup_truth::evaluate::read::{TruthOptions, read_results, read_truth};
use sizeup_truth::evaluate::{HeightOptions, evaluate_heights};
use sizeup_truth::simulate::{ErrorConfig, PriorLevel, SimulateConfig, TownKind};

/// Error from which a height counts as large, metres.
const LARGE_M: f64 = 1.0;

/// A name, and what it changes.
type Change = (&'static str, fn(&mut RunConfig));

/// The method as it is, and changes of one pass each.
const CHANGES: [Change; 13] = [
    ("as it is", |_| ()),
    ("full_sweeps = 3", |run| run.optimise.search.full_sweeps = 3),
    ("local_sweeps = 1", |run| run.optimise.search.local_sweeps = 1),
    ("correct_edge_bleeding = false", |run| run.optimise.search.correct_edge_bleeding = false),
    ("measure_shift = false", |run| run.optimise.search.measure_shift = false),
    ("no shifts of single footprints", |run| run.optimise.search.measure_footprints = false),
    ("leave_out_vegetation = false", |run| run.optimise.search.leave_out_vegetation = false),
    ("split_levels = false", |run| run.optimise.search.split_levels = false),
    ("roof_forms = []", |run| run.optimise.search.roof_forms.clear()),
    ("no stepped roofs", |run| run.optimise.search.roof_forms.retain(|form| *form != RoofForm::Stepped)),
    ("no agreement of depths", |run| {
        (run.optimise.search.agreement_weight, run.optimise.search.local_agreement_weight) = (0.0, 0.0);
    }),
    ("unmodelled_agreement_weight = 0", |run| run.optimise.search.unmodelled_agreement_weight = 0.0),
    ("refinement.enabled = false", |run| run.refinement.enabled = Some(false)),
];

/// Scenes and changes of the suite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PassesConfig {
    /// Kinds of towns that are simulated, with priors alone.
    pub towns: Vec<TownKind>,
    /// Configurations besides, each with the heights to compare with as `truth.geojson` beside it.
    pub real: Vec<PathBuf>,
    /// Names of the changes that are measured; none: all.
    pub changes: Vec<String>,
    /// Buildings of a simulated town.
    pub n_buildings: usize,
    /// Photos of a simulated town.
    pub n_views: usize,
    /// Longer side of its priors, pixels.
    pub longest_px: u32,
    /// Level of prior errors.
    pub level: PriorLevel,
    /// Root of the random choices.
    pub seed: u64,
}

impl Default for PassesConfig {
    fn default() -> Self {
        Self {
            towns: vec![TownKind::Village, TownKind::District, TownKind::Downtown],
            real: Vec::new(),
            changes: Vec::new(),
            n_buildings: 60,
            n_views: 80,
            longest_px: 448,
            level: PriorLevel::Mid,
            seed: 71,
        }
    }
}

impl PassesConfig {
    /// Seconds instead of minutes.
    #[must_use]
    pub fn small() -> Self {
        let changes = ["as it is", "roof_forms = []"].map(str::to_owned).to_vec();
        Self {
            towns: vec![TownKind::Village],
            n_buildings: 12,
            n_views: 24,
            longest_px: 320,
            level: PriorLevel::Clean,
            changes,
            ..Self::default()
        }
    }

    fn changes(&self) -> Result<Vec<&'static Change>, BenchmarkError> {
        let known = || CHANGES.map(|(name, _)| name).join(", ");
        let named = |name: &String| {
            let found = CHANGES.iter().find(|(known, _)| known == name);
            found.ok_or_else(|| BenchmarkError::UnknownChange { name: name.clone(), known: known() })
        };
        if self.changes.is_empty() { Ok(CHANGES.iter().collect()) } else { self.changes.iter().map(named).collect() }
    }
}

/// Heights of one scene with one change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassRow {
    /// Name of the scene.
    pub scene: String,
    /// Name of the change.
    pub change: String,
    /// Heights that were compared.
    pub n: usize,
    /// Mean error, metres.
    pub error_mean_m: f64,
    /// Heights more than a metre off.
    pub n_large: usize,
    /// Processor seconds of the whole run in user mode; `None` where the system does not tell.
    pub user_s: Option<f64>,
}

/// Figures of all scenes and changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassTable {
    /// One per scene and change.
    pub rows: Vec<PassRow>,
}

impl PassTable {
    /// The table in Markdown: a row per change, a column per scene.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let mut scenes: Vec<&str> = self.rows.iter().map(|row| &*row.scene).collect();
        scenes.dedup();
        let mut text = format!("| change | {} |\n|---|{}\n", scenes.join(" | "), "---|".repeat(scenes.len()));
        let of_first = self.rows.iter().filter(|row| scenes.first() == Some(&&*row.scene));
        for change in of_first.map(|row| &row.change) {
            let cell = |row: &PassRow| {
                let seconds = row.user_s.map_or_else(|| "–".to_owned(), |s| format!("{s:.1} s"));
                format!("{:.3}, {} of {}, {seconds}", row.error_mean_m, row.n_large, row.n)
            };
            let cells: Vec<String> = self.rows.iter().filter(|row| row.change == *change).map(cell).collect();
            let _ = writeln!(text, "| {change} | {} |", cells.join(" | "));
        }
        text.push_str("\nMean error in metres, heights more than 1 m off, processor seconds of the whole run.\n");
        text
    }
}

/// Measures all scenes with all changes, and writes `passes.md` and `passes.json`.
///
/// # Errors
/// [`BenchmarkError`].
pub fn run(config: &PassesConfig, plan: &SuitePlan, tell: TellScenes<'_>) -> Result<PassTable, BenchmarkError> {
    if config.towns.is_empty() && config.real.is_empty() {
        return Err(BenchmarkError::Empty { setting: "towns" });
    }
    let changes = config.changes()?;
    let total = (config.towns.len() + config.real.len()) * changes.len();
    let mut rows = Vec::new();
    for kind in &config.towns {
        let name = word(kind);
        let folder = simulated(&job(config, *kind, &name), plan)?;
        measure(&name, &folder.join("sizeup.toml"), &changes, plan, &mut rows, &|n, what| tell(n, total, what))?;
        if !plan.keep_scenes {
            fs::remove_dir_all(&folder).map_err(FileError::on("remove", &folder))?;
        }
    }
    for file in &config.real {
        let folder = file.parent().and_then(Path::file_name);
        let name = folder.map_or_else(|| file.display().to_string(), |name| name.to_string_lossy().into_owned());
        measure(&name, file, &changes, plan, &mut rows, &|n, what| tell(n, total, what))?;
    }
    let table = PassTable { rows };
    write_json(&plan.folder.join("passes.json"), &table)?;
    write_whole(&plan.folder.join("passes.md"), |out| out.write_all(table.to_markdown().as_bytes()))?;
    Ok(table)
}

/// A simulated town with priors and no photos.
fn job(config: &PassesConfig, kind: TownKind, name: &str) -> SceneJob {
    let mut town = SimulateConfig { seed: config.seed, errors: ErrorConfig::REALISTIC, ..SimulateConfig::default() };
    (town.town.kind, town.town.n_buildings) = (kind, config.n_buildings);
    town.flight.n_views = Some(config.n_views);
    (town.camera.width_px, town.camera.height_px) = (config.longest_px, config.longest_px * 3 / 4);
    (town.prior.longest_px, town.prior.level) = (config.longest_px, config.level);
    town.images.enabled = false;
    SceneJob::of_scene(name, town)
}

/// Heights of a configuration with each of some changes, added to the rows.
fn measure(
    name: &str,
    file: &Path,
    changes: &[&Change],
    plan: &SuitePlan,
    rows: &mut Vec<PassRow>,
    tell: &dyn Fn(usize, &str),
) -> Result<(), BenchmarkError> {
    let as_is =
        RunConfig::load(file, &[]).map_err(|source| BenchmarkError::Config { scene: name.to_owned(), source })?;
    let truth = file.with_file_name("truth.geojson");
    let truth = read_truth(&truth, &TruthOptions::default(), &as_is.project.crs)?;
    let command = format!("sizeup-lab benchmark passes: {name}");
    let options = RunOptions { from: Stage::Survey, until: Stage::Output, command };
    for (change, apply) in changes {
        tell(rows.len(), &format!("{name}: {change}"));
        let mut run = as_is.clone();
        (run.output.pictures, run.output.report.page) = (false, false);
        run.project.output = plan.folder.join("results").join(name);
        apply(&mut run);
        let before = user_seconds();
        pipeline::run(&run, &options, &|_| {}).map_err(|source| BenchmarkError::Run {
            scene: name.to_owned(),
            method: change,
            source,
        })?;
        let user_s = user_seconds().zip(before).map(|(after, before)| after - before);
        let results = read_results(&run.project.output.join("city.city.json"), &run.project.crs)?;
        let found = evaluate_heights(&results, &truth.buildings, &HeightOptions::default())?;
        let large = found.buildings.iter().filter(|building| building.signed_error_m.abs() > LARGE_M);
        rows.push(PassRow {
            scene: name.to_owned(),
            change: (*change).to_owned(),
            n: found.buildings.len(),
            error_mean_m: found.all.as_ref().map_or(f64::NAN, |all| all.error_mean_m),
            n_large: large.count(),
            user_s,
        });
    }
    Ok(())
}
