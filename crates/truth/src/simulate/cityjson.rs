//! Surfaces of real buildings in `LoD1` or `LoD2`, from a `CityJSON` file.

use std::path::Path;

use glam::DVec3;
use indexmap::IndexMap;

use sizeup_results::output::cityjson::read::{CityFile, CityGeometry, CitySurface};
use sizeup_results::output::prism::FaceKind;
use sizeup_results::output::{MalformedFile, OutputError};

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

/// Reads a file. Buildings without a usable geometry are left out.
///
/// # Errors
/// [`SimulateError::CityJson`] if it cannot be read or is something else.
pub(super) fn read(path: &Path) -> Result<RawCity, SimulateError> {
    let unusable = |error: OutputError| match error {
        OutputError::Malformed(MalformedFile { reason, .. }) => {
            SimulateError::CityJson { path: path.to_owned(), reason }
        }
        OutputError::File(error) => error.into(),
        other => SimulateError::CityJson { path: path.to_owned(), reason: other.to_string() },
    };
    let city = CityFile::read(path).map_err(unusable)?;
    // Parts go to the building they belong to; buildings keep the order of the file.
    let mut buildings: IndexMap<&str, Vec<RawSurface>> = IndexMap::new();
    for object in city.objects.iter().filter(|object| matches!(object.kind.as_str(), "Building" | "BuildingPart")) {
        let owner = object.parents.first().unwrap_or(&object.id);
        let usable = object.geometries.iter().filter(|geometry| level_of(geometry) <= HIGHEST_LOD);
        let Some(best) = usable.max_by(|a, b| level_of(a).total_cmp(&level_of(b))) else { continue };
        let surfaces = best.surfaces.iter().map(|surface| raw(surface, &city.vertices));
        let is_polygon = |surface: &RawSurface| surface.rings.iter().all(|ring| ring.len() >= 3);
        buildings.entry(owner).or_default().extend(surfaces.filter(is_polygon));
    }
    let buildings = buildings.into_iter().filter(|(_, surfaces)| !surfaces.is_empty());
    let buildings = buildings.map(|(id, surfaces)| RawBuilding { id: id.to_owned(), surfaces }).collect();
    Ok(RawCity { crs: city.crs.map(|crs| crs.definition().to_owned()), buildings })
}

/// Level of detail: `"2.2"`.
fn level_of(geometry: &CityGeometry) -> f64 {
    geometry.lod.parse().unwrap_or(0.0)
}

fn raw(surface: &CitySurface, vertices: &[[f64; 3]]) -> RawSurface {
    let role = match surface.kind {
        Some(FaceKind::Roof) => Role::Roof,
        Some(FaceKind::Ground) => Role::Ground,
        Some(FaceKind::Wall) => Role::Wall,
        None => Role::Unsaid,
    };
    let ring = |ring: &Vec<u32>| ring.iter().map(|&i| DVec3::from(vertices[i as usize])).collect();
    RawSurface { rings: surface.rings.iter().map(ring).collect(), role }
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
    fn something_else_is_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        fs::write(&path, r#"{"type":"FeatureCollection","CityObjects":{},"vertices":[]}"#).unwrap();
        assert!(matches!(read(&path), Err(SimulateError::CityJson { .. })));
    }
}
