//! Whole images of the proxies: z-depth, building and face per pixel.

use glam::DVec2;
use rayon::prelude::*;

use super::PlacedCamera;
use super::bvh::Bvh;
use crate::ids::BuildingIdx;
use crate::raster::Raster;
use crate::ray::{Aabb, Ray};
use crate::scene::{Crossing, Scene};

/// What a ray meets first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Face {
    /// Sky, or ground that is not known.
    Nothing,
    /// The terrain.
    Ground,
    /// A building's wall.
    Wall(BuildingIdx),
    /// A building's roof.
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
    /// What is seen.
    pub face: Raster<Face>,
}

/// A scene with one height per building, ready for rays.
pub struct SceneTracer<'a> {
    scene: &'a Scene,
    roofs: Vec<f32>,
    bvh: Bvh,
}

impl<'a> SceneTracer<'a> {
    /// `heights_m`: metres above each building's ground level, one per building.
    #[must_use]
    pub fn new(scene: &'a Scene, heights_m: &[f32]) -> Self {
        let roofs = scene.roofs(heights_m);
        let boxes: Vec<Aabb> = scene.prisms.iter().zip(&roofs).map(|(p, &roof)| p.bounds_below(roof)).collect();
        Self { scene, roofs, bvh: Bvh::build(&boxes) }
    }

    /// The ray parameter of the first thing met, and what it is; `NaN` and [`Face::Nothing`] if there is none.
    /// `scratch` saves an allocation per ray.
    pub fn trace(&self, ray: &Ray, scratch: &mut Vec<Crossing>) -> (f32, Face) {
        let (mut nearest, mut face) = match self.scene.ground.meets(ray) {
            Some(t) => (t, Face::Ground),
            None => (f32::INFINITY, Face::Nothing),
        };
        self.bvh.traverse(ray, nearest, |idx, t_max| {
            scratch.clear();
            self.scene.prisms[idx].crossings(ray, scratch);
            for crossing in scratch.iter() {
                if let Some((t, is_roof)) = meet(ray, *crossing, self.roofs[idx])
                    && t < nearest
                {
                    nearest = t;
                    let building = BuildingIdx::new(idx);
                    face = if is_roof { Face::Roof(building) } else { Face::Wall(building) };
                }
            }
            t_max.min(nearest)
        });
        if nearest.is_finite() { (nearest, face) } else { (f32::NAN, Face::Nothing) }
    }

    /// Renders a whole image, rows in parallel.
    #[must_use]
    pub fn render(&self, placed: &PlacedCamera) -> DepthImage {
        let (width, height) = (placed.camera.width_px as usize, placed.camera.height_px as usize);
        let mut depth = Raster::filled(width, height, f32::NAN);
        let mut face = Raster::filled(width, height, Face::Nothing);
        depth.data_mut().par_chunks_mut(width).zip(face.data_mut().par_chunks_mut(width)).enumerate().for_each_init(
            Vec::new,
            |scratch, (row, (depths, faces))| {
                for col in 0..width {
                    let pixel = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
                    if let Some(ray) = placed.ray(pixel) {
                        (depths[col], faces[col]) = self.trace(&ray, scratch);
                    }
                }
            },
        );
        DepthImage { depth, face }
    }
}

/// Where a ray meets a prism within one stretch over its footprint, and whether that is the roof.
fn meet(ray: &Ray, crossing: Crossing, roof_z: f32) -> Option<(f32, bool)> {
    let (from, dz) = (ray.origin.z, ray.direction.z);
    let enter = crossing.enter.max(0.0);
    if from + enter * dz <= roof_z {
        return (crossing.enter > 0.0).then_some((enter, false)); // from inside there is no wall to see
    }
    let roof = (roof_z - from) / dz;
    (dz < 0.0 && roof < crossing.leave).then_some((roof, true))
}
