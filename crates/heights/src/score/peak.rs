//! Whether a height is a peak of the score over the whole range of heights.
//!
//! ```text
//! S(h)              mean score over views, at heights over the full range
//! fall to an end    S(h) − S(end)
//! lead              S(h) − max S(x) over all x that are not the same answer as h: |x − h| > SAME_M + SAME_SHARE · h
//! ```
//!
//! Local sweeps look at a short interval in small windows, and find a best height in it whatever lies beyond. A score that does not
//! fall towards an end of the range has no peak that could be told from "as high as you let me".

/// Heights closer than this are the same answer: a fixed part, metres, and a share of the height.
const SAME_M: f32 = 2.0;
const SAME_SHARE: f32 = 0.25;

/// Distance from a height at which another answer begins, metres.
pub(crate) fn reach_m(height_m: f32) -> f32 {
    SAME_M + SAME_SHARE * height_m
}

/// Heights over the full range, ascending, metres, and the mean score of each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScoreCurve(pub Vec<(f32, f64)>);

impl ScoreCurve {
    /// The score at a height: the better one of the two tried heights around it, as a peak may lie between them.
    fn at(&self, height_m: f32) -> Option<f64> {
        let above = self.0.partition_point(|(h, _)| *h < height_m);
        let around = [above.checked_sub(1), Some(above)].into_iter().flatten().filter_map(|i| self.0.get(i));
        around.map(|(_, score)| *score).reduce(f64::max)
    }

    /// By how much the score falls from a height to the greatest one.
    pub fn fall_to_top(&self, height_m: f32) -> Option<f64> {
        Some(self.at(height_m)? - self.0.last()?.1)
    }

    /// Whether a height is within the last step of the range.
    pub fn is_at_top(&self, height_m: f32) -> bool {
        self.0.len() > 1 && height_m > self.0[self.0.len() - 2].0
    }

    /// By how much the score is better than at every other answer.
    pub fn lead(&self, height_m: f32) -> Option<f64> {
        let is_other = |h: f32| (h - height_m).abs() > reach_m(height_m);
        let others = self.0.iter().filter(|(h, _)| is_other(*h));
        let other = others.map(|(_, score)| *score).reduce(f64::max)?;
        Some(self.at(height_m)? - other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From 2 to 150 m, steps of a tenth.
    fn curve(score: impl Fn(f32) -> f64) -> ScoreCurve {
        let heights = (0..46).map(|i| 2.0 * 75.0_f32.powf(i as f32 / 45.0));
        ScoreCurve(heights.map(|h| (h, score(h))).collect())
    }

    #[test]
    fn a_peak_falls_to_the_top_and_leads_over_all_others() {
        let bump = |h: f32, at_m: f32| f64::from(1.0 / (1.0 + ((h - at_m) / (0.2 * at_m)).powi(2)));
        let peak = curve(|h| bump(h, 12.0));
        assert!(peak.fall_to_top(12.1).unwrap() > 0.8 && peak.lead(12.1).unwrap() > 0.3 && !peak.is_at_top(12.1));
        let rising = curve(|h| 0.25 + 0.08 * f64::from(h) / 150.0);
        assert!(rising.fall_to_top(145.4).unwrap() < 0.02 && rising.is_at_top(145.4), "as high as it was let");
        assert!(rising.fall_to_top(80.0).unwrap() < 0.0, "without a peak");
        let two = curve(|h| bump(h, 6.0).max(0.9 * bump(h, 40.0)));
        assert!(two.lead(6.0).unwrap() > 0.0 && two.lead(40.0).unwrap() < 0.0);
        let single = ScoreCurve::default();
        assert_eq!((single.fall_to_top(5.0), single.lead(5.0), single.is_at_top(5.0)), (None, None, false));
    }
}
