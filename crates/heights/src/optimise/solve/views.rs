//! Which views take part: selection for the present heights, and loading the priors that it asks for.

use std::collections::BTreeSet;

use glam::DVec3;
use rand::Rng as _;
use rayon::prelude::*;

use super::{SolverState, Solving, ViewInput};
use crate::config::MAX_VIEWS_PER_BUILDING;
use crate::evidence::straighten::{GroundFits, PriorShape};
use crate::seed;
use crate::views::{CandidateView, Choice, Selection, Visibility, drawn, in_turn, select, select_each, visibility};

/// Fits of a view that is not straightened.
static NO_FITS: GroundFits = GroundFits::NONE;

impl SolverState<'_> {
    /// Selects views that see the buildings.
    pub(super) fn select(&self, visibilities: &[Option<Visibility>]) -> Selection {
        let views = self.problem.views;
        let n_buildings = self.problem.scene.prisms.len();
        let axes: Vec<DVec3> = views.iter().map(|v| v.placed.axis()).collect();
        let ground_z = f64::from(self.problem.scene.prisms.first().map_or(0.0, |p| p.ground_z));
        let stations: Vec<DVec3> = views.iter().map(|v| v.placed.looks_at(ground_z)).collect();
        let candidates: Vec<CandidateView> =
            views.iter().map(|v| CandidateView { eye: v.placed.eye(), key: v.key }).collect();
        let centres: Vec<DVec3> = (0..n_buildings).map(|b| self.centre(b)).collect();
        let mut selection = match self.views_config.choice {
            Choice::Cover => select(&self.views_config, visibilities, &stations, &axes, n_buildings),
            Choice::Each => select_each(&self.views_config, visibilities, &candidates, &centres),
            Choice::Random => {
                let draw = |v: &ViewInput| seed::stream(self.problem.seed, "drawn views", &[v.key]).random();
                let keys: Vec<u64> = views.iter().map(draw).collect();
                drawn(&self.views_config, visibilities, &keys, n_buildings)
            }
        };
        let kept: Vec<usize> = (0..n_buildings).filter(|&b| !self.problem.is_searched(b)).collect();
        if !kept.is_empty() {
            kept.into_iter().for_each(|b| selection.views_of_building[b].clear());
            let needed: BTreeSet<usize> = selection.views_of_building.iter().flatten().copied().collect();
            selection.views = needed.into_iter().collect();
        }
        selection
    }

    /// Selects views for the present heights and loads the priors that are new; a view whose prior cannot be loaded is
    /// replaced by another.
    pub(super) fn reselect(&mut self) -> Selection {
        let mut visibilities = self.visibilities();
        loop {
            let selection = self.select(&visibilities);
            self.load(&selection.views);
            let failed: Vec<usize> = selection.views.iter().copied().filter(|&v| self.failed[v].is_some()).collect();
            if failed.is_empty() {
                let of_building = selection.views_of_building.iter().enumerate();
                self.views_of = of_building.map(|(b, views)| self.best_views(b, views, &visibilities)).collect();
                return selection;
            }
            for view in failed {
                visibilities[view] = None;
            }
        }
    }

    /// Visibility in each view with the present heights; `None` where it takes no part.
    pub(super) fn visibilities(&self) -> Vec<Option<Visibility>> {
        let takes_part =
            |&v: &usize| self.problem.views[v].is_oblique && self.failed[v].is_none() && self.disagreeing[v].is_none();
        let taking_part: Vec<usize> = (0..self.problem.views.len()).filter(takes_part).collect();
        let placed: Vec<_> =
            taking_part.iter().map(|&v| (&self.problem.views[v].placed, self.problem.profiles(v))).collect();
        let seen = visibility(self.problem.scene, &placed, &self.heights_m, self.config.stride_px);
        let mut visibilities = vec![None; self.problem.views.len()];
        for (view, seen) in taking_part.into_iter().zip(seen) {
            visibilities[view] = Some(seen);
        }
        visibilities
    }

    pub(super) fn load(&mut self, views: &[usize]) {
        let new: Vec<usize> =
            views.iter().copied().filter(|&v| self.evidence[v].is_none() && self.failed[v].is_none()).collect();
        let n_done = std::sync::atomic::AtomicUsize::new(0);
        let loaded: Vec<_> = new
            .par_iter()
            .map(|&v| {
                let evidence = self.problem.prior(v, self.config.stride_px).map(|prior| {
                    let evidence = self.problem.evidence(v, prior, self.config.stride_px);
                    let is_line = self.prior_shape == Some(PriorShape::Line);
                    let fits = if is_line { &NO_FITS } else { prior.fits(&evidence) };
                    (evidence, fits)
                });
                let done = n_done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
                (self.problem.progress)(Solving::Priors, done, new.len());
                evidence
            })
            .collect();
        let fits: Vec<_> = loaded.iter().flatten().map(|(_, fits)| *fits).collect();
        // The first photos whose priors could be loaded decide for all.
        if self.prior_shape.is_none() && !fits.is_empty() {
            self.prior_shape = Some(PriorShape::of(&fits));
        }
        let shape = self.prior_shape.unwrap_or_default();
        for (v, loaded) in new.into_iter().zip(loaded) {
            match loaded {
                Ok((mut evidence, fits)) => {
                    evidence.straighten(fits, shape);
                    self.evidence[v] = Some(evidence);
                }
                Err(why) => self.failed[v] = Some(why),
            }
        }
    }

    /// The views a building is measured in: from each sector of azimuth in turn the one that sees most of it.
    fn best_views(&self, building: usize, candidates: &[usize], seen: &[Option<Visibility>]) -> Vec<usize> {
        let centre = self.centre(building);
        let n_rays = |view: usize| {
            let sights = seen[view].as_ref().map_or(&[][..], |seen| &seen.buildings);
            sights.binary_search_by_key(&(building as u32), |s| s.building).map_or(0, |i| sights[i].n_rays)
        };
        let loaded = candidates.iter().copied().filter(|&v| self.evidence[v].is_some());
        let ranked = loaded.map(|view| {
            let from = self.problem.views[view].placed.eye() - centre;
            (view, from.truncate(), std::cmp::Reverse(n_rays(view)))
        });
        in_turn(ranked, MAX_VIEWS_PER_BUILDING)
    }

    /// Middle of a building at its ground, local frame, metres.
    pub(super) fn centre(&self, building: usize) -> DVec3 {
        let prism = &self.problem.scene.prisms[building];
        prism.centre_at(prism.ground_z).as_dvec3()
    }
}
