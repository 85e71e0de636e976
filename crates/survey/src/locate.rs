//! From a file's world to the project's map frame: checks, positions through PROJ, grid convergence per camera.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DVec3};

use super::angles::{North, nearest_rotation};
use super::heights::HeightConversion;
use super::inspect::{IMPOSSIBLE_HEIGHT, LOOKS_UP};
use super::poses::{FileHeights, Pose, Poses, PropertyCounts, World, refused};
use super::{Survey, SurveyConfig, SurveyError, View, ViewKind, photos};
use sizeup_geo::crs::{Accuracy, Crs, CrsError, Geocentric, GridNorth, Transform, TrueNorth, enu_from_geocentric};
use sizeup_geo::files::is_virtual;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::paths::within;
use sizeup_heights::frames::Rigid;
use sizeup_heights::ids::ViewId;

/// Heights a camera over land can have, metres: the Dead Sea's shore (−430 m) with a geoid 70 m below the ellipsoid, and
/// 10 km above the highest summit.
pub(crate) const POSSIBLE_HEIGHTS_M: std::ops::RangeInclusive<f64> = -500.0..=18_850.0;

/// A pose error becomes a height error of the same size: a coarser way to the project's plane is refused, metres.
const MAX_TRANSFORM_ERROR_M: f64 = 1.0;
/// Farther from the origin of a grid, metres, lies nothing: the earth is 4e7 round, and eastings that begin with the zone's
/// number reach 6.1e7.
const FARTHEST_M: f64 = 1e8;

/// The way to the map that all poses of a survey have in common.
struct WayToMap {
    map_from_world: Transform,
    /// For rotations that count from true north although positions are in a grid.
    true_north: Option<TrueNorth>,
    heights: HeightConversion,
    /// Metres per unit of the poses' heights.
    height_unit_m: f64,
    offset: DVec3,
}

/// A pose in the map frame.
struct Located {
    camera_from_map: DMat3,
    centre_in_map: DVec3,
    north: GridNorth,
}

/// Facts found on the way, for the report.
#[derive(Debug, Clone, Default)]
pub(crate) struct Facts {
    /// The CRS the poses came in.
    pub world: String,
    /// Way of heights to the project's vertical reference.
    pub heights: String,
    /// Turn applied to each view for grid convergence, degrees, clockwise.
    pub convergence_deg: Vec<f64>,
    /// Point scale between the poses' grid and the project's, where both are grids.
    pub point_scale: Vec<f64>,
    /// Way of positions to the project's plane, and its accuracy.
    pub transform: String,
    /// Poses in the file.
    pub n_poses: usize,
    /// Sources of focal lengths and states of positioning.
    pub counts: PropertyCounts,
}

impl WayToMap {
    fn locate(&self, pose: &Pose) -> Result<Located, String> {
        let centre = pose.centre + self.offset;
        let rotation = nearest_rotation(pose.camera_from_world)?;
        if !centre.is_finite() {
            return Err(format!("its position is {centre}: expected finite numbers"));
        }
        let (easting, northing) = self.map_from_world.point(centre.x, centre.y).map_err(|e| e.to_string())?;
        let world_north = self.map_from_world.north_at(centre.x, centre.y).map_err(|e| e.to_string())?;
        let true_north = match &self.true_north {
            Some(true_north) => true_north.at(centre.x, centre.y).map_err(|e| e.to_string())?,
            None => GridNorth::SAME,
        };
        if easting.abs().max(northing.abs()) > FARTHEST_M {
            return Err(format!(
                "its position is {easting:e}, {northing:e}: expected metres of at most {FARTHEST_M:e}"
            ));
        }
        let in_metres = centre.with_z(centre.z * self.height_unit_m);
        let height_m = self.heights.in_project(in_metres).map_err(|e| e.to_string())?;
        let azimuth_rad = world_north.azimuth_rad + true_north.azimuth_rad;
        let north = GridNorth { azimuth_rad, scale: world_north.scale };
        Ok(Located {
            camera_from_map: rotation * north.target_from_source().transpose(),
            centre_in_map: DVec3::new(easting, northing, height_m),
            north,
        })
    }
}

/// The CRS of the poses (declared, said by the file, or the project's), and the offset still to be added in it.
fn world_crs(poses: &mut Poses, config: &SurveyConfig, project_crs: &Crs) -> Result<(Crs, DVec3), SurveyError> {
    let offset = DVec3::from(config.offset);
    if let Some([lat_deg, lon_deg, height_m]) = config.enu_origin {
        if config.crs.is_some() {
            return Err(SurveyError::config(
                "`crs` and `enu_origin` are both given",
                "poses are in one frame: keep one",
            ));
        }
        poses.world = World::Enu(DVec3::new(lon_deg, lat_deg, height_m));
    } else if let Some(declared) = &config.crs {
        poses.world = World::Crs(declared.clone());
    }
    match poses.world.clone() {
        World::Unsaid => Ok((project_crs.clone(), offset)),
        World::Unclear(why) => Err(SurveyError::config(why, "state `survey.crs`")),
        World::Crs(crs) if !crs.is_geocentric() => Ok((crs, offset)),
        world => {
            to_geodetic(poses, &world, offset)?;
            Ok((Crs::parse("EPSG:4979")?, DVec3::ZERO))
        }
    }
}

/// Moves poses of an earth-centred or local tangent world to longitude, latitude, ellipsoidal height, and their
/// rotations to the east, north, up at each camera.
fn to_geodetic(poses: &mut Poses, world: &World, offset: DVec3) -> Result<(), SurveyError> {
    std::mem::take(&mut poses.units).require_metres()?;
    let geocentric = Geocentric::new()?;
    let (axes, origin) = match world {
        World::Enu(origin) => (enu_from_geocentric(origin.x, origin.y).transpose(), geocentric.geocentric(*origin)?),
        World::Crs(_) | World::Unsaid | World::Unclear(_) => (DMat3::IDENTITY, DVec3::ZERO),
    };
    let mut kept = Vec::with_capacity(poses.poses.len());
    for mut pose in std::mem::take(&mut poses.poses) {
        match geocentric.geodetic(origin + axes * (pose.centre + offset)) {
            Ok(geodetic) if pose.centre.is_finite() => {
                let enu_from_world = enu_from_geocentric(geodetic.x, geodetic.y) * axes;
                pose.camera_from_world *= enu_from_world.transpose();
                pose.centre = geodetic;
                kept.push(pose);
            }
            Ok(_) => poses.refuse("pose_unusable", &pose.name, "its position is not finite"),
            Err(e) => poses.refuse("pose_unusable", &pose.name, e.to_string()),
        }
    }
    poses.poses = kept;
    poses.heights = FileHeights::Ellipsoidal;
    Ok(())
}

/// Turns a file's poses into views in the project's CRS; what cannot be used becomes an issue.
pub(crate) fn locate(
    mut poses: Poses,
    config: &SurveyConfig,
    project_crs: &Crs,
) -> Result<(Survey, Facts), SurveyError> {
    let is_refused = |issue: &&Issue| issue.severity == Severity::Refused;
    let n_read = poses.poses.len() + poses.issues.iter().filter(is_refused).count();
    let (world, offset) = world_crs(&mut poses, config, project_crs)?;
    require_frame(&poses, (&world, offset), project_crs)?;
    let heights = match HeightConversion::decide(&config.height, poses.heights, &world, project_crs) {
        // What is wrong with each photo says more than heights that none of them has.
        Err(_) if poses.poses.is_empty() => return Ok(nothing(poses, &world, n_read)),
        heights => heights?,
    };
    let height_unit_m = match poses.units.height_unit_m(&config.height, &world) {
        Err(_) if poses.poses.is_empty() => return Ok(nothing(poses, &world, n_read)),
        unit => unit?,
    };
    let true_north = match poses.north {
        North::True if !world.is_geographic() => Some(TrueNorth::of(&world)?),
        _ => None,
    };
    let way =
        WayToMap { map_from_world: Transform::new(&world, project_crs)?, true_north, offset, heights, height_unit_m };
    let Poses { poses, mut issues, counts, written, .. } = poses;
    let mut facts = Facts {
        world: world.to_string(),
        heights: heights_in_words(&way),
        n_poses: n_read,
        counts,
        ..Facts::default()
    };
    if let Some(first) = poses.first() {
        facts.transform = accuracy(&way, first.centre + offset, config, &mut issues)?;
        if let Some(accuracy) = way.heights.accuracy_at(first.centre + offset) {
            facts.heights = format!("{}, {accuracy}", facts.heights);
        }
    }
    let mut views = Vec::with_capacity(poses.len());
    for pose in without_duplicates(poses, &mut issues) {
        match view(&way, pose) {
            Ok((view, north)) => {
                views.push(view);
                facts.convergence_deg.push(north.azimuth_rad.to_degrees());
                facts.point_scale.push(north.scale);
            }
            Err(issue) => issues.push(*issue),
        }
    }
    views.sort_by(|a, b| a.id.cmp(&b.id));
    if let Some(place) = config.images.as_deref().filter(|images| is_virtual(images)) {
        photos::address(&mut views, place)?;
    } else if let Some(folder) = &config.images {
        if !folder.exists() {
            let message = format!("there is no folder {}", folder.display());
            return Err(SurveyError::config(
                message,
                "`images` is the folder of the photos, on a server `/vsicurl/https://…`; leave it out for poses only",
            ));
        }
        let refused = names_of(&issues);
        issues.extend(photos::attach(&mut views, &refused, &written, folder)?);
    }
    if way.heights.is_choice() {
        let subject = Subject::Input(config.path.display().to_string());
        issues.push(Issue::new(Severity::Note, "height_choice", subject, facts.heights.clone()));
    }
    issues.sort_by(|a, b| (&a.subject, &a.code).cmp(&(&b.subject, &b.code)));
    Ok((Survey { views, issues }, facts))
}

/// Way of heights to the project, and the unit that they are converted from.
fn heights_in_words(way: &WayToMap) -> String {
    match way.height_unit_m {
        1.0 => way.heights.to_string(),
        unit_m => format!("{}; converted to metres from units of {unit_m:.9} m", way.heights),
    }
}

/// The survey of a file without a pose, and why.
fn nothing(poses: Poses, world: &Crs, n_poses: usize) -> (Survey, Facts) {
    let Poses { mut issues, counts, .. } = poses;
    issues.sort_by(|a, b| (&a.subject, &a.code).cmp(&(&b.subject, &b.code)));
    let facts = Facts {
        world: world.to_string(),
        heights: "none".to_owned(),
        transform: "none".to_owned(),
        n_poses,
        counts,
        ..Facts::default()
    };
    (Survey { views: Vec::new(), issues }, facts)
}

/// Accuracy of the way to the project's plane; refused where that is not enough.
fn accuracy(way: &WayToMap, at: DVec3, config: &SurveyConfig, issues: &mut Vec<Issue>) -> Result<String, SurveyError> {
    let transform = &way.map_from_world;
    if transform.is_identity() {
        return Ok("none: the poses are in the project's plane".to_owned());
    }
    // A place outside the operation's domain is the pose's trouble.
    let Ok(accuracy) = transform.accuracy_at(at.x, at.y) else {
        return Ok("not possible at the first pose".to_owned());
    };
    let better = transform.better_at(at.x, at.y);
    let advice = better.map_or_else(String::new, |better| format!("; {better}"));
    let (from, to) = (transform.from(), transform.to());
    let subject = || Subject::Input(config.path.display().to_string());
    match accuracy {
        Accuracy::Metres(metres) if metres > MAX_TRANSFORM_ERROR_M => {
            let message = format!(
                "positions reach {to} from {from} only to {metres} m, expected {MAX_TRANSFORM_ERROR_M} m or better{advice}"
            );
            if config.accept_unsound {
                issues.push(Issue::new(Severity::Warning, "transform_coarse", subject(), message));
                return Ok(format!("{from} to {to}, {accuracy}{advice}"));
            }
            let hint = format!(
                "install the grid file where one is named (`projsync --file NAME`, or a folder named by PROJ_DATA); where a \
                 base station gave positions in the datum of {to}, declare that by `survey.crs`; or accept the shift by \
                 `survey.accept_unsound = true`"
            );
            return Err(SurveyError::config(message, hint));
        }
        Accuracy::Unknown => {
            let message = format!("nothing tells how well positions reach {to} from {from}{advice}");
            issues.push(Issue::new(Severity::Warning, "transform_accuracy_unknown", subject(), message));
        }
        Accuracy::Metres(_) if !advice.is_empty() => {
            let message = format!("positions reach {to} from {from} {accuracy}{advice}");
            issues.push(Issue::new(Severity::Note, "better_transform_known", subject(), message));
        }
        Accuracy::Metres(_) | Accuracy::Exact => {}
    }
    Ok(format!("{from} to {to}, {accuracy}{advice}"))
}

fn names_of(issues: &[Issue]) -> BTreeSet<String> {
    let name = |issue: &Issue| match &issue.subject {
        Subject::View(name) => Some(name.clone()),
        _ => None,
    };
    issues.iter().filter_map(name).collect()
}

/// Refuses a project CRS that cannot carry a city where the survey lies, suggesting the grid in metres of its place.
fn require_frame(poses: &Poses, (world, offset): (&Crs, DVec3), project_crs: &Crs) -> Result<(), SurveyError> {
    let first = poses.poses.first().map(|pose| pose.centre + offset).filter(|centre| centre.is_finite());
    let moved = |centre: DVec3, to: &Crs| Transform::new(world, to).ok()?.point(centre.x, centre.y).ok();
    let Err(refused) = project_crs.require_projected_metres() else {
        project_crs.require_heights_in_metres()?;
        let Some((easting, northing)) = first.and_then(|centre| moved(centre, project_crs)) else { return Ok(()) };
        return Ok(project_crs.require_true_scale_at(easting, northing)?);
    };
    let place = || -> Option<(f64, f64)> {
        // The CRS of poses that nobody named is the refused one: it places them nowhere.
        let is_named = poses.world != World::Unsaid || world.is_geographic();
        let lon_lat = moved(first.filter(|_| is_named)?, &Crs::parse("EPSG:4326").ok()?)?;
        // Metres read as degrees lie nowhere: the project's CRS was taken for the poses' too.
        Some(lon_lat).filter(|(lon_deg, lat_deg)| lon_deg.abs() <= 180.0 && lat_deg.abs() <= 90.0)
    };
    match (refused, place()) {
        (CrsError::NotProjectedInMetres { definition, found, .. }, Some((lon_deg, lat_deg))) => {
            let hint = project_crs.advice_at("survey lies", lon_deg, lat_deg);
            Err(CrsError::NotProjectedInMetres { definition, found, hint }.into())
        }
        (refused, _) => Err(refused.into()),
    }
}

fn view(way: &WayToMap, pose: Pose) -> Result<(View, GridNorth), Box<Issue>> {
    if within(&pose.name).is_none() {
        let issue = refused("photo_name_unusable", &pose.name, "its name is no path of a file");
        return Err(Box::new(issue.hint("name photos by file, or by folders and file below one folder")));
    }
    check_camera(&pose)?;
    let located = way.locate(&pose).map_err(|reason| Box::new(refused("pose_unusable", &pose.name, reason)))?;
    let camera_from_map = Rigid::from_rotation_and_centre(located.camera_from_map, located.centre_in_map);
    let height_m = located.centre_in_map.z;
    if !POSSIBLE_HEIGHTS_M.contains(&height_m) {
        let message = format!(
            "its camera is {height_m:.0} m high: expected {:.0} to {:.0} m",
            POSSIBLE_HEIGHTS_M.start(),
            POSSIBLE_HEIGHTS_M.end()
        );
        let issue = refused(IMPOSSIBLE_HEIGHT, &pose.name, message)
            .hint("check the unit and the reference of the heights, and the order of the axes")
            .at(located.centre_in_map.x, located.centre_in_map.y);
        return Err(Box::new(issue));
    }
    let view = View { id: ViewId(pose.name), camera: pose.camera, camera_from_map, image: None };
    if view.kind() == ViewKind::Upward {
        let message = format!("it looks {:.1}° off the vertical, at or above the horizon", view.off_nadir_deg());
        let place = located.centre_in_map;
        let issue = refused(LOOKS_UP, &view.id.0, message)
            .hint("if many views do, the angle sequence, direction or axes are declared wrong")
            .at(place.x, place.y);
        return Err(Box::new(issue));
    }
    Ok((view, located.north))
}

/// Shorter focal lengths, of the larger side, are in another unit than pixels: 157° from side to side.
const MIN_FOCAL: f64 = 0.1;

/// Refuses a camera that cannot be, whatever format it comes from.
fn check_camera(pose: &Pose) -> Result<(), Box<Issue>> {
    let unusable = |message: String| refused("camera_unusable", &pose.name, message);
    let camera = &pose.camera;
    camera.validate().map_err(|e| Box::new(unusable(e.to_string())))?;
    let (width_px, height_px) = (camera.width_px, camera.height_px);
    let focal_px = camera.fx_px.min(camera.fy_px);
    if focal_px >= MIN_FOCAL * f64::from(width_px.max(height_px)) {
        return Ok(());
    }
    let message = format!(
        "a focal length of {focal_px} px for {width_px} × {height_px} px: expected at least {MIN_FOCAL} of the larger side"
    );
    let hint =
        "focal lengths are in pixels: mm times the pixels of a side over its mm (36 for equivalents of 35 mm film)";
    Err(Box::new(unusable(message).hint(hint)))
}

/// A name given twice with one pose counts once; with two poses neither can be trusted.
fn without_duplicates(poses: Vec<Pose>, issues: &mut Vec<Issue>) -> Vec<Pose> {
    let mut places: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (i, pose) in poses.iter().enumerate() {
        places.entry(&pose.name).or_default().push(i);
    }
    let mut is_kept = vec![true; poses.len()];
    for (name, places) in places.iter().filter(|(_, places)| places.len() > 1) {
        let first = &poses[places[0]];
        let is_same = places
            .iter()
            .all(|&i| poses[i].centre == first.centre && poses[i].camera_from_world == first.camera_from_world);
        let subject = Subject::View((*name).to_owned());
        let n = places.len();
        if is_same {
            let message = format!("listed {n} times with the same pose; used once");
            issues.push(Issue::new(Severity::Warning, "duplicate_name", subject, message));
        } else {
            let message = format!("{n} different poses have this name; none is used");
            issues.push(
                Issue::new(Severity::Refused, "duplicate_name", subject, message)
                    .hint("give each photo its own name, for example with its folder"),
            );
        }
        for &i in &places[usize::from(is_same)..] {
            is_kept[i] = false;
        }
    }
    let mut kept = is_kept.into_iter();
    poses.into_iter().filter(|_| kept.next().unwrap_or(true)).collect()
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::fs;

    use super::*;
    use crate::{Reading, Site};

    #[test]
    fn a_position_off_the_earth_is_refused_and_spoils_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.csv");
        let mut table = "name,x,y,z,omega,phi,kappa,width,height,fx\n".to_owned();
        for i in 0..20 {
            writeln!(table, "{i}.jpg,{},5763000,180,10,0,0,400,300,500", 566_000 + 10 * i).unwrap();
        }
        // The last lies in a grid whose eastings begin with the zone's number.
        table += "far.jpg,1e99,5763000,180,10,0,0,400,300,500\nback.jpg,566000,-1e9,180,10,0,0,400,300,500\n\
            zone.jpg,60566000,5763000,180,10,0,0,400,300,500\n";
        fs::write(&path, table).unwrap();
        let crs = Crs::parse("EPSG:25832").unwrap();
        let reading = Reading::of(&SurveyConfig::at(&path), &crs).unwrap();
        let refused: Vec<String> = reading.survey().issues.iter().map(|issue| format!("{:?}", issue.subject)).collect();
        assert_eq!(refused, [r#"View("back.jpg")"#, r#"View("far.jpg")"#]);
        assert!(reading.survey().issues[1].message.contains("1e99"), "{}", reading.survey().issues[1].message);
        let report = reading.report(Site::default());
        assert!(report.is_sound() && report.height_m.unwrap().min > 179.0, "{report}");
    }

    /// A pose at a place of Hamburg in EPSG:25832, minus an offset.
    fn hamburg(folder: &std::path::Path) -> SurveyConfig {
        let path = folder.join("poses.csv");
        let table = "name,x,y,z,omega,phi,kappa,width,height,fx\n0.jpg,120.0,240.0,180,10,0,0,400,300,500\n";
        fs::write(&path, table).unwrap();
        let crs = Crs::parse("EPSG:25832").ok();
        SurveyConfig { crs, offset: [565_000.0, 5_933_000.0, 0.0], ..SurveyConfig::at(&path) }
    }

    fn refusal(config: &SurveyConfig, project: &str) -> String {
        Reading::of(config, &Crs::parse(project).unwrap()).err().map_or_else(String::new, |e| e.to_string())
    }

    #[test]
    fn the_grid_to_use_is_that_of_the_place_with_its_offset() {
        let folder = tempfile::tempdir().unwrap();
        let config = hamburg(folder.path());
        let refused = refusal(&config, "EPSG:3857");
        assert!(
            refused.contains("9.98") && refused.contains("53.5") && refused.contains("use EPSG:32632"),
            "{refused}"
        );
        let feet = SurveyConfig { crs: Crs::parse("EPSG:2263").ok(), offset: [984_000.0, 213_000.0, 0.0], ..config };
        let refused = refusal(&feet, "EPSG:2263");
        assert!(refused.contains("use EPSG:32118 (NAD83 / New York Long Island)"), "{refused}");
    }

    #[test]
    fn a_project_crs_that_stretches_metres_at_the_survey_is_refused_with_the_scale() {
        let folder = tempfile::tempdir().unwrap();
        let config = hamburg(folder.path());
        let refused = refusal(&config, "EPSG:3395");
        assert!(
            refused.contains("a metre on the ground is 1.679 m long") && refused.contains("use EPSG:32632"),
            "{refused}"
        );
        assert_eq!(refusal(&config, "EPSG:25833"), "");
    }

    #[test]
    fn photos_without_a_pose_are_told_why_before_their_heights_are_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let size = b"II*\0\x08\0\0\0\x02\0\0\x01\x04\0\x01\0\0\0\x28\0\0\0\x01\x01\x04\0\x01\0\0\0\x1e\0\0\0\0\0\0\0";
        fs::write(folder.path().join("a.tif"), size).unwrap();
        let crs = Crs::parse("EPSG:25832").unwrap();
        let reading = Reading::of(&SurveyConfig::at(folder.path()), &crs).unwrap();
        let report = reading.report(Site::default());
        assert!(!report.is_sound() && report.n_refused() == 1, "{report}");
        assert!(report.to_string().contains("refused: a.tif: no focal length in its metadata"), "{report}");
    }
}
