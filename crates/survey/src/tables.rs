//! Text tables of other tools, each a declared table of ours: ODM's `geo.txt`, Metashape's export of omega, phi, kappa
//! and Pix4D's external parameters. None carries a camera: it has to be declared.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::angles::{AngleConvention, AngleKind, North, PitchZero};
use super::config::{CameraConfig, CsvConfig, PixelOrigin};
use super::error::Place;
use super::poses::{FileHeights, Pose, Poses, World};
use super::{SurveyError, csv};
use sizeup_geo::crs::{Crs, CrsError};
use sizeup_geo::files;
use sizeup_heights::camera::Camera;

fn need_camera<'a>(camera: Option<&'a CameraConfig>, format: &str) -> Result<&'a CameraConfig, SurveyError> {
    camera.ok_or_else(|| {
        let message = format!("{format} carries no camera");
        SurveyError::config(
            message,
            "declare it under [survey.camera]: width, height, fx and what is known of the lens",
        )
    })
}

/// Metashape, "Export Cameras", Omega Phi Kappa: `PhotoID X Y Z Omega Phi Kappa r11 … r33`, tabs or commas.
pub(crate) fn read_metashape_opk(path: &Path, camera: Option<&CameraConfig>) -> Result<Poses, SurveyError> {
    let camera = need_camera(camera, "Metashape's omega-phi-kappa export")?;
    let header = ["name", "x", "y", "z", "omega", "phi", "kappa"].map(str::to_owned).to_vec();
    csv::read(path, &CsvConfig { header: Some(header), ..CsvConfig::default() }, Some(camera))
}

/// Pix4D, `*_calibrated_external_camera_parameters.txt`: `imageName X Y Z Omega Phi Kappa`, blanks.
pub(crate) fn read_pix4d_external(path: &Path, camera: Option<&CameraConfig>) -> Result<Poses, SurveyError> {
    let camera = need_camera(camera, "Pix4D's file of external parameters")?;
    let config = CsvConfig { name: "imageName".to_owned(), delimiter: "whitespace".to_owned(), ..CsvConfig::default() };
    csv::read(path, &config, Some(camera))
}

/// ODM's `geo.txt`: the CRS, then `name x y [z] [yaw pitch roll] [accuracies]`; pitch 0 looks straight down.
pub(crate) fn read_geo_txt(path: &Path, camera: Option<&CameraConfig>) -> Result<Poses, SurveyError> {
    let camera = Arc::new(camera_of(need_camera(camera, "geo.txt")?)?);
    let text = files::read_text(path)?;
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let Some((_, crs)) = lines.next() else {
        return Err(SurveyError::malformed(path, Place::Line(1), "empty: expected the CRS on the first line"));
    };
    let world = World::Crs(crs_of_line(crs)?);
    let mut poses = Poses { world, north: North::True, heights: FileHeights::Unreliable, ..Poses::new() };
    let convention =
        AngleConvention { angles: AngleKind::Ypr, pitch_zero: PitchZero::Nadir, ..AngleConvention::default() };
    for (i, line) in lines {
        let fields: Vec<&str> = line.split_ascii_whitespace().collect();
        let name = fields[0];
        let numbers: Option<Vec<f64>> = fields[1..].iter().map(|field| field.parse().ok()).collect();
        let Some(numbers) = numbers else {
            poses.refuse("pose_unusable", name, format!("line {}: expected numbers after the name", i + 1));
            continue;
        };
        if numbers.len() < 6 {
            let message = format!("line {}: no yaw, pitch, roll ({} numbers: expected 6)", i + 1, numbers.len());
            poses.refuse("photo_without_pose", name, message);
            continue;
        }
        match convention.camera_from_world(&numbers[3..6]) {
            Ok(camera_from_world) => poses.poses.push(Pose {
                name: name.to_owned(),
                camera: Arc::clone(&camera),
                camera_from_world,
                centre: DVec3::new(numbers[0], numbers[1], numbers[2]),
            }),
            Err(reason) => poses.refuse("pose_unusable", name, format!("line {}: {reason}", i + 1)),
        }
    }
    Ok(poses)
}

/// A CRS as ODM's text files name it: also in words, `WGS84 UTM 32N`.
fn crs_of_line(line: &str) -> Result<Crs, CrsError> {
    let words: Vec<&str> = line.split_whitespace().collect();
    if let ["WGS84", "UTM", zone] = words[..] {
        let [north, south] = [zone.strip_suffix('N'), zone.strip_suffix('S')];
        let number = north.or(south).and_then(|number| number.parse::<u32>().ok());
        if let Some(number @ 1..=60) = number {
            return Crs::parse(&format!("EPSG:{}", if north.is_some() { 32600 } else { 32700 } + number));
        }
    }
    Crs::parse(line)
}

fn camera_of(config: &CameraConfig) -> Result<Camera, SurveyError> {
    csv::declared_camera(config, PixelOrigin::default()).map_err(|e| SurveyError::config(e, ""))
}
