//! The accuracy matrix: seeds × towns × levels of prior errors, every method on each scene.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::reliability::{self, SigmaClass};
use super::{BenchmarkError, Method, Outcome, Programs, RealTown, SceneJob, SuitePlan, TellScenes, Variant, run_scene};
use sizeup_geo::files::{write_json, write_whole};
use sizeup_results::output::Status;
use sizeup_truth::evaluate::{BuildingError, HeightStatistics};
use sizeup_truth::simulate::{ErrorConfig, PriorLevel, SimulateConfig, TownKind};

/// Errors above this that carry no flag are counted, metres.
const GROSS_M: f64 = 5.0;
/// Errors above this have no business under the status `measured`, metres: two thirds of a storey.
const MISLEADING_M: f64 = 2.0;

/// Places tried per building for the point cloud; about a fifth becomes a point on a building.
const POINTS_PER_BUILDING: usize = 3000;

/// Which scenes make up the matrix.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AccuracyConfig {
    /// One scene per seed, town and level.
    pub seeds: Vec<u64>,
    /// Kinds of towns that are simulated.
    pub towns: Vec<TownKind>,
    /// Towns of real buildings, besides.
    #[serde(default)]
    pub real: Vec<RealTown>,
    /// Levels of prior errors that are simulated.
    pub levels: Vec<PriorLevel>,
    /// Methods that are run.
    pub methods: Vec<Method>,
    /// Buildings of each scene.
    pub n_buildings: usize,
    /// Views per scene, nadir ones included.
    pub n_views: usize,
    /// Size of the views and priors: width and height, pixels.
    pub image_px: [u32; 2],
    /// Size of the photos, where the methods get any (`robust` then settles roofs by them; simulating takes much longer).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photo_px: Option<[u32; 2]>,
    /// Errors of poses and footprints as the methods get them.
    pub errors: ErrorConfig,
}

impl Default for AccuracyConfig {
    fn default() -> Self {
        Self {
            seeds: vec![1, 2, 3, 4, 5],
            towns: vec![TownKind::Village, TownKind::District, TownKind::Downtown],
            real: Vec::new(),
            levels: vec![PriorLevel::Clean, PriorLevel::Mid, PriorLevel::High, PriorLevel::Bleed],
            methods: Method::MAIN.to_vec(),
            n_buildings: 40,
            n_views: 60,
            image_px: [448, 336],
            photo_px: None,
            errors: ErrorConfig::REALISTIC,
        }
    }
}

impl AccuracyConfig {
    /// Seconds instead of minutes: for continuous integration, too small to tell methods apart.
    #[must_use]
    pub fn small() -> Self {
        Self {
            seeds: vec![1],
            towns: vec![TownKind::Village],
            levels: vec![PriorLevel::Clean, PriorLevel::Mid],
            n_buildings: 8,
            n_views: 24,
            image_px: [160, 120],
            ..Self::default()
        }
    }

    fn all_towns(&self) -> impl Iterator<Item = Town> {
        let simulated = self.towns.iter().copied().map(Town::Simulated);
        simulated.chain(self.real.iter().cloned().map(|real| Town::Real(Box::new(real))))
    }

    fn check(&self) -> Result<(), BenchmarkError> {
        let lists = [
            ("seeds", self.seeds.len()),
            ("towns", self.towns.len() + self.real.len()),
            ("levels", self.levels.len()),
            ("methods", self.methods.len()),
        ];
        match lists.into_iter().find(|(_, n)| *n == 0) {
            Some((setting, _)) => Err(BenchmarkError::Empty { setting }),
            None => Ok(()),
        }
    }

    fn job(&self, cell: &Cell) -> SceneJob {
        let mut simulate = SimulateConfig { seed: cell.seed, errors: self.errors, ..SimulateConfig::default() };
        let mut cameras = None;
        match &cell.town {
            Town::Simulated(kind) => (simulate.town.kind, simulate.town.n_buildings) = (*kind, self.n_buildings),
            Town::Real(real) => {
                simulate.cityjson = Some(real.cityjson.clone());
                simulate.errors = real.errors;
                cameras = real.cameras.clone().map(|cameras| (cameras, self.n_views));
            }
        }
        simulate.flight.n_views = Some(self.n_views);
        [simulate.camera.width_px, simulate.camera.height_px] = self.photo_px.unwrap_or(self.image_px);
        simulate.prior.level = cell.level;
        simulate.prior.longest_px = self.image_px[0].max(self.image_px[1]);
        simulate.images.enabled = self.photo_px.is_some();
        if self.methods.iter().any(|m| m.needs_points()) {
            simulate.points.per_view = POINTS_PER_BUILDING * self.n_buildings / self.n_views.max(1);
        }
        SceneJob {
            name: format!("{}-{}-seed{}", cell.town.name(), word(&cell.level), cell.seed),
            simulate,
            variants: self.methods.iter().copied().map(Variant::as_it_is).collect(),
            cameras,
            assignments: vec![format!("optimise.working_px={}", self.image_px[0].max(self.image_px[1]))],
            paper_assignments: Vec::new(),
            with_bodies: false,
        }
    }
}

/// The name of an enumeration's variant in files.
pub(super) fn word(value: &impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Buildings of a scene.
#[derive(Debug, Clone, PartialEq)]
enum Town {
    Simulated(TownKind),
    Real(Box<RealTown>),
}

impl Town {
    fn name(&self) -> String {
        match self {
            Self::Simulated(kind) => word(kind),
            Self::Real(real) => real.name.clone(),
        }
    }
}

#[derive(Debug, Clone)]
struct Cell {
    town: Town,
    level: PriorLevel,
    seed: u64,
}

/// One row: a town (or all), a level and a method, over all seeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AccuracyRow {
    /// Kind of town, or `all`.
    pub town: String,
    /// Level of prior errors.
    pub level: String,
    /// Method that was run.
    pub method: Method,
    /// Over the buildings of all seeds.
    pub statistics: HeightStatistics,
    /// Buildings without a height.
    pub n_without_height: usize,
    /// Buildings off by more than 5 m that are not marked as doubtful.
    pub n_gross_unflagged: usize,
    /// Buildings off by more than 5 m.
    pub n_gross: usize,
    /// Buildings off by more than 2 m whose status is `measured`.
    #[serde(default)]
    pub n_misleading: usize,
    /// Least and greatest mean error over the scenes of the row, metres.
    pub mean_range_m: [f64; 2],
    /// Seconds per scene from priors on disk to heights, mean over scenes.
    pub heights_s: f64,
    /// Processor seconds per scene in user mode, whole run, mean over scenes.
    pub user_s: Option<f64>,
}

/// The matrix as a whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AccuracyTable {
    /// Settings of the simulation.
    pub config: AccuracyConfig,
    /// By level, town and method.
    pub rows: Vec<AccuracyRow>,
    /// Stated sigmas against errors, over all towns; by level and method.
    pub reliability: Vec<SigmaClass>,
    /// Which programs made the outcomes.
    pub programs: Programs,
}

/// Runs the matrix; after every scene `accuracy.json` and `accuracy.md` in the plan's folder hold what there is so far.
///
/// # Errors
/// [`BenchmarkError`].
pub fn run(config: &AccuracyConfig, plan: &SuitePlan, tell: TellScenes<'_>) -> Result<AccuracyTable, BenchmarkError> {
    config.check()?;
    let mut cells = Vec::new();
    // Seeds outermost: a run that is stopped has whole matrices of fewer seeds.
    for &seed in &config.seeds {
        for &level in &config.levels {
            cells.extend(config.all_towns().map(|town| Cell { town, level, seed }));
        }
    }
    let mut outcomes: Vec<(Cell, Outcome)> = Vec::new();
    let mut table = AccuracyTable {
        config: config.clone(),
        rows: Vec::new(),
        reliability: Vec::new(),
        programs: Programs::default(),
    };
    for (i, cell) in cells.iter().enumerate() {
        let job = config.job(cell);
        let found = run_scene(&job, plan, &|what| tell(i, cells.len(), &format!("{}: {what}", job.name)))?;
        outcomes.extend(found.into_iter().map(|outcome| (cell.clone(), outcome)));
        table.rows = rows(config, &outcomes);
        table.reliability = sigma_classes(config, &outcomes);
        table.programs = Programs::of(&plan.program, outcomes.iter().map(|(_, outcome)| outcome));
        write(&table, plan)?;
    }
    tell(cells.len(), cells.len(), "done");
    Ok(table)
}

fn write(table: &AccuracyTable, plan: &SuitePlan) -> Result<(), BenchmarkError> {
    write_json(&plan.folder.join("accuracy.json"), table)?;
    write_whole(&plan.folder.join("accuracy.md"), |out| out.write_all(table.to_markdown().as_bytes()))?;
    Ok(())
}

fn rows(config: &AccuracyConfig, outcomes: &[(Cell, Outcome)]) -> Vec<AccuracyRow> {
    let mut rows = Vec::new();
    for &level in &config.levels {
        let n_towns = config.all_towns().count();
        let towns = config.all_towns().map(Some).chain((n_towns > 1).then_some(None));
        for town in towns {
            for &method in &config.methods {
                let belongs = |(cell, outcome): &&(Cell, Outcome)| {
                    cell.level == level && town.as_ref().is_none_or(|t| cell.town == *t) && outcome.method == method
                };
                let of_row: Vec<&Outcome> = outcomes.iter().filter(belongs).map(|(_, outcome)| outcome).collect();
                let name = town.as_ref().map_or_else(|| "all".to_owned(), Town::name);
                rows.extend(row(name, level, method, &of_row));
            }
        }
    }
    rows
}

fn sigma_classes(config: &AccuracyConfig, outcomes: &[(Cell, Outcome)]) -> Vec<SigmaClass> {
    let mut classes = Vec::new();
    for &level in &config.levels {
        for &method in &config.methods {
            let belongs = |(cell, outcome): &&(Cell, Outcome)| cell.level == level && outcome.method == method;
            let buildings: Vec<&BuildingError> =
                outcomes.iter().filter(belongs).flat_map(|(_, outcome)| &outcome.heights.buildings).collect();
            classes.extend(reliability::sigma_classes(&word(&level), method, &buildings));
        }
    }
    classes
}

fn row(town: String, level: PriorLevel, method: Method, of_row: &[&Outcome]) -> Option<AccuracyRow> {
    let buildings: Vec<&BuildingError> = of_row.iter().flat_map(|o| &o.heights.buildings).collect();
    let is_gross = |b: &&&BuildingError| b.signed_error_m.abs() > GROSS_M;
    let is_misleading = |b: &&&BuildingError| b.signed_error_m.abs() > MISLEADING_M && b.status == Status::Measured;
    let means: Vec<f64> = of_row.iter().filter_map(|o| o.heights.all.as_ref()).map(|s| s.error_mean_m).collect();
    let n = of_row.len() as f64;
    let user: Option<Vec<f64>> = of_row.iter().map(|o| o.user_s).collect();
    Some(AccuracyRow {
        town,
        level: word(&level),
        method,
        statistics: HeightStatistics::of_buildings(buildings.iter().copied())?,
        n_without_height: of_row.iter().map(|o| o.heights.counts.n_unobserved).sum(),
        n_gross_unflagged: buildings.iter().filter(is_gross).filter(|b| b.status == Status::Measured).count(),
        n_gross: buildings.iter().filter(is_gross).count(),
        n_misleading: buildings.iter().filter(is_misleading).count(),
        mean_range_m: [means.iter().copied().fold(f64::INFINITY, f64::min), means.iter().copied().fold(0.0, f64::max)],
        heights_s: of_row.iter().map(|o| o.heights_s).sum::<f64>() / n,
        user_s: user.map(|u| u.iter().sum::<f64>() / n),
    })
}

impl AccuracyTable {
    /// As Markdown, one table per level, with what the columns mean.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let mut by_level: BTreeMap<usize, Vec<&AccuracyRow>> = BTreeMap::new();
        for row in &self.rows {
            let at = self.config.levels.iter().position(|l| word(l) == row.level).unwrap_or(usize::MAX);
            by_level.entry(at).or_default().push(row);
        }
        let mut text = String::new();
        let c = &self.config;
        let e = &c.errors;
        let _ = writeln!(
            text,
            "Simulated towns of {} buildings, {} views of {} × {} px, seeds {:?}; errors: position {} m, angle {}°, footprint \
             corners {} m, footprints {} m too large{}.\n",
            c.n_buildings,
            c.n_views,
            c.image_px[0],
            c.image_px[1],
            c.seeds,
            e.position_m,
            e.angle_deg,
            e.vertex_m,
            e.footprint_m,
            c.photo_px.map_or_else(String::new, |[w, h]| format!("; photos of {w} × {h} px"))
        );
        for rows in by_level.values() {
            let _ = writeln!(text, "**{}**\n", rows[0].level);
            text.push_str(
                "| town | method | n | mean m | scenes' means m | median m | P90 m | max m | bias m | ≤ 1 m | > 2 m and `measured` | > 5 m, of these not flagged | no height | within 1, 2 σ | s (user) |\n\
                 |---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
            );
            for row in rows {
                text.push_str(&row.to_markdown());
            }
            text.push('\n');
        }
        text.push_str(
            "e = |h − h*|, both roof minus ground; h*: mean roof height over its area. Mean, median, 90th percentile (linear \
             interpolation) and maximum of e over the buildings of all seeds; scenes' means: least and greatest mean error of a \
             single scene; bias: mean of h − h*; not flagged: status `measured`; within 1, 2 σ: shares of buildings \
             with a stated sigma whose e is at most that, or twice that (68 and 95 % if errors were normal and sigma right); s: seconds per scene from priors on disk \
             to heights, in brackets processor seconds of the whole run in user mode. ",
        );
        text.push_str(&self.programs.to_markdown());
        text.push_str(&reliability::to_markdown(&self.reliability));
        text
    }
}

impl AccuracyRow {
    fn to_markdown(&self) -> String {
        let s = &self.statistics;
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        format!(
            "| {} | `{}` | {} | {:.2} | {:.2}–{:.2} | {:.2} | {:.2} | {:.1} | {:+.2} | {} | {} | {}, {} | {} | {} | {:.1} ({}) |\n",
            self.town,
            self.method.name(),
            s.n,
            s.error_mean_m,
            self.mean_range_m[0],
            self.mean_range_m[1],
            s.error_median_m,
            s.error_p90_m,
            s.error_max_m,
            s.bias_m,
            percent(s.within_1m_share),
            self.n_misleading,
            self.n_gross,
            self.n_gross_unflagged,
            self.n_without_height,
            s.within_1_sigma_share
                .zip(s.within_2_sigma_share)
                .map_or_else(|| "–".to_owned(), |(one, two)| format!("{}, {}", percent(one), percent(two))),
            self.heights_s,
            self.user_s.map_or_else(|| "–".to_owned(), |s| format!("{s:.1}")),
        )
    }
}
