//! Sloping surfaces: planes of any slope are handed from pixel to pixel where a level one explains the pictures badly (`PatchMatch`
//! stereo: Bleyer, Rhemann and Rother 2011, doi:10.5244/C.25.14).
//!
//! A plane is the inverse of depth, which is linear over the picture. With `M = Rᵣᵀ·Kᵣ⁻¹` (pixel to direction in the map), the
//! projection centres `C`, a point `X` of the plane and its upright normal `N = (−∂z/∂x, −∂z/∂y, 1)`:
//!
//! ```text
//! 1/depth at u = w(u) = N·M·u / (N·(X − C))        N ∝ M⁻ᵀ·(∂w/∂u, ∂w/∂v, w(0))
//! u lies in a neighbour at  A·u + w(u)·b           A = Kₛ·Rₛ·M,  b = Kₛ·Rₛ·(Cᵣ − Cₛ)
//! ```
//!
//! A level plane starts at every height that was chosen. Pixels that it does not explain well take over the planes of those beside
//! them, try others nearby, and keep what correlates best, by the same rule as levels: the mean of the better half of the neighbours.
//! A slope has to pay: it is kept where it correlates better by [`LEAST_GAIN`]. Numbers of chance hang on the pixel alone, so that
//! the same photos give the same depth.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use std::sync::Arc;

use fearless_simd::{Level, dispatch};
use glam::{DMat3, DVec2, DVec3, Mat3, Vec3};

use super::correlate::{LEAST_VARIANCE, NeighbourImage};
use super::levels::Levels;
use sizeup_heights::picture::{Picture, PosedCamera};
use sizeup_heights::raster::Raster;

/// Samples along a side of the window.
const SIDE: usize = 5;
/// Samples of a window.
const N: usize = SIDE * SIDE;
/// As many numbers as the processor's vectors hold at a time; those beyond the samples repeat the middle.
const LANES: usize = 32;
/// Columns and rows of the samples from the middle.
const COLS: [f32; LANES] = steps(false);
const ROWS: [f32; LANES] = steps(true);

const fn steps(are_rows: bool) -> [f32; LANES] {
    let mut steps = [0.0; LANES];
    let mut i = 0;
    while i < N {
        let at = if are_rows { i / SIDE } else { i % SIDE };
        steps[i] = at as f32 - (SIDE / 2) as f32;
        i += 1;
    }
    steps
}
/// A level plane that correlates so well is not doubted.
const EXPLAINED: f32 = 0.85;
/// Nor is one that correlates so well amid heights that differ by so few levels.
const EXPLAINED_AMID_SAME: f32 = 0.65;
const SAME_LEVELS: f64 = 1.5;
/// Distance around a pixel within which that is asked, pixels.
const AMID_PX: usize = 2;
/// Planes near one that correlates worse are not tried.
const WORTH_TRYING: f32 = 0.3;
/// Planes that are nearer, as a share of depth over the window, are one.
const SAME_PLANE: f32 = 2e-4;
/// A slope has to correlate so much better than the level plane.
const LEAST_GAIN: f32 = 0.05;
/// And so much better than what the least correlation asks for where there was no level plane.
const LEAST_GAIN_OF_NEW: f64 = 0.1;
/// Steepest roof, as the tangent of its slope: 56 degrees. Walls are no surfaces to look for.
const STEEPEST: f64 = 1.5;
/// Times that planes are handed on, each the other way round.
const N_PASSES: usize = 4;
/// Greatest difference of the first tried plane from the one at hand: slope, and levels. Halved from pass to pass.
const FIRST_SLOPE: f64 = 1.0;
const FIRST_LEVELS: f64 = 1.0;
/// Planes tried nearby, per pixel and pass.
const N_TRIED: usize = 2;

/// Inverse of z-depth over the picture, as seen from one pixel: there, per pixel to the right, per pixel downwards, 1/metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct DepthPlane {
    w: f32,
    right: f32,
    down: f32,
}

impl DepthPlane {
    const NONE: Self = Self { w: f32::NAN, right: 0.0, down: 0.0 };

    /// Whether nobody could tell them apart within so many pixels.
    #[inline(always)]
    fn is_like(self, other: Self, within_px: f32) -> bool {
        let apart = |a: f32, b: f32| (a - b).abs();
        let slopes = apart(self.right, other.right) + apart(self.down, other.down);
        apart(self.w, other.w) + within_px * slopes < SAME_PLANE * self.w
    }

    /// The same plane seen from a pixel so far aside.
    fn seen_from_aside(self, cols: f32, rows: f32) -> Self {
        Self { w: self.w + cols * self.right + rows * self.down, ..self }
    }
}

/// Way of the view's pixels into a neighbour.
struct NeighbourWarp<'a> {
    neighbour: &'a NeighbourImage,
    a: Mat3,
    b: Vec3,
}

/// Evidence that planes are judged by.
struct Judge<'a> {
    grey: &'a Raster<f32>,
    ways: Vec<NeighbourWarp<'a>>,
    /// Between samples of a window, pixels.
    step_px: i32,
}

/// The samples of a window in the view: mean 0, and one by the root of their sum of squares; `None` without texture.
struct SampledWindow {
    values: [f32; N],
    per_norm: f32,
}

impl Judge<'_> {
    #[inline(always)]
    fn window(&self, col: usize, row: usize) -> Option<SampledWindow> {
        let reach = self.step_px as usize * (SIDE / 2);
        let is_inside =
            col >= reach && row >= reach && col + reach < self.grey.width() && row + reach < self.grey.height();
        if !is_inside {
            return None;
        }
        let mut values = [0.0; N];
        for (i, line) in values.chunks_exact_mut(SIDE).enumerate() {
            let row = row - reach + i * self.step_px as usize;
            for (j, value) in line.iter_mut().enumerate() {
                *value = self.grey[(col - reach + j * self.step_px as usize, row)];
            }
        }
        let mean = values.iter().sum::<f32>() / N as f32;
        values.iter_mut().for_each(|v| *v -= mean);
        let squares = values.iter().map(|v| v * v).sum::<f32>();
        (squares > LEAST_VARIANCE * N as f32).then(|| SampledWindow { values, per_norm: 1.0 / squares.sqrt() })
    }

    /// Mean of the better half of the correlations, −1 where no neighbour sees the whole window.
    #[inline(always)]
    fn score(&self, col: usize, row: usize, window: &SampledWindow, plane: DepthPlane) -> f32 {
        /// Most neighbours of a view.
        const MOST: usize = 16;
        let mut found = [-1.0_f32; MOST];
        let mut n = 0;
        let pixel = Vec3::new(col as f32 + 0.5, row as f32 + 0.5, 1.0);
        for way in self.ways.iter().take(MOST) {
            if let Some(score) = correlation(way, pixel, self.step_px as f32, window, plane) {
                found[n] = score;
                n += 1;
            }
        }
        if n == 0 {
            return -1.0;
        }
        let found = &mut found[..n];
        found.sort_unstable_by(|a, b| b.total_cmp(a));
        let half = &found[..n.div_ceil(2)];
        half.iter().sum::<f32>() / half.len() as f32
    }
}

/// Correlation of a window with what a neighbour sees of the plane; `None` where it does not see all of it.
#[inline(always)]
fn correlation(
    way: &NeighbourWarp<'_>,
    pixel: Vec3,
    step_px: f32,
    window: &SampledWindow,
    plane: DepthPlane,
) -> Option<f32> {
    let middle = way.a * pixel + way.b * plane.w;
    let right = step_px * (way.a.x_axis + way.b * plane.right);
    let down = step_px * (way.a.y_axis + way.b * plane.down);
    let (mut x, mut y) = ([0.0_f32; LANES], [0.0_f32; LANES]);
    for i in 0..LANES {
        let z = middle.z + COLS[i] * right.z + ROWS[i] * down.z;
        // Behind the camera is nowhere.
        let per_z = if z > 0.0 { 1.0 / z } else { f32::NAN };
        x[i] = (middle.x + COLS[i] * right.x + ROWS[i] * down.x) * per_z - 0.5;
        y[i] = (middle.y + COLS[i] * right.y + ROWS[i] * down.y) * per_z - 0.5;
    }
    let (last_x, last_y) = way.neighbour.last();
    let mut is_seen = true;
    for i in 0..LANES {
        #[expect(clippy::needless_bitwise_bool, reason = "a branch would keep the loop from the vector unit")]
        let is_inside = (x[i] >= 0.0) & (y[i] >= 0.0) & (x[i] < last_x) & (y[i] < last_y);
        is_seen &= is_inside;
    }
    if !is_seen {
        return None;
    }
    let mut b = [0.0_f32; N];
    for i in 0..N {
        b[i] = way.neighbour.at(x[i], y[i]);
    }
    let (mut sum, mut squares, mut products) = (0.0, 0.0, 0.0);
    for (b, a) in b.iter().zip(&window.values) {
        sum += b;
        squares += b * b;
        products += a * b;
    }
    let spread = squares - sum * sum / N as f32;
    Some(if spread > LEAST_VARIANCE * N as f32 { products * window.per_norm / spread.sqrt() } else { 0.0 })
}

/// The view's side of the formulas above.
struct ViewFrame {
    centre: DVec3,
    map_from_pixel: DMat3,
    normal_from_plane: DMat3,
}

impl ViewFrame {
    fn of(ideal: &PosedCamera) -> Self {
        let pose = &ideal.camera_from_map;
        let map_from_pixel = pose.rotation.transpose() * ideal.calibration().inverse();
        let normal_from_plane = (ideal.calibration() * pose.rotation).transpose();
        Self { centre: pose.centre(), map_from_pixel, normal_from_plane }
    }

    fn ray(&self, pixel: DVec2) -> DVec3 {
        self.map_from_pixel * pixel.extend(1.0)
    }

    /// The plane with a slope (∂z/∂x, ∂z/∂y) that stands at a height in a pixel.
    fn plane(&self, pixel: DVec2, z_m: f64, slope: DVec2) -> DepthPlane {
        let ray = self.ray(pixel);
        let depth = (z_m - self.centre.z) / ray.z;
        let normal = DVec3::new(-slope.x, -slope.y, 1.0);
        let g = self.map_from_pixel.transpose() * normal / (depth * normal.dot(ray));
        DepthPlane { w: (1.0 / depth) as f32, right: g.x as f32, down: g.y as f32 }
    }

    /// Height in the pixel, metres, and slope.
    fn height_and_slope(&self, pixel: DVec2, plane: DepthPlane) -> (f64, DVec2) {
        let [w, right, down] = [plane.w, plane.right, plane.down].map(f64::from);
        let normal = self.normal_from_plane * DVec3::new(right, down, w - right * pixel.x - down * pixel.y);
        let z_m = self.centre.z + self.ray(pixel).z / w;
        (z_m, -DVec2::new(normal.x, normal.y) / normal.z)
    }
}

/// Numbers from −1 to 1 that hang on a pixel, a pass and a count alone.
fn chance(seed: [usize; 3], k: u64) -> f64 {
    let mut x = (seed[0] as u64) << 24 ^ (seed[1] as u64) << 16 ^ (seed[2] as u64) << 8 ^ k;
    x = x.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (x ^ (x >> 31)) as f64 / u64::MAX as f64 * 2.0 - 1.0
}

/// A view, its neighbours where they are looked from, and the planes that heights were chosen from.
pub(super) struct Slopes<'a> {
    pub reference: &'a Picture,
    pub others: &'a [Arc<Picture>],
    pub ideals: &'a [PosedCamera],
    pub levels: &'a Levels,
    /// Radius of the comparison window, pixels.
    pub radius_px: usize,
    /// Least correlation for which a height counts.
    pub min_score: f64,
}

impl Slopes<'_> {
    /// Heights with those of sloping surfaces in place of level ones where they explain the pictures better, and where there were none.
    pub(super) fn find(&self, heights_m: &Raster<f32>) -> Raster<f32> {
        let neighbours: Vec<NeighbourImage> =
            self.others.iter().map(|other| NeighbourImage::new(other.grey())).collect();
        let here = self.reference.posed();
        let frame = ViewFrame::of(here);
        let way = |(neighbour, there): (_, &PosedCamera)| {
            let pixel_from_map = there.calibration() * there.camera_from_map.rotation;
            let shift = here.camera_from_map.centre() - there.camera_from_map.centre();
            let (a, b) = (pixel_from_map * frame.map_from_pixel, pixel_from_map * shift);
            NeighbourWarp { neighbour, a: a.as_mat3(), b: b.as_vec3() }
        };
        let ways = neighbours.iter().zip(self.ideals).map(way).collect();
        let step_px = ((2 * self.radius_px) / (SIDE - 1)).max(1) as i32;
        let judge = Judge { grey: self.reference.grey(), ways, step_px };
        dispatch!(Level::new(), _simd => self.hand_on(&frame, &judge, heights_m))
    }

    #[inline(always)]
    fn hand_on(&self, frame: &ViewFrame, judge: &Judge<'_>, heights_m: &Raster<f32>) -> Raster<f32> {
        let mut field = PlaneField::of(frame, judge, heights_m);
        let level_scores = field.scores.clone();
        let is_explained: Vec<bool> =
            level_scores.iter().enumerate().map(|(i, score)| self.is_explained(heights_m, i, *score)).collect();
        let n = level_scores.len();
        for pass in 0..N_PASSES {
            let is_forth = pass % 2 == 0;
            for k in 0..n {
                let i = if is_forth { k } else { n - 1 - k };
                if is_explained[i] {
                    continue;
                }
                let Some(window) = judge.window(i % field.width, i / field.width) else { continue };
                field.take_over(judge, i, &window, is_forth);
                if field.scores[i] > WORTH_TRYING {
                    self.try_nearby(frame, judge, &mut field, i, &window, pass);
                }
            }
        }
        let settled = |i: usize| {
            let level_m = heights_m.data()[i];
            let new = (self.min_score + LEAST_GAIN_OF_NEW) as f32;
            let least = if level_m.is_nan() { new } else { level_scores[i] + LEAST_GAIN };
            if field.scores[i] < least {
                return level_m;
            }
            let (z_m, slope) = frame.height_and_slope(field.pixel(i), field.planes[i]);
            if self.is_roof(z_m, slope) { z_m as f32 } else { level_m }
        };
        Raster::from_vec(field.width, heights_m.height(), (0..n).map(settled).collect()).expect("one per pixel")
    }

    /// Whether a level plane that correlates so is left as it is.
    fn is_explained(&self, heights_m: &Raster<f32>, i: usize, score: f32) -> bool {
        if !(EXPLAINED_AMID_SAME..EXPLAINED).contains(&score) {
            return score >= EXPLAINED;
        }
        let (col, row) = (i % heights_m.width(), i / heights_m.width());
        let around = |at: usize, n: usize| at.saturating_sub(AMID_PX)..(at + AMID_PX + 1).min(n);
        let mut range_m = [f32::INFINITY, f32::NEG_INFINITY];
        for row in around(row, heights_m.height()) {
            for z in &heights_m.data()[row * heights_m.width()..][around(col, heights_m.width())] {
                if z.is_nan() {
                    return false;
                }
                range_m = [range_m[0].min(*z), range_m[1].max(*z)];
            }
        }
        f64::from(range_m[1] - range_m[0]) < SAME_LEVELS * self.levels.step_m(f64::from(range_m[0]))
    }

    /// Tries planes near the one at hand, nearer from pass to pass.
    #[inline(always)]
    fn try_nearby(
        &self,
        frame: &ViewFrame,
        judge: &Judge<'_>,
        field: &mut PlaneField,
        i: usize,
        window: &SampledWindow,
        pass: usize,
    ) {
        let share = 0.5_f64.powi(pass as i32);
        for tried in 0..N_TRIED {
            let (z_m, slope) = frame.height_and_slope(field.pixel(i), field.planes[i]);
            let random = |k: u64| share * chance([i, pass, tried], k);
            let slope = slope + FIRST_SLOPE * DVec2::new(random(0), random(1));
            let z_m = z_m + FIRST_LEVELS * self.levels.step_m(z_m) * random(2);
            if self.is_roof(z_m, slope) {
                let plane = frame.plane(field.pixel(i), z_m, slope);
                field.attempt(judge, i, window, plane);
            }
        }
    }

    fn is_roof(&self, z_m: f64, slope: DVec2) -> bool {
        slope.length() <= STEEPEST && z_m >= self.levels.from_m && z_m <= self.levels.to_m
    }
}

/// The best plane of every pixel so far.
struct PlaneField {
    width: usize,
    planes: Vec<DepthPlane>,
    scores: Vec<f32>,
}

impl PlaneField {
    /// Level planes at the heights that are known.
    #[inline(always)]
    fn of(frame: &ViewFrame, judge: &Judge<'_>, heights_m: &Raster<f32>) -> Self {
        let (width, n) = (heights_m.width(), heights_m.data().len());
        let mut field = Self { width, planes: vec![DepthPlane::NONE; n], scores: vec![-1.0; n] };
        for (i, z) in heights_m.data().iter().enumerate().filter(|(_, z)| !z.is_nan()) {
            let plane = frame.plane(field.pixel(i), f64::from(*z), DVec2::ZERO);
            if let Some(window) = judge.window(i % width, i / width) {
                field.attempt(judge, i, &window, plane);
            }
        }
        field
    }

    fn pixel(&self, i: usize) -> DVec2 {
        DVec2::new((i % self.width) as f64 + 0.5, (i / self.width) as f64 + 0.5)
    }

    #[inline(always)]
    fn attempt(&mut self, judge: &Judge<'_>, i: usize, window: &SampledWindow, plane: DepthPlane) {
        let score = judge.score(i % self.width, i / self.width, window, plane);
        if score > self.scores[i] {
            (self.planes[i], self.scores[i]) = (plane, score);
        }
    }

    /// Takes over the plane of a pixel that was visited just before, where it explains more there and here.
    #[inline(always)]
    fn take_over(&mut self, judge: &Judge<'_>, i: usize, window: &SampledWindow, is_forth: bool) {
        // Whole windows keep away from the border: there is a pixel on every side.
        let (beside, above, sign) = if is_forth { (i - 1, i - self.width, 1.0) } else { (i + 1, i + self.width, -1.0) };
        for (from, cols, rows) in [(beside, sign, 0.0), (above, 0.0, sign)] {
            let plane = self.planes[from].seen_from_aside(cols, rows);
            let within_px = (judge.step_px * (SIDE / 2) as i32) as f32;
            // A plane that is there already is none to try, and NaN is like nothing.
            if self.scores[from] > self.scores[i].max(0.0) && !plane.is_like(self.planes[i], within_px) {
                self.attempt(judge, i, window, plane);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;

    /// Slope of the roof: 38 degrees, rising to the north-east.
    const SLOPE: DVec2 = DVec2::new(0.62, 0.48);

    /// From so far east, 60 m up, 30 degrees off nadir to the north: a pixel is half a metre or so.
    fn camera(east_m: f64) -> PosedCamera {
        let (sin, cos) = 30.0_f64.to_radians().sin_cos();
        let rotation = DMat3::from_cols(DVec3::X, DVec3::new(0.0, -cos, -sin), DVec3::new(0.0, sin, -cos)).transpose();
        let centre = DVec3::new(east_m, -35.0, 60.0);
        let camera_from_map = Rigid::from_rotation_and_centre(rotation, centre);
        PosedCamera { camera: Camera::pinhole(96, 72, 120.0), camera_from_map }
    }

    fn roof_m(place: DVec2) -> f64 {
        5.0 + SLOPE.dot(place)
    }

    /// Point where a pixel's ray meets the roof.
    fn place(ideal: &PosedCamera, pixel: DVec2) -> DVec3 {
        let frame = ViewFrame::of(ideal);
        let ray = frame.ray(pixel);
        let normal = DVec3::new(-SLOPE.x, -SLOPE.y, 1.0);
        let depth = (5.0 - normal.dot(frame.centre)) / normal.dot(ray);
        frame.centre + depth * ray
    }

    /// Tiles of some two metres in all directions, none like another.
    fn tiles(place: DVec3) -> f32 {
        let wave = |k: usize| {
            let turn = 2.4 * k as f64;
            let length_m = 1.6 + 0.37 * (k as f64 * 1.7).sin().abs() * 4.0;
            (std::f64::consts::TAU * (place.x * turn.cos() + place.y * turn.sin()) / length_m + turn).sin()
        };
        (0..12).map(wave).sum::<f64>() as f32 * 8.0
    }

    #[test]
    fn a_plane_is_what_it_was_made_of() {
        let ideal = camera(0.0);
        let (frame, pixel) = (ViewFrame::of(&ideal), DVec2::new(30.5, 50.5));
        let plane = frame.plane(pixel, roof_m(place(&ideal, pixel).truncate()), SLOPE);
        let (z_m, slope) = frame.height_and_slope(pixel, plane);
        assert!((z_m - place(&ideal, pixel).z).abs() < 1e-3 && (slope - SLOPE).length() < 1e-3, "{z_m} {slope}");
        // Seen from another pixel it is the same roof.
        let aside = frame.height_and_slope(pixel + DVec2::new(12.0, -20.0), plane.seen_from_aside(12.0, -20.0));
        let there = place(&ideal, pixel + DVec2::new(12.0, -20.0)).z;
        assert!((aside.0 - there).abs() < 1e-3 && (aside.1 - SLOPE).length() < 1e-3, "{aside:?} {there}");
    }

    #[test]
    fn a_neighbour_sees_a_plane_where_its_own_rays_meet_it() {
        let (here, there) = (camera(0.0), camera(14.0));
        let paint = |ideal: &PosedCamera| Picture::painted(ideal.clone(), |pixel| tiles(place(ideal, pixel)));
        let (reference, other) = (paint(&here), NeighbourImage::new(paint(&there).grey()));
        let frame = ViewFrame::of(&here);
        let pixel_from_map = there.calibration() * there.camera_from_map.rotation;
        let (a, b) =
            (pixel_from_map * frame.map_from_pixel, pixel_from_map * (frame.centre - ViewFrame::of(&there).centre));
        let way = NeighbourWarp { neighbour: &other, a: a.as_mat3(), b: b.as_vec3() };
        let judge = Judge { grey: reference.grey(), ways: vec![way], step_px: 2 };
        let window = judge.window(48, 36).unwrap();
        let pixel = DVec2::new(48.5, 36.5);
        let score = |slope: DVec2| judge.score(48, 36, &window, frame.plane(pixel, place(&here, pixel).z, slope));
        assert!(score(SLOPE) > 0.97, "{}", score(SLOPE));
        assert!(score(DVec2::ZERO) < score(SLOPE) - 0.03, "{} {}", score(DVec2::ZERO), score(SLOPE));
    }

    #[test]
    fn a_roof_that_was_found_here_and_there_is_found_as_a_whole() {
        let [here, west, east] = [0.0, -14.0, 14.0].map(camera);
        let paint = |ideal: &PosedCamera| Picture::painted(ideal.clone(), |pixel| tiles(place(ideal, pixel)));
        let (reference, others) = (paint(&here), [Arc::new(paint(&west)), Arc::new(paint(&east))]);
        let ideals = [west, east];
        let levels = Levels::from_to(60.0, -15.0, 30.0);
        let slopes = Slopes {
            reference: &reference,
            others: &others,
            ideals: &ideals,
            levels: &levels,
            radius_px: 4,
            min_score: 0.4,
        };
        let truth = |i: usize| place(&here, DVec2::new((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5)).z;
        // One pixel of thirty has a height, to the next metre.
        let known = |i: usize| if (i * 7919).is_multiple_of(30) { truth(i).round() as f32 } else { f32::NAN };
        let start = Raster::from_vec(96, 72, (0..96 * 72).map(known).collect()).unwrap();
        let found = slopes.find(&start);
        // Where both neighbours see the whole window.
        let inside: Vec<usize> =
            (0..96 * 72).filter(|i| (34..62).contains(&(i % 96)) && (6..66).contains(&(i / 96))).collect();
        let errors: Vec<f64> =
            inside.iter().map(|i| f64::from(found.data()[*i]) - truth(*i)).filter(|e| !e.is_nan()).collect();
        let n_right = errors.iter().filter(|e| e.abs() < 0.3).count();
        assert!(n_right as f64 > 0.95 * inside.len() as f64, "{n_right} of {}, {} found", inside.len(), errors.len());
    }
}
