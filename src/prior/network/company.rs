//! Photos that go into a network together, and their poses as Depth Anything 3 wants them (`depth_anything_3/api.py`,
//! `_normalize_extrinsics`).
//!
//! ```text
//! E'ᵢ = Eᵢ · E₀⁻¹,   tᵢ of E'ᵢ divided by max(0.1, median of |Cᵢ|)
//! ```
//!
//! `E`: world to camera, the view itself first; `C`: projection centres in the first camera's frame.

use glam::{DMat3, DVec3};

use crate::onnx::Tensor;
use crate::survey::View;

/// Least distance that distances are divided by, metres.
const LEAST_DISTANCE_M: f64 = 0.1;

/// Poses, `1 × n × 4 × 4`.
pub(super) fn extrinsics(views: &[&View]) -> Tensor {
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
    let unit_m = distances[(distances.len() - 1) / 2].max(LEAST_DISTANCE_M);
    let mut values = Vec::with_capacity(views.len() * 16);
    for (rotation, shift) in relative {
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::camera::Camera;
    use crate::frames::Rigid;

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
        let poses = extrinsics(&views);
        assert_eq!(poses.shape, [1, 3, 4, 4]);
        let pose = |i: usize| &poses.values[i * 16..][..16];
        let identity = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
        assert!(pose(0).iter().zip(identity).all(|(a, b)| (a - b).abs() < 1e-6), "{:?}", pose(0));
        // Distances 0, 20, 40: the median is 20. The second camera stands east, so the first lies west of it.
        let length = |i: usize| (0..3).map(|row| pose(i)[row * 4 + 3].powi(2)).sum::<f32>().sqrt();
        assert!((length(1) - 1.0).abs() < 1e-6 && (length(2) - 2.0).abs() < 1e-6);
        let west = DMat3::from_rotation_z(0.3) * DVec3::NEG_X;
        assert!((f64::from(pose(1)[3]) - west.x).abs() < 1e-6 && (f64::from(pose(1)[7]) - west.y).abs() < 1e-6);
        assert_eq!(intrinsics(&views[..1], 150, 200).values, [250., 0., 100., 0., 250., 75., 0., 0., 1.]);
    }
}
