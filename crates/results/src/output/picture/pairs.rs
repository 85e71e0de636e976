//! Ordinal pairs over a photo: which pixels are compared, and which comparisons cost something.

use image::RgbImage;
use image::imageops::{FilterType, resize};

use super::canvas::{Align, Canvas, Pen};
use super::chart::SERIES_COLOURS;
use super::colour::{GREY, NO_VALUE};

/// One pair of pixels, in shares of the image's width and height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PicturedPair {
    /// The two pixels, in shares of the image's width and height.
    pub ends: [[f32; 2]; 2],
    /// Cost of the hinge: 0 is a pair in the right order by the margin.
    pub cost: f32,
}

/// Most pairs of either sort that are drawn: more would hide the photo.
const MOST_DRAWN: usize = 60;
/// Height of the caption and of the line below, pixels.
const CAPTION_PX: f32 = 74.0;
const FOOT_PX: f32 = 58.0;

/// The photo with its pairs, `width_px` wide, as high as a depth panel of that picture width.
#[must_use]
pub fn pairs_picture(photo: &RgbImage, pairs: &[PicturedPair], width_px: u32) -> RgbImage {
    let width = width_px.clamp(200, 4000);
    let height =
        (f64::from(width) * f64::from(photo.height()) / f64::from(photo.width().max(1))).round().max(1.0) as u32;
    let mut canvas = Canvas::new(width + 16, (CAPTION_PX + height as f32 + FOOT_PX) as u32);
    let mut pale = resize(photo, width, height, FilterType::Triangle);
    for pixel in pale.pixels_mut() {
        pixel.0 = pixel.0.map(|v| 128 + v / 2);
    }
    canvas.text("ordinal pairs", [0.0, 64.0], 17.0, GREY, Align::Left);
    canvas.picture(&pale, [0, CAPTION_PX as i32]);
    let active = pairs.iter().filter(|p| p.cost > 0.0);
    let settled = pairs.iter().filter(|p| p.cost <= 0.0);
    let at = |end: [f32; 2]| [end[0] * width as f32, CAPTION_PX + end[1] * height as f32];
    let mut draw = |pair: &PicturedPair, colour, opacity| {
        let [from, to] = pair.ends.map(at);
        canvas.line(&[from, to], Pen { colour, opacity, width_px: 1.3 });
        for end in [from, to] {
            canvas.disc(end, 2.2, colour, Pen::new(colour, 0.5));
        }
    };
    settled.clone().take(MOST_DRAWN).for_each(|pair| draw(pair, SERIES_COLOURS[0], 0.35));
    active.clone().take(MOST_DRAWN).for_each(|pair| draw(pair, SERIES_COLOURS[1], 0.8));
    let y = CAPTION_PX + height as f32 + 30.0;
    let mut x = 0.0;
    for (n, word, colour) in
        [(active.count(), "active", SERIES_COLOURS[1]), (settled.count(), "in order by the margin", SERIES_COLOURS[0])]
    {
        canvas.fill_rect([x, y - 9.0], [16.0, 6.0], colour);
        let text = format!("{n} {word}");
        canvas.text(&text, [x + 22.0, y], 14.0, GREY, Align::Left);
        x += 48.0 + canvas.text_width(&text, 14.0);
    }
    if pairs.is_empty() {
        canvas.text("no pair has a vote", [0.0, y], 14.0, NO_VALUE, Align::Left);
    }
    canvas.into_image()
}

/// Two pictures side by side, top-aligned on white.
#[must_use]
pub fn beside(left: &RgbImage, right: &RgbImage) -> RgbImage {
    let size = (left.width() + right.width(), left.height().max(right.height()));
    let mut both = RgbImage::from_pixel(size.0, size.1, image::Rgb([255; 3]));
    image::imageops::replace(&mut both, left, 0, 0);
    image::imageops::replace(&mut both, right, i64::from(left.width()), 0);
    both
}
