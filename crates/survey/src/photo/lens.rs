//! Intrinsics of a photo from what its metadata know, best source first.

use exif::Tag;

use super::header::PhotoHeader;
use super::xmp::Tags;
use crate::config::{CameraConfig, PixelOrigin};
use crate::csv::declared_camera;
use sizeup_heights::camera::{Camera, Distortion};

/// Diagonal of a 36 × 24 mm frame.
const FULL_FRAME_DIAGONAL_MM: f64 = 43.266_615;
/// Largest difference between the aspects of the raster and of the size EXIF tells before they are different crops.
const ASPECT_TOLERANCE: f64 = 0.01;

/// Pixel pitch of sensors whose maker publishes it: EXIF model, columns, micrometres (DJI's specification pages).
const PITCHES: [(&str, f64, f64); 6] = [
    ("ZH20T", 640.0, 12.0),
    ("ZenmuseP1", 8192.0, 4.4),
    ("M3E", 5280.0, 3.3),
    ("FC6310", 5472.0, 2.41),
    ("FC6310R", 5472.0, 2.41),
    ("FC6310S", 5472.0, 2.41),
];

/// A camera and where its focal length comes from.
pub(super) struct PhotoCamera {
    pub camera: Camera,
    pub source: &'static str,
}

/// The camera at the raster's own size.
pub(super) fn of(header: &PhotoHeader, tags: &Tags, declared: Option<&CameraConfig>) -> Result<PhotoCamera, String> {
    let (width_px, height_px) = header.size_px;
    if let Some(declared) = declared {
        let camera = declared_camera(declared, PixelOrigin::default())?;
        let is_same_shape = is_same_aspect((camera.width_px, camera.height_px), header.size_px);
        if !is_same_shape {
            return Err(format!(
                "the photo is {width_px} × {height_px} px, the declared camera {} × {}",
                camera.width_px, camera.height_px
            ));
        }
        return Ok(PhotoCamera { camera: camera.resized(width_px, height_px), source: "declared camera" });
    }
    let native_px = native_size(header);
    let at_native = |focal_px: f64| Camera::pinhole(native_px.0, native_px.1, focal_px);
    let (camera, source) = if let Some(camera) = dewarp(tags, native_px)? {
        (camera, "DewarpData")
    } else if let Some(camera) = calibrated(tags, native_px)? {
        (camera, "CalibratedFocalLength")
    } else if let Some(focal_px) = from_pitch(header) {
        (Camera::pinhole(width_px, height_px, focal_px), "focal length / pixel pitch")
    } else if let Some(equivalent_mm) = header.number(Tag::FocalLengthIn35mmFilm).filter(|&mm| mm > 0.0) {
        let diagonal_px = f64::from(native_px.0).hypot(f64::from(native_px.1));
        (at_native(equivalent_mm / FULL_FRAME_DIAGONAL_MM * diagonal_px), "35 mm equivalent")
    } else {
        return Err("no focal length in its metadata: declare the camera under [survey.camera]".to_owned());
    };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(PhotoCamera { camera: camera.resized(width_px, height_px), source })
}

fn is_same_aspect(a: (u32, u32), b: (u32, u32)) -> bool {
    let aspect = |(w, h): (u32, u32)| f64::from(w) / f64::from(h.max(1));
    (aspect(a) / aspect(b) - 1.0).abs() < ASPECT_TOLERANCE
}

/// The size the camera wrote; a resized photo still tells it, and calibrations refer to it.
fn native_size(header: &PhotoHeader) -> (u32, u32) {
    let told = |tag| header.number(tag).map(|n| n as u32).filter(|&n| n > 0);
    match (told(Tag::PixelXDimension), told(Tag::PixelYDimension)) {
        (Some(width), Some(height)) if is_same_aspect((width, height), header.size_px) => (width, height),
        _ => header.size_px,
    }
}

/// `date;fx,fy,cx,cy,k1,k2,p1,p2,k3`: pixels, centre as an offset from the image's middle, OpenCV's order.
fn dewarp(tags: &Tags, (width_px, height_px): (u32, u32)) -> Result<Option<Camera>, String> {
    let Some(text) = tags.text("DewarpData") else { return Ok(None) };
    let numbers = text.rsplit(';').next().unwrap_or_default();
    let numbers: Option<Vec<f64>> = numbers.split(',').map(|number| number.trim().parse().ok()).collect();
    let Some([fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3]) = numbers.and_then(|n| <[f64; 9]>::try_from(n).ok())
    else {
        return Err(format!(
            "its DewarpData is {text:?}: expected date;fx,fy,cx,cy,k1,k2,p1,p2,k3; declare the camera under [survey.camera]"
        ));
    };
    // Flag 1: the camera has removed the distortion already.
    let is_dewarped = tags.number("DewarpFlag")? == Some(1.0);
    Ok(Some(Camera {
        width_px,
        height_px,
        fx_px,
        fy_px,
        cx_px: f64::from(width_px) / 2.0 + cx_px,
        cy_px: f64::from(height_px) / 2.0 + cy_px,
        distortion: if is_dewarped { Distortion::None } else { Distortion::Brown { k1, k2, k3, p1, p2 } },
    }))
}

fn calibrated(tags: &Tags, (width_px, height_px): (u32, u32)) -> Result<Option<Camera>, String> {
    let Some(focal_px) = tags.number("CalibratedFocalLength")?.filter(|&focal| focal > 0.0) else { return Ok(None) };
    let mut camera = Camera::pinhole(width_px, height_px, focal_px);
    if let (Some(cx_px), Some(cy_px)) =
        (tags.number("CalibratedOpticalCenterX")?, tags.number("CalibratedOpticalCenterY")?)
    {
        (camera.cx_px, camera.cy_px) = (cx_px, cy_px);
    }
    Ok(Some(camera))
}

/// Focal length in pixels of the raster, from millimetres and the pitch: told by EXIF, or published for the model.
fn from_pitch(header: &PhotoHeader) -> Option<f64> {
    let focal_mm = header.number(Tag::FocalLength).filter(|&mm| mm > 0.0)?;
    let model = header.text(Tag::Model)?;
    let (_, columns, pitch_um) = PITCHES.iter().find(|(known, ..)| *known == model)?;
    Some(focal_mm * 1000.0 / pitch_um * f64::from(header.size_px.0) / columns)
}
