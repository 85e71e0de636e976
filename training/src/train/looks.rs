//! How crops differ in their looks from the photos that they are cut from: colours, light, and what depth they have.

use std::collections::BTreeMap;

use glam::DVec2;
use rand::Rng;
use sizeup_heights::seed;

use super::TrainConfig;
use super::matched::{as_if_matched, smooth};
use crate::dataset::load::Photo;
use crate::network::Input;
use crate::network::parameters::normal;

/// `ImageNet`'s mean and deviation, as in sizeup's profile `small.v1`.
pub const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// Standard deviation of red, green and blue that inputs are scaled by; see [`MEAN`].
pub const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// Change of a crop as a whole, made or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Change {
    /// All colours are the grey of their mean.
    Grey,
    /// Colours are blurred by a box of three pixels.
    Blurred,
    /// There are no colours.
    WithoutImage,
    /// There is no depth.
    WithoutDepth,
    /// Depth is as if photos had been matched for it.
    Matched,
    /// Roofs and ground take colours that they do not have.
    Painted,
    /// A shadow falls over a part.
    Shaded,
}

/// Differences of a crop's colours and relief from the photo's.
#[derive(Debug, Clone)]
pub(super) struct Looks {
    gain: [f32; 3],
    gamma: f32,
    noise: f32,
    key: u64,
    relief_gain: f32,
    /// Standard deviation of the logarithm of light that changes over tens of pixels, and of a texture of a few.
    light: f32,
    texture: f32,
    /// Changes that are made.
    changes: Vec<Change>,
}

impl Looks {
    pub fn plain() -> Self {
        Self {
            gain: [1.0; 3],
            gamma: 1.0,
            noise: 0.0,
            key: 0,
            relief_gain: 1.0,
            light: 0.0,
            texture: 0.0,
            changes: Vec::new(),
        }
    }

    pub fn random(config: &TrainConfig, rng: &mut impl Rng) -> Self {
        let a = &config.augment;
        let all = (a.colour * normal(rng)).exp();
        let gain = [0; 3].map(|_| (all * (0.5 * a.colour * normal(rng)).exp()) as f32);
        let has = |i: Input| config.network.inputs.contains(&i);
        let (dropped, which): (bool, bool) = (rng.random_bool(a.drop), rng.random());
        let dropped = dropped && has(Input::Image) && has(Input::Depth);
        // In this order: the same seed gives the same crops as ever.
        let gamma = (a.gamma * normal(rng)).exp() as f32;
        let (is_grey, is_blurred) = (rng.random_bool(a.grey), rng.random_bool(a.blur));
        let noise = (a.noise / 255.0 * rng.random::<f64>()) as f32;
        let key = rng.random();
        let relief_gain = (a.relief * normal(rng)).exp() as f32;
        let (is_matched, is_painted) = (rng.random_bool(a.matched), rng.random_bool(a.painted));
        let light = (a.light * rng.random::<f64>()) as f32;
        let texture = (a.texture * rng.random::<f64>()) as f32;
        let is_shaded = rng.random_bool(a.shaded);
        let changes = [
            (Change::Grey, is_grey),
            (Change::Blurred, is_blurred),
            (Change::WithoutImage, dropped && which),
            (Change::WithoutDepth, dropped && !which),
            (Change::Matched, is_matched),
            (Change::Painted, is_painted),
            (Change::Shaded, is_shaded),
        ];
        let changes = changes.into_iter().filter_map(|(change, is_made)| is_made.then_some(change)).collect();
        Self { gain, gamma, noise, key, relief_gain, light, texture, changes }
    }

    fn has(&self, change: Change) -> bool {
        self.changes.contains(&change)
    }

    /// Relief at cells of a photo; outside it is the ground's 0.
    pub fn relief(&self, photo: &Photo, cells: &[Option<usize>], size: (usize, usize)) -> Vec<f32> {
        let gain = if self.has(Change::WithoutDepth) { 0.0 } else { self.relief_gain };
        let mut relief: Vec<f32> = cells.iter().map(|c| c.map_or(0.0, |c| gain * photo.relief[c])).collect();
        if self.has(Change::Matched) && !self.has(Change::WithoutDepth) {
            relief = as_if_matched(&relief, size, &mut seed::stream(self.key, "matched", &[]));
        }
        relief
    }

    /// Normalised red, green and blue at positions of a photo; what lies outside is black.
    pub fn colours(
        &self,
        photo: &Photo,
        pixels: &[DVec2],
        cells: &[Option<usize>],
        size: (usize, usize),
        zoom: f64,
    ) -> Vec<f32> {
        if self.has(Change::WithoutImage) {
            return vec![0.0; 3 * pixels.len()];
        }
        let is_exact = zoom == 1.0;
        let mut colours: Vec<[f32; 3]> =
            pixels.iter().map(|p| if is_exact { nearest(photo, *p) } else { bilinear(photo, *p) }).collect();
        let mut rng = seed::stream(self.key, "noise", &[]);
        if self.has(Change::Painted) {
            painted(&mut colours, photo, cells, &mut rng);
        }
        self.lit(&mut colours, size, &mut rng);
        if self.has(Change::Blurred) {
            colours = blurred(&colours, size);
        }
        let is_grey = self.has(Change::Grey);
        for colour in &mut colours {
            self.developed(colour, is_grey, &mut rng);
        }
        let channel = |c: usize| colours.iter().map(move |v| (v[c] - MEAN[c]) / DEVIATION[c]);
        channel(0).chain(channel(1)).chain(channel(2)).collect()
    }

    /// Light that changes from place to place, texture, and a shadow's edge.
    fn lit(&self, colours: &mut [[f32; 3]], size: (usize, usize), rng: &mut impl Rng) {
        for (sd, cell_px) in [(self.light, rng.random_range(20.0..60.0)), (self.texture, rng.random_range(1.5..6.0))] {
            if sd > 0.0 {
                let field = smooth(size, cell_px, rng);
                colours.iter_mut().zip(field).for_each(|(c, f)| *c = c.map(|v| v * (sd * f).exp()));
            }
        }
        if self.has(Change::Shaded) {
            let (angle, dark) = (rng.random_range(0.0..std::f32::consts::TAU), rng.random_range(0.3..0.75));
            let (from, width) = (rng.random_range(-0.5..0.5), rng.random_range(0.05..0.4));
            let reach = size.0.max(size.1) as f32;
            for (i, colour) in colours.iter_mut().enumerate() {
                let at = ((i % size.0) as f32 - 0.5 * size.0 as f32, (i / size.0) as f32 - 0.5 * size.1 as f32);
                let across = (at.0 * angle.cos() + at.1 * angle.sin()) / reach - from;
                if (0.0..width).contains(&across) {
                    *colour = colour.map(|v| v * dark);
                }
            }
        }
    }

    /// One colour through another camera.
    fn developed(&self, colour: &mut [f32; 3], is_grey: bool, rng: &mut impl Rng) {
        if is_grey {
            *colour = [(colour[0] + colour[1] + colour[2]) / 3.0; 3];
        }
        for (value, gain) in colour.iter_mut().zip(self.gain) {
            if self.gamma != 1.0 || gain != 1.0 {
                *value = (value.powf(self.gamma) * gain).min(1.0);
            }
            if self.noise > 0.0 {
                // The sum of two uniform numbers is near enough to a normal one.
                *value += self.noise * 2.45 * (rng.random::<f32>() + rng.random::<f32>() - 1.0);
            }
        }
    }
}

/// Gives every roof, and the ground, a colour of its own in the place of a part of theirs; light and texture stay.
fn painted(colours: &mut [[f32; 3]], photo: &Photo, cells: &[Option<usize>], rng: &mut impl Rng) {
    let mut paints: BTreeMap<u16, ([f32; 3], f32)> = BTreeMap::new();
    for (colour, cell) in colours.iter_mut().zip(cells) {
        let Some(cell) = cell else { continue };
        let (paint, share) = *paints.entry(photo.roof.data()[*cell]).or_insert_with(|| {
            let grey: f32 = rng.random_range(0.15..0.8);
            ([0; 3].map(|_| grey * rng.random_range(0.7..1.3)), rng.random_range(0.0..0.9))
        });
        let light = 0.4 * (colour[0] + colour[1] + colour[2]) / 3.0 + 0.6 * colour[1];
        *colour = [0, 1, 2].map(|c| (1.0 - share) * colour[c] + share * (paint[c] * (0.4 + 1.5 * light)).min(1.0));
    }
}

fn nearest(photo: &Photo, p: DVec2) -> [f32; 3] {
    let inside = p.x >= 0.0 && p.y >= 0.0 && p.x < photo.size.0 as f64 && p.y < photo.size.1 as f64;
    if inside { photo.rgb[p.y as usize * photo.size.0 + p.x as usize].map(|v| f32::from(v) / 255.0) } else { [0.0; 3] }
}

fn bilinear(photo: &Photo, p: DVec2) -> [f32; 3] {
    let (width, height) = photo.size;
    let inside = p.x >= 0.0 && p.y >= 0.0 && p.x < width as f64 && p.y < height as f64;
    if !inside {
        return [0.0; 3];
    }
    let split = |v: f64, n: usize| {
        let v = (v - 0.5).clamp(0.0, n as f64 - 1.0);
        (v as usize, (v as usize + 1).min(n - 1), v.fract() as f32)
    };
    let ((left, right, along), (top, bottom, down)) = (split(p.x, width), split(p.y, height));
    let at = |col: usize, row: usize, c: usize| f32::from(photo.rgb[row * width + col][c]) / 255.0;
    [0, 1, 2].map(|c| {
        let upper = at(left, top, c) * (1.0 - along) + at(right, top, c) * along;
        let lower = at(left, bottom, c) * (1.0 - along) + at(right, bottom, c) * along;
        upper * (1.0 - down) + lower * down
    })
}

/// A box of three by three.
fn blurred(colours: &[[f32; 3]], (columns, rows): (usize, usize)) -> Vec<[f32; 3]> {
    let mean = |i: usize| {
        let (col, row) = (i % columns, i / columns);
        let (mut sum, mut n) = ([0.0_f32; 3], 0.0_f32);
        for r in row.saturating_sub(1)..(row + 2).min(rows) {
            for c in col.saturating_sub(1)..(col + 2).min(columns) {
                (0..3).for_each(|k| sum[k] += colours[r * columns + c][k]);
                n += 1.0;
            }
        }
        sum.map(|s| s / n)
    };
    (0..colours.len()).map(mean).collect()
}
