//! How the drone moved while photos were exposed: smear of the ground, and lines read one after the other.
//!
//! By what DJI's XMP (`FlightXSpeed`, `FlightYSpeed`, `FlightZSpeed`, m/s; `ShutterType`; `RelativeAltitude`, m) and EXIF
//! (`ExposureTime`, s) say. Old drones write neither: of them nothing is said.

use glam::DVec3;

use super::header::PhotoHeader;
use super::xmp;
use exif::Tag;
use sizeup_geo::issue::{Issue, Severity, Subject};

/// Smear of the ground that photogrammetry's advice allows is 1.5 pixels; from here on it is told.
const SMEARED_PX: f64 = 2.0;
/// Slower than this nothing is told of lines, m/s: drones drift so while they hover.
const FLYING_M_S: f64 = 1.0;
/// Flatter views have no middle on the ground, degrees below the horizon.
const LOOKS_DOWN_DEG: f64 = 10.0;

/// The motion of one photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    /// Speed over ground, metres per second.
    speed_m_s: f64,
    /// Smear of the ground in the photo's middle, pixels, where the exposure and the height are known.
    smear_px: Option<f64>,
    /// Whether the lines of the photo were exposed one after the other.
    is_line_by_line: bool,
}

impl Motion {
    /// From a photo's header, if it tells its speed. `pitch_deg` is the gimbal's, −90 straight down.
    pub(super) fn of(header: &PhotoHeader, tags: &xmp::Tags, focal_px: f64, pitch_deg: f64) -> Option<Self> {
        let part = |name: &str| tags.number(name).ok().flatten();
        let speed_m_s =
            DVec3::new(part("FlightXSpeed")?, part("FlightYSpeed")?, part("FlightZSpeed").unwrap_or(0.0)).length();
        let distance_m = part("RelativeAltitude")
            .filter(|above_m| *above_m > 0.0 && pitch_deg < -LOOKS_DOWN_DEG)
            .map(|above_m| above_m / -pitch_deg.to_radians().sin());
        let exposure_s = header.number(Tag::ExposureTime).filter(|seconds| *seconds > 0.0);
        let smear_px = distance_m.zip(exposure_s).map(|(metres, seconds)| speed_m_s * seconds * focal_px / metres);
        let is_line_by_line = tags.text("ShutterType").is_some_and(|kind| kind.eq_ignore_ascii_case("electronic"));
        Some(Self { speed_m_s, smear_px, is_line_by_line })
    }
}

/// Issues of a flight's motions; `n_photos` with and without.
pub(super) fn remark(motions: &[Motion], n_photos: usize) -> Vec<Issue> {
    let about = || Subject::Input("survey".to_owned());
    let smeared: Vec<f64> = motions.iter().filter_map(|motion| motion.smear_px).filter(|px| *px > SMEARED_PX).collect();
    let most_px = smeared.iter().copied().fold(0.0, f64::max);
    let smear = (!smeared.is_empty()).then(|| {
        let message = format!(
            "{} of {n_photos} photos moved on by more than {SMEARED_PX} of their pixels while they were exposed, {most_px:.1} at most, by their \
             speed and exposure",
            smeared.len()
        );
        Issue::new(Severity::Warning, "motion_blur", about(), message)
            .hint("fly slower or expose shorter; blur within a pixel of the reduced photos does no harm (`photo_blurred` names what does)")
    });
    let by_lines = motions.iter().filter(|motion| motion.is_line_by_line && motion.speed_m_s > FLYING_M_S);
    let (n, fastest_m_s) = by_lines.fold((0, 0.0_f64), |(n, most), motion| (n + 1, most.max(motion.speed_m_s)));
    let lines = (n > 0).then(|| {
        let message = format!(
            "{n} of {n_photos} photos were taken with an electronic shutter at up to {fastest_m_s:.1} m/s: their lines were exposed one after \
             the other, {:.2} m further on for each hundredth of a second that reading takes",
            fastest_m_s / 100.0
        );
        Issue::new(Severity::Note, "rolling_shutter", about(), message)
            .hint("poses by a photogrammetry that corrects the rolling shutter are better than the drone's; a mechanical shutter has none")
    });
    smear.into_iter().chain(lines).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(speed_m_s: f64, smear_px: Option<f64>, is_line_by_line: bool) -> Motion {
        Motion { speed_m_s, smear_px, is_line_by_line }
    }

    #[test]
    fn smear_and_lines_are_told_once_for_a_flight_and_only_where_there_are_any() {
        let calm = [motion(0.2, Some(0.1), true), motion(5.0, None, false), motion(5.0, Some(1.9), false)];
        assert_eq!(remark(&calm, 4), []);
        let fast = [motion(12.0, Some(3.4), true), motion(10.0, Some(2.8), true), motion(8.0, Some(1.0), true)];
        let told = remark(&fast, 3);
        let codes: Vec<&str> = told.iter().map(|issue| issue.code.as_str()).collect();
        assert_eq!(codes, ["motion_blur", "rolling_shutter"]);
        assert!(told[0].message.starts_with("2 of 3 photos") && told[0].message.contains("3.4 at most"), "{told:?}");
        assert!(told[1].message.contains("up to 12.0 m/s") && told[1].message.contains("0.12 m"), "{told:?}");
    }
}
