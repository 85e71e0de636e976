//! What aligning did, as a document and in words.

use std::collections::BTreeSet;
use std::fmt;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::bundle::LensCorrection;
use super::{LEAST_TRACKS, PhotoBlock};
use sizeup_heights::stats::{median, quantile};
use sizeup_survey::View;

/// Photos left alone that are named in words.
const N_NAMED: usize = 5;

/// Distances between where photos show points and where poses put them, pixels of the photo freed of lens distortion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Residuals {
    /// Half of them are smaller.
    pub median_px: f64,
    /// Nine of ten are smaller.
    pub p90_px: f64,
}

impl Residuals {
    pub(super) fn of(lengths_px: &[f64]) -> Self {
        let at = |q: f64| quantile(lengths_px, q).unwrap_or_default();
        Self { median_px: at(0.5), p90_px: at(0.9) }
    }
}

/// Correction of the pose of a photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PhotoCorrection {
    /// Name of the photo's view.
    pub view: String,
    /// Easting, northing and height that were added to its position, metres.
    pub shift_m: [f64; 3],
    /// Angle that it was turned by, degrees.
    pub turn_deg: f64,
    /// Points that it shows.
    pub n_tracks: usize,
    /// Median distance between where it shows them and where its adjusted pose puts them, pixels.
    pub residual_px: f64,
}

/// Correction of a camera that was not calibrated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraCorrection {
    /// Name of its first photo.
    pub view: String,
    /// Photos taken with it.
    pub n_photos: usize,
    /// Focal length as it came, pixels.
    pub given_focal_px: f64,
    /// Focal length as it was found, pixels.
    pub focal_px: f64,
    /// Share that rays 45 degrees off the axis were lengthened by beyond that.
    pub radial: f64,
}

/// A photo that was not moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LeftAlone {
    /// Name of the photo's view.
    pub view: String,
    /// Why the pose was not adjusted.
    pub reason: String,
}

/// Report of an alignment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AlignReport {
    /// Whether the adjusted poses were taken: they are if residuals fall by a fifth. Otherwise the given ones are kept.
    pub is_taken: bool,
    /// Views of the survey.
    pub n_views: usize,
    /// Photos that were adjusted.
    pub n_photos: usize,
    /// Points that three photos or more show.
    pub n_tracks: usize,
    /// Places where photos show them.
    pub n_sightings: usize,
    /// Groups of adjusted photos that share no point: these lie to one another as the given poses say.
    pub n_blocks: usize,
    /// Under the given poses, with points where these fit best.
    pub before: Residuals,
    /// Under the adjusted poses.
    pub after: Residuals,
    /// Mean of the shifts: what the block as a whole was moved by, metres.
    pub common_shift_m: [f64; 3],
    /// Length of the mean turn in the map frame: what the block as a whole was turned by, degrees.
    pub common_turn_deg: f64,
    /// Median length of a photo's shift, metres.
    pub shift_m: f64,
    /// Median angle that a photo was turned by, degrees.
    pub turn_deg: f64,
    /// Cameras that were adjusted; none where they are taken as calibrated.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<CameraCorrection>,
    /// Adjusted photos, in the order of the views.
    pub photos: Vec<PhotoCorrection>,
    /// Photos that were not adjusted, and why.
    pub left_alone: Vec<LeftAlone>,
}

impl PhotoBlock<'_> {
    pub(super) fn report(&self, views: &[View], [before, after]: [Residuals; 2], is_taken: bool) -> AlignReport {
        let counts = self.n_tracks();
        let stations = &self.bundle.stations;
        let free: Vec<usize> = (0..stations.len()).filter(|view| stations[*view].is_free).collect();
        let residuals = self.residuals_by_photo();
        let correction = |view: &usize| PhotoCorrection {
            view: self.views[*view].id.to_string(),
            shift_m: stations[*view].shift_m().to_array(),
            turn_deg: stations[*view].turn_rad().length().to_degrees(),
            n_tracks: counts[*view],
            residual_px: median(&residuals[*view]).unwrap_or_default(),
        };
        let photos: Vec<PhotoCorrection> = free.iter().map(correction).collect();
        let mean_of =
            |of: &dyn Fn(usize) -> DVec3| free.iter().map(|view| of(*view)).sum::<DVec3>() / free.len().max(1) as f64;
        let in_map = |view: usize| stations[view].given.rotation.transpose() * stations[view].turn_rad();
        AlignReport {
            is_taken,
            n_views: views.len(),
            n_photos: photos.len(),
            n_tracks: self.bundle.tracks.len(),
            n_sightings: self.bundle.tracks.iter().map(|track| track.sightings.len()).sum(),
            n_blocks: self.n_blocks(),
            before,
            after,
            common_shift_m: mean_of(&|view| stations[view].shift_m()).to_array(),
            common_turn_deg: mean_of(&in_map).length().to_degrees(),
            shift_m: median_of(&photos, |photo| DVec3::from(photo.shift_m).length()),
            turn_deg: median_of(&photos, |photo| photo.turn_deg),
            cameras: self.cameras(),
            photos,
            left_alone: self.left_alone(views, &counts),
        }
    }

    fn cameras(&self) -> Vec<CameraCorrection> {
        let of = |(i, lens): (usize, &LensCorrection)| {
            let mut taken = self.bundle.stations.iter().zip(&self.views).filter(|(station, _)| station.lens == i);
            let (first, n_others) = (taken.next()?, taken.count());
            let [scale, radial] = lens.total();
            (lens.is_free && self.config.focal_sigma_percent > 0.0).then(|| CameraCorrection {
                view: first.1.id.to_string(),
                n_photos: 1 + n_others,
                given_focal_px: first.0.focal_px.x * (1.0 + scale),
                focal_px: first.0.focal_px.x,
                radial,
            })
        };
        self.bundle.lenses.iter().enumerate().filter_map(of).collect()
    }

    fn n_blocks(&self) -> usize {
        let mut block: Vec<usize> = (0..self.views.len()).collect();
        let mut has_changed = true;
        while has_changed {
            has_changed = false;
            for track in &self.bundle.tracks {
                let least = track.sightings.iter().map(|s| block[s.view]).min().unwrap_or_default();
                for sighting in &track.sightings {
                    has_changed |= block[sighting.view] > least;
                    block[sighting.view] = least;
                }
            }
        }
        let free = block.iter().zip(&self.bundle.stations).filter(|(_, station)| station.is_free);
        free.map(|(block, _)| block).collect::<BTreeSet<_>>().len()
    }

    fn residuals_by_photo(&self) -> Vec<Vec<f64>> {
        let mut residuals = vec![Vec::new(); self.views.len()];
        for track in &self.bundle.tracks {
            for sighting in &track.sightings {
                residuals[sighting.view].extend(self.bundle.off_px(track, sighting).map(glam::DVec2::length));
            }
        }
        residuals
    }

    fn left_alone(&self, views: &[View], counts: &[usize]) -> Vec<LeftAlone> {
        let reason = |view: &View| -> Option<String> {
            let Some(i) = self.views.iter().position(|own| own.id == view.id) else {
                return Some("its photo is not known".to_owned());
            };
            if let Some(problem) = self.unreadable.get(&i) {
                return Some(problem.clone());
            }
            if self.bundle.stations[i].is_free {
                return None;
            }
            Some(match (self.neighbours[i].len(), counts[i]) {
                (0, _) => "no other photo sees the same ground under a fair angle".to_owned(),
                (n, _) => format!("fewer than {LEAST_TRACKS} of its patches are found in its {n} neighbours"),
            })
        };
        let left = views.iter().filter_map(|view| Some(LeftAlone { view: view.id.to_string(), reason: reason(view)? }));
        left.collect()
    }
}

fn median_of(photos: &[PhotoCorrection], of: impl Fn(&PhotoCorrection) -> f64) -> f64 {
    median(&photos.iter().map(of).collect::<Vec<f64>>()).unwrap_or_default()
}

impl fmt::Display for AlignReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |label: &str, value: &dyn fmt::Display| writeln!(f, "  {label:<24}{value}");
        row("photos", &format!("{} of {}", self.n_photos, self.n_views))?;
        row("points", &format!("{}, seen {} times", self.n_tracks, self.n_sightings))?;
        let pixels = |r: &Residuals| format!("{:.2} px (nine of ten below {:.2})", r.median_px, r.p90_px);
        row("residuals before", &pixels(&self.before))?;
        row("residuals after", &pixels(&self.after))?;
        row("photos moved by", &format!("{:.3} m, {:.3} degrees (medians)", self.shift_m, self.turn_deg))?;
        let [x, y, z] = self.common_shift_m;
        row("all of them by", &format!("{x:.3}, {y:.3}, {z:.3} m, {:.3} degrees (means)", self.common_turn_deg))?;
        for camera in &self.cameras {
            let CameraCorrection { given_focal_px, focal_px, radial, n_photos, .. } = camera;
            writeln!(
                f,
                "  camera of {n_photos} photos: focal length {given_focal_px:.1} -> {focal_px:.1} px, radial {radial:+.4}"
            )?;
        }
        if self.n_blocks > 1 {
            writeln!(
                f,
                "  the photos fall into {} groups that share no point: these lie to one another as given",
                self.n_blocks
            )?;
        }
        for left in self.left_alone.iter().take(N_NAMED) {
            writeln!(f, "  left alone: {}: {}", left.view, left.reason)?;
        }
        if self.left_alone.len() > N_NAMED {
            writeln!(f, "    and {} more (--json lists them)", self.left_alone.len() - N_NAMED)?;
        }
        if self.is_taken {
            writeln!(f, "The poses agree with the photos now.")
        } else {
            writeln!(f, "The photos fit no better under other poses: the given ones are kept.")
        }
    }
}
