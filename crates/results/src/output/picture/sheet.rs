//! Contact sheets: buildings in the photos that show them, with lines drawn over.

use image::RgbImage;

use super::canvas::{Align, Canvas, Pen};
use super::colour::{GREY, INK, Rgb};
use super::overlay::Polyline;

/// A building on a contact sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetBuilding {
    /// Line above its photos.
    pub caption: String,
    /// Cut-outs of its photos.
    pub photos: Vec<SheetPhoto>,
}

/// A cut-out of a photo, with lines in its own pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetPhoto {
    /// The cut-out, [`SHEET_PHOTO_PX`] large.
    pub picture: RgbImage,
    /// Lines drawn over it; parts outside are cut off.
    pub lines: Vec<Polyline>,
    /// Line below it: the photo's name.
    pub name: String,
}

/// Size of a photo on a contact sheet, pixels.
pub const SHEET_PHOTO_PX: [u32; 2] = [320, 240];
/// Photos of a building, at most.
pub const SHEET_PHOTOS: usize = 3;

const COLUMNS: usize = 2;
const GAP_PX: f32 = 8.0;
const COLUMN_GAP_PX: f32 = 28.0;
const BORDER_PX: f32 = 24.0;
const TITLE_PX: f32 = 48.0;
const CAPTION_PX: f32 = 30.0;
const NAME_PX: f32 = 22.0;

/// Draws buildings in two columns, read by rows, with a key (`label`, `colour`) beside the title.
#[must_use]
pub fn contact_sheet(title: &str, key: &[(&str, Rgb)], buildings: &[SheetBuilding]) -> RgbImage {
    let [photo_width, photo_height] = SHEET_PHOTO_PX.map(|n| n as f32);
    let column = SHEET_PHOTOS as f32 * photo_width + (SHEET_PHOTOS - 1) as f32 * GAP_PX;
    let row = CAPTION_PX + photo_height + NAME_PX;
    let n_rows = buildings.len().div_ceil(COLUMNS).max(1);
    let width = 2.0 * BORDER_PX + COLUMNS as f32 * column + (COLUMNS - 1) as f32 * COLUMN_GAP_PX;
    let mut canvas = Canvas::new(width as u32, (2.0 * BORDER_PX + TITLE_PX + n_rows as f32 * row) as u32);
    canvas.text(title, [BORDER_PX, BORDER_PX + 22.0], 22.0, INK, Align::Left);
    let mut x = width - BORDER_PX;
    for (label, colour) in key.iter().rev() {
        canvas.text(label, [x, BORDER_PX + 21.0], 16.0, INK, Align::Right);
        x -= canvas.text_width(label, 16.0) + 8.0;
        canvas.fill_rect([x - 30.0, BORDER_PX + 13.0], [30.0, 5.0], *colour);
        x -= 52.0;
    }
    for (i, building) in buildings.iter().enumerate() {
        let left = BORDER_PX + (i % COLUMNS) as f32 * (column + COLUMN_GAP_PX);
        let top = BORDER_PX + TITLE_PX + (i / COLUMNS) as f32 * row;
        canvas.text(&building.caption, [left, top + 20.0], 16.0, INK, Align::Left);
        for (k, photo) in building.photos.iter().take(SHEET_PHOTOS).enumerate() {
            let at = [left + k as f32 * (photo_width + GAP_PX), top + CAPTION_PX];
            canvas.picture(&with_lines(photo), at.map(|v| v as i32));
            canvas.text(&photo.name, [at[0], at[1] + photo_height + 14.0], 11.0, GREY, Align::Left);
        }
    }
    canvas.into_image()
}

/// A cut-out with its lines, all halos below all lines so that crossing edges stay readable.
fn with_lines(photo: &SheetPhoto) -> RgbImage {
    let mut canvas = Canvas::new(photo.picture.width(), photo.picture.height());
    canvas.picture(&photo.picture, [0, 0]);
    let placed: Vec<Vec<[f32; 2]>> =
        photo.lines.iter().map(|line| line.points_px.iter().map(|p| p.map(|v| v as f32)).collect()).collect();
    for points in &placed {
        canvas.line(points, Pen { colour: INK, opacity: 0.5, width_px: 3.2 });
    }
    for (points, line) in placed.iter().zip(&photo.lines) {
        canvas.line(points, Pen::new(line.colour, 1.6));
    }
    canvas.into_image()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb as Pixel;

    #[test]
    fn buildings_stand_in_two_columns_with_their_lines_over_their_photos() {
        let [width, height] = SHEET_PHOTO_PX;
        let yellow = [253, 231, 37];
        let photo = SheetPhoto {
            picture: RgbImage::from_pixel(width, height, Pixel([10, 90, 10])),
            lines: vec![Polyline { points_px: vec![[-50.0, 120.5], [400.0, 120.5]], colour: yellow }],
            name: "001.jpg".to_owned(),
        };
        let building = SheetBuilding { caption: "b1".to_owned(), photos: vec![photo] };
        let one = contact_sheet("Title", &[("result", yellow)], std::slice::from_ref(&building));
        let three = contact_sheet("Title", &[("result", yellow)], &vec![building; 3]);
        let row = (CAPTION_PX + height as f32 + NAME_PX) as u32;
        assert_eq!((three.width(), three.height()), (one.width(), one.height() + row), "two rows for three");
        let count = |sheet: &RgbImage, colour: [u8; 3]| sheet.pixels().filter(|p| p.0 == colour).count();
        // A line of 1.6 pixels has one row that is all of its colour; the key's is there once.
        let (in_one, in_three) = (count(&one, yellow), count(&three, yellow));
        let along = (in_three - in_one) / 2;
        assert!((width as usize..=2 * width as usize).contains(&along), "{along} pixels of a line across the photo");
        let of_key = in_one - along;
        assert!((100..=150).contains(&of_key), "{of_key} pixels of the key");
        assert!(count(&one, [10, 90, 10]) > (width * height * 9 / 10) as usize);
    }
}
