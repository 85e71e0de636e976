//! The attributes of a building as all formats write them: one list of names, units and meanings.
//!
//! Numbers in metres are rounded to [`DECIMALS_M`] decimals (a millimetre), below anything that is measured here.
//! The user's own attributes follow under their own names; one that would hide ours is written as `input_<name>`.

use serde_json::{Map as JsonMap, Number, Value};

use super::facts::SolidFacts;
use super::{BuildingRecord, RoofForm, Status};
use sizeup_geo::geodata::features::{Column, ColumnKind};
use sizeup_heights::optimise::{Gable, Terrace};

/// Decimals of a metre in files.
const DECIMALS_M: i32 = 3;

/// `CityGML`'s name of a building's height.
pub const MEASURED_HEIGHT: &str = "measuredHeight";

/// Prefix of a user's attribute whose name is taken.
const CARRIED_PREFIX: &str = "input_";

/// One of our attributes: its column, and its value for a building whose solid is known.
#[derive(Debug, Clone)]
pub struct Field {
    /// Name, type, meaning.
    pub column: Column,
    value: fn(&BuildingRecord, &SolidFacts) -> Value,
}

impl Field {
    const fn new(
        name: &'static str,
        title: &'static str,
        kind: ColumnKind,
        meaning: &'static str,
        value: fn(&BuildingRecord, &SolidFacts) -> Value,
    ) -> Self {
        Self { column: Column::new(name, title, kind, meaning), value }
    }

    /// Its value; [`Value::Null`] if not known. Lists stay lists.
    #[must_use]
    pub fn value(&self, record: &BuildingRecord, solid: &SolidFacts) -> Value {
        (self.value)(record, solid)
    }

    /// Whether it holds a list, which formats without lists write as text.
    #[must_use]
    pub fn is_list(&self) -> bool {
        matches!(&*self.column.name, "reasons" | "views" | "solid_faults")
    }
}

/// Our own attributes in the order in which they are written; the id comes before them. Names are told apart by their
/// first ten characters, which is all that a Shapefile keeps.
pub const FIELDS: [Field; 24] = {
    use ColumnKind::{Integer, Real, Text};
    [
        Field::new(
            "part_of",
            "Part of",
            Text,
            "Building of the input that this is a part of, where it has several",
            |b, _| text(b.part_of.as_deref()),
        ),
        Field::new("height_m", "Height (m)", Real, "Roof level minus ground level, metres", |b, _| known(b.height_m)),
        Field::new(
            "ground_z_m",
            "Ground level (m)",
            Real,
            "Ground level the height counts from, metres in the vertical reference",
            |b, _| known(b.ground_z_m),
        ),
        Field::new(
            "base_z_m",
            "Base level (m)",
            Real,
            "Lowest ground under the outline, where walls end, metres",
            |b, _| known(b.base_z_m),
        ),
        Field::new("roof_z_m", "Roof level (m)", Real, "Roof level, metres in the vertical reference", |b, _| {
            known(b.roof_z_m())
        }),
        Field::new("height_sigma_m", "Height sigma (m)", Real, "One standard deviation of height_m, metres", |b, _| {
            known(b.height_sigma_m)
        }),
        Field::new(
            "height_reference",
            "Height stands for",
            Text,
            "Which height of a pitched roof: eave, mean or ridge",
            |b, _| b.height_reference.as_str().into(),
        ),
        Field::new(
            "roof_form",
            "Roof form",
            Text,
            "Form of the roof: flat (or no other form seen), gable, hip, stepped or mixed (a gable and a flat part)",
            |b, _| text(b.roof.map(|roof| roof.form.as_str())),
        ),
        Field::new(
            "eave_height_m",
            "Eave height (m)",
            Real,
            "Lowest edge of the roof above ground level, metres",
            |b, _| known(b.roof.map(|roof| roof.eave_height_m)),
        ),
        Field::new(
            "ridge_height_m",
            "Ridge height (m)",
            Real,
            "Highest line of the roof above ground level, metres",
            |b, _| known(b.roof.map(|roof| roof.ridge_height_m)),
        ),
        Field::new(
            "ridge_azimuth_deg",
            "Direction of the ridge (degrees)",
            Real,
            "Where the ridge of a gable runs, the main body's where there are wings: degrees clockwise from grid north, 0 to 180",
            |b, _| known(b.roof.and_then(|roof| roof.ridge_azimuth_deg)),
        ),
        Field::new(
            "roof_step",
            "Plan of the roof's step",
            Text,
            "Of a stepped or mixed roof, JSON: the rectangle (`corners`, map coordinates) of the upper level (`is_upper`) or the lower \
             one; over it a `gable` with its eave above ground level and whether its ridge runs along the first side",
            |b, _| b.roof.and_then(|roof| roof.step).map_or(Value::Null, |step| roof_step(step).into()),
        ),
        Field::new(
            "roof_70p_z_m",
            "Roof level, 70th percentile (m)",
            Real,
            "Level that 70 % of the roof's area lies below, metres in the vertical reference: the roof level of a flat roof, \
             eave + 0.7 (ridge - eave) of a gable; empty for other forms",
            |b, _| known(roof_70p_z_m(b)),
        ),
        Field::new(
            "outline_area_m2",
            "Outline area (m2)",
            Real,
            "Area of the outline without its courtyards, m2; also that of the block's roof and floor",
            |b, _| known(b.footprint.as_ref().map(geo::Area::unsigned_area)),
        ),
        Field::new("solid_volume_m3", "Volume (m3)", Real, "Volume of the block, m3", |_, solid| {
            known(solid.measures.map(|measures| measures.volume_m3))
        }),
        Field::new(
            "wall_area_m2",
            "Wall area (m2)",
            Real,
            "Walls of the block from base to roof, courtyards' and party walls too, m2",
            |_, solid| known(solid.measures.map(|measures| measures.walls_m2)),
        ),
        Field::new(
            "party_wall_area_m2",
            "Party wall area (m2)",
            Real,
            "Of the walls, those that stand against a neighbour's, m2; empty where neighbours were not looked at",
            |b, solid| known(b.party_wall_m2.filter(|_| solid.measures.is_some())),
        ),
        Field::new(
            "status",
            "Status",
            Text,
            "measured, reviewed, given, doubtful, fallback, unknown or refused",
            |b, _| b.status.as_str().into(),
        ),
        Field::new(
            "quality_ok",
            "Fit for use",
            Integer,
            "1 where the height is measured, reviewed or given without doubt and the solid is valid, else 0",
            |b, solid| {
                let is_known = matches!(b.status, Status::Measured | Status::Reviewed | Status::Given);
                i64::from(is_known && solid.is_valid()).into()
            },
        ),
        Field::new("reasons", "Reasons", Text, "Why the status is what it is", |b, _| b.reasons.clone().into()),
        Field::new("n_views", "Photos", Integer, "Number of photos the height was measured in", |b, _| {
            b.views.len().into()
        }),
        Field::new("views", "Names of the photos", Text, "Photos the height was measured in", |b, _| {
            b.views.clone().into()
        }),
        Field::new(
            "solid_faults",
            "Faults of the solid",
            Text,
            "val3dity's codes of what `sizeup validate` finds in the solid; an empty list or text: it is valid",
            |_, solid| match solid.measures {
                Some(_) => solid.faults.iter().map(u16::to_string).collect::<Vec<_>>().into(),
                None => Value::Null,
            },
        ),
        Field::new(
            "no_solid_reason",
            "Why no solid",
            Text,
            "Why the building has no 3D geometry, where it has none",
            |_, solid| text(solid.no_solid_reason),
        ),
    ]
};

/// A step as text, rounded as all metres are.
fn roof_step(step: Terrace) -> String {
    let corners = step.corners.map(|corner| corner.map(round_m));
    let gable = step.gable.map(|gable| Gable { eave_m: round_m(gable.eave_m), ..gable });
    serde_json::to_string(&Terrace { corners, gable, ..step }).unwrap_or_default()
}

/// The level below which 70 % of a roof's area lies. On a gable the area between eave and ridge is even in height.
#[must_use]
pub fn roof_70p_z_m(record: &BuildingRecord) -> Option<f64> {
    const SHARE: f64 = 0.7;
    let (roof, ground_z_m) = (record.roof?, record.ground_z_m?);
    match roof.form {
        RoofForm::Flat => record.roof_z_m(),
        RoofForm::Gable => Some(ground_z_m + roof.eave_height_m + SHARE * (roof.ridge_height_m - roof.eave_height_m)),
        RoofForm::Hip | RoofForm::Stepped | RoofForm::Mixed => None,
    }
}

fn known(value_m: Option<f64>) -> Value {
    value_m.map_or(Value::Null, metres)
}

fn text(value: Option<&str>) -> Value {
    value.map_or(Value::Null, Value::from)
}

/// The id, before [`FIELDS`] in formats that have no place of their own for it.
pub const ID: Column = Column::new("id", "Building", ColumnKind::Text, "Id of the building in the input");

/// Names that a format needs for itself, beside [`FIELDS`].
const RESERVED: [&str; 5] = ["id", "fid", "geom", "measuredheight", "rtree"];

/// A number of metres as written in files.
#[must_use]
pub fn metres(value_m: f64) -> Value {
    Number::from_f64(round_m(value_m)).map_or(Value::Null, Value::Number)
}

/// Rounded to a millimetre, without a negative zero.
#[must_use]
pub fn round_m(value_m: f64) -> f64 {
    let factor = 10_f64.powi(DECIMALS_M);
    (value_m * factor).round() / factor + 0.0
}

/// Under which name a user's attribute is written.
#[must_use]
pub fn carried_name(name: &str) -> String {
    if is_taken(name) { format!("{CARRIED_PREFIX}{name}") } else { name.to_owned() }
}

/// The user's name of a carried attribute: the inverse of [`carried_name`].
#[must_use]
pub fn original_name(name: &str) -> &str {
    match name.strip_prefix(CARRIED_PREFIX) {
        Some(original) if is_taken(original) => original,
        _ => name,
    }
}

/// Whether an attribute name is ours, compared without case as `GeoPackage` does.
#[must_use]
pub fn is_taken(name: &str) -> bool {
    let lower = name.to_lowercase();
    RESERVED.contains(&lower.as_str()) || FIELDS.iter().any(|field| field.column.name == lower)
}

/// Our own attributes where known, and `measuredHeight`.
#[must_use]
pub fn own(record: &BuildingRecord, solid: &SolidFacts) -> JsonMap<String, Value> {
    let mut attributes = JsonMap::new();
    if let Some(height_m) = record.height_m {
        attributes.insert(MEASURED_HEIGHT.to_owned(), metres(height_m));
    }
    for field in &FIELDS {
        let value = field.value(record, solid);
        if !value.is_null() {
            attributes.insert(field.column.name.as_ref().to_owned(), value);
        }
    }
    attributes
}

/// The user's own attributes under the names they have in files.
pub fn carried(record: &BuildingRecord) -> impl Iterator<Item = (String, Value)> {
    record.attributes.iter().map(|(name, value)| (carried_name(name), value.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_taken_name_is_carried_beside_ours_and_finds_back() {
        for name in ["height_m", "STATUS", "fid", "measuredHeight"] {
            assert_eq!(carried_name(name), format!("input_{name}"));
            assert_eq!(original_name(&carried_name(name)), name);
        }
        assert_eq!((carried_name("street").as_str(), original_name("input_street")), ("street", "input_street"));
    }

    #[test]
    fn a_shapefile_tells_all_names_apart() {
        let short: std::collections::BTreeSet<String> =
            FIELDS.iter().map(|field| field.column.name.chars().take(10).collect()).collect();
        assert_eq!(short.len(), FIELDS.len());
        assert!(FIELDS.iter().all(|field| !field.column.title.is_empty()));
    }

    #[test]
    fn seventy_percent_of_a_gable_lies_below_seven_tenths_of_its_rise() {
        use crate::output::RoofShape;
        use geo_types::polygon;
        let outline = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0)];
        let mut house = crate::output::record::tests::record("a", outline, 100.0, 99.0, 7.0);
        assert_eq!(roof_70p_z_m(&house), None, "nobody looked at the roof");
        house.roof = Some(RoofShape::new(RoofForm::Gable, 4.0, 9.0));
        assert_eq!(roof_70p_z_m(&house), Some(107.5));
        house.roof = Some(RoofShape::new(RoofForm::Hip, 4.0, 9.0));
        assert_eq!(roof_70p_z_m(&house), None);
    }

    #[test]
    fn metres_have_three_decimals_and_no_negative_zero() {
        assert_eq!(metres(12.345_678).to_string(), "12.346");
        assert_eq!(metres(-0.000_1).to_string(), "0.0");
        assert_eq!(metres(f64::NAN), Value::Null);
    }
}
