//! Lines drawn over a photo: the edges of prisms as the camera sees them.

use image::RgbImage;
use image::imageops::{FilterType, resize};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canvas::{Align, Canvas, Pen};
use super::colour::{INK, Rgb, WHITE};

/// Settings of the overlay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct OverlayConfig {
    /// Longest side of the picture, pixels; the photo is never enlarged.
    pub longest_px: u32,
    /// Shift of the photo towards white, 0 (as it is) to 1 (white), so that the lines stand out.
    pub brighten: f32,
    /// Width of the lines, pixels at a longest side of 1600 pixels.
    pub line_px: f32,
}

impl Default for OverlayConfig {
    fn default() -> Self {
        Self { longest_px: 1600, brighten: 0.25, line_px: 2.4 }
    }
}

/// A chain of points in pixels of the full photo (top-left pixel's centre at (0.5, 0.5)).
#[derive(Debug, Clone, PartialEq)]
pub struct Polyline {
    /// Points; parts outside the photo are cut off.
    pub points_px: Vec<[f64; 2]>,
    /// Colour of the line.
    pub colour: Rgb,
}

/// Draws lines over a photo, with a key (`label`, `colour`) in the upper left corner.
#[must_use]
pub fn overlay(photo: &RgbImage, lines: &[Polyline], key: &[(&str, Rgb)], config: &OverlayConfig) -> RgbImage {
    let longest = photo.width().max(photo.height()).max(1);
    let scale = (f64::from(config.longest_px) / f64::from(longest)).min(1.0);
    let side = |n: u32| ((f64::from(n) * scale).round() as u32).max(1);
    let (width, height) = (side(photo.width()), side(photo.height()));
    let mut photo = if scale < 1.0 { resize(photo, width, height, FilterType::Triangle) } else { photo.clone() };
    let towards_white = config.brighten.clamp(0.0, 1.0);
    for pixel in photo.pixels_mut() {
        pixel.0 = pixel.0.map(|v| (f32::from(v) + (255.0 - f32::from(v)) * towards_white).round() as u8);
    }
    let mut canvas = Canvas::new(width, height);
    canvas.picture(&photo, [0, 0]);
    let unit = canvas.width().max(canvas.height()) / 1600.0;
    let pen = config.line_px.max(0.1) * unit.max(0.7);
    let placed: Vec<Vec<[f32; 2]>> =
        lines.iter().map(|line| line.points_px.iter().map(|p| p.map(|v| (v * scale) as f32)).collect()).collect();
    // All halos below all lines, so that crossing edges stay readable.
    for points in &placed {
        canvas.line(points, Pen { colour: INK, opacity: 0.45, width_px: 2.2 * pen });
    }
    for (points, line) in placed.iter().zip(lines) {
        canvas.line(points, Pen::new(line.colour, pen));
    }
    draw_key(&mut canvas, key, unit.max(0.75));
    canvas.into_image()
}

fn draw_key(canvas: &mut Canvas, key: &[(&str, Rgb)], unit: f32) {
    let Some(widest) = key.iter().map(|(label, _)| canvas.text_width(label, 18.0 * unit)).reduce(f32::max) else {
        return;
    };
    let (left, top) = (16.0 * unit, 16.0 * unit);
    canvas.fill_rect([left, top], [widest + 72.0 * unit, (key.len() as f32 * 28.0 + 12.0) * unit], WHITE);
    for (i, (label, colour)) in key.iter().enumerate() {
        let y = top + (i as f32 * 28.0 + 20.0) * unit;
        canvas.line(&[[left + 12.0 * unit, y], [left + 48.0 * unit, y]], Pen::new(*colour, 4.0 * unit));
        canvas.text(label, [left + 58.0 * unit, y + 6.0 * unit], 18.0 * unit, INK, Align::Left);
    }
}
