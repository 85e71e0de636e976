//! The plan: from all of the input, what each tile has to do.

mod city;
mod layer;
mod settings;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

pub use self::settings::PlanSettings;

use self::city::PlannedCity;
use self::layer::CityFootprints;
use self::settings::check;
use super::frame::CityFrame;
use super::grid::Places;
use super::manifest::{Common, Layout, Manifest, Tile, Tileset, read_json, sweep_litter};
use super::run::{COST, Cost};
use super::stale::{StaleCheck, Trust, known, part_name};
use super::{Lock, TilesError};
use crate::config::RunConfig;
use crate::pipeline::{self, Event, RunOptions, RunSettings, Stage, Tell};
use crate::recipe::Recipe;
use sizeup_geo::crs::Crs;
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::source;
use sizeup_geo::hashes::Hashes;
use sizeup_results::output::reports::write_json;
use sizeup_results::output::{InputFile, OutputError, tiles3d};
use sizeup_survey::Survey;

/// A tile that would be run, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TileChange {
    /// Tile of the plan.
    pub tile: Tile,
    /// Why it is not done.
    pub why: String,
    /// Processor time that it takes by what others took, seconds; `None` where none has been run yet.
    pub processor_seconds: Option<f64>,
}

/// A plan, and what there would be to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Planned {
    /// Tiles of the plan.
    pub n_tiles: usize,
    /// Those that would be run.
    pub changes: Vec<TileChange>,
}

/// Makes the plan and writes it into the configuration's output folder. The same input gives the same bytes; tiles that
/// are done stay done where nothing that they are made from has changed.
///
/// # Errors
/// [`TilesError`]: settings, or input that cannot be used as a whole.
pub fn plan(
    config: &RunConfig,
    settings: &PlanSettings,
    command: &str,
    tell: Tell<'_>,
) -> Result<Manifest, TilesError> {
    check(&RunSettings::of(config), settings)?;
    let layout = Layout::new(&config.project.output);
    let _lock = Lock::take(&layout.lock("city"), &|_| {})?;
    sweep_litter(layout.folder());
    make(config, settings, &layout, command, tell)
}

/// Plan as it would be, and which tiles would have to be run; the city's folder stays as it is.
///
/// # Errors
/// As [`plan`].
pub fn try_plan(
    config: &RunConfig,
    settings: &PlanSettings,
    command: &str,
    tell: Tell<'_>,
) -> Result<Planned, TilesError> {
    check(&RunSettings::of(config), settings)?;
    let city = Layout::new(&config.project.output);
    let aside = tempfile::tempdir().map_err(FileError::on("cannot create", Path::new("a temporary folder")))?;
    let layout = Layout::new(aside.path());
    if let Ok(frame) = read_json::<CityFrame>(&city.frame()) {
        write_json(&layout.frame(), &frame)?;
    }
    // What is known of files need not be read again; without it, it is.
    let known_of_plan = layout.hashes("plan");
    if let (Some(folder), true) = (known_of_plan.parent(), settings.trust == Trust::Known) {
        std::fs::create_dir_all(folder).map_err(FileError::on("cannot create", folder))?;
        let _ = std::fs::copy(city.hashes("plan"), &known_of_plan);
    }
    let mut elsewhere = config.clone();
    aside.path().clone_into(&mut elsewhere.project.output);
    let manifest = make(&elsewhere, settings, &layout, command, tell)?;
    let names = ["plan"].into_iter().chain(manifest.tiles.iter().map(|tile| tile.id.as_str()));
    let hashes = known(&city, settings.trust, names);
    // Views are those of the new plan, results those of the city.
    let check = StaleCheck::new(&layout, &manifest, &hashes);
    let seconds = seconds_per_building(&city, &manifest);
    let of_tile = |tile: &Tile| -> Result<Option<TileChange>, TilesError> {
        let wanted = check.tile(tile)?;
        let why = match city.read_done(&tile.id) {
            None => Some("it has not been run".to_owned()),
            Some(done) => wanted.why_stale(&done.made_by).or_else(|| done.fault(&city, &hashes)),
        };
        let processor_seconds = seconds.map(|each| each * tile.n_solved as f64);
        Ok(why.map(|why| TileChange { tile: tile.clone(), why, processor_seconds }))
    };
    let changes: Vec<Option<TileChange>> = manifest.tiles.iter().map(of_tile).collect::<Result<_, _>>()?;
    Ok(Planned { n_tiles: manifest.tiles.len(), changes: changes.into_iter().flatten().collect() })
}

/// Processor time of the tiles that have been run for each building that they solved, seconds.
fn seconds_per_building(city: &Layout, manifest: &Manifest) -> Option<f64> {
    let costs: Vec<Cost> =
        manifest.tiles.iter().filter_map(|tile| read_json(&city.tile(&tile.id).join(COST)).ok()).collect();
    let n_solved: usize = costs.iter().map(|cost| cost.n_solved).sum();
    let seconds: f64 = costs.iter().map(|cost| cost.processor_seconds.unwrap_or(cost.seconds)).sum();
    (n_solved > 0).then(|| seconds / n_solved as f64)
}

fn make(
    config: &RunConfig,
    settings: &PlanSettings,
    layout: &Layout,
    command: &str,
    tell: Tell<'_>,
) -> Result<Manifest, TilesError> {
    let hashes = known(layout, settings.trust, std::iter::once("plan"));
    let run = RunSettings::of(config);
    let before = shared_inputs(&run, settings, None, &hashes)?;
    let options = RunOptions { from: Stage::Survey, until: Stage::Survey, command: command.to_owned() };
    pipeline::run(config, &options, tell)?;
    tell(Event::Stage(Stage::Footprints));
    let found = pipeline::find_footprints(&run, command, tell)?;
    let survey = run.survey()?;
    let mut footprints = CityFootprints::read(&run.footprints, run.records.fallback)?;
    if let Some(found) = found {
        (footprints.refused, footprints.issues) = (found.refused, found.issues);
    }
    pipeline::check_city(&run.heights.scene, &survey, footprints.extent, &footprints.middles)?;
    let places = Places::new(&footprints.middles);
    let earlier = read_json::<CityFrame>(&layout.frame()).ok();
    let city = PlannedCity::new(&run, settings, &survey, &footprints, places, earlier)?;
    can_be_placed(&config.project.crs, settings.tileset, &city)?;
    let tiles = city.tiles(layout)?;
    let inputs = shared_inputs(&run, settings, Some(&survey), &hashes)?;
    if let Some(changed) = before.iter().find(|file| !inputs.contains(file)) {
        let (what, why) =
            ("the plan".to_owned(), format!("{} {} changed while it was read", changed.role, changed.path));
        return Err(TilesError::Stale { what, why, hint: "plan again once nobody writes to it" });
    }
    let mut as_recipe = config.clone();
    as_recipe.project.output = PathBuf::new();
    let manifest = Manifest {
        made_by: recipe_of(&json!(as_recipe), settings, &inputs),
        origin_m: city.frame.origin.0.to_array(),
        heights_m: [city.frame.bounds.min_m, city.frame.bounds.max_m],
        ground_spacing_m: city.settled.ground_spacing_m,
        halo_m: city.settled.halo_m,
        view_margin_m: city.settled.view_margin_m,
        config: config.clone(),
        tileset: settings.tileset,
        inputs,
        prior_files: config.prior.shared_files(),
        renamed: footprints.renamed,
        n_buildings: footprints.middles.len(),
        n_views: survey.views.len(),
        tiles,
    };
    write_json(&layout.frame(), &city.settled)?;
    let Survey { views, mut issues } = survey;
    issues.extend(footprints.issues);
    let paths: Vec<&Path> = manifest.inputs.iter().map(|file| Path::new(&file.path)).collect();
    hashes.save(&layout.hashes("plan"), paths.into_iter())?;
    write_json(&layout.common(), &Common { views, refused: footprints.refused, issues })?;
    write_json(&layout.manifest(), &manifest)?;
    Ok(manifest)
}

/// Recipe of a plan: all settings but where results go, how it is cut, and the files that all tiles share.
fn recipe_of(config: &Value, settings: &PlanSettings, inputs: &[InputFile]) -> Recipe {
    let mut recipe = Recipe::new(&json!({ "config": config, "cut": settings.cut(), "tileset": settings.tileset }));
    for file in inputs {
        recipe.add(part_name(&file.role, Path::new(&file.path)), &file.sha256);
    }
    recipe
}

/// Whether 3D Tiles can be written in the end, for which PROJ may lack a grid: better now than after all tiles.
fn can_be_placed(crs: &Crs, tileset: Tileset, city: &PlannedCity<'_>) -> Result<(), TilesError> {
    let (Tileset::Written(heights), Some(extent)) = (tileset, city.places.extent()) else { return Ok(()) };
    let ground_m = city.grounds.first().map_or(0.0, |ground| ground[0]);
    let middle = glam::DVec3::new(
        f64::midpoint(extent.west_m, extent.east_m),
        f64::midpoint(extent.south_m, extent.north_m),
        ground_m,
    );
    match tiles3d::check_place(crs, heights, middle) {
        // Then there are none, which the merge says.
        Ok(()) | Err(OutputError::HeightsNotStated { .. }) => Ok(()),
        Err(source) => Err(TilesError::Heights { source }),
    }
}

/// The files that all tiles share; footprints that are found in photos of a survey come from as many files.
fn shared_inputs(
    run: &RunSettings<'_>,
    settings: &PlanSettings,
    survey: Option<&Survey>,
    hashes: &Hashes,
) -> Result<Vec<InputFile>, TilesError> {
    let none = Survey::default();
    let own = settings.config_file.iter().map(|path| ("config", path.clone()));
    let poses = pipeline::files_of(&run.survey.config.path).into_iter().map(|path| ("survey", path));
    let footprints = pipeline::footprint_files(run.footprints.source, survey.unwrap_or(&none));
    let footprints = footprints.iter().flat_map(|path| source::files_of(path)).map(|path| ("footprints", path));
    let terrain = run.survey.terrain.dtm.iter().flat_map(|path| source::files_of(path)).map(|path| ("terrain", path));
    let reviews = run.reviews.iter().flat_map(|reviews| source::files_of(&reviews.path));
    let reviews = reviews.map(|path| ("reviews", path));
    let all = own.chain(poses).chain(footprints).chain(terrain).chain(reviews);
    let mut files: Vec<(&str, PathBuf)> = all.filter(|(_, path)| path.is_file()).collect();
    files.sort();
    files.dedup();
    let hashed = files.iter().map(|(role, path)| {
        let content = hashes.of(path).map_err(FileError::on("cannot read", path))?;
        Ok(InputFile::holding(role, path, content))
    });
    hashed.collect()
}

/// Inputs of a configuration's plan, file by file, without reading the poses: files that an engine checks to decide
/// whether to plan again. Masks of photos are known to the plan alone.
///
/// # Errors
/// [`TilesError::File`] for a file that cannot be read.
pub fn inputs(run: &RunSettings<'_>, settings: &PlanSettings) -> Result<Vec<InputFile>, TilesError> {
    let layout = Layout::new(run.output.folder.path());
    let hashes = known(&layout, settings.trust, std::iter::once("plan"));
    shared_inputs(run, settings, None, &hashes)
}
