//! Behaviour of sizeup seen from outside, one module per topic.

mod synthetic_block;
mod survey_real;
mod evaluation;
mod outputs;
mod simulate;
