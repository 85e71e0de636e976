//! A plan of the buildings, in the colours of the classes of heights.

use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canvas::{Align, Canvas, Pen};
use super::colour::{ALERT, GREY, INK, NO_VALUE, Rgb, WHITE, height_classes, height_colour};
use super::plan::{MapFrame, MapSheet, ShownRegion};
use super::warning;
use crate::output::{BuildingRecord, CityModel, Status, StatusCount};
use sizeup_survey::{View, ViewKind};

/// Settings of the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MapConfig {
    /// Width of the picture, pixels, 600 to 8000.
    pub width_px: u32,
    /// Whether to draw the cameras over the buildings; `pictures/survey.png` shows them by themselves.
    pub cameras: bool,
    /// Heading; the number of buildings by default.
    pub title: Option<String>,
}

impl Default for MapConfig {
    fn default() -> Self {
        Self { width_px: 1600, cameras: false, title: None }
    }
}

/// Free margin around the buildings, share of their larger side.
const MARGIN_SHARE: f64 = 0.05;
/// Growth of the map to take cameras in, share of the buildings' larger side: beyond it the buildings get small.
const CAMERA_REACH_SHARE: f64 = 0.35;

/// Room for the north arrow, pixels of the reference width.
const ARROW: f32 = 50.0;

/// Draws footprints coloured by height, with a legend.
#[must_use]
pub fn map(model: &CityModel<'_>, config: &MapConfig) -> RgbImage {
    let views: &[View] = if config.cameras { &model.survey.views } else { &[] };
    let region = region_of(model.records, views);
    let mut sheet = MapSheet::new(&region, config.width_px);
    buildings(&mut sheet, model.records);
    let n_drawn = cameras(&mut sheet, views);
    let told = model.issues.iter().filter(|issue| issue.code == "result_implausible");
    let told: Vec<String> = told.map(|issue| issue.message.clone()).collect();
    warning::band(
        &mut sheet.canvas,
        [sheet.frame.left, sheet.frame.top],
        sheet.frame.width - ARROW * sheet.unit,
        &told,
    );
    sheet.furnish();
    headings(&mut sheet, model, config);
    let note =
        (config.cameras && !views.is_empty()).then(|| format!("{n_drawn} of {} cameras in the map", views.len()));
    let (left, unit) = (sheet.legend_left(), sheet.unit);
    Legend { canvas: &mut sheet.canvas, left, unit }.draw(&sheet.frame, model.records, note.as_deref());
    sheet.canvas.into_image()
}

/// Around the buildings, and the cameras near them.
fn region_of(records: &[BuildingRecord], views: &[View]) -> ShownRegion {
    let footprints = || records.iter().filter_map(|r| r.footprint.as_ref());
    let points = || footprints().flat_map(|p| p.exterior().coords()).map(|c| [c.x, c.y]);
    let buildings = ShownRegion::around(points(), 0.0);
    let side_m = buildings.width_m().max(buildings.height_m());
    let centres = views.iter().map(|v| v.camera_from_map.centre()).map(|c| [c.x, c.y]);
    let near = centres.filter(|c| buildings.is_near(*c, CAMERA_REACH_SHARE * side_m));
    ShownRegion::around(buildings.corners().into_iter().chain(near), MARGIN_SHARE)
}

fn buildings(sheet: &mut MapSheet, records: &[BuildingRecord]) {
    let MapSheet { canvas, to_px, unit, .. } = sheet;
    let unit = *unit;
    for record in records {
        let Some(footprint) = &record.footprint else { continue };
        let rings = to_px.rings(footprint);
        if let Some(height_m) = record.height_m {
            canvas.fill_rings(&rings, height_colour(height_m));
            match record.status {
                Status::Doubtful => canvas.hatch_rings(&rings, Pen::new(ALERT, 1.6 * unit), 9.0 * unit),
                Status::Fallback => canvas.hatch_rings(&rings, Pen::new(GREY, 1.0 * unit), 7.0 * unit),
                _ => {}
            }
        } else {
            canvas.fill_rings(&rings, NO_VALUE);
            canvas.hatch_rings(&rings, Pen::new(GREY, 1.0 * unit), 7.0 * unit);
        }
        canvas.stroke_rings(&rings, edge_pen(record, unit));
    }
}

/// A colour for swatches that stand for any height.
fn middle_colour() -> Rgb {
    let classes = height_classes();
    classes[classes.len() / 2].colour
}

/// Whether a height deserves a second look.
fn is_doubtful(record: &BuildingRecord) -> bool {
    record.height_m.is_some() && record.status == Status::Doubtful
}

fn edge_pen(record: &BuildingRecord, unit: f32) -> Pen {
    if is_doubtful(record) {
        return Pen::new(ALERT, 2.2 * unit);
    }
    Pen { colour: INK, opacity: 0.75, width_px: 0.9 * unit }
}

/// Draws the cameras within the frame; returns how many.
fn cameras(sheet: &mut MapSheet, views: &[View]) -> usize {
    let MapSheet { canvas, frame, to_px, unit } = sheet;
    let unit = *unit;
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

fn headings(sheet: &mut MapSheet, model: &CityModel<'_>, config: &MapConfig) {
    let count = StatusCount::of(model.records);
    let without: usize = count.by_status().iter().filter(|(s, _)| **s >= Status::Unknown).map(|(_, n)| n).sum();
    let n_known = count.n_buildings() - without;
    let title = config.title.clone().unwrap_or_else(|| "Building heights above ground".to_owned());
    let date = model.lineage.reference_date.as_deref().map(|date| format!(" · {date}")).unwrap_or_default();
    let below = format!("{n_known} of {} buildings have a height{date}", count.n_buildings());
    sheet.headings(&title, &below, model.crs);
}

/// The column right of the map.
struct Legend<'a> {
    canvas: &'a mut Canvas,
    left: f32,
    unit: f32,
}

impl Legend<'_> {
    fn draw(mut self, frame: &MapFrame, records: &[BuildingRecord], note: Option<&str>) {
        let unit = self.unit;
        let bar_top = frame.top + 44.0 * unit;
        let bar_height = (0.45 * frame.height).min(380.0 * unit);
        self.canvas.text("height, m", [self.left, frame.top + 18.0 * unit], 17.0 * unit, INK, Align::Left);
        self.bar(bar_top, bar_height);
        let mut y = bar_top + bar_height + 50.0 * unit;
        let count = |holds: &dyn Fn(&BuildingRecord) -> bool| records.iter().filter(|r| holds(r)).count();
        let n_doubtful = count(&is_doubtful);
        let n_fallback = count(&|r| r.height_m.is_some() && r.status == Status::Fallback);
        let n_unknown = count(&|r| r.height_m.is_none() && r.footprint.is_some());
        let n_absent = count(&|r| r.footprint.is_none());
        if n_doubtful > 0 {
            let middle = middle_colour();
            y = self.entry(y, &format!("doubtful: {n_doubtful}"), |canvas, swatch| {
                let rings = [swatch];
                canvas.fill_rings(&rings, middle);
                canvas.hatch_rings(&rings, Pen::new(ALERT, 1.6 * unit), 9.0 * unit);
                canvas.stroke_rings(&rings, Pen::new(ALERT, 2.2 * unit));
            });
        }
        if n_fallback > 0 {
            let middle = middle_colour();
            y = self.entry(y, &format!("not measured: {n_fallback}"), |canvas, swatch| {
                let rings = [swatch];
                canvas.fill_rings(&rings, middle);
                canvas.hatch_rings(&rings, Pen::new(GREY, 1.0 * unit), 7.0 * unit);
                canvas.stroke_rings(&rings, Pen::new(INK, 0.9 * unit));
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
            (n_absent > 0).then(|| format!("{n_absent} without footprint")).into_iter().chain(note.map(str::to_owned));
        for line in notes {
            self.canvas.text(&line, [self.left, y + 5.0 * unit], 14.0 * unit, GREY, Align::Left);
            y += 26.0 * unit;
        }
    }

    /// The classes as blocks, the lowest at the bottom, with their bounds.
    fn bar(&mut self, top: f32, height: f32) {
        let unit = self.unit;
        let classes = height_classes();
        let (width, step) = (26.0 * unit, height / classes.len() as f32);
        let left = self.left;
        for (i, class) in classes.iter().enumerate() {
            let y = top + height - (i + 1) as f32 * step;
            self.canvas.fill_rect([left, y], [width, step], class.colour);
            if class.below_m.is_finite() {
                self.canvas.line(&[[left + width, y], [left + width + 6.0 * unit, y]], Pen::new(INK, 1.2 * unit));
                let at = [left + width + 12.0 * unit, y + 5.5 * unit];
                self.canvas.text(&format!("{}", class.below_m), at, 15.0 * unit, INK, Align::Left);
            }
        }
        let rim = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|[x, y]| [left + x, top + y]);
        self.canvas.stroke_rings(&[rim.to_vec()], Pen::new(INK, 1.0 * unit));
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
