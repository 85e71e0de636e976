//! A tile of an image at once: 64 rays from one point, as eight packets of eight neighbours in vector registers.
//!
//! The hierarchy is walked once per tile: each box is held against the cones around all eight packets, one per lane.
//! Prisms whose boxes a cone may meet are then met by the packet's eight rays, one per lane, with the arithmetic of
//! the single ray ([`Prism::crossings`]) in its order: depths and faces are the same to the bit. Two ways of one
//! packet over a footprint (courtyards, L-shaped outlines) are left to the single ray, lane by lane.
//!
//! Source of the idea: Wald, Slusallek, Benthin, Wagner, "Interactive Rendering with Coherent Ray Tracing", CGF
//! 20:153, 2001; bounds over many rays as in Reshetov, Soupikov, Hurley, "Multi-Level Ray Tracing", TOG 24:1176, 2005.

use glam::Vec3;
use wide::f32x8;

use super::bvh::Probe;
use super::image::{Hit, SceneTracer, Solid};
use crate::ray::{Aabb, Ray};
use crate::scene::{Crossing, Prism};

/// Rays of a packet, and packets of a tile.
pub(super) const LANES: usize = 8;
/// Rays of a tile.
pub(super) const TILE: usize = LANES * LANES;

/// One value per ray of a packet, or per packet of a tile.
type Lanes = f32x8;

/// Eight rays and what they met so far.
#[derive(Clone, Copy)]
struct Packet {
    direction: [Lanes; 3],
    /// Of the horizontal direction.
    length_squared: Lanes,
    nearest: Lanes,
    /// [`Hit::code`]s, as bits.
    code: Lanes,
}

/// Bounds on where the rays of each packet (a lane) can be, for boxes on either side of their common origin along an
/// axis.
#[derive(Clone, Copy)]
struct Cones {
    /// Times the way to the box's near face, where the origin is not between the two: no ray is there before. Infinite
    /// where none goes that way.
    soonest: [Side; 3],
    /// Times the way to a face that no ray starts beyond: every ray is past it after. Infinite where one never gets
    /// there.
    latest: [Side; 3],
}

/// A factor for boxes above the origin along an axis, and one for those below.
#[derive(Clone, Copy)]
struct Side {
    above: Lanes,
    below: Lanes,
}

/// The rays of a tile on their way through a scene.
pub(super) struct Tile<'a> {
    tracer: &'a SceneTracer<'a>,
    origin: Vec3,
    packets: [Packet; LANES],
    cones: Cones,
    /// By packet: the farthest that one of its rays still looks.
    reach: Lanes,
    scratch: Vec<Crossing>,
}

impl<'a> Tile<'a> {
    /// From 64 rays out of one point, in packets of eight neighbours; `None` = no ray.
    pub fn new(tracer: &'a SceneTracer<'a>, rays: &[Option<Ray>; TILE]) -> Option<Self> {
        let any = rays.iter().flatten().find(|ray| !is_upright(ray))?;
        let packets = std::array::from_fn(|i| Packet::new(tracer, &rays[LANES * i..LANES * (i + 1)], any));
        let cones = Cones::around(&packets);
        let reach = Lanes::new(std::array::from_fn(|i| packets[i].reach()));
        Some(Self { tracer, origin: any.origin, packets, cones, reach, scratch: Vec::new() })
    }

    /// What every ray meets first; for no ray and upright ones nothing.
    pub fn trace(mut self) -> [Hit; TILE] {
        self.tracer.bvh().walk(&mut self);
        std::array::from_fn(|i| {
            let packet = &self.packets[i / LANES];
            let lane = i % LANES;
            Hit { t: packet.nearest.to_array()[lane], code: packet.code.to_array()[lane].to_bits() }
        })
    }

    /// Where the cones enter a box, by packet, and which of them may do so within reach.
    fn meets(&self, bounds: &Aabb) -> (Lanes, Lanes) {
        let (mut enter, mut leave) = (Lanes::ZERO, self.reach);
        for axis in 0..3 {
            let (low, high) = (bounds.min[axis] - self.origin[axis], bounds.max[axis] - self.origin[axis]);
            let (soonest, latest) = (&self.cones.soonest[axis], &self.cones.latest[axis]);
            if low > 0.0 {
                enter = enter.fast_max(Lanes::splat(low) * soonest.above);
            } else if high < 0.0 {
                enter = enter.fast_max(Lanes::splat(high) * soonest.below);
            }
            if high > 0.0 {
                leave = leave.fast_min(Lanes::splat(high) * latest.above);
            }
            if low < 0.0 {
                leave = leave.fast_min(Lanes::splat(low) * latest.below);
            }
        }
        (enter, enter.simd_le(leave))
    }
}

impl Probe for Tile<'_> {
    fn enters(&self, bounds: &Aabb) -> Option<f32> {
        let (enter, may_meet) = self.meets(bounds);
        may_meet.any().then(|| -greatest(-may_meet.select(enter, Lanes::splat(f32::INFINITY))))
    }

    fn reach(&self) -> f32 {
        greatest(self.reach)
    }

    fn visit(&mut self, idx: usize) {
        let mut may_meet = self.meets(self.tracer.bounds(idx)).1.to_bitmask();
        let solid = self.tracer.solid(idx);
        while may_meet != 0 {
            let i = may_meet.trailing_zeros() as usize;
            may_meet &= may_meet - 1;
            self.packets[i].meet(self.origin, (idx, &solid), &mut self.scratch);
            self.reach.as_mut_array()[i] = self.packets[i].reach();
        }
    }
}

impl Packet {
    /// Eight rays, each with the ground in front of it; missing and upright ones look nowhere, along `any`.
    fn new(tracer: &SceneTracer<'_>, rays: &[Option<Ray>], any: &Ray) -> Self {
        let rays: [Option<&Ray>; LANES] = std::array::from_fn(|i| rays[i].as_ref().filter(|ray| !is_upright(ray)));
        let ground = rays.map(|ray| ray.map_or(Hit::BLOCKED, |ray| tracer.ground(ray)));
        let axis = |axis: usize| Lanes::new(rays.map(|ray| ray.unwrap_or(any).direction[axis]));
        let [x, y, z] = [axis(0), axis(1), axis(2)];
        Self {
            direction: [x, y, z],
            length_squared: x * x + y * y,
            nearest: Lanes::new(ground.map(|hit| hit.t)),
            code: Lanes::new(ground.map(|hit| f32::from_bits(hit.code))),
        }
    }

    /// The farthest that one of the rays still looks; never infinite, so that a box that no ray can reach is out of it.
    fn reach(&self) -> f32 {
        greatest(self.nearest).min(f32::MAX)
    }

    /// Meets all rays with one prism.
    fn meet(&mut self, origin: Vec3, (idx, solid): (usize, &Solid<'_>), scratch: &mut Vec<Crossing>) {
        let [x, y, z] = self.direction;
        let (enter, leave, n) = solid.prism.crossings_of_eight(origin.truncate(), [x, y], self.length_squared);
        let is_over = n.simd_eq(Lanes::splat(2.0)) & leave.simd_gt(enter) & leave.simd_gt(Lanes::ZERO);
        let (eye, foot, top) = (Lanes::splat(origin.z), Lanes::splat(solid.foot_z), Lanes::splat(solid.roof_z));
        let from = enter.fast_max(Lanes::ZERO);
        let level = eye + from * z;
        let below_roof = level.simd_le(top);
        let roof = (top - eye) / z;
        let meets_wall = below_roof & enter.simd_gt(Lanes::ZERO) & level.simd_ge(foot);
        let meets_roof = !below_roof & z.simd_lt(Lanes::ZERO) & roof.simd_lt(leave);
        let t = below_roof.bitselect(from, roof);
        let [wall_code, roof_code] = [Hit::wall(idx), Hit::roof(idx)].map(|code| Lanes::splat(f32::from_bits(code)));
        self.take(is_over & (meets_wall | meets_roof), t, below_roof.bitselect(wall_code, roof_code));

        let mut many = n.simd_gt(Lanes::splat(2.0)).to_bitmask();
        while many != 0 {
            let lane = many.trailing_zeros() as usize;
            many &= many - 1;
            let ray = Ray::new(origin, Vec3::from_array(self.direction.map(|axis| axis.to_array()[lane])));
            let before = Hit { t: self.nearest.to_array()[lane], code: self.code.to_array()[lane].to_bits() };
            let hit = before.or_nearer(&ray, (idx, solid), scratch);
            self.nearest.as_mut_array()[lane] = hit.t;
            self.code.as_mut_array()[lane] = f32::from_bits(hit.code);
        }
    }

    /// Keeps what is nearer, and of equals the one with the lower code.
    fn take(&mut self, hits: Lanes, t: Lanes, code: Lanes) {
        let mut closer = hits & t.simd_lt(self.nearest);
        let equal = hits & t.simd_eq(self.nearest);
        if equal.any() {
            let (ours, theirs) = (self.code.to_array(), code.to_array());
            let bits = std::array::from_fn(|i| if theirs[i].to_bits() < ours[i].to_bits() { u32::MAX } else { 0 });
            closer |= equal & Lanes::new(bits.map(f32::from_bits));
        }
        self.nearest = closer.bitselect(t, self.nearest);
        self.code = closer.bitselect(code, self.code);
    }
}

impl Cones {
    fn around(packets: &[Packet; LANES]) -> Self {
        let of_axis = |axis: usize| {
            let least = packets.map(|packet| -greatest(-packet.direction[axis]));
            let most = packets.map(|packet| greatest(packet.direction[axis]));
            let positive = |d: f32| if d > 0.0 { d.recip() } else { f32::INFINITY };
            let negative = |d: f32| if d < 0.0 { d.recip() } else { f32::NEG_INFINITY };
            let lanes = |values: [f32; LANES]| Lanes::new(values);
            let soonest = Side { above: lanes(most.map(positive)), below: lanes(least.map(negative)) };
            let latest = Side { above: lanes(least.map(positive)), below: lanes(most.map(negative)) };
            (soonest, latest)
        };
        let axes = [of_axis(0), of_axis(1), of_axis(2)];
        Self { soonest: axes.map(|a| a.0), latest: axes.map(|a| a.1) }
    }
}

/// Whether a ray has no horizontal direction that footprints could be cut along.
pub(super) fn is_upright(ray: &Ray) -> bool {
    Prism::is_upright(ray.direction.truncate().length_squared())
}

fn greatest(lanes: Lanes) -> f32 {
    let [a, b, c, d, e, f, g, h] = lanes.to_array();
    let most = |a: f32, b: f32| if a > b { a } else { b };
    most(most(most(a, b), most(c, d)), most(most(e, f), most(g, h)))
}

#[cfg(test)]
mod tests {
    use geo_types::{Polygon, polygon};
    use glam::{DMat3, DVec2, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::camera::Camera;
    use crate::frames::Rigid;
    use crate::ids::BuildingIdx;
    use crate::raster::Raster;
    use crate::render::PlacedCamera;
    use crate::render::image::Face;
    use crate::scene::{HeightBounds, Scene};
    use crate::terrain::{Dem, GroundLevel, Terrain};

    /// Squares, two of them wall to wall and two over one another, a courtyard, an L and a star of many corners, on
    /// hills or on a plain.
    fn scene(terrain: &Terrain) -> Scene {
        let outline = |corners: &[(f64, f64)]| Polygon::new(corners.to_vec().into(), Vec::new());
        let square = |x: f64, y: f64, side: f64| outline(&[(x, y), (x + side, y), (x + side, y + side), (x, y + side)]);
        let courtyard = polygon!(
            exterior: [(x: 30.0, y: 0.0), (x: 50.0, y: 0.0), (x: 50.0, y: 20.0), (x: 30.0, y: 20.0)],
            interiors: [[(x: 36.0, y: 6.0), (x: 36.0, y: 14.0), (x: 44.0, y: 14.0), (x: 44.0, y: 6.0)]],
        );
        let corner = outline(&[(30.0, 28.0), (52.0, 28.0), (52.0, 35.0), (38.0, 35.0), (38.0, 50.0), (30.0, 50.0)]);
        let ray = |i: i32| {
            let at =
                DVec2::new(-20.0, 20.0) + (7.0 + 5.0 * f64::from(i % 2)) * DVec2::from_angle(f64::from(i) * 0.3142);
            (at.x, at.y)
        };
        let star = Polygon::new((0..20).map(ray).collect::<Vec<_>>().into(), Vec::new());
        let polygons = [
            square(0.0, 0.0, 12.0),
            square(12.0, 0.0, 9.0),
            square(0.0, 25.0, 15.0),
            square(10.0, 30.0, 12.0),
            courtyard,
            corner,
            star,
        ];
        let footprints: Vec<_> =
            polygons.iter().map(|p| (p, GroundLevel { reference_m: 0.5, lowest_m: 0.0 })).collect();
        Scene::new(&footprints, terrain, HeightBounds { min_m: 2.0, max_m: 60.0 }, 150.0)
    }

    fn hills() -> Terrain {
        let z = |i: usize| ((i % 50) as f32 * 0.3).sin() * 1.5 + ((i / 50) as f32 * 0.2).cos() - 2.5;
        let heights = Raster::from_vec(50, 50, (0..2500).map(z).collect()).unwrap();
        Terrain::Grid(Dem::new(heights, -90.0, 110.0, 4.0, 4.0).unwrap())
    }

    fn camera(scene: &Scene, azimuth: f64, tilt: f64, height_m: f64) -> PlacedCamera {
        let rotation = DMat3::from_rotation_x(std::f64::consts::PI - tilt) * DMat3::from_rotation_z(azimuth);
        let look = rotation.transpose() * DVec3::Z;
        let eye = DVec3::new(15.0, 20.0, 0.0) - look * (height_m / -look.z);
        // No multiple of a tile's side either way.
        PlacedCamera::new(Camera::pinhole(75, 53, 60.0), Rigid::from_rotation_and_centre(rotation, eye), scene.origin)
    }

    /// Nearest hit among all prisms, without a hierarchy.
    fn linear(tracer: &SceneTracer<'_>, n_prisms: usize, ray: &Ray) -> Hit {
        let mut scratch = Vec::new();
        let nearer = |hit: Hit, idx| hit.or_nearer(ray, (idx, &tracer.solid(idx)), &mut scratch);
        (0..n_prisms).fold(tracer.ground(ray), nearer)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn packets_single_rays_and_a_linear_search_see_the_same_to_the_bit(
            heights in prop::array::uniform7(2.0..60.0_f32),
            azimuth in -3.2..3.2_f64, tilt in 0.0..1.5_f64, height_m in 20.0..150.0_f64,
            is_straight in any::<bool>(), is_hilly in any::<bool>(),
        ) {
            let terrain = if is_hilly { hills() } else { Terrain::Constant(0.0) };
            let scene = scene(&terrain);
            // Straight views have rays in the planes of walls, and some upright ones.
            let (azimuth, tilt) = if is_straight {
                ((azimuth * 0.63).round() * std::f64::consts::FRAC_PI_2, (tilt * 0.6).round())
            } else {
                (azimuth, tilt)
            };
            let placed = camera(&scene, azimuth, tilt, height_m);
            let tracer = SceneTracer::new(&scene, &heights);
            let image = tracer.render(&placed);
            let mut scratch = Vec::new();
            for row in 0..53 {
                for col in 0..75 {
                    let ray = placed.ray(DVec2::new(col as f64 + 0.5, row as f64 + 0.5)).unwrap();
                    let (depth, face) = tracer.trace(&ray, &mut scratch);
                    let in_image = (image.depth[(col, row)].to_bits(), image.face[(col, row)]);
                    prop_assert_eq!(in_image, (depth.to_bits(), face), "{} {}", col, row);
                    let all = linear(&tracer, 7, &ray);
                    let is_same = if depth.is_nan() { all.t.is_infinite() } else { all.t.to_bits() == depth.to_bits() };
                    prop_assert!(is_same, "{:?} for {:?}", depth, all);
                    let building = (all.code >= 2).then(|| (all.code as usize - 2) / 2);
                    prop_assert_eq!(face.building().map(BuildingIdx::at), building);
                }
            }
        }
    }

    #[test]
    fn of_two_walls_in_one_place_the_first_building_is_seen() {
        let square = polygon![(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)];
        let ground = GroundLevel { reference_m: 0.0, lowest_m: 0.0 };
        let bounds = HeightBounds { min_m: 2.0, max_m: 60.0 };
        let scene = Scene::new(&[(&square, ground), (&square, ground)], &Terrain::Constant(0.0), bounds, 50.0);
        let image = SceneTracer::new(&scene, &[20.0, 20.0]).render(&camera(&scene, 0.3, 0.7, 80.0));
        let seen: Vec<_> = image.face.data().iter().filter_map(|face| face.building()).collect();
        assert!(!seen.is_empty() && seen.iter().all(|building| building.at() == 0));
        assert!(image.face.data().iter().any(|face| matches!(face, Face::Wall(_))));
    }
}
