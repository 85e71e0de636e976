//! Every fault that is planted is found, under its number and at its place; nothing is found where nothing is.

use std::path::Path;

use geo::Area as _;
use geo_types::{Coord, LineString, Polygon};
use glam::DVec3;
use proptest::prelude::*;
use sizeup::output::cityjson::read::{CityFile, CityGeometry, CityObject, CitySurface};
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::validate::{Fault, ValidateConfig, schema, validate, validate_file};

use crate::evaluation::shared_data;
use crate::outputs::town;

type Ring = Vec<[f64; 3]>;
type Faces = Vec<Vec<Ring>>;

/// Where the test solids stand: far from the origin, as real ones do.
const AT: [f64; 3] = [93_000.0, 436_000.0, 5.0];

fn file(faces: &Faces) -> CityFile {
    let mut city = CityFile::default();
    let mut surfaces = Vec::new();
    for (i, face) in faces.iter().enumerate() {
        let rings = face.iter().map(|ring| {
            ring.iter()
                .map(|p| {
                    city.vertices.push(std::array::from_fn(|axis| p[axis] + AT[axis]));
                    u32::try_from(city.vertices.len() - 1).unwrap()
                })
                .collect()
        });
        surfaces.push(CitySurface { place: [0, 0, i], kind: None, rings: rings.collect() });
    }
    let geometry = CityGeometry { lod: "1.2".to_owned(), is_solid: true, surfaces };
    city.objects.push(CityObject {
        id: "a".to_owned(),
        kind: "Building".to_owned(),
        parents: Vec::new(),
        children: Vec::new(),
        attributes: serde_json::Map::new(),
        geometries: vec![geometry],
    });
    city
}

fn faults(faces: &Faces) -> Vec<Fault> {
    validate(&file(faces), &ValidateConfig::default()).faults
}

fn codes(faces: &Faces) -> Vec<u16> {
    let mut numbers: Vec<u16> = faults(faces).iter().map(|f| f.number).collect();
    numbers.dedup();
    numbers
}

/// A cube of 10 m with its lower corner at (x, y, z): ground, roof, four walls.
fn cube(x: f64, y: f64, z: f64) -> Faces {
    let at = |dx: f64, dy: f64, dz: f64| [x + 10.0 * dx, y + 10.0 * dy, z + 10.0 * dz];
    let low = [at(0., 0., 0.), at(1., 0., 0.), at(1., 1., 0.), at(0., 1., 0.)];
    let high = [at(0., 0., 1.), at(1., 0., 1.), at(1., 1., 1.), at(0., 1., 1.)];
    let mut faces = vec![vec![low.iter().rev().copied().collect()], vec![high.to_vec()]];
    for i in 0..4 {
        let j = (i + 1) % 4;
        faces.push(vec![vec![low[i], low[j], high[j], high[i]]]);
    }
    faces
}

fn hole(points: &[[f64; 2]]) -> Ring {
    points.iter().map(|p| [p[0], p[1], 10.0]).collect()
}

/// The cube with holes in its roof face (the shell is then open, but faces are checked first).
fn with_holes(holes: &[&[[f64; 2]]]) -> Faces {
    let mut faces = cube(0.0, 0.0, 0.0);
    faces[1].extend(holes.iter().map(|points| hole(points)));
    faces
}

#[test]
fn a_cube_and_a_courtyard_are_valid() {
    assert_eq!(codes(&cube(0.0, 0.0, 0.0)), Vec::<u16>::new());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    cityjson::write(&path, &town().model(), &CityJsonConfig::default()).unwrap();
    let outcome = validate(&CityFile::read(&path).unwrap(), &ValidateConfig::default());
    assert_eq!((outcome.n_geometries, outcome.n_valid, outcome.n_without_geometry), (13, 13, 1));
}

#[test]
fn ring_faults_are_found() {
    let mut faces = cube(0.0, 0.0, 0.0);
    faces[1][0].truncate(2);
    assert_eq!(codes(&faces), [101]);

    let mut faces = cube(0.0, 0.0, 0.0);
    faces[1][0].insert(1, [0.0, 0.0004, 10.0]);
    assert_eq!(codes(&faces), [102]);

    let mut faces = cube(0.0, 0.0, 0.0);
    faces[1][0].swap(1, 2);
    assert_eq!(codes(&faces), [104]);

    let mut faces = cube(0.0, 0.0, 0.0);
    faces[1][0].splice(1..1, [[5.0, 0.0, 10.0], [5.0, -3.0, 10.0], [5.0, 0.0, 10.0]]);
    assert_eq!(codes(&faces), [104]);
}

#[test]
fn a_wall_as_narrow_as_the_tolerance_is_two_equal_corners_and_crosses_no_other() {
    // A millimetre of wall at a corner, on the grid of a millimetre, far from the origin.
    let corners = [[0.0, 0.0], [0.001, 0.0], [9.925, 1.219], [8.707, 11.144], [-1.219, 9.925]];
    let [low, high] = [0.0, 9.0].map(|z| corners.map(|[x, y]| [x + 500.1, y + 0.2, z]));
    let mut faces = vec![vec![low.iter().rev().copied().collect()], vec![high.to_vec()]];
    for i in 0..corners.len() {
        let j = (i + 1) % corners.len();
        faces.push(vec![vec![low[i], low[j], high[j], high[i]]]);
    }
    // Two pairs of equal corners leave the wall without an area, and no wall crosses another (306).
    assert_eq!(codes(&faces), [102, 101]);
    // Three millimetres are a wall.
    for p in faces.iter_mut().flatten().flatten().filter(|p| (p[0] - 500.101).abs() < 1e-9) {
        p[0] = 500.103;
    }
    assert_eq!(codes(&faces), Vec::<u16>::new());
}

#[test]
fn faults_between_rings_are_found() {
    let crossing = [[5.0, 5.0], [5.0, 7.0], [12.0, 7.0], [12.0, 5.0]];
    assert_eq!(codes(&with_holes(&[&crossing])), [201]);
    let along = [[0.0, 2.0], [0.0, 4.0], [2.0, 4.0], [2.0, 2.0]];
    assert_eq!(codes(&with_holes(&[&along])), [201]);
    let same = [[0.0, 0.0], [0.0, 10.0], [10.0, 10.0], [10.0, 0.0]];
    assert_eq!(codes(&with_holes(&[&same])), [202]);
    let from_wall_to_wall = [[0.0, 5.0], [5.0, 6.0], [10.0, 5.0], [5.0, 4.0]];
    assert_eq!(codes(&with_holes(&[&from_wall_to_wall])), [205]);
    let outside = [[12.0, 2.0], [12.0, 4.0], [14.0, 4.0], [14.0, 2.0]];
    assert_eq!(codes(&with_holes(&[&outside])), [206]);
    let large = [[2.0, 2.0], [2.0, 8.0], [8.0, 8.0], [8.0, 2.0]];
    let inner = [[4.0, 4.0], [4.0, 6.0], [6.0, 6.0], [6.0, 4.0]];
    assert_eq!(codes(&with_holes(&[&large, &inner])), [207]);
    assert_eq!(codes(&with_holes(&[&inner, &large])), [207]);
    let mut turned = inner;
    turned.reverse();
    assert_eq!(codes(&with_holes(&[&turned])), [208]);
}

#[test]
fn holes_that_touch_in_a_circle_cut_a_face_in_two() {
    // From the corner (0, 0) to the opposite corner by two holes that share a corner; a chain that ends inside cuts nothing.
    let (first, second) = ([[0.0, 0.0], [4.0, 6.0], [6.0, 4.0]], [[4.0, 6.0], [5.0, 8.0], [10.0, 10.0]]);
    assert_eq!(codes(&with_holes(&[&first, &second])), [205]);
    let inside = [[4.0, 6.0], [5.0, 8.0], [8.0, 8.0]];
    assert_eq!(codes(&with_holes(&[&first, &inside])), [303], "the corner where the hole's walls would stand");
}

#[test]
fn what_hangs_on_or_touches_from_within_is_told_before_what_is_open() {
    let at = |x: f64, y: f64, z: f64| [x, y, z];
    // A flag on a corner of the cube: open edges too, but the corner is the matter.
    let flag = vec![vec![vec![at(10., 10., 10.), at(20., 20., 20.), at(20., 30., 30.)]]];
    assert_eq!(codes(&[cube(0.0, 0.0, 0.0), flag].concat()), [303]);
    let apart = vec![vec![vec![at(20., 10., 10.), at(20., 20., 20.), at(20., 30., 15.)]]];
    assert_eq!(codes(&[cube(0.0, 0.0, 0.0), apart].concat()), [305]);
    // A roof pulled down until its middle touches the floor.
    let mut pulled = cube(0.0, 0.0, 0.0);
    let roof = pulled.remove(1).remove(0);
    for i in 0..4 {
        pulled.push(vec![vec![roof[i], roof[(i + 1) % 4], [5.0, 5.0, 0.0]]]);
    }
    assert_eq!(codes(&pulled), [306]);
}

/// A building of parts, each an extruded box: corner, sides and height.
fn building_of(parts: &[[f64; 6]]) -> CityFile {
    let mut city = CityFile::default();
    for (i, [x, y, z, w, d, h]) in parts.iter().enumerate() {
        let mut part = cube(0.0, 0.0, 0.0);
        for p in part.iter_mut().flatten().flatten() {
            *p = [x + p[0] * w / 10.0, y + p[1] * d / 10.0, z + p[2] * h / 10.0];
        }
        let one = file(&part);
        let offset = u32::try_from(city.vertices.len()).unwrap();
        city.vertices.extend(one.vertices);
        let mut object = one.objects.into_iter().next().unwrap();
        object.geometries[0].surfaces.iter_mut().flat_map(|s| &mut s.rings).flatten().for_each(|v| *v += offset);
        (object.id, object.kind, object.parents) =
            (format!("part {i}"), "BuildingPart".to_owned(), vec!["a".to_owned()]);
        city.objects.push(object);
    }
    city
}

#[test]
fn parts_of_a_building_may_share_walls_and_no_volume() {
    let found = |parts: &[[f64; 6]]| validate(&building_of(parts), &ValidateConfig::default()).faults;
    let tower = [0.0, 0.0, 0.0, 10.0, 10.0, 30.0];
    assert_eq!(found(&[tower, [10.0, 0.0, 0.0, 20.0, 10.0, 8.0]]), [], "side by side");
    assert_eq!(found(&[tower, [0.0, 0.0, 30.0, 10.0, 10.0, 5.0]]), [], "on top");
    assert_eq!(found(&[tower, [9.9995, 0.0, 0.0, 20.0, 10.0, 8.0]]), [], "within the tolerance");
    let shared = found(&[tower, [8.0, 2.0, 1.0, 20.0, 4.0, 8.0]]);
    assert_eq!(shared.len(), 1);
    assert_eq!((shared[0].number, shared[0].object.as_str()), (601, "part 1"));
    assert_eq!(shared[0].position, Some([AT[0] + 9.0, AT[1] + 4.0, AT[2] + 1.0]));
    // Two bars of one height that cross: no corner of either lies in the other.
    assert_eq!(found(&[[0.0, 4.0, 0.0, 10.0, 2.0, 5.0], [4.0, 0.0, 0.0, 2.0, 10.0, 5.0]])[0].number, 601);
}

#[test]
fn bent_faces_are_found() {
    let mut faces = cube(0.0, 0.0, 0.0);
    for p in faces.iter_mut().flatten().flatten().filter(|p| **p == [10.0, 10.0, 10.0]) {
        p[2] += 0.1;
    }
    let found = faults(&faces);
    assert_eq!((found.len(), found[0].number, found[0].surface), (1, 203, Some(1)));
    // A face of 4 cm whose corner is bent up by 3 cm: within 1 cm of its mean plane, but turned.
    let small: Faces = cube(0.0, 0.0, 0.0)
        .into_iter()
        .map(|face| {
            let shrink = |p: [f64; 3]| {
                let bent = if p == [10.0, 10.0, 10.0] { 0.03 } else { 0.0 };
                [p[0] * 0.004, p[1] * 0.004, p[2] * 0.004 + bent]
            };
            face.into_iter().map(|ring| ring.into_iter().map(shrink).collect()).collect()
        })
        .collect();
    assert_eq!(codes(&small), [204]);
}

#[test]
fn shell_faults_are_found_with_their_place() {
    let whole = cube(0.0, 0.0, 0.0);
    assert_eq!(codes(&whole[..3].to_vec()), [301]);

    let mut open = whole.clone();
    open.remove(1);
    let found = faults(&open);
    assert_eq!((found.len(), found[0].number), (4, 302), "the four edges of the missing roof");
    assert!(found.iter().all(|f| f.position.unwrap()[2] == AT[2] + 10.0), "{found:?}");

    let along_an_edge = [whole.clone(), cube(10.0, 10.0, 0.0)].concat();
    let found = faults(&along_an_edge);
    assert_eq!(found.iter().map(|f| f.number).collect::<Vec<_>>(), [303]);
    assert_eq!(found[0].position, Some([AT[0] + 10.0, AT[1] + 10.0, AT[2] + 5.0]));

    let at_a_corner = [whole.clone(), cube(10.0, 10.0, 10.0)].concat();
    let found = faults(&at_a_corner);
    assert_eq!(found.iter().map(|f| f.number).collect::<Vec<_>>(), [303]);
    assert_eq!(found[0].position, Some([AT[0] + 10.0, AT[1] + 10.0, AT[2] + 10.0]));

    assert_eq!(codes(&[whole.clone(), cube(30.0, 0.0, 0.0)].concat()), [305]);
    // Two cubes apart that overlap are two parts as well; a roof pulled down through the floor is one part.
    let mut pierced = whole.clone();
    let roof = pierced.remove(1).remove(0);
    for i in 0..4 {
        pierced.push(vec![vec![roof[i], roof[(i + 1) % 4], [5.0, 5.0, -2.0]]]);
    }
    assert_eq!(codes(&pierced), [306]);

    let mut turned = whole.clone();
    turned[3][0].reverse();
    assert_eq!(codes(&turned), [307]);

    let mut inside_out = whole;
    inside_out.iter_mut().flatten().for_each(|ring| ring.reverse());
    assert_eq!(codes(&inside_out), [405]);
    assert_eq!(codes(&Vec::new()), [902]);
}

/// The form's faults of the town's file after a change, by cjval's names.
fn form_faults(name: &str, alter: impl Fn(&mut serde_json::Value)) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let is_sequence = name.ends_with("jsonl");
    if is_sequence {
        cityjson::write_sequence(&path, &town().model(), &CityJsonConfig::default()).unwrap();
    } else {
        cityjson::write(&path, &town().model(), &CityJsonConfig::default()).unwrap();
    }
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, part, after) = if is_sequence {
        let mut lines: Vec<&str> = text.lines().collect();
        let after = lines.split_off(4).join("\n");
        let part = lines.pop().unwrap();
        (lines.join("\n") + "\n", part.to_owned(), "\n".to_owned() + &after)
    } else {
        (String::new(), text, String::new())
    };
    let mut part = serde_json::from_str(&part).unwrap();
    alter(&mut part);
    std::fs::write(&path, format!("{before}{part}{after}")).unwrap();
    let outcome = schema::check(&path).unwrap();
    assert!(!is_sequence || outcome.errors.iter().all(|fault| fault.line == Some(4)), "{outcome:?}");
    outcome.errors.into_iter().map(|fault| fault.check).collect()
}

#[test]
fn faults_of_form_are_found_by_name_and_line() {
    use serde_json::json;
    assert_eq!(form_faults("a.city.json", |_| {}), Vec::<String>::new());
    assert_eq!(form_faults("a.city.jsonl", |_| {}), Vec::<String>::new());
    let courtyard = "/CityObjects/courtyard/geometry/0";
    for name in ["a.city.json", "a.city.jsonl"] {
        assert_eq!(form_faults(name, |c| c["CityObjects"]["courtyard"]["type"] = json!("House")), ["schema"], "{name}");
        assert_eq!(form_faults(name, |c| c.pointer_mut(courtyard).unwrap()["lod"] = json!(1.2)), ["schema"], "{name}");
        let index = format!("{courtyard}/boundaries/0/0/0/0");
        assert_eq!(
            form_faults(name, |c| *c.pointer_mut(&index).unwrap() = json!(9999)),
            ["wrong_vertex_index"],
            "{name}"
        );
        let values = format!("{courtyard}/semantics/values/0/1");
        assert_eq!(form_faults(name, |c| *c.pointer_mut(&values).unwrap() = json!(7)), ["semantics_arrays"], "{name}");
        let orphan = |c: &mut serde_json::Value| c["CityObjects"]["courtyard"]["children"] = json!(["nobody"]);
        assert_eq!(form_faults(name, orphan), ["parents_children_consistency"], "{name}");
    }
    let mut without_version = form_faults("a.city.json", |c| drop(c.as_object_mut().unwrap().remove("version")));
    without_version.dedup();
    assert_eq!(without_version, ["schema"]);
}

#[test]
fn the_form_of_every_feature_of_a_long_sequence_is_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.city.jsonl");
    let mut town = town();
    let house = town.records[0].clone();
    town.records = (0..700).map(|i| sizeup::output::BuildingRecord { id: format!("h{i}"), ..house.clone() }).collect();
    cityjson::write_sequence(&path, &town.model(), &CityJsonConfig::default()).unwrap();
    let sound = schema::check(&path).unwrap();
    assert_eq!((sound.errors.len(), sound.warnings.len(), sound.n_features_checked), (0, 0, 700), "{sound:?}");
    // Houses on one spot share positions but no vertices: only within a feature that is worth a warning.
    let mut lines: Vec<String> = std::fs::read_to_string(&path).unwrap().lines().map(str::to_owned).collect();
    lines[300] = lines[300].replacen("\"Building\"", "\"House\"", 1);
    lines[301] = "{".to_owned();
    lines[655] = lines[655].replacen("\"vertices\":[", "\"vertices\":[[0,0,0],", 1);
    std::fs::write(&path, lines.join("\n")).unwrap();
    let faulty = schema::check(&path).unwrap();
    let found: Vec<(Option<usize>, &str)> = faulty.errors.iter().map(|e| (e.line, e.check.as_str())).collect();
    assert_eq!(found, [(Some(301), "schema"), (Some(302), "json_syntax")]);
    assert!(
        !faulty.warnings.is_empty() && faulty.warnings.iter().all(|w| w.line == Some(656)),
        "{:?}",
        faulty.warnings
    );
    assert_eq!((faulty.n_features, faulty.n_features_checked), (700, 700));
    // Once there is enough to tell, the rest is passed over, and that is said.
    let first = schema::check_until(&path, 0).unwrap();
    assert_eq!((first.n_features, first.n_features_checked), (700, 0));
}

/// What cjval says of a file as a whole, check by check.
fn said_of_the_whole(path: &Path) -> Vec<(String, String)> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut validator = cjval::CJValidator::from_str(&text);
    if text.contains("\"Sizeup\"") {
        validator.add_one_extension_from_str(&cityjson::extension_schema().to_string()).unwrap();
    }
    let summaries = validator.validate();
    let faults = summaries.iter().flat_map(|(check, s)| s.get_errors().iter().map(|m| (check.clone(), m.clone())));
    sorted(faults.collect())
}

fn said_of_parts(path: &Path) -> Vec<(String, String)> {
    let outcome = schema::check(path).unwrap();
    sorted(outcome.errors.into_iter().chain(outcome.warnings).map(|fault| (fault.check, fault.message)).collect())
}

fn sorted(mut faults: Vec<(String, String)>) -> Vec<(String, String)> {
    faults.sort();
    faults
}

/// Writes so many bytes of houses, each in its own place and with a long note, that a file of them is several parts; its text.
fn write_long_town(path: &Path) -> String {
    let mut town = town();
    let mut house = town.records[0].clone();
    house.attributes.insert("note".to_owned(), "x".repeat(17_000).into());
    town.records.extend((0..=LAST_HOUSE).map(|i| sizeup::output::BuildingRecord {
        id: format!("h{i}"),
        footprint: house.footprint.as_ref().map(|f| geo::Translate::translate(f, 30.0 * f64::from(i), 500.0)),
        ..house.clone()
    }));
    let extension_url = Some("https://example.org/sizeup.ext.json".to_owned());
    cityjson::write(path, &town.model(), &CityJsonConfig { extension_url, ..CityJsonConfig::default() }).unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.len() > 2 << 20, "{} bytes are one part", text.len());
    text
}

/// Number of the last house of [`write_long_town`]; the first is 0.
const LAST_HOUSE: u32 = 129;

type Alter<'a> = &'a dyn Fn(&mut serde_json::Value);

#[test]
fn a_file_in_parts_has_the_faults_of_the_whole_in_the_same_words() {
    use serde_json::{Value, json};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    let sound: Value = serde_json::from_str(&write_long_town(&path)).unwrap();
    assert_eq!(said_of_parts(&path), []);

    let set = |c: &mut Value, place: &str, value: Value| *c.pointer_mut(place).unwrap() = value;
    let n = sound["vertices"].as_array().unwrap().len();
    let add = |c: &mut Value, i: i32| c["vertices"].as_array_mut().unwrap().push(json!([i, -9, -9]));
    let (last_id, last) = (format!("h{LAST_HOUSE}"), format!("/CityObjects/h{LAST_HOUSE}/geometry/0"));
    let faults: [(&str, Alter<'_>); 22] = [
        ("schema", &|c| set(c, "/CityObjects/h0/type", json!("House"))),
        ("schema", &|c| set(c, &format!("{last}/lod"), json!(1.2))),
        ("schema", &|c| set(c, &format!("{last}/boundaries/0/0/0/0"), json!("x"))),
        ("schema", &|c| c["vertices"][n - 1] = json!([1, 2])),
        ("schema", &|c| c["vertices"][n - 1] = json!([1, 2, "3"])),
        ("schema", &|c| set(c, "/transform/scale", json!([1, 1]))),
        ("schema", &|c| drop(c.as_object_mut().unwrap().remove("transform"))),
        ("schema", &|c| drop(c.as_object_mut().unwrap().remove("vertices"))),
        ("schema", &|c| drop(c.as_object_mut().unwrap().remove("CityObjects"))),
        ("schema", &|c| c["CityObjects"] = json!([1, 2])),
        ("schema", &|c| c["version"] = json!("3.0")),
        ("schema", &|c| c["type"] = json!("FeatureCollection")),
        ("extensions", &|c| set(c, &format!("/CityObjects/{last_id}/attributes/+sizeup-height_m"), json!("tall"))),
        ("extensions", &|c| {
            for id in ["h0", &last_id] {
                c["CityObjects"][id]["attributes"]["+unheard-of"] = json!(1);
            }
        }),
        ("extensions", &|c| c["+extra"] = json!(1)),
        ("parents_children_consistency", &|c| {
            // The first and the last object: never in one part.
            c["CityObjects"]["h0"]["children"] = json!([last_id, "nobody"]);
            c["CityObjects"][&last_id]["parents"] = json!(["h1", "no one"]);
        }),
        ("wrong_vertex_index", &|c| {
            set(c, "/CityObjects/h0/geometry/0/boundaries/0/1/0/0", json!(n));
            set(c, "/CityObjects/h0/geometry/0/boundaries/0/1/0/1", json!(n + 7));
            set(c, &format!("{last}/boundaries/0/0/0/0"), json!(n + 1));
            let points = json!([{"type": "MultiPoint", "lod": "0", "boundaries": [0, n, n + 2]}]);
            // Buildings have no points.
            c["CityObjects"]["h1"] = json!({"type": "CityFurniture", "geometry": points});
        }),
        ("semantics_arrays", &|c| set(c, &format!("{last}/semantics/values/0/1"), json!(7))),
        ("extra_root_properties", &|c| c["comment"] = json!("hand-made")),
        ("duplicate_vertices", &|c| (1..4).for_each(|i| c["vertices"][n - i] = c["vertices"][0].clone())),
        ("unused_vertices", &|c| (0..3).for_each(|i| add(c, i))),
        ("unused_vertices", &|c| (0..9).for_each(|i| add(c, i))),
    ];
    for (check, alter) in faults {
        let mut city = sound.clone();
        alter(&mut city);
        std::fs::write(&path, city.to_string()).unwrap();
        let found = said_of_parts(&path);
        assert!(found.iter().any(|(name, _)| name == check), "{check}: {found:?}");
        assert_eq!(found, said_of_the_whole(&path), "{check}");
    }
}

#[test]
fn a_broken_file_is_told_in_the_words_for_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    let text = write_long_town(&path);
    for (what, broken) in [
        ("an id twice, first and last", text.replacen(&format!("\"h{LAST_HOUSE}\":"), "\"h0\":", 1)),
        ("cut off", text[..text.len() / 2].to_owned()),
        ("more than one document", text.clone() + "}"),
        ("a brace missing", text.replacen(":{", ":", 1)),
        ("no document", "[1, 2]".to_owned()),
    ] {
        std::fs::write(&path, broken).unwrap();
        let found = said_of_parts(&path);
        assert_eq!(found.len(), 1, "{what}: {found:?}");
        assert_eq!(found, said_of_the_whole(&path), "{what}");
    }
}

#[test]
fn real_files_in_parts_have_the_faults_of_the_whole() {
    for name in ["rotterdam_lod2/rotterdam_delfshaven.city.json", "delft_lidar_lod1/output/testarea.json"] {
        let Some(path) = shared_data(name) else { continue };
        let whole = said_of_the_whole(Path::new(&path));
        eprintln!("{name}: {} faults and warnings", whole.len());
        assert_eq!(said_of_parts(Path::new(&path)), whole, "{name}");
    }
}

#[test]
fn a_file_and_a_sequence_are_checked_object_by_object_alike() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    cityjson::write(&at("a.city.json"), &town().model(), &CityJsonConfig::default()).unwrap();
    cityjson::write_sequence(&at("a.city.jsonl"), &town().model(), &CityJsonConfig::default()).unwrap();
    let config = ValidateConfig::default();
    let whole = validate(&CityFile::read(&at("a.city.json")).unwrap(), &config);
    assert_eq!(validate_file(&at("a.city.json"), &config).unwrap(), whole);
    assert_eq!(validate_file(&at("a.city.jsonl"), &config).unwrap(), whole);
}

#[test]
fn the_command_tells_faults_of_form_and_ends_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    cityjson::write(&path, &town().model(), &CityJsonConfig::default()).unwrap();
    let validate = |flags: &[&str]| {
        let mut sizeup = crate::tiny_scene::sizeup();
        sizeup.arg("check").arg(&path).args(flags).output().unwrap()
    };
    let valid = validate(&[]);
    assert_eq!(valid.status.code(), Some(0), "{}", String::from_utf8_lossy(&valid.stdout));
    let text = std::fs::read_to_string(&path).unwrap().replacen("\"type\":\"Building\"", "\"type\":\"House\"", 1);
    std::fs::write(&path, text).unwrap();
    let faulty = validate(&["--json"]);
    assert_eq!(faulty.status.code(), Some(3));
    let report: serde_json::Value = serde_json::from_slice(&faulty.stdout).unwrap();
    assert_eq!(
        (&report["form"]["errors"][0]["check"], &report["n_valid"]),
        (&"schema".into(), &report["n_geometries"])
    );
    assert_eq!(validate(&["--no-schema"]).status.code(), Some(0), "its solids are sound");
}

#[test]
fn real_files_are_checked_without_a_panic() {
    for name in ["rotterdam_lod2/rotterdam_delfshaven.city.json", "delft_lidar_lod1/output/testarea.json"] {
        let Some(path) = shared_data(name) else { continue };
        let outcome = validate(&CityFile::read(Path::new(&path)).unwrap(), &ValidateConfig::default());
        eprintln!("{name}: {} of {} valid, {:?}", outcome.n_valid, outcome.n_geometries, outcome.n_by_code);
        assert!(outcome.n_geometries > 100);
    }
}

/// A star around the town's corner with a courtyard around its middle, between radii of metres.
fn footprints() -> impl Strategy<Value = Polygon<f64>> {
    let star = |low_m: f64, high_m: f64| {
        prop::collection::vec((low_m..high_m, 0.0..0.8_f64), 5..16).prop_map(|spokes| {
            let step = std::f64::consts::TAU / spokes.len() as f64;
            let corner = |(i, &(r, shift)): (usize, &(f64, f64))| {
                let angle = (i as f64 + shift) * step;
                Coord { x: AT[0] + r * angle.cos(), y: AT[1] + r * angle.sin() }
            };
            spokes.iter().enumerate().map(corner).collect::<LineString<f64>>()
        })
    };
    (star(9.0, 20.0), star(0.5, 3.0), any::<bool>()).prop_map(|(exterior, courtyard, has_courtyard)| {
        Polygon::new(exterior, if has_courtyard { vec![courtyard] } else { Vec::new() })
    })
}

/// Volume enclosed by the faces of an object of a file, by the divergence theorem.
fn volume_m3(city: &CityFile, id: &str) -> f64 {
    let point = |i: u32| DVec3::from_array(city.vertices[i as usize]) - DVec3::from_array(AT);
    let objects = city.objects.iter().filter(|object| object.id == id);
    let rings = objects.flat_map(|o| &o.geometries).flat_map(|g| &g.surfaces).flat_map(|s| &s.rings);
    rings.map(|r| r.windows(2).map(|e| point(r[0]).dot(point(e[0]).cross(point(e[1])))).sum::<f64>() / 6.0).sum()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, failure_persistence: None, ..ProptestConfig::default() })]

    /// Four of them in a file: reading the schemas costs most of a check.
    #[test]
    fn any_valid_footprint_of_any_height_is_a_valid_file_of_area_times_height(
        buildings in prop::collection::vec((footprints(), 0.6..300.0_f64), 4),
    ) {
        prop_assume!(buildings.iter().all(|(footprint, _)| geo::Validation::is_valid(footprint)));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.city.json");
        let mut town = town();
        let house = town.records[0].clone();
        let record = |(i, (footprint, thickness_m)): (usize, &(Polygon<f64>, f64))| sizeup::output::BuildingRecord {
            id: format!("h{i}"),
            footprint: Some(geo::Translate::translate(footprint, 100.0 * i as f64, 0.0)),
            ground_z_m: Some(12.0),
            base_z_m: Some(12.0),
            height_m: Some(*thickness_m),
            ..house.clone()
        };
        town.records = buildings.iter().enumerate().map(record).collect();
        cityjson::write(&path, &town.model(), &CityJsonConfig::default()).unwrap();
        let city = CityFile::read(&path).unwrap();
        let solids = validate(&city, &ValidateConfig::default());
        prop_assert!(solids.is_valid() && solids.n_geometries == 4, "{solids:?}");
        let form = schema::check(&path).unwrap();
        prop_assert!(form.errors.is_empty() && form.warnings.is_empty(), "{form:?}");
        for (i, (footprint, thickness_m)) in buildings.iter().enumerate() {
            // Half a millimetre along a footprint of at most 600 m, and in height.
            let (area_m2, volume_m3) = (footprint.unsigned_area(), volume_m3(&city, &format!("h{i}")));
            let tolerance_m3 = 0.3 * thickness_m + 0.0005 * area_m2;
            prop_assert!((volume_m3 - area_m2 * thickness_m).abs() < tolerance_m3, "{volume_m3} {area_m2}");
        }
    }
}
