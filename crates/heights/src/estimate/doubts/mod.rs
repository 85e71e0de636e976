//! Doubts about heights that only their surroundings show.

mod neighbours;
mod towers;
mod uncertain;

pub(super) use neighbours::mark_small;
pub(super) use towers::mark_towers;
pub(super) use uncertain::mark_uncertain;
