//! Poses in a table with declared columns and conventions: the universal fallback.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::angles::AngleUnit;
use super::config::{CameraConfig, CsvConfig, PixelOrigin};
use super::csv_header::{ColumnUnit, CsvHeader, CsvLayout, HeaderFit, layout, names_angles};
use super::error::Place;
use super::formats::FileMarks;
use super::heights::{FileUnits, HeightUnit};
use super::poses::{FileHeights, Pose, Poses, World};
use super::{SurveyConfig, SurveyError, text};
use sizeup_geo::crs::Crs;
use sizeup_heights::camera::{Camera, Distortion};

/// Columns of the intrinsics, with other names they go by.
const CAMERA_COLUMNS: [(&str, &[&str]); N_INTRINSICS] = [
    ("width", &["image_width", "w"]),
    ("height", &["image_height", "h"]),
    ("fx", &["f", "focal"]),
    ("fy", &[]),
    ("cx", &["ppx"]),
    ("cy", &["ppy"]),
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
/// The first of them: the size of the image, which has to be in pixels as the focal lengths and the principal point have.
const N_IN_PIXELS: usize = 6;
/// The first of them that [`CameraConfig`] always has: size and focal lengths.
const N_DECLARED: usize = 4;

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
    /// Whether the position is longitude and latitude, by its columns' names or units.
    are_degrees: bool,
    units: FileUnits,
}

/// Names that tools give the photo's column.
const NAME_COLUMNS: [&str; 10] =
    ["image", "imagename", "imageid", "photo", "photoid", "photoname", "filename", "file", "label", "id"];
const LONGITUDES: [&str; 4] = ["longitude", "lon", "long", "lng"];
const X_COLUMNS: [&str; 7] = ["easting", "east", "e", "longitude", "lon", "long", "lng"];
const Y_COLUMNS: [&str; 5] = ["northing", "north", "n", "latitude", "lat"];
/// Before `height` and `h`, which are the image's unless the header has a length for their unit, or no width.
const Z_COLUMNS: [&str; 3] = ["altitude", "alt", "elevation"];
const HEIGHTS: [&str; 2] = ["height", "h"];

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
    let text = text::read(path)?;
    let CsvLayout { delimiter, header, rows } =
        layout(&text, config.table, |header| ColumnPositions::fit(header, &config));
    let mut reader = ::csv::ReaderBuilder::new()
        .delimiter(delimiter.unwrap_or(b','))
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(::csv::Trim::All)
        .from_reader(OneSpace::new(rows.as_bytes(), delimiter.is_none()));
    let mut poses = Poses { north: config.table.north, ..Poses::new() };
    let Some(header) = header else { return Ok(poses) };
    let columns = ColumnPositions::find(&header, &config).and_then(|columns| columns.with_camera(&header, &config));
    let columns = columns.map_err(|e| match config.table.header {
        Some(_) => SurveyError::config(e, ""),
        None => SurveyError::malformed(path, Place::Line(1), e).hint(COLUMNS_HINT),
    })?;
    if columns.are_degrees {
        // A receiver's, whose heights may count from anything.
        (poses.world, poses.heights) = (World::Crs(Crs::parse("EPSG:4326")?), FileHeights::Unreliable);
    }
    poses.units = columns.units;
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
        // Spreadsheets leave rows of nothing but separators.
        let is_empty = record.iter().all(str::is_empty);
        if is_empty || std::mem::take(&mut is_header) {
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
    /// How well a header serves as this table's.
    fn fit(header: &CsvHeader, declared: &Declared<'_>) -> HeaderFit {
        const FEW: usize = 3;
        if Self::find(header, declared).is_ok() {
            return HeaderFit::All;
        }
        let config = declared.table;
        let position = [
            header.seek_any(&config.name, "name", &NAME_COLUMNS),
            header.seek_any(&config.x, "x", &X_COLUMNS),
            header.seek_any(&config.y, "y", &Y_COLUMNS),
            header.seek_any(&config.z, "z", &Z_COLUMNS),
        ];
        let angles = config.angle_columns();
        let n_found =
            position.into_iter().flatten().count() + angles.iter().filter_map(|name| header.seek(name)).count();
        if n_found >= FEW { HeaderFit::Some } else { HeaderFit::None }
    }

    fn find(header: &CsvHeader, declared: &Declared<'_>) -> Result<Self, String> {
        let config = declared.table;
        let missing = |wanted: &str| format!("there is no column {wanted:?}; the columns are {}", header.names());
        let need = |wanted: &str, own: &str, others: &[&str]| {
            header.seek_any(wanted, own, others).ok_or_else(|| missing(wanted))
        };
        let rotation: Result<Vec<usize>, String> =
            config.angle_columns().iter().map(|name| header.seek(name).ok_or_else(|| missing(name))).collect();
        let rotation = rotation?;
        header.check_angles(&rotation, config)?;
        let n_needed = config.angles.n_values();
        if rotation.len() != n_needed {
            return Err(format!("{} angle columns: expected {n_needed}", rotation.len()));
        }
        let name = need(&config.name, "name", &NAME_COLUMNS)?;
        let (x, y) = (need(&config.x, "x", &X_COLUMNS)?, need(&config.y, "y", &Y_COLUMNS)?);
        let z = header.seek_any(&config.z, "z", &Z_COLUMNS);
        let z =
            z.or_else(|| height_of_position(header).filter(|_| config.z == "z")).ok_or_else(|| missing(&config.z))?;
        let serves_pose = |column: &usize| [name, x, y, z].contains(column) || rotation.contains(column);
        let camera = CAMERA_COLUMNS.map(|(name, others)| {
            let names = std::iter::once(&name).chain(others);
            names.filter_map(|name| header.seek(name)).find(|column| !serves_pose(column))
        });
        let plane = unit_of_plane(header, x, y)?;
        Ok(Self {
            name,
            position: [x, y, z],
            rotation,
            camera,
            lens: header.seek("lens"),
            are_degrees: header.is_one_of(x, &LONGITUDES) || matches!(plane, Some(ColumnUnit::Angle(_))),
            units: FileUnits {
                plane_m: if let Some(ColumnUnit::Length(unit_m)) = plane { Some(unit_m) } else { None },
                heights: unit_of_heights(header, z)?,
            },
        })
    }

    /// Itself, if it or the configuration has a camera. What the configuration declares is not read from columns, whose unit
    /// may be another.
    fn with_camera(mut self, header: &CsvHeader, declared: &Declared<'_>) -> Result<Self, String> {
        if declared.camera.is_some() {
            self.camera[..N_DECLARED].fill(None);
            return Ok(self);
        }
        if self.camera[..3].iter().any(Option::is_none) {
            return Err("there is no camera: neither columns width, height, fx nor [survey.camera]".to_owned());
        }
        // RealityScan's names: mm of 36 mm film, of which the program's own table has no size of the image either.
        let is_realityscan = self.camera[2].is_some_and(|column| header.is_one_of(column, &["f"]));
        if is_realityscan && header.seek("px").is_some() && header.seek("py").is_some() {
            let message = "the columns f, px, py are RealityScan's, which count in 36 mm film: declare the camera under [survey.camera]";
            return Err(message.to_owned());
        }
        for column in self.camera[..N_IN_PIXELS].iter().flatten() {
            if !matches!(header.unit(*column)?, None | Some(ColumnUnit::Pixels)) {
                return Err(header.wrong_unit(*column, "pixels; or declare the camera under [survey.camera]"));
            }
        }
        Ok(self)
    }
}

/// The column `height` where it is that of the position and not the image's.
fn height_of_position(header: &CsvHeader) -> Option<usize> {
    let (width, others) = CAMERA_COLUMNS[0];
    let has_width = std::iter::once(&width).chain(others).any(|name| header.seek(name).is_some());
    let is_length = |column: &usize| matches!(header.unit(*column), Ok(Some(ColumnUnit::Length(_))));
    HEIGHTS.iter().filter_map(|name| header.seek(name)).find(|column| !has_width || is_length(column))
}

/// The unit of eastings and northings, or of longitudes and latitudes, which is one.
fn unit_of_plane(header: &CsvHeader, x: usize, y: usize) -> Result<Option<ColumnUnit>, String> {
    let expected = "degrees or a length, the same for both positions";
    match (header.unit(x)?, header.unit(y)?) {
        (Some(of_x), Some(of_y)) if of_x != of_y => Err(header.wrong_unit(y, expected)),
        (Some(ColumnUnit::Pixels), _) => Err(header.wrong_unit(x, expected)),
        (Some(ColumnUnit::Angle(unit)), _) if unit != AngleUnit::Deg => Err(header.wrong_unit(x, expected)),
        (of_x, of_y) => Ok(of_x.or(of_y)),
    }
}

fn unit_of_heights(header: &CsvHeader, z: usize) -> Result<HeightUnit, String> {
    match header.unit(z)? {
        Some(ColumnUnit::Length(unit_m)) => Ok(HeightUnit::Metres(unit_m)),
        Some(_) => Err(header.wrong_unit(z, "a length")),
        None => Ok(HeightUnit::Unsaid),
    }
}

/// A row of the table, with its numbers as its producer writes them.
struct Row<'a> {
    record: &'a ::csv::StringRecord,
    /// Whether a number of it has a point for its decimals.
    has_points: bool,
}

impl<'a> Row<'a> {
    fn of(record: &'a ::csv::StringRecord, columns: &ColumnPositions) -> Self {
        let camera = columns.camera.iter().flatten();
        let mut numbers = columns.position.iter().chain(&columns.rotation).chain(camera);
        let has_points = numbers.any(|&column| record.get(column).is_some_and(|field| field.contains('.')));
        Self { record, has_points }
    }

    /// A number. One comma is that of decimals where no number of the row has a point.
    fn number(&self, column: usize) -> Result<f64, String> {
        let field = self.record.get(column).ok_or_else(|| format!("the row ends before column {}", column + 1))?;
        let has_decimal_comma = !self.has_points && field.matches(',').count() == 1;
        let number = if has_decimal_comma { field.replace(',', ".").parse() } else { field.parse() };
        number.map_err(|_| {
            let about = if field.contains(',') { ": expected no separator of thousands" } else { "" };
            format!("{field:?} in column {} is not a number{about}", column + 1)
        })
    }
}

fn pose(
    record: &::csv::StringRecord,
    columns: &ColumnPositions,
    config: &Declared<'_>,
    cameras: &mut CameraCache,
) -> Result<Pose, String> {
    let row = Row::of(record, columns);
    let [x, y, z] = columns.position;
    let values: Result<Vec<f64>, String> = columns.rotation.iter().map(|&column| row.number(column)).collect();
    let mut intrinsics = [None; N_INTRINSICS];
    for (intrinsic, column) in intrinsics.iter_mut().zip(&columns.camera) {
        let column = column.filter(|&c| record.get(c).is_some_and(|field| !field.is_empty()));
        *intrinsic = column.map(|column| row.number(column)).transpose()?;
    }
    Ok(Pose {
        name: record.get(columns.name).unwrap_or_default().to_owned(),
        camera: cameras.get(intrinsics, columns.lens.and_then(|c| record.get(c)).unwrap_or_default(), config)?,
        camera_from_world: config.table.convention().camera_from_world(&values?)?,
        centre: DVec3::new(row.number(x)?, row.number(y)?, row.number(z)?),
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

/// Camera of a row: declared values go before the row's own. Coefficients that are all zero are not declared.
fn camera_of(
    row: [Option<f64>; N_INTRINSICS],
    lens: &str,
    declared: Option<&CameraConfig>,
    pixel_origin: PixelOrigin,
) -> Result<Camera, String> {
    let or = |i: usize, get: fn(&CameraConfig) -> Option<f64>| declared.and_then(get).or(row[i]);
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
    let of_declared = declared.map(|c| [c.k[0], c.k[1], c.k[2], c.p[0], c.p[1]]).filter(|all| *all != [0.0; 5]);
    let [k1, k2, k3, p1, p2] = [0, 1, 2, 3, 4].map(|i| of_declared.map(|all| all[i]).or(row[6 + i]).unwrap_or(0.0));
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

#[cfg(test)]
mod tests;
