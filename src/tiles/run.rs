//! One tile: read what it needs, solve it, write its buildings, and say that it is done.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::attempt::{Attempt, remove_if_there};
use super::manifest::{Done, Layout, Tile, TileViews, hash_of, sweep_litter};
use super::merge::names_below;
use super::stale::{StaleCheck, Trust, known};
use super::{Lock, TilesError};
use crate::pipeline::{CityPart, PaintedTile, PartHeights, RunSettings, Tell, footprints_around, layer_of};
use crate::recipe::{Recipe, program};
use sizeup_geo::files::{FileError, write_whole, write_whole_unflushed};
use sizeup_geo::issue::{Severity, Subject};
use sizeup_heights::ids::ViewId;
use sizeup_results::output::cityjson::CityJsonConfig;
use sizeup_results::output::reports::{write_issues, write_json};
use sizeup_results::output::textured;
use sizeup_results::output::unmeasured::unmeasured;
use sizeup_results::output::{CityModel, InputFile, Overview, Status, StatusCount, cityjson, n_photos_missing};
use sizeup_survey::Survey;

/// Buildings, one a line, exactly as they were found.
pub(super) const BUILDINGS: &str = "buildings.jsonl";
/// Heights of its halo's buildings, one a line.
pub(super) const HALO: &str = "halo.jsonl";
/// Issues of its buildings and photos.
pub(super) const ISSUES: &str = "issues.json";
/// Terrain by its photos in its core and close to it.
pub(super) const GROUND: &str = "ground.json";
/// Name of the file of a tile's lineage.
pub(super) const LINEAGE: &str = "lineage.json";
/// Name of a tile's CityJSON file, for other programs.
const CITY: &str = "city.city.json";
/// Cost: differs from run to run, so it is no result.
pub(super) const COST: &str = "cost.json";
/// Role of its part of the footprints, in its lineage.
pub(super) const PART_OF_FOOTPRINTS: &str = "footprints, the tile's part";
/// Role of its part of the terrain, in its lineage.
pub(super) const PART_OF_TERRAIN: &str = "terrain, the tile's part";
/// Role of its part of the reviews, in its lineage.
pub(super) const PART_OF_REVIEWS: &str = "reviews, the tile's part";

/// Cost of a tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Cost {
    /// Time from start to end, seconds.
    pub seconds: f64,
    /// Time of all threads, where the system reports it.
    pub processor_seconds: Option<f64>,
    /// The most memory that it held, megabytes, where the system reports it.
    pub peak_mb: Option<u64>,
    /// Estimate of the plan.
    pub estimate_mb: u64,
    /// Buildings of core and halo.
    pub n_solved: usize,
    /// The program that ran it.
    pub program: String,
}

/// Outcome of running a tile.
#[derive(Debug, Clone, PartialEq)]
pub enum TileRun {
    /// It was done already, with the same input.
    WasDone(Done),
    /// The tile was run now.
    Ran(Done),
}

impl TileRun {
    /// The word that it is done.
    #[must_use]
    pub fn done(&self) -> &Done {
        match self {
            Self::WasDone(done) | Self::Ran(done) => done,
        }
    }
}

/// A building of the halo, as this tile found it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct HaloHeight {
    pub id: String,
    pub height_m: Option<f64>,
    /// Middle's distance from the core, metres.
    pub distance_m: f64,
}

/// Runs a tile, unless it is done with the same input. One runner at a time: a second one waits (`wait` takes the
/// name of the first) and finds it done.
///
/// # Errors
/// [`TilesError`]: a plan that does not fit, input that cannot be read or has changed since the plan, files that cannot be
/// written. The tile is then not done, and running it again starts from the beginning.
pub fn run_tile(
    layout: &Layout,
    id: &str,
    trust: Trust,
    wait: &dyn Fn(&str),
    tell: Tell<'_>,
) -> Result<TileRun, TilesError> {
    let manifest = layout.read_manifest()?;
    manifest.config.limits.set();
    let tile = manifest.tile(id)?;
    let _lock = Lock::take(&layout.lock(id), wait)?;
    sweep_litter(&layout.tile(id));
    let hashes = known(layout, trust, ["plan", id].into_iter());
    let check = StaleCheck::new(layout, &manifest, &hashes);
    let views = check.views(tile)?;
    if manifest.made_by.program() != program() {
        let why = format!("made by sizeup {}, this is {}", manifest.made_by.program(), program());
        return Err(TilesError::Stale { what: "the plan".to_owned(), why, hint: PLAN_AGAIN });
    }
    let wanted = check.tile_of(tile, &views);
    if let Some(done) = layout.read_done(id).filter(|done| check.why_not_done(&wanted, done).is_none()) {
        // The files may be the same after all: then nobody need read them again.
        check.keep_hashes(tile, &views, &done)?;
        Attempt::forget(layout, id)?;
        return Ok(TileRun::WasDone(done));
    }
    let attempt = Attempt::start(layout, id)?;
    match run_anew(&check, tile, &views, &wanted, tell) {
        Ok(done) => {
            Attempt::forget(layout, id)?;
            Ok(TileRun::Ran(done))
        }
        Err(error) => {
            attempt.fail(layout, &error);
            Err(error)
        }
    }
}

/// Remedy where the plan is stale.
pub(super) const PLAN_AGAIN: &str =
    "plan again with `sizeup tiles plan`: tiles that the change does not touch stay done";

fn run_anew(
    check: &StaleCheck<'_>,
    tile: &Tile,
    views: &TileViews,
    wanted: &Recipe,
    tell: Tell<'_>,
) -> Result<Done, TilesError> {
    let (start, layout, manifest) = (Instant::now(), check.layout, check.manifest);
    let settings = RunSettings::of(&manifest.config);
    let part = part_of(check, &settings, tile, views.clone())?;
    // From here on its files are being replaced: the old word no longer holds.
    let path = layout.done(&tile.id);
    remove_if_there(&path)?;
    let heights = part.solve(&tile.core, &layout.tile(&tile.id), tell)?;
    let done = write(check, tile, &part, heights, wanted)?;
    if let Some(why) = check.tile_of(tile, views).why_stale(wanted) {
        return Err(TilesError::ChangedMeanwhile { id: tile.id.clone(), why });
    }
    let cost = Cost {
        seconds: start.elapsed().as_secs_f64(),
        processor_seconds: processor_seconds(),
        peak_mb: peak_mb(),
        estimate_mb: tile.memory_mb,
        n_solved: tile.n_solved,
        program: manifest.made_by.program().to_owned(),
    };
    write_json(&layout.tile(&tile.id).join(COST), &cost)?;
    check.keep_hashes(tile, views, &done)?;
    write_json(&path, &done)?;
    Ok(done)
}

fn part_of<'a>(
    check: &StaleCheck<'_>,
    settings: &'a RunSettings<'a>,
    tile: &Tile,
    views: TileViews,
) -> Result<CityPart<'a>, TilesError> {
    let manifest = check.manifest;
    let positions = views.positions_by_name();
    let survey = Survey { views: views.views, issues: Vec::new() };
    let footprints = footprints_around(&settings.footprints, tile.halo, &manifest.renamed)?;
    let part = CityPart::new(settings, manifest.frame(), survey, positions, footprints)?;
    if part.hashes() != tile.reads {
        let own =
            || format!("the footprints, the terrain or the reviews of tile {} are not those of the plan", tile.id);
        let (what, why) = ("the plan".to_owned(), check.plan().unwrap_or_else(own));
        return Err(TilesError::Stale { what, why, hint: PLAN_AGAIN });
    }
    Ok(part)
}

/// Inputs of a tile's result: its part of the files that all tiles share, and the priors of the views that were
/// used.
fn inputs_of(
    check: &StaleCheck<'_>,
    tile: &Tile,
    part: &CityPart<'_>,
    used: &HashSet<&ViewId>,
) -> Result<Vec<InputFile>, TilesError> {
    let config = &check.manifest.config;
    let footprints = layer_of(&RunSettings::of(config).footprints).path.clone();
    let terrain = config.terrain.dtm.iter().zip(&tile.reads.terrain);
    let reviews = config.reviews.iter().zip(&tile.reads.reviews);
    let parts = std::iter::once((PART_OF_FOOTPRINTS, footprints, tile.reads.footprints.clone()))
        .chain(terrain.map(|(path, content)| (PART_OF_TERRAIN, path.clone(), content.clone())))
        .chain(reviews.map(|(reviews, content)| (PART_OF_REVIEWS, reviews.path.clone(), content.clone())));
    let parts = parts.map(|(role, path, content)| InputFile::holding(role, &path, content));
    let priors = part.prior_files(|view| used.contains(view))?;
    let priors = priors.iter().filter_map(|path| Some(InputFile::holding("prior", path, check.hashes.of(path).ok()?)));
    let mut inputs: Vec<InputFile> = parts.chain(priors).collect();
    inputs.sort();
    Ok(inputs)
}

fn write(
    check: &StaleCheck<'_>,
    tile: &Tile,
    part: &CityPart<'_>,
    heights: PartHeights,
    made_by: &Recipe,
) -> Result<Done, TilesError> {
    let folder = check.layout.tile(&tile.id);
    // Parts of a footprint that was split go with the footprint.
    let belongs = |id: &str| part.owns(id, &tile.core);
    let (own, others): (Vec<_>, Vec<_>) = heights.records.into_iter().partition(|record| belongs(&record.id));
    let halo = others.into_iter().filter_map(|record| {
        let distance_m = tile.core.distance_m(part.middle_of(&record.id)?);
        Some(HaloHeight { id: record.id, height_m: record.height_m, distance_m })
    });
    let mut issues = heights.issues;
    issues.retain(|issue| match &issue.subject {
        Subject::Building(id) => belongs(id),
        Subject::View(_) | Subject::Input(_) => true,
    });
    let used: HashSet<_> = heights.used_views.iter().collect();
    let inputs = inputs_of(check, tile, part, &used)?;
    let lineage = part.lineage(&format!("sizeup tiles run --tile {}", tile.id), inputs);
    let config = &check.manifest.config;
    issues.extend(heights.painted.iter().flat_map(PaintedTile::issues).cloned());
    issues.extend(cityjson::check(&own)?);
    issues.extend(unmeasured(&own, &issues));
    let model = CityModel {
        records: own.as_slice(),
        crs: &config.project.crs,
        lineage: &lineage,
        issues: &issues,
        survey: part.survey(),
    };
    cityjson::write(&folder.join(CITY), &model, &CityJsonConfig::default())?;
    write_lines(&folder.join(BUILDINGS), own.iter())?;
    write_lines(&folder.join(HALO), halo)?;
    write_issues(&folder.join(ISSUES), &issues)?;
    write_json(&folder.join(GROUND), &heights.ground)?;
    write_json(&folder.join(LINEAGE), &lineage)?;

    let textured = folder.join(textured::FOLDER);
    let mut names: Vec<String> = [CITY, BUILDINGS, HALO, GROUND, ISSUES, LINEAGE].map(str::to_owned).to_vec();
    match &heights.painted {
        Some(painted) => {
            painted.write(&textured, &model, &CityJsonConfig::default())?;
            names_below(&folder, textured::FOLDER, &mut names).map_err(FileError::on("cannot read", &textured))?;
        }
        None => textured::remove(&textured)?,
    }
    let hash = |name: String| hash_of(&folder.join(&name)).map(|sha256| (name, sha256));
    let outputs = names.into_iter().map(hash).collect::<Result<BTreeMap<_, _>, FileError>>()?;
    let (count, overview) = (StatusCount::of(&own), Overview::of(own.as_slice())?);
    let by_status = count.by_status();
    let has_failed = issues.iter().any(|issue| issue.severity == Severity::Refused)
        || n_photos_missing(&issues) > 0
        || by_status.contains_key(&Status::Unknown)
        || by_status.contains_key(&Status::Refused);
    Ok(Done {
        tile: tile.id.clone(),
        made_by: made_by.clone(),
        outputs,
        n_buildings: count.n_buildings(),
        n_heights: overview.n_heights,
        by_status,
        n_used_views: heights.used_views.len(),
        exit_code: if has_failed { 5 } else { 0 },
    })
}

fn write_lines<T: Serialize>(path: &Path, lines: impl Iterator<Item = T>) -> Result<(), FileError> {
    write_whole(path, |out| {
        for line in lines {
            serde_json::to_writer(&mut *out, &line)?;
            out.write_all(b"\n")?;
        }
        Ok(())
    })
}

/// The most memory that this process has held, megabytes, where the system reports it.
fn peak_mb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes.div_ceil(1000))
}

/// Processor time of this process and its threads, seconds, where the system reports it.
fn processor_seconds() -> Option<f64> {
    /// Ticks of a second in `/proc`, on every Linux in use.
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name, in brackets, may hold anything; user and system time are the 12th and 13th word after it.
    let words: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: f64 = words.get(11)?.parse::<f64>().ok()? + words.get(12)?.parse::<f64>().ok()?;
    Some(ticks / TICKS)
}

/// Keeps what a tile said while it ran.
pub(super) fn write_log(layout: &Layout, id: &str, text: &[u8]) -> Result<(), FileError> {
    write_whole_unflushed(&layout.tile(id).join("log.txt"), |out| out.write_all(text))
}
