//! The stretches of rays over one building in one view, packed for vector registers: the solver's inner loop.
//!
//! ```text
//! r(h) = roof₀ + m · h                    z-depth at which a ray sinks to the roof of height h
//! stopped: after ≤ r < before             nothing else stops it earlier, and it has not left the outline
//! v(h) = ref / max(r, enter) − 1          scaled inverse depth where stopped; without the building elsewhere
//! a(h) = Σ exp(−e²/2),  e = (lifted − v) / tolerance     over what is seen of the roof
//! ```
//!
//! Each stretch costs some forty operations in single precision, without branches. Partial sums are kept per lane, so that
//! all widths of registers give the same bits.

use wide::f32x8;

/// Stretches in one block.
pub(super) const LANES: usize = 8;
/// One value per stretch of a block.
pub(super) type Lanes = f32x8;
/// Height tolerance of the agreement: a fixed part, metres, and a share of the height (a prior's relief is off by some
/// 10 %).
const AGREEMENT_M: f32 = 0.7;
const AGREEMENT_SHARE: f32 = 0.1;
/// So many rays that agree with nothing are added to a roof's own: a roof of few rays has little to say.
const FEW_RAYS: f64 = 2.0;

/// One ray's way over the building.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
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

/// [`Stretch`]es side by side.
#[derive(Debug, Clone, Copy)]
struct Block {
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

impl Block {
    /// Lanes that never stop a ray.
    const EMPTY: Self = Self {
        roof_at_zero: Lanes::ZERO,
        per_metre: Lanes::new([-1.0; LANES]),
        after: Lanes::new([f32::INFINITY; LANES]),
        before: Lanes::new([f32::NEG_INFINITY; LANES]),
        enter: Lanes::ONE,
        v: Lanes::ZERO,
        p: Lanes::ZERO,
        x: Lanes::ZERO,
        y: Lanes::ZERO,
        lifted: Lanes::new([f32::NAN; LANES]),
    };

    fn set(&mut self, lane: usize, stretch: &Stretch) {
        let set = |lanes: &mut Lanes, value: f32| lanes.as_mut_array()[lane] = value;
        set(&mut self.roof_at_zero, stretch.roof_at_zero);
        set(&mut self.per_metre, stretch.per_metre);
        set(&mut self.after, stretch.after);
        set(&mut self.before, stretch.before);
        set(&mut self.enter, stretch.enter);
        set(&mut self.v, stretch.v);
        set(&mut self.p, stretch.p);
        set(&mut self.x, stretch.x);
        set(&mut self.y, stretch.y);
        set(&mut self.lifted, stretch.lifted);
    }
}

/// What a height changes, summed over the stretches.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    /// Of v, v·x, v·y, v·p, v².
    pub v: f64,
    pub vx: f64,
    pub vy: f64,
    pub vp: f64,
    pub vv: f64,
    /// Of the agreement, and over how many stretches.
    agreement: f64,
    n_agreement: f64,
}

impl Sums {
    /// How many of the pixels on the roof lie, by the calibrated prior, at its height: the mean of `exp(−e²/2)`; 0..1, 0
    /// without calibration.
    ///
    /// What stands around the building has no part in it, so outlines that are missing do no harm.
    pub fn agreement(&self) -> f64 {
        self.agreement / (self.n_agreement + FEW_RAYS)
    }
}

/// All stretches of a building in a view.
#[derive(Debug, Default)]
pub(super) struct Stretches {
    blocks: Vec<Block>,
    /// By stretch: position of its ray in the window.
    rays: Vec<u32>,
    /// Stretches whose ray has one before them.
    later: Vec<usize>,
    /// Depth that scaled inverse depth is relative to, metres.
    reference: f32,
}

impl Stretches {
    /// None yet; `reference` is the depth that scaled inverse depth is relative to, metres.
    pub fn relative_to(reference: f32) -> Self {
        Self { reference, ..Self::default() }
    }

    pub fn push(&mut self, stretch: &Stretch) {
        let lane = self.rays.len() % LANES;
        if lane == 0 {
            self.blocks.push(Block::EMPTY);
        }
        self.blocks.last_mut().expect("one was just made").set(lane, stretch);
        if self.rays.last() == Some(&stretch.ray) {
            self.later.push(self.rays.len());
        }
        self.rays.push(stretch.ray);
    }

    /// In how many blocks they are.
    pub fn n_blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Position in the window of each stretch's ray, and z-depths between which the building can stop it.
    pub fn iter(&self) -> impl Iterator<Item = (u32, f32, f32)> + '_ {
        self.rays.iter().enumerate().map(|(i, &ray)| {
            let block = &self.blocks[i / LANES];
            let [enter, before] = [block.enter, block.before].map(|lanes| lanes.as_array()[i % LANES]);
            (ray, enter, before)
        })
    }

    /// The sums for one height above ground, metres.
    pub fn at(&self, height_m: f32) -> Sums {
        Kernel::new(self.reference, height_m).at_height(&self.blocks, height_m)
    }

    /// The sums for a roof of any form: `depths` holds the z-depth at which it stops each stretch, `+∞` where the ray passes
    /// over; [`Self::n_blocks`] of them. `height_m` sets the agreement's tolerance.
    pub fn with(&self, height_m: f32, depths: &mut [Lanes]) -> Sums {
        for &i in &self.later {
            let is_stopped = |j: usize| depths[j / LANES].as_array()[j % LANES].is_finite();
            let of_ray = (0..i).rev().take_while(|&j| self.rays[j] == self.rays[i]);
            if of_ray.into_iter().any(is_stopped) {
                depths[i / LANES].as_mut_array()[i % LANES] = f32::INFINITY;
            }
        }
        Kernel::new(self.reference, height_m).at_depths(&self.blocks, depths)
    }

    /// Each stretch that a height stops: position of its ray in the window, and its scaled inverse depth.
    pub fn stopped_at(&self, height_m: f32) -> impl Iterator<Item = (u32, f32)> + '_ {
        self.rays.iter().enumerate().filter_map(move |(i, &ray)| {
            let b = &self.blocks[i / LANES];
            let columns = [b.roof_at_zero, b.per_metre, b.after, b.before, b.enter];
            let [at_zero, per_metre, after, before, enter] = columns.map(|lanes| lanes.as_array()[i % LANES]);
            let roof = at_zero + per_metre * height_m;
            (roof >= after && roof < before).then(|| (ray, self.reference / roof.max(enter) - 1.0))
        })
    }
}

/// The loops, with what is the same for all stretches.
struct Kernel {
    reference: Lanes,
    /// Of `e = (lifted − v) · depth² · per_tolerance / m`.
    per_tolerance: Lanes,
}

/// Partial sums, lane by lane, in the order of [`Sums`].
type Partial = [Lanes; 7];

impl Kernel {
    fn new(reference: f32, height_m: f32) -> Self {
        let per_tolerance = -1.0 / (reference * (AGREEMENT_M + AGREEMENT_SHARE * height_m));
        Self { reference: Lanes::splat(reference), per_tolerance: Lanes::splat(per_tolerance) }
    }

    fn at_height(&self, blocks: &[Block], height_m: f32) -> Sums {
        let mut partial = Partial::default();
        let height_m = Lanes::splat(height_m);
        for block in blocks {
            let roof = block.roof_at_zero + block.per_metre * height_m;
            let stops = roof.simd_ge(block.after) & roof.simd_lt(block.before);
            // Most rays over a building pass above its roof, neighbours together: they change nothing.
            if stops.any() {
                self.add(&mut partial, block, stops, roof.fast_max(block.enter));
            }
        }
        total(&partial)
    }

    fn at_depths(&self, blocks: &[Block], depths: &[Lanes]) -> Sums {
        let mut partial = Partial::default();
        for (block, &depth) in blocks.iter().zip(depths) {
            let stops = depth.simd_lt(Lanes::splat(f32::INFINITY));
            if stops.any() {
                self.add(&mut partial, block, stops, depth);
            }
        }
        total(&partial)
    }

    #[inline]
    fn add(&self, partial: &mut Partial, block: &Block, stops: Lanes, depth: Lanes) {
        let value = stops.bitselect(self.reference / depth - Lanes::ONE, block.v);
        let change = value - block.v;
        partial[0] += change;
        partial[1] += change * block.x;
        partial[2] += change * block.y;
        partial[3] += change * block.p;
        partial[4] += change * (value + block.v);
        let agrees = stops & depth.simd_gt(block.enter) & block.lifted.simd_ge(Lanes::splat(f32::NEG_INFINITY));
        let e = (block.lifted - value) * (depth * depth) * (self.per_tolerance / block.per_metre);
        partial[5] += agrees & bell(e);
        partial[6] += agrees & Lanes::ONE;
    }
}

fn total(partial: &Partial) -> Sums {
    let [v, vx, vy, vp, vv, agreement, n_agreement] =
        partial.map(|lanes| lanes.as_array().iter().map(|&s| f64::from(s)).sum::<f64>());
    Sums { v, vx, vy, vp, vv, agreement, n_agreement }
}

/// `exp(−e²/2)` to 2e-6: `1 / exp(t/16)^16` with Taylor's series, `t = e²/2`.
#[inline]
fn bell(e: Lanes) -> Lanes {
    /// Beyond this the result is nothing, and its inverse too great for single precision.
    const MOST: f32 = 80.0;
    /// `1 / i!`, from the fifth term to the first.
    const C: [f32; 5] = [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0];
    let s = (e * e * Lanes::splat(0.5)).fast_min(Lanes::splat(MOST)) * Lanes::splat(1.0 / 16.0);
    let mut power = C.iter().fold(Lanes::splat(1.0 / 720.0), |sum, &c| sum * s + Lanes::splat(c));
    power = power * s + Lanes::ONE;
    for _ in 0..4 {
        power *= power;
    }
    Lanes::ONE / power
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_bell_is_the_library_s(e in -12.0..12.0_f32) {
            let exact = (-0.5 * f64::from(e) * f64::from(e)).exp();
            let ours = f64::from(bell(Lanes::splat(e)).as_array()[3]);
            prop_assert!((ours - exact).abs() < 2e-6, "{ours} {exact}");
        }

        /// The packed loops against one that goes stretch by stretch in double precision.
        #[test]
        fn packed_sums_are_those_of_each_stretch(n in 0..40_usize, height_m in 2.0..60.0_f32, seed in 0..1000_u64) {
            let stretches = some_stretches(n, seed);
            let by_one = one_by_one(&stretches, height_m);
            let mut depths = vec![Lanes::splat(f32::INFINITY); stretches.n_blocks()];
            for (i, depth) in stretches.depths(height_m) {
                depths[i / LANES].as_mut_array()[i % LANES] = depth;
            }
            for packed in [stretches.at(height_m), stretches.with(height_m, &mut depths)] {
                let sums = [packed.v, packed.vx, packed.vy, packed.vp, packed.vv, packed.agreement()];
                for (a, b) in sums.iter().zip(by_one) {
                    prop_assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
                }
            }
        }
    }

    impl Stretches {
        fn depths(&self, height_m: f32) -> impl Iterator<Item = (usize, f32)> + '_ {
            (0..self.rays.len()).filter_map(move |i| {
                let b = &self.blocks[i / LANES];
                let columns = [b.roof_at_zero, b.per_metre, b.after, b.before, b.enter];
                let [at_zero, per_metre, after, before, enter] = columns.map(|lanes| lanes.as_array()[i % LANES]);
                let roof = at_zero + per_metre * height_m;
                (roof >= after && roof < before).then(|| (i, roof.max(enter)))
            })
        }
    }

    fn one_by_one(stretches: &Stretches, height_m: f32) -> [f64; 6] {
        let mut sums = [0.0; 5];
        let (mut agreement, mut n) = (0.0, 0.0);
        for (i, depth) in stretches.depths(height_m) {
            let b = &stretches.blocks[i / LANES];
            let columns = [b.per_metre, b.enter, b.v, b.p, b.x, b.y, b.lifted];
            let [per_metre, enter, v, p, x, y, lifted] = columns.map(|lanes| f64::from(lanes.as_array()[i % LANES]));
            let [depth, reference] = [depth, stretches.reference].map(f64::from);
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

    fn some_stretches(n: usize, seed: u64) -> Stretches {
        use rand::Rng as _;
        let mut rng = crate::seed::stream(seed, "stretches", &[]);
        let mut stretches = Stretches::relative_to(150.0);
        for ray in 0..n as u32 {
            let enter = rng.random_range(100.0..160.0_f32);
            stretches.push(&Stretch {
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
        stretches
    }
}
