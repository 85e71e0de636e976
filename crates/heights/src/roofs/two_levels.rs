//! Two flat levels under one footprint, and how well they explain what the priors show of it.
//!
//! ```text
//! z(x, y) = ground + inner   inside of a rectangle along the axes of the footprint's smallest rectangle
//!         = ground + outer   elsewhere
//! ```
//!
//! The six numbers are searched for by the same score as a height: how well the rendered depth agrees with the prior, over
//! views of the building.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};
use glam::{Mat2, Vec2};

use crate::ray::Ray;
use crate::roofs::{RoofView, grid, smallest_rectangle};
use crate::scene::{HeightBounds, Prism};
use crate::score::Window;
use crate::score::intervals::RoofIntersection;
use crate::simd::{LANES, Lanes};

/// Middles of the first rectangles, and their size, as shares of the footprint's sides.
const FIRST_MIDDLES: [f32; 3] = [0.25, 0.5, 0.75];
const FIRST_SIZE: f32 = 0.5;
/// Points per side of the grid that the rectangle's share of the footprint is counted on.
const GRID: usize = 40;

/// Numbers that two levels take more than one: a rectangle, and a level.
pub(crate) const N_MORE: f64 = 5.0;

/// A rectangle at one level, everything else at another. Metres; the rectangle along the plan's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TwoLevels {
    pub low: Vec2,
    pub high: Vec2,
    pub inner_m: f32,
    pub outer_m: f32,
}

impl TwoLevels {
    pub fn lower_m(&self) -> f32 {
        self.inner_m.min(self.outer_m)
    }

    pub fn upper_m(&self) -> f32 {
        self.inner_m.max(self.outer_m)
    }
}

/// Steps of one round of the pattern search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PatternStep {
    /// The rectangle's sides, as a share of the footprint's.
    pub side_share: f32,
    /// The levels: a fixed part, metres, and a share of each.
    pub height_m: f32,
    pub height_share: f32,
}

/// Share of a footprint's width that a rectangle across it has at least: row houses are five metres wide.
const ACROSS_SHARE: f32 = 0.9;

/// Limits of two levels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TwoLevelLimits {
    pub heights: HeightBounds,
    /// Least side of the rectangle, metres; across a footprint that is no wider, [`ACROSS_SHARE`] of its width.
    pub side_m: f32,
}

/// A footprint along the axes of its smallest rectangle.
pub(crate) struct AlignedFootprint<'a> {
    pub prism: &'a Prism,
    axes: Mat2,
    pub low: Vec2,
    pub high: Vec2,
    limits: TwoLevelLimits,
}

impl<'a> AlignedFootprint<'a> {
    pub fn new(prism: &'a Prism, limits: TwoLevelLimits) -> Self {
        let (axes, low, high) = smallest_rectangle(prism);
        let side_m = limits.side_m.min(ACROSS_SHARE * (high - low).min_element());
        Self { prism, axes, low, high, limits: TwoLevelLimits { side_m, ..limits } }
    }

    /// Rectangles over the whole footprint, each with several pairs of an inner and an outer level, metres.
    pub fn guesses<'p>(&'p self, pairs_m: &'p [[f32; 2]]) -> impl Iterator<Item = TwoLevels> + 'p {
        let size = self.high - self.low;
        // A rectangle that starts narrower than it may be could not be moved at all.
        let half = 0.5 * (FIRST_SIZE * size).max(Vec2::splat(self.limits.side_m)).min(size);
        let middles = FIRST_MIDDLES.into_iter().flat_map(|x| FIRST_MIDDLES.into_iter().map(move |y| Vec2::new(x, y)));
        middles.flat_map(move |middle| {
            pairs_m.iter().map(move |&[inner_m, outer_m]| {
                let middle = (self.low + middle * size).clamp(self.low + half, self.high - half);
                self.within(TwoLevels { low: middle - half, high: middle + half, inner_m, outer_m })
            })
        })
    }

    /// The best of some guesses after the best `n_followed` of them were bettered, with its total score over the views.
    pub fn best_of(
        &self,
        guesses: impl Iterator<Item = TwoLevels>,
        n_followed: usize,
        seen: &[&TwoLevelView<'_>],
        steps: &[PatternStep],
    ) -> Option<(f64, TwoLevels)> {
        let mut guesses: Vec<(f64, TwoLevels)> = guesses.map(|guess| (total(seen, &guess), guess)).collect();
        guesses.sort_by(|a, b| b.0.total_cmp(&a.0));
        // Over a narrow footprint there is but one rectangle to begin with.
        guesses.dedup_by_key(|(_, guess)| *guess);
        let followed = guesses.into_iter().take(n_followed);
        followed.map(|(_, guess)| self.climb(seen, guess, steps)).max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Pattern search: the sides, the place and the levels, with each step until none helps. With the total score.
    pub fn climb(&self, seen: &[&TwoLevelView<'_>], start: TwoLevels, steps: &[PatternStep]) -> (f64, TwoLevels) {
        let (mut best, mut at) = (total(seen, &start), start);
        for &step in steps {
            loop {
                let before = best;
                for direction in moves() {
                    let moved = self.moved(&at, direction, step);
                    if (moved.high - moved.low).min_element() < self.limits.side_m {
                        continue;
                    }
                    let score = total(seen, &moved);
                    if score > best {
                        (best, at) = (score, moved);
                    }
                }
                if best <= before {
                    break;
                }
            }
        }
        (best, at)
    }

    fn moved(&self, at: &TwoLevels, (low, high, inner, outer): Move, step: PatternStep) -> TwoLevels {
        let sides = step.side_share * (self.high - self.low);
        let level = |h: f32, direction: f32| h + direction * (step.height_m + step.height_share * h);
        self.within(TwoLevels {
            low: at.low + low * sides,
            high: at.high + high * sides,
            inner_m: level(at.inner_m, inner),
            outer_m: level(at.outer_m, outer),
        })
    }

    fn within(&self, levels: TwoLevels) -> TwoLevels {
        let HeightBounds { min_m, max_m } = self.limits.heights;
        TwoLevels {
            low: levels.low.max(self.low),
            high: levels.high.min(self.high),
            inner_m: levels.inner_m.clamp(min_m, max_m),
            outer_m: levels.outer_m.clamp(min_m, max_m),
        }
    }

    /// The part of the footprint's area that lies in the rectangle, 0..1.
    pub fn inner_share(&self, levels: &TwoLevels) -> f64 {
        let (mut n_inside, mut n_inner) = (0, 0);
        for at in grid(self.low, self.high, GRID) {
            if self.prism.contains(self.axes.transpose() * at) {
                n_inside += 1;
                n_inner += usize::from(at.cmpge(levels.low).all() && at.cmple(levels.high).all());
            }
        }
        n_inner as f64 / n_inside.max(1) as f64
    }

    /// The corners of a rectangle along the axes: local frame, metres, counter-clockwise.
    pub fn corners(&self, low: Vec2, high: Vec2) -> [[f64; 2]; 4] {
        [low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)]
            .map(|corner| (self.axes.transpose() * corner).as_dvec2().to_array())
    }
}

fn total(seen: &[&TwoLevelView<'_>], levels: &TwoLevels) -> f64 {
    seen.iter().map(|s| s.two_levels(levels)).sum()
}

/// Directions of the rectangle's low and high corner, and of the inner and outer level.
type Move = (Vec2, Vec2, f32, f32);

fn moves() -> impl Iterator<Item = Move> {
    let (x, y, no) = (Vec2::X, Vec2::Y, Vec2::ZERO);
    let one_way = [
        (no, no, 1.0, 0.0),
        (no, no, 0.0, 1.0),
        (x, no, 0.0, 0.0),
        (no, x, 0.0, 0.0),
        (y, no, 0.0, 0.0),
        (no, y, 0.0, 0.0),
        (x, x, 0.0, 0.0),
        (y, y, 0.0, 0.0),
    ];
    one_way.into_iter().flat_map(|(low, high, inner, outer)| [(low, high, inner, outer), (-low, -high, -inner, -outer)])
}

/// The building in one view.
pub(crate) struct TwoLevelView<'a> {
    window: &'a Window,
    /// Weight of the agreement.
    weight: f64,
    ways: Vec<AxisWays>,
}

impl<'a> TwoLevelView<'a> {
    pub fn new(view: &'a RoofView<'_>, weight: f64, plan: &AlignedFootprint<'_>) -> Self {
        Self { window: &view.window, weight, ways: ways(view, plan) }
    }

    /// Rays of the view that are compared.
    pub fn n_rays(&self) -> usize {
        self.window.n_rays()
    }

    /// The score of one level, metres above the building's ground.
    pub fn one_level(&self, height_m: f32) -> f64 {
        self.window.score(height_m, self.weight)
    }

    pub fn two_levels(&self, levels: &TwoLevels) -> f64 {
        self.window.score_where(self.weight, levels.outer_m, &Terraced { ways: &self.ways, levels })
    }
}

/// The ways of a view's rays over the footprint.
fn ways(view: &RoofView<'_>, plan: &AlignedFootprint<'_>) -> Vec<AxisWays> {
    let mut ways = Vec::new();
    for (i, (ray, enter, leave)) in view.window.own_stretches().enumerate() {
        if i % LANES == 0 {
            ways.push(AxisWays::EMPTY);
        }
        ways[i / LANES].set(i % LANES, &view.evidence.ray(view.placed, ray), plan, (enter, leave));
    }
    ways
}

/// Ways of rays over the footprint, along the plan's axes, side by side.
#[derive(Debug, Clone, Copy)]
struct AxisWays {
    /// Position at z-depth 0, and z-depth per metre along the axis.
    from: [Lanes; 2],
    per_metre: [Lanes; 2],
    /// Height above the building's ground at z-depth 0, and z-depth per metre of it.
    above_m: Lanes,
    per_metre_up: Lanes,
    enter: Lanes,
    leave: Lanes,
}

impl AxisWays {
    /// Lanes that stop no ray.
    const EMPTY: Self = Self {
        from: [Lanes::splat(0.0); 2],
        per_metre: [Lanes::splat(1.0); 2],
        above_m: Lanes::splat(0.0),
        per_metre_up: Lanes::splat(-1.0),
        enter: Lanes::splat(1.0),
        leave: Lanes::splat(0.0),
    };

    fn set(&mut self, lane: usize, ray: &Ray, plan: &AlignedFootprint<'_>, (enter, leave): (f32, f32)) {
        let (from, along) = (plan.axes * ray.origin.truncate(), plan.axes * ray.direction.truncate());
        for axis in 0..2 {
            self.from[axis].set(lane, from[axis]);
            self.per_metre[axis].set(lane, along[axis].recip());
        }
        self.above_m.set(lane, ray.origin.z - plan.prism.ground_z);
        self.per_metre_up.set(lane, ray.direction.z.recip());
        self.enter.set(lane, enter);
        self.leave.set(lane, leave);
    }

    /// z-depths at which the rays meet the two levels; `+∞` where they pass over.
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, levels: &TwoLevels) -> f32x8<S> {
        let (enter, leave) = (self.enter.load(simd), self.leave.load(simd));
        // Where the ray enters and leaves the rectangle, within its way over the footprint.
        let (mut within, mut beyond) = (enter, leave);
        for axis in 0..2 {
            let (from, per_metre) = (self.from[axis].load(simd), self.per_metre[axis].load(simd));
            let a = (levels.low[axis] - from) * per_metre;
            let b = (levels.high[axis] - from) * per_metre;
            within = within.max(a.min(b));
            beyond = beyond.min(a.max(b));
        }
        let misses = within.simd_ge(beyond);
        within = misses.select(leave, within);
        beyond = misses.select(leave, beyond);
        let (above_m, per_metre_up) = (self.above_m.load(simd), self.per_metre_up.load(simd));
        let inner = (levels.inner_m - above_m) * per_metre_up;
        let outer = (levels.outer_m - above_m) * per_metre_up;
        // From behind: what stops it later counts only where nothing does before.
        let mut depth = f32x8::splat(simd, f32::INFINITY);
        for (start, end, roof) in [(beyond, leave, outer), (within, beyond, inner), (enter, within, outer)] {
            depth = (end.simd_gt(start) & roof.simd_lt(end)).select(roof.max(start), depth);
        }
        depth
    }
}

/// Two levels over a view's intervals.
struct Terraced<'a> {
    ways: &'a [AxisWays],
    levels: &'a TwoLevels,
}

impl RoofIntersection for Terraced<'_> {
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, block: usize) -> f32x8<S> {
        self.ways[block].meets(simd, self.levels)
    }
}
