//! Bounds on many rays from one point: where packets can be, and which boxes they may meet.
//!
//! Intervals of directions, axis by axis. With `low` and `high` the box's faces seen from the origin, and `d` the
//! directions of a packet's rays along the axis:
//!
//! ```text
//! enter ≥ low / max d   if low > 0,    high / min d   if high < 0
//! leave ≤ high / min d  if min d > 0,  low / max d    if max d < 0
//! ```
//!
//! Source: Reshetov, Soupikov, Hurley, "Multi-Level Ray Tracing", TOG 24:1176, 2005.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use fearless_simd::{Simd, f32x4, f32x8, mask32x8, prelude::*};
use glam::Vec3;

use super::tile::LANES;
use crate::ray::Aabb;

/// Bounds on where the rays of each packet (a lane) can be, for boxes on either side of their common origin along an
/// axis.
#[derive(Clone, Copy)]
pub(super) struct Cones<S: Simd> {
    /// Times the way to the box's near face, where the origin is not between the two: no ray is there before. Infinite
    /// where none goes that way.
    soonest: [SideFactors<S>; 3],
    /// Times the way to a face that no ray starts beyond: every ray is past it after. Infinite where one never gets
    /// there.
    latest: [SideFactors<S>; 3],
}

/// A factor for faces above the origin along an axis, and one for those below.
#[derive(Clone, Copy)]
struct SideFactors<S: Simd> {
    above: f32x8<S>,
    below: f32x8<S>,
}

impl<S: Simd> SideFactors<S> {
    /// The soonest and the latest, from the directions of all packets' rays along the axis.
    #[inline(always)]
    fn pair(simd: S, directions: [f32x8<S>; LANES]) -> (Self, Self) {
        let (least, most) = (least_of_packets(simd, directions), greatest_of_packets(simd, directions));
        let soonest = Self { above: over_positive(most), below: over_negative(least) };
        (soonest, Self { above: over_positive(least), below: over_negative(most) })
    }
}

/// `1 / d`, infinite unless `d` is positive.
#[inline(always)]
fn over_positive<S: Simd>(d: f32x8<S>) -> f32x8<S> {
    d.simd_gt(0.0).select(1.0 / d, f32x8::splat(d.simd, f32::INFINITY))
}

/// `1 / d`, infinite below zero unless `d` is negative.
#[inline(always)]
fn over_negative<S: Simd>(d: f32x8<S>) -> f32x8<S> {
    d.simd_lt(0.0).select(1.0 / d, f32x8::splat(d.simd, f32::NEG_INFINITY))
}

impl<S: Simd> Cones<S> {
    /// Around packets, from the directions of their rays, one array per axis.
    #[inline(always)]
    pub fn around(simd: S, directions: [[f32x8<S>; LANES]; 3]) -> Self {
        let [x, y, z] = directions;
        let ((soonest_x, latest_x), (soonest_y, latest_y), (soonest_z, latest_z)) =
            (SideFactors::pair(simd, x), SideFactors::pair(simd, y), SideFactors::pair(simd, z));
        Self { soonest: [soonest_x, soonest_y, soonest_z], latest: [latest_x, latest_y, latest_z] }
    }

    /// Ray parameters at which the cones enter a box, by packet, and which of them may do so before `reach`.
    #[inline(always)]
    pub fn meet(&self, bounds: &Aabb, origin: Vec3, reach: f32x8<S>) -> (f32x8<S>, mask32x8<S>) {
        let (mut enter, mut leave) = (f32x8::splat(reach.simd, 0.0), reach);
        for axis in 0..3 {
            let (low, high) = (bounds.min[axis] - origin[axis], bounds.max[axis] - origin[axis]);
            let (soonest, latest) = (&self.soonest[axis], &self.latest[axis]);
            if low > 0.0 {
                enter = enter.max(soonest.above * low);
            } else if high < 0.0 {
                enter = enter.max(soonest.below * high);
            }
            // A face at the origin itself would make 0 · ∞.
            if high > 0.0 {
                leave = leave.min(latest.above * high);
            }
            if low < 0.0 {
                leave = leave.min(latest.below * low);
            }
        }
        (enter, enter.simd_le(leave))
    }
}

/// One value per packet: the greatest of its lanes.
#[inline(always)]
pub(super) fn greatest_of_packets<S: Simd>(simd: S, packets: [f32x8<S>; LANES]) -> f32x8<S> {
    let [a, b, c, d, e, f, g, h] = packets;
    simd.combine_f32x4(greatest_of_four([a, b, c, d]), greatest_of_four([e, f, g, h]))
}

/// One value per packet: the least of its lanes.
#[inline(always)]
fn least_of_packets<S: Simd>(simd: S, [a, b, c, d, e, f, g, h]: [f32x8<S>; LANES]) -> f32x8<S> {
    -greatest_of_packets(simd, [-a, -b, -c, -d, -e, -f, -g, -h])
}

/// Transposes while it compares: lanes of two packets alternate, then those of all four.
#[inline(always)]
fn greatest_of_four<S: Simd>([a, b, c, d]: [f32x8<S>; 4]) -> f32x4<S> {
    let ac = greatest_in_turn(greatest_of_halves(a), greatest_of_halves(c));
    let bd = greatest_in_turn(greatest_of_halves(b), greatest_of_halves(d));
    greatest_in_turn(ac, bd)
}

#[inline(always)]
fn greatest_of_halves<S: Simd>(lanes: f32x8<S>) -> f32x4<S> {
    let (low, high) = lanes.simd.split_f32x8(lanes);
    low.max(high)
}

#[inline(always)]
fn greatest_in_turn<S: Simd>(a: f32x4<S>, b: f32x4<S>) -> f32x4<S> {
    a.zip_low(b).max(a.zip_high(b))
}
