//! Pictures of a training: the losses as a curve, and what the network finds in a few photos.

use std::path::Path;

use candle_core::Tensor;
use image::{ExtendedColorType, Rgb, RgbImage};
use sizeup_heights::raster::Raster;

use super::sample::Scene;
use crate::TrainError;
use crate::dataset::make::write_png;

/// Size of the curve's picture and its margin, pixels.
const CURVE: (u32, u32, u32) = (640, 320, 24);
/// Photos in the overlay.
const SHOWN: usize = 4;
const TRAIN: Rgb<u8> = Rgb([70, 110, 200]);
const VAL: Rgb<u8> = Rgb([220, 120, 30]);
const AXIS: Rgb<u8> = Rgb([120, 120, 120]);
/// Truth, what was found, and what is near the edge of a roof.
const TRUTH: Rgb<u8> = Rgb([255, 255, 255]);
const FOUND: Rgb<u8> = Rgb([255, 60, 20]);
const RIM: Rgb<u8> = Rgb([40, 240, 240]);

/// Whether a photo is in the overlay: some, spread over all.
pub(super) fn is_shown(i: usize, n: usize) -> bool {
    let step = n.div_ceil(SHOWN).max(1);
    i.is_multiple_of(step)
}

/// Draws the log's losses: of training in blue, of validation in orange; from 0 up.
pub(super) fn curve(log: &str, path: &Path) -> Result<(), TrainError> {
    let rows: Vec<Vec<f64>> =
        log.lines().skip(1).map(|l| l.split(',').filter_map(|v| v.parse().ok()).collect()).collect();
    let (width, height, margin) = CURVE;
    let mut picture = RgbImage::from_pixel(width, height, Rgb([255, 255, 255]));
    let last = rows.last().and_then(|r| r.first()).copied().unwrap_or(1.0);
    let top = rows.iter().flat_map(|r| r.iter().skip(2).take(2)).copied().fold(1e-9, f64::max);
    let at = |step: f64, value: f64| {
        let (w, h) = (f64::from(width - 2 * margin), f64::from(height - 2 * margin));
        (f64::from(margin) + w * step / last, f64::from(height - margin) - h * value / top)
    };
    line(&mut picture, at(0.0, 0.0), at(last, 0.0), AXIS);
    line(&mut picture, at(0.0, 0.0), at(0.0, top), AXIS);
    // A tick for each 0.5.
    (1..=(top / 0.5) as usize).for_each(|i| {
        let (x, y) = at(0.0, 0.5 * i as f64);
        line(&mut picture, (x - 5.0, y), (x, y), AXIS);
    });
    for pair in rows.windows(2).filter(|p| p.iter().all(|r| r.len() == 5)) {
        for (column, colour) in [(2, TRAIN), (3, VAL)] {
            line(&mut picture, at(pair[0][0], pair[0][column]), at(pair[1][0], pair[1][column]), colour);
        }
    }
    write_png(path, picture.as_raw(), (width, height), ExtendedColorType::Rgb8)
}

fn line(picture: &mut RgbImage, from: (f64, f64), to: (f64, f64), colour: Rgb<u8>) {
    let n = (to.0 - from.0).abs().max((to.1 - from.1).abs()).ceil().max(1.0);
    for i in 0..=n as usize {
        let share = i as f64 / n;
        let (x, y) = (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1));
        if x >= 0.0 && y >= 0.0 && x < f64::from(picture.width()) && y < f64::from(picture.height()) {
            picture.put_pixel(x as u32, y as u32, colour);
        }
    }
}

/// Photos one above the other: footprints on the ground in white, what is found in red, edges of roofs as found in cyan.
/// `shown`: photos, how many of their pixels a pixel of the logits is wide, and the logits.
pub(super) fn overlays(shown: &[(&Scene, f64, Tensor)], path: &Path) -> Result<(), TrainError> {
    let mut rows = Vec::new();
    let mut size = (0, 0);
    for (scene, zoom, logits) in shown {
        let (_, _, height, width) = logits.dims4()?;
        if scene.photo.size.0 < width || scene.photo.size.1 < height || (size != (0, 0) && size.0 != width) {
            // Features at another size than the photo, or photos of different widths: the first kind is shown.
            continue;
        }
        let map = |channel: usize| -> Result<Raster<bool>, TrainError> {
            let values = logits.narrow(1, channel, 1)?.flatten_all()?.to_vec1::<f32>()?;
            Ok(Raster::from_vec(width, height, values.iter().map(|v| *v > 0.0).collect()).expect("one per pixel"))
        };
        let (found, roof, middle) = (map(0)?, map(1)?, map(2)?);
        let in_photo = |n: usize| ((n as f64 + 0.5) * zoom) as usize;
        let label = |i: usize| scene.photo.ground[(in_photo(i % width), in_photo(i / width))];
        let labels = Raster::from_vec(width, height, (0..width * height).map(label).collect()).expect("one per pixel");
        for row in 0..height {
            for col in 0..width {
                let grey = scene.photo.rgb[in_photo(row) * scene.photo.size.0 + in_photo(col)];
                let colour = if is_edge(&found, col, row) {
                    FOUND
                } else if is_edge(&labels, col, row) {
                    TRUTH
                } else if roof[(col, row)] && !middle[(col, row)] {
                    RIM
                } else {
                    Rgb(grey)
                };
                rows.extend(colour.0);
            }
        }
        size = (width, size.1 + height);
    }
    if size.1 == 0 {
        return Ok(());
    }
    write_png(path, &rows, (size.0 as u32, size.1 as u32), ExtendedColorType::Rgb8)
}

/// Whether the pixel to the right or below has another value.
fn is_edge<T: PartialEq>(map: &Raster<T>, col: usize, row: usize) -> bool {
    let here = &map[(col, row)];
    map.get(col + 1, row).is_some_and(|v| v != here) || map.get(col, row + 1).is_some_and(|v| v != here)
}
