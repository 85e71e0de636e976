//! True depth: what each pixel's ray meets, and where it would meet the ground if nothing stood there.

use glam::{DMat3, DVec2, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::raster::Raster;
use crate::render::bvh::Ray;
use crate::survey::View;

use super::scene::{Scene, Seen};

/// A camera in the `Local` frame.
pub(super) struct Eye<'a> {
    camera: &'a Camera,
    local_from_camera: DMat3,
    centre: Vec3,
}

impl<'a> Eye<'a> {
    /// `camera` is the view's own, or the same lens at another size.
    pub fn new(view: &View, camera: &'a Camera, scene: &Scene) -> Self {
        let centre = view.camera_from_map.centre() - scene.origin.0;
        Self { camera, local_from_camera: view.camera_from_map.rotation.transpose(), centre: centre.as_vec3() }
    }

    /// The ray through a pixel, its parameter being z-depth; `None` outside the lens model.
    pub fn ray(&self, pixel: DVec2) -> Option<Ray> {
        let direction = self.local_from_camera * self.camera.unproject(pixel)?;
        Some(Ray::new(self.centre, direction.as_vec3()))
    }

    /// Radians per pixel in the middle of the image.
    pub fn pixel_angle(&self) -> f32 {
        (1.0 / self.camera.fx_px) as f32
    }
}

/// The truth behind one depth prior: `H × W`, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueDepth {
    /// z-depth of what is seen, metres; `NaN` = sky.
    pub depth_m: Raster<f32>,
    /// z-depth of the ground along the same ray, metres; `NaN` = none.
    pub ground_m: Raster<f32>,
    /// What is seen.
    pub seen: Raster<Seen>,
}

/// Traces one view at a camera's size (the view's own, or the same lens reduced).
pub(super) fn true_depth(scene: &Scene, view: &View, camera: &Camera) -> TrueDepth {
    let eye = Eye::new(view, camera, scene);
    let (width, height) = (camera.width_px as usize, camera.height_px as usize);
    let pixels: Vec<(f32, f32, Seen)> = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let Some(ray) = eye.ray(pixel) else { return (f32::NAN, f32::NAN, Seen::Sky) };
            let ground = scene.ground_hit(&ray);
            let first = scene.first_hit(&ray, ground);
            let t = |hit: Option<super::scene::Hit>| hit.map_or(f32::NAN, |h| h.t);
            (t(first), t(ground), first.map_or(Seen::Sky, |h| h.surface.seen()))
        })
        .collect();
    let image = |f: fn(&(f32, f32, Seen)) -> f32| {
        Raster::from_vec(width, height, pixels.iter().map(f).collect()).expect("one value per pixel")
    };
    let seen = pixels.iter().map(|p| p.2).collect();
    TrueDepth {
        depth_m: image(|p| p.0),
        ground_m: image(|p| p.1),
        seen: Raster::from_vec(width, height, seen).expect("one value per pixel"),
    }
}
