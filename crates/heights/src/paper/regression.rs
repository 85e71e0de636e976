//! The regression of normalised depth that the ordinal loss is compared with: one view's loss and derivative.
//!
//! ```text
//! e = R' − D'       R', D': rendered inverse depth and the prior's, negated, each (x − median_Ω) / MAD_Ω
//!                   Ω: building pixels
//! L1: |e|,  L2: e²   mean over Ω, its derivative through roofs only (depth falls by 1/d_z per metre)
//! ```
//!
//! Inverse depth, because regression compares values, and priors are affine in that. All pixels of Ω take part, not pairs
//! of them.

use crate::config::Loss;
use crate::evidence::Evidence;
use crate::paper::gradient::{HeightSlope, sum_by_building};
use crate::paper::ordinal::ViewStep;
use crate::stats;

/// Building pixels below which a view says nothing.
const MIN_PIXELS: usize = 32;

/// A pixel of a view that shows a building.
struct Pixel {
    building: u32,
    /// Change of inverse depth (negated, so growing away from the camera) per metre of height.
    slope: f64,
    rendered: f32,
    prior: f32,
}

/// Loss and derivative of one view; `None` where too few building pixels have a prior, or all are at one depth.
#[must_use]
pub fn view_step(evidence: &Evidence<'_>, roofs: &[f32], loss: Loss) -> Option<ViewStep> {
    let pixels = pixels(evidence, roofs);
    if pixels.len() < MIN_PIXELS {
        return None;
    }
    let (r_median, r_mad) = stats::median_and_mad(&pixels.iter().map(|p| p.rendered).collect::<Vec<_>>())?;
    let (d_median, d_mad) = stats::median_and_mad(&pixels.iter().map(|p| p.prior).collect::<Vec<_>>())?;
    if r_mad <= 0.0 || d_mad <= 0.0 {
        return None;
    }
    let mut sum = 0.0;
    let mut slopes: Vec<HeightSlope> = Vec::new();
    for p in &pixels {
        let e = f64::from((p.rendered - r_median) / r_mad - (p.prior - d_median) / d_mad);
        let (cost, slope) = match loss {
            Loss::L2 => (e * e, 2.0 * e),
            Loss::L1 | Loss::Ordinal => (e.abs(), if e == 0.0 { 0.0 } else { e.signum() }),
        };
        sum += cost;
        if p.slope != 0.0 {
            slopes.push((p.building, slope * p.slope / f64::from(r_mad)));
        }
    }
    let n = pixels.len();
    Some(ViewStep { loss: sum / n as f64, n_pairs: 0, n_active: 0, gradient: sum_by_building(slopes, n) })
}

fn pixels(evidence: &Evidence<'_>, roofs: &[f32]) -> Vec<Pixel> {
    let profiles = evidence.profiles;
    let of_ray = |(i, &nearness): (usize, &f32)| {
        let sight = profiles.sight(i, roofs);
        let building = sight.building.filter(|_| nearness.is_finite())?;
        let (depth, dz) = (f64::from(sight.depth), f64::from(profiles.rays[i].dz));
        let slope = if sight.is_roof { 1.0 / (dz * depth * depth) } else { 0.0 };
        Some(Pixel { building, slope, rendered: -sight.depth.recip(), prior: -nearness })
    };
    evidence.nearness.iter().enumerate().filter_map(of_ray).collect()
}
