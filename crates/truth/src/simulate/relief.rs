//! Hilly ground: a few long waves with random directions and phases, sampled as a DTM.
//!
//! ```text
//! z(x, y) = base + relief · Σ a_i · sin(k_i · p + φ_i),   Σ |a_i| = 1/2
//! ```
//!
//! Waves are 250 to 900 m long, so that the grid's bilinear surface is within millimetres of its triangles.

use glam::DVec2;

use sizeup_geo::terrain::{Dem, Terrain};
use sizeup_heights::raster::Raster;
use sizeup_heights::seed;

use super::SimulateError;
use super::chance::between;
use super::config::SimulatedTerrain;

/// Number of waves that are summed for rolling ground.
const N_WAVES: usize = 5;
/// Shortest and longest wave, metres.
const WAVELENGTH_M: (f64, f64) = (250.0, 900.0);

/// A rectangle on the map: west, south, east, north; metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapRect {
    /// Easting of the western edge, metres.
    pub west_m: f64,
    /// Northing of the southern edge, metres.
    pub south_m: f64,
    /// Easting of the eastern edge, metres.
    pub east_m: f64,
    /// Northing of the northern edge, metres.
    pub north_m: f64,
}

impl MapRect {
    /// The rectangle around a centre that reaches so far east-west and north-south, metres.
    #[must_use]
    pub fn around(centre: DVec2, half_x_m: f64, half_y_m: f64) -> Self {
        Self {
            west_m: centre.x - half_x_m,
            south_m: centre.y - half_y_m,
            east_m: centre.x + half_x_m,
            north_m: centre.y + half_y_m,
        }
    }

    /// Larger by `by` on every side.
    #[must_use]
    pub fn grown(self, by: f64) -> Self {
        Self {
            west_m: self.west_m - by,
            south_m: self.south_m - by,
            east_m: self.east_m + by,
            north_m: self.north_m + by,
        }
    }

    /// Smallest extent around points; `None` without points.
    pub fn of(points: impl IntoIterator<Item = DVec2>) -> Option<Self> {
        points.into_iter().fold(None, |extent, p| {
            let e = extent.unwrap_or(Self::around(p, 0.0, 0.0));
            Some(Self {
                west_m: e.west_m.min(p.x),
                south_m: e.south_m.min(p.y),
                east_m: e.east_m.max(p.x),
                north_m: e.north_m.max(p.y),
            })
        })
    }

    /// Middle of the rectangle, easting and northing, metres.
    #[must_use]
    pub fn centre(&self) -> DVec2 {
        DVec2::new(0.5 * (self.west_m + self.east_m), 0.5 * (self.south_m + self.north_m))
    }

    /// Width and height, metres.
    #[must_use]
    pub fn size(&self) -> DVec2 {
        DVec2::new(self.east_m - self.west_m, self.north_m - self.south_m)
    }

    /// Whether a position lies in it.
    #[must_use]
    pub fn contains(&self, p: DVec2) -> bool {
        p.x >= self.west_m && p.x <= self.east_m && p.y >= self.south_m && p.y <= self.north_m
    }
}

/// A DTM of random hills over an extent.
///
/// # Errors
/// [`SimulateError::Dem`] for an extent without area.
pub(super) fn hills(config: &SimulatedTerrain, extent: &MapRect, root_seed: u64) -> Result<Terrain, SimulateError> {
    let mut rng = seed::stream(root_seed, "hills", &[]);
    let waves: Vec<(f64, DVec2, f64)> = (0..N_WAVES)
        .map(|_| {
            let length = between(&mut rng, WAVELENGTH_M.0, WAVELENGTH_M.1);
            let direction = DVec2::from_angle(between(&mut rng, 0.0, std::f64::consts::TAU));
            (length, direction * (std::f64::consts::TAU / length), between(&mut rng, 0.0, std::f64::consts::TAU))
        })
        .collect();
    let total: f64 = waves.iter().map(|w| w.0).sum();
    let height = |p: DVec2| {
        let sum: f64 = waves.iter().map(|(length, k, phase)| length * (k.dot(p) + phase).sin()).sum();
        config.base_z_m + 0.5 * config.relief_m * sum / total
    };
    grid(extent, config.cell_m, height)
}

/// A DTM from a function of the map position.
///
/// # Errors
/// [`SimulateError::Dem`] for an extent without area.
pub(super) fn grid(extent: &MapRect, cell_m: f64, z: impl Fn(DVec2) -> f64) -> Result<Terrain, SimulateError> {
    // Whole cells on a grid of round coordinates, as mapping agencies cut their tiles.
    let west = (extent.west_m / cell_m).floor() * cell_m;
    let north = (extent.north_m / cell_m).ceil() * cell_m;
    let width = ((extent.east_m - west) / cell_m).ceil() as usize;
    let height = ((north - extent.south_m) / cell_m).ceil() as usize;
    // Phases count from the middle, so that the hills do not depend on the size of the coordinates.
    let centre = extent.centre();
    let heights = Raster::filled(width, height, ());
    let mut cells = Vec::with_capacity(heights.data().len());
    for row in 0..height {
        for col in 0..width {
            let p = DVec2::new(west + (col as f64 + 0.5) * cell_m, north - (row as f64 + 0.5) * cell_m);
            cells.push(z(p - centre) as f32);
        }
    }
    let raster = Raster::from_vec(width, height, cells).expect("one value per cell");
    Ok(Terrain::Grid(Dem::new(raster, west, north, cell_m, cell_m)?))
}
