//! What is made small: cross-entropy and Dice (Milletari and others, 2016, arXiv 1606.04797) of buildings on the ground and of roofs,
//! cross-entropy of how near to its roof's middle a pixel lies, of how far the roof rises, and of where two roofs meet.
//!
//! ```text
//! BCE  = sum w · (max(x, 0) − x·y + ln(1 + e^−|x|)) / sum w        x: logit, y: 0 to 1, w: is it known, and how much it counts
//! Dice = (2 · sum w·p·y + 1) / (sum w·p + sum w·y + 1)             p = 1 / (1 + e^−x)
//! ```
//!
//! Cross-entropy alone is content with no building at all where they are one pixel in a thousand; Dice is not. Of a `y` between
//! 0 and 1 the cross-entropy is least at its mean: where a wall may lie here or there, the network says so by a shallow valley.

use candle_core::{Result, Tensor};

use super::LossConfig;
use super::sample::Batch;

/// The loss of logits `batch × 5 × rows × columns`.
///
/// # Errors
/// Shapes that do not fit.
pub fn loss(logits: &Tensor, batch: &Batch, config: &LossConfig) -> Result<Tensor> {
    let of = |tensor: &Tensor, channel: usize| tensor.narrow(1, channel, 1);
    let of_channel = |channel: usize| -> Result<(Tensor, Tensor, Tensor)> {
        Ok((of(logits, channel)?, of(&batch.target, channel)?, of(&batch.weight, channel)?))
    };
    let entropy = |channel: usize| -> Result<Tensor> {
        let (x, y, weight) = of_channel(channel)?;
        cross_entropy(&x, &y, &weight)
    };
    let mask = |channel: usize| -> Result<Tensor> {
        let (x, y, weight) = of_channel(channel)?;
        cross_entropy(&x, &y, &weight)? + (dice_loss(&x, &y, &weight)? * config.dice)?
    };
    let roofs = ((mask(1)? * config.roof)? + (entropy(2)? * config.middle)?)?;
    (mask(0)? + roofs)? + ((entropy(3)? * config.rise)? + (entropy(4)? * config.seam)?)?
}

fn cross_entropy(x: &Tensor, y: &Tensor, weight: &Tensor) -> Result<Tensor> {
    let soft = (x.abs()?.neg()?.exp()? + 1.0)?.log()?;
    let entropy = ((x.relu()? - (x * y)?)? + soft)?;
    (entropy * weight)?.sum_all()? / (weight.sum_all()? + 1e-6)?
}

fn dice_loss(x: &Tensor, y: &Tensor, weight: &Tensor) -> Result<Tensor> {
    let p = (((x * 0.5)?.tanh()? + 1.0)? * 0.5)?;
    let (p, y) = ((p * weight)?, (y * weight)?);
    let both = (((&p * &y)?.sum_all()? * 2.0)? + 1.0)?;
    let sum = ((p.sum_all()? + y.sum_all()?)? + 1.0)?;
    1.0 - (both / sum)?
}

/// Pixels that both call a building, and pixels that either does, at a probability of a half; unknown ones left out.
///
/// # Errors
/// That of the framework.
pub fn overlap(logits: &Tensor, batch: &Batch) -> Result<(f64, f64)> {
    let found = logits.narrow(1, 0, 1)?.flatten_all()?.to_vec1::<f32>()?;
    let truth = batch.target.narrow(1, 0, 1)?.flatten_all()?.to_vec1::<f32>()?;
    let weight = batch.weight.narrow(1, 0, 1)?.flatten_all()?.to_vec1::<f32>()?;
    let (mut both, mut either) = (0.0, 0.0);
    for ((x, y), w) in found.iter().zip(&truth).zip(&weight).filter(|(_, w)| **w > 0.0) {
        let (found, truth) = (*x > 0.0, *y > 0.5);
        both += f64::from(w * f32::from(u8::from(found && truth)));
        either += f64::from(w * f32::from(u8::from(found || truth)));
    }
    Ok((both, either))
}
