//! The boundary part: as a roof rises, its edges move over the image, and what they pass changes its depth at once.
//!
//! ```text
//! dL/dh = (2 / Den) ∮ v_n { [a(R_near) − L b] 1[near ∈ Ω] − [a(R_far) − L b] 1[far ∈ Ω] } ds
//! a(r) = ∫_Ω k l(e at depth r, q) dq,   b = ∫_Ω k dq,   Den = ∬_Ω² k
//! ```
//!
//! `e`: a point of the roof's edge in the image, `ds` along it; `v_n`: how fast the edge moves towards its far side,
//! pixels per metre of height; `k`: 1 where the pair has a vote. With a point in Ω the pairs it takes part in come or
//! go, which is what `L b` is for. Every roof edge is sampled, and both sides of it are traced: only where depth
//! jumps, or one side is not in Ω, does anything remain, so that no edge has to be classified. The view's
//! normalisation is held fixed.
//!
//! Source: Li et al., "Differentiable Monte Carlo Ray Tracing through Edge Sampling", TOG 37:222, 2018, for the idea;
//! the estimator of this loss is our own.

use glam::{DVec2, DVec3, Vec2};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::HeightSlope;
use crate::config::{OrdinalConfig, Region};
use crate::evidence::{Evidence, farness_at};
use crate::paper::ordinal::{ComparedPixels, OrderVote};
use crate::prior::DepthPrior;
use crate::render::PlacedCamera;
use crate::render::image::SceneTracer;
use crate::render::profile::FLATTEST_DZ;
use crate::scene::Scene;

/// Distance from an edge at which its two sides are looked at, pixels.
const BESIDE_PX: f64 = 0.01;
/// Depths that differ by less are one surface, metres.
const SAME_SURFACE_M: f32 = 0.1;
/// Half width of the differences that the motion of image points is taken from, metres.
const STEP_M: f64 = 0.01;

/// Input for the sampling of edges, besides the view's rays.
#[derive(Clone, Copy)]
pub struct EdgeInput<'a> {
    /// Buildings and ground, local frame.
    pub scene: &'a Scene,
    /// Camera of the view, local frame.
    pub placed: &'a PlacedCamera,
    /// Depth prior of the view.
    pub prior: &'a DepthPrior,
}

/// State of the loss: what the boundary is weighed against.
#[derive(Debug, Clone, Copy)]
pub struct BoundaryLoss {
    /// Mean cost of a pair, `L`.
    pub mean: f64,
    /// Share of random pairs that have a vote.
    pub vote_share: f64,
}

/// Slopes of the mean cost by the motion of every roof edge in view.
pub fn slopes(
    edges: &EdgeInput<'_>,
    evidence: &Evidence<'_>,
    roofs: &[f32],
    compared: &ComparedPixels,
    loss: BoundaryLoss,
    config: &OrdinalConfig,
    rng: &mut ChaCha8Rng,
) -> Vec<HeightSlope> {
    let scene = edges.scene;
    let boundary = Boundary {
        edges,
        tracer: SceneTracer::with_roofs(scene, roofs.to_vec()),
        capped: SceneTracer::new(scene, &vec![scene.bounds.max_m; scene.prisms.len()]),
        compared,
        loss,
        config,
        area_px: evidence.area_px(compared.rays.len()),
    };
    let mut slopes = Vec::new();
    let is_seen = |b: &usize| !evidence.rays_of(*b as u32).is_empty();
    for building in (0..scene.prisms.len()).filter(is_seen) {
        for (start, end) in scene.prisms[building].edges() {
            for i in 0..config.edge_points {
                let along = (i as f32 + rng.random::<f32>()) / config.edge_points as f32;
                let Some(point) = boundary.point(building, [start, end], along, roofs[building]) else { continue };
                slopes.push((building as u32, boundary.slope(&point, rng)));
            }
        }
    }
    slopes
}

/// A visible point of a roof's edge.
struct EdgePoint {
    /// Speed towards the far side times the length of edge it stands for, px² per metre of height.
    sweep: f64,
    /// The normalised prior at the point.
    prior: f32,
    /// Depth on the near side, and whether it is compared; the same on the far side.
    near: (f32, bool),
    far: (f32, bool),
}

struct Boundary<'a> {
    edges: &'a EdgeInput<'a>,
    tracer: SceneTracer<'a>,
    /// Every building at its greatest height.
    capped: SceneTracer<'a>,
    compared: &'a ComparedPixels,
    loss: BoundaryLoss,
    config: &'a OrdinalConfig,
    area_px: f64,
}

impl Boundary<'_> {
    /// A point of an edge, if it can be seen and something changes there.
    fn point(&self, building: usize, [start, end]: [Vec2; 2], along: f32, roof_z: f32) -> Option<EdgePoint> {
        let placed = self.edges.placed;
        let direction = (end - start).as_dvec2();
        let length_m = direction.length();
        let in_local = start.lerp(end, along).extend(roof_z).as_dvec3();
        let pixel = placed.project(in_local).filter(|p| placed.camera.contains(*p))?;
        let motion = |towards: DVec3| {
            let step = STEP_M * towards;
            Some((placed.project(in_local + step)? - placed.project(in_local - step)?) / (2.0 * STEP_M))
        };
        let (tangent, speed) = (motion((direction / length_m).extend(0.0))?, motion(DVec3::Z)?);
        let normal = tangent.perp().try_normalize()?;
        let [left, right] = [1.0, -1.0].map(|side| (side, self.look(pixel + side * BESIDE_PX * normal)));
        let (left, right) = ((left.0, left.1?), (right.0, right.1?));
        let ((_, near), (far_side, far)) = if left.1.depth <= right.1.depth { (left, right) } else { (right, left) };
        let edge_depth = (in_local - placed.eye()).dot(placed.axis()) as f32;
        let is_visible = near.building == Some(building) && (near.depth - edge_depth).abs() < SAME_SURFACE_M;
        let changes = far.depth - near.depth > SAME_SURFACE_M || near.is_compared != far.is_compared;
        if !(is_visible && changes) {
            return None;
        }
        let prior = self.compared.of_prior.apply(farness_at(placed, self.edges.prior, pixel));
        let length_px = tangent.length() * length_m / self.config.edge_points as f64;
        prior.is_finite().then(|| EdgePoint {
            sweep: far_side * normal.dot(speed) * length_px,
            prior,
            near: (near.depth, near.is_compared),
            far: (far.depth, far.is_compared),
        })
    }

    /// The look at a position of the image.
    fn look(&self, pixel: DVec2) -> Option<EdgeSide> {
        let ray = self.edges.placed.ray(pixel)?;
        let mut scratch = Vec::new();
        let (depth, face) = self.tracer.trace(&ray, &mut scratch);
        let building = face.building().map(crate::ids::BuildingIdx::at);
        let is_compared = ray.direction.z <= FLATTEST_DZ
            && depth.is_finite()
            && match self.config.region {
                Region::Buildings => building.is_some(),
                Region::BuildingsAndGround => self.capped.trace(&ray, &mut scratch).1.building().is_some(),
            };
        Some(EdgeSide { depth: if depth.is_nan() { f32::INFINITY } else { depth }, building, is_compared })
    }

    /// The loss's slope by the motion of one point: against random partners out of Ω.
    fn slope(&self, point: &EdgePoint, rng: &mut ChaCha8Rng) -> f64 {
        let compared = self.compared;
        let (mut votes, mut near, mut far) = (0.0, 0.0, 0.0);
        for _ in 0..self.config.edge_partners {
            let q = rng.random_range(0..compared.rays.len());
            let Some(vote) = OrderVote::of(point.prior, compared.prior[q], self.config) else { continue };
            let cost = |depth: f32| f64::from(vote.cost(compared.of_rendered.contrast(depth, compared.rendered[q])));
            votes += 1.0;
            near += if point.near.1 { cost(point.near.0) } else { 0.0 };
            far += if point.far.1 { cost(point.far.0) } else { 0.0 };
        }
        let of_side = |costs: f64, (_, is_compared): (f32, bool)| {
            if is_compared { (costs - self.loss.mean * votes) / self.config.edge_partners as f64 } else { 0.0 }
        };
        let jump = of_side(near, point.near) - of_side(far, point.far);
        2.0 / (self.area_px * self.loss.vote_share) * point.sweep * jump
    }
}

/// One side of an edge.
#[derive(Debug, Clone, Copy)]
struct EdgeSide {
    /// z-depth, metres; `+∞` where the ray meets nothing.
    depth: f32,
    building: Option<usize>,
    is_compared: bool,
}
