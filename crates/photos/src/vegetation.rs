//! What is as green as leaves in a photo, by the excess green index (Woebbecke and others, 1995).
//!
//! ```text
//! ExG = (2 G − R − B) / (R + G + B),    as green as leaves: ExG > 0.08 there, and at most of the pixels around it
//! ```
//!
//! In twelve real photos of a city on a hazy day the limit takes crowns, hedges and lawns, 19 % of the pixels, and of roofs and roads
//! hardly anything; in one of a wood beside a road 84 %. Bare trees, red maples and leaves in deep shade are not told; copper roofs,
//! green tiles and artificial turf are taken with the leaves: who uses this looks at how high the green stands.

use sizeup_geo::geodata::raster::{CellWindow, RasterError, RasterFile, Resampling};
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Excess green index from which a pixel is as green as leaves.
const LEAVES: f32 = 0.08;

/// Pixels of a view's photo, reduced to `long_side_px`, that are as green as leaves; `None` without a photo, or where it has no colour.
///
/// # Errors
/// [`RasterError`]: a photo that is not there or cannot be read.
pub fn green(view: &View, long_side_px: u32) -> Result<Option<Raster<bool>>, RasterError> {
    let Some(path) = view.image.as_deref() else { return Ok(None) };
    let file = RasterFile::open(path)?;
    if file.n_bands() < 3 {
        return Ok(None);
    }
    let (width, height) = file.size();
    let reduced = view.camera.reduced_to(long_side_px);
    let size = (reduced.width_px as usize, reduced.height_px as usize);
    let whole = CellWindow { col: 0, row: 0, width, height };
    let band = |i: usize| file.read_window(i, whole, size, Resampling::Average);
    let (red, green, blue) = (band(1)?, band(2)?, band(3)?);
    let colours = red.data().iter().zip(green.data()).zip(blue.data());
    let pixels = colours.map(|((r, g), b)| excess_green([*r, *g, *b]) > LEAVES).collect();
    Ok(Raster::from_vec(size.0, size.1, pixels).map(|green| without_specks(&green)))
}

/// Green pixels of which most neighbours are green: dark windows are any colour, one by one.
fn without_specks(green: &Raster<bool>) -> Raster<bool> {
    let at = |i: usize| {
        let (x, y) = (i % green.width(), i / green.width());
        let around = || {
            let rows = y.saturating_sub(1)..(y + 2).min(green.height());
            rows.flat_map(|row| (x.saturating_sub(1)..(x + 2).min(green.width())).map(move |col| (col, row)))
        };
        green[(x, y)] && 2 * around().filter(|&place| green[place]).count() > around().count()
    };
    let pixels = (0..green.data().len()).map(at).collect();
    Raster::from_vec(green.width(), green.height(), pixels).expect("as many pixels")
}

/// Excess green index of a colour, −1..2; `NaN` of black.
fn excess_green([red, green, blue]: [f32; 3]) -> f32 {
    (2.0 * green - red - blue) / (red + green + blue)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crown_stays_and_specks_go() {
        let green =
            |x: usize, y: usize| (4..8).contains(&x) && (2..6).contains(&y) || (x, y) == (12, 3) || (x, y) == (0, 0);
        let pixels = (0..16 * 8).map(|i| green(i % 16, i / 16)).collect();
        let kept = without_specks(&Raster::from_vec(16, 8, pixels).unwrap());
        let kept: Vec<(usize, usize)> = (0..16 * 8).filter(|&i| kept.data()[i]).map(|i| (i % 16, i / 16)).collect();
        // All but the corners of the crown.
        assert_eq!(kept.len(), 12, "{kept:?}");
        assert!(kept.iter().all(|&(x, y)| (4..8).contains(&x) && (2..6).contains(&y)), "{kept:?}");
    }

    /// Colours picked from real photos: leaves and lawns in sun, haze and shade; roofs, roads and walls.
    #[test]
    fn leaves_are_green_and_roofs_are_not() {
        for leaves in [[96.0, 121.0, 62.0], [52.0, 60.0, 38.0], [117.0, 139.0, 86.0], [30.0, 36.0, 27.0]] {
            assert!(excess_green(leaves) > LEAVES, "{leaves:?}: {}", excess_green(leaves));
        }
        for other in [[150.0, 146.0, 148.0], [70.0, 72.0, 66.0], [140.0, 62.0, 48.0], [222.0, 226.0, 231.0], [0.0; 3]] {
            assert!(excess_green(other).partial_cmp(&LEAVES) != Some(std::cmp::Ordering::Greater), "{other:?}");
        }
    }
}
