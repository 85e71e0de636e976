//! What a network sees in a step: crops, turned, flipped, zoomed and recoloured; and what it is to say of them.
//!
//! A crop's pixel `q` shows the photo's pixel `p = c + z · D q`, with a zoom `z` and one of the eight flips and quarter turns
//! `D`. A direction in the photo is `Dᵀ l` in the crop: the lean turns along, so that poses stay true. Depth needs nothing.

use candle_core::{Device, Tensor};
use glam::DVec2;
use rand::Rng;
use sizeup_heights::seed;

use super::TrainConfig;
use crate::TrainError;
use crate::dataset::labels::{Middles, UNKNOWN, middles};
use crate::dataset::load::Photo;
use crate::network::Input;
use crate::network::parameters::normal;

/// ImageNet's mean and deviation, as in sizeup's profile `small.v1`.
pub const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// Standard deviation of red, green and blue that inputs are scaled by; see [`MEAN`].
pub const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];
/// Share of crops around a building.
const BUILT: f64 = 0.85;

/// A photo ready to be cropped.
#[derive(Debug)]
pub struct Scene {
    /// Photo that crops are cut from.
    pub photo: Photo,
    /// Per pixel: how near to its building's middle it lies.
    pub middles: Middles,
    /// Positions of the photo's pixels that show a building.
    built: Vec<u32>,
}

impl Scene {
    /// Gets photos ready, and checks that they have what the network takes.
    ///
    /// # Errors
    /// [`TrainError::Config`] for a network with depth and a photo without.
    pub fn ready(photos: Vec<Photo>, config: &TrainConfig) -> Result<Vec<Self>, TrainError> {
        let takes_depth = config.network.inputs.contains(&Input::Depth);
        if let Some(without) = photos.iter().find(|p| takes_depth && p.relief.is_empty()) {
            let problem = format!("{} has no depth, and the network takes it", without.image.file_name);
            return Err(TrainError::config(
                problem,
                "give the scene a `prior`, or leave \"depth\" out of `network.inputs`",
            ));
        }
        let reach = config.loss.reach_px;
        let ready = |photo: Photo| {
            let is_building = |i: &u32| !matches!(photo.ground.data()[*i as usize], 0 | UNKNOWN);
            let built = (0..photo.ground.data().len() as u32).filter(is_building).collect();
            Self { middles: middles(&photo.ground, reach), built, photo }
        };
        use rayon::prelude::*;
        Ok(photos.into_par_iter().map(ready).collect())
    }
}

/// Inputs by name, what is to come out, and how much each pixel counts.
#[derive(Debug, Clone)]
pub struct Batch {
    /// `batch × channels × rows × columns` each.
    pub inputs: Vec<(String, Tensor)>,
    /// `batch × 2 × rows × columns`: building, 0 or 1; how near to its middle, 0 to 1.
    pub target: Tensor,
    /// `batch × 2 × rows × columns`: how much each counts; 0 where nothing is known.
    pub weight: Tensor,
}

/// Values of a batch in the making, sample by sample.
pub(super) struct Draft {
    names: Vec<Input>,
    inputs: Vec<Vec<f32>>,
    target: Vec<f32>,
    weight: Vec<f32>,
    size: (usize, usize),
    shared_gain: f32,
    n: usize,
}

impl Draft {
    pub fn new(config: &TrainConfig, size: (usize, usize)) -> Self {
        let names = &config.network.inputs;
        Self {
            names: names.clone(),
            inputs: vec![Vec::new(); names.len()],
            target: Vec::new(),
            weight: Vec::new(),
            size,
            shared_gain: config.loss.shared_gain as f32,
            n: 0,
        }
    }

    pub fn finish(self, device: &Device) -> Result<Batch, TrainError> {
        let (columns, rows) = self.size;
        let tensor = |v: Vec<f32>, channels: usize| Tensor::from_vec(v, (self.n, channels, rows, columns), device);
        let inputs = self.names.iter().zip(self.inputs);
        let inputs = inputs.map(|(i, v)| Ok((i.name().to_owned(), tensor(v, i.channels())?)));
        Ok(Batch {
            inputs: inputs.collect::<Result<_, TrainError>>()?,
            target: tensor(self.target, 2)?,
            weight: tensor(self.weight, 2)?,
        })
    }

    /// Adds a crop of a scene to the batch.
    pub fn add(&mut self, scene: &Scene, place: &Placement, looks: &Looks) {
        let (columns, rows) = self.size;
        let photo = &scene.photo;
        let centre = DVec2::new(columns as f64, rows as f64) * 0.5;
        let at = |i: usize| {
            let q = DVec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5) - centre;
            place.centre + place.zoom * place.turn(q)
        };
        let pixels: Vec<DVec2> = (0..columns * rows).map(at).collect();
        let cell = |p: &DVec2| {
            let inside = p.x >= 0.0 && p.y >= 0.0 && p.x < photo.size.0 as f64 && p.y < photo.size.1 as f64;
            inside.then(|| p.y as usize * photo.size.0 + p.x as usize)
        };
        let cells: Vec<Option<usize>> = pixels.iter().map(cell).collect();
        for (input, values) in self.names.iter().zip(&mut self.inputs) {
            match input {
                Input::Image => values.extend(looks.colours(photo, &pixels, self.size, place.zoom)),
                Input::Depth => {
                    let gain = if looks.without_depth { 0.0 } else { looks.relief_gain };
                    values.extend(cells.iter().map(|c| c.map_or(0.0, |c| gain * photo.relief[c])));
                }
                Input::Lean => {
                    let leans: Vec<DVec2> = pixels.iter().map(|p| place.turn_back(photo.lean.at(*p))).collect();
                    values.extend(leans.iter().map(|l| l.x as f32));
                    values.extend(leans.iter().map(|l| l.y as f32));
                }
            }
        }
        let label = |c: &Option<usize>| c.map_or(UNKNOWN, |c| photo.ground.data()[c]);
        let as_float = |b: bool| f32::from(u8::from(b));
        self.target.extend(cells.iter().map(|c| as_float(!matches!(label(c), 0 | UNKNOWN))));
        self.target.extend(cells.iter().map(|c| c.map_or(0.0, |c| scene.middles.near[c])));
        self.weight.extend(cells.iter().map(|c| as_float(label(c) != UNKNOWN)));
        let gain =
            |c: &Option<usize>| if c.is_some_and(|c| scene.middles.is_shared[c]) { self.shared_gain } else { 1.0 };
        self.weight.extend(cells.iter().map(|c| gain(c) * as_float(label(c) != UNKNOWN)));
        self.n += 1;
    }
}

/// Where a crop lies in its photo.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placement {
    pub centre: DVec2,
    /// Pixels of the photo per pixel of the crop.
    pub zoom: f64,
    /// Flipped along the columns first, then so many quarter turns.
    pub flip: bool,
    pub quarters: u8,
}

impl Placement {
    fn turn(&self, q: DVec2) -> DVec2 {
        let q = if self.flip { DVec2::new(-q.x, q.y) } else { q };
        (0..self.quarters).fold(q, |q, _| DVec2::new(-q.y, q.x))
    }

    fn turn_back(&self, p: DVec2) -> DVec2 {
        let p = (0..self.quarters).fold(p, |p, _| DVec2::new(p.y, -p.x));
        if self.flip { DVec2::new(-p.x, p.y) } else { p }
    }

    /// A whole photo, as it is, from its top left corner.
    pub fn plain((columns, rows): (usize, usize)) -> Self {
        Self { centre: DVec2::new(columns as f64, rows as f64) * 0.5, zoom: 1.0, flip: false, quarters: 0 }
    }

    /// Around a pixel of a building that is chosen anew, mostly; anywhere in the photo otherwise.
    fn random(scene: &Scene, side: usize, zoom: f64, rng: &mut impl Rng) -> Self {
        let zoom = (1.0 + zoom).powf(rng.random_range(-1.0..=1.0));
        let reach = 0.5 * side as f64 * zoom;
        let (columns, rows) = scene.photo.size;
        let mut middle = DVec2::new(rng.random_range(0.0..columns as f64), rng.random_range(0.0..rows as f64));
        if rng.random_bool(BUILT) && !scene.built.is_empty() {
            let pixel = scene.built[rng.random_range(0..scene.built.len())] as usize;
            let aside = DVec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
            middle = DVec2::new((pixel % columns) as f64, (pixel / columns) as f64) + 0.6 * reach * aside;
        }
        // On a pixel's border, so that a crop without zoom needs no interpolation.
        let within = |at: f64, n: f64| at.clamp(reach.min(0.5 * n), (n - reach).max(0.5 * n)).round();
        let centre = DVec2::new(within(middle.x, columns as f64), within(middle.y, rows as f64));
        Self { centre, zoom, flip: rng.random(), quarters: rng.random_range(0..4) }
    }
}

/// How a crop's colours and relief differ from the photo's.
#[derive(Debug, Clone)]
pub(super) struct Looks {
    gain: [f32; 3],
    gamma: f32,
    grey: bool,
    blur: bool,
    noise: f32,
    noise_key: u64,
    relief_gain: f32,
    without_image: bool,
    without_depth: bool,
}

impl Looks {
    pub fn plain() -> Self {
        Self {
            gain: [1.0; 3],
            gamma: 1.0,
            grey: false,
            blur: false,
            noise: 0.0,
            noise_key: 0,
            relief_gain: 1.0,
            without_image: false,
            without_depth: false,
        }
    }

    fn random(config: &TrainConfig, rng: &mut impl Rng) -> Self {
        let a = &config.augment;
        let all = (a.colour * normal(rng)).exp();
        let gain = [0; 3].map(|_| (all * (0.5 * a.colour * normal(rng)).exp()) as f32);
        let has = |i: Input| config.network.inputs.contains(&i);
        let (dropped, which): (bool, bool) = (rng.random_bool(a.drop), rng.random());
        let dropped = dropped && has(Input::Image) && has(Input::Depth);
        Self {
            gain,
            gamma: (a.gamma * normal(rng)).exp() as f32,
            grey: rng.random_bool(a.grey),
            blur: rng.random_bool(a.blur),
            noise: (a.noise / 255.0 * rng.random::<f64>()) as f32,
            noise_key: rng.random(),
            relief_gain: (a.relief * normal(rng)).exp() as f32,
            without_image: dropped && which,
            without_depth: dropped && !which,
        }
    }

    /// Normalised red, green and blue at positions of a photo; what lies outside is black.
    fn colours(&self, photo: &Photo, pixels: &[DVec2], size: (usize, usize), zoom: f64) -> Vec<f32> {
        if self.without_image {
            return vec![0.0; 3 * pixels.len()];
        }
        let is_exact = zoom == 1.0;
        let mut colours: Vec<[f32; 3]> =
            pixels.iter().map(|p| if is_exact { nearest(photo, *p) } else { bilinear(photo, *p) }).collect();
        if self.blur {
            colours = blurred(&colours, size);
        }
        let mut rng = seed::stream(self.noise_key, "noise", &[]);
        for colour in &mut colours {
            if self.grey {
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
        let channel = |c: usize| colours.iter().map(move |v| (v[c] - MEAN[c]) / DEVIATION[c]);
        channel(0).chain(channel(1)).chain(channel(2)).collect()
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

/// The crops of one step: from photos chosen anew, mostly where buildings are.
///
/// # Errors
/// [`TrainError::Tensor`].
pub fn of_step(scenes: &[Scene], config: &TrainConfig, step: usize, device: &Device) -> Result<Batch, TrainError> {
    use rayon::prelude::*;
    let side = config.crop_px;
    let drafts: Vec<Draft> = (0..config.batch)
        .into_par_iter()
        .map(|i| {
            let mut rng = seed::stream(config.seed, "crop", &[step as u64, i as u64]);
            let scene = &scenes[rng.random_range(0..scenes.len())];
            let place = Placement::random(scene, side, config.augment.zoom, &mut rng);
            let looks = Looks::random(config, &mut rng);
            let mut draft = Draft::new(config, (side, side));
            draft.add(scene, &place, &looks);
            draft
        })
        .collect();
    let mut all = Draft::new(config, (side, side));
    for draft in drafts {
        all.inputs.iter_mut().zip(draft.inputs).for_each(|(to, from)| to.extend(from));
        all.target.extend(draft.target);
        all.weight.extend(draft.weight);
        all.n += 1;
    }
    all.finish(device)
}

/// A whole photo without any change, cut down to multiples of `multiple`.
///
/// # Errors
/// [`TrainError::Tensor`].
pub fn whole(scene: &Scene, config: &TrainConfig, device: &Device) -> Result<Batch, TrainError> {
    let multiple = config.network.multiple();
    let cut = |n: usize| n / multiple * multiple;
    let size = (cut(scene.photo.size.0), cut(scene.photo.size.1));
    let mut draft = Draft::new(config, size);
    draft.add(scene, &Placement::plain(size), &Looks::plain());
    draft.finish(device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lean_turns_with_the_crop() {
        for (flip, quarters) in [(false, 0), (true, 0), (false, 1), (true, 3), (false, 2)] {
            let place = Placement { centre: DVec2::new(50.0, 40.0), zoom: 1.3, flip, quarters };
            // The nadir's own place in the crop is where the lean points away from.
            let nadir = DVec2::new(20.0, 70.0);
            let q = DVec2::new(11.0, -4.0);
            let lean = place.centre + place.zoom * place.turn(q) - nadir;
            let nadir_in_crop = place.turn_back(nadir - place.centre) / place.zoom;
            let expected = (q - nadir_in_crop) * place.zoom;
            assert!((place.turn_back(lean) - expected).length() < 1e-9);
        }
    }
}
