//! Trimble INPHO project files, `.prj`, as MATCH-AT, `ApplicationsMaster` and national mapping agencies hand them out.
//!
//! A `$PHOTO` has `$EXT_ORI`: a time stamp, then focal length (mm) and projection centre (m), then a rotation matrix by
//! rows. Its `$CAMERA_ID` names a `$CAMERA_DEFINITION` (`$ID`) or, in older files, a `$CAMERA` (`$TYPE`).
//!
//! ```text
//! (X, Y, Z) = M (P − C),   M world to camera: x right, y up, z backward      x = f X/(−Z),  y = f Y/(−Z)  mm
//! column = a x + b y + c,  row = d x + e y + g        a … g = $CCD_INTERIOR_ORIENTATION, pixels per mm and pixels
//! ```
//!
//! `$PIXEL_REFERENCE : CenterTopLeft` counts from the first pixel's centre. An affine map whose axes are exchanged (a camera
//! that is mounted turned) turns the camera by the same quarter.
//!
//! Sources that agree on the matrix: `MicMac`'s convention `eConvMatrixInpho` (not camera to world, columns 1, −1, −1); a
//! space agency's program that writes such projects for `OrthoMaster` (transposed product of its ω, φ, κ); a German city's
//! reader of its oblique project (world to camera, axis −z). One hobby program reads it the other way round, without a
//! check. On the affine map: the last, and the pixel pitch of published cameras (217.39 per mm at 4.6 µm).
//!
//! Refused, as their signs have no certain source: coefficients of distortion and `$PRINCIPAL_POINT_PPA` other than 0.

mod blocks;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use self::blocks::{InphoBlock, blocks, numbers};
use super::angles::{nearest_rotation, rows};
use super::error::Place;
use super::formats::FileMarks;
use super::names::NameStyle;
use super::poses::{Pose, Poses, World};
use super::{SurveyConfig, SurveyError, text};
use sizeup_geo::crs::Crs;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::camera::{Camera, Distortion};

/// An entry of the affine map below this part of the greatest counts as 0: a hundredth of a pixel across 10,000 pixels.
const SKEW_TOLERANCE: f64 = 1e-6;
/// Difference between a photo's focal length and its camera's that is still rounding.
const FOCAL_TOLERANCE_MM: f64 = 1e-3;

/// A camera with the axes that its rotations refer to.
#[derive(Debug, Clone)]
struct Calibrated {
    camera: Arc<Camera>,
    /// From the axes of the rotation matrix (x right, y up, z backward, before the raster's quarter turn) to ours.
    camera_from_axes: DMat3,
    focal_mm: f64,
}

/// A `.prj` that begins with a block, which no CRS does.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    let begins = |name: &str| marks.head.lines().any(|line| line.starts_with(name));
    marks.has_extension("prj") && (begins("$PROJECT") || begins("$PHOTO") || begins("$CAMERA"))
}

/// Reads the photos of a project.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let text = text::read(path)?;
    let blocks = blocks(&text);
    if let Some(open) = blocks.last().filter(|block| !block.is_closed) {
        let message = format!("the file ends inside ${}", open.name);
        return Err(SurveyError::malformed(path, Place::Line(open.line), message).hint("it is truncated"));
    }
    if !blocks.iter().any(|block| block.name == "PHOTO") {
        return Err(SurveyError::malformed(
            path,
            Place::Whole,
            "no $PHOTO: expected an INPHO project with oriented photos",
        )
        .hint("a .prj that holds a CRS only is no project"));
    }
    in_metres(path, &blocks)?;
    let mut poses = Poses { names: NameStyle::Path, ..Poses::new() };
    if config.crs.is_none() {
        poses.world = world(path, &blocks)?;
    }
    let cameras = cameras(&blocks);
    for block in blocks.iter().filter(|block| block.name == "PHOTO") {
        let name = photo_name(block);
        match pose(&name, block, &cameras) {
            Ok(pose) => poses.poses.push(pose),
            Err((code, reason)) => poses.refuse(code, &name, format!("line {}: {reason}", block.line)),
        }
    }
    poses.issues.extend(remarks(path, &blocks));
    Ok(poses)
}

/// Refuses positions that are not in metres.
fn in_metres(path: &Path, blocks: &[InphoBlock<'_>]) -> Result<(), SurveyError> {
    for block in blocks {
        let unit = block.text("LINEAR_UNITS_OF_OBJECT").unwrap_or("m");
        if !["m", "meter", "metre", "meters", "metres"].iter().any(|known| unit.eq_ignore_ascii_case(known)) {
            let message = format!("$LINEAR_UNITS_OF_OBJECT is {unit:?}: expected m");
            return Err(SurveyError::malformed(path, Place::Line(block.line), message)
                .hint("set the project's object unit to metres and save it again"));
        }
    }
    Ok(())
}

/// The project's CRS, where it names one that PROJ can read.
fn world(path: &Path, blocks: &[InphoBlock<'_>]) -> Result<World, SurveyError> {
    let mut found: Vec<(u64, String)> = Vec::new();
    for block in blocks {
        for wkt in block.all("COORDINATE_SYSTEM") {
            let wkt: String = wkt.lines().map(str::trim).collect();
            if !wkt.is_empty() && !found.iter().any(|(_, known)| *known == wkt) {
                found.push((block.line, wkt));
            }
        }
    }
    let [(line, wkt)] = found.as_slice() else { return Ok(World::Unsaid) };
    match Crs::parse(wkt) {
        Ok(crs) if crs.is_projected() => Ok(World::Crs(crs)),
        Ok(crs) => {
            let message = format!("its $COORDINATE_SYSTEM {crs} is no grid: expected a projected CRS");
            Err(SurveyError::malformed(path, Place::Line(*line), message)
                .hint("say what the positions are in: `crs` of [survey]"))
        }
        Err(_) => Ok(World::Unsaid),
    }
}

/// Remarks on what the reader leaves to the user's judgement.
fn remarks(path: &Path, blocks: &[InphoBlock<'_>]) -> Vec<Issue> {
    let mut remarks = Vec::new();
    let is_on =
        |key: &str| blocks.iter().filter_map(|block| block.text(key)).any(|value| value.eq_ignore_ascii_case("on"));
    let subject = || Subject::Input(path.display().to_string());
    if is_on("CURV_CORR_DEFAULT") || is_on("REFRACT_CORR_DEFAULT") {
        let message = "the block was adjusted with corrections for the Earth's curvature or refraction, which are not \
                       applied here: they reach 0.08 m at 1 km from the camera and 0.3 m at 2 km";
        remarks.push(Issue::new(Severity::Warning, "curvature_not_applied", subject(), message));
    }
    let is_turned = |block: &InphoBlock<'_>| {
        let turn = block.text("CAMERA_MOUNT_ROTATION").and_then(|turn| turn.parse::<f64>().ok());
        turn.is_some_and(|turn_deg| turn_deg != 0.0)
    };
    if blocks.iter().any(is_turned) {
        let message = "a $CAMERA_MOUNT_ROTATION is taken to be part of the photos' rotations already";
        let issue = Issue::new(Severity::Warning, "mount_rotation", subject(), message);
        remarks.push(issue.hint("compare the image footprints with a map: `survey convert` writes them"));
    }
    remarks
}

fn cameras<'a>(blocks: &[InphoBlock<'a>]) -> BTreeMap<&'a str, Result<Calibrated, String>> {
    let id_of = |block: &InphoBlock<'a>| match block.name {
        "CAMERA_DEFINITION" => block.text("ID"),
        "CAMERA" => block.text("TYPE").or(block.text("ID")),
        _ => None,
    };
    blocks.iter().filter_map(|block| Some((id_of(block)?, calibrated(block)))).collect()
}

fn calibrated(block: &InphoBlock<'_>) -> Result<Calibrated, String> {
    let n_calibrations = block.all("FOCAL_LENGTH").count();
    if n_calibrations > 1 {
        return Err(format!("its camera has {n_calibrations} calibrations: expected one; delete those not in use"));
    }
    if let Some(kind) = block.text("KIND").filter(|kind| !kind.eq_ignore_ascii_case("CCDFrame")) {
        return Err(format!("its camera is a {kind}: expected CCDFrame"));
    }
    if let Some(reference) = block.text("PIXEL_REFERENCE").filter(|from| *from != "CenterTopLeft") {
        return Err(format!("its camera's $PIXEL_REFERENCE is {reference}: expected CenterTopLeft"));
    }
    if block.text("PRINCIPAL_POINT_PPA").is_some() && block.numbers::<2>("PRINCIPAL_POINT_PPA")? != [0.0, 0.0] {
        return Err("its camera's $PRINCIPAL_POINT_PPA is not 0: expected a principal point within \
                    $CCD_INTERIOR_ORIENTATION; undistort the photos, or deliver in another format"
            .to_owned());
    }
    let is_lens = |key: &str| ["DISTORT", "RADIAL", "DECENTRE", "GRID"].iter().any(|part| key.contains(part));
    let is_not_zero = |value: &str| value.split_whitespace().any(|word| word.parse::<f64>().is_ok_and(|c| c != 0.0));
    if let Some((key, _)) = block.fields().find(|(key, value)| is_lens(key) && is_not_zero(value)) {
        return Err(format!("its camera's ${key} is not 0: expected photos free of distortion; undistort them first"));
    }
    let [focal_mm] = block.numbers("FOCAL_LENGTH")?;
    let ([width], [height]) = (block.numbers("CCD_COLUMNS")?, block.numbers("CCD_ROWS")?);
    let is_pixels = |n: f64| n.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&n);
    if !(is_pixels(width) && is_pixels(height)) {
        return Err(format!("its camera has {width} columns and {height} rows: expected pixels"));
    }
    let affine = block.numbers("CCD_INTERIOR_ORIENTATION")?;
    let (fx_per_mm, fy_per_mm, camera_from_axes) = raster(affine)?;
    let camera = Camera {
        width_px: width as u32,
        height_px: height as u32,
        fx_px: fx_per_mm * focal_mm,
        fy_px: fy_per_mm * focal_mm,
        cx_px: affine[2] + 0.5,
        cy_px: affine[5] + 0.5,
        distortion: Distortion::None,
    };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(Calibrated { camera: Arc::new(camera), camera_from_axes, focal_mm })
}

/// Pixels per millimetre along columns and rows, and how the raster lies in the axes x right, y up, z backward.
fn raster([col_by_x, col_by_y, _, row_by_x, row_by_y, _]: [f64; 6]) -> Result<(f64, f64, DMat3), String> {
    let entries = [col_by_x, col_by_y, row_by_x, row_by_y];
    let shown = format!("$CCD_INTERIOR_ORIENTATION {col_by_x} {col_by_y}; {row_by_x} {row_by_y}");
    let least = SKEW_TOLERANCE * entries.into_iter().map(f64::abs).fold(0.0, f64::max);
    let is_zero = |entry: f64| entry.abs() <= least;
    let matrix = if is_zero(col_by_y) && is_zero(row_by_x) {
        rows([col_by_x.signum(), 0.0, 0.0], [0.0, row_by_y.signum(), 0.0], [0.0, 0.0, -1.0])
    } else if is_zero(col_by_x) && is_zero(row_by_y) {
        rows([0.0, col_by_y.signum(), 0.0], [row_by_x.signum(), 0.0, 0.0], [0.0, 0.0, -1.0])
    } else {
        return Err(format!("{shown} is skewed: expected columns and rows along the axes"));
    };
    let (columns, rows) = (col_by_x.abs().max(col_by_y.abs()), row_by_x.abs().max(row_by_y.abs()));
    if is_zero(columns) || is_zero(rows) || matrix.determinant() < 0.0 {
        return Err(format!("{shown} mirrors the image: expected a turn"));
    }
    Ok((columns, rows, matrix))
}

/// The file's path; blanks in it are written `\ `.
fn photo_name(block: &InphoBlock<'_>) -> String {
    let file = block.text("PHOTO_FILE").unwrap_or_default().replace("\\ ", " ");
    if file.is_empty() { block.text("PHOTO_NUM").unwrap_or("without number").to_owned() } else { file }
}

fn pose(
    name: &str,
    block: &InphoBlock<'_>,
    cameras: &BTreeMap<&str, Result<Calibrated, String>>,
) -> Result<Pose, (&'static str, String)> {
    let unusable = |reason: String| ("pose_unusable", reason);
    let oriented = block.all("EXT_ORI").next().and_then(|value| value.split_once('\n')).map(|(_, numbers)| numbers);
    let oriented = oriented.ok_or(("photo_without_pose", "it has no $EXT_ORI: it is not oriented".to_owned()))?;
    let [focal_mm, x, y, z, m @ ..] = numbers::<13>(oriented).map_err(|e| unusable(format!("$EXT_ORI: {e}")))?;
    let m: [f64; 9] = m;
    let id = block.text("CAMERA_ID").ok_or_else(|| unusable("it has no $CAMERA_ID".to_owned()))?;
    let camera = cameras.get(id).ok_or_else(|| ("camera_unknown", format!("its camera {id:?} is not in the file")))?;
    let camera = camera.as_ref().map_err(|reason| ("camera_unusable", reason.clone()))?;
    if (focal_mm - camera.focal_mm).abs() > FOCAL_TOLERANCE_MM {
        return Err(unusable(format!(
            "its focal length is {focal_mm} mm, its camera's {} mm: expected the same",
            camera.focal_mm
        )));
    }
    let matrix = rows([m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]);
    let axes_from_world = nearest_rotation(matrix).map_err(unusable)?;
    Ok(Pose {
        name: name.to_owned(),
        camera: Arc::clone(&camera.camera),
        camera_from_world: camera.camera_from_axes * axes_from_world,
        centre: DVec3::new(x, y, z),
    })
}
