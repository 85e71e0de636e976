//! Surfaces and volumes of two files, once their levels count from the same zero.

use glam::DVec3;

use super::compare::{CompareError, ComparedFiles, Reference, footprints_of};
use super::heights::HeightEvaluation;
use super::levels::{LevelAlignment, Stated, no_way};
use super::report::EvaluationReport;
use super::solid::{Facet, Solids, read_solids};
use super::surface::{TargetSurface, evaluate_surface};
use super::volume::evaluate_volume;
use sizeup_geo::cloud::points_in;
use sizeup_geo::crs::{Crs, CrsError, VerticalReference};
use sizeup_results::output::BuildingRecord;

/// Surfaces and volumes, into the report.
pub(super) fn bodies(
    c: &ComparedFiles,
    reference: &Reference,
    stated: Option<&Crs>,
    crs: &Crs,
    results: Option<&[BuildingRecord]>,
    report: &mut EvaluationReport,
) -> Result<(), CompareError> {
    let result = read_solids(&c.result, None, Some(crs), crs)?;
    match reference {
        Reference::Cloud(cloud, vertical) => {
            let footprints: Vec<_> = results.map(footprints_of).unwrap_or_default().into_iter().map(|o| o.1).collect();
            let mut points: Vec<DVec3> =
                points_in(&cloud.of_buildings(), &footprints, 0.0).into_iter().flatten().collect();
            let sides = [result.vertical.as_ref(), vertical.as_ref()];
            align(c, sides, crs, report, |alignment| alignment.move_points(&mut points))?;
            report.surface = evaluate_surface(&facets(&result), &TargetSurface::Points(&points), c.seed);
            report.left_out.push("volumes: a point cloud encloses none".to_owned());
        }
        Reference::Solids => {
            let mut truth = read_solids(&c.truth, c.options.lod.as_deref(), stated, crs)?;
            let vertical = truth.vertical.clone();
            let sides = [result.vertical.as_ref(), vertical.as_ref()];
            align(c, sides, crs, report, |alignment| alignment.move_solids(&mut truth.solids))?;
            report.surface = evaluate_surface(&facets(&result), &TargetSurface::Facets(&facets(&truth)), c.seed);
            let matched = matched(report.heights.as_ref(), &result, &truth);
            match evaluate_volume(&result.solids, &truth.solids, &matched) {
                Ok(volume) => report.volume = Some(volume),
                Err(why) => report.left_out.push(format!("volumes: {why}")),
            }
        }
    }
    Ok(())
}

/// Moves levels of the reference to those of the result, and says so in the report.
fn align(
    c: &ComparedFiles,
    [result, reference]: [Option<&VerticalReference>; 2],
    crs: &Crs,
    report: &mut EvaluationReport,
    apply: impl FnOnce(&mut LevelAlignment) -> Result<(), CrsError>,
) -> Result<(), CompareError> {
    let files = [&c.result, &c.truth].map(|path| path.display().to_string());
    let mut alignment = LevelAlignment::of(&Stated { result, reference, shift_m: c.level_shift_m, files }, crs)?;
    // A grid can turn out to be missing only here: PROJ looks for it when it sees the place.
    apply(&mut alignment).map_err(|source| match (reference, result) {
        (Some(from), Some(to)) => no_way(from, to, source).into(),
        _ => CompareError::Crs { path: c.truth.clone(), source },
    })?;
    report.levels = Some(alignment.agreement());
    Ok(())
}

fn facets(solids: &Solids) -> Vec<Facet> {
    solids.solids.iter().flat_map(|solid| solid.facets.iter().copied()).collect()
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
