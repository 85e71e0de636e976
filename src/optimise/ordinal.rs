//! One step of the ordinal optimiser: the loss of one view, and its derivative by the buildings' heights.
//!
//! Two derivatives, both with median and MAD held fixed:
//!
//! - *interior*: a roof pixel gets nearer as its roof rises, `dR/dh = 1/d_z < 0`; walls and ground do not move. What
//!   automatic differentiation of a hard rasteriser sees.
//! - *central difference*: `g_b = [l(h_b + δ) − l(h_b − δ)] / 2δ` per pair, for each building on either ray, with both
//!   rays evaluated anew: silhouettes, where a roof edge passes a pixel, are in it.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::config::{Gradient, OrdinalConfig, Region};
use super::evidence::Evidence;
use crate::ordinal::{DepthOrder, Normaliser};

/// Loss and derivative of one view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewStep {
    /// Mean cost over the pairs that have a vote.
    pub loss: f64,
    /// Pairs that have a vote.
    pub n_pairs: usize,
    /// Of these, pairs that cost something.
    pub n_active: usize,
    /// `(building, dL/dh)` by metre, each building once, ascending.
    pub gradient: Vec<(u32, f64)>,
}

/// The pixels of one view that are compared, with both depths normalised over them.
pub(super) struct Compared {
    /// Ray of each pixel, ascending.
    pub rays: Vec<u32>,
    /// Rendered z-depth, metres.
    pub rendered: Vec<f32>,
    /// Which building's roof it is; its depth moves with the height.
    roof_of: Vec<Option<u32>>,
    /// Normalised prior, growing away from the camera.
    pub prior: Vec<f32>,
    /// Brings rendered depth to its spread in the view.
    pub of_rendered: Normaliser,
}

/// Loss and derivative of one view for roof levels in the local frame; `None` where nothing can be compared.
#[must_use]
pub fn view_step(
    evidence: &Evidence<'_>,
    roofs: &[f32],
    difference_m: f32,
    config: &OrdinalConfig,
    rng: &mut ChaCha8Rng,
) -> Option<ViewStep> {
    let compared = Compared::new(evidence, roofs, config.region)?;
    let n = u32::try_from(compared.rays.len()).ok().filter(|&n| n >= 2)?;
    let mut step = ViewStep { loss: 0.0, n_pairs: 0, n_active: 0, gradient: Vec::new() };
    let mut slopes: Vec<(u32, f64)> = Vec::new();
    for _ in 0..config.n_pairs {
        let (p, q) = (rng.random_range(0..n) as usize, rng.random_range(0..n) as usize);
        let Some(order) = DepthOrder::from_prior(compared.prior[p], compared.prior[q], config.min_contrast) else {
            continue;
        };
        let margin = if config.adaptive_margin {
            config.margin.min((compared.prior[q] - compared.prior[p]).abs())
        } else {
            config.margin
        };
        let cost = |r_p: f32, r_q: f32| order.cost(compared.of_rendered.contrast(r_p, r_q), margin);
        let here = cost(compared.rendered[p], compared.rendered[q]);
        step.n_pairs += 1;
        step.n_active += usize::from(here > 0.0);
        step.loss += f64::from(here);
        match config.gradient {
            Gradient::Interior if here > 0.0 => {
                let slope = order.sign() / compared.of_rendered.scale;
                for (at, slope) in [(p, slope), (q, -slope)] {
                    if let Some(building) = compared.roof_of[at] {
                        let per_metre = evidence.profiles.rays[compared.rays[at] as usize].dz.recip();
                        slopes.push((building, f64::from(slope * per_metre)));
                    }
                }
            }
            Gradient::Interior => {}
            Gradient::CentralDifference => {
                central_differences(
                    evidence,
                    roofs,
                    [compared.rays[p], compared.rays[q]],
                    difference_m,
                    cost,
                    &mut slopes,
                );
            }
        }
    }
    if step.n_pairs == 0 {
        return None;
    }
    step.loss /= step.n_pairs as f64;
    step.gradient = sum_by_building(slopes, step.n_pairs);
    Some(step)
}

impl Compared {
    pub fn new(evidence: &Evidence<'_>, roofs: &[f32], region: Region) -> Option<Self> {
        let profiles = evidence.profiles;
        let mut compared = Self {
            rays: Vec::new(),
            rendered: Vec::new(),
            roof_of: Vec::new(),
            prior: Vec::new(),
            of_rendered: Normaliser { median: 0.0, scale: 1.0 },
        };
        for (ray_idx, &prior) in evidence.farness.iter().enumerate() {
            let sight = profiles.sight(ray_idx, roofs);
            let is_compared = match region {
                Region::Buildings => sight.building.is_some(),
                Region::BuildingsAndGround => !profiles.crossings(ray_idx).is_empty() && sight.depth.is_finite(),
            };
            if is_compared && prior.is_finite() {
                compared.rays.push(ray_idx as u32);
                compared.rendered.push(sight.depth);
                compared.roof_of.push(sight.building.filter(|_| sight.is_roof));
                compared.prior.push(prior);
            }
        }
        let of_prior = Normaliser::from_values(&compared.prior)?;
        compared.prior.iter_mut().for_each(|d| *d = of_prior.apply(*d));
        compared.of_rendered = Normaliser::from_values(&compared.rendered)?;
        Some(compared)
    }
}

/// Appends `(building, slope)` for every building whose height can change either ray.
fn central_differences(
    evidence: &Evidence<'_>,
    roofs: &[f32],
    rays: [u32; 2],
    difference_m: f32,
    cost: impl Fn(f32, f32) -> f32,
    slopes: &mut Vec<(u32, f64)>,
) {
    let profiles = evidence.profiles;
    let mut buildings: Vec<u32> =
        rays.iter().flat_map(|&r| profiles.crossings(r as usize)).map(|c| c.building).collect();
    buildings.sort_unstable();
    buildings.dedup();
    for building in buildings {
        let with_roof_moved = |by_m: f32| {
            let depth =
                |ray: u32| profiles.sight_with(ray as usize, roofs, building, roofs[building as usize] + by_m).depth;
            cost(depth(rays[0]), depth(rays[1]))
        };
        let slope = (with_roof_moved(difference_m) - with_roof_moved(-difference_m)) / (2.0 * difference_m);
        if slope != 0.0 {
            slopes.push((building, f64::from(slope)));
        }
    }
}

/// Adds up the slopes of each building; the stable sort keeps the order of pairs, so the sum is the same every time.
fn sum_by_building(mut slopes: Vec<(u32, f64)>, n_pairs: usize) -> Vec<(u32, f64)> {
    slopes.sort_by_key(|&(building, _)| building);
    slopes
        .chunk_by(|a, b| a.0 == b.0)
        .map(|same| (same[0].0, same.iter().map(|s| s.1).sum::<f64>() / n_pairs as f64))
        .collect()
}
