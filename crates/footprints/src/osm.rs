//! Buildings of an OpenStreetMap file: `.osm` as the website and Overpass give it, `.osm.pbf` as regional extracts come.
//!
//! Their footprints are ways that close and relations, which GDAL puts into one layer with everything else that has an area. Of
//! that layer the features with a `building` are buildings. Ways and relations are numbered apart: way 5 and relation 5 are two
//! buildings, so an id says which it is.

use std::path::Path;

use serde_json::Value;

use super::FootprintConfig;
use super::features::Ids;
use sizeup_geo::geodata::vector::{Feature, VectorError, VectorLayer};

/// GDAL's layer of areas.
const AREAS: &str = "multipolygons";
/// Attribute that makes an area a building.
const ARE_BUILDINGS: &str = "building IS NOT NULL AND building <> 'no'";

/// Whether a file is OpenStreetMap's, by its extension.
#[must_use]
pub fn is_osm(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("osm") || e.eq_ignore_ascii_case("pbf"))
}

/// Opens the layer of footprints: of an OpenStreetMap file its buildings, unless another layer is asked for.
///
/// # Errors
/// As [`VectorLayer::open`].
pub fn open_layer(config: &FootprintConfig) -> Result<VectorLayer, VectorError> {
    if !asks_for_buildings(config) {
        return VectorLayer::open(&config.path, config.layer.as_deref());
    }
    let mut layer = VectorLayer::open(&config.path, Some(AREAS))?;
    layer.only_where(ARE_BUILDINGS)?;
    Ok(layer)
}

/// Ids of the layer's buildings.
pub(super) fn ids(config: &FootprintConfig) -> Ids<'_> {
    match &config.id_field {
        Some(field) => Ids::Field(field),
        None if asks_for_buildings(config) => Ids::OpenStreetMap,
        None => Ids::Numbers,
    }
}

fn asks_for_buildings(config: &FootprintConfig) -> bool {
    is_osm(&config.path) && config.layer.as_ref().is_none_or(|layer| layer == AREAS)
}

/// `way/123` or `relation/45`, as the website's addresses have it; empty where the feature does not tell.
pub(super) fn id_of(feature: &Feature) -> String {
    let number = |name: &str| match feature.attributes.get(name) {
        Some(Value::String(text)) if !text.is_empty() => Some(text.clone()),
        Some(Value::Number(number)) => Some(number.to_string()),
        _ => None,
    };
    let way = number("osm_way_id").map(|number| format!("way/{number}"));
    way.or_else(|| number("osm_id").map(|number| format!("relation/{number}"))).unwrap_or_default()
}
