//! Tracks: patches with the places where other photos show them, found at one size of the photos after the other.

use std::collections::BTreeMap;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::bundle::{Sighting, Sigmas, Station, Track};
use super::matching::{PhotoPair, PosedImage, Where};
use super::patches::{corner_near, corners};
use super::{BELOW_GROUND_M, MAX_HEIGHT_M, MIN_SCORE, PATCHES_PER_SIDE};
use crate::prior::{Album, PriorError};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::camera::Camera;
use sizeup_heights::picture::Picture;
use sizeup_survey::View;

/// Fewest photos that show a point: with two, a wrong match along the line of heights looks like a right one.
const LEAST_SIGHTINGS: usize = 3;
/// Expected errors within which patches are looked for, standard deviations.
const N_SIGMAS: f64 = 3.0;
/// Distance within which patches are looked for where their point is known, pixels.
const REACH_PX: usize = 5;
/// Greatest move of a patch to the clearest corner of the next size, pixels.
const CORNER_REACH_PX: usize = 3;
/// Share of its clearance above the ground within which a camera sees nothing from above.
const BESIDE_CAMERA_SHARE: f64 = 0.1;
/// Memory for photos of one size, bytes.
const ALBUM_BYTES: usize = 512 << 20;
/// Pixels per side of a photo for which the ground is looked up.
const GROUND_SIDE: u32 = 6;

/// Pictures that tracks are looked for in, at one size.
pub(super) struct TrackSearch<'a> {
    views: &'a [View],
    stations: &'a [Station],
    neighbours: &'a [Vec<usize>],
    sigmas: Sigmas,
    album: Album,
    /// How far beside their lines patches are looked for at most, pixels; absent: as far as the poses may be off.
    within_px: Option<f64>,
}

impl<'a> TrackSearch<'a> {
    pub fn new(
        views: &'a [View],
        stations: &'a [Station],
        neighbours: &'a [Vec<usize>],
        sigmas: Sigmas,
        long_side_px: u32,
    ) -> Self {
        Self { views, stations, neighbours, sigmas, album: Album::new(long_side_px, ALBUM_BYTES), within_px: None }
    }

    /// The same, with patches looked for no farther beside their lines than so many pixels.
    pub fn within(self, within_px: Option<f64>) -> Self {
        Self { within_px, ..self }
    }

    /// Tracks of patches of some photos, anywhere between the ground and the highest roof, or why a photo has none.
    pub fn first(&self, of: &[usize], terrain: &Terrain) -> Vec<Result<Vec<Track>, PriorError>> {
        let of_view = |&view: &usize| {
            let picture = self.album.picture(&self.views[view])?;
            let Some(heights_m) = self.heights_m(view, terrain) else { return Ok(Vec::new()) };
            let patches = corners(picture.grey(), PATCHES_PER_SIDE);
            Ok(self.tracks(view, &picture, &patches, |_, other, camera| {
                let beside_px = self.expected_px(view, other, camera, heights_m[0]);
                Where::Between { heights_m, beside_px }
            }))
        };
        of.par_iter().map(of_view).collect()
    }

    /// The same points, looked for again in photos of this size and in all neighbours.
    pub fn again(&self, tracks: &[Track]) -> Vec<Track> {
        let mut by_view: BTreeMap<usize, Vec<&Track>> = BTreeMap::new();
        for track in tracks {
            by_view.entry(track.sightings[0].view).or_default().push(track);
        }
        let of_view = |(view, tracks): (usize, Vec<&Track>)| -> Vec<Track> {
            let Ok(picture) = self.album.picture(&self.views[view]) else { return Vec::new() };
            let (patches, heights_m): (Vec<DVec2>, Vec<f64>) = tracks
                .iter()
                .filter_map(|track| {
                    let place = picture.camera().project(track.sightings[0].ray.extend(1.0))?;
                    Some((corner_near(picture.grey(), place, CORNER_REACH_PX)?, track.point.z))
                })
                .unzip();
            self.tracks(view, &picture, &patches, |patch, _, _| Where::Around {
                height_m: heights_m[patch],
                reach_px: REACH_PX,
            })
        };
        by_view.into_par_iter().flat_map_iter(of_view).collect()
    }

    fn tracks(
        &self,
        view: usize,
        picture: &Picture,
        patches: &[DVec2],
        place: impl Fn(usize, usize, &Camera) -> Where,
    ) -> Vec<Track> {
        let sighting = |view: usize, camera: &Camera, pixel: DVec2| {
            Some(Sighting { view, ray: camera.unproject(pixel)?.truncate() })
        };
        let mut sightings: Vec<Vec<Sighting>> =
            patches.iter().map(|patch| sighting(view, picture.camera(), *patch).into_iter().collect()).collect();
        for &other in &self.neighbours[view] {
            let Ok(there) = self.album.picture(&self.views[other]) else { continue };
            let pair = PhotoPair {
                here: PosedImage { grey: picture.grey(), camera: picture.camera(), pose: &self.stations[view].pose },
                there: PosedImage { grey: there.grey(), camera: there.camera(), pose: &self.stations[other].pose },
                min_score: MIN_SCORE,
            };
            for (i, patch) in patches.iter().enumerate() {
                let found = pair.find(*patch, place(i, other, there.camera()));
                sightings[i].extend(found.and_then(|pixel| sighting(other, there.camera(), pixel)));
            }
        }
        let enough = sightings.into_iter().filter(|sightings| sightings.len() >= LEAST_SIGHTINGS);
        enough.filter_map(|sightings| Some(Track { point: self.meeting_point(&sightings)?, sightings })).collect()
    }

    /// The point nearest to all rays.
    fn meeting_point(&self, sightings: &[Sighting]) -> Option<DVec3> {
        let (mut square, mut right) = (DMat3::ZERO, DVec3::ZERO);
        let origin = self.stations[sightings[0].view].pose.centre();
        for sighting in sightings {
            let pose = &self.stations[sighting.view].pose;
            let ray = (pose.rotation.transpose() * sighting.ray.extend(1.0)).normalize();
            let across = DMat3::IDENTITY - DMat3::from_cols(ray * ray.x, ray * ray.y, ray * ray.z);
            square += across;
            right += across * (pose.centre() - origin);
        }
        let point = origin + square.inverse() * right;
        let is_before = |s: &Sighting| self.stations[s.view].pose.point(point).z > 0.0;
        (point.is_finite() && sightings.iter().all(is_before)).then_some(point)
    }

    /// From below the lowest ground in sight to above the highest; `None` for a photo that does not look down.
    fn heights_m(&self, view: usize, terrain: &Terrain) -> Option<[f64; 2]> {
        let (lowest, highest) = terrain.range()?;
        let (view, pose) = (&self.views[view], &self.stations[view].pose);
        let centre = pose.centre();
        let mut range: Option<[f64; 2]> = None;
        for i in 0..GROUND_SIDE * GROUND_SIDE {
            let at = |i: u32, n: u32| (f64::from(i) + 0.5) / f64::from(GROUND_SIDE) * f64::from(n);
            let pixel =
                DVec2::new(at(i % GROUND_SIDE, view.camera.width_px), at(i / GROUND_SIDE, view.camera.height_px));
            let Some(ray) = view.camera.unproject(pixel).map(|ray| pose.rotation.transpose() * ray) else { continue };
            // Both ends of the terrain's range, since the ray may meet the ground anywhere between.
            for z_m in [lowest, highest] {
                let place = centre + (z_m - centre.z) / ray.z * ray;
                if ray.z < 0.0 && z_m < centre.z {
                    let ground = terrain.height_at(place.x, place.y).unwrap_or(z_m);
                    range = Some(range.map_or([ground; 2], |[low, high]| [low.min(ground), high.max(ground)]));
                }
            }
        }
        let [low, high] = range?;
        let to_m = (high + MAX_HEIGHT_M).min(centre.z - BESIDE_CAMERA_SHARE * (centre.z - high));
        let from_m = low - BELOW_GROUND_M;
        (to_m > from_m).then_some([from_m, to_m])
    }

    /// Distance of a patch from its line by the expected errors of two poses, pixels of the other photo.
    fn expected_px(&self, view: usize, other: usize, camera: &Camera, ground_m: f64) -> f64 {
        let of = |view: usize| {
            let above_m = (self.stations[view].pose.centre().z - ground_m).max(1.0);
            self.sigmas.angle_rad.hypot(self.sigmas.position_m / above_m)
        };
        let expected_px = N_SIGMAS * camera.fx_px.max(camera.fy_px) * of(view).hypot(of(other));
        self.within_px.map_or(expected_px, |within_px| within_px.min(expected_px))
    }
}
