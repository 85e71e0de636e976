//! # sizeup: from a drone flight to a georeferenced LOD1 city
//!
//! Calibrated oblique photos, building footprints and depth priors go in at the top; a city model leaves at the
//! bottom. The method is that of "`SiZeUp`: Fast 3D Proxy from Aerial Images via Depth Ordinal Loss" (2026), called the
//! paper below, and a local search of our own over the same evidence.
//!
//! # The pipeline
//! [`pipeline`] runs four stages; each is a room, and a crate, of its own.
//!
//! 1. [`survey`]: photos and poses, in whatever format, into the project's CRS ([`crs`], [`camera`]).
//! 2. [`footprint`], [`terrain`]: building footprints, and the ground under each.
//! 3. [`optimise`]: one height per building. Views are chosen ([`views`]); their rays are traced once through the
//!    [`scene`] ([`render`]) and compared with the [`prior`] for any height ([`ordinal`] and the local search).
//! 4. [`output`]: `CityJSON`, `GeoPackage`, issues, lineage and pictures; [`report`]: the page that shows them.
//!
//! [`simulate`] makes input with known truth; [`evaluate`] compares a result with a truth. Baselines and benchmarks are in
//! `lab/`, with a binary of their own.
//!
//! A whole run from Rust:
//!
//! ```no_run
//! use sizeup::{config::RunConfig, pipeline};
//! let config = RunConfig::load("sizeup.toml".as_ref(), &[])?;
//! let city = pipeline::city(&config, &|_| {})?;
//! for building in &city.records {
//!     println!("{} {:?} {}", building.id, building.height_m, building.status.as_str());
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A configuration is built in code with [`config::RunConfig::new`]; `examples/run_configured_in_code.rs` does so.
//!
//! The method alone, without files, GDAL or networks, is the crate [`sizeup_heights`], whose front page has the frames
//! and the symbols of the paper.

pub use sizeup_footprints as footprint;
pub use sizeup_geo::{cloud, crs, files, geodata, hashes, issue, limits, paths, template, terrain, unfinished};
pub use sizeup_heights as heights;
pub use sizeup_heights::{camera, frames, ids, optimise, ordinal, raster, ray, render, scene, seed, stats, views};
pub use sizeup_photos::{dtm, onnx, prior, textures, vegetation};
pub use sizeup_results::{changes, output, report};
pub use sizeup_survey as survey;
pub use sizeup_truth::{evaluate, simulate};

pub mod cli;
pub mod config;
pub mod init;
pub mod pipeline;
pub mod recipe;
pub mod tiles;
