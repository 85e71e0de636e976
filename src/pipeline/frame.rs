//! What the parts of a city share, so that a building comes out the same in all of them.

use glam::DVec3;

use super::{PipelineError, input};
use crate::config::RunConfig;
use sizeup_geo::terrain::MapBox;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::scene::HeightBounds;
use sizeup_survey::Survey;

/// The local frame and the heights that are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Where the local frame lies in the map.
    pub origin: LocalOrigin,
    /// The range of heights of every building.
    pub bounds: HeightBounds,
}

impl Frame {
    /// Of a whole city: its survey, the box around all its outlines, and its highest ground.
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
        let bounds = if config.heights.max_m.is_none() { in_round_numbers(bounds) } else { bounds };
        Ok(Self { origin: origin(survey, area), bounds })
    }
}

/// A greatest height that comes from the flight is a multiple of this, metres, so that a house more on higher ground, or a
/// photo more, leaves it where it is; and where it is low.
const GREATEST_STEP_M: f32 = 5.0;
const LOW_GREATEST_STEP_M: f32 = 1.0;
/// Greatest heights from here on are not low, metres.
const LOW_GREATEST_M: f32 = 25.0;

/// A range that ends at a round number, not beyond where it would have ended.
fn in_round_numbers(bounds: HeightBounds) -> HeightBounds {
    let step_m = if bounds.max_m < LOW_GREATEST_M { LOW_GREATEST_STEP_M } else { GREATEST_STEP_M };
    let max_m = (bounds.max_m / step_m).floor() * step_m;
    // A range of less than a step has no such end.
    if max_m > bounds.min_m { HeightBounds { max_m, ..bounds } } else { bounds }
}

/// The local frame lies on multiples of this, metres: a house more at the rim of a town leaves it where it is. Small enough
/// that single precision holds a tenth of a millimetre a kilometre away.
const ORIGIN_STEP_M: DVec3 = DVec3::new(1000.0, 1000.0, 100.0);

/// The middle of the outlines at the height of the lowest view, in round numbers: the ground need not be known.
pub(super) fn origin(survey: &Survey, area: MapBox) -> LocalOrigin {
    let lowest_m = survey.views.iter().map(|v| v.camera_from_map.centre().z).reduce(f64::min).unwrap_or(0.0);
    let middle = (f64::midpoint(area.west_m, area.east_m), f64::midpoint(area.south_m, area.north_m));
    LocalOrigin((DVec3::new(middle.0, middle.1, lowest_m) / ORIGIN_STEP_M).round() * ORIGIN_STEP_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_from_the_flight_ends_at_a_round_number_below() {
        let end = |max_m: f32| in_round_numbers(HeightBounds { min_m: 2.0, max_m }).max_m;
        assert_eq!([117.85, 117.63, 150.0, 25.0, 24.9, 2.5].map(end), [115.0, 115.0, 150.0, 25.0, 24.0, 2.5]);
    }
}
