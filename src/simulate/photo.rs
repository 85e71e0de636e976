//! Photos: one ray per pixel, four where the picture has an edge; sun, sky, cast shadows, haze, sensor noise.
//!
//! ```text
//! L = albedo · (sun · max(0, n·s) · visible + sky · (0.6 + 0.4 n_z)),    grey level = 255 · (exposure · L)^(1/2)
//! ```

use glam::{DVec2, DVec3, Vec2, Vec3};
use image::{Rgb, RgbImage};
use rayon::prelude::*;

use crate::seed;
use crate::survey::View;

use super::chance::normal;
use super::config::ImageConfig;
use super::noise;
use super::scene::{Hit, Scene};
use super::texture::Palette;
use super::trace::Eye;

/// Radiance of the sun and of the sky on a horizontal white surface.
const SUN: Vec3 = Vec3::new(1.75, 1.62, 1.42);
const SKY: Vec3 = Vec3::new(0.42, 0.50, 0.62);
/// What is seen where there is nothing, and what haze fades into.
const HORIZON: Vec3 = Vec3::new(0.58, 0.66, 0.76);
/// Distance over which haze takes 63 %, metres.
const HAZE_M: f32 = 6000.0;
/// Shadow rays start this far from the surface, metres.
const LIFT_M: f32 = 0.02;
/// Extra rays of an edge pixel, as offsets from its centre in pixels.
const EDGE_RAYS: [(f64, f64); 3] = [(-0.3, -0.15), (0.15, 0.32), (0.3, -0.28)];
/// Normals apart by more than this cosine make an edge.
const SAME_NORMAL: f32 = 0.98;

/// What takes photos of a scene.
pub(super) struct Photographer<'a> {
    pub scene: &'a Scene,
    pub palette: &'a Palette<'a>,
    pub config: &'a ImageConfig,
    pub seed: u64,
}

impl Photographer<'_> {
    /// The photo of one view; `idx` keys its exposure and noise.
    pub fn take(&self, view: &View, idx: usize) -> RgbImage {
        let eye = Eye::new(view, &view.camera, self.scene);
        let (width, height) = (view.camera.width_px as usize, view.camera.height_px as usize);
        let mut rng = seed::stream(self.seed, "exposure", &[idx as u64]);
        let exposure = (self.config.exposure_sd * normal(&mut rng)).exp();
        let tint = [0, 1, 2].map(|_| (0.3 * self.config.exposure_sd * normal(&mut rng)).exp());
        let gain = (DVec3::from(tint) * exposure * 0.62).as_vec3();
        let hits: Vec<Option<Hit>> = (0..width * height)
            .into_par_iter()
            .map(|i| self.look(&eye, DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)).1)
            .collect();
        let pixels: Vec<[u8; 3]> = (0..width * height)
            .into_par_iter()
            .map(|i| {
                let (col, row) = (i % width, i / width);
                let centre = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
                let mut light = self.light(&eye, centre, hits[i]);
                if is_edge(&hits, width, height, col, row) {
                    for offset in EDGE_RAYS {
                        let pixel = centre + DVec2::from(offset);
                        light += self.light(&eye, pixel, self.look(&eye, pixel).1);
                    }
                    light /= (1 + EDGE_RAYS.len()) as f32;
                }
                self.develop(light * gain, i, idx)
            })
            .collect();
        RgbImage::from_fn(view.camera.width_px, view.camera.height_px, |x, y| {
            Rgb(pixels[y as usize * width + x as usize])
        })
    }

    fn look(&self, eye: &Eye, pixel: DVec2) -> (Option<Hit>, Option<Hit>) {
        let Some(ray) = eye.ray(pixel) else { return (None, None) };
        let ground = self.scene.ground_hit(&ray);
        (ground, self.scene.first_hit(&ray, ground))
    }

    /// Light that reaches a pixel.
    fn light(&self, eye: &Eye, pixel: DVec2, hit: Option<Hit>) -> Vec3 {
        let (Some(ray), Some(hit)) = (eye.ray(pixel), hit) else { return HORIZON };
        let p = ray.at(hit.t);
        let back = -ray.direction.normalize();
        let facing = hit.surface.normal.dot(back);
        let normal = if facing < 0.0 { -hit.surface.normal } else { hit.surface.normal };
        let pixel_m = hit.t * eye.pixel_angle() / facing.abs().max(0.15).sqrt();
        let albedo = self.palette.albedo(p, &hit.surface, pixel_m).max(Vec3::splat(0.01));
        let sun = self.towards_sun();
        let cosine = normal.dot(sun);
        let lit = cosine > 0.0 && !self.scene.is_shaded(p + LIFT_M * normal, sun);
        let direct = if lit { SUN * cosine } else { Vec3::ZERO };
        let light = albedo * (direct + SKY * (0.6 + 0.4 * normal.z));
        let clear = (-hit.t * ray.direction.length() / HAZE_M).exp();
        HORIZON.lerp(light, clear)
    }

    fn towards_sun(&self) -> Vec3 {
        let (azimuth, elevation) =
            (self.config.sun_azimuth_deg.to_radians(), self.config.sun_elevation_deg.to_radians());
        let level = Vec2::new(azimuth.sin() as f32, azimuth.cos() as f32) * elevation.cos() as f32;
        level.extend(elevation.sin() as f32)
    }

    /// Grey levels with sensor noise: four uniform bytes make a nearly normal number.
    fn develop(&self, light: Vec3, pixel: usize, view: usize) -> [u8; 3] {
        /// Standard deviation of the sum of four uniform bytes.
        const SD_OF_SUM: f32 = 147.8;
        let mut channel = 0;
        light.to_array().map(|value| {
            channel += 1;
            let bytes =
                noise::hash(pixel as i32, view as i32, (self.seed as u32) ^ (0x5e50_0000 + channel)).to_le_bytes();
            let draw = (bytes.iter().map(|&b| f32::from(b)).sum::<f32>() - 510.0) / SD_OF_SUM;
            let grey = 255.0 * value.max(0.0).sqrt() + self.config.noise_sd as f32 * draw;
            grey.round().clamp(0.0, 255.0) as u8
        })
    }
}

/// Whether a pixel's neighbours see another thing or another side of it.
fn is_edge(hits: &[Option<Hit>], width: usize, height: usize, col: usize, row: usize) -> bool {
    let here = &hits[row * width + col];
    let differs = |c: usize, r: usize| match (here, &hits[r * width + c]) {
        (Some(a), Some(b)) => {
            a.surface.seen() != b.surface.seen() || a.surface.normal.dot(b.surface.normal) < SAME_NORMAL
        }
        (None, None) => false,
        _ => true,
    };
    (col > 0 && differs(col - 1, row))
        || (row > 0 && differs(col, row - 1))
        || (col + 1 < width && differs(col + 1, row))
        || (row + 1 < height && differs(col, row + 1))
}
