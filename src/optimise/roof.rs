//! Pitched roofs: does one of a few simple forms explain the priors better than a flat roof, and how steep is it?
//!
//! ```text
//! z(x, y) = ground + eave + rise · t(x, y),     t in 0..1, mean t̄ over the footprint
//! hip     t = distance to the outline / greatest distance
//! gable   t = 1 − |v| / half width,  v across one of the two axes of the smallest rectangle around the outline
//! height  eave + t̄ · rise   (the area mean)
//! ```
//!
//! A flat block that fits a pitched roof's depth edges ends a third of the way from eave to ridge, which is not a height
//! that anybody means. The forms are tried after the search has settled, with the neighbours flat as they are.

use glam::{Mat2, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use super::config::SearchConfig;
use super::evidence::Evidence;
use super::score::{Correlation, Window};
use super::stretches::{LANES, Lanes};
use crate::ray::Ray;
use crate::render::PlacedCamera;
use crate::scene::{HeightReference, Prism, RoofForm};

/// Samples along a ray's way over the footprint.
const N_SAMPLES: usize = 8;
/// Points per side of the grid that means and greatest distances are taken over.
const GRID: usize = 24;
/// Steepest pitch tried: rise over run.
const STEEPEST: f32 = 1.4;
/// Tallest roof above its eave, metres: more is a tower under an outline that is not its own.
const TALLEST_M: f32 = 8.0;
/// Highest point of a tried roof above the height that the search has found, at most, metres.
pub(super) const REACH_M: f32 = TALLEST_M + 2.0;
/// A roof whose mean is farther than this from the flat height has to be better in whole windows too, metres.
const FAR_M: f32 = 2.0;
/// Rises tried besides 0, between nothing and the steepest.
const N_RISES: usize = 5;
/// Eaves tried for each rise.
const N_EAVES: usize = 9;
/// A pitched roof is believed if its score beats the flat one's by so many standard errors over views, ...
const MIN_STANDARD_ERRORS: f64 = 0.7;
/// ... and by so much per view.
const MIN_GAIN: f64 = 0.0005;
/// Fewer views cannot tell a form.
const MIN_VIEWS: usize = 4;

/// A roof as the evidence has it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Roof {
    /// Its form.
    pub form: RoofForm,
    /// Lowest edge above the building's ground, metres.
    pub eave_m: f64,
    /// Highest line above the building's ground, metres.
    pub ridge_m: f64,
    /// Area mean above the building's ground, metres.
    pub mean_m: f64,
}

impl Roof {
    /// A flat one.
    #[must_use]
    pub fn flat(height_m: f64) -> Self {
        Self { form: RoofForm::Flat, eave_m: height_m, ridge_m: height_m, mean_m: height_m }
    }

    /// Which of its heights is meant, metres.
    #[must_use]
    pub fn height_m(self, reference: HeightReference) -> f64 {
        match reference {
            HeightReference::Eave => self.eave_m,
            HeightReference::Mean => self.mean_m,
            HeightReference::Ridge => self.ridge_m,
        }
    }

    /// The same roof higher up.
    #[must_use]
    pub fn raised(self, by_m: f64) -> Self {
        let Self { form, eave_m, ridge_m, mean_m } = self;
        Self { form, eave_m: eave_m + by_m, ridge_m: ridge_m + by_m, mean_m: mean_m + by_m }
    }
}

/// Roofs of all forms and several pitches over a prism whose area mean is at a height above ground, each with places on it
/// (local frame, metres): some `n` on a lattice, at least `clear_m` from the walls. The flat one comes first; none where the
/// outline is too narrow.
#[must_use]
pub fn candidates(prism: &Prism, mean_m: f64, clear_m: f32, n: usize) -> Vec<(Roof, Vec<Vec3>)> {
    let (axes, low, high) = smallest_rectangle(prism);
    let size = high - low;
    let spacing_m = (size.x * size.y / n as f32).sqrt();
    let (n_x, n_y) = ((size.x / spacing_m).ceil() as usize, (size.y / spacing_m).ceil() as usize);
    let lattice = (0..n_y).flat_map(|row| (0..n_x).map(move |col| Vec2::new(col as f32 + 0.5, row as f32 + 0.5)));
    let inside: Vec<Vec2> = lattice
        .map(|cell| axes.transpose() * (low + spacing_m * cell))
        .filter(|p| prism.contains(*p) && distance_to_outline(prism, *p) >= clear_m)
        .collect();
    if inside.is_empty() {
        return Vec::new();
    }
    let level = |p: &Vec2| p.extend(prism.ground_z + mean_m as f32);
    let mut found = vec![(Roof::flat(mean_m), inside.iter().map(level).collect())];
    for shape in Shape::all(prism) {
        let shares: Vec<f32> = inside.iter().map(|p| shape.at(*p) - shape.mean).collect();
        for rise_m in (1..=N_RISES).map(|i| shape.tallest_m() * i as f32 / N_RISES as f32) {
            let eave_m = mean_m - f64::from(shape.mean * rise_m);
            if eave_m <= 0.0 {
                continue;
            }
            let roof = Roof { form: shape.form, eave_m, ridge_m: eave_m + f64::from(rise_m), mean_m };
            let place = |(p, share): (&Vec2, &f32)| level(p) + Vec3::Z * (rise_m * share);
            found.push((roof, inside.iter().zip(&shares).map(place).collect()));
        }
    }
    found
}

/// Ways of rays over a footprint, sampled, side by side.
#[derive(Debug, Clone, Copy)]
struct Ways {
    enter: Lanes,
    /// z-depth from one sample to the next.
    step: Lanes,
    /// Height of the ray above the building's ground at each sample, metres.
    above_m: [Lanes; N_SAMPLES],
}

/// A roof's `t` along each way.
type Shares = [Lanes; N_SAMPLES];

impl Ways {
    /// Lanes that stop no ray.
    const EMPTY: Self =
        Self { enter: Lanes::ONE, step: Lanes::ZERO, above_m: [Lanes::new([f32::INFINITY; LANES]); N_SAMPLES] };

    fn set(&mut self, lane: usize, ray: &Ray, (enter, leave): (f32, f32), ground_z: f32) {
        self.enter.as_mut_array()[lane] = enter;
        self.step.as_mut_array()[lane] = (leave - enter) / (N_SAMPLES - 1) as f32;
        for k in 0..N_SAMPLES {
            let z = ray.origin.z + self.depth(lane, k) * ray.direction.z;
            self.above_m[k].as_mut_array()[lane] = z - ground_z;
        }
    }

    fn depth(&self, lane: usize, k: usize) -> f32 {
        self.enter.as_array()[lane] + self.step.as_array()[lane] * k as f32
    }

    /// z-depths at which the rays meet the roof, or the wall in front; `+∞` where they pass over.
    fn meets(&self, shares: &Shares, eave_m: f32, rise_m: f32) -> Lanes {
        let (eave_m, rise_m) = (Lanes::splat(eave_m), Lanes::splat(rise_m));
        let clearance_m = |k: usize| self.above_m[k] - eave_m - rise_m * shares[k];
        // From behind: what stops it later counts only where nothing does before.
        let mut depth = Lanes::splat(f32::INFINITY);
        let mut next = clearance_m(N_SAMPLES - 1);
        for k in (1..N_SAMPLES).rev() {
            let previous = clearance_m(k - 1);
            let is_below = next.simd_le(Lanes::ZERO);
            if is_below.any() {
                let steps = Lanes::splat((k - 1) as f32) + previous / (previous - next);
                depth = is_below.bitselect(self.enter + steps * self.step, depth);
            }
            next = previous;
        }
        next.simd_le(Lanes::ZERO).bitselect(self.enter, depth)
    }
}

/// How high a roof stands at a place, 0 at the eave, 1 at the ridge.
struct Shape<'a> {
    form: RoofForm,
    prism: &'a Prism,
    /// Local axes of the rectangle around the outline, and its middle along them.
    axes: Mat2,
    middle: Vec2,
    /// Horizontal way from eave to ridge, metres.
    run_m: f32,
    /// Mean over the footprint.
    mean: f32,
}

impl<'a> Shape<'a> {
    /// The forms that a footprint can carry.
    fn all(prism: &'a Prism) -> Vec<Self> {
        let (axes, low, high) = smallest_rectangle(prism);
        let middle = 0.5 * (low + high);
        let half = 0.5 * (high - low);
        let inside: Vec<Vec2> = grid(low, high).map(|p| axes.transpose() * p).filter(|p| prism.contains(*p)).collect();
        let deepest = inside.iter().map(|p| distance_to_outline(prism, *p)).fold(0.0, f32::max);
        let turned = Mat2::from_cols(axes.row(1), -axes.row(0)).transpose();
        let gable = |axes: Mat2, middle: Vec2, run_m: f32| Self {
            form: RoofForm::Gable,
            prism,
            axes,
            middle,
            run_m,
            mean: 0.0,
        };
        let mut shapes = vec![
            gable(axes, middle, half.y),
            gable(turned, Vec2::new(middle.y, -middle.x), half.x),
            Self { form: RoofForm::Hip, prism, axes, middle, run_m: deepest, mean: 0.0 },
        ];
        for shape in &mut shapes {
            shape.mean = inside.iter().map(|p| shape.at(*p)).sum::<f32>() / inside.len().max(1) as f32;
        }
        shapes.retain(|s| s.run_m > 0.5 && s.mean > 0.0);
        shapes
    }

    /// Greatest rise, metres.
    fn tallest_m(&self) -> f32 {
        (STEEPEST * self.run_m).min(TALLEST_M)
    }

    fn at(&self, point: Vec2) -> f32 {
        let share = match self.form {
            RoofForm::Flat => 0.0,
            RoofForm::Gable => 1.0 - ((self.axes * point).y - self.middle.y).abs() / self.run_m,
            RoofForm::Hip => distance_to_outline(self.prism, point) / self.run_m,
        };
        share.clamp(0.0, 1.0)
    }
}

/// One view's stretches over the building.
struct Sampled {
    ways: Vec<Ways>,
    /// By shape.
    shares: Vec<Vec<Shares>>,
}

impl Sampled {
    fn new(
        window: &Window,
        placed: &PlacedCamera,
        evidence: &Evidence<'_>,
        shapes: &[Shape<'_>],
        ground_z: f32,
    ) -> Self {
        let mut sampled = Self { ways: Vec::new(), shares: vec![Vec::new(); shapes.len()] };
        for (i, (ray, enter, leave)) in window.own_stretches().enumerate() {
            let (block, lane) = (i / LANES, i % LANES);
            if lane == 0 {
                sampled.ways.push(Ways::EMPTY);
                sampled.shares.iter_mut().for_each(|shares| shares.push([Lanes::ZERO; N_SAMPLES]));
            }
            let ray = evidence.ray(placed, ray);
            sampled.ways[block].set(lane, &ray, (enter, leave), ground_z);
            for (shares, shape) in sampled.shares.iter_mut().zip(shapes) {
                for (k, share) in shares[block].iter_mut().enumerate() {
                    let along = sampled.ways[block].depth(lane, k);
                    share.as_mut_array()[lane] = shape.at((ray.origin + along * ray.direction).truncate());
                }
            }
        }
        sampled
    }

    /// Fills in where the rays meet a form of a shape.
    fn meets(&self, shape: usize, eave_m: f32, rise_m: f32, depths: &mut [Lanes]) {
        for ((ways, shares), depth) in self.ways.iter().zip(&self.shares[shape]).zip(depths) {
            *depth = ways.meets(shares, eave_m, rise_m);
        }
    }
}

/// A view of one building, with the camera and evidence of it.
pub(super) type RoofView<'a> = (Window, &'a PlacedCamera, &'a Evidence<'a>);

/// One of the shapes, at a height.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    shape: usize,
    eave_m: f32,
    rise_m: f32,
}

/// A building's views, made ready for roofs of some shapes around a flat one.
struct Looked<'a> {
    views: &'a [RoofView<'a>],
    sampled: Vec<Sampled>,
    weights: Vec<f64>,
    flat_m: f32,
}

impl<'a> Looked<'a> {
    fn new(views: &'a [RoofView<'a>], shapes: &[Shape<'_>], ground_z: f32, flat_m: f32, config: &SearchConfig) -> Self {
        let sampled = |(w, placed, evidence): &RoofView<'_>| Sampled::new(w, placed, evidence, shapes, ground_z);
        let weight = |(w, ..): &RoofView<'_>| w.agreement_weight(config.local_agreement_weight, config);
        Self {
            views,
            sampled: views.iter().map(sampled).collect(),
            weights: views.iter().map(weight).collect(),
            flat_m,
        }
    }

    /// By view.
    fn scores(&self, Candidate { shape, eave_m, rise_m }: Candidate) -> impl Iterator<Item = f64> {
        self.views.iter().zip(&self.sampled).zip(&self.weights).map(move |(((window, ..), sampled), &weight)| {
            window.score_where(weight, self.flat_m, |depths| sampled.meets(shape, eave_m, rise_m, depths))
        })
    }

    /// Whether a roof explains more than a flat one.
    fn is_better(&self, candidate: Candidate) -> bool {
        let flat = |((w, ..), &weight): (&RoofView<'_>, &f64)| w.score(self.flat_m, weight, Correlation::Linear);
        let flat = self.views.iter().zip(&self.weights).map(flat);
        let gains: Vec<f64> = self.scores(candidate).zip(flat).map(|(pitched, flat)| pitched - flat).collect();
        is_clear(&gains, MIN_GAIN, MIN_STANDARD_ERRORS)
    }
}

/// Looks for the pitched roof of one building around the height that the search has found; `None` where a flat one is
/// as good. What is far from that height has to be better in `whole`, too, which takes in all that the building could hide.
pub(super) fn find<'a>(
    prism: &Prism,
    height_m: f32,
    config: &SearchConfig,
    near: &[RoofView<'a>],
    whole: impl FnOnce() -> Vec<RoofView<'a>>,
) -> Option<Roof> {
    if near.len() < MIN_VIEWS {
        return None;
    }
    let shapes = Shape::all(prism);
    let looked = Looked::new(near, &shapes, prism.ground_z, height_m, config);
    let total = |candidate: Candidate| looked.scores(candidate).sum::<f64>();
    let mut best = (f64::NEG_INFINITY, None);
    for (at, shape) in shapes.iter().enumerate() {
        for rise_m in (1..=N_RISES).map(|i| shape.tallest_m() * i as f32 / N_RISES as f32) {
            // The flat height lies somewhere between eave and mean.
            for step in 0..N_EAVES {
                let eave_m = height_m + 0.5 - rise_m * (shape.mean + 0.25) * step as f32 / (N_EAVES - 1) as f32;
                if eave_m <= 0.0 {
                    continue;
                }
                let candidate = Candidate { shape: at, eave_m, rise_m };
                let total = total(candidate);
                if total > best.0 {
                    best = (total, Some(candidate));
                }
            }
        }
    }
    let (mut best_total, Some(mut best)) = best else { return None };
    // A pattern search settles the two numbers.
    let shape = &shapes[best.shape];
    let mut step_m = [0.5, 0.5 * shape.tallest_m() / N_RISES as f32];
    for _ in 0..4 {
        for (de, dr) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (-0.5, 1.0), (0.5, -1.0)] {
            let moved =
                Candidate { eave_m: best.eave_m + de * step_m[0], rise_m: best.rise_m + dr * step_m[1], ..best };
            if !(0.0..=shape.tallest_m()).contains(&moved.rise_m) || moved.eave_m <= 0.0 {
                continue;
            }
            let total = total(moved);
            if total > best_total {
                (best_total, best) = (total, moved);
            }
        }
        step_m = step_m.map(|s| 0.6 * s);
    }
    let (eave_m, rise_m) = (f64::from(best.eave_m), f64::from(best.rise_m));
    let mean_m = eave_m + f64::from(shape.mean) * rise_m;
    let is_better_in_whole = || Looked::new(&whole(), &shapes, prism.ground_z, height_m, config).is_better(best);
    let is_far = (mean_m - f64::from(height_m)).abs() > f64::from(FAR_M);
    let is_believed = looked.is_better(best) && (!is_far || is_better_in_whole());
    is_believed.then_some(Roof { form: shape.form, eave_m, ridge_m: eave_m + rise_m, mean_m })
}

/// Whether the views agree that something is better: their mean gain is large enough and stands clear of its standard
/// error.
pub(super) fn is_clear(gains: &[f64], min_gain: f64, min_standard_errors: f64) -> bool {
    let n = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean > min_gain && mean > min_standard_errors * (variance / n).sqrt()
}

/// The rectangle of least area around the exterior, along one of its edges: axes as rows, low and high corner.
pub(super) fn smallest_rectangle(prism: &Prism) -> (Mat2, Vec2, Vec2) {
    let exterior = prism.rings().next().unwrap_or(&[]);
    let mut best = (f32::INFINITY, Mat2::IDENTITY, Vec2::ZERO, Vec2::ZERO);
    for edge in exterior.windows(2) {
        let Some(along) = (edge[1] - edge[0]).try_normalize() else { continue };
        let axes = Mat2::from_cols(along, along.perp()).transpose();
        let (low, high) = exterior
            .iter()
            .map(|c| axes * *c)
            .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)));
        let size = high - low;
        if size.x * size.y < best.0 {
            best = (size.x * size.y, axes, low, high);
        }
    }
    (best.1, best.2, best.3)
}

fn grid(low: Vec2, high: Vec2) -> impl Iterator<Item = Vec2> {
    (0..GRID * GRID).map(move |i| {
        let cell = Vec2::new((i % GRID) as f32 + 0.5, (i / GRID) as f32 + 0.5) / GRID as f32;
        low + (high - low) * cell
    })
}

/// Distance of a point to the nearest wall, metres.
fn distance_to_outline(prism: &Prism, point: Vec2) -> f32 {
    prism
        .edges()
        .map(|(a, b)| {
            let edge = b - a;
            let along = ((point - a).dot(edge) / edge.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
            (point - a - along * edge).length()
        })
        .fold(f32::INFINITY, f32::min)
}
