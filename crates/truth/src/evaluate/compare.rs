//! A result's file against a reference's file: every measure that the two allow.

use std::error::Error;
use std::path::{Path, PathBuf};

use super::bodies::bodies;
use super::cloud_file::read_cloud;
use super::clouds::{CloudTruthOptions, truth_of_instances, truth_under_footprints};
use super::farthest;
use super::footprints::{FootprintEvaluation, evaluate_footprints};
use super::heights::{HeightOptions, evaluate_heights};
use super::levels::LevelError;
use super::parts::joined;
use super::pictures::write_pictures;
use super::read::{Truth, TruthOptions, crs_of, read_footprints, read_results, read_truth, read_truth_footprints};
use super::report::EvaluationReport;
use super::solid::SolidError;
use super::{EvaluationError, TruthBuilding};
use geo_types::MultiPolygon;
use sizeup_geo::cloud::{self, Cloud, CloudError};
use sizeup_geo::crs::{Crs, CrsError, VerticalReference};
use sizeup_results::output::read::ReadError;
use sizeup_results::output::{BuildingRecord, OutputError};
use sizeup_survey::View;

/// Two files and how to read them.
#[derive(Debug, Clone)]
pub struct ComparedFiles {
    /// Path of the result.
    pub result: PathBuf,
    /// Path of the reference.
    pub truth: PathBuf,
    /// CRS to compare in; the result's by default.
    pub crs: Option<Crs>,
    /// Options for reading the reference; its `crs` is for a file that states none.
    pub options: TruthOptions,
    /// Settings of heights from a point cloud.
    pub cloud: CloudTruthOptions,
    /// Rule that matches buildings.
    pub heights: HeightOptions,
    /// Shift declared by the user for levels of the reference so that they count from the result's zero, metres; 0
    /// if that is the same. Not declared: by what the files say.
    pub level_shift_m: Option<f64>,
    /// Whether footprints, surfaces and volumes are compared too.
    pub with_shapes: bool,
    /// Folder for pictures; none by default.
    pub pictures: Option<PathBuf>,
    /// Photos of the result's run, in the CRS to compare in: the buildings that are farthest off are pictured in them.
    pub views: Vec<View>,
    /// Seed of the surface samples.
    pub seed: u64,
}

/// Why two files cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// A file cannot be read, or has no CRS or height.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A point cloud cannot be read.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// A body file cannot be read.
    #[error(transparent)]
    Solid(#[from] SolidError),
    /// Levels cannot be brought together.
    #[error(transparent)]
    Levels(#[from] LevelError),
    /// A picture cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// No building of one matches any of the other.
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
    /// The CRS to compare in has no metres.
    #[error("{} cannot be compared in this CRS\nhint: name one to compare in with --crs", path.display())]
    Frame {
        /// Path of the result's file.
        path: PathBuf,
        /// Why its positions cannot be brought there.
        #[source]
        source: CrsError,
    },
    /// A CRS that is no CRS, or that nothing leads to.
    #[error("cannot bring {} to the project's CRS", path.display())]
    Crs {
        /// The file that is compared.
        path: PathBuf,
        /// Why its positions cannot be brought there.
        #[source]
        source: CrsError,
    },
}

/// Buildings of the reference as its file has them.
pub(super) enum Reference {
    /// Points, levels in metres, and what these count from where the file's CRS says so.
    Cloud(Cloud, Option<VerticalReference>),
    Solids,
}

/// Compares two files.
///
/// # Errors
/// [`CompareError`]. Measures that the files do not allow are listed in the report, with the reason.
pub fn compare_files(c: &ComparedFiles) -> Result<EvaluationReport, CompareError> {
    let stated = c.options.crs.as_deref().map(Crs::parse).transpose().map_err(|source| crs_error(&c.truth, source))?;
    let crs = match &c.crs {
        Some(crs) => crs.clone(),
        None if is_obj(&c.result) => return Err(ReadError::NoCrs { path: c.result.clone() }.into()),
        None => crs_of(&c.result)?,
    };
    let in_metres = crs.require_projected_metres();
    in_metres.map_err(|source| CompareError::Frame { path: c.result.clone(), source })?;
    let reference = if cloud::is_cloud(&c.truth) {
        let (cloud, vertical) = read_cloud(&c.truth, stated.as_ref(), &crs)?;
        Reference::Cloud(cloud, vertical)
    } else {
        Reference::Solids
    };
    let mut report = EvaluationReport::default();
    let results = if is_obj(&c.result) { None } else { Some(results_of(c, &crs, &mut report)?) };
    match &results {
        Some(results) if !is_obj(&c.truth) => {
            let truth = truth_of(c, results, &reference, &crs, &mut report)?;
            if report.left_out.is_empty() {
                let heights = report.heights.insert(evaluate_heights(results, &truth, &c.heights)?);
                if let Some(folder) = &c.pictures {
                    write_pictures(folder, heights, results)?;
                    report.left_out.extend(farthest::write(folder, heights, results, &truth, &c.views)?);
                }
            }
            match &reference {
                Reference::Cloud(cloud, _) if cloud.instances.is_empty() => report.left_out.push(
                    "footprints and match rates: the point cloud has no buildings of its own and was cut by the result's footprints"
                        .to_owned(),
                ),
                Reference::Cloud(..) => report
                    .left_out
                    .push("footprints: a point cloud's are the hulls of its points, which fill every corner".to_owned()),
                Reference::Solids if c.with_shapes => report.footprints = Some(footprints(results, &truth)),
                Reference::Solids => {}
            }
        }
        _ => report
            .left_out
            .push("heights and footprints: an OBJ file has bodies only, no footprints and no ground".to_owned()),
    }
    if c.with_shapes
        && let Err(why) = bodies(c, &reference, stated.as_ref(), &crs, results.as_deref(), &mut report)
    {
        // Heights and footprints can be compared without bodies; bodies that nothing else stands in for are the point of the
        // call.
        if report.heights.is_none() && report.footprints.is_none() {
            return Err(why);
        }
        let why = with_causes(&why).replace("\nhint:", " (hint:");
        let closing = if why.contains("(hint:") { ")" } else { "" };
        report.left_out.push(format!("surfaces and volumes: {why}{closing}"));
    }
    Ok(report)
}

/// An error and what caused it, in one line but for hints.
fn with_causes(error: &dyn Error) -> String {
    match error.source() {
        Some(cause) => format!("{error}: {}", with_causes(cause)),
        None => error.to_string(),
    }
}

pub(super) fn crs_error(path: &Path, source: CrsError) -> CompareError {
    CompareError::Crs { path: path.to_owned(), source }
}

fn is_obj(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"))
}

/// Whether a file has no heights, and footprints alone are wanted too.
fn has_footprints_only(c: &ComparedFiles, error: &ReadError) -> bool {
    c.with_shapes && c.options.height_field.is_none() && matches!(error, ReadError::NoField { what: "height", .. })
}

/// Buildings of the result; one without heights is told of in the report.
fn results_of(
    c: &ComparedFiles,
    crs: &Crs,
    report: &mut EvaluationReport,
) -> Result<Vec<BuildingRecord>, CompareError> {
    match read_results(&c.result, crs) {
        Err(e) if has_footprints_only(c, &e) => {
            report.left_out.push(format!("heights: {} has none", c.result.display()));
            Ok(read_footprints(&c.result, crs)?)
        }
        read => Ok(read?),
    }
}

/// Buildings of the reference; one without heights is told of in the report.
fn truth_of(
    c: &ComparedFiles,
    results: &[BuildingRecord],
    reference: &Reference,
    crs: &Crs,
    report: &mut EvaluationReport,
) -> Result<Vec<TruthBuilding>, CompareError> {
    let of_cloud = || format!("point cloud: {}", c.cloud);
    let truth = match reference {
        Reference::Cloud(cloud, _) if !cloud.instances.is_empty() => {
            Truth { buildings: truth_of_instances(cloud, &c.cloud), height_source: of_cloud() }
        }
        Reference::Cloud(cloud, _) => {
            let buildings = truth_under_footprints(cloud, &footprints_of(results), &c.cloud);
            Truth { buildings, height_source: of_cloud() }
        }
        Reference::Solids => match read_truth(&c.truth, &c.options, crs) {
            Err(e) if has_footprints_only(c, &e) => {
                report.left_out.push(format!("heights: {} has none", c.truth.display()));
                return Ok(read_truth_footprints(&c.truth, &c.options, crs)?.buildings);
            }
            read => read?,
        },
    };
    report.truth_heights = Some(truth.height_source);
    Ok(truth.buildings)
}

/// Footprints against footprints; parts of one building as one, where the reference has it as one.
fn footprints(results: &[BuildingRecord], truth: &[TruthBuilding]) -> FootprintEvaluation {
    let none = || MultiPolygon::new(Vec::new());
    let found: Vec<MultiPolygon<f64>> =
        joined(results, truth).iter().map(|r| r.footprint.clone().map_or_else(none, Into::into)).collect();
    let wanted: Vec<MultiPolygon<f64>> = truth.iter().map(|t| t.footprint.clone().unwrap_or_else(none)).collect();
    evaluate_footprints(&found, &wanted)
}

pub(super) fn footprints_of(results: &[BuildingRecord]) -> Vec<(String, MultiPolygon<f64>)> {
    let footprint = |r: &BuildingRecord| Some((r.id.clone(), MultiPolygon::new(vec![r.footprint.clone()?])));
    results.iter().filter_map(footprint).collect()
}
