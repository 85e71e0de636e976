//! The tiles that are done, as one city.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::manifest::{Common, Done, Layout, Manifest, hash_of, read_json, sweep_litter};
use super::merged::TileRecords;
use super::run::{BUILDINGS, HALO, ISSUES, LINEAGE};
use super::seams::{self, SeamReport};
use super::{Lock, TilesError};
use crate::files::FileError;
use crate::issue::{Issue, Severity, Subject};
use crate::output::geopackage::{self, TileArea};
use crate::output::reports::{write_issues, write_json};
use crate::output::tiles3d::{self, Heights, Tiles3dConfig};
use crate::output::{CityModel, InputFile, Lineage, OutputError, Overview, Records as _, Status, cityjson, sha256_hex};
use crate::pipeline::{refused_records, unstated_reference, write_project};
use crate::stats;
use crate::survey::Survey;

/// The city's layer package.
const GEOPACKAGE: &str = "city.gpkg";
/// Its buildings, a line each.
const SEQUENCE: &str = "city.city.jsonl";
/// Its tileset.
const TILESET: &str = "3dtiles";

/// What becomes of tiles that are not done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Missing {
    /// Without all of them nothing is merged.
    Refuse,
    /// What there is is merged, and the rest is named.
    Allow,
}

/// How a city is merged.
#[derive(Debug, Clone, PartialEq)]
pub struct MergeOptions {
    /// Tiles that are not done.
    pub missing: Missing,
    /// What heights are, for 3D Tiles.
    pub heights: Heights,
}

/// What was merged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Merged {
    /// Tiles of the plan.
    pub n_tiles: usize,
    /// Tiles that are not done.
    pub missing: Vec<String>,
    /// Buildings, those without an outline included.
    pub n_buildings: usize,
    /// Buildings by what became of them.
    pub by_status: BTreeMap<Status, usize>,
    /// Median height above ground, metres.
    pub median_height_m: Option<f64>,
    /// Issues that are refusals.
    pub n_refused: usize,
    /// How well neighbours agree.
    pub seams: SeamReport,
    /// Why there are no 3D Tiles, if so.
    pub no_tileset: Option<String>,
    /// Files by name, with their hashes.
    pub outputs: BTreeMap<String, String>,
    /// Hash of all that it was made from.
    input_sha256: String,
}

impl Merged {
    /// Whether some items of the input have no result.
    #[must_use]
    pub fn has_failed_items(&self) -> bool {
        let count = |status| self.by_status.get(&status).copied().unwrap_or(0);
        !self.missing.is_empty() || self.n_refused > 0 || count(Status::Unknown) + count(Status::Refused) > 0
    }
}

/// Merges the tiles that are done. The same tiles give the same bytes; if nothing has changed since the last time,
/// nothing is done.
///
/// # Errors
/// [`TilesError`]: no plan, tiles missing, two tiles with one building, files that cannot be written.
pub fn merge(layout: &Layout, options: &MergeOptions, wait: &dyn Fn(&str)) -> Result<Merged, TilesError> {
    let manifest = layout.read_manifest()?;
    let _lock = Lock::take(&layout.lock("city"), wait)?;
    sweep_litter(layout.folder());
    let done: Vec<Option<Done>> =
        manifest.tiles.iter().map(|tile| layout.read_done(&tile.id).filter(|done| done.is_intact(layout))).collect();
    let pairs = manifest.tiles.iter().zip(&done);
    let missing: Vec<String> = pairs.filter(|(_, done)| done.is_none()).map(|(tile, _)| tile.id.clone()).collect();
    if let (Some(first), Missing::Refuse) = (missing.first(), options.missing) {
        let (n_missing, n_tiles) = (missing.len(), done.len());
        return Err(TilesError::Missing { n_missing, n_tiles, first: first.clone() });
    }
    let input_sha256 = input_sha256(layout, &done, options)?;
    if let Ok(merged) = read_json::<Merged>(&layout.merged())
        && merged.input_sha256 == input_sha256
        && merged.is_intact(layout.folder())
    {
        return Ok(merged);
    }
    let city = City { layout, manifest: &manifest, done: done.iter().flatten().collect(), missing };
    let merged = city.write(options, input_sha256)?;
    write_json(&layout.merged(), &merged)?;
    Ok(merged)
}

fn input_sha256(layout: &Layout, done: &[Option<Done>], options: &MergeOptions) -> Result<String, TilesError> {
    let shared = [hash_of(&layout.manifest())?, hash_of(&layout.common())?];
    let parts = json!([env!("CARGO_PKG_VERSION"), shared, done, options.heights]);
    Ok(sha256_hex(parts.to_string().as_bytes()))
}

impl Merged {
    fn is_intact(&self, folder: &Path) -> bool {
        let is_same =
            |(name, sha256): (&String, &String)| hash_of(&folder.join(name)).is_ok_and(|found| found == *sha256);
        self.outputs.iter().all(is_same)
    }
}

/// A city about to be written.
struct City<'a> {
    layout: &'a Layout,
    manifest: &'a Manifest,
    done: Vec<&'a Done>,
    missing: Vec<String>,
}

impl City<'_> {
    fn write(self, options: &MergeOptions, input_sha256: String) -> Result<Merged, TilesError> {
        let (config, folder) = (&self.manifest.config, self.layout.folder());
        let common: Common = read_json(&self.layout.common())?;
        let issues = self.issues(common.issues)?;
        let survey = Survey { views: common.views, issues: Vec::new() };
        let records = TileRecords { files: self.files(BUILDINGS), rest: refused_records(config, common.refused) };
        let lineage = self.lineage()?;
        let crs = &config.project.crs;
        let model = CityModel { records: &records, crs, lineage: &lineage, issues: &issues, survey: &survey };
        let gpkg = &config.output.geopackage;
        let overview = geopackage::write_divided(&folder.join(GEOPACKAGE), &model, gpkg, &self.areas())?;
        write_project(config, folder, GEOPACKAGE, &model)?;
        cityjson::write_sequence(&folder.join(SEQUENCE), &model, &config.output.cityjson)?;
        let no_tileset = write_tileset(&folder.join(TILESET), &model, options)?;
        write_issues(&folder.join("issues.json"), &issues)?;
        write_json(&folder.join("lineage.json"), &lineage)?;
        let seams = seams::compare(&records.files, &self.files(HALO))?;
        let (by_status, median_height_m) = count(&records)?;
        let summary = json!({
            "n_tiles": self.manifest.tiles.len(), "missing_tiles": self.missing, "n_buildings": overview.n_buildings,
            "n_heights": overview.n_heights, "by_status": by_status, "median_height_m": median_height_m,
            "n_views": self.manifest.n_views, "seams": seams,
        });
        write_json(&folder.join("summary.json"), &summary)?;
        Ok(Merged {
            n_tiles: self.manifest.tiles.len(),
            missing: self.missing,
            n_buildings: overview.n_buildings,
            by_status,
            median_height_m,
            n_refused: issues.iter().filter(|issue| issue.severity == Severity::Refused).count(),
            seams,
            outputs: outputs(folder, no_tileset.is_none())?,
            no_tileset,
            input_sha256,
        })
    }

    fn files(&self, name: &str) -> Vec<PathBuf> {
        self.done.iter().map(|done| self.layout.tile(&done.tile).join(name)).collect()
    }

    /// Issues of the whole, then those of the tiles, each once: neighbours share photos.
    fn issues(&self, common: Vec<Issue>) -> Result<Vec<Issue>, TilesError> {
        let mut issues = common;
        let mut known: BTreeSet<String> = BTreeSet::new();
        for path in self.files(ISSUES) {
            let of_tile: Vec<Issue> = read_json(&path)?;
            issues.extend(of_tile.into_iter().filter(|issue| known.insert(json!(issue).to_string())));
        }
        issues.extend(unstated_reference(&self.manifest.config));
        issues.extend(self.missing.iter().map(|id| {
            let message = "the tile is not done: its buildings are missing";
            Issue::new(Severity::Refused, "tile_missing", Subject::Input(id.clone()), message)
                .hint("run it with `sizeup tiles run`, and merge again")
        }));
        Ok(issues)
    }

    fn lineage(&self) -> Result<Lineage, TilesError> {
        let mut inputs: BTreeSet<InputFile> = self.manifest.inputs.iter().cloned().collect();
        let mut lineage = None;
        for path in self.files(LINEAGE) {
            let mut of_tile: Lineage = read_json(&path)?;
            inputs.extend(std::mem::take(&mut of_tile.inputs));
            lineage.get_or_insert(of_tile);
        }
        let lineage = lineage.unwrap_or_default();
        Ok(Lineage { command: "sizeup tiles merge".to_owned(), inputs: inputs.into_iter().collect(), ..lineage })
    }

    fn areas(&self) -> Vec<TileArea> {
        let area = |tile: &super::Tile| {
            let done = self.done.iter().find(|done| done.tile == tile.id);
            TileArea {
                name: tile.id.clone(),
                status: if done.is_some() { "done" } else { "missing" },
                corners_m: [tile.core.west_m, tile.core.south_m, tile.core.east_m, tile.core.north_m],
                n_buildings: done.map_or(0, |done| done.n_buildings),
                n_heights: done.map_or(0, |done| done.n_heights),
            }
        };
        self.manifest.tiles.iter().map(area).collect()
    }
}

/// Writes 3D Tiles; where nobody says what heights count from, the reason why not.
fn write_tileset(
    path: &Path,
    model: &CityModel<'_, TileRecords>,
    options: &MergeOptions,
) -> Result<Option<String>, TilesError> {
    let config = Tiles3dConfig { heights: options.heights, ..Tiles3dConfig::default() };
    match tiles3d::write(path, model, &config) {
        Ok(Overview { .. }) => Ok(None),
        Err(reason @ OutputError::HeightsNotStated { .. }) => Ok(Some(reason.to_string())),
        Err(error) => Err(error.into()),
    }
}

fn count(records: &TileRecords) -> Result<(BTreeMap<Status, usize>, Option<f64>), TilesError> {
    let (mut by_status, mut heights) = (BTreeMap::new(), Vec::new());
    records.visit(&mut |record| {
        *by_status.entry(record.status).or_default() += 1;
        heights.extend(record.height_m);
        Ok(())
    })?;
    Ok((by_status, stats::median(&heights)))
}

fn outputs(folder: &Path, has_tileset: bool) -> Result<BTreeMap<String, String>, TilesError> {
    let names = [GEOPACKAGE, "city.qgs", SEQUENCE, "issues.json", "lineage.json", "summary.json"];
    let tileset = [format!("{TILESET}/tileset.json")];
    let names = names.iter().map(|&name| name.to_owned()).chain(tileset.into_iter().filter(|_| has_tileset));
    let hash = |name: String| hash_of(&folder.join(&name)).map(|sha256| (name, sha256));
    Ok(names.map(hash).collect::<Result<_, FileError>>()?)
}
