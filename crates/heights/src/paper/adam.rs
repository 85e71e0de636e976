//! Adam (Kingma and Ba, ICLR 2015), stepping only the heights that a view says something about.

const BETA1: f64 = 0.9;
const BETA2: f64 = 0.999;
const EPSILON: f64 = 1e-12;

/// Adam's running means of gradients and of their squares, one per building.
#[derive(Debug, Clone)]
pub struct Adam {
    mean: Vec<f64>,
    square: Vec<f64>,
    n_steps: Vec<i32>,
}

impl Adam {
    /// State before the first step, for `n` heights.
    #[must_use]
    pub fn new(n: usize) -> Self {
        Self { mean: vec![0.0; n], square: vec![0.0; n], n_steps: vec![0; n] }
    }

    /// The change of one height, metres, for its derivative and a step size in metres.
    pub fn change(&mut self, at: usize, derivative: f64, step_m: f64) -> f64 {
        self.n_steps[at] += 1;
        self.mean[at] = BETA1 * self.mean[at] + (1.0 - BETA1) * derivative;
        self.square[at] = BETA2 * self.square[at] + (1.0 - BETA2) * derivative * derivative;
        let mean = self.mean[at] / (1.0 - BETA1.powi(self.n_steps[at]));
        let square = self.square[at] / (1.0 - BETA2.powi(self.n_steps[at]));
        -step_m * mean / (square.sqrt() + EPSILON)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_has_the_step_size_whatever_the_scale() {
        for derivative in [1e-6, 3.0, -250.0_f64] {
            let change = Adam::new(1).change(0, derivative, 0.5);
            assert!((change + 0.5 * derivative.signum()).abs() < 1e-4);
        }
    }
}
