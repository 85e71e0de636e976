//! COLMAP text: `cameras.txt`, `images.txt`, `points3D.txt`, and for a survey `survey.toml`.
//!
//! Positions are written minus an offset of whole kilometres: tools that keep them in single precision would lose
//! decimetres of a UTM northing, and `t = −R·C` would lose the last digits.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use super::{Converted, images_folder, write_config};
use crate::angles::quaternion_wxyz;
use crate::poses::refused;
use crate::{Format, Survey, SurveyConfig, SurveyError, View};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::{FileError, write_whole};
use sizeup_geo::issue::Issue;
use sizeup_heights::camera::{Camera, Distortion};
use sizeup_heights::frames::Rigid;

/// Grain of the offset, metres.
const OFFSET_GRAIN_M: f64 = 1000.0;

/// A point on a surface and where photos show it, as structure from motion leaves it.
#[derive(Debug, Clone, PartialEq)]
pub struct TiePoint {
    /// Position of the point, map frame, metres.
    pub position: DVec3,
    /// Views by index, and pixels.
    pub sightings: Vec<(usize, DVec2)>,
    /// Mean distance between observed and projected pixels.
    pub error_px: f64,
}

/// A model to write: views with tie points, in the map frame minus an offset.
#[derive(Debug, Clone, Copy)]
pub struct ColmapModel<'a> {
    /// The views; images are numbered by their places from 1.
    pub views: &'a [View],
    /// Their tie points; may be empty.
    pub points: &'a [TiePoint],
    /// Taken off every position, metres.
    pub offset: DVec3,
}

impl ColmapModel<'_> {
    /// Writes `cameras.txt`, `images.txt` and `points3D.txt`. Views whose lens COLMAP cannot express are left out, each
    /// with an issue.
    ///
    /// # Errors
    /// [`FileError`] when a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<Vec<Issue>, FileError> {
        let mut issues = Vec::new();
        let mut ids: BTreeMap<String, usize> = BTreeMap::new();
        let mut cameras = Vec::new();
        let camera_ids: Vec<Option<usize>> = self
            .views
            .iter()
            .map(|view| match camera_row(&view.camera) {
                Ok(row) => Some(*ids.entry(row).or_insert_with_key(|row| {
                    cameras.push(row.clone());
                    cameras.len()
                })),
                Err(reason) => {
                    issues.push(refused("camera_not_expressible", &view.id.0, reason));
                    None
                }
            })
            .collect();
        write_whole(&folder.join("cameras.txt"), |file| {
            writeln!(file, "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]")?;
            cameras.iter().enumerate().try_for_each(|(i, row)| writeln!(file, "{} {row}", i + 1))
        })?;
        let mut sightings: Vec<Vec<(DVec2, usize)>> = vec![Vec::new(); self.views.len()];
        write_whole(&folder.join("points3D.txt"), |file| self.write_points(file, &camera_ids, &mut sightings))?;
        write_whole(&folder.join("images.txt"), |file| self.write_images(file, &camera_ids, &sightings))?;
        Ok(issues)
    }

    fn write_images(
        &self,
        file: &mut dyn std::io::Write,
        camera_ids: &[Option<usize>],
        sightings: &[Vec<(DVec2, usize)>],
    ) -> std::io::Result<()> {
        let DVec3 { x, y, z } = self.offset;
        writeln!(file, "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME")?;
        writeln!(file, "# POINTS2D[] as (X, Y, POINT3D_ID)")?;
        writeln!(file, "# Positions are those of the map minus ({x}, {y}, {z})")?;
        for (i, (view, camera_id)) in self.views.iter().zip(camera_ids).enumerate() {
            let Some(camera_id) = camera_id else { continue };
            let rotation = view.camera_from_map.rotation;
            let pose: Rigid<(), ()> = Rigid::from_rotation_and_centre(rotation, view.centre() - self.offset);
            let [w, x, y, z] = quaternion_wxyz(rotation);
            let t = pose.translation;
            writeln!(file, "{} {w} {x} {y} {z} {} {} {} {camera_id} {}", i + 1, t.x, t.y, t.z, view.id)?;
            let seen: Vec<String> =
                sightings[i].iter().map(|(at, point_id)| format!("{:.3} {:.3} {point_id}", at.x, at.y)).collect();
            writeln!(file, "{}", seen.join(" "))?;
        }
        Ok(())
    }

    /// Also gathers what each view sees: an image's line lists its points.
    fn write_points(
        &self,
        file: &mut dyn std::io::Write,
        camera_ids: &[Option<usize>],
        sightings: &mut [Vec<(DVec2, usize)>],
    ) -> std::io::Result<()> {
        writeln!(file, "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)")?;
        for (i, point) in self.points.iter().enumerate() {
            let p = point.position - self.offset;
            write!(file, "{} {:.4} {:.4} {:.4} 128 128 128 {:.3}", i + 1, p.x, p.y, p.z, point.error_px)?;
            for &(view, pixel) in point.sightings.iter().filter(|(view, _)| camera_ids[*view].is_some()) {
                write!(file, " {} {}", view + 1, sightings[view].len())?;
                sightings[view].push((pixel, i + 1));
            }
            writeln!(file)?;
        }
        Ok(())
    }
}

pub(super) fn write(survey: &Survey, project_crs: &Crs, folder: &Path) -> Result<Converted, SurveyError> {
    let offset = offset(&survey.views);
    let issues = ColmapModel { views: &survey.views, points: &[], offset }.write(folder)?;
    let path = |name: &str| -> PathBuf { folder.join(name) };
    let config = SurveyConfig {
        format: Format::Colmap,
        path: ".".into(),
        images: images_folder(&survey.views),
        crs: Some(project_crs.clone()),
        offset: offset.to_array(),
        ..SurveyConfig::default()
    };
    write_config(&config, &path("survey.toml"))?;
    Ok(Converted { files: ["cameras.txt", "images.txt", "points3D.txt", "survey.toml"].map(path).to_vec(), issues })
}

/// Whole kilometres near the middle of the survey; heights are small and stay.
fn offset(views: &[View]) -> DVec3 {
    let sum: DVec3 = views.iter().map(|view| view.camera_from_map.centre()).sum();
    let grain = |middle: f64| (middle / OFFSET_GRAIN_M).round() * OFFSET_GRAIN_M;
    let middle = sum / views.len().max(1) as f64;
    DVec3::new(grain(middle.x), grain(middle.y), 0.0)
}

/// A camera's line without its id.
fn camera_row(camera: &Camera) -> Result<String, String> {
    let Camera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, .. } = camera;
    let lens = format!("{width_px} {height_px} {fx_px} {fy_px} {cx_px} {cy_px}");
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
        Distortion::FisheyeSeries { .. } => {
            return Err("COLMAP has no fisheye with odd powers: write CSV, or undistort the photos".to_owned());
        }
    })
}
