//! How well one height of one building explains the prior in one view, blind to what the prior does not know.
//!
//! ```text
//! W      rays that can see the building below its greatest height, and those close to them
//! p      prior's inverse depth,   v(h) = 1 / R(h)   rendered inverse depth
//! ρ(h) = corr(p⊥, v⊥)             ⊥: what [1, x, y] explains over W is taken out of both
//! ```
//!
//! Taking out `[1, x, y]` makes ρ blind to the prior's unknown scale, shift and slow drift. What the ray sees without
//! the building does not depend on `h`, so a height costs one pass over the building's own rays.

use super::calibrate::Calibration;
use super::evidence::Evidence;
use crate::render::profile::Stops;
use crate::stats;

/// Fewer rays than this say nothing about three plane terms and a correlation.
const MIN_RAYS: usize = 12;
/// Residual variance, relative to the window's, below which a view is flat and has no vote.
const FLAT: f64 = 1e-9;
/// Height tolerance of [`Window::agreement`]: a fixed part, metres, and a share of the height (a prior's relief is off
/// by some 10 %).
const AGREEMENT_M: f32 = 0.7;
const AGREEMENT_SHARE: f32 = 0.1;
/// So many rays that agree with nothing are added to a roof's own: a roof of few rays has little to say.
const FEW_RAYS: f64 = 2.0;
/// What stands out from the ground around a building by more than this is something that the scene does not have.
const UNMODELLED_M: f64 = 3.0;
/// The same in standard deviations of the prior on open ground.
const UNMODELLED_SIGMAS: f64 = 3.0;
/// Ranks are resolved to this many steps of the residuals' range.
const RANK_BINS: usize = 2048;

/// The building's own stretches, as columns: the inner loop runs over these.
#[derive(Debug, Default)]
struct Columns {
    /// Ray parameter of the roof at height 0, and its change per metre.
    roof_at_zero: Vec<f32>,
    per_metre: Vec<f32>,
    /// The building stops the ray while `after <= roof parameter < before`.
    after: Vec<f32>,
    before: Vec<f32>,
    /// The wall in front.
    enter: Vec<f32>,
    /// Scaled inverse depth without the building.
    v: Vec<f32>,
    p: Vec<f32>,
    x: Vec<f32>,
    y: Vec<f32>,
    /// Scaled inverse depth that the calibrated prior stands for.
    lifted: Vec<f32>,
    /// Position of the ray in the window.
    ray: Vec<u32>,
}

/// One building in one view.
#[derive(Debug)]
pub struct Window {
    columns: Columns,
    /// All rays of the window: position in the view, image position, scaled inverse depth without the building.
    rays: Vec<u32>,
    x: Vec<f32>,
    y: Vec<f32>,
    v: Vec<f32>,
    /// Ranks of the prior's residual, centred; filled for rank scores only.
    p_ranks: Vec<f32>,
    p_rank_norm: f64,
    /// Inverse of the Gram matrix of `[1, x, y]`.
    gram_inverse: [[f64; 3]; 3],
    p_norm_squared: f64,
    base: Sums,
    /// Depth that scaled inverse depth is relative to, metres.
    reference: f32,
    /// Share of the surroundings that look at something the scene does not have, 0..1.
    pub unmodelled: f32,
}

/// Sums over the window of v, v·x, v·y, v·p, v².
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    v: f64,
    vx: f64,
    vy: f64,
    vp: f64,
    vv: f64,
}

/// Which correlation is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Correlation {
    /// Of the residuals themselves.
    Linear,
    /// Of their ranks: purely ordinal.
    Rank,
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
        dilate_px: usize,
        correlation: Correlation,
    ) -> Option<Self> {
        let profiles = evidence.profiles;
        let rays: Vec<u32> = evidence
            .rays_around(building, dilate_px)
            .into_iter()
            .filter(|&r| {
                let ray = &profiles.rays[r as usize];
                evidence.nearness[r as usize].is_finite() && (ray.ground.is_finite())
            })
            .collect();
        let (rays, unmodelled) = match calibration {
            Some(calibration) => without_unmodelled(evidence, building, stops, calibration, rays),
            None => (rays, 0.0),
        };
        if rays.len() < MIN_RAYS {
            return None;
        }
        let depths: Vec<f32> = rays.iter().map(|&r| profiles.depth_without(r as usize, stops, building)).collect();
        let reference = depths.iter().sum::<f32>() / depths.len() as f32;
        let v: Vec<f32> = depths.iter().map(|d| reference / d - 1.0).collect();
        let (x, y) = centred_positions(evidence, &rays);
        let gram_inverse = gram_inverse(&x, &y)?;
        let raw: Vec<f32> = rays.iter().map(|&r| evidence.nearness[r as usize]).collect();
        let (p, p_norm_squared) = residual(&raw, &x, &y, &gram_inverse)?;

        let mut columns = Columns::default();
        for (at, &r) in rays.iter().enumerate() {
            let ray = &profiles.rays[r as usize];
            let per_metre = ray.dz.recip();
            let roof_at_zero = (ground_z - profiles.eye_z) * per_metre;
            let mut after = f32::NEG_INFINITY;
            for crossing in profiles.crossings(r as usize).iter().filter(|c| c.building == building) {
                if crossing.enter >= depths[at] {
                    break;
                }
                let before = crossing.leave.min(depths[at]);
                columns.roof_at_zero.push(roof_at_zero);
                columns.per_metre.push(per_metre);
                columns.after.push(after);
                columns.before.push(before);
                columns.enter.push(crossing.enter);
                columns.v.push(v[at]);
                columns.p.push(p[at]);
                columns.x.push(x[at]);
                columns.y.push(y[at]);
                let lifted = calibration.map_or(f32::NAN, |c| c.inverse_depth(evidence.nearness[r as usize]));
                columns.lifted.push(reference * lifted - 1.0);
                columns.ray.push(at as u32);
                after = before;
            }
        }
        let mut base = Sums::default();
        for i in 0..v.len() {
            let value = f64::from(v[i]);
            base.v += value;
            base.vx += value * f64::from(x[i]);
            base.vy += value * f64::from(y[i]);
            base.vp += value * f64::from(p[i]);
            base.vv += value * value;
        }
        let (p_ranks, p_rank_norm) = match correlation {
            Correlation::Linear => (Vec::new(), 0.0),
            Correlation::Rank => centred_ranks(&p),
        };
        Some(Self {
            columns,
            rays,
            x,
            y,
            v,
            p_ranks,
            p_rank_norm,
            gram_inverse,
            p_norm_squared,
            base,
            reference,
            unmodelled,
        })
    }

    /// ρ for one height above ground, metres; 0 where the view cannot tell.
    #[must_use]
    pub fn score(&self, height_m: f32, correlation: Correlation) -> f64 {
        match correlation {
            Correlation::Linear => self.linear(height_m),
            Correlation::Rank => self.rank(height_m),
        }
    }

    /// How many of the pixels on the roof of a height lie, by the calibrated prior, at that height: the mean over the
    /// roof's rays of `exp(−e²/2)`, `e` in tolerances of height; 0..1, 0 without calibration.
    ///
    /// What stands around the building has no part in it, so outlines that are missing do no harm.
    #[must_use]
    pub fn agreement(&self, height_m: f32) -> f64 {
        let c = &self.columns;
        let tolerance_m = AGREEMENT_M + AGREEMENT_SHARE * height_m;
        let (mut n, mut sum) = (0, 0.0_f32);
        for i in 0..c.v.len() {
            let roof = c.roof_at_zero[i] + c.per_metre[i] * height_m;
            let is_roof_seen = roof >= c.after[i] && roof < c.before[i] && roof > c.enter[i];
            if is_roof_seen && !c.lifted[i].is_nan() {
                let per_metre = self.reference / (roof * roof) * -c.per_metre[i];
                let e = (c.lifted[i] - (self.reference / roof - 1.0)) / (per_metre * tolerance_m);
                sum += (-0.5 * e * e).exp();
                n += 1;
            }
        }
        f64::from(sum) / (f64::from(n) + FEW_RAYS)
    }

    /// Scaled inverse depth of an own stretch at a height, or without the building where it does not stop the ray.
    #[inline]
    fn value(&self, i: usize, height_m: f32) -> f32 {
        let c = &self.columns;
        let roof = c.roof_at_zero[i] + c.per_metre[i] * height_m;
        let stops = roof >= c.after[i] && roof < c.before[i];
        let seen = self.reference / roof.max(c.enter[i]) - 1.0;
        if stops { seen } else { c.v[i] }
    }

    fn sums_at(&self, height_m: f32) -> Sums {
        /// Independent partial sums, so that the loop runs on vector registers with the same result everywhere.
        const LANES: usize = 8;
        let c = &self.columns;
        let n = c.v.len();
        let mut partial = [[0.0_f32; LANES]; 5];
        let mut add = |lane: usize, i: usize| {
            let value = self.value(i, height_m);
            let change = value - c.v[i];
            partial[0][lane] += change;
            partial[1][lane] += change * c.x[i];
            partial[2][lane] += change * c.y[i];
            partial[3][lane] += change * c.p[i];
            partial[4][lane] += change * (value + c.v[i]);
        };
        for chunk in 0..n / LANES {
            for lane in 0..LANES {
                add(lane, chunk * LANES + lane);
            }
        }
        for i in n / LANES * LANES..n {
            add(i % LANES, i);
        }
        let total = |k: usize| partial[k].iter().map(|&s| f64::from(s)).sum::<f64>();
        Sums {
            v: self.base.v + total(0),
            vx: self.base.vx + total(1),
            vy: self.base.vy + total(2),
            vp: self.base.vp + total(3),
            vv: self.base.vv + total(4),
        }
    }

    /// The building's own stretches: ray, and z-depths between which it can stop the ray.
    pub(super) fn own_stretches(&self) -> impl Iterator<Item = (u32, f32, f32)> + '_ {
        let c = &self.columns;
        (0..c.v.len()).map(|i| (self.rays[c.ray[i] as usize], c.enter[i], c.before[i]))
    }

    /// Correlation and weighted agreement for a roof of any form: `meets` says at which z-depth a stretch (by its
    /// position in [`Self::own_stretches`]) stops its ray. `height_m` sets the agreement's tolerance.
    pub(super) fn score_where(&self, weight: f64, height_m: f32, meets: impl Fn(usize) -> Option<f32>) -> f64 {
        let c = &self.columns;
        let tolerance_m = AGREEMENT_M + AGREEMENT_SHARE * height_m;
        let mut sums = self.base;
        let (mut n, mut agreement) = (0, 0.0_f64);
        let mut stopped = None;
        for i in 0..c.v.len() {
            if stopped == Some(c.ray[i]) {
                continue;
            }
            let Some(depth) = meets(i) else { continue };
            stopped = Some(c.ray[i]);
            let value = self.reference / depth - 1.0;
            let change = f64::from(value - c.v[i]);
            sums.v += change;
            sums.vx += change * f64::from(c.x[i]);
            sums.vy += change * f64::from(c.y[i]);
            sums.vp += change * f64::from(c.p[i]);
            sums.vv += change * f64::from(value + c.v[i]);
            if depth > c.enter[i] && !c.lifted[i].is_nan() {
                let per_metre = self.reference / (depth * depth) * -c.per_metre[i];
                let e = f64::from((c.lifted[i] - value) / (per_metre * tolerance_m));
                agreement += (-0.5 * e * e).exp();
                n += 1;
            }
        }
        self.correlation(&sums) + weight * agreement / (f64::from(n) + FEW_RAYS)
    }

    fn linear(&self, height_m: f32) -> f64 {
        self.correlation(&self.sums_at(height_m))
    }

    fn correlation(&self, sums: &Sums) -> f64 {
        let q = [sums.v, sums.vx, sums.vy];
        let explained = dot(&q, &apply(&self.gram_inverse, &q));
        let v_norm_squared = sums.vv - explained;
        if v_norm_squared <= FLAT * sums.vv.max(f64::MIN_POSITIVE) {
            return 0.0;
        }
        sums.vp / (v_norm_squared * self.p_norm_squared).sqrt()
    }

    fn rank(&self, height_m: f32) -> f64 {
        let sums = self.sums_at(height_m);
        let plane = apply(&self.gram_inverse, &[sums.v, sums.vx, sums.vy]).map(|b| b as f32);
        let mut v = self.v.clone();
        for (i, &ray) in self.columns.ray.iter().enumerate() {
            let value = self.value(i, height_m);
            if value != self.columns.v[i] {
                v[ray as usize] = value;
            }
        }
        for (value, (x, y)) in v.iter_mut().zip(self.x.iter().zip(&self.y)) {
            *value -= plane[0] + plane[1] * x + plane[2] * y;
        }
        let (ranks, norm) = centred_ranks(&v);
        if norm * self.p_rank_norm == 0.0 {
            return 0.0;
        }
        let product: f64 = ranks.iter().zip(&self.p_ranks).map(|(a, b)| f64::from(a * b)).sum();
        product / (norm * self.p_rank_norm)
    }
}

/// Leaves out the rays around a building that look, by the calibrated prior, at something that the scene does not have
/// there: a building without an outline, a tree. What stands out is told against the open ground close by, so that a
/// slow drift of the prior does no harm.
fn without_unmodelled(
    evidence: &Evidence<'_>,
    building: u32,
    stops: &Stops,
    calibration: Calibration,
    rays: Vec<u32>,
) -> (Vec<u32>, f32) {
    let profiles = evidence.profiles;
    // By ray: how far above what is rendered the prior lies, metres; the building's own rays are left alone.
    let excess_m: Vec<Option<f64>> = rays
        .iter()
        .map(|&r| {
            let is_own = profiles.crossings(r as usize).iter().any(|c| c.building == building);
            let rendered = profiles.depth(r as usize, stops);
            let seen = calibration.inverse_depth(evidence.nearness[r as usize]).max(f32::MIN_POSITIVE).recip();
            (!is_own).then(|| f64::from((seen - rendered) * profiles.rays[r as usize].dz))
        })
        .collect();
    let mut around: Vec<f64> = excess_m.iter().flatten().copied().collect();
    let Some((level, sigma)) = far_side(&mut around) else { return (rays, 0.0) };
    let limit = level + (UNMODELLED_SIGMAS * sigma).max(UNMODELLED_M);
    let n_around = around.len() as f32;
    let (kept, left_out): (Vec<_>, Vec<_>) =
        rays.into_iter().zip(excess_m).partition(|(_, excess)| excess.is_none_or(|e| e <= limit));
    (kept.into_iter().map(|(r, _)| r).collect(), left_out.len() as f32 / n_around)
}

/// Where the far side of some residuals gathers, and its standard deviation: what is not modelled is nearer, so only the
/// near side is heavy. Tukey's biweight from the first third on, with the spread measured below the present value.
fn far_side(values: &mut [f64]) -> Option<(f64, f64)> {
    const ROUNDS: usize = 8;
    const CUT_OFF: f64 = 3.0;
    const SIGMA_PER_MAD: f64 = 1.4826;
    if values.len() < MIN_RAYS {
        return None;
    }
    values.sort_unstable_by(f64::total_cmp);
    let mut level = stats::quantile_of_sorted(values, 1.0 / 3.0)?;
    let mut sigma = 0.0;
    for _ in 0..ROUNDS {
        let below: Vec<f64> = values.iter().filter(|v| **v <= level).map(|v| level - v).collect();
        sigma = SIGMA_PER_MAD * stats::median(&below)?;
        if sigma <= 0.0 {
            break;
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for value in values.iter() {
            let u = (value - level) / (CUT_OFF * sigma);
            let weight = (1.0 - u * u).max(0.0).powi(2);
            sum += weight * value;
            weights += weight;
        }
        level = sum / weights;
    }
    Some((level, sigma))
}

/// Image positions of rays, centred and scaled to about ±1 so that the Gram matrix is well conditioned.
fn centred_positions(evidence: &Evidence<'_>, rays: &[u32]) -> (Vec<f32>, Vec<f32>) {
    let axis = |k: usize| {
        let values: Vec<f32> = rays.iter().map(|&r| f32::from(evidence.profiles.rays[r as usize].pixel[k])).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let extent = values.iter().fold(1.0_f32, |e, v| e.max((v - mean).abs()));
        values.into_iter().map(|v| (v - mean) / extent).collect::<Vec<f32>>()
    };
    (axis(0), axis(1))
}

fn gram_inverse(x: &[f32], y: &[f32]) -> Option<[[f64; 3]; 3]> {
    let sum = |f: &dyn Fn(f64, f64) -> f64| x.iter().zip(y).map(|(&x, &y)| f(f64::from(x), f64::from(y))).sum::<f64>();
    let (n, sx, sy) = (x.len() as f64, sum(&|x, _| x), sum(&|_, y| y));
    let (xx, xy, yy) = (sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y));
    let gram = glam::DMat3::from_cols_array(&[n, sx, sy, sx, xx, xy, sy, xy, yy]);
    if gram.determinant().abs() < 1e-9 * n * n * n {
        return None; // all rays in one row or column
    }
    let inverse = gram.inverse();
    Some([inverse.x_axis.to_array(), inverse.y_axis.to_array(), inverse.z_axis.to_array()])
}

/// What `[1, x, y]` does not explain of some values, and its squared norm; `None` if that is nothing.
fn residual(values: &[f32], x: &[f32], y: &[f32], gram_inverse: &[[f64; 3]; 3]) -> Option<(Vec<f32>, f64)> {
    let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
    let scale = values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>().sqrt();
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let centred: Vec<f64> = values.iter().map(|&v| (f64::from(v) - mean) / scale).collect();
    let mut q = [0.0; 3];
    for ((v, &x), &y) in centred.iter().zip(x).zip(y) {
        q[0] += v;
        q[1] += v * f64::from(x);
        q[2] += v * f64::from(y);
    }
    let plane = apply(gram_inverse, &q);
    let residual: Vec<f32> = centred
        .iter()
        .zip(x.iter().zip(y))
        .map(|(v, (&x, &y))| (v - plane[0] - plane[1] * f64::from(x) - plane[2] * f64::from(y)) as f32)
        .collect();
    let norm_squared: f64 = residual.iter().map(|&r| f64::from(r).powi(2)).sum();
    (norm_squared > FLAT).then_some((residual, norm_squared))
}

/// Ranks by counting in [`RANK_BINS`] steps of the range, ties sharing their mean rank, centred on 0; and their norm.
fn centred_ranks(values: &[f32]) -> (Vec<f32>, f64) {
    let (low, high) =
        values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    let per_bin = if high > low { (RANK_BINS - 1) as f32 / (high - low) } else { 0.0 };
    let bin_of = |v: f32| ((v - low) * per_bin) as usize;
    let mut counts = [0_u32; RANK_BINS];
    for &v in values {
        counts[bin_of(v)] += 1;
    }
    let centre = 0.5 * (values.len() as f32 - 1.0);
    let mut below = 0;
    let rank_of_bin: Vec<f32> = counts
        .iter()
        .map(|&count| {
            let rank = below as f32 + 0.5 * (count as f32 - 1.0) - centre;
            below += count;
            rank
        })
        .collect();
    let ranks: Vec<f32> = values.iter().map(|&v| rank_of_bin[bin_of(v)]).collect();
    let norm = ranks.iter().map(|&r| f64::from(r).powi(2)).sum::<f64>().sqrt();
    (ranks, norm)
}

fn apply(m: &[[f64; 3]; 3], v: &[f64; 3]) -> [f64; 3] {
    [dot(&m[0], v), dot(&m[1], v), dot(&m[2], v)]
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The height between three evenly spaced ones whose scores' parabola peaks; the middle one if they have no peak.
#[must_use]
pub fn parabola_peak(middle_m: f32, spacing_m: f32, scores: [f64; 3]) -> f32 {
    let [before, at, after] = scores;
    let curvature = before - 2.0 * at + after;
    if curvature >= 0.0 {
        return middle_m;
    }
    let shift = 0.5 * (before - after) / curvature;
    middle_m + spacing_m * shift.clamp(-1.0, 1.0) as f32
}

/// Standard error of an estimate from its leave-one-out values (jackknife); `None` for fewer than two.
#[must_use]
pub fn jackknife_sigma(leave_one_out: &[f64]) -> Option<f64> {
    let n = leave_one_out.len() as f64;
    let mean = stats::mean(leave_one_out)?;
    let squares: f64 = leave_one_out.iter().map(|h| (h - mean).powi(2)).sum();
    (leave_one_out.len() > 1).then(|| ((n - 1.0) / n * squares).sqrt())
}
