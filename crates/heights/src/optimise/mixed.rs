//! A gable beside a flat part: a house with a low annex, or one that stands on a podium.
//!
//! ```text
//! z(x, y) = ground + eave + rise · (1 − |v| / half width)   on the main body, a rectangle; v across its ridge
//!         = ground + flat                                   elsewhere
//! height  mean of both by area
//! ```
//!
//! Two flat levels put such a house's upper one a third of the way from eave to ridge, as one level does with a gable.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};
use glam::{Mat2, Vec2};

use super::intervals::RoofIntersection;
use super::pitched::{N_SAMPLES, RoofClearance, STEEPEST, SampledWays, TALLEST_M, ways};
use super::roof::{Gable, Margin, Roof, RoofFit, RoofView, Terrace, grid, smallest_rectangle};
use crate::scene::{Prism, RoofForm};
use crate::simd::Lanes;

/// Points per side of the grid that areas are counted on.
const GRID: usize = 40;
/// Least side of the main body, metres.
const MIN_SIDE_M: f32 = 3.0;
/// Least area of the flat part, m², and least share of the footprint's that either part has.
const MIN_FLAT_M2: f64 = 15.0;
const MIN_SHARE: f64 = 0.05;
/// The eave is so much above the flat part at least, metres: less is a dormer.
const MIN_STEP_M: f32 = 0.5;
/// Least part, of the rectangle around all that is not the terrace, that has to be so.
const MIN_BODY: f64 = 0.85;
/// Rises tried, between nothing and the steepest, and eaves for each.
const N_RISES: usize = 5;
const N_EAVES: usize = 7;
/// First moves of the pattern search, metres: of the heights, and of the main body's sides.
const FIRST_M: [f32; 2] = [0.6, 0.8];
const N_ROUNDS: usize = 5;
/// Lead that such a roof needs over a simpler one.
const MARGIN: Margin = Margin { gain: 0.002, standard_errors: 1.0, n_more: 1.0 };

/// A gable over a rectangle, all else at one level. Metres, along the axes of the smallest rectangle around the footprint.
#[derive(Debug, Clone, Copy, PartialEq)]
struct House {
    low: Vec2,
    high: Vec2,
    is_ridge_along_x: bool,
    flat_m: f32,
    eave_m: f32,
    rise_m: f32,
}

impl House {
    /// Middle and half of the width across the ridge.
    fn across(&self) -> (f32, f32) {
        let axis = usize::from(self.is_ridge_along_x);
        (0.5 * (self.low[axis] + self.high[axis]), 0.5 * (self.high[axis] - self.low[axis]))
    }

    fn tallest_m(&self) -> f32 {
        (STEEPEST * self.across().1).min(TALLEST_M)
    }

    fn is_sound(&self) -> bool {
        (self.high - self.low).min_element() >= MIN_SIDE_M
            && (0.0..=self.tallest_m()).contains(&self.rise_m)
            && self.flat_m > 0.0
            && self.eave_m >= self.flat_m + MIN_STEP_M
    }
}

/// The main body of a roof of two levels as a rectangle, low and high corner along the axes; `None` where it is not about one.
fn main_body(prism: &Prism, terrace: &Terrace) -> Option<(Mat2, Vec2, Vec2)> {
    let (axes, around_low, around_high) = smallest_rectangle(prism);
    let [low, high] = terrace.across(axes);
    if terrace.is_upper {
        return Some((axes, low.max(around_low), high.min(around_high)));
    }
    let is_terrace = |p: &Vec2| p.cmpge(low).all() && p.cmple(high).all();
    let inside: Vec<Vec2> =
        grid(around_low, around_high, GRID).filter(|p| prism.contains(axes.transpose() * *p)).collect();
    let upper: Vec<Vec2> = inside.iter().filter(|p| !is_terrace(p)).copied().collect();
    let half_cell = 0.5 * (around_high - around_low) / GRID as f32;
    let body_low = upper.iter().copied().reduce(Vec2::min)? - half_cell;
    let body_high = upper.iter().copied().reduce(Vec2::max)? + half_cell;
    let n_around = inside.iter().filter(|p| p.cmpge(body_low).all() && p.cmple(body_high).all()).count();
    (upper.len() as f64 >= MIN_BODY * n_around as f64).then_some((axes, body_low, body_high))
}

/// Roofs of two levels with gables of several pitches in place of the upper one, all of the same means.
pub(super) fn variants(prism: &Prism, found: &Roof, terrace: &Terrace) -> Vec<Roof> {
    let Some((axes, low, high)) = main_body(prism, terrace) else { return Vec::new() };
    let upper_m = terrace.gable.map_or(found.ridge_m, |gable| 0.5 * (gable.eave_m + found.ridge_m));
    let pitches = [false, true].into_iter().flat_map(|along| (1..=N_RISES).map(move |i| (along, i)));
    let of_pitch = |(is_ridge_along_x, i): (bool, usize)| {
        let (flat_m, eave_m) = (found.eave_m as f32, upper_m as f32);
        let house = House { low, high, is_ridge_along_x, flat_m, eave_m, rise_m: 0.0 };
        let rise_m = house.tallest_m() * i as f32 / N_RISES as f32;
        let house = House { rise_m, eave_m: eave_m - 0.5 * rise_m, ..house };
        house.is_sound().then(|| Roof { mean_m: found.mean_m, ..roof(&house, axes, 0.0) })
    };
    pitches.filter_map(of_pitch).collect()
}

/// The roof of one building, a gable beside a flat part, that its views show best around one of two levels; `None` where there is
/// none to speak of.
pub(super) fn best<'a>(prism: &'a Prism, flat_m: f32, step: &Roof, views: &[RoofView<'_>]) -> Option<RoofFit<'a>> {
    let (axes, low, high) = main_body(prism, &step.terrace?)?;
    let seen = seen_in(views, axes, prism.ground_z);
    let total = |house: &House| scores(views, &seen, flat_m, house).iter().sum::<f64>();
    let mut best: Option<(f64, House)> = None;
    for is_ridge_along_x in [false, true] {
        let house =
            House { low, high, is_ridge_along_x, flat_m: step.eave_m as f32, eave_m: step.ridge_m as f32, rise_m: 0.0 };
        for (i, k) in (1..=N_RISES).flat_map(|i| (0..N_EAVES).map(move |k| (i, k))) {
            let rise_m = house.tallest_m() * i as f32 / N_RISES as f32;
            // The upper level lies somewhere between eave and mean.
            let eave_m = step.ridge_m as f32 + 0.5 - 0.75 * rise_m * k as f32 / (N_EAVES - 1) as f32;
            let tried = House { eave_m, rise_m, ..house };
            if tried.is_sound() {
                let total = total(&tried);
                if best.is_none_or(|(best, _)| total > best) {
                    best = Some((total, tried));
                }
            }
        }
    }
    let (mut best_total, mut best) = best?;
    for round in 0..N_ROUNDS {
        for (heights, sides) in moves() {
            let [height_m, side_m] = FIRST_M.map(|first_m| first_m * 0.6_f32.powi(round as i32));
            let moved = House {
                flat_m: best.flat_m + heights[0] * height_m,
                eave_m: best.eave_m + heights[1] * height_m,
                rise_m: best.rise_m + heights[2] * height_m,
                low: best.low + Vec2::new(sides[0], sides[1]) * side_m,
                high: best.high + Vec2::new(sides[2], sides[3]) * side_m,
                ..best
            };
            if moved.is_sound() {
                let total = total(&moved);
                if total > best_total {
                    (best_total, best) = (total, moved);
                }
            }
        }
    }
    let body_share = body_share(prism, axes, &best);
    let least_flat = MIN_SHARE.max(MIN_FLAT_M2 / f64::from(prism.area_m2()));
    if body_share < MIN_SHARE || 1.0 - body_share < least_flat {
        return None;
    }
    let scores = scores(views, &seen, flat_m, &best);
    let scores_in =
        move |others: &[RoofView<'_>]| self::scores(others, &seen_in(others, axes, prism.ground_z), flat_m, &best);
    let roof = roof(&best, axes, body_share);
    Some(RoofFit { roof, is_told: true, margin: MARGIN, scores, scores_in: Box::new(scores_in) })
}

/// Directions of flat part, eave and rise, and of the main body's low and high corner.
fn moves() -> impl Iterator<Item = ([f32; 3], [f32; 4])> {
    let heights = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -0.5, 1.0]];
    let sides = (0..4).map(|side| ([0.0; 3], std::array::from_fn(|i| if i == side { 1.0 } else { 0.0 })));
    let all = heights.into_iter().map(|heights| (heights, [0.0; 4])).chain(sides);
    all.flat_map(|(heights, sides)| [(heights, sides), (heights.map(|h| -h), sides.map(|s: f32| -s))])
}

/// The part of the footprint's area that is the main body's, 0..1.
fn body_share(prism: &Prism, axes: Mat2, house: &House) -> f64 {
    let (_, low, high) = smallest_rectangle(prism);
    let inside = || grid(low, high, GRID).filter(|p| prism.contains(axes.transpose() * *p));
    let n_body = inside().filter(|p| p.cmpge(house.low).all() && p.cmple(house.high).all()).count();
    n_body as f64 / inside().count().max(1) as f64
}

fn roof(house: &House, axes: Mat2, body_share: f64) -> Roof {
    let [flat_m, eave_m, rise_m] = [house.flat_m, house.eave_m, house.rise_m].map(f64::from);
    let corners = [house.low, Vec2::new(house.high.x, house.low.y), house.high, Vec2::new(house.low.x, house.high.y)]
        .map(|corner| (axes.transpose() * corner).as_dvec2().to_array());
    let gable = Gable { eave_m, is_ridge_along_first: house.is_ridge_along_x };
    Roof {
        form: RoofForm::Mixed,
        eave_m: flat_m,
        ridge_m: eave_m + rise_m,
        mean_m: flat_m + body_share * (eave_m + 0.5 * rise_m - flat_m),
        terrace: Some(Terrace { corners, is_upper: true, gable: Some(gable) }),
        ridge_along: None,
    }
}

/// The ways of one view's rays over the footprint, with their samples' places along the axes.
struct MixedView {
    ways: Vec<SampledWays>,
    places: Vec<[[Lanes; N_SAMPLES]; 2]>,
}

fn seen_in(views: &[RoofView<'_>], axes: Mat2, ground_z: f32) -> Vec<MixedView> {
    let of_view = |view: &RoofView<'_>| {
        let mut places = Vec::new();
        let ways = ways(view, ground_z, |block, lane, k, at| {
            if places.len() <= block {
                places.push([[Lanes::splat(0.0); N_SAMPLES]; 2]);
            }
            let along = axes * at;
            places[block][0][k].set(lane, along.x);
            places[block][1][k].set(lane, along.y);
        });
        MixedView { ways, places }
    };
    views.iter().map(of_view).collect()
}

fn scores(views: &[RoofView<'_>], seen: &[MixedView], flat_m: f32, house: &House) -> Vec<f64> {
    let of_view = |(view, seen): (&RoofView<'_>, &MixedView)| {
        view.window.score_where(view.weight, flat_m, &Mixed { seen, house: *house })
    };
    views.iter().zip(seen).map(of_view).collect()
}

/// Such a roof over a view's intervals.
struct Mixed<'a> {
    seen: &'a MixedView,
    house: House,
}

impl RoofIntersection for Mixed<'_> {
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, block: usize) -> f32x8<S> {
        self.seen.ways[block].meets(simd, &OverPlaces { places: &self.seen.places[block], house: &self.house })
    }
}

struct OverPlaces<'a> {
    places: &'a [[Lanes; N_SAMPLES]; 2],
    house: &'a House,
}

impl RoofClearance for OverPlaces<'_> {
    #[inline(always)]
    fn clearance_m<S: Simd>(&self, simd: S, above_m: f32x8<S>, k: usize) -> f32x8<S> {
        let house = self.house;
        let (x, y) = (self.places[0][k].load(simd), self.places[1][k].load(simd));
        let is_body =
            x.simd_ge(house.low.x) & x.simd_le(house.high.x) & y.simd_ge(house.low.y) & y.simd_le(house.high.y);
        let (middle, half) = house.across();
        let off = if house.is_ridge_along_x { y - middle } else { x - middle };
        let gable = off.max(-off) * (-house.rise_m / half) + (house.eave_m + house.rise_m);
        above_m - is_body.select(gable, f32x8::splat(simd, house.flat_m))
    }
}
