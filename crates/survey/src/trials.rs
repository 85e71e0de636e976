//! Other readings of a survey that looks wrong, tried on a sample of its poses.

use glam::{DMat3, DVec3};

use super::angles::{AngleKind, AngleUnit, CameraAxes, Direction, PitchZero, Sequence};
use super::inspect::{Judgement, Site, looks_earth_centred, looks_like_degrees};
use super::locate::locate;
use super::poses::{Pose, Poses, World};
use super::report::{Spread, Trial};
use super::{Format, HeightConfig, SurveyConfig, VerticalDatum, csv};
use sizeup_geo::crs::Crs;

/// Poses that are tried, spread evenly over the file.
pub(crate) const SAMPLE: usize = 300;
/// Readings named in the report.
const N_NAMED: usize = 3;
/// A reading has to be better by this much to be worth naming.
const BETTER_BY: f64 = 0.1;

/// Another reading: what to declare for it, the poses it gives, and how they reach the project.
struct AlternativeReading {
    change: String,
    poses: Poses,
    config: SurveyConfig,
}

/// The readings that look clearly better than the declared one, best first.
pub(crate) fn run(
    poses: &Poses,
    config: &SurveyConfig,
    project_crs: &Crs,
    site: Site<'_>,
    declared: Judgement,
) -> Vec<Trial> {
    let unmatched = SurveyConfig { images: None, ..config.clone() };
    let mut candidates = rotations(poses, &unmatched);
    candidates.extend(systems(poses, &unmatched, project_crs));
    candidates.extend(takeoff(poses, &unmatched, project_crs, site));
    let mut found: Vec<(Judgement, String)> = Vec::new();
    for AlternativeReading { change, poses, config } in candidates {
        let Ok((survey, _)) = locate(poses, &config, project_crs) else { continue };
        let judgement = Judgement::of(&survey, site);
        if judgement.score() > declared.score() + BETTER_BY {
            found.push((judgement, change));
        }
    }
    // Sound readings first, then by score to the percent; the sort is stable, so the plainer of two equals leads.
    found.sort_by_key(|(judgement, _)| std::cmp::Reverse((judgement.is_sound(), (100.0 * judgement.score()) as u32)));
    found.truncate(N_NAMED);
    found.into_iter().map(|(judgement, change)| trial(change, judgement)).collect()
}

fn trial(change: String, judgement: Judgement) -> Trial {
    let Judgement { looks_down, sees_area, above_ground, .. } = judgement;
    Trial { change, looks_down, sees_area, above_ground }
}

/// Other CRSs of poses whose CRS nobody said: degrees, earth-centred, or the neighbours of the project's UTM zone.
fn systems(poses: &Poses, config: &SurveyConfig, project_crs: &Crs) -> Vec<AlternativeReading> {
    if config.crs.is_some() || config.enu_origin.is_some() || poses.world != World::Unsaid {
        return Vec::new();
    }
    let is_on = |test: fn(DVec3) -> bool| poses.poses.iter().all(|pose| test(pose.centre));
    let mut codes = Vec::new();
    codes.extend(is_on(looks_like_degrees).then_some(4979));
    codes.extend(is_on(looks_earth_centred).then_some(4978));
    codes.extend(project_crs.horizontal_epsg().map(neighbour_zones).unwrap_or_default());
    let candidate = |code: u32| {
        let crs = Crs::parse(&format!("EPSG:{code}")).ok()?;
        let mut config = SurveyConfig { crs: Some(crs), ..config.clone() };
        // Which height system they are in is another question.
        config.height.keep_ellipsoidal = config.height.geoid_offset.is_none();
        Some(AlternativeReading { change: format!("crs = \"EPSG:{code}\""), poses: poses.clone(), config })
    };
    codes.into_iter().filter_map(candidate).collect()
}

/// The zones west and east of a UTM zone on WGS 84 or ETRS89.
fn neighbour_zones(epsg: u32) -> Vec<u32> {
    const FAMILIES: [std::ops::RangeInclusive<u32>; 3] = [32601..=32660, 32701..=32760, 25828..=25838];
    let family = FAMILIES.iter().find(|family| family.contains(&epsg));
    let in_family = |zone: &u32| family.is_some_and(|family| family.contains(zone));
    [epsg - 1, epsg + 1].into_iter().filter(in_family).collect()
}

/// Heights above the take-off, tried on the ground below the cameras.
fn takeoff(poses: &Poses, config: &SurveyConfig, project_crs: &Crs, site: Site<'_>) -> Option<AlternativeReading> {
    let terrain = site.terrain?;
    let (survey, _) = locate(poses.clone(), config, project_crs).ok()?;
    let centres = survey.views.iter().map(|view| view.camera_from_map.centre());
    let ground_m = Spread::of(centres.filter_map(|centre| terrain.height_at(centre.x, centre.y)))?.median.round();
    let height =
        HeightConfig { reference: Some(VerticalDatum::AboveTakeoff), base: Some(ground_m), ..HeightConfig::default() };
    let change = format!("height.reference = \"above_takeoff\", height.base = {ground_m}");
    Some(AlternativeReading { change, poses: poses.clone(), config: SurveyConfig { height, ..config.clone() } })
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
        let poses = sample(&csv::read_table(&config.path, &other, config.camera.as_ref()).ok()?);
        let unmatched = SurveyConfig { images: None, ..config.clone() };
        let (survey, _) = locate(poses, &unmatched, project_crs).ok()?;
        let judgement = Judgement::of(&survey, site);
        judgement.is_sound().then(|| trial(change, judgement))
    };
    judge().into_iter().collect()
}

/// Every `n`-th pose, so that at most [`SAMPLE`] are left.
pub(crate) fn sample(poses: &Poses) -> Poses {
    let step = poses.poses.len().div_ceil(SAMPLE).max(1);
    Poses { poses: poses.poses.iter().step_by(step).cloned().collect(), issues: Vec::new(), ..poses.clone_empty() }
}

/// Other meanings of the same numbers.
fn rotations(poses: &Poses, config: &SurveyConfig) -> Vec<AlternativeReading> {
    let changed = |change: &str, edit: &dyn Fn(&mut Pose)| {
        let mut poses = poses.clone();
        poses.poses.iter_mut().for_each(edit);
        AlternativeReading { change: change.to_owned(), poses, config: config.clone() }
    };
    let swapped = |pose: &mut Pose| pose.centre = DVec3::new(pose.centre.y, pose.centre.x, pose.centre.z);
    let is_table = config.format == Format::Csv || config.csv.is_some();
    let exchanged = is_table.then(|| columns_exchanged(config)).flatten();
    let mut candidates = vec![changed(exchanged.as_deref().unwrap_or("x and y exchanged"), &swapped)];
    if is_table {
        let with_config = |(change, poses)| AlternativeReading { change, poses, config: config.clone() };
        candidates.extend(tables(config).into_iter().map(with_config));
        return candidates;
    }
    let y_up: DMat3 = CameraAxes::XRightYUp.camera_from_axes();
    candidates.extend([
        changed("rotations read in the other direction", &|pose| {
            pose.camera_from_world = pose.camera_from_world.transpose();
        }),
        changed("camera axes x right, y up", &|pose| pose.camera_from_world = y_up * pose.camera_from_world),
        changed("rotations in the other direction and camera axes x right, y up", &|pose| {
            pose.camera_from_world = y_up * pose.camera_from_world.transpose();
        }),
    ]);
    candidates
}

/// The settings that exchange the columns of easting and northing; `None` where the table has none of these names.
fn columns_exchanged(config: &SurveyConfig) -> Option<String> {
    let mut csv = config.csv.clone().unwrap_or_default();
    std::mem::swap(&mut csv.x, &mut csv.y);
    csv::read_table(&config.path, &csv, config.camera.as_ref()).ok()?;
    Some(format!("csv.x = {}, csv.y = {}", word(&csv.x), word(&csv.y)))
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
    let read = |csv: &super::CsvConfig| csv::read_table(&config.path, csv, config.camera.as_ref()).ok();
    configs.iter().filter_map(|(change, csv)| Some((change.clone(), sample(&read(csv)?)))).collect()
}

/// An option's value as the configuration writes it.
fn word(option: &impl serde::Serialize) -> String {
    serde_json::to_string(option).unwrap_or_default()
}
