//! Heights by what they are counted from, so that one cannot pass for another.
//!
//! ```text
//! H = h − N      H orthometric (above the geoid or a national zero), h ellipsoidal (what satellites give), N geoid
//! ```
//!
//! `N` is between −107 m and +86 m: a drone's ellipsoidal heights taken as orthometric put a city 50 m off.

use serde::{Deserialize, Serialize};

/// Above the ellipsoid, metres.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct EllipsoidalHeight(pub f64);

/// Above a geoid or national zero (the project's vertical reference), metres.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct OrthometricHeight(pub f64);

/// Above the ground straight below, metres.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct HeightAboveGround(pub f64);

/// Above the place of take-off, metres.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct HeightAboveTakeoff(pub f64);

/// Height of the geoid (or national zero) above the ellipsoid, metres: `N`.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct GeoidHeight(pub f64);

impl EllipsoidalHeight {
    /// Height above the geoid, `H = h − N`, metres.
    #[must_use]
    pub fn above_geoid(self, geoid: GeoidHeight) -> OrthometricHeight {
        OrthometricHeight(self.0 - geoid.0)
    }
}

impl HeightAboveGround {
    /// With the ground's own height.
    #[must_use]
    pub fn over(self, ground: OrthometricHeight) -> OrthometricHeight {
        OrthometricHeight(ground.0 + self.0)
    }
}

impl HeightAboveTakeoff {
    /// With the take-off's own height.
    #[must_use]
    pub fn from_takeoff(self, takeoff: OrthometricHeight) -> OrthometricHeight {
        OrthometricHeight(takeoff.0 + self.0)
    }
}
