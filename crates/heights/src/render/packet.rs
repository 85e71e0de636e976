//! A tile of an image at once: 64 rays from one point, as eight packets of eight neighbours in vector registers.
//!
//! The hierarchy is walked once per tile: each box is held against the cones around all eight packets, one per lane.
//! Prisms whose boxes a cone may meet are then met by the packet's eight rays, one per lane, with the arithmetic of
//! the single ray ([`Prism::intervals`]) in its order, no product fused with a sum: depths and faces are the same to the
//! bit, however wide registers are. Two ways of one ray over a footprint (courtyards, L-shaped footprints) are left to the
//! single ray.
//!
//! Source of the idea: Wald, Slusallek, Benthin, Wagner, "Interactive Rendering with Coherent Ray Tracing", CGF
//! 20:153, 2001; bounds over many rays as in Reshetov, Soupikov, Hurley, "Multi-Level Ray Tracing", TOG 24:1176, 2005.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8, mask32x8, u32x8};
use glam::Vec3;

use super::bvh::Probe;
use super::cones::{Cones, greatest_of_packets};
use super::image::{PrismSolid, RayHit, SceneTracer};
use super::tile::{LANES, RayTile, TILE};
use crate::ray::{Aabb, Ray};
use crate::scene::{LocalGround, Prism, RayInterval};

/// First hits of every ray of a tile; for no ray and upright ones nothing. Also which rays these are, as bits.
#[inline(always)]
pub(super) fn trace<S: Simd>(simd: S, tracer: &SceneTracer<'_>, rays: &RayTile) -> (TileHits, u64) {
    let mut hits = TileHits { t: [f32::INFINITY; TILE], code: [0; TILE] };
    let Some(some) = rays.first_slanted() else { return (hits, u64::MAX) };
    let (first, mut left_out) = Packet::new(simd, tracer, rays, 0, some);
    let mut packets = [first; LANES];
    // No `array::from_fn` nor `map`: what they call is not inlined.
    for (i, packet) in packets.iter_mut().enumerate().skip(1) {
        let without;
        (*packet, without) = Packet::new(simd, tracer, rays, i, some);
        left_out |= without << (LANES * i);
    }
    let mut tile = TileTrace::new(simd, tracer, rays.origin, packets);
    tracer.bvh().walk(&mut tile);
    for (i, packet) in tile.packets.iter().enumerate() {
        packet.nearest.store_slice(&mut hits.t[LANES * i..LANES * (i + 1)]);
        packet.code.store_slice(&mut hits.code[LANES * i..LANES * (i + 1)]);
    }
    (hits, left_out)
}

/// One [`RayHit`] per ray of a tile.
pub(super) struct TileHits {
    pub t: [f32; TILE],
    pub code: [u32; TILE],
}

/// Eight rays and what they met so far.
#[derive(Clone, Copy)]
struct Packet<S: Simd> {
    direction: [f32x8<S>; 3],
    /// Squared length of the horizontal direction.
    length_squared: f32x8<S>,
    nearest: f32x8<S>,
    /// [`RayHit::code`] of what each ray met.
    code: u32x8<S>,
}

/// The rays of a tile on their way through a scene.
struct TileTrace<'a, S: Simd> {
    simd: S,
    tracer: &'a SceneTracer<'a>,
    origin: Vec3,
    packets: [Packet<S>; LANES],
    cones: Cones<S>,
    /// By packet: the farthest that one of its rays still looks; never infinite, so that a box that no ray can reach is
    /// out of it.
    reach: f32x8<S>,
    scratch: Vec<RayInterval>,
}

impl<'a, S: Simd> TileTrace<'a, S> {
    #[inline(always)]
    fn new(simd: S, tracer: &'a SceneTracer<'a>, origin: Vec3, packets: [Packet<S>; LANES]) -> Self {
        let [mut x, mut y, mut z] = [[f32x8::splat(simd, 0.0); LANES]; 3];
        let mut nearest = x;
        for (i, packet) in packets.iter().enumerate() {
            [x[i], y[i], z[i]] = packet.direction;
            nearest[i] = packet.nearest;
        }
        let cones = Cones::around(simd, [x, y, z]);
        let reach = greatest_of_packets(simd, nearest).min(f32::MAX);
        Self { simd, tracer, origin, packets, cones, reach, scratch: Vec::new() }
    }
}

impl<S: Simd> Probe for TileTrace<'_, S> {
    #[inline(always)]
    fn enters(&self, bounds: &Aabb) -> Option<f32> {
        let (enter, may_meet) = self.cones.meet(bounds, self.origin, self.reach);
        let never = f32x8::splat(self.simd, f32::INFINITY);
        if may_meet.any_true() { Some(may_meet.select(enter, never).reduce_min()) } else { None }
    }

    #[inline(always)]
    fn reach(&self) -> f32 {
        self.reach.reduce_max()
    }

    #[inline(always)]
    fn visit(&mut self, idx: usize) {
        let mut may_meet = self.cones.meet(self.tracer.bounds(idx), self.origin, self.reach).1.to_bitmask();
        let solid = self.tracer.solid(idx);
        while may_meet != 0 {
            let i = may_meet.trailing_zeros() as usize;
            may_meet &= may_meet - 1;
            self.packets[i].meet(self.simd, self.origin, (idx, &solid), &mut self.scratch);
            self.reach[i] = self.packets[i].nearest.reduce_max().min(f32::MAX);
        }
    }
}

impl<S: Simd> Packet<S> {
    /// The `i`-th eight rays of a tile, each with the ground in front of it. Missing and upright ones look nowhere,
    /// along `some` other ray; these are told as bits.
    #[inline(always)]
    fn new(simd: S, tracer: &SceneTracer<'_>, rays: &RayTile, i: usize, some: Vec3) -> (Self, u64) {
        let [x, y, z] = &rays.direction;
        let (from, to) = (LANES * i, LANES * (i + 1));
        let x = f32x8::from_slice(simd, &x[from..to]);
        let y = f32x8::from_slice(simd, &y[from..to]);
        let z = f32x8::from_slice(simd, &z[from..to]);
        // False for `NaN`, where there is no ray.
        let is_slanted = (x * x + y * y).simd_ge(Prism::UPRIGHT_BELOW) & z.simd_eq(z);
        let x = is_slanted.select(x, f32x8::splat(simd, some.x));
        let y = is_slanted.select(y, f32x8::splat(simd, some.y));
        let z = is_slanted.select(z, f32x8::splat(simd, some.z));
        let (ground, code) = meet_ground(simd, tracer, rays.origin, [x, y, z]);
        let packet = Self {
            direction: [x, y, z],
            length_squared: x * x + y * y,
            nearest: is_slanted.select(ground, f32x8::splat(simd, f32::NEG_INFINITY)),
            code: is_slanted.select(code, u32x8::splat(simd, 0)),
        };
        (packet, (!is_slanted).to_bitmask())
    }

    /// Meets all rays with one prism.
    #[inline(always)]
    fn meet(&mut self, simd: S, origin: Vec3, (idx, solid): (usize, &PrismSolid<'_>), scratch: &mut Vec<RayInterval>) {
        let [x, y, z] = self.direction;
        let (enter, leave, n) = solid.prism.intervals_of_eight(simd, origin.truncate(), [x, y], self.length_squared);
        let is_over = n.simd_eq(2.0) & leave.simd_gt(enter) & leave.simd_gt(0.0);
        let (eye, top) = (f32x8::splat(simd, origin.z), f32x8::splat(simd, solid.roof_z));
        let from = enter.max(0.0);
        let level = eye + from * z;
        let below_roof = level.simd_le(top);
        let roof = (top - eye) / z;
        let meets_wall = below_roof & enter.simd_gt(0.0) & level.simd_ge(solid.foot_z);
        let meets_roof = !below_roof & z.simd_lt(0.0) & roof.simd_lt(leave);
        let code = below_roof.select(u32x8::splat(simd, RayHit::wall(idx)), u32x8::splat(simd, RayHit::roof(idx)));
        self.take(is_over & (meets_wall | meets_roof), below_roof.select(from, roof), code);

        let mut many = n.simd_gt(2.0).to_bitmask();
        while many != 0 {
            let lane = many.trailing_zeros() as usize;
            many &= many - 1;
            let ray = Ray::new(origin, Vec3::from_array(self.direction.map(|axis| axis[lane])));
            let before = RayHit { t: self.nearest[lane], code: self.code[lane] };
            let hit = before.or_nearer(&ray, (idx, solid), scratch);
            (self.nearest[lane], self.code[lane]) = (hit.t, hit.code);
        }
    }

    /// Keeps what is nearer, and of equals the one with the lower code.
    #[inline(always)]
    fn take(&mut self, hits: mask32x8<S>, t: f32x8<S>, code: u32x8<S>) {
        let is_first = t.simd_eq(self.nearest) & code.simd_lt(self.code);
        let is_nearer = hits & (t.simd_lt(self.nearest) | is_first);
        self.nearest = is_nearer.select(t, self.nearest);
        self.code = is_nearer.select(code, self.code);
    }
}

/// Points where eight rays meet the ground, as [`SceneTracer::ground`] tells it of one.
#[inline(always)]
fn meet_ground<S: Simd>(
    simd: S,
    tracer: &SceneTracer<'_>,
    origin: Vec3,
    direction: [f32x8<S>; 3],
) -> (f32x8<S>, u32x8<S>) {
    if let LocalGround::Level(level_z) = tracer.scene().ground {
        let t = f32x8::splat(simd, level_z - origin.z) / direction[2];
        let meets = direction[2].simd_lt(0.0) & t.simd_gt(0.0);
        let never = f32x8::splat(simd, f32::INFINITY);
        return (meets.select(t, never), meets.select(u32x8::splat(simd, 1), u32x8::splat(simd, 0)));
    }
    let hits: [RayHit; LANES] =
        std::array::from_fn(|i| tracer.ground(&Ray::new(origin, Vec3::from_array(direction.map(|axis| axis[i])))));
    (f32x8::simd_from(simd, hits.map(|hit| hit.t)), u32x8::simd_from(simd, hits.map(|hit| hit.code)))
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
    use crate::render::image::{BOX_MARGIN_M, Face};
    use crate::scene::{HeightBounds, Scene};
    use crate::terrain::{Dem, GroundLevel, Terrain};

    /// Squares, two of them wall to wall and two over one another, a courtyard, an L and a star of many corners, on
    /// hills or on a plain.
    fn scene(terrain: &Terrain) -> Scene {
        let footprint = |corners: &[(f64, f64)]| Polygon::new(corners.to_vec().into(), Vec::new());
        let square =
            |x: f64, y: f64, side: f64| footprint(&[(x, y), (x + side, y), (x + side, y + side), (x, y + side)]);
        let courtyard = polygon!(
            exterior: [(x: 30.0, y: 0.0), (x: 50.0, y: 0.0), (x: 50.0, y: 20.0), (x: 30.0, y: 20.0)],
            interiors: [[(x: 36.0, y: 6.0), (x: 36.0, y: 14.0), (x: 44.0, y: 14.0), (x: 44.0, y: 6.0)]],
        );
        let corner = footprint(&[(30.0, 28.0), (52.0, 28.0), (52.0, 35.0), (38.0, 35.0), (38.0, 50.0), (30.0, 50.0)]);
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
            polygons.iter().map(|p| (p, GroundLevel { lowest_m: 0.0, ..GroundLevel::flat(0.5) })).collect();
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
    fn linear(tracer: &SceneTracer<'_>, n_prisms: usize, ray: &Ray) -> RayHit {
        let mut scratch = Vec::new();
        let nearer = |hit: RayHit, idx| hit.or_nearer(ray, (idx, &tracer.solid(idx)), &mut scratch);
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

    /// A coordinate anywhere, or where walls and the faces of their boxes are.
    fn coordinate() -> impl Strategy<Value = f32> {
        let face = prop::sample::select(vec![0.0_f32, 9.0, 12.0, 21.0, 25.0, 28.0, 30.0, 35.0, 36.0, 44.0, 50.0]);
        let beside = prop::sample::select(vec![0.0_f32, BOX_MARGIN_M, -BOX_MARGIN_M, 0.005]);
        prop_oneof![-60.0..80.0_f32, (face, beside).prop_map(|(face, beside)| face + beside)]
    }

    /// Rays a little or a lot apart, among them some along axes, upright ones and gaps: a tile may look all ways round.
    fn directions() -> impl Strategy<Value = Vec<Option<Vec3>>> {
        let middle = (-1.0..1.0_f32, -1.0..1.0_f32, prop_oneof![Just(-1.0_f32), -1.0..0.6_f32]);
        let spread = prop::sample::select(vec![0.0_f32, 0.003, 0.05, 0.6, 4.0]);
        (middle, spread, any::<bool>()).prop_flat_map(|((x, y, z), spread, is_level)| {
            let apart = prop::array::uniform3(-1.0..1.0_f32);
            let ray = (apart, 0..24).prop_map(move |(apart, kind)| {
                let direction = Vec3::new(x, y, z) + spread * Vec3::from_array(apart);
                match kind {
                    0 => None,
                    1 => Some(Vec3::new(0.0, 0.0, -1.0)),
                    2 | 3 => Some(direction.with_x(0.0)),
                    4 | 5 => Some(direction.with_y(-0.0)),
                    6 if is_level => Some(direction.with_z(0.0)),
                    _ => Some(direction),
                }
            });
            prop::collection::vec(ray, TILE)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn tiles_from_anywhere_see_what_single_rays_see_to_the_bit_in_all_registers(
            heights in prop::array::uniform7(2.0..60.0_f32),
            // Inside and above buildings, in the planes of walls, and far off.
            eye in (coordinate(), coordinate(), prop_oneof![0.0..70.0_f32, 70.0..400.0_f32]),
            at_box in prop::option::of((0..7_usize, prop::array::uniform3(0..4_u8))),
            directions in directions(), is_hilly in any::<bool>(),
        ) {
            let terrain = if is_hilly { hills() } else { Terrain::Constant(0.0) };
            let scene = scene(&terrain);
            let mut tracer = SceneTracer::new(&scene, &heights);
            // Coordinates of the scene are those of the map, moved by whole numbers.
            let mut eye = (DVec3::new(eye.0.into(), eye.1.into(), eye.2.into()) - scene.origin.0).as_vec3();
            // In the planes of a box's faces, which bound nothing.
            if let Some((prism, faces)) = at_box {
                let bounds = tracer.bounds(prism);
                for axis in 0..3 {
                    eye[axis] = match faces[axis] {
                        0 => bounds.min[axis],
                        1 => bounds.max[axis],
                        _ => eye[axis],
                    };
                }
            }
            let rays = RayTile::new(eye, |k| directions[k]);
            for level in crate::simd::levels() {
                tracer.level = level;
                let seen = tracer.trace_tile(&rays);
                for (k, direction) in directions.iter().enumerate() {
                    let expected = match *direction {
                        Some(direction) => {
                            let ray = Ray::new(eye, direction);
                            let all = linear(&tracer, 7, &ray).seen();
                            let single = tracer.trace(&ray, &mut Vec::new());
                            prop_assert_eq!((all.0.to_bits(), all.1), (single.0.to_bits(), single.1), "{:?}", ray);
                            single
                        }
                        None => (f32::NAN, Face::Nothing),
                    };
                    let found = (seen.depth[k].to_bits(), seen.face[k]);
                    prop_assert_eq!(found, (expected.0.to_bits(), expected.1), "{} {:?} {:?}", k, direction, level);
                }
            }
        }
    }

    #[test]
    fn of_two_walls_in_one_place_the_first_building_is_seen() {
        let square = polygon![(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)];
        let ground = GroundLevel::flat(0.0);
        let bounds = HeightBounds { min_m: 2.0, max_m: 60.0 };
        let scene = Scene::new(&[(&square, ground), (&square, ground)], &Terrain::Constant(0.0), bounds, 50.0);
        let image = SceneTracer::new(&scene, &[20.0, 20.0]).render(&camera(&scene, 0.3, 0.7, 80.0));
        let seen: Vec<_> = image.face.data().iter().filter_map(|face| face.building()).collect();
        assert!(!seen.is_empty() && seen.iter().all(|building| building.at() == 0));
        assert!(image.face.data().iter().any(|face| matches!(face, Face::Wall(_))));
    }
}
