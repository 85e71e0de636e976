//! What maps have in common: which part of the plane they show and where, frame, title, scale bar, north arrow.

use geo_types::{LineString, Polygon};

use super::canvas::{Align, Canvas, Pen};
use super::colour::{GREY, INK, WHITE};
use super::scale;
use sizeup_geo::crs::Crs;

/// Aspect of a map's frame, height by width.
const ASPECTS: (f64, f64) = (0.5, 1.1);
/// Widths at the reference width of 1600 px; everything scales with the picture.
const REFERENCE_WIDTH_PX: f32 = 1600.0;
/// Widths of pictures, pixels.
const WIDTHS_PX: (u32, u32) = (600, 8000);

/// A picture with a map on its left and room for a legend on its right.
pub struct MapSheet {
    /// Canvas that is drawn on.
    pub canvas: Canvas,
    /// Rectangle of the canvas that the map fills.
    pub frame: MapFrame,
    /// From the map plane to the picture.
    pub to_px: MapPlacement,
    /// Pixels per pixel of the reference width.
    pub unit: f32,
}

impl MapSheet {
    /// An empty map of a region.
    pub fn new(region: &ShownRegion, width_px: u32) -> Self {
        let width = width_px.clamp(WIDTHS_PX.0, WIDTHS_PX.1) as f32;
        let unit = width / REFERENCE_WIDTH_PX;
        let (left, top, legend, bottom) = (28.0 * unit, 76.0 * unit, 250.0 * unit, 52.0 * unit);
        let frame_width = width - left - legend - left;
        let aspect = (region.height_m() / region.width_m()).clamp(ASPECTS.0, ASPECTS.1) as f32;
        let frame = MapFrame { left, top, width: frame_width, height: (frame_width * aspect).round() };
        let mut canvas = Canvas::new(width as u32, (top + frame.height + bottom) as u32);
        canvas.fill_rect([frame.left, frame.top], [frame.width, frame.height], [247, 247, 244]);
        let to_px = MapPlacement::new(region, &frame);
        Self { canvas, frame, to_px, unit }
    }

    /// Left edge of the legend.
    pub fn legend_left(&self) -> f32 {
        self.frame.left + self.frame.width + 26.0 * self.unit
    }

    /// The rim, scale bar and north arrow, over what the map shows.
    pub fn furnish(&mut self) {
        let Self { canvas, frame, to_px, unit } = self;
        let rim = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]| [frame.left + x * frame.width, frame.top + y * frame.height]);
        canvas.stroke_rings(&[rim.to_vec()], Pen::new(GREY, 1.2 * *unit));
        scale_bar(canvas, to_px, frame, *unit);
        north_arrow(canvas, frame, *unit);
    }

    /// Title, a line below it, and the CRS below the map.
    pub fn headings(&mut self, title: &str, below: &str, crs: &Crs) {
        let Self { canvas, frame, unit, .. } = self;
        canvas.text(title, [frame.left, 36.0 * *unit], 27.0 * *unit, INK, Align::Left);
        canvas.text(below, [frame.left, 62.0 * *unit], 16.0 * *unit, GREY, Align::Left);
        let crs = match crs.epsg() {
            Some(_) => format!("{crs} · {}", crs.name()),
            None => crs.name().to_owned(),
        };
        let bottom = frame.top + frame.height + 32.0 * *unit;
        canvas.text(&crs, [frame.left, bottom], 14.0 * *unit, GREY, Align::Left);
    }
}

/// The part of the map plane that is shown, metres.
pub struct ShownRegion {
    min_m: [f64; 2],
    max_m: [f64; 2],
}

impl ShownRegion {
    /// Around points, or a place of 100 m without any; `margin` is a share of the larger side.
    pub fn around(points: impl Iterator<Item = [f64; 2]>, margin: f64) -> Self {
        Self::of(points).unwrap_or(Self { min_m: [0.0; 2], max_m: [100.0; 2] }).grown(margin)
    }

    fn grown(mut self, margin: f64) -> Self {
        let margin_m = margin * self.width_m().max(self.height_m()).max(10.0);
        for axis in 0..2 {
            self.min_m[axis] -= margin_m;
            self.max_m[axis] += margin_m;
        }
        self
    }

    /// Whether a point lies within, or at most `reach_m` beyond.
    pub fn is_near(&self, point: [f64; 2], reach_m: f64) -> bool {
        (0..2).all(|axis| point[axis] >= self.min_m[axis] - reach_m && point[axis] <= self.max_m[axis] + reach_m)
    }

    /// South-western and north-eastern corner, map frame, metres.
    pub fn corners(&self) -> [[f64; 2]; 2] {
        [self.min_m, self.max_m]
    }

    fn of(points: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        points.fold(None, |region: Option<Self>, p| {
            let region = region.unwrap_or(Self { min_m: p, max_m: p });
            Some(Self {
                min_m: std::array::from_fn(|axis| region.min_m[axis].min(p[axis])),
                max_m: std::array::from_fn(|axis| region.max_m[axis].max(p[axis])),
            })
        })
    }

    /// East to west, metres.
    pub fn width_m(&self) -> f64 {
        self.max_m[0] - self.min_m[0]
    }

    /// North to south, metres.
    pub fn height_m(&self) -> f64 {
        self.max_m[1] - self.min_m[1]
    }
}

/// The map's place in the picture, pixels.
pub struct MapFrame {
    /// Left edge, pixels.
    pub left: f32,
    /// Top edge, pixels.
    pub top: f32,
    /// Width of the map, pixels.
    pub width: f32,
    /// Height of the map, pixels.
    pub height: f32,
}

impl MapFrame {
    /// Whether a pixel lies in it.
    pub fn contains(&self, [x, y]: [f32; 2]) -> bool {
        x >= self.left && y >= self.top && x <= self.left + self.width && y <= self.top + self.height
    }
}

/// From metres to pixels: the region centred in the frame, north up.
pub struct MapPlacement {
    px_per_m: f64,
    centre_m: [f64; 2],
    centre_px: [f64; 2],
}

impl MapPlacement {
    fn new(region: &ShownRegion, frame: &MapFrame) -> Self {
        let px_per_m = (f64::from(frame.width) / region.width_m()).min(f64::from(frame.height) / region.height_m());
        Self {
            px_per_m,
            centre_m: std::array::from_fn(|axis| 0.5 * (region.min_m[axis] + region.max_m[axis])),
            centre_px: [f64::from(frame.left + frame.width / 2.0), f64::from(frame.top + frame.height / 2.0)],
        }
    }

    /// The pixel of an easting and northing.
    pub fn at(&self, x_m: f64, y_m: f64) -> [f32; 2] {
        let x = self.centre_px[0] + (x_m - self.centre_m[0]) * self.px_per_m;
        let y = self.centre_px[1] - (y_m - self.centre_m[1]) * self.px_per_m;
        [x as f32, y as f32]
    }

    /// The rings of a polygon.
    pub fn rings(&self, polygon: &Polygon<f64>) -> Vec<Vec<[f32; 2]>> {
        let ring = |ring: &LineString<f64>| ring.coords().map(|p| self.at(p.x, p.y)).collect();
        std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(ring).collect()
    }
}

/// A bar of a round length, about a fifth of the frame, in its lower left corner.
fn scale_bar(canvas: &mut Canvas, to_px: &MapPlacement, frame: &MapFrame, unit: f32) {
    let length_m = scale::round_down(0.22 * f64::from(frame.width) / to_px.px_per_m);
    let length = (length_m * to_px.px_per_m) as f32;
    let (left, y) = (frame.left + 22.0 * unit, frame.top + frame.height - 24.0 * unit);
    let label = if length_m >= 1000.0 { format!("{} km", length_m / 1000.0) } else { format!("{length_m} m") };
    let plate = [length + 24.0 * unit + canvas.text_width(&label, 15.0 * unit), 26.0 * unit];
    canvas.fill_rect([left - 10.0 * unit, y - 13.0 * unit], plate, WHITE);
    for (i, colour) in [INK, WHITE, INK, WHITE].into_iter().enumerate() {
        canvas.fill_rect([left + i as f32 * length / 4.0, y - 3.5 * unit], [length / 4.0, 7.0 * unit], colour);
    }
    let corners = [[0.0, -3.5], [1.0, -3.5], [1.0, 3.5], [0.0, 3.5]].map(|[x, dy]| [left + x * length, y + dy * unit]);
    canvas.stroke_rings(&[corners.to_vec()], Pen::new(INK, 1.2 * unit));
    canvas.text(&label, [left + length + 8.0 * unit, y + 5.0 * unit], 15.0 * unit, INK, Align::Left);
}

/// Grid north, in the upper right corner of the frame.
fn north_arrow(canvas: &mut Canvas, frame: &MapFrame, unit: f32) {
    let (x, y) = (frame.left + frame.width - 30.0 * unit, frame.top + 24.0 * unit);
    let plate =
        [[-20.0, -16.0], [20.0, -16.0], [20.0, 62.0], [-20.0, 62.0]].map(|[dx, dy]| [x + dx * unit, y + dy * unit]);
    canvas.fill_rings(&[plate.to_vec()], WHITE);
    let half = |sign: f32| vec![[x, y - 8.0 * unit], [x + sign * 10.0 * unit, y + 30.0 * unit], [x, y + 22.0 * unit]];
    canvas.fill_rings(&[half(-1.0)], INK);
    canvas.stroke_rings(&[half(1.0)], Pen::new(INK, 1.2 * unit));
    canvas.text("N", [x, y + 52.0 * unit], 18.0 * unit, INK, Align::Centre);
}
