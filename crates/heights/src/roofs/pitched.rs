//! Pitched roofs: a few simple forms over a footprint, and how steep they are.
//!
//! ```text
//! z(x, y) = ground + eave + rise · t(x, y),     t in 0..1, mean t̄ over the footprint
//! hip     t = distance to the footprint / greatest distance
//! gable   t = 1 − |v| / half width,  v across one of the two axes of the smallest rectangle around the footprint; over a main body
//!         with wings that of the highest of their gables ([`crate::roofs::wings`])
//! height  eave + t̄ · rise   (the area mean)
//! ```
//!
//! A flat block that fits a pitched roof's depth edges ends a third of the way from eave to ridge, which is not a height
//! that anybody means.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};
use glam::{DVec2, Mat2, Vec2};

use crate::ray::Ray;
use crate::roofs::wings::{WingGable, Wings};
use crate::roofs::{Margin, Roof, RoofFit, RoofView, distance_to_border, grid, smallest_rectangle};
use crate::scene::{Prism, RoofForm};
use crate::score::intervals::RoofIntersection;
use crate::simd::{LANES, Lanes};

/// Samples along a ray's way over the footprint.
pub(crate) const N_SAMPLES: usize = 8;
/// Points per side of the grid that means and greatest distances are taken over.
const GRID: usize = 24;
/// Steepest pitch tried: rise over run.
pub(crate) const STEEPEST: f32 = 1.4;
/// Tallest roof above its eave, metres: more is a tower under a footprint that is not its own.
pub(crate) const TALLEST_M: f32 = 8.0;
/// Rises tried besides 0, between nothing and the steepest.
const N_RISES: usize = 5;
/// Eaves tried for each rise.
const N_EAVES: usize = 9;
/// Lead of a pitched roof over a flat one from which it is believed: it takes its rise more, and a choice among forms. Of 360 flat roofs
/// (six simulated towns, seeds 31 and 32, four levels of prior errors) a gain of 0.0005 at 0.7 standard errors, without a price for
/// numbers, called 238 pitched, mostly low hips that make up for footprints a little too large; this calls 59 so, and of 387 gables 383
/// stay gables. Mean error of all 1,597 heights, those of Rotterdam's western half among them: 0.371 to 0.358 m.
const MARGIN: Margin = Margin { gain: 0.002, standard_errors: 1.0, n_more: 2.0 };
/// The place that is farthest from all walls is found to this, metres.
const DEEPEST_TO_M: f32 = 0.02;
/// Flatter is flat: rise over run, 8.5 degrees.
const FLATTEST: f32 = 0.15;

/// Widths of the rim in which the edges of a flat roof are rounded, pixels of the prior.
const RIMS_PX: [f32; 3] = [1.0, 2.0, 3.0];
/// Depths to which it is lowered at the walls, metres.
const ROUNDED_M: [f32; 7] = [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0];
/// Heights of the rounded roof that are tried, above that of the flat one, metres: edges draw that down.
const TOPS_M: [f32; 9] = [-0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5];

/// Ways of rays over a footprint, sampled, side by side.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SampledWays {
    enter: Lanes,
    /// z-depth from one sample to the next.
    step: Lanes,
    /// Height of the ray above the building's ground at each sample, metres.
    above_m: [Lanes; N_SAMPLES],
}

/// A roof's `t` along each way.
type Shares = [Lanes; N_SAMPLES];

impl SampledWays {
    /// Lanes that stop no ray.
    const EMPTY: Self =
        Self { enter: Lanes::splat(1.0), step: Lanes::splat(0.0), above_m: [Lanes::splat(f32::INFINITY); N_SAMPLES] };

    fn set(&mut self, lane: usize, ray: &Ray, (enter, leave): (f32, f32), ground_z: f32) {
        self.enter.set(lane, enter);
        self.step.set(lane, (leave - enter) / (N_SAMPLES - 1) as f32);
        for k in 0..N_SAMPLES {
            let z = ray.origin.z + self.depth(lane, k) * ray.direction.z;
            self.above_m[k].set(lane, z - ground_z);
        }
    }

    fn depth(&self, lane: usize, k: usize) -> f32 {
        self.enter.get(lane) + self.step.get(lane) * k as f32
    }

    /// z-depths at which the rays meet the roof, or the wall in front; `+∞` where they pass over.
    #[inline(always)]
    pub fn meets<S: Simd>(&self, simd: S, surface: &impl RoofClearance) -> f32x8<S> {
        let (enter, step) = (self.enter.load(simd), self.step.load(simd));
        // From behind: what stops it later counts only where nothing does before.
        let mut depth = f32x8::splat(simd, f32::INFINITY);
        let mut next = surface.clearance_m(simd, self.above_m[N_SAMPLES - 1].load(simd), N_SAMPLES - 1);
        for k in (1..N_SAMPLES).rev() {
            let previous = surface.clearance_m(simd, self.above_m[k - 1].load(simd), k - 1);
            let is_below = next.simd_le(0.0);
            if is_below.any_true() {
                let steps = previous / (previous - next) + (k - 1) as f32;
                depth = is_below.select(enter + steps * step, depth);
            }
            next = previous;
        }
        next.simd_le(0.0).select(enter, depth)
    }
}

/// The ways of a view's rays over its building; `at` hears of each sample: block, lane, which one, and where, local frame, metres.
pub(crate) fn ways(
    view: &RoofView<'_>,
    ground_z: f32,
    mut at: impl FnMut(usize, usize, usize, Vec2),
) -> Vec<SampledWays> {
    let mut ways = Vec::new();
    for (i, (ray, enter, leave)) in view.window.own_stretches().enumerate() {
        let (block, lane) = (i / LANES, i % LANES);
        if lane == 0 {
            ways.push(SampledWays::EMPTY);
        }
        let ray = view.evidence.ray(view.placed, ray);
        ways[block].set(lane, &ray, (enter, leave), ground_z);
        for k in 0..N_SAMPLES {
            at(block, lane, k, (ray.origin + ways[block].depth(lane, k) * ray.direction).truncate());
        }
    }
    ways
}

/// A roof's surface over sampled ways.
pub(crate) trait RoofClearance {
    /// Height above it of the rays that are so far above the ground at their sample `k`, metres. To be inlined always.
    fn clearance_m<S: Simd>(&self, simd: S, above_m: f32x8<S>, k: usize) -> f32x8<S>;
}

/// A roof of some shape over ways.
struct Raised<'a> {
    shares: &'a Shares,
    eave_m: f32,
    rise_m: f32,
}

impl RoofClearance for Raised<'_> {
    #[inline(always)]
    fn clearance_m<S: Simd>(&self, simd: S, above_m: f32x8<S>, k: usize) -> f32x8<S> {
        above_m - self.eave_m - self.shares[k].load(simd) * self.rise_m
    }
}

/// One of the shapes over a view's intervals, at a height.
struct Pitched<'a> {
    sampled: &'a Sampled,
    candidate: ShapeAtHeight,
}

impl RoofIntersection for Pitched<'_> {
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, block: usize) -> f32x8<S> {
        let ShapeAtHeight { shape, eave_m, rise_m } = self.candidate;
        self.sampled.ways[block].meets(simd, &Raised { shares: &self.sampled.shares[shape][block], eave_m, rise_m })
    }
}

/// Height of a roof at a place, 0 at the eave, 1 at the ridge.
pub(crate) struct PitchedShape<'a> {
    pub form: RoofForm,
    prism: &'a Prism,
    /// Local axes of the rectangle around the footprint, and its middle along them.
    axes: Mat2,
    middle: Vec2,
    /// Half the size of the rectangle along them.
    half: Vec2,
    /// Horizontal way from eave to ridge, metres.
    run_m: f32,
    /// Wings of a gable over more than a rectangle.
    wings: Option<Wings>,
    /// Mean over the footprint.
    pub mean: f32,
}

impl<'a> PitchedShape<'a> {
    /// The forms that a footprint can carry.
    pub fn all(prism: &'a Prism) -> Vec<Self> {
        let (axes, low, high) = smallest_rectangle(prism);
        let middle = 0.5 * (low + high);
        let half = 0.5 * (high - low);
        let inside: Vec<Vec2> =
            grid(low, high, GRID).map(|p| axes.transpose() * p).filter(|p| prism.contains(*p)).collect();
        let deepest = Self::deepest_m(prism, axes, low, high);
        let turned = Mat2::from_cols(axes.row(1), -axes.row(0)).transpose();
        let gable = |axes: Mat2, middle: Vec2, half: Vec2, run_m: f32| Self {
            form: RoofForm::Gable,
            prism,
            axes,
            middle,
            half,
            run_m,
            wings: None,
            mean: 0.0,
        };
        let wings = Wings::of(prism, axes);
        let mut shapes = if wings.is_empty() {
            let across = gable(turned, Vec2::new(middle.y, -middle.x), Vec2::new(half.y, half.x), half.x);
            vec![gable(axes, middle, half, half.y), across]
        } else {
            let winged =
                |wings: Wings| Self { run_m: wings.run_m(), wings: Some(wings), ..gable(axes, middle, half, 0.0) };
            wings.into_iter().map(winged).collect()
        };
        shapes.push(Self { form: RoofForm::Hip, ..gable(axes, middle, half, deepest) });
        for shape in &mut shapes {
            shape.mean = inside.iter().map(|p| shape.at(*p)).sum::<f32>() / inside.len().max(1) as f32;
        }
        shapes.retain(|s| s.run_m > 0.5 && s.mean > 0.0);
        shapes
    }

    /// Distance from the nearest wall of the place farthest from all walls, metres; of a footprint within a rectangle.
    pub fn deepest_m(prism: &Prism, axes: Mat2, low: Vec2, high: Vec2) -> f32 {
        let depth = |p: Vec2| if prism.contains(p) { distance_to_border(prism, p) } else { 0.0 };
        let deeper = |best: (f32, Vec2), p: Vec2| if depth(p) > best.0 { (depth(p), p) } else { best };
        let on_grid = grid(low, high, GRID).map(|p| axes.transpose() * p);
        let mut best = on_grid.fold((0.0, Vec2::ZERO), deeper);
        // Between the points of the grid.
        let mut step_m = (high - low).max_element() / GRID as f32;
        while step_m > DEEPEST_TO_M {
            let around = [Vec2::X, Vec2::Y, -Vec2::X, -Vec2::Y].map(|way| best.1 + step_m * (axes.transpose() * way));
            let moved = around.into_iter().fold(best, deeper);
            (best, step_m) = if moved.0 > best.0 { (moved, step_m) } else { (best, 0.5 * step_m) };
        }
        best.0
    }

    /// Horizontal way from eave to ridge, metres.
    pub fn run_m(&self) -> f32 {
        self.run_m
    }

    /// Direction of its ridge, a gable's.
    pub fn ridge_along(&self) -> Option<DVec2> {
        let is_along_first = self.wings.as_ref().is_none_or(|wings| wings.gables()[0].is_along_x);
        let along = self.axes.row(usize::from(!is_along_first)).as_dvec2();
        (self.form == RoofForm::Gable).then_some(along)
    }

    /// Gables of it along its axes, rows, the main body's first.
    pub fn gables(&self) -> (Mat2, Vec<WingGable>) {
        let alone = || vec![WingGable::new(self.middle - self.half, self.middle + self.half, true)];
        (self.axes, self.wings.as_ref().map_or_else(alone, |wings| wings.gables().to_vec()))
    }

    /// It as a roof, metres.
    pub fn roof(&self, eave_m: f64, rise_m: f64, mean_m: f64) -> Roof {
        let ridge_along = self.ridge_along().map(|along| along.to_array());
        Roof { form: self.form, eave_m, ridge_m: eave_m + rise_m, mean_m, terrace: None, ridge_along }
    }

    /// Greatest rise of the roof above its eave that is tried, metres.
    fn tallest_m(&self) -> f32 {
        (STEEPEST * self.run_m).min(TALLEST_M)
    }

    /// Rises to try, metres.
    pub fn rises_m(&self) -> impl Iterator<Item = f32> + use<> {
        let tallest_m = self.tallest_m();
        (1..=N_RISES).map(move |i| tallest_m * i as f32 / N_RISES as f32)
    }

    pub fn at(&self, point: Vec2) -> f32 {
        let share = match self.form {
            RoofForm::Flat | RoofForm::Stepped => 0.0,
            RoofForm::Gable => match &self.wings {
                Some(wings) => wings.rise_m(self.axes * point) / self.run_m,
                None => 1.0 - ((self.axes * point).y - self.middle.y).abs() / self.run_m,
            },
            RoofForm::Hip => distance_to_border(self.prism, point) / self.run_m,
        };
        share.clamp(0.0, 1.0)
    }
}

/// One view's intervals over the building.
struct Sampled {
    ways: Vec<SampledWays>,
    /// Shares of the rays for each shape.
    shares: Vec<Vec<Shares>>,
}

impl Sampled {
    /// `share`: height of one of the shapes at a place, 0 at the eave, 1 at its highest.
    fn new(view: &RoofView<'_>, n_shapes: usize, share: impl Fn(usize, Vec2) -> f32, ground_z: f32) -> Self {
        let mut shares: Vec<Vec<Shares>> = vec![Vec::new(); n_shapes];
        let ways = ways(view, ground_z, |block, lane, k, at| {
            for (shape, shares) in shares.iter_mut().enumerate() {
                if shares.len() <= block {
                    shares.push([Lanes::splat(0.0); N_SAMPLES]);
                }
                shares[block][k].set(lane, share(shape, at));
            }
        });
        Self { ways, shares }
    }
}

/// One of the shapes, at a height.
#[derive(Debug, Clone, Copy)]
struct ShapeAtHeight {
    shape: usize,
    eave_m: f32,
    rise_m: f32,
}

/// A building's views, made ready for roofs of some shapes around a flat one.
struct PitchedViews<'a> {
    views: &'a [RoofView<'a>],
    sampled: Vec<Sampled>,
    flat_m: f32,
}

impl<'a> PitchedViews<'a> {
    fn new(views: &'a [RoofView<'a>], shapes: &[PitchedShape<'_>], ground_z: f32, flat_m: f32) -> Self {
        let share = |shape: usize, at: Vec2| shapes[shape].at(at);
        let sampled = views.iter().map(|view| Sampled::new(view, shapes.len(), share, ground_z)).collect();
        Self { views, sampled, flat_m }
    }

    /// Score of a candidate in each view, in their order.
    fn scores(&self, candidate: ShapeAtHeight) -> impl Iterator<Item = f64> {
        self.views.iter().zip(&self.sampled).map(move |(view, sampled)| {
            view.window.score_where(view.weight, self.flat_m, &Pitched { sampled, candidate })
        })
    }
}

/// Scores in each view of the flat roof with rounded edges that views show best: priors are blurred, which lowers a roof near its
/// walls, and a footprint that is too large has a rim of ground within it. A low hip follows both. None where the flat one is next to
/// nothing high.
pub(crate) fn rounded(prism: &Prism, flat_m: f32, views: &[RoofView<'_>]) -> Vec<f64> {
    let (axes, low, high) = smallest_rectangle(prism);
    let deepest_m = PitchedShape::deepest_m(prism, axes, low, high);
    let middle = (axes.transpose() * (0.5 * (low + high))).extend(prism.ground_z + flat_m).as_dvec3();
    let sampled_of = |view: &RoofView<'_>| {
        let pixel_m = view.evidence.pixel_px * view.placed.eye().distance(middle) / view.placed.camera.fx_px;
        let share = |rim: usize, at: Vec2| {
            let rim_m = (RIMS_PX[rim] * pixel_m as f32).min(deepest_m);
            (distance_to_border(prism, at) / rim_m).clamp(0.0, 1.0)
        };
        Sampled::new(view, RIMS_PX.len(), share, prism.ground_z)
    };
    let sampled = views.iter().map(sampled_of).collect();
    let looked = PitchedViews { views, sampled, flat_m };
    let of_rise = |shape: usize, rise_m: f32| {
        TOPS_M.map(|top_m| ShapeAtHeight { shape, eave_m: flat_m + top_m - rise_m, rise_m })
    };
    let candidates =
        (0..RIMS_PX.len()).flat_map(|rim| ROUNDED_M.into_iter().flat_map(move |rise_m| of_rise(rim, rise_m)));
    let scores = candidates.filter(|c| c.eave_m > 0.0).map(|c| looked.scores(c).collect::<Vec<f64>>());
    let total = |scores: &Vec<f64>| scores.iter().sum::<f64>();
    scores.max_by(|a, b| total(a).total_cmp(&total(b))).unwrap_or_default()
}

/// The pitched roof of one building, of some forms, that its views show best around a flat one; `None` where its footprint carries
/// none.
pub(crate) fn best<'a>(
    prism: &'a Prism,
    forms: &[RoofForm],
    flat_m: f32,
    views: &[RoofView<'_>],
) -> Option<RoofFit<'a>> {
    let mut shapes = PitchedShape::all(prism);
    shapes.retain(|shape| forms.contains(&shape.form));
    let looked = PitchedViews::new(views, &shapes, prism.ground_z, flat_m);
    let total = |candidate: ShapeAtHeight| looked.scores(candidate).sum::<f64>();
    let mut best = (f64::NEG_INFINITY, None);
    for (at, shape) in shapes.iter().enumerate() {
        for rise_m in shape.rises_m() {
            // The flat height lies somewhere between eave and mean.
            for step in 0..N_EAVES {
                let eave_m = flat_m + 0.5 - rise_m * (shape.mean + 0.25) * step as f32 / (N_EAVES - 1) as f32;
                if eave_m <= 0.0 {
                    continue;
                }
                let candidate = ShapeAtHeight { shape: at, eave_m, rise_m };
                let total = total(candidate);
                if total > best.0 {
                    best = (total, Some(candidate));
                }
            }
        }
    }
    let (mut best_total, Some(mut best)) = best else { return None };
    // A pattern search settles the two numbers.
    let tallest_m = shapes[best.shape].tallest_m();
    let mut step_m = [0.5, 0.5 * tallest_m / N_RISES as f32];
    for _ in 0..4 {
        for (de, dr) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (-0.5, 1.0), (0.5, -1.0)] {
            let moved =
                ShapeAtHeight { eave_m: best.eave_m + de * step_m[0], rise_m: best.rise_m + dr * step_m[1], ..best };
            if !(0.0..=tallest_m).contains(&moved.rise_m) || moved.eave_m <= 0.0 {
                continue;
            }
            let total = total(moved);
            if total > best_total {
                (best_total, best) = (total, moved);
            }
        }
        step_m = step_m.map(|s| 0.6 * s);
    }
    let scores = looked.scores(best).collect();
    let (shape, eave_m, rise_m) = (&shapes[best.shape], f64::from(best.eave_m), f64::from(best.rise_m));
    let mean_m = eave_m + f64::from(shape.mean) * rise_m;
    let roof = shape.roof(eave_m, rise_m, mean_m);
    let is_told = best.rise_m >= FLATTEST * shape.run_m;
    let scores_in = move |others: &[RoofView<'_>]| {
        PitchedViews::new(others, &shapes, prism.ground_z, flat_m).scores(best).collect()
    };
    Some(RoofFit { roof, is_told, margin: MARGIN, scores, scores_in: Box::new(scores_in) })
}
