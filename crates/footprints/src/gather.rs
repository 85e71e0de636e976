//! Candidates joined to clusters, one after the other in a fixed order, on all cores.
//!
//! What a candidate joins depends on the clusters that those before it made, so the order is part of the answer. The
//! work is not: nearly all of it is comparing shapes, and that needs no order. Candidates are therefore taken in batches:
//!
//! 1. each is compared with the clusters there were before the batch, all at once;
//! 2. each is compared with those before it in the batch that found no cluster and may become one, all at once;
//! 3. they join in their order, by the comparisons made. Only clusters that grew within the batch (a building that no view
//!    shows whole) are compared once more.
//!
//! So the size of a batch and the number of cores change nothing in the outcome.

use std::cmp::Ordering;

use geo::{Area as _, BooleanOps as _};
use geo_types::MultiPolygon;
use rayon::prelude::*;
use rstar::Envelope as _;

use super::candidate::{Bounds, FootprintCandidate, SeenGround, bounds, envelope, joint, shared_box_m2};
use super::cluster::Cluster;
use super::compare::{Comparer, Tree, entry, near};
use super::consensus::ConsensusConfig;

/// Candidates of a batch: enough for all cores, few enough that they are mostly of different buildings.
const BATCH: usize = 512;
/// Least overlap of two parts that may be the same building, m².
const MIN_SHARED_M2: f64 = 1.0;

/// Clusters in the order in which their first candidates come.
pub(super) fn gather(candidates: &[FootprintCandidate], seen: &[SeenGround], config: &ConsensusConfig) -> Vec<Cluster> {
    gather_in_batches(candidates, seen, config, BATCH)
}

fn gather_in_batches(
    candidates: &[FootprintCandidate],
    seen: &[SeenGround],
    config: &ConsensusConfig,
    batch: usize,
) -> Vec<Cluster> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.par_sort_unstable_by(|&a, &b| by_worth(&candidates[a], &candidates[b]).then(a.cmp(&b)));
    let mut gathering = GrowingClusters { clusters: Vec::new(), tree: Tree::new(), min_iou: config.min_iou };
    let mut comparer = Comparer::default();
    for batch in order.chunks(batch) {
        let newcomers: Vec<Newcomer<'_>> =
            batch.par_iter().filter_map(|&i| Newcomer::of(i, &candidates[i], seen)).collect();
        gathering.add(&newcomers, &mut comparer);
    }
    gathering.clusters
}

/// Whole ones first, then those that count more.
fn by_worth(a: &FootprintCandidate, b: &FootprintCandidate) -> Ordering {
    let worth = |c: &FootprintCandidate| c.weight * f64::from(c.score);
    a.is_cut.cmp(&b.is_cut).then(worth(b).total_cmp(&worth(a)))
}

/// A candidate that looks for its cluster.
struct Newcomer<'a> {
    position: usize,
    shape: &'a MultiPolygon<f64>,
    bounds: Bounds,
    area_m2: f64,
    /// Area that its view sees, if that does not hold all of it.
    seen: Option<MultiPolygon<f64>>,
}

impl<'a> Newcomer<'a> {
    fn of(position: usize, candidate: &'a FootprintCandidate, seen: &[SeenGround]) -> Option<Self> {
        Some(Self {
            position,
            shape: &candidate.shape,
            bounds: bounds(&candidate.shape)?,
            area_m2: candidate.shape.unsigned_area(),
            seen: candidate.is_cut.then(|| MultiPolygon::new(vec![seen[candidate.view].area.clone()])),
        })
    }

    /// A cluster of this one alone.
    fn cluster(&self) -> Cluster {
        Cluster {
            shape: self.shape.clone(),
            members: vec![self.position],
            n_seen: 0,
            n_views: 0,
            area_m2: self.area_m2,
            bounds: self.bounds,
            seen: self.seen.clone(),
        }
    }
}

/// The shape that a newcomer is compared with: of a cluster, or of one that may become a cluster.
struct ComparedShape<'a> {
    shape: &'a MultiPolygon<f64>,
    bounds: Bounds,
    area_m2: f64,
    seen: Option<&'a MultiPolygon<f64>>,
}

impl<'a> From<&'a Cluster> for ComparedShape<'a> {
    fn from(c: &'a Cluster) -> Self {
        Self { shape: &c.shape, bounds: c.bounds, area_m2: c.area_m2, seen: c.seen.as_ref() }
    }
}

impl<'a> From<&'a Newcomer<'_>> for ComparedShape<'a> {
    fn from(n: &'a Newcomer<'_>) -> Self {
        Self { shape: n.shape, bounds: n.bounds, area_m2: n.area_m2, seen: n.seen.as_ref() }
    }
}

/// Intersection over union of a newcomer with what it may join; `None` where that is too little.
fn match_with(
    newcomer: &Newcomer<'_>,
    target: &ComparedShape<'_>,
    min_iou: f64,
    comparer: &mut Comparer,
) -> Option<f64> {
    let least_m2 = MIN_SHARED_M2.min(0.5 * newcomer.area_m2);
    let larger_m2 = newcomer.area_m2.max(target.area_m2);
    let is_whole = newcomer.seen.is_none() && target.seen.is_none();
    let most_m2 = shared_box_m2(newcomer.bounds, target.bounds).min(newcomer.area_m2).min(target.area_m2);
    if (is_whole && most_m2 < min_iou * larger_m2) || most_m2 < least_m2 {
        return None;
    }
    let limits: Vec<&MultiPolygon<f64>> = newcomer.seen.iter().chain(target.seen).collect();
    let found = comparer.overlap(newcomer.shape, target.shape, joint(newcomer.bounds, target.bounds), &limits);
    (found.shared_m2 >= least_m2 && found.iou() >= min_iou).then(|| found.iou())
}

/// The better of two matches; of equals the cluster that was there first.
fn better(best: Option<(usize, f64)>, other: (usize, f64)) -> Option<(usize, f64)> {
    let is_better = best.is_none_or(|(at, iou)| other.1 > iou || (other.1 == iou && other.0 < at));
    if is_better { Some(other) } else { best }
}

/// Clusters of candidates as they grow, with a search tree of them.
struct GrowingClusters {
    clusters: Vec<Cluster>,
    /// By their bounds; one that grew is in it several times, the last time with all of it.
    tree: Tree,
    min_iou: f64,
}

impl GrowingClusters {
    fn add(&mut self, batch: &[Newcomer<'_>], comparer: &mut Comparer) {
        let known = self.matches_with_clusters(batch);
        let mutual = self.matches_within(batch, &known);
        // What the batch's newcomers founded, and which clusters are no longer what they were compared as.
        let mut founded: Vec<Option<usize>> = vec![None; batch.len()];
        let mut changed: Vec<usize> = Vec::new();
        for (k, newcomer) in batch.iter().enumerate() {
            let of_batch = mutual[k].iter().filter_map(|&(t, iou)| Some((founded[t]?, iou)));
            let as_compared = known[k].iter().copied().chain(of_batch).filter(|(at, _)| !changed.contains(at));
            let mut best = as_compared.fold(None, better);
            for &at in &changed {
                let cluster = &self.clusters[at];
                let is_near = envelope(newcomer.bounds).intersects(&envelope(cluster.bounds));
                let iou = if is_near { match_with(newcomer, &cluster.into(), self.min_iou, comparer) } else { None };
                best = iou.map_or(best, |iou| better(best, (at, iou)));
            }
            match best {
                Some((at, _)) => {
                    if self.join(at, newcomer) && !changed.contains(&at) {
                        changed.push(at);
                    }
                }
                None => {
                    founded[k] = Some(self.clusters.len());
                    // A newcomer that lost its only match was compared by nobody.
                    if !known[k].is_empty() {
                        changed.push(self.clusters.len());
                    }
                    self.tree.insert(entry(newcomer.bounds, self.clusters.len()));
                    self.clusters.push(newcomer.cluster());
                }
            }
        }
    }

    /// For each newcomer the clusters that it may join.
    fn matches_with_clusters(&self, batch: &[Newcomer<'_>]) -> Vec<Vec<(usize, f64)>> {
        let of_one = |comparer: &mut Comparer, newcomer: &Newcomer<'_>| {
            let nearby = near(&self.tree, &envelope(newcomer.bounds)).into_iter();
            let compared = nearby
                .map(|at| Some((at, match_with(newcomer, &(&self.clusters[at]).into(), self.min_iou, comparer)?)));
            compared.flatten().collect()
        };
        batch.par_iter().map_init(Comparer::default, of_one).collect()
    }

    /// For each newcomer those before it in the batch that may found a cluster which it may join.
    fn matches_within(&self, batch: &[Newcomer<'_>], known: &[Vec<(usize, f64)>]) -> Vec<Vec<(usize, f64)>> {
        let founders = (0..batch.len()).filter(|&k| known[k].is_empty());
        let tree = Tree::bulk_load(founders.map(|k| entry(batch[k].bounds, k)).collect());
        let of_one = |comparer: &mut Comparer, k: usize| {
            let nearby = near(&tree, &envelope(batch[k].bounds)).into_iter().filter(|&t| t < k);
            let compared =
                nearby.map(|t| Some((t, match_with(&batch[k], &(&batch[t]).into(), self.min_iou, comparer)?)));
            compared.flatten().collect()
        };
        (0..batch.len()).into_par_iter().map_init(Comparer::default, of_one).collect()
    }

    /// Adds a newcomer to a cluster; whether that changes its shape: of what no view shows whole, the parts add up.
    fn join(&mut self, at: usize, newcomer: &Newcomer<'_>) -> bool {
        let cluster = &mut self.clusters[at];
        cluster.members.push(newcomer.position);
        let (Some(of_cluster), Some(of_newcomer)) = (&mut cluster.seen, &newcomer.seen) else { return false };
        *of_cluster = of_cluster.union(of_newcomer);
        cluster.shape = cluster.shape.union(newcomer.shape);
        cluster.area_m2 = cluster.shape.unsigned_area();
        cluster.bounds = joint(cluster.bounds, newcomer.bounds);
        self.tree.insert(entry(cluster.bounds, at));
        true
    }
}

#[cfg(test)]
mod tests {
    use geo_types::{Polygon, Rect};
    use proptest::prelude::*;

    use super::*;

    fn rectangle([x, y]: [f64; 2], [w, d]: [f64; 2]) -> Polygon<f64> {
        Rect::new((x, y), (x + w, y + d)).to_polygon()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        /// One by one is what the text above says; batches must not differ from it.
        #[test]
        fn batches_gather_what_taking_one_after_the_other_gathers(
            boxes in prop::collection::vec(((0.0..60.0_f64, 0.0..40.0_f64), (4.0..14.0_f64, 4.0..14.0_f64), 0..4_usize), 1..40)
        ) {
            let seen: Vec<SeenGround> = [[0.0, 0.0], [20.0, 0.0], [0.0, 15.0], [20.0, 15.0]]
                .map(|corner| SeenGround { area: rectangle(corner, [35.0, 30.0]) }).to_vec();
            let candidates: Vec<FootprintCandidate> = boxes.iter().filter_map(|&((x, y), (w, d), view)| {
                let whole = MultiPolygon::new(vec![rectangle([x.round(), y.round()], [w.round(), d.round()])]);
                let shape = whole.intersection(&MultiPolygon::new(vec![seen[view].area.clone()]));
                let is_cut = shape.unsigned_area() < whole.unsigned_area() - 0.01;
                let (weight, is_enough) = (1.0 + w.floor(), shape.unsigned_area() > 2.0);
                is_enough.then_some(FootprintCandidate { view, shape, weight, score: 1.0, is_cut })
            }).collect();
            let config = ConsensusConfig::default();
            let one_by_one = gather_in_batches(&candidates, &seen, &config, 1);
            for batch in [5, 512] {
                prop_assert_eq!(&gather_in_batches(&candidates, &seen, &config, batch), &one_by_one);
            }
        }
    }

    #[test]
    fn parts_that_borders_cut_off_add_up_within_one_batch() {
        // A hall of 60 m; two views see 40 m of it each, 20 m of them in common.
        let seen = [rectangle([-1.0, -10.0], [41.0, 40.0]), rectangle([20.0, -10.0], [41.0, 40.0])]
            .map(|area| SeenGround { area });
        let part = |view: usize, x: f64| FootprintCandidate {
            view,
            shape: rectangle([x, 0.0], [40.0, 10.0]).into(),
            weight: 1.0,
            score: 1.0,
            is_cut: true,
        };
        let found = gather(&[part(0, 0.0), part(1, 20.0)], &seen, &ConsensusConfig::default());
        assert_eq!(found.len(), 1);
        assert!((found[0].area_m2 - 600.0).abs() < 1e-6 && found[0].members == [0, 1]);
    }
}
