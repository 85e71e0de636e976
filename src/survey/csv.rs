//! Poses in a table with declared columns and conventions: the universal fallback.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::SurveyError;
use super::config::{CameraConfig, CsvConfig, PixelOrigin};
use super::error::Place;
use super::poses::{Pose, Poses};
use crate::camera::{Camera, Distortion};
use crate::files::FileError;

/// Columns of the intrinsics, with other names they go by.
const CAMERA_COLUMNS: [(&str, &[&str]); 11] = [
    ("width", &["width_px", "image_width", "w"]),
    ("height", &["height_px", "image_height", "h"]),
    ("fx", &["fx_px", "f", "focal", "focal_px"]),
    ("fy", &["fy_px"]),
    ("cx", &["cx_px", "ppx"]),
    ("cy", &["cy_px", "ppy"]),
    ("k1", &[]),
    ("k2", &[]),
    ("k3", &[]),
    ("p1", &[]),
    ("p2", &[]),
];

/// Where the wanted columns stand.
struct Columns {
    name: usize,
    position: [usize; 3],
    rotation: Vec<usize>,
    /// In the order of [`CAMERA_COLUMNS`].
    camera: [Option<usize>; 11],
}

/// Reads a table of poses.
pub(crate) fn read(path: &Path, config: &CsvConfig) -> Result<Poses, SurveyError> {
    let delimiter = delimiter(path, &config.delimiter)?;
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    let mut reader = ::csv::ReaderBuilder::new()
        .delimiter(delimiter.unwrap_or(b','))
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(::csv::Trim::All)
        .from_reader(OneSpace::new(BufReader::new(file), delimiter.is_none()));
    let mut poses = Poses { north: config.north, ..Poses::new() };
    let mut columns = match &config.header {
        Some(header) => Some(Columns::find(header, config).map_err(|e| SurveyError::config(e, ""))?),
        None => None,
    };
    let mut cameras = CameraCache::default();
    let mut record = ::csv::StringRecord::new();
    loop {
        let is_more = reader
            .read_record(&mut record)
            .map_err(|e| SurveyError::malformed(path, Place::Line(line_of(&e)), e.to_string()))?;
        if !is_more {
            break;
        }
        let line = record.position().map_or(0, ::csv::Position::line);
        let Some(columns) = &columns else {
            let header: Vec<String> =
                record.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect();
            let found = Columns::find(&header, config);
            columns = Some(found.map_err(|e| SurveyError::malformed(path, Place::Line(line), e).hint(COLUMNS_HINT))?);
            continue;
        };
        let name = record.get(columns.name).unwrap_or_default();
        if name.is_empty() {
            return Err(SurveyError::malformed(path, Place::Line(line), "the row has no name"));
        }
        match pose(&record, columns, config, &mut cameras) {
            Ok(pose) => poses.poses.push(pose),
            Err(reason) => poses.refuse("pose_unusable", name, format!("line {line}: {reason}")),
        }
    }
    Ok(poses)
}

const COLUMNS_HINT: &str = "name the columns under [survey.csv]: name, x, y, z, angle_columns; or give `header`";

fn line_of(error: &::csv::Error) -> u64 {
    error.position().map_or(0, ::csv::Position::line)
}

/// The separator: `None` is any run of blanks.
fn delimiter(path: &Path, declared: &str) -> Result<Option<u8>, SurveyError> {
    match declared {
        "tab" | "\t" => return Ok(Some(b'\t')),
        "whitespace" => return Ok(None),
        "" => {}
        _ if declared.len() == 1 => return Ok(Some(declared.as_bytes()[0])),
        _ => {
            let message = format!("csv.delimiter {declared:?}");
            return Err(SurveyError::config(message, "one character, or \"tab\" or \"whitespace\""));
        }
    }
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    let mut first = String::new();
    // A line that is not text is reported by the reader proper, with its place.
    let _ = std::io::Read::take(BufReader::new(file), 1 << 16).read_line(&mut first);
    Ok(b"\t;,".iter().copied().find(|&separator| first.as_bytes().contains(&separator)))
}

impl Columns {
    fn find(header: &[String], config: &CsvConfig) -> Result<Self, String> {
        let seek = |wanted: &str| header.iter().position(|name| name.eq_ignore_ascii_case(wanted));
        let need = |wanted: &str| {
            seek(wanted).ok_or_else(|| format!("there is no column {wanted:?}; the columns are {}", header.join(", ")))
        };
        let rotation: Result<Vec<usize>, String> = config.angle_columns().iter().map(|name| need(name)).collect();
        let camera = CAMERA_COLUMNS.map(|(name, others)| seek(name).or_else(|| others.iter().find_map(|o| seek(o))));
        let columns = Self {
            name: need(&config.name)?,
            position: [need(&config.x)?, need(&config.y)?, need(&config.z)?],
            rotation: rotation?,
            camera,
        };
        let n_needed = config.angles.n_values();
        if columns.rotation.len() != n_needed {
            return Err(format!("{} angle columns: expected {n_needed}", columns.rotation.len()));
        }
        let has_camera = camera[..3].iter().all(Option::is_some);
        if !has_camera && config.camera.is_none() {
            return Err("there is no camera: neither columns width, height, fx nor [survey.csv.camera]".to_owned());
        }
        Ok(columns)
    }
}

fn pose(
    record: &::csv::StringRecord,
    columns: &Columns,
    config: &CsvConfig,
    cameras: &mut CameraCache,
) -> Result<Pose, String> {
    let value = |column: usize| -> Result<f64, String> {
        let field = record.get(column).ok_or_else(|| format!("the row ends before column {}", column + 1))?;
        field.parse().map_err(|_| format!("{field:?} in column {} is not a number", column + 1))
    };
    let [x, y, z] = columns.position;
    let values: Result<Vec<f64>, String> = columns.rotation.iter().map(|&column| value(column)).collect();
    let mut intrinsics = [None; 11];
    for (intrinsic, column) in intrinsics.iter_mut().zip(&columns.camera) {
        *intrinsic = column.filter(|&c| record.get(c).is_some_and(|field| !field.is_empty())).map(value).transpose()?;
    }
    Ok(Pose {
        name: record.get(columns.name).unwrap_or_default().to_owned(),
        camera: cameras.get(intrinsics, config)?,
        camera_from_world: config.convention().camera_from_world(&values?)?,
        centre: DVec3::new(value(x)?, value(y)?, value(z)?),
    })
}

/// Cameras that were made, by the bits of their row, so that photos share them.
#[derive(Default)]
struct CameraCache(HashMap<[Option<u64>; 11], Arc<Camera>>);

impl CameraCache {
    fn get(&mut self, intrinsics: [Option<f64>; 11], config: &CsvConfig) -> Result<Arc<Camera>, String> {
        let key = intrinsics.map(|value| value.map(f64::to_bits));
        if let Some(camera) = self.0.get(&key) {
            return Ok(Arc::clone(camera));
        }
        let camera = Arc::new(camera_of(intrinsics, config)?);
        self.0.insert(key, Arc::clone(&camera));
        Ok(camera)
    }
}

/// A row's own values go before the declared camera's.
fn camera_of(row: [Option<f64>; 11], config: &CsvConfig) -> Result<Camera, String> {
    let declared = config.camera.as_ref();
    let or = |i: usize, get: fn(&CameraConfig) -> Option<f64>| row[i].or_else(|| declared.and_then(get));
    let missing = |what: &str| format!("its camera has no {what}");
    let pixels = |value: f64, what: &str| {
        let whole = value.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&value);
        if whole { Ok(value as u32) } else { Err(format!("image {what} {value} px: expected a whole positive number")) }
    };
    let width_px = pixels(or(0, |c| Some(c.width.into())).ok_or_else(|| missing("width"))?, "width")?;
    let height_px = pixels(or(1, |c| Some(c.height.into())).ok_or_else(|| missing("height"))?, "height")?;
    let fx_px = or(2, |c| Some(c.fx)).ok_or_else(|| missing("focal length"))?;
    let shift_px = match config.pixel_origin {
        PixelOrigin::Corner => 0.0,
        PixelOrigin::PixelCentre => 0.5,
    };
    let [k1, k2, k3] =
        [or(6, |c| Some(c.k[0])), or(7, |c| Some(c.k[1])), or(8, |c| Some(c.k[2]))].map(|k| k.unwrap_or(0.0));
    let [p1, p2] = [or(9, |c| Some(c.p[0])), or(10, |c| Some(c.p[1]))].map(|p| p.unwrap_or(0.0));
    let is_ideal = [k1, k2, k3, p1, p2].iter().all(|&c| c == 0.0);
    let camera = Camera {
        width_px,
        height_px,
        fx_px,
        fy_px: or(3, |c| c.fy).unwrap_or(fx_px),
        cx_px: or(4, |c| c.cx).map_or(f64::from(width_px) / 2.0, |cx| cx + shift_px),
        cy_px: or(5, |c| c.cy).map_or(f64::from(height_px) / 2.0, |cy| cy + shift_px),
        distortion: if is_ideal { Distortion::None } else { Distortion::Brown { k1, k2, k3, p1, p2 } },
    };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(camera)
}

/// Turns runs of blanks into one comma each, for tables whose columns are aligned by blanks.
struct OneSpace<R> {
    inner: R,
    is_on: bool,
    in_run: bool,
    at_line_start: bool,
}

impl<R> OneSpace<R> {
    fn new(inner: R, is_on: bool) -> Self {
        Self { inner, is_on, in_run: false, at_line_start: true }
    }
}

impl<R: std::io::Read> std::io::Read for OneSpace<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        loop {
            let n = self.inner.read(buffer)?;
            if !self.is_on || n == 0 {
                return Ok(n);
            }
            let mut kept = 0;
            for i in 0..n {
                let byte = buffer[i];
                let is_blank = byte == b' ' || byte == b'\t' || byte == b',';
                if !is_blank || !(self.in_run || self.at_line_start) {
                    buffer[kept] = if is_blank { b',' } else { byte };
                    kept += 1;
                }
                self.in_run = is_blank;
                self.at_line_start = (self.at_line_start && is_blank) || byte == b'\n';
            }
            if kept > 0 {
                return Ok(kept);
            }
        }
    }
}
