//! The real Warsaw block, read with a few lines of its own so that evidence is tested without the survey readers.

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};
use sizeup::camera::{Camera, Distortion};
use sizeup::frames::Rigid;
use sizeup::survey::View;

/// Offset of the COLMAP model from EPSG:2180, metres.
pub const OFFSET: DVec3 = DVec3::new(634_000.0, 485_000.0, 0.0);

/// The twelve views in EPSG:2180.
pub fn views(folder: &Path) -> Vec<View> {
    let numbers = |line: &str| line.split_whitespace().filter_map(|w| w.parse().ok()).collect::<Vec<f64>>();
    let text = std::fs::read_to_string(folder.join("sparse/cameras.txt")).unwrap();
    let line = text.lines().find(|line| line.contains("OPENCV") && !line.starts_with('#')).unwrap();
    let [_, width, height, fx, fy, cx, cy, k1, k2, p1, p2] = numbers(line)[..] else { panic!("{line}") };
    let camera = Arc::new(Camera {
        width_px: width as u32,
        height_px: height as u32,
        fx_px: fx,
        fy_px: fy,
        cx_px: cx,
        cy_px: cy,
        distortion: Distortion::Brown { k1, k2, k3: 0.0, p1, p2 },
    });
    let text = std::fs::read_to_string(folder.join("sparse/images.txt")).unwrap();
    let poses = text.lines().filter(|line| line.contains("img_"));
    let view = |line: &str| {
        let [_, w, x, y, z, tx, ty, tz, ..] = numbers(line)[..] else { panic!("{line}") };
        let name = line.split_whitespace().last().unwrap();
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let translation = DVec3::new(tx, ty, tz) - rotation * OFFSET;
        View {
            id: name.into(),
            camera: Arc::clone(&camera),
            camera_from_map: Rigid::new(rotation, translation),
            image: Some(folder.join("images").join(name)),
        }
    };
    let mut views: Vec<View> = poses.map(view).collect();
    views.sort_by(|a, b| a.id.cmp(&b.id));
    views
}
