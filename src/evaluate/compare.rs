//! A result's file against a reference's file: every measure that the two allow.

use std::path::{Path, PathBuf};

use geo_types::MultiPolygon;
use glam::DVec3;

use super::clouds::{CloudTruthOptions, truth_of_instances, truth_under_outlines};
use super::footprints::{FootprintEvaluation, evaluate_footprints};
use super::heights::{HeightEvaluation, HeightOptions, evaluate_heights};
use super::parts::joined;
use super::pictures::write_pictures;
use super::read::{TruthOptions, crs_of, read_outlines, read_results, read_truth, read_truth_outlines};
use super::report::EvaluationReport;
use super::solid::{Facet, SolidError, Solids, read_solids};
use super::surface::{Target, evaluate_surface};
use super::volume::evaluate_volume;
use super::{EvaluationError, TruthBuilding};
use crate::cloud::{self, Cloud, CloudError, points_in};
use crate::crs::{Crs, CrsError, Transform};
use crate::output::read::{ReadError, height_unit_m};
use crate::output::{BuildingRecord, OutputError};

/// Two files and how to read them.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The result.
    pub result: PathBuf,
    /// The reference.
    pub truth: PathBuf,
    /// CRS to compare in; the result's by default.
    pub crs: Option<Crs>,
    /// What to read of the reference; its `crs` is for a file that states none.
    pub options: TruthOptions,
    /// How heights are taken from a point cloud.
    pub cloud: CloudTruthOptions,
    /// How buildings are matched.
    pub heights: HeightOptions,
    /// Whether the user declares that levels of both files count from the same zero.
    pub has_same_vertical: bool,
    /// Whether outlines, surfaces and volumes are compared too.
    pub with_shapes: bool,
    /// Folder for pictures; none by default.
    pub pictures: Option<PathBuf>,
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
    /// A picture cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Nothing matches.
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
    /// A CRS that is no CRS, or that nothing leads to.
    #[error("cannot bring {} to the project's CRS", path.display())]
    Crs {
        /// The file.
        path: PathBuf,
        /// Why not.
        #[source]
        source: CrsError,
    },
}

/// What the reference is, read.
enum Reference {
    /// Points, levels in metres, and what these count from where the file's CRS says so.
    Cloud(Cloud, Option<String>),
    Solids,
}

/// Compares two files.
///
/// # Errors
/// [`CompareError`]. Measures that the files do not allow are listed in the report, with the reason.
pub fn compare_files(c: &Comparison) -> Result<EvaluationReport, CompareError> {
    let stated = c.options.crs.as_deref().map(Crs::parse).transpose().map_err(|source| crs_error(&c.truth, source))?;
    let crs = match &c.crs {
        Some(crs) => crs.clone(),
        None if is_obj(&c.result) => return Err(ReadError::NoCrs { path: c.result.clone() }.into()),
        None => crs_of(&c.result)?,
    };
    let reference = if cloud::is_cloud(&c.truth) {
        let (cloud, vertical) = read_cloud(&c.truth, stated.as_ref(), &crs)?;
        Reference::Cloud(cloud, vertical)
    } else {
        Reference::Solids
    };
    let mut report =
        EvaluationReport { heights: None, footprints: None, surface: None, volume: None, left_out: Vec::new() };
    let results = if is_obj(&c.result) { None } else { Some(results_of(c, &crs, &mut report)?) };
    match &results {
        Some(results) if !is_obj(&c.truth) => {
            let truth = truth_of(c, results, &reference, &crs, &mut report)?;
            if report.left_out.is_empty() {
                report.heights = Some(evaluate_heights(results, &truth, &c.heights)?);
            }
            match &reference {
                Reference::Cloud(cloud, _) if cloud.instances.is_empty() => report.left_out.push(
                    "outlines and match rates: the point cloud has no buildings of its own and was cut by the result's outlines"
                        .to_owned(),
                ),
                Reference::Cloud(..) => report
                    .left_out
                    .push("outlines: a point cloud's are the hulls of its points, which fill every corner".to_owned()),
                Reference::Solids if c.with_shapes => report.footprints = Some(footprints(results, &truth)),
                Reference::Solids => {}
            }
        }
        _ => report
            .left_out
            .push("heights and outlines: an OBJ file has bodies only, no outlines and no ground".to_owned()),
    }
    if let (Some(folder), Some(heights), Some(results)) = (&c.pictures, &report.heights, &results) {
        write_pictures(folder, heights, results)?;
    }
    if c.with_shapes
        && let Err(why) = bodies(c, &reference, stated.as_ref(), &crs, results.as_deref(), &mut report)
    {
        // Heights and outlines can be compared without bodies; bodies that nothing else stands in for are the point of the
        // call.
        if report.heights.is_none() && report.footprints.is_none() {
            return Err(why);
        }
        let why = why.to_string().replace("\nhint:", " (hint:");
        let closing = if why.contains("(hint:") { ")" } else { "" };
        report.left_out.push(format!("surfaces and volumes: {why}{closing}"));
    }
    Ok(report)
}

fn crs_error(path: &Path, source: CrsError) -> CompareError {
    CompareError::Crs { path: path.to_owned(), source }
}

fn is_obj(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"))
}

/// A cloud in the project's CRS, levels in metres, and what these count from.
fn read_cloud(path: &Path, stated: Option<&Crs>, project: &Crs) -> Result<(Cloud, Option<String>), CompareError> {
    let mut cloud = cloud::read(path)?;
    let own = cloud.crs.as_deref().map(Crs::parse).transpose().map_err(|source| crs_error(path, source))?;
    // Many a file states where its points are, and not what their levels are: users may add that.
    let adds_heights = |(own, stated): &(&Crs, &Crs)| {
        own.height_unit_m().is_none()
            && stated.height_unit_m().is_some()
            && own.horizontal_epsg() == stated.horizontal_epsg()
    };
    let fuller = own.as_ref().zip(stated).filter(adds_heights).map(|(_, stated)| stated);
    let from = fuller.or(own.as_ref()).or(stated).ok_or_else(|| ReadError::NoCrs { path: path.to_owned() })?;
    let unit_m = height_unit_m(path, from)?;
    let transform = Transform::new(from, project).map_err(|source| crs_error(path, source))?;
    for p in &mut cloud.points {
        (p.x, p.y) = transform.point(p.x, p.y).map_err(|source| crs_error(path, source))?;
        p.z *= unit_m;
    }
    Ok((cloud, from.vertical_name().map(str::to_owned)))
}

/// Whether a file has no heights, and outlines alone are wanted too.
fn has_outlines_only(c: &Comparison, error: &ReadError) -> bool {
    c.with_shapes && c.options.height_field.is_none() && matches!(error, ReadError::NoField { what: "height", .. })
}

/// Buildings of the result; one without heights is told of in the report.
fn results_of(c: &Comparison, crs: &Crs, report: &mut EvaluationReport) -> Result<Vec<BuildingRecord>, CompareError> {
    match read_results(&c.result, crs) {
        Err(e) if has_outlines_only(c, &e) => {
            report.left_out.push(format!("heights: {} has none", c.result.display()));
            Ok(read_outlines(&c.result, crs)?)
        }
        read => Ok(read?),
    }
}

/// Buildings of the reference; one without heights is told of in the report.
fn truth_of(
    c: &Comparison,
    results: &[BuildingRecord],
    reference: &Reference,
    crs: &Crs,
    report: &mut EvaluationReport,
) -> Result<Vec<TruthBuilding>, CompareError> {
    Ok(match reference {
        Reference::Cloud(cloud, _) if !cloud.instances.is_empty() => truth_of_instances(cloud, &c.cloud),
        Reference::Cloud(cloud, _) => truth_under_outlines(cloud, &outlines_of(results), &c.cloud),
        Reference::Solids => match read_truth(&c.truth, &c.options, crs) {
            Err(e) if has_outlines_only(c, &e) => {
                report.left_out.push(format!("heights: {} has none", c.truth.display()));
                read_truth_outlines(&c.truth, &c.options, crs)?.buildings
            }
            read => read?.buildings,
        },
    })
}

/// Outlines against outlines; parts of one building as one, where the reference has it as one.
fn footprints(results: &[BuildingRecord], truth: &[TruthBuilding]) -> FootprintEvaluation {
    let none = || MultiPolygon::new(Vec::new());
    let found: Vec<MultiPolygon<f64>> =
        joined(results, truth).iter().map(|r| r.footprint.clone().map_or_else(none, Into::into)).collect();
    let wanted: Vec<MultiPolygon<f64>> = truth.iter().map(|t| t.footprint.clone().unwrap_or_else(none)).collect();
    evaluate_footprints(&found, &wanted)
}

fn outlines_of(results: &[BuildingRecord]) -> Vec<(String, MultiPolygon<f64>)> {
    let outline = |r: &BuildingRecord| Some((r.id.clone(), MultiPolygon::new(vec![r.footprint.clone()?])));
    results.iter().filter_map(outline).collect()
}

/// Surfaces and volumes, into the report.
fn bodies(
    c: &Comparison,
    reference: &Reference,
    stated: Option<&Crs>,
    crs: &Crs,
    results: Option<&[BuildingRecord]>,
    report: &mut EvaluationReport,
) -> Result<(), CompareError> {
    let result = read_solids(&c.result, None, Some(crs), crs)?;
    let truth = match reference {
        Reference::Cloud(..) => None,
        Reference::Solids => Some(read_solids(&c.truth, c.options.lod.as_deref(), stated, crs)?),
    };
    let truth_vertical = match (reference, &truth) {
        (Reference::Cloud(_, vertical), _) => vertical.clone(),
        (Reference::Solids, solids) => solids.as_ref().and_then(|s| s.vertical.clone()),
    };
    if let Some(objection) = vertical_objection(c, result.vertical.as_deref(), truth_vertical.as_deref()) {
        report.left_out.push(format!("surfaces and volumes: {objection}"));
        return Ok(());
    }
    let facets = |solids: &Solids| solids.solids.iter().flat_map(|s| s.facets.iter().copied()).collect::<Vec<Facet>>();
    match (reference, &truth) {
        (Reference::Cloud(cloud, _), _) => {
            let outlines: Vec<_> = results.map(outlines_of).unwrap_or_default().into_iter().map(|o| o.1).collect();
            let of_outlines: Vec<DVec3> =
                points_in(&cloud.of_buildings(), &outlines, 0.0).into_iter().flatten().collect();
            report.surface = evaluate_surface(&facets(&result), &Target::Points(&of_outlines), c.seed);
            report.left_out.push("volumes: a point cloud encloses none".to_owned());
        }
        (Reference::Solids, Some(truth)) => {
            report.surface = evaluate_surface(&facets(&result), &Target::Facets(&facets(truth)), c.seed);
            let matched = matched(report.heights.as_ref(), &result, truth);
            match evaluate_volume(&result.solids, &truth.solids, &matched) {
                Ok(volume) => report.volume = Some(volume),
                Err(why) => report.left_out.push(format!("volumes: {why}")),
            }
        }
        (Reference::Solids, None) => {}
    }
    Ok(())
}

/// Why levels of both files may not be compared.
fn vertical_objection(c: &Comparison, result: Option<&str>, truth: Option<&str>) -> Option<String> {
    match (result, truth) {
        _ if c.has_same_vertical => None,
        (Some(a), Some(b)) if a == b => None,
        (Some(a), Some(b)) => Some(format!(
            "levels of the result count from {a}, those of the reference from {b} (hint: transform one of them, or declare \
             that they are the same with --same-vertical)"
        )),
        (a, _) => Some(format!(
            "{} does not say what its levels count from (hint: declare that both count from the same zero with \
             --same-vertical)",
            if a.is_none() { c.result.display() } else { c.truth.display() }
        )),
    }
}

/// Positions of matched bodies: as the heights were matched, else by id.
fn matched(heights: Option<&HeightEvaluation>, result: &Solids, truth: &Solids) -> Vec<(usize, usize)> {
    let position = |solids: &Solids, id: &str| solids.solids.iter().position(|s| s.id == id);
    match heights {
        Some(heights) => {
            let pair =
                |b: &super::BuildingError| Some((position(result, &b.result_id)?, position(truth, &b.truth_id)?));
            heights.buildings.iter().filter_map(pair).collect()
        }
        None => {
            let pair = |(i, s): (usize, &super::solid::Solid)| Some((i, position(truth, &s.id)?));
            result.solids.iter().enumerate().filter_map(pair).collect()
        }
    }
}
