//! One step of the ordinal optimiser: the loss of one view, and its derivative by the buildings' heights from the
//! parts of [`crate::paper::gradient`].

use std::collections::BTreeMap;
use std::ops::AddAssign;

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::config::{Gradient, MadGradient, OrdinalConfig, Region};
use crate::evidence::Evidence;
use crate::ordinal::{DepthOrder, Normaliser};
use crate::paper::gradient::{HeightSlope, central_difference, edge_sampled, interior, scale, sum_by_building};

/// Loss and derivative of one view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewStep {
    /// Mean cost over the pairs that have a vote.
    pub loss: f64,
    /// Pairs that have a vote.
    pub n_pairs: usize,
    /// Pairs among these that cost something.
    pub n_active: usize,
    /// `(building, dL/dh)` by metre, each building once, ascending.
    pub gradient: Vec<(u32, f64)>,
}

/// One view and the heights as they stand.
pub struct StepInput<'a> {
    /// Rays and prior of the view.
    pub evidence: &'a Evidence<'a>,
    /// Roof levels in the local frame, one per building.
    pub roofs: &'a [f32],
    /// Half width of central differences, metres.
    pub difference_m: f32,
    /// Input that [`Gradient::EdgeSampled`] needs besides; without it, it is the interior part alone.
    pub edges: Option<edge_sampled::EdgeInput<'a>>,
}

/// The pixels of one view that are compared, with both depths normalised over them.
pub(crate) struct ComparedPixels {
    /// Ray of each pixel, ascending.
    pub rays: Vec<u32>,
    /// Rendered z-depth of each pixel, metres.
    pub rendered: Vec<f32>,
    /// Which building it shows.
    pub building: Vec<Option<u32>>,
    /// Which building's roof it is; its depth moves with the height.
    pub roof_of: Vec<Option<u32>>,
    /// Normalised prior, growing away from the camera.
    pub prior: Vec<f32>,
    /// Brings the prior to its spread in the view.
    pub of_prior: Normaliser,
    /// Brings rendered depth to its spread in the view.
    pub of_rendered: Normaliser,
}

/// Order of two pixels in the prior, and the cost of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OrderVote {
    pub order: DepthOrder,
    margin: f32,
}

impl OrderVote {
    /// From two normalised priors; `None` where their contrast is too weak.
    pub fn of(d_p: f32, d_q: f32, config: &OrdinalConfig) -> Option<Self> {
        let order = DepthOrder::from_prior(d_p, d_q, config.min_contrast)?;
        let margin = config.margin;
        Some(Self { order, margin })
    }

    /// Cost where both pixels are rendered at one depth: an order that is no better than none.
    pub fn cost_of_none(self) -> f32 {
        self.cost(0.0)
    }

    /// Cost of a normalised rendered contrast.
    pub fn cost(self, rendered_contrast: f32) -> f32 {
        self.order.cost(rendered_contrast, self.margin)
    }
}

/// Two compared pixels with a vote.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PixelPair {
    pub p: usize,
    pub q: usize,
    pub vote: OrderVote,
}

impl PixelPair {
    /// Cost for the depths as they are rendered.
    pub fn cost(&self, compared: &ComparedPixels) -> f32 {
        self.vote.cost(compared.contrast(self))
    }
}

/// Loss and derivative of one view; `None` where nothing can be compared.
#[must_use]
pub fn view_step(input: &StepInput<'_>, config: &OrdinalConfig, rng: &mut ChaCha8Rng) -> Option<ViewStep> {
    let StepInput { evidence, roofs, difference_m, .. } = *input;
    let compared = ComparedPixels::new(evidence, roofs, config.region)?;
    let pairs = draw_pairs(&compared, config, rng);
    if pairs.is_empty() {
        return None;
    }
    let costs: Vec<f32> = pairs.iter().map(|pair| pair.cost(&compared)).collect();
    let loss = costs.iter().map(|cost| f64::from(*cost)).sum::<f64>() / pairs.len() as f64;
    let is_exact = config.mad_gradient == MadGradient::Exact;
    let by_pair = match config.gradient {
        Gradient::Interior | Gradient::EdgeSampled => interior::slopes(evidence, &compared, &pairs),
        Gradient::CentralDifference if is_exact => Vec::new(),
        Gradient::CentralDifference => central_difference::slopes(evidence, roofs, &compared, &pairs, difference_m),
    };
    let mut gradient = sum_by_building(by_pair, pairs.len());
    let mut add =
        |part: Vec<HeightSlope>| gradient = sum_by_building(gradient.iter().copied().chain(part).collect(), 1);
    if is_exact {
        add(match config.gradient {
            Gradient::CentralDifference => {
                central_difference::slopes_with_scale(evidence, roofs, &compared, &pairs, difference_m)
            }
            Gradient::Interior | Gradient::EdgeSampled => scale::slopes(evidence, &compared, &pairs),
        });
    }
    if let (Gradient::EdgeSampled, Some(edges)) = (config.gradient, &input.edges) {
        let present = edge_sampled::BoundaryLoss { mean: loss, vote_share: pairs.len() as f64 / config.n_pairs as f64 };
        add(edge_sampled::slopes(edges, evidence, roofs, &compared, present, config, rng));
    }
    let n_active = costs.iter().filter(|cost| **cost > 0.0).count();
    Some(ViewStep { loss, n_pairs: pairs.len(), n_active, gradient })
}

/// Cost of pairs, beside that of every one rendered at one depth.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Costs {
    /// Number of pairs compared.
    pub n: usize,
    paid: f64,
    of_none: f64,
    /// Cost if the building were lower, and higher.
    moved: [f64; 2],
}

impl AddAssign for Costs {
    fn add_assign(&mut self, other: Self) {
        *self = Self {
            n: self.n + other.n,
            paid: self.paid + other.paid,
            of_none: self.of_none + other.of_none,
            moved: [0, 1].map(|way| self.moved[way] + other.moved[way]),
        };
    }
}

impl Costs {
    fn of(pair: &PixelPair, compared: &ComparedPixels) -> Self {
        let paid = f64::from(pair.cost(compared));
        Self { n: 1, paid, of_none: f64::from(pair.vote.cost_of_none()), moved: [paid; 2] }
    }

    /// By how much a pair would cost more if the building were lower, and if it were higher, mean.
    pub fn rises(&self) -> [f64; 2] {
        self.moved.map(|moved| (moved - self.paid) / self.n as f64)
    }

    /// Whether the order is no better than none; not where nothing was compared.
    pub fn are_no_better_than_none(&self) -> bool {
        self.of_none > 0.0 && self.paid >= self.of_none
    }
}

/// Cost of random pairs of one view that have a vote: all of them, and by building those that show it. Each building is tried lower and
/// higher too, by `moves_m`, metres. `None` where nothing can be compared.
pub(crate) fn costs(
    evidence: &Evidence<'_>,
    roofs: &[f32],
    moves_m: &[f32],
    config: &OrdinalConfig,
    rng: &mut ChaCha8Rng,
) -> Option<(Costs, BTreeMap<u32, Costs>)> {
    let compared = ComparedPixels::new(evidence, roofs, config.region)?;
    let (mut of_view, mut of_building) = (Costs::default(), BTreeMap::<u32, Costs>::new());
    for pair in draw_pairs(&compared, config, rng) {
        let as_found = Costs::of(&pair, &compared);
        of_view += as_found;
        let [of_p, of_q] = [pair.p, pair.q].map(|at| compared.building[at]);
        for building in of_p.into_iter().chain(of_q.filter(|_| of_q != of_p)) {
            let (roof_z, by_m) = (roofs[building as usize], moves_m[building as usize]);
            let moved = [roof_z - by_m, roof_z + by_m].map(|roof_z| {
                let depth =
                    |at: usize| evidence.profiles.sight_with(compared.rays[at] as usize, roofs, building, roof_z).depth;
                let cost = f64::from(pair.vote.cost(compared.of_rendered.contrast(depth(pair.p), depth(pair.q))));
                // Behind a lowered building may lie ground that is not known.
                if cost.is_finite() { cost } else { as_found.paid }
            });
            *of_building.entry(building).or_default() += Costs { moved, ..as_found };
        }
    }
    Some((of_view, of_building))
}

/// Random pairs of compared pixels; those without a vote are left out.
pub(crate) fn draw_pairs(compared: &ComparedPixels, config: &OrdinalConfig, rng: &mut ChaCha8Rng) -> Vec<PixelPair> {
    let Some(n) = u32::try_from(compared.rays.len()).ok().filter(|&n| n >= 2) else { return Vec::new() };
    let draw = |_| {
        let (p, q) = (rng.random_range(0..n) as usize, rng.random_range(0..n) as usize);
        Some(PixelPair { p, q, vote: OrderVote::of(compared.prior[p], compared.prior[q], config)? })
    };
    (0..config.n_pairs).filter_map(draw).collect()
}

impl ComparedPixels {
    pub fn new(evidence: &Evidence<'_>, roofs: &[f32], region: Region) -> Option<Self> {
        let profiles = evidence.profiles;
        let no_scale = Normaliser { median: 0.0, scale: 1.0 };
        let mut compared = Self {
            rays: Vec::new(),
            rendered: Vec::new(),
            building: Vec::new(),
            roof_of: Vec::new(),
            prior: Vec::new(),
            of_prior: no_scale,
            of_rendered: no_scale,
        };
        for ray_idx in 0..profiles.rays.len() {
            let prior = evidence.farness(ray_idx);
            let sight = profiles.sight(ray_idx, roofs);
            let is_compared = match region {
                Region::Buildings => sight.building.is_some(),
                Region::BuildingsAndGround => !profiles.intervals(ray_idx).is_empty() && sight.depth.is_finite(),
            };
            if is_compared && prior.is_finite() {
                compared.rays.push(ray_idx as u32);
                compared.rendered.push(sight.depth);
                compared.building.push(sight.building);
                compared.roof_of.push(sight.building.filter(|_| sight.is_roof));
                compared.prior.push(prior);
            }
        }
        compared.of_prior = Normaliser::from_values(&compared.prior)?;
        compared.prior.iter_mut().for_each(|d| *d = compared.of_prior.apply(*d));
        compared.of_rendered = Normaliser::from_values(&compared.rendered)?;
        Some(compared)
    }

    /// Normalised rendered contrast of a pair.
    pub fn contrast(&self, pair: &PixelPair) -> f32 {
        self.of_rendered.contrast(self.rendered[pair.p], self.rendered[pair.q])
    }
}
