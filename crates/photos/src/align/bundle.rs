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
//!
//! Where lenses may change, the photos of a camera share two more unknowns, its rays being `m (1 + a + b |m|²)` in place of `m`, and
//! `Σ a²/σ_a² + b²/σ_b²` is added.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::reduced::{Matrix6, Reduced, SIX, Six};
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
    /// The lens that it was taken with, by index.
    pub lens: usize,
}

/// Difference of a camera's rays from the given ones.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct LensCorrection {
    /// Share that the rays of sightings are longer by (`a`): the focal length is so much too long.
    pub scale: f64,
    /// The same times the square of their length (`b`).
    pub radial: f64,
    /// Scale and radial part that are in the rays of sightings already.
    pub applied: [f64; 2],
    /// Whether the adjustment may change the lens.
    pub is_free: bool,
}

impl LensCorrection {
    /// A ray as the lens has it.
    pub fn ray(&self, ray: DVec2) -> DVec2 {
        ray * (1.0 + self.scale + self.radial * ray.length_squared())
    }

    /// Since the given camera: scale and radial part.
    pub fn total(&self) -> [f64; 2] {
        [(1.0 + self.applied[0]) * (1.0 + self.scale) - 1.0, self.applied[1] + self.radial]
    }
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

/// Sighting of a point in a photo.
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
    /// Position of the point, map frame, metres.
    pub point: DVec3,
    /// The photo that it was chosen in comes first.
    pub sightings: Vec<Sighting>,
}

/// Expected errors, one standard deviation each.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sigmas {
    /// Expected error of a sighting, pixels of the photo.
    pub sighting_px: f64,
    /// Expected error of a given position along each axis, metres.
    pub position_m: f64,
    /// Expected error of a given rotation about each axis, radians.
    pub angle_rad: f64,
    /// Errors of the given lenses; `None` where these stay as they are.
    pub lens: Option<LensSigmas>,
}

/// Expected errors of given lenses.
#[derive(Debug, Clone, Copy)]
pub(super) struct LensSigmas {
    /// Error of the focal length, a share of it.
    pub scale: f64,
    /// Error of the radial part at 45 degrees off the axis, a share.
    pub radial: f64,
}

impl LensSigmas {
    fn cost(&self, lens: &LensCorrection) -> f64 {
        let [scale, radial] = lens.total();
        (scale / self.scale).powi(2) + (radial / self.radial).powi(2)
    }
}

/// Unknowns that an adjustment solves for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moving {
    Points,
    PointsAndPoses,
}

/// Photos and points to be made to agree.
#[derive(Debug, Clone)]
pub(super) struct Bundle {
    pub stations: Vec<Station>,
    pub lenses: Vec<LensCorrection>,
    pub tracks: Vec<Track>,
    pub sigmas: Sigmas,
}

/// A sighting's residual, pixels, and how it changes.
struct Linear {
    off_px: DVec2,
    /// By turn and shift of the photo: one row per axis of the image.
    by_pose: [Six; 2],
    /// By scale and radial part of the lens, in the first two.
    by_lens: [Six; 2],
    /// Change of the residual with the point's position: one row per axis of the image.
    by_point: [DVec3; 2],
}

/// A point taken out of the equations.
struct Eliminated {
    inverse: DMat3,
    pull: DVec3,
    /// Photo, or lens counted on from the last photo, and mixed terms of its unknowns with the point.
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
        let poses_move = moving == Moving::PointsAndPoses;
        let n_lenses = if poses_move && self.sigmas.lens.is_some() { self.lenses.len() } else { 0 };
        let mut reduced = Reduced::new(self.stations.len() + n_lenses);
        if poses_move {
            self.add_given(&mut reduced);
            self.add_given_lenses(&mut reduced);
        }
        let eliminated: Vec<Option<Eliminated>> = self
            .tracks
            .iter()
            .map(|track| self.eliminate(track, width_px, damping, poses_move, &mut reduced))
            .collect();
        let steps = if poses_move { reduced.solve(damping) } else { vec![[0.0; SIX]; self.stations.len() + n_lenses] };
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
        for (lens, step) in next.lenses.iter_mut().zip(&steps[self.stations.len()..]) {
            (lens.scale, lens.radial) = (lens.scale + step[0], lens.radial + step[1]);
        }
        next
    }

    /// The given lenses as observations. The unknowns that a lens does not have stay 0.
    fn add_given_lenses(&self, reduced: &mut Reduced) {
        let Some(sigmas) = self.sigmas.lens else { return };
        let per = [sigmas.scale, sigmas.radial].map(|sigma| sigma.powi(-2));
        for (i, lens) in self.lenses.iter().enumerate() {
            let mut block: Matrix6 = std::array::from_fn(|a| std::array::from_fn(|b| if a == b { 1.0 } else { 0.0 }));
            let mut right = [0.0; SIX];
            for (k, total) in lens.total().into_iter().enumerate() {
                (block[k][k], right[k]) = (per[k], -per[k] * total);
            }
            reduced.add(self.stations.len() + i, self.stations.len() + i, &block);
            reduced.add_right(self.stations.len() + i, &right);
        }
    }

    /// The given poses as observations.
    fn add_given(&self, reduced: &mut Reduced) {
        let [per_angle, per_position] = [self.sigmas.angle_rad, self.sigmas.position_m].map(|sigma| sigma.powi(-2));
        for (view, station) in self.stations.iter().enumerate() {
            let (turn, shift) = (station.turn_rad(), station.shift_m());
            let mut block: Matrix6 = [[0.0; SIX]; SIX];
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
        let mut mixed: Vec<(usize, [DVec3; SIX])> = Vec::with_capacity(track.sightings.len() + 1);
        let lenses_move = poses_move && self.sigmas.lens.is_some();
        for sighting in &track.sightings {
            let Some(linear) = self.linear(sighting, track.point) else { continue };
            let station = &self.stations[sighting.view];
            let weight = self.weight(linear.off_px, width_px);
            for (by_point, off_px) in linear.by_point.iter().zip(linear.off_px.to_array()) {
                square += outer(*by_point * weight, *by_point);
                pull += *by_point * (weight * off_px);
            }
            let is_moved = poses_move && station.is_free;
            let unknowns = [
                is_moved.then_some((sighting.view, &linear.by_pose)),
                lenses_move.then_some((self.stations.len() + station.lens, &linear.by_lens)),
            ];
            for (i, unknown) in unknowns.iter().enumerate() {
                let Some((row, by)) = unknown else { continue };
                reduced.add_right(*row, &right_of(by, linear.off_px, weight));
                add_mixed(&mut mixed, *row, &mixed_of(by, &linear.by_point, weight));
                for (col, with) in unknowns[i..].iter().flatten() {
                    reduced.add(*row, *col, &block_of(by, with, weight));
                }
            }
        }
        mixed.sort_unstable_by_key(|(row, _)| *row);
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
                let block: Matrix6 = scaled.map(|of| of_other.map(|with| -of.dot(with)));
                reduced.add(*view, *other, &block);
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
        let ray = sighting.ray;
        let by_lens = [0, 1].map(|axis| {
            let by_scale = if self.lenses[station.lens].is_free { -focal[axis] * ray[axis] } else { 0.0 };
            [by_scale, by_scale * ray.length_squared(), 0.0, 0.0, 0.0, 0.0]
        });
        let off_px = focal * (self.lenses[station.lens].ray(ray) - seen);
        Some(Linear { off_px, by_pose, by_lens, by_point })
    }

    fn weight(&self, off_px: DVec2, width_px: f64) -> f64 {
        self.sigmas.sighting_px.powi(-2) / (1.0 + off_px.length_squared() / (width_px * width_px))
    }

    /// Offset of a sighting from where the pose puts its point, pixels of the photo; `None` behind the camera.
    pub fn off_px(&self, track: &Track, sighting: &Sighting) -> Option<DVec2> {
        let station = &self.stations[sighting.view];
        let p = station.pose.point(track.point);
        (p.z > 0.0).then(|| station.focal_px * (self.lenses[station.lens].ray(sighting.ray) - p.truncate() / p.z))
    }

    fn cost(&self, width_px: f64) -> f64 {
        let behind = 1e6;
        let squared = width_px * width_px;
        let of_sighting = |track: &Track, sighting: &Sighting| {
            let off = self.off_px(track, sighting).map_or(behind, DVec2::length_squared);
            squared * (off / squared).ln_1p()
        };
        let of_track = |track: &Track| track.sightings.iter().map(|s| of_sighting(track, s)).sum::<f64>();
        let Sigmas { sighting_px, position_m, angle_rad, lens } = self.sigmas;
        let of_station = |station: &Station| {
            station.shift_m().length_squared() / (position_m * position_m)
                + station.turn_rad().length_squared() / (angle_rad * angle_rad)
        };
        self.tracks.iter().map(of_track).sum::<f64>() / (sighting_px * sighting_px)
            + self.stations.iter().map(of_station).sum::<f64>()
            + lens.map_or(0.0, |sigmas| self.lenses.iter().map(|lens| sigmas.cost(lens)).sum())
    }

    /// Takes what was found of the lenses into the rays of the sightings, for cameras that are changed alike.
    pub fn apply_lenses(&mut self) {
        for sighting in self.tracks.iter_mut().flat_map(|track| &mut track.sightings) {
            sighting.ray = self.lenses[self.stations[sighting.view].lens].ray(sighting.ray);
        }
        for station in &mut self.stations {
            station.focal_px /= 1.0 + self.lenses[station.lens].scale;
        }
        for lens in &mut self.lenses {
            *lens = LensCorrection { applied: lens.total(), is_free: lens.is_free, ..LensCorrection::default() };
        }
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

/// Pull of a sighting's residual on some unknowns, from derivatives by them, a row per axis of the image.
fn right_of(by: &[Six; 2], off_px: DVec2, weight: f64) -> Six {
    std::array::from_fn(|a| weight * (by[0][a] * off_px.x + by[1][a] * off_px.y))
}

/// Mixed terms of unknowns with the point.
fn mixed_of(by: &[Six; 2], by_point: &[DVec3; 2], weight: f64) -> [DVec3; SIX] {
    std::array::from_fn(|a| (by_point[0] * by[0][a] + by_point[1] * by[1][a]) * weight)
}

/// Terms of some unknowns with others.
fn block_of(by: &[Six; 2], with: &[Six; 2], weight: f64) -> Matrix6 {
    std::array::from_fn(|a| std::array::from_fn(|b| weight * (by[0][a] * with[0][b] + by[1][a] * with[1][b])))
}

/// Adds to the mixed terms of a row; photos that share a lens share its row.
fn add_mixed(mixed: &mut Vec<(usize, [DVec3; SIX])>, row: usize, terms: &[DVec3; SIX]) {
    match mixed.iter_mut().find(|(known, _)| *known == row) {
        Some((_, sum)) => sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += *term),
        None => mixed.push((row, *terms)),
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
            Station { focal_px: DVec2::new(1000.0, 1010.0), given, pose: given, is_free: true, lens: 0 }
        };
        let stations = truth.iter().enumerate().map(station).collect();
        let sigmas = Sigmas { sighting_px: 0.3, position_m: 0.3, angle_rad: 0.01, lens: None };
        let lenses = vec![LensCorrection { is_free: true, ..LensCorrection::default() }];
        (Bundle { stations, lenses, tracks: (0..60).map(track).collect(), sigmas }, truth)
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
        for unknown in 0..2 {
            let moved = |by: f64| {
                let mut moved = bundle.clone();
                let lens = &mut moved.lenses[0];
                *(if unknown == 0 { &mut lens.scale } else { &mut lens.radial }) += by;
                off_of(&moved, track)
            };
            let slope = (moved(-step) - moved(step)) / (2.0 * step);
            assert!((0..2).all(|axis| close(linear.by_lens[axis][unknown], slope[axis])), "{unknown}: {slope}");
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
        bundle.sigmas = Sigmas { sighting_px: 0.3, position_m: 1e6, angle_rad: 1e6, lens: None };
        (0..6).for_each(|_| bundle.iterate(1.0, Moving::PointsAndPoses));
        for (station, pose) in bundle.stations.iter().zip(&truth) {
            let turn = (station.pose.rotation - pose.rotation).abs();
            let turn = [turn.x_axis, turn.y_axis, turn.z_axis].map(DVec3::max_element).into_iter().fold(0.0, f64::max);
            let shift_m = station.pose.centre().distance(pose.centre());
            assert!(shift_m < 1e-6 && turn < 1e-6, "{shift_m} {turn}");
        }
    }

    #[test]
    fn a_lens_that_is_off_comes_back_with_the_poses() {
        let (mut bundle, truth) = block(0.05, 0.01);
        let (scale, radial) = (0.03, -0.04);
        // Sightings as a camera has them whose focal length and radial part are off.
        let given = |ray: DVec2| (0..20).fold(ray, |m, _| ray / (1.0 + scale + radial * m.length_squared()));
        for sighting in bundle.tracks.iter_mut().flat_map(|track| &mut track.sightings) {
            sighting.ray = given(sighting.ray);
        }
        bundle.sigmas = Sigmas { sighting_px: 0.3, position_m: 0.05, angle_rad: 0.01, lens: None };
        let off_m = |bundle: &Bundle| {
            let off = bundle.stations.iter().zip(&truth).map(|(s, pose)| s.pose.centre().distance(pose.centre()));
            median(&off.collect::<Vec<f64>>()).unwrap()
        };
        let mut held = bundle.clone();
        held.adjust(Moving::PointsAndPoses);
        bundle.sigmas.lens = Some(LensSigmas { scale: 0.05, radial: 0.1 });
        bundle.adjust(Moving::PointsAndPoses);
        let [found_scale, found_radial] = bundle.lenses[0].total();
        assert!((found_scale - scale).abs() < 2e-3 && (found_radial - radial).abs() < 4e-3, "{:?}", bundle.lenses);
        assert!(bundle.median_px().unwrap() < 0.02 && off_m(&bundle) < 0.05, "{}", off_m(&bundle));
        assert!(off_m(&held) > 2.0 * off_m(&bundle), "{} {}", off_m(&held), off_m(&bundle));
        let before = bundle.median_px().unwrap();
        bundle.apply_lenses();
        // The focal length that residuals are counted in has changed with it.
        assert!((bundle.median_px().unwrap() * (1.0 + found_scale) - before).abs() < 1e-9, "the same rays, taken in");
        assert!((bundle.lenses[0].total()[0] - found_scale).abs() < 1e-12);
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
