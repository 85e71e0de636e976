//! What the parts of a city share, so that a building comes out the same in all of them.

use glam::DVec3;

use super::{PipelineError, ground_told, input};
use crate::config::RunConfig;
use sizeup_geo::terrain::MapBox;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::scene::HeightBounds;
use sizeup_survey::Survey;

/// The local frame and the heights that are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Origin of the local frame in the map.
    pub origin: LocalOrigin,
    /// The range of heights of every building.
    pub bounds: HeightBounds,
    /// From one place where the ground is looked at in the photos to the next, metres.
    pub ground_spacing_m: f64,
}

impl Frame {
    /// Frame of a whole city: its survey, the box around all its footprints, and its highest ground.
    ///
    /// # Errors
    /// [`PipelineError`] where the views do not look down at such ground, or the settings leave no range of heights.
    pub fn of_city(
        config: &RunConfig,
        survey: &Survey,
        area: MapBox,
        highest_ground_m: f64,
    ) -> Result<Self, PipelineError> {
        let lowest_flight_m = input::clearance_m(survey, highest_ground_m)?;
        let bounds = input::height_bounds(config, lowest_flight_m)?;
        Ok(Self { origin: origin(survey, area), bounds, ground_spacing_m: ground_told::spacing_m(area) })
    }
}

/// The local frame lies on multiples of this, metres: a house more at the rim of a town leaves it where it is. Small enough
/// that single precision holds a tenth of a millimetre a kilometre away.
const ORIGIN_STEP_M: DVec3 = DVec3::new(1000.0, 1000.0, 100.0);

/// The middle of the footprints at the height of the lowest view, in round numbers: the ground need not be known.
pub(super) fn origin(survey: &Survey, area: MapBox) -> LocalOrigin {
    let lowest_m = survey.views.iter().map(|v| v.camera_from_map.centre().z).reduce(f64::min).unwrap_or(0.0);
    let middle = (f64::midpoint(area.west_m, area.east_m), f64::midpoint(area.south_m, area.north_m));
    LocalOrigin((DVec3::new(middle.0, middle.1, lowest_m) / ORIGIN_STEP_M).round() * ORIGIN_STEP_M)
}
