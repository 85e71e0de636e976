//! Other readings of a survey that looks wrong, tried on a sample of its poses.

use glam::DMat3;

use super::angles::{AngleKind, AngleUnit, CameraAxes, Direction, PitchZero, Sequence};
use super::inspect::{Judgement, Site};
use super::locate::locate;
use super::poses::{Pose, Poses};
use super::report::Trial;
use super::{Format, SurveyConfig, csv};
use crate::crs::Crs;

/// Poses that are tried, spread evenly over the file.
const SAMPLE: usize = 300;
/// Readings named in the report.
const N_NAMED: usize = 3;
/// A reading has to be better by this much to be worth naming.
const BETTER_BY: f64 = 0.1;

/// The readings that look clearly better than the declared one, best first.
pub(crate) fn run(
    poses: &Poses,
    config: &SurveyConfig,
    project_crs: &Crs,
    site: Site<'_>,
    declared: Judgement,
) -> Vec<Trial> {
    let unmatched = SurveyConfig { images: None, ..config.clone() };
    let judge = |poses: Poses| -> Option<Judgement> {
        let (survey, _) = locate(poses, &unmatched, project_crs).ok()?;
        Some(Judgement::of(&survey, site))
    };
    let mut found: Vec<(Judgement, String)> = Vec::new();
    for (change, reading) in readings(poses, config) {
        if let Some(judgement) = judge(reading).filter(|j| j.score() > declared.score() + BETTER_BY) {
            found.push((judgement, change));
        }
    }
    // Sound readings first, then by score to the percent; the sort is stable, so the plainer of two equals leads.
    found.sort_by_key(|(judgement, _)| std::cmp::Reverse((judgement.is_sound(), (100.0 * judgement.score()) as u32)));
    found.truncate(N_NAMED);
    found
        .into_iter()
        .map(|(judgement, change)| Trial { change, looks_down: judgement.looks_down, sees_area: judgement.sees_area })
        .collect()
}

/// The reading of a table of angles that looks the other way from the same numbers (Rotterdam's cameras against the
/// usual convention), if it passes the same checks: views look down in both.
pub(crate) fn opposite(config: &SurveyConfig, project_crs: &Crs, site: Site<'_>) -> Vec<Trial> {
    let Some(declared) = config.csv.as_ref().filter(|csv| matches!(csv.angles, AngleKind::Opk | AngleKind::Pok)) else {
        return Vec::new();
    };
    let is_usual = declared.direction != Some(Direction::WorldToCamera);
    let (sequence, direction) = match (declared.angles, is_usual) {
        (_, false) => (None, Direction::CameraToWorld),
        (AngleKind::Opk, true) => (Some(Sequence::Zyx), Direction::WorldToCamera),
        (_, true) => (Some(Sequence::Zxy), Direction::WorldToCamera),
    };
    let other = super::CsvConfig { sequence, direction: Some(direction), ..declared.clone() };
    let own = if declared.angles == AngleKind::Opk { Sequence::Xyz } else { Sequence::Yxz };
    let change = format!("csv.sequence = {}, csv.direction = {}", word(&sequence.unwrap_or(own)), word(&direction));
    let judge = || -> Option<Trial> {
        let poses = sample(&csv::read(&config.path, &other, config.camera.as_ref()).ok()?);
        let unmatched = SurveyConfig { images: None, ..config.clone() };
        let (survey, _) = locate(poses, &unmatched, project_crs).ok()?;
        let judgement = Judgement::of(&survey, site);
        judgement.is_sound().then_some(Trial {
            change,
            looks_down: judgement.looks_down,
            sees_area: judgement.sees_area,
        })
    };
    judge().into_iter().collect()
}

/// Every `n`-th pose, so that at most [`SAMPLE`] are left.
fn sample(poses: &Poses) -> Poses {
    let step = poses.poses.len().div_ceil(SAMPLE).max(1);
    Poses { poses: poses.poses.iter().step_by(step).cloned().collect(), issues: Vec::new(), ..poses.clone_empty() }
}

fn readings(poses: &Poses, config: &SurveyConfig) -> Vec<(String, Poses)> {
    let sampled = sample(poses);
    let changed = |change: &dyn Fn(&mut Pose)| {
        let mut changed = sampled.clone();
        changed.poses.iter_mut().for_each(change);
        changed
    };
    let mut readings = vec![(
        "x and y exchanged".to_owned(),
        changed(&|pose| pose.centre = glam::DVec3::new(pose.centre.y, pose.centre.x, pose.centre.z)),
    )];
    if config.format == Format::Csv || config.csv.is_some() {
        readings.extend(tables(config));
    } else {
        let y_up: DMat3 = CameraAxes::XRightYUp.camera_from_axes();
        readings.push((
            "rotations read in the other direction".to_owned(),
            changed(&|pose| pose.camera_from_world = pose.camera_from_world.transpose()),
        ));
        readings.push((
            "camera axes x right, y up".to_owned(),
            changed(&|pose| pose.camera_from_world = y_up * pose.camera_from_world),
        ));
        readings.push((
            "rotations in the other direction and camera axes x right, y up".to_owned(),
            changed(&|pose| pose.camera_from_world = y_up * pose.camera_from_world.transpose()),
        ));
    }
    readings
}

/// Declarations of a table, one option changed before two are.
fn tables(config: &SurveyConfig) -> Vec<(String, Poses)> {
    let declared = config.csv.clone().unwrap_or_default();
    let mut configs = Vec::new();
    let mut with = |change: String, edit: &dyn Fn(&mut super::CsvConfig)| {
        let mut other = declared.clone();
        edit(&mut other);
        configs.push((change, other));
    };
    for unit in [AngleUnit::Deg, AngleUnit::Gon, AngleUnit::Rad].into_iter().filter(|&u| u != declared.unit) {
        with(format!("csv.unit = {}", word(&unit)), &|csv| csv.unit = unit);
    }
    let has_three = matches!(declared.angles, AngleKind::Opk | AngleKind::Pok | AngleKind::Ypr);
    if has_three {
        let columns = declared.angle_columns();
        for angles in [AngleKind::Opk, AngleKind::Pok, AngleKind::Ypr].into_iter().filter(|&a| a != declared.angles) {
            with(format!("csv.angles = {}", word(&angles)), &|csv| {
                (csv.angles, csv.angle_columns, csv.sequence) = (angles, columns.clone(), None);
            });
        }
    }
    for pitch_zero in [PitchZero::Horizon, PitchZero::Nadir] {
        if declared.angles == AngleKind::Ypr && pitch_zero != declared.pitch_zero {
            with(format!("csv.pitch_zero = {}", word(&pitch_zero)), &|csv| csv.pitch_zero = pitch_zero);
        }
    }
    for axes in [CameraAxes::XRightYDown, CameraAxes::XRightYUp] {
        with(format!("csv.camera_axes = {}", word(&axes)), &|csv| csv.camera_axes = Some(axes));
        for direction in [Direction::CameraToWorld, Direction::WorldToCamera] {
            with(format!("csv.direction = {}, csv.camera_axes = {}", word(&direction), word(&axes)), &|csv| {
                (csv.direction, csv.camera_axes) = (Some(direction), Some(axes));
            });
        }
    }
    if has_three {
        for sequence in Sequence::ALL {
            for direction in [Direction::CameraToWorld, Direction::WorldToCamera] {
                with(format!("csv.sequence = {}, csv.direction = {}", word(&sequence), word(&direction)), &|csv| {
                    (csv.sequence, csv.direction) = (Some(sequence), Some(direction));
                });
            }
        }
    }
    let read = |csv: &super::CsvConfig| csv::read(&config.path, csv, config.camera.as_ref()).ok();
    configs.iter().filter_map(|(change, csv)| Some((change.clone(), sample(&read(csv)?)))).collect()
}

/// An option's value as the configuration writes it.
fn word(option: &impl serde::Serialize) -> String {
    serde_json::to_string(option).unwrap_or_default()
}
