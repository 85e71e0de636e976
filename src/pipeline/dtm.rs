//! A terrain model from the photos: made by itself, or by a run with `[dtm]`, before its footprints.

use std::path::Path;

use geo::Centroid as _;
use geo_types::Polygon;
use glam::DVec3;

use super::checks::check_apart;
use super::checks::check_baseline;
use super::settings::{DtmSettings, SurveySettings};
use super::{Event, PhotoGround, PipelineError, Tell};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_json;
use sizeup_geo::geodata::{GridPlace, write_geotiff};
use sizeup_geo::terrain::{self, Terrain};
use sizeup_photos::dtm::{self, Dtm, DtmConfig};
use sizeup_results::output::picture::{relief_map, write_png};
use sizeup_survey::Survey;

/// Written where no ground was found.
const NODATA: f32 = -9999.0;

/// Makes the model around the configuration's footprints, and gives them too (none where they are yet to be found).
/// `progress` takes the squares done and their total.
///
/// # Errors
/// [`PipelineError`]: among others where the configuration has no rough level to start from.
pub fn dtm_of_photos(
    survey: &SurveySettings<'_>,
    place: &DtmSettings<'_>,
    settings: &DtmConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<(Dtm, Vec<Polygon<f64>>), PipelineError> {
    if (&place.terrain.dtm, place.terrain.constant_m) == (&None, None) {
        return Err(PipelineError::Settings {
            table: "terrain",
            message: "a terrain model from the photos starts from a rough level of the ground".to_owned(),
            hint: "set terrain.constant_m in the vertical reference of the poses, or terrain.dtm to a coarse model",
        });
    }
    let reading = super::survey::read(survey)?;
    Place::of(place, reading.survey(), settings)?.dtm(reading.survey(), settings, progress)
}

/// Footprints that a model is made around, and the ground that it starts from.
struct Place {
    footprints: Vec<Polygon<f64>>,
    rough: Terrain,
}

impl Place {
    fn of(place: &DtmSettings<'_>, survey: &Survey, settings: &DtmConfig) -> Result<Self, PipelineError> {
        let crs = place.places.crs;
        let footprints = match place.places.layer {
            Some(layer) => {
                let layer = sizeup_footprints::read(layer, crs)?;
                check_apart(&place.places, survey, &layer)?;
                layer.footprints.into_iter().map(|footprint| footprint.polygon).collect()
            }
            None => Vec::new(),
        };
        let polygons: Vec<&Polygon<f64>> = footprints.iter().collect();
        let area = dtm::area(&survey.views, &polygons, settings);
        let rough = terrain::load(place.terrain, crs, area)?;
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

/// Makes the terrain model of a run, and writes it where the later stages read it.
pub(super) fn for_run(settings: &DtmSettings<'_>, survey: &Survey, tell: Tell<'_>) -> Result<(), PipelineError> {
    let Some(model) = settings.model else { return Ok(()) };
    let (place, crs) = (Place::of(settings, survey, model)?, settings.places.crs);
    check_baseline(settings.depth, survey, &place.targets())?;
    let (dtm, footprints) = place.dtm(survey, model, &|done, total| tell(Event::Ground { done, total }))?;
    write_dtm(&dtm, crs, &settings.folder.dtm())?;
    let squares = PhotoGround::of(&dtm.squares, dtm.sigma_m, |at| dtm.dem.height_at(at.x, at.y));
    write_json(&settings.folder.dtm_squares(), &squares)?;
    if settings.draws_picture {
        let polygons: Vec<&Polygon<f64>> = footprints.iter().collect();
        let picture = relief_map(&dtm, &polygons, crs);
        write_png(&settings.folder.picture("dtm.png"), &picture)?;
    }
    Ok(())
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
