//! What is known of one building at the end of a run: shared by all writers.

use geo::buffer::{BufferStyle, LineJoin};
use geo::{Area as _, Buffer as _, Translate as _};
use geo_types::Polygon;
use serde::{Deserialize, Serialize};
use serde_json::{Map as JsonMap, Value};

use sizeup_heights::optimise::{FootprintShift, Terrace};
use sizeup_heights::scene::{HeightReference, RoofForm};

/// Corners sharper than this are cut off where walls move outwards, radians.
const SHARPEST_RAD: f64 = 0.5;

/// Status of a building.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The height was measured in the photos.
    Measured,
    /// A person looked at the building and confirmed or corrected its height.
    Reviewed,
    /// The height is that of a model of others, which does not say how it was found.
    Given,
    /// The height was measured, and at least one reason says to look at it again.
    Doubtful,
    /// The height could not be measured; it comes from the fallback the user chose.
    Fallback,
    /// The height is not known.
    Unknown,
    /// The footprint could not be used.
    Refused,
}

impl Status {
    /// All of them, in the order in which they are reported.
    pub const ALL: [Self; 7] =
        [Self::Measured, Self::Reviewed, Self::Given, Self::Doubtful, Self::Fallback, Self::Unknown, Self::Refused];

    /// The name in files: `measured`, `doubtful`, ….
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Reviewed => "reviewed",
            Self::Given => "given",
            Self::Doubtful => "doubtful",
            Self::Fallback => "fallback",
            Self::Unknown => "unknown",
            Self::Refused => "refused",
        }
    }
}

/// The roof that the photos support.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RoofShape {
    /// Form of the roof.
    pub form: RoofForm,
    /// Lowest edge above the ground level, metres.
    pub eave_height_m: f64,
    /// Highest line above the ground level, metres.
    pub ridge_height_m: f64,
    /// Direction of a gable's ridge, the main body's where there are wings: degrees clockwise from grid north, 0 to 180.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ridge_azimuth_deg: Option<f64>,
    /// How certain the form is, 0 to 1: the share of roofs called so, as clearly, that are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certainty: Option<f64>,
    /// Plan of a stepped roof, its corners in the map frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<Terrace>,
}

impl RoofShape {
    /// A shape of which only form and heights are known.
    #[must_use]
    pub fn new(form: RoofForm, eave_height_m: f64, ridge_height_m: f64) -> Self {
        Self { form, eave_height_m, ridge_height_m, ridge_azimuth_deg: None, certainty: None, step: None }
    }
}

/// One building of the result. Heights in metres, positions in the project's map frame and vertical reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BuildingRecord {
    /// Unique id, the input's.
    pub id: String,
    /// The building of the input that this is a part of, where its footprint came in several pieces. Each piece has its
    /// own height.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_of: Option<String>,
    /// Footprint (exterior counter-clockwise seen from above, holes clockwise), `None` if it could not be used.
    pub footprint: Option<Polygon<f64>>,
    /// Ground level the height counts from.
    pub ground_z_m: Option<f64>,
    /// Lowest ground under the footprint: walls go down to here. At most `ground_z_m`.
    pub base_z_m: Option<f64>,
    /// The lowest and the highest ground along the outline of the building, where it is known there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground_ends_z_m: Option<[f64; 2]>,
    /// Roof level minus ground level.
    pub height_m: Option<f64>,
    /// One standard deviation of `height_m`, where it could be estimated: of the roof's level and the ground's together.
    pub height_sigma_m: Option<f64>,
    /// One standard deviation of the roof's level, metres, where it could be estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roof_sigma_m: Option<f64>,
    /// One standard deviation of `ground_z_m`, metres, where the photos show the ground around the building.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground_sigma_m: Option<f64>,
    /// Which height of a pitched roof `height_m` is.
    pub height_reference: HeightReference,
    /// The form of its roof, where the method looks for one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roof: Option<RoofShape>,
    /// Walls that stand against a neighbour's, m², where the neighbours were looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub party_wall_m2: Option<f64>,
    /// How far the footprint is off, where the photos tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub footprint_shift: Option<FootprintShift>,
    /// Status of the building.
    pub status: Status,
    /// Machine-readable reasons behind the status (`too_few_views`, `range_bound`, …), sorted.
    pub reasons: Vec<String>,
    /// Names of the views its height was measured in.
    pub views: Vec<String>,
    /// The user's own attributes, carried through.
    #[serde(default)]
    pub attributes: JsonMap<String, Value>,
}

impl BuildingRecord {
    /// A measured building: its footprint (map frame, metres), ground level and height above it. Walls go down to the ground
    /// level; everything else is left unknown.
    #[must_use]
    pub fn measured(id: impl Into<String>, footprint: Polygon<f64>, ground_z_m: f64, height_m: f64) -> Self {
        Self {
            footprint: Some(footprint),
            ground_z_m: Some(ground_z_m),
            base_z_m: Some(ground_z_m),
            height_m: Some(height_m),
            ..Self::without_height(id, Status::Measured)
        }
    }

    /// A building of which nothing is known but its status.
    #[must_use]
    pub fn without_height(id: impl Into<String>, status: Status) -> Self {
        Self {
            id: id.into(),
            part_of: None,
            footprint: None,
            ground_z_m: None,
            base_z_m: None,
            ground_ends_z_m: None,
            height_m: None,
            height_sigma_m: None,
            roof_sigma_m: None,
            ground_sigma_m: None,
            height_reference: HeightReference::Mean,
            roof: None,
            party_wall_m2: None,
            footprint_shift: None,
            status,
            reasons: Vec::new(),
            views: Vec::new(),
            attributes: JsonMap::new(),
        }
    }

    /// The footprint where the photos show the building, and as large, where it is known to be off. Map frame, metres.
    #[must_use]
    pub fn footprint_in_photos(&self) -> Option<Polygon<f64>> {
        let (footprint, shift) = (self.footprint.as_ref()?, self.footprint_shift?);
        let moved = footprint.translate(shift.way().x, shift.way().y);
        if shift.too_large_m == 0.0 {
            return Some(moved);
        }
        let style = BufferStyle::new(-shift.too_large_m).line_join(LineJoin::Miter(SHARPEST_RAD));
        let resized = moved.buffer_with_style(style);
        Some(resized.into_iter().max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area())).unwrap_or(moved))
    }

    /// Roof level: ground plus height.
    #[must_use]
    pub fn roof_z_m(&self) -> Option<f64> {
        Some(self.ground_z_m? + self.height_m?)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A measured building without views and attributes; all metres.
    pub(crate) fn record(id: &str, footprint: Polygon<f64>, ground_z: f64, base_z: f64, height: f64) -> BuildingRecord {
        BuildingRecord {
            base_z_m: Some(base_z),
            height_sigma_m: Some(0.25),
            ..BuildingRecord::measured(id, footprint, ground_z, height)
        }
    }
}
