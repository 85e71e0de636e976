//! A terrain model from the photos: made by itself, or before the footprints of a run that asks for it.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use geo::Centroid as _;
use geo_types::Polygon;
use glam::DVec3;

use super::apart::check_apart;
use super::input::check_baseline;
use super::{Event, GroundTold, PipelineError, Tell, soundness};
use crate::config::RunConfig;
use sizeup_footprints::FootprintSource;
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_json;
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_geo::geodata::{GridPlace, write_geotiff};
use sizeup_geo::terrain::{self, Terrain, TerrainConfig};
use sizeup_photos::dtm::{self, Dtm, DtmConfig};
use sizeup_results::output::geopackage::{self, ProjectGround};
use sizeup_results::output::picture::{relief_map, write_png};
use sizeup_results::output::{CityModel, OutputError, Records};
use sizeup_survey::Survey;

/// Written where no ground was found.
const NODATA: f32 = -9999.0;

/// Makes the model around the configuration's footprints, and gives them too (none where they are yet to be found).
/// `progress` is told how many squares of how many are done.
///
/// # Errors
/// [`PipelineError`]: among others where the configuration has no rough level to start from.
pub fn dtm_of_photos(
    config: &RunConfig,
    settings: &DtmConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<(Dtm, Vec<Polygon<f64>>), PipelineError> {
    if (&config.terrain.dtm, config.terrain.constant_m) == (&None, None) {
        return Err(PipelineError::Settings {
            table: "terrain",
            message: "a terrain model from the photos starts from a rough level of the ground".to_owned(),
            hint: "set terrain.constant_m in the vertical reference of the poses, or terrain.dtm to a coarse model",
        });
    }
    let reading = soundness::read(config)?;
    Place::of(config, reading.survey(), settings)?.dtm(reading.survey(), settings, progress)
}

/// Footprints that a model is made around, and the ground that it starts from.
struct Place {
    footprints: Vec<Polygon<f64>>,
    rough: Terrain,
}

impl Place {
    fn of(config: &RunConfig, survey: &Survey, settings: &DtmConfig) -> Result<Self, PipelineError> {
        let footprints = match &config.footprints {
            FootprintSource::Layer(layer) => {
                let layer = sizeup_footprints::read(layer, &config.project.crs)?;
                check_apart(config, survey, &layer)?;
                layer.footprints.into_iter().map(|footprint| footprint.polygon).collect()
            }
            FootprintSource::Masks(_) | FootprintSource::Network(_) => Vec::new(),
        };
        let polygons: Vec<&Polygon<f64>> = footprints.iter().collect();
        let area = dtm::area(&survey.views, &polygons, settings);
        let rough = terrain::load(&config.terrain, &config.project.crs, area)?;
        Ok(Self { footprints, rough })
    }

    fn dtm(
        self,
        survey: &Survey,
        settings: &DtmConfig,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<(Dtm, Vec<Polygon<f64>>), PipelineError> {
        let polygons: Vec<&Polygon<f64>> = self.footprints.iter().collect();
        let dtm = dtm::estimate(&survey.views, &polygons, &self.rough, settings, progress)?;
        Ok((dtm, self.footprints))
    }

    /// Middles of the footprints on the rough ground.
    fn targets(&self) -> Vec<DVec3> {
        let target = |polygon: &Polygon<f64>| {
            let middle = polygon.centroid()?;
            Some(DVec3::new(middle.x(), middle.y(), self.rough.height_at(middle.x(), middle.y())?))
        };
        self.footprints.iter().filter_map(target).collect()
    }
}

/// Makes the model that a run asks for, and writes it where [`terrain_in_force`] looks for it.
pub(super) fn for_run(config: &RunConfig, survey: &Survey, tell: Tell<'_>) -> Result<(), PipelineError> {
    let Some(settings) = &config.dtm else { return Ok(()) };
    let place = Place::of(config, survey, settings)?;
    check_baseline(config, survey, &place.targets())?;
    let (dtm, footprints) = place.dtm(survey, settings, &|done, total| tell(Event::Ground { done, total }))?;
    write_dtm(&dtm, &config.project.crs, &path_of(config))?;
    let squares = GroundTold::of(&dtm.squares, dtm.sigma_m, |at| dtm.dem.height_at(at.x, at.y));
    write_json(&squares_path_of(config), &squares)?;
    if config.output.pictures {
        let polygons: Vec<&Polygon<f64>> = footprints.iter().collect();
        let picture = relief_map(&dtm, &polygons, &config.project.crs);
        write_png(&config.project.output.join("pictures").join("dtm.png"), &picture)?;
    }
    Ok(())
}

/// Squares of open ground that the model of a run was made from, against it; none where they are not kept.
pub(super) fn squares_of_run(config: &RunConfig) -> GroundTold {
    let file = std::fs::read(squares_path_of(config));
    file.ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
}

fn squares_path_of(config: &RunConfig) -> PathBuf {
    config.project.output.join("stages").join("dtm_squares.json")
}

/// Writes a model (`GeoTIFF`), in the vertical reference of the poses.
///
/// # Errors
/// [`PipelineError`] where it cannot be written.
pub fn write_dtm(dtm: &Dtm, crs: &Crs, path: &Path) -> Result<(), PipelineError> {
    let place = GridPlace { corner_m: dtm.dem.corner_m(), cell_m: dtm.dem.cell_m(), crs, nodata: NODATA };
    write_geotiff(path, dtm.dem.heights_m(), &place)?;
    Ok(())
}

fn path_of(config: &RunConfig) -> PathBuf {
    config.project.output.join("stages").join("dtm.tif")
}

/// Writes the QGIS project of a result into its folder, beside its `GeoPackage`, standing on the run's terrain.
///
/// # Errors
/// [`OutputError`].
pub fn write_project<R: Records + ?Sized>(
    config: &RunConfig,
    folder: &Path,
    geopackage: &str,
    model: &CityModel<'_, R>,
) -> Result<(), OutputError> {
    let terrain = terrain_in_force(config);
    let own = terrain.dtm.as_ref().and_then(|path| RasterFile::open(path).ok()?.crs().ok()?);
    let own = own.or_else(|| terrain.crs.clone());
    let path = terrain.dtm.as_ref().map(|path| match path.strip_prefix(folder) {
        Ok(made) => made.to_owned(),
        Err(_) => config.saved_path(path),
    });
    let ground = match (&path, terrain.constant_m) {
        (Some(path), _) => ProjectGround::Model {
            path,
            crs: own.as_ref(),
            // A run has read it, so that its unit is known.
            unit_m: sizeup_geo::terrain::height_unit_m(&terrain).unwrap_or(1.0),
            offset_m: terrain.vertical_offset_m.unwrap_or(0.0),
        },
        (None, Some(level_m)) => ProjectGround::Level(level_m),
        (None, None) => ProjectGround::LowestWall,
    };
    geopackage::write_project(&folder.join("city.qgs"), geopackage, model, &config.output.geopackage, ground)
}

/// Where the ground of a run is: as configured, or in the model that it makes from the photos.
pub(super) fn terrain_in_force(config: &RunConfig) -> Cow<'_, TerrainConfig> {
    if config.dtm.is_none() {
        return Cow::Borrowed(&config.terrain);
    }
    let TerrainConfig { margin_m, min_cell_m, .. } = config.terrain;
    Cow::Owned(TerrainConfig { margin_m, min_cell_m, ..TerrainConfig::dtm(path_of(config)) })
}
