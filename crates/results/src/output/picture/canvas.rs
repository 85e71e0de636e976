//! A surface to draw on: antialiased shapes (tiny-skia) and text (`ab_glyph`, DejaVu Sans).
//!
//! Coordinates in pixels from the top-left corner; the top-left pixel's centre is (0.5, 0.5).

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};
use image::RgbImage;
use tiny_skia::{
    Color, FillRule, FilterQuality, LineCap, LineJoin, Mask, Paint, Path, PathBuilder, Pixmap, PixmapPaint, Rect,
    Stroke, Transform,
};

use super::colour::Rgb;

const FONT: &[u8] = include_bytes!("DejaVuSans-subset.ttf");

/// Alignment of a text to its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Align {
    /// The text starts at the position.
    Left,
    /// It is centred there.
    Centre,
    /// The text ends at the position.
    Right,
}

/// Pen of a line.
#[derive(Debug, Clone, Copy)]
pub struct Pen {
    /// Colour of the line.
    pub colour: Rgb,
    /// 0 (invisible) to 1.
    pub opacity: f32,
    /// Width of the line, pixels.
    pub width_px: f32,
}

impl Pen {
    /// A pen whose lines hide what is below.
    pub fn new(colour: Rgb, width_px: f32) -> Self {
        Self { colour, opacity: 1.0, width_px }
    }
}

/// A picture in the making.
pub struct Canvas {
    pixels: Pixmap,
    font: FontRef<'static>,
}

impl Canvas {
    /// A white picture of at least one pixel.
    pub fn new(width_px: u32, height_px: u32) -> Self {
        let mut pixels = Pixmap::new(width_px.max(1), height_px.max(1)).expect("sizes of pictures are in range");
        pixels.fill(Color::WHITE);
        Self { pixels, font: FontRef::try_from_slice(FONT).expect("the embedded font is sound") }
    }

    /// Width of the canvas, pixels.
    pub fn width(&self) -> f32 {
        self.pixels.width() as f32
    }

    /// Height of the canvas, pixels.
    pub fn height(&self) -> f32 {
        self.pixels.height() as f32
    }

    /// Fills a box whose upper left corner and size are given, pixels.
    pub fn fill_rect(&mut self, [x, y]: [f32; 2], [w, h]: [f32; 2], colour: Rgb) {
        if let Some(rect) = Rect::from_xywh(x, y, w, h) {
            self.pixels.fill_rect(rect, &paint(colour, 1.0), Transform::identity(), None);
        }
    }

    /// Filled rings (even-odd, so holes stay open).
    pub fn fill_rings(&mut self, rings: &[Vec<[f32; 2]>], colour: Rgb) {
        if let Some(path) = closed(rings) {
            self.pixels.fill_path(&path, &paint(colour, 1.0), FillRule::EvenOdd, Transform::identity(), None);
        }
    }

    /// Diagonal lines within rings.
    pub fn hatch_rings(&mut self, rings: &[Vec<[f32; 2]>], pen: Pen, distance_px: f32) {
        let Some(path) = closed(rings) else { return };
        let Some(mut mask) = Mask::new(self.pixels.width(), self.pixels.height()) else { return };
        mask.fill_path(&path, FillRule::EvenOdd, true, Transform::identity());
        let bounds = path.bounds();
        let mut lines = PathBuilder::new();
        // Lines x + y = c, the same family everywhere so that neighbours join up.
        let (first, last) = (bounds.left() + bounds.top(), bounds.right() + bounds.bottom());
        let mut c = (first / distance_px).floor() * distance_px;
        while c <= last {
            lines.move_to(c - bounds.top(), bounds.top());
            lines.line_to(c - bounds.bottom(), bounds.bottom());
            c += distance_px;
        }
        if let Some(lines) = lines.finish() {
            let paint = paint(pen.colour, pen.opacity);
            self.pixels.stroke_path(&lines, &paint, &stroke(pen.width_px), Transform::identity(), Some(&mask));
        }
    }

    /// Closed lines along rings.
    pub fn stroke_rings(&mut self, rings: &[Vec<[f32; 2]>], pen: Pen) {
        if let Some(path) = closed(rings) {
            self.stroke(&path, pen);
        }
    }

    /// A line through points.
    pub fn line(&mut self, points: &[[f32; 2]], pen: Pen) {
        let mut path = PathBuilder::new();
        for (i, p) in points.iter().enumerate() {
            if i == 0 { path.move_to(p[0], p[1]) } else { path.line_to(p[0], p[1]) }
        }
        if let Some(path) = path.finish() {
            self.stroke(&path, pen);
        }
    }

    /// A disc with a rim.
    pub fn disc(&mut self, [x, y]: [f32; 2], radius_px: f32, fill: Rgb, rim: Pen) {
        if let Some(path) = PathBuilder::from_circle(x, y, radius_px) {
            self.pixels.fill_path(&path, &paint(fill, 1.0), FillRule::Winding, Transform::identity(), None);
            self.stroke(&path, rim);
        }
    }

    /// A picture with its top-left corner at a position, not scaled.
    pub fn picture(&mut self, picture: &RgbImage, [x, y]: [i32; 2]) {
        let Some(mut pixels) = Pixmap::new(picture.width(), picture.height()) else { return };
        for (target, source) in pixels.data_mut().chunks_exact_mut(4).zip(picture.pixels()) {
            target.copy_from_slice(&[source[0], source[1], source[2], 255]);
        }
        let nearest = PixmapPaint { quality: FilterQuality::Nearest, ..PixmapPaint::default() };
        self.pixels.draw_pixmap(x, y, pixels.as_ref(), &nearest, Transform::identity(), None);
    }

    /// A line of text, its baseline at a height.
    pub fn text(&mut self, text: &str, [x, baseline]: [f32; 2], size_px: f32, colour: Rgb, align: Align) {
        let left = match align {
            Align::Left => x,
            Align::Centre => x - self.text_width(text, size_px) / 2.0,
            Align::Right => x - self.text_width(text, size_px),
        };
        let (width, height) = (self.pixels.width().cast_signed(), self.pixels.height().cast_signed());
        for glyph in self.glyphs(text, size_px, [left, baseline]) {
            let Some(shape) = self.font.outline_glyph(glyph) else { continue };
            let (left, top) = (shape.px_bounds().min.x as i32, shape.px_bounds().min.y as i32);
            let data = self.pixels.data_mut();
            shape.draw(|dx, dy, coverage| {
                let (px, py) = (left + dx.cast_signed(), top + dy.cast_signed());
                if (0..width).contains(&px) && (0..height).contains(&py) {
                    let at = 4 * (py * width + px) as usize;
                    for (value, ink) in data[at..at + 3].iter_mut().zip(colour) {
                        let mixed = f32::from(*value) + (f32::from(ink) - f32::from(*value)) * coverage.min(1.0);
                        *value = mixed.round() as u8;
                    }
                }
            });
        }
    }

    /// Width of a line of text, pixels.
    pub fn text_width(&self, text: &str, size_px: f32) -> f32 {
        let font = self.font.as_scaled(PxScale::from(size_px));
        text.chars().map(|c| font.h_advance(font.glyph_id(c))).sum()
    }

    /// The canvas as an opaque image.
    pub fn into_image(self) -> RgbImage {
        let (width, height) = (self.pixels.width(), self.pixels.height());
        let rgb = self.pixels.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        RgbImage::from_raw(width, height, rgb).expect("three bytes per pixel")
    }

    fn glyphs(&self, text: &str, size_px: f32, [x, baseline]: [f32; 2]) -> Vec<Glyph> {
        let font = self.font.as_scaled(PxScale::from(size_px));
        let mut pen_x = x;
        text.chars()
            .map(|c| {
                let id = font.glyph_id(c);
                let glyph = id.with_scale_and_position(PxScale::from(size_px), point(pen_x, baseline));
                pen_x += font.h_advance(id);
                glyph
            })
            .collect()
    }

    fn stroke(&mut self, path: &Path, pen: Pen) {
        let paint = paint(pen.colour, pen.opacity);
        self.pixels.stroke_path(path, &paint, &stroke(pen.width_px), Transform::identity(), None);
    }
}

fn paint(colour: Rgb, opacity: f32) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    let [r, g, b] = colour;
    paint.set_color_rgba8(r, g, b, (opacity.clamp(0.0, 1.0) * 255.0).round() as u8);
    paint
}

fn stroke(width_px: f32) -> Stroke {
    Stroke { width: width_px, line_cap: LineCap::Round, line_join: LineJoin::Round, ..Stroke::default() }
}

fn closed(rings: &[Vec<[f32; 2]>]) -> Option<Path> {
    let mut path = PathBuilder::new();
    for ring in rings.iter().filter(|ring| ring.len() >= 3) {
        path.move_to(ring[0][0], ring[0][1]);
        ring[1..].iter().for_each(|p| path.line_to(p[0], p[1]));
        path.close();
    }
    path.finish()
}
