//! Rays against the scene, on the CPU.
//!
//! Footprints never move, only heights do. So a ray's list of footprint intervals is found once ([`profile`]) and the
//! depth along it is evaluated for any heights after that, without tracing. Whole images for pictures, view selection
//! and evaluation come from [`image`].
//!
//! ```text
//! roof parameter   s_b(h) = (ground_b + h − o_z) / d_z
//! depth            min over intervals (b, s0, s1) with s_b(h) < s1 of max(s0, s_b(h)), else the ground's s_T
//! ```
//!
//! Rays have `d · forward = 1`, so the parameter `s` is z-depth. Frame: [`Local`], `f32`.

pub mod bvh;
mod cones;
pub mod image;
mod packet;
pub mod profile;
pub mod tile;

use glam::{DVec2, DVec3, Vec3};

use crate::camera::Camera;
use crate::frames::{Cam, Local, LocalOrigin, Map, Rigid};
use crate::ray::Ray;

/// A camera placed in the local frame.
#[derive(Debug, Clone)]
pub struct PlacedCamera {
    /// Intrinsics at the working resolution.
    pub camera: Camera,
    camera_from_local: Rigid<Cam, Local>,
    eye: DVec3,
}

impl PlacedCamera {
    /// Places a camera given in the map frame.
    #[must_use]
    pub fn new(camera: Camera, camera_from_map: Rigid<Cam, Map>, origin: LocalOrigin) -> Self {
        let camera_from_local = camera_from_map * origin.map_from_local();
        Self { camera, camera_from_local, eye: camera_from_local.centre() }
    }

    /// The same camera elsewhere, moved in the local frame, metres.
    #[must_use]
    pub fn moved(&self, by: DVec3) -> Self {
        let camera_from_local = self.camera_from_local.moved(by);
        Self { camera: self.camera.clone(), camera_from_local, eye: camera_from_local.centre() }
    }

    /// The projection centre, local frame, metres.
    #[must_use]
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Size of a pixel on a surface at a local point, across the line of sight, metres.
    #[must_use]
    pub fn pixel_m_at(&self, point_in_local: DVec3) -> f64 {
        (self.eye - point_in_local).length() / self.camera.fx_px
    }

    /// The optical axis in the local (and map) frame, unit length.
    #[must_use]
    pub fn axis(&self) -> DVec3 {
        self.camera_from_local.rotation.transpose() * DVec3::Z
    }

    /// Point where the optical axis meets a level, local frame; below the camera if it never does.
    #[must_use]
    pub fn looks_at(&self, level_z: f64) -> DVec3 {
        let axis = self.axis();
        let along = if axis.z < 0.0 { ((level_z - self.eye.z) / axis.z).max(0.0) } else { 0.0 };
        (self.eye + along * axis).truncate().extend(level_z)
    }

    /// The ray through a position in the image; `None` outside the lens model's valid domain.
    #[must_use]
    pub fn ray(&self, pixel: DVec2) -> Option<Ray> {
        Some(Ray::new(self.eye.as_vec3(), self.direction(pixel)?))
    }

    /// The direction of that ray, from [`Self::eye`], local frame; `d · axis = 1`, so that its parameter is z-depth.
    #[must_use]
    #[inline]
    pub fn direction(&self, pixel: DVec2) -> Option<Vec3> {
        let direction = self.camera_from_local.rotation.transpose() * self.camera.unproject(pixel)?;
        Some(direction.as_vec3())
    }

    /// The image position that sees a local point; `None` behind the camera.
    #[must_use]
    pub fn project(&self, point_in_local: DVec3) -> Option<DVec2> {
        self.camera.project(self.camera_from_local.point(point_in_local))
    }
}
