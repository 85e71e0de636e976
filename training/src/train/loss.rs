//! What is made small: cross-entropy and Dice (Milletari and others, 2016, arXiv 1606.04797) of buildings and of borders.
//!
//! ```text
//! BCE  = sum w · g · (max(x, 0) − x·y + ln(1 + e^−|x|)) / sum w        x: logit, y: 0 or 1, w: is it known, g: gain where y = 1
//! Dice = (2 · sum w·p·y + 1) / (sum w·p + sum w·y + 1)                 p = 1 / (1 + e^−x)
//! ```
//!
//! Cross-entropy alone is content with no building at all where they are one pixel in a thousand; Dice is not.

use candle_core::{Result, Tensor};

use super::LossConfig;
use super::sample::Batch;

/// The loss of logits `batch × 2 × rows × columns`.
///
/// # Errors
/// Shapes that do not fit.
pub fn loss(logits: &Tensor, batch: &Batch, config: &LossConfig) -> Result<Tensor> {
    let part = |channel: usize, gain: f64| {
        let (x, y) = (logits.narrow(1, channel, 1)?, batch.target.narrow(1, channel, 1)?);
        channel_loss(&x, &y, &batch.weight, gain, config.dice)
    };
    part(0, 1.0)? + (part(1, config.border_gain)? * config.border)?
}

fn channel_loss(x: &Tensor, y: &Tensor, weight: &Tensor, gain: f64, dice: f64) -> Result<Tensor> {
    let soft = (x.abs()?.neg()?.exp()? + 1.0)?.log()?;
    let entropy = ((x.relu()? - (x * y)?)? + soft)?;
    let gains = (weight * ((y * (gain - 1.0))? + 1.0)?)?;
    let n = (weight.sum_all()? + 1e-6)?;
    let entropy = ((entropy * gains)?.sum_all()? / &n)?;
    let p = (((x * 0.5)?.tanh()? + 1.0)? * 0.5)?;
    let (p, y) = ((p * weight)?, (y * weight)?);
    let both = (((&p * &y)?.sum_all()? * 2.0)? + 1.0)?;
    let sum = ((p.sum_all()? + y.sum_all()?)? + 1.0)?;
    entropy + ((1.0 - (both / sum)?)? * dice)?
}

/// Pixels that both call a building, and pixels that either does, at a probability of a half; unknown ones left out.
///
/// # Errors
/// That of the framework.
pub fn overlap(logits: &Tensor, batch: &Batch) -> Result<(f64, f64)> {
    let found = logits.narrow(1, 0, 1)?.flatten_all()?.to_vec1::<f32>()?;
    let truth = batch.target.narrow(1, 0, 1)?.flatten_all()?.to_vec1::<f32>()?;
    let weight = batch.weight.flatten_all()?.to_vec1::<f32>()?;
    let (mut both, mut either) = (0.0, 0.0);
    for ((x, y), w) in found.iter().zip(&truth).zip(&weight).filter(|(_, w)| **w > 0.0) {
        let (found, truth) = (*x > 0.0, *y > 0.5);
        both += f64::from(w * f32::from(u8::from(found && truth)));
        either += f64::from(w * f32::from(u8::from(found || truth)));
    }
    Ok((both, either))
}
