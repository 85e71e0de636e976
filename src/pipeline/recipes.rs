//! Recipes: the settings and the files that decide the result of a stage or of a part of a city.
//!
//! Listed here are the settings that do *not* count. A table of the configuration that is not listed counts from the first stage
//! on: at worst a stage runs again without need. The content of a file is known from `stages/hashes.json` while its size, inode and
//! times are those at which it was hashed, so that a run that starts late reads no photo to learn that none has changed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Map, Value, json};

use super::Stage;
use super::settings::{FootprintSettings, HeightSettings, SurveySettings};
use crate::config::{ResultFolder, RunConfig};
use crate::recipe::{ABSENT, Recipe};
use sizeup_footprints::{ContourSource as _, FootprintSource, MaskFiles};
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::source;
use sizeup_geo::hashes::Hashes;
use sizeup_photos::onnx::is_profile_file;
use sizeup_photos::prior::PriorConfig;
use sizeup_survey::{Survey, View, ViewKind};

/// The first stage that a table of the configuration decides; the last for those that only writers use.
fn first_stage(table: &str) -> Stage {
    match table {
        "footprints" | "terrain" | "dtm" | "ground" => Stage::Footprints,
        "seed" | "heights" | "prior" | "optimise" | "refinement" => Stage::Heights,
        "reviews" | "output" | "limits" => Stage::Output,
        _ => Stage::Survey,
    }
}

/// The tables of a configuration; `auto` priors are replaced by those that they choose.
fn tables(config: Value, prior: &PriorConfig) -> Map<String, Value> {
    let Value::Object(mut tables) = config else { return Map::new() };
    tables.insert("prior".to_owned(), json!(*prior.chosen()));
    tables
}

/// Takes keys out of one of the tables.
fn without(tables: &mut Map<String, Value>, table: &str, keys: &[&str]) {
    if let Some(Value::Object(table)) = tables.get_mut(table) {
        keys.iter().for_each(|&key| drop(table.remove(key)));
    }
}

/// Settings that decide the results of stages, wherever these results go.
#[derive(Debug, Clone)]
pub(super) struct Decisive {
    /// The tables of the configuration as it is saved beside the results.
    tables: Map<String, Value>,
    /// Settings that decide the result of a part of a city, a table of tables.
    pub of_part: Value,
    /// Whether a run checks how well its poses fit the photos.
    is_aligned: bool,
    /// Whether footprints are found by a network that may take its depth from the run's priors.
    depth_of_footprints_is_prior: bool,
    /// Whether depth comes from matching the photos with each other.
    from_photos: bool,
}

impl Decisive {
    /// Settings of a configuration.
    pub fn of(config: &RunConfig, is_aligned: bool) -> Self {
        let saved = config.saved();
        Self {
            tables: tables(json!(saved), &saved.prior),
            of_part: of_part(tables(json!(config), &config.prior)),
            is_aligned,
            depth_of_footprints_is_prior: matches!(config.footprints, FootprintSource::Network(_)),
            from_photos: config.prior.matches_photos(),
        }
    }

    /// Settings that decide the result of a stage and those before it, a table of tables.
    pub fn of_stage(&self, stage: Stage) -> Value {
        let of = |name: &str| self.tables.get(name).cloned().unwrap_or_default();
        let mut tables = self.tables.clone();
        tables.retain(|name, _| first_stage(name) <= stage && first_stage(name) < Stage::Output);
        // The folder of the results, the day and the name of the datum are for writers.
        without(&mut tables, "project", &["output", "vertical_reference", "reference_date"]);
        if self.is_aligned {
            tables.insert("ground of poses".to_owned(), of("terrain"));
        } else {
            tables.remove("align");
        }
        if stage >= Stage::Footprints && self.depth_of_footprints_is_prior {
            tables.insert("depth of footprints".to_owned(), json!([of("prior"), of("heights")]));
        }
        // A level is compared with the poses. Photos are checked where depth is matched from them.
        let level = of("terrain").get("constant_m").cloned().unwrap_or_default();
        tables.insert("level of poses".to_owned(), level);
        tables.insert("photos are looked at".to_owned(), json!(self.from_photos));
        Value::Object(tables)
    }
}

/// Tables that decide the result of a part of a city: not those of the survey, whose views are given, nor of the reviews, which are
/// read, nor those of outputs of the whole city.
fn of_part(mut tables: Map<String, Value>) -> Value {
    for given in ["survey", "align", "reviews", "limits"] {
        tables.remove(given);
    }
    without(&mut tables, "project", &["output"]);
    without(&mut tables, "output", &["pictures", "geopackage", "report"]);
    Value::Object(tables)
}

/// Files that the stages are made from.
#[derive(Debug, Clone)]
pub(super) struct StageFiles<'a> {
    pub folder: ResultFolder<'a>,
    pub survey: SurveySettings<'a>,
    pub footprints: FootprintSettings<'a>,
    pub heights: HeightSettings<'a>,
}

impl StageFiles<'_> {
    /// Adds the files that a stage and those before it are made from to its recipe.
    pub fn add(&self, recipe: &mut Recipe, stage: Stage, survey: &Survey) {
        let files: Vec<(&str, PathBuf)> = self.files(stage, survey).into_iter().collect();
        let (path, hashes) = (self.folder.stage_file("hashes.json"), Hashes::new());
        hashes.load(&path);
        let sha256 = |path: &Path| hashes.of(path).map_or_else(|_| ABSENT.to_owned(), |content| content.sha256);
        let hashed: Vec<String> = files.par_iter().map(|(_, path)| sha256(path)).collect();
        for ((role, path), sha256) in files.iter().zip(hashed) {
            recipe.add(format!("{role} {}", self.folder.saved(path).display()), sha256);
        }
        if hashes.n_bytes_read() > 0
            && let Err(error) = keep(&hashes, &path)
        {
            // Then they are read again the next time.
            tracing::warn!("{error}");
        }
    }

    fn files(&self, stage: Stage, survey: &Survey) -> BTreeSet<(&'static str, PathBuf)> {
        let Self { survey: poses, footprints, heights, .. } = self;
        let prior = heights.prior;
        let mut files = BTreeSet::new();
        let of_poses = files_of(&poses.config.path);
        files.extend(of_poses.into_iter().filter(|path| path.is_file()).map(|path| ("survey", path)));
        let photos = |is_read: &dyn Fn(&View) -> bool| -> Vec<(&'static str, PathBuf)> {
            let read = survey.views.iter().filter(|view| is_read(view));
            read.filter_map(|view| Some(("photo", view.image.clone()?))).collect()
        };
        if poses.is_aligned || poses.from_photos {
            files.extend(photos(&|_| true));
        }
        if stage >= Stage::Footprints {
            let layers = footprint_files(footprints.source, survey);
            files.extend(layers.iter().flat_map(|path| source::files_of(path)).map(|path| ("footprints", path)));
            files
                .extend(poses.terrain.dtm.iter().flat_map(|path| source::files_of(path)).map(|path| ("terrain", path)));
            let makes_dtm = footprints.ground.squares.is_some();
            let finds = matches!(footprints.source, FootprintSource::Network(_));
            if finds {
                let of_each = prior.file_of_each(&survey.views).unwrap_or_default();
                let nadir = survey.views.iter().zip(of_each).filter(|(view, _)| view.kind() == ViewKind::Nadir);
                let files_of_depth = prior.shared_files().into_iter().chain(nadir.filter_map(|(_, path)| path));
                files.extend(files_of_depth.map(|path| ("depth", path)));
            }
            files.extend(photos(&|view| makes_dtm || (finds && view.kind() == ViewKind::Nadir)));
        }
        if stage >= Stage::Heights {
            files.extend(prior.shared_files().into_iter().map(|path| ("prior", path)));
            // Settings that cannot work are refused where priors are read.
            let priors = prior.file_of_each(&survey.views).unwrap_or_default();
            let from_all = matches!(*prior.chosen(), PriorConfig::Stereo(_));
            let of_views = survey.views.iter().zip(priors);
            let kind = survey.kind_for_heights();
            let used = of_views.filter(|(view, _)| from_all || view.kind() == kind);
            files.extend(used.filter_map(|(_, path)| Some(("prior", path?))));
            files.extend(photos(&|view| heights.reads_photo(view)));
        }
        files
    }
}

fn keep(hashes: &Hashes, path: &Path) -> Result<(), FileError> {
    let all = hashes.paths();
    hashes.save(path, all.iter().map(PathBuf::as_path))
}

/// The file itself, or the files of a folder.
#[must_use]
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    match std::fs::read_dir(path) {
        Ok(entries) => entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|p| p.is_file()).collect(),
        Err(_) => vec![path.to_owned()],
    }
}

/// The files that footprints come from, for the lineage.
#[must_use]
pub fn footprint_files(source: &FootprintSource, survey: &Survey) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = source.file().into_iter().collect();
    if let FootprintSource::Network(network) = source {
        files.extend(network.backbones.values().cloned());
        files.extend(network.profile.iter().filter(|profile| is_profile_file(profile)).map(PathBuf::from));
    }
    if let FootprintSource::Masks(masks) = source
        && let Ok(masks) = MaskFiles::new(masks.clone())
    {
        let nadir = survey.views.iter().filter(|v| v.kind() == ViewKind::Nadir);
        files.extend(nadir.filter_map(|view| masks.file_of(view)));
    }
    if let Some(cadastre) = source.detection().and_then(|d| d.cadastre) {
        files.push(cadastre.path.clone());
    }
    files
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::Path;

    use super::super::RunSettings;
    use super::*;
    use crate::recipe::Recipe;

    fn of_stage(config: &RunConfig, stage: Stage) -> Value {
        RunSettings::of(config).artefacts.decisive.of_stage(stage)
    }

    const TEXT: &str = "\
        [project]\ncrs = \"EPSG:25832\"\n[survey]\npath = \"poses\"\n[footprints]\npath = \"a.gpkg\"\n\
        [terrain]\nconstant_m = 3.0\n[prior]\nsource = \"files\"\npath = \"{stem}.npy\"\nkind = \"depth\"\n";
    /// Poses are taken as they are.
    const AS_GIVEN: &str = "align.when=\"never\"";

    fn with(assignments: &[&str]) -> RunConfig {
        let assignments: Vec<String> = assignments.iter().map(|&a| a.to_owned()).collect();
        RunConfig::from_text(TEXT, Path::new("sizeup.toml"), &assignments).unwrap()
    }

    /// Whether one configuration makes what another came out as stale, by the first stages up to one.
    fn is_stale(stage: Stage, before: &RunConfig, now: &RunConfig) -> bool {
        let recipe = |config: &RunConfig| Recipe::new(&of_stage(config, stage));
        recipe(now).why_stale(&recipe(before)).is_some()
    }

    /// One change of each table, where poses are taken as they are: the first stage that it makes stale, and whether it
    /// does a part of a city.
    const CHANGES: [(&str, Option<Stage>, bool); 22] = [
        ("seed=7", Some(Stage::Heights), true),
        ("project.crs=\"EPSG:25833\"", Some(Stage::Survey), true),
        ("project.output=\"elsewhere\"", None, false),
        ("project.vertical_reference=\"NAP\"", None, true),
        ("project.reference_date=\"2026-05-01\"", None, true),
        ("survey.accept_unsound=true", Some(Stage::Survey), false),
        ("align.when=\"always\"", Some(Stage::Survey), false),
        ("footprints.path=\"b.gpkg\"", Some(Stage::Footprints), true),
        ("terrain.vertical_offset_m=1.0", Some(Stage::Footprints), true),
        ("terrain.constant_m=4.0", Some(Stage::Survey), true),
        ("dtm.within_m=20.0", Some(Stage::Footprints), true),
        ("ground.reference=\"mean\"", Some(Stage::Footprints), true),
        ("heights.max_m=12.0", Some(Stage::Heights), true),
        ("prior.kind=\"inverse_depth\"", Some(Stage::Heights), true),
        ("optimise.working_px=300", Some(Stage::Heights), true),
        ("refinement.long_side_px=900", Some(Stage::Heights), true),
        ("refinement.enabled=false", Some(Stage::Heights), true),
        ("reviews.path=\"reviews.geojson\"", None, false),
        ("output.fallback.source=\"attribute\"", None, true),
        ("output.pictures=false", None, false),
        ("output.textures.enabled=true", None, true),
        ("limits.input_mb=100", None, false),
    ];

    #[test]
    fn a_change_of_any_table_makes_stale_what_it_decides_and_nothing_else() {
        let stages = [Stage::Survey, Stage::Footprints, Stage::Heights];
        let recipe = |config: &RunConfig, stage| Recipe::new(&of_stage(config, stage));
        let before = with(&[AS_GIVEN]);
        let mut seen: BTreeMap<String, bool> = BTreeMap::new();
        for (change, first, is_of_part) in CHANGES {
            let now = with(&[AS_GIVEN, change]);
            assert!(now != before, "{change} is a change");
            for stage in stages {
                let why = recipe(&now, stage).why_stale(&recipe(&before, stage));
                assert_eq!(why.is_some(), first.is_some_and(|first| first <= stage), "{change}, {stage:?}: {why:?}");
            }
            let why = Recipe::new(RunSettings::of(&now).of_part())
                .why_stale(&Recipe::new(RunSettings::of(&before).of_part()));
            assert_eq!(why.is_some(), is_of_part, "{change}, a part: {why:?}");
            seen.insert(change.split(['.', '=']).next().unwrap_or_default().to_owned(), true);
        }
        let Value::Object(tables) = json!(with(&["dtm.within_m=20.0", "reviews.path=\"reviews.geojson\""])) else {
            panic!("a configuration is a table")
        };
        let forgotten: Vec<&String> = tables.keys().filter(|name| !seen.contains_key(*name)).collect();
        assert!(forgotten.is_empty(), "tables that no change here is of: {forgotten:?}");
    }

    /// Poses that may be aligned with the photos depend on the ground: another ground, or no photos, gives other poses.
    #[test]
    fn the_ground_counts_for_poses_that_may_be_aligned() {
        for change in ["terrain.vertical_offset_m=1.0", "refinement.enabled=false", AS_GIVEN] {
            assert!(is_stale(Stage::Survey, &with(&[]), &with(&[change])), "{change}");
        }
        assert!(!is_stale(Stage::Survey, &with(&[]), &with(&["refinement.long_side_px=900"])));
        let before = with(&["refinement.enabled=false"]);
        assert!(!is_stale(
            Stage::Survey,
            &before,
            &with(&["refinement.enabled=false", "terrain.vertical_offset_m=1.0"])
        ));
    }

    /// A footprint network takes the run's depth: other priors, other footprints.
    #[test]
    fn priors_count_for_footprints_where_a_network_finds_them() {
        let stale = |network: &str| {
            is_stale(Stage::Footprints, &with(&[network]), &with(&[network, "prior.kind=\"inverse_depth\""]))
        };
        assert!(stale("footprints={source=\"network\"}") && !stale("footprints={path=\"a.gpkg\"}"));
    }

    #[test]
    fn a_table_that_nobody_thought_of_counts_from_the_first_stage() {
        assert_eq!(first_stage("new"), Stage::Survey);
    }
}
