//! The paper's own solver: its ordinal loss along the rays, the loss's slopes by each height, and Adam's steps (`SiZeUp`, "Objective
//! function").

pub(crate) mod adam;
pub(crate) mod gradient;
pub(crate) mod ordinal;
pub(crate) mod regression;
pub(crate) mod schedule;
