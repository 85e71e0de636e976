//! `OpenSfM`'s `reconstruction.json`, and ODM's `shots.geojson`.
//!
//! Shots hold world to camera as angle-axis and `t`, `C = −Rᵀ·t`; axes are ours. Image coordinates are normalised by
//! the larger side about the image's middle. The world is east, north, up at `reference_lla`, or, once ODM has
//! georeferenced it, UTM minus an offset: ODM then leaves `reconstruction.topocentric.json` beside the rewritten file,
//! the offset in `odm_georeferencing/coords.txt` and the CRS in `proj.txt`. In `shots.geojson`, `translation` is the
//! camera's *position* in that CRS. Heights are ellipsoidal. Source: both projects' code.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use serde::Deserialize;

use super::SurveyError;
use super::angles::from_rotation_vector;
use super::error::Place;
use super::poses::{FileHeights, Pose, Poses, World};
use crate::camera::{Camera, Distortion};
use crate::crs::Crs;
use crate::files::{self, FileError};

#[derive(Deserialize)]
struct Reconstruction {
    #[serde(default)]
    cameras: BTreeMap<String, SfmCamera>,
    #[serde(default)]
    shots: BTreeMap<String, Shot>,
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
struct Shot {
    rotation: [f64; 3],
    translation: [f64; 3],
    camera: String,
}

#[derive(Deserialize)]
struct SfmCamera {
    #[serde(default = "perspective")]
    projection_type: String,
    width: f64,
    height: f64,
    #[serde(flatten)]
    numbers: BTreeMap<String, serde_json::Value>,
}

#[derive(Deserialize)]
struct ShotsLayer {
    features: Vec<ShotFeature>,
}

#[derive(Deserialize)]
struct ShotFeature {
    properties: ShotProperties,
}

#[derive(Deserialize)]
struct ShotProperties {
    filename: String,
    camera: String,
    rotation: Option<[f64; 3]>,
    translation: Option<[f64; 3]>,
}

type Cameras = BTreeMap<String, Result<Arc<Camera>, String>>;

fn perspective() -> String {
    "perspective".to_owned()
}

fn json<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<T, SurveyError> {
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    serde_json::from_reader(BufReader::with_capacity(1 << 18, file))
        .map_err(|e| SurveyError::malformed(path, Place::Line(e.line() as u64), e.to_string()))
}

/// Reads a `reconstruction.json`, the largest of its parts first where it has several.
pub(crate) fn read(path: &Path) -> Result<Poses, SurveyError> {
    let path = &if path.is_dir() { path.join("reconstruction.json") } else { path.to_owned() };
    let parts: Vec<Reconstruction> = json(path)?;
    let mut poses = Poses { heights: FileHeights::Ellipsoidal, ..Poses::new() };
    let folder = path.parent().unwrap_or(Path::new("."));
    let is_rewritten = path.file_name().is_some_and(|name| name == "reconstruction.json")
        && folder.join("reconstruction.topocentric.json").is_file();
    let mut offset = DVec3::ZERO;
    if is_rewritten {
        let georeferencing = folder.join("..").join("odm_georeferencing");
        offset = odm_offset(&georeferencing.join("coords.txt"))?;
        poses.world = World::Crs(odm_crs(&georeferencing)?);
    } else if let Some(reference) = parts.first().and_then(|part| part.reference_lla.as_ref()) {
        poses.world = World::Enu(DVec3::new(reference.longitude, reference.latitude, reference.altitude));
    } else if folder.join("reference_lla.json").is_file() {
        let reference: ReferenceLla = json(&folder.join("reference_lla.json"))?;
        poses.world = World::Enu(DVec3::new(reference.longitude, reference.latitude, reference.altitude));
    }
    for part in parts {
        let cameras = cameras_of(part.cameras);
        for (name, shot) in part.shots {
            let rotation = from_rotation_vector(shot.rotation.into());
            let centre = -(rotation.transpose() * DVec3::from(shot.translation)) + offset;
            take(&name, &shot.camera, &cameras, &mut poses, |camera| Pose {
                name: name.clone(),
                camera,
                camera_from_world: rotation,
                centre,
            });
        }
    }
    Ok(poses)
}

/// Reads ODM's `shots.geojson`; `cameras.json` lies beside it or at the project's root.
pub(crate) fn read_shots(path: &Path) -> Result<Poses, SurveyError> {
    let layer: ShotsLayer = json(path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let cameras_path = [folder.join("cameras.json"), folder.join("..").join("cameras.json")]
        .into_iter()
        .find(|candidate| candidate.is_file())
        .ok_or_else(|| {
            SurveyError::malformed(path, Place::Whole, "there is no cameras.json beside it or one folder up")
                .hint("shots.geojson has no lens parameters: copy ODM's cameras.json beside it")
        })?;
    let cameras = cameras_of(json(&cameras_path)?);
    let mut poses = Poses { heights: FileHeights::Ellipsoidal, ..Poses::new() };
    let georeferencing = [folder.to_owned(), folder.join("..").join("odm_georeferencing")];
    if let Some(found) = georeferencing.iter().find(|f| f.join("proj.txt").is_file()) {
        poses.world = World::Crs(odm_crs(found)?);
    }
    for ShotFeature { properties: shot } in layer.features {
        let (Some(rotation), Some(position)) = (shot.rotation, shot.translation) else {
            poses.refuse("photo_without_pose", &shot.filename, "the shot has no rotation or translation");
            continue;
        };
        take(&shot.filename, &shot.camera, &cameras, &mut poses, |camera| Pose {
            name: shot.filename.clone(),
            camera,
            camera_from_world: from_rotation_vector(rotation.into()),
            centre: position.into(),
        });
    }
    Ok(poses)
}

fn take(name: &str, camera: &str, cameras: &Cameras, poses: &mut Poses, pose: impl FnOnce(Arc<Camera>) -> Pose) {
    match cameras.get(camera_key(camera)) {
        Some(Ok(camera)) => poses.poses.push(pose(Arc::clone(camera))),
        Some(Err(reason)) => poses.refuse("camera_unusable", name, reason.clone()),
        None => poses.refuse("camera_unknown", name, format!("its camera {camera:?} is not in the file of cameras")),
    }
}

/// Shots say `v2 dji fc300s …`, `cameras.json` leaves the `v2 ` out.
fn camera_key(id: &str) -> &str {
    id.strip_prefix("v2 ").unwrap_or(id)
}

fn cameras_of(cameras: BTreeMap<String, SfmCamera>) -> Cameras {
    cameras.into_iter().map(|(id, camera)| (camera_key(&id).to_owned(), camera_of(&camera).map(Arc::new))).collect()
}

fn camera_of(camera: &SfmCamera) -> Result<Camera, String> {
    let number = |name: &str| camera.numbers.get(name).and_then(serde_json::Value::as_f64);
    let or_zero = |name: &str| number(name).unwrap_or(0.0);
    let is_pixels = |n: f64| n.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&n);
    if !(is_pixels(camera.width) && is_pixels(camera.height)) {
        return Err(format!("image size {} × {}: expected pixels", camera.width, camera.height));
    }
    let larger_px = camera.width.max(camera.height);
    let focal_x = number("focal_x").or_else(|| number("focal")).ok_or("the camera has no focal length")?;
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

/// The second line of `coords.txt`: easting and northing.
fn odm_offset(path: &Path) -> Result<DVec3, SurveyError> {
    let text = files::read_text(path)?;
    let numbers: Vec<f64> =
        text.lines().nth(1).unwrap_or_default().split_ascii_whitespace().filter_map(|n| n.parse().ok()).collect();
    match numbers[..] {
        [easting, northing, ..] => Ok(DVec3::new(easting, northing, 0.0)),
        _ => Err(SurveyError::malformed(path, Place::Line(2), "expected easting and northing of the offset")),
    }
}

fn odm_crs(folder: &Path) -> Result<Crs, SurveyError> {
    let path: PathBuf = folder.join("proj.txt");
    let text = files::read_text(&path)?;
    Ok(crs_of_line(text.trim())?)
}

/// A CRS as a line of a file; PROJ strings of older tools lack `+type=crs`.
pub(crate) fn crs_of_line(line: &str) -> Result<Crs, crate::crs::CrsError> {
    if line.starts_with('+') && !line.contains("+type=crs") {
        return Crs::parse(&format!("{line} +type=crs"));
    }
    Crs::parse(line)
}
