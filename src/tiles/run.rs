//! One tile: read what it needs, solve it, write its buildings, and say that it is done.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::manifest::{Done, Layout, Manifest, Tile, TileViews, hash_of, read_json, sweep_litter};
use super::plan::settings_sha256;
use super::{Lock, TilesError};
use crate::files::{FileError, write_whole, write_whole_unflushed};
use crate::issue::{Severity, Subject};
use crate::output::reports::{write_issues, write_json};
use crate::output::unmeasured::unmeasured;
use crate::output::{CityModel, InputFile, Status, cityjson, sha256_hex};
use crate::pipeline::{Part, PartHeights, Tell, outlines_around};
use crate::survey::Survey;

/// Its buildings, one a line, exactly as they were found.
pub(super) const BUILDINGS: &str = "buildings.jsonl";
/// Heights of its halo's buildings, one a line.
pub(super) const HALO: &str = "halo.jsonl";
/// What was wrong with its buildings and photos.
pub(super) const ISSUES: &str = "issues.json";
/// Where it comes from.
pub(super) const LINEAGE: &str = "lineage.json";
/// Its buildings for others.
const CITY: &str = "city.city.json";
/// What it cost: differs from run to run, so it is no result.
const COST: &str = "cost.json";

/// What running a tile came to.
#[derive(Debug, Clone, PartialEq)]
pub enum TileRun {
    /// It was done already, with the same input.
    WasDone(Done),
    /// It was run.
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
    /// Its middle's distance from the core, metres.
    pub distance_m: f64,
}

/// Runs a tile, unless it is done with the same input. One runner at a time: a second one waits (`wait` is told for
/// whom) and finds it done.
///
/// # Errors
/// [`TilesError`]: a plan that does not fit, input that cannot be read, files that cannot be written. The tile is then
/// not done, and running it again starts from the beginning.
pub fn run_tile(layout: &Layout, id: &str, wait: &dyn Fn(&str), tell: Tell<'_>) -> Result<TileRun, TilesError> {
    let start = Instant::now();
    let manifest = layout.read_manifest()?;
    let tile = manifest.tile(id)?;
    let _lock = Lock::take(&layout.lock(id), wait)?;
    let folder = layout.tile(id);
    sweep_litter(&folder);
    let mut part = part_of(layout, &manifest, tile)?;
    let inputs = inputs_of(&manifest, &part, |_| true)?;
    let input_sha256 = input_sha256(&manifest, tile, &part, &inputs)?;
    if let Some(done) = layout.read_done(id).filter(|done| done.input_sha256 == input_sha256)
        && done.is_intact(layout)
    {
        return Ok(TileRun::WasDone(done));
    }
    // From here on its files are being replaced: the old word no longer holds.
    let path = layout.done(id);
    if path.exists() {
        std::fs::remove_file(&path).map_err(FileError::on("cannot remove", &path))?;
    }
    let heights = part.solve(tell)?;
    let done = write(layout, &manifest, tile, &part, heights, input_sha256)?;
    let cost = json!({ "seconds": start.elapsed().as_secs_f64(), "peak_mb": peak_mb(), "estimate_mb": tile.memory_mb });
    write_json(&folder.join(COST), &cost)?;
    write_json(&path, &done)?;
    Ok(TileRun::Ran(done))
}

fn part_of<'a>(layout: &Layout, manifest: &'a Manifest, tile: &Tile) -> Result<Part<'a>, TilesError> {
    let path = layout.views(&tile.id);
    if hash_of(&path)? != tile.views_sha256 {
        return Err(TilesError::Plan { path, message: "it is not the one that the plan was written with".to_owned() });
    }
    let views: TileViews = read_json(&path)?;
    let footprints = outlines_around(&manifest.config, tile.halo, &manifest.renamed)?;
    let positions = views.positions_by_name();
    let survey = Survey { views: views.views, issues: Vec::new() };
    Ok(Part::new(&manifest.config, manifest.frame(), survey, positions, footprints)?)
}

/// The shared files as the plan knows them, and the priors of the views that are wanted.
fn inputs_of(
    manifest: &Manifest,
    part: &Part<'_>,
    is_wanted: impl Fn(&crate::ids::ViewId) -> bool,
) -> Result<Vec<InputFile>, TilesError> {
    let priors = part.prior_files(is_wanted)?;
    // A file that cannot be read is an issue of its view, and its absence is part of the input.
    let hashed = priors.iter().filter_map(|path| InputFile::hash("prior", path).ok());
    let mut inputs: Vec<InputFile> = manifest.inputs.iter().cloned().chain(hashed).collect();
    inputs.sort();
    Ok(inputs)
}

/// Hash of everything that a tile is made from: settings, frame, views, outlines on their ground, and priors. The shared
/// files count by what the tile reads of them, so that a change elsewhere in the city leaves it done.
fn input_sha256(manifest: &Manifest, tile: &Tile, part: &Part<'_>, inputs: &[InputFile]) -> Result<String, TilesError> {
    let priors: Vec<&InputFile> = inputs.iter().filter(|file| file.role == "prior").collect();
    let photos = part.photo_files();
    let photos: Vec<InputFile> = photos.iter().filter_map(|path| InputFile::hash("photo", path).ok()).collect();
    let parts = json!({
        "sizeup": manifest.sizeup,
        "settings": settings_sha256(&manifest.config),
        "frame": [manifest.origin_m.to_vec(), manifest.heights_m.map(f64::from).to_vec()],
        "core": tile.core,
        "halo": tile.halo,
        "views": tile.views_sha256,
        "footprints": sha256_hex(&to_bytes(part.footprints())?),
        "terrain": part.terrain_sha256(),
        "priors": priors,
        "photos": photos,
    });
    Ok(sha256_hex(&to_bytes(&parts)?))
}

fn to_bytes(value: &impl Serialize) -> Result<Vec<u8>, FileError> {
    serde_json::to_vec(value).map_err(|e| FileError::on("cannot hash", Path::new("the tile's input"))(e.into()))
}

fn write(
    layout: &Layout,
    manifest: &Manifest,
    tile: &Tile,
    part: &Part<'_>,
    heights: PartHeights,
    input_sha256: String,
) -> Result<Done, TilesError> {
    let folder = layout.tile(&tile.id);
    // Parts of an outline that was taken apart go with the outline.
    let belongs = |id: &str| part.middle_of(id).is_some_and(|middle| tile.core.holds(middle));
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
    let inputs = inputs_of(manifest, part, |view| used.contains(view))?;
    let lineage = part.lineage(&format!("sizeup tiles run --tile {}", tile.id), inputs);
    let config = &manifest.config;
    issues.extend(cityjson::check(&own, &config.output.cityjson)?);
    issues.extend(unmeasured(&own, &issues));
    let model = CityModel {
        records: own.as_slice(),
        crs: &config.project.crs,
        lineage: &lineage,
        issues: &issues,
        survey: part.survey(),
    };
    cityjson::write(&folder.join(CITY), &model, &config.output.cityjson)?;
    write_lines(&folder.join(BUILDINGS), own.iter())?;
    write_lines(&folder.join(HALO), halo)?;
    write_issues(&folder.join(ISSUES), &issues)?;
    write_json(&folder.join(LINEAGE), &lineage)?;

    let names = [CITY, BUILDINGS, HALO, ISSUES, LINEAGE];
    let hash = |name: &str| Ok((name.to_owned(), hash_of(&folder.join(name))?));
    let outputs = names.into_iter().map(hash).collect::<Result<BTreeMap<_, _>, FileError>>()?;
    let mut by_status: BTreeMap<Status, usize> = BTreeMap::new();
    for record in &own {
        *by_status.entry(record.status).or_default() += 1;
    }
    let has_failed = issues.iter().any(|issue| issue.severity == Severity::Refused)
        || by_status.contains_key(&Status::Unknown)
        || by_status.contains_key(&Status::Refused);
    Ok(Done {
        sizeup: manifest.sizeup.clone(),
        tile: tile.id.clone(),
        input_sha256,
        outputs,
        n_buildings: own.len(),
        n_heights: own.iter().filter(|r| r.height_m.is_some()).count(),
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

/// The most memory that this process has held, megabytes, where the system tells.
fn peak_mb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes.div_ceil(1000))
}

/// Keeps what a tile said while it ran.
pub(super) fn write_log(layout: &Layout, id: &str, text: &[u8]) -> Result<(), FileError> {
    write_whole_unflushed(&layout.tile(id).join("log.txt"), |out| out.write_all(text))
}
