//! Footprints that hold two roof levels (a tower on its podium, a hall beside its office): no single height fits them.
//!
//! Two levels are searched for in all views of the building ([`crate::roofs::two_levels`]). Only the *plan* of the two parts is
//! taken from here, if they are clear, large and well apart: their heights are then searched as any other's.

use glam::Vec2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::{MAX_VIEWS_PER_BUILDING, SearchConfig};
use crate::roofs::two_levels::{AlignedFootprint, N_MORE, PatternStep, TwoLevelLimits, TwoLevelView, TwoLevels};
use crate::roofs::{RoofView, carries, is_clear};
use crate::scene::{HeightBounds, Prism, Scene};
use crate::score::Scope;
use crate::search::{SweepView, SweepViews, ViewsOf, standing};
use crate::views::{corners_inside, in_turn};

/// Least area of a part, m², and as a share of the footprint; smaller ones are steps of one roof ([`crate::roofs::stepped`]).
const MIN_PART_M2: f32 = 20.0;
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
/// Distance from a new part within which this is done, metres between middles: what hides and is hidden stands closer.
const NEAR_M: f32 = 100.0;
/// Heights tried for one level, log-spaced over the whole range.
const N_HEIGHTS: usize = 24;
/// First heights of the inner and the outer level, as shares of the height that one level gets.
const FIRST_SHARES: [[f32; 2]; 6] = [[1.0, 0.1], [1.0, 0.25], [1.3, 0.5], [2.5, 1.0], [6.0, 1.0], [0.4, 1.0]];
/// Steps of the search, for the followed guesses and for the best of them.
const COARSE_STEPS: [PatternStep; 3] = [step(0.2), step(0.1), step(0.05)];
const FINE_STEPS: [PatternStep; 4] = [step(0.05), step(0.025), step(0.0125), step(0.006)];
/// A side of the rectangle as near as this to the footprint's own is the footprint's, metres.
const SNAP_M: f32 = 2.5;

const fn step(side_share: f32) -> PatternStep {
    PatternStep { side_share, height_m: 0.0, height_share: 1.25 * side_share }
}

/// A part of a footprint that stands at another level than the rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OtherLevel {
    /// Position of the building in the scene.
    pub building: usize,
    /// Corners of a rectangle, local frame, metres, counter-clockwise; it may reach beyond the footprint.
    pub corners: [[f64; 2]; 4],
    /// Gain of the two levels over one, and how many views had a say.
    #[serde(default)]
    pub gain: LevelGain,
}

/// Gain of two levels over one in explaining the priors.
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

/// Buildings that should be split, by index. Those known from a round before have been looked at there: only what one
/// level explains badly, close to new parts, is looked at again. What is split far away changes nothing here.
pub(crate) fn find(
    scene: &Scene,
    views: SweepViews<'_>,
    views_of: ViewsOf<'_>,
    heights_m: &[f32],
    is_known: &(dyn Fn(usize) -> bool + Sync),
    config: &SearchConfig,
) -> Vec<OtherLevel> {
    let middle = |building: usize| scene.prisms[building].centre_at(0.0).truncate();
    let parts: Vec<Vec2> = (0..scene.prisms.len()).filter(|&b| !is_known(b)).map(middle).collect();
    let is_near_part = |building| parts.iter().any(|part| part.distance(middle(building)) <= NEAR_M);
    let of_building = |building: usize| {
        let prism = &scene.prisms[building];
        if prism.area_m2() < 2.0 * MIN_PART_M2 || is_known(building) && !is_near_part(building) {
            return None;
        }
        // A tall roof as large as the footprint leaves most images: what stands below it may be seen in them still.
        let at_foot = (views_of[building].len() < MIN_VIEWS).then(|| views_of_foot(scene, views, building));
        let of_building = at_foot.as_ref().unwrap_or(&views_of[building]);
        let standing = standing(scene, of_building.iter().filter_map(|&v| views[v].as_ref()), building);
        let scope = Scope::whole().without_crowns(standing);
        let plan = AlignedFootprint::new(prism, TwoLevelLimits { heights: scene.bounds, side_m: MIN_SIDE_M });
        let seen_in = |some: &[usize]| -> Vec<RoofView<'_>> {
            let views = some.iter().filter_map(|&v| views[v].as_ref());
            views.filter_map(|v| v.roof_view(scene, building, scope, config)).collect()
        };
        let one = OneLevel { height_m: heights_m[building], bounds: scene.bounds };
        let below_score = if is_known(building) { DOUBTFUL_SCORE } else { 1.0 - MIN_GAIN };
        let every = of_building.len().div_ceil(N_FIRST_VIEWS).max(1);
        let first: Vec<usize> = of_building.iter().copied().step_by(every).collect();
        let first = seen_in(&first);
        let guess = first_guess(&plan, &two_levels(&first, &plan), one)?;
        let views = seen_in(of_building);
        let seen = two_levels(&views, &plan);
        let levels = other_level(&plan, &seen, &guess, below_score)?;
        Some(OtherLevel { building, corners: corners(&plan, &levels), gain: gain(&seen, &levels, one) })
    };
    (0..scene.prisms.len()).into_par_iter().filter_map(of_building).collect()
}

/// Views that show the whole footprint where it stands on the ground.
fn views_of_foot(scene: &Scene, views: SweepViews<'_>, building: usize) -> Vec<usize> {
    let prism = &scene.prisms[building];
    let foot = prism.centre_at(prism.ground_z).as_dvec3();
    let shows_foot = |view: &SweepView<'_>| corners_inside(prism, view.placed, prism.ground_z) == 1.0;
    let taking_part = views.iter().enumerate().filter_map(|(v, view)| Some((v, view.as_ref()?)));
    let ranked = taking_part.filter(|(_, view)| shows_foot(view)).map(|(v, view)| {
        let n_rays = view.evidence.rays_of(building as u32).len();
        (v, (view.placed.eye() - foot).truncate(), std::cmp::Reverse(n_rays))
    });
    in_turn(ranked, MAX_VIEWS_PER_BUILDING)
}

/// Where one level for the whole footprint is looked for.
#[derive(Debug, Clone, Copy)]
struct OneLevel {
    /// Height that the search has found, metres.
    height_m: f32,
    bounds: HeightBounds,
}

impl OneLevel {
    /// Heights over the whole range, log-spaced.
    fn tried(self) -> impl Iterator<Item = f32> {
        let HeightBounds { min_m, max_m } = self.bounds;
        (0..N_HEIGHTS).map(move |i| min_m * (max_m / min_m).powf(i as f32 / (N_HEIGHTS - 1) as f32))
    }

    /// The height that explains most.
    fn best_m(self, seen: &[&TwoLevelView<'_>]) -> f32 {
        let total = |h: f32| seen.iter().map(|s| s.one_level(h)).sum::<f64>();
        let scored = std::iter::once(self.height_m).chain(self.tried()).map(|h| (total(h), h));
        scored.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(self.height_m, |(_, h)| h)
    }
}

/// A building in some views.
fn two_levels<'a>(views: &'a [RoofView<'_>], plan: &AlignedFootprint<'_>) -> Vec<TwoLevelView<'a>> {
    views.iter().map(|view| TwoLevelView::new(view, 0.0, plan)).collect()
}

/// The best single level in a few views, and the two levels that explain more there.
struct FirstGuess {
    one_m: f32,
    two: TwoLevels,
}

/// `None` where one level is as good in a few views.
fn first_guess(plan: &AlignedFootprint<'_>, first: &[TwoLevelView<'_>], one: OneLevel) -> Option<FirstGuess> {
    let first: Vec<&TwoLevelView<'_>> = first.iter().collect();
    if first.is_empty() {
        return None;
    }
    let one_m = one.best_m(&first);
    let pairs_m = FIRST_SHARES.map(|pair| pair.map(|share| share * one.height_m));
    let (score, two) = plan.best_of(plan.guesses(&pairs_m), N_FOLLOWED, &first, &COARSE_STEPS)?;
    let flat: f64 = first.iter().map(|s| s.one_level(one_m)).sum();
    let is_better = score - flat >= 0.5 * MIN_GAIN * first.len() as f64;
    (is_part(plan.prism, &two) && is_better).then_some(FirstGuess { one_m, two })
}

/// The part at another level than the rest; `None` where one level is as good, or scores no less than `below_score`.
fn other_level(
    plan: &AlignedFootprint<'_>,
    seen: &[TwoLevelView<'_>],
    guess: &FirstGuess,
    below_score: f64,
) -> Option<TwoLevels> {
    if seen.len() < MIN_VIEWS {
        return None;
    }
    let flat: Vec<f64> = seen.iter().map(|s| s.one_level(guess.one_m)).collect();
    // No score is better than 1: where one level almost has it, two cannot be clearly better.
    let mean = flat.iter().sum::<f64>() / flat.len() as f64;
    if mean >= below_score {
        return None;
    }
    let all: Vec<&TwoLevelView<'_>> = seen.iter().collect();
    let (_, best) = plan.climb(&all, guess.two, &FINE_STEPS);
    let two: Vec<f64> = seen.iter().map(|s| s.two_levels(&best)).collect();
    let gains: Vec<f64> = two.iter().zip(&flat).map(|(two, flat)| two - flat).collect();
    let of_views = seen.iter().zip(flat.iter().zip(&two)).map(|(s, (flat, two))| (s.n_rays(), *flat, *two));
    let is_believed = is_clear(&gains, MIN_GAIN, MIN_STANDARD_ERRORS) && carries(N_MORE, of_views);
    (is_part(plan.prism, &best) && is_believed).then_some(best)
}

/// Both explanations side by side.
fn gain(seen: &[TwoLevelView<'_>], levels: &TwoLevels, one: OneLevel) -> LevelGain {
    let mean =
        |score: &dyn Fn(&TwoLevelView<'_>) -> f64| seen.iter().map(score).sum::<f64>() / seen.len().max(1) as f64;
    let mut heights: Vec<f32> = one.tried().chain([one.height_m, levels.inner_m, levels.outer_m]).collect();
    heights.sort_by(f32::total_cmp);
    LevelGain {
        heights_m: [levels.inner_m, levels.outer_m],
        two: mean(&|s| s.two_levels(levels)),
        one: heights.into_iter().map(|h| (h, mean(&|s| s.one_level(h)))).collect(),
        n_views: seen.len(),
    }
}

/// Whether both parts are large, and well apart.
fn is_part(prism: &Prism, levels: &TwoLevels) -> bool {
    let inner_m2 = (levels.high - levels.low).element_product();
    let footprint_m2 = prism.area_m2();
    let least_m2 = MIN_PART_M2.max(MIN_PART_SHARE * footprint_m2);
    inner_m2 >= least_m2
        && footprint_m2 - inner_m2 >= least_m2
        && levels.upper_m() - levels.lower_m() >= MIN_STEP_M.max(MIN_STEP_SHARE * levels.upper_m())
}

/// The rectangle's; beyond the footprint where it comes close to it, so that no slivers stay.
fn corners(plan: &AlignedFootprint<'_>, levels: &TwoLevels) -> [[f64; 2]; 4] {
    let low = Vec2::select((levels.low - plan.low).cmplt(Vec2::splat(SNAP_M)), plan.low - SNAP_M, levels.low);
    let high = Vec2::select((plan.high - levels.high).cmplt(Vec2::splat(SNAP_M)), plan.high + SNAP_M, levels.high);
    plan.corners(low, high)
}
