//! `sizeup evaluate`: a result against a reference.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use geo::Area as _;
use geo_types::MultiPolygon;

use super::ui::{Ui, warn_of_unfinished};
use super::{Failure, Global, print, print_json};
use crate::config::{RunConfig, SAVED_NAME};
use crate::pipeline::RunSettings;
use sizeup_footprints::{Annotated, FootprintError, PhotoInstances, coco_instances, is_coco};
use sizeup_geo::crs::Crs;
use sizeup_geo::paths::file_name;
use sizeup_results::output::HeightReference;
use sizeup_results::output::read::{RESULTS, result_file};
use sizeup_survey::View;
use sizeup_truth::evaluate::read::TruthOptions;
use sizeup_truth::evaluate::{
    CloudTruthOptions, ComparedFiles, HeightOptions, PhotoAreas, compare_files, evaluate_photos,
};

/// Arguments of `sizeup evaluate`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup evaluate result/city.city.json truth.geojson
  sizeup evaluate result/city.gpkg lod2.city.json --height-reference ridge --json
  sizeup evaluate result/city.city.json lod2.city.json --same-vertical
  sizeup evaluate result/city.city.json lidar.laz --truth-crs EPSG:7415
  sizeup evaluate footprints-in-photos.json SET/test.json")]
pub struct EvaluateArgs {
    /// Result: its folder, CityJSON, a vector layer with a height attribute, or OBJ; footprints in photos as COCO.
    pub result: PathBuf,
    /// Reference: the folder of another result, CityJSON of any version and level of detail, a vector layer with a height attribute, OBJ, a point
    /// cloud (LAS, LAZ, or XYZ with instance ids), or footprints in the same photos as COCO.
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
    /// Compare heights only: no footprints, surfaces and volumes.
    #[arg(long)]
    pub heights_only: bool,
    /// Draw a map of the errors and the reliability of the stated sigmas into this folder, and beside a run's other results the
    /// buildings that are farthest off, over the run's photos.
    #[arg(long, value_name = "FOLDER")]
    pub pictures: Option<PathBuf>,
    /// Percentile of a point cloud's roof points that counts as the height, 0 to 100.
    #[arg(long, value_name = "PERCENT", default_value_t = 50.0)]
    pub roof_percentile: f64,
    /// Level of the ground of a point cloud without ground points, metres.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub ground: Option<f64>,
    /// For footprints in photos: leave out instances of the result with a lower score, 0 to 1.
    #[arg(long, value_name = "SCORE", default_value_t = 0.0)]
    pub min_score: f32,
    /// For footprints in photos: smaller ones of both files count for nothing, pixels².
    #[arg(long, value_name = "PIXELS", default_value_t = 64.0)]
    pub min_area: f64,
    /// For footprints in photos: the result has roofs, each with an "offset" in pixels from the wall's foot to the roof,
    /// by which it is moved back.
    #[arg(long)]
    pub roof_offset: bool,
}

/// Which height of a pitched roof, on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum HeightReferenceArg {
    /// Where the roof meets the walls.
    Eave,
    /// The mean over the roof's area.
    Mean,
    /// The highest line of the roof.
    Ridge,
}

pub(super) fn run(args: &EvaluateArgs, global: &Global) -> Result<u8, Failure> {
    let file = |path: &Path| result_file(path, RESULTS).map_err(|e| Failure::new(3, &e));
    let args = &EvaluateArgs { result: file(&args.result)?, truth: file(&args.truth)?, ..args.clone() };
    warn_of_unfinished(&args.result, global);
    let parse = |definition: &String| Crs::parse(definition).map_err(|e| Failure::new(2, &e));
    if !(0.0..=100.0).contains(&args.roof_percentile) {
        return Err(Failure::from_text(2, format!("--roof-percentile {}: expected 0 to 100", args.roof_percentile)));
    }
    if !(0.0..=1.0).contains(&args.min_score) || !args.min_area.is_finite() || args.min_area < 0.0 {
        let found = format!("--min-score {}, --min-area {}", args.min_score, args.min_area);
        return Err(Failure::from_text(2, format!("{found}: expected a score of 0 to 1 and an area of at least 0")));
    }
    // A wrong definition is a wrong call, whatever the files are.
    args.truth_crs.as_ref().map(parse).transpose()?;
    if is_coco(&args.truth) {
        return in_photos(args, global);
    }
    let comparison = ComparedFiles {
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
        views: if args.pictures.is_some() && args.crs.is_none() { views_of(&args.result, global) } else { Vec::new() },
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

/// The photos of the run that a result is of, with their poses; none where it does not lie in the folder of a run.
fn views_of(result: &Path, global: &Global) -> Vec<View> {
    let config = result.with_file_name(SAVED_NAME);
    if !config.is_file() {
        return Vec::new();
    }
    let config = RunConfig::load(&config, &[]).map_err(|e| e.to_string());
    match config.and_then(|config| RunSettings::of(&config).survey().map_err(|e| e.to_string())) {
        Ok(survey) => survey.views,
        Err(why) => {
            Ui::new(global).warn(format!("no building is pictured in its photos: {why}"));
            Vec::new()
        }
    }
}

/// Footprints in photos, both files COCO.
fn in_photos(args: &EvaluateArgs, global: &Global) -> Result<u8, Failure> {
    let failed = |e: FootprintError| Failure::new(3, &e);
    let annotated = if args.roof_offset { Annotated::RoofAndOffset } else { Annotated::Footprint };
    let truth = coco_instances(&args.truth, None, Annotated::Footprint, 0.0).map_err(failed)?;
    let found = coco_instances(&args.result, Some(&args.truth), annotated, args.min_score).map_err(failed)?;
    let large = |of: &PhotoInstances| -> Vec<MultiPolygon<f64>> {
        of.shapes_px.iter().filter(|s| s.unsigned_area() >= args.min_area).cloned().collect()
    };
    let mut n_listed = 0;
    let mut photos = Vec::with_capacity(truth.len());
    for photo in &truth {
        let same = |f: &&PhotoInstances| f.name == photo.name;
        let same_file = |f: &&PhotoInstances| file_name(&f.name) == file_name(&photo.name);
        let mut by_file = found.iter().filter(same_file);
        let theirs = found.iter().find(same).or_else(|| by_file.next().filter(|_| by_file.next().is_none()));
        if let Some(theirs) = theirs.filter(|theirs| theirs.size != photo.size) {
            let ([w, h], [width, height]) = (theirs.size, photo.size);
            let problem = format!("{}: {} is {w} × {h} pixels there", args.result.display(), photo.name);
            let hint = "footprints are compared in the photo's own pixels";
            return Err(Failure::from_text(3, format!("{problem}, {width} × {height} in the reference\nhint: {hint}")));
        }
        n_listed += usize::from(theirs.is_some());
        photos.push(PhotoAreas::of(&theirs.map(large).unwrap_or_default(), &large(photo)));
    }
    if n_listed == 0 {
        let problem =
            format!("{} lists none of the {} photos of {}", args.result.display(), truth.len(), args.truth.display());
        return Err(Failure::from_text(3, format!("{problem}\nhint: photos are matched by their file names")));
    }
    if n_listed < truth.len() {
        let n = truth.len() - n_listed;
        Ui::new(global).warn(format!("{n} of {} photos are not in the result: nothing found there", truth.len()));
    }
    let report = evaluate_photos(&photos);
    if global.json {
        print_json(&report)?;
    } else {
        print(&report)?;
    }
    Ok(0)
}
