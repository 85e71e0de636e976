//! Building heights from the order of depths in oblique aerial photos.

pub mod camera;
pub mod frames;
pub mod ids;
pub mod optimise;
pub mod ordinal;
pub mod prior;
pub mod raster;
pub mod ray;
pub mod render;
pub mod scene;
pub mod seed;
pub mod simd;
pub mod stats;
pub mod terrain;
pub mod views;
