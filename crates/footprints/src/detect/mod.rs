//! From the contours that nadir views show to one layer of buildings.

mod build;
mod look;
mod roofs;

use std::collections::BTreeMap;

use geo::Area as _;
use geo_types::MultiPolygon;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use roofs::move_roofs;

use self::build::LayerBuilder;
use self::look::{ViewCandidates, look_at, raised};
use super::cadastre::{self, CadastreChange, FootprintFrom};
use super::candidate::{FootprintCandidate, SeenGround};
use super::cluster::Dropped;
use super::consensus;
use super::contours::{ContourKind, ContourSource, ViewFault};
use super::georeference::InputAccuracy;
use super::layer::FootprintError;
use super::source::DetectionSettings;
use super::{Footprint, FootprintLayer};
use sizeup_geo::crs::Crs;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::Terrain;
use sizeup_survey::{View, ViewKind};

/// Distance by which the image's border is drawn in: contours end on it, pixels.
const BORDER_PX: f64 = 1.5;

/// A candidate with where it ended.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedCandidate {
    /// View, as a position in the survey.
    pub view: usize,
    /// Footprint on the ground; map frame, metres.
    pub shape: MultiPolygon<f64>,
    /// Score by the segmenter.
    pub score: f32,
    /// Whether the image's border cuts it off.
    pub is_cut: bool,
    /// Standard deviation of its footprint, metres.
    pub sigma_m: f64,
    /// Position of its building in the layer, if it is in one.
    pub building: Option<usize>,
}

/// Sightings of a building.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct BuildingSightings {
    /// Views that show it.
    pub n_views: usize,
    /// Views that see its place.
    pub n_seen: usize,
    /// Mean intersection over union of the views with the footprint.
    pub agreement: f64,
    /// Share of the views that show it times agreement times their mean score: 0 to 1.
    pub confidence: f64,
    /// Standard deviation of each corner, metres: exterior, then holes, without the repeated last ones.
    pub corner_sigma_m: Vec<f64>,
    /// Whether no single view shows it whole.
    pub is_assembled: bool,
    /// Area of what views agree on beside its footprint, in pieces that touch it in a corner at most, m².
    #[serde(default)]
    pub left_out_m2: f64,
    /// Against an existing layer.
    pub change: Option<CadastreChange>,
}

/// Numbers of views, contours and buildings in a detection, by what became of them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DetectionSummary {
    /// Where the footprints in the photos come from, in words.
    #[serde(default)]
    pub footprints_from: String,
    /// Nadir views that were looked at.
    pub n_views: usize,
    /// Views without usable contours among these.
    pub n_views_without: usize,
    /// Contours in all views.
    pub n_candidates: usize,
    /// Buildings that better supported ones contradict.
    pub n_contradicted: usize,
    /// Buildings that too few views show.
    pub n_unsupported: usize,
    /// Buildings below the least area.
    pub n_small: usize,
    /// Buildings by what became of them against an existing layer.
    pub by_change: BTreeMap<CadastreChange, usize>,
}

/// Input to move roofs again: the contours as the photos show them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracks {
    /// Per building of the layer: position of the view in the survey, and the contour in pixels of its photo.
    pub buildings: Vec<Vec<PhotoContour>>,
}

/// The contour of one building in one photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotoContour {
    /// Position of the view in the survey.
    pub view: usize,
    /// Pixels of the photo.
    pub shape_px: MultiPolygon<f64>,
    /// Score by the segmenter.
    pub score: f32,
    /// Whether the image's border cuts it off.
    pub is_cut: bool,
}

/// Buildings found in photos.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Detection {
    /// One footprint per building.
    pub layer: FootprintLayer,
    /// Sightings of each of the layer's footprints, in order.
    pub sightings: Vec<BuildingSightings>,
    /// Everything that single views show.
    pub candidates: Vec<PlacedCandidate>,
    /// Buildings of an existing layer that are gone.
    pub vanished: Vec<Footprint>,
    /// The photos' contours as seen, for roof contours; `None` where they were not kept.
    pub tracks: Option<Tracks>,
    /// Numbers of views, contours and buildings, by what became of them.
    pub summary: DetectionSummary,
}

/// Finds the buildings that the nadir views show.
///
/// # Errors
/// [`FootprintError`] if a setting is out of range, no view looks down, or no view has contours.
pub fn detect(
    source: &dyn ContourSource,
    views: &[View],
    terrain: &Terrain,
    settings: DetectionSettings<'_>,
    crs: &Crs,
) -> Result<Detection, FootprintError> {
    check(settings.accuracy)?;
    let nadir: Vec<usize> = (0..views.len()).filter(|&i| views[i].kind() == ViewKind::Nadir).collect();
    if nadir.is_empty() {
        return Err(FootprintError::Masks {
            problem: format!("none of the {} views looks straight down", views.len()),
            hint: "footprints are found in views within 15° of the vertical; check the angle convention of the poses"
                .to_owned(),
        });
    }
    let looked: Vec<Result<ViewCandidates, ViewFault>> =
        nadir.par_iter().map(|&i| look_at(source, &views[i], terrain, settings)).collect();
    let mut issues: Vec<Issue> = suspicious(&looked).into_iter().collect();
    let mut seen = Vec::new();
    let (mut candidates, mut tracks, mut placed) = (Vec::new(), Vec::new(), Vec::new());
    let mut summary = DetectionSummary { n_views: nadir.len(), ..DetectionSummary::default() };
    for (&view, looked) in nadir.iter().zip(looked) {
        let looked = match looked {
            Ok(looked) => looked,
            Err(fault) => {
                issues.push(fault.issue(&views[view]));
                summary.n_views_without += 1;
                continue;
            }
        };
        issues.extend(looked.notes(&views[view]));
        for (contour, shape, error) in looked.contours {
            let sigma_m = error.sigma_m();
            let weight = sigma_m.powi(2).max(1e-6).recip();
            let (score, is_cut) = (contour.score, contour.is_cut);
            placed.push(PlacedCandidate { view, shape: shape.clone(), score, is_cut, sigma_m, building: None });
            candidates.push(FootprintCandidate { view: seen.len(), shape, weight, score, is_cut });
            if settings.contour == ContourKind::Roof {
                tracks.push(PhotoContour { view, shape_px: contour.shape_px, score, is_cut });
            }
        }
        seen.push(SeenGround { area: looked.seen });
    }
    if seen.is_empty() {
        let (first, hint) = issues.into_iter().next().map_or_else(Default::default, |i| (i.message, i.hint));
        return Err(FootprintError::Masks {
            problem: format!("none of the {} nadir views has usable contours; of the first, {first}", nadir.len()),
            hint: hint.unwrap_or_default(),
        });
    }
    summary.n_candidates = candidates.len();
    let agreed = match settings.contour {
        ContourKind::Ground => consensus::agree(&candidates, &seen, settings.consensus),
        ContourKind::Roof => {
            let heights_m = settings.consensus.roof_heights_m;
            let levels: Vec<Vec<FootprintCandidate>> = heights_m
                .par_iter()
                .map(|height_m| {
                    candidates.iter().zip(&tracks).map(|(c, t)| raised(c, t, views, terrain, *height_m)).collect()
                })
                .collect();
            consensus::agree_at_some_level(&levels, &seen, settings.consensus)
        }
    };
    let Dropped { n_contradicted, n_unsupported } = agreed.dropped;
    (summary.n_contradicted, summary.n_unsupported) = (n_contradicted, n_unsupported);

    let mut builder = LayerBuilder { views, terrain, settings, placed, tracks, detection: Detection::default() };
    let footprints = builder.clean(agreed.buildings, &mut issues, &mut summary);
    builder.add(footprints);
    let LayerBuilder { mut detection, placed, .. } = builder;
    detection.candidates = placed;
    if let Some(config) = settings.cadastre {
        let found = cadastre::conflate(&mut detection.layer.footprints, &seen, config, crs)?;
        for (sighting, (change, _)) in detection.sightings.iter_mut().zip(&found.found) {
            sighting.change = Some(*change);
            *summary.by_change.entry(*change).or_default() += 1;
        }
        if !found.vanished.is_empty() {
            summary.by_change.insert(CadastreChange::Vanished, found.vanished.len());
        }
        for old in found.unseen {
            *summary.by_change.entry(CadastreChange::Unseen).or_default() += 1;
            detection.layer.footprints.push(old);
            detection
                .sightings
                .push(BuildingSightings { change: Some(CadastreChange::Unseen), ..BuildingSightings::default() });
        }
        if let Some(tracks) = &mut detection.tracks {
            tracks.buildings.resize(detection.layer.footprints.len(), Vec::new());
        }
        detection.vanished = found.vanished;
        issues.extend(found.issues);
    }
    tell(&summary, &mut issues);
    issues.extend(left_out(&detection, &settings));
    issues.append(&mut detection.layer.issues);
    detection.layer.issues = issues;
    detection.summary = summary;
    Ok(detection)
}

fn check(a: &InputAccuracy) -> Result<(), FootprintError> {
    let within = |field, value: f64, high: f64, expected| {
        if (0.0..=high).contains(&value) { Ok(()) } else { Err(FootprintError::Config { field, value, expected }) }
    };
    within("accuracy.position_m", a.position_m, 100.0, "0 to 100 m")?;
    within("accuracy.angle_deg", a.angle_deg, 10.0, "0 to 10 degrees")
}

/// Faults that every single mask allows and all together do not.
fn suspicious(looked: &[Result<ViewCandidates, ViewFault>]) -> Option<Issue> {
    let contours = || looked.iter().flatten().flat_map(|l| &l.contours);
    let warn = |code: &str, message: String, hint: &str| {
        Some(Issue::new(Severity::Warning, code, Subject::Input("footprints".to_owned()), message).hint(hint))
    };
    let n = contours().count();
    let n_in_parts = contours().filter(|(contour, ..)| contour.shape_px.0.len() > 1).count();
    let n_empty = looked.iter().flatten().filter(|l| l.contours.is_empty() && l.n_off_terrain == 0).count();
    if n == 0 && n_empty > 0 {
        let message = format!("the masks of all {n_empty} nadir photos are empty: there is no building");
        return warn("masks_empty", message, "check `kind`, `above` and, for COCO, `category` if there are buildings");
    }
    if 2 * n_in_parts > n {
        let message = format!("{n_in_parts} of {n} instances are in several parts each");
        return warn(
            "instances_in_parts",
            message,
            "`kind = \"instance\"` takes all pixels of one number for one building; if buildings have no numbers, it is \"semantic\"",
        );
    }
    None
}

/// Buildings that views show in several pieces, of which the largest became the footprint: those that lost as much as a
/// building. Where a layer's footprint is taken, nothing is lost.
fn left_out(detection: &Detection, settings: &DetectionSettings<'_>) -> Vec<Issue> {
    let has_own_footprint = |change: Option<CadastreChange>| {
        let is_of_layer = settings.cadastre.is_some_and(|config| config.footprint_from == FootprintFrom::Layer);
        !(is_of_layer && change == Some(CadastreChange::Matched))
    };
    let least_m2 = settings.consensus.min_area_m2;
    let buildings = detection.layer.footprints.iter().zip(&detection.sightings);
    let lost = buildings.filter(|(_, seen)| seen.left_out_m2 >= least_m2 && has_own_footprint(seen.change));
    let tell = |(footprint, seen): (&Footprint, &BuildingSightings)| {
        let (kept_m2, lost_m2) = (footprint.polygon.unsigned_area(), seen.left_out_m2);
        let message = format!(
            "the photos show it in pieces that touch in a corner at most: its footprint is the largest, {kept_m2:.1} m², and \
             {lost_m2:.1} m² ({:.0} % of all) are left out",
            100.0 * lost_m2 / (kept_m2 + lost_m2)
        );
        let subject = Subject::Building(footprint.id.to_string());
        let issue = Issue::new(Severity::Warning, "footprint_pieces_left_out", subject, message)
            .hint("draw each piece as a building of its own in the masks, or mend masks that cross themselves");
        match footprint.middle() {
            Some((x, y)) => issue.at(x, y),
            None => issue,
        }
    };
    lost.map(tell).collect()
}

/// Numbers of what was left out: single ones are in the layer of candidates.
fn tell(summary: &DetectionSummary, issues: &mut Vec<Issue>) {
    let mut note = |n: usize, code: &str, what: &str, hint: &str| {
        if n > 0 {
            let issue = Issue::new(
                Severity::Note,
                code,
                Subject::Input("footprints".to_owned()),
                format!("{n} contours {what}"),
            );
            issues.push(issue.hint(hint));
        }
    };
    let look = "the layer `candidates` of footprints.gpkg shows them";
    note(
        summary.n_unsupported,
        "footprint_unsupported",
        "are shown by too few of the views that see their place",
        look,
    );
    note(summary.n_contradicted, "footprint_contradicted", "are contradicted by others that more views show", look);
    note(
        summary.n_small,
        "footprint_too_small",
        "are smaller than the least building",
        "buildings of less than 4 m² are left out",
    );
}
