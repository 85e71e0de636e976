//! COLMAP text: `cameras.txt`, `images.txt`, an empty `points3D.txt`, and `survey.toml`.
//!
//! Positions are written minus an offset of whole kilometres: tools that keep them in single precision would lose
//! decimetres of a UTM northing, and `t = −R·C` would lose the last digits.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::{Converted, write_config};
use crate::camera::{Camera, Distortion};
use crate::crs::Crs;
use crate::files::write_whole;
use crate::frames::Rigid;
use crate::survey::angles::quaternion_wxyz;
use crate::survey::poses::refused;
use crate::survey::{Format, Survey, SurveyConfig, SurveyError, View};

/// Grain of the offset, metres.
const OFFSET_GRAIN_M: f64 = 1000.0;

pub(super) fn write(survey: &Survey, project_crs: &Crs, folder: &Path) -> Result<Converted, SurveyError> {
    let mut converted = Converted::default();
    let mut models: Vec<(String, &Camera)> = Vec::new();
    let mut ids: BTreeMap<usize, usize> = BTreeMap::new();
    let mut rows: Vec<(usize, &View)> = Vec::new();
    for view in &survey.views {
        let key = Arc::as_ptr(&view.camera) as usize;
        let id = if let Some(&id) = ids.get(&key) {
            id
        } else {
            match model(&view.camera) {
                Ok(model) => models.push((model, &view.camera)),
                Err(reason) => {
                    converted.issues.push(refused("camera_not_expressible", &view.id.0, reason));
                    continue;
                }
            }
            ids.insert(key, models.len());
            models.len()
        };
        rows.push((id, view));
    }
    let offset = offset(&survey.views);
    let path = |name: &str| folder.join(name);
    write_whole(&path("cameras.txt"), |file| {
        writeln!(file, "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]")?;
        for (i, (model, camera)) in models.iter().enumerate() {
            let (name, params) = model.split_once(' ').unwrap_or((model, ""));
            writeln!(file, "{} {name} {} {} {params}", i + 1, camera.width_px, camera.height_px)?;
        }
        Ok(())
    })?;
    write_whole(&path("images.txt"), |file| {
        writeln!(file, "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then an empty line")?;
        writeln!(file, "# World: {project_crs} minus ({}, {}, {})", offset.x, offset.y, offset.z)?;
        for (i, (camera_id, view)) in rows.iter().enumerate() {
            let rotation = view.camera_from_map.rotation;
            let pose: Rigid<(), ()> = Rigid::from_rotation_and_centre(rotation, view.camera_from_map.centre() - offset);
            let [w, x, y, z] = quaternion_wxyz(rotation);
            let t = pose.translation;
            writeln!(file, "{} {w} {x} {y} {z} {} {} {} {camera_id} {}\n", i + 1, t.x, t.y, t.z, view.id)?;
        }
        Ok(())
    })?;
    write_whole(&path("points3D.txt"), |file| writeln!(file, "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]"))?;
    let config = SurveyConfig {
        format: Format::Colmap,
        path: ".".into(),
        crs: Some(project_crs.clone()),
        offset: offset.to_array(),
        ..SurveyConfig::default()
    };
    write_config(&config, &path("survey.toml"))?;
    converted.files = ["cameras.txt", "images.txt", "points3D.txt", "survey.toml"].map(path).to_vec();
    Ok(converted)
}

/// Whole kilometres near the middle of the survey; heights are small and stay.
fn offset(views: &[View]) -> DVec3 {
    let sum: DVec3 = views.iter().map(|view| view.camera_from_map.centre()).sum();
    let grain = |middle: f64| (middle / OFFSET_GRAIN_M).round() * OFFSET_GRAIN_M;
    let middle = sum / views.len().max(1) as f64;
    DVec3::new(grain(middle.x), grain(middle.y), 0.0)
}

/// Name and parameters of COLMAP's model for a camera.
fn model(camera: &Camera) -> Result<String, String> {
    let Camera { fx_px, fy_px, cx_px, cy_px, .. } = camera;
    let lens = format!("{fx_px} {fy_px} {cx_px} {cy_px}");
    Ok(match camera.distortion {
        Distortion::None => format!("PINHOLE {lens}"),
        Distortion::Brown { k1, k2, k3: 0.0, p1, p2 } => format!("OPENCV {lens} {k1} {k2} {p1} {p2}"),
        Distortion::Brown { k1, k2, k3, p1, p2 } => format!("FULL_OPENCV {lens} {k1} {k2} {p1} {p2} {k3} 0 0 0"),
        Distortion::Rational { k1, k2, k3, k4, k5, k6, p1, p2 } => {
            format!("FULL_OPENCV {lens} {k1} {k2} {p1} {p2} {k3} {k4} {k5} {k6}")
        }
        Distortion::Fisheye { k1, k2, k3, k4 } => format!("OPENCV_FISHEYE {lens} {k1} {k2} {k3} {k4}"),
        Distortion::BrownAffine { .. } => {
            return Err("COLMAP has no model with k4 or skew: write CSV, or undistort the photos".to_owned());
        }
    })
}
