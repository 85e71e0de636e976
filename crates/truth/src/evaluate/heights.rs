//! Heights against a reference, over all buildings, by kind of building and by status.

use std::collections::BTreeMap;

use geo::Area as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::matching::{Match, Matching, match_buildings};
use super::parts::joined;
use super::statistics::{DEFINITIONS, HeightPair, HeightStatistics};
use super::{EvaluationError, TruthBuilding};
use sizeup_results::output::{BuildingRecord, Status};

/// Upper limits of the classes of height, metres; the last class is above.
const HEIGHT_CLASSES_M: [f64; 4] = [6.0, 12.0, 25.0, 50.0];
/// Upper limits of the classes of footprint area, m²; the last class is above.
const AREA_CLASSES_M2: [f64; 3] = [100.0, 300.0, 1000.0];

/// Settings of the comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct HeightOptions {
    /// Rule that matches buildings: `auto`, `id` or `overlap`.
    pub matching: Matching,
    /// Smallest share of a reference footprint that its match covers, 0 to 1, when matching by overlap.
    pub min_overlap_share: f64,
    /// Reference buildings lower than this are counted, not compared, metres (relative accuracy means nothing there).
    pub min_truth_height_m: f64,
}

impl Default for HeightOptions {
    fn default() -> Self {
        Self { matching: Matching::Auto, min_overlap_share: 0.5, min_truth_height_m: 2.0 }
    }
}

/// Number of buildings by outcome. The reference's buildings are the sum of `n_compared`, `n_unmatched`,
/// `n_too_low`, `n_without_truth` and `n_unobserved`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MatchCounts {
    /// Buildings of the reference.
    pub n_truth: usize,
    /// Buildings of the result.
    pub n_results: usize,
    /// Buildings whose heights were compared.
    pub n_compared: usize,
    /// Reference buildings without a match.
    pub n_unmatched: usize,
    /// Reference buildings below the minimum height, matched or not.
    pub n_too_low: usize,
    /// Reference buildings whose own height is not known.
    pub n_without_truth: usize,
    /// Matched, but the result has no height.
    pub n_unobserved: usize,
    /// Buildings of the result that no reference building was matched to.
    pub n_results_unmatched: usize,
}

/// Statistics of one group of buildings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupStatistics {
    /// Name of the group.
    pub group: String,
    /// Statistics over the buildings of the group.
    pub statistics: HeightStatistics,
}

/// Error of one building that was compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BuildingError {
    /// Id in the reference.
    pub truth_id: String,
    /// Id in the result.
    pub result_id: String,
    /// Height in the result, metres.
    pub height_m: f64,
    /// Height in the reference, metres.
    pub truth_m: f64,
    /// Result minus reference, metres.
    pub signed_error_m: f64,
    /// The result's stated standard deviation, metres.
    pub sigma_m: Option<f64>,
    /// Status of the building.
    pub status: Status,
    /// Kind of building; `None` where nobody names it.
    pub group: Option<String>,
    /// Share of the reference's footprint that the match covers.
    pub overlap_share: Option<f64>,
    /// Area of the reference's footprint, m²; of the result's where the reference has none.
    #[serde(default)]
    pub area_m2: Option<f64>,
}

/// The outcome, with everything needed to read it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeightEvaluation {
    /// Rule that matched buildings: `id` or `overlap`.
    pub matched_by: Matching,
    /// Least share of a reference footprint that its match covers, as used, 0 to 1.
    pub min_overlap_share: f64,
    /// Reference buildings lower than this were not compared, metres.
    pub min_truth_height_m: f64,
    /// Number of buildings by outcome.
    pub counts: MatchCounts,
    /// Over all compared buildings; `None` if every match is unobserved or too low.
    pub all: Option<HeightStatistics>,
    /// By what became of the building (`measured`, `doubtful`, `fallback`), in that order.
    pub by_status: Vec<GroupStatistics>,
    /// By kind of building, in alphabetical order; empty if the reference has no kinds.
    pub by_group: Vec<GroupStatistics>,
    /// By height of the reference, ascending; empty where all are of one class.
    #[serde(default)]
    pub by_height: Vec<GroupStatistics>,
    /// By area of the footprint, ascending; empty where all are of one class.
    #[serde(default)]
    pub by_area: Vec<GroupStatistics>,
    /// Each compared building, in the reference's order.
    pub buildings: Vec<BuildingError>,
    /// Meaning of each number.
    pub definitions: BTreeMap<String, String>,
}

/// Compares the heights of a result with a reference. Both footprints must be in the same CRS. Parts of a building count as
/// one where the reference has it as one, with the mean height over their areas.
///
/// # Errors
/// [`EvaluationError::NoMatch`] when nothing matches, [`EvaluationError::DuplicateId`] for ambiguous ids.
pub fn evaluate_heights(
    results: &[BuildingRecord],
    truth: &[TruthBuilding],
    options: &HeightOptions,
) -> Result<HeightEvaluation, EvaluationError> {
    let results = &joined(results, truth);
    let (matched_by, matches) = match_buildings(results, truth, options.matching, options.min_overlap_share)?;
    if matches.is_empty() {
        return Err(no_match(results.len(), truth.len(), matched_by));
    }
    let (counts, buildings) = compare(results, truth, &matches, options.min_truth_height_m);
    let known_groups: std::collections::BTreeSet<&str> = buildings.iter().filter_map(|b| b.group.as_deref()).collect();
    let statuses = Status::ALL;
    let group = |name: &str, belongs: &dyn Fn(&BuildingError) -> bool| {
        let statistics = HeightStatistics::of_buildings(buildings.iter().filter(|b| belongs(b)))?;
        Some(GroupStatistics { group: name.to_owned(), statistics })
    };
    Ok(HeightEvaluation {
        matched_by,
        min_overlap_share: options.min_overlap_share,
        min_truth_height_m: options.min_truth_height_m,
        counts,
        all: HeightStatistics::of_buildings(buildings.iter()),
        by_status: statuses.iter().filter_map(|s| group(s.as_str(), &|b| b.status == *s)).collect(),
        by_group: known_groups.iter().filter_map(|g| group(g, &|b| b.group.as_deref() == Some(g))).collect(),
        by_height: classes(&buildings, &HEIGHT_CLASSES_M, "m high", |b| Some(b.truth_m)),
        by_area: classes(&buildings, &AREA_CLASSES_M2, "m²", |b| b.area_m2),
        definitions: DEFINITIONS.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect(),
        buildings,
    })
}

/// Statistics by size, ascending; nothing where all buildings are of one class.
fn classes(
    buildings: &[BuildingError],
    limits: &[f64],
    unit: &str,
    size_of: impl Fn(&BuildingError) -> Option<f64>,
) -> Vec<GroupStatistics> {
    let bounds =
        || std::iter::once(0.0).chain(limits.iter().copied()).zip(limits.iter().copied().chain([f64::INFINITY]));
    let name = |low: f64, high: f64| match (low, high) {
        (0.0, _) => format!("up to {high} {unit}"),
        (_, f64::INFINITY) => format!("above {low} {unit}"),
        _ => format!("{low} to {high} {unit}"),
    };
    let statistics = |(low, high): (f64, f64)| {
        let of_class = buildings.iter().filter(|b| size_of(b).is_some_and(|size| size > low && size <= high));
        let statistics = HeightStatistics::of_buildings(of_class)?;
        Some(GroupStatistics { group: name(low, high), statistics })
    };
    let classes: Vec<GroupStatistics> = bounds().filter_map(statistics).collect();
    if classes.len() > 1 { classes } else { Vec::new() }
}

fn no_match(n_results: usize, n_truth: usize, matched_by: Matching) -> EvaluationError {
    let (how, hint) = match matched_by {
        Matching::Id => ("id", "name the id attribute of both, or match by overlap"),
        Matching::Auto | Matching::Overlap => {
            ("overlap", "check that both cover the same area, and that their CRSs are stated rightly")
        }
    };
    EvaluationError::NoMatch { n_truth, n_results, how, hint }
}

/// Sorts the matches into compared pairs and counts of everything else.
fn compare(
    results: &[BuildingRecord],
    truth: &[TruthBuilding],
    matches: &[Match],
    min_truth_height_m: f64,
) -> (MatchCounts, Vec<BuildingError>) {
    let mut match_of: Vec<Option<&Match>> = vec![None; truth.len()];
    let mut is_used = vec![false; results.len()];
    for found in matches {
        match_of[found.truth] = Some(found);
        is_used[found.result] = true;
    }
    let mut counts = MatchCounts { n_truth: truth.len(), n_results: results.len(), ..MatchCounts::default() };
    let mut compared = Vec::new();
    for (building, found) in truth.iter().zip(match_of) {
        let Some(truth_m) = building.height_m.filter(|h| h.is_finite()) else {
            counts.n_without_truth += 1;
            continue;
        };
        if truth_m < min_truth_height_m || truth_m <= 0.0 {
            counts.n_too_low += 1;
            continue;
        }
        let Some(found) = found else {
            counts.n_unmatched += 1;
            continue;
        };
        let record = &results[found.result];
        let Some(height_m) = record.height_m.filter(|h| h.is_finite()) else {
            counts.n_unobserved += 1;
            continue;
        };
        compared.push(BuildingError {
            truth_id: building.id.clone(),
            result_id: record.id.clone(),
            height_m,
            truth_m,
            signed_error_m: height_m - truth_m,
            sigma_m: record.height_sigma_m,
            status: record.status,
            group: building.group.clone(),
            overlap_share: found.overlap_share,
            area_m2: match (&building.footprint, &record.footprint) {
                (Some(footprint), _) => Some(footprint.unsigned_area()),
                (None, footprint) => footprint.as_ref().map(geo::Area::unsigned_area),
            },
        });
    }
    counts.n_compared = compared.len();
    counts.n_results_unmatched = is_used.iter().filter(|used| !**used).count();
    (counts, compared)
}

impl HeightStatistics {
    /// Over compared buildings, of one evaluation or of several; `None` for none.
    pub fn of_buildings<'a>(buildings: impl Iterator<Item = &'a BuildingError>) -> Option<Self> {
        let pairs: Vec<HeightPair> =
            buildings.map(|b| HeightPair { height_m: b.height_m, truth_m: b.truth_m, sigma_m: b.sigma_m }).collect();
        Self::of(&pairs)
    }
}
