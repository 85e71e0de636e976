//! Ray profiles: the footprints along each sampled ray of a view, found once and evaluated for any heights.
//!
//! Memory: 20 bytes per ray and 12 per interval; a view of 448 × 336 px sampled every 4 px holds 9,400 rays.

use std::cell::LazyCell;

use glam::{DVec2, Vec2};
use rand::Rng;
use rayon::prelude::*;

use super::PlacedCamera;
use super::bvh::Bvh;
use crate::ray::{Aabb, Ray};
use crate::scene::{RayInterval, Scene};
use crate::seed;

/// Rays flatter than this never sink to a roof within any useful distance (dz per unit of z-depth).
pub(crate) const FLATTEST_DZ: f32 = -1e-3;
/// Steps of a ray's way between the highest and the lowest level of a roof that is no level, and halvings of the one in which it sinks
/// below: over a roof that rises by 4 m a ray at 45 degrees is stopped to 2 cm.
const N_STEPS: usize = 8;
const N_HALVINGS: usize = 5;
/// Rays whose ground is known are traced so many at a time.
const RAYS_AT_ONCE: usize = 512;

/// One footprint along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PrismInterval {
    /// Which building, as a dense index.
    pub building: u32,
    /// z-depth where the ray enters the footprint.
    pub enter: f32,
    /// z-depth where it leaves, or meets the ground.
    pub leave: f32,
}

impl PrismInterval {
    /// z-depth at which its ray meets a roof, or the wall below it; `+∞` where it passes over.
    fn meets(&self, ray: &Ray, roof: &impl RoofSurface) -> f32 {
        let is_below = |depth: f32| {
            let at = ray.origin + depth * ray.direction;
            at.z <= roof.level(at.truncate())
        };
        let [first, last] = roof.range_z().map(|z| (z - ray.origin.z) / ray.direction.z);
        let (first, last) = (self.enter.max(first), self.leave.min(last.max(self.enter)));
        if is_below(first) {
            // A camera inside a prism (depth 0) looks out of it, as in the tracer.
            return if first > 0.0 { first } else { f32::INFINITY };
        }
        let step = (last - first) / N_STEPS as f32;
        let depth = |k: usize| first + step * k as f32;
        let Some(k) = (1..=N_STEPS).find(|&k| is_below(depth(k))) else {
            // At its lowest level rounding may keep the ray a hair above it.
            return if last < self.leave { last } else { f32::INFINITY };
        };
        let (mut above, mut below) = (depth(k - 1), depth(k));
        for _ in 0..N_HALVINGS {
            let middle = f32::midpoint(above, below);
            *(if is_below(middle) { &mut below } else { &mut above }) = middle;
        }
        below
    }
}

/// A roof that is no level.
pub trait RoofSurface {
    /// The level of it at a place, local frame, metres.
    fn level(&self, at: Vec2) -> f32;

    /// Highest and lowest level, local frame, metres.
    fn range_z(&self) -> [f32; 2];
}

/// One ray of a view, with the intervals in which it passes through prisms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfileRay {
    /// Column and row of the sampled pixel.
    pub pixel: [u16; 2],
    /// Height lost per metre of z-depth: `d_z < 0`.
    pub dz: f32,
    /// z-depth of the ground; `+∞` where none is known.
    pub ground: f32,
    /// Start of its intervals.
    first: u32,
}

impl ProfileRay {
    /// The image position that was sampled.
    #[must_use]
    pub fn centre(&self) -> DVec2 {
        DVec2::new(f64::from(self.pixel[0]) + 0.5, f64::from(self.pixel[1]) + 0.5)
    }
}

/// The sampled rays of one view, row by row.
#[derive(Debug, Clone, Default)]
pub struct Profiles {
    /// Height of the projection centre, local frame, metres.
    pub eye_z: f32,
    /// One per sampled pixel that looks at the ground or at a building.
    pub rays: Vec<ProfileRay>,
    intervals: Vec<PrismInterval>,
}

/// Sight of a ray for some heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// z-depth of what is seen, metres.
    pub depth: f32,
    /// The interval that stops the ray; `None` is the ground.
    pub building: Option<u32>,
    /// Whether it is a roof (its depth changes with the height) or a wall.
    pub is_roof: bool,
}

/// Stops of a view's rays at some roofs.
#[derive(Debug, Clone)]
pub struct Stops {
    /// Z-depth at which each interval stops its ray, in the intervals' order; `+∞` where the ray passes over.
    of_intervals: Vec<f32>,
    /// z-depth along each ray.
    depths: Vec<f32>,
}

impl Stops {
    /// z-depth along a ray.
    #[must_use]
    pub fn depth(&self, ray_idx: usize) -> f32 {
        self.depths[ray_idx]
    }
}

/// Which pixels of a view to sample: one in each `stride × stride` block, at random within it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sampling {
    /// Side of the blocks, pixels.
    pub stride_px: usize,
    /// Root seed of the random streams.
    pub seed: u64,
    /// Key of the view, so that views differ: of its name, so that it has the same rays in whatever company.
    pub view: u64,
}

impl Profiles {
    /// Traces the sampled rays against the prisms at their greatest height.
    #[must_use]
    pub fn trace(scene: &Scene, capped: &CappedScene, placed: &PlacedCamera, sampling: Sampling) -> Self {
        let (width, height) = (placed.camera.width_px as usize, placed.camera.height_px as usize);
        let stride = sampling.stride_px.max(1);
        let row = |block_row: usize| {
            let mut rng = seed::stream(sampling.seed, "rays", &[sampling.view, block_row as u64]);
            let mut row = Tracing::new(scene, capped, placed);
            for block_col in 0..width.div_ceil(stride) {
                let col = block_col * stride + rng.random_range(0..stride as u32) as usize;
                let line = block_row * stride + rng.random_range(0..stride as u32) as usize;
                if col < width && line < height {
                    row.trace([col as u16, line as u16], |ray| scene.ground.meets(ray).unwrap_or(f32::INFINITY));
                }
            }
            row.found
        };
        Self::joined((0..height.div_ceil(stride)).into_par_iter().map(row).collect(), placed)
    }

    /// Traces the middles of some pixels, row by row.
    #[must_use]
    pub fn through(scene: &Scene, capped: &CappedScene, placed: &PlacedCamera, pixels: &[[u16; 2]]) -> Self {
        let batch = |pixels: &[[u16; 2]]| {
            let mut tracing = Tracing::new(scene, capped, placed);
            for pixel in pixels {
                tracing.trace(*pixel, |ray| scene.ground.meets(ray).unwrap_or(f32::INFINITY));
            }
            tracing.found
        };
        Self::joined(pixels.par_chunks(RAYS_AT_ONCE).map(batch).collect(), placed)
    }

    /// Traces rays whose ground is known, as [`Self::trace`] found it under other prisms.
    #[must_use]
    pub fn over(scene: &Scene, capped: &CappedScene, placed: &PlacedCamera, known: &[ProfileRay]) -> Self {
        let batch = |rays: &[ProfileRay]| {
            let mut tracing = Tracing::new(scene, capped, placed);
            for known in rays {
                tracing.trace(known.pixel, |_| known.ground);
            }
            tracing.found
        };
        Self::joined(known.par_chunks(RAYS_AT_ONCE).map(batch).collect(), placed)
    }

    fn joined(parts: Vec<Self>, placed: &PlacedCamera) -> Self {
        let mut profiles = Self { eye_z: placed.eye().z as f32, ..Self::default() };
        profiles.rays.reserve_exact(parts.iter().map(|part| part.rays.len()).sum());
        profiles.intervals.reserve_exact(parts.iter().map(|part| part.intervals.len()).sum());
        for part in parts {
            let offset = profiles.intervals.len() as u32;
            profiles.rays.extend(part.rays.into_iter().map(|r| ProfileRay { first: r.first + offset, ..r }));
            profiles.intervals.extend(part.intervals);
        }
        profiles
    }

    /// The footprints along a ray, by where they begin.
    #[must_use]
    pub fn intervals(&self, ray_idx: usize) -> &[PrismInterval] {
        let end = self.rays.get(ray_idx + 1).map_or(self.intervals.len(), |next| next.first as usize);
        &self.intervals[self.rays[ray_idx].first as usize..end]
    }

    /// Sight of a ray for roof levels in the local frame, one per building.
    #[must_use]
    pub fn sight(&self, ray_idx: usize, roofs: &[f32]) -> Sight {
        self.first_met(ray_idx, |building| roofs[building as usize])
    }

    /// Sight of a ray when one building's roof is elsewhere.
    #[must_use]
    pub fn sight_with(&self, ray_idx: usize, roofs: &[f32], moved: u32, roof_z: f32) -> Sight {
        self.first_met(ray_idx, |building| if building == moved { roof_z } else { roofs[building as usize] })
    }

    /// Z-depth at which every interval would stop its ray for roof levels in the local frame, one per building.
    #[must_use]
    pub fn stops(&self, roofs: &[f32]) -> Stops {
        let mut of_intervals = Vec::with_capacity(self.intervals.len());
        let of_ray = |ray_idx: usize| {
            let ProfileRay { dz, ground, .. } = self.rays[ray_idx];
            let per_dz = dz.recip();
            let stop = |c: &PrismInterval| {
                let roof = (roofs[c.building as usize] - self.eye_z) * per_dz;
                let depth = c.enter.max(roof);
                // A camera inside a prism (depth 0) looks out of it, as in the tracer.
                if roof < c.leave && depth > 0.0 { depth } else { f32::INFINITY }
            };
            let first = of_intervals.len();
            of_intervals.extend(self.intervals(ray_idx).iter().map(stop));
            of_intervals[first..].iter().copied().fold(ground, f32::min)
        };
        let depths = (0..self.rays.len()).map(of_ray).collect();
        Stops { of_intervals, depths }
    }

    /// As [`Self::stops`], where some buildings have roofs that are no level. The view is `placed` as when it was traced.
    #[must_use]
    pub fn stops_at(&self, placed: &PlacedCamera, levels: &[f32], surfaces: &[Option<impl RoofSurface>]) -> Stops {
        let mut stops = self.stops(levels);
        if surfaces.iter().all(Option::is_none) {
            return stops;
        }
        for (ray_idx, known) in self.rays.iter().enumerate() {
            let intervals = self.intervals(ray_idx);
            if intervals.iter().all(|c| surfaces[c.building as usize].is_none()) {
                continue;
            }
            let ray = LazyCell::new(|| placed.ray(known.centre()));
            let first = known.first as usize;
            let of_ray = &mut stops.of_intervals[first..first + intervals.len()];
            for (over, stop) in intervals.iter().zip(&mut *of_ray) {
                let Some(surface) = &surfaces[over.building as usize] else { continue };
                let [highest_z, _] = surface.range_z();
                if self.eye_z + over.leave * known.dz > highest_z {
                    *stop = f32::INFINITY;
                } else if let Some(ray) = &*ray {
                    *stop = over.meets(ray, surface);
                }
            }
            stops.depths[ray_idx] = of_ray.iter().copied().fold(known.ground, f32::min);
        }
        stops
    }

    /// The last building, by index, whose footprint a ray crosses.
    #[must_use]
    pub fn highest_building(&self) -> Option<u32> {
        self.intervals.iter().map(|over| over.building).max()
    }

    /// Level at a z-depth along a ray, local frame, metres.
    #[must_use]
    pub fn level(&self, ray_idx: usize, depth: f32) -> f32 {
        self.eye_z + depth * self.rays[ray_idx].dz
    }

    /// z-depth along a ray when one building is not there.
    #[must_use]
    pub fn depth_without(&self, ray_idx: usize, stops: &Stops, absent: u32) -> f32 {
        self.depth_among(ray_idx, stops, |building| building != absent)
    }

    /// z-depth along a ray when only some buildings are there.
    #[must_use]
    pub fn depth_among(&self, ray_idx: usize, stops: &Stops, is_there: impl Fn(u32) -> bool) -> f32 {
        let first = self.rays[ray_idx].first as usize;
        let own = self.intervals(ray_idx).iter().zip(&stops.of_intervals[first..]);
        own.filter(|(c, _)| is_there(c.building)).map(|(_, stop)| *stop).fold(self.rays[ray_idx].ground, f32::min)
    }

    #[inline]
    fn first_met(&self, ray_idx: usize, roof_of: impl Fn(u32) -> f32) -> Sight {
        let ray = &self.rays[ray_idx];
        let per_dz = ray.dz.recip();
        let mut sight = Sight { depth: ray.ground, building: None, is_roof: false };
        for interval in self.intervals(ray_idx) {
            if interval.enter >= sight.depth {
                break;
            }
            let roof = (roof_of(interval.building) - self.eye_z) * per_dz;
            let depth = interval.enter.max(roof);
            // A camera inside a prism (depth 0) looks out of it, as in the tracer.
            if roof < interval.leave && depth < sight.depth && depth > 0.0 {
                sight = Sight { depth, building: Some(interval.building), is_roof: roof > interval.enter };
            }
        }
        sight
    }

    /// Bytes held, for memory reports.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.rays.as_slice()) + size_of_val(self.intervals.as_slice())
    }
}

/// The prisms at their greatest height in a hierarchy: built once per scene.
pub struct CappedScene {
    bvh: Bvh,
    caps: Vec<f32>,
}

impl CappedScene {
    /// The hierarchy of a scene's prisms at their greatest height.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let caps: Vec<f32> = scene.prisms.iter().map(|p| p.ground_z + scene.bounds.max_m).collect();
        let boxes: Vec<Aabb> = scene.prisms.iter().zip(&caps).map(|(p, &cap)| p.bounds_below(cap)).collect();
        Self { bvh: Bvh::build(&boxes), caps }
    }
}

/// Some rays of one view being traced.
struct Tracing<'a> {
    scene: &'a Scene,
    capped: &'a CappedScene,
    placed: &'a PlacedCamera,
    found: Profiles,
    over_footprint: Vec<RayInterval>,
    intervals: Vec<PrismInterval>,
}

impl<'a> Tracing<'a> {
    fn new(scene: &'a Scene, capped: &'a CappedScene, placed: &'a PlacedCamera) -> Self {
        Self { scene, capped, placed, found: Profiles::default(), over_footprint: Vec::new(), intervals: Vec::new() }
    }

    /// Traces the middle of a pixel; `ground_of` says at what z-depth its ray meets the ground, `+∞` where it does not.
    fn trace(&mut self, pixel: [u16; 2], ground_of: impl Fn(&Ray) -> f32) {
        let centre = DVec2::new(f64::from(pixel[0]) + 0.5, f64::from(pixel[1]) + 0.5);
        let Some(ray) = self.placed.ray(centre) else { return };
        if ray.direction.z > FLATTEST_DZ {
            return; // at or above the horizon
        }
        let ground = ground_of(&ray);
        let Self { scene, capped, found, over_footprint, intervals, .. } = self;
        intervals.clear();
        capped.bvh.traverse(&ray, ground, |idx, t_max| {
            over_footprint.clear();
            scene.prisms[idx].intervals(&ray, over_footprint);
            let below_cap = (capped.caps[idx] - ray.origin.z) / ray.direction.z;
            let met = over_footprint.iter().map(|s| PrismInterval {
                building: idx as u32,
                enter: s.enter.max(0.0),
                leave: s.leave.min(ground),
            });
            intervals.extend(met.filter(|c| c.leave > c.enter && c.leave > below_cap));
            t_max
        });
        if intervals.is_empty() && ground.is_infinite() {
            return;
        }
        intervals.sort_unstable_by(|a, b| a.enter.total_cmp(&b.enter).then(a.building.cmp(&b.building)));
        found.rays.push(ProfileRay { pixel, dz: ray.direction.z, ground, first: found.intervals.len() as u32 });
        found.intervals.extend_from_slice(intervals);
    }
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::camera::Camera;
    use crate::frames::Rigid;
    use crate::raster::Raster;
    use crate::render::image::{Face, SceneTracer};
    use crate::scene::HeightBounds;
    use crate::terrain::{Dem, GroundLevel, Terrain};

    fn blocks() -> Scene {
        let square = |x: f64, y: f64, side: f64| polygon![(x: x, y: y), (x: x + side, y: y), (x: x + side, y: y + side), (x: x, y: y + side)];
        // Two that share a wall, one apart, one overlapping it.
        let polygons =
            [square(0.0, 0.0, 12.0), square(12.0, 0.0, 9.0), square(0.0, 25.0, 15.0), square(10.0, 30.0, 12.0)];
        let ground = GroundLevel { lowest_m: 0.0, ..GroundLevel::flat(0.5) };
        let footprints: Vec<_> = polygons.iter().map(|p| (p, ground)).collect();
        Scene::new(&footprints, &Terrain::Constant(0.0), HeightBounds { min_m: 2.0, max_m: 60.0 }, 100.0)
    }

    fn oblique(azimuth: f64, tilt: f64) -> PlacedCamera {
        let rotation = DMat3::from_rotation_x(std::f64::consts::PI - tilt) * DMat3::from_rotation_z(azimuth);
        let look = rotation.transpose() * DVec3::Z;
        let eye = DVec3::new(10.0, 20.0, 0.0) - look * (90.0 / -look.z);
        PlacedCamera::new(
            Camera::pinhole(96, 72, 70.0),
            Rigid::from_rotation_and_centre(rotation, eye),
            blocks().origin,
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// The evaluator against the tracer, which shares only the footprint interval with it.
        #[test]
        fn profiles_see_what_the_tracer_sees(
            heights in prop::array::uniform4(2.0..60.0_f32),
            azimuth in -3.1..3.1_f64, tilt in 0.0..0.9_f64,
        ) {
            let scene = blocks();
            let placed = oblique(azimuth, tilt);
            let capped = CappedScene::new(&scene);
            let profiles = Profiles::trace(&scene, &capped, &placed, Sampling { stride_px: 1, seed: 0, view: 0 });
            let image = SceneTracer::new(&scene, &heights).render(&placed);
            let roofs = scene.roofs(&heights);
            prop_assert_eq!(profiles.rays.len(), 96 * 72);
            for (i, ray) in profiles.rays.iter().enumerate() {
                let sight = profiles.sight(i, &roofs);
                let at = (usize::from(ray.pixel[0]), usize::from(ray.pixel[1]));
                prop_assert!((sight.depth - image.depth[at]).abs() < 1e-3, "{:?} {:?}", sight, image.face[at]);
                let face = image.face[at];
                prop_assert_eq!(sight.is_roof, matches!(face, Face::Roof(_)));
                prop_assert_eq!(sight.building.is_none(), face == Face::Ground);
            }
        }
    }

    /// Rays of one scene, kept for another one that has a building less, against rays traced there from nothing.
    #[test]
    fn rays_kept_for_other_prisms_are_those_traced_anew() {
        let bounds = HeightBounds { min_m: 2.0, max_m: 60.0 };
        let z = |i: usize| ((i % 60) as f32 * 0.3).sin() + ((i / 60) as f32 * 0.2).cos();
        let heights = Raster::from_vec(60, 60, (0..3600).map(z).collect()).unwrap();
        let hills = Terrain::Grid(Dem::new(heights, -110.0, 140.0, 4.0, 4.0).unwrap());
        let square = |x: f64| polygon![(x: x, y: 0.0), (x: x + 9.0, y: 0.0), (x: x + 9.0, y: 9.0), (x: x, y: 9.0)];
        let ground = GroundLevel { lowest_m: -2.0, ..GroundLevel::flat(0.5) };
        // The one in the middle goes: the same piece of terrain is cut out.
        let [left, middle, right] = [0.0, 14.0, 28.0].map(square);
        let before = Scene::new(&[(&left, ground), (&middle, ground), (&right, ground)], &hills, bounds, 60.0);
        let after = Scene::at(before.origin, &[(&left, ground), (&right, ground)], &hills, bounds, 60.0);
        let sampling = Sampling { stride_px: 1, seed: 5, view: 1 };
        for placed in [oblique(0.4, 0.6), oblique(-2.0, 0.9)] {
            let traced = |scene: &Scene| Profiles::trace(scene, &CappedScene::new(scene), &placed, sampling);
            let kept = Profiles::over(&after, &CappedScene::new(&after), &placed, &traced(&before).rays);
            let anew = traced(&after);
            assert!(anew.rays.len() > 1000 && anew.intervals.len() > 20, "{} rays", anew.rays.len());
            assert_eq!(kept.rays, anew.rays);
            assert_eq!(kept.intervals, anew.intervals);
            assert_eq!(kept.eye_z, anew.eye_z);
        }
    }

    /// A level as a surface.
    struct LevelSurface(f32);

    impl RoofSurface for LevelSurface {
        fn level(&self, _: Vec2) -> f32 {
            self.0
        }

        fn range_z(&self) -> [f32; 2] {
            [self.0; 2]
        }
    }

    /// A roof that rises to the east by this much per metre from a level at x = 0, between two of x.
    struct SlopingSurface(f32, f32, [f32; 2]);

    impl RoofSurface for SlopingSurface {
        fn level(&self, at: Vec2) -> f32 {
            self.0 + self.1 * at.x
        }

        fn range_z(&self) -> [f32; 2] {
            let [west, east] = self.2;
            [self.level(east * Vec2::X), self.level(west * Vec2::X)]
        }
    }

    #[test]
    fn rays_meet_roofs_that_are_no_level_where_they_sink_below_them() {
        let scene = blocks();
        let (mut n_on_slope, capped) = (0, CappedScene::new(&scene));
        for placed in [oblique(0.0, 0.7), oblique(2.0, 0.5)] {
            let profiles = Profiles::trace(&scene, &capped, &placed, Sampling { stride_px: 2, seed: 1, view: 0 });
            let roofs = scene.roofs(&[20.0, 8.0, 12.0, 30.0]);
            // Levels as surfaces are the levels.
            let levels: Vec<Option<LevelSurface>> = roofs.iter().map(|&z| Some(LevelSurface(z))).collect();
            let (flat, same) = (profiles.stops(&roofs), profiles.stops_at(&placed, &roofs, &levels));
            // The third slopes.
            let bounds = scene.prisms[2].bounds_below(0.0);
            let slope = |b: usize| (b == 2).then_some(SlopingSurface(roofs[2], 0.4, [bounds.min.x, bounds.max.x]));
            let sloping = profiles.stops_at(&placed, &roofs, &[0, 1, 2, 3].map(slope));
            for i in 0..profiles.rays.len() {
                assert!((flat.depth(i) - same.depth(i)).abs() < 0.05, "{} {}", flat.depth(i), same.depth(i));
                let others = profiles.depth_without(i, &sloping, 2);
                assert_eq!(others, profiles.depth_without(i, &flat, 2));
                // What the ray meets first, worked out by the plane's equation.
                let ray = placed.ray(profiles.rays[i].centre()).unwrap();
                let over = profiles.intervals(i).iter().filter(|c| c.building == 2);
                let plane = (roofs[2] + 0.4 * ray.origin.x - ray.origin.z) / (ray.direction.z - 0.4 * ray.direction.x);
                let met =
                    over.map(|c| c.enter.max(plane)).zip(profiles.intervals(i).iter().filter(|c| c.building == 2));
                let expected =
                    met.filter(|(depth, c)| *depth < c.leave).fold(others, |first, (depth, _)| first.min(depth));
                assert!((sloping.depth(i) - expected).abs() < 0.05, "{} {expected}", sloping.depth(i));
                n_on_slope += usize::from(expected < others && expected == plane);
            }
        }
        assert!(n_on_slope > 40, "{n_on_slope} rays on the slope");
    }

    #[test]
    fn without_its_building_a_ray_sees_what_is_behind() {
        let scene = blocks();
        let placed = oblique(0.0, 0.7);
        let profiles =
            Profiles::trace(&scene, &CappedScene::new(&scene), &placed, Sampling { stride_px: 2, seed: 1, view: 0 });
        let roofs = scene.roofs(&[20.0; 4]);
        let stops = profiles.stops(&roofs);
        let mut n_behind = 0;
        for i in 0..profiles.rays.len() {
            let sight = profiles.sight(i, &roofs);
            if let Some(building) = sight.building {
                let behind = profiles.sight_with(i, &roofs, building, f32::NEG_INFINITY);
                assert!(behind.depth > sight.depth || behind.building.is_some());
                assert_ne!(behind.building, Some(building));
                assert_eq!(stops.depth(i), sight.depth);
                assert_eq!(profiles.depth_without(i, &stops, building), behind.depth);
                n_behind += 1;
            }
        }
        assert!(n_behind > 50, "{n_behind} rays on buildings");
    }
}
