//! Whether a result as a whole can be: what no single building tells.

use super::{BuildingRecord, Status};
use sizeup_geo::issue::{Issue, Severity, Subject};

/// Fewer heights than this are no pattern.
const MIN_HEIGHTS: usize = 3;
/// Share of the heights from which a doubt is one about the whole: at an end of the range, where a town has hardly any …
const AT_END_SHARE: f64 = 0.1;
/// … and of heights that the photos disagree on, or that are not measured for whatever reason.
const DISAGREEING_SHARE: f64 = 1.0 / 3.0;
const NOT_MEASURED_SHARE: f64 = 0.5;

/// Doubts about the heights of a result, counted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CityDoubts {
    n: usize,
    n_measured: usize,
    n_at_end: usize,
    n_disagreeing: usize,
    n_above_all: usize,
    /// The highest of them, metres.
    highest: Option<(f64, String)>,
}

impl CityDoubts {
    /// Doubts about a city that its records give reason for.
    #[must_use]
    pub fn of(records: &[BuildingRecord]) -> Self {
        let mut doubts = Self::default();
        for record in records {
            doubts.add(record);
        }
        doubts
    }

    /// Counts one more building, or part of one. What has no usable footprint says nothing.
    pub fn add(&mut self, record: &BuildingRecord) {
        if record.status == Status::Refused {
            return;
        }
        let has = |reason: &str| record.reasons.iter().any(|r| r == reason);
        self.n += 1;
        self.n_measured += usize::from(matches!(record.status, Status::Measured | Status::Reviewed));
        // What is not there has the least height, whatever the range.
        self.n_at_end += usize::from(has("range_bound") && !has("nothing_stands_here"));
        self.n_disagreeing += usize::from(has("conflicting_views"));
        if let Some(height_m) = record.height_m.filter(|_| has("above_all_around")) {
            self.n_above_all += 1;
            if self.highest.as_ref().is_none_or(|(highest_m, _)| height_m > *highest_m) {
                self.highest = Some((height_m, record.id.clone()));
            }
        }
    }

    /// Evidence against the result as a whole; one issue each, the gravest first.
    #[must_use]
    pub fn implausible(&self) -> Vec<Issue> {
        let of_all = |n: usize| format!("{n} of {} heights", self.n);
        let many = |n: usize, share: f64| self.n >= MIN_HEIGHTS && n >= 2 && n as f64 >= share * self.n as f64;
        let mut told = Vec::new();
        if many(self.n_at_end, AT_END_SHARE) {
            let text = format!("{} are at an end of the heights that are looked for", of_all(self.n_at_end));
            told.push((text, "are poses and terrain right, and heights.max_m and heights.min_m?"));
        }
        if let Some((height_m, id)) = &self.highest {
            let text = match self.n_above_all {
                1 => format!("{id} stands at {height_m:.1} m, far above all that is around it"),
                n => format!("{} stand far above all that is around them, {id} at {height_m:.1} m", of_all(n)),
            };
            told.push((text, "if there is no tower, look at its photos: false matches make towers"));
        }
        if many(self.n_disagreeing, DISAGREEING_SHARE) {
            let text = format!("the photos disagree on {}", of_all(self.n_disagreeing));
            told.push((text, "poses that are off, or priors that show something else, look like this"));
        }
        let n_not = self.n - self.n_measured;
        if told.is_empty() && many(n_not, NOT_MEASURED_SHARE) {
            let text = format!("{} are not measured", of_all(n_not));
            told.push((text, "the issues say why, building by building"));
        }
        let issue = |(text, hint): (String, &str)| {
            let subject = Subject::Input("result".to_owned());
            Issue::new(Severity::Warning, "result_implausible", subject, text).hint(hint)
        };
        told.into_iter().map(issue).collect()
    }
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};

    use super::*;
    use crate::output::record::tests::record;

    fn told(reasons: &[&[&str]]) -> Vec<String> {
        let footprint = Rect::new(coord! { x: 0.0, y: 0.0 }, coord! { x: 9.0, y: 9.0 }).to_polygon();
        let of = |(i, reasons): (usize, &&[&str])| BuildingRecord {
            reasons: reasons.iter().map(|r| (*r).to_owned()).collect(),
            status: if reasons.is_empty() { Status::Measured } else { Status::Doubtful },
            ..record(&format!("b{i}"), footprint.clone(), 0.0, 0.0, 145.4)
        };
        let records: Vec<BuildingRecord> = reasons.iter().enumerate().map(of).collect();
        CityDoubts::of(&records).implausible().into_iter().map(|issue| issue.message).collect()
    }

    #[test]
    fn what_cannot_be_as_a_whole_is_told_and_single_doubts_are_not() {
        let fine: &[&str] = &[];
        let (end, apart): (&[&str], &[&str]) = (&["range_bound"], &["conflicting_views"]);
        assert_eq!(told(&[fine, fine, end]), Vec::<String>::new(), "one of three is no pattern");
        assert_eq!(told(&[fine, apart, fine, fine]), Vec::<String>::new());
        assert_eq!(told(&[fine, end, end]), ["2 of 3 heights are at an end of the heights that are looked for"]);
        assert_eq!(told(&[apart, apart, fine, fine]), ["the photos disagree on 2 of 4 heights"]);
        assert_eq!(
            told(&[fine, fine, fine, fine, &["above_all_around"]]),
            ["b4 stands at 145.4 m, far above all that is around it"]
        );
        assert_eq!(told(&[fine, &["poor_score"], &["too_few_views"]]), ["2 of 3 heights are not measured"]);
    }
}
