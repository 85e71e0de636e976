//! Scenes with known truth, in the files a user would bring.
//!
//! ```text
//! town or CityJSON ─ terrain ─ clutter ─> scene ─┬─ photos                images/*.jpg
//!                                                ├─ true depth ─ corrupt  priors/*.npy
//! flight or given views ────────────────────────┤
//!                                                └─ tie points, poses     sparse/*.txt
//! buildings ─ footprints.gpkg, truth.geojson, masks/*.png (nadir views);  terrain ─ dtm.tif;  all ─ sizeup.toml
//! ```
//!
//! Everything is drawn from [`sizeup_heights::seed::stream`]s keyed by purpose and index: the same configuration gives the same
//! bytes on any number of threads. Truth is in the map frame; poses and footprints carry the configured errors.

mod blocks;
mod building;
mod chance;
mod cityjson;
mod clutter;
mod config;
mod corrupt;
mod disturb;
mod eye;
mod files;
mod filter;
mod flight;
mod form;
mod ground;
mod mask_errors;
mod masks;
mod mosaic;
mod noise;
mod photo;
mod points;
mod presets;
mod real;
mod relief;
mod run;
mod scene;
mod sight;
mod streets;
mod texture;
mod tie_points;
mod town;
mod trace;

pub use building::{BuildingKind, Placement, RoofLevel, RoofOrWall, SimulatedBuilding, Triangle, by_roof_level};
pub use config::{
    CityJsonTown, ErrorConfig, FlightConfig, FlightPattern, FootprintsOf, ImageConfig, MaskContour, MosaicConfig,
    PointConfig, PriorLevel, SimulateConfig, SimulatedCamera, SimulatedMasks, SimulatedPriors, SimulatedTerrain,
    TownConfig, TownKind,
};
pub use corrupt::{Corruption, building_gain, prior};
pub use disturb::{footprints as disturbed_footprints, poses as disturbed_poses};
pub use flight::{plan, pose};
pub use form::RoofKind;
pub use mask_errors::{MaskErrors, MaskLevel, masks_with_errors};
pub use masks::{ground_contact, roofs};
pub use relief::MapRect;
pub use run::{SimulationSummary, simulate, simulate_with_views, world};
pub use scene::SeenObject;
pub use sight::VisibleWorld;
pub use town::SimulatedTown;
pub use trace::TrueDepth;

use std::path::PathBuf;

use sizeup_geo::crs::CrsError;
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::WriteError;
use sizeup_geo::terrain::DemError;

/// Why a scene cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// A setting outside its range.
    #[error("{setting} is {found}: expected {expected}")]
    Setting {
        /// Name in the configuration.
        setting: &'static str,
        /// The value that was set.
        found: String,
        /// Values that are allowed, in words.
        expected: &'static str,
    },
    /// No building came out.
    #[error(
        "the scene has no buildings ({wanted} were asked for)\nhint: set `town.n_buildings` to 1 or more, or widen `cityjson.bounds_m`"
    )]
    NoBuildings {
        /// Number of buildings asked for.
        wanted: usize,
    },
    /// No view came out.
    #[error("the scene has no views\nhint: reduce `flight.spacing_m`, or set `flight.n_views`")]
    NoViews,
    /// Two given views whose files would have one name.
    #[error(
        "two views are named {stem:?}: their photos and priors would overwrite each other\nhint: give every photo its own name"
    )]
    DuplicateView {
        /// The name without folder and extension.
        stem: String,
    },
    /// A preset that does not exist.
    #[error("unknown preset {name:?}\nhint: the presets are {known}")]
    UnknownPreset {
        /// Name that was asked for.
        name: String,
        /// Names of all presets, with commas.
        known: String,
    },
    /// The CRS cannot be used.
    #[error(transparent)]
    Crs(#[from] CrsError),
    /// The ground has no extent.
    #[error(transparent)]
    Dem(#[from] DemError),
    /// A file of real buildings cannot be used.
    #[error("cannot use {}: {reason}\nhint: expected CityJSON 1.x or 2.0 with Building objects of LoD1 or LoD2", path.display())]
    CityJson {
        /// Path of the CityJSON file.
        path: PathBuf,
        /// The part of it that sizeup cannot use.
        reason: String,
    },
    /// A photo could not be encoded.
    #[error("cannot encode {}", path.display())]
    Image {
        /// Path of the picture's file.
        path: PathBuf,
        /// The encoder's own words.
        #[source]
        source: image::ImageError,
    },
    /// A file could not be written or read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A GIS file could not be written.
    #[error(transparent)]
    Gis(#[from] WriteError),
}
