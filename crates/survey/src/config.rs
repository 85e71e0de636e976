//! What the user declares about a survey: its format, place, CRS and, for CSV, every convention.

use std::path::PathBuf;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::angles::{AngleConvention, AngleKind, AngleUnit, CameraAxes, Direction, North, PitchZero, Sequence};
use super::formats::Format;
use super::{SurveyError, csv};
use sizeup_geo::crs::Crs;
use sizeup_geo::paths::PathVisitor;
use sizeup_heights::camera::Camera;

/// Where the poses come from and what their numbers mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SurveyConfig {
    /// File format of the poses; `auto` looks at the files.
    #[serde(default)]
    pub format: Format,
    /// The poses' file, or the folder of a model or of photos.
    pub path: PathBuf,
    /// Folder of the photos, matched to the poses by name. Without it no photo is looked for. In an archive or on a server:
    /// `/vsizip/photos.zip/{name}`, `/vsicurl/https://…/{stem}.jpg` (servers only with `--allow-remote`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub images: Option<PathBuf>,
    /// CRS of the poses as `EPSG:n`, WKT or PROJ string. Default: what the file says, else the project's CRS.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub crs: Option<Crs>,
    /// Added to every position before anything else, metres (or the unit of the poses' CRS): x, y, z.
    #[serde(default)]
    pub offset: [f64; 3],
    /// Origin of poses in a local east, north, up frame: latitude, longitude (degrees, WGS 84), ellipsoidal height (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub enu_origin: Option<[f64; 3]>,
    /// Order of P1 and P2 in `BlocksExchange` files, which do not say. Default: OpenCV's, with a warning.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub tangential: Option<TangentialOrder>,
    /// Vertical datum of the poses' heights, and how they reach the project's.
    #[serde(default)]
    pub height: HeightConfig,
    /// One camera for all photos, for formats that carry none. It goes before the columns of a table; what other formats say goes
    /// before it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraConfig>,
    /// Columns and conventions of a CSV file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub csv: Option<CsvConfig>,
    /// Go on although the survey report says that the poses look wrong, or their datum reaches the project's only to more than a
    /// metre. Recorded as an issue of the result.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub accept_unsound: bool,
}

impl Default for SurveyConfig {
    fn default() -> Self {
        Self {
            format: Format::Auto,
            path: PathBuf::new(),
            images: None,
            crs: None,
            offset: [0.0; 3],
            enu_origin: None,
            tangential: None,
            height: HeightConfig::default(),
            camera: None,
            csv: None,
            accept_unsound: false,
        }
    }
}

impl SurveyConfig {
    /// The camera under `[survey.camera]`, for a format that carries none: `format` is its name in the error.
    ///
    /// # Errors
    /// [`SurveyError::Config`] where no camera is declared, or the declared one cannot be.
    pub(crate) fn declared_camera(&self, format: &str) -> Result<Arc<Camera>, SurveyError> {
        let camera = self.camera.as_ref().ok_or_else(|| {
            let hint = "declare it under [survey.camera]: width, height, fx and what is known of the lens";
            SurveyError::config(format!("{format} carries no camera"), hint)
        })?;
        let camera = csv::declared_camera(camera, PixelOrigin::default());
        camera.map(Arc::new).map_err(|e| SurveyError::config(e, ""))
    }
}

/// Which tangential coefficient is the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TangentialOrder {
    /// `x += 2 P1 x y + P2 (r² + 2x²)`
    #[default]
    Opencv,
    /// `x += P1 (r² + 2x²) + 2 P2 x y`
    Metashape,
}

impl TangentialOrder {
    /// OpenCV's p1, p2 of a file's P1, P2.
    pub(crate) fn opencv(self, [p1, p2]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Opencv => [p1, p2],
            Self::Metashape => [p2, p1],
        }
    }
}

/// Vertical datum of heights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VerticalDatum {
    /// The project's own vertical reference: taken as they are.
    Project,
    /// The ellipsoid: what satellite receivers give.
    Ellipsoidal,
    /// The vertical system named by `height.crs`.
    Orthometric,
    /// The ground, whose height in the project is `height.base` (flat sites only).
    AboveGround,
    /// The place of take-off, whose height in the project is `height.base`.
    AboveTakeoff,
}

/// Heights of the poses.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HeightConfig {
    /// Vertical datum of the poses' heights. Default: what the file says, else the project's reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<VerticalDatum>,
    /// Vertical CRS of `orthometric` heights, such as `EPSG:5773` (EGM96).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub crs: Option<Crs>,
    /// Height in the project of the ground or the take-off, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base: Option<f64>,
    /// Height of the geoid (or national zero) above the ellipsoid in the area, metres: subtracted from ellipsoidal
    /// heights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geoid_offset: Option<f64>,
    /// Use ellipsoidal heights as they are: the project, its terrain included, is ellipsoidal.
    #[schemars(extend("x-expert" = true))]
    pub keep_ellipsoidal: bool,
}

/// Columns and conventions of a CSV file of poses. Column names are compared without regard to case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CsvConfig {
    /// Whether white space separates the columns, as in files of some programs. Else the separator is detected.
    #[serde(skip)]
    pub is_spaced: bool,
    /// Names of the columns, where the file has no header line.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub header: Option<Vec<String>>,
    /// Column of the photo's name.
    pub name: String,
    /// Column of the easting or longitude.
    pub x: String,
    /// Column of the northing or latitude.
    pub y: String,
    /// Column of the height. Its unit is the header's (`z [ft]`), else that of the poses' CRS, else metres.
    pub z: String,
    /// Kind of the rotation columns.
    pub angles: AngleKind,
    /// Columns of the rotation. Empty: omega, phi, kappa; yaw, pitch, roll; qw..qz; r11..r33.
    pub angle_columns: Vec<String>,
    /// Unit of the angles.
    pub unit: AngleUnit,
    /// Order of the matrix product, left to right. Default: opk `xyz`, pok `yxz`, ypr `zyx`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequence: Option<Sequence>,
    /// Direction of the rotation. Default: angles camera to world, quaternion and matrix world to camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction: Option<Direction>,
    /// Camera axes. Default: opk, pok x right, y up; quaternion, matrix x right, y down.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub camera_axes: Option<CameraAxes>,
    /// Where the camera looks at pitch 0, for `ypr`.
    #[schemars(extend("x-expert" = true))]
    pub pitch_zero: PitchZero,
    /// Which north the angles count from.
    #[schemars(extend("x-expert" = true))]
    pub north: North,
    /// Where pixel coordinates (cx, cy) have their origin.
    #[schemars(extend("x-expert" = true))]
    pub pixel_origin: PixelOrigin,
}

/// Where pixel coordinates have their origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PixelOrigin {
    /// The image's top-left corner; the first pixel's centre is (0.5, 0.5) (COLMAP, Metashape).
    #[default]
    Corner,
    /// The centre of the first pixel (OpenCV).
    PixelCentre,
}

/// A camera declared in the configuration; pixels, OpenCV's order of coefficients.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraConfig {
    /// Columns of the photos, pixels.
    pub width: u32,
    /// Rows of the photos, pixels.
    pub height: u32,
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels. Default: `fx`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fy: Option<f64>,
    /// Principal point from the left, pixels. Default: the middle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cx: Option<f64>,
    /// Principal point from the top, pixels. Default: the middle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cy: Option<f64>,
    /// Radial coefficients k1, k2, k3, unitless.
    #[serde(default)]
    pub k: [f64; 3],
    /// Tangential coefficients p1, p2 of OpenCV, unitless.
    #[serde(default)]
    pub p: [f64; 2],
}

impl Default for CsvConfig {
    fn default() -> Self {
        Self {
            is_spaced: false,
            header: None,
            name: "name".to_owned(),
            x: "x".to_owned(),
            y: "y".to_owned(),
            z: "z".to_owned(),
            angles: AngleKind::Opk,
            angle_columns: Vec::new(),
            unit: AngleUnit::Deg,
            sequence: None,
            direction: None,
            camera_axes: None,
            pitch_zero: PitchZero::Horizon,
            north: North::Grid,
            pixel_origin: PixelOrigin::Corner,
        }
    }
}

impl CsvConfig {
    /// The rotation convention it declares.
    #[must_use]
    pub fn convention(&self) -> AngleConvention {
        AngleConvention {
            angles: self.angles,
            unit: self.unit,
            sequence: self.sequence,
            direction: self.direction,
            camera_axes: self.camera_axes,
            pitch_zero: self.pitch_zero,
        }
    }

    /// The names of the rotation columns, declared or the kind's own.
    #[must_use]
    pub fn angle_columns(&self) -> Vec<String> {
        if !self.angle_columns.is_empty() {
            return self.angle_columns.clone();
        }
        let own: &[&str] = match self.angles {
            AngleKind::Opk | AngleKind::Pok => &["omega", "phi", "kappa"],
            AngleKind::Ypr => &["yaw", "pitch", "roll"],
            AngleKind::Quaternion => &["qw", "qx", "qy", "qz"],
            AngleKind::Matrix => &["r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"],
        };
        own.iter().map(|&name| name.to_owned()).collect()
    }
}

impl SurveyConfig {
    /// A survey whose format is found from its files and whose poses are in the project's CRS.
    #[must_use]
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), ..Self::default() }
    }

    /// Hands every path of these settings to `visit`, which may change it.
    pub fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        visit(&mut self.path);
        self.images.iter_mut().for_each(visit);
    }
}
