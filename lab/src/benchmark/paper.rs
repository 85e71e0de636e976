//! Tables in the paper's layout, on scenes of our own that share its counts.
//!
//! The paper's scenes are not public in a form that anybody could run. Ours have as many buildings and views as each of
//! its seven, buildings about as high, the same number of views per selection (#Sel), and simulated priors: a comparison of methods on
//! them is fair, one with the paper's own numbers is not. Those stand in tables of their own.

use std::fmt::Write as _;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::studies::{self, StudyConfig, StudyTables};
use super::{
    BenchmarkError, BodyScores, Method, Outcome, Programs, SceneJob, SuitePlan, TellScenes, Variant, run_scene,
};
use sizeup_geo::files::{write_json, write_whole};
use sizeup_truth::simulate::{ErrorConfig, FlightPattern, PriorLevel, SimulateConfig};

/// Points tried per building for the point cloud.
const POINTS_PER_BUILDING: usize = 3000;
/// Buildings and views of the mini-scenes and of the flight without a grid.
const MINI: (usize, usize) = (24, 60);
const FREE: (usize, usize) = (40, 120);

/// A row of the paper's table of heights: #Sel, #Used, ratio, seconds, error mean and 90 %, accuracy mean and 90 %.
type PublishedHeights = (u32, u32, f64, f64, [f64; 2], [f64; 2]);

/// A scene of the suite.
struct PaperScene {
    name: &'static str,
    /// Name of the simulation preset.
    preset: &'static str,
    /// Views per selection of the `paper` method.
    n_selected: usize,
    /// Statement of the paper on its scene of that name.
    published: Option<PublishedHeights>,
    /// The paper's flying height and the mean height of its buildings, metres.
    flight_and_buildings_m: Option<[f64; 2]>,
    change: fn(&mut SimulateConfig),
}

fn as_it_is(_: &mut SimulateConfig) {}

fn mini(config: &mut SimulateConfig) {
    (config.town.n_buildings, config.flight.n_views) = (MINI.0, Some(MINI.1));
}

fn free(config: &mut SimulateConfig) {
    (config.town.n_buildings, config.flight.n_views) = (FREE.0, Some(FREE.1));
    config.flight.pattern = FlightPattern::Free;
}

/// All scenes; published numbers: the paper, tables "Height estimation" and "Proxy construction". Its buildings' mean height follows from
/// the first: mean error / (1 − mean accuracy). It names flying heights of 200, 200, 100 and 300 m; we give them to the scenes of the second
/// table in its order, and 200 m to the others.
const SCENES: [PaperScene; 11] = [
    PaperScene {
        name: "res-1",
        preset: "res-1",
        n_selected: 50,
        published: Some((50, 101, 0.27, 19.0, [3.28, 7.19], [93.45, 88.34])),
        flight_and_buildings_m: Some([200.0, 50.0]),
        change: as_it_is,
    },
    PaperScene {
        name: "res-2",
        preset: "res-2",
        n_selected: 100,
        published: Some((100, 287, 0.17, 38.0, [7.47, 15.93], [85.95, 61.07])),
        flight_and_buildings_m: Some([200.0, 53.0]),
        change: as_it_is,
    },
    PaperScene {
        name: "res-3",
        preset: "res-3",
        n_selected: 50,
        published: Some((50, 175, 0.10, 42.0, [2.08, 4.63], [93.11, 81.29])),
        flight_and_buildings_m: Some([200.0, 30.0]),
        change: as_it_is,
    },
    PaperScene {
        name: "res-4",
        preset: "res-4",
        n_selected: 100,
        published: Some((100, 298, 0.12, 49.0, [4.27, 7.49], [89.67, 77.19])),
        flight_and_buildings_m: Some([200.0, 41.0]),
        change: as_it_is,
    },
    PaperScene {
        name: "ind-1",
        preset: "ind-1",
        n_selected: 50,
        published: Some((50, 147, 0.10, 29.0, [1.28, 2.56], [92.47, 66.22])),
        flight_and_buildings_m: Some([100.0, 17.0]),
        change: as_it_is,
    },
    PaperScene {
        name: "ind-2",
        preset: "ind-2",
        n_selected: 100,
        published: Some((100, 261, 0.21, 33.0, [6.48, 14.35], [77.85, 44.09])),
        flight_and_buildings_m: Some([300.0, 29.0]),
        change: as_it_is,
    },
    PaperScene {
        name: "city-1",
        preset: "city-1",
        n_selected: 256,
        published: Some((256, 873, 0.17, 118.0, [4.84, 6.52], [85.19, 65.30])),
        flight_and_buildings_m: Some([200.0, 33.0]),
        change: as_it_is,
    },
    PaperScene {
        name: "mini-village",
        preset: "village",
        n_selected: 50,
        published: None,
        flight_and_buildings_m: None,
        change: mini,
    },
    PaperScene {
        name: "mini-district",
        preset: "district",
        n_selected: 50,
        published: None,
        flight_and_buildings_m: None,
        change: mini,
    },
    PaperScene {
        name: "mini-downtown",
        preset: "downtown",
        n_selected: 50,
        published: None,
        flight_and_buildings_m: None,
        change: mini,
    },
    PaperScene {
        name: "free-district",
        preset: "district",
        n_selected: 50,
        published: None,
        flight_and_buildings_m: None,
        change: free,
    },
];

/// A row of the paper's table of proxies: scene, method, error 90/95 m, completeness 0.5/1 m %, overlap %, seconds.
type PublishedBody = (&'static str, &'static str, [f64; 2], [f64; 2], f64, f64);

/// The paper's table of proxies.
const PUBLISHED_BODIES: [PublishedBody; 16] = [
    ("res-1", "ConvexHull", [5.16, 6.40], [21.88, 39.18], 24.73, 443.0),
    ("res-1", "ProxyRecon", [3.77, 4.79], [30.50, 49.70], 32.39, 447.0),
    ("res-1", "ArcPro", [4.25, 5.50], [20.18, 44.23], 29.77, 457.0),
    ("res-1", "SiZeUp", [3.73, 5.38], [57.97, 76.77], 49.18, 19.0),
    ("res-2", "ConvexHull", [5.82, 6.44], [23.70, 44.47], 33.62, 1831.0),
    ("res-2", "ProxyRecon", [4.78, 6.51], [33.63, 58.78], 36.26, 1838.0),
    ("res-2", "ArcPro", [2.66, 3.69], [30.92, 57.16], 39.69, 1964.0),
    ("res-2", "SiZeUp", [4.52, 6.07], [41.21, 66.65], 42.87, 38.0),
    ("ind-1", "ConvexHull", [3.63, 4.86], [34.37, 49.55], 37.99, 1509.0),
    ("ind-1", "ProxyRecon", [2.51, 2.97], [37.63, 51.92], 42.74, 1512.0),
    ("ind-1", "ArcPro", [1.69, 2.23], [42.57, 57.41], 51.87, 1550.0),
    ("ind-1", "SiZeUp", [3.33, 4.70], [37.86, 64.68], 43.12, 29.0),
    ("ind-2", "ConvexHull", [6.24, 7.79], [35.70, 49.67], 29.38, 1541.0),
    ("ind-2", "ProxyRecon", [13.46, 16.26], [26.14, 43.53], 29.54, 1547.0),
    ("ind-2", "ArcPro", [4.69, 6.08], [37.49, 59.98], 40.23, 1657.0),
    ("ind-2", "SiZeUp", [8.46, 10.40], [48.34, 61.56], 35.36, 33.0),
];

/// Which scenes run, and what on them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PaperConfig {
    /// Names of the scenes that are run.
    pub scenes: Vec<String>,
    /// Methods that are run.
    pub methods: Vec<Method>,
    /// Level of prior errors.
    pub level: PriorLevel,
    /// Errors of poses and footprints as the methods get them.
    pub errors: ErrorConfig,
    /// Root seed of scenes and solver.
    pub seed: u64,
    /// Fewer buildings and views than the scenes have, and this longer side of images in pixels; for a quick look.
    pub shrink: Option<[usize; 3]>,
    /// One setting of `paper` after the other changed, on scenes of their own.
    pub studies: StudyConfig,
}

impl Default for PaperConfig {
    fn default() -> Self {
        Self {
            scenes: SCENES.iter().map(|s| s.name.to_owned()).collect(),
            methods: Method::ALL.to_vec(),
            level: PriorLevel::Mid,
            errors: ErrorConfig::REALISTIC,
            seed: 1,
            shrink: None,
            studies: StudyConfig::default(),
        }
    }
}

impl PaperConfig {
    /// Seconds instead of an hour.
    #[must_use]
    pub fn small() -> Self {
        let scenes = vec!["mini-village".to_owned(), "free-district".to_owned()];
        Self { scenes, shrink: Some([8, 24, 160]), studies: StudyConfig::small(), ..Self::default() }
    }

    fn job(&self, scene: &PaperScene) -> Result<SceneJob, BenchmarkError> {
        let mut simulate = SimulateConfig::preset(scene.preset)
            .map_err(|source| BenchmarkError::Simulate { scene: scene.name.to_owned(), source })?;
        (scene.change)(&mut simulate);
        if let Some([flight_m, buildings_m]) = scene.flight_and_buildings_m {
            (simulate.flight.height_m, simulate.town.mean_height_m) = (flight_m, Some(buildings_m));
        }
        (simulate.seed, simulate.errors, simulate.prior.level) = (self.seed, self.errors, self.level);
        simulate.images.enabled = false;
        if let Some([n_buildings, n_views, longest_px]) = self.shrink {
            (simulate.town.n_buildings, simulate.flight.n_views) = (n_buildings, Some(n_views));
            simulate.prior.longest_px = longest_px as u32;
        }
        // The images are not written: nothing but the priors' size counts.
        simulate.camera.width_px = simulate.prior.longest_px;
        simulate.camera.height_px = simulate.prior.longest_px * 3 / 4;
        let n_views = simulate.flight.n_views.unwrap_or(1).max(1);
        simulate.points.per_view = (POINTS_PER_BUILDING * simulate.town.n_buildings).div_ceil(n_views);
        let working_px = simulate.prior.longest_px;
        Ok(SceneJob {
            variants: self.methods.iter().copied().map(Variant::as_it_is).collect(),
            assignments: vec![format!("optimise.working_px={working_px}")],
            paper_assignments: vec![format!("optimise.views.n_spread={}", scene.n_selected)],
            with_bodies: true,
            ..SceneJob::of_scene(scene.name, simulate)
        })
    }
}

/// Measurements on a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PaperResult {
    /// Name of the scene.
    pub scene: String,
    /// Buildings of the scene.
    pub n_buildings: usize,
    /// Outcome of each method.
    pub outcomes: Vec<Outcome>,
}

/// The suite as a whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PaperTables {
    /// Settings of the run.
    pub config: PaperConfig,
    /// Results of the scenes, in the order of the settings.
    pub scenes: Vec<PaperResult>,
    /// Which programs made the outcomes.
    pub programs: Programs,
    /// The studies, if any.
    pub studies: StudyTables,
}

/// Runs the suite; after every scene `paper.json` and `paper.md` in the plan's folder hold what there is so far, and
/// `studies.json` and `studies.md` after every scene of the studies.
///
/// # Errors
/// [`BenchmarkError`].
pub fn run(config: &PaperConfig, plan: &SuitePlan, tell: TellScenes<'_>) -> Result<PaperTables, BenchmarkError> {
    let known = || SCENES.iter().map(|s| s.name).collect::<Vec<_>>().join(", ");
    let scene = |name: &String| {
        let found = SCENES.iter().find(|s| s.name == name);
        found.ok_or_else(|| BenchmarkError::UnknownScene { name: name.clone(), known: known() })
    };
    let scenes: Vec<&PaperScene> = config.scenes.iter().map(scene).collect::<Result<_, _>>()?;
    if scenes.is_empty() && config.studies.of.is_empty() {
        return Err(BenchmarkError::Empty { setting: "scenes" });
    }
    if config.methods.is_empty() && !scenes.is_empty() {
        return Err(BenchmarkError::Empty { setting: "methods" });
    }
    let mut tables = PaperTables {
        config: config.clone(),
        scenes: Vec::new(),
        programs: Programs::default(),
        studies: StudyTables::default(),
    };
    for (i, scene) in scenes.iter().enumerate() {
        let job = config.job(scene)?;
        let outcomes = run_scene(&job, plan, &|what| tell(i, scenes.len(), &format!("{}: {what}", job.name)))?;
        let n_buildings = job.simulate.town.n_buildings;
        tables.scenes.push(PaperResult { scene: job.name.clone(), n_buildings, outcomes });
        tables.programs = Programs::of(&plan.program, tables.scenes.iter().flat_map(|s| &s.outcomes));
        write_json(&plan.folder.join("paper.json"), &tables)?;
        write_whole(&plan.folder.join("paper.md"), |out| out.write_all(tables.to_markdown().as_bytes()))?;
    }
    tables.studies = studies::run(&config.studies, plan, tell)?;
    Ok(tables)
}

impl PaperTables {
    /// As Markdown: heights, bodies, and what the paper states.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let mut text = String::new();
        if self.scenes.is_empty() {
            return self.studies.to_markdown();
        }
        text.push_str(
            "Heights, on our scenes:\n\n\
             | scene | buildings | views | method | #Sel | #Used | ratio | time s (user s) | err avg m | err 90 % m | acc avg % | acc 90 % % | no height |\n\
             |---|---:|---:|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        );
        for scene in &self.scenes {
            for outcome in &scene.outcomes {
                text.push_str(&heights_row(scene, outcome));
            }
        }
        text.push_str(
            "\nBodies, on our scenes, against the true ones with their roofs:\n\n\
             | scene | method | Err 90/95 % m | Comp 0.5/1 m % | voxel IoU 0.5 m % | column IoU % | time s (user s) |\n\
             |---|---|---:|---:|---:|---:|---:|\n",
        );
        for scene in &self.scenes {
            for outcome in &scene.outcomes {
                text.push_str(&bodies_rows(scene, outcome));
            }
        }
        text.push_str(
            "\nerr: |h − h*| with the mean roof height as h*; acc = max(0, 1 − err/h*); acc 90 %: what 90 % of the buildings reach. \
             Time: from priors on disk to heights, everything but the priors themselves; in brackets processor seconds of the \
             whole run. Err: distances from the result's walls and roofs to the true surface; Comp: share of the true walls and \
             roofs within 0.5 and 1 m of the result. Bodies are blocks, as LOD 1.2 has them, but for hulls and stacks, which make \
             their own, and `robust`, LOD 2.0: its result's highest level of detail, with roof forms where they are certain. \
             `constant` and `neighbourhood` are told true heights (the median of all; the five nearest others) and stand for what \
             no evidence at all gives. Points: simulated sparse multi-view points with noise, gaps and blunders; making them takes \
             a real pipeline far longer than the times here, which leave it out. \
             ArcPro: not reproduced, no public weights or code. The learned footprint extractors (PolyWorld, Pix2Poly, MLS-BRN, OBM) \
             publish both; they are not run here. ",
        );
        text.push_str(&self.programs.to_markdown());
        text.push_str(&published());
        text.push_str(&self.studies.to_markdown());
        text
    }
}

fn heights_row(scene: &PaperResult, outcome: &Outcome) -> String {
    let Some(s) = &outcome.heights.all else {
        return format!(
            "| {} | {} | {} | `{}` | | | | | | | | | |\n",
            scene.scene,
            scene.n_buildings,
            outcome.n_views,
            outcome.method.name()
        );
    };
    let ratio = outcome.n_used as f64 / outcome.n_views.max(1) as f64;
    let user = outcome.user_s.map_or_else(|| "–".to_owned(), |s| format!("{s:.1}"));
    format!(
        "| {} | {} | {} | `{}` | {} | {} | {ratio:.2} | {:.1} ({user}) | {:.2} | {:.2} | {:.1} | {:.1} | {} |\n",
        scene.scene,
        scene.n_buildings,
        outcome.n_views,
        outcome.method.name(),
        outcome.n_selected,
        outcome.n_used,
        outcome.heights_s,
        s.error_mean_m,
        s.error_p90_m,
        100.0 * s.accuracy_mean,
        100.0 * s.accuracy_90,
        outcome.heights.counts.n_unobserved,
    )
}

fn bodies_rows(scene: &PaperResult, outcome: &Outcome) -> String {
    let name = format!("`{}`", outcome.method.name());
    let formed_name = format!("{name}, LOD 2.0");
    let rows = [(name, &outcome.bodies), (formed_name, &outcome.formed_bodies)];
    rows.into_iter().filter_map(|(name, bodies)| Some(bodies_row(scene, outcome, &name, bodies.as_ref()?))).collect()
}

fn bodies_row(scene: &PaperResult, outcome: &Outcome, name: &str, bodies: &BodyScores) -> String {
    let dash = || "–".to_owned();
    let surface = bodies.surface.as_ref();
    let volume = bodies.volume.as_ref();
    let user = outcome.user_s.map_or_else(dash, |s| format!("{s:.1}"));
    format!(
        "| {} | {name} | {} | {} | {} | {} | {:.1} ({user}) |\n",
        scene.scene,
        surface.map_or_else(dash, |s| format!("{:.2}/{:.2}", s.error_90_m, s.error_95_m)),
        surface.map_or_else(dash, |s| format!("{:.1}/{:.1}", 100.0 * s.completeness_05, 100.0 * s.completeness_1)),
        volume.and_then(|v| v.voxel_iou.get("0.5")).map_or_else(dash, |iou| format!("{:.1}", 100.0 * iou)),
        volume.map_or_else(dash, |v| format!("{:.1}", 100.0 * v.column_iou)),
        outcome.heights_s,
    )
}

/// The paper's own numbers.
fn published() -> String {
    let mut text =
        "\nPublished by the paper for its own scenes, photos, network and GPU machine (not comparable row by row):\n\n\
         | scene | #Sel | #Used | ratio | time s | err avg m | err 90 % m | acc avg % | acc 90 % % |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|\n"
            .to_owned();
    for scene in &SCENES {
        if let Some((sel, used, ratio, seconds, [err, err_90], [acc, acc_90])) = scene.published {
            let name = scene.name;
            let _ = writeln!(
                text,
                "| {name} | {sel} | {used} | {ratio:.2} | {seconds:.0} | {err:.2} | {err_90:.2} | {acc:.2} | {acc_90:.2} |"
            );
        }
    }
    text.push_str(
        "\n| scene | method | Err 90/95 % m | Comp 0.5/1 m % | IoU % (definition not published) | time s |\n\
         |---|---|---:|---:|---:|---:|\n",
    );
    for (scene, method, [err_90, err_95], [comp_05, comp_1], iou, seconds) in PUBLISHED_BODIES {
        let _ = writeln!(
            text,
            "| {scene} | {method} | {err_90:.2}/{err_95:.2} | {comp_05:.2}/{comp_1:.2} | {iou:.2} | {seconds:.0} |"
        );
    }
    text
}
