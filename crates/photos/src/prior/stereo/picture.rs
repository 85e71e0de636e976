//! A photo as stereo sees it: small, grey, without lens distortion and without slow brightness changes.

use glam::{DMat3, DVec2, DVec3};

use crate::prior::PriorError;
use sizeup_geo::geodata::raster::{CellWindow, RasterFile, Resampling};
use sizeup_heights::camera::Camera;
use sizeup_heights::frames::{Cam, Map, Rigid};
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Radius of the neighbourhood whose mean is taken off, pixels: wide against any comparison window.
const SLOW_RADIUS_PX: usize = 15;

/// The camera of a reduced, distortion-free photo, where it stood.
#[derive(Debug, Clone)]
pub(super) struct Ideal {
    /// Without distortion, of the picture's size.
    pub camera: Camera,
    /// Pose of the view: from the map frame to its camera's.
    pub camera_from_map: Rigid<Cam, Map>,
}

impl Ideal {
    /// Picture of a view, whose photo need not be read for that.
    pub(super) fn of(view: &View, long_side_px: u32) -> Self {
        let camera = view.camera.reduced_to(long_side_px).ideal();
        Self { camera, camera_from_map: view.camera_from_map }
    }

    /// The same camera where another stands.
    pub(super) fn posed_as(&self, other: &Self) -> Self {
        Self { camera: self.camera.clone(), camera_from_map: other.camera_from_map }
    }

    /// Calibration matrix: pixels from rays in the camera's frame.
    pub(super) fn calibration(&self) -> DMat3 {
        let camera = &self.camera;
        DMat3::from_cols(
            DVec3::new(camera.fx_px, 0.0, 0.0),
            DVec3::new(0.0, camera.fy_px, 0.0),
            DVec3::new(camera.cx_px, camera.cy_px, 1.0),
        )
    }
}

/// A reduced, grey, distortion-free photo with its camera.
#[derive(Debug)]
pub struct Picture {
    grey: Raster<f32>,
    ideal: Ideal,
}

impl Picture {
    /// Decodes at reduced size (from a JPEG's own coarser scales where it is one), whatever the photo's size.
    pub(crate) fn load(view: &View, long_side_px: u32) -> Result<Self, PriorError> {
        let refuse = |problem: String| PriorError::Photo {
            view: view.id.to_string(),
            problem,
            hint: "is it the photo that the pose belongs to?".to_owned(),
        };
        let path = view.image.as_deref().ok_or_else(|| refuse("its photo is not known".to_owned()))?;
        let file = RasterFile::open(path)?;
        let (width, height) = file.size();
        let aspect_is_off =
            (width as f64 * f64::from(view.camera.height_px) - height as f64 * f64::from(view.camera.width_px)).abs()
                > 0.01 * width as f64 * f64::from(view.camera.height_px);
        if aspect_is_off {
            return Err(refuse(format!(
                "its photo has {width} × {height} pixels, its camera {} × {}",
                view.camera.width_px, view.camera.height_px
            )));
        }
        let distorted_camera = view.camera.reduced_to(long_side_px);
        let size = (distorted_camera.width_px as usize, distorted_camera.height_px as usize);
        let whole = CellWindow { col: 0, row: 0, width, height };
        let band = |i: usize| file.read_window(i, whole, size, Resampling::Average);
        let grey = if file.n_bands() >= 3 {
            let (red, green, blue) = (band(1)?, band(2)?, band(3)?);
            let mixed = red.data().iter().zip(green.data()).zip(blue.data()).map(|((r, g), b)| r + g + b);
            Raster::from_vec(size.0, size.1, mixed.map(|sum| sum / 3.0).collect()).expect("bands are alike")
        } else {
            band(1)?
        };
        let ideal = Ideal::of(view, long_side_px);
        let straight = straighten(&grey, &distorted_camera, &ideal.camera);
        Ok(Self { grey: flatten(&straight), ideal })
    }

    /// Whether it shows a place of the map.
    #[must_use]
    pub fn shows(&self, place: DVec3) -> bool {
        let Ideal { camera, camera_from_map } = &self.ideal;
        camera.project(camera_from_map.point(place)).is_some_and(|pixel| camera.contains(pixel))
    }

    /// Picture of a camera and what it sees, by pixel.
    #[cfg(test)]
    pub(super) fn painted(ideal: Ideal, brightness: impl Fn(DVec2) -> f32) -> Self {
        let (width, height) = (ideal.camera.width_px as usize, ideal.camera.height_px as usize);
        let at = |i: usize| brightness(DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5));
        let grey = Raster::from_vec(width, height, (0..width * height).map(at).collect()).expect("one per pixel");
        Self { grey, ideal }
    }

    /// Picture of a camera without distortion that sees brightness along each ray: centre and direction, map frame.
    #[cfg(test)]
    pub(crate) fn seeing(
        camera: Camera,
        camera_from_map: Rigid<Cam, Map>,
        brightness: impl Fn(DVec3, DVec3) -> f32,
    ) -> Self {
        let to_map = camera_from_map.rotation.inverse();
        let (centre, rays) = (camera_from_map.centre(), camera.clone());
        let at = |pixel: DVec2| {
            let ray = DVec3::new((pixel.x - rays.cx_px) / rays.fx_px, (pixel.y - rays.cy_px) / rays.fy_px, 1.0);
            brightness(centre, to_map * ray)
        };
        Self::painted(Ideal { camera, camera_from_map }, at)
    }

    /// The picture at half its size.
    pub(super) fn half(&self) -> Self {
        let (width, height) = (self.grey.width() / 2, self.grey.height() / 2);
        let mean = |i: usize| {
            let (x, y) = (i % width * 2, i / width * 2);
            let at = |dx: usize, dy: usize| self.grey[(x + dx, y + dy)];
            (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4.0
        };
        let grey = Raster::from_vec(width, height, (0..width * height).map(mean).collect()).expect("one per pixel");
        let camera = &self.ideal.camera;
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
        Self { grey, ideal: Ideal { camera, ..self.ideal.clone() } }
    }

    /// Brightness against its surroundings, `H × W`, no gaps.
    pub(crate) fn grey(&self) -> &Raster<f32> {
        &self.grey
    }

    /// Camera of the picture, where it stood.
    pub(super) fn ideal(&self) -> &Ideal {
        &self.ideal
    }

    /// Without distortion, of the picture's size.
    pub(crate) fn camera(&self) -> &Camera {
        &self.ideal.camera
    }

    /// Pose of the view: from the map frame to its camera's.
    pub(crate) fn camera_from_map(&self) -> &Rigid<Cam, Map> {
        &self.ideal.camera_from_map
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
