//! A building in several pieces, each with a height of its own.

use std::path::Path;

use serde_json::{Value, json};
use sizeup::output::cityjson::{self, AttributeNames, CityJsonConfig, extension_schema};
use sizeup::output::geopackage;
use sizeup::output::read::{FoundBuildings, ReadOptions, RecordFile};
use sizeup::output::{BuildingRecord, CityModel, OutputError, Overview, Records, Status, flatgeobuf};

use crate::outputs::{Town, assert_valid_cityjson, town};

/// The town, where the row houses are two parts of one building, and the tower a part whose sibling was refused.
fn town_with_parts() -> Town {
    let mut town = town();
    for (i, whole) in [(0, "row"), (1, "row"), (3, "tower group"), (5, "tower group")] {
        town.records[i].part_of = Some(whole.to_owned());
    }
    town
}

fn by_id(mut records: Vec<BuildingRecord>) -> Vec<BuildingRecord> {
    records.sort_by(|a, b| a.id.cmp(&b.id));
    records
}

fn read(path: &Path) -> Vec<BuildingRecord> {
    by_id(FoundBuildings::read(path, &ReadOptions::default()).unwrap().to_records())
}

fn objects(path: &Path) -> Value {
    serde_json::from_slice::<Value>(&std::fs::read(path).unwrap()).unwrap()["CityObjects"].take()
}

#[test]
fn parts_become_building_parts_of_one_building() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    cityjson::write(&path, &town_with_parts().model(), &CityJsonConfig::default()).unwrap();
    assert_valid_cityjson(&path);
    let objects = objects(&path);
    let row = &objects["row"];
    assert_eq!((&row["type"], &row["children"]), (&json!("Building"), &json!(["row 1", "row 2"])));
    // Highest roof to lowest ground; the user's attributes are the whole's, ours are the parts'.
    assert_eq!(row["attributes"]["measuredHeight"], 7.5);
    assert_eq!((&row["attributes"]["floors"], row["attributes"].get("height_m")), (&json!(3), None));
    assert_eq!(row["geographicalExtent"], json!([93000.0, 436_000.0, 11.4, 93020.0, 436_008.0, 19.5]));
    assert_eq!(
        row.get("geometry"),
        Some(&json!([])),
        "its own is in its parts; readers ask for the member all the same"
    );
    for (id, height) in [("row 1", 6.25), ("row 2", 7.5)] {
        let part = &objects[id];
        assert_eq!((&part["type"], &part["parents"]), (&json!("BuildingPart"), &json!(["row"])));
        assert_eq!((&part["attributes"]["height_m"], part["attributes"].get("floors")), (&json!(height), None));
        assert_eq!(part["geometry"][0]["type"], "Solid");
    }
    // The refused part comes last in the list and stands beside its sibling all the same.
    assert_eq!(objects["tower group"]["children"], json!(["tower", "no footprint"]));
    assert_eq!(objects["tower group"]["attributes"]["status"], "refused");
}

#[test]
fn parts_come_back_from_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let town = town_with_parts();
    let model = town.model();
    let at = |name: &str| folder.path().join(name);
    cityjson::write(&at("a.city.json"), &model, &CityJsonConfig::default()).unwrap();
    cityjson::write_sequence(&at("a.city.jsonl"), &model, &CityJsonConfig::default()).unwrap();
    geopackage::write(&at("a.gpkg"), &model).unwrap();
    flatgeobuf::write(&at("a.fgb"), &model).unwrap();
    let from_city = read(&at("a.city.json"));
    assert_eq!(from_city, read(&at("a.city.jsonl")));
    for name in ["a.city.json", "a.gpkg", "a.fgb"] {
        // FlatGeobuf has no place for a building without a footprint.
        let has_place = |r: &BuildingRecord| name != "a.fgb" || r.footprint.is_some();
        let expected: Vec<BuildingRecord> = by_id(town.records.clone()).into_iter().filter(has_place).collect();
        let found = read(&at(name));
        assert_eq!(found.len(), expected.len(), "{name}");
        for (found, written) in found.iter().zip(expected) {
            assert_eq!((&found.id, &found.part_of), (&written.id, &written.part_of), "{name}");
            assert_eq!((found.height_m, found.status), (written.height_m, written.status), "{name}");
            assert_eq!(found.attributes["street"], written.attributes["street"], "{name}");
            let known = |r: &BuildingRecord| r.footprint.is_some() && r.ground_z_m.is_some();
            assert_eq!(known(found), known(&written), "{name}: {}", found.id);
        }
    }
    // One feature per building of the input, whole with its parts.
    let lines = std::fs::read_to_string(at("a.city.jsonl")).unwrap();
    assert_eq!(lines.lines().count(), 1 + 4);
}

#[test]
fn a_whole_may_not_be_called_as_another_building() {
    let mut town = town();
    town.records[0].part_of = Some("tower".to_owned());
    let refused = Overview::of(town.records.as_slice()).unwrap_err();
    assert!(matches!(&refused, OutputError::DuplicateId { id } if id == "tower"), "{refused}");
}

#[test]
fn a_city_streamed_from_a_file_is_the_city_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let town = town_with_parts();
    let at = |name: &str| folder.path().join(name);
    cityjson::write_sequence(&at("a.city.jsonl"), &town.model(), &CityJsonConfig::default()).unwrap();
    geopackage::write(&at("a.gpkg"), &town.model()).unwrap();
    for source in ["a.city.jsonl", "a.gpkg"] {
        let streamed = RecordFile::open(&at(source), ReadOptions::default()).unwrap();
        let read = FoundBuildings::read(&at(source), &ReadOptions::default()).unwrap().to_records();
        let lineage = streamed.lineage().unwrap();
        assert_eq!(lineage.vertical_reference, town.lineage.vertical_reference, "{source}");
        let model =
            CityModel { records: &streamed, crs: &town.crs, lineage: &town.lineage, issues: &[], survey: &town.survey };
        let in_memory = CityModel { records: read.as_slice(), ..town.model() };
        cityjson::write(&at("streamed.city.json"), &model, &CityJsonConfig::default()).unwrap();
        cityjson::write(&at("memory.city.json"), &in_memory, &CityJsonConfig::default()).unwrap();
        let bytes = |name: &str| std::fs::read(at(name)).unwrap();
        assert!(bytes("streamed.city.json") == bytes("memory.city.json"), "{source}");
        // And twice the same: every pass starts at the first building.
        let mut n = [0, 0];
        for count in &mut n {
            streamed
                .visit(&mut |_| {
                    *count += 1;
                    Ok(())
                })
                .unwrap();
        }
        assert_eq!(n, [6, 6], "{source}");
    }
}

/// What cjval says of a file with our extension at hand.
fn extension_errors(city: &Value) -> Vec<String> {
    let mut validator = cjval::CJValidator::from_str(&city.to_string());
    validator.add_one_extension_from_str(&extension_schema().to_string()).unwrap();
    validator.validate().into_iter().flat_map(|(_, summary)| summary.get_errors().clone()).collect()
}

#[test]
fn the_extension_declares_our_attributes_and_finds_wrong_types() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    let town = town_with_parts();
    let url = "https://example.org/sizeup.ext.json";
    let config = CityJsonConfig { extension_url: Some(url.to_owned()), ..CityJsonConfig::default() };
    cityjson::write(&path, &town.model(), &config).unwrap();
    let mut city: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    assert_eq!(city["extensions"]["Sizeup"]["url"], url);
    assert_eq!(city["CityObjects"]["row 1"]["attributes"]["+sizeup-height_m"], 6.25);
    assert_eq!(city["CityObjects"]["courtyard"]["attributes"]["street"], "Zürich \"A\"");
    assert_eq!(extension_errors(&city), Vec::<String>::new());
    // The same buildings as without the extension.
    let plain = folder.path().join("plain.city.json");
    cityjson::write(&plain, &town.model(), &CityJsonConfig::default()).unwrap();
    assert_eq!(read(&path), read(&plain));

    for (attribute, wrong) in [("height_m", json!("tall")), ("status", json!("guessed")), ("views", json!("a.jpg"))] {
        let mut faulty = city.clone();
        faulty["CityObjects"]["courtyard"]["attributes"][format!("+sizeup-{attribute}")] = wrong;
        let errors = extension_errors(&faulty);
        assert!(errors.len() == 1 && errors[0].contains(attribute), "{errors:?}");
    }
    city["CityObjects"]["courtyard"]["attributes"]["+sizeup-shoe_size"] = json!(43);
    assert!(!extension_errors(&city).is_empty(), "an attribute that the extension does not know");
}

#[test]
fn names_of_3dbag_stand_beside_ours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    let mut town = town();
    town.records[2].status = Status::Measured;
    let config = CityJsonConfig { names: AttributeNames::ThreeDBag, ..CityJsonConfig::default() };
    cityjson::write(&path, &town.model(), &config).unwrap();
    assert_valid_cityjson(&path);
    let objects = objects(&path);
    let courtyard = &objects["courtyard"]["attributes"];
    assert_eq!(courtyard["identificatie"], "courtyard");
    assert_eq!((&courtyard["b3_h_maaiveld"], &courtyard["b3_h_dak_50p"]), (&json!(12.0), &json!(27.0)));
    // 30 m × 30 m without a courtyard of 10 m × 10 m, from 11.4 m to 27 m.
    assert_eq!((&courtyard["b3_opp_grond"], &courtyard["b3_volume_lod12"]), (&json!(800.0), &json!(12_480.0)));
    assert_eq!(courtyard["height_m"], 15.0);
    assert_eq!(objects["unknown"]["attributes"].get("b3_h_dak_50p"), None);
    // Ground at 12 m, eaves 6 m and ridge 9 m above it, mean 7.5 m.
    let gable = &objects["row 2"]["attributes"];
    let levels = ["b3_h_dak_min", "b3_h_dak_50p", "b3_h_dak_max"].map(|name| gable[name].as_f64().unwrap());
    assert_eq!((levels, &gable["b3_dak_type"]), ([18.0, 19.5, 21.0], &json!("slanted")));
}
