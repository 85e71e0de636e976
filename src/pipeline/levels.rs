//! Outlines that hold two roof levels: taken apart between two rounds of solving.

use std::collections::BTreeMap;

use geo_types::{LineString, Polygon};
use serde::{Deserialize, Serialize};

use super::FootprintStage;
use super::stages::SceneStage;
use crate::footprint::{Footprint, pieces, with_corners_of};
use crate::ids::BuildingId;
use crate::issue::{Issue, Severity, Subject};
use crate::optimise::{LevelGain, Solution};

/// Rounds of taking apart: each finds one more level of a building.
pub(super) const MAX_ROUNDS: usize = 2;

/// Where one outline is cut.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cut {
    /// Position in the layer, as it was before this round.
    pub footprint: usize,
    /// What stands at another level than the rest, map frame.
    pub other: Polygon<f64>,
    /// Why it is cut.
    #[serde(default)]
    pub gain: LevelGain,
}

/// The cuts that a solution asks for.
pub(super) fn cuts(stage: &SceneStage, solution: &Solution) -> Vec<Cut> {
    let origin = stage.scene.origin.0;
    let of_level = |level: &crate::optimise::OtherLevel| {
        let ring = level.corners.map(|[x, y]| (x + origin.x, y + origin.y));
        Cut {
            footprint: stage.solved[level.building],
            other: Polygon::new(LineString::from(ring.to_vec()), Vec::new()),
            gain: level.gain.clone(),
        }
    };
    solution.other_levels.iter().map(of_level).collect()
}

/// Replaces the outlines that are cut by their parts: `ID#1`, `ID#2`, …, on the ground of the whole. Returns where each
/// outline stood before, nothing for parts; `None` if no outline was cut.
pub(super) fn take_apart(stage: &mut FootprintStage, cuts: &[Cut]) -> Option<Vec<Option<usize>>> {
    let mut cuts = cuts.iter().peekable();
    let whole = std::mem::take(&mut stage.layer.footprints);
    let grounds = std::mem::take(&mut stage.ground);
    let n_before = whole.len();
    let mut stood = Vec::with_capacity(n_before);
    for (at, (footprint, ground)) in whole.into_iter().zip(grounds).enumerate() {
        let cut = cuts.next_if(|cut| cut.footprint == at);
        let Some((cut, parts)) = cut.and_then(|cut| Some((cut, pieces(&footprint.polygon, &cut.other)?))) else {
            stage.layer.footprints.push(footprint);
            stage.ground.push(ground);
            stood.push(Some(at));
            continue;
        };
        stage.issues.push(note(&footprint, parts.len(), &cut.gain));
        stage.levels.push((footprint.id.clone(), cut.gain.clone()));
        for (i, polygon) in parts.into_iter().enumerate() {
            stage.layer.footprints.push(part_of(&footprint, i, polygon));
            stage.ground.push(ground);
            stood.push(None);
        }
    }
    join_parts(&mut stage.layer.footprints, &stood);
    (stage.layer.footprints.len() > n_before).then_some(stood)
}

/// Gives parts of one building each other's corners where a part was taken apart once more: those of the new parts lie on
/// edges of the others.
fn join_parts(footprints: &mut [Footprint], stood: &[Option<usize>]) {
    let mut by_whole: BTreeMap<BuildingId, Vec<usize>> = BTreeMap::new();
    for (at, footprint) in footprints.iter().enumerate() {
        if let Some(whole) = &footprint.part_of {
            by_whole.entry(whole.clone()).or_default().push(at);
        }
    }
    let is_new = |at: &usize| stood[*at].is_none();
    for parts in by_whole.values().filter(|parts| parts.iter().any(is_new) && !parts.iter().all(is_new)) {
        let joined = parts.iter().map(|&at| {
            let others: Vec<_> = parts.iter().filter(|&&o| o != at).map(|&o| &footprints[o].polygon).collect();
            with_corners_of(&others, &footprints[at].polygon)
        });
        for (&at, polygon) in parts.iter().zip(joined.collect::<Vec<_>>()) {
            footprints[at].polygon = polygon;
        }
    }
}

fn part_of(whole: &Footprint, i: usize, polygon: Polygon<f64>) -> Footprint {
    Footprint {
        id: BuildingId(format!("{}#{}", whole.id, i + 1)),
        part_of: Some(whole.part_of.clone().unwrap_or_else(|| whole.id.clone())),
        polygon,
        attributes: whole.attributes.clone(),
    }
}

fn note(footprint: &Footprint, n_parts: usize, gain: &LevelGain) -> Issue {
    let subject = Subject::Building(footprint.id.to_string());
    let one = gain.one.iter().map(|(_, score)| *score).fold(f64::NEG_INFINITY, f64::max);
    let [inner_m, outer_m] = gain.heights_m;
    let (low_m, high_m) = (inner_m.min(outer_m), inner_m.max(outer_m));
    let message = format!(
        "its outline holds roofs at two levels, about {low_m:.0} and {high_m:.0} m, and was taken apart into {n_parts} parts: \
         over {} photos two levels score {:.2}, one level {one:.2} at best",
        gain.n_views, gain.two
    );
    let note = Issue::new(Severity::Note, "levels_taken_apart", subject, message);
    note.hint("optimise.search.split_levels = false keeps outlines whole")
}
