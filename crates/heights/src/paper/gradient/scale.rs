//! The exact mode's other half: the scale of a view depends on the heights too.
//!
//! ```text
//! M = |R_b − R_a| + ε |R_a|,   a: the median pixel,  b: the pixel whose deviation is the median of all
//! dM/dh = σ (Ṙ_b − Ṙ_a) + ε sign(R_a) Ṙ_a,   σ = sign(R_b − R_a)
//! dl/dM = s Δr / M,   Δr: the pair's normalised contrast
//! ```
//!
//! Both medians are values of the sample: of an even count the lower middle ([`crate::stats::median_low`], as
//! `torch.median`), so that a is one pixel and b is one pixel whatever the count. Of pixels that share the median's
//! depth the first is taken. At fixed pixels the derivative is exact; as an estimate of how the scale of *all* pixels
//! changes it is inconsistent (Hong, Oper. Res. 57:118, 2009: one pixel's motion stands for the whole view's). That is
//! why the scale is held fixed unless `OrdinalConfig::mad_gradient` is `Exact`.

use super::HeightSlope;
use super::interior::roof_motion;
use crate::evidence::Evidence;
use crate::ordinal::EPSILON;
use crate::paper::ordinal::{ComparedPixels, PixelPair};

/// Slopes of the mean cost of the pairs through the view's scale; already a mean.
pub fn slopes(evidence: &Evidence<'_>, compared: &ComparedPixels, pairs: &[PixelPair]) -> Vec<HeightSlope> {
    let scale = f64::from(compared.of_rendered.scale);
    let by_scale = |pair: &PixelPair| f64::from(pair.vote.order.sign() * compared.contrast(pair)) / scale;
    let active = pairs.iter().filter(|pair| pair.cost(compared) > 0.0);
    let loss_by_scale = active.map(by_scale).sum::<f64>() / pairs.len() as f64;

    let median = compared.of_rendered.median;
    let deviation = |depth: &f32| (depth - median).abs();
    let Some(mad) = crate::stats::median_low(&mut compared.rendered.iter().map(deviation).collect::<Vec<_>>()) else {
        return Vec::new();
    };
    let at_median = compared.rendered.iter().position(|depth| *depth == median);
    let at_mad = compared.rendered.iter().position(|depth| deviation(depth) == mad);
    let (Some(a), Some(b)) = (at_median, at_mad) else { return Vec::new() };
    // More than half of the pixels on one level: the scale is ε alone, and has a kink there.
    let sign = if mad == 0.0 { 0.0 } else { f64::from((compared.rendered[b] - median).signum()) };
    let of_median = f64::from(EPSILON) * f64::from(median.signum()) - sign;
    [(a, of_median), (b, sign)]
        .into_iter()
        .filter_map(|(at, share)| {
            let (building, per_metre) = roof_motion(evidence, compared, at)?;
            Some((building, loss_by_scale * share * f64::from(per_metre)))
        })
        .collect()
}
