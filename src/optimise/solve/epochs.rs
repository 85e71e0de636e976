//! The epochs of the ordinal optimiser.

use rand::Rng;
use rand::seq::SliceRandom;

use super::{Solving, State};
use crate::optimise::adam::Adam;
use crate::optimise::config::Gradient;
use crate::optimise::gradient::edge_sampled::Outlines;
use crate::optimise::ordinal::{StepInput, ViewStep, view_step};
use crate::seed;

impl State<'_> {
    pub(super) fn run_ordinal(&mut self) {
        let config = &self.config.ordinal;
        let bounds = self.problem.scene.bounds;
        self.set_start_heights();
        let mut adam = Adam::new(self.heights_m.len());
        let mut selection = None;
        let mut n_steps = 0;
        for epoch in 0..config.epochs {
            (self.problem.progress)(Solving::Epochs, epoch, config.epochs);
            if epoch % config.reselect_every.max(1) == 0 {
                selection = Some(self.reselect());
            }
            let Some(selection) = &selection else { return };
            let mut order: Vec<usize> =
                selection.views.iter().copied().filter(|&v| self.evidence[v].is_some()).collect();
            order.shuffle(&mut seed::stream(self.problem.seed, "view order", &[epoch as u64]));
            let before = self.heights_m.clone();
            let n_total = (config.epochs * order.len()).max(2);
            let mut steps: Vec<ViewStep> = Vec::new();
            for view in order {
                let progress = (n_steps as f32 / (n_total - 1) as f32).min(1.0);
                let anneal = |ends: [f32; 2]| ends[0] * (ends[1] / ends[0]).powf(progress);
                let roofs = self.problem.scene.roofs(&self.heights_m);
                let mut rng = seed::stream(self.problem.seed, "pairs", &[epoch as u64, view as u64]);
                let evidence = self.evidence[view].as_ref().expect("only loaded views are in the order");
                let prior = match config.gradient {
                    Gradient::EdgeSampled => (self.problem.load_prior)(view).ok(),
                    Gradient::Interior | Gradient::CentralDifference => None,
                };
                let (scene, placed) = (self.problem.scene, &self.problem.views[view].placed);
                let outlines = prior.as_ref().map(|prior| Outlines { scene, placed, prior });
                let input = StepInput { evidence, roofs: &roofs, difference_m: anneal(config.difference_m), outlines };
                let Some(step) = view_step(&input, config, &mut rng) else { continue };
                for &(building, derivative) in &step.gradient {
                    let at = building as usize;
                    self.is_voted_on[at] |= derivative != 0.0;
                    let change = adam.change(at, derivative, f64::from(anneal(config.step_m)));
                    self.heights_m[at] = (self.heights_m[at] + change as f32).clamp(bounds.min_m, bounds.max_m);
                }
                n_steps += 1;
                steps.push(step);
            }
            let losses: Vec<f64> = steps.iter().map(|s| s.loss).collect();
            let n_pairs: usize = steps.iter().map(|s| s.n_pairs).sum();
            let n_active: usize = steps.iter().map(|s| s.n_active).sum();
            let n_selected = selection.views.len();
            let active = n_active as f64 / n_pairs.max(1) as f64;
            self.record(crate::stats::mean(&losses).unwrap_or(0.0), &before, n_selected, Some(active));
        }
        (self.problem.progress)(Solving::Epochs, config.epochs, config.epochs);
    }
}

/// Heights from a normal distribution around mid-range, a quarter of the range wide, clamped (`SiZeUp`, "Initialisation";
/// the paper leaves mean and width open).
pub(super) fn initial_heights(root: u64, min_m: f32, max_m: f32, n: usize) -> Vec<f32> {
    let mut rng = seed::stream(root, "initial heights", &[]);
    let (mean, sigma) = (0.5 * (min_m + max_m), 0.25 * (max_m - min_m));
    (0..n)
        .map(|_| {
            // Box and Muller.
            let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
            let angle = std::f32::consts::TAU * rng.random::<f32>();
            (mean + sigma * radius * angle.cos()).clamp(min_m, max_m)
        })
        .collect()
}
