//! A photo as it is compared with others: reduced, grey, without lens distortion and without slow changes of brightness.

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};

use crate::camera::Camera;
use crate::frames::{Cam, Map, Rigid};
use crate::raster::Raster;

/// Radius of the neighbourhood whose mean is subtracted, pixels: wide compared with any comparison window.
const SLOW_RADIUS_PX: usize = 15;

/// A camera and its pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PosedCamera {
    /// Intrinsics of the photo.
    pub camera: Camera,
    /// Pose: from the map frame to the camera's.
    pub camera_from_map: Rigid<Cam, Map>,
}

impl PosedCamera {
    /// The same camera at the pose of another.
    #[must_use]
    pub fn posed_as(&self, other: &Self) -> Self {
        Self { camera: self.camera.clone(), camera_from_map: other.camera_from_map }
    }

    /// Calibration matrix: from rays in the camera's frame to pixels, without distortion.
    #[must_use]
    pub fn calibration(&self) -> DMat3 {
        let camera = &self.camera;
        DMat3::from_cols(
            DVec3::new(camera.fx_px, 0.0, 0.0),
            DVec3::new(0.0, camera.fy_px, 0.0),
            DVec3::new(camera.cx_px, camera.cy_px, 1.0),
        )
    }

    /// Pixel at which the photo shows a place of the map; `None` where it does not.
    #[must_use]
    pub fn pixel_of(&self, place: DVec3) -> Option<DVec2> {
        self.camera.pixel_of(&self.camera_from_map, place)
    }
}

/// A reduced, grey, distortion-free photo with its camera.
#[derive(Debug, Clone)]
pub struct Picture {
    grey: Arc<Raster<f32>>,
    posed: PosedCamera,
}

impl Picture {
    /// Picture of a grey photo of the camera's size; `None` if the sizes differ.
    #[must_use]
    pub fn new(grey: &Raster<f32>, camera: &Camera, camera_from_map: Rigid<Cam, Map>) -> Option<Self> {
        if (grey.width(), grey.height()) != (camera.width_px as usize, camera.height_px as usize) {
            return None;
        }
        let ideal = camera.ideal();
        let grey = Arc::new(flatten(&straighten(grey, camera, &ideal)));
        Some(Self { grey, posed: PosedCamera { camera: ideal, camera_from_map } })
    }

    /// Whether it shows a place of the map.
    #[must_use]
    pub fn shows(&self, place: DVec3) -> bool {
        self.posed.pixel_of(place).is_some()
    }

    /// The same picture from another place, moved in the map frame, metres.
    #[must_use]
    pub fn moved(&self, by: DVec3) -> Self {
        let PosedCamera { camera, camera_from_map } = self.posed.clone();
        Self { grey: self.grey.clone(), posed: PosedCamera { camera, camera_from_map: camera_from_map.moved(by) } }
    }

    /// Picture of a camera without distortion, with this brightness at each pixel's centre.
    ///
    /// # Panics
    /// Never: there is one value per pixel.
    #[must_use]
    pub fn painted(posed: PosedCamera, brightness: impl Fn(DVec2) -> f32) -> Self {
        let (width, height) = (posed.camera.width_px as usize, posed.camera.height_px as usize);
        let at = |i: usize| brightness(DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5));
        let grey = Raster::from_vec(width, height, (0..width * height).map(at).collect()).expect("one per pixel");
        Self { grey: Arc::new(grey), posed }
    }

    /// Picture of a camera without distortion that sees this brightness along each ray: centre and direction, map frame.
    #[must_use]
    pub fn seeing(camera: Camera, camera_from_map: Rigid<Cam, Map>, brightness: impl Fn(DVec3, DVec3) -> f32) -> Self {
        let to_map = camera_from_map.rotation.inverse();
        let (centre, rays) = (camera_from_map.centre(), camera.clone());
        let at = |pixel: DVec2| {
            let ray = DVec3::new((pixel.x - rays.cx_px) / rays.fx_px, (pixel.y - rays.cy_px) / rays.fy_px, 1.0);
            brightness(centre, to_map * ray)
        };
        Self::painted(PosedCamera { camera, camera_from_map }, at)
    }

    /// The picture at half its size.
    ///
    /// # Panics
    /// Never: there is one value per pixel.
    #[must_use]
    pub fn half(&self) -> Self {
        let (width, height) = (self.grey.width() / 2, self.grey.height() / 2);
        let mean = |i: usize| {
            let (x, y) = (i % width * 2, i / width * 2);
            let at = |dx: usize, dy: usize| self.grey[(x + dx, y + dy)];
            (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4.0
        };
        let grey = Raster::from_vec(width, height, (0..width * height).map(mean).collect()).expect("one per pixel");
        let camera = &self.posed.camera;
        // Exactly half, also where an odd last column or row has gone.
        let camera = Camera {
            width_px: width as u32,
            height_px: height as u32,
            fx_px: camera.fx_px / 2.0,
            fy_px: camera.fy_px / 2.0,
            cx_px: camera.cx_px / 2.0,
            cy_px: camera.cy_px / 2.0,
            ..camera.ideal()
        };
        Self { grey: Arc::new(grey), posed: PosedCamera { camera, ..self.posed.clone() } }
    }

    /// Brightness relative to the surroundings, `H × W`, without gaps.
    #[must_use]
    pub fn grey(&self) -> &Raster<f32> {
        &self.grey
    }

    /// Camera of the picture and its pose.
    #[must_use]
    pub fn posed(&self) -> &PosedCamera {
        &self.posed
    }

    /// Camera without distortion, of the picture's size.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.posed.camera
    }

    /// Pose: from the map frame to the camera's.
    #[must_use]
    pub fn camera_from_map(&self) -> &Rigid<Cam, Map> {
        &self.posed.camera_from_map
    }
}

/// Picture that a camera without distortion would have taken; its border repeated where the photo ends.
fn straighten(grey: &Raster<f32>, distorted: &Camera, ideal: &Camera) -> Raster<f32> {
    if distorted.is_ideal() {
        return grey.map(|v| if v.is_nan() { 0.0 } else { *v });
    }
    let (width, height) = (grey.width(), grey.height());
    let value = |i: usize| {
        let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let seen = ideal.unproject(pixel).and_then(|ray| distorted.project(ray)).unwrap_or(pixel);
        let seen = seen.clamp(DVec2::ZERO, DVec2::new(width as f64, height as f64));
        let value = grey.bilinear(seen.x, seen.y);
        if value.is_nan() { 0.0 } else { value }
    };
    Raster::from_vec(width, height, (0..width * height).map(value).collect()).expect("one value per pixel")
}

/// Brightness minus its mean in a wide neighbourhood: exposure, haze and vignetting go, texture stays, and sums of
/// squares stay small enough for `f32`.
fn flatten(grey: &Raster<f32>) -> Raster<f32> {
    let rows = mean_along_rows(grey.data(), grey.width());
    let turned = transpose(&rows, grey.width());
    let means = transpose(&mean_along_rows(&turned, grey.height()), grey.height());
    let flat = grey.data().iter().zip(means).map(|(v, mean)| v - mean);
    Raster::from_vec(grey.width(), grey.height(), flat.collect()).expect("one value per pixel")
}

fn mean_along_rows(values: &[f32], width: usize) -> Vec<f32> {
    let mut means = Vec::with_capacity(values.len());
    // Grey levels are small and few: their sums in 64 bits are as good as exact.
    let mut sums_before = vec![0.0_f64; width + 1];
    for row in values.chunks_exact(width) {
        for (col, value) in row.iter().enumerate() {
            sums_before[col + 1] = sums_before[col] + f64::from(*value);
        }
        means.extend((0..width).map(|col| {
            let (first, end) = (col.saturating_sub(SLOW_RADIUS_PX), (col + SLOW_RADIUS_PX + 1).min(width));
            ((sums_before[end] - sums_before[first]) / (end - first) as f64) as f32
        }));
    }
    means
}

fn transpose(values: &[f32], width: usize) -> Vec<f32> {
    let height = values.len() / width;
    (0..width).flat_map(|col| (0..height).map(move |row| values[row * width + col])).collect()
}
