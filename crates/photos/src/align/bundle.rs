//! Bundle adjustment: the poses, close to the given ones, under which photos agree on where points are.
//!
//! With `Rⱼ`, `Cⱼ` the rotation and centre of photo `j`, `Xᵢ` a point, `mᵢⱼ` where the photo shows it (ray coordinates, free of
//! lens distortion), `f` the focal length in pixels of the photo and `π(x, y, z) = (x, y) / z`:
//!
//! ```text
//! least  Σᵢⱼ ρ(|f (mᵢⱼ − π(Rⱼ (Xᵢ − Cⱼ)))|) / s²  +  Σⱼ |Cⱼ − Cⱼ⁰|² / σ_C² + |ωⱼ|² / σ_ω²        ωⱼ = log(Rⱼ Rⱼ⁰ᵀ)
//! ρ(r) = c² ln(1 + r²/c²)                                                                     Cauchy
//! ```
//!
//! by Levenberg–Marquardt with weights `1/(1 + r²/c²)`. Points are eliminated (Schur's complement); what is left, six unknowns per
//! photo, is solved in [`super::reduced`]. The given poses hold what photos cannot tell: where the block lies as a whole.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::reduced::{Block, Reduced, SIX, Six};
use sizeup_heights::frames::{Cam, Map, Rigid};
use sizeup_heights::stats::median;

/// Most steps for one width of the robust loss.
const MAX_STEPS: usize = 15;
/// Share of the cost below which a step's gain ends the iteration.
const CONVERGED: f64 = 1e-6;
/// First damping, and the factors by which it falls and rises.
const DAMPING: f64 = 1e-4;
const DAMPING_FALLS: f64 = 0.1;
const DAMPING_RISES: f64 = 10.0;
/// Damping at which no step helps any more.
const MAX_DAMPING: f64 = 1e8;
/// Width of the loss over the median residual: 1.48 medians are a standard deviation.
const WIDTH_PER_MEDIAN: f64 = 3.0;
/// Widths of the loss that are tried, each by the residuals under the one before.
const MAX_WIDTHS: usize = 6;

/// A photo as the adjustment sees it.
#[derive(Debug, Clone)]
pub(super) struct Station {
    /// Focal lengths, pixels of the photo.
    pub focal_px: DVec2,
    /// The pose as it came.
    pub given: Rigid<Cam, Map>,
    /// The pose as it is now.
    pub pose: Rigid<Cam, Map>,
    /// Whether the pose may change.
    pub is_free: bool,
}

impl Station {
    /// Turn since the given pose, a rotation vector in the camera's frame, radians.
    pub fn turn_rad(&self) -> DVec3 {
        DQuat::from_mat3(&(self.pose.rotation * self.given.rotation.transpose())).normalize().to_scaled_axis()
    }

    /// Shift since the given pose, map frame, metres.
    pub fn shift_m(&self) -> DVec3 {
        self.pose.centre() - self.given.centre()
    }

    /// The pose after a small turn in the camera's frame and a shift in the map's.
    fn moved(&self, by: &Six) -> Rigid<Cam, Map> {
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(by[0], by[1], by[2])));
        let centre = self.pose.centre() + DVec3::new(by[3], by[4], by[5]);
        Rigid::from_rotation_and_centre(turn * self.pose.rotation, centre)
    }
}

/// Where a photo shows a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    /// The photo, by index.
    pub view: usize,
    /// Coordinates of the ray `(x, y, 1)`, camera frame.
    pub ray: DVec2,
}

/// A point and the photos that show it.
#[derive(Debug, Clone)]
pub(super) struct Track {
    /// Map frame, metres.
    pub point: DVec3,
    /// The photo that it was chosen in comes first.
    pub sightings: Vec<Sighting>,
}

/// How far things are expected to be off.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sigmas {
    /// Of a sighting, pixels of the photo.
    pub sighting_px: f64,
    /// Of a given position along each axis, metres.
    pub position_m: f64,
    /// Of a given rotation about each axis, radians.
    pub angle_rad: f64,
}

/// What may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moving {
    Points,
    PointsAndPoses,
}

/// Photos and points to be made to agree.
#[derive(Debug, Clone)]
pub(super) struct Bundle {
    pub stations: Vec<Station>,
    pub tracks: Vec<Track>,
    pub sigmas: Sigmas,
}

/// A sighting's residual, pixels, and how it changes.
struct Linear {
    off_px: DVec2,
    /// By turn and shift of the photo: one row per axis of the image.
    by_pose: [Six; 2],
    /// By the point.
    by_point: [DVec3; 2],
}

/// A point taken out of the equations.
struct Eliminated {
    inverse: DMat3,
    pull: DVec3,
    /// Photo, and mixed terms of its six unknowns with the point.
    mixed: Vec<(usize, [DVec3; SIX])>,
}

impl Bundle {
    /// Adjusts with a loss that narrows as residuals fall.
    pub fn adjust(&mut self, moving: Moving) {
        let mut width_px = f64::INFINITY;
        for _ in 0..MAX_WIDTHS {
            let by_median = self.median_px().map_or(0.0, |median| WIDTH_PER_MEDIAN * median);
            let next = by_median.max(self.sigmas.sighting_px);
            if next > 0.9 * width_px {
                return;
            }
            width_px = next;
            self.iterate(width_px, moving);
        }
    }

    /// Levenberg–Marquardt under one width of the loss.
    fn iterate(&mut self, width_px: f64, moving: Moving) {
        let mut damping = DAMPING;
        let mut cost = self.cost(width_px);
        for _ in 0..MAX_STEPS {
            let Some((next, next_cost)) = self.better(cost, width_px, moving, &mut damping) else { return };
            let gain = cost - next_cost;
            (*self, cost) = (next, next_cost);
            damping = (damping * DAMPING_FALLS).max(1e-12);
            if gain <= CONVERGED * cost {
                return;
            }
        }
    }

    /// The first step that lowers the cost, as damping rises.
    fn better(&self, cost: f64, width_px: f64, moving: Moving, damping: &mut f64) -> Option<(Self, f64)> {
        while *damping < MAX_DAMPING {
            let next = self.stepped(width_px, moving, *damping);
            let next_cost = next.cost(width_px);
            if next_cost < cost {
                return Some((next, next_cost));
            }
            *damping *= DAMPING_RISES;
        }
        None
    }

    fn stepped(&self, width_px: f64, moving: Moving, damping: f64) -> Self {
        let mut reduced = Reduced::new(self.stations.len());
        let poses_move = moving == Moving::PointsAndPoses;
        if poses_move {
            self.add_given(&mut reduced);
        }
        let eliminated: Vec<Option<Eliminated>> = self
            .tracks
            .iter()
            .map(|track| self.eliminate(track, width_px, damping, poses_move, &mut reduced))
            .collect();
        let steps = if poses_move { reduced.solve(damping) } else { vec![[0.0; SIX]; self.stations.len()] };
        let mut next = self.clone();
        for (track, eliminated) in next.tracks.iter_mut().zip(&eliminated) {
            if let Some(point) = eliminated {
                let of_poses: DVec3 = point.mixed.iter().map(|(view, mixed)| along(mixed, &steps[*view])).sum();
                track.point += point.inverse * (point.pull - of_poses);
            }
        }
        for (station, step) in next.stations.iter_mut().zip(&steps).filter(|(station, _)| station.is_free) {
            station.pose = station.moved(step);
        }
        next
    }

    /// The given poses as observations.
    fn add_given(&self, reduced: &mut Reduced) {
        let [per_angle, per_position] = [self.sigmas.angle_rad, self.sigmas.position_m].map(|sigma| sigma.powi(-2));
        for (view, station) in self.stations.iter().enumerate() {
            let (turn, shift) = (station.turn_rad(), station.shift_m());
            let mut block: Block = [[0.0; SIX]; SIX];
            let mut right = [0.0; SIX];
            for axis in 0..3 {
                (block[axis][axis], block[axis + 3][axis + 3]) = (per_angle, per_position);
                (right[axis], right[axis + 3]) = (-per_angle * turn[axis], -per_position * shift[axis]);
            }
            reduced.add(view, view, &block);
            reduced.add_right(view, &right);
        }
    }

    /// Adds what a point's sightings say of the poses; `None` for a point that none of them sees.
    fn eliminate(
        &self,
        track: &Track,
        width_px: f64,
        damping: f64,
        poses_move: bool,
        reduced: &mut Reduced,
    ) -> Option<Eliminated> {
        let (mut square, mut pull) = (DMat3::ZERO, DVec3::ZERO);
        let mut mixed: Vec<(usize, [DVec3; SIX])> = Vec::with_capacity(track.sightings.len());
        for sighting in &track.sightings {
            let Some(linear) = self.linear(sighting, track.point) else { continue };
            let weight = self.weight(linear.off_px, width_px);
            let mut of_pose = [DVec3::ZERO; SIX];
            let (mut block, mut right): (Block, Six) = ([[0.0; SIX]; SIX], [0.0; SIX]);
            for (axis, by_point) in linear.by_point.iter().enumerate() {
                let (by_pose, off) = (&linear.by_pose[axis], weight * linear.off_px[axis]);
                square += outer(*by_point * weight, *by_point);
                pull += *by_point * off;
                for a in 0..SIX {
                    of_pose[a] += *by_point * (weight * by_pose[a]);
                    right[a] += by_pose[a] * off;
                    for b in 0..SIX {
                        block[a][b] += weight * by_pose[a] * by_pose[b];
                    }
                }
            }
            if poses_move && self.stations[sighting.view].is_free {
                reduced.add(sighting.view, sighting.view, &block);
                reduced.add_right(sighting.view, &right);
                mixed.push((sighting.view, of_pose));
            }
        }
        let damped =
            square + DMat3::from_diagonal(DVec3::new(square.x_axis.x, square.y_axis.y, square.z_axis.z) * damping);
        let inverse = damped.inverse();
        if !inverse.is_finite() {
            return None;
        }
        for (i, (view, of_view)) in mixed.iter().enumerate() {
            let scaled = of_view.map(|of| inverse * of);
            reduced.add_right(*view, &scaled.map(|of| -of.dot(pull)));
            for (other, of_other) in &mixed[i..] {
                let (first, second) = if view <= other { (&scaled, of_other) } else { (of_other, &scaled) };
                let block: Block = first.map(|of| second.map(|with| -of.dot(with)));
                reduced.add(*view.min(other), *view.max(other), &block);
            }
        }
        Some(Eliminated { inverse, pull, mixed })
    }

    fn linear(&self, sighting: &Sighting, point: DVec3) -> Option<Linear> {
        let station = &self.stations[sighting.view];
        let rotation = &station.pose.rotation;
        let p = station.pose.point(point);
        if p.z <= 0.0 {
            return None;
        }
        let (seen, focal) = (p.truncate() / p.z, station.focal_px);
        let by_camera_point =
            [DVec3::new(1.0, 0.0, -seen.x) * (focal.x / p.z), DVec3::new(0.0, 1.0, -seen.y) * (focal.y / p.z)];
        let by_point = by_camera_point.map(|by| rotation.transpose() * by);
        let by_pose = [0, 1].map(|axis| {
            // A turn by ω moves p by ω × p.
            let (turn, shift) = (p.cross(by_camera_point[axis]), -by_point[axis]);
            [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
        });
        Some(Linear { off_px: focal * (sighting.ray - seen), by_pose, by_point })
    }

    fn weight(&self, off_px: DVec2, width_px: f64) -> f64 {
        self.sigmas.sighting_px.powi(-2) / (1.0 + off_px.length_squared() / (width_px * width_px))
    }

    /// Where a sighting is against where the pose puts its point, pixels of the photo; `None` behind the camera.
    pub fn off_px(&self, track: &Track, sighting: &Sighting) -> Option<DVec2> {
        let station = &self.stations[sighting.view];
        let p = station.pose.point(track.point);
        (p.z > 0.0).then(|| station.focal_px * (sighting.ray - p.truncate() / p.z))
    }

    fn cost(&self, width_px: f64) -> f64 {
        let behind = 1e6;
        let squared = width_px * width_px;
        let of_sighting = |track: &Track, sighting: &Sighting| {
            let off = self.off_px(track, sighting).map_or(behind, DVec2::length_squared);
            squared * (off / squared).ln_1p()
        };
        let of_track = |track: &Track| track.sightings.iter().map(|s| of_sighting(track, s)).sum::<f64>();
        let Sigmas { sighting_px, position_m, angle_rad } = self.sigmas;
        let of_station = |station: &Station| {
            station.shift_m().length_squared() / (position_m * position_m)
                + station.turn_rad().length_squared() / (angle_rad * angle_rad)
        };
        self.tracks.iter().map(of_track).sum::<f64>() / (sighting_px * sighting_px)
            + self.stations.iter().map(of_station).sum::<f64>()
    }

    /// Lengths of all residuals, pixels of the photo.
    pub fn residuals_px(&self) -> Vec<f64> {
        let of_track = |track: &'_ Track| -> Vec<f64> {
            track.sightings.iter().filter_map(|s| Some(self.off_px(track, s)?.length())).collect()
        };
        self.tracks.iter().flat_map(of_track).collect()
    }

    pub fn median_px(&self) -> Option<f64> {
        median(&self.residuals_px())
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

fn along(mixed: &[DVec3; SIX], step: &Six) -> DVec3 {
    mixed.iter().zip(step).map(|(of, by)| *of * *by).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: usize) -> f64 {
        let x = ((seed as f64 + 1.0) * 12.9898).sin() * 43_758.545_3;
        2.0 * (x - x.floor()) - 1.0
    }

    fn noise_vec(seed: usize) -> DVec3 {
        DVec3::new(noise(3 * seed), noise(3 * seed + 1), noise(3 * seed + 2))
    }

    /// Nine photos from 80 m over 60 points, each seen by all; the given poses are off by `position_m` and `angle_rad`.
    fn block(position_m: f64, angle_rad: f64) -> (Bundle, Vec<Rigid<Cam, Map>>) {
        let origin = DVec3::new(634_000.0, 485_000.0, 110.0);
        let looking = |i: usize| {
            let eye = origin + DVec3::new((i % 3) as f64 * 30.0, (i / 3) as f64 * 30.0, 80.0);
            Rigid::looking_at(eye, origin + DVec3::new(30.0, 30.0, 0.0) + 8.0 * noise_vec(i + 500))
        };
        let truth: Vec<Rigid<Cam, Map>> = (0..9).map(looking).collect();
        let sighting = |view: usize, point: DVec3| {
            let p = truth[view].point(point);
            Sighting { view, ray: p.truncate() / p.z }
        };
        let track = |i: usize| {
            let point = origin + DVec3::new(30.0, 30.0, 5.0) + noise_vec(i) * DVec3::new(30.0, 30.0, 10.0);
            Track {
                point: point + 0.2 * noise_vec(i + 900),
                sightings: (0..9).map(|view| sighting(view, point)).collect(),
            }
        };
        let station = |(i, pose): (usize, &Rigid<Cam, Map>)| {
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(angle_rad * noise_vec(i + 100)));
            let centre = pose.centre() + position_m * noise_vec(i + 200);
            let given = Rigid::from_rotation_and_centre(turn * pose.rotation, centre);
            Station { focal_px: DVec2::new(1000.0, 1010.0), given, pose: given, is_free: true }
        };
        let stations = truth.iter().enumerate().map(station).collect();
        let sigmas = Sigmas { sighting_px: 0.3, position_m: 0.3, angle_rad: 0.01 };
        (Bundle { stations, tracks: (0..60).map(track).collect(), sigmas }, truth)
    }

    #[test]
    fn derivatives_are_those_of_finite_differences() {
        let (bundle, _) = block(0.3, 0.01);
        let (track, step) = (&bundle.tracks[3], 1e-4);
        let sighting = &track.sightings[4];
        let linear = bundle.linear(sighting, track.point).unwrap();
        let off_of = |bundle: &Bundle, track: &Track| bundle.off_px(track, sighting).unwrap();
        let close = |found: f64, expected: f64| (found - expected).abs() < 1e-4 * (1.0 + expected.abs());
        for unknown in 0..SIX {
            let moved = |by: f64| {
                let mut moved = bundle.clone();
                let mut step = [0.0; SIX];
                step[unknown] = by;
                moved.stations[4].pose = bundle.stations[4].moved(&step);
                off_of(&moved, track)
            };
            let slope = (moved(-step) - moved(step)) / (2.0 * step);
            assert!((0..2).all(|axis| close(linear.by_pose[axis][unknown], slope[axis])), "{unknown}: {slope}");
        }
        for axis in 0..3 {
            let moved =
                |by: f64| off_of(&bundle, &Track { point: track.point + DVec3::AXES[axis] * by, ..track.clone() });
            let slope = (moved(-step) - moved(step)) / (2.0 * step);
            assert!((0..2).all(|row| close(linear.by_point[row][axis], slope[row])), "{axis}: {slope}");
        }
    }

    #[test]
    fn exact_sightings_bring_back_exact_poses_where_some_are_held() {
        let (mut bundle, truth) = block(0.3, 0.01);
        // Two held poses are a gauge; nothing else pulls.
        for (station, pose) in bundle.stations.iter_mut().zip(&truth).take(2) {
            *station = Station { given: *pose, pose: *pose, is_free: false, ..station.clone() };
        }
        bundle.sigmas = Sigmas { sighting_px: 0.3, position_m: 1e6, angle_rad: 1e6 };
        (0..6).for_each(|_| bundle.iterate(1.0, Moving::PointsAndPoses));
        for (station, pose) in bundle.stations.iter().zip(&truth) {
            let turn = (station.pose.rotation - pose.rotation).abs();
            let turn = [turn.x_axis, turn.y_axis, turn.z_axis].map(DVec3::max_element).into_iter().fold(0.0, f64::max);
            let shift_m = station.pose.centre().distance(pose.centre());
            assert!(shift_m < 1e-6 && turn < 1e-6, "{shift_m} {turn}");
        }
    }

    #[test]
    fn one_wrong_sighting_in_five_does_little_harm() {
        let (mut bundle, _) = block(0.3, 0.01);
        let before = bundle.median_px().unwrap();
        for (i, track) in bundle.tracks.iter_mut().enumerate() {
            for (k, sighting) in track.sightings.iter_mut().enumerate() {
                if (i * 9 + k) % 5 == 0 {
                    sighting.ray += 0.03 * noise_vec(i * 9 + k + 3000).truncate();
                }
            }
        }
        bundle.adjust(Moving::PointsAndPoses);
        let after = bundle.median_px().unwrap();
        assert!(before > 2.0 && after < 0.1, "{before} {after}");
    }
}
