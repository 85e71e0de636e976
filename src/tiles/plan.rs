//! The plan: from all of the input, what each tile has to do.

use std::collections::BTreeMap;
use std::path::Path;

use geo_types::Rect;
use rayon::prelude::*;

use super::grid::{self, Core, Places};
use super::manifest::{Common, Layout, Manifest, Tile, TileViews, sweep_litter};
use super::memory::{Counts, estimate_mb};
use super::{Lock, TilesError, sight};
use crate::config::RunConfig;
use crate::footprint::{FootprintSource, LayerParts, RefusedFootprint};
use crate::geodata::raster::RasterFile;
use crate::issue::Issue;
use crate::optimise::Preset;
use crate::output::reports::write_json;
use crate::output::{InputFile, sha256_hex};
use crate::pipeline::{
    self, Event, Frame, PipelineError, RunOptions, Stage, Tell, asks_photo, check_fallback, layer_of, outlines_around,
    photo_bytes,
};
use crate::prior::PriorConfig;
use crate::stats;
use crate::survey::{Survey, View, ViewKind};
use crate::terrain::MapBox;

/// Width of the halo in breadths of the median oblique view: what a core's views show, and what hides and measures that.
const HALO_BREADTHS: f64 = 1.5;
/// How far around a core views are taken in, as a share of the halo: buildings that far out are solved as in their own tile.
const VIEW_MARGIN_SHARE: f64 = 1.0 / 3.0;
/// Longest side of a tile that is accepted, metres.
const LARGEST_TILE_M: f64 = 100_000.0;

/// How a city is cut.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanSettings {
    /// Side of the tiles, metres; `None`: squares are quartered until they hold few enough buildings.
    pub size_m: Option<f64>,
    /// Most buildings of a tile's core, where no size is given.
    pub n_buildings: usize,
    /// Width of the halo, metres; `None`: half as much again as a view shows at once.
    pub halo_m: Option<f64>,
    /// How far around a core views are taken in, metres; `None`: a third of the halo.
    pub view_margin_m: Option<f64>,
    /// Most memory that a tile may need, megabytes; tiles that need more are quartered.
    pub memory_mb: Option<u64>,
    /// Threads that a tile will run on.
    pub n_threads: usize,
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
    let city = City::new(config, settings, &survey, &outlines, places)?;
    let tiles = city.tiles(&layout)?;
    let manifest = Manifest {
        sizeup: env!("CARGO_PKG_VERSION").to_owned(),
        origin_m: city.frame.origin.0.to_array(),
        heights_m: [city.frame.bounds.min_m, city.frame.bounds.max_m],
        halo_m: city.halo_m,
        view_margin_m: city.view_margin_m,
        config: config.clone(),
        inputs: shared_inputs(config, &survey)?,
        renamed: outlines.renamed,
        n_buildings: outlines.middles.len(),
        n_views: survey.views.len(),
        tiles,
    };
    let Survey { views, mut issues } = survey;
    issues.extend(outlines.issues);
    write_json(&layout.common(), &Common { views, refused: outlines.refused, issues })?;
    write_json(&layout.manifest(), &manifest)?;
    Ok(manifest)
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
    layer_of(config)?;
    let refuse = |setting, found: String, expected| Err(TilesError::Setting { setting, found, expected });
    let is_within = |m: f64, low: f64| m.is_finite() && m >= low && m <= LARGEST_TILE_M;
    if let Some(size_m) = settings.size_m.filter(|&m| !is_within(m, 1.0)) {
        return refuse("--size", size_m.to_string(), "1 to 100000 metres");
    }
    if settings.n_buildings == 0 {
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
    frame: Frame,
    halo_m: f64,
    view_margin_m: f64,
    cell_m: Option<f64>,
}

impl<'a> City<'a> {
    fn new(
        config: &'a RunConfig,
        settings: &'a PlanSettings,
        survey: &'a Survey,
        outlines: &Outlines,
        places: Places,
    ) -> Result<Self, TilesError> {
        let cores = match settings.size_m {
            Some(size_m) => grid::even(&places, size_m),
            None => grid::by_count(&places, settings.n_buildings),
        };
        let renamed = outlines.renamed.clone();
        let known: Vec<Option<[f64; 2]>> =
            cores.par_iter().map(|core| ground_of(config, core, &renamed)).collect::<Result<_, _>>()?;
        let all = known.iter().flatten().copied().reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        let Some(all) = all else {
            return Err(TilesError::Pipeline(PipelineError::Mismatch {
                message: format!("none of the {} footprints has a ground level", outlines.middles.len()),
                hint: "does the terrain cover the footprints, in the CRS it states?",
            }));
        };
        let frame = Frame::of_city(config, survey, outlines.extent, all[1])?;
        let halo_m = settings.halo_m.unwrap_or_else(|| (HALO_BREADTHS * breadth_m(survey, all)).ceil());
        let view_margin_m = settings.view_margin_m.unwrap_or((VIEW_MARGIN_SHARE * halo_m).ceil());
        let cell_m = config.terrain.dtm.as_ref().map(|path| cell_m(path).max(config.terrain.min_cell_m));
        let grounds = known.into_iter().map(|ground| ground.unwrap_or(all)).collect();
        let mut city =
            Self { config, settings, survey, places, cores, grounds, renamed, frame, halo_m, view_margin_m, cell_m };
        city.quarter_until_it_fits()?;
        Ok(city)
    }

    /// Quarters tiles that need more memory than is allowed.
    fn quarter_until_it_fits(&mut self) -> Result<(), TilesError> {
        let Some(limit_mb) = self.settings.memory_mb else { return Ok(()) };
        let (lowest, highest) = (self.grounds.iter().map(|g| g[0]), self.grounds.iter().map(|g| g[1]));
        let all = [lowest.fold(f64::INFINITY, f64::min), highest.fold(f64::NEG_INFINITY, f64::max)];
        let is_too_large = |core: &Core| self.memory_mb(core, self.views_of(core, all).len()) > limit_mb;
        let cores = grid::split_while(&self.places, self.cores.clone(), &is_too_large);
        let grounds: Vec<Option<[f64; 2]>> =
            cores.par_iter().map(|core| ground_of(self.config, core, &self.renamed)).collect::<Result<_, _>>()?;
        self.grounds = grounds.into_iter().map(|ground| ground.unwrap_or(all)).collect();
        self.cores = cores;
        let needs = self.cores.iter().map(|core| (core, self.memory_mb(core, self.views_of(core, all).len())));
        match needs.into_iter().find(|(_, needs_mb)| *needs_mb > limit_mb) {
            Some((core, needs_mb)) => Err(TilesError::TooLarge { id: core.id(), needs_mb, has_mb: limit_mb }),
            None => Ok(()),
        }
    }

    fn views_of(&self, core: &Core, ground_m: [f64; 2]) -> Vec<usize> {
        let area = core.area().grown(self.view_margin_m);
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
        let halo = core.area().grown(self.halo_m);
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
        let of_tile = TileViews { views, positions };
        let path = layout.views(&id);
        write_json(&path, &of_tile)?;
        let views_sha256 = super::manifest::hash_of(&path)?;
        let halo = area.grown(self.halo_m);
        Ok(Tile {
            id,
            core: area,
            halo,
            n_buildings: self.places.count(&area),
            n_solved: self.places.count(&halo),
            n_views,
            memory_mb: self.memory_mb(core, n_views),
            views_sha256,
        })
    }
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

/// The files that all tiles share, hashed once.
fn shared_inputs(config: &RunConfig, survey: &Survey) -> Result<Vec<InputFile>, TilesError> {
    let poses = pipeline::files_of(&config.survey.path).into_iter().map(|path| ("survey", path));
    let outlines = pipeline::outline_files(config, survey).into_iter().map(|path| ("footprints", path));
    let terrain = config.terrain.dtm.iter().map(|path| ("terrain", path.clone()));
    let mut files: Vec<_> = poses.chain(outlines).chain(terrain).filter(|(_, path)| path.is_file()).collect();
    files.sort();
    files.iter().map(|(role, path)| Ok(InputFile::hash(role, path)?)).collect()
}

/// Hash of a configuration, which decides with all else whether a tile is done. Where results go is not part of it.
pub(super) fn settings_sha256(config: &RunConfig) -> String {
    let mut config = config.clone();
    config.project.output = std::path::PathBuf::new();
    sha256_hex(config.to_toml().as_bytes())
}
