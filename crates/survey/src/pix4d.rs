//! Pix4D's calibrated camera parameters, with its offset and CRS files.
//!
//! `*_calibrated_camera_parameters.txt`, also without a project's name before it: eight header lines, then ten lines per image: name, width, height; K (3 × 3);
//! radial R1 R2 R3; tangential T1 T2; position minus offset; world to camera (3 × 3), axes ours. Distortion in OpenCV's
//! order. `*_offset.xyz` is added; `*_wkt.prj` names the CRS. Source: Pix4D support, "Output files, params".

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use super::angles::{nearest_rotation, rows};
use super::config::CsvConfig;
use super::error::Place;
use super::formats::FileMarks;
use super::heights::FileUnits;
use super::poses::{Pose, Poses, World};
use super::{SurveyConfig, SurveyError, csv, text};
use sizeup_geo::crs::Crs;
use sizeup_heights::camera::{Camera, Distortion};

const CALIBRATED: &str = "calibrated_camera_parameters.txt";
const EXTERNAL: &str = "calibrated_external_camera_parameters.txt";
const HEADER_LINES: usize = 8;
const LINES_PER_IMAGE: usize = 10;

/// The file of a Pix4D `params` folder to read: complete cameras before external parameters only.
fn find(path: &Path) -> Option<PathBuf> {
    let ends = |path: &Path, end: &str| {
        let prefix = path.file_name().and_then(|name| name.to_str()?.strip_suffix(end));
        prefix.is_some_and(|prefix| prefix.is_empty() || prefix.ends_with('_'))
    };
    if path.is_file() {
        return (ends(path, CALIBRATED) || ends(path, EXTERNAL)).then(|| path.to_owned());
    }
    let mut files: Vec<PathBuf> = fs::read_dir(path).ok()?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    [CALIBRATED, EXTERNAL].iter().find_map(|end| files.iter().find(|file| ends(file, end)).cloned())
}

/// A `params` folder, or one of its files.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    find(&marks.path).is_some()
}

/// Reads a `params` folder or one of its files.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let file = find(path).ok_or_else(|| {
        SurveyError::malformed(path, Place::Whole, format!("no file ends in {CALIBRATED} or {EXTERNAL}"))
            .hint("`path` is Pix4D's folder 1_initial/params, or one of these files")
    })?;
    let name = file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    let prefix = name.strip_suffix(CALIBRATED).or_else(|| name.strip_suffix(EXTERNAL)).unwrap_or(name);
    let beside = |end: &str| file.with_file_name(format!("{prefix}{end}"));
    let is_complete = name.ends_with(CALIBRATED);
    let mut poses = if is_complete {
        read_calibrated(&file, offset(&beside("offset.xyz"))?)?
    } else {
        read_external(&file, config)?
    };
    let prj = beside("wkt.prj");
    if prj.is_file() {
        let wkt = text::read(&prj)?;
        poses.world = World::Crs(Crs::parse(wkt.trim())?);
    }
    poses.units = FileUnits::ONE_SCALE;
    Ok(poses)
}

/// A table `imageName X Y Z Omega Phi Kappa` with blanks between, which carries no camera.
fn read_external(path: &Path, config: &SurveyConfig) -> Result<Poses, SurveyError> {
    config.declared_camera("Pix4D's file of external parameters")?;
    let table = CsvConfig { name: "imageName".to_owned(), is_spaced: true, ..CsvConfig::default() };
    csv::read_table(path, &table, config.camera.as_ref())
}

fn offset(path: &Path) -> Result<DVec3, SurveyError> {
    if !path.is_file() {
        return Ok(DVec3::ZERO);
    }
    let text = text::read(path)?;
    match numbers(&text)[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(SurveyError::malformed(path, Place::Line(1), "expected the offset as x y z")),
    }
}

fn numbers(line: &str) -> Vec<f64> {
    line.split_ascii_whitespace().filter_map(|field| field.parse().ok()).collect()
}

fn read_calibrated(path: &Path, offset: DVec3) -> Result<Poses, SurveyError> {
    let text = text::read(path)?;
    let lines: Vec<&str> = text.lines().collect();
    let mut poses = Poses::new();
    let body = lines.get(HEADER_LINES..).unwrap_or_default();
    let body = &body[..body.iter().rposition(|line| !line.trim().is_empty()).map_or(0, |last| last + 1)];
    for (i, block) in body.chunks(LINES_PER_IMAGE).enumerate() {
        let line = (HEADER_LINES + i * LINES_PER_IMAGE + 1) as u64;
        if block.len() < LINES_PER_IMAGE {
            return Err(SurveyError::malformed(path, Place::Line(line), "the file ends in the middle of an image")
                .hint("each image has ten lines; the file is truncated"));
        }
        let name = block[0].rsplitn(3, ' ').last().unwrap_or_default().trim();
        match pose(name, block, offset) {
            Ok(pose) => poses.poses.push(pose),
            Err(reason) => poses.refuse("pose_unusable", name, format!("line {line}: {reason}")),
        }
    }
    Ok(poses)
}

fn pose(name: &str, block: &[&str], offset: DVec3) -> Result<Pose, String> {
    let row = |i: usize| -> Result<[f64; 3], String> {
        numbers(block[i]).try_into().map_err(|_| format!("row {} of the image: expected three numbers", i + 1))
    };
    let size: Result<Vec<u32>, _> = block[0].split_ascii_whitespace().rev().take(2).map(str::parse).collect();
    let [height_px, width_px] = size.ok().and_then(|s| s.try_into().ok()).ok_or("expected name, width, height")?;
    let ([fx_px, skew_px, cx_px], [_, fy_px, cy_px]) = (row(1)?, row(2)?);
    let [k1, k2, k3] = row(4)?;
    let [p1, p2] = numbers(block[5]).try_into().map_err(|_| "row 6 of the image: expected two numbers")?;
    let distortion = if skew_px == 0.0 {
        Distortion::brown([k1, k2, k3], [p1, p2])
    } else {
        Distortion::BrownAffine { k1, k2, k3, k4: 0.0, p1, p2, skew: skew_px / fx_px }
    };
    let camera = Camera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, distortion };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(Pose {
        name: name.to_owned(),
        camera: Arc::new(camera),
        camera_from_world: nearest_rotation(rows(row(7)?, row(8)?, row(9)?))?,
        centre: DVec3::from(row(6)?) + offset,
    })
}
