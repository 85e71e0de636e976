//! Scenes of real buildings, under a simulated flight or under real cameras.

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_geo::crs::Crs;
use sizeup_survey::{SurveyConfig, SurveyError, View, ViewKind};
use sizeup_truth::simulate::{CityJsonTown, ErrorConfig};

/// Buildings from a file in place of a procedural town.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RealTown {
    /// Name in tables and files.
    pub name: String,
    /// The buildings: which part of which file.
    pub cityjson: CityJsonTown,
    /// The cameras; absent: a simulated flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cameras: Option<RealCameras>,
    /// Errors of poses and footprints as the methods get them; absent: none, both are as their files have them.
    #[serde(default)]
    pub errors: ErrorConfig,
}

/// Cameras of a real survey, of which those that look at one place are taken.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RealCameras {
    /// Settings that read the survey.
    pub survey: SurveyConfig,
    /// Coordinate reference system, as `EPSG:n`.
    pub crs: String,
    /// The place, easting and northing, metres; at ground level 0.
    pub at_m: [f64; 2],
}

/// Quarters of heading that cameras are taken from in equal numbers.
const N_QUARTERS: usize = 4;

impl RealCameras {
    /// The `n` oblique views whose axes meet the ground `z = 0` nearest to the place, as many from each quarter of heading.
    ///
    /// # Errors
    /// [`SurveyError`] for cameras that cannot be read.
    pub fn views(&self, n: usize) -> Result<Vec<View>, SurveyError> {
        let views = sizeup_survey::read(&self.survey, &Crs::parse(&self.crs)?)?.views;
        let place = DVec2::from_array(self.at_m);
        let distance = |view: &View| {
            let (centre, axis) = (view.camera_from_map.centre(), view.axis_in_map());
            (centre + axis * (-centre.z / axis.z)).truncate().distance(place)
        };
        let quarter = |view: &View| {
            let axis = view.axis_in_map();
            2 * usize::from(axis.x > 0.0) + usize::from(axis.y > 0.0)
        };
        let mut by_quarter: [Vec<View>; N_QUARTERS] = Default::default();
        views.into_iter().filter(|v| v.kind() == ViewKind::Oblique).for_each(|v| by_quarter[quarter(&v)].push(v));
        for quarter in &mut by_quarter {
            quarter.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            quarter.truncate(n.div_ceil(N_QUARTERS));
        }
        Ok(by_quarter.into_iter().flatten().take(n).collect())
    }
}
