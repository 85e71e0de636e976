//! Footprint layers as people keep them: every feature is used or refused by name, whatever the file.

use std::path::{Path, PathBuf};

use gdal::vector::{Geometry, LayerAccess as _, LayerOptions, OGRFieldType, OGRwkbGeometryType};
use gdal::{DriverManager, spatial_ref::SpatialRef};
use geo::{Area as _, BoundingRect as _, Validation as _, Winding as _};
use sizeup::crs::Crs;
use sizeup::footprint::{FootprintConfig, FootprintError, FootprintLayer, read};
use sizeup::issue::Severity;

use crate::shared_data::shared_data;

fn crs(definition: &str) -> Crs {
    Crs::parse(definition).unwrap()
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// GeoJSON in RD New (EPSG:28992) from (id, geometry as JSON without its type's braces).
fn geojson(features: &[(&str, &str)]) -> String {
    let features: Vec<String> = features
        .iter()
        .map(|(id, geometry)| format!(r#"{{"type":"Feature","properties":{{"name":{id}}},"geometry":{geometry}}}"#))
        .collect();
    format!(
        r#"{{"type":"FeatureCollection","crs":{{"type":"name","properties":{{"name":"urn:ogc:def:crs:EPSG::28992"}}}},
            "features":[{}]}}"#,
        features.join(",")
    )
}

/// A square of 10 m, `west` metres east of (100000, 400000).
fn square(west: f64) -> String {
    let (w, e, s, n) = (100_000.0 + west, 100_010.0 + west, 400_000.0, 400_010.0);
    format!(r#"{{"type":"Polygon","coordinates":[[[{w},{s}],[{e},{s}],[{e},{n}],[{w},{n}],[{w},{s}]]]}}"#)
}

fn read_geojson(features: &[(&str, &str)]) -> FootprintLayer {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "a.geojson", &geojson(features));
    let config = FootprintConfig { id_field: Some("name".into()), ..FootprintConfig::new(path) };
    read(&config, &crs("EPSG:28992")).unwrap()
}

fn ids(layer: &FootprintLayer) -> Vec<&str> {
    layer.footprints.iter().map(|f| f.id.0.as_str()).collect()
}

fn codes(layer: &FootprintLayer) -> Vec<&str> {
    layer.issues.iter().map(|i| i.code.as_str()).collect()
}

fn assert_fit_to_extrude(layer: &FootprintLayer) {
    for footprint in &layer.footprints {
        assert!(footprint.polygon.is_valid(), "{}", footprint.id);
        assert!(footprint.polygon.exterior().is_ccw(), "{}", footprint.id);
        assert!(footprint.polygon.interiors().iter().all(geo::Winding::is_cw), "{}", footprint.id);
    }
}

#[test]
fn every_feature_is_used_or_refused() {
    let multi = format!(
        r#"{{"type":"MultiPolygon","coordinates":[{},{}]}}"#,
        &square(40.0).split_once("coordinates\":").unwrap().1.trim_end_matches('}'),
        &square(60.0).split_once("coordinates\":").unwrap().1.trim_end_matches('}'),
    );
    let bow_tie = r#"{"type":"Polygon","coordinates":[[[100000,400050],[100009,400059],[100009,400050],[100000,400059],[100000,400050]]]}"#;
    let layer = read_geojson(&[
        (r#""a""#, &square(0.0)),
        (r#""a""#, &square(20.0)),
        (r#""multi""#, &multi),
        (r#""tie""#, bow_tie),
        (r#""none""#, "null"),
        (r#""line""#, r#"{"type":"LineString","coordinates":[[100000,400000],[100001,400001]]}"#),
        ("null", &square(80.0)),
        (r#""empty""#, r#"{"type":"Polygon","coordinates":[]}"#),
        (
            r#""flat""#,
            r#"{"type":"Polygon","coordinates":[[[100000,400000],[100005,400005],[100009,400009],[100000,400000]]]}"#,
        ),
    ]);
    assert_eq!(ids(&layer), ["a", "a~2", "multi#1", "multi#2", "fid-6"]);
    let wholes: Vec<Option<&str>> =
        layer.footprints.iter().map(|f| f.part_of.as_ref().map(|id| id.0.as_str())).collect();
    assert_eq!(wholes, [None, None, Some("multi"), Some("multi"), None]);
    let refused: Vec<(&str, &str)> = layer.refused.iter().map(|r| (r.id.0.as_str(), r.reason.as_str())).collect();
    assert_eq!(
        refused,
        [
            ("tie", "footprint_self_crossing"),
            ("none", "footprint_without_geometry"),
            ("line", "footprint_not_a_polygon"),
            ("empty", "footprint_without_geometry"),
            ("flat", "footprint_no_area"),
        ]
    );
    for reason in refused.iter().map(|(_, reason)| reason) {
        assert!(layer.issues.iter().any(|i| i.code == *reason && i.severity == Severity::Refused), "{reason}");
    }
    assert!(codes(&layer).contains(&"footprint_id_repeated") && codes(&layer).contains(&"footprint_split"));
    let crossing = layer.issues.iter().find(|i| i.code == "footprint_self_crossing").unwrap();
    let [e, n] = crossing.place.unwrap();
    assert!((100_000.0..100_010.0).contains(&e) && (400_050.0..400_060.0).contains(&n), "{crossing:?}");
    assert_eq!(layer.footprints[2].attributes["name"], "multi");
    assert_fit_to_extrude(&layer);
}

#[test]
fn overlapping_buildings_are_warned_of_once() {
    let layer = read_geojson(&[(r#""a""#, &square(0.0)), (r#""b""#, &square(4.0)), (r#""c""#, &square(14.0))]);
    let overlaps: Vec<_> = layer.issues.iter().filter(|i| i.code == "footprint_overlap").collect();
    assert_eq!(overlaps.len(), 1, "b and c only share a wall");
    assert!(overlaps[0].message.contains("building b by 60.0 m²"), "{}", overlaps[0].message);
}

#[test]
fn an_empty_layer_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "a.geojson", &geojson(&[]));
    assert!(matches!(read(&FootprintConfig::new(path), &crs("EPSG:28992")), Err(FootprintError::Empty { .. })));
}

#[test]
fn metres_passed_off_as_degrees_are_noticed_and_a_stated_crs_settles_it() {
    let folder = tempfile::tempdir().unwrap();
    let without_crs = format!(
        r#"{{"type":"FeatureCollection","features":[{{"type":"Feature","properties":{{}},"geometry":{}}}]}}"#,
        square(0.0)
    );
    let path = write(folder.path(), "a.geojson", &without_crs);
    let config = FootprintConfig::new(&path);
    let error = read(&config, &crs("EPSG:28992")).unwrap_err();
    assert!(matches!(error, FootprintError::NotDegrees { .. }), "{error}");
    let stated = FootprintConfig { crs: Some(crs("EPSG:28992")), ..config };
    let layer = read(&stated, &crs("EPSG:28992")).unwrap();
    assert_eq!(layer.footprints[0].polygon.unsigned_area(), 100.0);

    let path = write(folder.path(), "b.geojson", &geojson(&[(r#""a""#, &square(0.0))]));
    let conflict = FootprintConfig { crs: Some(crs("EPSG:25832")), ..FootprintConfig::new(path) };
    assert!(matches!(read(&conflict, &crs("EPSG:28992")), Err(FootprintError::CrsConflict { .. })));
}

/// A layer in degrees of houses of some 20 m.
fn in_degrees(folder: &Path, rings: &[&str]) -> PathBuf {
    let feature = |ring: &&str| {
        format!(r#"{{"type":"Feature","properties":{{}},"geometry":{{"type":"MultiPolygon","coordinates":{ring}}}}}"#)
    };
    let features: Vec<String> = rings.iter().map(feature).collect();
    write(folder, "degrees.geojson", &format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(",")))
}

#[test]
fn houses_on_the_date_line_stay_in_one_place() {
    let folder = tempfile::tempdir().unwrap();
    // On Taveuni, Fiji: across the line in one piece, and cut in two at it as RFC 7946 asks for.
    let across = "[[[[179.9999,-16.8],[-179.9999,-16.8],[-179.9999,-16.7998],[179.9999,-16.7998],[179.9999,-16.8]]]]";
    let cut = "[[[[179.9999,-16.81],[180,-16.81],[180,-16.8098],[179.9999,-16.8098],[179.9999,-16.81]]],\
               [[[-180,-16.81],[-179.9999,-16.81],[-179.9999,-16.8098],[-180,-16.8098],[-180,-16.81]]]]";
    let path = in_degrees(folder.path(), &[across, cut]);
    let layer = read(&FootprintConfig::new(path), &crs("EPSG:32760")).unwrap();
    assert!(layer.refused.is_empty(), "{:?}", layer.issues);
    assert_fit_to_extrude(&layer);
    // 0.0002 degrees are 21.3 m along the parallel and 22.1 m along the meridian.
    let area_m2: f64 = layer.footprints.iter().map(|f| f.polygon.unsigned_area()).sum();
    assert!((area_m2 - 2.0 * 21.32 * 22.13).abs() < 4.0, "{area_m2} m²");
    for footprint in &layer.footprints {
        let bounds = footprint.polygon.bounding_rect().unwrap();
        assert!(bounds.width() < 25.0 && bounds.height() < 25.0, "{bounds:?}");
    }
}

#[test]
fn swapped_axes_are_never_taken_for_a_place() {
    let folder = tempfile::tempdir().unwrap();
    let swapped = |lon: f64, lat: f64| {
        let corners = [(0.0, 0.0), (2e-4, 0.0), (2e-4, 2e-4), (0.0, 2e-4), (0.0, 0.0)];
        let ring: Vec<String> = corners.iter().map(|(a, b)| format!("[{},{}]", lat + b, lon + a)).collect();
        format!("[[[{}]]]", ring.join(","))
    };
    // Latitude first: in Sydney that makes a latitude of 151 degrees, in Delft a place off Somalia.
    let read_in =
        |ring: &str, project: &str| read(&FootprintConfig::new(in_degrees(folder.path(), &[ring])), &crs(project));
    let sydney = read_in(&swapped(151.2, -33.9), "EPSG:28356").unwrap_err().to_string();
    assert!(sydney.contains("swapped"), "{sydney}");
    let delft = read_in(&swapped(4.36, 52.0), "EPSG:28992").unwrap_err().to_string();
    assert!(delft.contains("swapped"), "{delft}");
}

/// Writes one layer per name, each with the given shapes (WKT, EPSG:28992 unless told otherwise).
fn write_ogr(path: &Path, driver: &str, layers: &[&str], srs: Option<u32>, wkts: &[&str]) {
    let mut dataset = DriverManager::get_driver_by_name(driver).unwrap().create_vector_only(path).unwrap();
    for name in layers {
        let srs = srs.map(|code| SpatialRef::from_epsg(code).unwrap());
        let options =
            LayerOptions { name, srs: srs.as_ref(), ty: OGRwkbGeometryType::wkbUnknown, ..Default::default() };
        let mut layer = dataset.create_layer(options).unwrap();
        layer.create_defn_fields(&[("floors", OGRFieldType::OFTInteger)]).unwrap();
        for wkt in wkts {
            layer.create_feature(Geometry::from_wkt(wkt).unwrap()).unwrap();
        }
    }
}

const SQUARE_WKT: &str = "POLYGON((100000 400000,100010 400000,100010 400010,100000 400010,100000 400000))";

#[test]
fn the_same_square_comes_out_of_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for (driver, file) in [("GPKG", "a.gpkg"), ("ESRI Shapefile", "a.shp"), ("FlatGeobuf", "a.fgb")] {
        let path = folder.path().join(file);
        write_ogr(&path, driver, &["a"], Some(28992), &[SQUARE_WKT]);
        let layer = read(&FootprintConfig::new(&path), &crs("EPSG:28992")).unwrap();
        assert_eq!(layer.footprints.len(), 1, "{driver}: {:?}", layer.issues);
        assert_eq!(layer.footprints[0].polygon.unsigned_area(), 100.0, "{driver}");
        assert!(layer.footprints[0].attributes["floors"].is_null(), "{driver}");
    }
}

#[test]
fn a_layer_without_crs_needs_one_and_several_layers_a_choice() {
    let folder = tempfile::tempdir().unwrap();
    let shp = folder.path().join("bare.shp");
    write_ogr(&shp, "ESRI Shapefile", &["bare"], None, &[SQUARE_WKT]);
    let config = FootprintConfig::new(&shp);
    assert!(matches!(read(&config, &crs("EPSG:28992")), Err(FootprintError::NoCrs { .. })));
    let stated = FootprintConfig { crs: Some(crs("EPSG:28992")), ..config };
    assert_eq!(read(&stated, &crs("EPSG:28992")).unwrap().footprints.len(), 1);

    let gpkg = folder.path().join("two.gpkg");
    write_ogr(&gpkg, "GPKG", &["houses", "sheds"], Some(28992), &[SQUARE_WKT]);
    let config = FootprintConfig::new(&gpkg);
    let error = read(&config, &crs("EPSG:28992")).unwrap_err().to_string();
    assert!(error.contains("houses, sheds"), "{error}");
    let chosen = FootprintConfig { layer: Some("sheds".into()), ..config.clone() };
    assert_eq!(read(&chosen, &crs("EPSG:28992")).unwrap().footprints.len(), 1);
    let wrong = FootprintConfig { layer: Some("barns".into()), ..config };
    assert!(read(&wrong, &crs("EPSG:28992")).unwrap_err().to_string().contains("barns"));
}

#[test]
fn heights_measures_and_curves_become_plain_footprints() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("odd.gpkg");
    let shapes = [
        "POLYGON ZM((100000 400000 5 1,100010 400000 5 2,100010 400010 5 3,100000 400010 5 4,100000 400000 5 1))",
        // A circle of radius 5 m, and a square whose eastern side is an arc.
        "CURVEPOLYGON(CIRCULARSTRING(100030 400000,100035 400005,100030 400010,100025 400005,100030 400000))",
        "CURVEPOLYGON(COMPOUNDCURVE(CIRCULARSTRING(100060 400000,100065 400005,100060 400010),(100060 400010,100050 400010,100050 400000,100060 400000)))",
        "MULTISURFACE(CURVEPOLYGON(CIRCULARSTRING(100080 400000,100085 400005,100080 400010,100075 400005,100080 400000)),((100100 400000,100110 400000,100110 400010,100100 400000)))",
        "POLYHEDRALSURFACE(((0 0,1 0,1 1,0 0)))",
    ];
    write_ogr(&path, "GPKG", &["odd"], Some(28992), &shapes);
    let layer = read(&FootprintConfig::new(&path), &crs("EPSG:28992")).unwrap();
    assert_eq!(ids(&layer), ["1", "2", "3", "4#1", "4#2"]);
    let areas: Vec<f64> = layer.footprints.iter().map(|f| f.polygon.unsigned_area()).collect();
    let circle = std::f64::consts::PI * 25.0;
    // Inscribed in steps of 4° a circle keeps 99.9 % of its area.
    for (area, expected) in areas.iter().zip([100.0, circle, 100.0 + circle / 2.0, circle, 50.0]) {
        assert!((area / expected - 1.0).abs() < 1.5e-3, "{area} {expected}");
    }
    assert_eq!(layer.refused[0].reason, "footprint_unsupported_geometry");
    assert_fit_to_extrude(&layer);
}

/// A cube of 10 m over [`SQUARE_WKT`], all its faces.
const CUBE_FACES: &str = "((100000 400000 5,100010 400000 5,100010 400010 5,100000 400010 5,100000 400000 5)),\
    ((100000 400000 15,100010 400000 15,100010 400010 15,100000 400010 15,100000 400000 15)),\
    ((100000 400000 5,100010 400000 5,100010 400000 15,100000 400000 15,100000 400000 5)),\
    ((100010 400000 5,100010 400010 5,100010 400010 15,100010 400000 15,100010 400000 5)),\
    ((100010 400010 5,100000 400010 5,100000 400010 15,100010 400010 15,100010 400010 5)),\
    ((100000 400010 5,100000 400000 5,100000 400000 15,100000 400010 15,100000 400010 5))";

#[test]
fn faces_of_bodies_are_one_footprint_each_with_one_note_and_parts_stay_parts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bodies.gpkg");
    // The second stands 3 km farther north: one place has one building.
    let beside = CUBE_FACES.replace(" 4000", " 4030");
    let shapes = [
        format!("MULTIPOLYGON Z({CUBE_FACES})"),
        format!("POLYHEDRALSURFACE Z({beside})"),
        // Two houses of one owner, on ground that is not level.
        "MULTIPOLYGON Z(((100050 400000 5,100060 400000 5,100060 400010 6,100050 400010 6,100050 400000 5)),\
            ((100070 400000 7,100080 400000 7,100080 400010 8,100070 400010 8,100070 400000 7)))"
            .to_owned(),
    ];
    write_ogr(&path, "GPKG", &["bodies"], Some(28992), &shapes.each_ref().map(String::as_str));
    let config = FootprintConfig { overlap_warning_m2: f64::MAX, ..FootprintConfig::new(&path) };
    let layer = read(&config, &crs("EPSG:28992")).unwrap();
    assert_eq!(ids(&layer), ["1", "2", "3#1", "3#2"]);
    assert!(layer.footprints.iter().all(|f| (f.polygon.unsigned_area() - 100.0).abs() < 1e-6), "{layer:?}");
    assert_eq!((codes(&layer), layer.refused.len()), (vec!["footprints_of_bodies", "footprint_split"], 0));
    assert_fit_to_extrude(&layer);

    // As GeoJSON, which is read without GDAL.
    let faces = CUBE_FACES.split(")),").map(|face| {
        let corners = face.trim_matches(['(', ')', ' ']).split(',');
        format!("[[{}]]", corners.map(|c| format!("[{}]", c.replace(' ', ","))).collect::<Vec<_>>().join(","))
    });
    let body = format!(r#"{{"type":"MultiPolygon","coordinates":[{}]}}"#, faces.collect::<Vec<_>>().join(","));
    let layer = read_geojson(&[("\"a\"", &body)]);
    assert_eq!((ids(&layer), codes(&layer)), (vec!["a"], vec!["footprints_of_bodies"]));
    assert!((layer.footprints[0].polygon.unsigned_area() - 100.0).abs() < 1e-6);
}

#[test]
fn ids_of_a_column_of_reals_are_whole_numbers_where_they_are() {
    let squares: Vec<String> = (0..4).map(|i| square(20.0 * f64::from(i))).collect();
    let ids_of = ["1000000000001.0", "12.5", "1e17", "7"];
    let layer = read_geojson(&std::array::from_fn::<_, 4, _>(|i| (ids_of[i], squares[i].as_str())));
    assert_eq!(ids(&layer), ["1000000000001", "12.5", "100000000000000000", "7"]);
}

#[test]
fn letters_of_a_shapefile_that_states_no_encoding_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.shp");
    {
        let mut dataset =
            DriverManager::get_driver_by_name("ESRI Shapefile").unwrap().create_vector_only(&path).unwrap();
        let srs = SpatialRef::from_epsg(28992).unwrap();
        let options =
            LayerOptions { name: "a", srs: Some(&srs), ty: OGRwkbGeometryType::wkbPolygon, ..Default::default() };
        let layer = dataset.create_layer(options).unwrap();
        layer.create_defn_fields(&[("street", OGRFieldType::OFTString)]).unwrap();
        let mut feature = gdal::vector::Feature::new(layer.defn()).unwrap();
        feature.set_geometry(Geometry::from_wkt(SQUARE_WKT).unwrap()).unwrap();
        feature.set_field_string(0, "Strasse 1").unwrap();
        feature.create(&layer).unwrap();
    }
    let _ = std::fs::remove_file(path.with_extension("cpg"));
    let table = path.with_extension("dbf");
    let plain = std::fs::read(&table).unwrap();
    let at = plain.windows(7).position(|bytes| bytes == b"Strasse").unwrap();
    let street = |letters: &[u8]| {
        let mut bytes = plain.clone();
        bytes[29] = 0;
        bytes[at..at + 7].copy_from_slice(letters);
        std::fs::write(&table, bytes).unwrap();
        read(&FootprintConfig::new(&path), &crs("EPSG:28992")).unwrap().footprints[0].attributes["street"].clone()
    };
    assert_eq!(street(b"Stra\xdfe "), "Stra\u{df}e  1", "ISO-8859-1");
    assert_eq!(street("Stra\u{df}e".as_bytes()), "Stra\u{df}e 1", "UTF-8");
    assert_eq!(street(b"Strasse"), "Strasse 1");
}

#[test]
fn tags_of_openstreetmap_that_have_no_column_are_attributes_too() {
    let folder = tempfile::tempdir().unwrap();
    let node = |i: usize, lat: f64, lon: f64| format!(r#"<node id="{}" version="1" lat="{lat}" lon="{lon}"/>"#, i + 1);
    let corners = [(52.0, 5.0), (52.0, 5.001), (52.001, 5.001), (52.001, 5.0)];
    let nodes: String = corners.iter().enumerate().map(|(i, (lat, lon))| node(i, *lat, *lon)).collect();
    let refs: String = [1, 2, 3, 4, 1].map(|id| format!(r#"<nd ref="{id}"/>"#)).concat();
    let tags: String = [("building", "yes"), ("height", "12 m"), ("building:levels", "3;4")]
        .map(|(key, value)| format!(r#"<tag k="{key}" v="{value}"/>"#))
        .concat();
    let osm = format!(r#"<osm version="0.6">{nodes}<way id="9" version="1">{refs}{tags}</way></osm>"#);
    let layer = read(&FootprintConfig::new(write(folder.path(), "a.osm", &osm)), &crs("EPSG:28992")).unwrap();
    assert_eq!(ids(&layer), ["way/9"]);
    let attribute = |name: &str| {
        sizeup::footprint::attribute(&layer.footprints[0].attributes, name).map(|value| value.as_ref().clone())
    };
    assert_eq!(attribute("height"), Some("12 m".into()));
    assert_eq!(attribute("building:levels"), Some("3;4".into()));
    assert_eq!((attribute("building"), attribute("roof:shape")), (Some("yes".into()), None));
}

#[test]
fn alexandria_in_degrees_lands_on_its_terrain_in_metres() {
    let Some(folder) = shared_data("alexandria_terrain") else { return };
    let mut areas = Vec::new();
    for file in ["buildings.geojson", "buildings.shp"] {
        let layer = read(&FootprintConfig::new(folder.join(file)), &crs("EPSG:26918")).unwrap();
        assert_eq!(layer.footprints.len() + layer.refused.len(), 84, "{file}: {:?}", layer.issues);
        assert_fit_to_extrude(&layer);
        // The publisher's own areas (SQMETERS) are of other footprints, off by a factor of two either way: no truth.
        for footprint in &layer.footprints {
            let middle = footprint.polygon.bounding_rect().unwrap().center();
            assert!((321_400.0..322_200.0).contains(&middle.x) && (4_297_400.0..4_298_100.0).contains(&middle.y));
        }
        println!("{file}: {} used, {} refused, {:?}", layer.footprints.len(), layer.refused.len(), codes(&layer));
        areas.push(layer.footprints.iter().map(|f| f.polygon.unsigned_area()).sum::<f64>());
    }
    assert!((areas[0] - areas[1]).abs() < 1e-3 * areas[0], "{areas:?}");
}

#[test]
fn delft_and_warsaw_come_in_whole() {
    if let Some(path) = shared_data("delft_lidar_lod1/bgt/bgt_pand.sqlite") {
        let config = FootprintConfig { id_field: Some("gml_id".into()), ..FootprintConfig::new(path) };
        let layer = read(&config, &crs("EPSG:7415")).unwrap();
        println!("delft: {} used, {} refused, {:?}", layer.footprints.len(), layer.refused.len(), codes(&layer));
        assert!(layer.footprints.len() >= 160 && layer.refused.is_empty());
        assert_fit_to_extrude(&layer);
    }
    if let Some(path) = shared_data("warsaw_ochota_photos/truth_buildings.geojson") {
        let config = FootprintConfig { id_field: Some("id".into()), ..FootprintConfig::new(path) };
        let layer = read(&config, &crs("EPSG:2180")).unwrap();
        println!("warsaw: {:?}, {:?}", ids(&layer), codes(&layer));
        assert_eq!(layer.footprints.len(), 9);
        let hall = layer.footprints.iter().find(|f| f.id.0 == "market_hall").unwrap().polygon.bounding_rect().unwrap();
        // EPSG:2180 lists northing first; the layer keeps easting first, and so do we.
        assert!((hall.min().x - 635_002.7).abs() < 2e-3 && (hall.min().y - 485_409.8).abs() < 2e-3, "{hall:?}");
        assert_fit_to_extrude(&layer);
    }
}
