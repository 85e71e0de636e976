//! The tiles that are done, as one city.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::attempt::remove_if_there;
use super::manifest::{Common, Done, Layout, Manifest, Tileset, hash_of, read_json, sweep_litter};
use super::merged::TileRecords;
use super::run::{
    BUILDINGS, GROUND, HALO, ISSUES, LINEAGE, PART_OF_FOOTPRINTS, PART_OF_REVIEWS, PART_OF_TERRAIN, PLAN_AGAIN,
};
use super::seams::{self, SeamReport};
use super::stale::{StaleCheck, Trust, known};
use super::status::TileState;
use super::{Lock, TilesError};
use crate::pipeline::{
    OutputSettings, PhotoGround, RunSettings, refused_records, reviews_of, unstated_reference, write_city_report,
    write_project,
};
use crate::recipe::Recipe;
use sizeup_geo::files::{FileError, is_virtual};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::MapBox;
use sizeup_geo::unfinished::Unfinished;
use sizeup_heights::stats;
use sizeup_results::output::cityjson::CityJsonConfig;
use sizeup_results::output::geopackage::{self, TileArea};
use sizeup_results::output::plausible::CityDoubts;
use sizeup_results::output::reports::{write_issues, write_json};
use sizeup_results::output::textured::{self, SUMMARY, TexturedCity};
use sizeup_results::output::tiles3d::{self, Tiles3dConfig};
use sizeup_results::output::{
    CityModel, InputFile, Lineage, OutputError, Overview, Records as _, RunSummary, Status, StatusCount, TilesSummary,
    cityjson,
};
use sizeup_survey::{Survey, ViewKind};

/// The city's layer package.
const GEOPACKAGE: &str = "city.gpkg";
/// Buildings, a line each.
const SEQUENCE: &str = "city.city.jsonl";
/// Name of the folder of 3D Tiles.
const TILESET: &str = "3dtiles";
/// Page, for cities of up to [`MAX_PAGE_BUILDINGS`].
const PAGE: &str = "report.html";
/// Larger cities make pages that browsers are slow with: `sizeup view` shows them.
const MAX_PAGE_BUILDINGS: usize = 20_000;

/// Files by name, with their hashes.
type Hashed = BTreeMap<String, String>;

/// Rule for tiles that are not done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Missing {
    /// Without all of them nothing is merged.
    Refuse,
    /// Merge of what there is, and names of the rest.
    Allow,
}

/// How a city is merged.
#[derive(Debug, Clone, PartialEq)]
pub struct MergeOptions {
    /// Tiles that are not done.
    pub missing: Missing,
    /// Treatment of heights in 3D Tiles; `None`: what the plan says.
    pub tileset: Option<Tileset>,
    /// How much of what is known of files is believed.
    pub trust: Trust,
}

/// Result of the merge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Merged {
    /// Tiles of the plan.
    pub n_tiles: usize,
    /// Tiles that are not done.
    pub missing: Vec<String>,
    /// Buildings of the input, those without a footprint included.
    pub n_buildings: usize,
    /// Buildings by what became of them, one in parts as its worst part.
    pub by_status: BTreeMap<Status, usize>,
    /// Median height above ground, metres.
    pub median_height_m: Option<f64>,
    /// Issues that are refusals.
    pub n_refused: usize,
    /// Photos that the survey names and nobody could read.
    #[serde(default)]
    pub n_photos_missing: usize,
    /// How well neighbouring tiles agree.
    pub seams: SeamReport,
    /// Why there are no 3D Tiles, if so.
    pub no_tileset: Option<String>,
    /// Files by name, with their hashes.
    pub outputs: BTreeMap<String, String>,
    /// Photos under the map of its page, with their hashes.
    #[serde(default)]
    pub photos: BTreeMap<String, String>,
    /// Whether 3D Tiles were written, and what their heights are.
    pub tileset: Tileset,
    /// All that it was made from.
    pub made_by: Recipe,
}

impl Merged {
    /// Whether some items of the input have no result.
    #[must_use]
    pub fn has_failed_items(&self) -> bool {
        let count = |status| self.by_status.get(&status).copied().unwrap_or(0);
        let n_lacking = self.n_refused + self.n_photos_missing + count(Status::Unknown) + count(Status::Refused);
        !self.missing.is_empty() || n_lacking > 0
    }
}

/// Merges the tiles that are done. The same tiles give the same bytes; if nothing has changed since the last time,
/// nothing is done.
///
/// # Errors
/// [`TilesError`]: no plan, or one whose input has changed since; tiles that are missing, stale or failed; two tiles with
/// one building; files that cannot be written.
pub fn merge(layout: &Layout, options: &MergeOptions, wait: &dyn Fn(&str)) -> Result<Merged, TilesError> {
    let manifest = layout.read_manifest()?;
    let _lock = Lock::take(&layout.lock("city"), wait)?;
    sweep_litter(layout.folder());
    let names = ["plan", "city"].into_iter().chain(manifest.tiles.iter().map(|tile| tile.id.as_str()));
    let hashes = known(layout, options.trust, names);
    let check = StaleCheck::new(layout, &manifest, &hashes);
    if let Some(why) = check.plan() {
        return Err(TilesError::Stale { what: "the plan".to_owned(), why, hint: PLAN_AGAIN });
    }
    let (done, missing) = done_tiles(&check);
    if let (Some(first), Missing::Refuse) = (missing.first(), options.missing) {
        let (n_missing, n_tiles) = (missing.len(), done.len());
        let first = format!("{} ({})", first.0, first.1);
        return Err(TilesError::Missing { n_missing, n_tiles, first });
    }
    let tileset = options.tileset.unwrap_or(manifest.tileset);
    let made_by = check.merge(&done, tileset)?;
    if let Ok(merged) = read_json::<Merged>(&layout.merged())
        && check.why_not_merged(&made_by, &merged).is_none()
    {
        return Ok(merged);
    }
    // From here on its files are being replaced: the old word no longer holds.
    remove_if_there(&layout.merged())?;
    let unfinished = Unfinished::begin(layout.folder(), &format!("sizeup tiles merge {}", layout.folder().display()))?;
    let missing = missing.into_iter().map(|(id, _)| id).collect();
    let city = JoinedCity { layout, manifest: &manifest, done: done.iter().flatten().collect(), missing };
    let merged = city.write(tileset, made_by)?;
    unfinished.finish()?;
    write_json(&layout.merged(), &merged)?;
    Ok(merged)
}

/// The word of every tile that is done, in the plan's order, and the others with why they are not.
fn done_tiles(check: &StaleCheck<'_>) -> (Vec<Option<Done>>, Vec<(String, String)>) {
    use rayon::prelude::*;
    let of_tile = |tile: &super::Tile| {
        let status = check.status(tile);
        let done = check.layout.read_done(&tile.id).filter(|_| status.state == TileState::Done);
        let why = match (status.state, status.why) {
            (TileState::Waiting, None) => "it has not been run".to_owned(),
            (TileState::Running, _) => format!("it is being run by {}", status.runner.unwrap_or_default()),
            (state, why) => {
                let state = if state == TileState::Failed { "failed" } else { "stale" };
                format!("{state}: {}", why.unwrap_or_default().lines().next().unwrap_or_default())
            }
        };
        (tile.id.clone(), done, why)
    };
    let all: Vec<_> = check.manifest.tiles.par_iter().map(of_tile).collect();
    let missing =
        all.iter().filter(|(_, done, _)| done.is_none()).map(|(id, _, why)| (id.clone(), why.clone())).collect();
    (all.into_iter().map(|(_, done, _)| done).collect(), missing)
}

/// A city about to be written.
struct JoinedCity<'a> {
    layout: &'a Layout,
    manifest: &'a Manifest,
    done: Vec<&'a Done>,
    missing: Vec<String>,
}

impl JoinedCity<'_> {
    fn write(self, tileset: Tileset, made_by: Recipe) -> Result<Merged, TilesError> {
        let (config, folder) = (&self.manifest.config, self.layout.folder());
        let settings = RunSettings::of(config);
        let common: Common = read_json(&self.layout.common())?;
        let mut issues = self.issues(common.issues)?;
        let survey = Survey { views: common.views, issues: Vec::new() };
        let records = TileRecords { files: self.files(BUILDINGS), rest: refused_records(&settings, common.refused) };
        let (count, doubts, median_height_m) = count(&records)?;
        let implausible = doubts.implausible();
        let told: Vec<String> = implausible.iter().map(|issue| issue.message.clone()).collect();
        issues.extend(implausible);
        issues.extend(reviews_of(settings.reviews)?.unmatched(&records)?);
        issues.sort_by_key(Issue::weight);
        let lineage = self.lineage(&settings)?;
        let crs = &config.project.crs;
        let model = CityModel { records: &records, crs, lineage: &lineage, issues: &issues, survey: &survey };
        let overview = geopackage::write_divided(&folder.join(GEOPACKAGE), &model, &self.areas())?;
        write_project(&settings.output, folder, GEOPACKAGE, &model)?;
        cityjson::write_sequence(&folder.join(SEQUENCE), &model, &CityJsonConfig::default())?;
        let is_textured = |tile: &PathBuf| tile.join(SUMMARY).is_file();
        let painted: Vec<PathBuf> = self.files(textured::FOLDER).into_iter().filter(is_textured).collect();
        let painted = if painted.is_empty() { None } else { Some(TexturedCity::of_tiles(&painted)?) };
        let no_tileset = write_tileset(&folder.join(TILESET), &model, (tileset, painted.as_ref()))?;
        let photos = self.write_page(&settings.output, (&model, painted.as_ref()), count.n_buildings())?;
        write_issues(&folder.join("issues.json"), &issues)?;
        write_json(&folder.join("lineage.json"), &lineage)?;
        let seams = seams::compare(&records.files, &self.files(HALO))?;
        let by_status = count.by_status();
        let mut summary = RunSummary {
            implausible: told,
            priors_from: config.prior.in_words(),
            n_views: self.manifest.n_views,
            n_oblique: survey.views.iter().filter(|view| view.kind() == ViewKind::Oblique).count(),
            n_used_views: n_used_views(&records)?,
            n_buildings: count.n_buildings(),
            by_status: by_status.clone(),
            parts_by_status: count.parts.clone(),
            median_height_m,
            tiles: Some(TilesSummary {
                n_tiles: self.manifest.tiles.len(),
                missing_tiles: self.missing.clone(),
                n_parts: count.n_parts(),
                n_heights: overview.n_heights,
                seams: json!(seams),
            }),
            ..RunSummary::default()
        };
        summary.count_issues(&issues);
        summary.write(folder)?;
        Ok(Merged {
            n_tiles: self.manifest.tiles.len(),
            missing: self.missing,
            n_buildings: count.n_buildings(),
            by_status,
            median_height_m,
            n_refused: summary.n_refused,
            n_photos_missing: summary.n_photos_missing,
            seams,
            outputs: outputs(folder, no_tileset.is_none(), photos.is_some())?,
            photos: photos.unwrap_or_default(),
            no_tileset,
            tileset,
            made_by,
        })
    }

    /// Writes the page, unless there are too many buildings or none, or no page is wanted; returns the photos under its map.
    fn write_page(
        &self,
        settings: &OutputSettings<'_>,
        (model, painted): (&CityModel<'_, TileRecords>, Option<&TexturedCity>),
        n_buildings: usize,
    ) -> Result<Option<Hashed>, TilesError> {
        let folder = self.layout.folder();
        let mut records = Vec::new();
        if settings.config.report.page && n_buildings <= MAX_PAGE_BUILDINGS {
            model.records.visit(&mut |record| {
                records.push(record.clone());
                Ok(())
            })?;
        }
        if records.iter().all(|record| record.footprint.is_none()) {
            remove_if_there(&folder.join(PAGE))?;
            return Ok(None);
        }
        let CityModel { crs, lineage, issues, survey, .. } = *model;
        let model = CityModel { records: records.as_slice(), crs, lineage, issues, survey };
        let photos = write_city_report(settings, folder, &model, painted)?;
        // One on a server is not read a second time: as elsewhere, it is known by its name.
        let here = photos.iter().filter(|photo| !is_virtual(photo));
        let hash = |photo: &PathBuf| hash_of(photo).map(|sha256| (photo.display().to_string(), sha256));
        Ok(Some(here.map(hash).collect::<Result<_, FileError>>()?))
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
        // Photos show the ground of the city; without them each tile estimates its level by depth, and one issue is enough.
        let is_level = |issue: &Issue| ["terrain_too_high", "terrain_too_low"].contains(&&*issue.code);
        let ground = self.ground()?.issue();
        let mut n_kept = usize::from(ground.is_some());
        issues.retain(|issue| {
            n_kept += usize::from(is_level(issue));
            !is_level(issue) || n_kept == 1
        });
        issues.extend(unstated_reference(&self.manifest.config.project));
        issues.extend(ground);
        issues.extend(self.missing.iter().map(|id| {
            let message = "the tile is not done: its buildings are missing";
            Issue::new(Severity::Refused, "tile_missing", Subject::Input(id.clone()), message)
                .hint("run it with `sizeup tiles run`, and merge again")
        }));
        Ok(issues)
    }

    /// Terrain by the photos of all tiles.
    fn ground(&self) -> Result<PhotoGround, TilesError> {
        let of_tile = |done: &&Done| -> Result<_, TilesError> {
            let core = self.manifest.tile(&done.tile)?.core;
            Ok((core, read_json::<PhotoGround>(&self.layout.tile(&done.tile).join(GROUND))?))
        };
        let parts: Vec<(MapBox, PhotoGround)> = self.done.iter().map(of_tile).collect::<Result<_, _>>()?;
        Ok(PhotoGround::of_parts(parts))
    }

    /// The files that the plan was made from, and the priors of all tiles.
    fn lineage(&self, settings: &RunSettings<'_>) -> Result<Lineage, TilesError> {
        let mut inputs: BTreeSet<InputFile> = self.manifest.inputs.iter().cloned().collect();
        let mut last_day = None;
        for path in self.files(LINEAGE) {
            let of_tile: Lineage = read_json(&path)?;
            let parts = [PART_OF_FOOTPRINTS, PART_OF_TERRAIN, PART_OF_REVIEWS];
            let is_whole = |file: &InputFile| !parts.contains(&file.role.as_str());
            inputs.extend(of_tile.inputs.into_iter().filter(is_whole));
            last_day = last_day.max(of_tile.reference_date);
        }
        let lineage = settings.origin.lineage("sizeup tiles merge", inputs.into_iter().collect());
        Ok(lineage.of_day(|| last_day))
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

/// Writes 3D Tiles; where nobody says the vertical datum, the reason why not.
fn write_tileset(
    path: &Path,
    model: &CityModel<'_, TileRecords>,
    (tileset, painted): (Tileset, Option<&TexturedCity>),
) -> Result<Option<String>, TilesError> {
    let Tileset::Written(heights) = tileset else { return Ok(Some("none were asked for".to_owned())) };
    let config = Tiles3dConfig { heights, ..Tiles3dConfig::default() };
    match tiles3d::write_textured(path, model, &config, painted) {
        Ok(Overview { .. }) => Ok(None),
        Err(reason @ OutputError::HeightsNotStated { .. }) => Ok(Some(reason.to_string())),
        Err(source @ OutputError::Crs(_)) => Err(TilesError::Heights { source }),
        Err(error) => Err(error.into()),
    }
}

fn count(records: &TileRecords) -> Result<(StatusCount, CityDoubts, Option<f64>), TilesError> {
    let (mut count, mut doubts, mut heights) = (StatusCount::default(), CityDoubts::default(), Vec::new());
    records.visit(&mut |record| {
        count.add(record);
        doubts.add(record);
        heights.extend(record.height_m);
        Ok(())
    })?;
    Ok((count, doubts, stats::median(&heights)))
}

/// Distinct photos in which heights were measured.
fn n_used_views(records: &TileRecords) -> Result<usize, TilesError> {
    let mut used: BTreeSet<String> = BTreeSet::new();
    records.visit(&mut |record| {
        used.extend(record.views.iter().cloned());
        Ok(())
    })?;
    Ok(used.len())
}

/// Every file of the city, by its name in the folder.
fn outputs(folder: &Path, has_tileset: bool, has_page: bool) -> Result<BTreeMap<String, String>, TilesError> {
    let mut names: Vec<String> =
        [GEOPACKAGE, "city.qgs", "city.qgz", SEQUENCE, "issues.json", "lineage.json", "summary.json"]
            .map(str::to_owned)
            .to_vec();
    names.extend(has_page.then(|| PAGE.to_owned()));
    if has_tileset {
        names_below(folder, TILESET, &mut names).map_err(FileError::on("cannot read", &folder.join(TILESET)))?;
    }
    let hash = |name: String| hash_of(&folder.join(&name)).map(|sha256| (name, sha256));
    Ok(names.into_iter().map(hash).collect::<Result<_, FileError>>()?)
}

/// Adds the names of all files below a folder of a folder.
pub(super) fn names_below(folder: &Path, name: &str, names: &mut Vec<String>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder.join(name))? {
        let entry = entry?;
        let name = format!("{name}/{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            names_below(folder, &name, names)?;
        } else {
            names.push(name);
        }
    }
    Ok(())
}
