//! Pix4D's Open Photogrammetry Format 1.0: a calibrated `project.opf`.
//!
//! The project lists items by type, each with files by format: `calibration` (calibrated cameras), `camera_list`
//! (file names), `input_cameras` (image sizes), `scene_reference_frame` (the CRS and how it was moved). Ids join them.
//!
//! ```text
//! R = Rx(ω)·Ry(φ)·Rz(κ), camera (x right, y up, z back) to the processing frame
//! processing = swap(scale · base) + shift
//! ```
//!
//! Pixels count from the corner of the image; distortion is Pix4D's, which is `OpenCV`'s for perspective lenses and for
//! fisheyes, θ off the axis, direction (x, y) in the image plane:
//!
//! ```text
//! t = 2θ/π,   ρ = p0 + p1 t + p2 t² + p3 t³ + …,   (u, v) = [c d; e f] · ρ (x, y)/|(x, y)| + principal point
//! ```
//!
//! Rigs need nothing more: every camera has its own pose. Sources: <https://github.com/Pix4D/opf-spec>, version 1.0, and
//! for the fisheye Pix4D support, "How are the Internal and External Camera Parameters defined?", which it refers to.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::angles::AngleConvention;
use super::error::Place;
use super::formats::FileMarks;
use super::names::NameStyle;
use super::poses::{Pose, Poses, World};
use super::{SurveyConfig, SurveyError, text};
use sizeup_geo::crs::Crs;
use sizeup_geo::paths::within;
use sizeup_heights::camera::{Camera, Distortion};

/// Coefficients of a fisheye's polynomial, p0 included.
const MAX_FISHEYE_TERMS: usize = 5;

#[derive(Deserialize)]
struct OpfProject {
    items: Vec<OpfItem>,
}

#[derive(Deserialize)]
struct OpfItem {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    resources: Vec<Resource>,
}

#[derive(Deserialize)]
struct Resource {
    uri: String,
    format: String,
}

#[derive(Deserialize)]
struct OpfCalibration {
    sensors: Vec<Sensor>,
    cameras: Vec<CalibratedCamera>,
}

#[derive(Deserialize)]
struct Sensor {
    id: u64,
    internals: Internals,
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum Internals {
    Perspective {
        principal_point_px: [f64; 2],
        focal_length_px: f64,
        radial_distortion: [f64; 3],
        tangential_distortion: [f64; 2],
    },
    Fisheye {
        principal_point_px: [f64; 2],
        affine: [f64; 4],
        polynomial: Vec<f64>,
    },
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
struct CalibratedCamera {
    id: u64,
    sensor_id: u64,
    position: [f64; 3],
    orientation_deg: [f64; 3],
}

#[derive(Deserialize)]
struct InputCameras {
    sensors: Vec<InputSensor>,
}

#[derive(Deserialize)]
struct InputSensor {
    id: u64,
    image_size_px: [f64; 2],
}

#[derive(Deserialize)]
struct CameraList {
    cameras: Vec<ListedCamera>,
}

#[derive(Deserialize)]
struct ListedCamera {
    id: u64,
    uri: String,
}

#[derive(Deserialize)]
struct SceneFrame {
    crs: FrameCrs,
    base_to_canonical: Canonical,
}

#[derive(Deserialize)]
struct FrameCrs {
    definition: String,
    geoid_height: Option<f64>,
}

#[derive(Deserialize)]
struct Canonical {
    shift: [f64; 3],
    scale: [f64; 3],
    swap_xy: bool,
}

/// The project file that a path means.
fn find(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path.to_owned());
    }
    let is_project = |file: &PathBuf| file.extension().is_some_and(|e| e.eq_ignore_ascii_case("opf"));
    let mut files: Vec<PathBuf> =
        fs::read_dir(path).ok()?.filter_map(|entry| Some(entry.ok()?.path())).filter(is_project).collect();
    files.sort();
    files.into_iter().next()
}

/// A project, or a folder with one.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    marks.has_extension("opf") || (marks.is_folder && find(&marks.path).is_some())
}

/// Reads a project with a calibration.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let file = find(path)
        .ok_or_else(|| SurveyError::malformed(path, Place::Whole, "expected a .opf project, or a folder with one"))?;
    let project: OpfProject = read_json(&file)?;
    let calibration: OpfCalibration = project.part(&file, "calibration", "opf-calibrated-cameras")?;
    let inputs: InputCameras = project.part(&file, "input_cameras", "opf-input-cameras")?;
    let list: CameraList = project.part(&file, "camera_list", "opf-camera-list")?;
    let frame: SceneFrame = project.part(&file, "scene_reference_frame", "opf-scene-reference-frame")?;

    let names: BTreeMap<u64, &str> = list.cameras.iter().map(|c| (c.id, without_page(&c.uri))).collect();
    let sizes: BTreeMap<u64, [f64; 2]> = inputs.sensors.iter().map(|s| (s.id, s.image_size_px)).collect();
    let cameras: BTreeMap<u64, Result<Arc<Camera>, String>> = calibration
        .sensors
        .iter()
        .map(|sensor| (sensor.id, camera(&sensor.internals, sizes.get(&sensor.id).copied()).map(Arc::new)))
        .collect();

    let mut poses = Poses { world: world(&file, &frame)?, names: NameStyle::Path, ..Poses::new() };
    for calibrated in &calibration.cameras {
        let number = calibrated.id.to_string();
        let name = names.get(&calibrated.id).copied().unwrap_or(&number);
        let sensor = cameras.get(&calibrated.sensor_id).cloned();
        let sensor = sensor.unwrap_or_else(|| Err(format!("its sensor {} is not calibrated", calibrated.sensor_id)));
        match sensor.and_then(|camera| pose(name, camera, calibrated, &frame.base_to_canonical)) {
            Ok(pose) => poses.poses.push(pose),
            Err(reason) => poses.refuse("pose_unusable", name, reason),
        }
    }
    Ok(poses)
}

impl OpfProject {
    /// The first file of a format among the items of a type.
    fn part<T: DeserializeOwned>(&self, project: &Path, kind: &str, format: &str) -> Result<T, SurveyError> {
        let resource = self
            .items
            .iter()
            .filter(|item| item.kind == kind)
            .flat_map(|item| &item.resources)
            .find(|resource| resource.format.trim_end_matches("+json").ends_with(format));
        let resource = resource.ok_or_else(|| {
            SurveyError::malformed(project, Place::Whole, format!("the project has no {kind} ({format})")).hint(
                "export a calibrated project: `calibration`, `input_cameras`, `camera_list`, `scene_reference_frame`",
            )
        })?;
        let beside = within(&resource.uri).ok_or_else(|| {
            let message = format!("the {kind} is in {:?}, outside the project's folder", resource.uri);
            SurveyError::malformed(project, Place::Whole, message)
        })?;
        read_json(&project.with_file_name(beside))
    }
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, SurveyError> {
    serde_json::from_reader(text::open(path)?)
        .map_err(|e| SurveyError::malformed(path, Place::Line(e.line() as u64), e.to_string()))
}

/// A photo's URI, page of a TIFF left out.
fn without_page(uri: &str) -> &str {
    uri.split('#').next().unwrap_or(uri)
}

fn world(path: &Path, frame: &SceneFrame) -> Result<World, SurveyError> {
    if frame.crs.geoid_height.is_some() {
        return Err(SurveyError::malformed(path, Place::Whole, "its CRS has a constant geoid height")
            .hint("export with a vertical CRS, or in ellipsoidal heights"));
    }
    let local = ["ENGINEERINGCRS", "ENGCRS", "LOCAL_CS"];
    if local.iter().any(|word| frame.crs.definition.trim_start().starts_with(word)) {
        return Ok(World::Unsaid);
    }
    Ok(World::Crs(Crs::parse(&frame.crs.definition)?))
}

fn camera(internals: &Internals, size_px: Option<[f64; 2]>) -> Result<Camera, String> {
    let [width, height] = size_px.ok_or("its sensor has no image size")?;
    let is_pixels = |n: f64| n.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&n);
    if !(is_pixels(width) && is_pixels(height)) {
        return Err(format!("image size {width} × {height}: expected pixels"));
    }
    let (centre_px, focal_px, distortion) = match internals {
        Internals::Perspective { principal_point_px, focal_length_px, radial_distortion, tangential_distortion } => {
            let ([k1, k2, k3], [p1, p2]) = (*radial_distortion, *tangential_distortion);
            (principal_point_px, [*focal_length_px; 2], Distortion::brown([k1, k2, k3], [p1, p2]))
        }
        Internals::Fisheye { principal_point_px, affine, polynomial } => {
            let (focal_px, lens) = fisheye(*affine, polynomial)?;
            (principal_point_px, focal_px, lens)
        }
        Internals::Other => return Err("spherical sensors of OPF are not read".to_owned()),
    };
    let camera = Camera {
        width_px: width as u32,
        height_px: height as u32,
        fx_px: focal_px[0],
        fy_px: focal_px[1],
        cx_px: centre_px[0],
        cy_px: centre_px[1],
        distortion,
    };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(camera)
}

/// Focal lengths and lens of a fisheye: with `q = 2/π`, `fx = c q p1` and `θ_d = θ (1 + q p2/p1 θ + q² p3/p1 θ² + …)`.
fn fisheye([c, d, e, f]: [f64; 4], polynomial: &[f64]) -> Result<([f64; 2], Distortion), String> {
    let term = |i: usize| polynomial.get(i).copied().unwrap_or(0.0);
    if d != 0.0 || e != 0.0 {
        return Err(format!("a fisheye with the shear {d}, {e} is not read: expected 0, 0"));
    }
    if term(0) != 0.0 || polynomial.len() > MAX_FISHEYE_TERMS {
        return Err(format!("the fisheye's polynomial {polynomial:?}: expected 0, p1, p2, p3, p4"));
    }
    let per_radian = std::f64::consts::FRAC_2_PI;
    let focal_px = [c, f].map(|side| side * per_radian * term(1));
    if !focal_px.iter().all(|focal| *focal > 0.0) {
        return Err(format!("the fisheye's focal lengths come to {focal_px:?}: expected positive numbers"));
    }
    let k = |power: i32| per_radian.powi(power) * term(1 + power as usize) / term(1);
    Ok((focal_px, Distortion::FisheyeSeries { k1: k(1), k2: k(2), k3: k(3) }))
}

fn pose(name: &str, camera: Arc<Camera>, from: &CalibratedCamera, frame: &Canonical) -> Result<Pose, String> {
    let scale = DVec3::from(frame.scale);
    if (scale.x - scale.y).abs() > f64::EPSILON || scale.min_element() <= 0.0 {
        return Err(format!("its frame is scaled by {scale}: expected alike in easting and northing"));
    }
    let swapped = |v: DVec3| if frame.swap_xy { DVec3::new(v.y, v.x, v.z) } else { v };
    // The rotation counts from the canonical axes: east and north, also where the base CRS lists northing first.
    let camera_from_world: DMat3 = AngleConvention::default().camera_from_world(&from.orientation_deg)?;
    let canonical = DVec3::from(from.position) - DVec3::from(frame.shift);
    // Our positions are easting first whatever the CRS lists first.
    let centre = swapped(swapped(canonical) / scale);
    Ok(Pose { name: name.to_owned(), camera, camera_from_world, centre })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::names;

    fn calibrated(position: [f64; 3]) -> CalibratedCamera {
        CalibratedCamera { id: 1, sensor_id: 1, position, orientation_deg: [0.0, 0.0, -90.0] }
    }

    #[test]
    fn the_shift_is_taken_off_and_kappa_turns_clockwise_from_north() {
        // The shift of the specification's own example.
        let frame = Canonical { shift: [-746_308.0, -3_714_810.0, -268.0], scale: [1.0; 3], swap_xy: false };
        let camera = Arc::new(Camera::pinhole(400, 300, 500.0));
        let pose = pose("a", camera, &calibrated([10.0, 20.0, 30.0]), &frame).unwrap();
        assert_eq!(pose.centre, DVec3::new(746_318.0, 3_714_830.0, 298.0));
        // Golden vector of a heading of 90°: image x points south, y west.
        let expected = DMat3::from_cols_array(&[0.0, -1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0]).transpose();
        assert!(pose.camera_from_world.abs_diff_eq(expected, 1e-12), "{}", pose.camera_from_world);
    }

    #[test]
    fn a_fisheye_lands_where_pix4ds_formula_says() {
        // The sensor of the specification's own example.
        let internals = Internals::Fisheye {
            principal_point_px: [634.45, 481.23],
            affine: [1_676.296_432, 0.0, 0.0, 1_676.296_432],
            polynomial: vec![0.0, 1.0, 0.015_264_6, -0.161_096],
        };
        let camera = camera(&internals, Some([1280.0, 960.0])).unwrap();
        let point = DVec3::new(0.6, -0.3, 1.0);
        let (r, t) = (point.x.hypot(point.y), 2.0 * point.x.hypot(point.y).atan() / std::f64::consts::PI);
        let rho = t + 0.015_264_6 * t * t - 0.161_096 * t * t * t;
        let (u, v) = (1_676.296_432 * rho * 0.6 / r + 634.45, 1_676.296_432 * rho * -0.3 / r + 481.23);
        let pixel = camera.project(point).unwrap();
        assert!((pixel.x - u).abs() < 1e-9 && (pixel.y - v).abs() < 1e-9, "{pixel} against {u}, {v}");
        let back = camera.unproject(pixel).unwrap();
        assert!((back - point).length() < 1e-10, "{back}");
        assert!(fisheye([1.0, 0.1, 0.0, 1.0], &[0.0, 1.0]).is_err(), "shear is refused");
        assert!(fisheye([1.0, 0.0, 0.0, 1.0], &[0.5, 1.0]).is_err(), "p0 is refused");
    }

    #[test]
    fn names_come_from_uris() {
        let name = |uri: &str| names::parts(without_page(uri)).pop().map(str::to_owned);
        assert_eq!(name("file:///c:/data/images/DJI_09572.jpg").as_deref(), Some("DJI_09572.jpg"));
        assert_eq!(name("IMG_03849021.tiff#page=0").as_deref(), Some("IMG_03849021.tiff"));
    }
}
