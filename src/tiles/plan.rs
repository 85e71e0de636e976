//! The plan: from all of the input, what each tile has to do.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use geo_types::Rect;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::frame::CityFrame;
use super::grid::{self, Core, Places};
use super::manifest::{Common, Layout, Manifest, Tile, TileViews, Tileset, read_json, sweep_litter};
use super::memory::{Counts, estimate_mb};
use super::run::{COST, Cost};
use super::stale::{Check, Trust, known, part_name};
use super::{Lock, TilesError, sight};
use crate::config::RunConfig;
use crate::pipeline::{
    self, Event, Frame, PartHashes, PipelineError, RunOptions, Stage, Tell, asks_photo, check_fallback, layer_of,
    outlines_around, photo_bytes,
};
use crate::recipe::Recipe;
use sizeup_footprints::{FootprintSource, LayerParts, RefusedFootprint};
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_geo::hashes::Hashes;
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::MapBox;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::optimise::Preset;
use sizeup_heights::scene::HeightBounds;
use sizeup_heights::stats;
use sizeup_photos::prior::PriorConfig;
use sizeup_results::output::reports::write_json;
use sizeup_results::output::{InputFile, OutputError, tiles3d};
use sizeup_survey::{Survey, View, ViewKind};

/// Width of the halo in breadths of the median oblique view: what a core's views show, and what hides and measures that.
const HALO_BREADTHS: f64 = 1.5;
/// The halo is a multiple of this, metres, so that a photo more does not change it.
const HALO_STEP_M: f64 = 50.0;
/// How far around a core views are taken in, as a share of the halo: buildings that far out are solved as in their own tile.
const VIEW_MARGIN_SHARE: f64 = 1.0 / 3.0;
/// Longest side of a tile that is accepted, metres.
const LARGEST_TILE_M: f64 = 100_000.0;
/// Buildings that all tiles solve, their halos included, for each building that there is, at most, where nobody says how
/// large tiles are to be and memory allows it.
const MOST_SOLVED: f64 = 1.5;
/// Memory of a tile at most where nobody says how large tiles are to be, megabytes: what a node of a cluster has for a core.
const DEFAULT_MEMORY_MB: u64 = 4000;

/// How a city is cut.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanSettings {
    /// Side of the tiles, metres.
    pub size_m: Option<f64>,
    /// Most buildings of a tile's core, where no size is given: squares are quartered until they hold few enough. Without
    /// either, tiles are as large as it takes to bound what their halos cost.
    pub n_buildings: Option<usize>,
    /// Width of the halo, metres; `None`: half as much again as a view shows at once.
    pub halo_m: Option<f64>,
    /// How far around a core views are taken in, metres; `None`: a third of the halo.
    pub view_margin_m: Option<f64>,
    /// Most memory that a tile may need, megabytes; tiles that need more are quartered.
    pub memory_mb: Option<u64>,
    /// Threads that a tile will run on.
    pub n_threads: usize,
    /// The file that the configuration comes from, which is then part of the input.
    pub config_file: Option<PathBuf>,
    /// What the merge is to make of heights.
    pub tileset: Tileset,
    /// How much of what is known of files is believed.
    pub trust: Trust,
}

impl PlanSettings {
    /// What decides how the city is cut.
    fn cut(&self) -> serde_json::Value {
        let Self { size_m, n_buildings, halo_m, view_margin_m, memory_mb, .. } = self;
        json!({
            "size_m": size_m, "buildings": n_buildings, "halo_m": halo_m, "view_margin_m": view_margin_m,
            "memory_mb": memory_mb,
        })
    }

    fn memory_limit_mb(&self) -> Option<u64> {
        let is_left_open = self.size_m.is_none() && self.n_buildings.is_none();
        self.memory_mb.or_else(|| is_left_open.then_some(DEFAULT_MEMORY_MB))
    }
}

/// A tile that would be run, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// The tile.
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
    pub changes: Vec<Change>,
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
    check(config, settings)?;
    let layout = Layout::new(&config.project.output);
    let _lock = Lock::take(&layout.lock("city"), &|_| {})?;
    sweep_litter(layout.folder());
    make(config, settings, &layout, command, tell)
}

/// What a plan would be, and which tiles would have to be run; the city's folder stays as it is.
///
/// # Errors
/// As [`plan`].
pub fn try_plan(
    config: &RunConfig,
    settings: &PlanSettings,
    command: &str,
    tell: Tell<'_>,
) -> Result<Planned, TilesError> {
    check(config, settings)?;
    let city = Layout::new(&config.project.output);
    let aside = tempfile::tempdir().map_err(FileError::on("cannot create", Path::new("a temporary folder")))?;
    let layout = Layout::new(aside.path());
    if let Some(frame) = read_json::<CityFrame>(&city.frame()).ok() {
        write_json(&layout.frame(), &frame)?;
    }
    // What is known of files need not be read again; without it, it is.
    let known_of_plan = layout.hashes("plan");
    if let (Some(folder), true) = (known_of_plan.parent(), settings.trust == Trust::Known) {
        std::fs::create_dir_all(folder).map_err(FileError::on("cannot create", folder))?;
        let _ = std::fs::copy(city.hashes("plan"), &known_of_plan);
    }
    let mut elsewhere = config.clone();
    elsewhere.project.output = aside.path().to_owned();
    let manifest = make(&elsewhere, settings, &layout, command, tell)?;
    let names = ["plan"].into_iter().chain(manifest.tiles.iter().map(|tile| tile.id.as_str()));
    let hashes = known(&city, settings.trust, names);
    // Views are those of the new plan, results those of the city.
    let check = Check { layout: &layout, manifest: &manifest, hashes: &hashes };
    let seconds = seconds_per_building(&city, &manifest);
    let of_tile = |tile: &Tile| -> Result<Option<Change>, TilesError> {
        let wanted = check.tile(tile)?;
        let why = match city.read_done(&tile.id) {
            None => Some("it has not been run".to_owned()),
            Some(done) => wanted.why_stale(&done.made_by).or_else(|| done.fault(&city, &hashes)),
        };
        let processor_seconds = seconds.map(|each| each * tile.n_solved as f64);
        Ok(why.map(|why| Change { tile: tile.clone(), why, processor_seconds }))
    };
    let changes: Vec<Option<Change>> = manifest.tiles.iter().map(of_tile).collect::<Result<_, _>>()?;
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
    let before = shared_inputs(config, settings, None, &hashes)?;
    let options = RunOptions { from: Stage::Survey, until: Stage::Survey, command: command.to_owned() };
    pipeline::run(config, &options, tell)?;
    tell(Event::Stage(Stage::Footprints));
    let found = pipeline::find_outlines(config, command, tell)?;
    let survey = pipeline::survey_of(config)?;
    let mut outlines = Outlines::read(config)?;
    if let Some(found) = found {
        (outlines.refused, outlines.issues) = (found.refused, found.issues);
    }
    let places = Places::new(&outlines.middles);
    let earlier = read_json::<CityFrame>(&layout.frame()).ok();
    let city = City::new(config, settings, &survey, &outlines, places, earlier)?;
    can_be_placed(config, settings.tileset, &city)?;
    let tiles = city.tiles(layout)?;
    let inputs = shared_inputs(config, settings, Some(&survey), &hashes)?;
    if let Some(changed) = before.iter().find(|file| !inputs.contains(file)) {
        let (what, why) =
            ("the plan".to_owned(), format!("{} {} changed while it was read", changed.role, changed.path));
        return Err(TilesError::Stale { what, why, hint: "plan again once nobody writes to it" });
    }
    let manifest = Manifest {
        made_by: recipe_of(config, settings, &inputs),
        origin_m: city.frame.origin.0.to_array(),
        heights_m: [city.frame.bounds.min_m, city.frame.bounds.max_m],
        halo_m: city.settled.halo_m,
        view_margin_m: city.settled.view_margin_m,
        config: config.clone(),
        tileset: settings.tileset,
        inputs,
        renamed: outlines.renamed,
        n_buildings: outlines.middles.len(),
        n_views: survey.views.len(),
        tiles,
    };
    write_json(&layout.frame(), &city.settled)?;
    let Survey { views, mut issues } = survey;
    issues.extend(outlines.issues);
    let paths: Vec<&Path> = manifest.inputs.iter().map(|file| Path::new(&file.path)).collect();
    hashes.save(&layout.hashes("plan"), paths.into_iter())?;
    write_json(&layout.common(), &Common { views, refused: outlines.refused, issues })?;
    write_json(&layout.manifest(), &manifest)?;
    Ok(manifest)
}

/// What a plan is made from: all settings but where results go, how it is cut, and the files that all tiles share.
fn recipe_of(config: &RunConfig, settings: &PlanSettings, inputs: &[InputFile]) -> Recipe {
    let mut config = config.clone();
    config.project.output = PathBuf::new();
    let mut recipe = Recipe::new(&json!({ "config": config, "cut": settings.cut(), "tileset": settings.tileset }));
    for file in inputs {
        recipe.add(part_name(&file.role, Path::new(&file.path)), &file.sha256);
    }
    recipe
}

/// Whether 3D Tiles can be written in the end, for which PROJ may lack a grid: better now than after all tiles.
fn can_be_placed(config: &RunConfig, tileset: Tileset, city: &City<'_>) -> Result<(), TilesError> {
    let (Tileset::Written(heights), Some(extent)) = (tileset, city.places.extent()) else { return Ok(()) };
    let ground_m = city.grounds.first().map_or(0.0, |ground| ground[0]);
    let middle = glam::DVec3::new(
        f64::midpoint(extent.west_m, extent.east_m),
        f64::midpoint(extent.south_m, extent.north_m),
        ground_m,
    );
    match tiles3d::check_place(&config.project.crs, heights, middle) {
        // Then there are none, which the merge says.
        Ok(()) | Err(OutputError::HeightsNotStated { .. }) => Ok(()),
        Err(source) => Err(TilesError::Heights { source }),
    }
}

fn check(config: &RunConfig, settings: &PlanSettings) -> Result<(), TilesError> {
    if config.optimise.preset == Preset::Paper {
        return Err(TilesError::PaperPreset);
    }
    if config.dtm.is_some() {
        return Err(TilesError::Pipeline(PipelineError::Settings {
            table: "dtm",
            message: "a terrain model made by the run is not made tile by tile".to_owned(),
            hint: "make it once with `sizeup dtm`, name it as terrain.dtm, and take [dtm] out",
        }));
    }
    if config.reviews.is_some() {
        return Err(TilesError::Pipeline(PipelineError::Settings {
            table: "reviews",
            message: "decisions about buildings are applied to runs of one piece, not to tiles".to_owned(),
            hint: "take [reviews] out, or run without --tiled",
        }));
    }
    layer_of(config)?;
    let refuse = |setting, found: String, expected| Err(TilesError::Setting { setting, found, expected });
    let is_within = |m: f64, low: f64| m.is_finite() && m >= low && m <= LARGEST_TILE_M;
    if let Some(size_m) = settings.size_m.filter(|&m| !is_within(m, 1.0)) {
        return refuse("--size", size_m.to_string(), "1 to 100000 metres");
    }
    if settings.n_buildings == Some(0) {
        return refuse("--buildings", "0".to_owned(), "1 or more");
    }
    let margins = [("--halo", settings.halo_m), ("--view-margin", settings.view_margin_m)];
    match margins.into_iter().find(|(_, m)| m.is_some_and(|m| !is_within(m, 0.0))) {
        Some((setting, m)) => refuse(setting, m.unwrap_or(0.0).to_string(), "0 to 100000 metres"),
        None => Ok(()),
    }
}

/// The layer, gone through once.
struct Outlines {
    middles: Vec<(f64, f64)>,
    extent: MapBox,
    renamed: BTreeMap<u64, String>,
    refused: Vec<RefusedFootprint>,
    issues: Vec<Issue>,
}

impl Outlines {
    fn read(config: &RunConfig) -> Result<Self, TilesError> {
        use geo::BoundingRect as _;
        let (mut middles, mut refused, mut issues) = (Vec::new(), Vec::new(), Vec::new());
        let mut extent: Option<MapBox> = None;
        // Holds as soon as one outline has what heights fall back on.
        let mut fallback = None;
        let renamed = LayerParts::open(&*layer_of(config)?, &config.project.crs)?.visit(&mut |found| {
            if !matches!(fallback, Some(Ok(()))) {
                fallback = Some(check_fallback(config, found.footprints.iter().map(|f| &f.attributes)));
            }
            for footprint in &found.footprints {
                middles.extend(footprint.middle());
                let corners = footprint.polygon.bounding_rect().map(|r: Rect<f64>| [r.min().x_y(), r.max().x_y()]);
                let known = extent.map(|e| [(e.west_m, e.south_m), (e.east_m, e.north_m)]);
                extent = MapBox::around(corners.into_iter().chain(known).flatten());
            }
            refused.extend(found.refused);
            issues.extend(found.issues);
        })?;
        let Some(extent) = extent else {
            return Err(TilesError::Pipeline(PipelineError::Mismatch {
                message: "none of the input's buildings has a usable outline".to_owned(),
                hint: "`sizeup run --until footprints` tells why, building by building",
            }));
        };
        // Of outlines found in photos the stage that found them has checked it.
        if matches!(config.footprints, FootprintSource::Layer(_)) {
            fallback.transpose()?;
        }
        Ok(Self { middles, extent, renamed, refused, issues })
    }
}

/// Everything that tiles are made from.
struct City<'a> {
    config: &'a RunConfig,
    settings: &'a PlanSettings,
    survey: &'a Survey,
    places: Places,
    cores: Vec<Core>,
    /// Lowest and highest ground of each core; of the city where a core has none.
    grounds: Vec<[f64; 2]>,
    renamed: BTreeMap<u64, String>,
    settled: CityFrame,
    frame: Frame,
    cell_m: Option<f64>,
    /// What each view's prior is made from.
    priors: Vec<Option<PathBuf>>,
}

impl<'a> City<'a> {
    fn new(
        config: &'a RunConfig,
        settings: &'a PlanSettings,
        survey: &'a Survey,
        outlines: &Outlines,
        places: Places,
        earlier: Option<CityFrame>,
    ) -> Result<Self, TilesError> {
        let renamed = outlines.renamed.clone();
        // The ground of the whole city, looked at in pieces of moderate size.
        let pieces = grid::even(&places, grid::step_of(PIECE_M));
        let Some(all) = range(&grounds_of(config, &pieces, &renamed)?) else {
            return Err(TilesError::Pipeline(PipelineError::Mismatch {
                message: format!("none of the {} footprints has a ground level", outlines.middles.len()),
                hint: "does the terrain cover the footprints, in the CRS it states?",
            }));
        };
        let settled = settle(config, settings, survey, outlines, &places, all)?.or_kept(earlier);
        let [min_m, max_m] = settled.heights_m;
        let frame = Frame { origin: LocalOrigin(settled.origin_m.into()), bounds: HeightBounds { min_m, max_m } };
        let cores = match (settings.size_m, settings.n_buildings) {
            (Some(size_m), _) => grid::even(&places, size_m),
            (None, Some(n_buildings)) => grid::by_count(&places, settled.side_m, n_buildings),
            (None, None) => grid::even(&places, settled.side_m),
        };
        let cell_m = config.terrain.dtm.as_ref().map(|path| cell_m(path).max(config.terrain.min_cell_m));
        let priors = config.prior.file_of_each(&survey.views).map_err(PipelineError::from)?;
        let grounds = Vec::new();
        let mut city =
            Self { config, settings, survey, places, cores, grounds, renamed, settled, frame, cell_m, priors };
        city.quarter_until_it_fits(all)?;
        let grounds = grounds_of(config, &city.cores, &city.renamed)?;
        city.grounds = grounds.into_iter().map(|ground| ground.unwrap_or(all)).collect();
        Ok(city)
    }

    /// Quarters tiles that need more memory than is allowed.
    fn quarter_until_it_fits(&mut self, all: [f64; 2]) -> Result<(), TilesError> {
        let Some(limit_mb) = self.settings.memory_limit_mb() else { return Ok(()) };
        let needs_mb = |core: &Core| self.memory_mb(core, self.views_of(core, all).len());
        let cores = grid::split_while(&self.places, self.cores.clone(), &|core| needs_mb(core) > limit_mb);
        if let Some((core, needs_mb)) =
            cores.iter().map(|core| (core, needs_mb(core))).find(|(_, needs_mb)| *needs_mb > limit_mb)
        {
            return Err(TilesError::TooLarge { id: core.id(), needs_mb, has_mb: limit_mb });
        }
        self.cores = cores;
        Ok(())
    }

    fn views_of(&self, core: &Core, ground_m: [f64; 2]) -> Vec<usize> {
        let area = core.area().grown(self.settled.view_margin_m);
        let tallest_m = f64::from(self.frame.bounds.max_m);
        // Stereo matches views of all kinds with each other, and roofs are settled by photos of all kinds; otherwise only
        // oblique ones have a say.
        let takes_part = |view: &View| {
            view.kind() == ViewKind::Oblique
                || matches!(*self.config.prior.chosen(), PriorConfig::Stereo(_))
                || asks_photo(self.config, view)
        };
        let views = self.survey.views.iter().enumerate();
        let seeing = views.filter(|(_, v)| takes_part(v) && sight::looks_at(v, &area, ground_m, tallest_m));
        seeing.map(|(i, _)| i).collect()
    }

    /// Megabytes that a tile with so many views needs at most.
    fn memory_mb(&self, core: &Core, n_views: usize) -> u64 {
        let halo = core.area().grown(self.settled.halo_m);
        let oblique: Vec<&View> = self.survey.views.iter().filter(|v| v.kind() == ViewKind::Oblique).collect();
        let tangents: Vec<f64> = oblique.iter().map(|v| v.off_nadir_rad().tan().min(MAX_SLOPE)).collect();
        let aspect = oblique.first().map_or(1.0, |v| f64::from(v.camera.width_px) / f64::from(v.camera.height_px));
        let counts = Counts {
            n_views,
            n_buildings: self.places.count(&halo),
            area_m2: (halo.east_m - halo.west_m) * (halo.north_m - halo.south_m),
            tallest_m: f64::from(self.frame.bounds.max_m),
            aspect: aspect.max(aspect.recip()),
            slope: stats::mean(&tangents).unwrap_or(1.0),
            cell_m: self.cell_m,
            n_threads: self.settings.n_threads,
            photo_bytes: if self.survey.views.iter().any(|view| asks_photo(self.config, view)) {
                photo_bytes(self.config, n_views)
            } else {
                0
            },
        };
        estimate_mb(&counts, &self.config.optimise)
    }

    fn tiles(&self, layout: &Layout) -> Result<Vec<Tile>, TilesError> {
        let cores = self.cores.par_iter().zip(&self.grounds);
        cores.map(|(core, ground_m)| self.tile(layout, core, *ground_m)).collect()
    }

    /// A tile of the plan; its views are written.
    fn tile(&self, layout: &Layout, core: &Core, ground_m: [f64; 2]) -> Result<Tile, TilesError> {
        let positions = self.views_of(core, ground_m);
        let views: Vec<View> = positions.iter().map(|&i| self.survey.views[i].clone()).collect();
        let (id, area, n_views) = (core.id(), core.area(), views.len());
        let priors = positions.iter().filter_map(|&i| self.priors[i].clone()).collect();
        let asked = views.iter().filter(|view| asks_photo(self.config, view));
        let photos = asked.filter_map(|view| view.image.clone()).collect();
        let positions = if self.config.prior.asks_for_positions() { positions } else { Vec::new() };
        let path = layout.views(&id);
        write_json(&path, &TileViews { views, positions, priors, photos })?;
        let views_sha256 = super::manifest::hash_of(&path)?;
        let halo = area.grown(self.settled.halo_m);
        let reads = PartHashes::of(self.config, &self.frame, &outlines_around(self.config, halo, &self.renamed)?)?;
        Ok(Tile {
            id,
            core: area,
            halo,
            n_buildings: self.places.count(&area),
            n_solved: self.places.count(&halo),
            n_views,
            memory_mb: self.memory_mb(core, n_views),
            views_sha256,
            reads,
        })
    }
}

/// Side of the pieces that the ground of a city is looked at in, metres.
const PIECE_M: f64 = 1000.0;

/// What a city would be settled to from nothing.
fn settle(
    config: &RunConfig,
    settings: &PlanSettings,
    survey: &Survey,
    outlines: &Outlines,
    places: &Places,
    ground_m: [f64; 2],
) -> Result<CityFrame, TilesError> {
    let Frame { origin, bounds } = Frame::of_city(config, survey, outlines.extent, ground_m[1])?;
    let halo_m = settings.halo_m.unwrap_or_else(|| {
        let halo_m = HALO_BREADTHS * breadth_m(survey, ground_m);
        (halo_m / HALO_STEP_M).ceil() * HALO_STEP_M
    });
    let side_m = match (settings.size_m, settings.n_buildings) {
        (Some(size_m), _) => size_m,
        (None, Some(_)) => grid::side_around(places),
        (None, None) => grid::side_bounded(places, halo_m, MOST_SOLVED),
    };
    Ok(CityFrame {
        asked: json!({ "cut": settings.cut(), "heights": config.heights, "crs": config.project.crs }),
        origin_m: origin.0.to_array(),
        heights_m: [bounds.min_m, bounds.max_m],
        halo_m,
        view_margin_m: settings.view_margin_m.unwrap_or_else(|| (VIEW_MARGIN_SHARE * halo_m).ceil()),
        side_m,
    })
}

/// Lowest and highest ground of some squares' buildings.
fn grounds_of(
    config: &RunConfig,
    cores: &[Core],
    renamed: &BTreeMap<u64, String>,
) -> Result<Vec<Option<[f64; 2]>>, TilesError> {
    cores.par_iter().map(|core| ground_of(config, core, renamed)).collect()
}

fn range(grounds: &[Option<[f64; 2]>]) -> Option<[f64; 2]> {
    grounds.iter().flatten().copied().reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// Rays flatter than this have nothing to meet, horizontal over vertical way.
const MAX_SLOPE: f64 = 3.0;

/// Lowest and highest ground of a core's buildings.
fn ground_of(config: &RunConfig, core: &Core, renamed: &BTreeMap<u64, String>) -> Result<Option<[f64; 2]>, TilesError> {
    if let Some(z_m) = config.terrain.constant_m.filter(|_| config.terrain.dtm.is_none()) {
        return Ok(Some([z_m, z_m]));
    }
    let levels = outlines_around(config, core.area(), renamed)?.ground;
    let levels = levels.into_iter().flatten().map(|level| level.reference_m);
    Ok(levels.fold(None, |range: Option<[f64; 2]>, z| range.map_or(Some([z, z]), |[a, b]| Some([a.min(z), b.max(z)]))))
}

/// Cell of a terrain model in metres; that of one in degrees counts as small.
fn cell_m(path: &Path) -> f64 {
    let grid = RasterFile::open(path).and_then(|file| file.grid());
    grid.map_or(0.0, |grid| grid.cell_x.min(grid.cell_y))
}

/// How far a typical oblique view shows at once, whole metres.
fn breadth_m(survey: &Survey, [lowest_m, highest_m]: [f64; 2]) -> f64 {
    let middle_m = f64::midpoint(lowest_m, highest_m);
    let oblique = survey.views.iter().filter(|v| v.kind() == ViewKind::Oblique);
    let breadths: Vec<f64> = oblique.map(|view| sight::breadth_m(view, middle_m)).collect();
    stats::median(&breadths).unwrap_or(0.0).ceil()
}

/// The files that all tiles share; outlines that are found in photos of a survey come from as many files.
fn shared_inputs(
    config: &RunConfig,
    settings: &PlanSettings,
    survey: Option<&Survey>,
    hashes: &Hashes,
) -> Result<Vec<InputFile>, TilesError> {
    let none = Survey::default();
    let own = settings.config_file.iter().map(|path| ("config", path.clone()));
    let poses = pipeline::files_of(&config.survey.path).into_iter().map(|path| ("survey", path));
    let outlines = pipeline::outline_files(config, survey.unwrap_or(&none)).into_iter();
    let terrain = config.terrain.dtm.iter().map(|path| ("terrain", path.clone()));
    let all = own.chain(poses).chain(outlines.map(|path| ("footprints", path))).chain(terrain);
    let mut files: Vec<(&str, PathBuf)> = all.filter(|(_, path)| path.is_file()).collect();
    files.sort();
    files.dedup();
    let hashed = files.iter().map(|(role, path)| {
        let content = hashes.of(path).map_err(FileError::on("cannot read", path))?;
        Ok(InputFile::holding(role, path, content))
    });
    hashed.collect()
}

/// What the plan of a configuration reads, file by file, without reading the poses: what an engine has to look at to know
/// whether to plan again. Masks of photos are known to the plan alone.
///
/// # Errors
/// [`TilesError::File`] for a file that cannot be read.
pub fn inputs(config: &RunConfig, settings: &PlanSettings) -> Result<Vec<InputFile>, TilesError> {
    let layout = Layout::new(&config.project.output);
    let hashes = known(&layout, settings.trust, std::iter::once("plan"));
    shared_inputs(config, settings, None, &hashes)
}
