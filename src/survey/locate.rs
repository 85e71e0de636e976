//! From a file's world to the project's map frame: checks, positions through PROJ, grid convergence per camera.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DVec3};

use super::angles::{North, nearest_rotation};
use super::poses::{Pose, Poses, World, refused};
use super::{SurveyConfig, SurveyError, View, ViewKind, photos};
use crate::crs::{Crs, GridNorth, Transform, TrueNorth};
use crate::frames::Rigid;
use crate::ids::ViewId;
use crate::issue::{Issue, Severity, Subject};

/// What all poses of a survey have in common on their way to the map.
struct Way {
    map_from_world: Transform,
    /// For rotations that count from true north although positions are in a grid.
    true_north: Option<TrueNorth>,
}

/// A pose in the map frame.
struct Located {
    camera_from_map: DMat3,
    centre_in_map: DVec3,
}

impl Way {
    fn new(world: &Crs, north: North, project_crs: &Crs) -> Result<Self, SurveyError> {
        let map_from_world = Transform::new(world, project_crs)?;
        let true_north = match north {
            North::True if !world.is_geographic() => Some(TrueNorth::of(world)?),
            _ => None,
        };
        Ok(Self { map_from_world, true_north })
    }

    fn locate(&self, pose: &Pose, offset: DVec3) -> Result<Located, String> {
        let centre = pose.centre + offset;
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
        let map_from_axes = world_north.target_from_source() * true_north.target_from_source();
        Ok(Located {
            camera_from_map: rotation * map_from_axes.transpose(),
            centre_in_map: DVec3::new(easting, northing, centre.z),
        })
    }
}

/// Turns a file's poses into views in the project's CRS; what cannot be used becomes an issue.
pub(crate) fn locate(
    poses: Poses,
    config: &SurveyConfig,
    project_crs: &Crs,
) -> Result<(Vec<View>, Vec<Issue>), SurveyError> {
    let Poses { world, north, poses, mut issues } = poses;
    let world = match (&config.crs, world) {
        (Some(declared), _) => declared.clone(),
        (None, World::Crs(crs)) => crs,
        (None, World::Unsaid) => project_crs.clone(),
    };
    let way = Way::new(&world, north, project_crs)?;
    let offset = DVec3::from(config.offset);
    let n_poses = poses.len();
    let mut views = Vec::with_capacity(n_poses);
    for pose in without_duplicates(poses, &mut issues) {
        match view(&way, pose, offset) {
            Ok(view) => views.push(view),
            Err(issue) => issues.push(issue),
        }
    }
    views.sort_by(|a, b| a.id.cmp(&b.id));
    if let Some(folder) = &config.images {
        let refused: BTreeSet<String> = issues
            .iter()
            .filter_map(|issue| match &issue.subject {
                Subject::View(name) => Some(name.clone()),
                _ => None,
            })
            .collect();
        issues.extend(photos::attach(&mut views, &refused, folder)?);
    }
    issues.sort_by(|a, b| (&a.subject, &a.code).cmp(&(&b.subject, &b.code)));
    if views.is_empty() {
        let first = issues.first().map_or_else(|| "the file lists none".to_owned(), |issue| issue.message.clone());
        let hint = "check the survey's format, CRS and angle convention".into();
        return Err(SurveyError::NothingUsable { path: config.path.clone(), n_poses, first, hint });
    }
    Ok((views, issues))
}

fn view(way: &Way, pose: Pose, offset: DVec3) -> Result<View, Issue> {
    pose.camera.validate().map_err(|e| refused("camera_unusable", &pose.name, e.to_string()))?;
    let located = way.locate(&pose, offset).map_err(|reason| refused("pose_unusable", &pose.name, reason))?;
    let camera_from_map = Rigid::from_rotation_and_centre(located.camera_from_map, located.centre_in_map);
    let view = View { id: ViewId(pose.name), camera: pose.camera, camera_from_map, image: None };
    if view.kind() == ViewKind::Upward {
        let message = format!("it looks {:.1}° off the vertical, at or above the horizon", view.off_nadir_deg());
        let place = located.centre_in_map;
        return Err(refused("view_looks_up", &view.id.0, message)
            .hint("if many views do, the angle sequence, direction or axes are declared wrong")
            .at(place.x, place.y));
    }
    Ok(view)
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
