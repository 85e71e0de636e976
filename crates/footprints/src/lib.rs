//! Building footprints: valid polygons in the project's map frame.
//!
//! ```text
//! existing layer ─ layer ─ features ─ clean ──────────────────────────────────────────┐
//! masks, COCO, network ─ contours ─ vectorise ─ georeference ─> candidates per view   ├─> FootprintLayer
//!                       candidates ─ cluster ─ consensus (partition, shape) ─ cadastre ┘
//! ```

mod arcs;
mod cadastre;
mod candidate;
mod check;
pub mod clean;
pub mod clearance;
mod cluster;
mod coco;
mod compare;
mod consensus;
mod contours;
mod coverage;
mod detect;
mod features;
mod gather;
mod georeference;
mod identity;
pub mod layer;
mod lines;
mod masks;
mod osm;
mod overlap;
mod partition;
mod parts;
mod plain;
pub mod segment;
mod shape;
mod simplify;
mod source;
mod vectorise;
mod votes;
mod write;

pub use cadastre::{CadastreChange, CadastreConfig, FootprintFrom};
pub use candidate::{FootprintCandidate, SeenGround};
pub use cluster::Dropped;
pub use coco::{Annotated, PhotoInstances, coco_instances, is_coco};
pub use consensus::{Agreed, Consensus, ConsensusConfig, agree};
pub use contours::{ContourFineness, ContourKind, ContourSource, ViewContours, ViewFault};
pub use detect::{
    BuildingSightings, Detection, DetectionSummary, PhotoContour, PlacedCandidate, Tracks, detect, move_roofs,
};
pub use georeference::InputAccuracy;
pub use layer::{FootprintConfig, FootprintError, MAX_AREA_CHANGE, read};
pub use masks::{MaskConfig, MaskFiles, MaskKind};
pub use osm::{attribute, is_osm, open_layer};
pub use overlap::overlaps;
pub use parts::LayerParts;
pub use plain::{plain_config, unpack, write_plain};
pub use segment::profile::SegmenterProfile;
pub use segment::{SMALL, Segmenter, SegmenterConfig, SmallNetwork};
pub use source::{DetectionSettings, FootprintSource};
pub use vectorise::{Contour, Instances, MaskFault, Vectorising, contours, contours_at_level};
pub use write::{WriteFootprintsError, write};

use geo_types::Polygon;
use serde::{Deserialize, Serialize};
use serde_json::{Map as JsonMap, Value};

use sizeup_geo::issue::Issue;
use sizeup_heights::ids::BuildingId;

/// A building's polygon on the ground.
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
    /// Polygon with courtyards as holes; map frame, metres.
    pub polygon: Polygon<f64>,
    /// The user's own attributes, carried through.
    #[serde(default)]
    pub attributes: JsonMap<String, Value>,
}

impl Footprint {
    /// Middle of the box around it, which decides where it belongs when an area is divided.
    #[must_use]
    pub fn middle(&self) -> Option<(f64, f64)> {
        use geo::BoundingRect as _;
        self.polygon.bounding_rect().map(|rect| rect.center().x_y())
    }
}

/// A building of the input that has no usable footprint: it is in the output all the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RefusedFootprint {
    /// Id in the input.
    pub id: BuildingId,
    /// The feature of the layer that this is a part of, where that falls into several.
    #[serde(default)]
    pub part_of: Option<BuildingId>,
    /// Why it cannot be used: the code of the issue that tells the rest.
    pub reason: String,
    /// The footprint that it lies on, where it is the same building once more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duplicate_of: Option<BuildingId>,
    /// The user's own attributes, carried through.
    #[serde(default)]
    pub attributes: JsonMap<String, Value>,
}

/// A layer of footprints as read: every input building is in one of the two lists.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FootprintLayer {
    /// Usable footprints in the order of the layer.
    pub footprints: Vec<Footprint>,
    /// Buildings without a usable footprint.
    pub refused: Vec<RefusedFootprint>,
    /// Repairs and refusals, with their places.
    pub issues: Vec<Issue>,
}
