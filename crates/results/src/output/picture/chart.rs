//! Line charts: curves and marks over two axes with round ticks, both from 0.

use image::RgbImage;

use super::canvas::{Align, Canvas, Pen};
use super::colour::{ALERT, GREY, INK, NO_VALUE, Rgb};
use super::scale::{label, step, ticks};

/// Style of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// A line through the points.
    Line,
    /// A disc at each point.
    Marks,
}

/// Points with a name in the legend; an empty name is left out of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// `(x, y)`; points that are not finite break the line.
    pub points: Vec<[f64; 2]>,
    /// Way in which the points are drawn.
    pub stroke: Stroke,
    /// Colour of line and points.
    pub colour: Rgb,
}

/// A chart of series over two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Title above the chart.
    pub title: String,
    /// Below the horizontal axis, with the unit.
    pub x_label: String,
    /// Above the vertical axis, with the unit.
    pub y_label: String,
    /// Drawn in this order.
    pub series: Vec<Series>,
}

/// Colours that colour-blind people tell apart (Okabe and Ito, 2008).
pub const SERIES_COLOURS: [Rgb; 5] = [[0, 114, 178], ALERT, [0, 158, 115], [204, 121, 167], [86, 180, 233]];

/// Margins around the plot, pixels: left, right, top, bottom.
const MARGINS: [f32; 4] = [84.0, 24.0, 84.0, 62.0];

/// Draws a chart of a size in pixels, 300 × 200 or larger.
#[must_use]
pub fn chart(chart: &Chart, width_px: u32, height_px: u32) -> RgbImage {
    let (width, height) = (width_px.max(300) as f32, height_px.max(200) as f32);
    let mut canvas = Canvas::new(width as u32, height as u32);
    let [left, right, top, bottom] = MARGINS;
    let values = |i: usize| chart.series.iter().flat_map(|s| &s.points).map(move |p| p[i]);
    let axes = Axes { x: range(values(0)), y: range(values(1)), frame: [left, top, width - right, height - bottom] };
    canvas.text(&chart.title, [left, 30.0], 19.0, INK, Align::Left);
    axes.draw(&mut canvas, chart);
    for series in &chart.series {
        draw_series(&mut canvas, &axes, series);
    }
    let mut x = left + canvas.text_width(&chart.y_label, 14.0) + 28.0;
    for series in chart.series.iter().filter(|s| !s.name.is_empty()) {
        canvas.fill_rect([x, top - 22.0], [14.0, 6.0], series.colour);
        canvas.text(&series.name, [x + 20.0, top - 14.0], 14.0, GREY, Align::Left);
        x += 40.0 + canvas.text_width(&series.name, 14.0);
    }
    canvas.into_image()
}

/// Least and greatest finite value; nothing to see gives both infinite.
fn extent(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let finite = values.filter(|v| v.is_finite());
    finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

/// From 0, or the least value below it, to the greatest, with some room; 0 to 1 where there is none.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = extent(values);
    if !low.is_finite() {
        return [0.0, 1.0];
    }
    let low = low.min(0.0);
    let room = 0.04 * if high > low { high - low } else { high.abs().max(1.0) };
    [if low == 0.0 { 0.0 } else { low - room }, high + room]
}

struct Axes {
    x: [f64; 2],
    y: [f64; 2],
    /// Left, top, right, bottom; pixels.
    frame: [f32; 4],
}

impl Axes {
    fn at(&self, [x, y]: [f64; 2]) -> [f32; 2] {
        let [left, top, right, bottom] = self.frame;
        let share = |v: f64, [low, high]: [f64; 2]| ((v - low) / (high - low)) as f32;
        [left + share(x, self.x) * (right - left), bottom - share(y, self.y) * (bottom - top)]
    }

    fn draw(&self, canvas: &mut Canvas, chart: &Chart) {
        let [left, top, right, bottom] = self.frame;
        let grid = Pen::new(NO_VALUE, 1.0);
        for tick in ticks(self.x[0], self.x[1], 7) {
            let [x, _] = self.at([tick, self.y[0]]);
            canvas.line(&[[x, top], [x, bottom]], grid);
            canvas.text(&label(tick, step(self.x[0], self.x[1], 7)), [x, bottom + 20.0], 14.0, GREY, Align::Centre);
        }
        for tick in ticks(self.y[0], self.y[1], 6) {
            let [_, y] = self.at([self.x[0], tick]);
            canvas.line(&[[left, y], [right, y]], grid);
            canvas.text(&label(tick, step(self.y[0], self.y[1], 6)), [left - 8.0, y + 5.0], 14.0, GREY, Align::Right);
        }
        canvas.text(&chart.y_label, [left, top - 14.0], 14.0, INK, Align::Left);
        canvas.text(&chart.x_label, [0.5 * (left + right), bottom + 46.0], 14.0, INK, Align::Centre);
        canvas.line(&[[left, top], [left, bottom], [right, bottom]], Pen::new(GREY, 1.5));
    }
}

fn draw_series(canvas: &mut Canvas, axes: &Axes, series: &Series) {
    let is_known = |p: &[f64; 2]| axes.at(*p).iter().all(|v| v.is_finite());
    if series.stroke == Stroke::Marks {
        for point in series.points.iter().filter(|p| is_known(p)) {
            canvas.disc(axes.at(*point), 4.5, series.colour, Pen::new([255, 255, 255], 1.0));
        }
        return;
    }
    let pen = Pen::new(series.colour, 2.2);
    for stretch in series.points.split(|p| !is_known(p)).filter(|s| s.len() > 1) {
        let line: Vec<[f32; 2]> = stretch.iter().map(|p| axes.at(*p)).collect();
        canvas.line(&line, pen);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_crosses_the_plot_in_its_colour_and_nothing_breaks_without_points() {
        let series = |points: Vec<[f64; 2]>| Series {
            name: "a".to_owned(),
            points,
            stroke: Stroke::Line,
            colour: SERIES_COLOURS[0],
        };
        let of = |points| Chart {
            title: "t".to_owned(),
            x_label: "x".to_owned(),
            y_label: "y".to_owned(),
            series: vec![series(points)],
        };
        let drawn = chart(&of(vec![[0.0, 0.0], [10.0, 5.0], [f64::NAN, 1.0]]), 600, 400);
        let blue = drawn.pixels().filter(|p| p.0 == SERIES_COLOURS[0]).count();
        assert!(blue > 400, "{blue}");
        let empty = chart(&of(Vec::new()), 600, 400);
        assert_eq!(empty.dimensions(), (600, 400));
    }
}
