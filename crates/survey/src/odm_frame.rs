//! Which frame the shots of a `reconstruction.json` are in: east, north, up at `reference_lla` (`OpenSfM`), or a grid
//! minus an offset, to which ODM rewrites it in place. Nothing in the file says so; what gives it away:
//!
//! - ODM leaves `reconstruction.topocentric.json` beside the rewritten file, and the grid in `odm_georeferencing`;
//! - ODM's reference is a whole metre of that grid;
//! - the shots' GPS positions stay east, north, up, and so are turned against rewritten centres by the convergence:
//!
//! ```text
//! β = atan2(Σ q × p, Σ q · p),   σ_β² = Σ |p − R(β) q|² / (2n − 3) / Σ |q|²
//! ```
//!
//! `p`: centres, `q`: GPS positions as a frame predicts them, both minus their means, metres. Source: ODM's stage
//! `opensfm` and `OpenSfM`'s `export_geocoords`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use super::error::Place;
use super::poses::{Poses, World};
use super::{SurveyConfig, SurveyError, text};
use sizeup_geo::crs::{Crs, Geocentric, Transform, enu_from_geocentric};
use sizeup_geo::issue::{Issue, Severity, Subject};

/// A shot's GPS position (east, north, up at the reference) and its centre as the file has it, metres.
pub(super) struct Fix {
    pub gps: DVec3,
    pub centre: DVec3,
}

/// A grid and the offset that was subtracted.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OdmGrid {
    pub crs: Crs,
    pub offset: DVec3,
}

/// ODM keeps offsets in whole metres; `reference_lla` repeats them to better than this, metres.
const WHOLE_METRE_WITHIN_M: f64 = 2e-3;
/// Frames whose positions differ by less than this over the block need not be told apart, metres: a pixel of a photo
/// from 400 m.
const SAME_WITHIN_M: f64 = 0.1;
/// Standard deviations at which a turn is taken for one.
const SURE_SIGMAS: f64 = 5.0;
/// A frame contradicts its GPS where the turn between them moves the block's rim by more than this, metres.
const CONTRADICTS_M: f64 = 0.5;

const WAY_OUT: &str = "put ODM's folder odm_georeferencing (proj.txt, coords.txt) beside the folder opensfm; or say it: `crs` and \
                       `offset` for a grid, `enu_origin` for east, north, up";

/// Sets the poses' world, adding the offset of a grid to them.
pub(super) fn place(
    poses: &mut Poses,
    path: &Path,
    reference: Option<DVec3>,
    fixes: &[Fix],
    config: &SurveyConfig,
) -> Result<(), SurveyError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let is_rewritten = path.file_name().is_some_and(|name| name == "reconstruction.json")
        && folder.join("reconstruction.topocentric.json").is_file();
    let is_topocentric = path.file_name().is_some_and(|name| name == "reconstruction.topocentric.json");
    let beside = if is_topocentric { None } else { OdmGrid::beside(folder)? };
    if config.enu_origin.is_some() {
        return Ok(());
    }
    let is_named = beside.is_some();
    let grid = match (beside, &config.crs, reference) {
        (Some(grid), _, _) => Some(grid),
        (None, Some(declared), Some(reference)) => OdmGrid::of_reference(declared, reference),
        (None, None, Some(reference)) if !is_topocentric => {
            OdmGrid::of_reference(&Crs::parse(&Crs::utm_zone(reference.x, reference.y))?, reference)
        }
        _ => None,
    };
    if let Some(grid) = grid.as_ref().filter(|_| is_rewritten || config.crs.is_some()) {
        grid.take(poses);
        return Ok(());
    }
    if is_rewritten {
        let message = "ODM rewrote it to a grid (reconstruction.topocentric.json lies beside it) that nothing names";
        return Err(SurveyError::malformed(path, Place::Whole, message).hint(WAY_OUT));
    }
    let Some(reference) = reference else { return Ok(()) };
    poses.world = World::Enu(reference);
    match grid {
        None => refuse_if_turned(path, GpsFit::of(fixes.iter().map(|fix| (fix.centre.truncate(), fix.gps.truncate())))),
        Some(grid) => choose(poses, path, reference, fixes, &grid, is_named),
    }
}

/// Verdict of the GPS positions.
enum GpsVerdict {
    Topocentric,
    Gridded(GpsFit),
    Unsure(String),
}

/// Between east, north, up and a grid, by the GPS positions; a grid that ODM named goes before saying nothing.
fn choose(
    poses: &mut Poses,
    path: &Path,
    reference: DVec3,
    fixes: &[Fix],
    grid: &OdmGrid,
    is_named: bool,
) -> Result<(), SurveyError> {
    let apart_m = grid.distance_from_topocentric_m(poses, reference)?;
    if apart_m < SAME_WITHIN_M && !is_named {
        return Ok(());
    }
    let topocentric = GpsFit::of(fixes.iter().map(|fix| (fix.centre.truncate(), fix.gps.truncate())));
    let predicted = grid.of_enu(reference, fixes.iter().map(|fix| fix.gps))?;
    let gridded = GpsFit::of(fixes.iter().map(|fix| fix.centre.truncate()).zip(predicted));
    let reason = match verdict(topocentric, gridded) {
        GpsVerdict::Topocentric => return Ok(()),
        GpsVerdict::Gridded(fit) => {
            format!("its GPS positions are turned by {fit} against east, north, up, and not against the grid")
        }
        GpsVerdict::Unsure(_) if is_named => "ODM's folder odm_georeferencing names it".to_owned(),
        GpsVerdict::Unsure(reason) => {
            let message = format!(
                "it may be east, north, up, or rewritten by ODM to {}, up to {apart_m:.1} m apart: {reason}",
                grid.crs
            );
            return Err(SurveyError::malformed(path, Place::Whole, message).hint(WAY_OUT));
        }
    };
    grid.take(poses);
    let (x, y) = (grid.offset.x, grid.offset.y);
    let message = format!("read as rewritten by ODM to {} minus ({x}, {y}): {reason}", grid.crs);
    let subject = Subject::Input(path.display().to_string());
    poses.issues.push(
        Issue::new(Severity::Warning, "frame_found", subject, message)
            .hint("reconstruction.topocentric.json beside it, or `crs` and `offset`, would leave no doubt"),
    );
    Ok(())
}

fn verdict(topocentric: Option<GpsFit>, gridded: Option<GpsFit>) -> GpsVerdict {
    let (Some(topocentric), Some(gridded)) = (topocentric, gridded) else {
        return GpsVerdict::Unsure("its shots have no GPS positions to tell by".to_owned());
    };
    let is_sure = (topocentric.turn_rad - gridded.turn_rad).abs() > SURE_SIGMAS * topocentric.sigma_rad;
    let is_clearly_less = |a: GpsFit, b: GpsFit| is_sure && a.turn_rad.abs() < b.turn_rad.abs() / 3.0;
    if is_clearly_less(gridded, topocentric) {
        GpsVerdict::Gridded(topocentric)
    } else if is_clearly_less(topocentric, gridded) {
        GpsVerdict::Topocentric
    } else {
        GpsVerdict::Unsure(format!(
            "its GPS positions are turned by {topocentric} against the one and by {gridded} against the other"
        ))
    }
}

fn refuse_if_turned(path: &Path, fit: Option<GpsFit>) -> Result<(), SurveyError> {
    let Some(fit) = fit else { return Ok(()) };
    let moved_m = fit.turn_rad.abs() * fit.radius_m;
    if fit.turn_rad.abs() <= SURE_SIGMAS * fit.sigma_rad || moved_m <= CONTRADICTS_M {
        return Ok(());
    }
    let message = format!(
        "its GPS positions are turned by {fit} against its centres ({moved_m:.1} m at the rim): it is not east, north, up \
         at its reference_lla"
    );
    Err(SurveyError::malformed(path, Place::Whole, message).hint(WAY_OUT))
}

/// Fit of GPS positions on centres.
#[derive(Debug, Clone, Copy)]
struct GpsFit {
    turn_rad: f64,
    sigma_rad: f64,
    radius_m: f64,
}

impl std::fmt::Display for GpsFit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.2}° ± {:.2}°", self.turn_rad.to_degrees(), self.sigma_rad.to_degrees())
    }
}

impl GpsFit {
    /// The fit of pairs of centre and GPS position; `None` where they are too few.
    fn of(pairs: impl IntoIterator<Item = (DVec2, DVec2)>) -> Option<Self> {
        const MIN_FIXES: usize = 4;
        let pairs: Vec<(DVec2, DVec2)> = pairs.into_iter().collect();
        if pairs.len() < MIN_FIXES {
            return None;
        }
        let n = pairs.len() as f64;
        let mean = |of: fn(&(DVec2, DVec2)) -> DVec2| pairs.iter().map(of).sum::<DVec2>() / n;
        let (mean_p, mean_q) = (mean(|pair| pair.0), mean(|pair| pair.1));
        let centred = || pairs.iter().map(|&(p, q)| (p - mean_p, q - mean_q));
        let cross: f64 = centred().map(|(p, q)| q.perp_dot(p)).sum();
        let dot: f64 = centred().map(|(p, q)| q.dot(p)).sum();
        let turn_rad = cross.atan2(dot);
        let rotation = DVec2::from_angle(turn_rad);
        let squares: f64 = centred().map(|(p, q)| (p - rotation.rotate(q)).length_squared()).sum();
        let spread: f64 = centred().map(|(_, q)| q.length_squared()).sum();
        let radius_m = centred().map(|(p, _)| p.length()).fold(0.0, f64::max);
        let sigma_rad = (squares / (2.0 * n - 3.0) / spread).sqrt();
        (turn_rad.is_finite() && sigma_rad.is_finite()).then_some(Self { turn_rad, sigma_rad, radius_m })
    }
}

impl OdmGrid {
    /// The files that ODM wrote into `odm_georeferencing`, looked for in the folder, in it, and beside it.
    pub(super) fn beside(folder: &Path) -> Result<Option<Self>, SurveyError> {
        let name = "odm_georeferencing";
        let places = [folder.join("..").join(name), folder.join(name), folder.to_owned()];
        let is_complete = |place: &&PathBuf| place.join("proj.txt").is_file() && place.join("coords.txt").is_file();
        let Some(found) = places.iter().find(is_complete) else { return Ok(None) };
        Ok(Some(Self { crs: odm_crs(found)?, offset: odm_offset(&found.join("coords.txt"))? }))
    }

    /// The grid whose whole metre the reference is, if it is one.
    fn of_reference(crs: &Crs, reference: DVec3) -> Option<Self> {
        if !crs.is_projected() {
            return None;
        }
        let (x, y) = Transform::new(&Crs::parse("EPSG:4326").ok()?, crs).ok()?.point(reference.x, reference.y).ok()?;
        let is_whole = |value: f64| (value - value.round()).abs() < WHOLE_METRE_WITHIN_M;
        (is_whole(x) && is_whole(y)).then(|| Self { crs: crs.clone(), offset: DVec3::new(x.round(), y.round(), 0.0) })
    }

    fn take(&self, poses: &mut Poses) {
        poses.world = World::Crs(self.crs.clone());
        for pose in &mut poses.poses {
            pose.centre += self.offset;
        }
    }

    /// Places of positions in this grid, minus the offset, east, north, up at the reference.
    fn of_enu(&self, reference: DVec3, places: impl Iterator<Item = DVec3>) -> Result<Vec<DVec2>, SurveyError> {
        let geocentric = Geocentric::new()?;
        let grid_from_lonlat = Transform::new(&Crs::parse("EPSG:4326")?, &self.crs)?;
        let axes = enu_from_geocentric(reference.x, reference.y).transpose();
        let origin = geocentric.geocentric(reference)?;
        places
            .map(|place| {
                let geodetic = geocentric.geodetic(origin + axes * place)?;
                let (x, y) = grid_from_lonlat.point(geodetic.x, geodetic.y)?;
                Ok(DVec2::new(x, y) - self.offset.truncate())
            })
            .collect()
    }

    /// Distance between the places that the two frames give the outermost of the centres.
    fn distance_from_topocentric_m(&self, poses: &Poses, reference: DVec3) -> Result<f64, SurveyError> {
        let radius_m = poses.poses.iter().map(|pose| pose.centre.truncate().length()).fold(0.0, f64::max);
        let rim = [DVec3::ZERO, radius_m * DVec3::X, radius_m * DVec3::Y];
        let moved = self.of_enu(reference, rim.into_iter())?;
        Ok(moved.iter().zip(rim).map(|(grid, enu)| grid.distance(enu.truncate())).fold(0.0, f64::max))
    }
}

/// The second line of `coords.txt`: easting and northing.
fn odm_offset(path: &Path) -> Result<DVec3, SurveyError> {
    let text = text::read(path)?;
    let numbers: Vec<f64> =
        text.lines().nth(1).unwrap_or_default().split_ascii_whitespace().filter_map(|n| n.parse().ok()).collect();
    match numbers[..] {
        [easting, northing, ..] => Ok(DVec3::new(easting, northing, 0.0)),
        _ => Err(SurveyError::malformed(path, Place::Line(2), "expected easting and northing of the offset")),
    }
}

/// The CRS of `proj.txt`.
pub(super) fn odm_crs(folder: &Path) -> Result<Crs, SurveyError> {
    let path: PathBuf = folder.join("proj.txt");
    let text = text::read(&path)?;
    Ok(Crs::parse(&by_code(text.trim()).unwrap_or_else(|| text.trim().to_owned()))?)
}

/// The code of a UTM zone of WGS 84, which ODM writes out as PROJ does: results name a CRS that has one, and other
/// programs know it by that.
fn by_code(definition: &str) -> Option<String> {
    let words: BTreeSet<&str> = definition.split_ascii_whitespace().collect();
    let zone: u32 = words.iter().find_map(|word| word.strip_prefix("+zone=")?.parse().ok())?;
    let is_south = words.contains("+south");
    let known = ["+proj=utm", "+datum=WGS84", "+ellps=WGS84", "+units=m", "+no_defs", "+type=crs", "+south"];
    let is_plain = words.iter().all(|word| known.contains(word) || word.starts_with("+zone="));
    let is_utm = ["+proj=utm", "+datum=WGS84", "+units=m"].iter().all(|word| words.contains(word));
    let base = if is_south { 32_700 } else { 32_600 };
    (is_plain && is_utm && (1..=60).contains(&zone)).then(|| format!("EPSG:{}", base + zone))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_utm_zone_of_wgs_84_has_its_code_and_nothing_else_has() {
        let code = |definition: &str| by_code(definition);
        let north = "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs +type=crs";
        assert_eq!(code(north).as_deref(), Some("EPSG:32632"));
        assert_eq!(code("+proj=utm +zone=23 +south +datum=WGS84 +units=m +no_defs").as_deref(), Some("EPSG:32723"));
        for other in [
            "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs",
            "+proj=utm +zone=32 +datum=WGS84 +units=us-ft +no_defs",
            "+proj=utm +zone=32 +datum=WGS84 +towgs84=1,2,3 +units=m",
            "+proj=utm +zone=61 +datum=WGS84 +units=m",
            "EPSG:25832",
        ] {
            assert_eq!(code(other), None, "{other}");
        }
        let [coded, written] = [code(north).unwrap(), north.to_owned()].map(|text| Crs::parse(&text).unwrap());
        let way = Transform::new(&coded, &written).unwrap().point(565_000.0, 5_932_000.0).unwrap();
        assert!((way.0 - 565_000.0).abs() < 1e-6 && (way.1 - 5_932_000.0).abs() < 1e-6, "{way:?}");
    }
}
