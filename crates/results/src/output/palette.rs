//! Plain colours as a small picture: every viewer shows textures, but deck.gl and QGIS pass over colours of vertices.

use std::io::Cursor;

use image::{ImageFormat, RgbImage};
use indexmap::IndexSet;

use super::picture::colour::Rgb;

/// Greatest number of columns of the picture.
const COLUMNS: usize = 64;

/// Colours, a pixel each, row by row.
#[derive(Debug, Default)]
pub(super) struct Palette {
    colours: IndexSet<Rgb>,
}

impl Palette {
    /// Palette of some colours, each once.
    pub fn of(colours: impl IntoIterator<Item = Rgb>) -> Self {
        Self { colours: colours.into_iter().collect() }
    }

    /// Middle of a colour's pixel, as shares from the upper left corner.
    ///
    /// # Panics
    /// For a colour that is not in the palette.
    pub fn uv(&self, colour: Rgb) -> [f32; 2] {
        let at = self.colours.get_index_of(&colour).expect("palettes are made of all colours in use");
        let (columns, rows) = self.size();
        let middle = |at: usize, n: usize| (at as f32 + 0.5) / n as f32;
        [middle(at % columns, columns), middle(at / columns, rows)]
    }

    fn size(&self) -> (usize, usize) {
        let columns = self.colours.len().clamp(1, COLUMNS);
        (columns, self.colours.len().div_ceil(columns).max(1))
    }

    /// The picture as PNG.
    ///
    /// # Panics
    /// Never: memory takes every byte.
    pub fn png(&self) -> Vec<u8> {
        let (columns, rows) = self.size();
        let mut picture = RgbImage::new(columns as u32, rows as u32);
        for (pixel, colour) in picture.pixels_mut().zip(&self.colours) {
            pixel.0 = *colour;
        }
        let mut png = Cursor::new(Vec::new());
        picture.write_to(&mut png, ImageFormat::Png).expect("a picture in memory is encoded");
        png.into_inner()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_colour_is_found_at_its_place() {
        let colours: Vec<Rgb> = (0..130_u8).map(|i| [i, 255 - i, i / 2]).collect();
        for n in [1, 64, 65, 130] {
            let palette = Palette::of(colours[..n].iter().copied());
            let picture = image::load_from_memory(&palette.png()).unwrap().into_rgb8();
            for colour in &colours[..n] {
                let [u, v] = palette.uv(*colour);
                let at = [u * picture.width() as f32, v * picture.height() as f32].map(|v| v as u32);
                assert_eq!(picture.get_pixel(at[0], at[1]).0, *colour);
            }
        }
    }
}
