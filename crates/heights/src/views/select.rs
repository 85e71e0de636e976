//! The selection for a whole scene: gate, spread, cover; or views drawn at random.

use glam::DVec3;

use super::each::is_informative;
use super::{ViewsConfig, Visibility};
use crate::stats;

/// The views to use, and how well they cover the buildings.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// Positions of the selected views, ascending.
    pub views: Vec<usize>,
    /// For each building, the selected views that see it well enough, ascending.
    pub views_of_building: Vec<Vec<usize>>,
    /// Buildings that no more than this many views of all see well enough, fewer than asked for.
    pub under_observed: Vec<usize>,
}

/// Selects views for `n_buildings` buildings.
///
/// `visibilities[v]` is `None` where view `v` takes no part (it is no oblique one, or has no prior): nothing of the selection
/// depends on such a view. `stations[v]` is where view `v`'s optical axis meets the ground (x, y, metres) and `axes[v]` its direction. Ties go to the
/// view with the lower position, so the same input gives the same selection.
#[must_use]
pub fn select(
    config: &ViewsConfig,
    visibilities: &[Option<Visibility>],
    stations: &[DVec3],
    axes: &[DVec3],
    n_buildings: usize,
) -> Selection {
    let seen = informative(config, visibilities);
    let mut selected = vec![false; visibilities.len()];
    for view in spread(config, visibilities, stations, axes) {
        selected[view] = true;
    }
    cover(config.min_views_per_building, &seen, &mut selected, n_buildings);

    of_selected(config, &seen, &selected, n_buildings)
}

/// `n_spread` views out of those that take part, those with the lowest keys; `keys[v]` belongs to `visibilities[v]`.
#[must_use]
pub fn drawn(config: &ViewsConfig, visibilities: &[Option<Visibility>], keys: &[u64], n_buildings: usize) -> Selection {
    let mut taking_part: Vec<usize> = (0..visibilities.len()).filter(|&v| visibilities[v].is_some()).collect();
    taking_part.sort_by_key(|&v| (keys[v], v));
    let mut selected = vec![false; visibilities.len()];
    taking_part.into_iter().take(config.n_spread).for_each(|v| selected[v] = true);
    of_selected(config, &informative(config, visibilities), &selected, n_buildings)
}

fn of_selected(config: &ViewsConfig, seen: &[Vec<u32>], selected: &[bool], n_buildings: usize) -> Selection {
    let mut views_of_building = vec![Vec::new(); n_buildings];
    let mut n_candidates = vec![0_usize; n_buildings];
    for (view, buildings) in seen.iter().enumerate() {
        for &building in buildings {
            n_candidates[building as usize] += 1;
            if selected[view] {
                views_of_building[building as usize].push(view);
            }
        }
    }
    let under_observed = (0..n_buildings).filter(|&b| n_candidates[b] < config.min_views_per_building).collect();
    Selection { views: (0..selected.len()).filter(|&v| selected[v]).collect(), views_of_building, under_observed }
}

/// For each view, the buildings it sees well enough.
fn informative(config: &ViewsConfig, visibilities: &[Option<Visibility>]) -> Vec<Vec<u32>> {
    let of_view = |view: &Option<Visibility>| {
        let sights = view.iter().flat_map(|v| &v.buildings);
        sights.filter(|s| is_informative(config, s)).map(|s| s.building).collect()
    };
    visibilities.iter().map(of_view).collect()
}

/// Gate by percentiles, then farthest point sampling, from the view with the largest visible surface.
fn spread(config: &ViewsConfig, visibilities: &[Option<Visibility>], stations: &[DVec3], axes: &[DVec3]) -> Vec<usize> {
    let taking_part = || visibilities.iter().enumerate().filter_map(|(v, seen)| Some((v, seen.as_ref()?)));
    let n_seen = |seen: &Visibility| seen.buildings.len() as f64;
    let surface = |seen: &Visibility| f64::from(seen.surface_m2);
    let threshold = |measure: &dyn Fn(&Visibility) -> f64| {
        let values: Vec<f64> = taking_part().map(|(_, seen)| measure(seen)).collect();
        stats::quantile(&values, config.gate_percentile / 100.0).unwrap_or(0.0)
    };
    let (least_n, least_surface) = (threshold(&n_seen), threshold(&surface));
    let those = |passes: &dyn Fn(bool, bool) -> bool| {
        let is_passed = |seen: &Visibility| passes(n_seen(seen) >= least_n, surface(seen) >= least_surface);
        let sees_any = taking_part().filter(|(_, seen)| !seen.buildings.is_empty());
        sees_any.filter(|(_, seen)| is_passed(seen)).map(|(v, _)| v).collect::<Vec<usize>>()
    };
    let mut candidates = those(&|n, surface| n && surface);
    if candidates.is_empty() {
        // No view reaches both thresholds: fall back to those that reach either.
        candidates = those(&|n, surface| n || surface);
    }
    if candidates.len() <= config.n_spread {
        return candidates;
    }
    let surfaces: Vec<f64> = visibilities.iter().map(|seen| seen.as_ref().map_or(0.0, surface)).collect();
    farthest_points(config, &candidates, &surfaces, stations, axes)
}

fn farthest_points(
    config: &ViewsConfig,
    candidates: &[usize],
    surfaces: &[f64],
    stations: &[DVec3],
    axes: &[DVec3],
) -> Vec<usize> {
    // Positions count in units of the survey's extent, directions in units of a radian times the weight.
    let low = candidates.iter().fold(DVec3::INFINITY, |b, &v| b.min(stations[v]));
    let high = candidates.iter().fold(DVec3::NEG_INFINITY, |b, &v| b.max(stations[v]));
    let extent = (high - low).truncate().length().max(1e-9);
    let distance = |a: usize, b: usize| {
        let position = (stations[a] - stations[b]).truncate().length() / extent;
        position + config.direction_weight * (axes[a] - axes[b]).length()
    };
    let best_first = |a: &usize, b: &usize| surfaces[*a].total_cmp(&surfaces[*b]).then(b.cmp(a));
    let Some(first) = candidates.iter().copied().max_by(best_first) else { return Vec::new() };
    let mut chosen = Vec::with_capacity(config.n_spread);
    let mut gaps = vec![f64::INFINITY; candidates.len()];
    let mut next = first;
    while chosen.len() < config.n_spread {
        chosen.push(next);
        for (gap, &candidate) in gaps.iter_mut().zip(candidates) {
            *gap = gap.min(distance(candidate, next));
        }
        let farthest = (0..candidates.len()).max_by(|&a, &b| gaps[a].total_cmp(&gaps[b]).then(b.cmp(&a)));
        next = farthest.map_or(first, |i| candidates[i]);
    }
    chosen
}

/// Greedy multi-cover: adds the view that serves the most unmet demands, until every building has its `k` views or all
/// that there are. Greedy is within `1 + ln n` of the fewest views.
fn cover(k: usize, seen: &[Vec<u32>], selected: &mut [bool], n_buildings: usize) {
    let mut missing = vec![k; n_buildings];
    let serve = |view: usize, missing: &mut [usize]| {
        for &building in &seen[view] {
            missing[building as usize] = missing[building as usize].saturating_sub(1);
        }
    };
    for view in (0..seen.len()).filter(|&v| selected[v]) {
        serve(view, &mut missing);
    }
    loop {
        let gain = |view: usize| seen[view].iter().filter(|&&b| missing[b as usize] > 0).count();
        let best = (0..seen.len())
            .filter(|&v| !selected[v])
            .map(|v| (gain(v), v))
            .max_by(|a, b| a.0.cmp(&b.0).then(b.1.cmp(&a.1)));
        match best {
            Some((gain, view)) if gain > 0 => {
                selected[view] = true;
                serve(view, &mut missing);
            }
            _ => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::ViewSight;
    use super::*;

    #[expect(clippy::unnecessary_wraps, reason = "as the selection takes them")]
    fn view_of(buildings: &[u32], surface_m2: f32) -> Option<Visibility> {
        let sight = |&building: &u32| ViewSight { building, n_rays: 10, n_roof_rays: 5, corners_inside: 1.0 };
        Some(Visibility { buildings: buildings.iter().map(sight).collect(), surface_m2 })
    }

    fn line_of_stations(n: usize) -> (Vec<DVec3>, Vec<DVec3>) {
        ((0..n).map(|i| DVec3::new(i as f64 * 10.0, 0.0, 0.0)).collect(), vec![-DVec3::Z; n])
    }

    #[test]
    fn every_building_gets_its_views_or_all_there_are() {
        let visibilities = [view_of(&[0], 1.0), view_of(&[0, 1], 1.0), view_of(&[0], 1.0), view_of(&[0, 1], 1.0)];
        let (stations, axes) = line_of_stations(4);
        let config = ViewsConfig { n_spread: 0, min_views_per_building: 3, ..ViewsConfig::paper() };
        let selection = select(&config, &visibilities, &stations, &axes, 3);
        assert_eq!(selection.views_of_building[0].len(), 3);
        assert_eq!(selection.views_of_building[1], [1, 3]);
        assert_eq!(selection.under_observed, [1, 2]);
    }

    #[test]
    fn the_gate_drops_views_below_the_median_in_either_measure() {
        let visibilities =
            [view_of(&[0], 9.0), view_of(&[0, 1, 2], 1.0), view_of(&[0, 1, 2], 9.0), view_of(&[0, 1], 5.0)];
        let (stations, axes) = line_of_stations(4);
        let config = ViewsConfig { n_spread: 10, min_views_per_building: 0, ..ViewsConfig::paper() };
        assert_eq!(select(&config, &visibilities, &stations, &axes, 3).views, [2]);
    }

    #[test]
    fn views_that_take_no_part_do_not_count_at_the_gate() {
        let taking_part = [view_of(&[0], 1.0), view_of(&[0], 2.0), view_of(&[0, 1], 3.0), view_of(&[0, 1], 4.0)];
        let config = ViewsConfig { n_spread: 10, min_views_per_building: 0, ..ViewsConfig::paper() };
        let (stations, axes) = line_of_stations(4);
        assert_eq!(select(&config, &taking_part, &stations, &axes, 2).views, [2, 3]);
        // As many again that take none: as zeros they would bring the medians below every other view.
        let all: Vec<_> = taking_part.into_iter().flat_map(|view| [None, view]).collect();
        let (stations, axes) = line_of_stations(8);
        assert_eq!(select(&config, &all, &stations, &axes, 2).views, [5, 7]);
    }

    #[test]
    fn views_are_drawn_by_their_keys_out_of_those_that_take_part() {
        let visibilities = [view_of(&[0], 1.0), None, view_of(&[1], 1.0), view_of(&[0, 1], 1.0)];
        let config = ViewsConfig { n_spread: 2, ..ViewsConfig::paper() };
        let selection = drawn(&config, &visibilities, &[7, 1, 9, 8], 2);
        assert_eq!((selection.views.as_slice(), &selection.views_of_building[1]), (&[0, 3][..], &vec![3]));
    }

    #[test]
    fn farthest_points_spread_over_the_line() {
        let visibilities: Vec<_> = (0..11).map(|i| view_of(&[0], if i == 0 { 2.0 } else { 1.0 })).collect();
        let (stations, axes) = line_of_stations(11);
        let config =
            ViewsConfig { n_spread: 3, gate_percentile: 0.0, min_views_per_building: 0, ..ViewsConfig::paper() };
        assert_eq!(select(&config, &visibilities, &stations, &axes, 1).views, [0, 5, 10]);
    }
}
