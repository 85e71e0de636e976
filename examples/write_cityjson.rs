//! CityJSON of prisms of your own, checked as `sizeup check` checks it.
//!
//! `cargo run --release --example write_cityjson`.

#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use geo_types::polygon;
use sizeup::crs::Crs;
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::{BuildingRecord, CityModel, Lineage, validate};
use sizeup::survey::Survey;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Amersfoort / RD New with NAP heights; metres.
    let crs = Crs::parse("EPSG:7415")?;
    let barn = polygon![(x: 85_000.0, y: 447_000.0), (x: 85_020.0, y: 447_000.0), (x: 85_020.0, y: 447_012.0), (x: 85_000.0, y: 447_012.0)];
    let silo = polygon![(x: 85_030.0, y: 447_000.0), (x: 85_036.0, y: 447_000.0), (x: 85_036.0, y: 447_006.0), (x: 85_030.0, y: 447_006.0)];
    let records = [
        BuildingRecord::measured("barn", barn, -0.4, 7.5),
        BuildingRecord { height_sigma_m: Some(0.3), ..BuildingRecord::measured("silo", silo, -0.4, 18.0) },
    ];
    let model = CityModel {
        records: records.as_slice(),
        crs: &crs,
        lineage: &Lineage { crs: crs.definition().to_owned(), ..Lineage::default() },
        issues: &[],
        survey: &Survey::default(),
    };
    let path = std::env::temp_dir().join("prisms.city.json");
    cityjson::write(&path, &model, &CityJsonConfig::default())?;

    let checked = validate::validate_file(&path, &validate::ValidateConfig::default())?;
    println!("{}: {} solids, {} faults", path.display(), checked.n_geometries, checked.faults.len());
    assert!(checked.is_valid());
    Ok(())
}
