//! How crops differ in their looks from the photos that they are cut from: colours, light, and what depth they have.

use std::collections::BTreeMap;

use glam::DVec2;
use rand::Rng;
use sizeup_footprints::segment::geometry::Lean;
use sizeup_heights::seed;

use super::TrainConfig;
use super::matched::{as_if_matched, smooth};
use super::sample::Placement;
use crate::dataset::labels::UNKNOWN;
use crate::dataset::load::Photo;
use crate::network::Input;
use crate::network::parameters::normal;

/// `ImageNet`'s mean and deviation, as in sizeup's profile `small.v1`.
pub const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// Standard deviation of red, green and blue that inputs are scaled by; see [`MEAN`].
pub const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// Lightness and hue of roofs: red tiles, grey slate or concrete, white, blue, and rusty metal. Each is as likely as the others, though
/// simulated towns and most places have mainly one of them.
const ROOFS: [[f32; 4]; 5] =
    [[0.4, 1.5, 0.8, 0.7], [0.45, 1.0, 1.0, 1.0], [0.8, 1.0, 1.0, 1.0], [0.45, 0.6, 1.0, 1.5], [0.45, 1.25, 0.95, 0.8]];
/// Focal lengths of the simulated photos, pixels of the network: 480 pixels wide and reduced to 0.34 m.
const FOCAL_PX: std::ops::Range<f64> = 250.0..500.0;
/// Largest lean along columns and rows in the corner of such a photo.
const MOST_LEAN: f64 = 0.5;
/// Relief of roofs in spreads: 1 over the root of the share of a photo that is built on, for 5 to 40 %.
const ROOF_RELIEF: std::ops::Range<f32> = 1.6..4.5;
/// Most trees in a crop, and their radii, pixels of 0.34 m.
const MOST_TREES: usize = 60;
const TREE_RADIUS_PX: std::ops::Range<f32> = 3.0..14.0;
/// Least (2 g − r − b) / (r + g + b) of leaves, the *excess green index*. In four places 6 to 18 % of the roofs lie above it, and 19 to 80 % of the
/// rest.
const LEAST_GREEN: f32 = 0.08;
/// Share of the trees that stand anywhere: bare ones, lorries, awnings.
const ANYWHERE: f64 = 0.15;

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
    /// Depth is made from the outlines of roofs.
    Raised,
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
    /// Lean in the place of the photo's.
    lean: Option<Lean>,
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
            lean: None,
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
        let is_without_depth = (dropped && !which) || (has(Input::Image) && rng.random_bool(a.without_depth));
        let changes = [
            (Change::Grey, is_grey),
            (Change::Blurred, is_blurred),
            (Change::WithoutImage, dropped && which && !is_without_depth),
            (Change::WithoutDepth, is_without_depth),
            (Change::Matched, is_matched),
            (Change::Painted, is_painted),
            (Change::Shaded, is_shaded),
        ];
        let changes = changes.into_iter().filter_map(|(change, is_made)| is_made.then_some(change)).collect();
        Self { gain, gamma, noise, key, relief_gain, light, texture, lean: None, changes }
    }

    /// The same for an orthophoto's crop: it always keeps its own colours, and may get a lean and depth that it does not have.
    pub fn of_orthophoto(mut self, config: &TrainConfig, place: &Placement, rng: &mut impl Rng) -> Self {
        self.changes.retain(|change| !matches!(change, Change::WithoutImage | Change::Painted));
        if rng.random_bool(config.orthophotos.raised) {
            self.changes.push(Change::Raised);
        }
        if rng.random_bool(config.orthophotos.leaning) {
            // Focal length and nadir of a photo reduced to the network's pixels.
            let focal_px = place.zoom * rng.random_range(FOCAL_PX);
            let aside = DVec2::new(rng.random_range(-MOST_LEAN..MOST_LEAN), rng.random_range(-MOST_LEAN..MOST_LEAN));
            self.lean = Some(Lean { nadir_px: (place.centre + focal_px * aside).to_array(), focal_px });
        }
        self
    }

    /// Lean that the crop gets in the place of the photo's, if any.
    pub fn lean(&self) -> Option<Lean> {
        self.lean
    }

    fn has(&self, change: Change) -> bool {
        self.changes.contains(&change)
    }

    /// Relief at cells of a photo; outside it, and in a photo without depth, it is the ground's 0.
    pub fn relief(&self, photo: &Photo, cells: &[Option<usize>], size: (usize, usize)) -> Vec<f32> {
        let is_raised = self.has(Change::Raised) && photo.relief.is_empty();
        if self.has(Change::WithoutDepth) || (photo.relief.is_empty() && !is_raised) {
            return vec![0.0; cells.len()];
        }
        let mut relief: Vec<f32> = if is_raised {
            raised(photo, cells, size.0, &mut seed::stream(self.key, "raised", &[]))
        } else {
            cells.iter().map(|c| c.map_or(0.0, |c| self.relief_gain * photo.relief[c])).collect()
        };
        if self.has(Change::Matched) {
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
        if self.has(Change::WithoutImage) && !photo.relief.is_empty() {
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

/// Depth from outlines: flat roofs of several heights, and trees, most of them where the photo is green. These stand out of the ground like
/// roofs, so that only colours tell them apart.
fn raised(photo: &Photo, cells: &[Option<usize>], columns: usize, rng: &mut impl Rng) -> Vec<f32> {
    let common: f32 = rng.random_range(ROOF_RELIEF);
    let mut roofs: BTreeMap<u16, f32> = BTreeMap::new();
    let is_tree = |i: usize| {
        cells[i].is_some_and(|cell| matches!(photo.roof.data()[cell], 0 | UNKNOWN) && is_green(photo.rgb[cell]))
    };
    let trees: Vec<(f32, f32, f32, f32)> = (0..rng.random_range(0..=MOST_TREES))
        .filter_map(|_| {
            let at = rng.random_range(0..cells.len());
            (rng.random_bool(ANYWHERE) || is_tree(at)).then(|| {
                let (radius, top) = (rng.random_range(TREE_RADIUS_PX), common * rng.random_range(0.3..1.5));
                ((at % columns) as f32, (at / columns) as f32, radius, top)
            })
        })
        .collect();
    let mut relief = Vec::with_capacity(cells.len());
    for (i, cell) in cells.iter().enumerate() {
        let label = cell.map_or(0, |cell| photo.roof.data()[cell]);
        let (x, y) = ((i % columns) as f32, (i / columns) as f32);
        let crown = |(col, row, radius, top): &(f32, f32, f32, f32)| {
            let share = 1.0 - ((x - col).powi(2) + (y - row).powi(2)) / radius.powi(2);
            top * share.max(0.0).sqrt()
        };
        relief.push(match label {
            0 | UNKNOWN => trees.iter().map(crown).fold(0.0, f32::max),
            _ => *roofs.entry(label).or_insert_with(|| common * rng.random_range(0.5..1.4)),
        });
    }
    relief
}

/// Whether a colour is that of leaves.
fn is_green(colour: [u8; 3]) -> bool {
    let [r, g, b] = colour.map(f32::from);
    2.0 * g - r - b > LEAST_GREEN * (r + g + b)
}

/// Gives every roof, and the ground, a colour of its own in the place of a part of theirs; light and texture stay.
fn painted(colours: &mut [[f32; 3]], photo: &Photo, cells: &[Option<usize>], rng: &mut impl Rng) {
    let mut paints: BTreeMap<u16, ([f32; 3], f32)> = BTreeMap::new();
    for (colour, cell) in colours.iter_mut().zip(cells) {
        let Some(cell) = cell else { continue };
        let label = photo.roof.data()[*cell];
        let (paint, share) = *paints.entry(label).or_insert_with(|| {
            let grey: f32 = rng.random_range(0.15..0.8);
            let paint = match ROOFS[rng.random_range(0..ROOFS.len())] {
                [light, hue @ ..] if label != 0 => {
                    let light = light * rng.random_range(0.6..1.4_f32);
                    hue.map(|h| light * h * rng.random_range(0.9..1.1))
                }
                _ => [0; 3].map(|_| grey * rng.random_range(0.7..1.3)),
            };
            (paint, rng.random_range(0.0..0.9))
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

#[cfg(test)]
mod tests {
    use sizeup_heights::raster::Raster;

    use super::*;
    use crate::dataset::coco::CocoImage;

    /// A photo of one red roof.
    fn red_roof() -> Photo {
        let image = serde_json::json!({
            "id": 1, "file_name": "a.png", "width": 8, "height": 8, "scene": "a", "off_nadir_deg": 0.0, "nadir_px": [4.0, 4.0],
            "focal_px": 10.0, "ground_sample_m": 0.3, "ground": "g", "roof": "r", "visible": "v",
        });
        let image: CocoImage = serde_json::from_value(image).unwrap();
        let labels = Raster::filled(8, 8, 1);
        let lean = Lean { nadir_px: image.nadir_px, focal_px: image.focal_px };
        Photo {
            image,
            size: (8, 8),
            rgb: vec![[170, 70, 55]; 64],
            relief: Vec::new(),
            lean,
            ground: labels.clone(),
            roof: labels,
        }
    }

    /// A red roof that is painted over becomes reddish, bluish and neither about as often as the five kinds of roofs are.
    #[test]
    fn painted_roofs_are_red_no_more_often_than_blue_or_grey() {
        let photo = red_roof();
        let (mut n_red, mut n_blue, mut n_neutral) = (0, 0, 0);
        for key in 0..500 {
            let mut colours = vec![[0.45, 0.45, 0.45]; 64];
            let cells: Vec<Option<usize>> = (0..64).map(Some).collect();
            painted(&mut colours, &photo, &cells, &mut seed::stream(key, "test", &[]));
            let [red, green, blue] = colours[0];
            match (red - blue) / (red + green + blue) {
                off if off > 0.1 => n_red += 1,
                off if off < -0.1 => n_blue += 1,
                _ => n_neutral += 1,
            }
        }
        // Roofs are painted by 0 to 90 % of their colour, so that some of each hue stay near grey.
        assert!(
            n_blue > 50 && n_neutral > 200 && n_red < 2 * n_blue + 50,
            "{n_red} red, {n_blue} blue, {n_neutral} neither"
        );
    }

    /// A meadow beside a car park: what stands out stands on the meadow, mostly, and on the car park now and then.
    #[test]
    fn trees_stand_where_it_is_green() {
        let mut photo = red_roof();
        photo.size = (64, 32);
        photo.roof = Raster::filled(64, 32, 0);
        let is_meadow = |i: usize| i % 64 < 32;
        photo.rgb = (0..64 * 32).map(|i| if is_meadow(i) { [80, 120, 60] } else { [120, 120, 120] }).collect();
        let cells: Vec<Option<usize>> = (0..64 * 32).map(Some).collect();
        let (mut n_meadow, mut n_car_park) = (0, 0);
        for key in 0..100 {
            let relief = raised(&photo, &cells, 64, &mut seed::stream(key, "test", &[]));
            // Crowns reach over the border by up to 14 pixels.
            let raised = |meadow: bool| {
                let is_far = |i: &usize| (i % 64).abs_diff(32) > 14;
                (0..64 * 32).filter(|i| is_meadow(*i) == meadow && is_far(i) && relief[*i] > 0.0).count()
            };
            n_meadow += raised(true);
            n_car_park += raised(false);
        }
        assert!(
            n_car_park > 0 && n_meadow > 2 * n_car_park,
            "{n_meadow} pixels of the meadow, {n_car_park} of the car park"
        );
    }
}
