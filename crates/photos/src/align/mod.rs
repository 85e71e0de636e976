//! Poses from the drone as they are, brought to agree with the photos: guided matching and bundle adjustment.
//!
//! It is no structure from motion: poses that are nearly right say where to look.
//!
//! 1. Corners are spread over every photo ([`patches`]), at a quarter of the size first.
//! 2. Each is looked for in the photo's neighbours, between the ground and the highest roof, as far beside that line as poses may be off
//!    ([`matching`]); what three photos show is a point ([`tracks`]).
//! 3. Poses and points are adjusted together, with the given poses as observations ([`bundle`]).
//! 4. Sightings that do not fit go, and steps 2 and 3 are done at half and at full size, now near where the points are.
//!
//! Where poses are known to be near already, it begins at half size, near the lines.
//!
//! Cameras stay as they are given, or, where they are not calibrated, focal length and radial distortion are found with the poses
//! ([`lenses`]).
//!
//! What the photos cannot tell, position and turn of the block as a whole, stays the mean of the given poses.
//!
//! Whether that is worth while is told beforehand by a few photos ([`misfit_px`]).

mod bundle;
mod error;
mod lenses;
mod matching;
mod patches;
mod reduced;
mod report;
mod tracks;

pub use error::AlignError;
pub use report::{AlignReport, CameraCorrection, LeftAlone, PhotoCorrection, Residuals};

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::bundle::{Bundle, LensSigmas, Moving, Sigmas, Station, Track};
use self::tracks::TrackSearch;
use crate::prior::Neighbours;
use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::ViewId;
use sizeup_survey::View;

/// Fewest photos worth adjusting.
const LEAST_PHOTOS: usize = 3;
/// Fewest points that a photo is moved by.
const LEAST_TRACKS: usize = 12;
/// Fewest photos that show a point.
const LEAST_SIGHTINGS: usize = 3;
/// Sizes that are gone through, as divisors of the largest.
const DIVISORS: [u32; 3] = [4, 2, 1];
/// Expected error of a sighting, pixels at the size it was found at.
const SIGHTING_PX: f64 = 0.3;
/// Residuals over the median from which a sighting is none, and the least such residual, pixels at the size it was found at.
const OUTLIER_PER_MEDIAN: f64 = 4.0;
const OUTLIER_PX: f64 = 1.0;
/// Radial distortion that is expected where none is known, a share at 45 degrees off the axis: wide lenses of drones have up to 0.1.
const RADIAL_SIGMA: f64 = 0.1;
/// By which factor the median residual has to fall for the adjusted poses to be taken.
const BETTER: f64 = 0.8;

/// Photos that [`misfit_px`] is found from, and by how much they are reduced.
const N_SAMPLED: usize = 8;
const SAMPLE_DIVISOR: u32 = 2;
/// A median misfit up to which patches are looked for at half size at once, pixels at the largest size, and how far beside their lines:
/// so many misfits, and so many pixels besides. A photo that is farther off than that is left alone.
const NEAR_PX: f64 = 2.0;
const WITHIN_MISFITS: f64 = 8.0;
const WITHIN_PX: f64 = 2.0;

/// When a run aligns its poses before it uses them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AlignWhen {
    /// Where photos are matched with each other, for depth or to refine roofs, and a few of them lie more than `max_misfit_px` off.
    #[default]
    Auto,
    /// Align poses in every run.
    Always,
    /// Use the poses as they are given.
    Never,
}

/// Median distance between where a few photos show points and where the poses put them, from which `when = "auto"` aligns, pixels
/// of a photo reduced to `long_side_px`. A limit of 1 pixel missed poses that are off by 0.05 m and 0.05°.
pub const MAX_MISFIT_PX: f64 = 0.4;
/// Most neighbours that a photo's patches are looked for in.
const N_NEIGHBOURS: usize = 8;
/// Patches along each side of a photo.
const PATCHES_PER_SIDE: usize = 14;
/// Least correlation of a patch that is found.
const MIN_SCORE: f32 = 0.75;
/// How far below the lowest ground in a photo points may be, metres.
const BELOW_GROUND_M: f64 = 5.0;
/// Highest roof above the highest ground in a photo, metres. Above 0.
pub(crate) const MAX_HEIGHT_M: f64 = 60.0;

/// How poses are brought to agree with the photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("x-expert" = true))]
pub struct AlignConfig {
    /// When `sizeup run` does it by itself; `sizeup survey align` always does.
    #[schemars(extend("x-expert" = false))]
    pub when: AlignWhen,
    /// Longer side of the photos at the last size, pixels, 320 to 8192; never more than the photo has.
    pub long_side_px: u32,
    /// Expected error of the given positions along each axis, metres, 0.001 to 10.
    #[schemars(extend("x-expert" = false))]
    pub position_sigma_m: f64,
    /// Expected error of the given rotations about each axis, degrees, 0.001 to 5.
    #[schemars(extend("x-expert" = false))]
    pub angle_sigma_deg: f64,
    /// Expected error of the given focal lengths, percent, 0 to 20. 0: cameras are calibrated, and stay as they are. Above 0 focal
    /// length and radial distortion are found too, one of each for all photos of a camera.
    pub focal_sigma_percent: f64,
}

impl Default for AlignConfig {
    fn default() -> Self {
        Self {
            when: AlignWhen::default(),
            long_side_px: 1600,
            position_sigma_m: 0.3,
            angle_sigma_deg: 0.5,
            focal_sigma_percent: 0.0,
        }
    }
}

impl AlignConfig {
    fn check(&self) -> Result<(), AlignError> {
        let in_range = [
            ("long_side_px", (320..=8192).contains(&self.long_side_px), "320 to 8192"),
            ("position_sigma_m", (0.001..=10.0).contains(&self.position_sigma_m), "0.001 to 10 m"),
            ("angle_sigma_deg", (0.001..=5.0).contains(&self.angle_sigma_deg), "0.001 to 5 degrees"),
            ("focal_sigma_percent", (0.0..=20.0).contains(&self.focal_sigma_percent), "0 to 20 percent"),
        ];
        match in_range.iter().find(|(_, is_fine, _)| !is_fine) {
            None => Ok(()),
            Some((field, _, expected)) => Err(AlignError::Config { field, expected }),
        }
    }

    fn sigmas(&self, sighting_px: f64) -> Sigmas {
        let scale = 0.01 * self.focal_sigma_percent;
        Sigmas {
            sighting_px,
            position_m: self.position_sigma_m,
            angle_rad: self.angle_sigma_deg.to_radians(),
            lens: (scale > 0.0).then_some(LensSigmas { scale, radial: RADIAL_SIGMA }),
        }
    }
}

/// A survey whose poses agree with its photos.
#[derive(Debug, Clone)]
pub struct Aligned {
    /// All views in their order; those that were left alone as they came.
    pub views: Vec<View>,
    /// Report of what was done.
    pub report: AlignReport,
}

/// Brings the poses of a survey to agree with its photos. `misfit_px`: what [`misfit_px`] told, which spares a wide search where it is
/// small. `tell` hears of sizes that are done, and of how many there are.
///
/// # Errors
/// [`AlignError`]: nothing that could be aligned. A photo that cannot is left as it came, and the report says why.
pub fn align(
    views: &[View],
    terrain: &Terrain,
    config: &AlignConfig,
    misfit_px: Option<f64>,
    tell: &dyn Fn(usize, usize),
) -> Result<Aligned, AlignError> {
    let (taking_part, neighbours) = overlapping(views, terrain, config)?;
    let mut block = PhotoBlock::new(&taking_part, &neighbours, config);
    // A lens that is off by much moves patches by more than poses do.
    let near_px = misfit_px.filter(|misfit_px| *misfit_px <= NEAR_PX && config.focal_sigma_percent == 0.0);
    block.within_px = near_px.map(|misfit_px| WITHIN_MISFITS * misfit_px + WITHIN_PX);
    let divisors = if near_px.is_some() { &DIVISORS[1..] } else { &DIVISORS };
    for (i, &divisor) in divisors.iter().enumerate() {
        tell(i, divisors.len());
        block.pass(divisor, terrain)?;
    }
    tell(divisors.len(), divisors.len());
    Ok(block.into_aligned(views))
}

/// Distance of photos from where the poses put them: the median over points that a few photos and their neighbours show, each at the place
/// that fits best, in pixels of a photo reduced to `long_side_px`. `None` where too few points are found to tell.
///
/// # Errors
/// As [`align`].
pub fn misfit_px(views: &[View], terrain: &Terrain, config: &AlignConfig) -> Result<Option<f64>, AlignError> {
    let (taking_part, neighbours) = overlapping(views, terrain, config)?;
    let with_neighbours: Vec<usize> = (0..taking_part.len()).filter(|view| !neighbours[*view].is_empty()).collect();
    let n = with_neighbours.len().min(N_SAMPLED);
    let sample: Vec<usize> = (0..n).map(|i| with_neighbours[(2 * i + 1) * with_neighbours.len() / (2 * n)]).collect();
    let mut block = PhotoBlock::new(&taking_part, &neighbours, config);
    let size = block.at(SAMPLE_DIVISOR);
    block.bundle.tracks =
        block.search(&size).first(&sample, terrain).into_iter().filter_map(Result::ok).flatten().collect();
    block.bundle.adjust(Moving::Points);
    let is_enough = block.bundle.tracks.len() >= LEAST_TRACKS;
    let per_px = f64::from(config.long_side_px.min(block.largest_px())) / f64::from(block.largest_px());
    Ok(block.bundle.median_px().filter(|_| is_enough).map(|median| median * per_px))
}

/// The views with a photo, and the neighbours of each.
fn overlapping(
    views: &[View],
    terrain: &Terrain,
    config: &AlignConfig,
) -> Result<(Vec<View>, Vec<Vec<usize>>), AlignError> {
    config.check()?;
    if terrain.range().is_none() {
        return Err(AlignError::NoTerrain);
    }
    let taking_part: Vec<View> = views.iter().filter(|view| view.image.is_some()).cloned().collect();
    if taking_part.len() < LEAST_PHOTOS {
        return Err(AlignError::FewPhotos { n_photos: taking_part.len(), n_views: views.len() });
    }
    let neighbours = neighbours(&taking_part, terrain, N_NEIGHBOURS);
    if neighbours.iter().all(Vec::is_empty) {
        return Err(AlignError::NoOverlap { n_photos: taking_part.len() });
    }
    Ok((taking_part, neighbours))
}

/// The neighbours of each view, by index.
fn neighbours(views: &[View], terrain: &Terrain, n: usize) -> Vec<Vec<usize>> {
    let index: BTreeMap<&ViewId, usize> = views.iter().enumerate().map(|(i, view)| (&view.id, i)).collect();
    let survey = Neighbours::new(views.to_vec(), terrain);
    views.iter().map(|view| survey.choose(view, n).iter().map(|other| index[&other.id]).collect()).collect()
}

/// The photos that take part, as far as they are adjusted.
struct PhotoBlock<'a> {
    /// With their cameras as they are now.
    views: Vec<View>,
    neighbours: &'a [Vec<usize>],
    config: &'a AlignConfig,
    bundle: Bundle,
    /// How far beside their lines patches are looked for at most, pixels at `long_side_px`.
    within_px: Option<f64>,
    /// Why a photo could not be read.
    unreadable: BTreeMap<usize, String>,
}

/// A size of the photos.
#[derive(Debug, Clone, Copy)]
struct Size {
    long_side_px: u32,
    /// Pixels of the largest photo per pixel of this size.
    per_px: f64,
}

impl<'a> PhotoBlock<'a> {
    fn new(views: &[View], neighbours: &'a [Vec<usize>], config: &'a AlignConfig) -> Self {
        let (lens_of, lenses) = lenses::of(views);
        let station = |(view, lens): (&View, usize)| Station {
            focal_px: glam::DVec2::new(view.camera.fx_px, view.camera.fy_px),
            given: view.camera_from_map,
            pose: view.camera_from_map,
            is_free: true,
            lens,
        };
        let stations = views.iter().zip(lens_of).map(station).collect();
        let bundle = Bundle { stations, lenses, tracks: Vec::new(), sigmas: config.sigmas(1.0) };
        Self { views: views.to_vec(), neighbours, config, bundle, within_px: None, unreadable: BTreeMap::new() }
    }

    /// The longer side of the largest photo.
    fn largest_px(&self) -> u32 {
        self.views.iter().map(|view| view.camera.width_px.max(view.camera.height_px)).max().unwrap_or(1)
    }

    /// Gets ready for photos of one size.
    fn at(&mut self, divisor: u32) -> Size {
        let largest = self.largest_px();
        let long_side_px = self.config.long_side_px.min(largest) / divisor;
        let size = Size { long_side_px, per_px: f64::from(largest) / f64::from(long_side_px) };
        self.bundle.sigmas = self.config.sigmas(SIGHTING_PX * size.per_px);
        size
    }

    fn search(&self, size: &Size) -> TrackSearch<'_> {
        let (stations, sigmas) = (&self.bundle.stations, self.bundle.sigmas);
        let largest_px = f64::from(self.config.long_side_px.min(self.largest_px()));
        let within_px = self.within_px.map(|px| px * f64::from(size.long_side_px) / largest_px);
        TrackSearch::new(&self.views, stations, self.neighbours, sigmas, size.long_side_px).within(within_px)
    }

    /// Matches and adjusts at one size.
    fn pass(&mut self, divisor: u32, terrain: &Terrain) -> Result<(), AlignError> {
        let size = self.at(divisor);
        let search = self.search(&size);
        let tracks = if self.bundle.tracks.is_empty() {
            let mut tracks = Vec::new();
            let all: Vec<usize> = (0..self.views.len()).collect();
            for (view, found) in search.first(&all, terrain).into_iter().enumerate() {
                match found {
                    Ok(found) => tracks.extend(found),
                    Err(problem) => drop(self.unreadable.insert(view, problem.to_string())),
                }
            }
            tracks
        } else {
            search.again(&self.bundle.tracks)
        };
        self.bundle.tracks = tracks;
        self.hold_back();
        if self.bundle.tracks.is_empty() {
            return Err(AlignError::NothingMatches {
                n_photos: self.views.len(),
                n_unreadable: self.unreadable.len(),
                first: self.unreadable.values().next().cloned(),
            });
        }
        tracing::debug!("align: {} points at {} px", self.bundle.tracks.len(), size.long_side_px);
        self.bundle.adjust(Moving::PointsAndPoses);
        lenses::apply(&mut self.views, &mut self.bundle);
        self.throw_out(OUTLIER_PX * size.per_px);
        self.hold_back();
        Ok(())
    }

    /// Leaves out sightings that do not fit.
    fn throw_out(&mut self, least_px: f64) {
        let limit_px = self.bundle.median_px().map_or(0.0, |median| OUTLIER_PER_MEDIAN * median).max(least_px);
        let fits = |bundle: &Bundle, track: &Track| -> Option<Track> {
            let is_fine =
                |i: &usize| bundle.off_px(track, &track.sightings[*i]).is_some_and(|off| off.length() <= limit_px);
            // Without the photo that it was chosen in, nothing is known of where else it is.
            let kept: Vec<usize> = (0..track.sightings.len()).filter(is_fine).collect();
            (kept.first() == Some(&0))
                .then(|| Track { sightings: kept.iter().map(|i| track.sightings[*i]).collect(), ..track.clone() })
        };
        self.bundle.tracks = self.bundle.tracks.iter().filter_map(|track| fits(&self.bundle, track)).collect();
    }

    /// Photos with too few points stay as they are and say nothing, until all others have enough.
    fn hold_back(&mut self) {
        for station in &mut self.bundle.stations {
            station.is_free = true;
        }
        loop {
            self.bundle.tracks.retain(|track| track.sightings.len() >= LEAST_SIGHTINGS);
            let counts = self.n_tracks();
            let is_short = |view: usize| counts[view] < LEAST_TRACKS;
            let mut has_changed = false;
            for (view, station) in self.bundle.stations.iter_mut().enumerate() {
                has_changed |= station.is_free && is_short(view);
                station.is_free &= !is_short(view);
                if !station.is_free {
                    station.pose = station.given;
                }
            }
            if !has_changed {
                return;
            }
            let stations = &self.bundle.stations;
            self.bundle.tracks.retain(|track| stations[track.sightings[0].view].is_free);
            for track in &mut self.bundle.tracks {
                track.sightings.retain(|sighting| stations[sighting.view].is_free);
            }
        }
    }

    /// Number of points that each photo shows.
    fn n_tracks(&self) -> Vec<usize> {
        let mut counts = vec![0; self.views.len()];
        for sighting in self.bundle.tracks.iter().flat_map(|track| &track.sightings) {
            counts[sighting.view] += 1;
        }
        counts
    }

    fn into_aligned(self, views: &[View]) -> Aligned {
        let mut given = self.bundle.clone();
        given.stations.iter_mut().for_each(|station| station.pose = station.given);
        lenses::take_back(&mut given);
        given.adjust(Moving::Points);
        let residuals = [&given, &self.bundle].map(|bundle| Residuals::of(&bundle.residuals_px()));
        let is_better = residuals[1].median_px < BETTER * residuals[0].median_px;
        let report = self.report(views, residuals, is_better);
        let adjusted: BTreeMap<&ViewId, (&View, &Station)> =
            self.views.iter().map(|view| &view.id).zip(self.views.iter().zip(&self.bundle.stations)).collect();
        let moved = |view: &View| match adjusted.get(&view.id) {
            Some((own, station)) if is_better => {
                View { camera: own.camera.clone(), camera_from_map: station.pose, ..view.clone() }
            }
            _ => view.clone(),
        };
        Aligned { views: views.iter().map(moved).collect(), report }
    }
}
