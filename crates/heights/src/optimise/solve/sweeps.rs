//! The passes of the local search.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::outcome::is_hopeless;
use super::{Kept, Problem, SolverState, Solving};
use crate::config::CalibrationRays;
use crate::evidence::bleed;
use crate::optimise::layer_shift;
use crate::roofs::Judged;
use crate::roofs::formed::FormedRoof;
use crate::scene::{Prism, Scene};
use crate::search::disagreeing::disagreeing;
use crate::search::empty_space::{self, FoundView, KnownRays};
use crate::search::footprint_shift::{FootprintShift, SettledScene};
use crate::search::levels;
use crate::search::{Finding, Range, SweepView, around, find_roofs, standing, sweep};

/// Heights are kept on a grid of so many steps per metre.
const STEPS_PER_M: f32 = 1000.0;
/// Roofs that move by less do not change what is seen of their neighbours, metres.
const STILL_M: f32 = 0.05;
/// Local sweeps over heights that were looked for in the whole range again.
const N_AFTER_LEAP: usize = 2;
/// Rounds in which views that disagree are replaced by others, which may disagree too.
const MAX_REPLACED: usize = 4;
/// Less bleeding is left alone, pixels of the working image.
const MIN_BLEEDING_PX: f64 = 0.5;

impl SolverState<'_> {
    pub(super) fn run_search(&mut self) {
        let config = &self.config.search;
        self.set_start_heights();
        let n_sweeps = config.full_sweeps + config.local_sweeps;
        let mut n_selected = 0;
        let mut before = None;
        for i in 0..config.full_sweeps {
            (self.problem.progress)(Solving::Epochs, i, n_sweeps);
            if i % config.reselect_every.max(1) == 0 {
                n_selected = self.reselect().views.len();
            }
            let is_last = i + 1 == config.full_sweeps;
            let problem = self.problem;
            let is_asked = |b: usize| match problem.kept(b) {
                Kept::Nothing => true,
                Kept::Height(_) => is_last,
                Kept::All(_) => false,
            };
            let is_new: Vec<bool> = {
                let before = &before;
                let of = |b: usize| is_asked(b) && self.looks_new(b, before.as_ref());
                (0..self.heights_m.len()).into_par_iter().map(of).collect()
            };
            before = Some((self.views_of.clone(), self.heights_m.clone()));
            self.sweep(|b| is_new[b], Range::Full, n_selected);
        }
        n_selected = self.replace_disagreeing(n_selected);
        if config.split_levels || config.measure_shift {
            let views = self.sweep_views(|_| true);
            let (problem, heights_m) = (self.problem, &self.heights_m);
            let is_known = |b: usize| problem.kept(b) != Kept::Nothing;
            let find = || levels::find(problem.scene, &views, &self.views_of, heights_m, &is_known, config);
            let other_levels = if config.split_levels { find() } else { Vec::new() };
            // A block over two levels fits the photos best where it stands over the higher one.
            let mut views_of = self.views_of.clone();
            other_levels.iter().for_each(|other| views_of[other.building].clear());
            let shift = || layer_shift::measure(problem, &views, &views_of, heights_m, config);
            let layer_shift = config.measure_shift.then(shift).flatten();
            // Depth in metres shows the ground itself.
            let asks_level =
                config.measure_shift && layer_shift.is_none() && config.calibrate_on != CalibrationRays::None;
            let level = || layer_shift::measure_level(problem, &views, &views_of, heights_m, config);
            let level_off = asks_level.then(level).flatten();
            drop(views);
            (self.other_levels, self.layer_shift, self.level_off) = (other_levels, layer_shift, level_off);
            if self.layer_shift.is_some() {
                return; // to be solved again with photos and footprints in one place
            }
        }
        if !self.other_levels.is_empty() {
            return; // to be solved again with these footprints split
        }
        if config.correct_edge_bleeding {
            self.correct_edge_bleeding();
        }
        for i in 0..config.local_sweeps {
            (self.problem.progress)(Solving::Epochs, config.full_sweeps + i, n_sweeps);
            let problem = self.problem;
            self.sweep(|b| problem.is_searched(b), local(i), n_selected);
        }
        let problem = self.problem;
        let views = self.sweep_views(|_| true);
        let views_of = |b: usize| self.views_of[b].iter().filter_map(|&v| views[v].as_ref());
        let is_green = |b: usize| standing(problem.scene, views_of(b), b).is_green();
        let is_green = (0..self.heights_m.len()).into_par_iter().map(is_green).collect();
        let is_asked = |b: usize| !config.roof_forms.is_empty() && problem.is_searched(b);
        let roofs = find_roofs(problem.scene, &views, &self.views_of, &self.heights_m, is_asked, config);
        drop(views);
        self.is_green = is_green;
        self.keep_roofs(roofs);
        if self.roofs.iter().any(|judged| judged.roof.is_some()) {
            self.leap_beside_roofs(n_selected);
        }
        if config.measure_footprints {
            self.measure_footprints(n_selected);
        }
        self.blind_m2 = self.blind_areas_m2();
        (self.problem.progress)(Solving::Epochs, n_sweeps, n_sweeps);
    }

    /// Whether a full sweep would see a building otherwise than the one before, with the views and heights of then: it is new itself, is
    /// measured in other views, or beside one whose roof moved by more than [`STILL_M`] where it stops rays.
    fn looks_new(&self, building: usize, before: Option<&(Vec<Vec<usize>>, Vec<f32>)>) -> bool {
        let Some((views_before, heights_before_m)) = before else { return true };
        let views = &self.views_of[building];
        if self.findings[building].is_none() || *views != views_before[building] {
            return true;
        }
        let prisms = &self.problem.scene.prisms;
        let has_moved_to = |other: usize| {
            let (from_m, to_m) = (heights_before_m[other], self.heights_m[other]);
            ((to_m - from_m).abs() > STILL_M).then(|| prisms[other].ground_z + to_m.max(from_m))
        };
        views.iter().filter_map(|&view| self.evidence[view].as_ref()).any(|evidence| {
            let profiles = evidence.profiles;
            evidence.rays_around_building(building as u32).iter().any(|&ray| {
                let others = profiles.intervals(ray as usize).iter().filter(|c| c.building != building as u32);
                others.into_iter().any(|c| {
                    has_moved_to(c.building as usize).is_some_and(|top_z| top_z > profiles.level(ray as usize, c.leave))
                })
            })
        })
    }

    /// Leaves out the views whose prior shows something else than the others', and looks again for the heights that were measured in
    /// them, in the views that take their place. All other heights and choices of views stay: a bad photo at one end of a city must
    /// not move heights at the other, which a tile does not see. Returns how many views are selected then.
    fn replace_disagreeing(&mut self, mut n_selected: usize) -> usize {
        for _ in 0..MAX_REPLACED {
            let mut scores = vec![Vec::new(); self.evidence.len()];
            for finding in self.findings.iter().flatten() {
                finding.by_view.iter().for_each(|(view, score)| scores[*view].push(*score));
            }
            let found = disagreeing(&scores);
            if found.is_empty() {
                break;
            }
            for disagreeing in found {
                self.evidence[disagreeing.view] = None;
                self.disagreeing[disagreeing.view] = Some(disagreeing);
            }
            let is_left_out = |view: &usize| self.disagreeing[*view].is_some();
            let has_lost_one: Vec<bool> = self.views_of.iter().map(|views| views.iter().any(is_left_out)).collect();
            let before = self.views_of.clone();
            n_selected = self.reselect().views.len();
            for (building, views) in before.into_iter().enumerate().filter(|(building, _)| !has_lost_one[*building]) {
                self.views_of[building] = views;
            }
            for (building, finding) in self.findings.iter_mut().enumerate() {
                if has_lost_one[building] {
                    *finding = None;
                }
            }
            let problem = self.problem;
            self.sweep(|b| has_lost_one[b] && problem.is_searched(b), Range::Full, n_selected);
        }
        n_selected
    }

    /// Looks for the forms of the roofs that are asked for.
    fn find_roofs(&mut self, is_asked: impl Fn(usize) -> bool + Sync) {
        let views = self.sweep_views_of(&is_asked);
        let (scene, config) = (self.problem.scene, &self.config.search);
        let found = find_roofs(scene, &views, &self.views_of, &self.heights_m, is_asked, config);
        drop(views);
        self.keep_roofs(found);
    }

    /// Takes the roofs that were found in place of the former ones.
    fn keep_roofs(&mut self, found: Vec<Option<Judged>>) {
        for (kept, judged) in self.roofs.iter_mut().zip(found) {
            *kept = judged.unwrap_or_else(|| std::mem::take(kept));
        }
    }

    /// Looks in the whole range again for heights that are contested as they stand, now beside neighbours whose roofs have a form: a shed in
    /// front of a house of two levels was measured in front of a block. What is found counts only farther away than
    /// local sweeps reach: nearer by it is no better than what was there.
    fn leap_beside_roofs(&mut self, n_selected: usize) {
        let all = 0..self.heights_m.len();
        let mut leaps: Vec<bool> = all.map(|b| self.is_contested(b)).collect();
        if !leaps.contains(&true) {
            return;
        }
        let before: Vec<_> = self.heights_m.iter().copied().zip(self.findings.iter().cloned()).collect();
        self.sweep(|b| leaps[b], Range::Full, n_selected);
        for i in 0..N_AFTER_LEAP {
            self.sweep(|b| leaps[b], local(i), n_selected);
        }
        let bounds = self.problem.scene.bounds;
        for (b, (height_m, finding)) in before.into_iter().enumerate() {
            let (low, high) = around(height_m, 1.0, bounds);
            let is_near = (low..=high).contains(&self.heights_m[b]);
            if is_near || self.findings[b].as_ref().is_some_and(is_hopeless) {
                (self.heights_m[b], self.findings[b]) = (height_m, finding);
                leaps[b] = false;
            }
        }
        if leaps.contains(&true) {
            self.find_roofs(|b| leaps[b]);
        }
    }

    /// Measures how far single footprints are off; the heights of those that lie elsewhere are settled again there.
    fn measure_footprints(&mut self, n_selected: usize) {
        let (scene, config) = (self.problem.scene, &self.config.search);
        let is_asked = |b: usize| self.problem.is_searched(b);
        let views = self.sweep_views(|_| true);
        let (views_of, heights_m) = (&self.views_of[..], &self.heights_m[..]);
        let shifts = SettledScene { scene, views: &views, views_of, heights_m, config }.footprint_shifts(is_asked);
        drop(views);
        self.footprint_shifts = shifts;
        let is_moved: Vec<bool> =
            self.footprint_shifts.iter().map(|shift| shift.is_some_and(|shift| shift.is_moved())).collect();
        if !is_moved.contains(&true) {
            return;
        }
        let in_place = |(prism, shift): (&Prism, &Option<FootprintShift>)| {
            shift.map_or_else(|| prism.clone(), |shift| shift.moved(prism))
        };
        let prisms = scene.prisms.iter().zip(&self.footprint_shifts).map(in_place).collect();
        let scene = Scene { prisms, ..scene.clone() };
        let rays = self.problem.rays.of_moved_footprints();
        let problem = Problem { scene: &scene, rays: &rays, ..*self.problem };
        let mut there = SolverState::new(&problem, self.config);
        there.heights_m.clone_from(&self.heights_m);
        there.findings.clone_from(&self.findings);
        there.roofs.clone_from(&self.roofs);
        there.views_of.clone_from(&self.views_of);
        there.prior_shape = self.prior_shape;
        there.bleeding_px.clone_from(&self.bleeding_px);
        let of_moved = (0..is_moved.len()).filter(|&b| is_moved[b]).flat_map(|b| self.views_of[b].iter().copied());
        let views: BTreeSet<usize> = of_moved.collect();
        there.load(&views.into_iter().collect::<Vec<_>>());
        there.sweep(|b| is_moved[b], Range::Full, n_selected);
        for i in 0..config.local_sweeps {
            there.sweep(|b| is_moved[b], local(i), n_selected);
        }
        if !config.roof_forms.is_empty() {
            there.find_roofs(|b| is_moved[b]);
        }
        let SolverState { heights_m, findings, roofs, history, .. } = there;
        self.history.extend(history);
        (self.heights_m, self.findings, self.roofs) = (heights_m, findings, roofs);
    }

    /// By building, the area above its roof that none of its views has looked through.
    fn blind_areas_m2(&self) -> Vec<f64> {
        let roofs = self.problem.scene.roofs(&self.heights_m);
        let is_in_metres = self.config.search.calibrate_on == CalibrationRays::None;
        let look_of = |v: usize| {
            let evidence = self.evidence[v].as_ref()?;
            let (placed, stops) = (&self.problem.views[v].placed, evidence.profiles.stops(&roofs));
            Some(FoundView { evidence, placed, stops, all: KnownRays::of(evidence), is_in_metres })
        };
        let all: Vec<Option<FoundView<'_>>> = (0..self.evidence.len()).into_par_iter().map(look_of).collect();
        let of_building = |b: usize| {
            let looks: Vec<&FoundView<'_>> = self.views_of[b].iter().filter_map(|&v| all[v].as_ref()).collect();
            let above_m = self.roofs[b].roof.map_or(0.0, |roof| (roof.ridge_m as f32 - self.heights_m[b]).max(0.0));
            empty_space::blind_area_m2(b as u32, roofs[b] + above_m, &looks)
        };
        (0..roofs.len()).into_par_iter().map(of_building).collect()
    }

    /// Measures how far each prior's near sides bleed over known edges, and samples the priors anew without it.
    fn correct_edge_bleeding(&mut self) {
        let used: Vec<usize> = (0..self.evidence.len()).filter(|&v| self.evidence[v].is_some()).collect();
        let edges = bleed::Edges::new(self.problem.scene, &self.heights_m);
        let shape = self.prior_shape.unwrap_or_default();
        let without_bleeding = |&v: &usize| {
            let evidence = self.evidence[v].as_ref()?;
            let prior = (self.problem.load_prior)(v).ok()?;
            let seen = evidence.crossed().iter().map(|&b| b as usize);
            let bleeding_px = bleed::bleeding_px(&edges.offsets(&self.problem.views[v].placed, &prior, seen));
            if bleeding_px.abs() < MIN_BLEEDING_PX {
                return None;
            }
            let cut_back = self.problem.sampled(v, &prior, bleeding_px, self.config.stride_px);
            let mut cut_back = self.problem.evidence(v, &cut_back, self.config.stride_px);
            // Along the ground it runs as it did.
            if let Some(fits) = self.problem.rays.prior(v).and_then(|as_loaded| as_loaded.known_fits()) {
                cut_back.straighten(fits, shape);
            }
            Some((v, bleeding_px, cut_back))
        };
        let changed: Vec<_> = used.par_iter().filter_map(without_bleeding).collect();
        for (v, bleeding_px, cut_back) in changed {
            self.bleeding_px[v] = bleeding_px;
            self.evidence[v] = Some(cut_back);
        }
    }

    /// The views of the buildings that are asked for, as [`Self::sweep_views`] has them.
    fn sweep_views_of(&self, is_asked: impl Fn(usize) -> bool) -> Vec<Option<SweepView<'_>>> {
        let asked = (0..self.views_of.len()).filter(|&b| is_asked(b));
        let needed: BTreeSet<usize> = asked.flat_map(|b| self.views_of[b].iter().copied()).collect();
        self.sweep_views(|view| needed.contains(&view))
    }

    /// Views with a prior, with the roofs as they stand: levels at first, later those that have been found.
    fn sweep_views(&self, is_needed: impl Fn(usize) -> bool + Sync) -> Vec<Option<SweepView<'_>>> {
        let scene = self.problem.scene;
        let roofs = scene.roofs(&self.heights_m);
        let formed = |(prism, judged): (&Prism, &Judged)| FormedRoof::of(prism, judged.roof);
        let formed: Vec<Option<FormedRoof>> = scene.prisms.par_iter().zip(&self.roofs).map(formed).collect();
        let view_of = |v: usize| {
            let evidence = self.evidence[v].as_ref().filter(|_| is_needed(v))?;
            let placed = &self.problem.views[v].placed;
            let stops = evidence.profiles.stops_at(placed, &roofs, &formed);
            Some(SweepView::new(scene, placed, evidence, stops, &self.config.search))
        };
        (0..self.evidence.len()).into_par_iter().map(view_of).collect()
    }

    /// One pass over the buildings that are asked for: each takes the best height of the range.
    fn sweep(&mut self, is_asked: impl Fn(usize) -> bool + Sync, range: Range, n_selected: usize) {
        let views = self.sweep_views_of(&is_asked);
        let (scene, config) = (self.problem.scene, &self.config.search);
        let found = sweep(scene, &views, &self.views_of, &self.heights_m, is_asked, range, config);
        drop(views);
        let before = self.heights_m.clone();
        for (b, finding) in found.into_iter().enumerate() {
            if let Some(finding) = finding {
                self.heights_m[b] = on_grid(finding.height_m).clamp(scene.bounds.min_m, scene.bounds.max_m);
                // The full sweeps saw the whole range: only they can tell a flat score, or one without a peak.
                let (contrast, whole) = match (range, self.findings[b].take()) {
                    (Range::Local { .. }, Some(previous)) => (previous.contrast, previous.whole),
                    _ => (finding.contrast, finding.whole),
                };
                self.findings[b] = Some(Finding { contrast, whole, ..finding });
            }
        }
        let scores: Vec<f64> = self.findings.iter().flatten().map(|f| f.score).collect();
        let loss = 1.0 - crate::stats::mean(&scores).unwrap_or(0.0);
        self.record(loss, &before, n_selected, None);
    }
}

/// The range of a local sweep: the first of several tries a wider one.
fn local(i: usize) -> Range {
    Range::Local { share: if i == 0 { 1.0 } else { 0.5 } }
}

/// A height to the millimetre: less than that, such as what far-away neighbours make, does not travel from sweep to sweep.
fn on_grid(height_m: f32) -> f32 {
    (height_m * STEPS_PER_M).round() / STEPS_PER_M
}
