//! From a file's building to one of our records.

use geo::{Area, Orient, orient::Direction};
use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::Error as ValueError;
use serde_json::{Map as JsonMap, Value};

use super::super::attributes::{ID, MEASURED_HEIGHT, is_field, original_name};
use super::super::cityjson::EXTENSION_PREFIX;
use super::super::footprints::LIST_SEPARATOR;
use super::super::{BuildingRecord, HeightReference, RoofShape, Status};
use super::{FoundBuilding, FoundBuildings};
use sizeup_heights::optimise::FootprintShift;

/// Reason of a building whose roof is at or below its ground, by its file.
const NOT_POSITIVE: &str = "height_not_positive";

impl FoundBuildings {
    /// As records. From our own files every field comes back as it was written; from those of others the height is
    /// measured on the surfaces and the status is `given` or `unknown`. Of several polygons the largest is kept.
    #[must_use]
    pub fn to_records(&self) -> Vec<BuildingRecord> {
        self.buildings.iter().map(FoundBuilding::to_record).collect()
    }
}

impl FoundBuilding {
    /// The building as the writers take it.
    #[must_use]
    pub fn to_record(&self) -> BuildingRecord {
        let number = |name: &str| self.own(name).and_then(Value::as_f64);
        let ground_z_m = number("ground_z_m").or(self.levels.map(|levels| levels.ground_m));
        let stated_m = number("height_m").or(self.levels.map(|levels| levels.roof_mean_m - levels.ground_m));
        // Nothing is as high as its ground, or lower.
        let height_m = stated_m.filter(|height_m| *height_m > 0.0);
        let mut reasons = self.list("reasons");
        reasons
            .extend((height_m != stated_m).then(|| NOT_POSITIVE.to_owned()).filter(|reason| !reasons.contains(reason)));
        let largest = self
            .footprint
            .as_ref()
            .and_then(|footprint| footprint.iter().max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area())));
        let otherwise = if height_m.is_some() { Status::Given } else { Status::Unknown };
        BuildingRecord {
            id: self.id.clone(),
            part_of: self.part_of.clone(),
            footprint: largest.map(|polygon| polygon.orient(Direction::Default)),
            ground_z_m,
            base_z_m: number("base_z_m").or(ground_z_m),
            ground_ends_z_m: number("ground_min_z_m").zip(number("ground_max_z_m")).map(<[f64; 2]>::from),
            height_m,
            height_sigma_m: number("height_sigma_m"),
            roof_sigma_m: number("roof_sigma_m"),
            ground_sigma_m: number("ground_sigma_m"),
            party_wall_m2: number("party_wall_area_m2"),
            footprint_shift: self.footprint_shift(),
            height_reference: self.named("height_reference").unwrap_or(HeightReference::Mean),
            roof: self.roof(),
            status: self.named("status").filter(|_| height_m == stated_m).unwrap_or(otherwise),
            reasons,
            views: self.list("views"),
            attributes: self.carried(),
        }
    }

    fn footprint_shift(&self) -> Option<FootprintShift> {
        let number = |name: &str| self.own(name).and_then(Value::as_f64);
        let (east_m, north_m) = (number("off_east_m")?, number("off_north_m")?);
        let (sigma_m, too_large_m) = (number("off_sigma_m")?, number("too_large_m")?);
        Some(FootprintShift { east_m, north_m, too_large_m, sigma_m })
    }

    fn roof(&self) -> Option<RoofShape> {
        let number = |name: &str| self.own(name).and_then(Value::as_f64);
        let (eave_height_m, ridge_height_m) = (number("eave_height_m")?, number("ridge_height_m")?);
        Some(RoofShape {
            ridge_azimuth_deg: number("ridge_azimuth_deg"),
            certainty: number("form_certainty"),
            step: self.own("roof_step").and_then(Value::as_str).and_then(|text| serde_json::from_str(text).ok()),
            ..RoofShape::new(self.named("roof_form")?, eave_height_m, ridge_height_m)
        })
    }

    /// One of our attributes, also under its name in our extension.
    fn own(&self, name: &str) -> Option<&Value> {
        self.attributes.get(name).or_else(|| self.attributes.get(&format!("{EXTENSION_PREFIX}{name}")))
    }

    /// One of our enumerations by its name in files.
    fn named<T: for<'de> Deserialize<'de>>(&self, name: &str) -> Option<T> {
        let text = self.own(name)?.as_str()?;
        T::deserialize(IntoDeserializer::<ValueError>::into_deserializer(text)).ok()
    }

    fn list(&self, name: &str) -> Vec<String> {
        match self.own(name) {
            Some(Value::Array(items)) => items.iter().filter_map(Value::as_str).map(str::to_owned).collect(),
            Some(Value::String(text)) if !text.is_empty() => text.split(LIST_SEPARATOR).map(str::to_owned).collect(),
            _ => Vec::new(),
        }
    }

    /// The user's attributes under their own names, without ours and without empty columns.
    fn carried(&self) -> JsonMap<String, Value> {
        let theirs = self.attributes.iter().filter(|(name, value)| !is_ours(name) && !value.is_null());
        theirs.map(|(name, value)| (original_name(name).to_owned(), value.clone())).collect()
    }
}

/// Whether an attribute is written by us, whatever the user's are called.
pub(super) fn is_ours(name: &str) -> bool {
    let plain = name.strip_prefix(EXTENSION_PREFIX).unwrap_or(name);
    plain == ID.name || plain == MEASURED_HEIGHT || is_field(plain)
}
