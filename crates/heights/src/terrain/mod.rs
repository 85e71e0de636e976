//! The ground: a terrain model or a constant, in the project's map frame and vertical datum.
//!
//! Heights are metres in the project's vertical datum; where the terrain has no value the answer is `None`, never
//! a guess.

mod dem;
mod intersect;

pub use dem::{Dem, DemError};

use serde::{Deserialize, Serialize};

/// Ground under one building, metres in the project's vertical reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GroundLevel {
    /// The level heights count from.
    pub reference_m: f64,
    /// The lowest ground: walls go down to here.
    pub lowest_m: f64,
    /// The lowest and the highest ground along the outline; `None` where it is not known there.
    pub outline_m: Option<[f64; 2]>,
}

impl GroundLevel {
    /// Level ground at this height, metres.
    #[must_use]
    pub fn flat(z_m: f64) -> Self {
        Self { reference_m: z_m, lowest_m: z_m, outline_m: Some([z_m, z_m]) }
    }

    /// The same ground so much higher, metres.
    #[must_use]
    pub fn raised(self, by_m: f64) -> Self {
        Self {
            reference_m: self.reference_m + by_m,
            lowest_m: self.lowest_m + by_m,
            outline_m: self.outline_m.map(|ends| ends.map(|z_m| z_m + by_m)),
        }
    }
}

/// The ground surface of a project.
#[derive(Debug, Clone, PartialEq)]
pub enum Terrain {
    /// One height everywhere, metres.
    Constant(f64),
    /// A regular grid, bilinear between cell centres.
    Grid(Dem),
}

impl Terrain {
    /// Ground height at a map position, metres; `None` outside the grid or at nodata.
    #[must_use]
    pub fn height_at(&self, easting_m: f64, northing_m: f64) -> Option<f64> {
        match self {
            Self::Constant(z_m) => Some(*z_m),
            Self::Grid(dem) => dem.height_at(easting_m, northing_m),
        }
    }

    /// Lowest and highest ground, metres; there always is one.
    #[must_use]
    pub fn range(&self) -> Option<(f64, f64)> {
        match self {
            Self::Constant(z_m) => Some((*z_m, *z_m)),
            Self::Grid(dem) => Some(dem.range()),
        }
    }
}
