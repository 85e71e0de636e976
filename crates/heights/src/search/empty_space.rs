//! Space above found roofs that no view has looked through. Priors with gaps (depth from the photos alone) have none where
//! photos could not be matched, and a tower whose roof and walls could not looks like the low block that explains what is
//! left: what nobody has seen to be empty may be the rest of the building.
//!
//! The first `N_STOREYS` above a roof are cut into cells, `CELL_M` across and `STOREY_M` high. A ray with a depth that goes through a
//! cell, by the roofs found, shows it empty; one without a depth shows nothing. Where depth is in metres, one that ends before the
//! cell does not show it empty either, but that something stands there:
//!
//! ```text
//! known(cell) = rays with a depth behind the cell / rays, through the cell
//! blind cell:   rays ≥ LEAST_RAYS  and  known(cell) ≤ BLIND_SHARE · known(all rays of these views)
//! blind column: all its cells are blind
//! ```
//!
//! Frame: [`crate::frames::Local`], metres.

use std::collections::BTreeMap;

use crate::evidence::Evidence;
use crate::render::PlacedCamera;
use crate::render::profile::Stops;

/// Side of a cell, metres: what is narrower than a small house is no matter.
const CELL_M: f32 = 4.0;
/// Height of a cell, metres.
const STOREY_M: f32 = 3.0;
/// Storeys above the roof that are looked at: that one is missing is told by other means.
const N_STOREYS: usize = 3;
/// Height of the first cell above the roof, metres: roofs are not flat, and depths not exact.
const ABOVE_ROOF_M: f32 = 1.5;
/// Rays through a cell for it to be told.
const LEAST_RAYS: u32 = 6;
/// A ray that looks so far into a cell shows it empty, metres of z-depth: more than depth in metres is off by.
const INTO_CELL_M: f32 = 1.0;
/// A cell is blind if it has less than this part of the usual share of depths.
const BLIND_SHARE: f64 = 0.25;

/// A view with the roofs as found.
pub(crate) struct FoundView<'a> {
    /// The view's rays and its prior.
    pub evidence: &'a Evidence<'a>,
    /// The view's camera in the local frame.
    pub placed: &'a PlacedCamera,
    /// Ends of its rays.
    pub stops: Stops,
    /// All rays of the view, and how many of them have a prior.
    pub all: KnownRays,
    /// Whether its prior's depth is in metres of itself.
    pub is_in_metres: bool,
}

/// Some rays, and those of them with a depth (of a cell: behind it).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct KnownRays {
    n_rays: u32,
    n_known: u32,
}

impl KnownRays {
    /// Rays of a view, those with a prior and those without.
    pub(crate) fn of(evidence: &Evidence<'_>) -> Self {
        let mut all = Self::default();
        evidence.nearness.iter().for_each(|nearness| all.add(!nearness.is_nan()));
        all
    }

    fn add(&mut self, is_known: bool) {
        self.n_rays += 1;
        self.n_known += u32::from(is_known);
    }

    fn share(self) -> f64 {
        f64::from(self.n_known) / f64::from(self.n_rays.max(1))
    }
}

/// The area above a building's roof that no view has looked through, metres squared. `top_z`: the roof's highest level.
pub(crate) fn blind_area_m2(building: u32, top_z: f32, looks: &[&FoundView<'_>]) -> f64 {
    let usual = looks.iter().fold(KnownRays::default(), |sum, look| KnownRays {
        n_rays: sum.n_rays + look.all.n_rays,
        n_known: sum.n_known + look.all.n_known,
    });
    if usual.n_known == usual.n_rays {
        return 0.0; // priors without gaps
    }
    let mut columns: BTreeMap<[i32; 2], [KnownRays; N_STOREYS]> = BTreeMap::new();
    for look in looks {
        for &ray in look.evidence.rays_of(building) {
            look.through(ray, building, top_z + ABOVE_ROOF_M, &mut columns);
        }
    }
    let is_blind = |cell: &KnownRays| cell.n_rays >= LEAST_RAYS && cell.share() <= BLIND_SHARE * usual.share();
    columns.values().filter(|cells| cells.iter().all(is_blind)).count() as f64 * f64::from(CELL_M * CELL_M)
}

impl FoundView<'_> {
    /// Counts a ray in every cell above `from_z` over the building that it passes through.
    fn through(&self, ray: u32, building: u32, from_z: f32, columns: &mut BTreeMap<[i32; 2], [KnownRays; N_STOREYS]>) {
        let profiles = self.evidence.profiles;
        // How far the ray looks, z-depth: relative depth does not say, but that it looks.
        let nearness = self.evidence.nearness[ray as usize];
        let looks_to = if self.is_in_metres || nearness.is_nan() { nearness.recip() } else { f32::INFINITY };
        let (dz, end) = (profiles.rays[ray as usize].dz, self.stops.depth(ray as usize));
        let line = self.evidence.ray(self.placed, ray);
        // The ray's own measure of its direction: z-depth by height, since both fall along it in proportion.
        let at = |depth: f32| line.origin + (depth * dz / line.direction.z) * line.direction;
        let mut last = None;
        for interval in profiles.intervals(ray as usize).iter().filter(|c| c.building == building) {
            let leave = interval.leave.min(end).min((from_z - profiles.eye_z) / dz);
            let length_m = (at(leave) - at(interval.enter)).length();
            if leave <= interval.enter {
                continue;
            }
            let n_steps = (2.0 * length_m / STOREY_M).ceil();
            for step in 0..n_steps as usize {
                let depth = interval.enter + (leave - interval.enter) * (step as f32 + 0.5) / n_steps;
                let place = at(depth);
                let column = [place.x, place.y].map(|x| (x / CELL_M).floor() as i32);
                let storey = ((place.z - from_z) / STOREY_M) as usize;
                if storey < N_STOREYS && last.replace((column, storey)) != Some((column, storey)) {
                    // NaN looks nowhere.
                    columns.entry(column).or_default()[storey].add(looks_to > depth + INTO_CELL_M);
                }
            }
        }
    }
}
