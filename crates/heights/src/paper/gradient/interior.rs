//! The interior part: which pixel shows what is held fixed, and roofs get nearer as they rise.
//!
//! ```text
//! dR/dh = 1/d_z on the roof,   dl/dh_b = s (Ṙ_p − Ṙ_q) / M where the pair costs something
//! ```
//!
//! What automatic differentiation of a hard rasteriser sees.

use super::HeightSlope;
use crate::evidence::Evidence;
use crate::paper::ordinal::{ComparedPixels, PixelPair};

/// Slopes of the pairs that cost something, in their order; to be divided by the number of all pairs.
pub fn slopes(evidence: &Evidence<'_>, compared: &ComparedPixels, pairs: &[PixelPair]) -> Vec<HeightSlope> {
    let mut slopes = Vec::new();
    for pair in pairs.iter().filter(|pair| pair.cost(compared) > 0.0) {
        let slope = pair.vote.order.sign() / compared.of_rendered.scale;
        for (at, slope) in [(pair.p, slope), (pair.q, -slope)] {
            if let Some((building, per_metre)) = roof_motion(evidence, compared, at) {
                slopes.push((building, f64::from(slope * per_metre)));
            }
        }
    }
    slopes
}

/// Whose roof a compared pixel shows, and how much its depth changes per metre of height; `None` on walls and ground.
pub fn roof_motion(evidence: &Evidence<'_>, compared: &ComparedPixels, at: usize) -> Option<(u32, f32)> {
    let building = compared.roof_of[at]?;
    Some((building, evidence.profiles.rays[compared.rays[at] as usize].dz.recip()))
}
