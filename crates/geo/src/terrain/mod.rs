//! Terrain of a project, read from a DTM into its CRS and vertical datum, and the ground level under each footprint.
//!
//! The surface itself is [`sizeup_heights::terrain`].

mod ground;
mod load;
mod reproject;
mod surface_model;
mod voids;

pub use ground::{GroundConfig, GroundReference, ground_under};
pub use load::{LoadedTerrain, TerrainConfig, TerrainError, height_unit_m, load, load_with_issues};
pub use reproject::MapBox;
pub use sizeup_heights::terrain::{Dem, DemError, GroundLevel, Terrain};
pub use surface_model::{SurfaceModel, surface_model};
