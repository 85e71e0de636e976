//! A plan of footprints in the colours of classes, with a legend that counts them.

use geo_types::MultiPolygon;
use image::RgbImage;

use super::canvas::{Align, Canvas, Pen};
use super::colour::{INK, Rgb};
use super::plan::{MapSheet, ShownRegion};
use sizeup_geo::crs::Crs;

/// Free margin around the footprints, share of their larger side.
const MARGIN_SHARE: f64 = 0.05;
/// Width of the picture, pixels.
const WIDTH_PX: u32 = 1600;
/// Height of a line of the legend, pixels of the reference width.
const LINE: f32 = 32.0;

/// A class of footprints.
#[derive(Debug, Clone, PartialEq)]
pub struct MapClass<'a> {
    /// Name in the legend.
    pub label: String,
    /// Colour of the footprints.
    pub colour: Rgb,
    /// Footprints of the class, map frame, metres.
    pub footprints: Vec<&'a MultiPolygon<f64>>,
}

/// Headings of a map.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapHeadings {
    /// Title, in large letters.
    pub title: String,
    /// Line below the title, in small letters.
    pub below: String,
}

/// Draws the classes, the last one on top; those without footprints are in the legend all the same.
#[must_use]
pub fn class_map(headings: &MapHeadings, classes: &[MapClass<'_>], crs: &Crs) -> RgbImage {
    let footprints = classes.iter().flat_map(|class| class.footprints.iter().flat_map(|footprint| footprint.iter()));
    let corners = footprints.flat_map(|polygon| polygon.exterior().coords()).map(|at| [at.x, at.y]);
    let region = ShownRegion::around(corners, MARGIN_SHARE);
    let mut sheet = MapSheet::new(&region, WIDTH_PX);
    let unit = sheet.unit;
    for class in classes {
        for polygon in class.footprints.iter().flat_map(|footprint| footprint.iter()) {
            let rings = sheet.to_px.rings(polygon);
            sheet.canvas.fill_rings(&rings, class.colour);
            sheet.canvas.stroke_rings(&rings, rim(unit));
        }
    }
    sheet.furnish();
    sheet.headings(&headings.title, &headings.below, crs);
    let (left, top) = (sheet.legend_left(), sheet.frame.top + 18.0 * unit);
    for (i, class) in classes.iter().rev().enumerate() {
        entry(&mut sheet.canvas, [left, top + i as f32 * LINE * unit], unit, class);
    }
    sheet.canvas.into_image()
}

fn rim(unit: f32) -> Pen {
    Pen { colour: INK, opacity: 0.75, width_px: 0.9 * unit }
}

fn entry(canvas: &mut Canvas, [x, y]: [f32; 2], unit: f32, class: &MapClass<'_>) {
    let corners = [[0.0, -9.0], [26.0, -9.0], [26.0, 9.0], [0.0, 9.0]];
    let swatch = [corners.map(|[dx, dy]| [x + dx * unit, y + dy * unit]).to_vec()];
    canvas.fill_rings(&swatch, class.colour);
    canvas.stroke_rings(&swatch, rim(unit));
    let text = format!("{}: {}", class.label, class.footprints.len());
    canvas.text(&text, [x + 36.0 * unit, y + 5.0 * unit], 15.0 * unit, INK, Align::Left);
}
