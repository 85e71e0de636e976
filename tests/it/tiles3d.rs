//! 3D Tiles: structure, place, volume and attributes of what we write, read without our own code.

use std::collections::BTreeMap;
use std::path::Path;

use geo::{Area as _, Translate as _};
use glam::{DMat4, DVec3};
use serde_json::{Value, json};
use sizeup::crs::{Crs, Transform};
use sizeup::output::OutputError;
use sizeup::output::tiles3d::{self, Heights, Precision, Tiles3dConfig};

use crate::outputs::{Town, town};

/// Height of the geoid that the tests state, metres.
const GEOID_M: f64 = 43.5;

pub fn config() -> Tiles3dConfig {
    Tiles3dConfig { heights: Heights::GeoidHeight(GEOID_M), ..Tiles3dConfig::default() }
}

/// A town whose tileset has several levels.
pub fn write_deep(folder: &Path, precision: Precision) -> (Town, Value) {
    let mut town = town();
    let tower = town.records[3].clone();
    for i in 0..20_u32 {
        let mut copy = tower.clone();
        copy.id = format!("copy {i}");
        copy.footprint =
            tower.footprint.as_ref().map(|f| f.translate(20.0 + 25.0 * f64::from(i % 5), 30.0 * f64::from(i / 5)));
        copy.height_m = Some(4.0 + f64::from(i));
        town.records.push(copy);
    }
    tiles3d::write(folder, &town.model(), &Tiles3dConfig { max_buildings: 3, precision, ..config() }).unwrap();
    let tileset = serde_json::from_slice(&std::fs::read(folder.join("tileset.json")).unwrap()).unwrap();
    (town, tileset)
}

/// A binary glTF split.
pub struct Glb {
    pub json: Value,
    bin: Vec<u8>,
}

impl Glb {
    pub fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        let json_end = 20 + word(12);
        assert_eq!((&bytes[16..20], &bytes[json_end + 4..json_end + 8]), (&b"JSON"[..], &b"BIN\0"[..]));
        Self { json: serde_json::from_slice(&bytes[20..json_end]).unwrap(), bin: bytes[json_end + 8..].to_vec() }
    }

    fn view(&self, index: &Value) -> &[u8] {
        let view = &self.json["bufferViews"][index.as_u64().unwrap() as usize];
        let at = |name: &str| view[name].as_u64().unwrap() as usize;
        &self.bin[at("byteOffset")..at("byteOffset") + at("byteLength")]
    }

    /// Components of an accessor as numbers, one list per element; normalised integers are brought to -1..1.
    pub fn accessor(&self, index: &Value) -> Vec<Vec<f64>> {
        let accessor = &self.json["accessors"][index.as_u64().unwrap() as usize];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let n = match accessor["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let (size, read): (usize, fn(&[u8]) -> f64) = match accessor["componentType"].as_u64().unwrap() {
            5120 => (1, |b| f64::from(i8::from_le_bytes([b[0]])) / 127.0),
            5121 => (1, |b| f64::from(b[0]) / 255.0),
            5123 => (2, |b| f64::from(u16::from_le_bytes([b[0], b[1]]))),
            5125 => (4, |b| f64::from(u32::from_le_bytes(b[..4].try_into().unwrap()))),
            _ => (4, |b| f64::from(f32::from_le_bytes(b[..4].try_into().unwrap()))),
        };
        let stride = view["byteStride"].as_u64().map_or(n * size, |s| s as usize);
        let bytes = self.view(&accessor["bufferView"]);
        let count = accessor["count"].as_u64().unwrap() as usize;
        (0..count).map(|i| (0..n).map(|c| read(&bytes[i * stride + c * size..])).collect()).collect()
    }

    pub fn primitive(&self) -> &Value {
        &self.json["meshes"][0]["primitives"][0]
    }

    /// Colour of a vertex of a primitive: that of the picture of its material, at its place there.
    pub fn colour(&self, primitive: &Value, vertex: usize) -> [u8; 3] {
        let picture = self.picture(primitive);
        let at = &self.accessor(&primitive["attributes"]["TEXCOORD_0"])[vertex];
        let [x, y] = [at[0] * f64::from(picture.width()), at[1] * f64::from(picture.height())].map(|v| v as u32);
        picture.get_pixel(x.min(picture.width() - 1), y.min(picture.height() - 1)).0
    }

    /// The picture of a primitive's material.
    pub fn picture(&self, primitive: &Value) -> image::RgbImage {
        let index = |value: &Value| value.as_u64().unwrap() as usize;
        let material = &self.json["materials"][index(&primitive["material"])];
        let texture = &self.json["textures"][index(&material["pbrMetallicRoughness"]["baseColorTexture"]["index"])];
        let view = &self.json["images"][index(&texture["source"])]["bufferView"];
        image::load_from_memory(self.view(view)).unwrap().into_rgb8()
    }

    /// Vertices in the tileset's axes: the node's own transform, then y up to z up, as the standard says.
    fn positions(&self) -> Vec<DVec3> {
        let node = &self.json["nodes"][0];
        let list =
            |name: &str| node[name].as_array().map(|l| l.iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>());
        let shift = DVec3::from_slice(&list("translation").unwrap());
        let scale = list("scale").map_or(DVec3::ONE, |s| DVec3::from_slice(&s));
        let placed = |p: Vec<f64>| DVec3::from_slice(&p) * scale + shift;
        self.accessor(&self.primitive()["attributes"]["POSITION"])
            .into_iter()
            .map(placed)
            .map(|p| DVec3::new(p.x, -p.z, p.y))
            .collect()
    }

    /// A column of the property table.
    pub fn column(&self, name: &str) -> Vec<Value> {
        let extension = &self.json["extensions"]["EXT_structural_metadata"];
        let table = &extension["propertyTables"][0];
        let kind = &extension["schema"]["classes"]["building"]["properties"][name]["type"];
        let property = &table["properties"][name];
        let n = table["count"].as_u64().unwrap() as usize;
        let values = self.view(&property["values"]);
        if kind == "STRING" {
            let offsets: Vec<usize> = self
                .view(&property["stringOffsets"])
                .chunks_exact(4)
                .map(|b| u32::from_le_bytes(b.try_into().unwrap()) as usize)
                .collect();
            return (0..n).map(|i| std::str::from_utf8(&values[offsets[i]..offsets[i + 1]]).unwrap().into()).collect();
        }
        values.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap()).into()).collect()
    }
}

/// One building of a tileset.
struct Shown {
    /// Metres, in the tileset's axes.
    points: Vec<DVec3>,
    volume_m3: f64,
    height_m: f64,
}

/// All buildings of a tileset by id; each is in one tile only.
fn shown(folder: &Path, tile: &Value, found: &mut BTreeMap<String, Shown>) {
    let glb = Glb::read(&folder.join(tile["content"]["uri"].as_str().unwrap()));
    let positions = glb.positions();
    let features: Vec<usize> =
        glb.accessor(&glb.primitive()["attributes"]["_FEATURE_ID_0"]).iter().map(|v| v[0] as usize).collect();
    let indices: Vec<usize> = glb.accessor(&glb.primitive()["indices"]).iter().map(|v| v[0] as usize).collect();
    let (ids, heights) = (glb.column("id"), glb.column("height_m"));
    for (feature, (id, height)) in ids.iter().zip(&heights).enumerate() {
        let points: Vec<DVec3> =
            positions.iter().zip(&features).filter(|(_, f)| **f == feature).map(|(p, _)| *p).collect();
        let origin = points[0];
        let triangles = indices.chunks_exact(3).filter(|t| features[t[0]] == feature);
        let volume = triangles.map(|t| {
            let [a, b, c] = [0, 1, 2].map(|i| positions[t[i]] - origin);
            a.dot(b.cross(c)) / 6.0
        });
        let building = Shown { volume_m3: volume.sum(), height_m: height.as_f64().unwrap(), points };
        let is_new = found.insert(id.as_str().unwrap().to_owned(), building).is_none();
        assert!(is_new, "{id} is in two tiles");
    }
    tile["children"].as_array().into_iter().flatten().for_each(|child| shown(folder, child, found));
}

fn all_shown(folder: &Path, tileset: &Value) -> BTreeMap<String, Shown> {
    let mut found = BTreeMap::new();
    shown(folder, &tileset["root"], &mut found);
    found
}

/// Longitude, latitude (degrees) and ellipsoidal height to the earth's frame: the closed formula on WGS 84.
fn ecef(lon_deg: f64, lat_deg: f64, h: f64) -> DVec3 {
    let (a, f) = (6_378_137.0, 1.0 / 298.257_223_563);
    let e2 = f * (2.0 - f);
    let ((sin_lon, cos_lon), (sin_lat, cos_lat)) = (lon_deg.to_radians().sin_cos(), lat_deg.to_radians().sin_cos());
    let n = a / (1.0_f64 - e2 * sin_lat * sin_lat).sqrt();
    DVec3::new((n + h) * cos_lat * cos_lon, (n + h) * cos_lat * sin_lon, (n * (1.0 - e2) + h) * sin_lat)
}

fn transform(tileset: &Value) -> DMat4 {
    let columns: Vec<f64> =
        tileset["root"]["transform"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    DMat4::from_cols_slice(&columns)
}

#[test]
fn every_building_is_a_closed_solid_in_its_place_on_the_earth() {
    // Single precision within a town of 200 m, and half a step of 16 bits over it.
    for (precision, tolerance_m) in [(Precision::Float, 2e-5), (Precision::Quantised, 3e-3)] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tiles");
        let (town, tileset) = write_deep(&path, precision);
        let found = all_shown(&path, &tileset);
        let ecef_from_local = transform(&tileset);
        let lon_lat = Transform::new(&town.crs, &Crs::parse("EPSG:4326").unwrap()).unwrap();
        let solid: Vec<_> = town.records.iter().filter(|r| r.height_m.is_some()).collect();
        assert_eq!(found.len(), solid.len());
        for record in solid {
            let shown = &found[&record.id];
            let footprint = record.footprint.as_ref().unwrap();
            let (base_m, roof_m) = (record.base_z_m.unwrap(), record.roof_z_m().unwrap());
            // The map's scale is within 1 in 5,000 of the earth's here, and counts twice in an area.
            let expected_m3 = footprint.unsigned_area() * (roof_m - base_m);
            assert!(
                (shown.volume_m3 / expected_m3 - 1.0).abs() < 5e-4,
                "{}: {} {expected_m3}",
                record.id,
                shown.volume_m3
            );
            assert_eq!(shown.height_m, record.height_m.unwrap());
            for corner in footprint.exterior().coords() {
                let (lon, lat) = lon_lat.point(corner.x, corner.y).unwrap();
                for z in [base_m, roof_m] {
                    let expected = ecef(lon, lat, z + GEOID_M);
                    let distance = |p: &DVec3| (ecef_from_local.transform_point3(*p) - expected).length();
                    let nearest = shown.points.iter().map(distance).fold(f64::INFINITY, f64::min);
                    assert!(nearest < tolerance_m, "{}: a corner is {nearest} m off", record.id);
                }
            }
        }
    }
}

/// Corners of a box as the standard has it.
fn corners(volume: &Value) -> Vec<DVec3> {
    let b: Vec<f64> = volume["box"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let [c, x, y, z] = [0, 3, 6, 9].map(|i| DVec3::from_slice(&b[i..i + 3]));
    let sign = |i: usize, bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
    (0..8).map(|i| c + sign(i, 0) * x + sign(i, 1) * y + sign(i, 2) * z).collect()
}

fn is_within(point: DVec3, volume: &Value) -> bool {
    let all = corners(volume);
    let (low, high) =
        (all.iter().copied().reduce(DVec3::min).unwrap(), all.iter().copied().reduce(DVec3::max).unwrap());
    point.cmpge(low - 1e-9).all() && point.cmple(high + 1e-9).all()
}

fn count(tile: &Value) -> u64 {
    1 + tile["children"].as_array().into_iter().flatten().map(count).sum::<u64>()
}

fn check_tile(folder: &Path, tile: &Value, depth: usize) -> usize {
    let glb = Glb::read(&folder.join(tile["content"]["uri"].as_str().unwrap()));
    assert!(glb.positions().iter().all(|p| is_within(*p, &tile["content"]["boundingVolume"])));
    assert!(corners(&tile["content"]["boundingVolume"]).iter().all(|p| is_within(*p, &tile["boundingVolume"])));
    let own_error = tile["geometricError"].as_f64().unwrap();
    let children = tile["children"].as_array();
    assert_eq!(own_error == 0.0, children.is_none(), "only leaves show everything");
    let depths = children.into_iter().flatten().map(|child| {
        assert!(child["geometricError"].as_f64().unwrap() <= own_error);
        assert!(corners(&child["boundingVolume"]).iter().all(|p| is_within(*p, &tile["boundingVolume"])));
        check_tile(folder, child, depth + 1)
    });
    depths.max().unwrap_or(depth)
}

#[test]
fn boxes_hold_what_is_in_them_and_errors_fall_towards_the_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiles");
    let (_, tileset) = write_deep(&path, Precision::Float);
    assert_eq!((&tileset["asset"]["version"], &tileset["root"]["refine"]), (&json!("1.1"), &json!("ADD")));
    assert!(check_tile(&path, &tileset["root"], 0) >= 2, "several levels");
    let extras = &tileset["asset"]["extras"]["sizeup"];
    assert_eq!((&extras["n_buildings"], &extras["n_without_solid"]), (&json!(26), &json!(2)));
    assert_eq!(extras["heights"], json!({ "geoid_height": GEOID_M }));
    // Every viewer loads it first: three hundred bytes a tile, and a rest.
    let (n_bytes, n_tiles) = (std::fs::metadata(path.join("tileset.json")).unwrap().len(), count(&tileset["root"]));
    assert!(n_bytes < 700 + 350 * n_tiles, "{n_bytes} bytes for {n_tiles} tiles");
    let lineage: Value =
        serde_json::from_slice(&std::fs::read(path.join(extras["lineage"].as_str().unwrap())).unwrap()).unwrap();
    assert_eq!(lineage["config_sha256"], "00".repeat(32));
}

#[test]
fn attributes_of_the_user_are_properties_with_names_the_schema_allows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiles");
    let mut town = town();
    for (i, record) in town.records.iter_mut().enumerate() {
        record.attributes.insert("1st name (ä)".to_owned(), if i == 0 { Value::Null } else { json!(format!("n{i}")) });
    }
    tiles3d::write(&path, &town.model(), &config()).unwrap();
    let glb = Glb::read(&path.join("tiles/0/0_0.glb"));
    assert_eq!(glb.column("_1st_name____"), ["", "n1", "n2", "n3"]);
    assert_eq!(glb.column("floors"), [3.0, 3.0, 3.0, 3.0]);
    assert_eq!(glb.column("status"), ["measured", "measured", "doubtful", "fallback"]);
    let schema = &glb.json["extensions"]["EXT_structural_metadata"]["schema"]["classes"]["building"]["properties"];
    assert_eq!(schema["_1st_name____"]["name"], "1st name (ä)");
}

#[test]
fn heights_are_never_guessed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiles");
    let mut town = town();
    // Compound, so the CRS says what heights are; without PROJ's grid for NAP it is refused by its name.
    let by_crs = Tiles3dConfig::default();
    match tiles3d::write(&path, &town.model(), &by_crs) {
        Ok(_) => println!("the grid is installed here"),
        Err(e) => assert!(e.to_string().contains("nl_nsgi_nlgeo2018"), "{e}"),
    }
    town.crs = Crs::parse("EPSG:28992").unwrap();
    let refused = tiles3d::write(&path, &town.model(), &by_crs).unwrap_err();
    assert!(matches!(refused, OutputError::HeightsNotStated { .. }), "{refused}");
    // The EGM96 grid comes with PROJ's data; 43.6 m here (NGA's calculator for 51.9° N, 4.5° E).
    town.crs = Crs::parse("EPSG:28992+5773").unwrap();
    match tiles3d::write(&path, &town.model(), &by_crs) {
        Ok(_) => {
            let tileset: Value = serde_json::from_slice(&std::fs::read(path.join("tileset.json")).unwrap()).unwrap();
            let centre = transform(&tileset).w_axis.truncate();
            let lon_lat = Transform::new(&town.crs, &Crs::parse("EPSG:4326").unwrap()).unwrap();
            let (lon, lat) = lon_lat.point(93_035.0, 436_026.0).unwrap();
            let up = ecef(lon, lat, 1.0) - ecef(lon, lat, 0.0);
            let height_m = (centre - ecef(lon, lat, 0.0)).dot(up);
            assert!((height_m - 11.4 - 43.6).abs() < 1.0, "{height_m}");
        }
        Err(e) => assert!(e.to_string().contains("egm96"), "{e}"),
    }
}

#[test]
fn a_tileset_is_replaced_whole_and_other_folders_are_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiles");
    std::fs::create_dir(&path).unwrap();
    std::fs::write(path.join("thesis.txt"), "years").unwrap();
    let refused = tiles3d::write(&path, &town().model(), &config()).unwrap_err();
    assert!(matches!(refused, OutputError::FolderInUse { .. }), "{refused}");
    assert_eq!(std::fs::read_to_string(path.join("thesis.txt")).unwrap(), "years");

    let path = folder.path().join("city");
    write_deep(&path, Precision::Float);
    assert!(path.join("tiles/1").is_dir());
    tiles3d::write(&path, &town().model(), &config()).unwrap();
    assert!(!path.join("tiles/1").exists(), "nothing of the old one is left");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no litter");
}

#[test]
fn tiles_given_as_an_input_are_named_for_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    write_deep(&tiles, Precision::Float);
    let glb = std::fs::read_dir(&tiles)
        .unwrap()
        .map(|e| e.unwrap().path())
        .find(|p| p.extension().is_some_and(|e| e == "glb"));
    for input in [tiles.clone(), tiles.join("tileset.json"), glb.unwrap_or_else(|| tiles.join("0.glb"))] {
        let mut sizeup = crate::tiny_scene::sizeup();
        let outcome = sizeup.arg("export").arg(&input).arg(folder.path().join("city.gpkg")).output().unwrap();
        let message = String::from_utf8_lossy(&outcome.stderr);
        assert_eq!(outcome.status.code(), Some(3), "{message}");
        assert!(message.contains("is 3D Tiles, which are written and not read"), "{message}");
        assert!(message.contains("hint: give what they were made of"), "{message}");
    }
}

#[test]
fn a_city_without_solids_is_an_empty_tileset() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiles");
    let mut town = town();
    town.records.truncate(0);
    tiles3d::write(&path, &town.model(), &config()).unwrap();
    let tileset: Value = serde_json::from_slice(&std::fs::read(path.join("tileset.json")).unwrap()).unwrap();
    assert_eq!(tileset["root"].get("content"), None);
}
