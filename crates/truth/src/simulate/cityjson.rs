//! Reading building surfaces from `CityJSON` 1.x and 2.0: `MultiSurface`, `CompositeSurface`, `Solid`, `MultiSolid` and
//! `CompositeSolid`, `LoD1` or `LoD2`, with or without semantics.
//!
//! Source: `CityJSON` Specifications 2.0.0, sections 2 (city objects) and 3 (geometry), <https://www.cityjson.org/specs/>.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use serde::Deserialize;
use serde_json::Value;

use sizeup_geo::files;

use super::SimulateError;

/// Highest level of detail that is used: `LoD3` has windows and overhangs that no truth of ours speaks of.
const HIGHEST_LOD: f64 = 2.9;

/// Kind of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Roof,
    Ground,
    Wall,
    /// The file does not say.
    Unsaid,
}

/// A planar polygon with holes, rings without a repeated last point; CRS of the file.
#[derive(Debug, Clone)]
pub(super) struct RawSurface {
    pub rings: Vec<Vec<DVec3>>,
    pub role: Role,
}

/// All surfaces of one building, its parts included.
#[derive(Debug, Clone)]
pub(super) struct RawBuilding {
    pub id: String,
    pub surfaces: Vec<RawSurface>,
}

/// Content of a file.
#[derive(Debug)]
pub(super) struct RawCity {
    /// Definition of the CRS, such as `EPSG:28992`; `None` where the file names none.
    pub crs: Option<String>,
    /// In the order of the file.
    pub buildings: Vec<RawBuilding>,
}

#[derive(Deserialize)]
struct CityJsonDocument {
    #[serde(rename = "type")]
    kind: String,
    transform: Option<CityJsonTransform>,
    #[serde(default)]
    metadata: Value,
    #[serde(rename = "CityObjects")]
    objects: serde_json::Map<String, Value>,
    vertices: Vec<[f64; 3]>,
}

#[derive(Deserialize)]
struct CityJsonTransform {
    scale: [f64; 3],
    translate: [f64; 3],
}

#[derive(Deserialize)]
struct Object {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    parents: Vec<String>,
    #[serde(default)]
    geometry: Vec<CityJsonGeometry>,
}

#[derive(Deserialize)]
struct CityJsonGeometry {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    lod: Value,
    #[serde(default)]
    boundaries: Value,
    #[serde(default)]
    semantics: Value,
}

impl CityJsonGeometry {
    /// `"2.2"` in version 1.1 and later, a number before.
    fn lod(&self) -> f64 {
        self.lod.as_f64().or_else(|| self.lod.as_str()?.parse().ok()).unwrap_or(0.0)
    }
}

/// Reads a file. Buildings without a usable geometry are left out.
///
/// # Errors
/// [`SimulateError::File`] if it cannot be read, [`SimulateError::CityJson`] if it is something else.
pub(super) fn read(path: &Path) -> Result<RawCity, SimulateError> {
    let unusable = |reason: String| SimulateError::CityJson { path: path.to_owned(), reason };
    let text = files::read_bytes(path)?;
    let document: CityJsonDocument = serde_json::from_slice(&text).map_err(|e| unusable(e.to_string()))?;
    if document.kind != "CityJSON" {
        return Err(unusable(format!("its type is {:?}", document.kind)));
    }
    let vertices: Vec<DVec3> = match &document.transform {
        Some(t) => {
            let (scale, shift) = (DVec3::from(t.scale), DVec3::from(t.translate));
            document.vertices.iter().map(|&v| DVec3::from(v) * scale + shift).collect()
        }
        None => document.vertices.iter().map(|&v| DVec3::from(v)).collect(),
    };
    // Parts go to the building they belong to; buildings keep the order of the file.
    let mut order: Vec<String> = Vec::new();
    let mut surfaces: BTreeMap<String, Vec<RawSurface>> = BTreeMap::new();
    for (id, value) in document.objects {
        let object: Object = serde_json::from_value(value).map_err(|e| unusable(format!("object {id}: {e}")))?;
        if !object.kind.starts_with("Building") || !matches!(object.kind.as_str(), "Building" | "BuildingPart") {
            continue;
        }
        let owner = object.parents.first().cloned().unwrap_or(id);
        let usable = object.geometry.iter().filter(|g| g.lod() <= HIGHEST_LOD);
        let Some(best) = usable.max_by(|a, b| a.lod().total_cmp(&b.lod())) else { continue };
        let found = surfaces.entry(owner.clone()).or_default();
        if found.is_empty() {
            order.push(owner);
        }
        collect(best, &vertices, found);
    }
    let buildings = order.into_iter().map(|id| {
        let surfaces = surfaces.remove(&id).unwrap_or_default();
        RawBuilding { id, surfaces }
    });
    let buildings = buildings.filter(|b| !b.surfaces.is_empty()).collect();
    Ok(RawCity { crs: crs(&document.metadata), buildings })
}

/// `https://www.opengis.net/def/crs/EPSG/0/28992` and `urn:ogc:def:crs:EPSG::28992` as `EPSG:28992`; OGC's names of two parts
/// (`…/crs-compound?1=…/EPSG/0/28992&2=…/EPSG/0/5709`) as `EPSG:28992+5709`.
fn crs(metadata: &Value) -> Option<String> {
    let name = metadata["referenceSystem"].as_str()?;
    let parts = name.split("EPSG").skip(1).map(|part| {
        let code = part.split(['&', ',']).next()?.rsplit(['/', ':']).next()?;
        code.parse::<u32>().ok().map(|code| code.to_string())
    });
    let codes = parts.collect::<Option<Vec<String>>>()?;
    (!codes.is_empty()).then(|| format!("EPSG:{}", codes.join("+")))
}

/// Surfaces lie one, two or three levels deep; semantics have the same nesting down to the surface.
fn collect(geometry: &CityJsonGeometry, vertices: &[DVec3], found: &mut Vec<RawSurface>) {
    let depth = match geometry.kind.as_str() {
        "MultiSurface" | "CompositeSurface" => 0,
        "Solid" => 1,
        "MultiSolid" | "CompositeSolid" => 2,
        _ => return,
    };
    let kinds = &geometry.semantics["surfaces"];
    descend(&geometry.boundaries, &geometry.semantics["values"], depth, &mut |boundary, value| {
        let role = match value.as_u64().and_then(|i| kinds[i as usize]["type"].as_str()) {
            Some("RoofSurface") => Role::Roof,
            Some("GroundSurface") => Role::Ground,
            Some(_) => Role::Wall,
            None => Role::Unsaid,
        };
        let ring = |r: &Value| -> Option<Vec<DVec3>> {
            let indices = r.as_array()?.iter();
            let points: Option<Vec<DVec3>> =
                indices.map(|i| vertices.get(usize::try_from(i.as_u64()?).ok()?).copied()).collect();
            points.filter(|p| p.len() >= 3)
        };
        let rings: Option<Vec<Vec<DVec3>>> = boundary.as_array().and_then(|rings| rings.iter().map(ring).collect());
        if let Some(rings) = rings.filter(|r| !r.is_empty()) {
            found.push(RawSurface { rings, role });
        }
    });
}

fn descend(boundary: &Value, value: &Value, depth: usize, visit: &mut impl FnMut(&Value, &Value)) {
    for (i, inner) in boundary.as_array().into_iter().flatten().enumerate() {
        if depth == 0 {
            visit(inner, &value[i]);
        } else {
            descend(inner, &value[i], depth - 1, visit);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// A 2 × 1 m box, 3 m high, as a Solid without semantics.
    const BOX: &str = r#"{"type":"CityJSON","version":"2.0","transform":{"scale":[0.5,0.5,0.5],"translate":[10,20,0]},
        "metadata":{"referenceSystem":"https://www.opengis.net/def/crs/EPSG/0/28992"},
        "CityObjects":{"p":{"type":"BuildingPart","parents":["b"],"geometry":[{"type":"Solid","lod":"1.2","boundaries":
        [[[[0,3,2,1]],[[4,5,6,7]],[[0,1,5,4]],[[1,2,6,5]],[[2,3,7,6]],[[3,0,4,7]]]]}]},
        "b":{"type":"Building","children":["p"]},"t":{"type":"SolitaryVegetationObject"}},
        "vertices":[[0,0,0],[4,0,0],[4,2,0],[0,2,0],[0,0,6],[4,0,6],[4,2,6],[0,2,6]]}"#;

    #[test]
    fn parts_belong_to_their_building_and_vertices_are_transformed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("box.city.json");
        fs::write(&path, BOX).unwrap();
        let city = read(&path).unwrap();
        assert_eq!(city.crs.as_deref(), Some("EPSG:28992"));
        assert_eq!(city.buildings.len(), 1);
        assert_eq!((city.buildings[0].id.as_str(), city.buildings[0].surfaces.len()), ("b", 6));
        assert_eq!(city.buildings[0].surfaces[1].rings[0][2], DVec3::new(12.0, 21.0, 3.0));
    }

    #[test]
    fn the_vertical_part_of_a_compound_is_not_its_crs() {
        let of = |name: &str| crs(&serde_json::json!({ "referenceSystem": name }));
        let part = |n: &str, code: u32| format!("{n}=http://www.opengis.net/def/crs/EPSG/0/{code}");
        let url = format!("http://www.opengis.net/def/crs-compound?{}&{}", part("1", 28992), part("2", 5709));
        assert_eq!(of(&url).as_deref(), Some("EPSG:28992+5709"));
        assert_eq!(of("urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709").as_deref(), Some("EPSG:28992+5709"));
        assert_eq!(of("urn:ogc:def:crs:EPSG::7415").as_deref(), Some("EPSG:7415"));
        assert_eq!(of("OGC:CRS84"), None);
    }

    #[test]
    fn something_else_is_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        fs::write(&path, r#"{"type":"FeatureCollection","CityObjects":{},"vertices":[]}"#).unwrap();
        assert!(matches!(read(&path), Err(SimulateError::CityJson { .. })));
    }
}
