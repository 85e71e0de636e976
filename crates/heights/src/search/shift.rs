//! What shifts on the map are measured with, of a layer as of [single footprints](super::footprint_shift): a peak of
//! scores over places, and views from all around.

use glam::{DVec2, DVec3};

use crate::stats::parabola_peak;

/// Longest mean of the directions that a building is seen from, as unit vectors on the map: 0 from all sides, 1 from one.
const MOST_ONE_SIDED: f64 = 0.5;

/// A search for a peak of scores, in rounds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PeakSearch {
    /// Ways that it may take, unit vectors.
    pub axes: &'static [DVec3],
    /// Distance of the places that are compared, metres.
    pub step_m: f64,
    /// Share of a step within which it has come to rest.
    pub at_rest: f64,
    pub max_rounds: usize,
}

impl PeakSearch {
    /// The scores around a place near their peak, and the place; `None` where the search does not come to rest.
    pub fn run(self, mut scores: impl FnMut(DVec3) -> Vec<f64>) -> Option<(DVec3, Cross)> {
        let (mut at, mut before, mut reach_m) = (DVec3::ZERO, DVec3::ZERO, self.step_m);
        for _ in 0..self.max_rounds {
            let cross = Cross::around(at, self, &mut scores);
            let way = cross.to_peak(|_| true);
            if way.length() < self.at_rest * self.step_m {
                return Some((at, cross));
            }
            // Back where it came from: between the two, in shorter steps.
            if way.dot(before) < 0.0 {
                reach_m *= 0.5;
            }
            before = way.clamp_length_max(reach_m);
            at += before;
        }
        None
    }
}

/// Scores at a place and at two places along each axis.
pub(crate) struct Cross {
    step_m: f64,
    axes: &'static [DVec3],
    middle: Vec<f64>,
    arms: Vec<[Vec<f64>; 2]>,
}

impl Cross {
    fn around(at: DVec3, search: PeakSearch, mut scores: impl FnMut(DVec3) -> Vec<f64>) -> Self {
        let PeakSearch { axes, step_m, .. } = search;
        let middle = scores(at);
        let arms = axes.iter().map(|axis| [-step_m, step_m].map(|step| scores(at + step * *axis))).collect();
        Self { step_m, axes, middle, arms }
    }

    /// Way from the middle to the peak, a step along each axis at most, by the scores that are kept.
    pub fn to_peak(&self, is_kept: impl Fn(usize) -> bool) -> DVec3 {
        let total = |scores: &[f64]| -> f64 {
            scores.iter().enumerate().filter(|(i, _)| is_kept(*i)).map(|(_, score)| score).sum()
        };
        let at = total(&self.middle);
        let along = |[before, after]: &[Vec<f64>; 2]| {
            let (before, after) = (total(before), total(after));
            if before - 2.0 * at + after >= 0.0 {
                // No peak here: uphill.
                return self.step_m * (after - before).signum();
            }
            parabola_peak(0.0, self.step_m, [before, at, after])
        };
        self.axes.iter().zip(&self.arms).map(|(axis, arms)| along(arms) * *axis).sum()
    }
}

/// At most `n` views, as evenly around as they come. A view comes with the horizontal way from the building to it.
pub(crate) fn evenly_around(views: impl Iterator<Item = (usize, DVec2)>, n: usize) -> Vec<usize> {
    let mut turned: Vec<(f64, usize)> = views.map(|(view, from)| (from.to_angle(), view)).collect();
    turned.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let n = turned.len().min(n);
    (0..n).map(|i| turned[i * turned.len() / n].1).collect()
}

/// Whether horizontal ways from a building to its views lead to all sides: from one side a shift would pass for another height.
pub(crate) fn lead_all_around(ways: &[DVec2]) -> bool {
    let sum: DVec2 = ways.iter().map(|way| way.normalize_or_zero()).sum();
    (sum / ways.len().max(1) as f64).length() <= MOST_ONE_SIDED
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole steps from one flank to the other never come to rest on a ridge that is narrower than they are.
    #[test]
    fn a_ridge_narrower_than_the_steps_is_found() {
        let (peak, along) = (DVec2::new(1.2, 2.4), DVec2::from_angle(0.5));
        let score = |d: DVec3| {
            let off = d.truncate() - peak;
            -(off.dot(along) / 0.4).powi(2) - (off.dot(along.perp()) / 2.0).powi(2)
        };
        let search = PeakSearch { axes: &[DVec3::X, DVec3::Y], step_m: 1.0, at_rest: 0.5, max_rounds: 12 };
        let (around, cross) = search.run(|d| vec![score(d)]).expect("it comes to rest");
        let found = (around + cross.to_peak(|_| true)).truncate();
        assert!(found.distance(peak) < 0.6, "{found}");
    }

    #[test]
    fn views_are_taken_evenly_around_and_one_side_is_not_all_around() {
        let ring: Vec<(usize, DVec2)> = (0..12).map(|i| (i, DVec2::from_angle(f64::from(i as u32) - 3.0))).collect();
        let ways: Vec<DVec2> = ring.iter().map(|(_, way)| 80.0 * *way).collect();
        assert!(lead_all_around(&ways) && !lead_all_around(&ways[..3]));
        let taken = evenly_around(ring.into_iter(), 4);
        let mut turns: Vec<f64> = taken.iter().map(|&i| ways[i].to_angle()).collect();
        turns.sort_by(f64::total_cmp);
        assert!(taken.len() == 4 && turns.windows(2).all(|pair| pair[1] - pair[0] > 1.0), "{turns:?}");
    }
}
