//! The files beside a result: `issues.json`, `summary.json`, `lineage.json`.

use std::path::Path;

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use super::attributes::round_m;
use super::{BuildingRecord, CityModel, OutputError, Status, StatusCount};
pub use sizeup_geo::files::write_json;
use sizeup_geo::files::write_whole;
use sizeup_geo::issue::Issue;
use sizeup_heights::stats::{mean, quantile};

/// Numbers that sum a result up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Buildings of the input.
    pub n_buildings: usize,
    /// Parts of those that came in several pieces or were split.
    pub n_parts: usize,
    /// Buildings by what became of them, one in parts as its worst part; all statuses, also those without buildings.
    pub n_by_status: IndexMap<String, usize>,
    /// Buildings, and parts of such, by reason, the most frequent first, then alphabetical.
    pub n_by_reason: IndexMap<String, usize>,
    /// Issues by code, the most frequent first, then alphabetical.
    pub n_issues_by_code: IndexMap<String, usize>,
    /// Photos with a pose.
    pub n_views: usize,
    /// Distinct photos in which a height was measured.
    pub n_views_used: usize,
    /// Heights of all buildings that have one; `None` without any.
    pub heights: Option<HeightSummary>,
}

/// Distribution of the heights; metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeightSummary {
    /// Buildings with a height.
    pub n: usize,
    /// Lowest height, metres.
    pub min_m: f64,
    /// 10th percentile of the heights, metres.
    pub p10_m: f64,
    /// Median of the heights, metres.
    pub median_m: f64,
    /// Mean of the heights, metres.
    pub mean_m: f64,
    /// 90th percentile of the heights, metres.
    pub p90_m: f64,
    /// Highest height, metres.
    pub max_m: f64,
    /// Median of the stated standard deviations, where there are any.
    pub median_sigma_m: Option<f64>,
}

impl Summary {
    /// Reports of a result.
    #[must_use]
    pub fn of(model: &CityModel<'_>) -> Self {
        let records = model.records;
        let count = StatusCount::of(records);
        let by_status = count.by_status();
        let of = |status: &Status| by_status.get(status).copied().unwrap_or(0);
        let mut views: Vec<&str> = records.iter().flat_map(|r| r.views.iter().map(String::as_str)).collect();
        views.sort_unstable();
        views.dedup();
        Self {
            n_buildings: count.n_buildings(),
            n_parts: count.n_parts(),
            n_by_status: Status::ALL.iter().map(|s| (s.as_str().to_owned(), of(s))).collect(),
            n_by_reason: tally(records.iter().flat_map(|r| r.reasons.iter().map(String::as_str))),
            n_issues_by_code: tally(model.issues.iter().map(|issue| issue.code.as_str())),
            n_views: model.survey.views.len(),
            n_views_used: views.len(),
            heights: HeightSummary::of(records),
        }
    }
}

impl HeightSummary {
    fn of(records: &[BuildingRecord]) -> Option<Self> {
        let heights: Vec<f64> = records.iter().filter_map(|r| r.height_m).collect();
        let sigmas: Vec<f64> = records.iter().filter_map(|r| r.height_sigma_m).collect();
        let at = |q: f64| quantile(&heights, q).map(round_m);
        Some(Self {
            n: heights.len(),
            min_m: at(0.0)?,
            p10_m: at(0.1)?,
            median_m: at(0.5)?,
            mean_m: mean(&heights).map(round_m)?,
            p90_m: at(0.9)?,
            max_m: at(1.0)?,
            median_sigma_m: quantile(&sigmas, 0.5).map(round_m),
        })
    }
}

/// Number of occurrences of each name.
fn tally<'a>(names: impl Iterator<Item = &'a str>) -> IndexMap<String, usize> {
    let mut counts: IndexMap<String, usize> = IndexMap::new();
    for name in names {
        *counts.entry(name.to_owned()).or_default() += 1;
    }
    counts.sort_by(|name_a, n_a, name_b, n_b| n_b.cmp(n_a).then_with(|| name_a.cmp(name_b)));
    counts
}

/// Writes `issues.json`: a list with an issue a line, by weight ([`Issue::weight`]), in their order where that is the same.
///
/// # Errors
/// [`OutputError::File`].
pub fn write_issues(path: &Path, issues: &[Issue]) -> Result<(), OutputError> {
    let mut sorted: Vec<&Issue> = issues.iter().collect();
    sorted.sort_by_key(|issue| issue.weight());
    Ok(write_whole(path, |out| {
        for (i, issue) in sorted.iter().enumerate() {
            out.write_all(if i == 0 { b"[\n" } else { b",\n" })?;
            serde_json::to_writer(&mut *out, issue)?;
        }
        out.write_all(if sorted.is_empty() { b"[]\n" } else { b"\n]\n" })
    })?)
}

#[cfg(test)]
mod tests {
    use sizeup_geo::issue::{Severity, Subject};

    use super::*;

    #[test]
    fn issues_are_a_list_with_one_a_line_the_weightiest_first() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("issues.json");
        let written = |issues: &[Issue]| {
            write_issues(&path, issues).unwrap();
            std::fs::read_to_string(&path).unwrap()
        };
        assert_eq!(written(&[]), "[]\n");
        let issue =
            |severity, id: &str| Issue::new(severity, "height_unknown", Subject::Building(id.to_owned()), "a \"b\"\nc");
        let text = written(&[issue(Severity::Note, "x"), issue(Severity::Refused, "y")]);
        assert_eq!(text.lines().count(), 4, "{text}");
        let read: Vec<Issue> = serde_json::from_str(&text).unwrap();
        assert_eq!(read, [issue(Severity::Refused, "y"), issue(Severity::Note, "x")]);
    }

    #[test]
    fn tallies_put_the_most_frequent_first() {
        let counts = tally(["b", "a", "c", "b", "c"].into_iter());
        assert_eq!(counts.into_iter().collect::<Vec<_>>(), [("b".into(), 2), ("c".into(), 2), ("a".into(), 1)]);
    }
}
