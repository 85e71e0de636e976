//! `sizeup evaluate`: a result against a reference.

use std::path::PathBuf;

use clap::Args;

use super::{Failure, Global, print, print_json};
use crate::crs::Crs;
use crate::evaluate::read::{TruthOptions, crs_of, read_results, read_truth};
use crate::evaluate::{HeightEvaluation, HeightOptions, evaluate_heights};

/// Arguments of `sizeup evaluate`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup evaluate result/city.city.json truth.geojson
  sizeup evaluate result/city.gpkg lod2.city.json --height ridge --json")]
pub struct EvaluateArgs {
    /// Result: CityJSON, or a vector layer with a height attribute.
    pub result: PathBuf,
    /// Reference: CityJSON of any version and level of detail, or a vector layer with a height attribute.
    pub truth: PathBuf,
    /// Height attribute of the reference, metres above ground.
    #[arg(long, value_name = "NAME")]
    pub height_field: Option<String>,
    /// Id attribute of the reference.
    #[arg(long, value_name = "NAME")]
    pub id_field: Option<String>,
    /// Attribute of the reference that tells kinds of buildings apart.
    #[arg(long, value_name = "NAME", default_value = "type")]
    pub group_field: String,
    /// CRS to compare in (default: the result's).
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,
}

pub(super) fn run(args: &EvaluateArgs, global: &Global) -> Result<u8, Failure> {
    let bad_input = |e: &dyn std::error::Error| Failure::new(3, e);
    let crs = match &args.crs {
        Some(definition) => Crs::parse(definition).map_err(|e| Failure::new(2, &e))?,
        None => crs_of(&args.result).map_err(|e| bad_input(&e))?,
    };
    let options = TruthOptions {
        height_field: args.height_field.clone(),
        id_field: args.id_field.clone(),
        group_field: args.group_field.clone(),
        ..TruthOptions::default()
    };
    let evaluation = evaluate(args, &options, &crs)?;
    if global.json {
        print_json(&evaluation)?;
    } else {
        print(&evaluation)?;
    }
    Ok(0)
}

fn evaluate(args: &EvaluateArgs, options: &TruthOptions, crs: &Crs) -> Result<HeightEvaluation, Failure> {
    let truth = read_truth(&args.truth, options, crs).map_err(|e| Failure::new(3, &e))?;
    let results = read_results(&args.result, crs).map_err(|e| Failure::new(3, &e))?;
    evaluate_heights(&results, &truth.buildings, &HeightOptions::default()).map_err(|e| Failure::new(3, &e))
}
