//! Trains the network that finds where buildings meet the ground in near-nadir photos, and exports it for sizeup.
//!
//! ```text
//! simulated scenes, or photos + poses + footprints + heights ─ dataset ─> a set ─ train ─> checkpoints ─ export ─> ONNX
//!                                                                           └── measure <──────────────────────────┘
//! ```
//!
//! The paper: `SiZeUp`, "Footprint Extraction". `docs/footprint-network.md` walks through it with figures.

pub mod config;
pub mod dataset;
pub mod error;
pub mod export;
pub mod measure;
pub mod network;
pub mod train;

pub use error::TrainError;
