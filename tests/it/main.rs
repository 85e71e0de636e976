//! Behaviour of sizeup seen from outside, one module per topic.

mod evaluation;
mod outputs;
mod pictures;
mod qgis;
mod simulate;
mod survey_formats;
mod survey_hostile;
mod survey_real;
mod synthetic_block;
mod footprint_layers;
mod networks;
mod prior_files;
mod shared_data;
mod stereo;
mod terrain_files;
mod warsaw;
mod validation;
