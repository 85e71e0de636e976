//! ODM's `shots.geojson`, with `cameras.json` beside it or one folder up.
//!
//! `translation` is the camera's *position* in ODM's grid, `rotation` world to camera as angle-axis, the geometry the same
//! place in longitude and latitude: the grid is `proj.txt`'s, or one that the places confirm. Older versions name
//! no camera: size and focal length find it. Heights are ellipsoidal. Source: ODM's `opendm/shots.py`.

use std::path::Path;

use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::angles::from_rotation_vector;
use super::error::Place;
use super::formats::FileMarks;
use super::heights::FileUnits;
use super::odm_frame::odm_crs;
use super::opensfm::{CamerasByName, SfmCamera, camera_key, cameras_of, json, take};
use super::poses::{FileHeights, Pose, Poses, World};
use super::{SurveyConfig, SurveyError};
use sizeup_geo::crs::{Crs, Transform};
use sizeup_geo::issue::{Issue, Severity, Subject};

#[derive(Deserialize)]
struct ShotsLayer {
    features: Vec<ShotFeature>,
}

#[derive(Deserialize)]
struct ShotFeature {
    properties: ShotProperties,
    geometry: Option<ShotGeometry>,
}

#[derive(Deserialize)]
struct ShotGeometry {
    coordinates: Vec<f64>,
}

#[derive(Deserialize)]
struct ShotProperties {
    filename: String,
    camera: Option<String>,
    focal: Option<f64>,
    width: Option<f64>,
    height: Option<f64>,
    rotation: Option<[f64; 3]>,
    translation: Option<[f64; 3]>,
}

/// ODM computes the places from the positions by the same grid: more is another grid, metres. National datums without
/// their grid files come out metres off.
const SAME_PLACE_WITHIN_M: f64 = 10.0;
/// The same where nothing but the places tells the grid, metres: rounding of 1e-6 degrees.
const CONFIRMED_WITHIN_M: f64 = 0.5;
/// Focal lengths of one camera in two files of ODM differ by rounding only, of the larger side.
const SAME_FOCAL_WITHIN: f64 = 1e-6;

/// A `.geojson` whose features name files.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    marks.has_extension("geojson") && marks.head.contains("\"filename\"")
}

/// Reads `shots.geojson` and the cameras beside it.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let layer: ShotsLayer = json(path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let cameras_path = [folder.join("cameras.json"), folder.join("..").join("cameras.json")]
        .into_iter()
        .find(|candidate| candidate.is_file())
        .ok_or_else(|| {
            SurveyError::malformed(path, Place::Whole, "there is no cameras.json beside it or one folder up")
                .hint("shots.geojson has no lens parameters: copy ODM's cameras.json beside it")
        })?;
    let models: std::collections::BTreeMap<String, SfmCamera> = json(&cameras_path)?;
    let sizes: Vec<(String, SfmSize)> =
        models.iter().map(|(id, camera)| (camera_key(id).to_owned(), SfmSize::of(camera))).collect();
    let cameras: CamerasByName = cameras_of(models);
    let mut poses = Poses { heights: FileHeights::Ellipsoidal, units: FileUnits::ONE_SCALE, ..Poses::new() };
    let mut places = Vec::new();
    for ShotFeature { properties: shot, geometry } in layer.features {
        let (Some(rotation), Some(position)) = (shot.rotation, shot.translation) else {
            poses.refuse("photo_without_pose", &shot.filename, "the shot has no rotation or translation");
            continue;
        };
        let camera = match shot.camera.clone().map_or_else(|| camera_by_size(&shot, &sizes), Ok) {
            Ok(camera) => camera,
            Err(reason) => {
                poses.refuse("camera_unknown", &shot.filename, reason);
                continue;
            }
        };
        if let Some([lon_deg, lat_deg, ..]) = geometry.as_ref().map(|g| g.coordinates.as_slice()) {
            places.push((DVec2::new(*lon_deg, *lat_deg), DVec3::from(position).truncate()));
        }
        take(&shot.filename, &camera, &cameras, &mut poses, |camera| Pose {
            name: shot.filename.clone(),
            camera,
            camera_from_world: from_rotation_vector(rotation.into()),
            centre: position.into(),
        });
    }
    find_grid(&mut poses, config, folder, &places)?;
    Ok(poses)
}

/// Size in pixels and focal length over the larger side.
struct SfmSize {
    width: f64,
    height: f64,
    focal: Option<f64>,
}

impl SfmSize {
    fn of(camera: &SfmCamera) -> Self {
        Self { width: camera.width, height: camera.height, focal: camera.focal() }
    }
}

/// The one camera that has a shot's size and focal length.
fn camera_by_size(shot: &ShotProperties, cameras: &[(String, SfmSize)]) -> Result<String, String> {
    let is_it = |size: &SfmSize| {
        let same_size = Some(size.width) == shot.width && Some(size.height) == shot.height;
        let same_focal = match (size.focal, shot.focal) {
            (Some(a), Some(b)) => (a - b).abs() < SAME_FOCAL_WITHIN,
            _ => false,
        };
        same_size && same_focal
    };
    let mut found = cameras.iter().filter(|(_, size)| is_it(size)).map(|(id, _)| id);
    match (found.next(), found.next()) {
        (Some(id), None) => Ok(id.clone()),
        (found, _) => {
            let n = if found.is_some() { "several cameras" } else { "no camera" };
            Err(format!("the shot names no camera, and {n} in cameras.json has its size and focal length"))
        }
    }
}

/// The grid of the positions: declared, `proj.txt`'s, or the UTM zone of the places, and never against them.
fn find_grid(
    poses: &mut Poses,
    config: &SurveyConfig,
    folder: &Path,
    places: &[(DVec2, DVec2)],
) -> Result<(), SurveyError> {
    let path = config.path.as_path();
    let georeferencing = [folder.to_owned(), folder.join("..").join("odm_georeferencing")];
    let named = match (&config.crs, georeferencing.iter().find(|f| f.join("proj.txt").is_file())) {
        (Some(declared), _) => Some(declared.clone()),
        (None, Some(found)) => Some(odm_crs(found)?),
        (None, None) => None,
    };
    if config.enu_origin.is_some() {
        return Ok(());
    }
    if let Some(crs) = named {
        if let Some(off_m) = worst_m(&crs, config, places).filter(|off_m| *off_m > SAME_PLACE_WITHIN_M) {
            let message = format!("{crs} puts its positions {off_m:.0} m from their own longitude and latitude");
            return Err(SurveyError::malformed(path, Place::Whole, message)
                .hint("name the grid that ODM used: its odm_georeferencing/proj.txt"));
        }
        poses.world = World::Crs(crs);
        return Ok(());
    }
    let Some((lon_lat, _)) = places.first() else {
        return Err(SurveyError::malformed(
            path,
            Place::Whole,
            "nothing names the grid of its positions: no proj.txt, no places",
        )
        .hint("set `crs`, or copy ODM's odm_georeferencing/proj.txt beside it"));
    };
    let zone = Crs::parse(&Crs::utm_zone(lon_lat.x, lon_lat.y))?;
    match worst_m(&zone, config, places) {
        Some(off_m) if off_m <= CONFIRMED_WITHIN_M => {
            let message =
                format!("no proj.txt names the grid; longitudes and latitudes confirm {zone} to {off_m:.2} m");
            let subject = Subject::Input(path.display().to_string());
            poses.issues.push(Issue::new(Severity::Note, "grid_found_from_places", subject, message));
            poses.world = World::Crs(zone);
            Ok(())
        }
        off_m => {
            let off = off_m.map_or("far".to_owned(), |off_m| format!("{off_m:.1} m"));
            let message = format!(
                "no proj.txt names the grid of its positions, and it is not {zone}: that puts them {off} from their own \
                 longitude and latitude"
            );
            Err(SurveyError::malformed(path, Place::Whole, message)
                .hint("set `crs`, or copy ODM's odm_georeferencing/proj.txt beside it"))
        }
    }
}

/// The largest distance between places and positions in a grid, metres; `None` where it cannot be told.
fn worst_m(crs: &Crs, config: &SurveyConfig, places: &[(DVec2, DVec2)]) -> Option<f64> {
    let offset = DVec3::from(config.offset).truncate();
    let to_grid = Transform::new(&Crs::parse("EPSG:4326").ok()?, crs).ok().filter(|_| crs.is_projected())?;
    let off_m = |&(lon_lat, position): &(DVec2, DVec2)| {
        let (x, y) = to_grid.point(lon_lat.x, lon_lat.y).unwrap_or((f64::INFINITY, f64::INFINITY));
        DVec2::new(x, y).distance(position + offset)
    };
    (!places.is_empty()).then(|| places.iter().map(off_m).fold(0.0, f64::max))
}
