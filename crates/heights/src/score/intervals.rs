//! The intervals of rays over one building in one view, packed for vector registers: the solver's inner loop.
//!
//! ```text
//! r(h) = roof₀ + m · h                    z-depth at which a ray sinks to the roof of height h
//! stopped: after ≤ r < before             nothing else stops it earlier, and it has not left the footprint
//! v(h) = ref / max(r, enter) − 1          scaled inverse depth where stopped; without the building elsewhere
//! a(h) = Σ exp(−e²/2),  e = (lifted − v) / tolerance     over what is seen of the roof
//! ```
//!
//! Each interval costs some forty operations in single precision, without branches, in the widest registers that the
//! processor has. Partial sums are kept per lane and no product is fused with a sum, so that all widths give the same bits.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x8, mask32x8};

use crate::simd::{LANES, Lanes};

/// A roof of any form over the intervals of a building in a view.
pub(crate) trait RoofIntersection {
    /// z-depths at which it stops the rays of a block; `+∞` where they pass over. To be inlined always.
    fn meets<S: Simd>(&self, simd: S, block: usize) -> f32x8<S>;
}
/// Height tolerance of the agreement: a fixed part, metres, and a share of the height (a prior's relief is off by some
/// 10 %).
const AGREEMENT_M: f32 = 0.7;
const AGREEMENT_SHARE: f32 = 0.1;
/// So many rays that agree with nothing are added to a roof's own: a roof of few rays has little to say.
const FEW_RAYS: f64 = 2.0;

/// One ray's way over the building.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PackedInterval {
    /// Position of the ray in the window.
    pub ray: u32,
    /// z-depth of the roof at height 0, and its change per metre.
    pub roof_at_zero: f32,
    pub per_metre: f32,
    /// The building stops the ray while `after <= z-depth of the roof < before`.
    pub after: f32,
    pub before: f32,
    /// z-depth of the wall in front.
    pub enter: f32,
    /// Scaled inverse depth without the building.
    pub v: f32,
    /// The prior's residual, and the image position.
    pub p: f32,
    pub x: f32,
    pub y: f32,
    /// Scaled inverse depth that the calibrated prior stands for; `NaN` = not calibrated.
    pub lifted: f32,
}

/// [`PackedInterval`]es side by side.
#[derive(Debug, Clone, Copy)]
struct PackedBlock {
    roof_at_zero: Lanes,
    per_metre: Lanes,
    after: Lanes,
    before: Lanes,
    enter: Lanes,
    v: Lanes,
    p: Lanes,
    x: Lanes,
    y: Lanes,
    lifted: Lanes,
}

impl PackedBlock {
    /// Lanes that never stop a ray.
    const EMPTY: Self = Self {
        roof_at_zero: Lanes::splat(0.0),
        per_metre: Lanes::splat(-1.0),
        after: Lanes::splat(f32::INFINITY),
        before: Lanes::splat(f32::NEG_INFINITY),
        enter: Lanes::splat(1.0),
        v: Lanes::splat(0.0),
        p: Lanes::splat(0.0),
        x: Lanes::splat(0.0),
        y: Lanes::splat(0.0),
        lifted: Lanes::splat(f32::NAN),
    };

    fn set(&mut self, lane: usize, interval: &PackedInterval) {
        self.roof_at_zero.set(lane, interval.roof_at_zero);
        self.per_metre.set(lane, interval.per_metre);
        self.after.set(lane, interval.after);
        self.before.set(lane, interval.before);
        self.enter.set(lane, interval.enter);
        self.v.set(lane, interval.v);
        self.p.set(lane, interval.p);
        self.x.set(lane, interval.x);
        self.y.set(lane, interval.y);
        self.lifted.set(lane, interval.lifted);
    }
}

/// Sums over the intervals that a height changes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums {
    /// Sums of v, v·x, v·y, v·p, v².
    pub v: f64,
    pub vx: f64,
    pub vy: f64,
    pub vp: f64,
    pub vv: f64,
    /// Sum of the agreement, and over how many intervals.
    agreement: f64,
    n_agreement: f64,
}

impl Sums {
    /// Share of the pixels on the roof that lie, by the calibrated prior, at its height: the mean of `exp(−e²/2)`; 0..1, 0
    /// without calibration.
    ///
    /// What stands around the building has no part in it, so footprints that are missing do no harm.
    pub fn agreement(&self) -> f64 {
        self.agreement / (self.n_agreement + FEW_RAYS)
    }
}

/// All intervals of a building in a view.
#[derive(Debug)]
pub(crate) struct Intervals {
    level: Level,
    blocks: Vec<PackedBlock>,
    /// By interval: position of its ray in the window.
    rays: Vec<u32>,
    /// Intervals whose ray has one before them.
    later: Vec<usize>,
    /// Depth that scaled inverse depth is relative to, metres.
    reference: f32,
}

impl Intervals {
    /// None yet, with room for those of `n` rays; `reference` is the depth that scaled inverse depth is relative to, metres.
    pub fn relative_to(reference: f32, n: usize) -> Self {
        let (blocks, rays) = (Vec::with_capacity(n.div_ceil(LANES)), Vec::with_capacity(n));
        Self { level: Level::new(), blocks, rays, later: Vec::new(), reference }
    }

    /// Depth that scaled inverse depth is relative to, metres.
    pub fn reference(&self) -> f32 {
        self.reference
    }

    /// Number of intervals over the building.
    pub fn n(&self) -> usize {
        self.rays.len()
    }

    pub fn push(&mut self, interval: &PackedInterval) {
        let lane = self.rays.len() % LANES;
        if lane == 0 {
            self.blocks.push(PackedBlock::EMPTY);
        }
        self.blocks.last_mut().expect("one was just made").set(lane, interval);
        if self.rays.last() == Some(&interval.ray) {
            self.later.push(self.rays.len());
        }
        self.rays.push(interval.ray);
    }

    /// Position in the window of each interval's ray, and z-depths between which the building can stop it.
    pub fn iter(&self) -> impl Iterator<Item = (u32, f32, f32)> + '_ {
        self.rays.iter().enumerate().map(|(i, &ray)| {
            let block = &self.blocks[i / LANES];
            (ray, block.enter.get(i % LANES), block.before.get(i % LANES))
        })
    }

    /// The sums for one height above ground, metres.
    pub fn at(&self, height_m: f32) -> Sums {
        dispatch!(self.level, simd => Kernel::new(simd, self.reference, height_m).at_height(&self.blocks, height_m))
    }

    /// The sums for a roof of any form. `height_m` sets the agreement's tolerance.
    pub fn with(&self, height_m: f32, form: &impl RoofIntersection) -> Sums {
        dispatch!(self.level, simd => self.with_in(simd, height_m, form))
    }

    #[inline(always)]
    fn with_in<S: Simd>(&self, simd: S, height_m: f32, form: &impl RoofIntersection) -> Sums {
        let mut depths = vec![Lanes::splat(f32::INFINITY); self.blocks.len()];
        for (block, depth) in depths.iter_mut().enumerate() {
            depth.store(form.meets(simd, block));
        }
        for &i in &self.later {
            let is_stopped = |j: usize| depths[j / LANES].get(j % LANES).is_finite();
            let mut of_ray = (0..i).rev().take_while(|&j| self.rays[j] == self.rays[i]);
            if of_ray.any(is_stopped) {
                depths[i / LANES].set(i % LANES, f32::INFINITY);
            }
        }
        Kernel::new(simd, self.reference, height_m).at_depths(&self.blocks, &depths)
    }
}

/// The loops, with what is the same for all intervals.
struct Kernel<S: Simd> {
    simd: S,
    reference: f32x8<S>,
    /// Factor of `e = (lifted − v) · depth² · per_tolerance / m`.
    per_tolerance: f32x8<S>,
    /// Partial sums, lane by lane, in the order of [`Sums`].
    partial: [f32x8<S>; 7],
}

impl<S: Simd> Kernel<S> {
    #[inline(always)]
    fn new(simd: S, reference: f32, height_m: f32) -> Self {
        let per_tolerance = -1.0 / (reference * (AGREEMENT_M + AGREEMENT_SHARE * height_m));
        let splat = |value: f32| f32x8::splat(simd, value);
        Self { simd, reference: splat(reference), per_tolerance: splat(per_tolerance), partial: [splat(0.0); 7] }
    }

    #[inline(always)]
    fn at_height(mut self, blocks: &[PackedBlock], height_m: f32) -> Sums {
        let simd = self.simd;
        for block in blocks {
            let roof = block.roof_at_zero.load(simd) + block.per_metre.load(simd) * height_m;
            let stops = roof.simd_ge(block.after.load(simd)) & roof.simd_lt(block.before.load(simd));
            // Most rays over a building pass above its roof, neighbours together: they change nothing.
            if stops.any_true() {
                self.add(block, stops, roof.max(block.enter.load(simd)));
            }
        }
        self.total()
    }

    #[inline(always)]
    fn at_depths(mut self, blocks: &[PackedBlock], depths: &[Lanes]) -> Sums {
        for (block, depth) in blocks.iter().zip(depths) {
            let depth = depth.load(self.simd);
            let stops = depth.simd_lt(f32::INFINITY);
            if stops.any_true() {
                self.add(block, stops, depth);
            }
        }
        self.total()
    }

    #[inline(always)]
    fn add(&mut self, block: &PackedBlock, stops: mask32x8<S>, depth: f32x8<S>) {
        let simd = self.simd;
        let (without, lifted) = (block.v.load(simd), block.lifted.load(simd));
        let value = stops.select(self.reference / depth - 1.0, without);
        let change = value - without;
        self.partial[0] += change;
        self.partial[1] += change * block.x.load(simd);
        self.partial[2] += change * block.y.load(simd);
        self.partial[3] += change * block.p.load(simd);
        self.partial[4] += change * (value + without);
        let agrees = stops & depth.simd_gt(block.enter.load(simd)) & lifted.simd_eq(lifted);
        let e = (lifted - value) * (depth * depth) * (self.per_tolerance / block.per_metre.load(simd));
        let nothing = f32x8::splat(simd, 0.0);
        self.partial[5] += agrees.select(bell(e), nothing);
        self.partial[6] += agrees.select(f32x8::splat(simd, 1.0), nothing);
    }

    #[inline(always)]
    fn total(self) -> Sums {
        let mut sums = [0.0; 7];
        for (sum, partial) in sums.iter_mut().zip(self.partial) {
            let mut lanes = [0.0_f32; LANES];
            partial.store_slice(&mut lanes);
            *sum = lanes.iter().map(|&s| f64::from(s)).sum();
        }
        let [v, vx, vy, vp, vv, agreement, n_agreement] = sums;
        Sums { v, vx, vy, vp, vv, agreement, n_agreement }
    }
}

/// `exp(−e²/2)` to 2e-6: `1 / exp(t/16)^16` with Taylor's series, `t = e²/2`.
#[inline(always)]
fn bell<S: Simd>(e: f32x8<S>) -> f32x8<S> {
    /// Beyond this the result is nothing, and its inverse too great for single precision.
    const MOST: f32 = 80.0;
    /// `1 / i!`, from the fifth term to the first.
    const C: [f32; 5] = [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0];
    let s = (e * e * 0.5).min(MOST) * (1.0 / 16.0);
    let mut power = f32x8::splat(e.simd, 1.0 / 720.0);
    for c in C {
        power = power * s + c;
    }
    power = power * s + 1.0;
    for _ in 0..4 {
        power *= power;
    }
    1.0 / power
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_bell_is_the_library_s(e in -12.0..12.0_f32) {
            let exact = (-0.5 * f64::from(e) * f64::from(e)).exp();
            let ours = f64::from(dispatch!(Level::new(), simd => bell(f32x8::splat(simd, e))[3]));
            prop_assert!((ours - exact).abs() < 2e-6, "{ours} {exact}");
        }

        /// The packed loops against one that goes interval by interval in double precision.
        #[test]
        fn packed_sums_are_those_of_each_stretch(n in 0..40_usize, height_m in 2.0..60.0_f32, seed in 0..1000_u64) {
            let intervals = some_stretches(n, seed);
            let by_one = one_by_one(&intervals, height_m);
            for packed in [intervals.at(height_m), intervals.with(height_m, &flat(&intervals, height_m))] {
                let sums = [packed.v, packed.vx, packed.vy, packed.vp, packed.vv, packed.agreement()];
                for (a, b) in sums.iter().zip(by_one) {
                    prop_assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
                }
            }
        }

        /// However wide registers are.
        #[test]
        fn all_widths_of_registers_give_the_same_bits(n in 0..60_usize, height_m in 2.0..60.0_f32, seed in 0..1000_u64) {
            let mut intervals = some_stretches(n, seed);
            let form = flat(&intervals, height_m);
            let mut bits = |level: Level| {
                intervals.level = level;
                [intervals.at(height_m), intervals.with(height_m, &form)]
                    .map(|sums| [sums.v, sums.vx, sums.vy, sums.vp, sums.vv, sums.agreement()].map(f64::to_bits))
            };
            let widest = bits(Level::new());
            for level in crate::simd::levels() {
                prop_assert_eq!(bits(level), widest, "{:?}", level);
            }
        }
    }

    /// A flat roof as one of any form, block by block.
    struct Flat(Vec<Lanes>);

    impl RoofIntersection for Flat {
        #[inline(always)]
        fn meets<S: Simd>(&self, simd: S, block: usize) -> f32x8<S> {
            self.0[block].load(simd)
        }
    }

    fn flat(intervals: &Intervals, height_m: f32) -> Flat {
        let mut depths = vec![Lanes::splat(f32::INFINITY); intervals.blocks.len()];
        for (i, depth) in intervals.depths(height_m) {
            depths[i / LANES].set(i % LANES, depth);
        }
        Flat(depths)
    }

    impl Intervals {
        fn depths(&self, height_m: f32) -> impl Iterator<Item = (usize, f32)> + '_ {
            (0..self.rays.len()).filter_map(move |i| {
                let b = &self.blocks[i / LANES];
                let columns = [b.roof_at_zero, b.per_metre, b.after, b.before, b.enter];
                let [at_zero, per_metre, after, before, enter] = columns.map(|lanes| lanes.get(i % LANES));
                let roof = at_zero + per_metre * height_m;
                (roof >= after && roof < before).then(|| (i, roof.max(enter)))
            })
        }
    }

    fn one_by_one(intervals: &Intervals, height_m: f32) -> [f64; 6] {
        let mut sums = [0.0; 5];
        let (mut agreement, mut n) = (0.0, 0.0);
        for (i, depth) in intervals.depths(height_m) {
            let b = &intervals.blocks[i / LANES];
            let columns = [b.per_metre, b.enter, b.v, b.p, b.x, b.y, b.lifted];
            let [per_metre, enter, v, p, x, y, lifted] = columns.map(|lanes| f64::from(lanes.get(i % LANES)));
            let [depth, reference] = [depth, intervals.reference].map(f64::from);
            let value = reference / depth - 1.0;
            for (sum, k) in sums.iter_mut().zip([1.0, x, y, p]) {
                *sum += (value - v) * k;
            }
            sums[4] += value * value - v * v;
            if depth > enter && !lifted.is_nan() {
                // Metres of height that the prior is off by, in tolerances.
                let off_m = (lifted - value) / (-reference / (depth * depth) * per_metre);
                agreement += (-0.5 * (off_m / (0.7 + 0.1 * f64::from(height_m))).powi(2)).exp();
                n += 1.0;
            }
        }
        [sums[0], sums[1], sums[2], sums[3], sums[4], agreement / (n + FEW_RAYS)]
    }

    fn some_stretches(n: usize, seed: u64) -> Intervals {
        use rand::Rng as _;
        let mut rng = crate::seed::stream(seed, "intervals", &[]);
        let mut intervals = Intervals::relative_to(150.0, 0);
        for ray in 0..n as u32 {
            let enter = rng.random_range(100.0..160.0_f32);
            intervals.push(&PackedInterval {
                ray,
                roof_at_zero: rng.random_range(140.0..200.0),
                per_metre: rng.random_range(-2.0..-1.0),
                after: if ray % 3 == 0 { rng.random_range(90.0..120.0) } else { f32::NEG_INFINITY },
                before: enter + rng.random_range(1.0..30.0_f32),
                enter,
                v: rng.random_range(-0.4..0.1),
                p: rng.random_range(-0.1..0.1),
                x: rng.random_range(-1.0..1.0),
                y: rng.random_range(-1.0..1.0),
                lifted: if ray % 7 == 0 { f32::NAN } else { rng.random_range(-0.4..0.4) },
            });
        }
        intervals
    }
}
