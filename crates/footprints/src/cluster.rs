//! Which candidates are the same building.
//!
//! Candidates are taken one after the other, complete ones before those that an image's border cuts off, heavier ones
//! first. Each joins the cluster whose *first* member it overlaps most, if
//!
//! ```text
//! IoU = area(c ∩ r) / area(c ∪ r) ≥ min_iou,    both within what the views of c and r can see,
//! ```
//!
//! else it starts its own. Comparing with the first member only, never with the last to join, keeps row houses apart:
//! a chain of small overlaps joins nothing. What the border cuts off is compared within its view's own ground, and
//! parts of a building that no view shows whole add up to one.
//!
//! The first member may be the odd one out: half of a house that most views show whole has an intersection over union of
//! ½ with it. Once gathered, a cluster's shape is the member that agrees most with the others, before clusters compete.
//!
//! Clusters may contradict each other: a view that shows three row houses as one, another one that shows one hall as
//! two. A cluster that others fill as its parts is dropped if half as many views have a border across it as show it
//! whole, because segmenters merge more often than they split. Of the others the heavier wins; what is mostly covered
//! by winners is dropped. A view that shows a house and its neighbours as one still says that there is a house.
//! Everything is near-linear in the number of candidates: R-trees for who is near, a small raster per comparison. How the
//! candidates are taken one after the other on many cores is [`gather`]'s concern.

use geo::{Area as _, Contains as _, InteriorPoint as _};
use geo_types::MultiPolygon;
use rayon::prelude::*;
use rstar::AABB;

use super::candidate::{Bounds, FootprintCandidate, SeenGround, bounds, envelope, joint, shared_box_m2};
use super::compare::{Comparer, Tree, entry, near};
use super::consensus::ConsensusConfig;
use super::gather::gather;

/// Share of a cluster that winners must cover to drop it.
const COVERED_SHARE: f64 = 0.5;
/// Share of a shape from which on it lies within another one.
const WITHIN_SHARE: f64 = 0.8;
/// Share of a shape below which another one leaves it alone.
const APART_SHARE: f64 = 0.15;
/// Share of a cluster that its parts must fill to be all of it.
const FILLED_SHARE: f64 = 0.6;
/// Views that must tell a cluster's parts apart, per view that does not: segmenters merge more often than they split.
const SPLIT_SHARE: f64 = 0.5;
/// Share by which the areas of a cluster's candidates may differ from its shape's before another shape is looked for.
const SAME_AREA_SHARE: f64 = 0.2;

/// A building with the candidates that show it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cluster {
    /// First candidate; all parts together where no view shows it whole.
    pub shape: MultiPolygon<f64>,
    /// Positions of its candidates, in the order in which they joined.
    pub members: Vec<usize>,
    /// Number of views that see the place.
    pub n_seen: usize,
    /// Number of them that show it.
    pub n_views: usize,
    /// Area of its shape.
    pub area_m2: f64,
    /// Bounds of its shape.
    pub bounds: Bounds,
    /// Part that its views see, where none sees it whole.
    pub seen: Option<MultiPolygon<f64>>,
}

impl Cluster {
    /// Takes the whole candidate that agrees most with the others for the shape, the earliest of equal ones. Where all have
    /// about one area, or no view shows the building whole, the shape stays.
    fn take_typical_shape(&mut self, candidates: &[FootprintCandidate], comparer: &mut Comparer) {
        let members = self.members.iter().map(|&m| &candidates[m]);
        let whole: Vec<&MultiPolygon<f64>> = members.filter(|c| !c.is_cut).map(|c| &c.shape).collect();
        let differs =
            |shape: &&MultiPolygon<f64>| (shape.unsigned_area() - self.area_m2).abs() > SAME_AREA_SHARE * self.area_m2;
        if self.seen.is_some() || whole.len() < 3 || !whole.iter().any(differs) {
            return;
        }
        let Some(best) = most_typical(&whole, comparer).map(|i| whole[i]) else { return };
        (self.area_m2, self.bounds) = (best.unsigned_area(), bounds(best).unwrap_or_default());
        self.shape = best.clone();
    }

    /// The same with other candidates.
    pub(super) fn with_members(mut self, members: Vec<usize>, n_views: usize) -> Self {
        (self.members, self.n_views) = (members, n_views);
        self
    }

    /// Cluster of candidates that are known to be one building; the heaviest whole one is its shape.
    pub(super) fn of(members: &[usize], candidates: &[FootprintCandidate]) -> Self {
        let worth = |&m: &usize| (!candidates[m].is_cut, candidates[m].weight * f64::from(candidates[m].score));
        let best = members.iter().copied().max_by(|a, b| {
            let (x, y) = (worth(a), worth(b));
            x.0.cmp(&y.0).then(x.1.total_cmp(&y.1)).then(b.cmp(a))
        });
        let shape = best.map_or_else(|| MultiPolygon::new(Vec::new()), |m| candidates[m].shape.clone());
        let (area_m2, box_of_it) = (shape.unsigned_area(), bounds(&shape).unwrap_or_default());
        let (members, n_views) = (members.to_vec(), members.len());
        Self { shape, members, n_seen: n_views, n_views, area_m2, bounds: box_of_it, seen: None }
    }
}

/// Why candidates are in no building.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Dropped {
    /// Clusters that better supported ones contradict.
    pub n_contradicted: usize,
    /// Clusters that too few of the views show that see their place.
    pub n_unsupported: usize,
}

/// Groups candidates into buildings; clusters come in a fixed order.
pub(super) fn cluster(
    candidates: &[FootprintCandidate],
    seen: &[SeenGround],
    config: &ConsensusConfig,
) -> (Vec<Cluster>, Dropped) {
    let mut clusters = gather(candidates, seen, config);
    clusters.par_iter_mut().for_each_init(Comparer::default, |comparer, c| c.take_typical_shape(candidates, comparer));
    count_views(&mut clusters, candidates, seen);
    let contest = Contest::of(&clusters, candidates);
    let is_supported: Vec<bool> = (0..clusters.len())
        .map(|i| contest.supporters(i).len() as f64 >= config.min_support * clusters[i].n_seen as f64)
        .collect();
    let is_winner = contest.winners(&is_supported);
    let n_unsupported = is_supported.iter().filter(|s| !**s).count();
    let n_contradicted = clusters.len() - n_unsupported - is_winner.iter().filter(|w| **w).count();
    let mut keep = is_winner.into_iter();
    clusters.retain(|_| keep.next().unwrap_or(false));
    (clusters, Dropped { n_contradicted, n_unsupported })
}

/// Fit of each cluster's candidates to its shape: the sum of their intersections over union, so that more candidates
/// and closer ones both count.
pub(super) fn fits(clusters: &[Cluster], candidates: &[FootprintCandidate]) -> Vec<f64> {
    let fit = |comparer: &mut Comparer, cluster: &Cluster| {
        let iou = |&m: &usize| {
            let candidate = &candidates[m];
            let Some(own) = bounds(&candidate.shape) else { return 0.0 };
            comparer.overlap(&candidate.shape, &cluster.shape, joint(own, cluster.bounds), &[]).iou()
        };
        cluster.members.iter().map(iou).sum()
    };
    clusters.par_iter().map_init(Comparer::default, fit).collect()
}

/// Position of the shape whose intersections over union with all others add up to the most.
fn most_typical(shapes: &[&MultiPolygon<f64>], comparer: &mut Comparer) -> Option<usize> {
    let boxes: Vec<Bounds> = shapes.iter().map(|shape| bounds(shape).unwrap_or_default()).collect();
    let mut agreement = vec![0.0; shapes.len()];
    for i in 0..shapes.len() {
        for j in i + 1..shapes.len() {
            let iou = comparer.overlap(shapes[i], shapes[j], joint(boxes[i], boxes[j]), &[]).iou();
            agreement[i] += iou;
            agreement[j] += iou;
        }
    }
    (0..shapes.len()).max_by(|&a, &b| agreement[a].total_cmp(&agreement[b]).then(b.cmp(&a)))
}

/// Number of views that see each cluster's place, and of those that show it.
fn count_views(clusters: &mut [Cluster], candidates: &[FootprintCandidate], seen: &[SeenGround]) {
    let boxes = seen.iter().enumerate().filter_map(|(i, s)| {
        let (low, high) = bounds(&MultiPolygon::new(vec![s.area.clone()]))?;
        Some(entry((low, high), i))
    });
    let tree = Tree::bulk_load(boxes.collect());
    clusters.par_iter_mut().for_each(|cluster| {
        let mut views: Vec<usize> = cluster.members.iter().map(|&m| candidates[m].view).collect();
        views.sort_unstable();
        views.dedup();
        cluster.n_views = views.len();
        let sees = |view: &usize, at: &geo_types::Point<f64>| seen[*view].area.contains(at);
        if let Some(at) = cluster.shape.interior_point() {
            let point = AABB::from_point([at.x(), at.y()]);
            views.extend(near(&tree, &point).iter().filter(|view| sees(view, &at)));
        }
        views.sort_unstable();
        views.dedup();
        cluster.n_seen = views.len();
    });
}

/// Clusters that claim the same ground.
struct Contest<'a> {
    clusters: &'a [Cluster],
    /// Sum of the candidates' weights.
    weight: Vec<f64>,
    /// Views that show each cluster, sorted.
    views: Vec<Vec<usize>>,
    /// Who overlaps whom, and by how much, m².
    overlaps: Vec<Vec<(usize, f64)>>,
}

impl<'a> Contest<'a> {
    fn of(clusters: &'a [Cluster], candidates: &[FootprintCandidate]) -> Self {
        let tree = Tree::bulk_load(clusters.iter().enumerate().map(|(i, c)| entry(c.bounds, i)).collect());
        let overlaps = |comparer: &mut Comparer, i: usize| {
            let cluster = &clusters[i];
            let others = near(&tree, &envelope(cluster.bounds)).into_iter().filter(|&j| j != i);
            let overlap = |j: usize| {
                let other = &clusters[j];
                let least_m2 = 0.05 * cluster.area_m2.min(other.area_m2);
                if shared_box_m2(cluster.bounds, other.bounds) < least_m2 {
                    return None;
                }
                let both = joint(cluster.bounds, other.bounds);
                let shared_m2 = comparer.overlap(&cluster.shape, &other.shape, both, &[]).shared_m2;
                (shared_m2 > least_m2).then_some((j, shared_m2))
            };
            others.filter_map(overlap).collect()
        };
        let members = |c: &'a Cluster| c.members.iter().map(|&m| &candidates[m]);
        Self {
            weight: clusters.iter().map(|c| members(c).map(|m| m.weight * f64::from(m.score)).sum()).collect(),
            views: clusters.iter().map(|c| distinct(members(c).map(|m| m.view))).collect(),
            overlaps: (0..clusters.len()).into_par_iter().map_init(Comparer::default, overlaps).collect(),
            clusters,
        }
    }

    /// Views that show something over all of a cluster: itself, or it and its neighbours as one.
    fn supporters(&self, i: usize) -> Vec<usize> {
        let covers = |(_, shared_m2): &&(usize, f64)| *shared_m2 >= WITHIN_SHARE * self.clusters[i].area_m2;
        let others = self.overlaps[i].iter().filter(covers).flat_map(|(j, _)| &self.views[*j]);
        distinct(self.views[i].iter().chain(others).copied())
    }

    /// Whether several buildings were taken for one: parts fill it, and enough views have a border across it.
    fn is_merged(&self, i: usize, is_supported: &[bool]) -> bool {
        let area_m2 = self.clusters[i].area_m2;
        let is_part = |&&(j, shared_m2): &&(usize, f64)| {
            is_supported[j]
                && shared_m2 >= WITHIN_SHARE * self.clusters[j].area_m2
                && shared_m2 < WITHIN_SHARE * area_m2
        };
        let parts: Vec<f64> = self.overlaps[i].iter().filter(is_part).map(|&(_, m2)| m2).collect();
        if parts.len() < 2 || parts.iter().sum::<f64>() < FILLED_SHARE * area_m2 {
            return false;
        }
        let cuts = |&&(j, shared_m2): &&(usize, f64)| {
            let share = shared_m2 / area_m2;
            self.clusters[j].seen.is_none() && share > APART_SHARE && share < WITHIN_SHARE
        };
        let against = self.overlaps[i].iter().filter(cuts).flat_map(|(j, _)| &self.views[*j]);
        distinct(against.copied()).len() as f64 >= SPLIT_SHARE * self.supporters(i).len() as f64
    }

    /// Per cluster, whether it stands: those with most weight first, none where winners cover it already.
    fn winners(&self, is_supported: &[bool]) -> Vec<bool> {
        let mut order: Vec<usize> = (0..self.clusters.len()).filter(|&i| is_supported[i]).collect();
        order.retain(|&i| !self.is_merged(i, is_supported));
        order.sort_by(|&a, &b| self.weight[b].total_cmp(&self.weight[a]).then(a.cmp(&b)));
        let mut is_winner = vec![false; self.clusters.len()];
        for i in order {
            let won = self.overlaps[i].iter().filter(|(j, _)| is_winner[*j]).map(|(_, m2)| m2).sum::<f64>();
            is_winner[i] = won <= COVERED_SHARE * self.clusters[i].area_m2;
        }
        is_winner
    }
}

fn distinct(values: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut values: Vec<usize> = values.collect();
    values.sort_unstable();
    values.dedup();
    values
}

#[cfg(test)]
mod tests {
    use geo_types::Rect;

    use super::*;

    /// Widths of the buildings, whole metres, that ten views agree on: the first `n_cut` show a house of 12 m in halves, the others
    /// whole. Weights fall from view to view, so that what the first ones show is gathered first.
    fn widths_m(n_cut: usize) -> Vec<u32> {
        let area = Rect::new((-50.0, -50.0), (50.0, 50.0)).to_polygon();
        let seen = vec![SeenGround { area }; 10];
        let of_view = |view: usize| {
            let spans: &[(f64, f64)] = if view < n_cut { &[(0.0, 6.2), (6.2, 12.0)] } else { &[(0.0, 12.0)] };
            spans.iter().map(move |&(west, east)| FootprintCandidate {
                view,
                shape: Rect::new((west, 0.0), (east, 9.0)).to_polygon().into(),
                weight: 12.0 - 0.1 * view as f64,
                score: 1.0,
                is_cut: false,
            })
        };
        let candidates: Vec<FootprintCandidate> = (0..10).flat_map(of_view).collect();
        let agreed = crate::agree(&candidates, &seen, &ConsensusConfig::default());
        let width = |b: &crate::Consensus| (b.polygon.unsigned_area() / 9.0).round() as u32;
        agreed.buildings.iter().map(width).collect()
    }

    #[test]
    fn a_house_that_fewer_than_half_of_the_views_cut_stays_whole() {
        assert_eq!(widths_m(3), [12]);
        assert_eq!(widths_m(4), [12]);
    }

    #[test]
    fn two_houses_that_most_views_tell_apart_stay_two() {
        assert_eq!(widths_m(7), [6, 6]);
        assert_eq!(widths_m(10), [6, 6]);
    }
}
