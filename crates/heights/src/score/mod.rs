//! How well one height of one building explains the prior in one view, blind to what the prior does not know.
//!
//! ```text
//! W      rays that can see the building below the greatest height asked for, and those close to them; without those
//!        that show something else which stands higher than that
//! p      prior's inverse depth,   v(h) = 1 / R(h)   rendered inverse depth
//! ρ(h) = corr(p⊥, v⊥)             ⊥: what [1, x, y] explains over W is taken out of both
//! ```
//!
//! Taking out `[1, x, y]` makes ρ blind to the prior's unknown scale, shift and slow drift. What the ray sees without
//! the building does not depend on `h`, so a height costs one pass over the building's own rays.

pub(crate) mod intervals;
pub(crate) mod peak;
pub(crate) mod unmodelled;

use crate::config::{LOCAL_DILATE_PX, SearchConfig};
use crate::evidence::Evidence;
use crate::evidence::calibrate::Calibration;
use crate::evidence::vegetation;
use crate::ray::Ray;
use crate::render::profile::{ProfileRay, Stops};
use crate::scene::Prism;
use crate::score::intervals::{Intervals, PackedInterval, RoofIntersection, Sums};
use crate::simd::LANES;
use crate::stats;

/// Fewer rays than this say nothing about three plane terms and a correlation.
const MIN_RAYS: usize = 12;
/// Residual variance, relative to the window's, below which a view is flat and has no vote.
const FLAT: f64 = 1e-9;
/// Height from which something that stands out from the ground around a building is not in the scene.
pub(crate) const UNMODELLED_M: f64 = 3.0;
/// The same in standard deviations of the prior on open ground.
const UNMODELLED_SIGMAS: f64 = 3.0;
/// Rays that tell what is open ground, about: evenly spaced ones of all around.
const N_OPEN: usize = 500;

/// One building in one view.
#[derive(Debug)]
pub struct Window {
    intervals: Intervals,
    rays: Vec<WindowRay>,
    calibration: Option<Calibration>,
    /// Height of the building's ground above the camera, metres.
    ground_above_eye_m: f32,
    /// Inverse of the Gram matrix of `[1, x, y]`.
    gram_inverse: [[f64; 3]; 3],
    p_norm_squared: f64,
    base: Sums,
    /// Share of the surroundings that look at something the scene does not have, 0..1.
    pub unmodelled: f32,
}

/// A ray of a window.
#[derive(Debug, Clone, Copy)]
struct WindowRay {
    /// Position in the view.
    ray: u32,
    /// Image position, −1 to 1 over the window.
    x: f32,
    y: f32,
    /// Scaled inverse depth without the building.
    v: f32,
    /// The prior, and what `[1, x, y]` leaves of it.
    raw: f32,
    p: f32,
}

/// Questions that will be asked of a window, and so the rays it takes.
///
/// The less it holds besides the building, the less it answers to: a tower behind a pavilion varies more in depth than the
/// pavilion, and errors of the prior in its relief outweigh all that the pavilion's height changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scope {
    /// Heights above the building's ground up to this will be asked for, metres; `None`: any height.
    pub up_to_m: Option<f32>,
    /// Whether what is green and stands above the ground is no part of the building.
    pub leave_out_crowns: bool,
}

impl Window {
    /// Prepares a building in a view, with the others' roofs where `stops` has them. `ground_z` is the building's own
    /// ground, local frame. `None` if too few rays have a prior, or the prior is flat here.
    #[must_use]
    pub fn new(
        evidence: &Evidence<'_>,
        building: u32,
        ground_z: f32,
        stops: &Stops,
        calibration: Option<Calibration>,
        scope: Scope,
    ) -> Option<Self> {
        let profiles = evidence.profiles;
        let top_z = scope.up_to_m.map_or(f32::INFINITY, |up_to_m| ground_z + up_to_m);
        let own_rays = evidence.rays_below(building, top_z);
        let mut rays = match scope.up_to_m {
            None => evidence.rays_around_building(building).to_vec(),
            Some(_) => evidence.rays_around(&own_rays, LOCAL_DILATE_PX),
        };
        let unmodelled = match calibration {
            Some(calibration) if calibration.is_in_metres => unmodelled::leave_out(evidence, &own_rays, &mut rays),
            Some(calibration) => leave_out_unmodelled(evidence, &own_rays, stops, calibration, &mut rays),
            None => 0.0,
        };
        if let Some(calibration) = calibration.filter(|_| scope.leave_out_crowns) {
            vegetation::leave_out(evidence, calibration, &mut rays);
        }
        // What each ray sees without the building.
        let mut kept: Vec<WindowRay> = Vec::with_capacity(rays.len());
        let mut own: Vec<(usize, u32, f32)> = Vec::with_capacity(own_rays.len());
        let mut is_own = within(&own_rays);
        let (mut low, mut high) = ([u16::MAX; 2], [0; 2]);
        let mut depths = 0.0;
        for r in rays {
            let (at, is_own) = (r as usize, is_own(r));
            let depth = if is_own { profiles.depth_without(at, stops, building) } else { stops.depth(at) };
            let ProfileRay { pixel, ground, .. } = profiles.rays[at];
            if depth >= ground || profiles.level(at, depth) < top_z {
                own.extend(is_own.then_some((kept.len(), r, depth)));
                let [x, y] = pixel.map(f32::from);
                kept.push(WindowRay { ray: r, x, y, v: depth, raw: evidence.nearness[at], p: 0.0 });
                for axis in 0..2 {
                    (low[axis], high[axis]) = (low[axis].min(pixel[axis]), high[axis].max(pixel[axis]));
                }
                depths += f64::from(depth);
            }
        }
        if kept.len() < MIN_RAYS {
            return None;
        }
        let reference = (depths / kept.len() as f64) as f32;
        let [middle, half] =
            [1.0, -1.0].map(|sign| [0, 1].map(|axis| 0.5 * (f32::from(high[axis]) + sign * f32::from(low[axis]))));
        for ray in &mut kept {
            ray.x = (ray.x - middle[0]) / half[0].max(1.0);
            ray.y = (ray.y - middle[1]) / half[1].max(1.0);
            ray.v = reference / ray.v - 1.0;
        }
        let PlaneResiduals { gram_inverse, norm_squared: p_norm_squared } = PlaneResiduals::taken_out(&mut kept)?;

        let mut window = Self {
            intervals: Intervals::relative_to(reference, own.len()),
            rays: kept,
            calibration,
            ground_above_eye_m: ground_z - profiles.eye_z,
            gram_inverse,
            p_norm_squared,
            base: Sums::default(),
            unmodelled,
        };
        for (at, r, depth) in own {
            let of_ray = profiles.intervals(r as usize).iter().filter(|c| c.building == building);
            window.push(at, profiles.rays[r as usize].dz, depth, of_ray.map(|c| (c.enter, c.leave)));
        }
        window.base = window.sums_without();
        Some(window)
    }

    /// Adds the stretches over the building of a ray that rises by `dz` per metre of z-depth, in order, each by where it enters and leaves
    /// the footprint; without the building the ray ends at `depth`.
    fn push(&mut self, at: usize, dz: f32, depth: f32, stretches: impl Iterator<Item = (f32, f32)>) {
        let per_metre = dz.recip();
        let WindowRay { x, y, v, raw, p, .. } = self.rays[at];
        let lifted = self.calibration.map_or(f32::NAN, |c| c.inverse_depth(raw));
        let mut after = f32::NEG_INFINITY;
        for (enter, leave) in stretches.take_while(|(enter, _)| *enter < depth) {
            let before = leave.min(depth);
            self.intervals.push(&PackedInterval {
                ray: at as u32,
                roof_at_zero: self.ground_above_eye_m * per_metre,
                per_metre,
                after,
                before,
                enter,
                v,
                p,
                x,
                y,
                lifted: self.intervals.reference() * lifted - 1.0,
            });
            after = before;
        }
    }

    /// Puts another footprint in the building's place, where the rays end at `depths` without the building.
    pub(crate) fn put(&mut self, prism: &Prism, rays: &[Ray], depths: &[f32]) {
        let reference = self.intervals.reference();
        self.intervals = Intervals::relative_to(reference, self.intervals.n());
        self.rays.iter_mut().zip(depths).for_each(|(ray, depth)| ray.v = reference / depth - 1.0);
        let (circle, mut over) = (prism.circle(), Vec::new());
        for (at, (ray, &depth)) in rays.iter().zip(depths).enumerate().filter(|(_, (ray, _))| circle.is_crossed(ray)) {
            over.clear();
            prism.intervals(ray, &mut over);
            self.push(at, ray.direction.z, depth, over.iter().map(|stretch| (stretch.enter.max(0.0), stretch.leave)));
        }
        self.base = self.sums_without();
    }

    /// The sums where the building is not there.
    fn sums_without(&self) -> Sums {
        let mut base = Sums::default();
        [base.v, base.vx, base.vy, base.vp, base.vv] = sums(&self.rays, |ray| {
            let value = f64::from(ray.v);
            [1.0, f64::from(ray.x), f64::from(ray.y), f64::from(ray.p), value].map(|k| value * k)
        });
        base
    }

    /// Rays that are compared, by their position in the view.
    pub(crate) fn rays(&self) -> impl Iterator<Item = u32> + '_ {
        self.rays.iter().map(|ray| ray.ray)
    }

    /// Rays that are compared.
    pub(crate) fn n_rays(&self) -> usize {
        self.rays.len()
    }

    /// The weight of the agreement here, where it has `weight` among surroundings that the scene knows.
    pub(crate) fn agreement_weight(&self, weight: f32, config: &SearchConfig) -> f64 {
        f64::from(weight + config.unmodelled_agreement_weight * self.unmodelled)
    }

    /// ρ and weighted agreement for one height above ground, metres; ρ is 0 where the view cannot tell.
    #[must_use]
    pub fn score(&self, height_m: f32, agreement_weight: f64) -> f64 {
        let sums = self.intervals.at(height_m);
        self.correlation(&sums) + agreement_weight * sums.agreement()
    }

    /// The same for a roof of any form over [`Self::own_stretches`]. `height_m` sets the agreement's tolerance.
    pub(crate) fn score_where(&self, weight: f64, height_m: f32, form: &impl RoofIntersection) -> f64 {
        let sums = self.intervals.with(height_m, form);
        self.correlation(&sums) + weight * sums.agreement()
    }

    /// The building's own intervals: ray, and z-depths between which it can stop the ray.
    pub(crate) fn own_stretches(&self) -> impl Iterator<Item = (u32, f32, f32)> + '_ {
        self.intervals.iter().map(|(ray, enter, before)| (self.rays[ray as usize].ray, enter, before))
    }

    /// Linear correlation, from what a roof changes.
    fn correlation(&self, change: &Sums) -> f64 {
        let q = self.plane_sums(change);
        let vv = self.base.vv + change.vv;
        let v_norm_squared = vv - dot(&q, &apply(&self.gram_inverse, &q));
        if v_norm_squared <= FLAT * vv.max(f64::MIN_POSITIVE) {
            return 0.0;
        }
        (self.base.vp + change.vp) / (v_norm_squared * self.p_norm_squared).sqrt()
    }

    fn plane_sums(&self, change: &Sums) -> [f64; 3] {
        [self.base.v + change.v, self.base.vx + change.vx, self.base.vy + change.vy]
    }
}

/// Leaves out the rays around a building that look, by the calibrated prior, at something that the scene does not have
/// there: a building without a footprint, a tree; says which share of those around it that was. What stands out is told
/// against the open ground close by, so that a slow drift of the prior does no harm.
fn leave_out_unmodelled(
    evidence: &Evidence<'_>,
    own: &[u32],
    stops: &Stops,
    calibration: Calibration,
    rays: &mut Vec<u32>,
) -> f32 {
    let mut is_own = within(own);
    let excess_m = |&ray: &u32| excess_m(evidence, stops, calibration, ray as usize);
    let mut around: Vec<f32> = Vec::with_capacity(rays.len());
    around.extend(rays.iter().filter(|&&r| !is_own(r)).map(excess_m));
    let Some(limit) = limit_m(&around) else { return 0.0 };
    let n_before = rays.len();
    // The building's own rays are left alone.
    let (mut is_own, mut of_around) = (within(own), around.iter());
    rays.retain(|&r| is_own(r) || of_around.next().is_some_and(|excess| f64::from(*excess) <= limit));
    (n_before - rays.len()) as f32 / around.len() as f32
}

/// Share of a view's rays beside all footprints that look, by the calibrated prior, at something that the scene does not have.
pub(crate) fn unmodelled_share(evidence: &Evidence<'_>, stops: &Stops, calibration: Calibration) -> f32 {
    let profiles = evidence.profiles;
    let is_open = |&ray: &usize| evidence.is_known(ray) && profiles.intervals(ray).is_empty();
    let open = (0..profiles.rays.len()).filter(is_open);
    let open: Vec<f32> = open.map(|ray| excess_m(evidence, stops, calibration, ray)).collect();
    let Some(limit) = limit_m(&open) else { return 0.0 };
    open.iter().filter(|excess| f64::from(**excess) > limit).count() as f32 / open.len() as f32
}

/// How far above what is rendered the prior lies, metres.
fn excess_m(evidence: &Evidence<'_>, stops: &Stops, calibration: Calibration, ray: usize) -> f32 {
    let seen = calibration.inverse_depth(evidence.nearness[ray]).max(f32::MIN_POSITIVE).recip();
    (seen - stops.depth(ray)) * evidence.profiles.rays[ray].dz
}

/// Excess from which something is not in the scene, among those of open ground; `None` where these are too few.
fn limit_m(open: &[f32]) -> Option<f64> {
    let mut some: Vec<f32> = open.iter().copied().step_by((open.len() / N_OPEN).max(1)).collect();
    let (level, sigma) = far_side(&mut some)?;
    Some(level + (UNMODELLED_SIGMAS * sigma).max(UNMODELLED_M))
}

/// Whether a ray is one of some rays, asked in ascending order.
pub(crate) fn within(ascending: &[u32]) -> impl FnMut(u32) -> bool + '_ {
    let mut rest = ascending;
    move |ray| {
        while rest.first().is_some_and(|&first| first < ray) {
            rest = &rest[1..];
        }
        rest.first() == Some(&ray)
    }
}

/// Several sums over rays, side by side, each in [`WAYS`] parts: a sum in its order waits for itself.
fn sums<const N: usize>(rays: &[WindowRay], terms: impl Fn(&WindowRay) -> [f64; N]) -> [f64; N] {
    const WAYS: usize = 4;
    let mut parts = [[0.0; WAYS]; N];
    let mut add = |way: usize, ray: &WindowRay| {
        parts.iter_mut().zip(terms(ray)).for_each(|(part, term)| part[way] += term);
    };
    let (blocks, rest) = rays.as_chunks::<WAYS>();
    blocks.iter().for_each(|block| block.iter().enumerate().for_each(|(way, ray)| add(way, ray)));
    rest.iter().enumerate().for_each(|(way, ray)| add(way, ray));
    parts.map(|part| part.into_iter().sum())
}

/// Value around which the far side of some residuals gathers, and its standard deviation: what is not modelled is nearer, so only the
/// near side is heavy. Tukey's biweight from the first third on, with the spread measured below the present value. Sorts the values.
fn far_side(values: &mut [f32]) -> Option<(f64, f64)> {
    const ROUNDS: usize = 8;
    const CUT_OFF: f64 = 3.0;
    if values.len() < MIN_RAYS {
        return None;
    }
    values.sort_unstable_by(f32::total_cmp);
    let mut level = stats::quantile_of_sorted(values, 1.0 / 3.0)?;
    let mut sigma = 0.0;
    for _ in 0..ROUNDS {
        let below = &values[..values.partition_point(|v| f64::from(*v) <= level)];
        sigma = stats::SIGMA_PER_MAD * (level - stats::quantile_of_sorted(below, 0.5)?);
        if sigma <= 0.0 {
            break;
        }
        let reach = CUT_OFF * sigma;
        let first = values.partition_point(|v| f64::from(*v) < level - reach);
        let end = values.partition_point(|v| f64::from(*v) <= level + reach);
        level += reach * weighted_mean(&values[first..end], level as f32, reach as f32);
    }
    Some((level, sigma))
}

/// Mean of `(value − middle) / reach` with the weights of Tukey's biweight, of values within the reach.
fn weighted_mean(values: &[f32], middle: f32, reach: f32) -> f64 {
    let (mut sums, mut weights) = ([0.0_f32; LANES], [0.0_f32; LANES]);
    let mut add = |lane: usize, value: f32| {
        let off = (value - middle) / reach;
        let weight = (1.0 - off * off).max(0.0).powi(2);
        sums[lane] += weight * off;
        weights[lane] += weight;
    };
    let (blocks, rest) = values.as_chunks::<LANES>();
    blocks.iter().for_each(|block| (0..LANES).for_each(|lane| add(lane, block[lane])));
    rest.iter().enumerate().for_each(|(lane, &value)| add(lane, value));
    let [sum, weight] = [sums, weights].map(|of_lanes| of_lanes.into_iter().map(f64::from).sum::<f64>());
    sum / weight
}

/// Parts of a window's prior that `[1, x, y]` does not explain.
struct PlaneResiduals {
    /// Inverse of the Gram matrix of `[1, x, y]`.
    gram_inverse: [[f64; 3]; 3],
    norm_squared: f64,
}

impl PlaneResiduals {
    /// Sets each ray's residual; `None` where all positions are in one line, or nothing is left of the prior.
    fn taken_out(rays: &mut [WindowRay]) -> Option<Self> {
        let count = rays.len() as f64;
        let [sum] = sums(rays, |ray| [f64::from(ray.raw)]);
        let mean = sum / count;
        let [sx, sy, xx, xy, yy, c_sum, cx, cy, squares] = sums(rays, |ray| {
            let (x, y, c) = (f64::from(ray.x), f64::from(ray.y), f64::from(ray.raw) - mean);
            [x, y, x * x, x * y, y * y, c, c * x, c * y, c * c]
        });
        let scale = squares.sqrt();
        let gram = glam::DMat3::from_cols_array(&[count, sx, sy, sx, xx, xy, sy, xy, yy]);
        let is_line = gram.determinant().abs() < 1e-9 * count * count * count;
        if is_line || !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        let inverse = gram.inverse();
        let gram_inverse = [inverse.x_axis, inverse.y_axis, inverse.z_axis].map(|axis| axis.to_array());
        let plane = apply(&gram_inverse, &[c_sum, cx, cy]);
        for ray in &mut *rays {
            let explained = plane[0] + plane[1] * f64::from(ray.x) + plane[2] * f64::from(ray.y);
            ray.p = ((f64::from(ray.raw) - mean - explained) / scale) as f32;
        }
        let [norm_squared] = sums(rays, |ray| [f64::from(ray.p).powi(2)]);
        (norm_squared > FLAT).then_some(Self { gram_inverse, norm_squared })
    }
}

fn apply(m: &[[f64; 3]; 3], v: &[f64; 3]) -> [f64; 3] {
    [dot(&m[0], v), dot(&m[1], v), dot(&m[2], v)]
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ground with some noise, of which every third ray shows a tree.
    fn open_ground(n: usize) -> Vec<f32> {
        let noise = |i: usize| ((i * 7919 % 1000) as f32 / 999.0 - 0.5) * 1.2;
        (0..n).map(|i| noise(i) + if i % 3 == 0 { 6.0 } else { 0.4 }).collect()
    }

    #[test]
    fn the_far_side_is_the_ground_between_trees() {
        let (level, sigma) = far_side(&mut open_ground(900)).expect("enough rays");
        assert!((level - 0.4).abs() < 0.1 && (0.2..0.7).contains(&sigma), "{level} {sigma}");
    }

    #[test]
    fn evenly_spaced_rays_tell_open_ground_as_all_do() {
        let open = open_ground(20 * N_OPEN + 7);
        let (of_some, of_all) = (limit_m(&open), far_side(&mut open.clone()));
        let (level, _) = of_all.expect("enough rays");
        assert!((of_some.expect("enough rays") - level - UNMODELLED_M).abs() < 0.05, "{of_some:?} {level}");
    }

    #[test]
    fn a_window_s_prior_is_left_without_its_plane() {
        let at = |i: u16| (f32::from(i % 8) / 3.5 - 1.0, f32::from(i / 8) / 3.5 - 1.0);
        let step = |x: f32, y: f32| if x * x + y * y < 0.4 { 1.0 } else { 0.0 };
        let ray = |i: u16| {
            let (x, y) = at(i);
            WindowRay { ray: u32::from(i), x, y, v: 0.0, raw: 5.0 + 2.0 * x - 3.0 * y + step(x, y), p: 0.0 }
        };
        let mut rays: Vec<WindowRay> = (0..64).map(ray).collect();
        let plane = PlaneResiduals::taken_out(&mut rays).expect("a step is left");
        let [sum, along_x, along_y, squares] = sums(&rays, |r| [r.p, r.p * r.x, r.p * r.y, r.p * r.p].map(f64::from));
        assert!([sum, along_x, along_y].iter().all(|left| left.abs() < 1e-5), "{sum} {along_x} {along_y}");
        assert!((squares - plane.norm_squared).abs() < 1e-6);
        let mut level: Vec<WindowRay> = rays.iter().map(|r| WindowRay { raw: 1.0 + r.x, ..*r }).collect();
        assert!(PlaneResiduals::taken_out(&mut level).is_none(), "nothing but the plane");
    }
}
