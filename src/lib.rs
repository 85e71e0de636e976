//! # sizeup: from a drone flight to a georeferenced LOD1 city
//!
//! Calibrated oblique photos, building footprints and depth priors go in at the top; a city model leaves at the
//! bottom. The modules are listed in the order in which the data flows.
//!
//! Frames and units: see [`frames`]. Depth is z-depth (along the optical axis) unless a name says `ray_t`.

pub mod files;
pub mod frames;
mod gdal_log;
pub mod ids;
pub mod issue;
pub mod raster;
pub mod ray;
pub mod seed;
pub mod stats;

pub mod camera;
pub mod crs;
pub mod geodata;
pub mod onnx;
pub mod survey;
pub mod terrain;

pub mod footprint;
pub mod prior;

pub mod render;
pub mod scene;

pub mod ordinal;
pub mod views;

pub mod optimise;

pub mod evaluate;
pub mod output;
pub mod simulate;

pub mod config;
pub mod pipeline;

pub mod cli;
