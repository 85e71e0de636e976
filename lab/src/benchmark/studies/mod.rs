//! What each choice of the `paper` method is worth: one setting after the other changed, on simulated towns.
//!
//! Every town is solved with several seeds of the solver, which draw the heights that it starts from, the order of the
//! views and the pairs of pixels. The seeds of the towns are others than those that any choice was made on.

mod tables;

use std::collections::BTreeMap;
use std::fs;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::accuracy::word;
use super::{BenchmarkError, Method, Outcome, Programs, SceneJob, SuitePlan, TellScenes, Variant, run_scene};
use sizeup_geo::files::{FileError, write_json, write_whole};
use sizeup_heights::stats;
use sizeup_truth::evaluate::{HeightStatistics, SurfaceEvaluation};
use sizeup_truth::simulate::{ErrorConfig, FootprintsOf, PriorLevel, SimulateConfig, TownKind};

/// Mean relative change of the heights below which the paper calls an optimisation stable.
const STABLE_CHANGE: f64 = 0.005;
/// More views than any town has.
const ALL_VIEWS: usize = 1_000_000;

/// Setting that is changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Study {
    /// Dynamic view selection, all oblique views, as many random ones.
    Views,
    /// Views per building (k).
    Cover,
    /// Percentile of the gate.
    Gate,
    /// Epochs between two selections of views.
    Refresh,
    /// Least contrast of a pair (`τ_d`).
    Contrast,
    /// Margin of the hinge (m).
    Margin,
    /// Ordinal pairs drawn per view.
    Pairs,
    /// Ordinal loss, or regression with everything else the same.
    Loss,
    /// Heights that are started from.
    Start,
    /// A step per view, or along the sum over views; and its length.
    Step,
    /// Which part of the derivative is followed.
    Gradient,
    /// Greatest height that is searched for.
    Range,
    /// A footprint per building, or per roof level (the paper's finer components).
    Components,
}

/// A setting, and the values that it takes.
type Values = (&'static str, &'static [&'static str]);

impl Study {
    /// All, in the order of the tables.
    pub const ALL: [Self; 13] = [
        Self::Views,
        Self::Cover,
        Self::Gate,
        Self::Refresh,
        Self::Contrast,
        Self::Margin,
        Self::Pairs,
        Self::Loss,
        Self::Start,
        Self::Step,
        Self::Gradient,
        Self::Range,
        Self::Components,
    ];

    /// Settings that are changed one at a time.
    fn settings(self) -> &'static [Values] {
        match self {
            Self::Views | Self::Components => &[],
            Self::Cover => &[("optimise.views.min_views_per_building", &["1", "2", "3", "5", "8"])],
            Self::Gate => &[("optimise.views.gate_percentile", &["0.0", "25.0", "75.0"])],
            Self::Refresh => &[("optimise.ordinal.reselect_every", &["1", "5", "20"])],
            Self::Contrast => &[("optimise.ordinal.min_contrast", &["0.01", "0.1", "0.2", "0.5"])],
            Self::Margin => &[("optimise.ordinal.margin", &["0.05", "0.1", "0.25", "1.0"])],
            Self::Pairs => &[("optimise.ordinal.n_pairs", &["256", "1024", "8192"])],
            Self::Loss => &[("optimise.ordinal.loss", &["l1", "l2"])],
            Self::Start => &[
                ("optimise.ordinal.start_mean_share", &["0.0", "0.25", "0.5", "0.75"]),
                ("optimise.ordinal.start_sigma_share", &["0.0", "0.1", "0.25"]),
            ],
            Self::Step => &[
                ("optimise.ordinal.steps_per_epoch", &["5", "10", "20"]),
                ("optimise.ordinal.step_m", &["[3.0,0.3]", "[12.0,0.3]", "[1.0,1.0]", "[6.0,0.03]", "[6.0,0.003]"]),
            ],
            Self::Gradient => &[
                ("optimise.ordinal.gradient", &["central_difference", "edge_sampled"]),
                ("optimise.ordinal.mad_gradient", &["exact"]),
            ],
            Self::Range => &[("heights.max_m", &["60.0", "90.0", "150.0"])],
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::Views => "Which views",
            Self::Cover => "Views that each building is seen from (k, paper: 3), no others selected",
            Self::Gate => "Percentile of the gate (paper: 50)",
            Self::Refresh => "Epochs between selections (paper: 3)",
            Self::Contrast => "Least contrast of a pair (τ_d, paper: 0.05)",
            Self::Margin => "Margin (m, paper: 0.5)",
            Self::Pairs => "Pairs per view (paper: 2048)",
            Self::Loss => "Loss, everything else the same",
            Self::Start => "Heights that are started from (mean and width left open)",
            Self::Step => "Steps (left open)",
            Self::Gradient => "Derivative (left open)",
            Self::Range => "Greatest height (from elevation and flying height; how is left open)",
            Self::Components => "Several heights in one building: its roof levels as footprints of their own",
        }
    }

    fn variants(self) -> Vec<PlannedRow> {
        let of = |(key, values): &Values| {
            let of_value = |value: &&str| {
                let short = key.rsplit('.').next().unwrap_or(key);
                let mut assignments = vec![format!("{key}={value}")];
                if short == "steps_per_epoch" {
                    // Counted along the sum over views only.
                    assignments.push("optimise.ordinal.step_on=all_views".to_owned());
                }
                if self == Self::Cover {
                    // The views that are spread over the survey see every building often enough, whatever k.
                    assignments.push("optimise.views.n_spread=0".to_owned());
                }
                PlannedRow { label: format!("{short} = {value}"), assignments }
            };
            values.iter().map(of_value).collect::<Vec<_>>()
        };
        self.settings().iter().flat_map(of).collect()
    }
}

/// The method as it is configured by default.
const AS_IT_IS: &str = "as it is";
const ALL_OBLIQUE: &str = "all oblique views";
const RANDOM: &str = "random views, as many as are used";
const OF_BUILDINGS: &str = "a footprint per building";
const OF_LEVELS: &str = "a footprint per roof level";

/// A row of a study, not run yet.
struct PlannedRow {
    label: String,
    assignments: Vec<String>,
}

/// Which studies run, on what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StudyConfig {
    /// Settings that are changed; empty: no study.
    pub of: Vec<Study>,
    /// Seeds of the towns.
    pub seeds: Vec<u64>,
    /// Kinds of towns that are simulated.
    pub towns: Vec<TownKind>,
    /// Seeds of the solver; each town is solved with each.
    pub solver_seeds: Vec<u64>,
    /// Level of prior errors.
    pub level: PriorLevel,
    /// Errors of poses and footprints as the method gets them.
    pub errors: ErrorConfig,
    /// Buildings of each town.
    pub n_buildings: usize,
    /// Views per town, nadir ones included.
    pub n_views: usize,
    /// Longer side of the views and priors, pixels.
    pub longest_px: u32,
}

impl Default for StudyConfig {
    fn default() -> Self {
        Self {
            of: Study::ALL.to_vec(),
            seeds: vec![31, 32],
            towns: vec![TownKind::Village, TownKind::District, TownKind::Downtown],
            solver_seeds: vec![1, 2],
            level: PriorLevel::Mid,
            errors: ErrorConfig::REALISTIC,
            n_buildings: 40,
            n_views: 160,
            longest_px: 320,
        }
    }
}

impl StudyConfig {
    /// Seconds instead of minutes.
    #[must_use]
    pub fn small() -> Self {
        Self {
            of: vec![Study::Views, Study::Margin],
            seeds: vec![31],
            towns: vec![TownKind::Village],
            solver_seeds: vec![1, 2],
            n_buildings: 8,
            n_views: 40,
            longest_px: 160,
            ..Self::default()
        }
    }

    fn job(&self, town: TownKind, seed: u64) -> SceneJob {
        let mut simulate = SimulateConfig { seed, errors: self.errors, ..SimulateConfig::default() };
        (simulate.town.kind, simulate.town.n_buildings) = (town, self.n_buildings);
        simulate.flight.n_views = Some(self.n_views);
        (simulate.prior.level, simulate.prior.longest_px) = (self.level, self.longest_px);
        (simulate.camera.width_px, simulate.camera.height_px) = (self.longest_px, self.longest_px * 3 / 4);
        simulate.images.enabled = false;
        let name = format!("study-{}-{}-seed{seed}", word(&town), word(&self.level));
        let assignments = vec![format!("optimise.working_px={}", self.longest_px)];
        SceneJob { assignments, ..SceneJob::of_scene(name, simulate) }
    }
}

/// One value of one setting, over all towns and solver seeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StudyRow {
    /// Value of the setting, as it is written.
    pub label: String,
    /// Over the buildings of all runs.
    pub statistics: HeightStatistics,
    /// Least and greatest mean error of a run, metres.
    pub run_means_m: [f64; 2],
    /// Greatest less least mean error of a town over the solver's seeds, mean over the towns, metres.
    pub by_solver_seed_m: f64,
    /// Views selected in the last pass (the paper's #Sel), mean over runs.
    pub n_selected: f64,
    /// Distinct views used (the paper's #Used), mean over runs.
    pub n_used: f64,
    /// Used views as a share of all.
    pub used_share: f64,
    /// Seconds from priors on disk to heights, mean over runs.
    pub heights_s: f64,
    /// Buildings without a height.
    pub n_without_height: usize,
    /// Runs that fell below the paper's 0.5 % in some pass.
    #[serde(default)]
    pub stable_share: f64,
    /// Distance from the result's walls and roofs that 90 % keep to the true ones, metres, and shares of the true ones within
    /// 0.5 and 1 m of the result; mean over runs, where bodies were compared.
    #[serde(default)]
    pub bodies: Option<[f64; 3]>,
}

/// Whether a run has fallen below the paper's 0.5 % in one of its first passes.
fn is_stable_by(run: &Outcome, n_passes: usize) -> bool {
    run.passes.iter().take(n_passes).any(|pass| pass.relative_change < STABLE_CHANGE)
}

/// The heights of the method as it is after one pass, over all runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StabilityRow {
    /// Number of passes made.
    pub epoch: usize,
    /// Mean loss over the runs.
    pub loss: f64,
    /// Mean relative change of the heights in this pass.
    pub relative_change: f64,
    /// Runs that have fallen below the paper's 0.5 % by now.
    pub stable_share: f64,
    /// Mean distance from the heights after the last pass, metres.
    pub to_last_m: f64,
}

/// Tables of all studies.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct StudyTables {
    /// Settings of the run; `None`: nothing.
    pub config: Option<StudyConfig>,
    /// By study, its rows; the method as it is comes first.
    pub studies: Vec<(Study, Vec<StudyRow>)>,
    /// Heights after each pass, in order.
    pub stability: Vec<StabilityRow>,
    /// Which programs made the outcomes.
    pub programs: Programs,
}

/// Outcomes by the row's label; those of a town stand together, by solver seed.
type Outcomes = BTreeMap<String, Vec<Outcome>>;

/// Runs the studies; after every town `studies.json` and `studies.md` in the plan's folder hold what there is so far.
///
/// # Errors
/// [`BenchmarkError`].
pub fn run(config: &StudyConfig, plan: &SuitePlan, tell: TellScenes<'_>) -> Result<StudyTables, BenchmarkError> {
    if config.of.is_empty() {
        return Ok(StudyTables::default());
    }
    let lists =
        [("seeds", config.seeds.len()), ("towns", config.towns.len()), ("solver_seeds", config.solver_seeds.len())];
    if let Some((setting, _)) = lists.into_iter().find(|(_, n)| *n == 0) {
        return Err(BenchmarkError::Empty { setting });
    }
    let towns: Vec<(u64, TownKind)> =
        config.seeds.iter().flat_map(|&seed| config.towns.iter().map(move |&town| (seed, town))).collect();
    let mut outcomes = Outcomes::new();
    let mut tables = StudyTables::default();
    for (i, &(seed, town)) in towns.iter().enumerate() {
        let job = config.job(town, seed);
        run_town(config, &job, plan, &|what| tell(i, towns.len(), &format!("{}: {what}", job.name)), &mut outcomes)?;
        tables = StudyTables {
            config: Some(config.clone()),
            studies: config.of.iter().map(|&study| (study, rows(config, study, &outcomes))).collect(),
            stability: stability(&outcomes[AS_IT_IS]),
            programs: Programs::of(&plan.program, outcomes.values().flatten()),
        };
        write_json(&plan.folder.join("studies.json"), &tables)?;
        write_whole(&plan.folder.join("studies.md"), |out| out.write_all(tables.to_markdown().as_bytes()))?;
    }
    tell(towns.len(), towns.len(), "done");
    Ok(tables)
}

/// Everything on one town.
fn run_town(
    config: &StudyConfig,
    job: &SceneJob,
    plan: &SuitePlan,
    tell: &dyn Fn(&str),
    outcomes: &mut Outcomes,
) -> Result<(), BenchmarkError> {
    // Simulated once, and removed in the end unless it is to be kept.
    let keeping = SuitePlan { keep_scenes: true, ..plan.clone() };
    let mut wanted = vec![PlannedRow { label: AS_IT_IS.to_owned(), assignments: Vec::new() }];
    wanted.extend(config.of.iter().flat_map(|study| study.variants()));
    if config.of.contains(&Study::Views) {
        let settings = ["gate_percentile=0.0".to_owned(), format!("n_spread={ALL_VIEWS}")];
        let assignments = settings.map(|setting| format!("optimise.views.{setting}")).to_vec();
        wanted.push(PlannedRow { label: ALL_OBLIQUE.to_owned(), assignments });
    }
    let run_rows = |rows: &[PlannedRow], outcomes: &mut Outcomes| -> Result<(), BenchmarkError> {
        let variants = rows.iter().flat_map(|row| seeded(config, row)).collect();
        let found = run_scene(&SceneJob { variants, ..job.clone() }, &keeping, tell)?;
        for (row, of_row) in rows.iter().zip(found.chunks(config.solver_seeds.len())) {
            outcomes.entry(row.label.clone()).or_default().extend(of_row.iter().cloned());
        }
        Ok(())
    };
    run_rows(&wanted, outcomes)?;
    if config.of.contains(&Study::Views) {
        let used: Vec<f64> =
            outcomes[AS_IT_IS].iter().filter(|o| o.scene == job.name).map(|o| o.n_used as f64).collect();
        let n_used = stats::mean(&used).unwrap_or(0.0).round();
        let settings = ["choice=random".to_owned(), format!("n_spread={n_used}")];
        let assignments = settings.map(|setting| format!("optimise.views.{setting}")).to_vec();
        run_rows(&[PlannedRow { label: RANDOM.to_owned(), assignments }], outcomes)?;
    }
    if config.of.contains(&Study::Components) {
        for (label, footprints) in [(OF_BUILDINGS, FootprintsOf::Buildings), (OF_LEVELS, FootprintsOf::RoofLevels)] {
            let mut job = SceneJob { with_bodies: true, ..job.clone() };
            if footprints == FootprintsOf::RoofLevels {
                job.name.push_str("-levels");
                job.simulate.town.footprints = footprints;
            }
            let row = PlannedRow { label: label.to_owned(), assignments: Vec::new() };
            let found = run_scene(&SceneJob { variants: seeded(config, &row), ..job.clone() }, plan, tell)?;
            outcomes.entry(row.label).or_default().extend(found);
        }
    }
    let folder = plan.folder.join("scenes").join(&job.name);
    if folder.exists() && !plan.keep_scenes {
        fs::remove_dir_all(&folder).map_err(FileError::on("remove", &folder))?;
    }
    Ok(())
}

/// A row's settings with each seed of the solver.
fn seeded(config: &StudyConfig, row: &PlannedRow) -> Vec<Variant> {
    let with_seed = |seed: &u64| Variant {
        method: Method::Paper,
        name: file_name(&row.label, *seed),
        assignments: row.assignments.iter().cloned().chain([format!("seed={seed}")]).collect(),
    };
    config.solver_seeds.iter().map(with_seed).collect()
}

fn file_name(label: &str, seed: u64) -> String {
    let plain = label.chars().map(|c| if c.is_ascii_alphanumeric() || c == '.' { c } else { '_' });
    format!("{}-{seed}", plain.collect::<String>())
}

fn rows(config: &StudyConfig, study: Study, outcomes: &Outcomes) -> Vec<StudyRow> {
    let named = |labels: &[&str]| labels.iter().map(|label| (*label).to_owned()).collect::<Vec<_>>();
    let labels: Vec<String> = match study {
        Study::Views => named(&[AS_IT_IS, ALL_OBLIQUE, RANDOM]),
        Study::Components => named(&[OF_BUILDINGS, OF_LEVELS]),
        _ => std::iter::once(AS_IT_IS.to_owned()).chain(study.variants().into_iter().map(|row| row.label)).collect(),
    };
    labels.into_iter().filter_map(|label| row(config, &label, outcomes.get(&label)?)).collect()
}

fn row(config: &StudyConfig, label: &str, of_row: &[Outcome]) -> Option<StudyRow> {
    let mean =
        |value: &dyn Fn(&Outcome) -> f64| stats::mean(&of_row.iter().map(value).collect::<Vec<_>>()).unwrap_or(0.0);
    let errors_m = |runs: &[Outcome]| {
        let means: Vec<f64> = runs.iter().filter_map(|o| o.heights.all.as_ref()).map(|s| s.error_mean_m).collect();
        [means.iter().copied().fold(f64::INFINITY, f64::min), means.iter().copied().fold(0.0, f64::max)]
    };
    let of_towns = of_row.chunks(config.solver_seeds.len()).map(errors_m);
    let ranges: Vec<f64> = of_towns.map(|[least, greatest]| (greatest - least).max(0.0)).collect();
    Some(StudyRow {
        label: label.to_owned(),
        statistics: HeightStatistics::of_buildings(of_row.iter().flat_map(|o| &o.heights.buildings))?,
        run_means_m: errors_m(of_row),
        by_solver_seed_m: stats::mean(&ranges).unwrap_or(0.0),
        n_selected: mean(&|o| o.n_selected as f64),
        n_used: mean(&|o| o.n_used as f64),
        used_share: mean(&|o| o.n_used as f64 / o.n_views.max(1) as f64),
        heights_s: mean(&|o| o.heights_s),
        n_without_height: of_row.iter().map(|o| o.heights.counts.n_unobserved).sum(),
        stable_share: mean(&|o| f64::from(u8::from(is_stable_by(o, usize::MAX)))),
        bodies: bodies(of_row),
    })
}

/// Mean over the runs whose bodies were compared.
fn bodies(of_row: &[Outcome]) -> Option<[f64; 3]> {
    let surfaces: Vec<_> = of_row.iter().filter_map(|o| o.bodies.as_ref()?.surface.as_ref()).collect();
    let mean = |of: fn(&SurfaceEvaluation) -> f64| stats::mean(&surfaces.iter().map(|s| of(s)).collect::<Vec<_>>());
    Some([mean(|s| s.error_90_m)?, mean(|s| s.completeness_05)?, mean(|s| s.completeness_1)?])
}

fn stability(runs: &[Outcome]) -> Vec<StabilityRow> {
    let n_epochs = runs.iter().map(|o| o.passes.len()).max().unwrap_or(0);
    let of_epoch = |epoch: usize| {
        let mean = |value: &dyn Fn(&super::Pass) -> f64| {
            let values: Vec<f64> = runs.iter().filter_map(|o| o.passes.get(epoch)).map(value).collect();
            stats::mean(&values).unwrap_or(0.0)
        };
        StabilityRow {
            epoch: epoch + 1,
            loss: mean(&|pass| pass.loss),
            relative_change: mean(&|pass| pass.relative_change),
            stable_share: runs.iter().filter(|run| is_stable_by(run, epoch + 1)).count() as f64
                / runs.len().max(1) as f64,
            to_last_m: mean(&|pass| pass.to_last_m),
        }
    };
    (0..n_epochs).map(of_epoch).collect()
}
