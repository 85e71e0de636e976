//! Which building of the result stands for which building of the reference.
//!
//! By id, or by the largest overlap: for truth `t`, the result `r` with the largest `area(t ∩ r)`, taken if that is at
//! least `min_overlap_share` of `area(t)`. Several truths may share one result (a block that the result has as one
//! footprint); ties go to the result that comes first.

use std::collections::HashMap;

use geo::{Area, BooleanOps, BoundingRect};
use geo_types::MultiPolygon;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{EvaluationError, TruthBuilding};
use sizeup_results::output::BuildingRecord;

/// Share of the reference's ids that must be in the result for [`Matching::Auto`] to trust them.
const MIN_SHARED_ID_SHARE: f64 = 0.5;

/// Rule that matches buildings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Matching {
    /// By id if at least half of the reference's ids are in the result, otherwise by overlap.
    #[default]
    Auto,
    /// Buildings match where their ids are equal.
    Id,
    /// By the largest overlap of the footprints.
    Overlap,
}

/// Indices of a matched pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Position in the reference.
    pub truth: usize,
    /// Position in the result.
    pub result: usize,
    /// `area(t ∩ r) / area(t)`, where footprints were compared.
    pub overlap_share: Option<f64>,
}

/// Matches each building of the reference to at most one of the result, in the reference's order. Returns the way
/// that was taken, never [`Matching::Auto`].
///
/// # Errors
/// [`EvaluationError::DuplicateId`] when matching by ids that are not unique.
pub fn match_buildings(
    results: &[BuildingRecord],
    truth: &[TruthBuilding],
    matching: Matching,
    min_overlap_share: f64,
) -> Result<(Matching, Vec<Match>), EvaluationError> {
    match matching {
        Matching::Id => Ok((Matching::Id, by_id(results, truth)?)),
        Matching::Overlap => Ok((Matching::Overlap, by_overlap(results, truth, min_overlap_share))),
        Matching::Auto => match by_id(results, truth) {
            Ok(matches) if matches.len() as f64 >= MIN_SHARED_ID_SHARE * truth.len() as f64 => {
                Ok((Matching::Id, matches))
            }
            // Ids that are few or not unique say nothing; footprints do.
            Ok(_) | Err(_) => Ok((Matching::Overlap, by_overlap(results, truth, min_overlap_share))),
        },
    }
}

fn by_id(results: &[BuildingRecord], truth: &[TruthBuilding]) -> Result<Vec<Match>, EvaluationError> {
    let mut result_of: HashMap<&str, usize> = HashMap::with_capacity(results.len());
    for (i, record) in results.iter().enumerate() {
        if result_of.insert(&record.id, i).is_some() {
            return Err(EvaluationError::DuplicateId { side: "result", id: record.id.clone() });
        }
    }
    let mut seen: HashMap<&str, usize> = HashMap::with_capacity(truth.len());
    let mut matches = Vec::new();
    for (i, building) in truth.iter().enumerate() {
        if seen.insert(&building.id, i).is_some() {
            return Err(EvaluationError::DuplicateId { side: "reference", id: building.id.clone() });
        }
        if let Some(&result) = result_of.get(building.id.as_str()) {
            matches.push(Match { truth: i, result, overlap_share: None });
        }
    }
    Ok(matches)
}

type Box2 = GeomWithData<Rectangle<[f64; 2]>, usize>;

fn by_overlap(results: &[BuildingRecord], truth: &[TruthBuilding], min_overlap_share: f64) -> Vec<Match> {
    let boxes: Vec<Box2> = results
        .iter()
        .enumerate()
        .filter_map(|(i, record)| {
            let bounds = record.footprint.as_ref()?.bounding_rect()?;
            let (low, high) = (bounds.min(), bounds.max());
            Some(GeomWithData::new(Rectangle::from_corners([low.x, low.y], [high.x, high.y]), i))
        })
        .collect();
    let tree = RTree::bulk_load(boxes);
    let best = |(i, building): (usize, &TruthBuilding)| {
        let footprint = building.footprint.as_ref()?;
        let area_m2 = footprint.unsigned_area();
        let bounds = footprint.bounding_rect()?;
        let (low, high) = (bounds.min(), bounds.max());
        let mut candidates: Vec<usize> = tree
            .locate_in_envelope_intersecting(&AABB::from_corners([low.x, low.y], [high.x, high.y]))
            .map(|candidate| candidate.data)
            .collect();
        candidates.sort_unstable();
        let mut best: Option<Match> = None;
        for result in candidates {
            let shared_m2 = shared_area_m2(footprint, &results[result]);
            let share = shared_m2 / area_m2;
            let is_better = best.is_none_or(|b| Some(share) > b.overlap_share);
            if share >= min_overlap_share && shared_m2 > 0.0 && is_better {
                best = Some(Match { truth: i, result, overlap_share: Some(share) });
            }
        }
        best
    };
    truth.iter().enumerate().filter_map(best).collect()
}

fn shared_area_m2(polygon: &MultiPolygon<f64>, record: &BuildingRecord) -> f64 {
    record
        .footprint
        .as_ref()
        .map_or(0.0, |footprint| polygon.intersection(&MultiPolygon::new(vec![footprint.clone()])).unsigned_area())
}
