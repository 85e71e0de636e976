//! ODM's `geo.txt`: the CRS, then `name x y [z] [yaw pitch roll] [accuracies]`; pitch 0 looks straight down. It carries no
//! camera.

use std::sync::Arc;

use glam::DVec3;

use super::angles::{AngleConvention, AngleKind, North, PitchZero};
use super::error::Place;
use super::formats::FileMarks;
use super::poses::{FileHeights, Pose, Poses, World};
use super::{SurveyConfig, SurveyError, text};
use sizeup_geo::crs::{Crs, CrsError};

/// A file of this name.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    marks.name == "geo.txt"
}

/// Reads the poses; the camera is the declared one.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let camera = config.declared_camera("geo.txt")?;
    let text = text::read(path)?;
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
