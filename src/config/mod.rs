//! The run configuration: composes the stages' own settings, and reads them from a TOML file.
//!
//! Precedence: defaults, then the file, then `--set table.key=value`. Relative paths are relative to the file. The
//! resolved configuration is saved beside every result.

mod advice;
mod escapes;
mod folder;
mod sources;

use std::path::{Path, PathBuf};

pub(crate) use advice::nearest;
pub use folder::ResultFolder;
use schemars::JsonSchema;
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};

use sizeup_footprints::FootprintSource;
use sizeup_geo::crs::Crs;
use sizeup_geo::limits::Limits;
use sizeup_geo::paths::{OwnPaths, PathVisitor, resolved};
use sizeup_geo::terrain::{GroundConfig, TerrainConfig};
use sizeup_heights::optimise::OptimiseConfig;
use sizeup_heights::photo_consistency::RefinementConfig;
use sizeup_heights::scene::HeightsConfig;
use sizeup_photos::align::AlignConfig;
use sizeup_photos::dtm::DtmConfig;
use sizeup_photos::prior::PriorConfig;
use sizeup_photos::textures::TextureConfig;
use sizeup_results::output::fallback::FallbackConfig;
use sizeup_results::output::reviews::ReviewsConfig;
use sizeup_results::report::ReportConfig;
use sizeup_survey::SurveyConfig;

/// Why a configuration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration {}: {source}\nhint: it is a text file of settings; `sizeup init FOLDER` writes one for a folder of photos", path.display())]
    Read {
        /// Path of the configuration's file.
        path: PathBuf,
        /// Error that the system reported.
        source: std::io::Error,
    },
    /// The file is not valid TOML, or a key or value is not known; the text shows the place.
    #[error("{}:\n{message}\nhint: {hint}", path.display())]
    Parse {
        /// Path of the configuration's file.
        path: PathBuf,
        /// The problem, with the line underlined.
        message: String,
        /// Advice: what to change or to check.
        hint: String,
    },
    /// A `--set` that cannot be applied.
    #[error("--set {assignment}: {message}\nhint: {hint}")]
    Set {
        /// The assignment as the user wrote it.
        assignment: String,
        /// The problem with the assignment.
        message: String,
        /// Advice: what to change or to check.
        hint: String,
    },
}

/// File beside every result that holds the whole configuration of its run.
pub const SAVED_NAME: &str = "config.toml";

/// The configuration of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RunConfig {
    /// Root of every random choice; the same seed gives the same bytes.
    #[serde(default)]
    pub seed: u64,
    /// The frame of the project and where its results go.
    pub project: ProjectConfig,
    /// Photos and their poses.
    pub survey: SurveyConfig,
    /// Poses brought to agree with the photos, where they do not.
    #[serde(default)]
    pub align: AlignConfig,
    /// Where footprints come from: a layer, masks or a network.
    pub footprints: FootprintSource,
    /// Where the ground comes from: a raster, one height or the photos.
    pub terrain: TerrainConfig,
    /// Make a terrain model from the photos first. `[terrain]` is then what it starts from: a rough level, or a coarse or
    /// shifted model that the photos correct.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dtm: Option<DtmConfig>,
    /// Which level of the terrain a building's height counts from.
    #[serde(default)]
    pub ground: GroundConfig,
    /// The heights that are looked for, by whatever does.
    #[serde(default)]
    pub heights: HeightsConfig,
    /// Where depth priors come from, and what their numbers mean.
    pub prior: PriorConfig,
    /// Solver of the heights: its preset, and constants for experts.
    #[serde(default)]
    pub optimise: OptimiseConfig,
    /// Roof heights refined by the photos, after the solver has found them.
    #[serde(default)]
    pub refinement: RefinementConfig,
    /// Decisions of people about single buildings, which count for more than what was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reviews: Option<ReviewsConfig>,
    /// Folder and formats of the results.
    #[serde(default)]
    pub output: OutputConfig,
    /// Limits of the memory and servers that input may use.
    #[serde(default)]
    pub limits: Limits,
    /// Which paths were relative in the file.
    #[serde(skip)]
    own_paths: OwnPaths,
}

/// The frame of the project.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProjectConfig {
    /// Projected CRS in metres, such as "EPSG:25832" or the compound "EPSG:7415".
    #[schemars(with = "String")]
    pub crs: Crs,
    /// Vertical datum, in words, where the CRS has no vertical part: "NAP", "DHHN2016", "ellipsoid".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vertical_reference: Option<String>,
    /// Folder of the results.
    #[serde(default = "default_output")]
    pub output: PathBuf,
    /// The day the data stands for, `YYYY-MM-DD`, written into the results.
    #[serde(default, deserialize_with = "day", skip_serializing_if = "Option::is_none")]
    pub reference_date: Option<String>,
}

/// Reads a day: CityJSON, CityGML and GeoPackage take nothing else.
fn day<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    let text = String::deserialize(deserializer)?;
    match text.parse::<toml::value::Datetime>() {
        Ok(toml::value::Datetime { date: Some(_), time: None, offset: None }) => Ok(Some(text)),
        _ => Err(D::Error::custom(format!("expected a day such as \"2026-05-01\", found \"{text}\""))),
    }
}

impl ProjectConfig {
    /// A project in a CRS, its results in a folder.
    #[must_use]
    pub fn new(crs: Crs, output: impl Into<PathBuf>) -> Self {
        Self { crs, vertical_reference: None, output: output.into(), reference_date: None }
    }
}

fn default_output() -> PathBuf {
    PathBuf::from("result")
}

/// Settings of the writers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct OutputConfig {
    /// Whether to draw pictures: a map, proxies over photos, one view's depth beside its prior.
    pub pictures: bool,
    /// Where footprints stand that are known to be off: `as_given`, or `in_photos`, where the photos show their buildings.
    pub footprints: FootprintPlace,
    /// Treatment of buildings whose height is not known.
    pub fallback: FallbackConfig,
    /// Settings of the report.
    pub report: ReportConfig,
    /// The city with textures from its photos.
    pub textures: TextureConfig,
}

/// Where a footprint stands in the results that is known to be off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FootprintPlace {
    /// Where the layer has it; attributes and the layer `footprints_moved` say where the photos show the building.
    #[default]
    AsGiven,
    /// Where the photos show the building, with its roof: the attributes still say how far off the given one lies.
    InPhotos,
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self {
            pictures: true,
            footprints: FootprintPlace::default(),
            fallback: FallbackConfig::default(),
            report: ReportConfig::default(),
            textures: TextureConfig::default(),
        }
    }
}

impl RunConfig {
    /// From what has no default; everything else as in a file that does not mention it. Paths are relative to the working
    /// folder.
    #[must_use]
    pub fn new(
        project: ProjectConfig,
        survey: SurveyConfig,
        footprints: FootprintSource,
        terrain: TerrainConfig,
        prior: PriorConfig,
    ) -> Self {
        Self {
            seed: 0,
            project,
            survey,
            align: AlignConfig::default(),
            footprints,
            terrain,
            dtm: None,
            ground: GroundConfig::default(),
            heights: HeightsConfig::default(),
            prior,
            optimise: OptimiseConfig::default(),
            refinement: RefinementConfig::default(),
            reviews: None,
            output: OutputConfig::default(),
            limits: Limits::default(),
            own_paths: OwnPaths::default(),
        }
    }

    /// Reads a file, applies `table.key=value` assignments, and makes paths relative to the file's folder.
    ///
    /// # Errors
    /// [`ConfigError`], with the offending line where there is one.
    pub fn load(path: &Path, assignments: &[String]) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(""));
        let mut config = Self::read(&text, path, assignments)?;
        config.resolve_paths(folder);
        Ok(config)
    }

    /// As [`Self::load`], for work that needs no depth priors: a file without `[prior]` will do.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn load_without_prior(path: &Path, assignments: &[String]) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let has_prior = text.parse::<toml::Table>().map_or(true, |table| table.contains_key("prior"));
        // Stereo has no file to be missing.
        let stand_in = (!has_prior).then(|| "prior.source=stereo".to_owned());
        let assignments: Vec<String> = stand_in.into_iter().chain(assignments.iter().cloned()).collect();
        Self::load(path, &assignments)
    }

    /// Reads the text of a file, its paths relative to the working folder; `path` is for messages only.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn from_text(text: &str, path: &Path, assignments: &[String]) -> Result<Self, ConfigError> {
        let mut config = Self::read(text, path, assignments)?;
        config.resolve_paths(Path::new(""));
        Ok(config)
    }

    fn read(text: &str, path: &Path, assignments: &[String]) -> Result<Self, ConfigError> {
        parse_with(text, Some(path), assignments, advice::KEYS_OF_RUN, |table| sources::make_room(table, assignments))
    }

    fn resolve_paths(&mut self, folder: &Path) {
        let mut own = OwnPaths::new(folder);
        self.project.output = resolved(folder, &self.project.output);
        self.visit_inputs(&mut |path| own.resolve(path));
        self.own_paths = own;
    }

    /// Visits every path but that of the results.
    fn visit_inputs(&mut self, visit: PathVisitor<'_>) {
        self.survey.visit_paths(visit);
        self.footprints.visit_paths(visit);
        self.terrain.dtm.iter_mut().for_each(&mut *visit);
        self.prior.visit_paths(visit);
        self.reviews.iter_mut().for_each(|reviews| visit(&mut reviews.path));
    }

    /// As it is saved beside the results: results go where the file is, and inputs are found from there (see
    /// [`sizeup_geo::paths`]). It does not depend on the folder a command was given in, and saving it again changes nothing.
    #[must_use]
    pub fn saved(&self) -> Self {
        let mut saved = self.clone();
        saved.project.output = PathBuf::from(".");
        saved.visit_inputs(&mut |path| *path = self.result_folder().saved(path));
        saved
    }

    /// Folder of the results, which knows how paths of the input are written into it.
    #[must_use]
    pub fn result_folder(&self) -> ResultFolder<'_> {
        ResultFolder { path: &self.project.output, own: &self.own_paths }
    }

    /// As TOML.
    ///
    /// # Panics
    /// Never: every field of the configuration is representable in TOML.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("a configuration is representable in TOML")
    }
}

/// Reads any settings from the text of a file (`path` is for messages only) with `table.key=value` assignments applied.
///
/// # Errors
/// [`ConfigError::Parse`] with the line underlined, or [`ConfigError::Set`].
pub fn parse<T: DeserializeOwned>(text: &str, path: Option<&Path>, assignments: &[String]) -> Result<T, ConfigError> {
    parse_with(text, path, assignments, advice::KEYS_OF_RUN, |_| ())
}

/// As [`parse`] for settings of simulated scenes, which `sizeup-lab schema` lists.
///
/// # Errors
/// As [`parse`].
pub fn parse_scene<T: DeserializeOwned>(
    text: &str,
    path: Option<&Path>,
    assignments: &[String],
) -> Result<T, ConfigError> {
    parse_with(text, path, assignments, advice::KEYS_OF_SCENE, |_| ())
}

/// As [`parse`], with the file's table changed before the assignments. `keys` says where all keys are listed.
fn parse_with<T: DeserializeOwned>(
    text: &str,
    path: Option<&Path>,
    assignments: &[String],
    keys: &str,
    change: impl FnOnce(&mut toml::Table),
) -> Result<T, ConfigError> {
    let path = || path.unwrap_or(Path::new("settings")).to_owned();
    let parse_error = |e: toml::de::Error| {
        let (message, hint) = advice::of_file(&e, text, keys);
        let message = message.or_else(|| placed(&e, text)).unwrap_or_else(|| e.to_string());
        ConfigError::Parse { path: path(), message, hint }
    };
    let mut table: toml::Table = toml::from_str(text).map_err(parse_error)?;
    let as_written = table.clone();
    change(&mut table);
    let check_escapes = |table: &toml::Table| {
        let sources: Vec<&str> = std::iter::once(text).chain(assignments.iter().map(String::as_str)).collect();
        escapes::unmeant(table, &sources).map_or(Ok(()), |(key, written)| {
            let message = format!("`{key} = \"{written}\"` holds control characters, expected a path or a word");
            Err(ConfigError::Parse { path: path(), message, hint: escapes::hint(&written) })
        })
    };
    if assignments.is_empty() && table == as_written {
        check_escapes(&table)?;
        return toml::from_str(text).map_err(parse_error); // keeps the place of every error
    }
    let without_assignments = table.clone();
    for assignment in assignments {
        assign(&mut table, assignment).map_err(|message| ConfigError::Set {
            assignment: assignment.clone(),
            message,
            hint: advice::FORM.into(),
        })?;
    }
    check_escapes(&table)?;
    table.try_into().map_err(|e: toml::de::Error| match toml::from_str::<T>(text) {
        Err(placed) if placed.message() == e.message() => parse_error(placed), // the file's own mistake, with its line
        _ if assignments.is_empty() => {
            let (_, hint) = advice::of_file(&e, text, keys);
            ConfigError::Parse { path: path(), message: e.message().to_owned(), hint }
        }
        _ => {
            // The first that brings the mistake in is to blame.
            let mut table = without_assignments;
            let brings_it_in = |assignment: &&String| {
                let _ = assign(&mut table, assignment);
                table.clone().try_into::<T>().is_err_and(|with_it| with_it.message() == e.message())
            };
            advice::of_assignments(&e, assignments.iter().find(brings_it_in), assignments, keys)
        }
    })
}

/// The message of an unknown key with its own line: where the kind of a table is one of its keys, the parser only knows
/// the line of the table.
fn placed(error: &toml::de::Error, text: &str) -> Option<String> {
    let key = error.message().strip_prefix("unknown field `")?.split('`').next()?;
    let is_key =
        |line: &str| line.trim_start().strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='));
    let table = text.get(..error.span()?.start)?.matches('\n').count();
    let (i, line) = text.lines().enumerate().skip(table).find(|(_, line)| is_key(line))?;
    let (number, indent) = ((i + 1).to_string(), line.len() - line.trim_start().len());
    let margin = " ".repeat(number.len());
    let mark = format!("{}{}", " ".repeat(indent), "^".repeat(key.len()));
    Some(format!(
        "TOML parse error at line {number}, column {}\n{margin} |\n{number} | {line}\n{margin} | {mark}\n{}",
        indent + 1,
        error.message()
    ))
}

/// Sets `a.b.c = value` in a table; the value is TOML where it parses as such, else a string.
fn assign(table: &mut toml::Table, assignment: &str) -> Result<(), String> {
    let (key, value) = assignment.split_once('=').ok_or("expected key=value")?;
    let value = match format!("v = {value}").parse::<toml::Table>() {
        Ok(mut parsed) => parsed.remove("v").unwrap_or_else(|| toml::Value::String(value.to_owned())),
        // Quotes that reach this far were meant for TOML.
        Err(_) if value.trim_start().starts_with('"') && value.contains('\\') => {
            return Err(format!("the value is no text of TOML: {}", escapes::hint(value.trim().trim_matches('"'))));
        }
        Err(_) => toml::Value::String(value.to_owned()),
    };
    let mut keys: Vec<&str> = key.trim().split('.').collect();
    let last = keys.pop().filter(|k| !k.is_empty()).ok_or("the key is empty")?;
    let mut table = table;
    for key in keys {
        let entry = table.entry(key).or_insert_with(|| toml::Value::Table(toml::Table::new()));
        table = entry.as_table_mut().ok_or_else(|| format!("`{key}` is a value, not a table"))?;
    }
    table.insert(last.to_owned(), value);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINIMAL: &str = r#"
        [project]
        crs = "EPSG:25832"
        [survey]
        path = "sparse"
        [footprints]
        path = "footprints.gpkg"
        [terrain]
        constant_m = 12.0
        [prior]
        source = "files"
        path = "priors/{stem}.npy"
        kind = "depth"
    "#;

    fn load(text: &str, assignments: &[&str]) -> Result<RunConfig, ConfigError> {
        let assignments: Vec<String> = assignments.iter().map(|a| (*a).to_owned()).collect();
        RunConfig::from_text(text, Path::new("sizeup.toml"), &assignments)
    }

    #[test]
    fn what_is_saved_reads_back_the_same() {
        let config = load(MINIMAL, &["heights.max_m=35.5", "seed=9"]).unwrap();
        assert_eq!((config.seed, config.heights.max_m), (9, Some(35.5)));
        assert_eq!(load(&config.to_toml(), &[]).unwrap(), config);
    }

    #[test]
    fn a_misspelt_key_is_shown_in_its_line() {
        let error = load(&MINIMAL.replace("crs =", "csr ="), &[]).unwrap_err().to_string();
        assert!(error.contains("csr") && error.contains("line 3"), "{error}");
        // Also where an assignment is not to blame.
        let error = load(&MINIMAL.replace("crs =", "csr ="), &["seed=1"]).unwrap_err().to_string();
        assert!(error.contains("csr") && error.contains("line 3"), "{error}");
    }

    #[test]
    fn a_misspelt_key_of_a_table_with_a_kind_is_shown_in_its_line() {
        let text = MINIMAL.replace("kind = \"depth\"", "kindd = \"depth\"");
        let error = load(&text, &[]).unwrap_err().to_string();
        assert!(error.contains("kindd = \"depth\"") && error.contains('^'), "{error}");
        let text = MINIMAL.replace("path = \"footprints.gpkg\"", "path = \"a\"\n        id_feild = \"id\"");
        let error = load(&text, &[]).unwrap_err().to_string();
        assert!(error.contains("id_feild = \"id\"") && error.contains("`id_field`"), "{error}");
    }

    #[test]
    fn an_assignment_of_an_unknown_key_is_named() {
        let error = load(MINIMAL, &["optimise.epochz=3"]).unwrap_err().to_string();
        assert!(error.starts_with("--set optimise.epochz=3") && error.contains("epochz"), "{error}");
    }

    #[test]
    fn a_missing_table_is_named_as_one_and_not_placed_at_a_comment() {
        let text = format!("# Our town\n{}", MINIMAL.replace("[terrain]\n        constant_m = 12.0", ""));
        let error = load(&text, &[]).unwrap_err().to_string();
        assert!(error.contains("the table [terrain] is missing") && !error.contains("Our town"), "{error}");
        assert!(error.contains("dtm = ") && error.contains("constant_m = "), "{error}");
    }

    #[test]
    fn a_prior_without_a_source_lists_the_three() {
        let error = load(&MINIMAL.replace("source = \"files\"", ""), &[]).unwrap_err().to_string();
        for source in ["\"files\"", "\"network\"", "\"stereo\""] {
            assert!(error.contains(source), "{error}");
        }
    }

    #[test]
    fn a_reference_date_is_a_day_that_files_can_state() {
        let date = |text: &str| load(MINIMAL, &[&format!("project.reference_date=\"{text}\"")]);
        assert_eq!(date("2026-05-01").unwrap().project.reference_date.as_deref(), Some("2026-05-01"));
        for wrong in ["May 2026", "2026-5-1", "2026-02-30", "2026-05-01T12:00:00", ""] {
            let error = date(wrong).unwrap_err().to_string();
            assert!(error.contains("expected a day such as \"2026-05-01\"") && error.contains(wrong), "{error}");
        }
    }

    #[test]
    fn a_misspelt_value_lists_what_it_can_be() {
        let error = load(MINIMAL, &["seed=3", "optimise.preset=papr"]).unwrap_err().to_string();
        assert!(error.starts_with("--set optimise.preset=papr: "), "only the one to blame: {error}");
        let hint = error.split_once("hint: ").unwrap().1;
        assert!(hint.contains("robust") && hint.contains("paper") && !hint.contains("EPSG"), "{error}");
        let error = load(&MINIMAL.replace("\"depth\"", "\"deepth\""), &[]).unwrap_err().to_string();
        assert!(error.split_once("hint: ").unwrap().1.contains("inverse_depth"), "{error}");
    }

    #[test]
    fn a_hyphen_does_for_the_underscore_of_a_prior_s_kind() {
        assert!(load(&MINIMAL.replace("\"depth\"", "\"inverse-depth\""), &[]).is_ok());
    }

    #[test]
    fn assignments_take_words_numbers_and_lists() {
        let config =
            load(MINIMAL, &["project.crs=EPSG:2180", "survey.offset=[1.0, 2.0, 3.0]", "optimise.preset=paper"]);
        let config = config.unwrap();
        assert_eq!(config.project.crs.epsg(), Some(2180));
        assert_eq!(config.survey.offset, [1.0, 2.0, 3.0]);
        assert_eq!(config.optimise.preset, sizeup_heights::optimise::Preset::Paper);
        assert!(load(MINIMAL, &["seed"]).is_err());
    }

    #[test]
    fn the_assignment_that_brings_a_mistake_in_is_blamed_for_it() {
        let set = |assignments: &[&str]| {
            let assignments: Vec<String> = assignments.iter().map(|&a| a.to_owned()).collect();
            parse_scene::<sizeup_truth::simulate::SimulateConfig>("", None, &assignments).unwrap_err()
        };
        // Both name the key; one of them may.
        for assignments in
            [["images.longest_px=640", "prior.longest_px=160"], ["prior.longest_px=160", "images.longest_px=640"]]
        {
            let ConfigError::Set { assignment, hint, .. } = set(&assignments) else { panic!() };
            assert_eq!(assignment, "images.longest_px=640");
            assert!(hint.contains("`sizeup-lab schema`"), "{hint}");
        }
    }

    #[test]
    fn a_misspelt_word_is_answered_with_the_one_that_was_meant() {
        let hint = |text: &str, assignments: &[&str]| {
            let error = load(text, assignments).unwrap_err().to_string();
            error.split_once("hint: ").unwrap().1.to_owned()
        };
        for (from, to, meant) in [
            ("crs =", "csr =", "`crs`"),
            ("crs =", "CRS =", "`crs`"),
            ("[terrain]", "[terain]", "`terrain`"),
            ("constant_m", "constant-m", "`constant_m`"),
            ("kind = ", "knid = ", "`kind`"),
            ("source = ", "sorce = ", "`source` by `sorce`"),
            ("\"files\"", "\"file\"", "`files`"),
            ("path = \"footprints.gpkg\"", "path = \"a\"\n        id_feild = \"id\"", "`id_field`"),
        ] {
            let hint = hint(&MINIMAL.replace(from, to), &[]);
            assert!(hint.starts_with(&format!("did you mean {meant}")), "{to}: {hint}");
        }
        for (assignment, meant) in [
            ("optimize.preset=paper", "`optimise`"),
            ("optimise.preset=robots", "`robust`"),
            ("heights.max=30", "`max_m`"),
        ] {
            let hint = hint(MINIMAL, &[assignment]);
            assert!(hint.starts_with(&format!("did you mean {meant}")), "{assignment}: {hint}");
        }
        assert!(!hint(MINIMAL, &["optimise.colour=1"]).contains("did you mean"), "nothing is like it");
    }

    #[test]
    fn an_assignment_of_another_source_leaves_out_what_the_old_one_had() {
        use sizeup_photos::prior::PriorConfig;
        let stereo = load(MINIMAL, &["prior.source=stereo"]).unwrap();
        assert!(matches!(stereo.prior, PriorConfig::Stereo(_)));
        assert!(matches!(load(MINIMAL, &["prior.source=\"auto\""]).unwrap().prior, PriorConfig::Auto(_)));
        let stereo = MINIMAL.replace("source = \"files\"", "source = \"stereo\"");
        let stereo = stereo.replace("path = \"priors/{stem}.npy\"\n        kind = \"depth\"", "cache.folder = \"c\"");
        // What is assigned itself counts.
        let files = load(&stereo, &["prior.source=files", "prior.path=p/{stem}.npy", "prior.kind=depth"]).unwrap();
        assert!(matches!(files.prior, PriorConfig::Files(_)));
        let error = load(MINIMAL, &["prior.source=stereo", "prior.kind=depth"]).unwrap_err().to_string();
        assert!(error.starts_with("--set prior.kind=depth: "), "{error}");
        let error = load(MINIMAL, &["seed=1", "prior.source=sterio"]).unwrap_err().to_string();
        assert!(
            error.starts_with("--set prior.source=sterio: ") && error.contains("did you mean `stereo`?"),
            "{error}"
        );
        // What both have stays: the path.
        let masks = load(MINIMAL, &["footprints.source=masks", "footprints.kind=instance"]).unwrap();
        assert!(matches!(&masks.footprints, FootprintSource::Masks(_)));
        assert!(masks.to_toml().contains("path = \"footprints.gpkg\""), "{}", masks.to_toml());
    }

    #[test]
    fn one_setting_of_the_view_selection_leaves_the_others_to_the_preset() {
        use sizeup_heights::views::{Choice, ViewsConfig};
        for preset in ["paper", "robust"] {
            let mut optimise = load(MINIMAL, &[&format!("optimise.preset={preset}")]).unwrap().optimise;
            let own = optimise.views_in_force();
            optimise.views.n_spread = Some(7);
            assert_eq!(optimise.views_in_force(), ViewsConfig { n_spread: 7, ..own }, "{preset}");
        }
        let paper = load(MINIMAL, &["optimise.preset=paper"]).unwrap();
        assert_eq!(paper.optimise.views_in_force().choice, Choice::Cover);
    }
}
