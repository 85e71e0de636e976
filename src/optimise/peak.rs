//! Whether a height is a peak of the score over the whole range of heights.
//!
//! ```text
//! S(h)              mean score over views, at heights over the full range
//! fall to an end    S(h) − S(end)
//! lead              S(h) − max S(x) over all x that are not the same answer as h: |x − h| > SAME_M + SAME_SHARE · h
//! ```
//!
//! Local sweeps look at a short stretch in small windows, and find a best height in it whatever lies beyond. A score that does not
//! fall towards an end of the range has no peak that could be told from "as high as you let me".

/// Heights closer than this are the same answer: a fixed part, metres, and a share of the height.
const SAME_M: f32 = 2.0;
const SAME_SHARE: f32 = 0.25;

/// Heights over the full range, ascending, metres, and the mean score of each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Curve(pub Vec<(f32, f64)>);

impl Curve {
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

    /// By how much the score is better than at every other answer, and the height of the best of these, metres.
    pub fn lead(&self, height_m: f32) -> Option<(f64, f32)> {
        let is_other = |h: f32| (h - height_m).abs() > SAME_M + SAME_SHARE * height_m;
        let others = self.0.iter().filter(|(h, _)| is_other(*h));
        let (other_m, other) = others.copied().reduce(|best, next| if next.1 > best.1 { next } else { best })?;
        Some((self.at(height_m)? - other, other_m))
    }
}
