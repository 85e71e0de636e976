//! What single photos say of themselves, whether or not a survey can use them: size, place, heights, positioning.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::header::PhotoHeader;
use super::{direction, place, rtk_word, xmp};

/// Facts in one photo's header.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PhotoFacts {
    /// Path of the photo's file.
    pub path: PathBuf,
    /// Columns and rows; `None` where the header cannot be read.
    pub size_px: Option<(u32, u32)>,
    /// Longitude and latitude, degrees.
    pub place_deg: Option<(f64, f64)>,
    /// Height of the camera above whatever the drone counts from, metres.
    pub absolute_m: Option<f64>,
    /// The same above the place of take-off, metres.
    pub relative_m: Option<f64>,
    /// Whether the direction of view is told.
    pub has_angles: bool,
    /// State of the satellite positioning: fixed, float, single; `None` without base station or mention of one.
    pub rtk: Option<&'static str>,
    /// Stated standard deviations of the position, metres: horizontal, vertical.
    pub sigma_m: Option<(f64, f64)>,
    /// Day on which it was taken, `YYYY-MM-DD`, by the camera's clock.
    pub day: Option<String>,
    /// Why the header cannot be read.
    pub fault: Option<String>,
}

/// Reads the headers of photos, in parallel; one that cannot be read says so.
#[must_use]
pub fn photo_facts(photos: &[PathBuf]) -> Vec<PhotoFacts> {
    photos.par_iter().map(|path| facts(path)).collect()
}

/// Returns the last day on which one of the photos was taken, `YYYY-MM-DD`; `None` where no photo has a date.
#[must_use]
pub fn flight_day<'a>(photos: impl IntoIterator<Item = &'a PathBuf>) -> Option<String> {
    let photos: Vec<&PathBuf> = photos.into_iter().collect();
    photos.par_iter().filter_map(|path| PhotoHeader::read(path).ok()?.day()).max()
}

fn facts(path: &Path) -> PhotoFacts {
    let of = |fault| PhotoFacts { path: path.to_owned(), fault, ..PhotoFacts::default() };
    let header = match PhotoHeader::read(path) {
        Ok(header) => header,
        Err(fault) => return of(Some(fault)),
    };
    let size_px = Some(header.size_px);
    let tags = match header.xmp.as_deref().map(|packet| xmp::tags(packet, path)).transpose() {
        Ok(tags) => tags.unwrap_or_default(),
        Err(error) => return PhotoFacts { size_px, ..of(Some(error.to_string())) },
    };
    let number = |name: &str| tags.number(name).ok().flatten();
    let horizontal_m = number("RtkStdLon").zip(number("RtkStdLat")).map(|(lon, lat)| lon.hypot(lat));
    PhotoFacts {
        size_px,
        place_deg: place(&header, &tags).ok(),
        absolute_m: number("AbsoluteAltitude").or(header.altitude_m()),
        relative_m: number("RelativeAltitude"),
        has_angles: direction::of(&header, &tags).is_ok(),
        rtk: number("RtkFlag").map(|flag| rtk_word(flag as u32)).filter(|word| *word != "none"),
        day: header.day(),
        sigma_m: horizontal_m.zip(number("RtkStdHgt")),
        ..of(None)
    }
}
