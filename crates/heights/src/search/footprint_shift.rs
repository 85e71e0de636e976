//! Shifts of single footprints against the photos, and walls that stand too far out: a layer whose buildings were drawn one by one is off
//! by a metre here and there.
//!
//! ```text
//! S(d, o) = max_h Σ_k ρ_k(h; footprint moved by d, its walls moved outwards by o)
//! d*, o*    place of its maximum, by parabolas along east, north and outwards, in rounds;   σ: leaving out one view at a time
//! ```
//!
//! Everything else stays where it is. Footprints that share walls are moved together, and their walls are not moved outwards. As with
//! a layer, only buildings that are seen from around are asked, and the forms of roofs have to leave the shift standing.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3, Vec2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::SearchConfig;
use crate::ray::Ray;
use crate::roofs::{self, RoofView, carries, distance_to_border, is_clear};
use crate::scene::{Prism, Scene};
use crate::score::Scope;
use crate::search::shift::{PeakSearch, evenly_around, lead_all_around};
use crate::search::{SweepViews, ViewsOf, standing};
use crate::stats::{jackknife_sigma, median, parabola_peak};

/// Walls no farther apart than this are shared, metres.
const SHARED_M: f32 = 0.1;
/// Fewer views do not tell a shift from a height.
const MIN_VIEWS: usize = 4;
/// Views that are asked of a building at most.
const MAX_VIEWS: usize = 16;
/// Heights that are tried, over so much around the present one, metres.
const N_HEIGHTS: usize = 7;
const HEIGHTS_M: f32 = 1.5;
/// First step of the search, metres, if not a pixel of the working image on the ground; rounds of it at most, and the share of a step
/// within which it has come to rest: the peak then lies between scores that are known. Delft's surface and two towns: 0.3 gives the
/// same heights, and takes 5 % more processor time over Delft.
const STEP_M: f64 = 0.4;
const MAX_ROUNDS: usize = 8;
const AT_REST: f64 = 0.75;
/// Longest shift that is believed, metres, and as a share of the width, the root of the area: farther away stands something else.
const LONGEST_M: f64 = 2.5;
const LONGEST_SHARE: f64 = 0.25;
/// Least shift that is told, metres, if not three standard deviations; the same of walls that stand too far out.
const LEAST_M: f64 = 0.5;
const SIGMAS: f64 = 3.0;
/// By how much the views have to agree better there, as for the forms of roofs.
const MIN_GAIN: f64 = 0.002;
const STANDARD_ERRORS: f64 = 2.0;
/// The same against walls that moved on one side alone. Without it 31 exact footprints are told over Delft's surface of laser returns, with
/// trees and sheds at walls, and with it 3; of a village and a district whose footprints are off by 0.8 m (seed 43) 31 and 28.
const ONE_SIDED_STANDARD_ERRORS: f64 = 1.0;
/// Fewer lone buildings than this do not say where walls stand on the whole.
const MIN_LONE: usize = 5;

/// How far one footprint lies from where the photos show its building.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct FootprintShift {
    /// It lies so far east of what the photos show, metres.
    pub east_m: f64,
    /// The same to the north, metres.
    pub north_m: f64,
    /// How far its walls stand outside of what the photos show, compared with other footprints of the scene, metres; negative where the
    /// roof reaches beyond them.
    pub too_large_m: f64,
    /// One standard deviation along each axis, metres.
    pub sigma_m: f64,
}

impl FootprintShift {
    /// The way from the footprint to where the photos show the building, local frame or map, metres.
    #[must_use]
    pub fn way(&self) -> DVec2 {
        -DVec2::new(self.east_m, self.north_m)
    }

    /// A footprint that is off by it, in place; its walls stand as they were given.
    #[must_use]
    pub fn moved(&self, prism: &Prism) -> Prism {
        prism.moved(self.way().as_vec2(), 0.0)
    }

    /// Whether it lies elsewhere, not only its walls too far out.
    #[must_use]
    pub fn is_moved(&self) -> bool {
        self.way() != DVec2::ZERO
    }
}

/// Result for a block before the others are known.
struct Measured {
    way: DVec3,
    sigma: DVec3,
}

/// A scene with its views, as the search has left it.
pub(crate) struct SettledScene<'a> {
    pub scene: &'a Scene,
    pub views: SweepViews<'a>,
    pub views_of: ViewsOf<'a>,
    pub heights_m: &'a [f32],
    pub config: &'a SearchConfig,
}

impl SettledScene<'_> {
    /// By building, how far its footprint is off; `None` where it fits, too little is seen to say, or no building of its block is asked for.
    pub fn footprint_shifts(&self, is_asked: impl Fn(usize) -> bool) -> Vec<Option<FootprintShift>> {
        let mut blocks = blocks(&self.scene.prisms);
        blocks.retain(|block| block.iter().any(|&b| is_asked(b)));
        let measured: Vec<Option<Measured>> = blocks.par_iter().map(|block| self.block(block).measure()).collect();
        let lone_m = blocks.iter().zip(&measured).filter(|(block, _)| block.len() == 1);
        let lone_m: Vec<f64> = lone_m.filter_map(|(_, measured)| Some(measured.as_ref()?.way.z)).collect();
        // Edges that bleed look like walls that all stand too far out: what all have in common is not told.
        let common_m = if lone_m.len() < MIN_LONE { None } else { median(&lone_m) };
        let tell = |(block, measured): (&Vec<usize>, &Option<Measured>)| {
            let Measured { way, sigma } = measured.as_ref()?;
            let sigma_m = sigma.truncate().max_element();
            let is_moved = way.truncate().length() >= LEAST_M.max(SIGMAS * sigma_m);
            let outwards_m = common_m.filter(|_| block.len() == 1).map_or(0.0, |common_m| way.z - common_m);
            // What was found half a metre away, and may not lie there, was measured in another place than the one told.
            let is_settled = is_moved || way.truncate().length() < LEAST_M;
            let is_resized = is_settled && outwards_m.abs() >= LEAST_M.max(SIGMAS * sigma.z);
            if !(is_moved || is_resized) || !self.block(block).is_better(*way) {
                return None;
            }
            let off = if is_moved { -way.truncate() } else { DVec2::ZERO };
            let too_large_m = if is_resized { -outwards_m } else { 0.0 };
            Some(FootprintShift { east_m: off.x, north_m: off.y, too_large_m, sigma_m })
        };
        let told: Vec<Option<FootprintShift>> = blocks.par_iter().zip(&measured).map(tell).collect();
        let mut shifts = vec![None; self.scene.prisms.len()];
        for (block, shift) in blocks.iter().zip(told) {
            block.iter().for_each(|&b| shifts[b] = shift);
        }
        shifts
    }

    /// Some buildings, to be moved together.
    fn block(&self, buildings: &[usize]) -> Block<'_> {
        let members = buildings.iter().map(|&b| self.member(b, buildings)).collect();
        Block { scene: self.scene, config: self.config, members }
    }

    /// One building of a block, in views from around it.
    fn member(&self, building: usize, block: &[usize]) -> Member<'_> {
        let Self { scene, views, config, .. } = *self;
        let (prism, height_m) = (&scene.prisms[building], self.heights_m[building]);
        let of_building = self.views_of[building].iter().filter_map(|&v| views[v].as_ref());
        let scope = Scope::near(height_m + roofs::REACH_M);
        let scope = scope.without_crowns(standing(scene, of_building, building));
        let (mut seen, mut known) = (Vec::new(), Vec::new());
        for v in self.around(building) {
            let Some(view) = views[v].as_ref() else { continue };
            let Some(roof_view) = view.roof_view(scene, building, scope, config) else { continue };
            let rays: Vec<u32> = roof_view.window.rays().collect();
            let profiles = view.evidence.profiles;
            let is_elsewhere = |b: u32| block.binary_search(&(b as usize)).is_err();
            let depth = |&r: &u32| profiles.depth_among(r as usize, &view.stops, is_elsewhere);
            let crossed = rays.iter().flat_map(|&r| profiles.intervals(r as usize)).map(|c| c.building as usize);
            let beside: BTreeSet<usize> =
                crossed.filter(|&b| b != building).filter_map(|b| block.binary_search(&b).ok()).collect();
            known.push(KnownView {
                view: v,
                depths: rays.iter().map(depth).collect(),
                rays: rays.iter().map(|&r| view.evidence.ray(view.placed, r)).collect(),
                beside: beside.into_iter().collect(),
            });
            seen.push(roof_view);
        }
        Member { prism, height_m, views: seen, known }
    }

    /// Some of a building's views, as evenly around it as they come.
    fn around(&self, building: usize) -> Vec<usize> {
        let prism = &self.scene.prisms[building];
        let centre = prism.centre_at(prism.ground_z).as_dvec3();
        let way = |&v: &usize| Some((v, (self.views[v].as_ref()?.placed.eye() - centre).truncate()));
        evenly_around(self.views_of[building].iter().filter_map(way), MAX_VIEWS)
    }
}

/// By view, by how much scores are better in one place than in another, mean over the members of a block that it sees.
fn gains(views: &BTreeSet<usize>, of_scores: &[usize], here: &[f64], there: &[f64]) -> Vec<f64> {
    let gain_of = |view: &usize| {
        let gains = of_scores.iter().zip(here.iter().zip(there)).filter(|(of_score, _)| *of_score == view);
        let gains: Vec<f64> = gains.map(|(_, (here, there))| there - here).collect();
        gains.iter().sum::<f64>() / gains.len() as f64
    };
    views.iter().map(gain_of).collect()
}

/// The building that stands for all that hang together with one.
fn root(first_of: &[usize], mut b: usize) -> usize {
    while first_of[b] != b {
        b = first_of[b];
    }
    b
}

/// Buildings that hang together by shared walls, each in one block; all in ascending order.
fn blocks(prisms: &[Prism]) -> Vec<Vec<usize>> {
    let boxes: Vec<(Vec2, Vec2)> = prisms
        .iter()
        .map(|prism| {
            let bounds = prism.bounds_below(0.0);
            (bounds.min.truncate() - SHARED_M, bounds.max.truncate() + SHARED_M)
        })
        .collect();
    let touch = |a: usize, b: usize| {
        let is_near = |of: &Prism, to: &Prism| of.edges().any(|(corner, _)| distance_to_border(to, corner) <= SHARED_M);
        is_near(&prisms[a], &prisms[b]) || is_near(&prisms[b], &prisms[a])
    };
    let mut by_west: Vec<usize> = (0..prisms.len()).collect();
    by_west.sort_by(|&a, &b| boxes[a].0.x.total_cmp(&boxes[b].0.x));
    let mut first_of: Vec<usize> = (0..prisms.len()).collect();
    for (at, &a) in by_west.iter().enumerate() {
        for &b in by_west[at + 1..].iter().take_while(|&&b| boxes[b].0.x <= boxes[a].1.x) {
            let (of_a, of_b) = (root(&first_of, a), root(&first_of, b));
            let is_apart = boxes[b].0.y > boxes[a].1.y || boxes[b].1.y < boxes[a].0.y;
            if of_a != of_b && !is_apart && touch(a, b) {
                first_of[of_a.max(of_b)] = of_a.min(of_b);
            }
        }
    }
    let mut blocks: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for b in 0..prisms.len() {
        blocks.entry(root(&first_of, b)).or_default().push(b);
    }
    blocks.into_values().collect()
}

/// One building of a block.
struct Member<'a> {
    prism: &'a Prism,
    height_m: f32,
    views: Vec<RoofView<'a>>,
    /// By view, what is known of it.
    known: Vec<KnownView>,
}

/// All that does not change in a view when a block is moved.
struct KnownView {
    view: usize,
    rays: Vec<Ray>,
    /// Where they end without any building of the block.
    depths: Vec<f32>,
    /// Other members of the block that stand in its window.
    beside: Vec<usize>,
}

impl Member<'_> {
    /// The best height, and the score of it in each view.
    fn scores(&self, least_m: f32) -> (f32, Vec<f64>) {
        let spacing_m = 2.0 * HEIGHTS_M / (N_HEIGHTS - 1) as f32;
        let low_m = (self.height_m - HEIGHTS_M).max(least_m);
        let at = |i: usize| low_m + spacing_m * i as f32;
        let score =
            |height_m: f32| -> Vec<f64> { self.views.iter().map(|v| v.window.score(height_m, v.weight)).collect() };
        let totals: Vec<f64> = (0..N_HEIGHTS).map(|i| score(at(i)).iter().sum()).collect();
        let best = (1..N_HEIGHTS - 1).fold(1, |best, i| if totals[i] > totals[best] { i } else { best });
        let around = [totals[best - 1], totals[best], totals[best + 1]];
        let height_m = parabola_peak(f64::from(at(best)), f64::from(spacing_m), around) as f32;
        (height_m, score(height_m))
    }
}

/// Buildings that are moved together.
struct Block<'a> {
    scene: &'a Scene,
    config: &'a SearchConfig,
    members: Vec<Member<'a>>,
}

impl Block<'_> {
    /// Views that see the block, and that of each member's each score.
    fn views(&self) -> (BTreeSet<usize>, Vec<usize>) {
        let of_scores: Vec<usize> = self.members.iter().flat_map(|m| &m.known).map(|known| known.view).collect();
        (of_scores.iter().copied().collect(), of_scores)
    }

    /// Ways that it may take, besides the two along the ground its walls' way outwards where it has no neighbours.
    fn axes(&self) -> &'static [DVec3] {
        if self.members.len() == 1 { &[DVec3::X, DVec3::Y, DVec3::Z] } else { &[DVec3::X, DVec3::Y] }
    }

    fn measure(mut self) -> Option<Measured> {
        let (views, of_scores) = self.views();
        let mut ways = Vec::new();
        let mut pixels_m = Vec::new();
        for member in &self.members {
            let centre = member.prism.centre_at(member.prism.ground_z).as_dvec3();
            ways.extend(member.views.iter().map(|v| (v.placed.eye() - centre).truncate()));
            pixels_m.extend(member.views.iter().map(|v| v.placed.pixel_m_at(centre)));
        }
        if views.len() < MIN_VIEWS || !lead_all_around(&ways) {
            return None;
        }
        let step_m = STEP_M.max(median(&pixels_m)?);
        let search = PeakSearch { axes: self.axes(), step_m, at_rest: AT_REST, max_rounds: MAX_ROUNDS };
        let (around, cross) = search.run(|at| self.scores(at))?;
        let way = around + cross.to_peak(|_| true);
        let area_m2: f64 = self.members.iter().map(|m| f64::from(m.prism.area_m2())).sum();
        if way.truncate().length() > LONGEST_M.min(LONGEST_SHARE * area_m2.sqrt()) {
            return None;
        }
        let without: Vec<DVec3> = views.iter().map(|out| cross.to_peak(|i| of_scores[i] != *out)).collect();
        let sigma_of = |axis: usize| jackknife_sigma(&without.iter().map(|d| d[axis]).collect::<Vec<_>>());
        Some(Measured { way, sigma: DVec3::new(sigma_of(0)?, sigma_of(1)?, sigma_of(2)?) })
    }

    /// Whether the views prefer a place clearly, whatever the forms of the roofs.
    fn is_better(&mut self, way: DVec3) -> bool {
        let (views, of_scores) = self.views();
        let (here, there) = (self.scores(DVec3::ZERO), self.scores(way));
        let gains = gains(&views, &of_scores, &here, &there);
        let rays = self.members.iter().flat_map(|m| &m.views).map(|v| (v.window.n_rays(), 1.0 + v.weight));
        let of_views =
            rays.zip(here.iter().zip(&there)).map(|((n, most), (here, there))| (n, here / most, there / most));
        if !is_clear(&gains, MIN_GAIN, STANDARD_ERRORS) || !carries(self.axes().len() as f64, of_views) {
            return false;
        }
        if way.truncate().length() >= LEAST_M && !self.is_off_on_both_sides(way, &there) {
            return false;
        }
        // A house with a low annex on one side seems to be off until its roof may have two levels.
        let mut roofs_at = |at: DVec3| -> f64 {
            self.put(at);
            let of = |member: &Member<'_>| {
                let prism = member.prism.moved(at.truncate().as_vec2(), at.z as f32);
                let (height_m, _) = member.scores(self.scene.bounds.min_m);
                let judged = roofs::find(&prism, self.scene.bounds, height_m, self.config, &member.views, Vec::new);
                judged.score.unwrap_or(0.0)
            };
            self.members.iter().map(of).sum()
        };
        roofs_at(way) > roofs_at(DVec3::ZERO)
    }

    /// Whether a shift is better than the same walls moved on one side alone, ahead or behind: a tree, a shed or an annex at one wall
    /// draws the footprint there, and says nothing of the other side. `there` are the scores of the shift.
    fn is_off_on_both_sides(&mut self, way: DVec3, there: &[f64]) -> bool {
        let (views, of_scores) = self.views();
        let by = way.truncate().as_vec2();
        let along = by.normalize_or_zero();
        let corners = self.members.iter().flat_map(|m| m.prism.edges()).map(|(corner, _)| along.dot(corner));
        let (behind, ahead) = corners.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), at| (l.min(at), h.max(at)));
        [(behind, ahead), (ahead, behind)].into_iter().all(|(fixed, free)| {
            let one_sided = self.scores_of(|prism| prism.drawn_out(by, fixed, free).moved(Vec2::ZERO, way.z as f32));
            is_clear(&gains(&views, &of_scores, &one_sided, there), MIN_GAIN, ONE_SIDED_STANDARD_ERRORS)
        })
    }

    /// The score of each member in each of its views at its best height, with the block at a place.
    fn scores(&mut self, at: DVec3) -> Vec<f64> {
        self.scores_of(|prism| prism.moved(at.truncate().as_vec2(), at.z as f32))
    }

    /// The same with its footprints altered.
    fn scores_of(&mut self, altered: impl Fn(&Prism) -> Prism) -> Vec<f64> {
        self.put_altered(altered);
        self.members.iter().flat_map(|member| member.scores(self.scene.bounds.min_m).1).collect()
    }

    /// Moves all footprints of the block, and their walls outwards.
    fn put(&mut self, at: DVec3) {
        self.put_altered(|prism| prism.moved(at.truncate().as_vec2(), at.z as f32));
    }

    /// Puts other footprints in the place of the block's.
    fn put_altered(&mut self, altered: impl Fn(&Prism) -> Prism) {
        let moved: Vec<Prism> = self.members.iter().map(|m| altered(m.prism)).collect();
        // Neighbours are blocks, as in the sweeps.
        let levels: Vec<f32> = self.members.iter().map(|m| m.prism.ground_z + m.height_m).collect();
        self.members.par_iter_mut().zip(&moved).for_each(|(member, own)| {
            let mut over = Vec::new();
            for (view, known) in member.views.iter_mut().zip(&member.known) {
                let mut depths = known.depths.clone();
                for &other in &known.beside {
                    let circle = moved[other].circle();
                    for (ray, depth) in known.rays.iter().zip(&mut depths).filter(|(ray, _)| circle.is_crossed(ray)) {
                        over.clear();
                        moved[other].intervals(ray, &mut over);
                        let roof = (levels[other] - ray.origin.z) / ray.direction.z;
                        let stops = over.iter().filter(|stretch| roof < stretch.leave && stretch.leave > 0.0);
                        *depth = stops.fold(*depth, |depth, stretch| depth.min(roof.max(stretch.enter)));
                    }
                }
                view.window.put(own, &known.rays, &depths);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::roofs::wings::tests::prism;

    /// A row of three whose middle one touches no corner of the others, a house half a metre beside it, and one far away.
    #[test]
    fn houses_that_share_walls_are_one_block() {
        let square =
            |x: f64, y: f64, side: f64| prism(&[(x, y), (x + side, y), (x + side, y + side), (x, y + side)], 0.0);
        let houses = [
            square(8.0, 2.0, 6.0),
            square(60.0, 60.0, 8.0),
            square(0.0, 0.0, 8.0),
            square(14.05, -1.0, 10.0),
            square(24.55, -1.0, 10.0),
        ];
        assert_eq!(blocks(&houses), [vec![0, 2, 3], vec![1], vec![4]]);
    }
}
