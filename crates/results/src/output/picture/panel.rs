//! Photo, rendered depth and prior of one view, side by side.

use image::RgbImage;
use image::imageops::{FilterType, resize};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canvas::{Align, Canvas, Pen};
use super::colour::{ColourMap, GREY, INK, NO_VALUE, Rgb};
use sizeup_heights::raster::Raster;
use sizeup_heights::stats::quantile;
use sizeup_photos::prior::PriorKind;

/// Settings of the panel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PanelConfig {
    /// Width of each of the three pictures, pixels, 200 to 4000.
    pub picture_width_px: u32,
}

impl Default for PanelConfig {
    fn default() -> Self {
        Self { picture_width_px: 640 }
    }
}

/// Values shown beside the photo. Any size, same aspect as the photo; `NaN` = no value.
#[derive(Debug, Clone, Copy)]
pub struct PanelDepths<'a> {
    /// z-depth of the model, metres.
    pub rendered_m: &'a Raster<f32>,
    /// The prior's own numbers.
    pub prior: &'a Raster<f32>,
    /// Kind of those numbers: inverse depth is shown turned round, so that near looks alike in both.
    pub prior_kind: PriorKind,
}

/// Quantiles of the values at the two ends of the colours.
const COLOUR_QUANTILES: (f64, f64) = (0.01, 0.99);
/// Widths at the default picture width; everything scales with it.
const REFERENCE_WIDTH_PX: f32 = 640.0;

/// Draws the panel; `caption` names the view.
#[must_use]
pub fn depth_panel(photo: &RgbImage, depths: &PanelDepths<'_>, caption: &str, config: &PanelConfig) -> RgbImage {
    let width = config.picture_width_px.clamp(200, 4000);
    let height =
        (f64::from(width) * f64::from(photo.height()) / f64::from(photo.width().max(1))).round().max(1.0) as u32;
    let unit = width as f32 / REFERENCE_WIDTH_PX;
    let (gap, top, bottom) = (16.0 * unit, 74.0 * unit, 58.0 * unit);
    let mut canvas = Canvas::new((3.0 * width as f32 + 4.0 * gap) as u32, (top + height as f32 + bottom) as u32);
    canvas.text(caption, [gap, 32.0 * unit], 22.0 * unit, INK, Align::Left);
    let left = |i: f32| (gap + i * (width as f32 + gap)).round();

    canvas.picture(&resize(photo, width, height, FilterType::Triangle), [left(0.0) as i32, top as i32]);
    let rendered = ShownDepth::new(depths.rendered_m, PriorKind::Depth);
    let prior = ShownDepth::new(depths.prior, depths.prior_kind);
    let prior_name = match depths.prior_kind {
        PriorKind::Depth => "depth prior",
        PriorKind::InverseDepth => "depth prior (inverse depth)",
    };
    let panels = [(0.0, "photo", None), (1.0, "rendered depth, m", Some(rendered)), (2.0, prior_name, Some(prior))];
    for (i, name, shown) in panels {
        canvas.text(name, [left(i), 64.0 * unit], 17.0 * unit, GREY, Align::Left);
        if let Some(shown) = shown {
            canvas.picture(&shown.picture(width, height), [left(i) as i32, top as i32]);
            let bar = Bar { left: left(i), top: top + height as f32 + 12.0 * unit, width: width as f32, unit };
            bar.draw(&mut canvas, &shown);
        }
        let rim = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let rim = rim.map(|[x, y]| [left(i) + x * width as f32, top.floor() + y * height as f32]);
        canvas.stroke_rings(&[rim.to_vec()], Pen::new(GREY, 1.0 * unit));
    }
    canvas.into_image()
}

/// A depth map in colours, near light and far dark, each cell as large as it takes to fill the size.
#[must_use]
pub fn depth_picture(values: &Raster<f32>, kind: PriorKind, width_px: u32, height_px: u32) -> RgbImage {
    ShownDepth::new(values, kind).picture(width_px, height_px)
}

/// A depth map with the ends of its colours.
struct ShownDepth<'a> {
    values: &'a Raster<f32>,
    /// Value shown as nearest and as farthest.
    ends: Option<(f64, f64)>,
}

impl<'a> ShownDepth<'a> {
    fn new(values: &'a Raster<f32>, kind: PriorKind) -> Self {
        let known: Vec<f64> = values.data().iter().filter(|v| v.is_finite()).map(|v| f64::from(*v)).collect();
        let low = quantile(&known, COLOUR_QUANTILES.0);
        let high = quantile(&known, COLOUR_QUANTILES.1);
        let ends = match (low.zip(high), kind) {
            (Some((low, high)), PriorKind::Depth) => Some((low, high)),
            (Some((low, high)), PriorKind::InverseDepth) => Some((high, low)),
            (None, _) => None,
        };
        Self { values, ends }
    }

    fn colour(&self, value: f32) -> Rgb {
        let Some((near, far)) = self.ends.filter(|_| value.is_finite()) else { return NO_VALUE };
        let span = far - near;
        let t = if span == 0.0 { 0.5 } else { (f64::from(value) - near) / span };
        ColourMap::MagmaReversed.at(t)
    }

    /// At another size: the nearest cell, so that no value is invented across an edge.
    fn picture(&self, width: u32, height: u32) -> RgbImage {
        let cell = |i: u32, n: u32, n_cells: usize| {
            (((f64::from(i) + 0.5) / f64::from(n) * n_cells as f64) as usize).min(n_cells.saturating_sub(1))
        };
        RgbImage::from_fn(width, height, |x, y| {
            let at = self.values.get(cell(x, width, self.values.width()), cell(y, height, self.values.height()));
            image::Rgb(at.map_or(NO_VALUE, |value| self.colour(*value)))
        })
    }
}

/// The colour bar below a depth map.
struct Bar {
    left: f32,
    top: f32,
    width: f32,
    unit: f32,
}

impl Bar {
    fn draw(&self, canvas: &mut Canvas, shown: &ShownDepth<'_>) {
        let Some((near, far)) = shown.ends else {
            canvas.text("no values", [self.left, self.top + 14.0 * self.unit], 14.0 * self.unit, GREY, Align::Left);
            return;
        };
        let n = self.width as usize;
        for i in 0..n {
            let colour = ColourMap::MagmaReversed.at((i as f64 + 0.5) / n as f64);
            canvas.fill_rect([self.left + i as f32, self.top], [1.0, 10.0 * self.unit], colour);
        }
        let number = |value: f64| {
            let magnitude = value.abs();
            let decimals = if magnitude >= 100.0 {
                0
            } else if magnitude >= 10.0 {
                1
            } else {
                3
            };
            format!("{value:.decimals$}")
        };
        let y = self.top + 28.0 * self.unit;
        let size = 14.0 * self.unit;
        canvas.text(&format!("near  {}", number(near)), [self.left, y], size, GREY, Align::Left);
        canvas.text(&format!("{}  far", number(far)), [self.left + self.width, y], size, GREY, Align::Right);
        if shown.values.data().iter().any(|v| !v.is_finite()) {
            let x = self.left + self.width / 2.0;
            canvas.fill_rect([x - 42.0 * self.unit, y - 11.0 * self.unit], [12.0 * self.unit; 2], NO_VALUE);
            canvas.text("no value", [x - 24.0 * self.unit, y], size, GREY, Align::Left);
        }
    }
}
