//! A plan of the buildings, coloured by height.

use geo_types::{LineString, Polygon};
use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canvas::{Align, Canvas, Pen};
use super::colour::{ALERT, ColourMap, GREY, INK, NO_VALUE, Rgb, WHITE};
use super::scale;
use crate::output::{BuildingRecord, CityModel, Status};
use crate::stats::quantile;
use crate::survey::{View, ViewKind};

/// How the map looks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MapConfig {
    /// Width of the picture, pixels, 600 to 8000.
    pub width_px: u32,
    /// Whether to draw the cameras.
    pub cameras: bool,
    /// Heading; the number of buildings by default.
    pub title: Option<String>,
}

impl Default for MapConfig {
    fn default() -> Self {
        Self { width_px: 1600, cameras: true, title: None }
    }
}

/// Free margin around the buildings, share of their larger side.
const MARGIN_SHARE: f64 = 0.05;
/// How far the map grows to take cameras in, share of the buildings' larger side: beyond it the buildings get small.
const CAMERA_REACH_SHARE: f64 = 0.35;
/// Aspect of the map's frame, height by width.
const ASPECTS: (f64, f64) = (0.5, 1.1);
/// Heights above this quantile share the last colour, so that one tower does not flatten the town …
const TOP_QUANTILE: f64 = 0.98;
/// … nor do a few: neither do the colours reach beyond this multiple of the median.
const TOP_MEDIANS: f64 = 2.5;
/// Widths at the reference width of 1600 px; everything scales with the picture.
const REFERENCE_WIDTH_PX: f32 = 1600.0;

/// Draws the map.
#[must_use]
pub fn map(model: &CityModel<'_>, config: &MapConfig) -> RgbImage {
    let width = config.width_px.clamp(600, 8000) as f32;
    let unit = width / REFERENCE_WIDTH_PX;
    let views: &[View] = if config.cameras { &model.survey.views } else { &[] };
    let region = Region::around(model.records, views);
    let (left, top, legend, bottom) = (28.0 * unit, 76.0 * unit, 250.0 * unit, 52.0 * unit);
    let frame_width = width - left - legend - left;
    let aspect = (region.height_m() / region.width_m()).clamp(ASPECTS.0, ASPECTS.1) as f32;
    let frame = Frame { left, top, width: frame_width, height: (frame_width * aspect).round() };
    let mut canvas = Canvas::new(width as u32, (top + frame.height + bottom) as u32);
    let to_px = Placement::new(&region, &frame);
    let range = HeightRange::of(model.records);

    canvas.fill_rect([frame.left, frame.top], [frame.width, frame.height], [247, 247, 244]);
    buildings(&mut canvas, model.records, &to_px, &range, unit);
    let n_drawn = cameras(&mut canvas, views, &to_px, &frame, unit);
    let rim = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
        .map(|[x, y]| [frame.left + x * frame.width, frame.top + y * frame.height]);
    canvas.stroke_rings(&[rim.to_vec()], Pen::new(GREY, 1.2 * unit));

    headings(&mut canvas, model, config, &frame, unit);
    scale_bar(&mut canvas, &to_px, &frame, unit);
    north_arrow(&mut canvas, &frame, unit);
    let note =
        (config.cameras && !views.is_empty()).then(|| format!("{n_drawn} of {} cameras in the map", views.len()));
    Legend { canvas: &mut canvas, left: frame.left + frame.width + 26.0 * unit, unit }.draw(
        &frame,
        &range,
        model.records,
        note.as_deref(),
    );
    canvas.into_image()
}

/// The part of the map plane that is shown, metres.
struct Region {
    min_m: [f64; 2],
    max_m: [f64; 2],
}

impl Region {
    fn around(records: &[BuildingRecord], views: &[View]) -> Self {
        let outlines = records.iter().filter_map(|r| r.footprint.as_ref());
        let points = outlines.flat_map(|p| p.exterior().coords()).map(|c| [c.x, c.y]);
        let mut region = Self::of(points).unwrap_or(Self { min_m: [0.0; 2], max_m: [100.0; 2] });
        let side_m = region.width_m().max(region.height_m()).max(10.0);
        let reach_m = CAMERA_REACH_SHARE * side_m;
        let is_near = |c: &[f64; 2]| {
            (0..2).all(|axis| c[axis] >= region.min_m[axis] - reach_m && c[axis] <= region.max_m[axis] + reach_m)
        };
        let centres = views.iter().map(|v| v.camera_from_map.centre()).map(|c| [c.x, c.y]).filter(is_near);
        if let Some(cameras) = Self::of(centres) {
            for axis in 0..2 {
                region.min_m[axis] = region.min_m[axis].min(cameras.min_m[axis]);
                region.max_m[axis] = region.max_m[axis].max(cameras.max_m[axis]);
            }
        }
        for axis in 0..2 {
            region.min_m[axis] -= MARGIN_SHARE * side_m;
            region.max_m[axis] += MARGIN_SHARE * side_m;
        }
        region
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

    fn width_m(&self) -> f64 {
        self.max_m[0] - self.min_m[0]
    }

    fn height_m(&self) -> f64 {
        self.max_m[1] - self.min_m[1]
    }
}

/// The map's place in the picture, pixels.
struct Frame {
    left: f32,
    top: f32,
    width: f32,
    height: f32,
}

impl Frame {
    fn contains(&self, [x, y]: [f32; 2]) -> bool {
        x >= self.left && y >= self.top && x <= self.left + self.width && y <= self.top + self.height
    }
}

/// From metres to pixels: the region centred in the frame, north up.
struct Placement {
    px_per_m: f64,
    centre_m: [f64; 2],
    centre_px: [f64; 2],
}

impl Placement {
    fn new(region: &Region, frame: &Frame) -> Self {
        let px_per_m = (f64::from(frame.width) / region.width_m()).min(f64::from(frame.height) / region.height_m());
        Self {
            px_per_m,
            centre_m: std::array::from_fn(|axis| 0.5 * (region.min_m[axis] + region.max_m[axis])),
            centre_px: [f64::from(frame.left + frame.width / 2.0), f64::from(frame.top + frame.height / 2.0)],
        }
    }

    fn at(&self, x_m: f64, y_m: f64) -> [f32; 2] {
        let x = self.centre_px[0] + (x_m - self.centre_m[0]) * self.px_per_m;
        let y = self.centre_px[1] - (y_m - self.centre_m[1]) * self.px_per_m;
        [x as f32, y as f32]
    }

    fn rings(&self, polygon: &Polygon<f64>) -> Vec<Vec<[f32; 2]>> {
        let ring = |ring: &LineString<f64>| ring.coords().map(|p| self.at(p.x, p.y)).collect();
        std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(ring).collect()
    }
}

/// The heights that the colours span, metres.
struct HeightRange {
    top_m: f64,
    has_higher: bool,
}

impl HeightRange {
    fn of(records: &[BuildingRecord]) -> Self {
        let heights: Vec<f64> = records.iter().filter_map(|r| r.height_m).collect();
        let median_m = quantile(&heights, 0.5).unwrap_or(1.0);
        let wished_m = quantile(&heights, TOP_QUANTILE).unwrap_or(1.0).min(TOP_MEDIANS * median_m).max(1.0);
        let step = scale::step(0.0, wished_m, 6);
        let top_m = (wished_m / step).ceil() * step;
        Self { top_m, has_higher: heights.iter().any(|h| *h > top_m) }
    }

    fn colour(&self, height_m: f64) -> Rgb {
        ColourMap::Viridis.at(height_m / self.top_m)
    }
}

fn buildings(canvas: &mut Canvas, records: &[BuildingRecord], to_px: &Placement, range: &HeightRange, unit: f32) {
    for record in records {
        let Some(outline) = &record.footprint else { continue };
        let rings = to_px.rings(outline);
        if let Some(height_m) = record.height_m {
            canvas.fill_rings(&rings, range.colour(height_m));
        } else {
            canvas.fill_rings(&rings, NO_VALUE);
            canvas.hatch_rings(&rings, Pen::new(GREY, 1.0 * unit), 7.0 * unit);
        }
        canvas.stroke_rings(&rings, outline_pen(record, unit));
    }
}

fn outline_pen(record: &BuildingRecord, unit: f32) -> Pen {
    match record.status {
        Status::Doubtful | Status::Fallback if record.height_m.is_some() => Pen::new(ALERT, 2.2 * unit),
        _ => Pen { colour: INK, opacity: 0.75, width_px: 0.9 * unit },
    }
}

/// Draws the cameras within the frame; returns how many.
fn cameras(canvas: &mut Canvas, views: &[View], to_px: &Placement, frame: &Frame, unit: f32) -> usize {
    // Hundreds of cameras need smaller signs than a dozen.
    let radius = unit * if views.len() > 200 { 2.2 } else { 3.6 };
    let mut n_drawn = 0;
    for view in views {
        let centre = view.camera_from_map.centre();
        let at = to_px.at(centre.x, centre.y);
        if !frame.contains(at) {
            continue;
        }
        n_drawn += 1;
        if view.kind() != ViewKind::Nadir {
            let axis = view.axis_in_map().truncate().normalize_or_zero();
            let tip = [at[0] + 5.0 * radius * axis.x as f32, at[1] - 5.0 * radius * axis.y as f32];
            canvas.line(&[at, tip], Pen::new(WHITE, 3.4 * unit));
            canvas.line(&[at, tip], Pen::new(INK, 1.4 * unit));
        }
        canvas.disc(at, radius, if view.kind() == ViewKind::Nadir { WHITE } else { INK }, Pen::new(INK, 1.2 * unit));
    }
    n_drawn
}

fn headings(canvas: &mut Canvas, model: &CityModel<'_>, config: &MapConfig, frame: &Frame, unit: f32) {
    let n_known = model.records.iter().filter(|r| r.height_m.is_some()).count();
    let title = config.title.clone().unwrap_or_else(|| "Building heights above ground".to_owned());
    canvas.text(&title, [frame.left, 36.0 * unit], 27.0 * unit, INK, Align::Left);
    let date = model.lineage.reference_date.as_deref().map(|date| format!(" · {date}")).unwrap_or_default();
    let below = format!("{n_known} of {} buildings have a height{date}", model.records.len());
    canvas.text(&below, [frame.left, 62.0 * unit], 16.0 * unit, GREY, Align::Left);
    let crs = match model.crs.epsg() {
        Some(_) => format!("{} · {}", model.crs, model.crs.name()),
        None => model.crs.name().to_owned(),
    };
    let bottom = frame.top + frame.height + 32.0 * unit;
    canvas.text(&crs, [frame.left, bottom], 14.0 * unit, GREY, Align::Left);
}

/// A bar of a round length, about a fifth of the frame, in its lower left corner.
fn scale_bar(canvas: &mut Canvas, to_px: &Placement, frame: &Frame, unit: f32) {
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
fn north_arrow(canvas: &mut Canvas, frame: &Frame, unit: f32) {
    let (x, y) = (frame.left + frame.width - 30.0 * unit, frame.top + 24.0 * unit);
    let plate =
        [[-20.0, -16.0], [20.0, -16.0], [20.0, 62.0], [-20.0, 62.0]].map(|[dx, dy]| [x + dx * unit, y + dy * unit]);
    canvas.fill_rings(&[plate.to_vec()], WHITE);
    let half = |sign: f32| vec![[x, y - 8.0 * unit], [x + sign * 10.0 * unit, y + 30.0 * unit], [x, y + 22.0 * unit]];
    canvas.fill_rings(&[half(-1.0)], INK);
    canvas.stroke_rings(&[half(1.0)], Pen::new(INK, 1.2 * unit));
    canvas.text("N", [x, y + 52.0 * unit], 18.0 * unit, INK, Align::Centre);
}

/// The column right of the map.
struct Legend<'a> {
    canvas: &'a mut Canvas,
    left: f32,
    unit: f32,
}

impl Legend<'_> {
    fn draw(mut self, frame: &Frame, range: &HeightRange, records: &[BuildingRecord], note: Option<&str>) {
        let unit = self.unit;
        let bar_top = frame.top + 44.0 * unit;
        let bar_height = (0.45 * frame.height).min(380.0 * unit);
        self.canvas.text("height, m", [self.left, frame.top + 18.0 * unit], 17.0 * unit, INK, Align::Left);
        self.bar(range, bar_top, bar_height);
        let mut y = bar_top + bar_height + 50.0 * unit;
        let count = |holds: &dyn Fn(&BuildingRecord) -> bool| records.iter().filter(|r| holds(r)).count();
        let n_doubtful = count(&|r| r.height_m.is_some() && matches!(r.status, Status::Doubtful | Status::Fallback));
        let n_unknown = count(&|r| r.height_m.is_none() && r.footprint.is_some());
        let n_absent = count(&|r| r.footprint.is_none());
        if n_doubtful > 0 {
            let middle = range.colour(0.4 * range.top_m);
            y = self.entry(y, &format!("doubtful or fallback: {n_doubtful}"), |canvas, swatch| {
                canvas.fill_rings(std::slice::from_ref(&swatch), middle);
                canvas.stroke_rings(&[swatch], Pen::new(ALERT, 2.2 * unit));
            });
        }
        if n_unknown > 0 {
            y = self.entry(y, &format!("height not known: {n_unknown}"), |canvas, swatch| {
                let rings = [swatch];
                canvas.fill_rings(&rings, NO_VALUE);
                canvas.hatch_rings(&rings, Pen::new(GREY, 1.0 * unit), 7.0 * unit);
                canvas.stroke_rings(&rings, Pen::new(INK, 0.9 * unit));
            });
        }
        let notes =
            (n_absent > 0).then(|| format!("{n_absent} without outline")).into_iter().chain(note.map(str::to_owned));
        for line in notes {
            self.canvas.text(&line, [self.left, y + 5.0 * unit], 14.0 * unit, GREY, Align::Left);
            y += 26.0 * unit;
        }
    }

    fn bar(&mut self, range: &HeightRange, top: f32, height: f32) {
        let unit = self.unit;
        let (width, n) = (26.0 * unit, height.ceil() as usize);
        for i in 0..n {
            let colour = ColourMap::Viridis.at(1.0 - (i as f64 + 0.5) / n as f64);
            self.canvas.fill_rect([self.left, top + i as f32], [width, (height - i as f32).min(1.0)], colour);
        }
        let rim = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|[x, y]| [self.left + x, top + y]);
        self.canvas.stroke_rings(&[rim.to_vec()], Pen::new(INK, 1.0 * unit));
        let step = scale::step(0.0, range.top_m, 6);
        for tick in scale::ticks(0.0, range.top_m, 6) {
            let y = top + height * (1.0 - (tick / range.top_m) as f32);
            let is_top = (tick - range.top_m).abs() < 1e-9;
            let prefix = if is_top && range.has_higher { "≥ " } else { "" };
            self.canvas.line(&[[self.left + width, y], [self.left + width + 6.0 * unit, y]], Pen::new(INK, 1.2 * unit));
            let label = format!("{prefix}{}", scale::label(tick, step));
            self.canvas.text(&label, [self.left + width + 12.0 * unit, y + 5.5 * unit], 15.0 * unit, INK, Align::Left);
        }
    }

    /// A swatch with a label; returns the next line's height.
    fn entry(&mut self, y: f32, label: &str, swatch: impl FnOnce(&mut Canvas, Vec<[f32; 2]>)) -> f32 {
        let unit = self.unit;
        let corners = [[0.0, -9.0], [26.0, -9.0], [26.0, 9.0], [0.0, 9.0]];
        swatch(self.canvas, corners.map(|[x, dy]| [self.left + x * unit, y + dy * unit]).to_vec());
        self.canvas.text(label, [self.left + 36.0 * unit, y + 5.0 * unit], 14.0 * unit, INK, Align::Left);
        y + 32.0 * unit
    }
}
