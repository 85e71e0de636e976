//! Building footprints: valid polygons in the project's map frame.

mod check;
pub mod clean;
mod features;
pub mod layer;
mod overlap;

pub use layer::{FootprintConfig, FootprintError, read};
pub use overlap::overlaps;

use geo_types::Polygon;
use serde::{Deserialize, Serialize};
use serde_json::{Map as JsonMap, Value};

use crate::ids::BuildingId;
use crate::issue::Issue;

/// One building's outline on the ground.
///
/// The polygon is valid (simple rings, holes inside, exterior counter-clockwise and holes clockwise seen from above)
/// and its coordinates are easting, northing in metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Footprint {
    /// Unique id, stable over runs.
    pub id: BuildingId,
    /// The feature of the layer that this is a part of, where that falls into several.
    #[serde(default)]
    pub part_of: Option<BuildingId>,
    /// Outline with courtyards as holes; map frame, metres.
    pub polygon: Polygon<f64>,
    /// The user's own attributes, carried through.
    #[serde(default)]
    pub attributes: JsonMap<String, Value>,
}

/// A building of the input that has no usable outline: it is in the output all the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RefusedFootprint {
    /// Its id in the input.
    pub id: BuildingId,
    /// The feature of the layer that this is a part of, where that falls into several.
    #[serde(default)]
    pub part_of: Option<BuildingId>,
    /// Why it cannot be used: the code of the issue that tells the rest.
    pub reason: String,
    /// The user's own attributes, carried through.
    #[serde(default)]
    pub attributes: JsonMap<String, Value>,
}

/// A layer of footprints as read: every input building is in one of the two lists.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FootprintLayer {
    /// Usable footprints in the order of the layer.
    pub footprints: Vec<Footprint>,
    /// Buildings without a usable outline.
    pub refused: Vec<RefusedFootprint>,
    /// What was repaired or refused, and where.
    pub issues: Vec<Issue>,
}
