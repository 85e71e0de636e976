//! Footprints that hold two roof levels: split between two rounds of solving.

use std::collections::{BTreeMap, BTreeSet};

use geo::{Area as _, Contains as _, InteriorPoint as _};
use geo_types::{LineString, Polygon};
use serde::{Deserialize, Serialize};

use super::stages::SceneStage;
use super::{FootprintStage, HeightStage};
use sizeup_footprints::{Footprint, pieces, with_corners_of};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::ids::BuildingId;
use sizeup_heights::optimise::{LevelGain, Solution, SolvedHeight};

/// Rounds of taking apart: each finds one more level of a building.
pub(super) const MAX_ROUNDS: usize = 2;

/// Cut of one footprint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FootprintCut {
    /// Position in the layer, as it was before this round.
    pub footprint: usize,
    /// Name there; its parts are called `ID#1`, `ID#2`, …
    #[serde(default)]
    pub id: String,
    /// Part at another level than the rest, map frame.
    pub other: Polygon<f64>,
    /// Gain of two levels over one, for which it is cut.
    #[serde(default)]
    pub gain: LevelGain,
}

/// The cuts that a solution asks for.
pub(super) fn cuts(footprints: &FootprintStage, stage: &SceneStage, solution: &Solution) -> Vec<FootprintCut> {
    let origin = stage.scene.origin.0;
    let of_level = |level: &sizeup_heights::optimise::OtherLevel| {
        let ring = level.corners.map(|[x, y]| (x + origin.x, y + origin.y));
        FootprintCut {
            footprint: stage.solved[level.building],
            id: footprints.layer.footprints[stage.solved[level.building]].id.0.clone(),
            other: Polygon::new(LineString::from(ring.to_vec()), Vec::new()),
            gain: level.gain.clone(),
        }
    };
    solution.other_levels.iter().map(of_level).collect()
}

/// Replaces the footprints that are cut by their parts: `ID#1`, `ID#2`, …, on the ground of the whole. Returns where each
/// footprint stood before, nothing for parts; `None` if no footprint was cut.
pub(super) fn split_footprints(stage: &mut FootprintStage, cuts: &[FootprintCut]) -> Option<Vec<Option<usize>>> {
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

/// How many standard deviations the step between two solved levels has to stand clear of none.
const CLEAR_SIGMAS: f64 = 2.0;

/// The cuts that the parts' own heights do not bear out. Where all views agree on two levels, each part comes to stand at
/// the one that it was cut for: nearer to that than to the other's, and clear of the other part by two standard deviations.
/// Parts of parts count by their areas.
pub(super) fn not_borne_out(
    footprints: &FootprintStage,
    heights: &HeightStage,
    cuts: &[Vec<FootprintCut>],
) -> BTreeSet<String> {
    let parts: Vec<(&Footprint, &SolvedHeight)> = heights
        .solved
        .iter()
        .map(|&at| &footprints.layer.footprints[at])
        .zip(&heights.solution.heights)
        .filter(|(footprint, _)| footprint.part_of.is_some())
        .collect();
    let is_borne_out = |cut: &FootprintCut| {
        let prefix = format!("{}#", cut.id);
        let of_cut = || parts.iter().filter(|(footprint, _)| footprint.id.0.starts_with(&prefix));
        let level_of = |is_inner: bool| {
            let side = of_cut()
                .filter(|(f, _)| f.polygon.interior_point().is_some_and(|p| cut.other.contains(&p)) == is_inner);
            PartLevel::mean(side.filter_map(|(footprint, solved)| PartLevel::of(footprint, solved)))
        };
        // What has no height contradicts nothing.
        let Some((inner, outer)) = level_of(true).zip(level_of(false)) else { return true };
        let [inner_m, outer_m] = cut.gain.heights_m.map(f64::from);
        let half_step_m = 0.5 * (inner_m - outer_m).abs();
        let is_where_cut =
            (inner.height_m - inner_m).abs() <= half_step_m && (outer.height_m - outer_m).abs() <= half_step_m;
        let step_m = (inner.height_m - outer.height_m) * (inner_m - outer_m).signum();
        is_where_cut && step_m > CLEAR_SIGMAS * inner.sigma_m.hypot(outer.sigma_m)
    };
    cuts.iter().flatten().filter(|cut| !is_borne_out(cut)).map(|cut| cut.id.clone()).collect()
}

/// The level of one or several parts.
#[derive(Debug, Clone, Copy)]
struct PartLevel {
    area_m2: f64,
    height_m: f64,
    sigma_m: f64,
}

impl PartLevel {
    fn of(footprint: &Footprint, solved: &SolvedHeight) -> Option<Self> {
        let height_m = solved.roof?.mean_m;
        Some(Self { area_m2: footprint.polygon.unsigned_area(), height_m, sigma_m: solved.sigma_m.unwrap_or(0.0) })
    }

    /// By area; as if all erred the same way.
    fn mean(levels: impl Iterator<Item = Self>) -> Option<Self> {
        levels.reduce(|a, b| {
            let area_m2 = a.area_m2 + b.area_m2;
            let mean = |of: fn(&Self) -> f64| (a.area_m2 * of(&a) + b.area_m2 * of(&b)) / area_m2;
            Self { area_m2, height_m: mean(|level| level.height_m), sigma_m: mean(|level| level.sigma_m) }
        })
    }
}

/// The cuts of one round without those of some footprints and of their parts, for a layer in which these are whole.
pub(super) fn without(
    cuts: &[FootprintCut],
    footprints: &FootprintStage,
    joined: &BTreeSet<String>,
) -> Vec<FootprintCut> {
    let is_of = |cut: &FootprintCut, whole: &String| cut.id == *whole || cut.id.starts_with(&format!("{whole}#"));
    let kept = cuts.iter().filter(|cut| !joined.iter().any(|whole| is_of(cut, whole)));
    let layer = &footprints.layer.footprints;
    let at = |cut: &FootprintCut| layer.iter().position(|footprint| footprint.id.0 == cut.id);
    kept.filter_map(|cut| Some(FootprintCut { footprint: at(cut)?, ..cut.clone() })).collect()
}

/// Says of a footprint that was split that its parts were joined again.
pub(super) fn joined_note(id: &str) -> Issue {
    let message =
        "its roof looked like two levels, but the heights of its two parts did not bear them out: it was left whole";
    Issue::new(Severity::Note, "levels_joined_again", Subject::Building(id.to_owned()), message)
}

/// Gives parts of one building each other's corners where a part was split once more: those of the new parts lie on
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
        "its footprint holds roofs at two levels, about {low_m:.0} and {high_m:.0} m, and was split into {n_parts} parts: \
         over {} photos two levels score {:.2}, one level {one:.2} at best",
        gain.n_views, gain.two
    );
    let note = Issue::new(Severity::Note, "footprint_split", subject, message);
    note.hint("optimise.search.split_levels = false keeps footprints whole")
}
