//! A plan of a terrain model made from photos: its heights, and the squares of ground that it was made of.

use geo_types::{LineString, Polygon};
use image::RgbImage;

use super::SHEET_PX;
use super::canvas::{Align, Pen};
use super::colour::{ALERT, ColourMap, GREY, INK, Rgb, WHITE};
use super::plan::{MapSheet, ShownRegion};
use super::scale;
use sizeup_geo::crs::Crs;
use sizeup_photos::dtm::{Dtm, SquareOutcome};

/// Most cells drawn along a side of the map.
const MAX_CELLS: usize = 300;
/// Radius of a square's mark at the reference width, pixels.
const MARK_PX: f32 = 3.0;
const UNCLEAR: Rgb = [60, 60, 66];
/// Steps of the legend's colour bar.
const BAR: usize = 60;

/// Draws a terrain model with footprints over it. North is up.
#[must_use]
pub fn relief_map(dtm: &Dtm, footprints: &[&Polygon<f64>], crs: &Crs) -> RgbImage {
    let (west, north) = dtm.dem.corner_m();
    let (cell_x, cell_y) = dtm.dem.cell_m();
    let heights = dtm.dem.heights_m();
    let (east, south) = (west + cell_x * heights.width() as f64, north - cell_y * heights.height() as f64);
    let region = ShownRegion::around([[west, south], [east, north]].into_iter(), 0.0);
    let mut sheet = MapSheet::new(&region, SHEET_PX);
    let (low_m, high_m) = dtm.dem.range();
    let span_m = (high_m - low_m).max(0.1);
    let step = heights.width().max(heights.height()).div_ceil(MAX_CELLS).max(1);
    for row in (0..heights.height()).step_by(step) {
        for col in (0..heights.width()).step_by(step) {
            let z_m = f64::from(heights[(col, row)]);
            if z_m.is_nan() {
                continue;
            }
            let at = |c: usize, r: usize| sheet.to_px.at(west + cell_x * c as f64, north - cell_y * r as f64);
            let [x0, y0] = at(col, row);
            let [x1, y1] = at((col + step).min(heights.width()), (row + step).min(heights.height()));
            let colour = ColourMap::Viridis.at((z_m - low_m) / span_m);
            // A little overlap, so that no paper shows between the cells.
            sheet.canvas.fill_rect([x0, y0], [x1 - x0 + 0.6, y1 - y0 + 0.6], colour);
        }
    }
    for footprint in footprints {
        let plan: Polygon<f64> = Polygon::new(LineString(footprint.exterior().0.clone()), Vec::new());
        sheet.canvas.stroke_rings(&sheet.to_px.rings(&plan), Pen::new(INK, 0.9 * sheet.unit));
    }
    for square in &dtm.squares {
        if let Some(colour) = colour(square.outcome) {
            let at = sheet.to_px.at(square.at.x, square.at.y);
            sheet.canvas.disc(at, MARK_PX * sheet.unit, colour, Pen::new(GREY, 0.5 * sheet.unit));
        }
    }
    sheet.furnish();
    let n = |is: fn(&SquareOutcome) -> bool| dtm.squares.iter().filter(|s| is(&s.outcome)).count();
    let below = format!("{low_m:.1} to {high_m:.1} m · a square's standard deviation {:.2} m", dtm.sigma_m);
    sheet.headings("The ground by the photos", &below, crs);
    let counts = [
        (WHITE, format!("ground: {}", n(|o| matches!(o, SquareOutcome::Ground(_))))),
        (ALERT, format!("stands out: {}", n(|o| matches!(o, SquareOutcome::Outlier(_))))),
        (UNCLEAR, format!("unclear: {}", n(|o| matches!(o, SquareOutcome::Unclear)))),
    ];
    legend(&mut sheet, &counts, (low_m, high_m));
    sheet.canvas.into_image()
}

fn colour(outcome: SquareOutcome) -> Option<Rgb> {
    match outcome {
        SquareOutcome::Ground(_) => Some(WHITE),
        SquareOutcome::Outlier(_) => Some(ALERT),
        SquareOutcome::Unclear => Some(UNCLEAR),
        SquareOutcome::Unseen => None,
    }
}

fn legend(sheet: &mut MapSheet, counts: &[(Rgb, String)], (low_m, high_m): (f64, f64)) {
    let (left, unit) = (sheet.legend_left(), sheet.unit);
    let MapSheet { canvas, frame, .. } = sheet;
    let mut y = frame.top + 18.0 * unit;
    for (colour, label) in counts {
        canvas.disc([left + 8.0 * unit, y], 1.6 * MARK_PX * unit, *colour, Pen::new(GREY, 0.8 * unit));
        canvas.text(label, [left + 26.0 * unit, y + 5.0 * unit], 15.0 * unit, INK, Align::Left);
        y += 30.0 * unit;
    }
    let (top, height) = (y + 20.0 * unit, 240.0 * unit);
    canvas.text("height, m", [left, top - 8.0 * unit], 14.0 * unit, GREY, Align::Left);
    for i in 0..BAR {
        let share = i as f32 / BAR as f32;
        let at = [left, top + (1.0 - share) * height - height / BAR as f32];
        canvas.fill_rect(at, [22.0 * unit, height / BAR as f32 + 1.0], ColourMap::Viridis.at(f64::from(share)));
    }
    let step = scale::step(low_m, high_m, 5);
    for tick in scale::ticks(low_m, high_m, 5) {
        let share = ((tick - low_m) / (high_m - low_m).max(0.1)) as f32;
        let at = [left + 30.0 * unit, top + (1.0 - share) * height + 5.0 * unit];
        canvas.text(&scale::label(tick, step), at, 14.0 * unit, INK, Align::Left);
    }
}
