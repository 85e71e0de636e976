//! `OpenSfM`'s `reconstruction.json`, also where ODM has rewritten it.
//!
//! Shots hold world to camera as angle-axis and `t`, `C = −Rᵀ·t`; axes are ours. Image coordinates are normalised by
//! the larger side about the image's middle. The world is east, north, up at `reference_lla`, or, once ODM has
//! georeferenced it, a grid minus an offset: `odm_frame` tells which. Heights are ellipsoidal. Source: both projects'
//! code.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde::Deserialize;

use super::angles::from_rotation_vector;
use super::error::Place;
use super::formats::FileMarks;
use super::heights::FileUnits;
use super::odm_frame::{self, Fix};
use super::poses::{FileHeights, Pose, Poses};
use super::{SurveyConfig, SurveyError, text};
use sizeup_heights::camera::{Camera, Distortion};

#[derive(Deserialize)]
struct Reconstruction {
    #[serde(default)]
    cameras: BTreeMap<String, SfmCamera>,
    #[serde(default)]
    shots: BTreeMap<String, OpensfmShot>,
    reference_lla: Option<ReferenceLla>,
}

#[derive(Deserialize)]
struct ReferenceLla {
    latitude: f64,
    longitude: f64,
    #[serde(default)]
    altitude: f64,
}

#[derive(Deserialize)]
struct OpensfmShot {
    rotation: [f64; 3],
    translation: [f64; 3],
    camera: String,
    /// Position by the satellite receiver, east, north, up at `reference_lla`, metres.
    gps_position: Option<[f64; 3]>,
    /// Accuracy of that position, metres; huge where there is none.
    gps_dop: Option<f64>,
}

#[derive(Deserialize)]
pub(super) struct SfmCamera {
    #[serde(default = "perspective")]
    projection_type: String,
    pub(super) width: f64,
    pub(super) height: f64,
    #[serde(flatten)]
    numbers: BTreeMap<String, serde_json::Value>,
}

/// Cameras by name; one that cannot be used keeps the reason.
pub(super) type CamerasByName = BTreeMap<String, Result<Arc<Camera>, String>>;

fn perspective() -> String {
    "perspective".to_owned()
}

/// Reads a JSON file.
pub(super) fn json<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<T, SurveyError> {
    serde_json::from_reader(text::open(path)?)
        .map_err(|e| SurveyError::malformed(path, Place::Line(e.line() as u64), e.to_string()))
}

/// A folder with the file, or the file.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    marks.path.join("reconstruction.json").is_file()
        || (marks.has_extension("json") && marks.head.trim_start().starts_with('['))
}

/// Positions of receivers worse than this are placeholders, metres (`OpenSfM` writes 999,999 for none).
const MAX_GPS_DOP_M: f64 = 1e4;

/// Reads a `reconstruction.json`, all of its parts.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let path = &if path.is_dir() { path.join("reconstruction.json") } else { path.to_owned() };
    let parts: Vec<Reconstruction> = json(path)?;
    let mut poses = Poses { heights: FileHeights::Ellipsoidal, units: FileUnits::ONE_SCALE, ..Poses::new() };
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut reference = parts.first().and_then(|part| part.reference_lla.as_ref()).map(ReferenceLla::lon_lat_height);
    if reference.is_none() && folder.join("reference_lla.json").is_file() {
        let beside: ReferenceLla = json(&folder.join("reference_lla.json"))?;
        reference = Some(beside.lon_lat_height());
    }
    let mut origins = parts.iter().filter_map(|part| part.reference_lla.as_ref()).map(ReferenceLla::lon_lat_height);
    if let Some(other) = origins.find(|origin| Some(*origin) != reference) {
        let first = reference.unwrap_or(other);
        let message = format!(
            "its parts have origins of their own (longitude, latitude {}, {} and {}, {}): expected one\nhint: export each part on its own",
            first.x, first.y, other.x, other.y
        );
        return Err(SurveyError::malformed(path, Place::Whole, message));
    }
    let mut fixes = Vec::new();
    for part in parts {
        let cameras = cameras_of(part.cameras);
        for (name, shot) in part.shots {
            let rotation = from_rotation_vector(shot.rotation.into());
            let centre = -(rotation.transpose() * DVec3::from(shot.translation));
            let is_fixed = shot.gps_dop.is_none_or(|dop_m| dop_m < MAX_GPS_DOP_M);
            if let Some(gps) = shot.gps_position.map(DVec3::from).filter(|gps| is_fixed && *gps != DVec3::ZERO) {
                fixes.push(Fix { gps, centre });
            }
            take(&name, &shot.camera, &cameras, &mut poses, |camera| Pose {
                name: name.clone(),
                camera,
                camera_from_world: rotation,
                centre,
            });
        }
    }
    odm_frame::place(&mut poses, path, reference, &fixes, config)?;
    Ok(poses)
}

impl ReferenceLla {
    fn lon_lat_height(&self) -> DVec3 {
        DVec3::new(self.longitude, self.latitude, self.altitude)
    }
}

/// Adds a shot's pose if its camera can be used.
pub(super) fn take(
    name: &str,
    camera: &str,
    cameras: &CamerasByName,
    poses: &mut Poses,
    pose: impl FnOnce(Arc<Camera>) -> Pose,
) {
    match cameras.get(camera_key(camera)) {
        Some(Ok(camera)) => poses.poses.push(pose(Arc::clone(camera))),
        Some(Err(reason)) => poses.refuse("camera_unusable", name, reason.clone()),
        None => poses.refuse("camera_unknown", name, format!("its camera {camera:?} is not in the file of cameras")),
    }
}

/// Shots say `v2 dji fc300s …`, `cameras.json` leaves the `v2 ` out.
pub(super) fn camera_key(id: &str) -> &str {
    id.strip_prefix("v2 ").unwrap_or(id)
}

/// The cameras of a file by their key.
pub(super) fn cameras_of(cameras: BTreeMap<String, SfmCamera>) -> CamerasByName {
    cameras.into_iter().map(|(id, camera)| (camera_key(&id).to_owned(), camera_of(&camera).map(Arc::new))).collect()
}

impl SfmCamera {
    fn number(&self, name: &str) -> Option<f64> {
        self.numbers.get(name).and_then(serde_json::Value::as_f64)
    }

    /// The horizontal focal length over the image's larger side.
    pub(super) fn focal(&self) -> Option<f64> {
        self.number("focal_x").or_else(|| self.number("focal"))
    }
}

fn camera_of(camera: &SfmCamera) -> Result<Camera, String> {
    let number = |name: &str| camera.number(name);
    let or_zero = |name: &str| number(name).unwrap_or(0.0);
    let is_pixels = |n: f64| n.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&n);
    if !(is_pixels(camera.width) && is_pixels(camera.height)) {
        return Err(format!("image size {} × {}: expected pixels", camera.width, camera.height));
    }
    let larger_px = camera.width.max(camera.height);
    let focal_x = camera.focal().ok_or("the camera has no focal length")?;
    let focal_y = number("focal_y").unwrap_or(focal_x);
    let [k1, k2, k3, k4] = ["k1", "k2", "k3", "k4"].map(or_zero);
    let [p1, p2] = ["p1", "p2"].map(or_zero);
    let distortion = match camera.projection_type.as_str() {
        "perspective" | "radial" | "simple_radial" => Distortion::Brown { k1, k2, k3: 0.0, p1: 0.0, p2: 0.0 },
        "brown" => Distortion::Brown { k1, k2, k3, p1, p2 },
        "fisheye" => Distortion::Fisheye { k1, k2, k3: 0.0, k4: 0.0 },
        "fisheye_opencv" => Distortion::Fisheye { k1, k2, k3, k4 },
        other => return Err(format!("projection {other:?} is not supported: undistort the photos first")),
    };
    let camera = Camera {
        width_px: camera.width as u32,
        height_px: camera.height as u32,
        fx_px: focal_x * larger_px,
        fy_px: focal_y * larger_px,
        cx_px: camera.width / 2.0 + or_zero("c_x") * larger_px,
        cy_px: camera.height / 2.0 + or_zero("c_y") * larger_px,
        distortion,
    };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(camera)
}
