//! Colours: perceptually even maps and a few fixed ones.
//!
//! The maps are matplotlib's viridis and magma (S. van der Walt, N. Smith; CC0), sampled at eleven places.

use std::sync::LazyLock;

use serde::Deserialize;

/// Red, green, blue; sRGB.
pub type Rgb = [u8; 3];

/// White, the colour of the paper.
pub const WHITE: Rgb = [255, 255, 255];
/// Nearly black, for text and borders.
pub const INK: Rgb = [38, 38, 46];
/// Grey, for secondary text and frames.
pub const GREY: Rgb = [125, 125, 132];
/// Colour of no value.
pub const NO_VALUE: Rgb = [214, 214, 218];
/// Colour of what deserves a second look (readable beside viridis for all kinds of colour vision).
pub const ALERT: Rgb = [213, 94, 0];

/// Colour of roof edges over a photo.
pub const ROOF: Rgb = [253, 231, 37];
/// Colour of a building's other edges.
pub const WALL: Rgb = [64, 190, 200];

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

/// Scale of colours for numbers from 0 to 1.
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

/// A class of heights and its colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightClass {
    /// Heights below this, metres; infinite for the last.
    pub below_m: f64,
    /// Colour of the class.
    pub colour: Rgb,
}

/// The classes of heights, the lowest first: the same in pictures, in the report, on the map in QGIS and in 3D Tiles, for
/// every city alike, so that a colour means one height wherever it is seen.
#[must_use]
pub fn height_classes() -> &'static [HeightClass] {
    static CLASSES: LazyLock<Vec<HeightClass>> = LazyLock::new(|| {
        let entries: Vec<ClassEntry> =
            serde_json::from_str(include_str!("../height_classes.json")).expect("our own file");
        let part = |colour: &str, at: usize| u8::from_str_radix(&colour[at..at + 2], 16).expect("#rrggbb");
        let class = |entry: ClassEntry| HeightClass {
            below_m: entry.below_m.unwrap_or(f64::INFINITY),
            colour: [1, 3, 5].map(|at| part(&entry.colour, at)),
        };
        entries.into_iter().map(class).collect()
    });
    &CLASSES
}

/// A class as its file has it.
#[derive(Deserialize)]
struct ClassEntry {
    below_m: Option<f64>,
    colour: String,
}

/// The colour of the class of a height.
#[must_use]
pub fn height_colour(height_m: f64) -> Rgb {
    let class = height_classes().iter().find(|class| height_m < class.below_m);
    class.map_or(NO_VALUE, |class| class.colour)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_have_the_colours_of_the_map_in_qgis() {
        let qml = include_str!("../geopackage/styles/buildings.qml");
        let mut low_m = 0.0;
        for class in height_classes() {
            let [r, g, b] = class.colour;
            let label = match (low_m, class.below_m) {
                (0.0, high_m) => format!("below {high_m} m"),
                (low_m, f64::INFINITY) => format!("{low_m} m and more"),
                (low_m, high_m) => format!("{low_m} to {high_m} m"),
            };
            assert!(qml.contains(&format!("label=\"{label}\"")), "{label}");
            assert!(qml.contains(&format!("value=\"{r},{g},{b},255\"")), "{label}");
            low_m = class.below_m;
        }
        assert_eq!((height_colour(2.9), height_colour(3.0)), ([0x44, 1, 0x54], [0x48, 0x28, 0x78]));
        assert_eq!(height_colour(f64::NAN), NO_VALUE);
    }

    #[test]
    fn low_blocks_and_towers_differ_alike() {
        let colours = [2.5, 5.6, 10.0, 12.0, 19.0, 25.0, 48.0, 70.0, 145.4].map(height_colour);
        assert!(colours.windows(2).all(|pair| pair[0] != pair[1]), "{colours:?}");
    }

    #[test]
    fn maps_get_steadily_lighter_or_darker() {
        let lightness = |[r, g, b]: Rgb| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
        for (map, sign) in [(ColourMap::Viridis, 1.0), (ColourMap::MagmaReversed, -1.0)] {
            let values: Vec<f64> = (0..=100).map(|i| lightness(map.at(f64::from(i) / 100.0))).collect();
            assert!(values.windows(2).all(|w| sign * (w[1] - w[0]) > -0.5), "{map:?}");
        }
    }
}
