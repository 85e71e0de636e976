//! Kinds of views by their tilt: footprints come from nadir views, heights from oblique ones.

use serde::{Deserialize, Serialize};

/// Off-nadir angle, degrees, up to which a view counts as nadir (`SiZeUp`, "Data preparation").
pub const NADIR_WITHIN_DEG: f64 = 15.0;

/// Purpose of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewKind {
    /// Looks straight down, within [`NADIR_WITHIN_DEG`]: footprints come from here.
    Nadir,
    /// Looks down at an angle: heights come from here.
    Oblique,
    /// Looks at or above the horizon: of no use.
    Upward,
}

impl ViewKind {
    /// Kind by the angle between the optical axis and the downward vertical, radians.
    #[must_use]
    pub fn of(off_nadir_rad: f64) -> Self {
        let off_nadir_deg = off_nadir_rad.to_degrees();
        if off_nadir_deg <= NADIR_WITHIN_DEG {
            Self::Nadir
        } else if off_nadir_deg < 90.0 {
            Self::Oblique
        } else {
            Self::Upward
        }
    }

    /// Kind of the views that heights are measured in: oblique ones, or nadir ones in a flight without any.
    #[must_use]
    pub fn for_heights(mut of_flight: impl Iterator<Item = Self>) -> Self {
        if of_flight.any(|kind| kind == Self::Oblique) { Self::Oblique } else { Self::Nadir }
    }
}
