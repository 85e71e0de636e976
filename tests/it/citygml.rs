//! `CityGML` 2.0 and 3.0: valid by the official schemas, and read by GDAL; skipped where these are not installed.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use sizeup::output::citygml::{self, Edition};
use sizeup::output::cityjson::{self, CityJsonConfig};

use crate::consumers::town_with_a_roof;
use crate::outputs::{Town, assert_valid_cityjson};
use crate::skipped::skip;
use crate::tools::{program, run};

/// The validator of `CityGML` 2.0 that brings the official schemas.
fn citysmith() -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/tools/citysmith/bin/citysmith");
    if !own.is_file() {
        skip("citysmith is not installed (make deps-test)");
        return None;
    }
    Some(own)
}

/// The folder of the official schemas of `CityGML` 3.0 and all that they import.
fn schemas_of_citygml3() -> Option<PathBuf> {
    let named = std::env::var_os("SIZEUP_CITYGML_SCHEMAS").map(PathBuf::from);
    let folder = named.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target/tools/citygml"));
    if !folder.join("citygml/3.0/building.xsd").is_file() {
        skip("no schemas of CityGML 3.0 (make deps-citygml)");
        return None;
    }
    Some(folder)
}

/// The town with a house in two parts, addresses, and names that are none in XML.
fn town_with_addresses() -> Town {
    let mut town = town_with_a_roof();
    town.records[0].part_of = Some("row <1>".to_owned());
    town.records[1].part_of = Some("row <1>".to_owned());
    "Höfe & 2".clone_into(&mut town.records[2].id);
    for (record, number) in town.records.iter_mut().zip([1, 3, 5]) {
        record.attributes.insert("addr:street".to_owned(), "Am <Hof>".into());
        record.attributes.insert("addr:housenumber".to_owned(), number.into());
    }
    town.records[2].attributes.insert("addr:postcode".to_owned(), "1010".into());
    town.records[2].attributes.insert("addr:city".to_owned(), "Wien".into());
    town.records[2].attributes.insert("addr:country".to_owned(), "AT".into());
    town
}

/// Every face that a solid refers to is there.
fn assert_links_lead_to_polygons(text: &str) {
    let links: Vec<&str> = text.split("xlink:href=\"#").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert!(links.len() > 20);
    for link in links {
        assert!(text.contains(&format!("<gml:Polygon gml:id=\"{link}\">")), "{link}");
    }
}

/// Text of all elements of a name, markup within left out.
fn texts<'a>(xml: &'a str, name: &str) -> Vec<&'a str> {
    let opened = format!("<{name}>");
    xml.split(opened.as_str()).skip(1).filter_map(|rest| rest.split('<').next()).collect()
}

#[test]
fn our_citygml3_is_valid_by_the_official_schemas_and_says_what_2_says() {
    let (Some(citysmith), Some(schemas)) = (citysmith(), schemas_of_citygml3()) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (folder.path().join("town2.gml"), folder.path().join("town3.gml"));
    let mut town = town_with_addresses();
    town.records[2].base_z_m = town.records[2].ground_z_m;
    citygml::write(&old, &town.model(), Edition::V2).unwrap();
    citygml::write(&new, &town.model(), Edition::V3).unwrap();
    // Its environment has lxml.
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/citygml3.py");
    let validate =
        |path: &Path| run(Command::new(citysmith.with_file_name("python")).arg(&script).arg(&schemas).arg(path));
    assert_eq!(validate(&new), "");
    let [old, text] = [&old, &new].map(|path| std::fs::read_to_string(path).unwrap());
    // The validator sees what is wrong.
    std::fs::write(&new, text.replace("<con:status>measured", "<con:status>guessed")).unwrap();
    assert!(validate(&new).contains("guessed"));
    assert_links_lead_to_polygons(&text);
    // The same corners, the same attributes, the same ids of objects.
    let corners = |xml: &str| {
        let mut all: Vec<String> = xml.split("<gml:posList srsDimension=\"3\">").skip(1).map(str::to_owned).collect();
        all.iter_mut().for_each(|rest| rest.truncate(rest.find('<').unwrap()));
        all.sort();
        all
    };
    assert_eq!(corners(&text), corners(&old));
    assert_eq!(texts(&text, "gen:value"), texts(&old, "gen:value"));
    assert_eq!(texts(&text, "gml:name"), texts(&old, "gml:name"));
    for name in ["bldg:roofType", "bldg:storeysAboveGround"] {
        assert_eq!(texts(&text, name), texts(&old, name));
    }
    let n = |words: &str| text.matches(words).count();
    assert_eq!((n("<core:lod1Solid>"), n("<core:lod2Solid>"), n("<core:lod1TerrainIntersectionCurve>")), (4, 4, 4));
    assert_eq!((n("<bldg:buildingPart>"), n("<con:RoofSurface ")), (2, old.matches("<bldg:RoofSurface ").count()));
    assert_eq!((n("<bldg:address>"), n("<xAL:NameElement>Am &lt;Hof&gt;<")), (2, 2));
    // The tower's height is a fallback; the courtyard's counts from the lowest ground, the others from a level above it.
    assert_eq!((n("<con:status>measured<"), n("<con:status>estimated<")), (3, 1));
    assert_eq!((n("<con:lowReference>lowestGroundPoint<"), n("<con:lowReference>generalGround<")), (1, 3));
    assert!(text.contains("<con:value uom=\"m\">61.000</con:value>"));
    assert!(text.contains("<core:creationDate>2025-06-01T00:00:00</core:creationDate>"));
}

#[test]
fn our_citygml_is_valid_by_the_official_schemas() {
    let Some(citysmith) = citysmith() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.gml");
    let town = town_with_addresses();
    citygml::write(&path, &town.model(), Edition::V2).unwrap();
    let said = run(Command::new(citysmith).arg("validate").arg("--schema-only").arg(&path));
    assert!(said.contains("valid"), "{said}");
    let text = std::fs::read_to_string(&path).unwrap();
    let n = |words: &str| text.matches(words).count();
    assert_eq!((n("<bldg:Building gml:id"), n("<bldg:BuildingPart gml:id")), (5, 2));
    // A gable; four with a height, of which all have both solids and a line on the ground.
    assert_eq!((n("<bldg:roofType>3100<"), n("<bldg:measuredHeight")), (2, 4));
    assert_eq!((n("<bldg:lod1Solid>"), n("<bldg:lod2Solid>"), n("<bldg:lod1TerrainIntersection>")), (4, 4, 4));
    assert_eq!((n("<bldg:storeysAboveGround>"), n("urn:ogc:def:crs:EPSG::7415")), (4, 1));
    // One address per building: the row of two parts, and the one beside it.
    assert_eq!((n("<bldg:address>"), n("<xAL:ThoroughfareName>Am &lt;Hof&gt;<")), (2, 2));
    assert!(text.contains("<xAL:PostalCodeNumber>1010<") && text.contains("<xAL:ThoroughfareNumber>1<"));
    let city = folder.path().join("town.city.json");
    cityjson::write(&city, &town.model(), &CityJsonConfig::default()).unwrap();
    assert_valid_cityjson(&city);
    let city: Value = serde_json::from_slice(&std::fs::read(&city).unwrap()).unwrap();
    assert_eq!(city["CityObjects"]["Höfe & 2"]["address"][0]["Locality"], "Wien");
    assert_eq!(city["CityObjects"]["row <1>"]["address"][0]["ThoroughfareNumber"], "1");
    // All attributes of the input come along, and the day.
    assert!(text.contains("<gen:stringAttribute name=\"street\"><gen:value>Zürich &quot;A&quot;</gen:value>"));
    assert!(text.contains("<core:creationDate>2025-06-01</core:creationDate>"));
    assert_links_lead_to_polygons(&text);
}

#[test]
fn gdal_reads_our_citygml_as_gml() {
    let Some(ogrinfo) = program("ogrinfo", "deps-test") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.gml");
    citygml::write(&path, &town_with_a_roof().model(), Edition::V2).unwrap();
    let said = run(Command::new(ogrinfo).arg(&path).args(["-al", "-so"]));
    assert!(said.contains("Layer name: Building") && said.contains("Feature Count: 6"), "{said}");
    assert!(said.contains("measuredHeight"), "{said}");
}
