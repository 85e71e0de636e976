//! A camera in the scene: rays through its pixels, and what they meet.

use glam::{DMat3, DVec2, IVec2, Vec3};

use sizeup_heights::camera::{Camera, Distortion};
use sizeup_heights::ray::{Aabb, Ray};
use sizeup_survey::View;

use super::scene::{SurfaceHit, TracedScene};

/// Side of the square tiles that are known to show ground only, pixels.
const TILE_PX: i32 = 8;
/// Lens distortion bends a box's edges by less than this share of the image's width.
const BEND: f64 = 0.04;

/// A camera in the `Local` frame.
pub(super) struct Eye<'a> {
    camera: &'a Camera,
    local_from_camera: DMat3,
    centre: Vec3,
    /// Row-major tiles: whether something other than ground may be seen there.
    things: Vec<bool>,
    n_tiles: IVec2,
}

impl<'a> Eye<'a> {
    /// `camera` is the view's own, or the same lens at another size.
    pub fn new(view: &View, camera: &'a Camera, scene: &TracedScene) -> Self {
        let centre = (view.camera_from_map.centre() - scene.origin.0).as_vec3();
        let local_from_camera = view.camera_from_map.rotation.transpose();
        let n_tiles = IVec2::new(camera.width_px.cast_signed(), camera.height_px.cast_signed()) / TILE_PX + 1;
        let mut eye =
            Self { camera, local_from_camera, centre, things: vec![false; (n_tiles.x * n_tiles.y) as usize], n_tiles };
        scene.boxes().for_each(|b| eye.mark(b));
        eye
    }

    /// Marks the tiles that a box may be seen in.
    fn mark(&mut self, b: &Aabb) {
        let camera_from_local = self.local_from_camera.transpose();
        let corner = |i: usize| {
            let pick = |bit: usize, low: f32, high: f32| if i & bit == 0 { low } else { high };
            Vec3::new(pick(1, b.min.x, b.max.x), pick(2, b.min.y, b.max.y), pick(4, b.min.z, b.max.z))
        };
        let pixel = |i| self.camera.project(camera_from_local * (corner(i) - self.centre).as_dvec3());
        let Some(pixels) = (0..8).map(pixel).collect::<Option<Vec<DVec2>>>() else {
            // Partly behind the camera or outside the lens model: no telling where.
            let behind = (0..8).all(|i| (camera_from_local * (corner(i) - self.centre).as_dvec3()).z <= 0.0);
            if !behind {
                self.things.fill(true);
            }
            return;
        };
        let bend_px = match self.camera.distortion {
            Distortion::None => 1.0,
            _ => BEND * f64::from(self.camera.width_px),
        };
        let tile = |p: DVec2| (p / f64::from(TILE_PX)).floor().as_ivec2().clamp(IVec2::NEG_ONE, self.n_tiles);
        let low = tile(pixels.iter().copied().fold(DVec2::INFINITY, DVec2::min) - bend_px).max(IVec2::ZERO);
        let high = tile(pixels.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max) + bend_px).min(self.n_tiles - 1);
        for row in low.y..=high.y {
            for col in low.x..=high.x {
                self.things[(row * self.n_tiles.x + col) as usize] = true;
            }
        }
    }

    /// The ray through a pixel, its parameter being z-depth; `None` outside the lens model.
    pub fn ray(&self, pixel: DVec2) -> Option<Ray> {
        let direction = self.local_from_camera * self.camera.unproject(pixel)?;
        Some(Ray::new(self.centre, direction.as_vec3()))
    }

    /// Point where a pixel's ray meets the ground, whatever stands in front of it, and what it meets first.
    pub fn look(&self, scene: &TracedScene, pixel: DVec2) -> (Option<SurfaceHit>, Option<SurfaceHit>) {
        let Some(ray) = self.ray(pixel) else { return (None, None) };
        let ground = scene.ground_hit(&ray);
        let tile = (pixel / f64::from(TILE_PX)).as_ivec2().clamp(IVec2::ZERO, self.n_tiles - 1);
        let may_see_things = self.things[(tile.y * self.n_tiles.x + tile.x) as usize];
        (ground, if may_see_things { scene.first_hit(&ray, ground) } else { ground })
    }

    /// Radians per pixel in the middle of the image.
    pub fn pixel_angle(&self) -> f32 {
        (1.0 / self.camera.fx_px) as f32
    }
}
