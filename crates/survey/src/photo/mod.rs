//! Photos with their own metadata: position and direction of view from a drone's XMP, position and lens from EXIF. [`direction`]
//! has the tags of the makers; what follows is DJI's.
//!
//! The gimbal's yaw is used (never the aircraft's), with pitch and roll in one product: roll ±180 frames, a few in
//! every flight past the nadir, come out right without special cases. Yaw counts from true north. Photos whose XMP was lost keep
//! the same three angles in DJI's maker note (`ExifTool`'s table of its tags; equal to the XMP's in four real photos). Heights are
//! ellipsoidal where the receiver had a base station (RTK), otherwise of no known reference. Only headers are read. Where
//! DJI's image log (MRK) lies beside the photos, positions by a base station are its; angles stay the gimbal's.
//!
//! The focal length is the declared camera's, else `DewarpData` (a calibration of this very lens), else
//! `CalibratedFocalLength`, else focal length over pixel pitch, else the 35 mm equivalent, which is 2-8 % wrong on some
//! sensors. The EXIF orientation flag is not applied: poses refer to the raster as stored.

mod direction;
mod facts;
mod header;
mod lens;
mod motion;
mod mrk;
mod xmp;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use self::direction::Direction;
pub use self::facts::{PhotoFacts, flight_day, photo_facts};
use self::header::PhotoHeader;
use self::motion::Motion;
use self::mrk::{Logs, Record};
use super::angles::North;
use super::config::{CameraConfig, SurveyConfig, VerticalDatum};
use super::formats::FileMarks;
use super::poses::{FileHeights, Pose, Poses, World, refused};
use super::{SurveyError, photos};
use sizeup_geo::crs::Crs;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::camera::Camera;

/// RTK flags of DJI at and above which positions come from a base station: 16 single, 32-49 float, 50 fixed.
const RTK_FLOAT: u32 = 32;
const RTK_FIXED: u32 = 50;
const RTK_SINGLE: u32 = 16;

/// The yield of one photo.
struct PhotoReading {
    pose: Pose,
    focal: &'static str,
    rtk: &'static str,
    heights: PhotoHeights,
    direction: Direction,
    /// Why the image log's line is not used.
    mismatch: Option<String>,
    /// Standard deviation of the image log's position, metres, horizontal and vertical, where it is used.
    sigma_m: Option<(f64, f64)>,
    /// Motion while the photo was exposed, where that is told.
    motion: Option<Motion>,
}

/// Heights as a photo states them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PhotoHeights {
    /// Positioned with a base station: above the ellipsoid.
    Ellipsoidal,
    /// `AltitudeType` is `RtkAlt`, and nothing states a fix: taken as above the ellipsoid, which not all models write.
    RtkUnfixed,
    /// Heights of no known reference, such as a barometer gives.
    Unknown,
}

/// A folder with photos.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    marks.is_folder && photos::list(&marks.path).is_ok_and(|found| !found.is_empty())
}

/// Reads the headers of all photos below a folder, in parallel.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let folder = config.path.as_path();
    let files = if folder.is_dir() { photos::list(folder)? } else { vec![folder.to_owned()] };
    if files.is_empty() {
        return Err(SurveyError::config(format!("{} holds no photos", folder.display()), "jpg, jpeg, tif or tiff"));
    }
    let mut logs = Logs::beside(&files)?;
    let wants_relative = config.height.reference == Some(VerticalDatum::AboveTakeoff);
    let readings: Vec<Result<PhotoReading, Box<Issue>>> = files
        .par_iter()
        .map(|path| {
            let name = path.strip_prefix(folder).ok().filter(|p| !p.as_os_str().is_empty());
            let name = name.unwrap_or_else(|| path.file_name().map_or(path, Path::new));
            let record = logs.of(path).filter(|_| !wants_relative);
            read_one(path, &name.to_string_lossy(), config.camera.as_ref(), wants_relative, record)
        })
        .collect();
    let mut poses = Poses { world: World::Crs(Crs::parse("EPSG:4326")?), north: North::True, ..Poses::new() };
    poses.issues.append(&mut logs.issues);
    let mut heights = Vec::new();
    let mut directions = Vec::new();
    let mut sigmas_m = Vec::new();
    let mut motions = Vec::new();
    let mut cameras: BTreeMap<String, Arc<Camera>> = BTreeMap::new();
    for (path, reading) in files.iter().zip(readings) {
        match reading {
            Ok(PhotoReading { mut pose, focal, rtk, heights: this, direction, mismatch, sigma_m, motion }) => {
                heights.push(this);
                directions.push(direction);
                sigmas_m.extend(sigma_m);
                motions.extend(motion);
                if let Some(message) = mismatch {
                    let subject = Subject::View(pose.name.clone());
                    poses.issues.push(Issue::new(Severity::Warning, "mrk_disagrees", subject, message));
                }
                *poses.counts.focal.entry(focal.to_owned()).or_default() += 1;
                *poses.counts.rtk.entry(rtk.to_owned()).or_default() += 1;
                let shared = cameras.entry(format!("{:?}", pose.camera)).or_insert_with(|| Arc::clone(&pose.camera));
                pose.camera = Arc::clone(shared);
                poses.poses.push(pose);
            }
            // A terrain model or an orthophoto beside the photos is none of them.
            Err(_) if photos::is_map(path) => {}
            Err(issue) => poses.issues.push(*issue),
        }
    }
    poses.issues.extend(mrk::remark(folder, &sigmas_m));
    poses.issues.extend(motion::remark(&motions, poses.poses.len()));
    poses.issues.extend(direction::remark(&directions));
    poses.heights =
        if heights.contains(&PhotoHeights::Unknown) { FileHeights::Unreliable } else { FileHeights::Ellipsoidal };
    if poses.heights == FileHeights::Ellipsoidal && config.height.reference.is_none() {
        poses.issues.extend(remark_on_heights(folder, &heights));
    }
    Ok(poses)
}

fn read_one(
    path: &Path,
    name: &str,
    declared: Option<&CameraConfig>,
    wants_relative: bool,
    record: Option<&Record>,
) -> Result<PhotoReading, Box<Issue>> {
    let unreadable = |reason: String| Box::new(refused("photo_unreadable", name, reason));
    let header = PhotoHeader::read(path).map_err(unreadable)?;
    let tags = header.xmp.as_deref().map(|packet| xmp::tags(packet, path)).transpose();
    let tags = tags.map_err(|e| unreadable(e.to_string()))?.unwrap_or_default();
    let lens =
        lens::of(&header, &tags, declared).map_err(|reason| Box::new(refused("camera_unusable", name, reason)))?;
    let no_pose = |reason: String| Box::new(refused("photo_without_pose", name, reason));
    let direction = direction::of(&header, &tags).map_err(no_pose)?;
    let (lon_deg, lat_deg) = place(&header, &tags).map_err(no_pose)?;
    let height_m = if wants_relative {
        let relative = tags.number("RelativeAltitude").map_err(no_pose)?;
        relative.ok_or_else(|| no_pose("its metadata lack RelativeAltitude".to_owned()))?
    } else {
        let absolute = tags.number("AbsoluteAltitude").map_err(no_pose)?.or(header.altitude_m());
        absolute.ok_or_else(|| no_pose("its metadata have no altitude".to_owned()))?
    };
    let flag = tags.number("RtkFlag").map_err(no_pose)?;
    let mut rtk = flag.map_or("none", |flag| rtk_word(flag as u32));
    let mut heights = match (rtk, tags.text("AltitudeType")) {
        ("fixed" | "float", _) => PhotoHeights::Ellipsoidal,
        (_, Some("RtkAlt")) => PhotoHeights::RtkUnfixed,
        _ => PhotoHeights::Unknown,
    };
    let mut centre = DVec3::new(lon_deg, lat_deg, height_m);
    let record = record.filter(|record| record.is_rtk());
    let mismatch = record.and_then(|record| record.disagrees_with((lon_deg, lat_deg)));
    let record = record.filter(|_| mismatch.is_none());
    if let Some(record) = record {
        centre = record.place;
        heights = PhotoHeights::Ellipsoidal;
        rtk = if record.state == RTK_FIXED { "fixed" } else { "float" };
    }
    let sigma_m = record.map(|record| (record.sigma_m.x.hypot(record.sigma_m.y), record.sigma_m.z));
    let motion = Motion::of(&header, &tags, lens.camera.fx_px, direction.pitch_deg);
    let camera_from_world = direction.camera_from_world;
    let pose = Pose { name: name.to_owned(), camera: Arc::new(lens.camera), camera_from_world, centre };
    Ok(PhotoReading { pose, focal: lens.source, rtk, heights, direction, mismatch, sigma_m, motion })
}

/// The issue on heights that are taken as ellipsoidal although no photo's positioning says so.
fn remark_on_heights(folder: &Path, heights: &[PhotoHeights]) -> Option<Issue> {
    let n_unfixed = heights.iter().filter(|of_photo| **of_photo == PhotoHeights::RtkUnfixed).count();
    let message = format!(
        "{n_unfixed} of {} photos have AltitudeType RtkAlt without an RTK fix (RtkFlag): their heights are taken as ellipsoidal for it, \
         which not all models write",
        heights.len()
    );
    let subject = Subject::Input(folder.display().to_string());
    let issue = Issue::new(Severity::Warning, "height_reference_assumed", subject, message);
    (n_unfixed > 0).then(|| issue.hint("if they count from sea level or from the take-off, set `height.reference`"))
}

/// A flag of DJI in a word.
fn rtk_word(flag: u32) -> &'static str {
    match flag {
        RTK_FIXED => "fixed",
        flag if flag >= RTK_FLOAT => "float",
        RTK_SINGLE => "single",
        _ => "none",
    }
}

/// Longitude and latitude: XMP has more digits than EXIF, and a spelling mistake of its own.
fn place(header: &PhotoHeader, tags: &xmp::Tags) -> Result<(f64, f64), String> {
    let lat_deg = tags.number("GpsLatitude")?;
    let lon_deg = match tags.number("GpsLongitude")? {
        Some(lon_deg) => Some(lon_deg),
        None => tags.number("GpsLongtitude")?,
    };
    let place = match (lon_deg, lat_deg) {
        (Some(lon_deg), Some(lat_deg)) => (lon_deg, lat_deg),
        _ => header.place_deg().ok_or("its metadata have no position")?,
    };
    let is_on_earth = place.0.abs() <= 180.0 && place.1.abs() <= 90.0;
    // No fix is written as 0, 0.
    if is_on_earth && place != (0.0, 0.0) {
        Ok(place)
    } else {
        Err(format!("its position is {place:?}: no satellite fix"))
    }
}
