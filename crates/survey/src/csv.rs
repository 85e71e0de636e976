//! Poses in a table with declared columns and conventions: the universal fallback.

use std::collections::HashMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::config::{CameraConfig, CsvConfig, PixelOrigin};
use super::csv_header::{CsvHeader, CsvLayout, layout, names_angles};
use super::error::Place;
use super::formats::FileMarks;
use super::poses::{FileHeights, Pose, Poses, World};
use super::{SurveyConfig, SurveyError};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::FileError;
use sizeup_heights::camera::{Camera, Distortion};

/// Columns of the intrinsics, with other names they go by.
const CAMERA_COLUMNS: [(&str, &[&str]); N_INTRINSICS] = [
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
    ("k4", &[]),
    ("k5", &[]),
    ("k6", &[]),
    ("skew", &[]),
];

/// Intrinsics a row may hold.
const N_INTRINSICS: usize = 15;

/// The columns of lens coefficients, in the order in which they are written.
pub(crate) const LENS_COLUMNS: [&str; 9] = ["k1", "k2", "k3", "p1", "p2", "k4", "k5", "k6", "skew"];

/// A table's columns and conventions, and the camera for rows without one.
struct Declared<'a> {
    table: &'a CsvConfig,
    camera: Option<&'a CameraConfig>,
}

/// Positions of the wanted columns.
struct ColumnPositions {
    name: usize,
    position: [usize; 3],
    rotation: Vec<usize>,
    /// In the order of [`CAMERA_COLUMNS`].
    camera: [Option<usize>; N_INTRINSICS],
    lens: Option<usize>,
    /// Whether the position is longitude and latitude, by its columns' names.
    are_degrees: bool,
}

/// Names that tools give the photo's column.
const NAME_COLUMNS: [&str; 13] = [
    "image",
    "imagename",
    "image_name",
    "imageid",
    "image_id",
    "photo",
    "photoid",
    "photo_id",
    "photoname",
    "filename",
    "file",
    "label",
    "id",
];
const LONGITUDES: [&str; 4] = ["longitude", "lon", "long", "lng"];
const X_COLUMNS: [&str; 7] = ["easting", "east", "e", "longitude", "lon", "long", "lng"];
const Y_COLUMNS: [&str; 5] = ["northing", "north", "n", "latitude", "lat"];
/// Not `height`, which is the image's.
const Z_COLUMNS: [&str; 3] = ["altitude", "alt", "elevation"];

/// A `.csv` or `.tsv`, or text that names angles in its header.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    let is_table = marks.has_extension("csv") || marks.has_extension("tsv");
    is_table || (!marks.is_folder && names_angles(&marks.head))
}

/// Reads a table as the survey declares it.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    read_table(&config.path, &config.csv.clone().unwrap_or_default(), config.camera.as_ref())
}

/// Reads a table of poses.
pub(crate) fn read_table(path: &Path, config: &CsvConfig, camera: Option<&CameraConfig>) -> Result<Poses, SurveyError> {
    let config = Declared { table: config, camera };
    let CsvLayout { delimiter, header } =
        layout(path, config.table, |header| ColumnPositions::find(header, &config).is_ok())?;
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    let mut reader = ::csv::ReaderBuilder::new()
        .delimiter(delimiter.unwrap_or(b','))
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(::csv::Trim::All)
        .from_reader(OneSpace::new(BufReader::new(file), delimiter.is_none()));
    let mut poses = Poses { north: config.table.north, ..Poses::new() };
    let Some(header) = header else { return Ok(poses) };
    let columns = ColumnPositions::find(&header, &config).and_then(|columns| columns.with_camera(&config));
    let columns = columns.map_err(|e| match config.table.header {
        Some(_) => SurveyError::config(e, ""),
        None => SurveyError::malformed(path, Place::Line(1), e).hint(COLUMNS_HINT),
    })?;
    if columns.are_degrees {
        // A receiver's, whose heights may count from anything.
        (poses.world, poses.heights) = (World::Crs(Crs::parse("EPSG:4326")?), FileHeights::Unreliable);
    }
    let mut is_header = header.is_row;
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
        if std::mem::take(&mut is_header) {
            continue;
        }
        let name = record.get(columns.name).unwrap_or_default();
        if name.is_empty() {
            return Err(SurveyError::malformed(path, Place::Line(line), "the row has no name"));
        }
        match pose(&record, &columns, &config, &mut cameras) {
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

impl ColumnPositions {
    fn find(header: &CsvHeader, declared: &Declared<'_>) -> Result<Self, String> {
        let config = declared.table;
        let missing =
            |wanted: &str| format!("there is no column {wanted:?}; the columns are {}", header.names.join(", "));
        let need = |wanted: &str, own: &str, others: &[&str]| {
            header.seek_any(wanted, own, others).ok_or_else(|| missing(wanted))
        };
        let rotation: Result<Vec<usize>, String> =
            config.angle_columns().iter().map(|name| header.seek(name).ok_or_else(|| missing(name))).collect();
        let rotation = rotation?;
        header.check_unit(&rotation, config)?;
        let camera = CAMERA_COLUMNS
            .map(|(name, others)| header.seek(name).or_else(|| others.iter().find_map(|o| header.seek(o))));
        let x = need(&config.x, "x", &X_COLUMNS)?;
        let columns = Self {
            name: need(&config.name, "name", &NAME_COLUMNS)?,
            position: [x, need(&config.y, "y", &Y_COLUMNS)?, need(&config.z, "z", &Z_COLUMNS)?],
            rotation,
            camera,
            lens: header.seek("lens"),
            are_degrees: LONGITUDES.iter().any(|name| header.names[x].eq_ignore_ascii_case(name)),
        };
        let n_needed = config.angles.n_values();
        if columns.rotation.len() != n_needed {
            return Err(format!("{} angle columns: expected {n_needed}", columns.rotation.len()));
        }
        Ok(columns)
    }

    /// Itself, if it or the configuration has a camera.
    fn with_camera(self, declared: &Declared<'_>) -> Result<Self, String> {
        let has_camera = self.camera[..3].iter().all(Option::is_some);
        if !has_camera && declared.camera.is_none() {
            return Err("there is no camera: neither columns width, height, fx nor [survey.camera]".to_owned());
        }
        Ok(self)
    }
}

fn pose(
    record: &::csv::StringRecord,
    columns: &ColumnPositions,
    config: &Declared<'_>,
    cameras: &mut CameraCache,
) -> Result<Pose, String> {
    let value = |column: usize| -> Result<f64, String> {
        let field = record.get(column).ok_or_else(|| format!("the row ends before column {}", column + 1))?;
        field.parse().map_err(|_| format!("{field:?} in column {} is not a number", column + 1))
    };
    let [x, y, z] = columns.position;
    let values: Result<Vec<f64>, String> = columns.rotation.iter().map(|&column| value(column)).collect();
    let mut intrinsics = [None; N_INTRINSICS];
    for (intrinsic, column) in intrinsics.iter_mut().zip(&columns.camera) {
        *intrinsic = column.filter(|&c| record.get(c).is_some_and(|field| !field.is_empty())).map(value).transpose()?;
    }
    Ok(Pose {
        name: record.get(columns.name).unwrap_or_default().to_owned(),
        camera: cameras.get(intrinsics, columns.lens.and_then(|c| record.get(c)).unwrap_or_default(), config)?,
        camera_from_world: config.table.convention().camera_from_world(&values?)?,
        centre: DVec3::new(value(x)?, value(y)?, value(z)?),
    })
}

/// Cameras that were made, by the bits of their row, so that photos share them.
#[derive(Default)]
struct CameraCache(HashMap<(String, [Option<u64>; N_INTRINSICS]), Arc<Camera>>);

impl CameraCache {
    fn get(
        &mut self,
        intrinsics: [Option<f64>; N_INTRINSICS],
        lens: &str,
        config: &Declared<'_>,
    ) -> Result<Arc<Camera>, String> {
        let key = (lens.to_owned(), intrinsics.map(|value| value.map(f64::to_bits)));
        if let Some(camera) = self.0.get(&key) {
            return Ok(Arc::clone(camera));
        }
        let camera = Arc::new(camera_of(intrinsics, lens, config.camera, config.table.pixel_origin)?);
        self.0.insert(key, Arc::clone(&camera));
        Ok(camera)
    }
}

/// A camera declared in the configuration.
pub(crate) fn declared_camera(camera: &CameraConfig, pixel_origin: PixelOrigin) -> Result<Camera, String> {
    camera_of([None; N_INTRINSICS], "", Some(camera), pixel_origin)
}

/// A row's own values go before the declared camera's.
fn camera_of(
    row: [Option<f64>; N_INTRINSICS],
    lens: &str,
    declared: Option<&CameraConfig>,
    pixel_origin: PixelOrigin,
) -> Result<Camera, String> {
    let or = |i: usize, get: fn(&CameraConfig) -> Option<f64>| row[i].or_else(|| declared.and_then(get));
    let missing = |what: &str| format!("its camera has no {what}");
    let pixels = |value: f64, what: &str| {
        let is_whole = value.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&value);
        if is_whole {
            Ok(value as u32)
        } else {
            Err(format!("image {what} {value} px: expected a whole positive number"))
        }
    };
    let width_px = pixels(or(0, |c| Some(c.width.into())).ok_or_else(|| missing("width"))?, "width")?;
    let height_px = pixels(or(1, |c| Some(c.height.into())).ok_or_else(|| missing("height"))?, "height")?;
    let fx_px = or(2, |c| Some(c.fx)).ok_or_else(|| missing("focal length"))?;
    let shift_px = match pixel_origin {
        PixelOrigin::Corner => 0.0,
        PixelOrigin::PixelCentre => 0.5,
    };
    let camera = Camera {
        width_px,
        height_px,
        fx_px,
        fy_px: or(3, |c| c.fy).unwrap_or(fx_px),
        cx_px: or(4, |c| c.cx).map_or(f64::from(width_px) / 2.0, |cx| cx + shift_px),
        cy_px: or(5, |c| c.cy).map_or(f64::from(height_px) / 2.0, |cy| cy + shift_px),
        distortion: distortion_of(&row, lens, declared)?,
    };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(camera)
}

/// The lens of a row: Brown's unless the column `lens` says otherwise.
fn distortion_of(
    row: &[Option<f64>; N_INTRINSICS],
    lens: &str,
    declared: Option<&CameraConfig>,
) -> Result<Distortion, String> {
    let of_declared = declared.map_or([0.0; 5], |c| [c.k[0], c.k[1], c.k[2], c.p[0], c.p[1]]);
    let [k1, k2, k3, p1, p2] = [0, 1, 2, 3, 4].map(|i| row[6 + i].unwrap_or(of_declared[i]));
    let [k4, k5, k6, skew] = [11, 12, 13, 14].map(|i| row[i].unwrap_or(0.0));
    Ok(match lens {
        "" => Distortion::brown([k1, k2, k3], [p1, p2]),
        "none" => Distortion::None,
        "brown" => Distortion::Brown { k1, k2, k3, p1, p2 },
        "brown_affine" => Distortion::BrownAffine { k1, k2, k3, k4, p1, p2, skew },
        "rational" => Distortion::Rational { k1, k2, k3, k4, k5, k6, p1, p2 },
        "fisheye" => Distortion::Fisheye { k1, k2, k3, k4 },
        "fisheye_series" => Distortion::FisheyeSeries { k1, k2, k3 },
        other => {
            let known = "none, brown, brown_affine, rational, fisheye or fisheye_series";
            return Err(format!("lens {other:?}: expected {known}"));
        }
    })
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
