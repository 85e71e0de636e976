//! One scene: simulate it where some outcome is missing, run the methods, keep one small file per method.

use std::cell::{Cell, RefCell};
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::bodies::{BodyScores, score, true_bodies};
use super::method::Aids;
use super::{BenchmarkError, Method, RealCameras, SuitePlan};
use sizeup::config::{RunConfig, parse};
use sizeup::pipeline::{RunOptions, RunSummary, Stage, run_with};
use sizeup_geo::cloud;
use sizeup_geo::crs::Crs;
use sizeup_geo::files::{FileError, write_whole};
use sizeup_heights::optimise::{EpochRecord, OptimiseConfig, Problem};
use sizeup_heights::stats;
use sizeup_results::output::sha256_hex;
use sizeup_truth::evaluate::read::{TruthOptions, read_results, read_truth};
use sizeup_truth::evaluate::solid::{Solid, SolidError, read_solids};
use sizeup_truth::evaluate::{HeightEvaluation, HeightOptions, TruthBuilding, evaluate_heights};
use sizeup_truth::simulate::{SimulateConfig, simulate, simulate_with_views};

/// A method with settings of its own, under a name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Variant {
    /// Method that is run.
    pub method: Method,
    /// Unique among the scene's runs; empty for the method as it is.
    pub name: String,
    /// `table.key=value` settings on top of the job's.
    pub assignments: Vec<String>,
}

impl Variant {
    /// A method with the settings that it has in its job.
    #[must_use]
    pub fn as_it_is(method: Method) -> Self {
        Self { method, name: String::new(), assignments: Vec::new() }
    }

    fn file_name(&self, scene: &str) -> String {
        let dash = if self.name.is_empty() { "" } else { "-" };
        format!("{scene}-{}{dash}{}.json", self.method.name(), self.name)
    }
}

/// A scene and what runs on it.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneJob {
    /// Unique name, part of file names.
    pub name: String,
    /// Settings that simulate the scene.
    pub simulate: SimulateConfig,
    /// Methods that are run.
    pub variants: Vec<Variant>,
    /// Real cameras in place of the scene's flight, and how many of them.
    pub cameras: Option<(RealCameras, usize)>,
    /// `table.key=value` settings of the runs, on top of the scene's own.
    pub assignments: Vec<String>,
    /// Settings of the runs of `paper` and of what differs from it by the loss alone.
    pub paper_assignments: Vec<String>,
    /// Whether bodies are compared with the true ones too.
    pub with_bodies: bool,
}

impl SceneJob {
    /// A simulated scene with its own flight, and nothing that runs on it yet.
    #[must_use]
    pub fn of_scene(name: impl Into<String>, simulate: SimulateConfig) -> Self {
        Self {
            name: name.into(),
            simulate,
            variants: Vec::new(),
            cameras: None,
            assignments: Vec::new(),
            paper_assignments: Vec::new(),
            with_bodies: false,
        }
    }

    fn assignments_of(&self, variant: &Variant) -> Vec<String> {
        let own = if variant.method.selects_as_paper() { &*self.paper_assignments } else { &[] };
        self.assignments.iter().chain(own).chain(&variant.assignments).cloned().collect()
    }

    /// All that the scene is made from.
    fn scene_settings(&self) -> serde_json::Value {
        match &self.cameras {
            Some(cameras) => serde_json::json!([self.simulate, cameras]),
            None => serde_json::json!(self.simulate),
        }
    }
}

/// Outcome of a method on a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Name of the scene.
    pub scene: String,
    /// Method that was run.
    pub method: Method,
    /// Name of its settings; empty for the method as it is.
    #[serde(default)]
    pub variant: String,
    /// Hash of the settings of scene and method.
    pub settings_sha256: String,
    /// The program that made it; empty where that was not written down.
    #[serde(default)]
    pub program: String,
    /// Heights against the truth.
    pub heights: HeightEvaluation,
    /// Views of the scene.
    pub n_views: usize,
    /// Views selected in the last pass (the paper's #Sel).
    pub n_selected: usize,
    /// Distinct views whose prior was used (the paper's #Used).
    pub n_used: usize,
    /// Seconds from priors on disk to heights, by the wall clock.
    pub heights_s: f64,
    /// Processor seconds of the whole run in user mode, all threads; `None` where the system does not tell.
    pub user_s: Option<f64>,
    /// Bodies against the true ones, where that was asked for: a block for each building or part, or what the method makes itself.
    #[serde(default)]
    pub bodies: Option<BodyScores>,
    /// The same of the result's highest level of detail, with the forms of roofs; only of `robust`, which alone finds them.
    #[serde(default)]
    pub formed_bodies: Option<BodyScores>,
    /// Pass by pass, for methods that have passes.
    #[serde(default)]
    pub passes: Vec<Pass>,
}

/// One pass over all views or buildings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pass {
    /// Mean loss over the views.
    pub loss: f64,
    /// Mean relative change of the heights, 0..1 (the paper's measure of stability).
    pub relative_change: f64,
    /// Mean distance of the heights after this pass from those after the last, metres.
    pub to_last_m: f64,
}

fn passes(history: &[EpochRecord]) -> Vec<Pass> {
    let last = history.last().map_or(&[][..], |epoch| &epoch.heights_m);
    let to_last_m = |heights_m: &[f32]| {
        let ways: Vec<f64> = heights_m.iter().zip(last).map(|(h, end)| f64::from((h - end).abs())).collect();
        stats::mean(&ways).unwrap_or(0.0)
    };
    let pass = |epoch: &EpochRecord| Pass {
        loss: epoch.loss,
        relative_change: epoch.relative_change,
        to_last_m: to_last_m(&epoch.heights_m),
    };
    history.iter().map(pass).collect()
}

/// The outcomes of a scene, in the order of its variants; from files where they are there and still hold.
///
/// # Errors
/// [`BenchmarkError`].
pub fn run_scene(job: &SceneJob, plan: &SuitePlan, tell: &dyn Fn(&str)) -> Result<Vec<Outcome>, BenchmarkError> {
    let mut scene: Option<PathBuf> = None;
    let mut outcomes = Vec::new();
    for variant in &job.variants {
        let path = plan.folder.join("outcomes").join(variant.file_name(&job.name));
        let settings_sha256 = settings_sha256(job, variant);
        let is_wanted = |outcome: &Outcome| {
            let is_outdated = plan.again.outdated && outcome.program != plan.program;
            !(is_outdated || plan.again.methods.contains(&variant.method))
        };
        let known = read_outcome(&path, &settings_sha256).filter(is_wanted);
        let outcome = match known {
            Some(outcome) => outcome,
            None => {
                let folder = match &scene {
                    Some(folder) => folder.clone(),
                    None => {
                        tell("simulating");
                        scene.insert(simulated(job, plan)?).clone()
                    }
                };
                tell(&format!("{} {}", variant.method.name(), variant.name));
                let outcome =
                    run_variant(job, variant, &folder, Origin { settings_sha256, program: plan.program.clone() })?;
                write_whole(&path, |out| Ok(serde_json::to_writer(out, &outcome)?))?;
                outcome
            }
        };
        outcomes.push(outcome);
    }
    if let Some(folder) = scene.filter(|_| !plan.keep_scenes) {
        fs::remove_dir_all(&folder).map_err(FileError::on("remove", &folder))?;
    }
    Ok(outcomes)
}

fn settings_sha256(job: &SceneJob, variant: &Variant) -> String {
    let parts = serde_json::json!([
        env!("CARGO_PKG_VERSION"),
        job.scene_settings(),
        job.assignments_of(variant),
        job.with_bodies.then_some("blocks, and the highest level of detail"),
        variant.method
    ]);
    sha256_hex(parts.to_string().as_bytes())
}

/// An outcome of an earlier run; one that does not fit or cannot be read is made anew.
fn read_outcome(path: &Path, settings_sha256: &str) -> Option<Outcome> {
    let outcome: Outcome = serde_json::from_slice(&fs::read(path).ok()?).ok()?;
    (outcome.settings_sha256 == settings_sha256).then_some(outcome)
}

/// The folder of the scene. A finished one says with which settings it was made.
pub(super) fn simulated(job: &SceneJob, plan: &SuitePlan) -> Result<PathBuf, BenchmarkError> {
    let folder = plan.folder.join("scenes").join(&job.name);
    let stamp = folder.join("settings.sha256");
    let sha256 =
        sha256_hex(serde_json::json!([env!("CARGO_PKG_VERSION"), job.scene_settings()]).to_string().as_bytes());
    if fs::read_to_string(&stamp).is_ok_and(|found| found == sha256) {
        return Ok(folder);
    }
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(FileError::on("remove", &folder))?;
    }
    let made = match &job.cameras {
        Some((cameras, n)) => {
            let views = cameras.views(*n);
            let views = views.map_err(|source| BenchmarkError::Cameras { scene: job.name.clone(), source })?;
            simulate_with_views(&job.simulate, &views, &folder, &|_, _| {})
        }
        None => simulate(&job.simulate, &folder, &|_, _| {}),
    };
    made.map_err(|source| BenchmarkError::Simulate { scene: job.name.clone(), source })?;
    write_whole(&stamp, |out| out.write_all(sha256.as_bytes()))?;
    Ok(folder)
}

/// Origin of an outcome: inputs and program.
struct Origin {
    settings_sha256: String,
    program: String,
}

/// Tables of the method that studies change, and a configuration does not have.
const ORDINAL: &str = "optimise.ordinal.";
const VIEWS: &str = "optimise.views.";

/// Splits an assignment to one of these tables.
fn method_settings(assignment: &str) -> Option<(&'static str, &str)> {
    [ORDINAL, VIEWS].into_iter().find_map(|table| Some((table, assignment.strip_prefix(table)?)))
}

fn run_variant(job: &SceneJob, variant: &Variant, folder: &Path, origin: Origin) -> Result<Outcome, BenchmarkError> {
    let method = variant.method;
    let failed = |source| BenchmarkError::Config { scene: job.name.clone(), source };
    let (of_method, of_run): (Vec<String>, Vec<String>) =
        job.assignments_of(variant).into_iter().partition(|assignment| method_settings(assignment).is_some());
    let mut config = RunConfig::load(&folder.join("sizeup.toml"), &of_run).map_err(failed)?;
    let of = |table| of_method.iter().filter_map(|a| method_settings(a)).filter(move |(name, _)| *name == table);
    let of = |table| of(table).map(|(_, assignment)| assignment.to_owned()).collect::<Vec<String>>();
    config.optimise.ordinal = parse("", None, &of(ORDINAL)).map_err(failed)?;
    config.optimise.views = parse("", None, &of(VIEWS)).map_err(failed)?;
    method.configure(&mut config);
    config.output.pictures = false;
    config.output.report.page = false;
    config.project.output = folder.join(format!("result-{}", method.name()));
    let options = RunOptions {
        from: Stage::Survey,
        until: Stage::Output,
        command: format!("sizeup-lab benchmark: {} by {}", job.name, method.name()),
    };
    let crs = config.project.crs.clone();
    let truth = read_truth(&folder.join("truth.geojson"), &TruthOptions::default(), &crs)?;
    let aids = aids(method, folder, &truth.buildings)?;
    let (n_selected, own_bodies, history) = (Cell::new(0), RefCell::new(None), RefCell::new(Vec::new()));
    let solver = |problem: &Problem<'_>, config: &OptimiseConfig| {
        let answer = method.answer(problem, config, &aids);
        n_selected.set(answer.solution.history.last().map_or(0, |epoch| epoch.n_selected));
        own_bodies.replace(answer.bodies);
        history.replace(passes(&answer.solution.history));
        answer.solution
    };
    let user_before = user_seconds();
    let summary = run_with(&config, &options, &|_| {}, &solver).map_err(|source| BenchmarkError::Run {
        scene: job.name.clone(),
        method: method.name(),
        source,
    })?;
    let user_s = user_seconds().zip(user_before).map(|(after, before)| after - before);
    let city = config.project.output.join("city.city.json");
    let results = read_results(&city, &crs)?;
    let (mut bodies, mut formed_bodies) = (None, None);
    if job.with_bodies {
        let truth = true_bodies(&job.name, &job.simulate)?;
        let against_truth = |bodies: &[Solid]| Some(score(bodies, &truth, job.simulate.seed));
        let extruded = || results.iter().filter_map(Solid::of_record).collect::<Vec<Solid>>();
        bodies = against_truth(&own_bodies.take().unwrap_or_else(extruded));
        if method == Method::Robust {
            formed_bodies = against_truth(&highest_bodies(&city, &crs)?);
        }
    }
    Ok(Outcome {
        scene: job.name.clone(),
        method,
        variant: variant.name.clone(),
        settings_sha256: origin.settings_sha256,
        program: origin.program,
        heights: evaluate_heights(&results, &truth.buildings, &HeightOptions::default())?,
        n_views: summary.n_views,
        n_selected: n_selected.get(),
        n_used: summary.n_used_views,
        heights_s: seconds_of(&summary, Stage::Heights),
        user_s,
        bodies,
        formed_bodies,
        passes: history.take(),
    })
}

/// A result's bodies at their highest level of detail, as surfaces alone: no prisms describe them.
fn highest_bodies(city: &Path, crs: &Crs) -> Result<Vec<Solid>, SolidError> {
    let found = read_solids(city, None, Some(crs), crs)?;
    Ok(found.solids.into_iter().map(|solid| Solid { prisms: Vec::new(), ..solid }).collect())
}

/// Evidence that the method needs beside priors.
fn aids(method: Method, folder: &Path, truth: &[TruthBuilding]) -> Result<Aids, BenchmarkError> {
    let points = if method.needs_points() { cloud::read(&folder.join("points.xyz"))?.points } else { Vec::new() };
    Ok(Aids { points, known: if method.needs_known() { Aids::known_of(truth) } else { Vec::new() } })
}

fn seconds_of(summary: &RunSummary, stage: Stage) -> f64 {
    summary.seconds.iter().filter(|(s, _)| s == stage.name()).map(|(_, seconds)| seconds).sum()
}

/// Processor seconds that this process spent in user mode, from Linux' `/proc`, in hundredths (`USER_HZ` is 100
/// everywhere).
pub(super) fn user_seconds() -> Option<f64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    // The command's name, in brackets, may hold spaces; `utime` is the twelfth field after it.
    let ticks: f64 = stat.rsplit_once(')')?.1.split_whitespace().nth(11)?.parse().ok()?;
    Some(ticks / 100.0)
}
