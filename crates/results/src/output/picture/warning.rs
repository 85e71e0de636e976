//! A band across a picture that says what is wrong with what it shows.

use image::RgbImage;

use super::canvas::{Align, Canvas};
use super::colour::{ALERT, WHITE};

/// Size of the text in a picture of 1600 px across, pixels.
const TEXT_PX: f32 = 18.0;
/// Height of a line, in sizes of the text.
const LINE: f32 = 1.6;

/// Draws sentences in a band at a place, from the top down; text that is too long for it ends with dots.
pub(super) fn band(canvas: &mut Canvas, [left, top]: [f32; 2], width: f32, sentences: &[String]) {
    let size = TEXT_PX * canvas.width() / 1600.0;
    if sentences.is_empty() {
        return;
    }
    canvas.fill_rect([left, top], [width, LINE * size * sentences.len() as f32], ALERT);
    for (i, sentence) in sentences.iter().enumerate() {
        let mut text = format!("Implausible: {sentence}");
        while canvas.text_width(&text, size) > width - 2.0 * size && text.chars().count() > 4 {
            text = text.chars().take(text.chars().count() - 4).collect::<String>() + "...";
        }
        let baseline = top + size * (LINE * i as f32 + 1.15);
        canvas.text(&text, [left + size, baseline], size, WHITE, Align::Left);
    }
}

/// A picture with a band of sentences across its top; the same without any.
#[must_use]
pub fn warned(picture: RgbImage, sentences: &[String]) -> RgbImage {
    if sentences.is_empty() {
        return picture;
    }
    let mut canvas = Canvas::new(picture.width(), picture.height());
    canvas.picture(&picture, [0, 0]);
    let width = canvas.width();
    band(&mut canvas, [0.0, 0.0], width, sentences);
    canvas.into_image()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_stands_over_the_picture_and_only_if_there_is_something_to_say() {
        let picture = RgbImage::from_pixel(800, 400, image::Rgb([10, 20, 30]));
        assert_eq!(warned(picture.clone(), &[]), picture);
        let long = "many heights ".repeat(40);
        let warned = warned(picture, &[long, "short".to_owned()]);
        assert_eq!((warned.get_pixel(1, 1).0, warned.get_pixel(1, 399).0), (ALERT, [10, 20, 30]));
    }
}
