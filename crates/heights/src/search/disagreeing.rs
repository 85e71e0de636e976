//! Views whose prior does not show what stands there: a prior of another photo, or a photo with a wrong pose.
//!
//! ```text
//! s_k    median over the buildings measured in view k of ρ_k at their heights: what all views agree on, a view that shows something
//!        else does not
//! s      upper quartile of s_k over views: what a view that fits has, even where most do not
//! k disagrees where s ≥ CLEAR, three quarters of its buildings have less than SHARE · s, and s_k < m − DEVIATIONS · σ
//! m, σ   median and spread of the views with s_k ≥ SHARE · s
//! ```
//!
//! The ground does not tell: in all oblique photos it gets farther up the image, in those of one flight by the same.

use serde::{Deserialize, Serialize};

use crate::stats;

/// Fewer buildings than this do not tell whether a view fits.
const MIN_BUILDINGS: usize = 3;
/// Fewer views than this do not tell what is usual.
const MIN_VIEWS: usize = 4;
/// Where the better views fit worse than this, none is singled out.
const CLEAR: f64 = 0.5;
/// Share of what the better views have below which most buildings of a view have to be for it to disagree.
const SHARE: f64 = 0.5;
/// Standard deviations of the others by which it falls short of them then: priors of one kind are not all as good.
const DEVIATIONS: f64 = 4.0;

/// A view whose prior does not fit its pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DisagreeingView {
    /// Position of the view in the survey.
    pub view: usize,
    /// Correlation of its prior with the depth of the buildings as found, median over these, −1 to 1.
    pub correlation: f64,
    /// The same of views that fit.
    pub usual: f64,
    /// Number of buildings.
    pub n_buildings: usize,
}

/// The views that disagree with the others, by each view's scores of the buildings that it measures.
pub(crate) fn disagreeing(scores: &[Vec<f64>]) -> Vec<DisagreeingView> {
    let judged = scores.iter().enumerate().filter(|(_, of_view)| of_view.len() >= MIN_BUILDINGS);
    let fits: Vec<(usize, f64)> = judged.filter_map(|(view, of_view)| Some((view, stats::median(of_view)?))).collect();
    let usual = stats::quantile(&fits.iter().map(|(_, fit)| *fit).collect::<Vec<_>>(), 0.75).unwrap_or(0.0);
    if fits.len() < MIN_VIEWS || usual < CLEAR {
        return Vec::new();
    }
    let fitting: Vec<f64> = fits.iter().map(|(_, fit)| *fit).filter(|fit| *fit >= SHARE * usual).collect();
    let middle = stats::median(&fitting).unwrap_or(usual);
    let deviations: Vec<f64> = fitting.iter().map(|fit| (fit - middle).abs()).collect();
    let spread = stats::SIGMA_PER_MAD * stats::median(&deviations).unwrap_or(0.0);
    // Where heights are wrong, as of towers on podiums that are not told apart yet, some buildings fit badly in a view that is right.
    let is_low = |view: usize| stats::quantile(&scores[view], 0.75).is_some_and(|most| most < SHARE * usual);
    let disagree = fits.into_iter().filter(|(view, fit)| *fit < middle - DEVIATIONS * spread && is_low(*view));
    let told = |(view, correlation)| DisagreeingView { view, correlation, usual, n_buildings: scores[view].len() };
    disagree.map(told).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_fit_far_worse_than_others_disagree_and_only_these() {
        let of = |fits: &[f64]| -> Vec<usize> {
            let scores: Vec<Vec<f64>> = fits.iter().map(|fit| vec![fit - 0.3, *fit, *fit, fit + 0.1]).collect();
            disagreeing(&scores).iter().map(|found| found.view).collect()
        };
        assert_eq!(of(&[0.8, 0.1, 0.75, -0.2, 0.7, 0.0]), [1, 3, 5], "half of them");
        assert_eq!(of(&[0.8, 0.5, 0.75, 0.6, 0.3, 0.45]), Vec::<usize>::new(), "priors of different quality");
        let podiums = vec![vec![0.1, 0.1, 0.1, 0.8, 0.8], vec![0.8; 9], vec![0.8; 9], vec![0.75; 9], vec![0.85; 9]];
        assert!(disagreeing(&podiums).is_empty(), "some buildings fit");
        assert_eq!(of(&[0.3, 0.1, 0.0, -0.2, 0.2, 0.0]), Vec::<usize>::new(), "none fits");
        assert_eq!(of(&[0.8, 0.1, 0.7]), Vec::<usize>::new(), "too few views");
        assert!(disagreeing(&[vec![0.0; 2], vec![0.8; 9], vec![0.8; 9], vec![0.8; 9], vec![0.8; 9]]).is_empty());
    }
}
