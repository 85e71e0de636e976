//! Bentley iTwin Capture / `ContextCapture` `BlocksExchange`: `.xml`, or `.xmlz` (the same, zipped).
//!
//! `Pose/Rotation` is world to camera; with `CameraOrientation` `XRightYDown` (the default) its axes are ours, other
//! orientations are turned. Focal lengths are in pixels, or in millimetres on a sensor whose larger side is
//! `SensorSize`, or whose pixels are `PixelSize` wide. The principal point counts pixels from the *centre* of the first
//! pixel, or millimetres (`xmm`, `ymm`, in the axes of `CameraOrientation`) from the middle of the image: the specification's
//! sample has 4683.755692, 7223.0141002 px and -0.1853590176, 0.06130152144 mm on 9420 x 14430 px of 7.2 um, which agree only so.
//! `Metadata` holds initial values and is never used. Not read, as no text gives their formulas: fisheyes, and the deprecated
//! `Heading`, `Pitch`, `Roll`.
//! Source: Bentley, `BlocksExchange` XML format 3.2.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::angles::{AngleConvention, AngleKind, AngleUnit, CameraAxes, rows};
use super::config::TangentialOrder;
use super::error::Place;
use super::formats::FileMarks;
use super::names::NameStyle;
use super::poses::{Pose, Poses, World};
use super::xml::{Element, Xml, XmlStep};
use super::{SurveyConfig, SurveyError};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::FileError;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::camera::{Camera, Distortion};

/// An unzipped `.xmlz` larger than this is refused; 100,000 photos take 0.2 GB.
const MAX_UNZIPPED_BYTES: u64 = 8 << 30;

/// A file with the element in its first bytes, or an `.xmlz`.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    marks.head.contains("<BlocksExchange") || marks.has_extension("xmlz")
}

/// Reads the poses of all blocks in the file.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let (path, tangential) = (config.path.as_path(), config.tangential);
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("xmlz")) {
        return read_xml(file, path, tangential);
    }
    let broken = |e: zip::result::ZipError| SurveyError::malformed(path, Place::Whole, format!("not a zip file: {e}"));
    let mut archive = zip::ZipArchive::new(BufReader::new(file)).map_err(broken)?;
    let mut found = None;
    for i in 0..archive.len() {
        let entry = archive.by_index(i).map_err(broken)?;
        let is_xml = entry.name().map_err(broken)?.to_ascii_lowercase().ends_with(".xml");
        found = found.or(is_xml.then_some(i));
    }
    let Some(found) = found else {
        return Err(SurveyError::malformed(path, Place::Whole, "the archive holds no .xml file"));
    };
    let entry = archive.by_index(found).map_err(broken)?;
    read_xml(entry.take(MAX_UNZIPPED_BYTES), path, tangential)
}

/// Camera and axes that the photos of a group share.
struct PhotoGroup {
    camera: Result<Arc<Camera>, String>,
    camera_from_axes: DMat3,
}

fn read_xml(reader: impl Read, path: &Path, tangential: Option<TangentialOrder>) -> Result<Poses, SurveyError> {
    let mut xml = Xml::new(reader, path);
    let mut poses = Poses { names: NameStyle::Path, ..Poses::new() };
    let mut systems: BTreeMap<String, String> = BTreeMap::new();
    let mut block_systems = BTreeSet::new();
    let mut group = Element::default();
    let mut shared: Option<PhotoGroup> = None;
    loop {
        match xml.step()? {
            XmlStep::Start(start) => match start.name.as_str() {
                "BlocksExchange" | "SpatialReferenceSystems" | "Block" | "Photogroups" => {}
                "Photogroup" => (group, shared) = (start, None),
                "SRS" => {
                    let system = xml.element(start)?;
                    let text = |name| system.text_of(name).unwrap_or_default().to_owned();
                    systems.insert(text("Id"), text("Definition"));
                }
                "SRSId" => {
                    block_systems.insert(xml.element(start)?.text.trim().to_owned());
                }
                "Photo" => {
                    let photo = xml.element(start)?;
                    take_photo(
                        &photo,
                        shared.get_or_insert_with(|| group_of(&group, tangential.unwrap_or_default())),
                        &mut poses,
                    );
                }
                _ => {
                    let element = xml.element(start)?;
                    // What photos share is kept; tie points and control points are passed over.
                    if element.children.len() < 64 {
                        group.children.push(element);
                    }
                }
            },
            XmlStep::End(_) => {}
            XmlStep::Done => break,
        }
    }
    if tangential.is_none() && poses.poses.iter().any(|pose| is_tangential(&pose.camera)) {
        poses.issues.push(tangential_order_assumed(path));
    }
    poses.world = block_world(&block_systems, &systems).map_err(|e| SurveyError::malformed(path, Place::Whole, e))?;
    Ok(poses)
}

/// The frame of the blocks by the systems that they name, and by what the file defines: identifier and definition.
fn block_world(named: &BTreeSet<String>, defined: &BTreeMap<String, String>) -> Result<World, String> {
    if let Some(id) = named.iter().find(|id| !defined.contains_key(*id)) {
        return Ok(World::Unclear(format!("the file's block is in system {id:?}, which the file does not define")));
    }
    let definitions: BTreeSet<&String> = named.iter().map(|id| &defined[id]).collect();
    let mut all = definitions.iter();
    match (all.next(), all.next()) {
        (None, _) => Ok(World::Unsaid),
        (Some(definition), None) => world(definition),
        (Some(one), Some(other)) => Err(format!(
            "its blocks are in different systems ({one}, {other}): expected one\nhint: export each block on its own, or all in one system"
        )),
    }
}

/// The issue of a file whose tangential coefficients are in an order that nothing states.
pub(super) fn tangential_order_assumed(path: &Path) -> Issue {
    let subject = Subject::Input(path.display().to_string());
    let message = "the order of P1 and P2 is not said by this format; taken as OpenCV's";
    Issue::new(Severity::Warning, "tangential_order_assumed", subject, message)
        .hint("set `tangential` to opencv or metashape; the difference is a pixel or so in the corners")
}

pub(super) fn is_tangential(camera: &Camera) -> bool {
    camera.distortion.coefficients().any(|(name, value)| name.starts_with('p') && value != 0.0)
}

/// `EPSG:n`, `EPSG:h+v`, WKT, a PROJ string, or `ENU:lat,lon`.
fn world(definition: &str) -> Result<World, String> {
    let Some(origin) = definition.strip_prefix("ENU:") else {
        return Crs::parse(definition).map(World::Crs).map_err(|e| e.to_string());
    };
    let numbers: Vec<f64> = origin.split(',').filter_map(|number| number.trim().parse().ok()).collect();
    match numbers[..] {
        [lat_deg, lon_deg] => Ok(World::Enu(DVec3::new(lon_deg, lat_deg, 0.0))),
        [lat_deg, lon_deg, height_m] => Ok(World::Enu(DVec3::new(lon_deg, lat_deg, height_m))),
        _ => Err(format!("SRS {definition:?}: expected ENU:latitude,longitude")),
    }
}

fn take_photo(photo: &Element, group: &PhotoGroup, poses: &mut Poses) {
    let name = photo
        .text_of("ImagePath")
        .map_or_else(|| format!("photo {}", photo.text_of("Id").unwrap_or("without id")), str::to_owned);
    let Some(pose) = photo.child("Pose").filter(|pose| pose.child("Center").is_some()) else {
        return poses.refuse("photo_without_pose", &name, "the photo has no pose (it was not aligned)");
    };
    let camera = match &group.camera {
        Ok(camera) => camera,
        Err(reason) => return poses.refuse("camera_unusable", &name, reason.clone()),
    };
    match pose_of(pose, group.camera_from_axes) {
        Ok((camera_from_world, centre)) => {
            poses.poses.push(Pose { name, camera: Arc::clone(camera), camera_from_world, centre });
        }
        Err(reason) => poses.refuse("pose_unusable", &name, reason),
    }
}

fn pose_of(pose: &Element, camera_from_axes: DMat3) -> Result<(DMat3, DVec3), String> {
    let centre = pose.child("Center").ok_or("<Pose> has no <Center>")?;
    let centre = DVec3::new(centre.need_number("x")?, centre.need_number("y")?, centre.need_number("z")?);
    let rotation = pose.child("Rotation").ok_or("<Pose> has no <Rotation>")?;
    let axes_from_world = if rotation.child("M_00").is_some() {
        let row = |i: usize| -> Result<[f64; 3], String> {
            let at = |j: usize| rotation.need_number(&format!("M_{i}{j}"));
            Ok([at(0)?, at(1)?, at(2)?])
        };
        rows(row(0)?, row(1)?, row(2)?)
    } else {
        angles(rotation)?
    };
    Ok((camera_from_axes * axes_from_world, centre))
}

/// Omega, phi, kappa of the matrix itself (so that `XRightYDown` gives ω near 180° at nadir), or yaw, pitch, roll.
fn angles(rotation: &Element) -> Result<DMat3, String> {
    let convention =
        |angles, camera_axes| AngleConvention { angles, unit: AngleUnit::Deg, camera_axes, ..Default::default() };
    if rotation.child("Omega").is_some() {
        let values = [rotation.need_number("Omega")?, rotation.need_number("Phi")?, rotation.need_number("Kappa")?];
        return convention(AngleKind::Opk, Some(CameraAxes::XRightYDown)).camera_from_world(&values);
    }
    if rotation.child("Yaw").is_some() {
        let values = [rotation.need_number("Yaw")?, rotation.need_number("Pitch")?, rotation.need_number("Roll")?];
        return convention(AngleKind::Ypr, None).camera_from_world(&values);
    }
    if rotation.child("Heading").is_some() {
        return Err("<Heading>, <Pitch>, <Roll> (deprecated) are not read: export the rotation as a matrix".to_owned());
    }
    Err("<Rotation> holds neither M_00…M_22, nor Omega, Phi, Kappa, nor Yaw, Pitch, Roll".to_owned())
}

fn group_of(group: &Element, tangential: TangentialOrder) -> PhotoGroup {
    let axes = match group.text_of("CameraOrientation").unwrap_or("XRightYDown") {
        "XRightYDown" => Ok(CameraAxes::XRightYDown),
        "XRightYUp" => Ok(CameraAxes::XRightYUp),
        "XLeftYDown" => Ok(CameraAxes::XLeftYDown),
        "XLeftYUp" => Ok(CameraAxes::XLeftYUp),
        "XDownYRight" => Ok(CameraAxes::XDownYRight),
        "XDownYLeft" => Ok(CameraAxes::XDownYLeft),
        "XUpYLeft" => Ok(CameraAxes::XUpYLeft),
        "XUpYRight" => Ok(CameraAxes::XUpYRight),
        other => Err(format!("CameraOrientation {other:?}: expected XRightYDown or one of its seven turns")),
    };
    match axes {
        Ok(axes) => {
            let camera_from_axes = axes.camera_from_axes();
            PhotoGroup { camera: camera(group, camera_from_axes, tangential).map(Arc::new), camera_from_axes }
        }
        Err(reason) => PhotoGroup { camera: Err(reason), camera_from_axes: DMat3::IDENTITY },
    }
}

/// From the top-left corner, pixels.
fn principal_point(
    point: &Element,
    pixel_mm: Option<f64>,
    (width, height): (f64, f64),
    camera_from_axes: DMat3,
) -> Result<(f64, f64), String> {
    const CENTRE_OF_FIRST_PIXEL: f64 = 0.5;
    if point.child("x").is_some() {
        return Ok((point.need_number("x")? + CENTRE_OF_FIRST_PIXEL, point.need_number("y")? + CENTRE_OF_FIRST_PIXEL));
    }
    let pixel_mm = pixel_mm.ok_or("<xmm> without <SensorSize> or <PixelSize>")?;
    let from_middle =
        camera_from_axes * DVec3::new(point.need_number("xmm")?, point.need_number("ymm")?, 0.0) / pixel_mm;
    Ok((width / 2.0 + from_middle.x, height / 2.0 + from_middle.y))
}

fn camera(group: &Element, camera_from_axes: DMat3, tangential: TangentialOrder) -> Result<Camera, String> {
    let size = group.child("ImageDimensions").ok_or("the photo group has no <ImageDimensions>")?;
    let (width, height) = (size.need_number("Width")?, size.need_number("Height")?);
    let is_pixels = |n: f64| (1.0..=f64::from(u32::MAX)).contains(&n);
    if !(is_pixels(width) && is_pixels(height)) {
        return Err(format!("image size {width} × {height}: expected pixels"));
    }
    let pixel_mm = match (group.number("SensorSize")?, group.number("PixelSize")?) {
        (Some(sensor_mm), _) => Some(sensor_mm / width.max(height)),
        (None, pixel_mm) => pixel_mm,
    };
    let focal_px = match (group.number("FocalLengthPixels")?, group.number("FocalLength")?, pixel_mm) {
        (Some(focal_px), _, _) => focal_px,
        (None, Some(focal_mm), Some(pixel_mm)) => focal_mm / pixel_mm,
        _ => {
            return Err("neither <FocalLengthPixels> nor <FocalLength> with <SensorSize> or <PixelSize>".to_owned());
        }
    };
    let fy_px = focal_px * group.number("AspectRatio")?.unwrap_or(1.0);
    let skew = group.number("Skew")?.unwrap_or(0.0) / focal_px;
    let (cx_px, cy_px) = match group.child("PrincipalPoint") {
        Some(point) => principal_point(point, pixel_mm, (width, height), camera_from_axes)?,
        None => (width / 2.0, height / 2.0),
    };
    let coefficient = |name: &str| match group.child("Distortion") {
        Some(distortion) => Ok(distortion.number(name)?.unwrap_or(0.0)),
        None => Ok::<f64, String>(0.0),
    };
    let distortion = match group.text_of("CameraModelType").unwrap_or("Perspective") {
        "Perspective" => {
            let [k1, k2, k3] = [coefficient("K1")?, coefficient("K2")?, coefficient("K3")?];
            let [p1, p2] = tangential.opencv([coefficient("P1")?, coefficient("P2")?]);
            if skew == 0.0 {
                Distortion::brown([k1, k2, k3], [p1, p2])
            } else {
                Distortion::BrownAffine { k1, k2, k3, k4: 0.0, p1, p2, skew }
            }
        }
        other => return Err(format!("camera model {other}: undistort the photos, only Perspective is read")),
    };
    let camera =
        Camera { width_px: width as u32, height_px: height as u32, fx_px: focal_px, fy_px, cx_px, cy_px, distortion };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(camera)
}
