//! What poses say of themselves, before there is a project with a CRS to bring them into.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use super::formats::{FileMarks, format_of, read_poses, recognised};
use super::inspect::{LOCAL_WITHIN_M, looks_earth_centred, looks_like_degrees};
use super::poses::{FileHeights, Poses, World};
use super::{Format, SurveyConfig, SurveyError};
use sizeup_geo::crs::{Crs, Geocentric, Transform, enu_from_geocentric};
use sizeup_geo::issue::Issue;

/// Poses as their file has them.
#[derive(Debug, Clone)]
pub struct FirstLook {
    /// The format that was recognised, or declared.
    pub format: Format,
    /// Names of the photos with a pose, in the file's order.
    pub names: Vec<String>,
    /// The world that they are in.
    pub world: PoseWorld,
    /// Vertical datum of their heights.
    pub heights: StatedHeights,
    /// Positions in the file's own world, offset included, in the order of the names.
    pub positions: Vec<DVec3>,
    /// Their longitudes and latitudes, degrees; empty where the file does not say where on the earth it is.
    pub places_deg: Vec<(f64, f64)>,
    /// States of satellite positioning, counted; empty where the format does not tell.
    pub rtk: BTreeMap<String, usize>,
    /// Sources of focal lengths, counted; empty where the format brings complete cameras.
    pub focal: BTreeMap<String, usize>,
    /// Issues of the reader.
    pub issues: Vec<Issue>,
}

/// The world of poses.
#[derive(Debug, Clone, PartialEq)]
pub enum PoseWorld {
    /// A CRS that the file or the settings name.
    Named(Crs),
    /// East, north, up at a place that is known.
    Local,
    /// A world that neither file nor settings name.
    Unsaid(WorldGuess),
}

/// A guess at the positions of an unknown world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WorldGuess {
    /// Eastings and northings of a projected CRS.
    Projected,
    /// Longitudes and latitudes, by their size.
    Degrees,
    /// Metres from the earth's centre.
    EarthCentred,
    /// Metres from a place that is not said.
    Local,
}

/// Heights as a file states them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StatedHeights {
    /// The file does not say.
    Unsaid,
    /// Heights above the ellipsoid.
    Ellipsoidal,
    /// Above the vertical reference of their CRS.
    ByCrs,
    /// Barometric or of unknown reference.
    Unreliable,
}

/// The format of a file or folder, `None` where no reader knows it.
#[must_use]
pub fn recognise(path: &Path) -> Option<Format> {
    recognised(&FileMarks::of(path).ok()?)
}

/// Reads poses without moving them anywhere.
///
/// # Errors
/// [`SurveyError`] when the file as a whole cannot be read.
pub fn first_look(config: &SurveyConfig) -> Result<FirstLook, SurveyError> {
    let format = format_of(config)?;
    let poses = read_poses(config)?;
    let world = world_of(&poses, config);
    let offset = DVec3::from(config.offset);
    let positions: Vec<DVec3> = poses.poses.iter().map(|pose| pose.centre + offset).collect();
    let places_deg = places_deg(&poses, config, &positions).unwrap_or_default();
    let heights = match (poses.heights, &world) {
        (FileHeights::Unreliable, _) => StatedHeights::Unreliable,
        (FileHeights::Ellipsoidal, _) | (_, PoseWorld::Local) => StatedHeights::Ellipsoidal,
        (FileHeights::Unsaid, PoseWorld::Named(crs)) if crs.vertical_epsg().is_some() => StatedHeights::ByCrs,
        (FileHeights::Unsaid, PoseWorld::Named(crs)) if crs.is_ellipsoidal_3d() => StatedHeights::Ellipsoidal,
        (FileHeights::Unsaid, _) => StatedHeights::Unsaid,
    };
    let Poses { poses, issues, counts, .. } = poses;
    let names = poses.into_iter().map(|pose| pose.name).collect();
    let (rtk, focal) = (counts.rtk, counts.focal);
    Ok(FirstLook { format, names, world, heights, positions, places_deg, rtk, focal, issues })
}

fn world_of(poses: &Poses, config: &SurveyConfig) -> PoseWorld {
    match (&config.crs, &poses.world) {
        _ if config.enu_origin.is_some() => PoseWorld::Local,
        (Some(crs), _) | (None, World::Crs(crs)) => PoseWorld::Named(crs.clone()),
        (None, World::Enu(_)) => PoseWorld::Local,
        (None, World::Unsaid | World::Unclear(_)) => PoseWorld::Unsaid(numbers_of(poses, DVec3::from(config.offset))),
    }
}

fn numbers_of(poses: &Poses, offset: DVec3) -> WorldGuess {
    let all = |test: fn(DVec3) -> bool| poses.poses.iter().all(|pose| test(pose.centre + offset));
    let is_near_origin = |centre: DVec3| centre.truncate().length() < LOCAL_WITHIN_M;
    // Local positions may all be small enough for degrees: only fractions of a degree lie together in one flight.
    let is_one_flight = spread(poses) < 1.0;
    if all(looks_like_degrees) && is_one_flight {
        WorldGuess::Degrees
    } else if all(looks_earth_centred) {
        WorldGuess::EarthCentred
    } else if all(is_near_origin) {
        WorldGuess::Local
    } else {
        WorldGuess::Projected
    }
}

/// Size of the box around all positions, in their unit.
fn spread(poses: &Poses) -> f64 {
    let centres = || poses.poses.iter().map(|pose| pose.centre.truncate());
    let (low, high) = (centres().reduce(glam::DVec2::min), centres().reduce(glam::DVec2::max));
    low.zip(high).map_or(0.0, |(low, high)| (high - low).max_element())
}

fn places_deg(poses: &Poses, config: &SurveyConfig, positions: &[DVec3]) -> Option<Vec<(f64, f64)>> {
    let crs = match (&config.crs, &poses.world) {
        _ if config.enu_origin.is_some() => {
            let [lat_deg, lon_deg, height_m] = config.enu_origin?;
            return around(DVec3::new(lon_deg, lat_deg, height_m), positions);
        }
        (Some(crs), _) | (None, World::Crs(crs)) => crs,
        (None, World::Enu(origin)) => return around(*origin, positions),
        (None, World::Unsaid | World::Unclear(_)) => return None,
    };
    if crs.is_geocentric() {
        let geocentric = Geocentric::new().ok()?;
        return Some(positions.iter().filter_map(|p| geocentric.geodetic(*p).ok()).map(|p| (p.x, p.y)).collect());
    }
    let lonlat = Transform::new(crs, &Crs::parse("EPSG:4326").ok()?).ok()?;
    Some(positions.iter().filter_map(|p| lonlat.point(p.x, p.y).ok()).collect())
}

/// Longitudes and latitudes of positions east and north of an origin.
fn around(origin: DVec3, positions: &[DVec3]) -> Option<Vec<(f64, f64)>> {
    let geocentric = Geocentric::new().ok()?;
    let (centre, axes) = (geocentric.geocentric(origin).ok()?, enu_from_geocentric(origin.x, origin.y).transpose());
    let place = |p: &DVec3| geocentric.geodetic(centre + axes * *p).ok().map(|p| (p.x, p.y));
    Some(positions.iter().filter_map(place).collect())
}
