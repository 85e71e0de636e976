//! Photos: one ray per pixel, four where the picture has an edge; sun, sky, cast shadows, haze, sensor noise.
//!
//! ```text
//! L = albedo · (sun · max(0, n·s) · visible + sky · (0.6 + 0.4 n_z)),    grey level = 255 · (exposure · L)^(1/2)
//! ```

use glam::{DVec2, DVec3, Vec2, Vec3};
use image::{Rgb, RgbImage};
use rayon::prelude::*;

use sizeup_heights::seed;
use sizeup_survey::View;

use super::chance::normal;
use super::config::ImageConfig;
use super::eye::Eye;
use super::noise;
use super::scene::{SeenObject, SurfaceHit, TracedScene};
use super::texture::Palette;

/// Radiance of the sun and of the sky on a horizontal white surface.
const SUN: Vec3 = Vec3::new(1.75, 1.62, 1.42);
const SKY: Vec3 = Vec3::new(0.42, 0.50, 0.62);
/// Colour where there is nothing, and what haze fades into.
const HORIZON: Vec3 = Vec3::new(0.58, 0.66, 0.76);
/// Distance over which haze takes 63 %, metres.
const HAZE_M: f32 = 6000.0;
/// Shadow rays start this far from the surface, metres.
const LIFT_M: f32 = 0.02;
/// Extra rays of an edge pixel, as offsets from its centre in pixels.
const EDGE_RAYS: [(f64, f64); 3] = [(-0.3, -0.15), (0.15, 0.32), (0.3, -0.28)];
/// Normals apart by more than this cosine make an edge.
const SAME_NORMAL: f32 = 0.98;

/// Camera that takes photos of a scene.
pub(super) struct Photographer<'a> {
    pub scene: &'a TracedScene,
    pub palette: &'a Palette<'a>,
    pub config: &'a ImageConfig,
    pub seed: u64,
    /// Unit vector towards the sun, map axes.
    pub towards_sun: Vec3,
}

/// Unit vector towards the sun, map axes.
pub(super) fn towards_sun(config: &ImageConfig) -> Vec3 {
    let (azimuth, elevation) = (config.sun_azimuth_deg.to_radians(), config.sun_elevation_deg.to_radians());
    let level = Vec2::new(azimuth.sin() as f32, azimuth.cos() as f32) * elevation.cos() as f32;
    level.extend(elevation.sin() as f32)
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
        let hits: Vec<Option<SurfaceHit>> = (0..width * height)
            .into_par_iter()
            .map(|i| eye.look(self.scene, DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)).1)
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
                        light += self.light(&eye, pixel, eye.look(self.scene, pixel).1);
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

    /// Light that reaches a pixel.
    fn light(&self, eye: &Eye, pixel: DVec2, hit: Option<SurfaceHit>) -> Vec3 {
        let (Some(ray), Some(hit)) = (eye.ray(pixel), hit) else { return HORIZON };
        let p = ray.at(hit.t);
        let back = -ray.direction.normalize();
        let facing = hit.surface.normal.dot(back);
        let normal = if facing < 0.0 { -hit.surface.normal } else { hit.surface.normal };
        let pixel_m = hit.t * eye.pixel_angle() / facing.abs().max(0.15).sqrt();
        let albedo = self.palette.albedo(p, &hit.surface, pixel_m).max(Vec3::splat(0.01));
        let sun = self.towards_sun;
        let cosine = normal.dot(sun);
        let lit = cosine > 0.0 && !self.scene.is_shaded(p + LIFT_M * normal, sun);
        let direct = if lit { SUN * cosine } else { Vec3::ZERO };
        let light = albedo * (direct + SKY * (0.6 + 0.4 * normal.z));
        let clear = (-hit.t * ray.direction.length() / HAZE_M).exp();
        HORIZON.lerp(light, clear)
    }

    /// Grey levels with sensor noise: four uniform bytes make a nearly normal number.
    fn develop(&self, light: Vec3, pixel: usize, view: usize) -> [u8; 3] {
        /// Standard deviation of the sum of four uniform bytes.
        const SD_OF_SUM: f32 = 147.8;
        let mut bits = noise::hash(pixel as u32, view as u32, (self.seed as u32) ^ 0x5e50_0000);
        light.to_array().map(|value| {
            // A congruential step (Numerical Recipes) tells the channels apart.
            bits = bits.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let bytes = (bits ^ (bits >> 15)).to_le_bytes();
            let draw = (bytes.iter().map(|&b| f32::from(b)).sum::<f32>() - 510.0) / SD_OF_SUM;
            let grey = 255.0 * value.max(0.0).sqrt() + self.config.noise_sd as f32 * draw;
            // The cast cuts off what lies outside 0 to 255.
            (grey + 0.5) as u8
        })
    }
}

/// Whether a pixel's neighbours see another thing or another side of it.
fn is_edge(hits: &[Option<SurfaceHit>], width: usize, height: usize, col: usize, row: usize) -> bool {
    let here = &hits[row * width + col];
    let differs = |c: usize, r: usize| match (here, &hits[r * width + c]) {
        (Some(a), Some(b)) => {
            // Leaves are all edges: only their contour counts.
            let bends = || a.surface.normal.dot(b.surface.normal) < SAME_NORMAL;
            a.surface.seen() != b.surface.seen() || (a.surface.seen() != SeenObject::Clutter && bends())
        }
        (None, None) => false,
        _ => true,
    };
    (col > 0 && differs(col - 1, row))
        || (row > 0 && differs(col, row - 1))
        || (col + 1 < width && differs(col + 1, row))
        || (row + 1 < height && differs(col, row + 1))
}

#[cfg(test)]
mod tests {
    use super::super::config::SimulateConfig;
    use super::super::town::SimulatedTown;
    use super::super::{clutter, flight, world};
    use super::*;
    use sizeup_heights::stats::median;
    use sizeup_survey::ViewKind;

    /// Grey values of a 6 × 6 m patch of a level, every 0.3 m; `None` where it leaves the photo.
    fn patch(photo: &RgbImage, view: &View, centre: DVec3) -> Option<Vec<f64>> {
        let at = |i: usize| centre + DVec3::new((i % 21) as f64 * 0.3 - 3.0, (i / 21) as f64 * 0.3 - 3.0, 0.0);
        (0..21 * 21)
            .map(|i| {
                let pixel = view.camera.project(view.camera_from_map.point(at(i)))? - DVec2::splat(0.5);
                let (x, y) = (pixel.x.floor(), pixel.y.floor());
                let inside =
                    x >= 0.0 && y >= 0.0 && x + 1.0 < f64::from(photo.width()) && y + 1.0 < f64::from(photo.height());
                let grey = |dx: u32, dy: u32| f64::from(photo.get_pixel(x as u32 + dx, y as u32 + dy).0[1]);
                let (fx, fy) = (pixel.x - x, pixel.y - y);
                inside.then(|| {
                    (grey(0, 0) * (1.0 - fx) + grey(1, 0) * fx) * (1.0 - fy)
                        + (grey(0, 1) * (1.0 - fx) + grey(1, 1) * fx) * fy
                })
            })
            .collect()
    }

    /// Normalised cross-correlation of two rows of values.
    fn ncc(a: &[f64], b: &[f64]) -> f64 {
        let n = a.len() as f64;
        let centred = |v: &[f64]| -> Vec<f64> { v.iter().map(|x| x - v.iter().sum::<f64>() / n).collect() };
        let (a, b) = (centred(a), centred(b));
        let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt()
    }

    fn visible_from(scene: &TracedScene, view: &View, p: DVec3) -> bool {
        let local = |q: DVec3| (q - scene.origin.0).as_vec3();
        !scene.is_hidden(local(view.camera_from_map.centre()), local(p))
    }

    /// Flat roofs and bare ground around the town's middle.
    fn places(world: &SimulatedTown) -> Vec<DVec3> {
        let flat = world.buildings.iter().filter(|b| b.eave_m == b.ridge_m && b.footprint.interiors().is_empty());
        let roofs = flat.filter_map(|b| {
            let c = geo::Centroid::centroid(&b.footprint)?;
            Some(DVec3::new(c.x(), c.y(), b.ground_z_m + b.ridge_m))
        });
        let middle = world.extent.centre();
        let ground = (0..60).filter_map(|i| {
            let p = middle + DVec2::new((i % 10) as f64 * 17.0 - 76.0, (i / 10) as f64 * 23.0 - 57.0);
            let is_built = world.buildings.iter().any(|b| {
                geo::Distance::distance(&geo::Euclidean, &geo_types::Point::new(p.x, p.y), &b.footprint) < 6.0
            });
            let z = world.terrain.height_at(p.x, p.y)?;
            (!is_built).then(|| p.extend(z))
        });
        roofs.chain(ground).collect()
    }

    #[test]
    fn surfaces_match_between_oblique_views_at_their_true_height_and_not_beside_it() {
        let mut config = SimulateConfig::default();
        config.town.n_buildings = 30;
        config.flight.spacing_m = 60.0;
        let world = world(&config).unwrap();
        let amounts = clutter::Amounts { n_trees: 40, n_at_walls: 0, n_cars: 20 };
        let scene = TracedScene::new(&world, &clutter::scatter(&world, amounts, 1));
        let palette = Palette::new(&world, scene.origin.0.truncate(), &config);
        let towards_sun = towards_sun(&config.images);
        let studio = Photographer { scene: &scene, palette: &palette, config: &config.images, seed: 1, towards_sun };
        let mut views = flight::plan(&config, &world);
        views.retain(|v| v.kind() == ViewKind::Oblique);
        let near_the_middle = |v: &View| {
            let centre = v.camera_from_map.centre();
            let s = (config.terrain.base_z_m - centre.z) / v.axis_in_map().z;
            (centre + s * v.axis_in_map()).truncate().distance(world.extent.centre())
        };
        views.sort_by(|a, b| near_the_middle(a).total_cmp(&near_the_middle(b)));
        views.truncate(8);
        let photos: Vec<RgbImage> = views.iter().enumerate().map(|(i, view)| studio.take(view, i)).collect();
        let (mut right, mut wrong) = (Vec::new(), Vec::new());
        for place in places(&world) {
            let seen: Vec<usize> = (0..views.len()).filter(|&i| visible_from(&scene, &views[i], place)).collect();
            for (k, &i) in seen.iter().enumerate() {
                for &j in &seen[..k] {
                    let score = |z: f64| {
                        let at = place + z * DVec3::Z;
                        Some(ncc(&patch(&photos[i], &views[i], at)?, &patch(&photos[j], &views[j], at)?))
                    };
                    if let (Some(at_truth), Some(beside)) = (score(0.0), score(3.0)) {
                        right.push(at_truth);
                        wrong.push(beside);
                    }
                }
            }
        }
        let (right, n, wrong) = (median(&right).unwrap(), right.len(), median(&wrong).unwrap());
        assert!(n > 100 && right > 0.6 && wrong < 0.4, "{n} pairs: {right} at the truth, {wrong} 3 m above");
    }
}
