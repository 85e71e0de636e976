//! The epochs of the ordinal optimiser.

use rand::Rng;
use rand::seq::SliceRandom;
use rayon::prelude::*;

use super::{SolverState, Solving};
use crate::config::{Gradient, Loss, OrdinalConfig, StepOn};
use crate::optimise::solution::Reason;
use crate::paper::adam::Adam;
use crate::paper::gradient::edge_sampled::EdgeInput;
use crate::paper::gradient::sum_by_building;
use crate::paper::ordinal::{Costs, StepInput, ViewStep, costs, view_step};
use crate::paper::regression;
use crate::paper::schedule::Step;
use crate::roofs::is_clear;
use crate::scene::HeightBounds;
use crate::score::peak::reach_m;
use crate::seed;
use crate::views::Selection;

/// A height agrees with the priors where the next lower and higher answers cost more, by so many standard errors over views.
const STANDARD_ERRORS: f64 = 2.0;

impl SolverState<'_> {
    pub(super) fn run_ordinal(&mut self) {
        let config = &self.config.ordinal;
        self.set_start_heights();
        let mut adam = Adam::new(self.heights_m.len());
        let mut selection = Selection::default();
        for epoch in 0..config.epochs {
            (self.problem.progress)(Solving::Epochs, epoch, config.epochs);
            if epoch % config.reselect_every.max(1) == 0 {
                selection = self.reselect();
            }
            let mut order: Vec<usize> =
                selection.views.iter().copied().filter(|&v| self.evidence[v].is_some()).collect();
            order.shuffle(&mut seed::stream(self.problem.seed, "view order", &[epoch as u64]));
            let batches: Vec<&[usize]> = match config.step_on {
                StepOn::View => order.chunks(1).collect(),
                StepOn::AllViews => vec![&order; config.steps_per_epoch],
            };
            let before = self.heights_m.clone();
            let mut steps: Vec<ViewStep> = Vec::new();
            for (place, views) in batches.iter().enumerate() {
                let step = Step { epoch: [epoch, config.epochs], place: [place, batches.len()] };
                steps.extend(self.step(views, step, &mut adam));
            }
            let losses: Vec<f64> = steps.iter().map(|s| s.loss).collect();
            let n_pairs: usize = steps.iter().map(|s| s.n_pairs).sum();
            let n_active: usize = steps.iter().map(|s| s.n_active).sum();
            let active = (config.loss == Loss::Ordinal).then(|| n_active as f64 / n_pairs.max(1) as f64);
            self.record(crate::stats::mean(&losses).unwrap_or(0.0), &before, selection.views.len(), active);
        }
        if config.loss == Loss::Ordinal {
            self.order_doubts = self.order_doubts(&selection);
        }
        (self.problem.progress)(Solving::Epochs, config.epochs, config.epochs);
    }

    /// By building: what its pairs have against its height, with the heights as they are.
    ///
    /// Its order is wrong where its pairs cost on average as much as if each were rendered at one depth, or more; and where
    /// most of its pairs are of views of which that holds as a whole: to be in order with what is itself misplaced says nothing of a
    /// height. Its height agrees with the priors beyond chance where its pairs cost more if it were lower, and more if it were higher: by
    /// more than [`STANDARD_ERRORS`] over views.
    fn order_doubts(&self, selection: &Selection) -> Vec<Option<Reason>> {
        let config = &self.config.ordinal;
        let roofs = self.problem.scene.roofs(&self.heights_m);
        let moves_m: Vec<f32> = self.heights_m.iter().map(|&height_m| reach_m(height_m)).collect();
        let mut own = vec![Costs::default(); self.heights_m.len()];
        // By building and view: what it would cost more lower, and higher.
        let mut rises = vec![[Vec::new(), Vec::new()]; self.heights_m.len()];
        // Pairs of each building, and those of them in views that are in the wrong order.
        let mut n_pairs = vec![[0_usize; 2]; self.heights_m.len()];
        for &view in &selection.views {
            let Some(evidence) = &self.evidence[view] else { continue };
            let mut rng = seed::stream(self.problem.seed, "pairs at the end", &[self.problem.views[view].key]);
            let Some((of_view, of_building)) = costs(evidence, &roofs, &moves_m, config, &mut rng) else { continue };
            let is_wrong = of_view.are_no_better_than_none();
            for (building, paid) in of_building {
                own[building as usize] += paid;
                let by_way = &mut rises[building as usize];
                by_way.iter_mut().zip(paid.rises()).for_each(|(of_views, rise)| of_views.push(rise));
                let [n, n_wrong] = &mut n_pairs[building as usize];
                (*n, *n_wrong) = (*n + paid.n, *n_wrong + if is_wrong { paid.n } else { 0 });
            }
        }
        let doubt = |((own, [n, n_wrong]), rises): ((Costs, [usize; 2]), [Vec<f64>; 2])| {
            let is_clear = |rises: &[f64]| is_clear(rises, 0.0, STANDARD_ERRORS);
            let falls = rises.each_ref().map(|rises| rises.iter().map(|rise| -rise).collect::<Vec<f64>>());
            if own.are_no_better_than_none() || 2 * n_wrong > n {
                Some(Reason::WrongOrder)
            } else if falls.iter().any(|falls| is_clear(falls)) {
                Some(Reason::OtherHeight)
            } else {
                (!rises.iter().all(|rises| is_clear(rises))).then_some(Reason::FlatScore)
            }
        };
        own.into_iter().zip(n_pairs).zip(rises).map(doubt).collect()
    }

    /// One step along the sum of some views' losses; what each view had to say.
    fn step(&mut self, views: &[usize], step: Step, adam: &mut Adam) -> Vec<ViewStep> {
        let config = &self.config.ordinal;
        let bounds = self.problem.scene.bounds;
        let roofs = self.problem.scene.roofs(&self.heights_m);
        let said: Vec<ViewStep> = views.par_iter().filter_map(|&view| self.view_step(view, &roofs, step)).collect();
        let gradient = sum_by_building(said.iter().flat_map(|s| s.gradient.iter().copied()).collect(), 1);
        for (building, derivative) in gradient {
            let at = building as usize;
            self.is_voted_on[at] |= derivative != 0.0;
            let change = adam.change(at, derivative, f64::from(step.anneal(config.step_m)));
            self.heights_m[at] = (self.heights_m[at] + change as f32).clamp(bounds.min_m, bounds.max_m);
        }
        said
    }

    /// Loss and derivative of one view; `None` where nothing can be compared.
    fn view_step(&self, view: usize, roofs: &[f32], step: Step) -> Option<ViewStep> {
        let (config, input) = (&self.config.ordinal, &self.problem.views[view]);
        let evidence = self.evidence[view].as_ref().expect("only loaded views are in the order");
        if config.loss != Loss::Ordinal {
            return regression::view_step(evidence, roofs, config.loss);
        }
        let place = match config.step_on {
            // A view's pairs depend on its name and the epoch, not on how many came before it.
            StepOn::View => 0,
            StepOn::AllViews => step.place[0],
        };
        let mut rng = seed::stream(self.problem.seed, "pairs", &[step.epoch[0] as u64, place as u64, input.key]);
        let prior = match config.gradient {
            Gradient::EdgeSampled => (self.problem.load_prior)(view).ok(),
            Gradient::Interior | Gradient::CentralDifference => None,
        };
        let edges = prior.as_ref().map(|prior| EdgeInput { scene: self.problem.scene, placed: &input.placed, prior });
        let input = StepInput { evidence, roofs, difference_m: step.anneal(config.difference_m), edges };
        view_step(&input, config, &mut rng)
    }
}

/// Heights from a normal distribution, clamped to the range (`SiZeUp`, "Initialisation"; the paper leaves mean and width
/// open).
pub(super) fn initial_heights(root: u64, bounds: HeightBounds, config: &OrdinalConfig, n: usize) -> Vec<f32> {
    let mut rng = seed::stream(root, "initial heights", &[]);
    let HeightBounds { min_m, max_m } = bounds;
    let of_range = |share: f32| share * (max_m - min_m);
    let (mean_m, sigma_m) = (min_m + of_range(config.start_mean_share), of_range(config.start_sigma_share));
    (0..n)
        .map(|_| {
            // Box and Muller.
            let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
            let angle = std::f32::consts::TAU * rng.random::<f32>();
            (mean_m + sigma_m * radius * angle.cos()).clamp(min_m, max_m)
        })
        .collect()
}
