//! Surfaces that a roof may have: levels, and pitched roofs of several forms.

use glam::{DVec2, DVec3};

use super::evidence::Evidence;
use super::grid::Grid;
use super::raised;
use crate::stats::parabola_peak;

/// Most heights compared in one sweep; the step grows beyond.
const MAX_HEIGHTS: usize = 400;
/// Levels and pitched roofs that are chosen.
const N_LEVELS: usize = 7;
const N_PITCHED: usize = 4;
/// Levels this near to each other are one, metres.
const LEVELS_APART_M: f64 = 0.6;
/// Pitches that are ranked: rise over run. From 14 to 54 degrees.
const PITCHES: [f64; 8] = [0.25, 0.38, 0.52, 0.66, 0.8, 0.95, 1.15, 1.4];
/// Ridges of gables, as shares of the region's width.
const RIDGES: [f64; 5] = [0.26, 0.38, 0.5, 0.62, 0.74];
/// Steps of pitch, ridge and height from the ranked ones to the best: rise over run, share of the width, heights.
const REFINING: [[f64; 3]; 4] = [[0.12, 0.08, 4.0], [0.08, 0.05, 2.0], [0.04, 0.03, 1.0], [0.02, 0.015, 0.5]];
/// Heights around the ranked one that are tried first.
const N_AROUND: i32 = 6;
/// Steepest lean-to: rise over run.
const STEEPEST_SHED: f64 = 0.6;
/// Cells that pitched roofs are ranked by.
const N_RANKED_BY: usize = 120;
/// Step among the heights that they are ranked at.
const RANKED_EVERY: usize = 2;
/// Pitched roofs that are compared and refined after that.
const N_COMPARED: usize = 4;
/// A surface over all cells, and the agreement of the photos with it.
#[derive(Debug, Clone)]
pub(super) struct RoofSurface {
    /// Heights above the ground by cell, metres.
    pub heights_m: Vec<f32>,
    pub scores: Vec<f32>,
    is_level: bool,
}

impl RoofSurface {
    /// Sum of the scores over some cells.
    pub fn score(&self, is_in: &[bool]) -> f64 {
        sum(&self.scores, is_in)
    }

    /// Mean height over some cells, metres.
    pub fn mean_m(&self, is_in: &[bool]) -> f64 {
        sum(&self.heights_m, is_in) / is_in.iter().filter(|i| **i).count() as f64
    }

    /// Height of a level roof, metres.
    pub fn level_m(&self) -> Option<f64> {
        self.is_level.then(|| self.heights_m.first().copied().map(f64::from)).flatten()
    }
}

fn sum(values: &[f32], is_in: &[bool]) -> f64 {
    values.iter().zip(is_in).filter(|(_, is_in)| **is_in).map(|(value, _)| f64::from(*value)).sum()
}

/// The surface that the photos agree with most on some cells.
pub(super) fn best<'a>(surfaces: &'a [RoofSurface], is_in: &[bool]) -> Option<&'a RoofSurface> {
    surfaces.iter().max_by(|a, b| a.score(is_in).total_cmp(&b.score(is_in)))
}

/// Scores of all cells at all heights.
pub(super) struct HeightSweep {
    low_m: f64,
    step_m: f64,
    /// By height, cell by cell.
    scores: Vec<Vec<f32>>,
    /// Cells at ground level, map frame.
    on_ground: Vec<DVec3>,
}

impl HeightSweep {
    pub fn new(evidence: &mut Evidence<'_>, ground_z_m: f64, [low_m, high_m]: [f64; 2]) -> Self {
        let grid = evidence.grid;
        let on_ground: Vec<DVec3> = grid.cells.iter().map(|&i| grid.middle(i).extend(ground_z_m)).collect();
        let step_m = evidence.step_m.max((high_m - low_m) / MAX_HEIGHTS as f64);
        let n_heights = ((high_m - low_m) / step_m).ceil() as usize + 1;
        let projected = evidence.projected(&on_ground);
        let scores = (0..n_heights).map(|k| evidence.scores(&projected, low_m + step_m * k as f64)).collect();
        Self { low_m, step_m, scores, on_ground }
    }

    fn height_m(&self, k: usize) -> f64 {
        self.low_m + self.step_m * k as f64
    }

    /// The level at one of the heights, its height refined where most of the chosen cells agree.
    fn level(&self, k: usize, is_chosen: &[bool]) -> RoofSurface {
        let around = |k: usize| sum(&self.scores[k], is_chosen);
        let height_m = if k > 0 && k + 1 < self.scores.len() {
            parabola_peak(self.height_m(k), self.step_m, [k - 1, k, k + 1].map(around))
        } else {
            self.height_m(k)
        };
        let scores = self.scores[k].clone();
        RoofSurface { heights_m: vec![height_m as f32; scores.len()], scores, is_level: true }
    }
}

/// The surfaces that explain a region: each is the one that gains most over those before it.
pub(super) fn choose(evidence: &mut Evidence<'_>, sweep: &HeightSweep, is_in: &[bool]) -> Vec<RoofSurface> {
    let inside: Vec<usize> = (0..is_in.len()).filter(|&at| is_in[at]).collect();
    let mut explained = vec![0.0_f32; is_in.len()];
    let mut levels: Vec<usize> = Vec::new();
    let gain = |scores: &[f32], explained: &[f32]| -> f32 {
        inside.iter().map(|&at| (scores[at] - explained[at]).max(0.0)).sum()
    };
    let mut surfaces = Vec::new();
    for _ in 0..N_LEVELS {
        let is_apart = |k: &usize| levels.iter().all(|l| l.abs_diff(*k) as f64 * sweep.step_m >= LEVELS_APART_M);
        let gains = (0..sweep.scores.len()).filter(is_apart).map(|k| (k, gain(&sweep.scores[k], &explained)));
        let Some((k, _)) = gains.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        let is_gained: Vec<bool> =
            (0..is_in.len()).map(|at| is_in[at] && sweep.scores[k][at] > explained[at]).collect();
        surfaces.push(sweep.level(k, &is_gained));
        explain(&mut explained, &sweep.scores[k]);
        levels.push(k);
    }
    let mut pitched = pitched(evidence, sweep, &inside);
    for _ in 0..N_PITCHED {
        let gains = pitched.iter().enumerate().map(|(at, surface)| (at, gain(&surface.scores, &explained)));
        let Some((at, _)) = gains.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        let surface = pitched.swap_remove(at);
        explain(&mut explained, &surface.scores);
        surfaces.push(surface);
    }
    surfaces
}

fn explain(explained: &mut [f32], scores: &[f32]) {
    for (best, score) in explained.iter_mut().zip(scores) {
        *best = best.max(*score);
    }
}

/// Pitched roofs over a region, where each agrees with the photos most.
///
/// They are ranked by the scores of the sweep at their heights: its windows are level, but have their middles on the roof.
fn pitched(evidence: &mut Evidence<'_>, sweep: &HeightSweep, inside: &[usize]) -> Vec<RoofSurface> {
    let grid = evidence.grid;
    let every = inside.len().div_ceil(N_RANKED_BY).max(1);
    let ranked_by: Vec<usize> = inside.iter().copied().step_by(every).collect();
    let mut ranked: Vec<(f32, Pitched)> = Vec::new();
    for form in PitchedForm::all(grid, inside) {
        let steps: Vec<usize> =
            ranked_by.iter().map(|&at| (form.height_m(grid, at) / sweep.step_m).round() as usize).collect();
        let highest = steps.iter().copied().max().unwrap_or(0);
        let total =
            |k: usize| -> f32 { ranked_by.iter().zip(&steps).map(|(&at, step)| sweep.scores[k + step][at]).sum() };
        let tried = (0..sweep.scores.len().saturating_sub(highest)).step_by(RANKED_EVERY).map(|k| (total(k), k));
        if let Some((total, k)) = tried.max_by(|a, b| a.0.total_cmp(&b.0)) {
            ranked.push((total, Pitched { form, eave_m: sweep.height_m(k) }));
        }
    }
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    ranked.truncate(N_COMPARED);
    let mut compared = |pitched: Pitched| {
        let pitched = pitched.refined(evidence, sweep, &ranked_by);
        let place = |(at, place): (usize, &DVec3)| raised(*place, pitched.height_m(grid, at));
        let surface: Vec<DVec3> = sweep.on_ground.iter().enumerate().map(place).collect();
        let scores = evidence.scores(&evidence.projected(&surface), 0.0);
        let heights_m = (0..scores.len()).map(|at| pitched.height_m(grid, at) as f32).collect();
        RoofSurface { heights_m, scores, is_level: false }
    };
    ranked.into_iter().map(|(_, pitched)| compared(pitched)).collect()
}

/// A pitched roof at a height.
#[derive(Debug, Clone, Copy)]
struct Pitched {
    form: PitchedForm,
    eave_m: f64,
}

impl Pitched {
    fn height_m(&self, grid: &Grid, at: usize) -> f64 {
        self.eave_m + self.form.height_m(grid, at)
    }

    /// With its pitch, ridge and height moved to where the photos agree with some cells of it as one surface.
    fn refined(self, evidence: &Evidence<'_>, sweep: &HeightSweep, cells: &[usize]) -> Self {
        let grid = evidence.grid;
        let as_one = |pitched: &Self| {
            let place = |&at: &usize| raised(sweep.on_ground[at], pitched.height_m(grid, at));
            evidence.as_one(&cells.iter().map(place).collect::<Vec<DVec3>>())
        };
        let mean_m =
            |form: &PitchedForm| cells.iter().map(|&at| form.height_m(grid, at)).sum::<f64>() / cells.len() as f64;
        let mut best = (self, as_one(&self));
        let consider = |best: &mut (Self, f64), next: Self| {
            let score = as_one(&next);
            if score > best.1 {
                *best = (next, score);
            }
        };
        for k in -N_AROUND..=N_AROUND {
            consider(&mut best, Self { eave_m: self.eave_m + f64::from(k) * sweep.step_m, ..self });
        }
        for [pitch, ridge, height] in REFINING {
            for sign in [1.0, -1.0] {
                let before = best.0;
                let moved = |pitch: f64, ridge: f64| {
                    let form = before.form.moved(sign * pitch, sign * ridge)?;
                    // The mean height stays: it is known better than the eave.
                    Some(Self { form, eave_m: before.eave_m + mean_m(&before.form) - mean_m(&form) })
                };
                let raised = Self { eave_m: before.eave_m + sign * height * sweep.step_m, ..before };
                for next in [moved(pitch, 0.0), moved(0.0, ridge), Some(raised)].into_iter().flatten() {
                    consider(&mut best, next);
                }
            }
        }
        best.0
    }
}

/// A pitched roof over the rectangle around a region, along the grid's axes.
#[derive(Debug, Clone, Copy)]
struct PitchedForm {
    kind: PitchedKind,
    low: DVec2,
    high: DVec2,
    /// Rise over run.
    pitch: f64,
}

#[derive(Debug, Clone, Copy)]
enum PitchedKind {
    /// Axis across the ridge, and where the ridge is across it, as a share.
    Gable(usize, f64),
    Hip,
    /// Axis along which it rises, and whether it rises backwards.
    Shed(usize, bool),
}

impl PitchedForm {
    fn all(grid: &Grid, inside: &[usize]) -> Vec<Self> {
        let along = |at: &usize| grid.along(grid.middle(grid.cells[*at]));
        let half = DVec2::splat(0.5 * grid.cell_m);
        let low = inside.iter().map(along).fold(DVec2::INFINITY, DVec2::min) - half;
        let high = inside.iter().map(along).fold(DVec2::NEG_INFINITY, DVec2::max) + half;
        let of_pitch = |&pitch: &f64| {
            let gables = [0, 1].into_iter().flat_map(|axis| RIDGES.map(|ridge| PitchedKind::Gable(axis, ridge)));
            let sheds = [0, 1].into_iter().flat_map(|axis| [false, true].map(|back| PitchedKind::Shed(axis, back)));
            let sheds = sheds.filter(move |_| pitch <= STEEPEST_SHED);
            gables.chain([PitchedKind::Hip]).chain(sheds).map(move |kind| Self { kind, low, high, pitch })
        };
        PITCHES.iter().flat_map(of_pitch).collect()
    }

    /// The same with another pitch and ridge; `None` if there is none such.
    fn moved(mut self, pitch: f64, ridge: f64) -> Option<Self> {
        self.pitch += pitch;
        match &mut self.kind {
            PitchedKind::Gable(_, at) => *at += ridge,
            PitchedKind::Hip | PitchedKind::Shed(..) if ridge != 0.0 => return None,
            PitchedKind::Hip | PitchedKind::Shed(..) => {}
        }
        (self.pitch > 0.0).then_some(self)
    }

    /// Height over the lowest edge at a cell, metres.
    fn height_m(&self, grid: &Grid, at: usize) -> f64 {
        let place = grid.along(grid.middle(grid.cells[at]));
        let (from_low, from_high, size) = (place - self.low, self.high - place, self.high - self.low);
        let run = match self.kind {
            PitchedKind::Gable(axis, ridge) => {
                let lower = ridge.max(1.0 - ridge) * size[axis];
                lower - (from_low[axis] - ridge * size[axis]).abs()
            }
            PitchedKind::Hip => from_low.min(from_high).min_element(),
            PitchedKind::Shed(axis, false) => from_low[axis],
            PitchedKind::Shed(axis, true) => from_high[axis],
        };
        (self.pitch * run).max(0.0)
    }
}
