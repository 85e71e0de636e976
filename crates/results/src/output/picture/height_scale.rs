//! The colours of heights: from the ground to the highest that is shown, none left out.
//!
//! ```text
//! t(h) = h / top             where the highest is at most 2.5 times the median
//! t(h) = √(h / top)          above, so that one tower does not flatten the town
//! ```

use super::colour::{ColourMap, Rgb};
use super::scale;
use sizeup_heights::stats;

/// A highest above this multiple of the median takes the square root.
const EVEN_MEDIANS: f64 = 2.5;
/// Ticks over the range, about.
const N_TICKS: usize = 6;

/// What colours span, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightScale {
    top_m: f64,
    is_root: bool,
}

impl HeightScale {
    /// Of the heights that are shown; to 1 m without any.
    #[must_use]
    pub fn of(heights_m: &[f64]) -> Self {
        let highest_m = heights_m.iter().copied().fold(1.0, f64::max);
        let median_m = stats::median(heights_m).unwrap_or(highest_m);
        let step_m = scale::step(0.0, highest_m, N_TICKS);
        Self { top_m: (highest_m / step_m).ceil() * step_m, is_root: highest_m > EVEN_MEDIANS * median_m }
    }

    /// How far up the colours a height is, 0 to 1.
    #[must_use]
    pub fn share(self, height_m: f64) -> f64 {
        let share = (height_m / self.top_m).clamp(0.0, 1.0);
        if self.is_root { share.sqrt() } else { share }
    }

    /// The colour of a height.
    #[must_use]
    pub fn colour(self, height_m: f64) -> Rgb {
        ColourMap::Viridis.at(self.share(height_m))
    }

    /// Round heights with their labels; where low ones have more room, more of them.
    pub(super) fn ticks(self) -> Vec<(f64, String)> {
        let step_m = scale::step(0.0, self.top_m, N_TICKS);
        let low = [0.2 * step_m, 0.4 * step_m].into_iter().filter(|_| self.is_root);
        let label = |tick: f64| (tick, scale::label(tick, if tick < 0.9 * step_m { 0.2 * step_m } else { step_m }));
        low.chain(scale::ticks(0.0, self.top_m, N_TICKS)).map(label).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_tell_all_heights_apart_that_are_shown() {
        let town = [5.6, 10.0, 12.0, 12.0, 19.0, 19.0, 6.0, 48.0, 145.4];
        let scale = HeightScale::of(&town);
        assert_eq!(scale.top_m, 160.0);
        assert!(scale.share(145.4) - scale.share(48.0) > 0.3, "a tower of 145 m looks like none of 48 m");
        assert!(scale.share(19.0) - scale.share(5.6) > 0.1, "and low blocks still differ");
        let even = HeightScale::of(&town[..6]);
        assert_eq!((even.top_m, even.share(10.0)), (20.0, 0.5));
        assert_eq!(HeightScale::of(&[]).share(3.0), 1.0);
    }
}
