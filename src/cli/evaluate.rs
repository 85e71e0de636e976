//! `sizeup evaluate`: a result against a reference.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::ui::warn_of_unfinished;
use super::{Failure, Global, print, print_json};
use sizeup_geo::crs::Crs;
use sizeup_lab::evaluate::read::TruthOptions;
use sizeup_lab::evaluate::{CloudTruthOptions, Comparison, HeightOptions, compare_files};
use sizeup_results::output::HeightReference;

/// Arguments of `sizeup evaluate`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup evaluate result/city.city.json truth.geojson
  sizeup evaluate result/city.gpkg lod2.city.json --height-reference ridge --json
  sizeup evaluate result/city.city.json lod2.city.json --same-vertical
  sizeup evaluate result/city.city.json lidar.laz --truth-crs EPSG:7415")]
pub struct EvaluateArgs {
    /// Result: CityJSON, a vector layer with a height attribute, or OBJ.
    pub result: PathBuf,
    /// Reference: CityJSON of any version and level of detail, a vector layer with a height attribute, OBJ, or a point
    /// cloud (LAS, LAZ, or XYZ with instance ids).
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
    /// Which height of the reference's pitched roofs counts, where it is measured on surfaces.
    #[arg(long, value_name = "WHICH", default_value = "mean")]
    pub height_reference: HeightReferenceArg,
    /// Level of detail of the reference's geometry (default: its highest).
    #[arg(long, value_name = "LOD")]
    pub lod: Option<String>,
    /// CRS to compare in, projected and in metres (default: the result's). Its vertical part says what levels of a result
    /// count from that does not say so.
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,
    /// CRS of a reference that states none, or none with a vertical part.
    #[arg(long, value_name = "CRS")]
    pub truth_crs: Option<String>,
    /// Declare that levels of both files count from the same zero, so that surfaces and volumes can be compared.
    #[arg(long)]
    pub same_vertical: bool,
    /// Metres to add to levels of the reference so that they count from the result's zero, where PROJ lacks the grid.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, conflicts_with = "same_vertical")]
    pub level_shift: Option<f64>,
    /// Compare heights only: no outlines, surfaces and volumes.
    #[arg(long)]
    pub heights_only: bool,
    /// Draw a map of the errors and the reliability of the stated sigmas into this folder.
    #[arg(long, value_name = "FOLDER")]
    pub pictures: Option<PathBuf>,
    /// Percentile of a point cloud's roof points that counts as the height, 0 to 100.
    #[arg(long, value_name = "PERCENT", default_value_t = 50.0)]
    pub roof_percentile: f64,
    /// Level of the ground of a point cloud without ground points, metres.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub ground: Option<f64>,
}

/// Which height of a pitched roof, on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum HeightReferenceArg {
    /// Where the roof meets the walls.
    Eave,
    /// The mean over the roof's area.
    Mean,
    /// The highest line.
    Ridge,
}

pub(super) fn run(args: &EvaluateArgs, global: &Global) -> Result<u8, Failure> {
    warn_of_unfinished(&args.result, global);
    let parse = |definition: &String| Crs::parse(definition).map_err(|e| Failure::new(2, &e));
    if !(0.0..=100.0).contains(&args.roof_percentile) {
        return Err(Failure::from_text(2, format!("--roof-percentile {}: expected 0 to 100", args.roof_percentile)));
    }
    // A wrong definition is a wrong call, whatever the files are.
    args.truth_crs.as_ref().map(parse).transpose()?;
    let comparison = Comparison {
        result: args.result.clone(),
        truth: args.truth.clone(),
        crs: args.crs.as_ref().map(parse).transpose()?,
        options: TruthOptions {
            height_field: args.height_field.clone(),
            id_field: args.id_field.clone(),
            group_field: args.group_field.clone(),
            height_reference: match args.height_reference {
                HeightReferenceArg::Eave => HeightReference::Eave,
                HeightReferenceArg::Mean => HeightReference::Mean,
                HeightReferenceArg::Ridge => HeightReference::Ridge,
            },
            lod: args.lod.clone(),
            crs: args.truth_crs.clone(),
            ..TruthOptions::default()
        },
        cloud: CloudTruthOptions {
            roof_percentile: args.roof_percentile,
            ground_m: args.ground,
            ..CloudTruthOptions::default()
        },
        heights: HeightOptions::default(),
        level_shift_m: args.level_shift.or(args.same_vertical.then_some(0.0)),
        with_shapes: !args.heights_only,
        pictures: args.pictures.clone(),
        seed: 0,
    };
    let report = compare_files(&comparison).map_err(|e| Failure::new(3, &e))?;
    if global.json {
        print_json(&report)?;
    } else {
        print(&report)?;
    }
    Ok(0)
}
