//! Geospatial base of sizeup: where things are, and the files they come from.
//!
//! The only doors to PROJ ([`crs`]) and GDAL ([`geodata`]); the terrain in the project's CRS and vertical datum
//! ([`terrain`]); point clouds ([`cloud`]); files that are written whole or not at all ([`files`]); what is wrong with a
//! single photo or building ([`issue`]).

pub mod cloud;
pub mod crs;
pub mod files;
mod gdal_log;
pub mod geodata;
pub mod groups;
pub mod hashes;
pub mod issue;
pub mod kept;
pub mod limits;
pub mod lock;
pub mod paths;
pub mod template;
pub mod terrain;
pub mod triangles;
pub mod unfinished;
pub mod units;
