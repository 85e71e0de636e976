//! One building as a vertical prism: a footprint, its ground level, and a height to be found.

use fearless_simd::{Simd, f32x8, prelude::*};
use geo_types::{LineString, Polygon};
use glam::{Vec2, Vec3};

use crate::frames::LocalOrigin;
use crate::ray::{Aabb, Ray};
use crate::terrain::GroundLevel;

/// Ray-prism interval: the part of a ray inside a footprint, in the ray's own parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayInterval {
    /// Ray parameter at which the ray enters the footprint (−∞ for a vertical ray inside it).
    pub enter: f32,
    /// Ray parameter at which it leaves (+∞ for a vertical ray inside it).
    pub leave: f32,
}

/// A footprint with its ground level, in the local frame, metres.
#[derive(Debug, Clone)]
pub struct Prism {
    /// Corners of all rings, each ring closed (first corner repeated); exterior first.
    corners: Vec<Vec2>,
    /// Start of each ring in `corners`, and the end.
    ring_starts: Vec<usize>,
    /// Level that heights count from.
    pub ground_z: f32,
    /// Lowest ground under the footprint.
    pub base_z: f32,
}

/// Circle on the ground, local frame, metres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Circle {
    centre: Vec2,
    radius: f32,
}

impl Circle {
    /// Whether a ray passes over it, however high.
    pub(crate) fn is_crossed(&self, ray: &Ray) -> bool {
        let along = ray.direction.truncate();
        along.perp_dot(self.centre - ray.origin.truncate()).abs() <= self.radius * along.length() || along == Vec2::ZERO
    }
}

impl Prism {
    /// A ray counts as upright if the squared length of its horizontal direction is less.
    pub(crate) const UPRIGHT_BELOW: f32 = 1e-12;

    /// From a map-frame footprint.
    #[must_use]
    pub fn new(polygon: &Polygon<f64>, ground: GroundLevel, origin: LocalOrigin) -> Self {
        let mut corners = Vec::new();
        let mut ring_starts = vec![0];
        for ring in std::iter::once(polygon.exterior()).chain(polygon.interiors()) {
            corners.extend(local_ring(ring, origin));
            ring_starts.push(corners.len());
        }
        let level = |z_m: f64| (z_m - origin.0.z) as f32;
        Self { corners, ring_starts, ground_z: level(ground.reference_m), base_z: level(ground.lowest_m) }
    }

    /// The same on the same ground with another footprint, map frame.
    #[must_use]
    pub fn with_footprint(&self, polygon: &Polygon<f64>, origin: LocalOrigin) -> Self {
        let anywhere = GroundLevel::flat(0.0);
        Self { ground_z: self.ground_z, base_z: self.base_z, ..Self::new(polygon, anywhere, origin) }
    }

    /// The same moved along the ground, metres, after all walls have moved outwards by so much (negative: inwards).
    #[must_use]
    pub fn moved(&self, by: Vec2, outwards_m: f32) -> Self {
        let mut moved = self.clone();
        moved.corners.clear();
        for ring in self.rings() {
            let corners = &ring[..ring.len() - 1];
            let n = corners.len();
            let area: f32 = ring.windows(2).map(|e| e[0].perp_dot(e[1])).sum();
            let is_exterior = moved.corners.is_empty();
            let outwards = if (area > 0.0) == is_exterior { outwards_m } else { -outwards_m };
            let first = moved.corners.len();
            for i in 0..n {
                let (before, at, after) = (corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]);
                let normal = |edge: Vec2| -edge.normalize_or_zero().perp();
                let (a, b) = (normal(at - before), normal(after - at));
                // The corner of the two moved walls, no farther away than twice as much.
                let corner = (a + b) / (1.0 + a.dot(b)).max(0.5);
                moved.corners.push(at + by + outwards * corner);
            }
            moved.corners.push(moved.corners[first]);
        }
        moved
    }

    /// The same drawn out along a way, metres: by nothing where a corner lies at `fixed` along it, by all of it at `free`.
    #[must_use]
    pub fn drawn_out(&self, by: Vec2, fixed: f32, free: f32) -> Self {
        let along = by.normalize_or_zero();
        let mut drawn = self.clone();
        for corner in &mut drawn.corners {
            *corner += (along.dot(*corner) - fixed) / (free - fixed) * by;
        }
        drawn
    }

    /// The rings, closed, exterior first.
    pub fn rings(&self) -> impl Iterator<Item = &[Vec2]> {
        self.ring_starts.windows(2).map(|w| &self.corners[w[0]..w[1]])
    }

    /// The walls' traces: `(start, end)` of every edge of every ring.
    pub fn edges(&self) -> impl Iterator<Item = (Vec2, Vec2)> {
        self.rings().flat_map(|ring| ring.windows(2).map(|e| (e[0], e[1])))
    }

    /// The box around the prism from its lowest ground to a roof level.
    #[must_use]
    pub fn bounds_below(&self, roof_z: f32) -> Aabb {
        let bottom = self.base_z.min(roof_z);
        Aabb::around(self.corners.iter().flat_map(|c| [c.extend(bottom), c.extend(roof_z)]))
    }

    /// Middle of the footprint's bounding box at a level.
    #[must_use]
    pub fn centre_at(&self, z: f32) -> Vec3 {
        let b = self.bounds_below(z);
        (0.5 * (b.min + b.max)).truncate().extend(z)
    }

    /// The intervals of a ray over the footprint, in order, pushed to `intervals`.
    ///
    /// A ray meets a ring's edges an even number of times, by a half-open rule on which side of the ray the corners
    /// lie; sorted meeting points pair up to intervals inside (even-odd rule, so holes cut them).
    pub fn intervals(&self, ray: &Ray, intervals: &mut Vec<RayInterval>) {
        /// Most edges that a typical footprint's ray meets; more spill to the heap.
        const INLINE: usize = 16;
        let origin = ray.origin.truncate();
        let direction = ray.direction.truncate();
        let length_squared = direction.length_squared();
        if Self::is_upright(length_squared) {
            if self.contains(origin) {
                intervals.push(RayInterval { enter: f32::NEG_INFINITY, leave: f32::INFINITY });
            }
            return;
        }
        let mut meets = [0.0_f32; INLINE];
        let mut spill = Vec::new();
        let mut n = 0;
        for ring in self.rings() {
            let mut previous = ring[0] - origin;
            let mut previous_side = direction.perp_dot(previous);
            for &corner in &ring[1..] {
                let next = corner - origin;
                let side = direction.perp_dot(next);
                if (previous_side >= 0.0) != (side >= 0.0) {
                    let along = previous_side / (previous_side - side);
                    let meet = direction.dot(previous + along * (next - previous)) / length_squared;
                    if n < INLINE {
                        meets[n] = meet;
                    } else {
                        if spill.is_empty() {
                            spill.extend_from_slice(&meets);
                        }
                        spill.push(meet);
                    }
                    n += 1;
                }
                previous = next;
                previous_side = side;
            }
        }
        let meets = if n <= INLINE { &mut meets[..n] } else { &mut spill[..] };
        meets.sort_unstable_by(f32::total_cmp);
        intervals.extend(
            meets
                .chunks_exact(2)
                .filter(|m| m[1] > m[0] && m[1] > 0.0)
                .map(|m| RayInterval { enter: m[0], leave: m[1] }),
        );
    }

    /// The circle around the footprint's bounding box: rays that pass it by meet no wall.
    #[must_use]
    pub(crate) fn circle(&self) -> Circle {
        let Aabb { min, max } = self.bounds_below(0.0);
        Circle { centre: 0.5 * (min + max).truncate(), radius: 0.5 * (max - min).truncate().length() }
    }

    /// Whether a ray counts as upright, by the squared length of its horizontal direction.
    #[must_use]
    pub fn is_upright(length_squared: f32) -> bool {
        length_squared < Self::UPRIGHT_BELOW
    }

    /// The same for eight rays from one point, none of them upright: where each first enters and last leaves the
    /// footprint, and how many edges it meets. Where it meets two, these are the one interval there is, to the bit; it
    /// counts if it ends in front of the origin and is longer than nothing.
    #[expect(clippy::inline_always, reason = "registers are as wide as where it is inlined")]
    #[inline(always)]
    pub(crate) fn intervals_of_eight<S: Simd>(
        &self,
        simd: S,
        origin: Vec2,
        [x, y]: [f32x8<S>; 2],
        length_squared: f32x8<S>,
    ) -> (f32x8<S>, f32x8<S>, f32x8<S>) {
        let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let never = f32x8::splat(simd, f32::INFINITY);
        let (mut enter, mut leave, mut n) = (never, -never, zero);
        for ring in self.rings() {
            let mut previous = ring[0] - origin;
            let mut previous_side = side_of([x, y], previous);
            let mut was_left = previous_side.simd_ge(zero);
            for &corner in &ring[1..] {
                let next = corner - origin;
                let side = side_of([x, y], next);
                let is_left = side.simd_ge(zero);
                let meets = was_left ^ is_left;
                if meets.any_true() {
                    let along = previous_side / (previous_side - side);
                    let edge = next - previous;
                    let meet_x = along * edge.x + previous.x;
                    let meet_y = along * edge.y + previous.y;
                    let meet = (x * meet_x + y * meet_y) / length_squared;
                    enter = meets.select(enter.min(meet), enter);
                    leave = meets.select(leave.max(meet), leave);
                    n = meets.select(n + one, n);
                }
                previous = next;
                previous_side = side;
                was_left = is_left;
            }
        }
        (enter, leave, n)
    }

    /// Whether a point lies in the footprint (even-odd rule).
    #[must_use]
    pub fn contains(&self, point: Vec2) -> bool {
        self.edges().fold(false, |inside, (a, b)| {
            let straddles = (a.y > point.y) != (b.y > point.y);
            inside ^ (straddles && point.x < (b.x - a.x) * (point.y - a.y) / (b.y - a.y) + a.x)
        })
    }

    /// Area of the footprint, m².
    #[must_use]
    pub fn area_m2(&self) -> f32 {
        // Rings of a valid footprint turn opposite ways, so that their signed areas add up to the area.
        let twice: f32 = self.edges().map(|(a, b)| a.perp_dot(b)).sum();
        0.5 * twice.abs()
    }
}

/// On which side of eight directions from the origin a corner lies: positive to their left.
#[expect(clippy::inline_always, reason = "registers are as wide as where it is inlined")]
#[inline(always)]
fn side_of<S: Simd>([x, y]: [f32x8<S>; 2], corner: Vec2) -> f32x8<S> {
    x * corner.y - y * corner.x
}

fn local_ring(ring: &LineString<f64>, origin: LocalOrigin) -> impl Iterator<Item = Vec2> + '_ {
    ring.coords().map(move |c| Vec2::new((c.x - origin.0.x) as f32, (c.y - origin.0.y) as f32))
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;

    fn courtyard() -> Prism {
        let polygon = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)],
            interiors: [[(x: 3.0, y: 3.0), (x: 3.0, y: 7.0), (x: 7.0, y: 7.0), (x: 7.0, y: 3.0)]],
        );
        Prism::new(&polygon, GroundLevel { lowest_m: 0.0, ..GroundLevel::flat(1.0) }, LocalOrigin(glam::DVec3::ZERO))
    }

    fn intervals(origin: [f32; 3], direction: [f32; 3]) -> Vec<(f32, f32)> {
        let mut found = Vec::new();
        courtyard().intervals(&Ray::new(origin.into(), direction.into()), &mut found);
        found.into_iter().map(|c| (c.enter, c.leave)).collect()
    }

    #[test]
    fn a_courtyard_cuts_the_ray_in_two() {
        assert_eq!(intervals([-5.0, 5.0, 9.0], [1.0, 0.0, -0.1]), [(5.0, 8.0), (12.0, 15.0)]);
    }

    #[test]
    fn a_ray_along_the_diagonal_through_corners_pairs_up() {
        assert_eq!(intervals([-1.0, -1.0, 9.0], [1.0, 1.0, -1.0]), [(1.0, 4.0), (8.0, 11.0)]);
    }

    #[test]
    fn a_vertical_ray_is_inside_or_outside_for_ever() {
        assert_eq!(intervals([1.0, 1.0, 9.0], [0.0, 0.0, -1.0]), [(f32::NEG_INFINITY, f32::INFINITY)]);
        assert_eq!(intervals([5.0, 5.0, 9.0], [0.0, 0.0, -1.0]), []);
    }

    #[test]
    fn walls_that_move_outwards_make_the_building_larger_and_its_courtyard_smaller() {
        let (given, moved) = (courtyard(), courtyard().moved(Vec2::new(3.0, -2.0), 0.5));
        assert_eq!(given.moved(Vec2::ZERO, 0.0).corners, given.corners);
        let [out, hole] = [0, 1].map(|ring| {
            let size = |prism: &Prism| {
                let ring = prism.rings().nth(ring).unwrap();
                let (low, high) =
                    ring.iter().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(l, h), c| (l.min(*c), h.max(*c)));
                (low, high)
            };
            let ((low, high), (moved_low, moved_high)) = (size(&given), size(&moved));
            [moved_low - low, moved_high - high]
        });
        assert_eq!(out, [Vec2::new(2.5, -2.5), Vec2::new(3.5, -1.5)]);
        assert_eq!(hole, [Vec2::new(3.5, -1.5), Vec2::new(2.5, -2.5)]);
    }

    #[test]
    fn a_prism_is_drawn_out_on_one_side() {
        let drawn = courtyard().drawn_out(Vec2::new(2.0, 0.0), 0.0, 10.0);
        let bounds = drawn.bounds_below(1.0);
        assert_eq!((bounds.min.x, bounds.max.x, bounds.max.y), (0.0, 12.0, 10.0));
        assert_eq!(drawn.rings().nth(1).unwrap()[0], Vec2::new(3.6, 3.0), "the courtyard with it");
    }

    #[test]
    fn the_area_leaves_the_courtyard_out() {
        assert_eq!(courtyard().area_m2(), 84.0);
    }
}
