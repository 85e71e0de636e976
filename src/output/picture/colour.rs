//! Colours: perceptually even maps and a few fixed ones.
//!
//! The maps are matplotlib's viridis and magma (S. van der Walt, N. Smith; CC0), sampled at eleven places.

/// Red, green, blue; sRGB.
pub type Rgb = [u8; 3];

/// Paper.
pub const WHITE: Rgb = [255, 255, 255];
/// Text and outlines.
pub const INK: Rgb = [38, 38, 46];
/// Secondary text, frames.
pub const GREY: Rgb = [125, 125, 132];
/// Where there is no value.
pub const NO_VALUE: Rgb = [214, 214, 218];
/// What deserves a second look (readable beside viridis for all kinds of colour vision).
pub const ALERT: Rgb = [213, 94, 0];

const VIRIDIS: [Rgb; 11] = [
    [68, 1, 84],
    [72, 36, 117],
    [65, 68, 135],
    [53, 95, 141],
    [42, 120, 142],
    [33, 145, 140],
    [34, 168, 132],
    [68, 191, 112],
    [122, 209, 81],
    [189, 223, 38],
    [253, 231, 37],
];

const MAGMA: [Rgb; 11] = [
    [0, 0, 4],
    [20, 14, 54],
    [59, 15, 112],
    [100, 26, 128],
    [140, 41, 129],
    [183, 55, 121],
    [222, 73, 104],
    [247, 112, 92],
    [254, 159, 109],
    [254, 207, 146],
    [252, 253, 191],
];

/// A colour map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColourMap {
    /// Dark violet to yellow: heights.
    Viridis,
    /// Pale yellow (near) to black (far): depths.
    MagmaReversed,
}

impl ColourMap {
    /// The colour at `t`, clamped to 0 to 1.
    #[must_use]
    pub fn at(self, t: f64) -> Rgb {
        let (stops, t) = match self {
            Self::Viridis => (&VIRIDIS, t),
            Self::MagmaReversed => (&MAGMA, 1.0 - t),
        };
        let position = t.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
        let below = (position.floor() as usize).min(stops.len() - 2);
        let share = position - below as f64;
        std::array::from_fn(|c| {
            let (a, b) = (f64::from(stops[below][c]), f64::from(stops[below + 1][c]));
            (a + (b - a) * share).round() as u8
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_get_steadily_lighter_or_darker() {
        let lightness = |[r, g, b]: Rgb| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
        for (map, sign) in [(ColourMap::Viridis, 1.0), (ColourMap::MagmaReversed, -1.0)] {
            let values: Vec<f64> = (0..=100).map(|i| lightness(map.at(f64::from(i) / 100.0))).collect();
            assert!(values.windows(2).all(|w| sign * (w[1] - w[0]) > -0.5), "{map:?}");
        }
    }
}
