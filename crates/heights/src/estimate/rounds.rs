//! The method's loop: solve, move photos or split footprints where the solution asks for it, solve again; then refine.

use std::collections::BTreeSet;

use glam::DVec3;

use super::beside::{Outlines, tallest_m};
use super::doubts::{mark_small, mark_towers};
use super::parts::{PartId, Parts, without};
use super::refinement::Refinement;
use super::task::{Heights, MethodSettings, NamedCamera, Task};
use crate::optimise::{CalibrationRays, Former, Kept, OptimiseConfig, Problem, Rays, Solution, ViewInput, solve};
use crate::render::PlacedCamera;
use crate::scene::Scene;
use crate::views::ViewKind;

/// Rounds of splitting: each finds one more level of a building.
const MAX_ROUNDS: usize = 2;
/// Full sweeps over parts among buildings whose heights are known from the round before.
const RESUMED_SWEEPS: usize = 2;

/// Turns evidence into one height per building of a scene: the optimiser, or a baseline in its place.
pub type Solver<'a> = &'a dyn Fn(&Problem<'_>, &OptimiseConfig) -> Solution;

/// Estimates the heights of all buildings of a task.
#[must_use]
pub fn estimate(task: &Task<'_>, settings: &MethodSettings) -> Heights {
    estimate_with(task, settings, &solve)
}

/// As [`estimate`], with another solver.
#[must_use]
pub fn estimate_with(task: &Task<'_>, settings: &MethodSettings, solver: Solver<'_>) -> Heights {
    Rounds { task, settings, solver, moved_m: DVec3::ZERO }.run()
}

/// The views of a task in a scene, at the solver's working resolution, moved in the map frame, metres. Heights are measured in oblique
/// views; in a flight that has none, depth in metres measures them in nadir views too.
#[must_use]
pub fn view_inputs(views: &[NamedCamera], optimise: &OptimiseConfig, scene: &Scene, moved_m: DVec3) -> Vec<ViewInput> {
    let is_in_metres = optimise.search.calibrate_on == CalibrationRays::None;
    let kind = ViewKind::for_heights(views.iter().map(NamedCamera::kind));
    let measures = kind == ViewKind::Oblique || is_in_metres;
    let of = |view: &NamedCamera| {
        let pose = view.posed.camera_from_map.moved(moved_m);
        let placed = PlacedCamera::new(view.posed.camera.reduced_to(optimise.working_px), pose, scene.origin);
        ViewInput::new(&view.name, placed, measures && view.kind() == kind)
    };
    views.iter().map(of).collect()
}

struct Rounds<'a> {
    task: &'a Task<'a>,
    settings: &'a MethodSettings,
    solver: Solver<'a>,
    /// Offset that the photos were moved by onto the footprints, map frame, metres.
    moved_m: DVec3,
}

impl Rounds<'_> {
    fn run(mut self) -> Heights {
        let whole = Parts::whole(self.task.buildings);
        let mut parts = whole.clone();
        let mut scene = self.scene(&parts);
        let mut rays = self.untraced();
        let mut solution = self.solve(&scene, &rays, &self.settings.optimise, None);
        let (layer_shift, level_off) = (solution.layer_shift, solution.level_off);
        if let Some(shift) = layer_shift {
            self.moved_m = shift.on_ground();
            rays = self.untraced();
            solution = self.solve(&scene, &rays, &self.settings.search(|search| search.measure_shift = false), None);
        }
        let mut cuts = Vec::new();
        // Positions of the parts in the solution.
        let mut former: Vec<Option<usize>> = (0..parts.parts.len()).map(Some).collect();
        let mut tallest = tallest_m(&parts, &solution);
        while cuts.len() < MAX_ROUNDS {
            let round = parts.cuts(scene.origin, &solution.other_levels);
            let Some(before) = parts.split(&round) else { break };
            former = before;
            scene = self.scene(&parts);
            rays = rays.of_other_footprints();
            cuts.push(round);
            if cuts.len() < MAX_ROUNDS {
                let kept: Vec<Kept> = former.iter().map(|at| at.map_or(Kept::Nothing, Kept::Height)).collect();
                let resumed = Former { solution: &solution, kept: &kept };
                solution = self.solve(&scene, &rays, &self.resumed(), Some(resumed));
                former = (0..parts.parts.len()).map(Some).collect();
            }
            tallest_m(&parts, &solution).into_iter().for_each(|(building, height_m)| {
                let tallest = tallest.entry(building).or_insert(0.0);
                *tallest = tallest.max(height_m);
            });
        }
        let keeping_whole = self.settings.search(|search| {
            search.split_levels = false;
            search.measure_shift = false;
        });
        if !cuts.is_empty() || !solution.other_levels.is_empty() {
            // Heights found with other footprints hide what stands behind them.
            let is_cut = |part: usize| !parts.parts[part].path.is_empty();
            let is_open = Outlines { scene: &scene, parts: &parts }.are_beside(is_cut, &tallest);
            let kept: Vec<Kept> = is_open
                .iter()
                .zip(&former)
                .map(|(is_open, at)| match at {
                    Some(at) if !is_open => Kept::Height(*at),
                    _ => Kept::Nothing,
                })
                .collect();
            let from = Former { solution: &solution, kept: &kept };
            solution = self.solve(&scene, &rays, &keeping_whole, Some(from));
        }
        let mut joined: BTreeSet<PartId> = BTreeSet::new();
        loop {
            let n_before = joined.len();
            joined.extend(parts.contradicted(&solution.heights, &cuts));
            if joined.len() == n_before {
                break;
            }
            let before = std::mem::replace(&mut parts, whole.clone());
            cuts = cuts.iter().map(|round| without(round, &joined)).collect();
            cuts.retain(|round| parts.split(round).is_some());
            scene = self.scene(&parts);
            rays = rays.of_other_footprints();
            let former = parts.positions_in(&before);
            let is_new = |part: usize| former[part].is_none();
            let is_open = Outlines { scene: &scene, parts: &parts }.are_beside(is_new, &tallest);
            let kept: Vec<Kept> = is_open
                .iter()
                .zip(&former)
                .map(|(is_open, at)| match at {
                    Some(at) if !is_open => Kept::All(*at),
                    _ => Kept::Nothing,
                })
                .collect();
            let from = Former { solution: &solution, kept: &kept };
            solution = self.solve(&scene, &rays, &keeping_whole, Some(from));
        }
        // Photos show roofs where they are.
        move_footprints(&mut scene, &solution);
        let unread_photos = self.refine(&mut scene, &mut parts, &mut solution);
        mark_towers(&scene, &mut solution);
        mark_small(&scene, &mut solution);
        solution.level_off = level_off;
        let Parts { parts, splits } = parts;
        Heights { parts, solution, splits, joined: joined.into_iter().collect(), layer_shift, unread_photos }
    }

    fn scene(&self, parts: &Parts) -> Scene {
        let on_ground: Vec<_> = parts.parts.iter().map(|part| (&part.footprint, part.ground)).collect();
        let frame = self.task.frame;
        Scene::at(frame.origin, &on_ground, self.task.terrain, frame.bounds, frame.bounds.ground_margin_m())
    }

    /// Rays of the views through a scene, none traced yet.
    fn untraced(&self) -> Rays {
        Rays::new(self.task.views.len(), self.settings.optimise.stride_px)
    }

    /// Settings to see whether a part has yet another level.
    fn resumed(&self) -> OptimiseConfig {
        self.settings.search(|search| {
            search.full_sweeps = RESUMED_SWEEPS.min(search.full_sweeps);
            search.local_sweeps = 0;
            search.correct_edge_bleeding = false;
            search.measure_shift = false;
            search.measure_footprints = false;
            search.roof_forms.clear();
        })
    }

    fn solve(&self, scene: &Scene, rays: &Rays, optimise: &OptimiseConfig, former: Option<Former<'_>>) -> Solution {
        let &Task { views, priors, seed, progress, .. } = self.task;
        let problem = Problem {
            scene,
            views: &view_inputs(views, optimise, scene, self.moved_m),
            without_prior: &|view| priors.absence(view),
            load_prior: &|view| priors.load(view),
            green: &|view| priors.green(view),
            former,
            seed,
            rays,
            progress,
        };
        let mut solution = (self.solver)(&problem, optimise);
        // Whichever solver: no height outside the range is returned.
        solution.heights.iter_mut().for_each(|solved| solved.keep_within(scene.bounds, optimise.height_reference));
        solution
    }

    /// Refines the roofs by the photos, and splits footprints where these show several levels. Returns the photos that cannot be read,
    /// and why.
    fn refine(&self, scene: &mut Scene, parts: &mut Parts, solution: &mut Solution) -> Vec<(usize, String)> {
        let Some(photos) = self.task.photos.filter(|_| self.settings.refines_roofs()) else { return Vec::new() };
        let refinement = Refinement {
            settings: &self.settings.refinement,
            reference: self.settings.optimise.height_reference,
            moved_m: self.moved_m,
            split_levels: self.settings.optimise.search.split_levels,
        };
        refinement.run(self.task.views, photos, scene, parts, solution)
    }
}

/// Moves footprints to where the photos show their buildings.
pub fn move_footprints(scene: &mut Scene, solution: &Solution) {
    for (prism, solved) in scene.prisms.iter_mut().zip(&solution.heights) {
        if let Some(shift) = solved.footprint_shift {
            *prism = shift.moved(prism);
        }
    }
}
