//! Places of a photo that are easily found again: corners, spread over it.

use glam::DVec2;

use sizeup_heights::raster::Raster;

/// Half the side of the window in which gradients are summed, pixels.
const RADIUS: usize = 4;
/// Least clearness of a corner, grey levels² per pixel.
const LEAST_CLEARNESS: f32 = 2.0;
/// Every so many pixels are looked at.
const STRIDE_PX: usize = 2;

/// The clearest corner of each cell of a grid with so many cells a side: centres of pixels.
pub(super) fn corners(grey: &Raster<f32>, per_side: usize) -> Vec<DVec2> {
    let span = |i: usize, n: usize| [i * n / per_side, (i + 1) * n / per_side];
    let of_cell = |cell: usize| {
        let (cols, rows) = (span(cell % per_side, grey.width()), span(cell / per_side, grey.height()));
        clearest(grey, cols, rows, STRIDE_PX)
    };
    (0..per_side * per_side).filter_map(of_cell).collect()
}

/// The clearest corner within so many pixels of a place.
pub(super) fn corner_near(grey: &Raster<f32>, place: DVec2, reach_px: usize) -> Option<DVec2> {
    let span = |at: f64| {
        let at = at.max(0.0) as usize;
        [at.saturating_sub(reach_px), at + reach_px + 1]
    };
    clearest(grey, span(place.x), span(place.y), 1)
}

/// The clearest corner of a part of the photo: the first one of several.
fn clearest(grey: &Raster<f32>, cols: [usize; 2], rows: [usize; 2], stride: usize) -> Option<DVec2> {
    let border = RADIUS + 1;
    let inside = |[from, to]: [usize; 2], n: usize| from.max(border)..to.min(n.saturating_sub(border));
    let mut best: Option<(f32, DVec2)> = None;
    for row in inside(rows, grey.height()).step_by(stride) {
        for col in inside(cols, grey.width()).step_by(stride) {
            let clear = clearness(grey, col, row);
            if clear > best.map_or(LEAST_CLEARNESS, |best| best.0) {
                best = Some((clear, DVec2::new(col as f64 + 0.5, row as f64 + 0.5)));
            }
        }
    }
    best.map(|(_, place)| place)
}

/// The lesser eigenvalue of the mean gradient's square (Shi and Tomasi 1994): how much a patch says in both directions.
fn clearness(grey: &Raster<f32>, col: usize, row: usize) -> f32 {
    let width = grey.width();
    let [mut xx, mut xy, mut yy] = [0.0_f32; 3];
    for y in row - RADIUS..=row + RADIUS {
        let line = |y: usize| &grey.data()[y * width + col - RADIUS - 1..=y * width + col + RADIUS + 1];
        let (above, here, below) = (line(y - 1), line(y), line(y + 1));
        for x in 1..=2 * RADIUS + 1 {
            let (gx, gy) = (here[x + 1] - here[x - 1], below[x] - above[x]);
            (xx, xy, yy) = (xx + gx * gx, xy + gx * gy, yy + gy * gy);
        }
    }
    let n = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
    (0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt()) / n
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corner_of_a_bright_square_is_found_and_its_sides_are_not() {
        let bright = |i: usize| if i % 60 >= 30 && i / 60 >= 20 { 100.0 } else { 0.0 };
        let grey = Raster::from_vec(60, 40, (0..60 * 40).map(bright).collect()).unwrap();
        let found = corners(&grey, 1);
        assert_eq!(found.len(), 1);
        // Within half a window: it holds the corner all the same.
        assert!((found[0] - DVec2::new(30.0, 20.0)).abs().max_element() <= 5.0, "{found:?}");
        assert_eq!(corner_near(&grey, DVec2::new(45.0, 10.0), 3), None);
        assert!(corner_near(&grey, DVec2::new(33.0, 23.0), 6).is_some());
    }
}
