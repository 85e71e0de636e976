//! A whole run whose configuration is built in code: no sizeup.toml.
//!
//! `cargo run --release --example run_configured_in_code`. A small town is simulated for it; the paths and settings of a
//! program of yours take its place.

#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use sizeup::config::{ProjectConfig, RunConfig};
use sizeup::crs::Crs;
use sizeup::footprint::{FootprintConfig, FootprintSource};
use sizeup::pipeline;
use sizeup::prior::{FilePriorConfig, PriorConfig};
use sizeup::simulate::{SimulateConfig, simulate};
use sizeup::survey::SurveyConfig;
use sizeup::terrain::TerrainConfig;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name);
    let mut town = SimulateConfig::default();
    (town.town.n_buildings, town.flight.n_views) = (6, Some(20));
    (town.camera.width_px, town.camera.height_px, town.prior.longest_px) = (160, 120, 160);
    town.images.enabled = false;
    simulate(&town, folder.path(), &|_, _| {})?;

    // The poses are local to a round number of metres, as COLMAP wants them.
    let georef: serde_json::Value = serde_json::from_slice(&std::fs::read(path("georef.json"))?)?;
    let offset = serde_json::from_value(georef["offset"].clone())?;
    let footprints =
        FootprintConfig { id_field: Some("id".to_owned()), ..FootprintConfig::new(path("footprints.gpkg")) };
    let priors = FilePriorConfig::new(path("priors/{stem}.npy").to_string_lossy(), town.prior.kind);
    let mut config = RunConfig::new(
        ProjectConfig::new(Crs::parse(&town.crs)?, path("result")),
        SurveyConfig { offset, ..SurveyConfig::at(path("sparse")) },
        FootprintSource::Layer(footprints),
        TerrainConfig::dtm(path("dtm.tif")),
        PriorConfig::Files(priors),
    );
    config.output.pictures = false;

    let city = pipeline::city(&config, &|_| {})?;
    for building in &city.records {
        println!("{}\t{:.2} m\t{}", building.id, building.height_m.unwrap_or(f64::NAN), building.status.as_str());
    }
    assert!(path("result").join("city.city.json").is_file(), "the files of a run are there too");
    Ok(())
}
