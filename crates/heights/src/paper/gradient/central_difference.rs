//! Exact central differences over the stored profiles, for pixels that stay the same.
//!
//! ```text
//! g_b = [l(h_b + δ) − l(h_b − δ)] / 2δ
//! ```
//!
//! Both rays of a pair are evaluated anew: a silhouette that passes a pixel within ±δ is in it.

use super::HeightSlope;
use crate::evidence::Evidence;
use crate::ordinal::Normaliser;
use crate::paper::ordinal::{ComparedPixels, PixelPair};

/// Slopes of every pair by every building on either of its rays, the view's scale held fixed; to be divided by the
/// number of pairs.
pub fn slopes(
    evidence: &Evidence<'_>,
    roofs: &[f32],
    compared: &ComparedPixels,
    pairs: &[PixelPair],
    difference_m: f32,
) -> Vec<HeightSlope> {
    let profiles = evidence.profiles;
    let mut slopes = Vec::new();
    for pair in pairs {
        let rays = [compared.rays[pair.p], compared.rays[pair.q]];
        let mut buildings: Vec<u32> =
            rays.iter().flat_map(|&r| profiles.intervals(r as usize)).map(|c| c.building).collect();
        buildings.sort_unstable();
        buildings.dedup();
        for building in buildings {
            let with_roof_moved = |by_m: f32| {
                let depth = |ray: u32| {
                    profiles.sight_with(ray as usize, roofs, building, roofs[building as usize] + by_m).depth
                };
                pair.vote.cost(compared.of_rendered.contrast(depth(rays[0]), depth(rays[1])))
            };
            let slope = (with_roof_moved(difference_m) - with_roof_moved(-difference_m)) / (2.0 * difference_m);
            // Behind a lowered building may lie ground that is not known, at no depth: nothing can be said of that.
            if slope != 0.0 && slope.is_finite() {
                slopes.push((building, f64::from(slope)));
            }
        }
    }
    slopes
}

/// The same with the view's scale worked out anew for every building and both of its heights: slopes of the mean cost.
pub fn slopes_with_scale(
    evidence: &Evidence<'_>,
    roofs: &[f32],
    compared: &ComparedPixels,
    pairs: &[PixelPair],
    difference_m: f32,
) -> Vec<HeightSlope> {
    let profiles = evidence.profiles;
    let is_seen = |building: &u32| !evidence.rays_of(*building).is_empty();
    let buildings = (0..roofs.len() as u32).filter(is_seen);
    let slope_of = |building: u32| {
        let loss_with_roof_moved = |by_m: f32| {
            let mut depths = compared.rendered.clone();
            for ray in evidence.rays_of(building) {
                if let Ok(at) = compared.rays.binary_search(ray) {
                    let roof = roofs[building as usize] + by_m;
                    depths[at] = profiles.sight_with(*ray as usize, roofs, building, roof).depth;
                }
            }
            let of_rendered = Normaliser::from_values(&depths)?;
            let costs = pairs.iter().map(|p| p.vote.cost(of_rendered.contrast(depths[p.p], depths[p.q])));
            Some(costs.map(f64::from).sum::<f64>() / pairs.len() as f64)
        };
        let rise = loss_with_roof_moved(difference_m)? - loss_with_roof_moved(-difference_m)?;
        let slope = rise / (2.0 * f64::from(difference_m));
        (slope != 0.0 && slope.is_finite()).then_some((building, slope))
    };
    buildings.filter_map(slope_of).collect()
}
