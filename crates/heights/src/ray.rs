//! Rays and axis-aligned boxes: what the model and the tracer both speak of.
//!
//! A ray's point at `t` is `origin + t · direction`. Frame: [`crate::frames::Local`], metres, `f32`.

use glam::Vec3;

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Corner with the lowest x, y and z.
    pub min: Vec3,
    /// Corner with the highest x, y and z.
    pub max: Vec3,
}

impl Aabb {
    /// The box of nothing: growing it by a point gives that point.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box around some points.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Middle of the box.
    #[must_use]
    pub fn centre(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Half its surface: what a random ray's chance to meet it is proportional to. Square metres.
    #[must_use]
    pub fn half_area(&self) -> f32 {
        let d = (self.max - self.min).max(Vec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// A ray `origin + t · direction`, with what the box test needs worked out once.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Point at which the ray begins, `t = 0`.
    pub origin: Vec3,
    /// Direction, any length: `t` is in its units.
    pub direction: Vec3,
    inverse: Vec3,
}

impl Ray {
    /// From a start and a direction of any length.
    #[must_use]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, inverse: direction.recip() }
    }

    /// The point at `t`.
    #[must_use]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }

    /// Where the ray enters the box from `min` to `max`, if it does so before `t_max`. Slab test; a ray in a face's plane may be told either
    /// way, never lost between two boxes that share the face.
    #[must_use]
    #[inline]
    pub fn enters(&self, min: Vec3, max: Vec3, t_max: f32) -> Option<f32> {
        let t0 = (min - self.origin) * self.inverse;
        let t1 = (max - self.origin) * self.inverse;
        // Where a zero direction meets a face, 0 · ∞ = NaN. `least` and `most` then take their second operand: an axis
        // whose far plane is NaN drops out, one whose near plane is NaN misses.
        let enter = most(least(t0.x, t1.x), most(least(t0.y, t1.y), most(least(t0.z, t1.z), 0.0)));
        let leave = least(most(t0.x, t1.x), least(most(t0.y, t1.y), least(most(t0.z, t1.z), t_max)));
        (enter <= leave).then_some(enter)
    }
}

/// The smaller one, the second where either is `NaN`: one machine instruction, unlike `f32::min`.
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger one, the second where either is `NaN`.
fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
