//! STAC items of the perspective imagery extension (`pers:`), as mapping agencies and cities serve oblique archives.
//!
//! A file is an item (`Feature`) or the answer of an items or search request (`FeatureCollection`); a folder holds items.
//! Positions are in `pers:crs` with heights in `pers:vertical_crs`; lengths of the camera in millimetres.
//!
//! ```text
//! x_c = M (X − C),   M = pers:rotation_matrix, row-major, world to camera = (Rx(ω) Ry(φ) Rz(κ))ᵀ
//! camera x right, y up, z backward;   principal point: w/2 + offset_x/pixel from the left, h/2 − offset_y/pixel from the top
//! ```
//!
//! ω, φ, κ are no part of the extension, but the Danish archive writes them beside the matrix; where both stand, they have
//! to agree.
//!
//! Sources, which agree: the extension's specification 1.0 (world to camera, row-major, offsets from the sensor's middle);
//! the viewer of the Danish agency that owns it (ω, φ, κ in degrees, rows from the bottom, sign of the offsets); published
//! items, whose matrix equals the transposed product of their angles to 1e-7 and whose ground polygon is where the
//! image's corners fall. Coefficients of distortion are refused: no published item has any.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use serde::Deserialize;
use serde_json::Value;

use super::angles::{AngleConvention, CameraAxes, nearest_rotation, rows};
use super::csv::declared_camera;
use super::error::Place;
use super::formats::FileMarks;
use super::opensfm::json;
use super::poses::{Pose, Poses, World};
use super::{PixelOrigin, SurveyConfig, SurveyError};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::FileError;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::camera::{Camera, Distortion};

/// Greatest difference between an element of the matrix and the same of the angles, which have five digits.
const MAX_DISAGREEMENT: f64 = 1e-4;

/// An item, or a page of them.
#[derive(Deserialize)]
struct StacDocument {
    #[serde(rename = "type")]
    kind: String,
    id: Option<String>,
    properties: Option<Value>,
    #[serde(default)]
    features: Vec<Value>,
    #[serde(default)]
    links: Vec<Link>,
}

#[derive(Deserialize)]
struct Link {
    rel: String,
}

#[derive(Deserialize)]
struct StacProperties {
    #[serde(rename = "pers:interior_orientation")]
    interior: Option<Interior>,
    #[serde(rename = "pers:perspective_center")]
    centre: Option<Vec<f64>>,
    #[serde(rename = "pers:crs")]
    crs: Option<Value>,
    #[serde(rename = "pers:vertical_crs")]
    vertical_crs: Option<Value>,
    #[serde(rename = "pers:rotation_matrix")]
    matrix: Option<Vec<f64>>,
    #[serde(rename = "pers:omega")]
    omega_deg: Option<f64>,
    #[serde(rename = "pers:phi")]
    phi_deg: Option<f64>,
    #[serde(rename = "pers:kappa")]
    kappa_deg: Option<f64>,
    /// Rows and columns of the image.
    #[serde(rename = "proj:shape")]
    shape: Option<Vec<f64>>,
}

/// Lengths in millimetres, image sizes as columns and rows.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Interior {
    sensor_array_dimensions: Option<[f64; 2]>,
    pixel_spacing: Option<[f64; 2]>,
    focal_length: Option<f64>,
    principal_point_offset: Option<[f64; 2]>,
    radial_distortion: Option<Vec<f64>>,
    affine_distortion: Option<Vec<f64>>,
}

/// A JSON file of items with perspective imagery, or a folder of them.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    if marks.is_folder {
        return items_in(&marks.path)
            .is_ok_and(|files| files.first().is_some_and(|file| FileMarks::of(file).is_ok_and(|file| is_stac(&file))));
    }
    is_stac(marks)
}

fn is_stac(file: &FileMarks) -> bool {
    (file.has_extension("json") || file.has_extension("geojson"))
        && file.head.contains("stac_version")
        && (file.head.contains("perspective-imagery") || file.head.contains("\"pers:"))
}

/// The JSON files of a folder, sorted.
fn items_in(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(FileError::on("cannot read folder", folder))? {
        let path = entry.map_err(FileError::on("cannot read folder", folder))?.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if path.is_file() && (extension == "json" || extension == "geojson") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Reads an item, a page of items, or all items of a folder.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let files = if path.is_dir() { items_in(path)? } else { vec![path.to_owned()] };
    let declared = config.camera.as_ref().map(|camera| declared_camera(camera, PixelOrigin::default()));
    let declared = declared.transpose().map_err(|e| SurveyError::config(e, ""))?.map(Arc::new);
    let mut survey = StacReading { declared, crs_is_declared: config.crs.is_some(), ..StacReading::default() };
    for file in &files {
        survey.add(file, json(file)?)?;
    }
    let mut poses = survey.poses;
    if let Some(world) = survey.world {
        poses.world = World::Crs(Crs::parse(&world)?);
    }
    Ok(poses)
}

/// State of the reading.
struct StacReading {
    poses: Poses,
    cameras: Vec<(Interior, Result<Arc<Camera>, String>)>,
    /// Definition of the first item's CRS: all have to share it.
    world: Option<String>,
    crs_is_declared: bool,
    declared: Option<Arc<Camera>>,
}

impl Default for StacReading {
    fn default() -> Self {
        Self { poses: Poses::new(), cameras: Vec::new(), world: None, crs_is_declared: false, declared: None }
    }
}

impl StacReading {
    fn add(&mut self, path: &Path, document: StacDocument) -> Result<(), SurveyError> {
        let StacDocument { kind, id, properties, features, links } = document;
        let items = match (kind.as_str(), id, properties) {
            ("FeatureCollection", ..) => features.into_iter().map(id_and_properties).collect(),
            ("Feature", Some(id), Some(properties)) => vec![(id, properties)],
            _ => {
                let message = format!("type {kind:?}: expected a STAC item (Feature) or a FeatureCollection of items");
                return Err(SurveyError::malformed(path, Place::Whole, message)
                    .hint("`path` is an item, the answer of an items or search request, or a folder of items"));
            }
        };
        if kind == "FeatureCollection" && links.iter().any(|link| link.rel == "next") {
            let subject = Subject::Input(path.display().to_string());
            let message = format!("{} items, and the answer has a next page that is not in the file", items.len());
            let issue = Issue::new(Severity::Warning, "more_pages", subject, message);
            self.poses.issues.push(issue.hint("ask with a higher `limit`, or put all pages into one folder"));
        }
        for (id, properties) in items {
            let properties = serde_json::from_value::<StacProperties>(properties).map_err(|e| e.to_string());
            match properties.and_then(|properties| self.pose(&id, &properties)) {
                Ok(pose) => self.poses.poses.push(pose),
                Err(reason) => self.poses.refuse("pose_unusable", &id, reason),
            }
        }
        Ok(())
    }

    fn pose(&mut self, id: &str, properties: &StacProperties) -> Result<Pose, String> {
        let centre = properties.centre.as_deref().ok_or("it has no pers:perspective_center")?;
        let &[x, y, z] = centre else {
            return Err(format!("its pers:perspective_center has {} numbers: expected X, Y, Z", centre.len()));
        };
        let camera_from_world = rotation(properties)?;
        if !self.crs_is_declared {
            self.share_world(world(properties)?)?;
        }
        let camera = self.camera(properties)?;
        Ok(Pose { name: id.to_owned(), camera, camera_from_world, centre: DVec3::new(x, y, z) })
    }

    /// Takes the CRS of the first item for all, and refuses another.
    fn share_world(&mut self, definition: String) -> Result<(), String> {
        match &self.world {
            Some(first) if *first == definition => Ok(()),
            Some(first) => {
                Err(format!("its CRS is {definition}, that of the first item {first}: expected one for all"))
            }
            None => {
                let crs = Crs::parse(&definition).map_err(|e| format!("its CRS: {e}"))?;
                if crs.is_geographic() {
                    return Err(format!("its pers:crs {crs} is in degrees: a rotation needs metres; declare `crs`"));
                }
                self.world = Some(definition);
                Ok(())
            }
        }
    }

    fn camera(&mut self, properties: &StacProperties) -> Result<Arc<Camera>, String> {
        let Some(interior) = &properties.interior else {
            return self.declared.clone().ok_or_else(|| {
                "it has no pers:interior_orientation of its own: declare the camera under [survey.camera]".to_owned()
            });
        };
        let known = self.cameras.iter().find(|(known, _)| known == interior).map(|(_, made)| made.clone());
        let camera = known.unwrap_or_else(|| {
            let made = interior.camera().map(Arc::new);
            self.cameras.push((interior.clone(), made.clone()));
            made
        })?;
        let sensor = [f64::from(camera.height_px), f64::from(camera.width_px)];
        match properties.shape.as_deref() {
            Some(shape) if *shape != sensor => Err(format!(
                "its image has {shape:?} rows and columns (proj:shape), its sensor {sensor:?}: expected the same"
            )),
            _ => Ok(camera),
        }
    }
}

/// An item's id and properties; what it lacks is found missing later.
fn id_and_properties(mut item: Value) -> (String, Value) {
    let id = item["id"].as_str().unwrap_or("item without id").to_owned();
    (id, item["properties"].take())
}

/// The definition of an item's CRS with its heights.
fn world(properties: &StacProperties) -> Result<String, String> {
    let code = |value: &Value| match value {
        Value::Number(code) => Some(code.to_string()),
        Value::String(text) => text.trim().strip_prefix("EPSG:").map(str::to_owned),
        _ => None,
    };
    let plane = properties.crs.as_ref().filter(|crs| !crs.is_null());
    let plane = plane.ok_or("it has no pers:crs, which then is degrees: a rotation needs metres; declare `crs`")?;
    let vertical = properties.vertical_crs.as_ref().filter(|crs| !crs.is_null());
    match (code(plane), vertical.map(code), plane) {
        (Some(plane), None, _) => Ok(format!("EPSG:{plane}")),
        (Some(plane), Some(Some(vertical)), _) => Ok(format!("EPSG:{plane}+{vertical}")),
        (None, None, Value::String(wkt)) => Ok(wkt.clone()),
        (None, None, json) => Ok(json.to_string()),
        _ => Err("its pers:crs and pers:vertical_crs are not both EPSG codes: declare `crs`".to_owned()),
    }
}

fn rotation(properties: &StacProperties) -> Result<DMat3, String> {
    let of_matrix = properties.matrix.as_deref().map(of_matrix).transpose()?;
    let angles = [properties.omega_deg, properties.phi_deg, properties.kappa_deg];
    let of_angles = match angles {
        [Some(omega), Some(phi), Some(kappa)] => {
            Some(AngleConvention::default().camera_from_world(&[omega, phi, kappa])?)
        }
        _ => None,
    };
    if let (Some(matrix), Some(angles)) = (of_matrix, of_angles) {
        let off = (matrix - angles).to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
        if off > MAX_DISAGREEMENT {
            return Err(format!(
                "its pers:rotation_matrix and its omega, phi, kappa differ by {off:.1e}: expected the same rotation"
            ));
        }
    }
    let missing = "it has neither pers:rotation_matrix nor pers:omega, phi, kappa: the direction of view is unknown";
    of_matrix.or(of_angles).ok_or_else(|| missing.to_owned())
}

fn of_matrix(m: &[f64]) -> Result<DMat3, String> {
    let m: [f64; 9] =
        m.try_into().map_err(|_| format!("its pers:rotation_matrix has {} numbers: expected 9", m.len()))?;
    let axes_from_world = nearest_rotation(rows([m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]))?;
    Ok(CameraAxes::XRightYUp.camera_from_axes() * axes_from_world)
}

impl Interior {
    fn camera(&self) -> Result<Camera, String> {
        let missing = |name: &str| format!("its pers:interior_orientation has no {name}");
        let [columns, rows] = self.sensor_array_dimensions.ok_or_else(|| missing("sensor_array_dimensions"))?;
        let [pixel_x_mm, pixel_y_mm] = self.pixel_spacing.ok_or_else(|| missing("pixel_spacing"))?;
        let focal_mm = self.focal_length.ok_or_else(|| missing("focal_length"))?;
        let is_pixels = |n: f64| n.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&n);
        if !(is_pixels(columns) && is_pixels(rows)) {
            return Err(format!("sensor_array_dimensions {columns} × {rows}: expected pixels"));
        }
        if !(pixel_x_mm > 0.0 && pixel_y_mm > 0.0) {
            return Err(format!("pixel_spacing {pixel_x_mm}, {pixel_y_mm} mm: expected positive numbers"));
        }
        for (name, found) in
            [("radial_distortion", &self.radial_distortion), ("affine_distortion", &self.affine_distortion)]
        {
            if let Some(found) = found.as_ref().filter(|found| found.iter().any(|&c| c != 0.0)) {
                return Err(format!("its {name} is {found:?}: expected none or zeros; undistort the photos first"));
            }
        }
        let [offset_x_mm, offset_y_mm] = self.principal_point_offset.unwrap_or_default();
        let camera = Camera {
            width_px: columns as u32,
            height_px: rows as u32,
            fx_px: focal_mm / pixel_x_mm,
            fy_px: focal_mm / pixel_y_mm,
            cx_px: columns / 2.0 + offset_x_mm / pixel_x_mm,
            cy_px: rows / 2.0 - offset_y_mm / pixel_y_mm,
            distortion: Distortion::None,
        };
        camera.validate().map_err(|e| e.to_string())?;
        Ok(camera)
    }
}
