//! Outlines that hold two roof levels (a tower on its podium, a hall beside its office): no single height fits them.
//!
//! ```text
//! z(x, y) = ground + inner   inside of a rectangle along the axes of the outline's smallest rectangle
//!         = ground + outer   elsewhere
//! ```
//!
//! The six numbers are searched for by the same score as a height: how well the rendered depth agrees with the prior, over
//! all views of the building. Only the *plan* of the two parts is taken from here, if they are clear, large and well
//! apart: their heights are then searched as any other's.

use glam::{Mat2, Vec2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::config::SearchConfig;
use super::evidence::Evidence;
use super::roof::{is_clear, smallest_rectangle};
use super::score::{Correlation, Scope, Window};
use super::search::{SweepView, SweepViews, ViewsOf};
use super::stretches::{LANES, Lanes};
use crate::ray::Ray;
use crate::render::PlacedCamera;
use crate::scene::{HeightBounds, Prism, Scene};
use crate::views::{corners_inside, in_turn};

/// Outlines smaller than this are left whole, m².
const MIN_OUTLINE_M2: f32 = 200.0;
/// Least area of a part, m², and as a share of the outline.
const MIN_PART_M2: f32 = 40.0;
const MIN_PART_SHARE: f32 = 0.06;
/// Least difference of two levels: a fixed part, metres, and a share of the upper one.
const MIN_STEP_M: f32 = 4.0;
const MIN_STEP_SHARE: f32 = 0.2;
/// Least side of the rectangle, metres.
const MIN_SIDE_M: f32 = 5.0;
/// Two levels are believed if their score beats one level's by so many standard errors over views, and by so much per view.
const MIN_STANDARD_ERRORS: f64 = 2.0;
const MIN_GAIN: f64 = 0.02;
/// Fewer views cannot tell.
const MIN_VIEWS: usize = 4;
/// Views that the first guesses are tried in.
const N_FIRST_VIEWS: usize = 6;
/// Guesses that are followed up.
const N_FOLLOWED: usize = 2;
/// One level with a lower score is looked at again in a later round.
const DOUBTFUL_SCORE: f64 = 0.9;
/// How far from a new part this is done, metres between middles: what hides and is hidden stands closer.
const NEAR_M: f32 = 100.0;
/// Heights tried for one level, log-spaced over the whole range.
const N_HEIGHTS: usize = 24;
/// Middles and sizes of the first rectangles, as shares of the outline's sides.
const FIRST_MIDDLES: [f32; 3] = [0.25, 0.5, 0.75];
const FIRST_SIZE: f32 = 0.5;
/// First heights of the two levels, as shares of the height that one level gets.
const FIRST_SHARES: [[f32; 2]; 6] = [[0.1, 1.0], [0.25, 1.0], [0.5, 1.3], [1.0, 2.5], [1.0, 6.0], [1.0, 0.4]];
/// Steps of the rectangle's sides as a share of the outline's, for the followed guesses and for the best of them.
const COARSE_STEPS: [f32; 3] = [0.2, 0.1, 0.05];
const FINE_STEPS: [f32; 4] = [0.05, 0.025, 0.0125, 0.006];
/// Steps of the heights as a share of them, for each share of a side.
const HEIGHT_STEP: f32 = 1.25;
/// A side of the rectangle as near as this to the outline's own is the outline's, metres.
const SNAP_M: f32 = 2.5;

/// A part of an outline that stands at another level than the rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OtherLevel {
    /// Which building.
    pub building: usize,
    /// Corners of a rectangle, local frame, metres, counter-clockwise; it may reach beyond the outline.
    pub corners: [[f64; 2]; 4],
    /// Why.
    #[serde(default)]
    pub gain: LevelGain,
}

/// How much better two levels explain the priors than one.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelGain {
    /// The two levels above ground, metres: of the part, and of the rest.
    pub heights_m: [f32; 2],
    /// Mean score over views of both together.
    pub two: f64,
    /// The same of one level at several heights: metres, score; heights ascend.
    pub one: Vec<(f32, f64)>,
    /// Views that had a say.
    pub n_views: usize,
}

/// Buildings that should be taken apart, by index. Those known from a round before have been looked at there: only what one
/// level explains badly, close to new parts, is looked at again. What is taken apart far away changes nothing here.
pub(super) fn find(
    scene: &Scene,
    views: SweepViews<'_>,
    views_of: ViewsOf<'_>,
    heights_m: &[f32],
    known_m: &[Option<f32>],
    config: &SearchConfig,
) -> Vec<OtherLevel> {
    let is_known = |building: usize| known_m.get(building).copied().flatten().is_some();
    let middle = |building: usize| scene.prisms[building].centre_at(0.0).truncate();
    let parts: Vec<Vec2> = (0..scene.prisms.len()).filter(|&b| !is_known(b)).map(middle).collect();
    let is_near_part = |building| parts.iter().any(|part| part.distance(middle(building)) <= NEAR_M);
    let of_building = |building: usize| {
        let prism = &scene.prisms[building];
        if prism.area_m2() < MIN_OUTLINE_M2 || is_known(building) && !is_near_part(building) {
            return None;
        }
        // A tall roof as large as the outline leaves most images: what stands below it may be seen in them still.
        let at_foot = (views_of[building].len() < MIN_VIEWS).then(|| views_of_foot(scene, views, building, config));
        let of_building = at_foot.as_ref().unwrap_or(&views_of[building]).iter();
        let plan = Plan::new(prism, scene.bounds);
        let seen: Vec<SeenIn> = of_building
            .filter_map(|&v| views[v].as_ref())
            .filter_map(|v| {
                let window = v.window(scene, building, Scope::whole(config, Correlation::Linear))?;
                Some(SeenIn::new(window, v.placed, v.evidence, &plan))
            })
            .collect();
        let below_score = if is_known(building) { DOUBTFUL_SCORE } else { 1.0 };
        let levels = plan.other_level(&seen, heights_m[building], below_score)?;
        Some(OtherLevel {
            building,
            corners: plan.corners(&levels),
            gain: plan.gain(&seen, &levels, heights_m[building]),
        })
    };
    (0..scene.prisms.len()).into_par_iter().filter_map(of_building).collect()
}

/// Views that show the whole outline where it stands on the ground.
fn views_of_foot(scene: &Scene, views: SweepViews<'_>, building: usize, config: &SearchConfig) -> Vec<usize> {
    let prism = &scene.prisms[building];
    let foot = prism.centre_at(prism.ground_z).as_dvec3();
    let shows_foot = |view: &SweepView<'_>| corners_inside(prism, view.placed, prism.ground_z) == 1.0;
    let taking_part = views.iter().enumerate().filter_map(|(v, view)| Some((v, view.as_ref()?)));
    let ranked = taking_part.filter(|(_, view)| shows_foot(view)).map(|(v, view)| {
        let n_rays = view.evidence.rays_of(building as u32).len();
        (v, (view.placed.eye() - foot).truncate(), std::cmp::Reverse(n_rays))
    });
    in_turn(ranked, config.max_views_per_building)
}

/// Ways of rays over the outline, along the plan's axes, side by side.
#[derive(Debug, Clone, Copy)]
struct Ways {
    /// Position at z-depth 0, and z-depth per metre along the axis.
    from: [Lanes; 2],
    per_metre: [Lanes; 2],
    /// Height above the building's ground at z-depth 0, and z-depth per metre of it.
    above_m: Lanes,
    per_metre_up: Lanes,
    enter: Lanes,
    leave: Lanes,
}

impl Ways {
    /// Lanes that stop no ray.
    const EMPTY: Self = Self {
        from: [Lanes::ZERO; 2],
        per_metre: [Lanes::ONE; 2],
        above_m: Lanes::ZERO,
        per_metre_up: Lanes::new([-1.0; LANES]),
        enter: Lanes::ONE,
        leave: Lanes::ZERO,
    };

    fn set(&mut self, lane: usize, ray: &Ray, plan: &Plan<'_>, (enter, leave): (f32, f32)) {
        let (from, along) = (plan.axes * ray.origin.truncate(), plan.axes * ray.direction.truncate());
        let set = |lanes: &mut Lanes, value: f32| lanes.as_mut_array()[lane] = value;
        for axis in 0..2 {
            set(&mut self.from[axis], from[axis]);
            set(&mut self.per_metre[axis], along[axis].recip());
        }
        set(&mut self.above_m, ray.origin.z - plan.prism.ground_z);
        set(&mut self.per_metre_up, ray.direction.z.recip());
        set(&mut self.enter, enter);
        set(&mut self.leave, leave);
    }

    /// z-depths at which the rays meet the two levels; `+∞` where they pass over.
    fn meets(&self, levels: &TwoLevels) -> Lanes {
        let (enter, leave) = (self.enter, self.leave);
        // Where the ray enters and leaves the rectangle, within its way over the outline.
        let (mut within, mut beyond) = (enter, leave);
        for axis in 0..2 {
            let a = (Lanes::splat(levels.low[axis]) - self.from[axis]) * self.per_metre[axis];
            let b = (Lanes::splat(levels.high[axis]) - self.from[axis]) * self.per_metre[axis];
            within = within.fast_max(a.fast_min(b));
            beyond = beyond.fast_min(a.fast_max(b));
        }
        let misses = within.simd_ge(beyond);
        within = misses.bitselect(leave, within);
        beyond = misses.bitselect(leave, beyond);
        let inner = (Lanes::splat(levels.inner_m) - self.above_m) * self.per_metre_up;
        let outer = (Lanes::splat(levels.outer_m) - self.above_m) * self.per_metre_up;
        // From behind: what stops it later counts only where nothing does before.
        let mut depth = Lanes::splat(f32::INFINITY);
        for (start, end, roof) in [(beyond, leave, outer), (within, beyond, inner), (enter, within, outer)] {
            depth = (end.simd_gt(start) & roof.simd_lt(end)).bitselect(roof.fast_max(start), depth);
        }
        depth
    }
}

/// The building in one view.
struct SeenIn {
    window: Window,
    ways: Vec<Ways>,
}

impl SeenIn {
    fn new(window: Window, placed: &PlacedCamera, evidence: &Evidence<'_>, plan: &Plan<'_>) -> Self {
        let mut ways = Vec::new();
        for (i, (ray, enter, leave)) in window.own_stretches().enumerate() {
            if i % LANES == 0 {
                ways.push(Ways::EMPTY);
            }
            ways[i / LANES].set(i % LANES, &evidence.ray(placed, ray), plan, (enter, leave));
        }
        Self { window, ways }
    }

    fn score(&self, levels: &TwoLevels) -> f64 {
        self.window.score_where(0.0, levels.outer_m, |depths| {
            self.ways.iter().zip(depths).for_each(|(ways, depth)| *depth = ways.meets(levels));
        })
    }
}

/// A rectangle at one level, everything else at another. Metres; the rectangle along the plan's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct TwoLevels {
    low: Vec2,
    high: Vec2,
    inner_m: f32,
    outer_m: f32,
}

/// An outline along the axes of its smallest rectangle.
struct Plan<'a> {
    prism: &'a Prism,
    bounds: HeightBounds,
    axes: Mat2,
    low: Vec2,
    high: Vec2,
}

impl<'a> Plan<'a> {
    fn new(prism: &'a Prism, bounds: HeightBounds) -> Self {
        let (axes, low, high) = smallest_rectangle(prism);
        Self { prism, bounds, axes, low, high }
    }

    /// The part at another level than the rest; `None` where one level is as good, or scores no less than `below_score`.
    fn other_level(&self, seen: &[SeenIn], height_m: f32, below_score: f64) -> Option<TwoLevels> {
        if seen.len() < MIN_VIEWS {
            return None;
        }
        let every = seen.len().div_ceil(N_FIRST_VIEWS);
        let first: Vec<&SeenIn> = seen.iter().step_by(every).collect();
        let one_level = self.best_level(&first, height_m);
        let flat: Vec<f64> = seen.iter().map(|s| s.window.score(one_level, 0.0, Correlation::Linear)).collect();
        // No score is better than 1: where one level almost has it, two cannot be clearly better.
        let mean = flat.iter().sum::<f64>() / flat.len() as f64;
        if mean >= below_score.min(1.0 - MIN_GAIN) {
            return None;
        }
        let total = |seen: &[&SeenIn], levels: &TwoLevels| seen.iter().map(|s| s.score(levels)).sum::<f64>();
        let mut guesses: Vec<(f64, TwoLevels)> =
            self.guesses(height_m).map(|guess| (total(&first, &guess), guess)).collect();
        guesses.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (score, best) = guesses
            .into_iter()
            .take(N_FOLLOWED)
            .map(|(score, guess)| self.climb(&first, guess, score, &COARSE_STEPS))
            .max_by(|a, b| a.0.total_cmp(&b.0))?;
        let first_flat: f64 = flat.iter().step_by(every).sum();
        if !self.is_part(&best) || score - first_flat < 0.5 * MIN_GAIN * first.len() as f64 {
            return None;
        }
        let all: Vec<&SeenIn> = seen.iter().collect();
        let (_, best) = self.climb(&all, best, total(&all, &best), &FINE_STEPS);
        let gains: Vec<f64> = seen.iter().zip(flat).map(|(s, flat)| s.score(&best) - flat).collect();
        (self.is_part(&best) && is_clear(&gains, MIN_GAIN, MIN_STANDARD_ERRORS)).then_some(best)
    }

    /// Both explanations side by side.
    fn gain(&self, seen: &[SeenIn], levels: &TwoLevels, height_m: f32) -> LevelGain {
        let mean = |score: &dyn Fn(&SeenIn) -> f64| seen.iter().map(score).sum::<f64>() / seen.len().max(1) as f64;
        let mut heights: Vec<f32> = self.tried_heights().chain([height_m, levels.inner_m, levels.outer_m]).collect();
        heights.sort_by(f32::total_cmp);
        LevelGain {
            heights_m: [levels.inner_m, levels.outer_m],
            two: mean(&|s| s.score(levels)),
            one: heights.into_iter().map(|h| (h, mean(&|s| s.window.score(h, 0.0, Correlation::Linear)))).collect(),
            n_views: seen.len(),
        }
    }

    /// Heights over the whole range, log-spaced.
    fn tried_heights(&self) -> impl Iterator<Item = f32> + use<> {
        let HeightBounds { min_m, max_m } = self.bounds;
        (0..N_HEIGHTS).map(move |i| min_m * (max_m / min_m).powf(i as f32 / (N_HEIGHTS - 1) as f32))
    }

    /// The one level that explains most.
    fn best_level(&self, seen: &[&SeenIn], height_m: f32) -> f32 {
        let total = |h: f32| seen.iter().map(|s| s.window.score(h, 0.0, Correlation::Linear)).sum::<f64>();
        let scored = std::iter::once(height_m).chain(self.tried_heights()).map(|h| (total(h), h));
        scored.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(height_m, |(_, h)| h)
    }

    fn guesses(&self, height_m: f32) -> impl Iterator<Item = TwoLevels> + '_ {
        let size = self.high - self.low;
        let middles = FIRST_MIDDLES.into_iter().flat_map(|x| FIRST_MIDDLES.into_iter().map(move |y| Vec2::new(x, y)));
        middles.flat_map(move |middle| {
            FIRST_SHARES.into_iter().map(move |[outer, inner]| {
                let (middle, half) = (self.low + middle * size, 0.5 * FIRST_SIZE * size);
                self.within(TwoLevels {
                    low: middle - half,
                    high: middle + half,
                    inner_m: inner * height_m,
                    outer_m: outer * height_m,
                })
            })
        })
    }

    fn within(&self, levels: TwoLevels) -> TwoLevels {
        let in_bounds = |h: f32| h.clamp(self.bounds.min_m, self.bounds.max_m);
        TwoLevels {
            low: levels.low.max(self.low),
            high: levels.high.min(self.high),
            inner_m: in_bounds(levels.inner_m),
            outer_m: in_bounds(levels.outer_m),
        }
    }

    /// Pattern search: the sides, the place and the levels, with each step until none helps.
    fn climb(&self, seen: &[&SeenIn], start: TwoLevels, score: f64, steps: &[f32]) -> (f64, TwoLevels) {
        let (mut best, mut at) = (score, start);
        for &share in steps {
            loop {
                let before = best;
                for step in moves() {
                    let moved = self.moved(&at, step, share);
                    if (moved.high - moved.low).min_element() < MIN_SIDE_M {
                        continue;
                    }
                    let score = seen.iter().map(|s| s.score(&moved)).sum();
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

    fn moved(&self, at: &TwoLevels, (low, high, inner, outer): Move, share: f32) -> TwoLevels {
        let step = share * (self.high - self.low);
        self.within(TwoLevels {
            low: at.low + low * step,
            high: at.high + high * step,
            inner_m: at.inner_m * (1.0 + inner * share * HEIGHT_STEP),
            outer_m: at.outer_m * (1.0 + outer * share * HEIGHT_STEP),
        })
    }

    /// Whether both parts are large, and well apart.
    fn is_part(&self, levels: &TwoLevels) -> bool {
        let inner_m2 = (levels.high - levels.low).element_product();
        let outline_m2 = self.prism.area_m2();
        let least_m2 = MIN_PART_M2.max(MIN_PART_SHARE * outline_m2);
        let (lower, upper) = (levels.inner_m.min(levels.outer_m), levels.inner_m.max(levels.outer_m));
        inner_m2 >= least_m2
            && outline_m2 - inner_m2 >= least_m2
            && upper - lower >= MIN_STEP_M.max(MIN_STEP_SHARE * upper)
    }

    fn corners(&self, levels: &TwoLevels) -> [[f64; 2]; 4] {
        // Beyond the outline where it comes close to it, so that no slivers stay.
        let low = Vec2::select((levels.low - self.low).cmplt(Vec2::splat(SNAP_M)), self.low - SNAP_M, levels.low);
        let high = Vec2::select((self.high - levels.high).cmplt(Vec2::splat(SNAP_M)), self.high + SNAP_M, levels.high);
        [low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)]
            .map(|corner| (self.axes.transpose() * corner).as_dvec2().to_array())
    }
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
