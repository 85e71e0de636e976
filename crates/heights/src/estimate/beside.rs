//! Which heights a new outline can change: what hides a building, or is hidden by it, stands close beside it.
//!
//! ```text
//! beside(a, b):  gap(a, b) ≤ REACH_PER_M · max(h_a, h_b) + MARGIN_M       gap: between bounding boxes
//! ```

use std::collections::BTreeMap;

use glam::Vec2;

use super::parts::Parts;
use super::task::{LevelEvidence, Split};
use crate::optimise::Solution;
use crate::scene::Scene;

/// Reach of a building in oblique photos per metre of its height, metres on the ground: rays at 56° from the vertical, the far side of photos
/// tilted by 45°.
const REACH_PER_M: f32 = 1.5;
/// Ground around a building that is compared with it, metres: 12 pixels of 0.4 m.
const MARGIN_M: f32 = 5.0;

/// A scene in parts, with heights of an earlier solution.
pub(super) struct Outlines<'a> {
    pub scene: &'a Scene,
    pub parts: &'a Parts,
}

impl Outlines<'_> {
    /// By part: whether it is new, or stands beside one that is. `former_heights_m`: heights of buildings before.
    pub fn are_beside(&self, is_new: impl Fn(usize) -> bool, tallest_m: &BTreeMap<usize, f32>) -> Vec<bool> {
        let outline = |part: usize| {
            let bounds = self.scene.prisms[part].bounds_below(0.0);
            let height_m = tallest_m.get(&self.parts.parts[part].building).copied().unwrap_or(0.0);
            (bounds.min.truncate(), bounds.max.truncate(), height_m)
        };
        let all: Vec<(Vec2, Vec2, f32)> = (0..self.parts.parts.len()).map(outline).collect();
        let new: Vec<usize> = (0..all.len()).filter(|&part| is_new(part)).collect();
        let is_beside = |(low, high, height_m): &(Vec2, Vec2, f32)| {
            new.iter().any(|&new| {
                let (new_low, new_high, new_height_m) = all[new];
                let gap = (*low - new_high).max(new_low - *high).max(Vec2::ZERO);
                gap.length() <= REACH_PER_M * height_m.max(new_height_m) + MARGIN_M
            })
        };
        all.iter().map(is_beside).collect()
    }
}

/// Greatest height of each building, by position: of its parts in a solution, and of the levels that it was cut for. Metres.
pub(super) fn tallest_m(parts: &Parts, solution: &Solution) -> BTreeMap<usize, f32> {
    let last = solution.history.last().map_or(&[][..], |pass| &pass.heights_m);
    let of_parts = parts.parts.iter().zip(last).map(|(part, height_m)| (part.building, *height_m));
    let of_split = |split: &Split| match &split.evidence {
        LevelEvidence::Priors(gain) => gain.heights_m.map(|height_m| (split.building, height_m)).to_vec(),
        LevelEvidence::Photos(_) => Vec::new(),
    };
    let of_cuts = parts.splits.iter().flat_map(of_split);
    let mut tallest_m = BTreeMap::new();
    for (building, height_m) in of_parts.chain(of_cuts) {
        let tallest = tallest_m.entry(building).or_insert(0.0_f32);
        *tallest = tallest.max(height_m);
    }
    tallest_m
}
