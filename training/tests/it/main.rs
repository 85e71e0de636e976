//! Training from outside: gradients, sets, checkpoints, export. `make train-test` runs them, optimised.

mod bad_input;
mod gradients;
mod learning;
mod orthophotos;
mod paper_features;
mod scene;
