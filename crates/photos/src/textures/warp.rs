//! Colours of a photo on the surfaces that it shows. Each photo is decoded once, for all of them.

use glam::DVec2;
use image::{Rgb, RgbImage};
use rayon::prelude::*;

use super::TextureTask;
use super::chart::Chart;
use super::scene::SurfaceScene;
use super::views::{Candidate, Shown, StoredColours};
use sizeup_geo::files::{FileError, UnnamedFile};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::render::PlacedCamera;

/// A photo and its halves, quarters, …: sampled at a size of which one or two pixels make a texel.
struct Pyramid {
    levels: Vec<RgbImage>,
}

impl Pyramid {
    fn new(photo: RgbImage, n_levels: usize) -> Self {
        let mut levels = vec![photo];
        while levels.len() < n_levels {
            let Some(half) = levels.last().and_then(half) else { break };
            levels.push(half);
        }
        Self { levels }
    }

    /// Colour at a share of width and height, bicubic: bilinear values blur what is sampled at about its own size.
    fn colour(&self, level: usize, share: DVec2) -> [f32; 3] {
        let picture = &self.levels[level.min(self.levels.len() - 1)];
        bicubic(picture, share.x * f64::from(picture.width()), share.y * f64::from(picture.height()))
    }
}

/// Colour of a picture at a place, pixels from its upper left corner; its border repeated beyond it.
pub(super) fn bilinear(picture: &RgbImage, x: f64, y: f64) -> [f32; 3] {
    let (last_x, last_y) = (picture.width() - 1, picture.height() - 1);
    let (x, y) = ((x - 0.5).clamp(0.0, f64::from(last_x)), (y - 0.5).clamp(0.0, f64::from(last_y)));
    let (col, row) = (x as u32, y as u32);
    let (fx, fy) = ((x - f64::from(col)) as f32, (y - f64::from(row)) as f32);
    let (right, below) = ((col + 1).min(last_x), (row + 1).min(last_y));
    let at = |x: u32, y: u32| picture.get_pixel(x, y).0.map(f32::from);
    let (a, b, c, d) = (at(col, row), at(right, row), at(col, below), at(right, below));
    std::array::from_fn(|i| {
        let (above, under) = (a[i] + (b[i] - a[i]) * fx, c[i] + (d[i] - c[i]) * fx);
        above + (under - above) * fy
    })
}

/// The same, by the cubic of Catmull and Rom through four pixels each way.
fn bicubic(picture: &RgbImage, x: f64, y: f64) -> [f32; 3] {
    let weights = |t: f32| {
        let (t2, t3) = (t * t, t * t * t);
        [-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, -0.5 * t2 + 0.5 * t3]
    };
    let (x, y) = (x - 0.5, y - 0.5);
    let (col, row) = (x.floor(), y.floor());
    let (across, down) = (weights((x - col) as f32), weights((y - row) as f32));
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let is_within = |v: f64, n: usize| v >= 1.0 && v + 2.0 < n as f64;
    if is_within(col, width) && is_within(row, height) {
        // All sixteen are in the picture: most places.
        let mut sum = [0.0_f32; 3];
        let first = 3 * ((row as usize - 1) * width + col as usize - 1);
        for (j, wy) in down.iter().enumerate() {
            let four = &picture.as_raw()[first + 3 * j * width..][..12];
            for (c, sum) in sum.iter_mut().enumerate() {
                let value = |i: usize| across[i] * f32::from(four[3 * i + c]);
                *sum += wy * (value(0) + value(1) + value(2) + value(3));
            }
        }
        return sum.map(|v| v.clamp(0.0, 255.0));
    }
    let clamped = |v: f64, n: u32| v.clamp(0.0, f64::from(n - 1)) as u32;
    let mut sum = [0.0; 3];
    for (j, wy) in down.iter().enumerate() {
        let v = clamped(row + j as f64 - 1.0, picture.height());
        for (i, wx) in across.iter().enumerate() {
            let pixel = picture.get_pixel(clamped(col + i as f64 - 1.0, picture.width()), v);
            sum.iter_mut().zip(pixel.0).for_each(|(sum, value)| *sum += wx * wy * f32::from(value));
        }
    }
    sum.map(|v: f32| v.clamp(0.0, 255.0))
}

/// A picture at half its size; `None` for one of a single row or column.
fn half(picture: &RgbImage) -> Option<RgbImage> {
    let (width, height) = (picture.width() / 2, picture.height() / 2);
    let mean = |x: u32, y: u32| {
        let at = |dx: u32, dy: u32| picture.get_pixel(2 * x + dx, 2 * y + dy).0.map(u16::from);
        let (a, b, c, d) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
        Rgb(std::array::from_fn(|i| ((a[i] + b[i] + c[i] + d[i] + 2) / 4) as u8))
    };
    (width > 0 && height > 0).then(|| RgbImage::from_fn(width, height, mean))
}

/// Colours of a photo on its surfaces, or why it cannot be read.
type OfPhoto = Result<Vec<Option<StoredColours>>, String>;

/// Lays the colours of all photos into the file, for the candidates; those of photos that cannot be read are taken out. Returns what is to
/// be told of such photos, in the survey's order.
///
/// # Errors
/// [`FileError`]: no room for the colours.
pub(super) fn fill(
    task: &TextureTask<'_>,
    scene: &SurfaceScene,
    charts: &[Option<Chart>],
    candidates: &mut [Vec<Candidate>],
    file: &UnnamedFile,
) -> Result<Vec<Issue>, FileError> {
    let mut of_view: Vec<Vec<(usize, usize)>> = vec![Vec::new(); task.views.len()];
    for (surface, of_surface) in candidates.iter().enumerate() {
        of_surface.iter().enumerate().for_each(|(k, candidate)| of_view[candidate.view].push((surface, k)));
    }
    // One photo per thread in memory.
    let painted: Result<Vec<(usize, OfPhoto)>, FileError> = (0..task.views.len())
        .into_par_iter()
        .with_max_len(1)
        .filter(|&view| !of_view[view].is_empty())
        .map(|view| match (task.decode)(&task.views[view]) {
            Ok(photo) => {
                Ok((view, Ok(colours(task, scene, charts, candidates, (view, photo), (&of_view[view], file))?)))
            }
            Err(reason) => Ok((view, Err(reason))),
        })
        .collect();
    let mut issues = Vec::new();
    for (view, colours) in painted? {
        match colours {
            Ok(colours) => {
                for (&(surface, k), colours) in of_view[view].iter().zip(colours) {
                    candidates[surface][k].stored = colours;
                }
            }
            Err(reason) => {
                let subject = Subject::View(task.views[view].id.0.clone());
                let issue = Issue::new(
                    Severity::Warning,
                    "photo_unreadable",
                    subject,
                    format!("no texture comes from it: {reason}"),
                );
                issues.push(
                    issue.hint("put the photo back, or save it again; other photos paint its surfaces meanwhile"),
                );
            }
        }
    }
    candidates.iter_mut().for_each(|of_surface| of_surface.retain(|candidate| candidate.stored.is_some()));
    Ok(issues)
}

fn colours(
    task: &TextureTask<'_>,
    scene: &SurfaceScene,
    charts: &[Option<Chart>],
    candidates: &[Vec<Candidate>],
    (view, photo): (usize, RgbImage),
    (places, file): (&[(usize, usize)], &UnnamedFile),
) -> Result<Vec<Option<StoredColours>>, FileError> {
    let of = &task.views[view];
    let level_of = |(surface, k): (usize, usize)| candidates[surface][k].pixels_per_texel.max(1.0).log2() as usize;
    let n_levels = places.iter().map(|place| level_of(*place) + 1).max().unwrap_or(1);
    let pyramid = Pyramid::new(photo, n_levels);
    let camera = PlacedCamera::new((*of.camera).clone(), of.camera_from_map, task.origin);
    let size = DVec2::new(f64::from(of.camera.width_px), f64::from(of.camera.height_px));
    let of_place = |&(surface, k): &(usize, usize)| {
        let Some(chart) = charts[surface].as_ref() else { return Ok(None) };
        let (facet, level) = (&scene.facets[surface], level_of((surface, k)));
        let seen = |x: u32, y: u32| camera.project(facet.point(chart.place(x, y)).as_dvec3());
        let first = candidates[surface][k].first_texels(chart);
        let mut texels = Vec::with_capacity(first[chart.cells.len()] as usize);
        for cell in (0..chart.cells.len()).filter(|cell| first[*cell] < first[cell + 1]) {
            let image = CellImage::of(chart.corners_of(cell as u32), &seen);
            for (x, y) in chart.texels_of(cell as u32) {
                // Beside the surface no colour is asked for.
                let place = if chart.is_inside(x, y) { image.at(x, y, &seen) } else { None };
                let colour = place.map_or([0.0; 3], |at| pyramid.colour(level, at / size)).map(|v| (v + 0.5) as u8);
                texels.push(colour);
            }
        }
        StoredColours::put(file, chart, &first, &texels).map(Some)
    };
    places.par_iter().map(of_place).collect()
}

/// Pixels of the texels of a cell: between those of its corners, as a camera changes too little over half a metre to be asked for each texel. Seen
/// from 80 m with a focal length of 4,000 pixels, that is off by 0.04 pixels at most (`f s² / 4 Z²`).
struct CellImage {
    first: [u32; 2],
    /// One by columns and rows from the first to the last texel; 1 where there is one only.
    n_steps: [f64; 2],
    /// Upper left, upper right, lower left and lower right corner; `None` where one of them is not in front of the camera.
    corners: Option<[DVec2; 4]>,
}

impl CellImage {
    fn of([first, last]: [[u32; 2]; 2], seen: &impl Fn(u32, u32) -> Option<DVec2>) -> Self {
        let corners = || {
            let above = [seen(first[0], first[1])?, seen(last[0], first[1])?];
            let below = [seen(first[0], last[1])?, seen(last[0], last[1])?];
            Some([above[0], above[1], below[0], below[1]])
        };
        let n_steps = [0, 1].map(|axis| f64::from(last[axis] - first[axis]).max(1.0));
        Self { first, n_steps, corners: corners() }
    }

    /// Pixel of a texel.
    fn at(&self, x: u32, y: u32, seen: &impl Fn(u32, u32) -> Option<DVec2>) -> Option<DVec2> {
        let Some([a, b, c, d]) = self.corners else { return seen(x, y) };
        let u = f64::from(x - self.first[0]) / self.n_steps[0];
        let v = f64::from(y - self.first[1]) / self.n_steps[1];
        Some(a.lerp(b, u).lerp(c.lerp(d, u), v))
    }
}

/// Cells that two candidates both show clearly.
pub(super) fn shared<'a>(a: &'a Candidate, b: &'a Candidate) -> impl Iterator<Item = usize> + 'a {
    (0..a.shown.len()).filter(|&cell| a.shown[cell] == Shown::Clear && b.shown[cell] == Shown::Clear)
}
