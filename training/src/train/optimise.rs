//! Adam with decoupled weight decay (Loshchilov and Hutter, 2019, arXiv 1711.05101), its state open to be kept.
//!
//! ```text
//! m = 0.9 m + 0.1 g,   v = 0.999 v + 0.001 g²,   p = p − r · (m̂ / (sqrt(v̂) + 1e-8) + d · p)
//! ```
//!
//! `m̂`, `v̂`: `m`, `v` over one minus their factor to the power of the step. Gradients longer than 1 in all are shortened to
//! that. Weight decay `d` is for kernels only, not for biases and gains.

use std::collections::BTreeMap;

use candle_core::backprop::GradStore;
use candle_core::{Result, Tensor};

use super::TrainConfig;
use crate::network::parameters::Parameters;

const FIRST: f64 = 0.9;
const SECOND: f64 = 0.999;
const LEAST: f64 = 1e-8;
/// Longest gradient of all parameters together.
const LONGEST: f64 = 1.0;

/// First and second moments of every parameter.
#[derive(Debug, Clone)]
pub struct Moments(pub BTreeMap<String, (Tensor, Tensor)>);

impl Moments {
    /// At the start.
    ///
    /// # Errors
    /// That of the framework.
    pub fn new(parameters: &Parameters) -> Result<Self> {
        let zeros = parameters.vars.iter().map(|(name, var)| {
            Ok((name.clone(), (var.as_tensor().zeros_like()?.detach(), var.as_tensor().zeros_like()?.detach())))
        });
        Ok(Self(zeros.collect::<Result<_>>()?))
    }

    /// One step, the first being 1. Returns the length of the gradient.
    ///
    /// # Errors
    /// That of the framework.
    pub fn step(
        &mut self,
        parameters: &Parameters,
        gradients: &GradStore,
        config: &TrainConfig,
        step: usize,
    ) -> Result<f64> {
        let mut squares = 0.0;
        for var in parameters.vars.values() {
            if let Some(g) = gradients.get(var.as_tensor()) {
                squares += f64::from(g.sqr()?.sum_all()?.to_scalar::<f32>()?);
            }
        }
        let length = squares.sqrt();
        let scale = if length > LONGEST { LONGEST / length } else { 1.0 };
        let rate = learning_rate(config, step);
        let power = i32::try_from(step).unwrap_or(i32::MAX);
        let (first, second) = (1.0 - FIRST.powi(power), 1.0 - SECOND.powi(power));
        for (name, var) in &parameters.vars {
            let Some(g) = gradients.get(var.as_tensor()) else { continue };
            let g = (g.detach() * scale)?;
            let Some((m, v)) = self.0.get_mut(name) else { continue };
            *m = ((&*m * FIRST)? + (&g * (1.0 - FIRST))?)?;
            *v = ((&*v * SECOND)? + (g.sqr()? * (1.0 - SECOND))?)?;
            let way = ((&*m / first)? / ((&*v / second)?.sqrt()? + LEAST)?)?;
            let p = var.as_tensor().detach();
            let decay = if p.rank() > 1 { config.weight_decay } else { 0.0 };
            let shrunk = (&p * (1.0 - rate * decay))?;
            var.set(&(shrunk - (way * rate)?)?)?;
        }
        Ok(length)
    }
}

/// Up in a line, down as half a cosine.
#[must_use]
pub fn learning_rate(config: &TrainConfig, step: usize) -> f64 {
    if step <= config.warm_up {
        return config.learning_rate * step as f64 / config.warm_up.max(1) as f64;
    }
    let share = (step - config.warm_up) as f64 / (config.steps - config.warm_up.min(config.steps)).max(1) as f64;
    0.5 * config.learning_rate * (1.0 + (std::f64::consts::PI * share.min(1.0)).cos())
}
