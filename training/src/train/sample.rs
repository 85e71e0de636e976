//! What a network sees in a step: crops, turned, flipped, zoomed and recoloured; and what it is to say of them.
//!
//! A crop's pixel `q` shows the photo's pixel `p = c + z · D q`, with a zoom `z` and one of the eight flips and quarter turns
//! `D`. A direction in the photo is `Dᵀ l` in the crop: the lean turns along, so that poses stay true. Depth needs nothing.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use glam::DVec2;
use rand::Rng;
use rayon::prelude::*;
use sizeup_footprints::segment::roofs::MOST_RISE;
use sizeup_heights::raster::Raster;
use sizeup_heights::seed;

use super::looks::Looks;
use super::{LossConfig, TrainConfig};
use crate::TrainError;
use crate::dataset::labels::{Middles, UNKNOWN, middles};
use crate::dataset::load::Photo;
use crate::dataset::rises::rises;
use crate::network::{Input, N_LOGITS};

/// Share of crops around a building.
const BUILT: f64 = 0.85;

/// A photo ready to be cropped.
#[derive(Debug)]
pub struct Scene {
    /// Photo that crops are cut from.
    pub photo: Photo,
    /// Per pixel: how near to its roof's middle it lies.
    pub middles: Middles,
    /// Per pixel: the rise of its roof, 1 being the most that a network says; `NaN` where it is not known.
    rise: Vec<f32>,
    /// Positions of the photo's pixels that show a building.
    built: Vec<u32>,
    /// Positions of the photo's pixels where two roofs meet.
    seams: Vec<u32>,
    /// Per pixel of an orthophoto: whether an outline is so near that the ground is unknown; empty for other photos.
    rim: Vec<bool>,
}

impl Scene {
    /// Gets photos ready, and checks that they have what the network takes.
    ///
    /// # Errors
    /// [`TrainError::Config`] for a network that sees depth alone and a photo without.
    pub fn ready(photos: Vec<Photo>, config: &TrainConfig) -> Result<Vec<Self>, TrainError> {
        let needs_depth =
            config.network.inputs.contains(&Input::Depth) && !config.network.inputs.contains(&Input::Image);
        if let Some(without) = photos.iter().find(|p| needs_depth && p.relief.is_empty()) {
            let problem = format!("{} has no depth, and the network takes nothing else", without.image.file_name);
            return Err(TrainError::config(problem, "give the scene a `prior`, or add \"image\" to `network.inputs`"));
        }
        let reach = config.loss.reach_px;
        let ready = |photo: Photo| {
            let is_orthophoto = config.orthophotos.scenes.contains(&photo.image.scene);
            let n = reduction(&photo, config) as usize;
            let photo = photo.reduced(n);
            let is_building = |i: &u32| !matches!(photo.ground.data()[*i as usize], 0 | UNKNOWN);
            let built = (0..photo.ground.data().len() as u32).filter(is_building).collect();
            let roofs = known_roofs(&photo);
            let rises = if is_orthophoto {
                BTreeMap::new()
            } else {
                rises(&photo.ground, &photo.roof, DVec2::from(photo.lean.nadir_px))
            };
            let rise = |label: &u16| rises.get(label).map_or(f32::NAN, |r| *r as f32 / MOST_RISE);
            let rise = photo.roof.data().iter().map(rise).collect();
            let middles = middles(&roofs, reach);
            let seams = (0..middles.is_seam.len() as u32).filter(|i| middles.is_seam[*i as usize]).collect();
            let rim_px = config.orthophotos.rim_m / photo.image.ground_sample_m;
            let rim = if is_orthophoto { rim(&photo.roof, rim_px) } else { Vec::new() };
            Self { photo, middles, rise, built, seams, rim }
        };
        Ok(photos.into_par_iter().map(ready).collect())
    }

    /// Whether its labels are outlines drawn on an orthophoto.
    #[must_use]
    pub fn is_orthophoto(&self) -> bool {
        !self.rim.is_empty()
    }
}

/// Pixels of a photo per pixel that the network sees, where crops are not zoomed: 1, or more where the photo is finer than
/// `config.pixel_m`.
pub(super) fn reduction(photo: &Photo, config: &TrainConfig) -> f64 {
    config.pixel_m.map_or(1.0, |pixel_m| (pixel_m / photo.image.ground_sample_m).max(1.0))
}

/// Pixels whose centre is within a distance of one with another label.
fn rim(labels: &Raster<u16>, reach_px: f64) -> Vec<bool> {
    let (width, height) = (labels.width(), labels.height());
    let reach = reach_px as usize;
    let is_near = |i: usize| {
        let (col, row) = (i % width, i / width);
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(height);
        rows.into_iter().any(|r| {
            (col.saturating_sub(reach)..(col + reach + 1).min(width)).any(|c| {
                let off = (r.abs_diff(row).pow(2) + c.abs_diff(col).pow(2)) as f64;
                labels[(c, r)] != labels.data()[i] && off <= reach_px.powi(2)
            })
        })
    };
    (0..labels.data().len()).map(is_near).collect()
}

/// Labels of roofs, unknown where it is not known what stands on the ground.
fn known_roofs(photo: &Photo) -> Raster<u16> {
    let mut roofs = photo.roof.clone();
    for (roof, ground) in roofs.data_mut().iter_mut().zip(photo.ground.data()) {
        if *roof == 0 && *ground == UNKNOWN {
            *roof = UNKNOWN;
        }
    }
    roofs
}

/// Targets of a pixel of a photo, and how much each counts, in the order of the network's channels.
pub(super) fn wanted(scene: &Scene, cell: Option<usize>, loss: &LossConfig) -> [(f32, f32); N_LOGITS] {
    let Some(cell) = cell else { return [(0.0, 0.0); N_LOGITS] };
    let as_float = |b: bool| f32::from(u8::from(b));
    let (ground, roof) = (scene.photo.ground.data()[cell], scene.photo.roof.data()[cell]);
    let (is_known, is_roof) = (as_float(ground != UNKNOWN), as_float(roof != 0));
    let is_ground_known = if scene.rim.get(cell) == Some(&true) { 0.0 } else { is_known };
    let is_roof_known = is_known.max(is_roof);
    let gain = if scene.middles.is_shared[cell] { loss.shared_gain as f32 } else { 1.0 };
    let is_seam = scene.middles.is_seam[cell];
    let rise = scene.rise[cell];
    [
        (as_float(!matches!(ground, 0 | UNKNOWN)), is_ground_known),
        (is_roof, is_roof_known),
        (scene.middles.near[cell], gain * is_roof_known),
        if rise.is_nan() { (0.0, 0.0) } else { (rise, is_roof) },
        (as_float(is_seam), if is_seam { loss.seam_gain as f32 } else { is_roof }),
    ]
}

/// Inputs by name, what is to come out, and how much each pixel counts.
#[derive(Debug, Clone)]
pub struct Batch {
    /// `batch × channels × rows × columns` each.
    pub inputs: Vec<(String, Tensor)>,
    /// `batch × 5 × rows × columns`: building on the ground and roof, 0 or 1; how near to the roof's middle, and its rise, 0 to 1; seam, 0 or 1.
    pub target: Tensor,
    /// `batch × 5 × rows × columns`: how much each counts; 0 where nothing is known.
    pub weight: Tensor,
}

/// Values of a batch in the making, sample by sample.
pub(super) struct Draft {
    names: Vec<Input>,
    inputs: Vec<Vec<f32>>,
    target: Vec<f32>,
    weight: Vec<f32>,
    size: (usize, usize),
    loss: LossConfig,
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
            loss: config.loss.clone(),
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
            target: tensor(self.target, N_LOGITS)?,
            weight: tensor(self.weight, N_LOGITS)?,
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
                Input::Image => values.extend(looks.colours(photo, &pixels, &cells, self.size, place.zoom)),
                Input::Depth => values.extend(looks.relief(photo, &cells, self.size)),
                Input::Lean => {
                    let lean = looks.lean().unwrap_or(photo.lean);
                    let leans: Vec<DVec2> = pixels.iter().map(|p| place.turn_back(lean.at(*p))).collect();
                    values.extend(leans.iter().map(|l| l.x as f32));
                    values.extend(leans.iter().map(|l| l.y as f32));
                }
            }
        }
        let mut wanted: Vec<_> = cells.iter().map(|c| wanted(scene, *c, &self.loss)).collect();
        if looks.lean().is_some() {
            // The roof would be displaced from its foot, nobody knows how far.
            wanted.iter_mut().for_each(|w| w[0].1 = 0.0);
        }
        for channel in 0..N_LOGITS {
            self.target.extend(wanted.iter().map(|w| w[channel].0));
            self.weight.extend(wanted.iter().map(|w| w[channel].1));
        }
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

    /// A whole photo from its top left corner, reduced by `zoom` to columns and rows.
    pub fn plain((columns, rows): (usize, usize), zoom: f64) -> Self {
        Self { centre: DVec2::new(columns as f64, rows as f64) * 0.5 * zoom, zoom, flip: false, quarters: 0 }
    }

    /// Around a pixel of a building or of a seam that is chosen anew, mostly; anywhere in the photo otherwise.
    fn random(scene: &Scene, config: &TrainConfig, rng: &mut impl Rng) -> Self {
        let (side, zoom) = (config.crop_px, config.augment.zoom);
        let zoom = reduction(&scene.photo, config) * (1.0 + zoom).powf(rng.random_range(-1.0..=1.0));
        let reach = 0.5 * side as f64 * zoom;
        let (columns, rows) = scene.photo.size;
        let mut middle = DVec2::new(rng.random_range(0.0..columns as f64), rng.random_range(0.0..rows as f64));
        let is_at_seam = rng.random_bool(config.at_seams) && !scene.seams.is_empty();
        let among = if is_at_seam { &scene.seams } else { &scene.built };
        if (is_at_seam || rng.random_bool(BUILT)) && !among.is_empty() {
            let pixel = among[rng.random_range(0..among.len())] as usize;
            let aside = DVec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
            middle = DVec2::new((pixel % columns) as f64, (pixel / columns) as f64) + 0.6 * reach * aside;
        }
        // On a pixel's border, so that a crop without zoom needs no interpolation.
        let within = |at: f64, n: f64| at.clamp(reach.min(0.5 * n), (n - reach).max(0.5 * n)).round();
        let centre = DVec2::new(within(middle.x, columns as f64), within(middle.y, rows as f64));
        Self { centre, zoom, flip: rng.random(), quarters: rng.random_range(0..4) }
    }
}

/// The photo of a crop: any one, or where there are orthophotos, one of these or of the others by their share; each scene of
/// orthophotos as often as the others, however many photos it has.
fn chosen<'a>(scenes: &'a [Scene], config: &TrainConfig, rng: &mut impl Rng) -> &'a Scene {
    let (orthophotos, others): (Vec<&Scene>, Vec<&Scene>) = scenes.iter().partition(|s| s.is_orthophoto());
    let is_orthophoto = !orthophotos.is_empty() && (others.is_empty() || rng.random_bool(config.orthophotos.share));
    if !is_orthophoto {
        return others[rng.random_range(0..others.len())];
    }
    let mut by_place: BTreeMap<&str, Vec<&Scene>> = BTreeMap::new();
    for scene in orthophotos {
        by_place.entry(&scene.photo.image.scene).or_default().push(scene);
    }
    let places: Vec<Vec<&Scene>> = by_place.into_values().collect();
    let place = &places[rng.random_range(0..places.len())];
    place[rng.random_range(0..place.len())]
}

/// The crops of one step: from photos chosen anew, mostly where buildings are.
///
/// # Errors
/// [`TrainError::Tensor`].
pub fn of_step(scenes: &[Scene], config: &TrainConfig, step: usize, device: &Device) -> Result<Batch, TrainError> {
    let side = config.crop_px;
    let drafts: Vec<Draft> = (0..config.batch)
        .into_par_iter()
        .map(|i| {
            let mut rng = seed::stream(config.seed, "crop", &[step as u64, i as u64]);
            let scene = chosen(scenes, config, &mut rng);
            let place = Placement::random(scene, config, &mut rng);
            let mut looks = Looks::random(config, &mut rng);
            if scene.is_orthophoto() {
                looks = looks.of_orthophoto(config, &place, &mut rng);
            }
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

/// A whole photo without any change but `config.pixel_m`, cut down to what the levels of the network ask for.
///
/// # Errors
/// [`TrainError::Tensor`].
pub fn whole(scene: &Scene, config: &TrainConfig, device: &Device) -> Result<Batch, TrainError> {
    let multiple = config.network.multiple();
    let zoom = reduction(&scene.photo, config);
    let cut = |n: usize| (n as f64 / zoom) as usize / multiple * multiple;
    let size = (cut(scene.photo.size.0), cut(scene.photo.size.1));
    let mut draft = Draft::new(config, size);
    draft.add(scene, &Placement::plain(size, zoom), &Looks::plain());
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
