//! Which buildings a view sees with the present heights.

use rayon::prelude::*;

use crate::render::PlacedCamera;
use crate::render::profile::Profiles;
use crate::scene::{Prism, Scene};

/// Steepest stretch of a wall's area by its foreshortening that still counts in full.
const MIN_WALL_SLANT: f32 = 0.1;

/// Visibility of one building in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewSight {
    /// Position of the building in the scene.
    pub building: u32,
    /// Sampled rays that end on it.
    pub n_rays: u32,
    /// Rays among these on its roof.
    pub n_roof_rays: u32,
    /// Share of its roof's corners that lie inside the image, 0..1.
    pub corners_inside: f32,
}

/// Visibility in one view.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Visibility {
    /// The buildings seen by at least one ray, by index.
    pub buildings: Vec<ViewSight>,
    /// Visible surface of buildings, m² (the paper's `Q_A`).
    pub surface_m2: f32,
}

/// Visibility of every building in every view, views in parallel.
///
/// A ray of a block of `stride²` pixels at z-depth `s` stands for `stride² s² / (fx fy)` m² across the optical axis; on
/// a roof that is spread by `1/|d_z|`, on a wall (taken to face the ray) by `1/|d_xy|`.
#[must_use]
pub fn visibility(
    scene: &Scene,
    views: &[(&PlacedCamera, &Profiles)],
    heights_m: &[f32],
    stride_px: usize,
) -> Vec<Visibility> {
    let roofs = scene.roofs(heights_m);
    views.par_iter().map(|(placed, profiles)| visibility_of(scene, placed, profiles, &roofs, stride_px)).collect()
}

fn visibility_of(
    scene: &Scene,
    placed: &PlacedCamera,
    profiles: &Profiles,
    roofs: &[f32],
    stride_px: usize,
) -> Visibility {
    let mut rays_on = vec![[0_u32; 2]; scene.prisms.len()];
    let mut surface_m2 = 0.0;
    let block = (stride_px * stride_px) as f32 / (placed.camera.fx_px * placed.camera.fy_px) as f32;
    for (ray_idx, ray) in profiles.rays.iter().enumerate() {
        let sight = profiles.sight(ray_idx, roofs);
        if let Some(building) = sight.building {
            let on = &mut rays_on[building as usize];
            on[0] += 1;
            on[1] += u32::from(sight.is_roof);
            let horizontal = (1.0 - ray.dz * ray.dz).max(0.0).sqrt();
            let slant = if sight.is_roof { -ray.dz } else { horizontal.max(MIN_WALL_SLANT) };
            surface_m2 += block * sight.depth * sight.depth / slant;
        }
    }
    let buildings = (0_u32..)
        .zip(&rays_on)
        .filter(|(_, on)| on[0] > 0)
        .map(|(building, on)| ViewSight {
            building,
            n_rays: on[0],
            n_roof_rays: on[1],
            corners_inside: corners_inside(&scene.prisms[building as usize], placed, roofs[building as usize]),
        })
        .collect();
    Visibility { buildings, surface_m2 }
}

/// Share of a footprint's corners that lie inside the image when they are at a level, local frame, metres.
pub fn corners_inside(prism: &Prism, placed: &PlacedCamera, z: f32) -> f32 {
    let (mut n_inside, mut n) = (0, 0);
    for (corner, _) in prism.edges() {
        let pixel = placed.project(corner.extend(z).as_dvec3());
        n_inside += usize::from(pixel.is_some_and(|p| placed.camera.contains(p)));
        n += 1;
    }
    n_inside as f32 / n.max(1) as f32
}
