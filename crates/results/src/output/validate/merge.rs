//! Several features of a sequence as one, so that a validator has to look at one only.
//!
//! What is wrong with a feature alone is wrong with all of them together, and nothing else becomes wrong: objects keep
//! their ids, which must differ; indices move by the vertices before them; vertices are moved apart, so that those of
//! different features never coincide. A feature with anything that this would hide or break is not merged.

use serde_json::{Map, Value, json};

/// Members of a feature that can be merged.
const MEMBERS: [&str; 4] = ["type", "id", "CityObjects", "vertices"];
/// Vertices of features lie so far apart, quanta: further than a city is wide.
const APART: i64 = 1 << 40;

/// The features (a JSON text each) as one; `None` if one of them has to be looked at alone.
#[must_use]
pub fn merged<'a>(lines: impl Iterator<Item = &'a str>) -> Option<String> {
    let mut objects = Map::new();
    let mut vertices: Vec<Value> = Vec::new();
    let mut id = None;
    for (shift, line) in (0..).step_by(APART as usize).zip(lines) {
        let Ok(Value::Object(mut feature)) = serde_json::from_str(line) else { return None };
        let is_plain = feature.len() == MEMBERS.len() && MEMBERS.iter().all(|name| feature.contains_key(*name));
        let Some(Value::Object(own)) = feature.remove("CityObjects").filter(|_| is_plain) else { return None };
        let Some(Value::Array(points)) = feature.remove("vertices") else { return None };
        if feature["type"] != "CityJSONFeature" || !feature["id"].is_string() || !refers_to_itself(&own) {
            return None;
        }
        let (before, n) = (vertices.len() as u64, points.len() as u64);
        for (name, mut object) in own {
            let is_moved = move_indices(&mut object, before, n);
            if !is_moved || objects.insert(name, object).is_some() {
                return None;
            }
        }
        vertices.extend(points.into_iter().map(|point| moved(&point, shift)).collect::<Option<Vec<_>>>()?);
        id = id.or_else(|| feature.remove("id"));
    }
    Some(json!({ "type": "CityJSONFeature", "id": id?, "CityObjects": objects, "vertices": vertices }).to_string())
}

/// Whether parents and children are all among the feature's own objects.
fn refers_to_itself(objects: &Map<String, Value>) -> bool {
    let names = |object: &Value, member: &str| match object.get(member) {
        None => Some(Vec::new()),
        Some(Value::Array(names)) => names.iter().map(|name| name.as_str().map(str::to_owned)).collect(),
        Some(_) => None,
    };
    objects
        .values()
        .flat_map(|object| [names(object, "parents"), names(object, "children")])
        .all(|names| names.is_some_and(|names: Vec<String>| names.iter().all(|name| objects.contains_key(name))))
}

/// Moves the indices of an object's geometries; `false` where that cannot be done faithfully.
fn move_indices(object: &mut Value, before: u64, n: u64) -> bool {
    // An address may refer to vertices of its own.
    if object.get("address").is_some() {
        return false;
    }
    match object.get_mut("geometry") {
        None => true,
        Some(Value::Array(geometries)) => geometries.iter_mut().all(|geometry| {
            geometry["type"] != "GeometryInstance"
                && geometry.get_mut("boundaries").is_some_and(|boundaries| move_by(boundaries, before, n))
        }),
        Some(_) => false,
    }
}

fn move_by(boundaries: &mut Value, before: u64, n: u64) -> bool {
    match boundaries {
        Value::Array(items) => items.iter_mut().all(|item| move_by(item, before, n)),
        other => match other.as_u64() {
            Some(index) if index < n => {
                *other = (index + before).into();
                true
            }
            _ => false,
        },
    }
}

/// A vertex of three whole numbers, moved along x.
fn moved(point: &Value, shift: i64) -> Option<Value> {
    let [x, y, z] = point.as_array()?.as_slice() else { return None };
    let (x, y, z) = (x.as_i64()?, y.as_i64()?, z.as_i64()?);
    (x.unsigned_abs() < APART as u64 / 2).then(|| json!([x + shift, y, z]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feature(id: &str, index: u64) -> String {
        json!({
            "type": "CityJSONFeature", "id": id, "vertices": [[1, 2, 3], [4, 5, 6]],
            "CityObjects": { id: { "type": "Building", "geometry": [{ "type": "MultiSurface", "boundaries": [[[0, index]]] }] } },
        })
        .to_string()
    }

    #[test]
    fn indices_and_vertices_move_together() {
        let text = merged([feature("a", 1), feature("b", 1)].iter().map(String::as_str)).unwrap();
        let both: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(both["CityObjects"]["b"]["geometry"][0]["boundaries"], json!([[[2, 3]]]));
        assert_eq!(both["vertices"], json!([[1, 2, 3], [4, 5, 6], [1 + APART, 2, 3], [4 + APART, 5, 6]]));
        assert_eq!(both["id"], "a");
    }

    #[test]
    fn what_merging_would_hide_is_looked_at_alone() {
        let is_merged = |b: &str| merged([feature("a", 1).as_str(), b].into_iter()).is_some();
        assert!(is_merged(&feature("b", 1)));
        assert!(!is_merged(&feature("b", 2)), "an index beyond its own vertices");
        assert!(!is_merged(&feature("a", 1)), "an id for the second time");
        assert!(!is_merged(&feature("b", 1).replace("\"Building\"", "\"Building\",\"children\":[\"a\"]")));
        assert!(!is_merged(&feature("b", 1).replace("\"id\"", "\"metadata\":{},\"id\"")));
        assert!(!is_merged(&feature("b", 1).replace("[1,2,3]", "[1.5,2,3]")));
        assert!(!is_merged("nonsense"));
    }
}
