//! Photos that say little: blurred, burnt out, or dark. Looked at as small as matching looks at them, so that what is told is
//! what costs heights: a smear of two pixels in a photo of twelve megapixels is none in its reduced copy.
//!
//! *Sharpness* is the mean square of differences between neighbouring pixels by that between the means of 4 × 4 pixels, the
//! lesser of across and down. Of pictures of the ground it hangs little on what they show: twelve real photos over a city have
//! 0.32 to 0.50, four from 40 m 0.93 to 1.16; blurred by a Gaussian of 1 pixel 0.13 to 0.18, of 2 pixels 0.08, smeared over 7
//! pixels along a row 0.10 to 0.15. What is perfectly smooth has 1/16.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use sizeup_geo::geodata::raster::{CellWindow, RasterError, RasterFile, Resampling};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::raster::Raster;
use sizeup_heights::stats;
use sizeup_survey::View;

/// Codes of what is told.
pub const CODES: [&str; 3] = ["photo_blurred", "photo_overexposed", "photo_underexposed"];
/// Longer side of the copy that is looked at, pixels: what stereo works on unless it is told otherwise.
const LONG_SIDE_PX: u32 = 672;
/// Less sharp is blurred, whatever the flight.
const BLURRED: f64 = 0.18;
/// Less sharp is blurred where the flight's photos are mostly sharper by so much.
const LESS_SHARP: f64 = 0.25;
const THAN_THE_FLIGHT: f64 = 0.5;
/// Least brightness, of 255, that is burnt out, and greatest that is black. Nothing can be told apart there.
const WHITE: f32 = 250.0;
const BLACK: f32 = 5.0;
/// Share of a photo that may be so.
const LOST_SHARE: f64 = 0.25;

/// Quality of a photo by its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotoQuality {
    /// 1/16 (smooth) to 1 and more; `None` where there is nothing to tell it from.
    pub sharpness: Option<f64>,
    /// Share of pixels that are burnt out, 0 to 1; of photos with more than 8 bits 0.
    pub white_share: f64,
    /// Share that is black.
    pub black_share: f64,
}

impl PhotoQuality {
    /// Quality of a grey picture as small as it is matched. `has_bytes`: its samples are 0 to 255, so that white and black are known.
    #[must_use]
    pub fn of(grey: &Raster<f32>, has_bytes: bool) -> Self {
        let n = grey.data().len().max(1) as f64;
        let share = |is_lost: fn(f32) -> bool| {
            let n_lost = grey.data().iter().filter(|value| has_bytes && is_lost(**value)).count();
            n_lost as f64 / n
        };
        Self {
            sharpness: sharpness(grey),
            white_share: share(|value| value >= WHITE),
            black_share: share(|value| value <= BLACK),
        }
    }

    fn read(view: &View) -> Option<Result<Self, RasterError>> {
        let path = view.image.as_deref()?;
        let read = || {
            let file = RasterFile::open(path)?;
            let (width, height) = file.size();
            let long_side = width.max(height).max(1);
            let reduced = |side: usize| (side * (LONG_SIDE_PX as usize).min(long_side) / long_side).max(1);
            let whole = CellWindow { col: 0, row: 0, width, height };
            // Green, where there are colours.
            let band = if file.n_bands() >= 3 { 2 } else { 1 };
            let grey = file.read_window(band, whole, (reduced(width), reduced(height)), Resampling::Average)?;
            Ok(Self::of(&grey, file.sample_type(band)?.bits == 8))
        };
        Some(read())
    }
}

/// Mean square of differences between neighbours by that between means of 4 × 4 pixels, the lesser of across and down.
fn sharpness(grey: &Raster<f32>) -> Option<f64> {
    let coarse = halved(&halved(grey)?)?;
    let fine = differences(grey);
    let coarse = differences(&coarse);
    (coarse.iter().all(|square| *square > 0.0)).then(|| (fine[0] / coarse[0]).min(fine[1] / coarse[1]))
}

/// Mean squares of the differences to the right and downwards, where both are known.
fn differences(grey: &Raster<f32>) -> [f64; 2] {
    let rows = || grey.data().chunks_exact(grey.width());
    let mean = |pairs: &mut dyn Iterator<Item = (f32, f32)>| {
        let squares = pairs.map(|(a, b)| f64::from(b - a).powi(2)).filter(|square| square.is_finite());
        let (n, sum) = squares.fold((0, 0.0), |(n, sum), square| (n + 1, sum + square));
        if n == 0 { 0.0 } else { sum / f64::from(n) }
    };
    let across = mean(&mut rows().flat_map(|row| row.windows(2)).map(|pair| (pair[0], pair[1])));
    let down = mean(&mut rows().zip(rows().skip(1)).flat_map(|(a, b)| a.iter().copied().zip(b.iter().copied())));
    [across, down]
}

fn halved(grey: &Raster<f32>) -> Option<Raster<f32>> {
    let (width, height) = (grey.width() / 2, grey.height() / 2);
    let mean = |i: usize| {
        let (x, y) = (i % width * 2, i / width * 2);
        (grey[(x, y)] + grey[(x + 1, y)] + grey[(x, y + 1)] + grey[(x + 1, y + 1)]) / 4.0
    };
    if width == 0 || height == 0 {
        return None;
    }
    Raster::from_vec(width, height, (0..width * height).map(mean).collect())
}

/// Looks at all photos of a survey and names those that say little, in the survey's order. Photos that cannot be read are
/// told where they are wanted.
pub fn look(views: &[View], progress: &(dyn Fn(usize, usize) + Sync)) -> Vec<Issue> {
    let n_done = AtomicUsize::new(0);
    let looked_at = |view: &View| {
        let quality = PhotoQuality::read(view).and_then(Result::ok);
        progress(n_done.fetch_add(1, Ordering::Relaxed) + 1, views.len());
        quality
    };
    let qualities: Vec<Option<PhotoQuality>> = views.par_iter().map(looked_at).collect();
    judge(views, &qualities)
}

fn judge(views: &[View], qualities: &[Option<PhotoQuality>]) -> Vec<Issue> {
    let known: Vec<f64> = qualities.iter().flatten().filter_map(|quality| quality.sharpness).collect();
    let usual = stats::median(&known).unwrap_or(f64::INFINITY);
    views
        .iter()
        .zip(qualities)
        .flat_map(|(view, quality)| quality.iter().flat_map(|it| it.doubts(view, usual)))
        .collect()
}

impl PhotoQuality {
    /// Issues of a photo in a flight with a usual sharpness.
    fn doubts(&self, view: &View, usual: f64) -> impl Iterator<Item = Issue> {
        let told = |code: &str, message: String, hint: &str| {
            Issue::new(Severity::Warning, code, Subject::View(view.id.0.clone()), message).hint(hint)
        };
        let is_blurred =
            |sharpness: &f64| *sharpness < BLURRED || (*sharpness < LESS_SHARP && *sharpness < THAN_THE_FLIGHT * usual);
        let blurred = self.sharpness.filter(is_blurred).map(|sharpness| {
            let message = format!(
                "blurred by a pixel or more also when reduced to {LONG_SIDE_PX} pixels (sharpness {sharpness:.2}, below {BLURRED}; half of the \
                 flight's photos have {usual:.2} and more)"
            );
            told(CODES[0], message, "leave it out if others see the same place: it is matched badly, and tells less than it seems to")
        });
        let percent = |share: f64| format!("{:.0} % of it", 100.0 * share);
        let white = (self.white_share > LOST_SHARE).then(|| {
            let message = format!("{} is burnt out: nothing can be matched there", percent(self.white_share));
            told(CODES[1], message, "roofs that are white in all photos get no height from them")
        });
        let black = (self.black_share > LOST_SHARE).then(|| {
            let message = format!("{} is black: nothing can be matched there", percent(self.black_share));
            told(CODES[2], message, "was it taken on the ground, or with the lens cap on?")
        });
        [blurred, white, black].into_iter().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rough at all scales, as the ground is: steps of blocks of 1, 2, 4 and 8 pixels, 0 to 255.
    fn ground() -> Raster<f32> {
        let noise = |x: usize, y: usize, k: usize| ((x * 7919 + y * 104_729 + x * y * 31 + k * 977) % 251) as f32;
        let at = |i: usize| {
            let (x, y) = (i % 160, i / 160);
            (0..4).map(|k| noise(x >> k, y >> k, k)).sum::<f32>() / 4.0
        };
        Raster::from_vec(160, 120, (0..160 * 120).map(at).collect()).unwrap()
    }

    /// Means over so many columns and rows from each pixel on.
    fn smeared(sharp: &Raster<f32>, cols: usize, rows: usize) -> Raster<f32> {
        let (width, height) = (sharp.width() - cols + 1, sharp.height() - rows + 1);
        let at = |i: usize| {
            let (x, y) = (i % width, i / width);
            let sum: f32 = (0..cols * rows).map(|k| sharp[(x + k % cols, y + k / cols)]).sum();
            sum / (cols * rows) as f32
        };
        Raster::from_vec(width, height, (0..width * height).map(at).collect()).unwrap()
    }

    #[test]
    fn a_smear_in_any_direction_is_seen_and_the_brightness_is_none() {
        let sharpness = |grey: &Raster<f32>| PhotoQuality::of(grey, true).sharpness.unwrap();
        let sharp = ground();
        assert!(sharpness(&sharp) > 2.0 * LESS_SHARP, "{}", sharpness(&sharp));
        for (cols, rows) in [(7, 1), (1, 7), (6, 6)] {
            let found = sharpness(&smeared(&sharp, cols, rows));
            assert!(found < BLURRED, "{cols} x {rows}: {found}");
        }
        let dim = Raster::from_vec(160, 120, sharp.data().iter().map(|v| 0.1 * v + 20.0).collect()).unwrap();
        assert!((sharpness(&dim) - sharpness(&sharp)).abs() < 1e-4);
    }

    #[test]
    fn what_is_burnt_out_or_black_is_counted_in_bytes_only() {
        let half = |value: f32| {
            let sharp = ground();
            let paint = |(i, v): (usize, &f32)| if i < 160 * 60 { value } else { 0.5 * v + 60.0 };
            Raster::from_vec(160, 120, sharp.data().iter().enumerate().map(paint).collect()).unwrap()
        };
        let [white, black] = [half(255.0), half(0.0)].map(|grey| PhotoQuality::of(&grey, true));
        assert_eq!([white.white_share, white.black_share, black.white_share, black.black_share], [0.5, 0.0, 0.0, 0.5]);
        assert_eq!(PhotoQuality::of(&half(255.0), false).white_share, 0.0);
    }

    #[test]
    fn a_picture_of_nothing_has_no_sharpness_and_no_data_do_no_harm() {
        let flat = Raster::from_vec(40, 30, vec![7.0; 1200]).unwrap();
        assert_eq!(PhotoQuality::of(&flat, true).sharpness, None);
        let tiny = Raster::from_vec(1, 1, vec![7.0]).unwrap();
        assert_eq!(PhotoQuality::of(&tiny, true).sharpness, None);
        let mut holes = ground().data().to_vec();
        (0..160 * 20).for_each(|i| holes[i] = f32::NAN);
        let holes = Raster::from_vec(160, 120, holes).unwrap();
        assert!(PhotoQuality::of(&holes, true).sharpness.unwrap() > 2.0 * LESS_SHARP);
    }
}
