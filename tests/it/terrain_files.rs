//! Terrain from files: in the project's CRS or another, with gaps, or not at all.

use std::path::Path;

use gdal::DriverManager;
use gdal::raster::Buffer;
use gdal::spatial_ref::SpatialRef;
use geo::Area as _;
use geo::line_measures::{Densify as _, Euclidean};
use sizeup::crs::{Crs, Transform};
use sizeup::footprint::FootprintConfig;
use sizeup::geodata::raster::{CellWindow, RasterFile, Resampling};
use sizeup::output::Records as _;
use sizeup::output::read::{ReadOptions, RecordFile};
use sizeup::stats;
use sizeup::terrain::{
    GroundConfig, MapBox, Terrain, TerrainConfig, TerrainError, ground_under, load, load_with_issues,
};

use crate::shared_data::shared_data;
use crate::tiny_scene::Scene;

fn crs(definition: &str) -> Crs {
    Crs::parse(definition).unwrap()
}

/// The whole town of Alexandria's tile, EPSG:26918.
const ALEXANDRIA: MapBox = MapBox { west_m: 321_600.0, south_m: 4_297_600.0, east_m: 321_900.0, north_m: 4_297_900.0 };

/// 100 × 80 cells of 1 m from (500000, 5500080) whose height is a plane; the first column has no value.
fn write_plane(path: &Path, epsg: Option<u32>, geotransform: Option<[f64; 6]>) {
    let driver = DriverManager::get_driver_by_name("GTiff").unwrap();
    let mut dataset = driver.create_with_band_type::<f32, _>(path, 100, 80, 1).unwrap();
    if let Some(geotransform) = geotransform {
        dataset.set_geo_transform(&geotransform).unwrap();
    }
    if let Some(code) = epsg {
        dataset.set_spatial_ref(&SpatialRef::from_epsg(code).unwrap()).unwrap();
    }
    let mut band = dataset.rasterband(1).unwrap();
    band.set_no_data_value(Some(-9999.0)).unwrap();
    let cells = (0..80).flat_map(|row| (0..100).map(move |col| if col == 0 { -9999.0 } else { plane(col, row) }));
    band.write((0, 0), (100, 80), &mut Buffer::new((100, 80), cells.collect())).unwrap();
}

fn plane(col: i32, row: i32) -> f32 {
    50.0 + 0.1 * (col as f32 + 0.5) - 0.2 * (row as f32 + 0.5)
}

const NORTH_UP: [f64; 6] = [500_000.0, 1.0, 0.0, 5_500_080.0, 0.0, -1.0];
const INSIDE: MapBox = MapBox { west_m: 500_020.0, south_m: 5_500_020.0, east_m: 500_060.0, north_m: 5_500_060.0 };

#[test]
fn a_plane_is_read_exactly_and_gaps_stay_gaps() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plane.tif");
    write_plane(&path, Some(25832), Some(NORTH_UP));
    let config = TerrainConfig { vertical_offset_m: Some(-2.0), ..TerrainConfig::dtm(&path) };
    let terrain = load(&config, &crs("EPSG:25832"), INSIDE).unwrap();
    let expected = 48.0 + 0.1 * 33.3 - 0.2 * (80.0 - 44.4);
    assert!((terrain.height_at(500_033.3, 5_500_044.4).unwrap() - expected).abs() < 1e-4);
    assert_eq!(terrain.height_at(500_000.7, 5_500_040.0), None, "the first column is nodata");

    // Through another zone and back: the same heights, resampled.
    let there = Transform::new(&crs("EPSG:25832"), &crs("EPSG:25833")).unwrap();
    let (e, n) = there.point(500_033.3, 5_500_044.4).unwrap();
    let area = MapBox { west_m: e - 10.0, south_m: n - 10.0, east_m: e + 10.0, north_m: n + 10.0 };
    let config = TerrainConfig { margin_m: 5.0, ..config };
    let resampled = load(&config, &crs("EPSG:25833"), area).unwrap();
    assert!((resampled.height_at(e, n).unwrap() - expected).abs() < 1e-3, "{:?}", resampled.height_at(e, n));
}

#[test]
fn only_the_window_is_read_and_fine_cells_are_averaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plane.tif");
    write_plane(&path, Some(25832), Some(NORTH_UP));
    let config = TerrainConfig { margin_m: 0.0, min_cell_m: 4.0, ..TerrainConfig::dtm(&path) };
    let Terrain::Grid(dem) = load(&config, &crs("EPSG:25832"), INSIDE).unwrap() else { panic!("a grid") };
    assert!(dem.heights_m().width() <= 12, "{}", dem.heights_m().width());
    let expected = 50.0 + 0.1 * 40.0 - 0.2 * 40.0;
    assert!((dem.height_at(500_040.0, 5_500_040.0).unwrap() - expected).abs() < 1e-4);
}

#[test]
fn what_cannot_be_placed_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let project = crs("EPSG:25832");
    let read = |name: &str| load(&TerrainConfig::dtm(path(name)), &project, INSIDE).unwrap_err();

    write_plane(&path("no_crs.tif"), None, Some(NORTH_UP));
    assert!(matches!(read("no_crs.tif"), TerrainError::NoCrs { .. }));
    let stated = TerrainConfig { crs: Some(project.clone()), ..TerrainConfig::dtm(path("no_crs.tif")) };
    assert!(load(&stated, &project, INSIDE).is_ok());

    write_plane(&path("rotated.tif"), Some(25832), Some([500_000.0, 1.0, 0.1, 5_500_080.0, -0.1, -1.0]));
    assert!(read("rotated.tif").to_string().contains("rotated"));
    write_plane(&path("upside_down.tif"), Some(25832), Some([500_000.0, 1.0, 0.0, 5_500_000.0, 0.0, 1.0]));
    assert!(read("upside_down.tif").to_string().contains("gdalwarp"));
    write_plane(&path("nowhere.tif"), Some(25832), None);
    assert!(read("nowhere.tif").to_string().contains("no geotransform"));
    write_plane(&path("elsewhere.tif"), Some(25832), Some([400_000.0, 1.0, 0.0, 5_500_080.0, 0.0, -1.0]));
    assert!(matches!(read("elsewhere.tif"), TerrainError::Elsewhere { .. }));
    write_plane(&path("two_datums.tif"), Some(7415), Some([100_000.0, 1.0, 0.0, 400_080.0, 0.0, -1.0]));
    let error = load(&TerrainConfig::dtm(path("two_datums.tif")), &crs("EPSG:28992+5773"), INSIDE).unwrap_err();
    assert!(error.to_string().contains("NAP height"), "{error}");
    assert!(read("absent.tif").to_string().contains("absent.tif"));
    assert!(matches!(load(&TerrainConfig::default(), &project, INSIDE), Err(TerrainError::Config { .. })));
}

#[test]
fn a_constant_needs_no_file() {
    let terrain = load(&TerrainConfig::constant(3.5), &crs("EPSG:25832"), INSIDE).unwrap();
    assert_eq!(terrain.height_at(0.0, 0.0), Some(3.5));
}

#[test]
fn alexandria_reads_the_same_in_its_own_zone_and_in_another() {
    let Some(folder) = shared_data("alexandria_terrain") else { return };
    let config = TerrainConfig::dtm(folder.join("dtm.tif"));
    let own = load(&config, &crs("EPSG:26918"), ALEXANDRIA).unwrap();
    let (lowest, highest) = own.range().unwrap();
    assert!(lowest > 6.0 && highest < 23.0, "{lowest} {highest}: nodata (-9999) must not get in");

    let there = Transform::new(&crs("EPSG:26918"), &crs("EPSG:26917")).unwrap();
    let at = |e: f64, n: f64| there.point(e, n).unwrap();
    let corners =
        [(321_600.0, 4_297_600.0), (321_900.0, 4_297_900.0), (321_600.0, 4_297_900.0), (321_900.0, 4_297_600.0)];
    let area = MapBox::around(corners.map(|(e, n)| at(e, n))).unwrap();
    let other = load(&TerrainConfig { margin_m: 0.0, ..config }, &crs("EPSG:26917"), area).unwrap();
    let mut differences = Vec::new();
    for i in 0..50 {
        for j in 0..50 {
            let (e, n) = (321_603.0 + 6.0 * i as f64, 4_297_603.0 + 6.0 * j as f64);
            let (x, y) = at(e, n);
            if let (Some(a), Some(b)) = (own.height_at(e, n), other.height_at(x, y)) {
                differences.push((a - b).abs());
            }
        }
    }
    println!(
        "alexandria: {} points, median {:?}, P99 {:?}",
        differences.len(),
        stats::median(&differences),
        stats::quantile(&differences, 0.99)
    );
    assert!(differences.len() > 2_000);
    // Two bilinear interpolations of 2 m cells on ground that slopes a few per cent.
    assert!(stats::median(&differences).unwrap() < 0.02 && stats::quantile(&differences, 0.99).unwrap() < 0.3);
}

#[test]
fn alexandria_roofs_above_ground_are_as_high_as_stated() {
    let Some(folder) = shared_data("alexandria_terrain") else { return };
    let project = crs("EPSG:26918");
    let layer = sizeup::footprint::read(&FootprintConfig::new(folder.join("buildings.geojson")), &project).unwrap();
    let everything = MapBox { west_m: 321_000.0, south_m: 4_297_000.0, east_m: 322_500.0, north_m: 4_298_500.0 };
    let ground = load(&TerrainConfig::dtm(folder.join("dtm.tif")), &project, everything).unwrap();
    let surface = load(&TerrainConfig::dtm(folder.join("dsm.tif")), &project, everything).unwrap();
    let mut errors = Vec::new();
    let mut n_missing = 0;
    for footprint in layer.footprints.iter().filter(|f| f.polygon.unsigned_area() > 30.0) {
        let (level, issue) = ground_under(&ground, &footprint.id, &footprint.polygon, GroundConfig::default());
        n_missing += usize::from(issue.is_some());
        let middle = geo::InteriorPoint::interior_point(&footprint.polygon).unwrap();
        let (Some(level), Some(roof)) = (level, surface.height_at(middle.x(), middle.y())) else { continue };
        let Some(stated_m) = footprint.attributes["HEIGHT"].as_f64() else { continue };
        errors.push((roof - level.reference_m - stated_m).abs());
    }
    println!(
        "alexandria: {} buildings, {n_missing} with gaps, median error {:?} m",
        errors.len(),
        stats::median(&errors)
    );
    assert!(errors.len() > 60 && stats::median(&errors).unwrap() < 2.0);
}

/// 60 × 60 cells of 10 units from (984000, 213600) of EPSG:2263 or what else is named; `z` in the file's unit.
struct Sheet<'a> {
    crs: &'a str,
    unit: &'a str,
    corner: (f64, f64),
    cell: f64,
}

const FEET: Sheet<'_> = Sheet { crs: "EPSG:2263", unit: "", corner: (984_000.0, 213_600.0), cell: 10.0 };
/// Where [`FEET`] lies, in EPSG:32118.
const LONG_ISLAND: MapBox = MapBox { west_m: 299_970.0, south_m: 64_970.0, east_m: 300_060.0, north_m: 65_060.0 };

fn write_sheet(path: &Path, sheet: &Sheet<'_>, z: impl Fn(i32, i32) -> f32) {
    let driver = DriverManager::get_driver_by_name("GTiff").unwrap();
    let mut dataset = driver.create_with_band_type::<f32, _>(path, 60, 60, 1).unwrap();
    let (west, north) = sheet.corner;
    dataset.set_geo_transform(&[west, sheet.cell, 0.0, north, 0.0, -sheet.cell]).unwrap();
    dataset.set_spatial_ref(&SpatialRef::from_definition(sheet.crs).unwrap()).unwrap();
    let mut band = dataset.rasterband(1).unwrap();
    let cells = (0..60).flat_map(|row| (0..60).map(move |col| (col, row))).map(|(col, row)| z(col, row));
    band.write((0, 0), (60, 60), &mut Buffer::new((60, 60), cells.collect())).unwrap();
    // The crate has no way to write a unit into the file.
    let beside = path.with_extension("tif.aux.xml");
    let unit = format!("<UnitType>{}</UnitType>", sheet.unit);
    let unit = if sheet.unit.is_empty() { "" } else { &unit };
    let text = format!("<PAMDataset><PAMRasterBand band=\"1\">{unit}</PAMRasterBand></PAMDataset>");
    std::fs::write(beside, text).unwrap();
}

#[test]
fn heights_beside_positions_in_feet_are_asked_for_and_converted_once_stated() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dem.tif");
    let level = |sheet: &Sheet<'_>, config: TerrainConfig, project: &str| {
        write_sheet(&path, sheet, |_, _| 100.0);
        let config = TerrainConfig { dtm: Some(path.clone()), margin_m: 10.0, ..config };
        let loaded = load_with_issues(&config, &crs(project), LONG_ISLAND)?;
        let codes: Vec<String> = loaded.issues.iter().map(|issue| issue.code.clone()).collect();
        Ok::<_, TerrainError>((loaded.terrain.height_at(300_000.0, 65_000.0).unwrap(), codes.join(" ")))
    };
    let stated = |crs_text: &str| TerrainConfig { crs: Some(crs(crs_text)), ..TerrainConfig::default() };
    let (us_ft, ft) = (100.0 * 1200.0 / 3937.0, 30.48);

    let unsaid = level(&FEET, TerrainConfig::default(), "EPSG:32118").unwrap_err();
    assert!(matches!(unsaid, TerrainError::HeightUnit { .. }), "{unsaid}");
    assert!(unsaid.to_string().contains("does not say in what it counts heights"), "{unsaid}");
    assert!(unsaid.to_string().contains("\"EPSG:2263+6360\""), "{unsaid}");
    let plane_only = level(&FEET, stated("EPSG:2263"), "EPSG:32118").unwrap_err();
    assert!(matches!(plane_only, TerrainError::HeightUnit { .. }), "{plane_only}");

    for (sheet, config, expected_m, codes) in [
        (FEET, stated("EPSG:2263+6360"), us_ft, "terrain_converted"),
        (FEET, stated("EPSG:2263+5703"), 100.0, ""),
        (Sheet { unit: "US survey foot", ..FEET }, TerrainConfig::default(), us_ft, "terrain_converted"),
        (Sheet { unit: "ft", ..FEET }, TerrainConfig::default(), ft, "terrain_converted"),
        (Sheet { unit: "metre", ..FEET }, TerrainConfig::default(), 100.0, ""),
        (Sheet { crs: "EPSG:2263+6360", ..FEET }, TerrainConfig::default(), us_ft, "terrain_converted"),
    ] {
        let (found_m, found) = level(&sheet, config, "EPSG:32118").unwrap();
        assert!((found_m - expected_m).abs() < 1e-4, "{} {:?}: {found_m}", sheet.crs, sheet.unit);
        assert_eq!(found, codes, "{} {:?}", sheet.crs, sheet.unit);
    }
    let two = Sheet { crs: "EPSG:2263+6360", unit: "metre", ..FEET };
    assert!(matches!(level(&two, TerrainConfig::default(), "EPSG:32118"), Err(TerrainError::TwoUnits { .. })));
    let odd = Sheet { unit: "fathom", ..FEET };
    assert!(matches!(level(&odd, TerrainConfig::default(), "EPSG:32118"), Err(TerrainError::NotMetres { .. })));

    // One vertical datum in two units needs no offset; another datum does.
    let navd88 = Sheet { crs: "EPSG:2263+6360", ..FEET };
    let (found_m, _) = level(&navd88, TerrainConfig::default(), "EPSG:32118+5703").unwrap();
    assert!((found_m - us_ft).abs() < 1e-4, "{found_m}");
    let ngvd29 = Sheet { crs: "EPSG:2263+5702", ..FEET };
    let other = level(&ngvd29, TerrainConfig::default(), "EPSG:32118+5703").unwrap_err();
    assert!(matches!(other, TerrainError::VerticalReference { .. }), "{other}");
    let offset = TerrainConfig { vertical_offset_m: Some(0.5), ..TerrainConfig::default() };
    assert!((level(&ngvd29, offset, "EPSG:32118+5703").unwrap().0 - us_ft - 0.5).abs() < 1e-4);
}

#[test]
fn of_several_bands_the_first_is_read_and_that_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.tif");
    let driver = DriverManager::get_driver_by_name("GTiff").unwrap();
    let mut dataset = driver.create_with_band_type::<f32, _>(&path, 60, 60, 2).unwrap();
    dataset.set_geo_transform(&[699_900.0, 10.0, 0.0, 5_764_500.0, 0.0, -10.0]).unwrap();
    dataset.set_spatial_ref(&SpatialRef::from_definition("EPSG:25832").unwrap()).unwrap();
    for (number, z) in [(1, 72.0), (2, 5.0)] {
        let cells = Buffer::new((60, 60), vec![z; 3600]);
        dataset.rasterband(number).unwrap().write((0, 0), (60, 60), &mut cells.clone()).unwrap();
    }
    drop(dataset);
    let config = TerrainConfig { dtm: Some(path), margin_m: 10.0, ..TerrainConfig::default() };
    let area = MapBox::around([(700_000.0, 5_764_100.0), (700_100.0, 5_764_200.0)]).unwrap();
    let loaded = load_with_issues(&config, &crs("EPSG:25832"), area).unwrap();
    assert_eq!(loaded.terrain.height_at(700_050.0, 5_764_150.0), Some(72.0));
    let [told] = &loaded.issues[..] else { panic!("{:?}", loaded.issues) };
    assert!(told.code == "terrain_has_bands" && told.message.contains("2 bands"), "{told:?}");
}

#[test]
fn voids_without_a_tag_are_no_ground_at_any_cell_size_and_in_any_grid() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dtm.tif");
    let metres = Sheet { crs: "EPSG:32118", unit: "", corner: (299_950.0, 65_070.0), cell: 2.0 };
    let houses = [(10, 10), (30, 20), (20, 40)];
    let is_house =
        |col: i32, row: i32| houses.iter().any(|(x, y)| (*x..x + 6).contains(&col) && (*y..y + 4).contains(&row));
    for (void, code) in [(-9999.0, "terrain_voids"), (0.0, "terrain_filled_in"), (6.0, "terrain_filled_in")] {
        write_sheet(&path, &metres, |col, row| if is_house(col, row) { void } else { 24.0 + 0.1 * col as f32 });
        for (min_cell_m, project, area) in [
            (0.5, "EPSG:32118", LONG_ISLAND),
            (5.0, "EPSG:32118", LONG_ISLAND),
            (
                0.5,
                "EPSG:26918",
                MapBox { west_m: 584_400.0, south_m: 4_511_690.0, east_m: 584_465.0, north_m: 4_511_760.0 },
            ),
        ] {
            let config = TerrainConfig { min_cell_m, margin_m: 0.0, ..TerrainConfig::dtm(&path) };
            let loaded = match load_with_issues(&config, &crs(project), area) {
                Ok(loaded) => loaded,
                Err(e) => panic!("{void} {project}: {e}"),
            };
            let (low, high) = loaded.terrain.range().unwrap();
            assert!(low > 23.9 && high < 30.1, "{void} at {min_cell_m} m in {project}: {low} to {high}");
            let codes: Vec<&str> = loaded.issues.iter().map(|issue| issue.code.as_str()).collect();
            assert_eq!(codes, [code], "{void} at {min_cell_m} m in {project}");
        }
        let config = TerrainConfig { margin_m: 0.0, ..TerrainConfig::dtm(&path) };
        let loaded = load_with_issues(&config, &crs("EPSG:32118"), LONG_ISLAND).unwrap();
        // The house at column 10, row 10: 299,970 to 299,982 east, 65,042 to 65,050 north.
        let house = geo_types::Rect::new((299_971.5, 65_043.5), (299_980.5, 65_048.5)).to_polygon();
        let (level, issue) = ground_under(&loaded.terrain, &"a".into(), &house, GroundConfig::default());
        assert!((level.unwrap().reference_m - 25.0).abs() < 1.5, "{void}: {level:?}");
        assert_eq!(issue.unwrap().code, "ground_from_around", "{void}");
    }
}

#[test]
fn averages_of_cells_are_those_of_gdal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dtm.tif");
    let metres = Sheet { crs: "EPSG:32118", unit: "", corner: (299_970.0, 65_060.0), cell: 1.0 };
    write_sheet(&path, &metres, |col, row| 24.0 + 0.03 * (col * col) as f32 + 0.2 * row as f32);
    let area = MapBox { west_m: 299_970.0, south_m: 65_000.0, east_m: 300_030.0, north_m: 65_060.0 };
    let config = TerrainConfig { min_cell_m: 3.0, margin_m: 0.0, ..TerrainConfig::dtm(&path) };
    let Terrain::Grid(dem) = load(&config, &crs("EPSG:32118"), area).unwrap() else { panic!("a grid") };
    let file = RasterFile::open(&path).unwrap();
    let whole = CellWindow { col: 0, row: 0, width: 60, height: 60 };
    let gdal = file.read_window(1, whole, (20, 20), Resampling::Average).unwrap();
    let differences = dem.heights_m().data().iter().zip(gdal.data()).map(|(a, b)| (a - b).abs());
    assert!(dem.heights_m().width() == 20 && differences.fold(0.0, f32::max) < 1e-4);
}

/// Height of a raster between the centres of four cells, by its definition.
fn between_cells(cells: &Buffer<f64>, [west, size_m, north]: [f64; 3], x: f64, y: f64) -> f64 {
    let (width, _) = cells.shape();
    let (col, row) = ((x - west) / size_m - 0.5, (north - y) / size_m - 0.5);
    let at = |dc: f64, dr: f64| cells.data()[(row.floor() + dr) as usize * width + (col.floor() + dc) as usize];
    let (u, v) = (col.fract(), row.fract());
    let upper = (1.0 - u) * at(0.0, 0.0) + u * at(1.0, 0.0);
    (1.0 - v) * upper + v * ((1.0 - u) * at(0.0, 1.0) + u * at(1.0, 1.0))
}

#[test]
fn a_run_states_the_lowest_and_the_highest_ground_along_each_outline() {
    let scene = Scene::new();
    assert_eq!(scene.run(&[]).code, 0);
    let dtm = gdal::Dataset::open(scene.path("dtm.tif")).unwrap();
    let [west, size_m, _, north, _, down_m] = dtm.geo_transform().unwrap();
    assert_eq!(size_m, -down_m);
    let band = dtm.rasterband(1).unwrap();
    let cells = band.read_as::<f64>((0, 0), band.size(), band.size(), None).unwrap();
    let mut falls_m = Vec::new();
    let file = RecordFile::open(&scene.path("result/city.gpkg"), ReadOptions::default()).unwrap();
    file.visit(&mut |record| {
        let outline = record.footprint.as_ref().unwrap().exterior();
        let places = Euclidean.densify(outline, 0.05);
        let ground = places.0.iter().map(|at| between_cells(&cells, [west, size_m, north], at.x, at.y));
        let ground: Vec<f64> = ground.collect();
        let [low_m, high_m] =
            [ground.iter().copied().fold(f64::INFINITY, f64::min), ground.iter().copied().fold(f64::MIN, f64::max)];
        let [stated_low_m, stated_high_m] = record.ground_ends_z_m.unwrap();
        // A metre between places; the file has millimetres.
        assert!((stated_low_m - low_m).abs() < 0.01 && (stated_high_m - high_m).abs() < 0.01, "{record:?}");
        falls_m.push(high_m - low_m);
        Ok(())
    })
    .unwrap();
    assert!(falls_m.len() >= 6 && falls_m.iter().any(|fall_m| *fall_m > 0.2), "{falls_m:?}");
}
