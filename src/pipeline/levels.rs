//! Outlines that hold two roof levels: taken apart between two rounds of solving.

use geo_types::{LineString, Polygon};
use serde::{Deserialize, Serialize};

use super::FootprintStage;
use super::stages::SceneStage;
use crate::footprint::{Footprint, pieces};
use crate::ids::BuildingId;
use crate::issue::{Issue, Severity, Subject};
use crate::optimise::Solution;

/// Rounds of taking apart: each finds one more level of a building.
pub(super) const MAX_ROUNDS: usize = 2;

/// Where one outline is cut.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cut {
    /// Position in the layer, as it was before this round.
    pub footprint: usize,
    /// What stands at another level than the rest, map frame.
    pub other: Polygon<f64>,
}

/// The cuts that a solution asks for.
pub(super) fn cuts(stage: &SceneStage, solution: &Solution) -> Vec<Cut> {
    let origin = stage.scene.origin.0;
    let of_level = |level: &crate::optimise::OtherLevel| {
        let ring = level.corners.map(|[x, y]| (x + origin.x, y + origin.y));
        Cut {
            footprint: stage.solved[level.building],
            other: Polygon::new(LineString::from(ring.to_vec()), Vec::new()),
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
        let parts = cuts.next_if(|cut| cut.footprint == at).and_then(|cut| pieces(&footprint.polygon, &cut.other));
        let Some(parts) = parts else {
            stage.layer.footprints.push(footprint);
            stage.ground.push(ground);
            stood.push(Some(at));
            continue;
        };
        stage.issues.push(note(&footprint, parts.len()));
        for (i, polygon) in parts.into_iter().enumerate() {
            stage.layer.footprints.push(part_of(&footprint, i, polygon));
            stage.ground.push(ground);
            stood.push(None);
        }
    }
    (stage.layer.footprints.len() > n_before).then_some(stood)
}

fn part_of(whole: &Footprint, i: usize, polygon: Polygon<f64>) -> Footprint {
    Footprint {
        id: BuildingId(format!("{}#{}", whole.id, i + 1)),
        part_of: Some(whole.part_of.clone().unwrap_or_else(|| whole.id.clone())),
        polygon,
        attributes: whole.attributes.clone(),
    }
}

fn note(footprint: &Footprint, n_parts: usize) -> Issue {
    let subject = Subject::Building(footprint.id.to_string());
    let message = format!("its outline holds roofs at two levels and was taken apart into {n_parts} parts");
    let note = Issue::new(Severity::Note, "levels_taken_apart", subject, message);
    note.hint("optimise.search.split_levels = false keeps outlines whole")
}
