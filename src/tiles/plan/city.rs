//! Everything that tiles are made from, and what each of them has to do.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::json;

use super::PlanSettings;
use super::layer::{CityFootprints, grounds_of, range};
use crate::pipeline::{Frame, PartHashes, PipelineError, RunSettings, footprints_around, reviews_of};
use crate::tiles::frame::CityFrame;
use crate::tiles::grid::{self, Core, Places};
use crate::tiles::manifest::{self, Layout, Tile, TileViews};
use crate::tiles::memory::{TileCounts, estimate_mb};
use crate::tiles::{TilesError, sight};
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::scene::HeightBounds;
use sizeup_heights::stats;
use sizeup_photos::prior::PriorConfig;
use sizeup_results::output::reports::write_json;
use sizeup_results::output::reviews::Reviews;
use sizeup_survey::{Survey, View};

/// Width of the halo in breadths of the median oblique view: as far as the views that are taken in show anything.
const HALO_BREADTHS: f64 = 2.0;
/// The halo is a multiple of this, metres, so that a photo more does not change it.
const HALO_STEP_M: f64 = 50.0;
/// How far around a core views are taken in, as a share of the halo: buildings that far out are solved as in their own tile.
/// With 1.5 breadths and a third of them, 8 of 20,551 heights differed from those in one piece by over 0.1 m; with this, none does.
const VIEW_MARGIN_SHARE: f64 = 0.45;
/// Buildings that all tiles solve, their halos included, for each building that there is, at most, where nobody says how
/// large tiles are to be and memory allows it.
const MOST_SOLVED: f64 = 1.5;
/// Side of the pieces that the ground of a city is read in, metres.
const PIECE_M: f64 = 1000.0;
/// Rays flatter than this have nothing to meet, horizontal over vertical way.
const MAX_SLOPE: f64 = 3.0;

/// Everything that tiles are made from.
pub(super) struct PlannedCity<'a> {
    run: &'a RunSettings<'a>,
    settings: &'a PlanSettings,
    survey: &'a Survey,
    pub places: Places,
    cores: Vec<Core>,
    /// Lowest and highest ground of each core; of the city where a core has none.
    pub grounds: Vec<[f64; 2]>,
    renamed: BTreeMap<u64, String>,
    pub settled: CityFrame,
    pub frame: Frame,
    cell_m: Option<f64>,
    /// Files that each view's prior is made from.
    priors: Vec<Option<PathBuf>>,
    /// Decisions of people about single buildings.
    reviews: Reviews,
}

impl<'a> PlannedCity<'a> {
    /// Settles the frame of a city and cuts it; `earlier` is what was settled for it before.
    ///
    /// # Errors
    /// [`TilesError`]: no ground under any footprint, tiles that need more memory than there is, input that cannot be read.
    pub(super) fn new(
        run: &'a RunSettings<'a>,
        settings: &'a PlanSettings,
        survey: &'a Survey,
        footprints: &CityFootprints,
        places: Places,
        earlier: Option<CityFrame>,
    ) -> Result<Self, TilesError> {
        let renamed = footprints.renamed.clone();
        // The ground of the whole city, read in pieces of moderate size.
        let pieces = grid::even(&places, grid::step_of(PIECE_M));
        let Some(all) = range(&grounds_of(&run.footprints, &pieces, &renamed)?) else {
            return Err(TilesError::Pipeline(PipelineError::Mismatch {
                message: format!("none of the {} footprints has a ground level", footprints.middles.len()),
                hint: "does the terrain cover the footprints, in the CRS it states?",
            }));
        };
        let settled = settle(run, settings, survey, footprints, &places, all)?.or_kept(earlier);
        let [min_m, max_m] = settled.heights_m;
        let (origin, bounds) = (LocalOrigin(settled.origin_m.into()), HeightBounds { min_m, max_m });
        let frame = Frame { origin, bounds, ground_spacing_m: settled.ground_spacing_m };
        let cores = match (settings.size_m, settings.n_buildings) {
            (Some(size_m), _) => grid::even(&places, size_m),
            (None, Some(n_buildings)) => grid::by_count(&places, settled.side_m, n_buildings),
            (None, None) => grid::even(&places, settled.side_m),
        };
        let terrain = &run.footprints.ground.terrain;
        let cell_m = terrain.dtm.as_ref().map(|path| cell_m(path).max(terrain.min_cell_m));
        let priors = run.heights.prior.file_of_each(&survey.views).map_err(PipelineError::from)?;
        let (grounds, reviews) = (Vec::new(), reviews_of(run.reviews)?);
        let mut city =
            Self { run, settings, survey, places, cores, grounds, renamed, settled, frame, cell_m, priors, reviews };
        city.quarter_until_it_fits(all)?;
        let grounds = grounds_of(&run.footprints, &city.cores, &city.renamed)?;
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
        // Stereo matches views of all kinds, and roofs and ground are measured in photos of all kinds; otherwise only oblique
        // ones are used.
        let kind = self.survey.kind_for_heights();
        let takes_part = |view: &View| {
            view.kind() == kind
                || matches!(*self.run.heights.prior.chosen(), PriorConfig::Stereo(_))
                || self.run.heights.reads_photo(view)
        };
        let views = self.survey.views.iter().enumerate();
        let seeing = views.filter(|(_, v)| takes_part(v) && sight::looks_at(v, &area, ground_m, tallest_m));
        seeing.map(|(i, _)| i).collect()
    }

    /// Megabytes that a tile with so many views needs at most.
    fn memory_mb(&self, core: &Core, n_views: usize) -> u64 {
        let halo = core.area().grown(self.settled.halo_m);
        let measuring: Vec<&View> = self.survey.views_for_heights().collect();
        let tangents: Vec<f64> = measuring.iter().map(|v| v.off_nadir_rad().tan().min(MAX_SLOPE)).collect();
        let aspect = measuring.first().map_or(1.0, |v| f64::from(v.camera.width_px) / f64::from(v.camera.height_px));
        let counts = TileCounts {
            n_views,
            n_buildings: self.places.count(&halo),
            area_m2: (halo.east_m - halo.west_m) * (halo.north_m - halo.south_m),
            tallest_m: f64::from(self.frame.bounds.max_m),
            aspect: aspect.max(aspect.recip()),
            slope: stats::mean(&tangents).unwrap_or(1.0),
            cell_m: self.cell_m,
            n_threads: self.settings.n_threads,
            photo_bytes: if self.survey.views.iter().any(|view| self.run.heights.reads_photo(view)) {
                self.run.heights.photo_bytes(n_views)
            } else {
                0
            },
        };
        estimate_mb(&counts, &self.run.heights.method.optimise)
    }

    /// The tiles of the plan; their views are written.
    ///
    /// # Errors
    /// [`TilesError`] where footprints or terrain cannot be read, or files not be written.
    pub(super) fn tiles(&self, layout: &Layout) -> Result<Vec<Tile>, TilesError> {
        let cores = self.cores.par_iter().zip(&self.grounds);
        cores.map(|(core, ground_m)| self.tile(layout, core, *ground_m)).collect()
    }

    /// A tile of the plan; its views are written.
    fn tile(&self, layout: &Layout, core: &Core, ground_m: [f64; 2]) -> Result<Tile, TilesError> {
        let positions = self.views_of(core, ground_m);
        let views: Vec<View> = positions.iter().map(|&i| self.survey.views[i].clone()).collect();
        let (id, area, n_views) = (core.id(), core.area(), views.len());
        let priors = positions.iter().filter_map(|&i| self.priors[i].clone()).collect();
        let read = views.iter().filter(|view| self.run.heights.reads_photo(view));
        let photos = read.filter_map(|view| view.image.clone()).collect();
        let positions = if self.run.heights.prior.asks_for_positions() { positions } else { Vec::new() };
        let path = layout.views(&id);
        write_json(&path, &TileViews { views, positions, priors, photos })?;
        let views_sha256 = manifest::hash_of(&path)?;
        let halo = area.grown(self.settled.halo_m);
        let footprints = footprints_around(&self.run.footprints, halo, &self.renamed)?;
        let reads = PartHashes::of(&self.run.footprints.ground, &self.frame, &footprints, &self.reviews)?;
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

/// Frame that a city would be settled to from nothing.
fn settle(
    run: &RunSettings<'_>,
    settings: &PlanSettings,
    survey: &Survey,
    footprints: &CityFootprints,
    places: &Places,
    ground_m: [f64; 2],
) -> Result<CityFrame, TilesError> {
    let heights = run.heights.scene.heights;
    let Frame { origin, bounds, ground_spacing_m } = Frame::of_city(heights, survey, footprints.extent, ground_m[1])?;
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
        asked: json!({ "cut": settings.cut(), "heights": heights, "crs": run.survey.crs }),
        origin_m: origin.0.to_array(),
        heights_m: [bounds.min_m, bounds.max_m],
        halo_m,
        view_margin_m: settings.view_margin_m.unwrap_or_else(|| (VIEW_MARGIN_SHARE * halo_m).ceil()),
        side_m,
        ground_spacing_m,
    })
}

/// Cell of a terrain model in metres; that of one in degrees counts as small.
fn cell_m(path: &Path) -> f64 {
    let grid = RasterFile::open(path).and_then(|file| file.grid());
    grid.map_or(0.0, |grid| grid.cell_x.min(grid.cell_y))
}

/// How far a typical oblique view shows at once, whole metres.
fn breadth_m(survey: &Survey, [lowest_m, highest_m]: [f64; 2]) -> f64 {
    let middle_m = f64::midpoint(lowest_m, highest_m);
    let breadths: Vec<f64> = survey.views_for_heights().map(|view| sight::breadth_m(view, middle_m)).collect();
    stats::median(&breadths).unwrap_or(0.0).ceil()
}
