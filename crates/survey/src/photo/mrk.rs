//! DJI's image log, `*_Timestamp.MRK`: one line per photo of a flight, with the position of the camera by the RTK receiver.
//!
//! ```text
//! 3 <tab> 505369.172143 <tab> [2364] <tab> -339,N <tab> -361,E <tab> 348,V <tab> 51.10917679,Lat <tab> -115.38278248,Lon
//!   <tab> 1368.634,Ellh <tab> 0.012459, 0.010243, 0.020338 <tab> 50,Q
//! ```
//!
//! Number of the photo in its folder; GPS seconds of the week; week; what was added from the antenna's phase centre to the
//! camera, millimetres, north, east, down; latitude and longitude, degrees; height above the ellipsoid, metres; standard
//! deviations north, east, up, metres; state (0 none, 16 single, 34 float, 50 fixed). The position *is* the camera's: the
//! offsets are in it already. Values are known by the name behind their comma, so their order does not matter.
//!
//! Sources, which agree: DJI's manuals of the Zenmuse P1 and the Matrice 4 ("Image Log File", "after compensation"), and
//! DJI's description of the Phantom 4 RTK's columns ("position of the CMOS centre").

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::{RTK_FIXED, RTK_FLOAT};
use crate::{SurveyError, text};
use sizeup_geo::issue::{Issue, Severity, Subject};

/// Farther from the photo's own position, metres, a line belongs to another photo: a receiver without a base station is off
/// by some metres, and photos of a flight are farther apart than a fixed position is off.
const SAME_PLACE_M: f64 = 10.0;
/// Metres of one degree of latitude.
const DEGREE_M: f64 = 111_320.0;

/// One photo's line of a `*_Timestamp.MRK`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Record {
    /// Longitude and latitude, degrees, and height above the ellipsoid, metres, of the camera.
    pub place: DVec3,
    /// Standard deviations north, east, up, metres.
    pub sigma_m: DVec3,
    /// State of the receiver.
    pub state: u32,
}

impl Record {
    /// Whether a base station was used.
    pub(super) fn is_rtk(&self) -> bool {
        (RTK_FLOAT..=RTK_FIXED).contains(&self.state)
    }

    /// Horizontal distance to a longitude and latitude in degrees, metres; good to a percent over some kilometres.
    fn distance_m(&self, (lon_deg, lat_deg): (f64, f64)) -> f64 {
        let north_m = (self.place.y - lat_deg) * DEGREE_M;
        let east_m = (self.place.x - lon_deg) * DEGREE_M * lat_deg.to_radians().cos();
        north_m.hypot(east_m)
    }

    /// Why the line is not that of a photo at a place, in degrees.
    pub(super) fn disagrees_with(&self, place: (f64, f64)) -> Option<String> {
        let off_m = self.distance_m(place);
        (off_m > SAME_PLACE_M).then(|| {
            format!("the line of its number in the image log (MRK) is {off_m:.0} m from its own position: not used")
        })
    }
}

/// A log: its name up to `Timestamp.MRK`, lower case, and its lines by number.
type Log = (String, BTreeMap<u32, Record>);

/// The logs beside some photos.
#[derive(Debug, Default)]
pub(super) struct Logs {
    by_folder: BTreeMap<PathBuf, Vec<Log>>,
    /// Lines that cannot be read.
    pub issues: Vec<Issue>,
}

impl Logs {
    /// Reads the logs in the folders of some photos.
    pub(super) fn beside(photos: &[PathBuf]) -> Result<Self, SurveyError> {
        let mut logs = Self::default();
        for folder in photos.iter().filter_map(|photo| photo.parent()) {
            if !logs.by_folder.contains_key(folder) {
                let found = logs.read_folder(folder)?;
                logs.by_folder.insert(folder.to_owned(), found);
            }
        }
        logs.tell_of_ambiguous(photos);
        Ok(logs)
    }

    /// Names the folders with several logs of which none is a photo's by its name.
    fn tell_of_ambiguous(&mut self, photos: &[PathBuf]) {
        for (folder, logs) in self.by_folder.iter().filter(|(_, logs)| logs.len() > 1) {
            let of_folder = photos.iter().filter(|photo| photo.parent() == Some(folder.as_path()));
            let n_without = of_folder.filter(|photo| log_of(logs, photo).is_none()).count();
            if n_without > 0 {
                let message =
                    format!("{} image logs (MRK), and {n_without} photos that none is named after", logs.len());
                let subject = Subject::Input(folder.display().to_string());
                let issue = Issue::new(Severity::Warning, "mrk_ambiguous", subject, message);
                self.issues.push(issue.hint("keep each flight in a folder of its own, with its log"));
            }
        }
    }

    fn read_folder(&mut self, folder: &Path) -> Result<Vec<Log>, SurveyError> {
        // One photo by its name alone has the empty folder, which is where the program runs.
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let Ok(entries) = fs::read_dir(folder) else { return Ok(Vec::new()) };
        let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
        paths.sort();
        let mut found = Vec::new();
        for path in paths {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_ascii_lowercase();
            if let Some(prefix) = name.strip_suffix("timestamp.mrk").filter(|_| path.is_file()) {
                found.push((prefix.to_owned(), self.read_log(&path)?));
            }
        }
        Ok(found)
    }

    fn read_log(&mut self, path: &Path) -> Result<BTreeMap<u32, Record>, SurveyError> {
        let text = text::read(path)?;
        let mut records = BTreeMap::new();
        let mut broken = Vec::new();
        for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            match record(line) {
                Ok((number, record)) => {
                    records.insert(number, record);
                }
                Err(reason) => broken.push(format!("line {}: {reason}", i + 1)),
            }
        }
        if let Some(first) = broken.first() {
            let message = format!("{} of its lines cannot be read; the first: {first}", broken.len());
            let subject = Subject::Input(path.display().to_string());
            let issue = Issue::new(Severity::Warning, "mrk_unreadable", subject, message);
            self.issues.push(issue.hint("photos without a line keep the position of their own metadata"));
        }
        Ok(records)
    }

    /// The line of a photo.
    pub(super) fn of(&self, photo: &Path) -> Option<&Record> {
        let (_, records) = log_of(self.by_folder.get(photo.parent()?)?, photo)?;
        records.get(&number_of(photo.file_stem()?.to_str()?)?)
    }
}

/// The log whose name a photo's begins with, else the only log in its folder.
fn log_of<'a>(logs: &'a [Log], photo: &Path) -> Option<&'a Log> {
    let stem = photo.file_stem()?.to_str()?.to_ascii_lowercase();
    let named = logs.iter().find(|(prefix, _)| !prefix.is_empty() && stem.starts_with(prefix.as_str()));
    named.or(match logs {
        [only] => Some(only),
        _ => None,
    })
}

/// The issue on positions that come from logs, whose standard deviations (horizontal, vertical) are in metres.
pub(super) fn remark(folder: &Path, sigmas_m: &[(f64, f64)]) -> Option<Issue> {
    let median = |part: fn(&(f64, f64)) -> f64| {
        let mut values: Vec<f64> = sigmas_m.iter().map(part).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let (horizontal_m, vertical_m) = (median(|sigma| sigma.0)?, median(|sigma| sigma.1)?);
    let message = format!(
        "positions of {} photos are the image log's (MRK), standard deviation {horizontal_m:.3} m in the plane and \
         {vertical_m:.3} m in height (medians)",
        sigmas_m.len()
    );
    Some(Issue::new(Severity::Note, "mrk_positions", Subject::Input(folder.display().to_string()), message))
}

/// A photo's number in its name, four digits: `100_0001_0031`, `dji_0031`, `dji_20250502142325_0031_d`.
fn number_of(stem: &str) -> Option<u32> {
    let is_number = |part: &&str| part.len() == 4 && part.bytes().all(|byte| byte.is_ascii_digit());
    stem.rsplit('_').find(is_number)?.parse().ok()
}

/// Number and record of a line.
fn record(line: &str) -> Result<(u32, Record), String> {
    let fields: Vec<&str> = line.split('\t').map(str::trim).collect();
    let number: u32 = fields[0].parse().map_err(|_| format!("{:?}: expected a photo's number", fields[0]))?;
    let named = |name: &str| -> Result<f64, String> {
        let value = fields.iter().find_map(|field| field.strip_suffix(name)?.trim_end().strip_suffix(','));
        let value = value.ok_or_else(|| format!("no value named {name}"))?;
        let number = value.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| format!("{name} is {value:?}: expected a number"))
    };
    let (lat_deg, lon_deg, height_m) = (named("Lat")?, named("Lon")?, named("Ellh")?);
    if lat_deg.abs() > 90.0 || lon_deg.abs() > 180.0 {
        return Err(format!("latitude {lat_deg}, longitude {lon_deg}: expected degrees"));
    }
    let sigmas = fields.iter().find_map(|field| {
        let parts: Option<Vec<f64>> = field.split(',').map(|part| part.trim().parse().ok()).collect();
        <[f64; 3]>::try_from(parts?).ok()
    });
    let sigma_m = DVec3::from(sigmas.ok_or("no three standard deviations")?);
    let state = named("Q")?;
    Ok((number, Record { place: DVec3::new(lon_deg, lat_deg, height_m), sigma_m, state: state as u32 }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line as a drone wrote it.
    const LINE: &str = "3\t505369.172143\t[2364]\t  -339,N\t  -361,E\t   348,V\t51.10917679,Lat\t-115.38278248,Lon\t\
                        1368.634,Ellh\t0.012459, 0.010243, 0.020338\t50,Q";

    #[test]
    fn a_line_of_a_drone_has_its_place_its_deviations_and_its_state() {
        let (number, record) = record(LINE).unwrap();
        assert_eq!((number, record.state), (3, 50));
        // The offsets to the camera are in the position already: nothing is added.
        assert_eq!(record.place, DVec3::new(-115.382_782_48, 51.109_176_79, 1368.634));
        assert_eq!(record.sigma_m, DVec3::new(0.012_459, 0.010_243, 0.020_338));
        assert!(record.is_rtk());
    }

    #[test]
    fn a_broken_line_says_what_is_wrong() {
        for (line, expected) in [
            ("x\t1\t[2]", "photo's number"),
            (&LINE.replace("51.10917679,Lat", "north,Lat"), "Lat is \"north\""),
            (&LINE.replace(",Ellh", ""), "no value named Ellh"),
            (&LINE.replace("51.1", "151.1"), "expected degrees"),
            (&LINE.replace("0.010243, ", ""), "three standard deviations"),
        ] {
            let reason = record(line).unwrap_err();
            assert!(reason.contains(expected), "{reason}");
        }
    }

    #[test]
    fn photos_of_both_naming_schemes_have_their_number() {
        assert_eq!(number_of("100_0001_0031"), Some(31));
        assert_eq!(number_of("dji_0042"), Some(42));
        assert_eq!(number_of("dji_20250502142325_0031_d"), Some(31));
        assert_eq!(number_of("scene"), None);
    }

    #[test]
    fn a_photo_elsewhere_is_not_the_lines() {
        let (_, record) = record(LINE).unwrap();
        assert_eq!(record.disagrees_with((-115.382_782, 51.109_177)), None);
        // A hundredth of a degree of latitude is 1.1 km.
        assert!(record.disagrees_with((-115.382_782, 51.119_177)).unwrap().contains("111"));
    }
}
