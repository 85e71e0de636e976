//! Buildings of an OpenStreetMap file: `.osm` as the website and Overpass give it, `.osm.pbf` as regional extracts come.
//!
//! Their footprints are ways that close and relations, which GDAL puts into one layer with everything else that has an area. Of
//! that layer the features with a `building` are buildings. Ways and relations are numbered apart: way 5 and relation 5 are two
//! buildings, so an id says which it is.

use std::borrow::Cow;
use std::path::Path;

use serde_json::{Map as JsonMap, Value};

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

/// The attribute that holds the tags that have no column of their own, as GDAL's driver of OpenStreetMap files calls it.
const OTHER_TAGS: &str = "other_tags";

/// An attribute of a building: a column of its own, or a tag of OpenStreetMap among [`OTHER_TAGS`], also where another program has
/// made another format of the file. `None` where it has no such attribute, or the attribute is null.
#[must_use]
pub fn attribute<'a>(attributes: &'a JsonMap<String, Value>, name: &str) -> Option<Cow<'a, Value>> {
    match attributes.get(name).filter(|value| !value.is_null()) {
        Some(value) => Some(Cow::Borrowed(value)),
        None => tag(attributes.get(OTHER_TAGS)?.as_str()?, name).map(|text| Cow::Owned(text.into())),
    }
}

/// A tag among others: `"height"=>"12","building:levels"=>"3"` (hstore, GDAL's default), or a JSON object.
fn tag(tags: &str, name: &str) -> Option<String> {
    if let Ok(tags) = serde_json::from_str::<JsonMap<String, Value>>(tags) {
        return tags.get(name)?.as_str().map(str::to_owned);
    }
    let mut rest = tags;
    loop {
        let (key, after) = quoted(rest)?;
        let (value, after) = quoted(after.trim_start().strip_prefix("=>")?.trim_start())?;
        if key == name {
            return Some(value);
        }
        rest = after.trim_start().strip_prefix(',')?.trim_start();
    }
}

/// The text in quotes at the start, in which a backslash stands before quotes and backslashes, and what comes after it.
fn quoted(text: &str) -> Option<(String, &str)> {
    let text = text.strip_prefix('"')?;
    let (mut inner, mut is_escaped) = (String::new(), false);
    for (i, c) in text.char_indices() {
        match c {
            '\\' if !is_escaped => is_escaped = true,
            '"' if !is_escaped => return Some((inner, &text[i + 1..])),
            _ => {
                is_escaped = false;
                inner.push(c);
            }
        }
    }
    None
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

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_tag_is_found_among_others_and_a_column_goes_before_it() {
        let attributes = |other: &str| {
            let columns = json!({ "name": null, "building": "yes", "other_tags": other });
            columns.as_object().unwrap().clone()
        };
        let hstore = r#""addr:street"=>"Am \"Hof\", \\ 3","height"=>"12 m","name"=>"Dom""#;
        let found = |other: &str, name: &str| attribute(&attributes(other), name).map(Cow::into_owned);
        assert_eq!(found(hstore, "height"), Some(json!("12 m")));
        assert_eq!(found(hstore, "addr:street"), Some(json!(r#"Am "Hof", \ 3"#)));
        assert_eq!(found(hstore, "building"), Some(json!("yes")));
        assert_eq!(found(hstore, "name"), Some(json!("Dom")), "an empty column hides no tag");
        assert_eq!(found(hstore, "building:levels"), None);
        assert_eq!(found(r#"{"height":"9"}"#, "height"), Some(json!("9")), "GDAL's TAGS_FORMAT=JSON");
        for broken in ["", "height", r#""height""#, r#""height"=>"#, r#""height"=>"9"#] {
            assert_eq!(found(broken, "height"), None, "{broken}");
        }
    }
}
