//! Whole images of the proxies: z-depth, building and face per pixel.

use fearless_simd::{Level, dispatch};
use glam::DVec2;
use rayon::prelude::*;

use super::PlacedCamera;
use super::bvh::Bvh;
use super::packet;
use super::tile::{LANES, RayTile, TILE, TileSeen};
use crate::ids::BuildingIdx;
use crate::raster::Raster;
use crate::ray::{Aabb, Ray};
use crate::scene::{Prism, RayInterval, Scene};

/// First thing that a ray meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Face {
    /// Sky, or ground that is not known.
    Nothing,
    /// The terrain, or the level ground.
    Ground,
    /// A wall of this building.
    Wall(BuildingIdx),
    /// The roof of this building.
    Roof(BuildingIdx),
}

impl Face {
    /// The building, if it is one.
    #[must_use]
    pub fn building(self) -> Option<BuildingIdx> {
        match self {
            Self::Wall(b) | Self::Roof(b) => Some(b),
            Self::Nothing | Self::Ground => None,
        }
    }
}

/// The proxies as one camera sees them: `H × W`, row-major.
#[derive(Debug, Clone)]
pub struct DepthImage {
    /// z-depth in metres; `NaN` = nothing there.
    pub depth: Raster<f32>,
    /// Face that is seen.
    pub face: Raster<Face>,
}

/// Pixels along each side of a tile, and where the rays of one of its packets (4 × 2 pixels) stand.
const TILE_SIDE: usize = 8;
const TILE_COLS: [usize; LANES] = [0, 1, 2, 3, 0, 1, 2, 3];
const TILE_ROWS: [usize; LANES] = [0, 0, 0, 0, 1, 1, 1, 1];
/// Boxes reach so far beyond what is in them, metres: more than rays are rounded by within kilometres, so that no box
/// is missed whose prism is met, and what is met does not depend on the order of boxes.
pub(super) const BOX_MARGIN_M: f32 = 0.01;

/// Hit of a ray: its parameter, and a code that a register can hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RayHit {
    /// Ray parameter of the hit; infinite where there is none.
    pub t: f32,
    /// 0 nothing, 1 ground, then wall and roof of every building in turn.
    pub code: u32,
}

impl RayHit {
    /// The code of a building's wall.
    pub fn wall(idx: usize) -> u32 {
        2 + 2 * idx as u32
    }

    /// The code of a building's roof.
    pub fn roof(idx: usize) -> u32 {
        3 + 2 * idx as u32
    }

    /// This, or what is met of a prism if that is nearer; of two at one place the first in the scene.
    pub fn or_nearer(self, ray: &Ray, (idx, solid): (usize, &PrismSolid<'_>), scratch: &mut Vec<RayInterval>) -> Self {
        scratch.clear();
        solid.prism.intervals(ray, scratch);
        scratch.iter().fold(self, |nearest, interval| match solid.meet(ray, *interval) {
            Some((t, is_roof)) => {
                let code = if is_roof { Self::roof(idx) } else { Self::wall(idx) };
                let is_nearer = t < nearest.t || (t == nearest.t && code < nearest.code);
                if is_nearer { Self { t, code } } else { nearest }
            }
            None => nearest,
        })
    }

    /// Depth and face as images have them.
    pub(super) fn seen(self) -> (f32, Face) {
        let building = || BuildingIdx::new((self.code as usize - 2) / 2);
        match self.code {
            _ if !self.t.is_finite() => (f32::NAN, Face::Nothing),
            0 => (f32::NAN, Face::Nothing),
            1 => (self.t, Face::Ground),
            code if code % 2 == 0 => (self.t, Face::Wall(building())),
            _ => (self.t, Face::Roof(building())),
        }
    }
}

/// A prism between two levels.
pub(super) struct PrismSolid<'a> {
    pub prism: &'a Prism,
    /// A ray that comes over the footprint below this passes under its walls. Well inside the prism's box, so that boxes
    /// decide nothing.
    pub foot_z: f32,
    pub roof_z: f32,
}

impl PrismSolid<'_> {
    /// Ray parameter at which a ray meets it within one interval over its footprint, and whether that is the roof.
    fn meet(&self, ray: &Ray, interval: RayInterval) -> Option<(f32, bool)> {
        let (from, dz) = (ray.origin.z, ray.direction.z);
        let enter = interval.enter.max(0.0);
        let level = from + enter * dz;
        if level <= self.roof_z {
            // From inside there is no wall to see.
            return (interval.enter > 0.0 && level >= self.foot_z).then_some((enter, false));
        }
        let roof = (self.roof_z - from) / dz;
        (dz < 0.0 && roof < interval.leave).then_some((roof, true))
    }
}

/// A scene with one height per building, ready for rays.
pub struct SceneTracer<'a> {
    scene: &'a Scene,
    roofs: Vec<f32>,
    /// Around each prism, somewhat larger.
    boxes: Vec<Aabb>,
    bvh: Bvh,
    /// The vector registers that this processor has.
    pub(super) level: Level,
}

impl<'a> SceneTracer<'a> {
    /// `heights_m`: metres above each building's ground level, one per building.
    #[must_use]
    pub fn new(scene: &'a Scene, heights_m: &[f32]) -> Self {
        Self::with_roofs(scene, scene.roofs(heights_m))
    }

    /// From roof levels in the local frame, metres, one per building.
    #[must_use]
    pub fn with_roofs(scene: &'a Scene, roofs: Vec<f32>) -> Self {
        let around = |(prism, &roof): (&Prism, &f32)| {
            let tight = prism.bounds_below(roof);
            Aabb { min: tight.min - BOX_MARGIN_M, max: tight.max + BOX_MARGIN_M }
        };
        let boxes: Vec<Aabb> = scene.prisms.iter().zip(&roofs).map(around).collect();
        let bvh = Bvh::build(&boxes);
        Self { scene, roofs, boxes, bvh, level: Level::new() }
    }

    /// The ray parameter of the first thing met, and what it is; `NaN` and [`Face::Nothing`] if there is none.
    /// `scratch` saves an allocation per ray.
    pub fn trace(&self, ray: &Ray, scratch: &mut Vec<RayInterval>) -> (f32, Face) {
        let mut nearest = self.ground(ray);
        self.bvh.traverse(ray, nearest.t, |idx, _| {
            nearest = nearest.or_nearer(ray, (idx, &self.solid(idx)), scratch);
            nearest.t
        });
        nearest.seen()
    }

    /// The same for up to 64 rays from one point: the same depths and faces, to the bit.
    #[must_use]
    pub fn trace_tile(&self, rays: &RayTile) -> TileSeen {
        let (hits, left_out) = dispatch!(self.level, simd => packet::trace(simd, self, rays));
        let mut seen = TileSeen { depth: [f32::NAN; TILE], face: [Face::Nothing; TILE] };
        for k in 0..TILE {
            (seen.depth[k], seen.face[k]) = RayHit { t: hits.t[k], code: hits.code[k] }.seen();
        }
        self.trace_left_out(rays, left_out, &mut seen);
        seen
    }

    /// Rays that are not there and upright ones, told as bits.
    fn trace_left_out(&self, rays: &RayTile, mut left_out: u64, seen: &mut TileSeen) {
        let mut scratch = Vec::new();
        while left_out != 0 {
            let k = left_out.trailing_zeros() as usize;
            left_out &= left_out - 1;
            if let Some(direction) = rays.direction_of(k) {
                (seen.depth[k], seen.face[k]) = self.trace(&Ray::new(rays.origin, direction), &mut scratch);
            }
        }
    }

    /// Renders a whole image, bands of rows in parallel.
    #[must_use]
    pub fn render(&self, placed: &PlacedCamera) -> DepthImage {
        let (width, height) = (placed.camera.width_px as usize, placed.camera.height_px as usize);
        let mut depth = Raster::filled(width, height, f32::NAN);
        let mut face = Raster::filled(width, height, Face::Nothing);
        let band = TILE_SIDE * width;
        depth.data_mut().par_chunks_mut(band).zip(face.data_mut().par_chunks_mut(band)).enumerate().for_each(
            |(i, (depths, faces))| {
                let n_rows = depths.len() / width;
                for col in (0..width).step_by(TILE_SIDE) {
                    let place = |k: usize| {
                        (col + TILE_COLS[k % LANES] + 4 * (k / LANES % 2), TILE_ROWS[k % LANES] + 2 * (k / LANES / 2))
                    };
                    let direction = |k: usize| {
                        let (col, row) = place(k);
                        let pixel = DVec2::new(col as f64 + 0.5, (TILE_SIDE * i + row) as f64 + 0.5);
                        if col < width && row < n_rows { placed.direction(pixel) } else { None }
                    };
                    let seen = self.trace_tile(&RayTile::new(placed.eye().as_vec3(), direction));
                    for k in 0..TILE {
                        let (col, row) = place(k);
                        if col < width && row < n_rows {
                            (depths[row * width + col], faces[row * width + col]) = (seen.depth[k], seen.face[k]);
                        }
                    }
                }
            },
        );
        DepthImage { depth, face }
    }

    /// Point where a ray meets the ground, with nothing on it.
    pub(super) fn ground(&self, ray: &Ray) -> RayHit {
        match self.scene.ground.meets(ray) {
            Some(t) => RayHit { t, code: 1 },
            None => RayHit { t: f32::INFINITY, code: 0 },
        }
    }

    pub(super) fn scene(&self) -> &'a Scene {
        self.scene
    }

    pub(super) fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    pub(super) fn solid(&self, idx: usize) -> PrismSolid<'a> {
        let prism = &self.scene.prisms[idx];
        PrismSolid { prism, foot_z: prism.base_z - 0.5 * BOX_MARGIN_M, roof_z: self.roofs[idx] }
    }

    pub(super) fn bounds(&self, idx: usize) -> &Aabb {
        &self.boxes[idx]
    }
}
