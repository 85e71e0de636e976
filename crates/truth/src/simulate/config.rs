//! Everything a simulated scene is made from. All angles in files are degrees, all lengths metres or pixels.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_photos::prior::PriorKind;

use super::mask_errors::MaskLevel;

/// A scene with known truth: what stands there, how it is flown, and what goes wrong on the way to the user.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulateConfig {
    /// Root of every random choice; the same seed gives the same files.
    pub seed: u64,
    /// Projected CRS in metres that the scene is written in; a `CityJSON` file's own CRS replaces it.
    pub crs: String,
    /// Easting and northing of the procedural town's centre, metres.
    pub centre_m: [f64; 2],
    /// The procedural town; not used with `cityjson`.
    pub town: TownConfig,
    /// Real geometry in place of the procedural town.
    pub cityjson: Option<CityJsonTown>,
    /// The procedural town again and again, side by side: a city of up to millions of buildings for trials of scale.
    pub mosaic: Option<MosaicConfig>,
    /// Shape of the ground.
    pub terrain: SimulatedTerrain,
    /// Where the photos are taken; not used where views are given from outside.
    pub flight: FlightConfig,
    /// The lens and the sensor; not used where views are given from outside.
    pub camera: SimulatedCamera,
    /// Settings for rendering the photos.
    pub images: ImageConfig,
    /// Masks of the nadir views.
    pub masks: SimulatedMasks,
    /// Settings for making depth priors from the true depth.
    pub prior: SimulatedPriors,
    /// A sparse point cloud as multi-view matching leaves it.
    pub points: PointConfig,
    /// Errors of poses and footprints as the user gets them.
    pub errors: ErrorConfig,
}

impl Default for SimulateConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            crs: "EPSG:25832".to_owned(),
            centre_m: [565_500.0, 5_932_500.0],
            town: TownConfig::default(),
            cityjson: None,
            mosaic: None,
            terrain: SimulatedTerrain::default(),
            flight: FlightConfig::default(),
            camera: SimulatedCamera::default(),
            images: ImageConfig::default(),
            masks: SimulatedMasks::default(),
            prior: SimulatedPriors::default(),
            points: PointConfig::default(),
            errors: ErrorConfig::default(),
        }
    }
}

/// Kind of town: which buildings stand in it, and how high they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TownKind {
    /// Low pitched houses and rows, 3 to 12 m.
    Village,
    /// Lone houses of 8 to 16 m, pairs, and rows of houses of 5 to 12 m, of all kinds of roofs, 3 to 12 m: no width tells them apart.
    Suburb,
    /// Courtyard blocks, rows that share walls, slabs, L and U shapes, 6 to 35 m.
    #[default]
    District,
    /// Towers with podiums between low pavilions, 3 to 115 m.
    Downtown,
    /// Large halls with flat or shallow roofs, 5 to 18 m.
    Industry,
}

/// Settings of a procedural town.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TownConfig {
    /// Kind of town, which decides forms and heights.
    pub kind: TownKind,
    /// Exactly so many buildings, 1 to 20000.
    pub n_buildings: usize,
    /// Mean height of the buildings, metres: all walls are as many times higher or lower as that takes. Unset: as the kind of town has
    /// it.
    pub mean_height_m: Option<f64>,
    /// Trees per building (mean), 0 or more.
    pub trees_per_building: f64,
    /// Share of the trees that stand at a wall, their crowns 5 to 14 m high against it and over its roof, 0 to 1.
    pub trees_at_walls: f64,
    /// Cars per building (mean), 0 or more.
    pub cars_per_building: f64,
    /// Direction of the streets, degrees from east, counter-clockwise.
    pub heading_deg: f64,
    /// Polygons of the footprint layer and of the truth.
    pub footprints: FootprintsOf,
}

/// Extent of a polygon of the footprint layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FootprintsOf {
    /// A polygon per building.
    #[default]
    Buildings,
    /// A polygon per roof level of a stepped building (`b007_1`, `b007_2`), one per building of the others: the paper's finer
    /// components.
    RoofLevels,
}

impl Default for TownConfig {
    fn default() -> Self {
        Self {
            kind: TownKind::District,
            n_buildings: 64,
            mean_height_m: None,
            trees_per_building: 4.0,
            trees_at_walls: 0.0,
            cars_per_building: 2.5,
            heading_deg: 17.0,
            footprints: FootprintsOf::Buildings,
        }
    }
}

/// Buildings from a `CityJSON` file (1.x or 2.0; `LoD1` or `LoD2`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CityJsonTown {
    /// Path of the CityJSON file.
    pub path: PathBuf,
    /// Moves all buildings by easting, northing, up; metres.
    #[serde(default)]
    pub translation_m: [f64; 3],
    /// Only buildings whose centre (before the translation) lies within west, south, east, north; metres.
    #[serde(default)]
    pub bounds_m: Option<[f64; 4]>,
    /// At most so many buildings, those nearest to the middle of the selection.
    #[serde(default)]
    pub max_buildings: Option<usize>,
    /// Trees per building (mean), 0 or more.
    #[serde(default)]
    pub trees_per_building: f64,
}

/// A city of equal towns on level ground, side by side. Buildings and views are counted per town, views in whole rows of
/// stations; a prior is rendered for the first town
/// and shared by all (hard links). Takes `terrain.relief_m = 0`, and neither photos nor masks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MosaicConfig {
    /// Number of towns from west to east, 1 to 999.
    pub columns: usize,
    /// Number of towns from south to north, 1 to 999.
    pub rows: usize,
}

/// The ground: a hilly, smooth surface, given to the user as a DTM.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedTerrain {
    /// Mean height of the ground in the vertical reference, metres; a `CityJSON` file's own ground replaces it.
    pub base_z_m: f64,
    /// Difference between hills and valleys, metres, 0 (flat) or more; a `CityJSON` file's own ground replaces it.
    pub relief_m: f64,
    /// Cell of the DTM, metres, 0.5 to 50.
    pub cell_m: f64,
    /// How far the ground goes on beyond the buildings, metres; views see sky behind it.
    pub margin_m: f64,
}

impl Default for SimulatedTerrain {
    fn default() -> Self {
        Self { base_z_m: 24.0, relief_m: 12.0, cell_m: 5.0, margin_m: 700.0 }
    }
}

/// How the photos are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FlightPattern {
    /// A regular grid of stations, at each one nadir and four oblique views.
    #[default]
    Grid,
    /// One smooth random path with changing tilt (20 to 60°) and azimuth, and some nadir views.
    Free,
}

/// Where the photos are taken.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlightConfig {
    /// Pattern of the flight: a grid, or freely scattered cameras.
    pub pattern: FlightPattern,
    /// Flying height above the mean ground, metres, above every roof.
    pub height_m: f64,
    /// Distance between stations, metres. With `n_views` it follows from that.
    pub spacing_m: f64,
    /// Exactly so many views; the spacing follows. Unset: as many as the spacing gives (free flight: 100).
    pub n_views: Option<usize>,
    /// Tilt of the oblique views of a grid flight, degrees from the downward vertical, 20 to 60.
    pub tilt_deg: f64,
    /// Direction of the flight lines, degrees clockwise from north.
    pub heading_deg: f64,
    /// Standard deviation of the drone's unsteadiness: known to the survey, so no error. Metres.
    pub wobble_m: f64,
    /// Standard deviation of the camera's unsteadiness: known to the survey, so no error. Degrees.
    pub wobble_deg: f64,
}

impl Default for FlightConfig {
    fn default() -> Self {
        Self {
            pattern: FlightPattern::Grid,
            height_m: 150.0,
            spacing_m: 60.0,
            n_views: None,
            tilt_deg: 45.0,
            heading_deg: 8.0,
            wobble_m: 1.0,
            wobble_deg: 0.8,
        }
    }
}

/// The lens and the sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedCamera {
    /// Columns, 16 to 20000 pixels.
    pub width_px: u32,
    /// Rows, 16 to 20000 pixels.
    pub height_px: u32,
    /// Focal length over image width, 0.3 to 5 (0.85 sees 61° across).
    pub focal_ratio: f64,
    /// Brown distortion `[k1, k2, k3, p1, p2]` in `OpenCV`'s order and signs; unset: none.
    pub brown: Option<[f64; 5]>,
}

impl Default for SimulatedCamera {
    fn default() -> Self {
        Self { width_px: 672, height_px: 504, focal_ratio: 0.85, brown: None }
    }
}

/// Settings for rendering the photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImageConfig {
    /// Whether photos are rendered; without them the survey has poses only.
    pub enabled: bool,
    /// Azimuth of the sun, degrees clockwise from north.
    pub sun_azimuth_deg: f64,
    /// Elevation of the sun, degrees over the horizon, 5 to 90.
    pub sun_elevation_deg: f64,
    /// Standard deviation of the exposure between photos, as a share of 1.
    pub exposure_sd: f64,
    /// Standard deviation of the sensor's noise, grey levels of 255.
    pub noise_sd: f64,
    /// JPEG quality, 1 to 100.
    pub jpeg_quality: u8,
}

impl Default for ImageConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            sun_azimuth_deg: 148.0,
            sun_elevation_deg: 48.0,
            exposure_sd: 0.04,
            noise_sd: 1.5,
            jpeg_quality: 93,
        }
    }
}

/// The contour of a building that masks follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskContour {
    /// Where walls meet the ground, hidden or not.
    #[default]
    Ground,
    /// Flat roofs at the mean height.
    Roof,
}

/// Masks of the nadir views, 16-bit PNG with one number per building.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedMasks {
    /// Whether masks are written.
    pub enabled: bool,
    /// The contour of a building that they follow.
    pub contour: MaskContour,
    /// How far they are from the truth; only for footprints on the ground.
    pub level: MaskLevel,
}

impl Default for SimulatedMasks {
    fn default() -> Self {
        Self { enabled: true, contour: MaskContour::default(), level: MaskLevel::default() }
    }
}

/// How far a simulated prior is from the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PriorLevel {
    /// A strictly monotone warp of the true depth, nothing else.
    Clean,
    /// Moderate errors of every kind.
    #[default]
    Mid,
    /// Strong errors of every kind.
    High,
    /// `high`, and 20 % of the buildings lost per view, and edges moved by 2 pixels.
    Harsh,
    /// `mid`, and 30 % of the buildings lost per view.
    Miss,
    /// The near side of every edge grows by 2 to 3 pixels in every view; weak drift, blur and noise.
    Bleed,
}

/// Settings for making depth priors from the true depth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedPriors {
    /// How far they are from the truth.
    pub level: PriorLevel,
    /// Whether higher means farther or nearer.
    pub kind: PriorKind,
    /// Longer side, pixels, 16 or more; never larger than the photo.
    pub longest_px: u32,
    /// Whether the true z-depth is written too, as `depth/*.npy` (metres, at the prior's size).
    pub write_true_depth: bool,
}

impl Default for SimulatedPriors {
    fn default() -> Self {
        Self { level: PriorLevel::Mid, kind: PriorKind::InverseDepth, longest_px: 448, write_true_depth: false }
    }
}

/// The point cloud: places on surfaces that three or more views see, with errors, gaps and blunders.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PointConfig {
    /// Places tried per view, 0 to 100000; 0: no cloud.
    pub per_view: usize,
    /// Standard deviation of a point's position per axis, metres.
    pub noise_m: f64,
    /// Share of surface patches without points (textureless, glass), 0 to 1.
    pub gap_share: f64,
    /// Size of such patches, metres.
    pub gap_m: f64,
    /// Share of points that are blunders, 0 to 1.
    pub blunder_share: f64,
    /// Standard deviation of a blunder's position per axis, metres.
    pub blunder_m: f64,
}

impl Default for PointConfig {
    fn default() -> Self {
        Self { per_view: 0, noise_m: 0.15, gap_share: 0.25, gap_m: 4.0, blunder_share: 0.01, blunder_m: 3.0 }
    }
}

/// Errors of what the user gets; the truth stays clean. All are standard deviations but the last two.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ErrorConfig {
    /// Error of camera positions, per axis, metres.
    pub position_m: f64,
    /// Error of camera attitudes, per axis, degrees.
    pub angle_deg: f64,
    /// Error of footprint vertices, per axis, metres.
    pub vertex_m: f64,
    /// By how much every footprint is too large (negative: too small), metres.
    pub footprint_m: f64,
    /// Error of each building's place, per axis, metres: footprints that share walls are off by the same.
    pub building_m: f64,
    /// How far the whole footprint layer lies off, east and north, metres.
    pub shift_m: [f64; 2],
}

impl ErrorConfig {
    /// Errors of a careful survey and a good cadastre: 0.05 m and 0.05°, vertices 0.3 m, footprints 0.2 m too large.
    pub const REALISTIC: Self = Self {
        position_m: 0.05,
        angle_deg: 0.05,
        vertex_m: 0.3,
        footprint_m: 0.2,
        building_m: 0.0,
        shift_m: [0.0, 0.0],
    };
}
