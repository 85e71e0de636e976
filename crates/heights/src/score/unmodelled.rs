//! What priors in metres show that the scene does not have: trees, and buildings without a footprint.
//!
//! ```text
//! s                     prior's z-depth along a ray,   G: the ground's,   d_z < 0: height per metre of z-depth
//! above(s) = (s − G) · d_z
//! nothing of the scene: above(s) > UNMODELLED_M, and s in no [enter, leave] of a footprint, widened by UNMODELLED_M
//! ```
//!
//! Such a ray tells nothing of any roof, wherever it passes over the building that is asked for: were it kept, a building grown
//! tall enough to stand in its way would explain it better than the ground does.

use crate::evidence::Evidence;
use crate::render::profile::Profiles;
use crate::score::{UNMODELLED_M, within};

/// Leaves out rays that show something the scene does not have; says which share of those around the building's `own` ones
/// that was, 0..1. Both lists ascend.
pub(crate) fn leave_out(evidence: &Evidence<'_>, own: &[u32], rays: &mut Vec<u32>) -> f32 {
    let mut is_own = within(own);
    let (mut n_around, mut n_left_out) = (0_usize, 0_usize);
    rays.retain(|&ray| {
        let is_kept = !shows_unmodelled(evidence.profiles, ray as usize, evidence.nearness[ray as usize].recip());
        if !is_own(ray) {
            n_around += 1;
            n_left_out += usize::from(!is_kept);
        }
        is_kept
    });
    n_left_out as f32 / n_around.max(1) as f32
}

/// Whether a ray that ends at a z-depth, metres, does so above the ground outside of all footprints that it crosses.
fn shows_unmodelled(profiles: &Profiles, ray: usize, depth: f32) -> bool {
    let margin_m = UNMODELLED_M as f32;
    let above_m = (depth - profiles.rays[ray].ground) * profiles.rays[ray].dz;
    let is_over = |enter: f32, leave: f32| depth > enter - margin_m && depth < leave + margin_m;
    above_m > margin_m && !profiles.intervals(ray).iter().any(|c| is_over(c.enter, c.leave))
}
