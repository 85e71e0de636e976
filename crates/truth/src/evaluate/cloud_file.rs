//! Point clouds from files, brought to the CRS of a project.

use std::path::Path;

use super::compare::{CompareError, crs_error};
use super::levels::{LevelAlignment, Stated};
use sizeup_geo::cloud::{self, Cloud};
use sizeup_geo::crs::{Crs, CrsError, Transform, VerticalReference};
use sizeup_results::output::read::{ReadError, height_unit_m};

/// A cloud in the project's plane and, where both say what their levels count from, with the project's levels. A cloud that
/// says nothing of its CRS is taken to be in the project's.
///
/// # Errors
/// [`CompareError`]: unreadable, or nothing leads from its CRS to the project's.
pub fn cloud_in_project(path: &Path, project: &Crs) -> Result<Cloud, CompareError> {
    let (mut cloud, vertical) = read_cloud(path, Some(project), project)?;
    let own = VerticalReference::of(project);
    if let (Some(result), Some(reference)) = (&own, &vertical) {
        let files = ["the project".to_owned(), path.display().to_string()];
        let stated = Stated { result: Some(result), reference: Some(reference), shift_m: None, files };
        let moved = LevelAlignment::of(&stated, project)?.move_points(&mut cloud.points);
        moved.map_err(|source| crs_error(path, source))?;
    }
    Ok(cloud)
}

/// A cloud in the project's CRS, levels in metres, and what these count from.
pub(super) fn read_cloud(
    path: &Path,
    stated: Option<&Crs>,
    project: &Crs,
) -> Result<(Cloud, Option<VerticalReference>), CompareError> {
    let mut cloud = cloud::read(path)?;
    let own = cloud.crs.as_deref().map(own_crs).transpose().map_err(|source| crs_error(path, source))?;
    let from = own.map(|own| own.with_heights_of(stated)).or_else(|| stated.cloned());
    let from = from.ok_or_else(|| ReadError::NoCrs { path: path.to_owned() })?;
    let unit_m = height_unit_m(path, &from)?;
    let transform = Transform::new(&from, project).map_err(|source| crs_error(path, source))?;
    for p in &mut cloud.points {
        (p.x, p.y) = transform.point(p.x, p.y).map_err(|source| crs_error(path, source))?;
        p.z *= unit_m;
    }
    Ok((cloud, VerticalReference::of(&from)))
}

/// The CRS that a cloud states. Codes of heights in old files can be of another kind: the plane is known all the same.
fn own_crs(definition: &str) -> Result<Crs, CrsError> {
    Crs::parse(definition).or_else(|e| match definition.split_once('+') {
        Some((plane, _)) if plane.starts_with("EPSG:") => Crs::parse(plane),
        _ => Err(e),
    })
}
