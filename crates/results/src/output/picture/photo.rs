//! Photos, and what is cut out of them.

use std::path::Path;

use glam::DVec2;
use image::imageops::{FilterType, crop_imm, resize};
use image::{Rgb, RgbImage};

use super::super::{MalformedFile, OutputError};
use sizeup_geo::files::is_virtual;
use sizeup_geo::geodata::raster::{RasterError, RasterFile};
use sizeup_survey::View;

/// Longer side of the grey that stands for a photo that is not there, pixels.
const NO_PHOTO_PX: u32 = 640;
/// Colour of a photo that is not there.
const NO_PHOTO: [u8; 3] = [120, 120, 120];
/// Margin shown around a building, shares of its own size in the photo, and at least, pixels of the photo.
const AROUND_SHARE: f64 = 0.45;
const LEAST_AROUND_PX: f64 = 12.0;
/// Width of a cut-out by its height.
const ASPECT: f64 = 4.0 / 3.0;

/// The photo of a view as it is stored; grey where none is known.
///
/// # Errors
/// [`OutputError::Malformed`]: a file that is no picture, or cannot be read.
pub fn photo_of(view: &View) -> Result<RgbImage, OutputError> {
    let Some(path) = &view.image else {
        let camera = view.camera.reduced_to(NO_PHOTO_PX);
        return Ok(RgbImage::from_pixel(camera.width_px, camera.height_px, Rgb(NO_PHOTO)));
    };
    let malformed = |reason: String| MalformedFile { path: path.clone(), reason };
    if is_virtual(path) {
        return Ok(through_gdal(path).map_err(|e| malformed(e.to_string()))?);
    }
    // The EXIF orientation stays unapplied: poses are of the image as it is stored.
    Ok(image::open(path).map_err(|e| malformed(e.to_string()))?.into_rgb8())
}

/// A photo in an archive or on a server; grey ones three times the same.
fn through_gdal(path: &Path) -> Result<RgbImage, RasterError> {
    let file = RasterFile::open(path)?;
    let mut photo = RgbImage::new(file.size().0 as u32, file.size().1 as u32);
    for band in 0..3 {
        let values = file.read(if file.n_bands() >= 3 { band + 1 } else { 1 })?;
        for (pixel, value) in photo.pixels_mut().zip(values.data()) {
            pixel.0[band] = value.round().clamp(0.0, 255.0) as u8; // NaN becomes 0
        }
    }
    Ok(photo)
}

/// A part of a photo, pixels of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotoCrop {
    /// Upper left corner.
    pub corner: DVec2,
    /// Width and height.
    pub size: DVec2,
}

impl PhotoCrop {
    /// The part that shows these points (pixels) and some of what is around them, of the shape of a cut-out; `None` where
    /// none of it is in the photo.
    #[must_use]
    pub fn around(points: &[DVec2], view_px: DVec2) -> Option<Self> {
        let low = points.iter().copied().reduce(DVec2::min)?;
        let high = points.iter().copied().reduce(DVec2::max)?;
        let around = ((high - low) * AROUND_SHARE).max(DVec2::splat(LEAST_AROUND_PX));
        let mut size = high - low + 2.0 * around;
        size = DVec2::new(size.x.max(size.y * ASPECT), size.y.max(size.x / ASPECT)).min(view_px);
        let corner = (0.5 * (low + high) - 0.5 * size).clamp(DVec2::ZERO, view_px - size).floor();
        let is_inside = (low.cmplt(view_px) & high.cmpgt(DVec2::ZERO)).all();
        (is_inside && size.min_element() >= 1.0).then_some(Self { corner, size: size.floor() })
    }

    /// Where a pixel of the camera lies in the part, shares of its width and height.
    #[must_use]
    pub fn share_of(&self, pixel: DVec2) -> DVec2 {
        (pixel - self.corner) / self.size
    }

    /// The part as a picture of this size; the photo may be stored in another size than the camera's.
    #[must_use]
    pub fn cut_out(&self, photo: &RgbImage, view: &View, [width, height]: [u32; 2]) -> RgbImage {
        let camera = DVec2::new(f64::from(view.camera.width_px), f64::from(view.camera.height_px));
        let stored = DVec2::new(f64::from(photo.width()), f64::from(photo.height()));
        let [x, y] = (self.corner / camera * stored).to_array().map(|v| v as u32);
        let [w, h] = (self.size / camera * stored).max(DVec2::ONE).to_array().map(|v| v as u32);
        resize(&crop_imm(photo, x, y, w, h).to_image(), width, height, FilterType::Triangle)
    }
}
