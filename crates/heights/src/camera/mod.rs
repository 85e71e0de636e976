//! Camera models: from a pixel to a ray and back.
//!
//! Image frame: pixels, the top-left pixel's *centre* at (0.5, 0.5). Camera frame: x right, y down, z forward.
//! A ray through a pixel has `z = 1`, so the parameter along it *is* z-depth.
//!
//! ```text
//! x' = X/Z, y' = Y/Z,   (x, y) = distort(x', y'),   u = fx·x + cx,   v = fy·y + cy
//! ```

mod distortion;
mod fisheye;

pub use distortion::Distortion;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::frames::{Cam, Map, Rigid};

/// Why camera parameters cannot describe a camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A focal length that is not a positive number.
    #[error("focal length fx {fx_px} px, fy {fy_px} px: expected positive numbers")]
    FocalLength {
        /// Horizontal focal length, pixels.
        fx_px: f64,
        /// Vertical focal length, pixels.
        fy_px: f64,
    },
    /// A principal point or distortion coefficient that is not a number.
    #[error("camera parameter {name} is {value}: expected a finite number")]
    NotFinite {
        /// Name of the parameter.
        name: &'static str,
        /// Value of the parameter.
        value: f64,
    },
    /// An image without pixels.
    #[error("image size {width_px} × {height_px}: expected at least one pixel each way")]
    EmptyImage {
        /// Columns of the image.
        width_px: u32,
        /// Rows of the image.
        height_px: u32,
    },
}

/// Intrinsics of one camera at one image size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Columns of the image.
    pub width_px: u32,
    /// Rows of the image.
    pub height_px: u32,
    /// Horizontal focal length, pixels.
    pub fx_px: f64,
    /// Vertical focal length, pixels.
    pub fy_px: f64,
    /// Principal point, pixels from the image's left edge (top-left pixel's centre at 0.5).
    pub cx_px: f64,
    /// Principal point, pixels from the image's top edge.
    pub cy_px: f64,
    /// Distortion of the lens, from ideal to observed normalised coordinates.
    pub distortion: Distortion,
}

impl Camera {
    /// A camera without distortion, principal point in the middle.
    #[must_use]
    pub fn pinhole(width_px: u32, height_px: u32, focal_px: f64) -> Self {
        Self {
            width_px,
            height_px,
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: f64::from(width_px) / 2.0,
            cy_px: f64::from(height_px) / 2.0,
            distortion: Distortion::None,
        }
    }

    /// Whether the lens bends nothing.
    #[must_use]
    pub fn is_ideal(&self) -> bool {
        self.distortion == Distortion::None
    }

    /// The same camera behind a lens that bends nothing.
    #[must_use]
    pub fn ideal(&self) -> Self {
        Self { distortion: Distortion::None, ..self.clone() }
    }

    /// Checks what no camera can have.
    ///
    /// # Errors
    /// [`CameraError`] naming the first parameter that is off.
    pub fn validate(&self) -> Result<(), CameraError> {
        if self.width_px == 0 || self.height_px == 0 {
            return Err(CameraError::EmptyImage { width_px: self.width_px, height_px: self.height_px });
        }
        let is_focal = |f: f64| f.is_finite() && f > 0.0;
        if !(is_focal(self.fx_px) && is_focal(self.fy_px)) {
            return Err(CameraError::FocalLength { fx_px: self.fx_px, fy_px: self.fy_px });
        }
        let named = [("cx", self.cx_px), ("cy", self.cy_px)];
        match named.into_iter().chain(self.distortion.coefficients()).find(|(_, value)| !value.is_finite()) {
            Some((name, value)) => Err(CameraError::NotFinite { name, value }),
            None => Ok(()),
        }
    }

    /// The pixel that sees a point, or `None` if the point is behind the camera or outside the lens model's valid
    /// domain. The pixel may lie outside the image: see [`Self::contains`].
    #[must_use]
    pub fn project(&self, point_in_camera: DVec3) -> Option<DVec2> {
        if point_in_camera.z <= 0.0 {
            return None;
        }
        let distorted = self.distortion.distort(point_in_camera.truncate() / point_in_camera.z)?;
        Some(DVec2::new(self.fx_px * distorted.x + self.cx_px, self.fy_px * distorted.y + self.cy_px))
    }

    /// The ray through a pixel as `(x, y, 1)` in the camera frame, or `None` outside the lens model's valid domain.
    #[must_use]
    #[inline]
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let distorted = DVec2::new((pixel.x - self.cx_px) / self.fx_px, (pixel.y - self.cy_px) / self.fy_px);
        Some(self.distortion.undistort(distorted)?.extend(1.0))
    }

    /// Whether a pixel position lies in the image.
    #[must_use]
    pub fn contains(&self, pixel: DVec2) -> bool {
        pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x <= f64::from(self.width_px) && pixel.y <= f64::from(self.height_px)
    }

    /// Pixel at which a photo from a pose shows a place of the map; `None` where it does not.
    #[must_use]
    pub fn pixel_of(&self, camera_from_map: &Rigid<Cam, Map>, place: DVec3) -> Option<DVec2> {
        self.project(camera_from_map.point(place)).filter(|pixel| self.contains(*pixel))
    }

    /// The same lens at another image size: pixel positions scale with the image, distortion stays.
    #[must_use]
    pub fn resized(&self, width_px: u32, height_px: u32) -> Self {
        let sx = f64::from(width_px) / f64::from(self.width_px);
        let sy = f64::from(height_px) / f64::from(self.height_px);
        Self {
            width_px,
            height_px,
            fx_px: self.fx_px * sx,
            fy_px: self.fy_px * sy,
            cx_px: self.cx_px * sx,
            cy_px: self.cy_px * sy,
            distortion: self.distortion.clone(),
        }
    }

    /// The same lens with the longer image side at most `longest_px` (never enlarged).
    #[must_use]
    pub fn reduced_to(&self, longest_px: u32) -> Self {
        let longest = self.width_px.max(self.height_px);
        if longest <= longest_px {
            return self.clone();
        }
        let scale = f64::from(longest_px) / f64::from(longest);
        let scaled = |n: u32| ((f64::from(n) * scale).round() as u32).max(1);
        self.resized(scaled(self.width_px), scaled(self.height_px))
    }
}
