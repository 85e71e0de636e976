//! City objects: a building in one piece is a `Building`; one in several is a `Building` with a `BuildingPart` each.

use crate::output::prism::MIN_THICKNESS_M;
use serde_json::{Map as JsonMap, Value, json};

use super::super::address::Address;
use super::super::attributes;
use super::super::buildings::Family;
use super::super::facts::SolidFacts;
use super::super::footprint::SnappedFootprint;
use super::super::grid::OutputGrid;
use super::super::prism::{FaceKind, GridFace};
use super::super::roof_solid::{self, Detail, RoofSurface};
use super::super::textured::Painting;
use super::super::{BuildingRecord, Status};
use super::names::{self, AttributeNames};
use super::vertices::VertexPool;
use super::{CityJsonConfig, metadata};

/// An id and its object.
pub type Named = (String, Value);

/// Settings that objects are made with.
#[derive(Clone, Copy)]
pub struct ObjectSettings<'a> {
    /// Grid of the vertices.
    pub grid: &'a OutputGrid,
    /// Form in which they are written.
    pub config: &'a CityJsonConfig,
    /// Whether there are solids with roofs beside the blocks.
    pub has_roofs: bool,
    /// Textures of the solids.
    pub painting: Option<&'a Painting<'a>>,
}

impl ObjectSettings<'_> {
    /// The objects of a building, the root first; their vertices go into `pool`.
    pub fn of(&self, family: &Family<'_>, pool: &mut VertexPool) -> Vec<Named> {
        match family {
            Family::Single(record) => {
                let mut object = self.solid_object("Building", record, pool);
                if let Some(Value::Object(own)) = object.get_mut("attributes") {
                    own.extend(attributes::carried(record));
                }
                if let Some(address) = Address::of(&record.attributes) {
                    object["address"] = json!([address.to_json()]);
                }
                vec![(record.id.clone(), object)]
            }
            Family::Parts(id, parts) => {
                let of_part = |part: &BuildingRecord| {
                    let mut object = self.solid_object("BuildingPart", part, pool);
                    object["parents"] = json!([id]);
                    (part.id.clone(), object)
                };
                let parts_of: Vec<Named> = parts.iter().map(of_part).collect();
                let whole = self.whole(parts, &parts_of);
                std::iter::once((id.clone(), whole)).chain(parts_of).collect()
            }
        }
    }

    /// The building that parts belong to: the user's attributes, the worst status, and all reasons.
    fn whole(&self, parts: &[BuildingRecord], objects: &[Named]) -> Value {
        let mut own = JsonMap::new();
        let (top, bottom) =
            (parts.iter().filter_map(BuildingRecord::roof_z_m), parts.iter().filter_map(|p| p.ground_z_m));
        let span_m = top.fold(f64::NEG_INFINITY, f64::max) - bottom.fold(f64::INFINITY, f64::min);
        if span_m.is_finite() {
            own.insert(attributes::MEASURED_HEIGHT.to_owned(), attributes::metres(span_m));
        }
        let mut reasons: Vec<&String> = parts.iter().flat_map(|part| &part.reasons).collect();
        reasons.sort_unstable();
        reasons.dedup();
        own.insert(
            "status".to_owned(),
            parts.iter().map(|p| p.status).max().map_or(Value::Null, |s: Status| s.as_str().into()),
        );
        own.insert("reasons".to_owned(), json!(reasons));
        let mut all = if self.config.extension_url.is_some() { names::extended(own) } else { own };
        if self.config.names == AttributeNames::ThreeDBag {
            all.insert("identificatie".to_owned(), json!(parts.first().and_then(|p| p.part_of.as_ref())));
        }
        all.extend(parts.iter().flat_map(attributes::carried));
        let children: Vec<&String> = objects.iter().map(|(id, _)| id).collect();
        let mut whole = json!({ "type": "Building", "attributes": all, "children": children, "geometry": [] });
        if let Some(address) = parts.iter().find_map(|part| Address::of(&part.attributes)) {
            whole["address"] = json!([address.to_json()]);
        }
        let boxes = objects
            .iter()
            .filter_map(|(_, o)| serde_json::from_value::<[f64; 6]>(o["geographicalExtent"].clone()).ok());
        let union =
            |a: [f64; 6], b: [f64; 6]| std::array::from_fn(|i| if i < 3 { a[i].min(b[i]) } else { a[i].max(b[i]) });
        if let Some(extent) = boxes.reduce(union) {
            whole["geographicalExtent"] = json!(extent);
        }
        whole
    }

    /// One object with our own attributes and its solid, or else its footprint on the ground.
    fn solid_object(&self, kind: &str, record: &BuildingRecord, pool: &mut VertexPool) -> Value {
        let (prism, facts) = SolidFacts::of(record, self.grid, MIN_THICKNESS_M);
        let own = attributes::own(record, &facts);
        let mut all = if self.config.extension_url.is_some() { names::extended(own) } else { own };
        if self.config.names == AttributeNames::ThreeDBag {
            all.extend(names::three_d_bag(record, &facts));
        }
        // A member of the object even where empty: readers look for it without asking.
        let mut object = json!({ "type": kind, "attributes": all, "geometry": [] });
        match prism {
            Ok(prism) => {
                let block = prism.faces();
                let roofed = facts.roofed.as_ref();
                let top = roofed.into_iter().flatten().flat_map(|face| face.rings.iter().flatten()).map(|p| p[2]);
                let top = top.fold(prism.roof(), i64::max);
                object["geographicalExtent"] = json!(extent(prism.footprint(), prism.base(), top, self.grid));
                let mut solid = |lod: &str, faces: &[GridFace], planes: &[RoofSurface]| {
                    let mut solid = solid(lod, faces, &self.surfaces(faces, planes), pool);
                    if let Some(painting) = self.painting {
                        painting.paint(&record.id, faces, &mut solid);
                    }
                    solid
                };
                let mut geometry = vec![solid("1.2", &block, &[])];
                if self.has_roofs {
                    // A block where the roof is flat or not known, or makes no solid with the footprint: who takes one of these
                    // levels has all buildings.
                    let levelled = roof_solid::faces(record, &prism, self.grid, Detail::Levels);
                    geometry.push(solid("1.3", levelled.as_ref().unwrap_or(&block), &[]));
                    let roofed = roofed.unwrap_or(&block);
                    geometry.push(solid("2.0", roofed, &facts.planes_of(record, roofed, self.grid)));
                }
                object["geometry"] = Value::Array(geometry);
            }
            Err(_) => {
                if let Some((footprint, level)) = self.footprint(record) {
                    object["geographicalExtent"] = json!(extent(&footprint, level, level, self.grid));
                    object["geometry"] = json!([surface(&footprint, level, pool)]);
                }
            }
        }
        object
    }

    /// Semantic surfaces of a solid: ground, the roof, with a surface for each of its planes where these are given, and walls.
    fn surfaces(&self, faces: &[GridFace], planes: &[RoofSurface]) -> Value {
        let roof = |attributes: JsonMap<String, Value>| {
            let kind = std::iter::once(("type".to_owned(), json!("RoofSurface")));
            Value::Object(kind.chain(attributes).collect())
        };
        let mut roofs: Vec<Value> =
            planes.iter().map(|plane| roof(names::of_plane(&plane.facet, self.config.names))).collect();
        if roofs.is_empty() {
            roofs.push(roof(JsonMap::new()));
        }
        let index = |face: &GridFace| match face.surface {
            FaceKind::Ground => 0,
            FaceKind::Roof => 1,
            FaceKind::Wall => roofs.len() + 1,
        };
        let mut values: Vec<usize> = faces.iter().map(index).collect();
        for (i, plane) in planes.iter().enumerate() {
            plane.faces.iter().for_each(|face| values[*face] = i + 1);
        }
        let (ground, wall) = (json!({ "type": "GroundSurface" }), json!({ "type": "WallSurface" }));
        let surfaces: Vec<Value> = std::iter::once(ground).chain(roofs).chain([wall]).collect();
        json!({ "surfaces": surfaces, "values": [values] })
    }

    /// Remainder of a building without a solid: its footprint on the ground, if both are known.
    fn footprint(&self, record: &BuildingRecord) -> Option<(SnappedFootprint, i64)> {
        let base_m = record.base_z_m.or(record.ground_z_m)?;
        let footprint = SnappedFootprint::new(record.footprint.as_ref()?, self.grid).ok()?;
        Some((footprint, self.grid.level(base_m)))
    }
}

/// The footprint as LOD 0.
fn surface(footprint: &SnappedFootprint, level: i64, pool: &mut VertexPool) -> Value {
    let mut ring =
        |ring: &Vec<[i64; 2]>| -> Vec<u32> { ring.iter().map(|&[x, y]| pool.index_of([x, y, level])).collect() };
    let rings: Vec<Vec<u32>> = footprint.rings().iter().map(&mut ring).collect();
    json!({
        "type": "MultiSurface", "lod": "0", "boundaries": [rings],
        "semantics": { "surfaces": [{ "type": "GroundSurface" }], "values": [0] },
    })
}

/// A `Solid` of one shell.
fn solid(lod: &str, faces: &[GridFace], semantics: &Value, pool: &mut VertexPool) -> Value {
    let mut face = |face: &GridFace| -> Vec<Vec<u32>> {
        face.rings.iter().map(|ring| ring.iter().map(|p| pool.index_of(*p)).collect()).collect()
    };
    let shell: Vec<Vec<Vec<u32>>> = faces.iter().map(&mut face).collect();
    json!({ "type": "Solid", "lod": lod, "boundaries": [shell], "semantics": semantics })
}

/// Box between two levels in the map frame, metres, rounded like everything else.
fn extent(footprint: &SnappedFootprint, base: i64, roof: i64, grid: &OutputGrid) -> [f64; 6] {
    let exterior = &footprint.rings()[0];
    let of = |axis: usize| {
        let values = exterior.iter().map(|p| p[axis]);
        values.fold((i64::MAX, i64::MIN), |(low, high), v| (low.min(v), high.max(v)))
    };
    let ((west, east), (south, north)) = (of(0), of(1));
    let low = grid.metres([west, south, base]).map(metadata::tidy);
    let high = grid.metres([east, north, roof]).map(metadata::tidy);
    [low[0], low[1], low[2], high[0], high[1], high[2]]
}
