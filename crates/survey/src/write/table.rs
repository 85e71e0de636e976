//! CSV: one row per view with a quaternion and the whole camera; omega, phi, kappa for people; `*.survey.toml` beside.

use std::path::Path;

use super::{Converted, images_folder, write_config};
use crate::angles::{AngleKind, opk_deg, quaternion_wxyz};
use crate::csv::LENS_COLUMNS;
use crate::{CsvConfig, Format, Survey, SurveyConfig, SurveyError};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_whole;
use sizeup_heights::camera::{Camera, Distortion};

pub(super) fn write(survey: &Survey, project_crs: &Crs, path: &Path) -> Result<Converted, SurveyError> {
    write_whole(path, |file| {
        let mut writer = ::csv::Writer::from_writer(file);
        let head = ["name", "x", "y", "z", "qw", "qx", "qy", "qz", "omega", "phi", "kappa"];
        let camera = ["width", "height", "fx", "fy", "cx", "cy", "lens"];
        writer.write_record(head.iter().chain(&camera).chain(&LENS_COLUMNS))?;
        for view in &survey.views {
            let rotation = view.camera_from_map.rotation;
            let centre = view.camera_from_map.centre().to_array();
            let pose = centre.into_iter().chain(quaternion_wxyz(rotation)).chain(opk_deg(rotation));
            let row = std::iter::once(view.id.0.clone()).chain(pose.map(|number| number.to_string()));
            writer.write_record(row.chain(camera_fields(&view.camera)))?;
        }
        writer.flush()
    })?;
    let config = SurveyConfig {
        format: Format::Csv,
        path: path.file_name().map(Into::into).unwrap_or_default(),
        images: images_folder(&survey.views),
        crs: Some(project_crs.clone()),
        csv: Some(CsvConfig { angles: AngleKind::Quaternion, ..CsvConfig::default() }),
        ..SurveyConfig::default()
    };
    let config_path = write_config(&config, &path.with_extension("survey.toml"))?;
    Ok(Converted { files: vec![path.to_owned(), config_path], issues: Vec::new() })
}

fn camera_fields(camera: &Camera) -> impl Iterator<Item = String> + use<> {
    let lens = match camera.distortion {
        Distortion::None => "none",
        Distortion::Brown { .. } => "brown",
        Distortion::BrownAffine { .. } => "brown_affine",
        Distortion::Rational { .. } => "rational",
        Distortion::Fisheye { .. } => "fisheye",
        Distortion::FisheyeSeries { .. } => "fisheye_series",
    };
    let coefficients: Vec<(&str, f64)> = camera.distortion.coefficients().collect();
    let coefficient = move |name: &str| {
        coefficients.iter().find(|(known, _)| *known == name).map_or_else(String::new, |(_, value)| value.to_string())
    };
    let numbers = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px].map(|number| number.to_string());
    [camera.width_px.to_string(), camera.height_px.to_string()]
        .into_iter()
        .chain(numbers)
        .chain(std::iter::once(lens.to_owned()))
        .chain(LENS_COLUMNS.map(coefficient))
}
