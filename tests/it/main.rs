//! Behaviour of sizeup seen from outside, one module per topic.

mod evaluation;
mod outputs;
mod pictures;
mod qgis;
mod simulate;
mod survey_real;
mod synthetic_block;
mod validation;
