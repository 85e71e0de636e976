//! What aerial photos say of depth: priors from files, networks and stereo, and ground.
//!
//! [`onnx`] is the only door to inference engines. [`prior`] turns a view into a
//! [`DepthPrior`](sizeup_heights::prior::DepthPrior); [`dtm`]
//! finds the ground between buildings; [`align`] brings poses that are nearly right to agree with the photos; [`quality`] names
//! photos that say little; [`vegetation`] what is green in them; [`textures`] paints buildings with them.

pub mod align;
pub mod dtm;
pub mod onnx;
pub mod prior;
pub mod quality;
pub mod textures;
pub mod vegetation;
