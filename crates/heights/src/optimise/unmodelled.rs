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

use super::evidence::Evidence;
use super::score::UNMODELLED_M;
use crate::render::profile::Profiles;

/// Leaves out rays that show something the scene does not have.
pub(super) fn leave_out(evidence: &Evidence<'_>, rays: &mut Vec<u32>) {
    rays.retain(|&ray| {
        let depth = evidence.nearness[ray as usize].recip();
        !shows_unmodelled(evidence.profiles, ray as usize, depth)
    });
}

/// Whether a ray that ends at a z-depth, metres, does so above the ground outside of all footprints that it crosses.
fn shows_unmodelled(profiles: &Profiles, ray: usize, depth: f32) -> bool {
    let margin_m = UNMODELLED_M as f32;
    let above_m = (depth - profiles.rays[ray].ground) * profiles.rays[ray].dz;
    let is_over = |enter: f32, leave: f32| depth > enter - margin_m && depth < leave + margin_m;
    above_m > margin_m && !profiles.intervals(ray).iter().any(|c| is_over(c.enter, c.leave))
}
