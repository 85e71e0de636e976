//! COLMAP models: `cameras` and `images`, text or binary.
//!
//! World to camera, Hamilton quaternions, `C = −Rᵀ·t`; camera axes and the pixel convention are ours: the top-left
//! pixel's centre is (0.5, 0.5). Source: COLMAP's documentation, "Output Format". The world is what the model was
//! aligned to; the file does not say.

mod binary;
mod models;
mod points;
mod text;

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};

pub use points::{SparseGround, sparse_ground};

use super::error::Place;
use super::formats::FileMarks;
use super::heights::FileUnits;
use super::poses::{Pose, Poses};
use super::{SurveyConfig, SurveyError};
use sizeup_heights::camera::Camera;

/// Cameras by COLMAP's id; one that cannot be used keeps the reason.
type CamerasById = BTreeMap<u32, Result<Arc<Camera>, String>>;

/// One row of `images`.
struct ImageRow {
    wxyz: [f64; 4],
    translation: DVec3,
    camera_id: u32,
    name: String,
}

/// A folder with `images.txt` or `images.bin`.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    let images = marks.path.join("images");
    marks.is_folder && ["txt", "bin"].iter().any(|e| images.with_extension(e).is_file())
}

/// Reads the model in a folder; binary where both exist, as COLMAP itself does.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let folder = config.path.as_path();
    let file = |stem: &str, extension: &str| folder.join(stem).with_extension(extension);
    let mut poses = Poses { units: FileUnits::ONE_SCALE, ..Poses::new() };
    if file("images", "bin").is_file() {
        let cameras = binary::cameras(&file("cameras", "bin"))?;
        binary::images(&file("images", "bin"), |row| take(row, &cameras, &mut poses))?;
    } else if file("images", "txt").is_file() {
        let cameras = text::cameras(&file("cameras", "txt"))?;
        text::images(&file("images", "txt"), |row| take(row, &cameras, &mut poses))?;
    } else {
        return Err(SurveyError::malformed(folder, Place::Whole, "neither images.txt nor images.bin is there")
            .hint("`path` is the folder of the model, often sparse/0"));
    }
    Ok(poses)
}

/// Turns a row into a pose, or into an issue.
fn take(row: ImageRow, cameras: &CamerasById, poses: &mut Poses) {
    let [w, x, y, z] = row.wxyz;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let length = quaternion.length();
    let camera = match cameras.get(&row.camera_id) {
        Some(Ok(camera)) => camera,
        Some(Err(reason)) => return poses.refuse("camera_unusable", &row.name, reason.clone()),
        None => {
            let message = format!("its camera {} is not in the model", row.camera_id);
            return poses.refuse("camera_unknown", &row.name, message);
        }
    };
    if !(length.is_finite() && length > 1e-6 && row.translation.is_finite()) {
        let message =
            format!("quaternion {:?}, translation {}: expected unit length, finite", row.wxyz, row.translation);
        return poses.refuse("pose_unusable", &row.name, message);
    }
    let rotation = DMat3::from_quat(quaternion.normalize());
    let centre = -(rotation.transpose() * row.translation);
    poses.poses.push(Pose { name: row.name, camera: Arc::clone(camera), camera_from_world: rotation, centre });
}
