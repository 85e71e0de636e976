//! Under which names a building's own attributes stand in `CityJSON`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map as JsonMap, Value, json};

use super::super::attributes::{self, FIELDS, Field, metres};
use super::super::facts::SolidFacts;
use super::super::roof_solid::RoofFacet;
use super::super::{BuildingRecord, HeightReference, RoofForm, Status};
use sizeup_geo::geodata::features::ColumnKind;

/// Prefix of our attributes where the file declares our extension: names of an extension begin with `+`.
pub const EXTENSION_PREFIX: &str = "+sizeup-";

/// Name of our extension.
const EXTENSION_NAME: &str = "Sizeup";

/// Names under which attributes are written to CityJSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub enum AttributeNames {
    /// Names that sizeup defines.
    #[default]
    #[serde(rename = "sizeup")]
    Sizeup,
    /// Ours, and beside them those of the Dutch 3DBAG (docs.3dbag.nl) that mean the same: `identificatie`,
    /// `b3_h_maaiveld`, `b3_h_dak_min`, `b3_h_dak_50p` or `b3_h_dak_max` by what the height stands for, all of them,
    /// `b3_dak_type`, `b3_h_dak_70p`, `b3_opp_dak_plat` and `b3_opp_dak_schuin` where the roof's form is known, `b3_bouwlagen`,
    /// `b3_opp_grond`, `b3_opp_buitenmuur`, `b3_opp_scheidingsmuur`, `b3_volume_lod12`, `b3_volume_lod22`, `b3_val3dity_lod12`; and
    /// `b3_hellingshoek` and `b3_azimut` of planes of roofs.
    #[serde(rename = "3dbag")]
    ThreeDBag,
}

/// The attributes of a plane of a roof: `area_m2`, `slope_deg` and `aspect_deg`, in 3DBAG's names too where they are asked for.
pub fn of_plane(facet: &RoofFacet, names: AttributeNames) -> JsonMap<String, Value> {
    let mut own = facet.attributes();
    if names == AttributeNames::ThreeDBag {
        own.insert("b3_hellingshoek".to_owned(), json!(facet.slope_deg));
        if let Some(aspect_deg) = facet.aspect_deg {
            own.insert("b3_azimut".to_owned(), json!(aspect_deg));
        }
    }
    own
}

/// The attributes of 3DBAG that can be told of a building.
pub fn three_d_bag(record: &BuildingRecord, solid: &SolidFacts) -> JsonMap<String, Value> {
    let mut names = JsonMap::new();
    let mut set = |name: &str, value: Value| names.insert(name.to_owned(), value);
    set("identificatie", json!(record.part_of.as_ref().unwrap_or(&record.id)));
    if let Some(ground_m) = record.ground_z_m {
        set("b3_h_maaiveld", metres(ground_m));
    }
    if let Some(roof_m) = record.roof_z_m() {
        let name = match record.height_reference {
            HeightReference::Eave => "b3_h_dak_min",
            // The median over the roof's area: for a box that stands for the mean of a pitched roof, its nearest.
            HeightReference::Mean => "b3_h_dak_50p",
            HeightReference::Ridge => "b3_h_dak_max",
        };
        set(name, metres(roof_m));
    }
    if let Some((roof, ground_m)) = record.roof.zip(record.ground_z_m) {
        let kind = match roof.form {
            RoofForm::Flat => "horizontal",
            RoofForm::Gable | RoofForm::Hip => "slanted",
            RoofForm::Stepped => "multiple horizontal",
        };
        set("b3_dak_type", json!(kind));
        set("b3_h_dak_min", metres(ground_m + roof.eave_height_m));
        set("b3_h_dak_max", metres(ground_m + roof.ridge_height_m));
    }
    if let Some(roof_m) = attributes::roof_70p_z_m(record) {
        set("b3_h_dak_70p", metres(roof_m));
    }
    if let Some(n) = attributes::n_storeys(record) {
        set("b3_bouwlagen", json!(n));
    }
    if !solid.roof.is_empty() {
        let area_m2 = |is_flat: bool| -> f64 {
            solid.roof.iter().filter(|plane| plane.aspect_deg.is_none() == is_flat).map(|plane| plane.area_m2).sum()
        };
        set("b3_opp_dak_plat", metres(area_m2(true)));
        set("b3_opp_dak_schuin", metres(area_m2(false)));
    }
    if let Some(measures) = solid.measures {
        let area_m2 = record.footprint.as_ref().map_or(f64::NAN, geo::Area::unsigned_area);
        set("b3_opp_grond", metres(area_m2));
        set("b3_volume_lod12", metres(measures.volume_m3));
        if let Some(roofed) = solid.roofed_measures {
            set("b3_volume_lod22", metres(roofed.volume_m3));
        }
        set("b3_val3dity_lod12", json!(format!("{:?}", solid.faults)));
        if let Some(shared_m2) = record.party_wall_m2 {
            set("b3_opp_scheidingsmuur", metres(shared_m2));
            set("b3_opp_buitenmuur", metres(measures.walls_m2 - shared_m2));
        }
    }
    names
}

/// Our attributes under the names of the extension; `measuredHeight` is `CityGML`'s and stays.
pub fn extended(attributes: JsonMap<String, Value>) -> JsonMap<String, Value> {
    let rename =
        |name: String| if name == attributes::MEASURED_HEIGHT { name } else { EXTENSION_PREFIX.to_owned() + &name };
    attributes.into_iter().map(|(name, value)| (rename(name), value)).collect()
}

/// The file's `extensions` member.
pub fn extensions(url: &str) -> Value {
    json!({ EXTENSION_NAME: { "url": url, "version": env!("CARGO_PKG_VERSION") } })
}

/// Our extension (`CityJSON` 2.0, 8): which attributes it has, of which type.
#[must_use]
pub fn extension_schema() -> Value {
    let attribute = |field: &Field| {
        let column = &field.column;
        let mut schema = if field.is_list() {
            json!({ "type": "array", "items": { "type": "string" } })
        } else {
            match (&*column.name, column.kind) {
                ("status", _) => json!({ "enum": Status::ALL.map(Status::as_str) }),
                ("height_reference", _) => json!({ "enum": ["eave", "mean", "ridge"] }),
                ("roof_form", _) => json!({ "enum": ["flat", "gable", "hip", "stepped"] }),
                (_, ColumnKind::Text) => json!({ "type": "string" }),
                (_, ColumnKind::Real) => json!({ "type": "number" }),
                (_, ColumnKind::Integer | ColumnKind::Flag) => json!({ "type": "integer" }),
            }
        };
        schema["description"] = column.meaning.into();
        (format!("{EXTENSION_PREFIX}{}", column.name), schema)
    };
    let attributes: JsonMap<String, Value> = FIELDS.iter().map(attribute).collect();
    json!({
        "type": "CityJSONExtension",
        "name": EXTENSION_NAME,
        "url": "sizeup.ext.json",
        "version": env!("CARGO_PKG_VERSION"),
        "versionCityJSON": "2.0",
        "description": "Heights of buildings measured in aerial photos, and how well they are known",
        "extraRootProperties": {},
        "extraAttributes": { "Building": attributes, "BuildingPart": attributes },
        "extraCityObjects": {},
        "extraSemanticSurfaces": {},
    })
}
