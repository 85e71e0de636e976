//! Crowns of trees over a roof: what a photo shows in the green of leaves and the prior above the ground is no roof.
//!
//! ```text
//! above(s) = (s − G) · d_z       height above the ground that the prior gives a ray; s: z-depth, G: the ground's
//! crown    = green, and above(s) > STANDING_M
//! ```
//!
//! Lawns stay: that the ground behind a building is seen over its roof says how low it is. So do green roofs: those that are hardly
//! anything else, and those that trees seldom reach.

use crate::evidence::Evidence;
use crate::evidence::calibrate::Calibration;

/// Height from which something green is a crown, and no lawn, metres.
const STANDING_M: f32 = 2.0;
/// A building with a larger share of green among what stands on it is green itself: copper, sods, or nothing but leaves in sight.
const MOST_GREEN: f64 = 0.8;
/// A smaller share is no crown, but lawn that bleeding edges raise, or a few windows.
const LEAST_GREEN: f64 = 0.04;
/// Height that crowns over a roof seldom reach, metres: what is green on buildings whose other roof is mostly higher is roof.
const TALL_M: f32 = 12.0;
/// Way behind the wall that a ray comes over from which it ends on the roof, and not on the wall, metres.
const BEHIND_WALL_M: f32 = 1.0;

/// Rays that end on a building's roof, whatever that is, over some views.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Standing {
    n: usize,
    n_green: usize,
    n_bare_tall: usize,
}

impl Standing {
    /// Counts the building's rays in another view. `ground_z`: its ground, local frame.
    pub fn add(&mut self, evidence: &Evidence<'_>, building: u32, ground_z: f32, calibration: Calibration) {
        if !evidence.sees_green() {
            return;
        }
        for &ray in evidence.rays_of(building) {
            let seen = depth(evidence, ray, calibration);
            let is_over = |enter: f32, leave: f32| seen > enter + BEHIND_WALL_M && seen < leave + BEHIND_WALL_M;
            let mut intervals = evidence.profiles.intervals(ray as usize).iter().filter(|c| c.building == building);
            if stands(evidence, ray, seen) && intervals.any(|c| is_over(c.enter, c.leave)) {
                self.n += 1;
                self.n_green += usize::from(evidence.is_green(ray));
                let is_tall = evidence.profiles.level(ray as usize, seen) - ground_z > TALL_M;
                self.n_bare_tall += usize::from(is_tall && !evidence.is_green(ray));
            }
        }
    }

    /// Whether there is something green, and it is not the roof itself.
    pub fn are_crowns(self) -> bool {
        self.n_green as f64 > LEAST_GREEN * self.n as f64
            && !self.is_green()
            && 2 * self.n_bare_tall <= self.n - self.n_green
    }

    /// Whether hardly anything else is there: a green roof, or one under trees.
    pub fn is_green(self) -> bool {
        self.n_green as f64 > MOST_GREEN * self.n as f64
    }
}

/// Leaves out rays that show crowns.
pub(crate) fn leave_out(evidence: &Evidence<'_>, calibration: Calibration, rays: &mut Vec<u32>) {
    rays.retain(|&ray| !(evidence.is_green(ray) && stands(evidence, ray, depth(evidence, ray, calibration))));
}

/// Depth along the optical axis that the prior gives a ray, metres.
fn depth(evidence: &Evidence<'_>, ray: u32, calibration: Calibration) -> f32 {
    calibration.inverse_depth(evidence.nearness[ray as usize]).max(f32::MIN_POSITIVE).recip()
}

fn stands(evidence: &Evidence<'_>, ray: u32, depth: f32) -> bool {
    let at = &evidence.profiles.rays[ray as usize];
    (depth - at.ground) * at.dz > STANDING_M
}
