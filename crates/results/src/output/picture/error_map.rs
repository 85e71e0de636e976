//! Footprints coloured by how far off they are: blue too low, white right, red too high.

use geo::BoundingRect as _;
use geo_types::Polygon;
use image::RgbImage;

use super::canvas::{Align, Canvas, Pen};
use super::colour::{GREY, INK, NO_VALUE, Rgb};
use sizeup_heights::stats;

/// Errors of this size and more have the full colour, metres.
const FULL_M: f64 = 3.0;
/// Ends and middle of the colours (`ColorBrewer` `RdBu`, readable by colour-blind people).
const LOW: Rgb = [33, 102, 172];
const MIDDLE: Rgb = [247, 247, 247];
const HIGH: Rgb = [178, 24, 43];
/// Border around the map, and the strip below it for the legend, pixels.
const BORDER_PX: f32 = 24.0;
const LEGEND_PX: f32 = 64.0;
const TITLE_PX: f32 = 40.0;

/// The colour of an error, metres, positive too high.
fn colour(error_m: f64) -> Rgb {
    let t = (error_m / FULL_M).clamp(-1.0, 1.0);
    let end = if t < 0.0 { LOW } else { HIGH };
    let mix = |a: u8, b: u8| (f64::from(a) + (f64::from(b) - f64::from(a)) * t.abs()).round() as u8;
    [mix(MIDDLE[0], end[0]), mix(MIDDLE[1], end[1]), mix(MIDDLE[2], end[2])]
}

/// Draws footprints with their signed errors, metres; `None` = not compared.
#[must_use]
pub fn error_map(title: &str, footprints: &[(&Polygon<f64>, Option<f64>)], width_px: u32) -> RgbImage {
    let width = width_px.max(300) as f32;
    let bounds = footprints.iter().filter_map(|(polygon, _)| polygon.bounding_rect());
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for b in bounds {
        low = [low[0].min(b.min().x), low[1].min(b.min().y)];
        high = [high[0].max(b.max().x), high[1].max(b.max().y)];
    }
    let extent = [(high[0] - low[0]).max(1.0), (high[1] - low[1]).max(1.0)];
    let per_metre = f64::from(width - 2.0 * BORDER_PX) / extent[0];
    let map_height =
        if extent[1].is_finite() { (extent[1] * per_metre).clamp(100.0, 4.0 * f64::from(width)) as f32 } else { 100.0 };
    let mut canvas = Canvas::new(width as u32, (map_height + 2.0 * BORDER_PX + LEGEND_PX + TITLE_PX) as u32);
    canvas.text(title, [BORDER_PX, 30.0], 19.0, INK, Align::Left);
    let top = TITLE_PX + BORDER_PX;
    for (polygon, error_m) in footprints {
        let rings: Vec<Vec<[f32; 2]>> = std::iter::once(polygon.exterior())
            .chain(polygon.interiors())
            .map(|ring| {
                let at = |c: &geo_types::Coord<f64>| {
                    [BORDER_PX + ((c.x - low[0]) * per_metre) as f32, top + ((high[1] - c.y) * per_metre) as f32]
                };
                ring.coords().map(at).collect()
            })
            .collect();
        canvas.fill_rings(&rings, error_m.map_or(NO_VALUE, colour));
        canvas.stroke_rings(&rings, Pen::new(GREY, 0.8));
    }
    let errors: Vec<f64> = footprints.iter().filter_map(|(_, error_m)| error_m.map(f64::abs)).collect();
    legend(&mut canvas, top + map_height + BORDER_PX, &errors);
    canvas.into_image()
}

fn legend(canvas: &mut Canvas, y: f32, errors_m: &[f64]) {
    const STEPS: usize = 120;
    for i in 0..STEPS {
        let error_m = FULL_M * (2.0 * i as f64 / (STEPS - 1) as f64 - 1.0);
        canvas.fill_rect([BORDER_PX + 2.0 * i as f32, y], [2.0, 12.0], colour(error_m));
    }
    let end = BORDER_PX + 2.0 * STEPS as f32;
    for (text, x) in
        [(format!("-{FULL_M}"), BORDER_PX), ("0".to_owned(), 0.5 * (BORDER_PX + end)), (format!("+{FULL_M} m"), end)]
    {
        canvas.text(&text, [x, y + 28.0], 14.0, GREY, Align::Centre);
    }
    canvas.text("result minus reference; grey: not compared", [end + 40.0, y + 12.0], 14.0, GREY, Align::Left);
    if let (Some(mean), Some(p90)) = (stats::mean(errors_m), stats::quantile(errors_m, 0.9)) {
        let text =
            format!("{} footprints: off by {mean:.2} m on average, 90 % by less than {p90:.2} m", errors_m.len());
        canvas.text(&text, [end + 40.0, y + 30.0], 14.0, GREY, Align::Left);
    }
}
