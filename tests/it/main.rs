//! Behaviour of sizeup seen from outside, one module per topic.

mod benchmark;
mod cli;
mod determinism;
mod evaluation;
mod footprint_layers;
mod hostile_inputs;
mod layers;
mod networks;
mod outputs;
mod pictures;
mod prior_files;
mod qgis;
mod real_data;
mod schemas;
mod shared_data;
mod simulate;
mod stereo;
mod survey_cli;
mod survey_formats;
mod survey_hostile;
mod survey_real;
mod synthetic_block;
mod terrain_files;
mod tiny_scene;
mod validation;
mod warsaw;
