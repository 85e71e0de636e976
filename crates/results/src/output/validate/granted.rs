//! What cjval takes for granted and the schemas do not demand: looked at here before cjval sees it, which would end the program.
//!
//! Indices are whole numbers from 0 on; there are surfaces, materials and textures where something refers to them; textures have
//! the shape of what they lie on. What is wrong is said in cjval's words where it has some, and taken out of what cjval is given.
//! Lists that the schemas let be `null` are given as lists of `null`.

use std::panic::{AssertUnwindSafe, catch_unwind};

use cjval::CJValidator;
use serde_json::{Number, Value, json};

use super::schema::{INDICES, MATERIALS, SCHEMA, SEMANTICS, TEXTURES};

/// Finding where cjval panics all the same.
const PANICKED: &str = "its form is so far from CityJSON that it could not be checked";

/// Name of a check, and what it found.
pub(super) type Finding = (&'static str, String);

/// Lists that geometries refer to, beside that of vertices.
#[derive(Debug, Clone, Copy)]
pub(super) struct Appearance {
    has_materials: bool,
    has_textures: bool,
}

impl Appearance {
    /// That of a file, its head, or a feature.
    pub(super) fn of(document: &Value) -> Self {
        let has = |name: &str| document["appearance"][name].as_array().is_some_and(|list| !list.is_empty());
        Self { has_materials: has("materials"), has_textures: has("textures") && has("vertices-texture") }
    }
}

/// Findings of cjval on a document that was [secured](secure_document). Should it end in a panic all the same, that is a finding.
pub(super) fn said(validator: &CJValidator) -> Vec<(String, String, bool)> {
    let summaries = catch_unwind(AssertUnwindSafe(|| validator.validate()));
    let Ok(summaries) = summaries else {
        return vec![(SCHEMA.to_owned(), PANICKED.to_owned(), false)];
    };
    let of_one = |(check, summary): (String, cjval::ValSummary)| {
        let messages = summary.get_errors().iter();
        messages.map(|message| (check.clone(), message.clone(), summary.is_warning())).collect::<Vec<_>>()
    };
    summaries.into_iter().flat_map(of_one).collect()
}

/// Secures a whole file, its head, or a feature of a sequence.
pub(super) fn secure_document(document: &mut Value) -> Vec<Finding> {
    let appearance = Appearance::of(document);
    let mut findings = Vec::new();
    let templates = document.pointer_mut("/geometry-templates/templates").and_then(Value::as_array_mut);
    for (i, template) in templates.into_iter().flatten().enumerate() {
        if let Some(boundaries) = template.get_mut("boundaries") {
            secure_indices(&format!("geometry-templates/templates/{i}/boundaries"), boundaries, &mut findings);
        }
    }
    for (id, object) in document.get_mut("CityObjects").and_then(Value::as_object_mut).into_iter().flatten() {
        findings.extend(secure_object(id, object, appearance));
    }
    findings
}

/// Secures a city object.
pub(super) fn secure_object(id: &str, object: &mut Value, appearance: Appearance) -> Vec<Finding> {
    let mut findings = Vec::new();
    let geometries = object.get_mut("geometry").and_then(Value::as_array_mut);
    for (i, geometry) in geometries.into_iter().flatten().enumerate().filter(|(_, geometry)| geometry.is_object()) {
        let place = format!("#{id} and geom-#{i}");
        // Out of the geometry for as long as the rest of it is changed.
        let mut boundaries = geometry.get_mut("boundaries").map(Value::take).unwrap_or_default();
        secure_indices(&format!("CityObjects/{id}/geometry/{i}/boundaries"), &mut boundaries, &mut findings);
        secure_semantics(&place, geometry, &boundaries, &mut findings);
        secure_materials(&place, geometry, &boundaries, appearance, &mut findings);
        secure_textures(&place, geometry, &boundaries, appearance, &mut findings);
        geometry.get_mut("boundaries").into_iter().for_each(|place| *place = boundaries.take());
    }
    let addresses = object.get_mut("address").and_then(Value::as_array_mut);
    for (i, address) in addresses.into_iter().flatten().enumerate() {
        if let Some(boundaries) = address.pointer_mut("/location/boundaries") {
            let place = format!("CityObjects/{id}/address/{i}/location/boundaries");
            secure_indices(&place, boundaries, &mut findings);
        }
    }
    findings
}

/// Numbers that are no indices become 0.
fn secure_indices(place: &str, boundaries: &mut Value, findings: &mut Vec<Finding>) {
    replace_indices(boundaries, &mut Vec::new(), &mut |number, path| {
        let path: String = path.iter().map(|i| format!("/{i}")).collect();
        findings
            .push((INDICES, format!("vertex index {number} at /{place}{path}: expected a whole number, 0 or more")));
    });
}

fn replace_indices(boundaries: &mut Value, path: &mut Vec<usize>, tell: &mut dyn FnMut(&Number, &[usize])) {
    match boundaries {
        Value::Array(items) => {
            for (i, item) in items.iter_mut().enumerate() {
                path.push(i);
                replace_indices(item, path, tell);
                path.pop();
            }
        }
        Value::Number(number) if number.as_u64().is_none() => {
            tell(number, path);
            *boundaries = json!(0);
        }
        _ => {}
    }
}

/// Lists above the values of semantics and materials, by the type of a geometry.
fn n_lists(geometry: &Value) -> Option<usize> {
    Some(match geometry["type"].as_str()? {
        "MultiPoint" | "MultiLineString" | "MultiSurface" | "CompositeSurface" => 1,
        "Solid" => 2,
        "MultiSolid" | "CompositeSolid" => 3,
        _ => return None,
    })
}

fn secure_semantics(place: &str, geometry: &mut Value, boundaries: &Value, findings: &mut Vec<Finding>) {
    let Some(n_lists) = n_lists(geometry) else { return };
    let has_surfaces =
        geometry.pointer("/semantics/surfaces").and_then(Value::as_array).is_none_or(|list| !list.is_empty());
    let Some(values) = geometry.pointer_mut("/semantics/values") else { return };
    let wrong = secure_values(values, boundaries, n_lists, has_surfaces);
    let found = |value: Value| match (value.as_u64(), has_surfaces) {
        (Some(_), false) => format!("Reference in semantic \"values\" overflows; {place}"),
        _ => format!("Reference {value} in semantic \"values\" is no whole number, 0 or more; {place}"),
    };
    findings.extend(wrong.into_iter().map(|value| (SEMANTICS, found(value))));
}

fn secure_materials(
    place: &str,
    geometry: &mut Value,
    boundaries: &Value,
    appearance: Appearance,
    findings: &mut Vec<Finding>,
) {
    let Some(n_lists) = n_lists(geometry) else { return };
    let themes = geometry.get_mut("material").and_then(Value::as_object_mut);
    let mut wrong = Vec::new();
    for theme in themes.into_iter().flat_map(|themes| themes.values_mut()) {
        if let Some(values) = theme.get_mut("values") {
            wrong.extend(secure_values(values, boundaries, n_lists, appearance.has_materials));
        }
        let single = theme.get_mut("value").filter(|value| value.is_number());
        if let Some(value) = single.filter(|value| value.as_u64().is_none() || !appearance.has_materials) {
            wrong.push(value.clone());
        }
    }
    let Some(value) = wrong.first() else { return };
    findings.push((MATERIALS, format!("Reference {value} in material \"values\" is to no material; {place}")));
    if let Some(geometry) = geometry.as_object_mut() {
        geometry.remove("material");
    }
}

/// Values with the shape of boundaries: missing lists become lists of nulls. References that are none become null, and are
/// handed back.
fn secure_values(values: &mut Value, boundaries: &Value, n_lists: usize, has_targets: bool) -> Vec<Value> {
    if n_lists == 0 {
        let is_wrong = values.is_number() && (values.as_u64().is_none() || !has_targets);
        return if is_wrong { vec![values.take()] } else { Vec::new() };
    }
    if values.is_null() {
        let n = boundaries.as_array().map_or(0, Vec::len);
        *values = Value::Array(vec![Value::Null; n]);
    }
    let items = values.as_array_mut().into_iter().flatten().enumerate();
    items.flat_map(|(i, value)| secure_values(value, &boundaries[i], n_lists - 1, has_targets)).collect()
}

/// Textures that cannot be compared with the boundaries are left out.
fn secure_textures(
    place: &str,
    geometry: &mut Value,
    boundaries: &Value,
    appearance: Appearance,
    findings: &mut Vec<Finding>,
) {
    let Some(themes) = geometry.get("texture").and_then(Value::as_object) else { return };
    let is_sound = |theme: &Value| lies_on(&theme["values"], boundaries, appearance.has_textures);
    if n_lists(geometry).is_some() && themes.values().all(is_sound) {
        return;
    }
    findings.push((
        TEXTURES,
        format!("/texture/values/ not same structure as /boundaries, or refers to no texture; {place}"),
    ));
    if let Some(geometry) = geometry.as_object_mut() {
        geometry.remove("texture");
    }
}

/// Whether the values of a texture are lists like the boundaries, of rings with something in them, down to whole numbers and nulls.
fn lies_on(values: &Value, boundaries: &Value, has_textures: bool) -> bool {
    let (Some(values), Some(boundaries)) = (values.as_array(), boundaries.as_array()) else { return false };
    if boundaries.iter().all(|item| !item.is_array()) {
        let is_reference = |value: &Value| value.is_null() || (value.as_u64().is_some() && has_textures);
        return !values.is_empty() && values.iter().all(is_reference);
    }
    values.len() == boundaries.len() && values.iter().zip(boundaries).all(|(a, b)| lies_on(a, b, has_textures))
}

#[cfg(test)]
mod tests {
    use super::super::schema::validator;
    use super::*;

    /// A file with everything that refers to anything.
    fn city() -> Value {
        let ring = json!([[0, 1, 2]]);
        let shell = json!([ring, [[0, 1, 3]], [[1, 2, 3]], [[2, 0, 3]]]);
        let texture = json!([[[0, 0, 1, 2]], [[0, 0, 1, 2]], [[null]], [[null]]]);
        json!({
            "type": "CityJSON", "version": "2.0", "transform": { "scale": [1, 1, 1], "translate": [0, 0, 0] },
            "vertices": [[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]],
            "appearance": {
                "materials": [{ "name": "brick" }],
                "textures": [{ "type": "PNG", "image": "a.png" }],
                "vertices-texture": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
            },
            "geometry-templates": {
                "templates": [{ "type": "MultiSurface", "lod": "2", "boundaries": [ring] }],
                "vertices-templates": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
            },
            "CityObjects": {
                "a": {
                    "type": "Building",
                    "address": [{ "location": { "type": "MultiPoint", "lod": "1", "boundaries": [3] } }],
                    "geometry": [
                        {
                            "type": "Solid", "lod": "2", "boundaries": [shell],
                            "semantics": { "surfaces": [{ "type": "RoofSurface" }], "values": [[0, null, 0, null]] },
                            "material": { "theme": { "values": [[0, null, 0, null]] } },
                            "texture": { "theme": { "values": [texture] } },
                        },
                        {
                            "type": "MultiSurface", "lod": "1", "boundaries": shell,
                            "semantics": { "surfaces": [{ "type": "RoofSurface" }], "values": [0, null, 0, null] },
                            "material": { "theme": { "value": 0 } },
                            "texture": { "theme": { "values": texture } },
                        },
                        {
                            "type": "CompositeSolid", "lod": "3", "boundaries": [[shell]],
                            "semantics": { "surfaces": [{ "type": "RoofSurface" }], "values": [[[0, null, 0, null]]] },
                        },
                    ],
                },
                "t": {
                    "type": "SolitaryVegetationObject",
                    "geometry": [{
                        "type": "GeometryInstance", "template": 0, "boundaries": [0],
                        "transformationMatrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
                    }],
                },
            },
        })
    }

    /// Findings in a file, by check: before cjval, and by it.
    fn found(mut city: Value) -> Vec<(String, String)> {
        let mut found: Vec<_> =
            secure_document(&mut city).into_iter().map(|(check, text)| (check.to_owned(), text)).collect();
        let of_cjval = said(&validator(&city.to_string())).into_iter().filter(|(.., is_warning)| !is_warning);
        found.extend(of_cjval.map(|(check, message, _)| (check, message)));
        found
    }

    fn altered(place: &str, value: Value) -> Value {
        let mut city = city();
        *city.pointer_mut(place).unwrap_or_else(|| panic!("{place}")) = value;
        city
    }

    #[test]
    fn a_sound_file_is_given_as_it_is_and_lists_that_may_be_null_are_no_fault() {
        let mut same = city();
        assert_eq!(secure_document(&mut same), []);
        assert_eq!(same, city());
        let geometry = "/CityObjects/a/geometry";
        for place in [
            "0/semantics/values",
            "0/semantics/values/0",
            "1/semantics/values",
            "2/semantics/values/0/0",
            "0/material/theme/values/0",
        ] {
            assert_eq!(found(altered(&format!("{geometry}/{place}"), Value::Null)), [], "{place}");
        }
    }

    #[test]
    fn an_index_that_is_none_is_told_with_its_place() {
        for (place, is_shown) in [
            ("CityObjects/a/geometry/0/boundaries/0/2/0/1", true),
            ("CityObjects/a/geometry/1/boundaries/3/0/2", true),
            ("CityObjects/a/geometry/2/boundaries/0/0/1/0/0", true),
            ("CityObjects/a/address/0/location/boundaries/0", true),
            ("CityObjects/t/geometry/0/boundaries/0", true),
            ("geometry-templates/templates/0/boundaries/0/0/1", true),
            ("CityObjects/a/geometry/0/semantics/values/0/2", false),
            ("CityObjects/a/geometry/0/material/theme/values/0/2", false),
            ("CityObjects/a/geometry/1/texture/theme/values/1/0/2", false),
        ] {
            for index in [json!(-1), json!(1e20), json!(0.5), json!(1.0)] {
                let found = found(altered(&format!("/{place}"), index.clone()));
                assert_eq!(found.len(), 1, "{place} {index}: {found:?}");
                assert!(!is_shown || found[0].1.contains(&format!("{index} at /{place}")), "{found:?}");
            }
        }
    }

    #[test]
    fn references_to_what_is_not_there_are_told() {
        let without = |place: &str| altered(place, json!([]));
        for (city, check) in [
            (without("/CityObjects/a/geometry/0/semantics/surfaces"), "semantics_arrays"),
            (without("/appearance/materials"), "materials"),
            (without("/appearance/textures"), "textures"),
            (without("/appearance/vertices-texture"), "textures"),
            (without("/CityObjects/a/geometry/0/texture/theme/values/0/0/0"), "textures"),
            (without("/CityObjects/a/geometry/1/texture/theme/values"), "textures"),
            (altered("/CityObjects/a/geometry/0/texture/theme", json!({})), "textures"),
        ] {
            let found = found(city);
            assert!(!found.is_empty() && found.iter().all(|(name, _)| name == check), "{check}: {found:?}");
        }
    }

    /// Every value of a file replaced by what does not belong there.
    #[test]
    fn whatever_stands_in_a_file_cjval_does_not_panic() {
        fn places(value: &Value, at: String, all: &mut Vec<String>) {
            match value {
                Value::Object(members) => members.iter().for_each(|(name, v)| places(v, format!("{at}/{name}"), all)),
                // The first of several is as good as the second.
                Value::Array(items) => items.iter().take(1).for_each(|v| places(v, format!("{at}/0"), all)),
                _ => {}
            }
            all.push(at);
        }
        let mut all = Vec::new();
        places(&city(), String::new(), &mut all);
        let strange = [json!(null), json!(-1), json!("x"), json!([]), json!([[]]), json!({}), json!([[[[[[0]]]]]])];
        // All of them are hundreds of files: a different one at each place, and all over the run of places.
        let panics = all.iter().enumerate().filter(|(i, place)| {
            let found = found(altered(place, strange[i % strange.len()].clone()));
            found.iter().any(|(_, message)| message == PANICKED)
        });
        let places: Vec<_> = panics.map(|(i, place)| format!("{place}: {}", strange[i % strange.len()])).collect();
        assert_eq!(places, Vec::<String>::new());
    }
}
