//! Photos that go into a network together, and their poses as the network wants them: Depth Anything 3's (`depth_anything_3/api.py`,
//! `_normalize_extrinsics`).
//!
//! ```text
//! E'ᵢ = Eᵢ · E₀⁻¹,   tᵢ of E'ᵢ divided by max(0.1, median of |Cᵢ|)
//! ```
//!
//! `E`: world to camera, the view itself first; `C`: projection centres in the first camera's frame.
//!
//! Networks that give poses back give them in the unit of their depth. What one unit is in metres follows from laying
//! the given centres `gᵢ` over theirs, `pᵢ` (Umeyama 1991, doi:10.1109/34.88573; `align_poses_umeyama`, there with
//! RANSAC from ten views on, here with all of them), with the singular values `σ` of `H = Σ (pᵢ − p̄)(gᵢ − ḡ)ᵀ`:
//!
//! ```text
//! units per metre = (σ₁ + σ₂ + sign(det H)·σ₃) / Σ |gᵢ − ḡ|²
//! ```

use glam::{DMat3, DQuat, DVec3};

use super::profile::{PoseDirection, PoseUnit};
use crate::onnx::Tensor;
use sizeup_survey::View;

/// Least distance that distances are divided by, metres.
const LEAST_DISTANCE_M: f64 = 0.1;

/// Poses, `1 × n × 4 × 4`.
pub(super) fn extrinsics(views: &[&View], unit: PoseUnit, direction: PoseDirection) -> Tensor {
    let first = views[0].camera_from_map;
    let relative: Vec<(DMat3, DVec3)> = views
        .iter()
        .map(|view| {
            let rotation = view.camera_from_map.rotation * first.rotation.transpose();
            // The vector between two centres in the map: large coordinates cancel before anything is turned.
            let shift = view.camera_from_map.rotation * (first.centre() - view.camera_from_map.centre());
            (rotation, shift)
        })
        .collect();
    let mut distances: Vec<f64> = relative.iter().map(|(_, shift)| shift.length()).collect();
    distances.sort_unstable_by(f64::total_cmp);
    // PyTorch's median: the lower one of two in the middle.
    let unit_m = match unit {
        PoseUnit::MedianDistance => distances[(distances.len() - 1) / 2].max(LEAST_DISTANCE_M),
        PoseUnit::Metre => 1.0,
    };
    let mut values = Vec::with_capacity(views.len() * 16);
    for (rotation, shift) in relative {
        let (rotation, shift) = match direction {
            PoseDirection::WorldToCamera => (rotation, shift),
            PoseDirection::CameraToWorld => (rotation.transpose(), -(rotation.transpose() * shift)),
        };
        for row in 0..3 {
            values.extend(rotation.row(row).to_array().map(|v| v as f32));
            values.push((shift[row] / unit_m) as f32);
        }
        values.extend([0.0, 0.0, 0.0, 1.0]);
    }
    Tensor { shape: vec![1, views.len(), 4, 4], values }
}

/// Calibration matrices of the photos at `rows × columns`, `1 × n × 3 × 3`.
pub(super) fn intrinsics(views: &[&View], rows: usize, columns: usize) -> Tensor {
    let matrix = |view: &&View| {
        let camera = view.camera.resized(columns as u32, rows as u32);
        [camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0].map(|v| v as f32)
    };
    Tensor { shape: vec![1, views.len(), 3, 3], values: views.iter().flat_map(matrix).collect() }
}

/// How many metres one unit of the network's poses (`1 × n × 3 × 4`, `1 × n × 4 × 4` or `1 × n × 9`, world to camera) is.
pub(super) fn metres_per_unit(views: &[&View], poses: &Tensor) -> Result<f64, String> {
    let n = views.len();
    let size = poses.values.len() / n;
    if poses.values.len() != n * size || !matches!(size, 9 | 12 | 16) {
        return Err(format!("they have shape {:?}, expected 1 × {n} × 3 × 4 or 1 × {n} × 9", poses.shape));
    }
    let found: Vec<DVec3> = poses.values.chunks_exact(size).map(centre).collect();
    let origin = views[0].camera_from_map.centre();
    let given: Vec<DVec3> = views.iter().map(|view| view.camera_from_map.centre() - origin).collect();
    let mean = |centres: &[DVec3]| centres.iter().sum::<DVec3>() / n as f64;
    let (mean_found, mean_given) = (mean(&found), mean(&given));
    let spread_m2: f64 = given.iter().map(|g| (g - mean_given).length_squared()).sum();
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    let h = found.iter().zip(&given).fold(DMat3::ZERO, |sum, (p, g)| sum + outer(p - mean_found, g - mean_given));
    let [largest, middle, least] = singular_values(&h);
    let metres = spread_m2 / (largest + middle + least.copysign(h.determinant()));
    if metres.is_finite() && metres > 0.0 {
        return Ok(metres);
    }
    let spread: f64 = found.iter().map(|p| (p - mean_found).length_squared()).sum();
    Err(format!("their centres lie {:.3} units apart, the cameras {:.3} m", spread.sqrt(), spread_m2.sqrt()))
}

/// Projection centre of a pose, world to camera: `−Rᵀ·t`. Row-major, or translation, quaternion x y z w and fields of view.
fn centre(pose: &[f32]) -> DVec3 {
    if let [x, y, z, i, j, k, real, _, _] = *pose {
        // Networks leave quaternions at any length.
        let rotation = DQuat::from_array([i, j, k, real].map(f64::from)).normalize();
        return -(rotation.conjugate() * DVec3::from_array([x, y, z].map(f64::from)));
    }
    let at = |row: usize, col: usize| f64::from(pose[row * 4 + col]);
    let row = |i: usize| DVec3::new(at(i, 0), at(i, 1), at(i, 2));
    -(0..3).map(|i| row(i) * at(i, 3)).sum::<DVec3>()
}

/// Largest first: columns are turned pairwise until they are at right angles (Hestenes 1958), which keeps the digits of
/// small ones, as two views and straight flights have.
fn singular_values(matrix: &DMat3) -> [f64; 3] {
    const SWEEPS: usize = 12;
    let mut columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    for (i, j) in [(0, 1), (0, 2), (1, 2)].into_iter().cycle().take(3 * SWEEPS) {
        let (a, b) = (columns[i], columns[j]);
        let dot = a.dot(b);
        if dot != 0.0 {
            let half = (b.length_squared() - a.length_squared()) / (2.0 * dot);
            let tangent = half.signum() / (half.abs() + half.hypot(1.0));
            let (cosine, sine) = (1.0 / tangent.hypot(1.0), tangent / tangent.hypot(1.0));
            (columns[i], columns[j]) = (a * cosine - b * sine, a * sine + b * cosine);
        }
    }
    let mut lengths = columns.map(DVec3::length);
    lengths.sort_unstable_by(|a, b| b.total_cmp(a));
    lengths
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;

    fn at(centre: DVec3, rotation: DMat3) -> View {
        View {
            id: "a".into(),
            camera: Arc::new(Camera::pinhole(400, 300, 500.0)),
            camera_from_map: Rigid::from_rotation_and_centre(rotation, centre),
            image: None,
        }
    }

    /// The same poses in another world: turned, shifted, and 0.02 units per metre; centres `3 × 4`, row-major.
    fn in_another_world(views: &[&View]) -> Tensor {
        let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(-0.4);
        let origin = views[0].camera_from_map.centre();
        let values = views.iter().flat_map(|view| {
            let centre = turn * (view.camera_from_map.centre() - origin) * 0.02 + DVec3::new(3.0, -1.0, 2.0);
            let rotation = view.camera_from_map.rotation * turn.transpose();
            let translation = -(rotation * centre);
            (0..3).flat_map(move |row| rotation.row(row).to_array().into_iter().chain([translation[row]]))
        });
        Tensor { shape: vec![1, views.len(), 3, 4], values: values.map(|v| v as f32).collect() }
    }

    /// `3 × 4` poses as translation, quaternion (of length 3) and fields of view.
    fn encoded(poses: &Tensor) -> Tensor {
        let of_pose = |pose: &[f32]| {
            let at = |row: usize, col: usize| f64::from(pose[row * 4 + col]);
            let column = |col: usize| DVec3::new(at(0, col), at(1, col), at(2, col));
            let quaternion = DQuat::from_mat3(&DMat3::from_cols(column(0), column(1), column(2))) * 3.0;
            let values: Vec<f64> = [&column(3).to_array()[..], &quaternion.to_array(), &[1.0, 1.2]].concat();
            values.into_iter().map(|v| v as f32).collect::<Vec<f32>>()
        };
        let n = poses.values.len() / 12;
        Tensor { shape: vec![1, n, 9], values: poses.values.chunks_exact(12).flat_map(of_pose).collect() }
    }

    #[test]
    fn poses_of_another_world_tell_its_unit_in_metres_also_of_two_views_and_of_a_straight_flight() {
        let base = DVec3::new(634_000.0, 485_000.0, 300.0);
        let places =
            [DVec3::ZERO, DVec3::new(40.0, 5.0, 1.0), DVec3::new(75.0, 60.0, -3.0), DVec3::new(10.0, 80.0, 9.0)];
        let views: Vec<View> =
            places.iter().map(|place| at(base + *place, DMat3::from_rotation_x(2.0 + place.x / 100.0))).collect();
        let straight: Vec<View> = (0..4).map(|i| at(base + f64::from(i) * places[1], DMat3::IDENTITY)).collect();
        for views in [&views[..], &views[..2], &straight] {
            let views: Vec<&View> = views.iter().collect();
            let poses = in_another_world(&views);
            let metres = metres_per_unit(&views, &poses).unwrap();
            assert!((metres - 50.0).abs() < 1e-3, "{metres}");
            let metres = metres_per_unit(&views, &encoded(&poses)).unwrap();
            assert!((metres - 50.0).abs() < 1e-3, "as translation and quaternion: {metres}");
        }
    }

    #[test]
    fn poses_in_one_place_and_of_another_number_are_refused() {
        let (a, b) = (at(DVec3::ZERO, DMat3::IDENTITY), at(DVec3::X, DMat3::IDENTITY));
        let mut poses = in_another_world(&[&a, &b]);
        assert!(metres_per_unit(&[&a, &b, &a], &poses).unwrap_err().contains("1 × 3 × 3 × 4"));
        poses.values.fill(0.0);
        assert!(metres_per_unit(&[&a, &b], &poses).unwrap_err().contains("0.000 units apart"));
    }

    #[test]
    fn the_first_pose_is_the_world_and_the_median_distance_the_unit() {
        let view = |east_m: f64, turn_rad: f64| View {
            id: "a".into(),
            camera: Arc::new(Camera::pinhole(400, 300, 500.0)),
            camera_from_map: Rigid::from_rotation_and_centre(
                DMat3::from_rotation_z(turn_rad),
                DVec3::new(500_000.0 + east_m, 5_800_000.0, 100.0),
            ),
            image: None,
        };
        let views = [view(0.0, 0.3), view(20.0, 0.3), view(-40.0, 0.8)];
        let views: Vec<&View> = views.iter().collect();
        let to_camera = PoseDirection::WorldToCamera;
        let metres = extrinsics(&views, PoseUnit::Metre, to_camera);
        let poses = extrinsics(&views, PoseUnit::MedianDistance, to_camera);
        assert_eq!(poses.shape, [1, 3, 4, 4]);
        let pose = |i: usize| &poses.values[i * 16..][..16];
        let identity = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
        assert!(pose(0).iter().zip(identity).all(|(a, b)| (a - b).abs() < 1e-6), "{:?}", pose(0));
        // Distances 0, 20, 40: the median is 20. The second camera stands east, so the first lies west of it.
        let length = |i: usize| (0..3).map(|row| pose(i)[row * 4 + 3].powi(2)).sum::<f32>().sqrt();
        assert!((metres.values[16 + 3].hypot(metres.values[16 + 7]) - 20.0).abs() < 1e-5);
        assert!((length(1) - 1.0).abs() < 1e-6 && (length(2) - 2.0).abs() < 1e-6);
        let west = DMat3::from_rotation_z(0.3) * DVec3::NEG_X;
        assert!((f64::from(pose(1)[3]) - west.x).abs() < 1e-6 && (f64::from(pose(1)[7]) - west.y).abs() < 1e-6);
        // The other way round the last column is the projection centre, 20 m away, and the rotation is turned back.
        let to_world = extrinsics(&views, PoseUnit::Metre, PoseDirection::CameraToWorld);
        let shift = |pose: &[f32]| DVec3::new(f64::from(pose[3]), f64::from(pose[7]), f64::from(pose[11]));
        assert!((shift(&to_world.values[16..32]) + 20.0 * west).length() < 1e-4);
        let (there, back) = (&metres.values[32..48], &to_world.values[32..48]);
        assert!((0..3).all(|i| (0..3).all(|j| there[i * 4 + j] == back[j * 4 + i])));
        assert_eq!(intrinsics(&views[..1], 150, 200).values, [250., 0., 100., 0., 250., 75., 0., 0., 1.]);
    }
}
