//! Rays against the scene, on the CPU.

pub mod bvh;
