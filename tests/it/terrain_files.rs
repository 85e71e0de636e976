//! Terrain from files: in the project's CRS or another, with gaps, or not at all.

use std::path::Path;

use gdal::DriverManager;
use gdal::raster::Buffer;
use gdal::spatial_ref::SpatialRef;
use geo::Area as _;
use sizeup::crs::{Crs, Transform};
use sizeup::footprint::FootprintConfig;
use sizeup::stats;
use sizeup::terrain::{GroundConfig, MapBox, Terrain, TerrainConfig, TerrainError, ground_under, load};

use crate::shared_data::shared_data;

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
