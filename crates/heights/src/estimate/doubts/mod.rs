//! Doubts about heights that only their surroundings show.

mod neighbours;
mod towers;

pub(super) use neighbours::mark_small;
pub(super) use towers::mark_towers;
