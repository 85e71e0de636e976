//! Buildings handed to the method, and footprints split into the parts that it returns.

use sizeup_footprints::Footprint;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::estimate::{Building, LevelEvidence, Part, Split};
use sizeup_heights::ids::BuildingId;
use sizeup_heights::optimise::LevelGain;

use super::{FootprintStage, HeightStage};

/// The buildings whose ground is known, in the order of the layer.
pub(super) fn buildings_of(footprints: &FootprintStage) -> Vec<Building> {
    let on_ground = footprints.layer.footprints.iter().zip(&footprints.ground);
    let building = |(footprint, ground): (&Footprint, &Option<_>)| {
        Some(Building { footprint: footprint.polygon.clone(), ground: (*ground)? })
    };
    on_ground.filter_map(building).collect()
}

/// Replaces footprints by the parts that the heights are of; each gets the name of the whole and its number. Returns the positions of
/// the parts in the layer.
pub(super) fn split_footprints(footprints: &mut FootprintStage, heights: &HeightStage) -> Vec<usize> {
    let whole = std::mem::take(&mut footprints.layer.footprints);
    let grounds = std::mem::take(&mut footprints.ground);
    let known: Vec<usize> = (0..whole.len()).filter(|&at| grounds[at].is_some()).collect();
    let id_of = |building: usize, path: &[usize]| name_of(&whole[known[building]].id, path);
    for Split { building, path, n_parts, evidence } in &heights.splits {
        let id = id_of(*building, path);
        footprints.issues.push(split_note(&id, *n_parts, evidence));
        if let LevelEvidence::Priors(gain) = evidence {
            footprints.levels.push((id, gain.clone()));
        }
    }
    let mut joined: Vec<BuildingId> = heights.joined.iter().map(|(building, path)| id_of(*building, path)).collect();
    joined.sort();
    footprints.issues.extend(joined.iter().map(joined_note));
    let mut solved = Vec::with_capacity(heights.parts.len());
    let mut parts = heights.parts.iter().peekable();
    let mut n_buildings = 0;
    for (footprint, ground) in whole.into_iter().zip(grounds) {
        let building = n_buildings;
        n_buildings += usize::from(ground.is_some());
        if ground.is_some() {
            while let Some(part) = parts.next_if(|part| part.building == building) {
                solved.push(footprints.layer.footprints.len());
                footprints.layer.footprints.push(part_of(&footprint, part));
                footprints.ground.push(ground);
            }
        } else {
            footprints.layer.footprints.push(footprint);
            footprints.ground.push(ground);
        }
    }
    solved
}

/// A footprint, or a part of it.
fn part_of(whole: &Footprint, part: &Part) -> Footprint {
    if part.path.is_empty() {
        return whole.clone();
    }
    Footprint {
        id: name_of(&whole.id, &part.path),
        part_of: Some(whole.part_of.clone().unwrap_or_else(|| whole.id.clone())),
        polygon: part.footprint.clone(),
        attributes: whole.attributes.clone(),
    }
}

/// `ID`, `ID#2`, `ID#2#1`, …
fn name_of(whole: &BuildingId, path: &[usize]) -> BuildingId {
    BuildingId(path.iter().fold(whole.0.clone(), |id, number| format!("{id}#{number}")))
}

fn split_note(id: &BuildingId, n_parts: usize, evidence: &LevelEvidence) -> Issue {
    let (message, hint) = match evidence {
        LevelEvidence::Priors(gain) => {
            (split_by_priors(n_parts, gain), "optimise.search.split_levels = false keeps footprints whole")
        }
        LevelEvidence::Photos(heights_m) => {
            (split_by_photos(heights_m), "look at the parts in the report; correct the footprint if the cut is wrong")
        }
    };
    Issue::new(Severity::Note, "footprint_split", Subject::Building(id.to_string()), message).hint(hint)
}

fn split_by_priors(n_parts: usize, gain: &LevelGain) -> String {
    let one = gain.one.iter().map(|(_, score)| *score).fold(f64::NEG_INFINITY, f64::max);
    let [inner_m, outer_m] = gain.heights_m;
    let (low_m, high_m) = (inner_m.min(outer_m), inner_m.max(outer_m));
    format!(
        "its footprint holds roofs at two levels, about {low_m:.0} and {high_m:.0} m, and was split into {n_parts} parts: \
         over {} photos two levels score {:.2}, one level {one:.2} at best",
        gain.n_views, gain.two
    )
}

fn split_by_photos(heights_m: &[f64]) -> String {
    let levels: Vec<String> = heights_m.iter().map(|height_m| format!("{height_m:.1}")).collect();
    format!(
        "the photos show roofs at several levels in its footprint ({} m): it was split into parts",
        levels.join(", ")
    )
}

fn joined_note(id: &BuildingId) -> Issue {
    let message =
        "its roof looked like two levels, but the heights of its two parts did not bear them out: it was left whole";
    Issue::new(Severity::Note, "levels_joined_again", Subject::Building(id.to_string()), message)
}
