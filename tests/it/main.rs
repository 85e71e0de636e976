//! Behaviour of sizeup seen from outside, one module per topic.

mod survey_formats;
mod survey_hostile;
mod survey_real;
