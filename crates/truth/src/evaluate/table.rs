//! The evaluation as text for people.

use std::fmt;

use super::heights::HeightEvaluation;
use super::matching::Matching;
use super::statistics::HeightStatistics;

impl fmt::Display for HeightEvaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let c = &self.counts;
        let how = match self.matched_by {
            Matching::Id => "by id".to_owned(),
            Matching::Auto | Matching::Overlap => {
                format!(
                    "by largest overlap (at least {:.0} % of the reference's footprint)",
                    100.0 * self.min_overlap_share
                )
            }
        };
        writeln!(f, "Heights: {} of {} reference buildings compared, matched {how}", c.n_compared, c.n_truth)?;
        writeln!(
            f,
            "  not compared: {} without match, {} without a height in the result, {} lower than {} m, {} without a \
             height in the reference; {} of {} result buildings have no match",
            c.n_unmatched,
            c.n_unobserved,
            c.n_too_low,
            self.min_truth_height_m,
            c.n_without_truth,
            c.n_results_unmatched,
            c.n_results
        )?;
        let Some(all) = &self.all else { return writeln!(f, "  nothing left to compare") };
        let groups = self.by_status.iter().chain(&self.by_group).chain(&self.by_height).chain(&self.by_area);
        let width = groups.clone().map(|g| g.group.chars().count()).max().unwrap_or(0).max(10);
        writeln!(f)?;
        writeln!(
            f,
            "{:width$} {:>6} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7} {:>7} {:>8} {:>8}",
            "", "n", "mean m", "median m", "P90 m", "RMSE m", "bias m", "<= 1 m", "<= 10 %", "acc avg", "acc 90 %"
        )?;
        row(f, "all", width, all)?;
        let has_several = |n: usize| n > 1;
        if has_several(self.by_status.len()) {
            self.by_status.iter().try_for_each(|g| row(f, &g.group, width, &g.statistics))?;
        }
        let by_kind_and_size = self.by_group.iter().chain(&self.by_height).chain(&self.by_area);
        by_kind_and_size.into_iter().try_for_each(|g| row(f, &g.group, width, &g.statistics))?;
        writeln!(f)?;
        if let (Some(one), Some(two)) = (all.within_1_sigma_share, all.within_2_sigma_share) {
            writeln!(
                f,
                "Stated sigma: {:.0} % of {} buildings within 1 sigma (68 % expected), {:.0} % within 2 (95 %)",
                100.0 * one,
                all.n_with_sigma,
                100.0 * two
            )?;
        }
        if all.n_accuracy_clamped > 0 {
            writeln!(
                f,
                "{} buildings are off by more than their own height (acc clamped to 0)",
                all.n_accuracy_clamped
            )?;
        }
        writeln!(
            f,
            "e = |h - h*|; h, h*: roof minus ground, result and reference; acc = max(0, 1 - e/h*); acc 90 %: reached by\n\
             90 % of the buildings (10th percentile); P90: 90th percentile of e, linear interpolation; RMSE: square root of\n\
             the mean of e^2; bias: mean of h - h*; <= 1 m, <= 10 %: share of buildings with e of at most 1 m, of 0.1 h*;\n\
             groups: status of the result, kind, h* and footprint area of the reference"
        )
    }
}

fn row(f: &mut fmt::Formatter<'_>, name: &str, width: usize, s: &HeightStatistics) -> fmt::Result {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    writeln!(
        f,
        "{name:width$} {:>6} {:>8.2} {:>8.2} {:>8.2} {:>8.2} {:>+8.2} {:>7} {:>7} {:>8} {:>8}",
        s.n,
        s.error_mean_m,
        s.error_median_m,
        s.error_p90_m,
        s.rmse_m,
        s.bias_m,
        percent(s.within_1m_share),
        percent(s.within_10pct_share),
        percent(s.accuracy_mean),
        percent(s.accuracy_90)
    )
}
