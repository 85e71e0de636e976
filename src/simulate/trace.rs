//! True depth: what each pixel's ray meets, and where it would meet the ground if nothing stood there.

use glam::DVec2;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::raster::Raster;
use crate::survey::View;

use super::eye::Eye;
use super::scene::{Scene, Seen};

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
            let (ground, first) = eye.look(scene, pixel);
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
