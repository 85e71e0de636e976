//! How far a run of the ordinal optimiser is: what its steps are annealed by.
//!
//! ```text
//! progress = (epoch · n + i) / (epochs · n − 1)        step i of n in this epoch, both from 0
//! value    = first · (last / first)^progress
//! ```
//!
//! Each epoch counts by the steps that it has itself. With `n` the same throughout, every step is as far from the next as
//! the others; where views are selected anew and `n` changes, progress still never falls: an epoch ends at or before
//! `(epoch + 1) / epochs`, and the next begins there or behind.

/// One step of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// Epoch, from 0, and how many there are.
    pub epoch: [usize; 2],
    /// Place in the epoch, from 0, and how many steps the epoch has.
    pub place: [usize; 2],
}

impl Step {
    /// Share of the run that is behind it, 0..1.
    fn progress(self) -> f64 {
        let ([epoch, n_epochs], [place, n]) = (self.epoch, self.place);
        ((epoch * n + place) as f64 / (n_epochs * n).saturating_sub(1).max(1) as f64).min(1.0)
    }

    /// Value that goes geometrically from the first of two to the second, at this step.
    #[must_use]
    pub fn anneal(self, [first, last]: [f32; 2]) -> f32 {
        first * (last / first).powf(self.progress() as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(n_steps: &[usize]) -> Vec<f32> {
        let step = |epoch: usize, place: usize| Step { epoch: [epoch, n_steps.len()], place: [place, n_steps[epoch]] };
        let steps = (0..n_steps.len()).flat_map(|epoch| (0..n_steps[epoch]).map(move |place| (epoch, place)));
        steps.map(|(epoch, place)| step(epoch, place).anneal([6.0, 0.3])).collect()
    }

    #[test]
    fn a_step_never_grows_whatever_the_selection_does() {
        // Views are selected anew every epoch: more, fewer, one, none at all.
        for n_steps in [&[20, 30, 80, 5, 60][..], &[3, 300, 3, 300], &[1, 1, 50], &[10, 0, 0, 40]] {
            let steps = run(n_steps);
            assert!(steps.is_sorted_by(|a, b| b <= a), "{n_steps:?}: {steps:?}");
        }
    }

    #[test]
    fn a_run_begins_with_the_first_value_and_ends_with_the_last() {
        let steps = run(&[7; 4]);
        assert_eq!(steps[0], 6.0);
        assert!((steps[27] - 0.3).abs() < 1e-6, "{steps:?}");
        let ratios: Vec<f32> = steps.windows(2).map(|w| w[1] / w[0]).collect();
        assert!(ratios.iter().all(|r| (r - ratios[0]).abs() < 1e-5), "{ratios:?}");
        assert_eq!(run(&[1]), [6.0]);
    }
}
