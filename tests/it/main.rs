//! Behaviour of sizeup seen from outside, one module per topic.

mod simulate;
