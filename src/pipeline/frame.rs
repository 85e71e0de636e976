//! What the parts of a city share, so that a building comes out the same in all of them.

use super::{PipelineError, input, photo_ground};
use sizeup_geo::terrain::MapBox;
use sizeup_heights::estimate::LocalFrame;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::scene::{HeightBounds, HeightsConfig};
use sizeup_survey::Survey;

/// The local frame and the heights that are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Origin of the local frame in the map.
    pub origin: LocalOrigin,
    /// The range of heights of every building.
    pub bounds: HeightBounds,
    /// Distance between the places where the photos are searched for ground, metres.
    pub ground_spacing_m: f64,
}

impl Frame {
    /// Frame of a whole city: its survey, the box around all its footprints, and its highest ground.
    ///
    /// # Errors
    /// [`PipelineError`] where the views do not look down at such ground, or the settings leave no range of heights.
    pub fn of_city(
        settings: &HeightsConfig,
        survey: &Survey,
        area: MapBox,
        highest_ground_m: f64,
    ) -> Result<Self, PipelineError> {
        let lowest_flight_m = input::clearance_m(survey, highest_ground_m)?;
        let bounds = input::height_bounds(settings, lowest_flight_m)?;
        Ok(Self { origin: origin(survey, area), bounds, ground_spacing_m: photo_ground::spacing_m(area) })
    }
}

/// Origin in the middle of the footprints, at the height of the lowest view: the ground need not be known.
pub(super) fn origin(survey: &Survey, area: MapBox) -> LocalOrigin {
    let corners = [area.west_m, area.south_m, area.east_m, area.north_m];
    LocalFrame::origin(survey.views.iter().map(|view| view.camera_from_map.centre()), corners)
}
