//! The data of the page, which its script reads.

use crate::output::grid::SCALE_M;
use std::collections::HashMap;

use serde::Serialize;

use super::backdrop::BackdropData;
use super::city::{GroundHeights, MapBuilding, origin, round_cm};
use super::evidence::{EvidenceData, data_uri};
use super::{LevelFit, Report, ViewUse};
use crate::output::grid::OutputGrid;
use crate::output::reports::Summary;
use crate::output::{BuildingRecord, Lineage, StatusCount};
use sizeup_geo::issue::Issue;
use sizeup_survey::{SurveyReport, View, ViewKind, ground};

/// Heights of single buildings over the passes are in the page up to so many numbers.
const MAX_PASS_HEIGHTS: usize = 400_000;
/// Every so many points of a photo's footprint on the ground are kept.
const FOOTPRINT_STEP: usize = 2;

/// Everything that the report's page shows.
#[derive(Debug, Serialize)]
pub struct Data<'a> {
    pub title: String,
    crs: String,
    origin: [f64; 3],
    summary: Summary,
    buildings: Vec<MapBuilding<'a>>,
    ground: Option<GroundHeights>,
    views: Vec<ViewData<'a>>,
    passes: Vec<PassData>,
    solved: &'a [usize],
    levels: &'a [LevelFit],
    survey: Option<&'a SurveyReport>,
    issues: Vec<&'a Issue>,
    evidence: Vec<EvidenceData>,
    lineage: &'a Lineage,
    config: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    overview: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    backdrop: Option<BackdropData<'a>>,
}

#[derive(Debug, Serialize)]
struct ViewData<'a> {
    id: &'a str,
    kind: ViewKind,
    #[serde(flatten)]
    used: &'a ViewUse,
    /// East, north, up; metres.
    centre: [f64; 3],
    off_nadir: f64,
    /// Footprint of the photo on the ground: east and north in turn, metres.
    footprint: Vec<f64>,
    has_photo: bool,
}

#[derive(Debug, Serialize)]
struct PassData {
    loss: f64,
    change: f64,
    selected: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    active: Option<f64>,
    /// Decimetres; empty for cities with too many.
    heights: Vec<i32>,
}

impl<'a> Data<'a> {
    /// Data of a report.
    pub fn of(report: &'a Report<'_>) -> Self {
        let model = &report.model;
        let origin = origin(model.records);
        // Whole metres around zero hold any city: indices are 64 bits wide.
        let grid = OutputGrid { scale_m: SCALE_M, origin_m: origin };
        let positions: HashMap<&str, usize> =
            model.survey.views.iter().enumerate().map(|(i, view)| (view.id.0.as_str(), i)).collect();
        let ground_m = middle_ground(model.records).unwrap_or(origin[2]);
        let n_heights: usize = report.passes.iter().map(|pass| pass.heights_m.len()).sum();
        let mut issues: Vec<&Issue> = model.issues.iter().collect();
        issues.sort_by_key(|issue| issue.weight());
        Self {
            title: title(report),
            crs: match model.crs.epsg() {
                Some(_) => format!("{} · {}", model.crs, model.crs.name()),
                None => model.crs.name().to_owned(),
            },
            origin,
            summary: Summary::of(model),
            buildings: model.records.iter().map(|record| MapBuilding::of(record, origin, &grid, &positions)).collect(),
            ground: GroundHeights::around(model.records, report.terrain),
            views: model.survey.views.iter().zip(&report.views).map(|(v, used)| view(v, used, ground_m)).collect(),
            passes: report.passes.iter().map(|pass| pass_data(pass, n_heights <= MAX_PASS_HEIGHTS)).collect(),
            solved: report.solved,
            levels: &report.levels,
            survey: report.survey.as_ref(),
            issues,
            evidence: report.evidence.iter().map(EvidenceData::from).collect(),
            lineage: model.lineage,
            config: &report.config,
            overview: report.overview.as_ref().map(data_uri),
            backdrop: report.backdrop.as_ref().map(BackdropData::from),
        }
    }
}

fn title(report: &Report<'_>) -> String {
    let n = StatusCount::of(report.model.records).n_buildings();
    let date = report.model.lineage.reference_date.as_deref().map(|date| format!(", {date}")).unwrap_or_default();
    format!("{n} building{}{date}", if n == 1 { "" } else { "s" })
}

fn middle_ground(records: &[BuildingRecord]) -> Option<f64> {
    let levels: Vec<f64> = records.iter().filter_map(|r| r.ground_z_m).collect();
    sizeup_heights::stats::median(&levels)
}

fn view<'a>(view: &'a View, used: &'a ViewUse, ground_m: f64) -> ViewData<'a> {
    let footprint = ground::footprint(view, ground_m);
    ViewData {
        id: &view.id.0,
        kind: view.kind(),
        used,
        centre: view.camera_from_map.centre().to_array().map(round_cm),
        off_nadir: (view.off_nadir_deg() * 10.0).round() / 10.0,
        footprint: footprint.iter().step_by(FOOTPRINT_STEP).flat_map(|p| [round_cm(p.x), round_cm(p.y)]).collect(),
        has_photo: view.image.is_some(),
    }
}

fn pass_data(pass: &super::SolverPass, has_heights: bool) -> PassData {
    let heights = if has_heights { pass.heights_m.as_slice() } else { &[] };
    let rounded = |value: f64| (value * 1e5).round() / 1e5;
    PassData {
        loss: rounded(pass.loss),
        change: rounded(pass.relative_change),
        selected: pass.n_selected,
        active: pass.active_pairs.map(rounded),
        heights: heights.iter().map(|h| (h * 10.0).round() as i32).collect(),
    }
}
