//! `sizeup export`: a city in another format.

use std::path::{Path, PathBuf};

use clap::Args;

use super::{Failure, Global, Ui, print_json};
use crate::crs::Crs;
use crate::output::cityjson::{self, CityJsonConfig};
use crate::output::geopackage::{self, GeoPackageConfig};
use crate::output::read::{FoundBuildings, ReadOptions};
use crate::output::{CityModel, InputFile, Lineage, OutputError};
use crate::survey::Survey;

/// Arguments of `sizeup export`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup export result/city.city.json city.gpkg
  sizeup export result/city.gpkg city.city.jsonl
  sizeup export lod2.city.json lod1.city.json      anybody's file: blocks of the mean roof height

Cameras and issues are only in the files of a run: an export has the buildings with all their attributes.")]
pub struct ExportArgs {
    /// CityJSON (.json), CityJSONSeq (.jsonl) or GeoPackage; ours, or anybody's with heights.
    pub input: PathBuf,
    /// File to write; its extension says which format: .json, .jsonl or .gpkg.
    pub output: PathBuf,
    /// CRS, for an input that does not state one.
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,
}

/// A format by its file's extension.
#[derive(Clone, Copy)]
enum Format {
    CityJson,
    CityJsonSeq,
    GeoPackage,
}

pub(super) fn run(args: &ExportArgs, global: &Global) -> Result<u8, Failure> {
    let format = format_of(&args.output)?;
    let found = FoundBuildings::read(&args.input, &ReadOptions::default()).map_err(|e| Failure::new(3, &e))?;
    let crs = match (&found.crs, &args.crs) {
        (None, Some(definition)) => Crs::parse(definition).map_err(|e| Failure::new(2, &e))?,
        (Some(crs), None) => crs.clone(),
        (Some(own), Some(_)) => {
            return Err(Failure::from_text(2, format!("{} is in {own}: leave --crs out", args.input.display())));
        }
        (None, None) => {
            let name = args.input.display();
            return Err(Failure::from_text(3, format!("{name} states no CRS\nhint: name it with --crs EPSG:…")));
        }
    };
    let records = found.to_records();
    let lineage = lineage(args, &crs)?;
    let survey = Survey::default();
    let model = CityModel { records: &records, crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    write(format, &args.output, &model).map_err(|e| Failure::new(4, &e))?;
    let n_heights = records.iter().filter(|record| record.height_m.is_some()).count();
    let ui = Ui::new(global);
    ui.say(format!("{} buildings, {n_heights} with a height, in {}", records.len(), args.output.display()));
    if global.json {
        print_json(
            &serde_json::json!({ "n_buildings": records.len(), "n_heights": n_heights, "output": args.output }),
        )?;
    }
    Ok(0)
}

fn format_of(path: &Path) -> Result<Format, Failure> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    match extension.as_str() {
        "json" => Ok(Format::CityJson),
        "jsonl" => Ok(Format::CityJsonSeq),
        "gpkg" => Ok(Format::GeoPackage),
        _ => {
            let name = path.display();
            Err(Failure::from_text(2, format!("cannot write {name}\nhint: .city.json, .city.jsonl or .gpkg")))
        }
    }
}

fn write(format: Format, path: &Path, model: &CityModel<'_>) -> Result<(), OutputError> {
    match format {
        Format::CityJson => cityjson::write(path, model, &CityJsonConfig::default()),
        Format::CityJsonSeq => cityjson::write_sequence(path, model, &CityJsonConfig::default()),
        Format::GeoPackage => geopackage::write(path, model, &GeoPackageConfig::default()),
    }
}

/// The export's own origin; the input is named with its hash.
fn lineage(args: &ExportArgs, crs: &Crs) -> Result<Lineage, Failure> {
    let input = InputFile::hash("city", &args.input).map_err(|e| Failure::new(3, &e))?;
    Ok(Lineage {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        command: std::env::args().collect::<Vec<_>>().join(" "),
        inputs: vec![input],
        crs: crs.definition().to_owned(),
        vertical_reference: crs.vertical_name().unwrap_or("as in the input").to_owned(),
        height_definition: "as in the input; measured on its surfaces where it states none".to_owned(),
        ..Lineage::default()
    })
}
