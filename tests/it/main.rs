//! Behaviour of sizeup seen from outside, one module per topic.

mod evaluation;
mod footprint_layers;
mod networks;
mod outputs;
mod pictures;
mod prior_files;
mod qgis;
mod shared_data;
mod simulate;
mod stereo;
mod survey_cli;
mod survey_formats;
mod survey_hostile;
mod survey_real;
mod synthetic_block;
mod terrain_files;
mod validation;
mod warsaw;
