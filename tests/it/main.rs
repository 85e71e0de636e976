//! Behaviour of sizeup seen from outside, one module per topic.

mod footprint_layers;
mod networks;
mod prior_files;
mod shared_data;
mod stereo;
mod terrain_files;
mod warsaw;
