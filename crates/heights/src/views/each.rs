//! Every building chooses its own views: what it gets does not depend on what else the scene holds.
//!
//! ```text
//! sector by sector of azimuth in turn, the best view that is left, until there are k
//! best   views that see at least half of the most rays of the sector, then the others; by a key of their names
//! ```
//!
//! The key is the same for all buildings, so neighbours agree on most views without asking each other (consistent
//! sampling), and few priors are needed in all.

use glam::{DVec2, DVec3};

use super::{Selection, ViewSight, ViewsConfig, Visibility};

/// Sectors of azimuth that a building's views are taken from in turn.
const N_SECTORS: usize = 8;
/// Views with fewer rays than this share of the sector's most come last.
const FEW_RAYS_SHARE: f64 = 0.5;

/// A view that may be chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CandidateView {
    /// Projection centre of its camera, in the frame of the buildings.
    pub eye: DVec3,
    /// A number for its name.
    pub key: u64,
}

/// Chooses for each building; `candidates[v]` belongs to `visibilities[v]` (`None`: the view takes no part), `centres`
/// are the buildings' middles.
#[must_use]
pub fn select_each(
    config: &ViewsConfig,
    visibilities: &[Option<Visibility>],
    candidates: &[CandidateView],
    centres: &[DVec3],
) -> Selection {
    let k = config.min_views_per_building;
    let mut seen_by: Vec<Vec<(usize, u32)>> = vec![Vec::new(); centres.len()];
    for (view, visibility) in visibilities.iter().enumerate() {
        let sights = visibility.iter().flat_map(|v| &v.buildings);
        for sight in sights.filter(|s| is_informative(config, s)) {
            seen_by[sight.building as usize].push((view, sight.n_rays));
        }
    }
    let choose = |(views, &centre): (&Vec<(usize, u32)>, &DVec3)| {
        let most = views.iter().map(|(_, n)| *n).max().unwrap_or(0);
        let has_few = |n: u32| f64::from(n) < FEW_RAYS_SHARE * f64::from(most);
        let ranked = views.iter().map(|&(view, n_rays)| {
            let CandidateView { eye, key } = candidates[view];
            (view, (eye - centre).truncate(), (has_few(n_rays), key))
        });
        in_turn(ranked, k)
    };
    let views_of_building: Vec<Vec<usize>> = seen_by.iter().zip(centres).map(choose).collect();
    let mut is_chosen = vec![false; visibilities.len()];
    views_of_building.iter().flatten().for_each(|&view| is_chosen[view] = true);
    let under_observed = (0..centres.len()).filter(|&b| seen_by[b].len() < k).collect();
    Selection { views: (0..is_chosen.len()).filter(|&v| is_chosen[v]).collect(), views_of_building, under_observed }
}

/// Whether a view sees a building well enough to measure it.
pub(super) fn is_informative(config: &ViewsConfig, sight: &ViewSight) -> bool {
    sight.n_rays as usize >= config.min_rays && f64::from(sight.corners_inside) >= config.min_corners_inside
}

/// At most `n` views, ascending: from each sector of azimuth in turn the first by rank. A view comes with the horizontal
/// way from the building to it, and its rank (the least is taken first, ties by position).
pub fn in_turn<K: Ord>(views: impl Iterator<Item = (usize, DVec2, K)>, n: usize) -> Vec<usize> {
    let mut sectors: Vec<Vec<(K, usize)>> = (0..N_SECTORS).map(|_| Vec::new()).collect();
    for (view, from, rank) in views {
        let turn = from.y.atan2(from.x) / std::f64::consts::TAU + 0.5;
        sectors[((turn * N_SECTORS as f64) as usize).min(N_SECTORS - 1)].push((rank, view));
    }
    for sector in &mut sectors {
        sector.sort();
    }
    let longest = sectors.iter().map(Vec::len).max().unwrap_or(0);
    let taken = (0..longest).flat_map(|i| sectors.iter().filter_map(move |sector| sector.get(i)));
    let mut best: Vec<usize> = taken.take(n).map(|(_, view)| *view).collect();
    best.sort_unstable();
    best
}

/// Quarters of azimuth that views to look at are taken from.
const N_SIDES: usize = 4;

/// At most `n` of some views that are given best first, as positions: the best of each quarter of azimuth before the second best of
/// any. A view is its horizontal way from what it shows.
#[must_use]
pub fn from_all_sides(views: impl Iterator<Item = DVec2>, n: usize) -> Vec<usize> {
    let mut taken = [0_usize; N_SIDES];
    let mut ranked: Vec<(usize, usize)> = Vec::new();
    for (rank, from) in views.enumerate() {
        let turn = from.y.atan2(from.x) / std::f64::consts::TAU + 0.5;
        let side = ((turn * N_SIDES as f64) as usize).min(N_SIDES - 1);
        ranked.push((taken[side], rank));
        taken[side] += 1;
    }
    ranked.sort_unstable();
    ranked.into_iter().take(n).map(|(_, rank)| rank).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(n: usize) -> Vec<CandidateView> {
        let at = |i: usize| {
            let eye = 100.0 * DVec2::from_angle(i as f64 * std::f64::consts::TAU / n as f64);
            CandidateView { eye: eye.extend(50.0), key: crate::seed::key_of(&i.to_string()) }
        };
        (0..n).map(at).collect()
    }

    #[expect(clippy::unnecessary_wraps, reason = "as the selection takes them")]
    fn sees(buildings: &[u32]) -> Option<Visibility> {
        let sight = |&building: &u32| ViewSight { building, n_rays: 10, n_roof_rays: 5, corners_inside: 1.0 };
        Some(Visibility { buildings: buildings.iter().map(sight).collect(), surface_m2: 1.0 })
    }

    #[test]
    fn what_else_there_is_does_not_change_a_buildings_views() {
        let config = ViewsConfig { min_views_per_building: 8, ..ViewsConfig::robust() };
        let alone = select_each(&config, &vec![sees(&[0]); 40], &ring(40), &[DVec3::ZERO]);
        let together = select_each(&config, &vec![sees(&[0, 1]); 40], &ring(40), &[DVec3::ZERO, DVec3::X]);
        assert_eq!(alone.views_of_building[0].len(), 8);
        assert_eq!(alone.views_of_building[0], together.views_of_building[0]);
        // Neighbours agree: two buildings a metre apart need hardly more views than one.
        assert!(together.views.len() <= 10, "{:?}", together.views);
    }

    #[test]
    fn views_come_from_all_sides_and_those_that_see_little_come_last() {
        let config = ViewsConfig { min_views_per_building: 8, ..ViewsConfig::robust() };
        let mut visibilities = vec![sees(&[0]); 40];
        for poor in visibilities.iter_mut().step_by(2).flatten() {
            poor.buildings[0].n_rays = 4;
        }
        let chosen = select_each(&config, &visibilities, &ring(40), &[DVec3::ZERO]);
        assert!(chosen.views.iter().all(|view| view % 2 == 1), "{:?}", chosen.views);
        let gaps = chosen.views.windows(2).map(|w| w[1] - w[0]).max();
        assert!(gaps <= Some(10), "{:?}", chosen.views);
    }
}
