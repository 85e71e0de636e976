//! Eight numbers side by side, as vector registers load them.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

/// Count of numbers side by side.
pub const LANES: usize = 8;

/// One number per lane.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub struct Lanes([f32; LANES]);

impl Lanes {
    /// The same in every lane.
    #[must_use]
    pub const fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    /// Number in one lane.
    #[must_use]
    pub fn get(&self, lane: usize) -> f32 {
        self.0[lane]
    }

    /// Sets the number in one lane.
    pub fn set(&mut self, lane: usize, value: f32) {
        self.0[lane] = value;
    }

    /// The lanes as a register.
    #[inline(always)]
    pub fn load<S: Simd>(&self, simd: S) -> f32x8<S> {
        f32x8::from_slice(simd, &self.0)
    }

    /// Takes the lanes from a register.
    #[inline(always)]
    pub fn store<S: Simd>(&mut self, register: f32x8<S>) {
        register.store_slice(&mut self.0);
    }
}

/// Every kind of vector registers that this processor has: tests hold them against each other.
#[cfg(test)]
pub fn levels() -> Vec<fearless_simd::Level> {
    use fearless_simd::Level;
    let best = Level::new();
    #[cfg(target_arch = "x86_64")]
    let some = [best.as_sse4_2().map(Simd::level), best.as_avx2().map(Simd::level)];
    #[cfg(not(target_arch = "x86_64"))]
    let some = [None];
    [Level::baseline(), best].into_iter().chain(some.into_iter().flatten()).collect()
}
