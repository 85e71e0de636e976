//! nerfstudio's `transforms.json` (also instant-ngp's).
//!
//! `transform_matrix` is camera to world, 4 × 4, camera x right, y up, z backward. `applied_transform` (3 × 4) is what the
//! converter did to the world and is undone; the world is then COLMAP's, of which the file says nothing. Intrinsics stand
//! with the file or with each frame, in pixels from the top-left corner:
//!
//! ```text
//! OPENCV, PINHOLE   x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p1 x y + p2 (r² + 2x²)
//! OPENCV_FISHEYE    θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)
//! ```
//!
//! Source: nerfstudio's documentation, "Data conventions", and its converter from COLMAP, which agree.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use serde::Deserialize;

use super::angles::{CameraAxes, nearest_rotation, rows};
use super::error::Place;
use super::formats::FileMarks;
use super::heights::FileUnits;
use super::opensfm::json;
use super::poses::{Pose, Poses};
use super::{SurveyConfig, SurveyError};
use sizeup_heights::camera::{Camera, Distortion};

#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    camera: Intrinsics,
    applied_transform: Option<Vec<Vec<f64>>>,
    frames: Vec<NerfstudioFrame>,
}

#[derive(Deserialize)]
struct NerfstudioFrame {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    camera: Intrinsics,
}

/// Intrinsics of the file, or of a frame, whose own go first.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
struct Intrinsics {
    camera_model: Option<String>,
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

/// A JSON object with frames and their matrices, or the folder of a `transforms.json`.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    marks.path.join("transforms.json").is_file()
        || (marks.has_extension("json")
            && marks.head.trim_start().starts_with('{')
            && (marks.name == "transforms.json" || marks.head.contains("\"transform_matrix\"")))
}

/// Reads the file, or the one in a folder.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let path = &if path.is_dir() { path.join("transforms.json") } else { path.to_owned() };
    let Transforms { camera: shared, applied_transform, frames } = json(path)?;
    let applied = applied_transform.as_deref().map(similarity).transpose();
    let applied = applied.map_err(|e| SurveyError::malformed(path, Place::Whole, format!("applied_transform: {e}")))?;
    let mut poses = Poses { units: FileUnits::ONE_SCALE, ..Poses::new() };
    let mut made: Vec<(Intrinsics, Result<Arc<Camera>, String>)> = Vec::new();
    for NerfstudioFrame { file_path, transform_matrix, camera } in frames {
        let name = file_path.trim_start_matches("./");
        let camera = camera.or(&shared);
        let known = made.iter().rev().find(|(intrinsics, _)| *intrinsics == camera).map(|(_, made)| made.clone());
        let model = known.unwrap_or_else(|| {
            let model = camera.model().map(Arc::new);
            made.push((camera, model.clone()));
            model
        });
        match model.and_then(|camera| Ok((camera, pose(&transform_matrix, applied)?))) {
            Ok((camera, (camera_from_world, centre))) => {
                poses.poses.push(Pose { name: name.to_owned(), camera, camera_from_world, centre });
            }
            Err(reason) => poses.refuse("pose_unusable", name, reason),
        }
    }
    Ok(poses)
}

/// Rotation and centre of a camera in the world before `applied`.
fn pose(matrix: &[Vec<f64>], applied: Option<(DMat3, DVec3)>) -> Result<(DMat3, DVec3), String> {
    let (world_from_axes, centre) = similarity(matrix).map_err(|e| format!("transform_matrix: {e}"))?;
    let (rotation, centre) = match applied {
        Some((turn, shift)) => (turn.transpose() * world_from_axes, turn.transpose() * (centre - shift)),
        None => (world_from_axes, centre),
    };
    Ok((CameraAxes::XRightYUp.camera_from_axes() * rotation.transpose(), centre))
}

/// Rotation and translation of a matrix of three or four rows.
fn similarity(matrix: &[Vec<f64>]) -> Result<(DMat3, DVec3), String> {
    let row = |i: usize| -> Result<[f64; 4], String> {
        let row = matrix.get(i).ok_or_else(|| format!("{} rows: expected 4", matrix.len()))?;
        row.as_slice().try_into().map_err(|_| format!("a row of {} numbers: expected 4", row.len()))
    };
    let [x, y, z] = [row(0)?, row(1)?, row(2)?];
    let rotation = rows([x[0], x[1], x[2]], [y[0], y[1], y[2]], [z[0], z[1], z[2]]);
    Ok((nearest_rotation(rotation)?, DVec3::new(x[3], y[3], z[3])))
}

impl Intrinsics {
    /// With the file's where the frame has none of its own.
    fn or(&self, shared: &Self) -> Self {
        let mut all = self.clone();
        all.camera_model = all.camera_model.or_else(|| shared.camera_model.clone());
        let fields: [(&mut Option<f64>, Option<f64>); 12] = [
            (&mut all.w, shared.w),
            (&mut all.h, shared.h),
            (&mut all.fl_x, shared.fl_x),
            (&mut all.fl_y, shared.fl_y),
            (&mut all.cx, shared.cx),
            (&mut all.cy, shared.cy),
            (&mut all.k1, shared.k1),
            (&mut all.k2, shared.k2),
            (&mut all.k3, shared.k3),
            (&mut all.k4, shared.k4),
            (&mut all.p1, shared.p1),
            (&mut all.p2, shared.p2),
        ];
        fields.into_iter().for_each(|(own, of_file)| *own = own.or(of_file));
        all
    }

    fn model(&self) -> Result<Camera, String> {
        let need = |value: Option<f64>, name: &str| value.ok_or_else(|| format!("its camera has no {name}"));
        let (width, height) = (need(self.w, "w")?, need(self.h, "h")?);
        let is_pixels = |n: f64| n.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&n);
        if !(is_pixels(width) && is_pixels(height)) {
            return Err(format!("image size {width} × {height}: expected pixels"));
        }
        let [k1, k2, k3, k4] = [self.k1, self.k2, self.k3, self.k4].map(|k| k.unwrap_or(0.0));
        let [p1, p2] = [self.p1, self.p2].map(|p| p.unwrap_or(0.0));
        let distortion = match self.camera_model.as_deref().unwrap_or("OPENCV") {
            "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" if k4 == 0.0 => Distortion::Brown { k1, k2, k3, p1, p2 },
            "OPENCV" => Distortion::BrownAffine { k1, k2, k3, k4, p1, p2, skew: 0.0 },
            "OPENCV_FISHEYE" => Distortion::Fisheye { k1, k2, k3, k4 },
            other => return Err(format!("camera model {other:?} is not supported: undistort the photos first")),
        };
        let fx_px = need(self.fl_x, "fl_x")?;
        let camera = Camera {
            width_px: width as u32,
            height_px: height as u32,
            fx_px,
            fy_px: self.fl_y.unwrap_or(fx_px),
            cx_px: self.cx.unwrap_or(width / 2.0),
            cy_px: self.cy.unwrap_or(height / 2.0),
            distortion,
        };
        camera.validate().map_err(|e| e.to_string())?;
        Ok(camera)
    }
}
