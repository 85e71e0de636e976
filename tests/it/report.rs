//! The report and the viewer in a real browser: they show what is in the result, and nothing leaves the page.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use gdal::vector::LayerAccess as _;
use geo::polygon;
use serde_json::Value;
use sizeup::issue::{Issue, Severity, Subject};
use sizeup::output::Status;
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::geopackage;
use sizeup::output::picture::{MapConfig, map};
use sizeup::output::tiles3d::{self, Tiles3dConfig};
use sizeup::report::{self, LevelFit, Report, ViewUse};
use sizeup::terrain::Terrain;

use crate::outputs::{Town, building, town};
use crate::real_data::WARSAW;
use crate::shared_data::shared_data;
use crate::skipped::skip;
use crate::tiles3d::{Glb, config as tiles_config};
use crate::tiny_scene::sizeup;
use crate::tools::{chromium, node_modules, npm, picture, program, run};

/// Runs one of the scripts in `tests/web`; `None`, and a line that says so, without a browser.
pub fn browse(script: &str, address: &str, more: &[&str]) -> Option<Value> {
    let (Some(_), Some(chromium)) = (npm("playwright-core"), chromium()) else { return None };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/web").join(script);
    let said = run(Command::new("node").arg(script).arg(node_modules()).arg(chromium).arg(address).args(more));
    Some(serde_json::from_str(&said).unwrap())
}

/// Opens a page, picks a building in every way there is, and checks what a page always has to do. Screenshots are left
/// in the target folder's `tmp/pictures/report-NAME`.
fn use_report(path: &Path, name: &str, id: &str) -> Option<Value> {
    let said = pick_in_report(path, name, id, &[])?;
    assert!(said["phoneColours"].as_u64().unwrap() > 30, "{said:#}");
    assert_eq!(said["overflow"], 0, "the page is no wider than a phone");
    assert_eq!(said["broken"], 0, "pictures that cannot be shown");
    for layer in ["buildings", "edges", "shadows", "ground", "cameras", "photos"] {
        assert_eq!(said["layers"][format!("layer-{layer}")], true, "{layer}");
    }
    assert_eq!(said["recolours"], true);
    Some(said)
}

/// Opens a page on a desktop and picks a building in every way there is. Layers, paper and a phone are left to pages that are used.
fn pick_in_report(path: &Path, name: &str, id: &str, more: &[&str]) -> Option<Value> {
    let out = picture(&format!("report-{name}"));
    fs::create_dir_all(&out).unwrap();
    let address = format!("file://{}", path.display());
    let said = browse("report.mjs", &address, &[&[out.to_str().unwrap(), id], more].concat())?;
    println!("{name}: {said:#}");
    assert_eq!(said["requests"], Value::Array(Vec::new()), "nothing is asked for");
    assert_eq!(said["errors"], Value::Array(Vec::new()));
    assert_eq!(said["placeholders"], false);
    // A blank or flat picture has a handful.
    assert!(said["colours"].as_u64().unwrap() > 30, "{said:#}");
    for way in ["pickedInScene", "pickedOnMap"] {
        assert_eq!(said[way]["id"], id, "{way}");
    }
    assert_eq!(said["pickedByEscape"]["id"], Value::Null);
    assert_eq!(said["pickedByLink"]["id"], said["linked"]);
    assert!(said["shownByLink"].as_f64().unwrap() > 0.5, "a link leads to where its building is seen: {said:#}");
    assert_eq!(said["address"], format!("#building={}", said["linked"].as_str().unwrap()));
    Some(said)
}

/// Holds a page against axe-core's rules of accessibility, on a desktop and on a phone.
pub fn is_accessible(address: &str) {
    if npm("axe-core").is_none() {
        return;
    }
    let Some(said) = browse("axe.mjs", address, &[]) else { return };
    for screen in ["desktop", "phone"] {
        assert_eq!(said[screen]["broken"], Value::Array(Vec::new()), "{address} on a {screen}");
        assert!(said[screen]["kept"].as_u64().unwrap() > 10, "axe looked at the page: {said:#}");
    }
}

/// The number at the start of `12.3 m ± 0.4 m`.
fn shown_m(picked: &Value) -> f64 {
    picked["height"].as_str().unwrap().split(' ').next().unwrap().parse().unwrap()
}

/// Heights in the city model by id.
fn heights_m(result: &Path) -> BTreeMap<String, f64> {
    let city: Value = serde_json::from_slice(&fs::read(result.join("city.city.json")).unwrap()).unwrap();
    let objects = city["CityObjects"].as_object().unwrap();
    objects.iter().filter_map(|(id, o)| Some((id.clone(), o["attributes"]["height_m"].as_f64()?))).collect()
}

/// The building that stands freest of others in the way: the highest.
fn highest(heights_m: &BTreeMap<String, f64>) -> (&str, f64) {
    let highest = heights_m.iter().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
    (highest.0, *highest.1)
}

#[test]
fn the_report_of_the_demo_works_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    sizeup().arg("demo").arg("--output").arg(folder.path()).assert().success();
    let result = folder.path().join("result");
    let heights_m = heights_m(&result);
    let (id, height_m) = highest(&heights_m);
    let Some(said) = use_report(&result.join("report.html"), "demo", id) else { return };
    // Shown to a decimetre.
    assert!((shown_m(&said["pickedInScene"]) - height_m).abs() < 0.051, "{said:#}");
    let linked = said["linked"].as_str().unwrap();
    assert!((shown_m(&said["pickedByLink"]) - heights_m[linked]).abs() < 0.051, "{said:#}");
    assert_eq!(said["backdrop"], true, "the photos under the map are seen, and can be hidden");
    // Four photos of the linked one, which is the most doubtful, each with its depth and its prior.
    assert_eq!(said["crops"], 12);
    let steps: Vec<f64> = evidence_gaps_m(&result.join("report.html"));
    // The curves are drawn for flat roofs with the neighbours as they stand at the end; pitched roofs move the mean.
    assert!(steps.len() == 40 && sizeup::stats::median(&steps).unwrap() < 0.8, "{steps:.2?}");
}

/// How far the best of the scored heights lies from the stated one, for each building with evidence in a page, metres.
fn evidence_gaps_m(page: &Path) -> Vec<f64> {
    let text = fs::read_to_string(page).unwrap();
    let data = text.split_once("id=\"data\">").unwrap().1.split_once("</script>").unwrap().0;
    let data: Value = serde_json::from_str(data).unwrap();
    let gap = |evidence: &Value| {
        let scores = evidence["scores"].as_array().unwrap();
        let total = |i: usize| scores.iter().map(|view| view["score"][i].as_f64().unwrap()).sum::<f64>();
        let heights = evidence["heights"].as_array().unwrap();
        let best = (0..heights.len()).max_by(|&a, &b| total(a).total_cmp(&total(b))).unwrap();
        let building = evidence["building"].as_u64().unwrap() as usize;
        (heights[best].as_f64().unwrap() - data["buildings"][building]["height"].as_f64().unwrap()).abs()
    };
    data["evidence"].as_array().unwrap().iter().map(gap).collect()
}

#[test]
fn the_report_of_the_real_warsaw_block_works_in_a_browser() {
    let Some(_) = shared_data("warsaw_ochota_photos") else { return };
    let result = WARSAW.as_ref().unwrap().path().join("result");
    let heights_m = heights_m(&result);
    let (id, height_m) = highest(&heights_m);
    let Some(said) = use_report(&result.join("report.html"), "warsaw", id) else { return };
    assert!((shown_m(&said["pickedInScene"]) - height_m).abs() < 0.051, "{said:#}");
    assert!(said["crops"].as_u64().unwrap() >= 6, "{said:#}");
}

fn write_report(town: &Town, path: &Path) {
    report::write(path, &plain_report(town)).unwrap();
}

pub fn plain_report(town: &Town) -> Report<'_> {
    Report {
        model: town.model(),
        terrain: &Terrain::Constant(11.5),
        views: vec![ViewUse::NotOblique, ViewUse::Failed("<b>unreadable</b>".to_owned())],
        passes: Vec::new(),
        solved: &[],
        levels: Vec::new(),
        survey: None,
        evidence: Vec::new(),
        overview: None,
        backdrop: None,
        textured: None,
        config: "# </script> {{script}}\n".to_owned(),
    }
}

#[test]
fn a_height_has_one_colour_on_the_map_of_the_page_in_the_picture_in_qgis_and_in_tiles() {
    let folder = tempfile::tempdir().unwrap();
    // A house of every class, each in a street of its own.
    let heights_m = [2.0, 4.5, 7.0, 10.0, 13.0, 17.0, 25.0, 45.0, 80.0, 145.4];
    let classes: Value =
        serde_json::from_str(include_str!("../../crates/results/src/output/height_classes.json")).unwrap();
    assert_eq!(classes.as_array().unwrap().len(), heights_m.len());
    let houses = |heights_m: &[f64]| -> Town {
        let mut town = town();
        town.issues.clear();
        let house = |(i, height_m): (usize, &f64)| {
            let (x, y) = (93_000.0 + 40.0 * (i % 4) as f64, 436_000.0 + 40.0 * (i / 4) as f64);
            let footprint =
                polygon![(x: x, y: y), (x: x + 20.0, y: y), (x: x + 20.0, y: y + 20.0), (x: x, y: y + 20.0)];
            building(&format!("h{i}"), Some(footprint), Some(*height_m), Status::Measured)
        };
        town.records = heights_m.iter().enumerate().map(house).collect();
        town
    };
    let all = houses(&heights_m);
    let in_qgis = colours_in_qgis(&all, folder.path(), &heights_m);
    let in_tiles = colours_in_tiles(&all, folder.path());
    let in_picture =
        heights_m.map(|height_m| most_frequent_colour(&map(&houses(&[height_m]).model(), &MapConfig::default())));
    assert_eq!(in_picture.as_slice(), in_qgis);
    assert_eq!(in_tiles, in_qgis);
    let path = folder.path().join("report.html");
    write_report(&all, &path);
    let Some(said) = pick_in_report(&path, "colours", "h9", &["--picks"]) else { return };
    for (i, height_m) in heights_m.iter().enumerate() {
        assert_eq!(said["onMap"][format!("h{i}")], serde_json::json!(in_qgis[i]), "{height_m} m on the page");
    }
}

/// The colours of heights by the style that a GeoPackage brings: those of the first rule that holds for each.
fn colours_in_qgis(town: &Town, folder: &Path, heights_m: &[f64]) -> Vec<[u8; 3]> {
    let path = folder.join("city.gpkg");
    geopackage::write(&path, &town.model()).unwrap();
    let package = gdal::Dataset::open(&path).unwrap();
    let styles = "SELECT styleQML FROM layer_styles WHERE f_table_name = 'buildings'";
    let mut styles = package.execute_sql(styles, None, gdal::vector::sql::Dialect::DEFAULT).unwrap().unwrap();
    let qml = styles.features().next().unwrap().field_as_string(0).unwrap().unwrap();
    let between = |text: &str, from: &str, to: &str| -> Option<String> {
        Some(text.split_once(from)?.1.split_once(to)?.0.to_owned())
    };
    // What is drawn from above; the 3D view has rules of its own.
    let qml = qml.split_once("<renderer-v2").unwrap().1;
    let rules = between(qml, "<rules", "</rules>").unwrap();
    let symbols = between(qml, "<symbols", "</symbols>").unwrap();
    // (lower bound, upper bound, symbol) of each rule about heights.
    let bounds = |rule: &str| -> Option<(f64, f64, String)> {
        let filter = between(rule, "filter=\"", "\"")?;
        let number = |after: &str, or: f64| {
            let text = filter.split_once(after).map(|(_, rest)| rest.trim().split(' ').next().unwrap().to_owned());
            text.map_or(or, |text| text.parse().unwrap())
        };
        let is_of_heights = filter.contains("height_m") && !filter.contains("status");
        let symbol = between(rule, "symbol=\"", "\"")?;
        is_of_heights.then(|| (number(">=", f64::NEG_INFINITY), number("&lt;", f64::INFINITY), symbol))
    };
    let rules: Vec<(f64, f64, String)> = rules.split("<rule ").filter_map(bounds).collect();
    let colour = |height_m: &f64| {
        let (_, _, name) = rules.iter().find(|(low, high, _)| low <= height_m && height_m < high).unwrap();
        let symbol = symbols.split("<symbol ").find(|symbol| symbol.contains(&format!(" name=\"{name}\""))).unwrap();
        let fill = symbol.split("<Option ").find(|option| option.contains("name=\"color\"")).unwrap();
        let parts = between(fill, "value=\"", "\"").unwrap();
        let parts: Vec<u8> = parts.split(',').take(3).map(|part| part.parse().unwrap()).collect();
        [parts[0], parts[1], parts[2]]
    };
    heights_m.iter().map(colour).collect()
}

/// The colours of h0, h1, … in the tiles of a town, by the picture that their material has: viewers pass over colours of vertices.
fn colours_in_tiles(town: &Town, folder: &Path) -> Vec<[u8; 3]> {
    let tiles = folder.join("tiles");
    tiles3d::write(&tiles, &town.model(), &tiles_config()).unwrap();
    let glbs: Vec<Glb> =
        fs::read_dir(tiles.join("tiles/0")).unwrap().map(|entry| Glb::read(&entry.unwrap().path())).collect();
    let [glb] = glbs.as_slice() else { panic!("a small town is one tile") };
    let ids = glb.column("id");
    let of = glb.accessor(&glb.primitive()["attributes"]["_FEATURE_ID_0"]);
    assert!(glb.primitive()["attributes"]["COLOR_0"].is_null(), "it would be multiplied with the picture");
    let colour = |i: usize| {
        let feature = ids.iter().position(|id| id == &Value::from(format!("h{i}"))).unwrap();
        let vertex = of.iter().position(|id| id[0] == feature as f64).unwrap();
        glb.colour(glb.primitive(), vertex)
    };
    (0..town.records.len()).map(colour).collect()
}

/// The colour of most pixels that are neither paper nor grey.
fn most_frequent_colour(picture: &image::RgbImage) -> [u8; 3] {
    let mut counts: BTreeMap<[u8; 3], usize> = BTreeMap::new();
    for pixel in picture.pixels().filter(|p| p[0] != p[1] || p[1] != p[2]) {
        *counts.entry(pixel.0).or_default() += 1;
    }
    counts.into_iter().max_by_key(|(_, n)| *n).unwrap().0
}

/// Text that becomes markup, or script, wherever it is not treated as text.
const MARKUP: &str = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\"'&{{title}}\u{2028}";

#[test]
fn markup_in_what_comes_from_the_input_stays_text() {
    let folder = tempfile::tempdir().unwrap();
    let mut town = town();
    // The tower stands apart.
    town.records[3].id = MARKUP.to_owned();
    town.records[3].attributes.insert(MARKUP.to_owned(), MARKUP.into());
    town.records[3].reasons = vec![MARKUP.to_owned()];
    town.survey.views[1].id = MARKUP.into();
    town.lineage.command = MARKUP.to_owned();
    town.lineage.reference_date = Some(MARKUP.to_owned());
    let subject = Subject::Building(MARKUP.to_owned());
    town.issues = vec![Issue::new(Severity::Warning, MARKUP, subject, MARKUP).hint(MARKUP).at(93_000.0, 436_000.0)];
    let path = folder.path().join("report.html");
    write_report(&town, &path);
    let text = fs::read_to_string(&path).unwrap();
    assert!(!text.contains("alert(1)</script>") && !text.contains("<img src=x"), "markup stands in the page");
    let Some(said) = use_report(&path, "markup", MARKUP) else { return };
    assert_eq!((&said["linked"], shown_m(&said["pickedByLink"])), (&MARKUP.into(), 61.0));
    assert_eq!(said["layers"]["layer-issues"], true);
}

#[test]
fn a_link_leads_to_where_its_building_is_seen_behind_higher_ones() {
    let folder = tempfile::tempdir().unwrap();
    let mut town = town();
    // A house in a ring of towers, with a lane of 5 m between.
    let block = |x: f64, y: f64| {
        let (x, y) = (93_000.0 + x, 436_000.0 + y);
        polygon![(x: x, y: y), (x: x + 20.0, y: y), (x: x + 20.0, y: y + 20.0), (x: x, y: y + 20.0)]
    };
    let places = (0..9).map(|i| (25.0 * f64::from(i % 3), 25.0 * f64::from(i / 3)));
    let of = |(i, (x, y))| match i {
        4 => building("hidden", Some(block(x, y)), Some(6.0), Status::Doubtful),
        _ => building(&format!("tower {i}"), Some(block(x, y)), Some(70.0 + i as f64), Status::Measured),
    };
    town.records = places.enumerate().map(of).collect();
    let subject = Subject::Building("hidden".to_owned());
    town.issues = vec![Issue::new(Severity::Warning, "too_few_views", subject, "doubtful").at(93_035.0, 436_035.0)];
    let path = folder.path().join("report.html");
    write_report(&town, &path);
    let Some(said) = pick_in_report(&path, "hidden", "tower 8", &["--picks"]) else { return };
    assert_eq!(said["linked"], "hidden");
    assert_eq!(said["shownByLink"], 1.0, "{said:#}");
}

#[test]
fn parts_of_a_building_that_was_taken_apart_lead_to_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let mut town = town();
    for (i, record) in town.records.iter_mut().take(2).enumerate() {
        (record.id, record.part_of) = (format!("row#{}", i + 1), Some("row".to_owned()));
    }
    let subject = Subject::Building("row".to_owned());
    town.issues = vec![Issue::new(Severity::Note, "footprint_split", subject, "split into 2 parts")];
    let path = folder.path().join("report.html");
    let gain = LevelFit {
        whole: "row".to_owned(),
        heights_m: [7.5, 6.25],
        two: 0.9,
        one: vec![(2.0, 0.1), (6.0, 0.7), (12.0, 0.2)],
        n_views: 5,
    };
    report::write(&path, &Report { levels: vec![gain], ..plain_report(&town) }).unwrap();
    let Some(said) = pick_in_report(&path, "parts", "tower", &["--picks"]) else { return };
    assert_eq!((&said["linked"], &said["whole"]), (&"row#1".into(), &"row, beside row#2".into()), "{said:#}");
    let charts = said["charts"].to_string();
    assert!(charts.contains("row as a whole") && charts.contains("7.5 m and 6.3 m"), "{charts}");
}

/// `n` houses on a grid, with towers among them.
fn large_town(n: u32, spacing_m: f64) -> Town {
    let mut town = town();
    let side = f64::from(n).sqrt().ceil() as u32;
    let house = |i: u32| {
        let (x, y) = (93_000.0 + spacing_m * f64::from(i % side), 436_000.0 + spacing_m * f64::from(i / side));
        let (w, h) = (14.0 + f64::from((i * 7) % 9), 13.0 + f64::from((i * 5) % 11));
        let footprint = polygon![(x: x, y: y), (x: x + w, y: y), (x: x + w, y: y + h), (x: x + 0.5 * w, y: y + h), (x: x + 0.5 * w, y: y + 0.7 * h), (x: x, y: y + 0.7 * h)];
        let height_m = 4.0 + f64::from((i * 13) % 17) + if i.is_multiple_of(97) { 40.0 } else { 0.0 };
        building(&format!("b{i}"), Some(footprint), Some(height_m), Status::Measured)
    };
    town.records = (0..n).map(house).collect();
    town
}

#[test]
fn a_printed_report_has_every_row_of_every_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let mut town = large_town(64, 31.0);
    let missing = |i: usize| {
        Issue::new(Severity::Warning, "view_failed", Subject::View(format!("photo{i:03}.jpg")), "cannot be read")
    };
    town.issues = (0..70).map(missing).collect();
    let input = |i: usize| sizeup::output::InputFile {
        role: "photo".to_owned(),
        path: format!("input{i:03}.jpg"),
        size_bytes: 1000,
        sha256: format!("{i:064}"),
    };
    town.lineage.inputs = (0..122).map(input).collect();
    write_report(&town, &path);
    is_accessible(&format!("file://{}", path.display()));
    let Some(_) = use_report(&path, "printed", "b9") else { return };
    let Some(pdftotext) = program("pdftotext", "deps-test") else { return };
    let text = run(Command::new(pdftotext).arg("-layout").arg(picture("report-printed").join("page.pdf")).arg("-"));
    let n_lines = |word: &str, n: usize| {
        let is_there = |i: &usize| text.lines().any(|line| line.contains(&format!("{word}{i:03}.jpg")));
        (0..n).filter(is_there).count()
    };
    assert_eq!((n_lines("photo", 70), n_lines("input", 122)), (70, 122));
    let is_listed = |i: &usize| {
        text.lines().any(|line| line.split_whitespace().next() == Some(&format!("b{i}")) && line.contains(" m "))
    };
    assert_eq!((0..64).filter(is_listed).count(), 64);
}

#[test]
#[ignore = "measures: cargo test --locked --test it frames_per_second -- --ignored --nocapture"]
fn frames_per_second_of_ten_thousand_buildings() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    write_report(&large_town(10_000, 31.0), &path);
    println!("{} bytes", fs::metadata(&path).unwrap().len());
    let out = picture("report-large");
    fs::create_dir_all(&out).unwrap();
    let address = format!("file://{}", path.display());
    let said = browse("report.mjs", &address, &[out.to_str().unwrap(), "--frames"]).expect("a browser");
    println!("{said:#}");
}

/// A running `sizeup view`, which ends with the test.
struct Viewer {
    process: Child,
    address: String,
}

impl Viewer {
    fn of(folder: &Path) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sizeup"));
        let mut process = command.args(["view", "--no-open"]).arg(folder).stdout(Stdio::piped()).spawn().unwrap();
        let mut address = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut address).unwrap();
        Self { process, address: address.trim_end().to_owned() }
    }

    /// The status line of an answer to some bytes.
    fn ask(&self, request: &str) -> String {
        let host = self.address.trim_start_matches("http://").trim_end_matches('/');
        let mut stream = TcpStream::connect(host).unwrap();
        stream.write_all(request.replace("HOST", host).as_bytes()).unwrap();
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        answer.lines().next().unwrap_or_default().to_owned()
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }
}

#[test]
fn the_viewer_streams_tiles_as_one_comes_closer() {
    let folder = tempfile::tempdir().unwrap();
    let tiles: PathBuf = folder.path().join("tiles");
    // So far apart that the whole is seen from where a house is no more than some pixels.
    let town = large_town(2_000, 300.0);
    let config =
        Tiles3dConfig { heights: tiles3d::Heights::GeoidHeight(43.5), max_buildings: 100, ..Default::default() };
    tiles3d::write(&tiles, &town.model(), &config).unwrap();
    let viewer = Viewer::of(folder.path());
    let Some(said) = browse("view.mjs", &viewer.address, &[picture("view.png").to_str().unwrap()]) else { return };
    println!("{said:#}");
    is_accessible(&viewer.address);
    assert_eq!((&said["elsewhere"], &said["errors"]), (&Value::Array(Vec::new()), &Value::Array(Vec::new())));
    let n = |when: &str, what: &str| said[when][what].as_u64().unwrap();
    assert!(n("far", "buildings") >= 100 && n("near", "tiles") > n("far", "tiles"), "{said:#}");
    assert!(n("near", "buildings") < 2_000, "what is out of sight is not loaded: {said:#}");
    let record = town.records.iter().find(|r| r.id == said["picked"]["id"].as_str().unwrap()).unwrap();
    assert!((shown_m(&said["picked"]) - record.height_m.unwrap()).abs() < 0.051, "{said:#}");
}

#[test]
fn the_viewer_makes_tiles_of_a_result_and_answers_only_those_who_ask_for_it() {
    let folder = tempfile::tempdir().unwrap();
    cityjson::write(&folder.path().join("city.city.json"), &town().model(), &CityJsonConfig::default()).unwrap();
    let viewer = Viewer::of(folder.path());
    assert!(viewer.address.starts_with("http://127.0.0.1:"), "{}", viewer.address);
    for (request, status) in [
        ("GET / HTTP/1.1\r\nHost: HOST\r\n\r\n", "200 OK"),
        ("GET /tiles/tileset.json HTTP/1.1\r\nHost: HOST\r\n\r\n", "200 OK"),
        ("GET /tiles/../city.city.json HTTP/1.1\r\nHost: HOST\r\n\r\n", "404 Not Found"),
        ("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", "421 Misdirected Request"),
        ("GET / HTTP/1.1\r\n\r\n", "421 Misdirected Request"),
        ("DELETE / HTTP/1.1\r\nHost: HOST\r\n\r\n", "405 Method Not Allowed"),
    ] {
        assert_eq!(viewer.ask(request), format!("HTTP/1.1 {status}"), "{request}");
    }
    // A head without an end gets no answer, and the next one is answered all the same.
    assert_eq!(viewer.ask(&format!("GET / HTTP/1.1\r\nX: {}", "x".repeat(20_000))), "");
    assert_eq!(viewer.ask("GET / HTTP/1.1\r\nHost: HOST\r\n\r\n"), "HTTP/1.1 200 OK");
}

#[test]
fn the_worst_come_first_and_the_extremes_are_named() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/crates/results/src/report/page/doubt.js");
    let script = fs::read_to_string(script).unwrap();
    let buildings = r#"[
        { "id": "plain", "status": "measured", "height": 9, "sigma": 0.1 },
        { "id": "wide", "status": "measured", "height": 8, "sigma": 3.0 },
        { "id": "tower", "status": "reviewed", "height": 60, "sigma": 0.2 },
        { "id": "odd", "status": "doubtful", "height": 4, "sigma": 0.3 },
        { "id": "odder", "status": "doubtful", "height": 5, "sigma": 0.9 },
        { "id": "none", "status": "unknown", "height": null, "sigma": null }]"#;
    let ask = format!(
        "{script}\nconst all = {buildings};\nconst {{ highest, unlikely }} = extremes(all);\n\
         console.log([...all.sort(byDoubt), highest, unlikely].map((b) => b.id).join(' '));"
    );
    let Ok(said) = Command::new("node").args(["-e", &ask]).output() else { return skip("node is not installed") };
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let said = String::from_utf8(said.stdout).unwrap();
    assert_eq!(said.trim(), "none odder odd wide tower plain tower odder");
}
