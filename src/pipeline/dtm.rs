//! A terrain model from the photos, made before a run that has none.

use geo_types::Polygon;

use super::{PipelineError, soundness};
use crate::config::RunConfig;
use crate::dtm::{self, Dtm, DtmConfig};
use crate::footprint::{self, FootprintSource};

/// Makes the model around the configuration's outlines, and gives them too (none where they are yet to be found).
/// `progress` is told how many squares of how many are done.
///
/// # Errors
/// [`PipelineError`]: among others where the configuration has no rough level to start from.
pub fn dtm_of_photos(
    config: &RunConfig,
    settings: &DtmConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<(Dtm, Vec<Polygon<f64>>), PipelineError> {
    let Some(near_m) = config.terrain.constant_m else {
        return Err(PipelineError::Settings {
            table: "terrain",
            message: "a terrain model from the photos starts from a rough level of the ground".to_owned(),
            hint: "set terrain.constant_m, in the vertical reference of the poses",
        });
    };
    let reading = soundness::read(config)?;
    let outlines = match &config.footprints {
        FootprintSource::Layer(layer) => footprint::read(layer, &config.project.crs)?.footprints,
        FootprintSource::Masks(_) | FootprintSource::Network(_) => Vec::new(),
    };
    let outlines: Vec<Polygon<f64>> = outlines.into_iter().map(|f| f.polygon).collect();
    let polygons: Vec<&Polygon<f64>> = outlines.iter().collect();
    let dtm = dtm::estimate(&reading.survey().views, &polygons, near_m, settings, progress)?;
    Ok((dtm, outlines))
}
