//! Resizing 8-bit pictures bit by bit as OpenCV does, because networks were fed by it.
//!
//! * Area: mean over the covered part of the source, for shrinking; `f32` sums in OpenCV's order, rounded half to even.
//! * Cubic: Keys' kernel with A = −0.75 over 4 × 4 pixels, border repeated, no smoothing when shrinking, rounded half to
//!   even. So do OpenCV's packages for x86 (through Intel's IPP); builds without IPP compute in fixed point of 11 bits
//!   and differ by one grey level in some 4 % of the values.
//! * Linear: two by two pixels, border repeated; on bytes in OpenCV's fixed point.

use sizeup_heights::raster::Raster;

/// Red, green and blue of a pixel.
pub type Rgb = [u8; 3];

/// Mean over areas (`INTER_AREA`): neither side may grow.
///
/// # Panics
/// If a side is 0.
#[must_use]
pub fn area(picture: &Raster<Rgb>, width: usize, height: usize) -> Raster<Rgb> {
    let (columns, rows) = (spans(picture.width(), width), spans(picture.height(), height));
    let mut pixels = Vec::with_capacity(width * height);
    for row in &rows {
        let mut sums = vec![[0.0_f32; 3]; width];
        for &(y, weight_y) in row {
            for (sum, column) in sums.iter_mut().zip(&columns) {
                let mut along_row = [0.0_f32; 3];
                for &(x, weight_x) in column {
                    for (total, channel) in along_row.iter_mut().zip(picture[(x, y)]) {
                        *total += f32::from(channel) * weight_x;
                    }
                }
                for (total, part) in sum.iter_mut().zip(along_row) {
                    *total += weight_y * part;
                }
            }
        }
        pixels.extend(sums.iter().map(|sum| sum.map(|v| v.round_ties_even().clamp(0.0, 255.0) as u8)));
    }
    Raster::from_vec(width, height, pixels).expect("one pixel per cell")
}

/// Source cells under each target cell, with their share (`computeResizeAreaTab`).
fn spans(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    const NEGLIGIBLE: f64 = 1e-3;
    let scale = from as f64 / to as f64;
    let span = |i: usize| {
        let (start, end) = (i as f64 * scale, i as f64 * scale + scale);
        let extent = scale.min(from as f64 - start);
        let last = (end.floor() as usize).min(from - 1);
        let first = (start.ceil() as usize).min(last);
        let mut cells = Vec::with_capacity(last - first + 2);
        if first as f64 - start > NEGLIGIBLE {
            cells.push((first - 1, ((first as f64 - start) / extent) as f32));
        }
        cells.extend((first..last).map(|x| (x, (1.0 / extent) as f32)));
        if end - last as f64 > NEGLIGIBLE {
            cells.push((last, ((end - last as f64).min(1.0).min(extent) / extent) as f32));
        }
        cells
    };
    (0..to).map(span).collect()
}

/// Cubic interpolation (`INTER_CUBIC`), growing or shrinking.
///
/// # Panics
/// If the picture has no pixels.
#[must_use]
pub fn cubic(picture: &Raster<Rgb>, width: usize, height: usize) -> Raster<Rgb> {
    let fractions = cubic_fractions(&picture.map(|pixel| pixel.map(f32::from)), width, height);
    fractions.map(|pixel| pixel.map(|v| v.round_ties_even().clamp(0.0, 255.0) as u8))
}

/// [`cubic`] of brightnesses that are fractions already, without rounding.
///
/// # Panics
/// If the picture has no pixels.
#[must_use]
pub fn cubic_fractions(picture: &Raster<[f32; 3]>, width: usize, height: usize) -> Raster<[f32; 3]> {
    let (columns, rows) = (taps(picture.width(), width), taps(picture.height(), height));
    let pixel = |row: &[Tap; 4], column: &[Tap; 4]| {
        let mut sum = [0.0_f32; 3];
        for tap_y in row {
            let mut along_row = [0.0_f32; 3];
            for tap_x in column {
                for (total, channel) in along_row.iter_mut().zip(picture[(tap_x.cell, tap_y.cell)]) {
                    *total += channel * tap_x.weight;
                }
            }
            for (total, part) in sum.iter_mut().zip(along_row) {
                *total += tap_y.weight * part;
            }
        }
        sum
    };
    let pixels = rows.iter().flat_map(|row| columns.iter().map(move |column| pixel(row, column))).collect();
    Raster::from_vec(width, height, pixels).expect("one pixel per cell")
}

/// Linear interpolation (`INTER_LINEAR`) in fixed point of 11 bits, growing or shrinking.
///
/// # Panics
/// If the picture has no pixels.
#[must_use]
pub fn linear(picture: &Raster<Rgb>, width: usize, height: usize) -> Raster<Rgb> {
    const ONE: f32 = 2048.0;
    let weights = |pair: &SourceCells| [1.0 - pair.fraction, pair.fraction].map(|w| (w * ONE).round_ties_even() as i32);
    let (columns, rows) = (pairs(picture.width(), width), pairs(picture.height(), height));
    let along_row = |row: usize, column: &SourceCells, c: usize| {
        let [here, next] = weights(column);
        i32::from(picture[(column.first, row)][c]) * here + i32::from(picture[(column.second, row)][c]) * next
    };
    let pixel = |row: &SourceCells, column: &SourceCells| {
        let [here, next] = weights(row);
        std::array::from_fn(|c| {
            let part = |row: usize, weight: i32| (weight * (along_row(row, column, c) >> 4)) >> 16;
            ((part(row.first, here) + part(row.second, next) + 2) >> 2).clamp(0, 255) as u8
        })
    };
    let pixels = rows.iter().flat_map(|row| columns.iter().map(move |column| pixel(row, column))).collect();
    Raster::from_vec(width, height, pixels).expect("one pixel per cell")
}

/// Linear interpolation of brightnesses, pixel centres kept, no smoothing (`PyTorch`'s `interpolate`).
///
/// # Panics
/// If the picture has no pixels.
#[must_use]
pub fn linear_fractions(picture: &Raster<[f32; 3]>, width: usize, height: usize) -> Raster<[f32; 3]> {
    let (columns, rows) = (pairs(picture.width(), width), pairs(picture.height(), height));
    let between = |a: f32, b: f32, t: f32| a * (1.0 - t) + b * t;
    let pixel = |row: &SourceCells, column: &SourceCells| {
        std::array::from_fn(|c| {
            let along = |row: usize| {
                between(picture[(column.first, row)][c], picture[(column.second, row)][c], column.fraction)
            };
            between(along(row.first), along(row.second), row.fraction)
        })
    };
    let pixels = rows.iter().flat_map(|row| columns.iter().map(move |column| pixel(row, column))).collect();
    Raster::from_vec(width, height, pixels).expect("one pixel per cell")
}

/// The two source cells of a target cell, and how far it lies towards the second.
#[derive(Debug, Clone, Copy)]
struct SourceCells {
    first: usize,
    second: usize,
    fraction: f32,
}

/// Pairs of each target cell, border repeated.
fn pairs(from: usize, to: usize) -> Vec<SourceCells> {
    let scale = from as f64 / to as f64;
    let pair = |i: usize| {
        let position = ((i as f64 + 0.5) * scale - 0.5).clamp(0.0, (from - 1) as f64) as f32;
        let first = (position.floor() as usize).min(from - 1);
        SourceCells { first, second: (first + 1).min(from - 1), fraction: position - first as f32 }
    };
    (0..to).map(pair).collect()
}

/// One of the four source cells of a target cell.
#[derive(Debug, Clone, Copy)]
struct Tap {
    cell: usize,
    weight: f32,
}

/// The four source cells of each target cell, border repeated.
fn taps(from: usize, to: usize) -> Vec<[Tap; 4]> {
    const A: f32 = -0.75;
    let scale = from as f64 / to as f64;
    let tap = |i: usize| {
        let position = ((i as f64 + 0.5) * scale - 0.5) as f32;
        let first = position.floor();
        let x = position - first;
        let w0 = ((A * (x + 1.0) - 5.0 * A) * (x + 1.0) + 8.0 * A) * (x + 1.0) - 4.0 * A;
        let w1 = ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0;
        let w2 = ((A + 2.0) * (1.0 - x) - (A + 3.0)) * (1.0 - x) * (1.0 - x) + 1.0;
        let weights = [w0, w1, w2, 1.0 - w0 - w1 - w2];
        let cell = |k: usize| (first + k as f32 - 1.0).clamp(0.0, (from - 1) as f32) as usize;
        std::array::from_fn(|k| Tap { cell: cell(k), weight: weights[k] })
    };
    (0..to).map(tap).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 23 × 17, the same formula as in the script that made the fixtures (`fixtures/README.md`).
    fn picture() -> Raster<Rgb> {
        let channel =
            |x: usize, y: usize, c: usize| ((x * x * 7 + y * 31 + x * y * 5 + c * 83 + (x ^ y) * 11) % 256) as u8;
        let pixels = (0..17).flat_map(|y| (0..23).map(move |x| std::array::from_fn(|c| channel(x, y, c))));
        Raster::from_vec(23, 17, pixels.collect()).unwrap()
    }

    fn assert_same(ours: &Raster<Rgb>, opencv: &[u8]) {
        let ours: Vec<u8> = ours.data().iter().flatten().copied().collect();
        assert_eq!(ours.len(), opencv.len());
        let worst = ours.iter().zip(opencv).map(|(a, b)| a.abs_diff(*b)).max();
        let n_off = ours.iter().zip(opencv).filter(|(a, b)| a != b).count();
        assert_eq!((worst, n_off), (Some(0), 0), "of {}", ours.len());
    }

    #[test]
    fn area_is_opencvs_to_the_bit() {
        assert_same(&area(&picture(), 14, 11), include_bytes!("../../../../../fixtures/resize/area_14x11.rgb"));
        assert_same(&area(&picture(), 23, 14), include_bytes!("../../../../../fixtures/resize/area_23x14.rgb"));
    }

    #[test]
    fn cubic_is_opencvs_to_the_bit() {
        assert_same(&cubic(&picture(), 42, 28), include_bytes!("../../../../../fixtures/resize/cubic_42x28.rgb"));
        assert_same(&cubic(&picture(), 28, 14), include_bytes!("../../../../../fixtures/resize/cubic_28x14.rgb"));
    }

    #[test]
    fn cubic_of_fractions_is_opencvs_within_rounding() {
        let fractions = picture().map(|pixel| pixel.map(|v| f32::from(v) / 255.0));
        let ours = cubic_fractions(&fractions, 28, 14);
        let opencv = include_bytes!("../../../../../fixtures/resize/cubic_28x14.f32");
        let opencv = opencv.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let worst = ours.data().iter().flatten().zip(opencv).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-6, "{worst}");
    }
}
