//! From the outlines that nadir views show to one layer of buildings.

use std::collections::BTreeMap;

use geo::{Area as _, BoundingRect as _, Centroid as _};
use geo_types::{MultiPolygon, Polygon};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map as JsonMap, Value};

use super::cadastre::{self, Change};
use super::candidate::{Candidate, SeenGround};
use super::clean::{self, Rules};
use super::cluster::Dropped;
use super::consensus::{self, Consensus};
use super::georeference::{PlaceError, Projector, Surface, ground_pixel_m};
use super::layer::FootprintError;
use super::outlines::{Look, OutlineKind, OutlineSource, ViewFault};
use super::source::DetectionSettings;
use super::vectorise::Outline;
use super::{Footprint, FootprintLayer, RefusedFootprint, identity};
use crate::crs::Crs;
use crate::ids::BuildingId;
use crate::issue::{Issue, Severity, Subject};
use crate::survey::{View, ViewKind};
use crate::terrain::Terrain;

/// Contours are thinned to this share of the outlines' tolerance before views vote.
const CONTOUR_SHARE: f64 = 0.1;
/// Parts of a candidate below this share of the least building are specks.
const SPECK_SHARE: f64 = 0.25;
/// How far the image's border is drawn in: contours end on it, pixels.
const BORDER_PX: f64 = 1.5;

/// A candidate with where it ended.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedCandidate {
    /// Its view, as a position in the survey.
    pub view: usize,
    /// Its outline on the ground; map frame, metres.
    pub shape: MultiPolygon<f64>,
    /// What the segmenter gives it.
    pub score: f32,
    /// Whether the image's border cuts it off.
    pub is_cut: bool,
    /// Standard deviation of its outline, metres.
    pub sigma_m: f64,
    /// Position of its building in the layer, if it is in one.
    pub building: Option<usize>,
}

/// How a building was seen.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// Views that show it.
    pub n_views: usize,
    /// Views that see its place.
    pub n_seen: usize,
    /// Mean intersection over union of the views with the outline.
    pub agreement: f64,
    /// Share of the views that show it times agreement: 0 to 1, not calibrated.
    pub confidence: f64,
    /// Standard deviation of each corner, metres: exterior, then holes, without the repeated last ones.
    pub corner_sigma_m: Vec<f64>,
    /// Whether no single view shows it whole.
    pub is_assembled: bool,
    /// Against an existing layer.
    pub change: Option<Change>,
}

/// How much there was.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DetectionSummary {
    /// Nadir views that were looked at.
    pub n_views: usize,
    /// Of these, views without usable outlines.
    pub n_views_without: usize,
    /// Outlines in all views.
    pub n_candidates: usize,
    /// Buildings that better supported ones contradict.
    pub n_contradicted: usize,
    /// Buildings that too few views show.
    pub n_unsupported: usize,
    /// Buildings below the least area.
    pub n_small: usize,
    /// Buildings by what became of them against an existing layer.
    pub by_change: BTreeMap<Change, usize>,
}

/// What roofs need to be moved again: the outlines as the photos show them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracks {
    /// Per building of the layer: position of the view in the survey, and the outline in pixels of its photo.
    pub buildings: Vec<Vec<Track>>,
}

/// One outline of one building in one photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Position of the view in the survey.
    pub view: usize,
    /// Pixels of the photo.
    pub shape_px: MultiPolygon<f64>,
    /// What the segmenter gives it.
    pub score: f32,
    /// Whether the image's border cuts it off.
    pub is_cut: bool,
}

/// Buildings found in photos.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Detection {
    /// The buildings.
    pub layer: FootprintLayer,
    /// How each of the layer's footprints was seen, in order.
    pub sightings: Vec<Sighting>,
    /// Everything that single views show.
    pub candidates: Vec<PlacedCandidate>,
    /// Buildings of an existing layer that are gone.
    pub vanished: Vec<Footprint>,
    /// For roof outlines.
    pub tracks: Option<Tracks>,
    /// How much there was.
    pub summary: DetectionSummary,
}

/// What one view shows.
struct Looked {
    seen: Polygon<f64>,
    outlines: Vec<(Outline, MultiPolygon<f64>, PlaceError)>,
    n_off_terrain: usize,
}

/// Finds the buildings that the nadir views show.
///
/// # Errors
/// [`FootprintError`] if a setting is out of range, no view looks down, or no view has outlines.
pub fn detect(
    source: &dyn OutlineSource,
    views: &[View],
    terrain: &Terrain,
    settings: DetectionSettings<'_>,
    crs: &Crs,
) -> Result<Detection, FootprintError> {
    check(&settings)?;
    let nadir: Vec<usize> = (0..views.len()).filter(|&i| views[i].kind() == ViewKind::Nadir).collect();
    if nadir.is_empty() {
        return Err(FootprintError::Masks {
            problem: format!("none of the {} views looks straight down", views.len()),
            hint: "outlines are found in views within 15° of the vertical; check the angle convention of the poses"
                .to_owned(),
        });
    }
    let looked: Vec<Result<Looked, ViewFault>> =
        nadir.par_iter().map(|&i| look_at(source, &views[i], terrain, settings)).collect();
    let mut issues = Vec::new();
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
        if looked.n_off_terrain > 0 {
            let message = format!("{} of its outlines reach beyond the terrain and are left out", looked.n_off_terrain);
            let subject = Subject::View(views[view].id.0.clone());
            issues.push(
                Issue::new(Severity::Note, "outlines_off_terrain", subject, message)
                    .hint("use a terrain model that covers what the views see"),
            );
        }
        for (outline, shape, error) in looked.outlines {
            let sigma_m = error.sigma_m(settings.accuracy);
            let weight = sigma_m.powi(2).max(1e-6).recip();
            let (score, is_cut) = (outline.score, outline.is_cut);
            placed.push(PlacedCandidate { view, shape: shape.clone(), score, is_cut, sigma_m, building: None });
            candidates.push(Candidate { view: seen.len(), shape, weight, score, is_cut });
            if settings.outline == OutlineKind::Roof {
                tracks.push(Track { view, shape_px: outline.shape_px, score, is_cut });
            }
        }
        seen.push(SeenGround { area: looked.seen });
    }
    if seen.is_empty() {
        let first = issues.first().map_or(String::new(), |i| i.message.clone());
        return Err(FootprintError::Masks {
            problem: format!("none of the {} nadir views has usable outlines; of the first, {first}", nadir.len()),
            hint: "`path` says where masks are; {stem} is the photo's name without its extension".to_owned(),
        });
    }
    summary.n_candidates = candidates.len();
    let agreed = match settings.outline {
        OutlineKind::Ground => consensus::agree(&candidates, &seen, settings.consensus),
        OutlineKind::Roof => {
            let heights_m = &settings.consensus.roof_heights_m;
            let levels: Vec<Vec<Candidate>> = heights_m
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

    let mut builder = Builder { views, terrain, settings, placed, tracks, detection: Detection::default() };
    let outlines = builder.clean(agreed.buildings, &mut issues, &mut summary);
    builder.add(outlines);
    let Builder { mut detection, placed, .. } = builder;
    detection.candidates = placed;
    if let Some(config) = settings.cadastre {
        let found = cadastre::conflate(&mut detection.layer.footprints, &seen, config, crs)?;
        for (sighting, (change, _)) in detection.sightings.iter_mut().zip(&found.found) {
            sighting.change = Some(*change);
            *summary.by_change.entry(*change).or_default() += 1;
        }
        if !found.vanished.is_empty() {
            summary.by_change.insert(Change::Vanished, found.vanished.len());
        }
        for old in found.unseen {
            *summary.by_change.entry(Change::Unseen).or_default() += 1;
            detection.layer.footprints.push(old);
            detection.sightings.push(Sighting { change: Some(Change::Unseen), ..Sighting::default() });
        }
        if let Some(tracks) = &mut detection.tracks {
            tracks.buildings.resize(detection.layer.footprints.len(), Vec::new());
        }
        detection.vanished = found.vanished;
        issues.extend(found.issues);
    }
    tell(&summary, &mut issues);
    issues.append(&mut detection.layer.issues);
    detection.layer.issues = issues;
    detection.summary = summary;
    Ok(detection)
}

fn check(settings: &DetectionSettings<'_>) -> Result<(), FootprintError> {
    let (c, a) = (settings.consensus, settings.accuracy);
    let within = |field, value: f64, low: f64, high: f64, expected| {
        if value >= low && value <= high { Ok(()) } else { Err(FootprintError::Config { field, value, expected }) }
    };
    within("consensus.min_iou", c.min_iou, 0.05, 1.0, "a share, 0.05 to 1")?;
    within("consensus.min_support", c.min_support, 0.0, 1.0, "a share, 0 to 1")?;
    within("consensus.cell_m", c.cell_m, 0.02, 2.0, "0.02 to 2 m")?;
    within("consensus.max_cells", c.max_cells as f64, 64.0, 1e8, "64 to 100000000")?;
    within("consensus.neighbour_m", c.neighbour_m, 0.0, 10.0, "0 to 10 m")?;
    within("consensus.tolerance_m", c.tolerance_m, 0.01, 10.0, "0.01 to 10 m")?;
    within("consensus.snap_deg", c.snap_deg, 0.0, 40.0, "0 to 40 degrees")?;
    within("consensus.max_shift_m", c.max_shift_m, 0.0, 10.0, "0 to 10 m")?;
    within("consensus.max_area_change", c.max_area_change, 0.0, 1.0, "a share, 0 to 1")?;
    within("consensus.min_hole_m2", c.min_hole_m2, 0.0, 1e6, "at least 0 m²")?;
    within("consensus.min_area_m2", c.min_area_m2, 0.1, 1e6, "at least 0.1 m²")?;
    within("consensus.grid_m", c.grid_m, 1e-6, 1.0, "0.000001 to 1 m")?;
    if c.roof_heights_m.is_empty() {
        return Err(FootprintError::Masks {
            problem: "`consensus.roof_heights_m` is empty".to_owned(),
            hint: "give at least one height in metres, such as [8]".to_owned(),
        });
    }
    for &height_m in &c.roof_heights_m {
        within("consensus.roof_heights_m", height_m, 0.0, 1000.0, "0 to 1000 m")?;
    }
    within("accuracy.mask_px", a.mask_px, 0.0, 100.0, "0 to 100 pixels")?;
    within("accuracy.position_m", a.position_m, 0.0, 100.0, "0 to 100 m")?;
    within("accuracy.angle_deg", a.angle_deg, 0.0, 10.0, "0 to 10 degrees")?;
    within("accuracy.terrain_m", a.terrain_m, 0.0, 100.0, "0 to 100 m")
}

fn look_at(
    source: &dyn OutlineSource,
    view: &View,
    terrain: &Terrain,
    settings: DetectionSettings<'_>,
) -> Result<Looked, ViewFault> {
    let on_ground = Projector::new(view, Surface::Terrain(terrain));
    let seen = on_ground.seen(BORDER_PX).ok_or(ViewFault::OffTerrain)?;
    let pixel_m = ground_pixel_m(&on_ground, view).ok_or(ViewFault::OffTerrain)?;
    let look = Look {
        min_area_px2: SPECK_SHARE * settings.consensus.min_area_m2 / (pixel_m * pixel_m),
        tolerance_px: CONTOUR_SHARE * settings.consensus.tolerance_m / pixel_m,
    };
    let found = source.outlines(view, look)?;
    let n_found = found.len();
    let outlines: Vec<_> = found
        .into_iter()
        .filter_map(|outline| {
            let shape = match settings.outline {
                OutlineKind::Ground => on_ground.shape(&outline.shape_px)?,
                OutlineKind::Roof => roof(view, terrain, &outline.shape_px, settings.consensus.roof_heights_m[0])?,
            };
            let centre = shape.centroid()?;
            let z = terrain.height_at(centre.x(), centre.y())?;
            let error = PlaceError::at(view, DVec3::new(centre.x(), centre.y(), z), settings.accuracy);
            Some((outline, shape, error))
        })
        .collect();
    let n_off_terrain = n_found - outlines.len();
    Ok(Looked { seen, outlines, n_off_terrain })
}

/// A roof's outline at a height above the ground under its middle.
fn roof(view: &View, terrain: &Terrain, shape_px: &MultiPolygon<f64>, height_m: f64) -> Option<MultiPolygon<f64>> {
    let middle_px = shape_px.centroid()?.into();
    let first = Projector::new(view, Surface::Terrain(terrain)).point(middle_px)?;
    // The ground under the roof, not behind it.
    let under = Projector::new(view, Surface::Level(first.z + height_m)).point(middle_px)?;
    let ground_m = terrain.height_at(under.x, under.y)?;
    Projector::new(view, Surface::Level(ground_m + height_m)).shape(shape_px)
}

/// A candidate at another height; as it is where that cannot be.
fn raised(candidate: &Candidate, track: &Track, views: &[View], terrain: &Terrain, height_m: f64) -> Candidate {
    match roof(&views[track.view], terrain, &track.shape_px, height_m) {
        Some(shape) => Candidate { shape, ..candidate.clone() },
        None => candidate.clone(),
    }
}

/// Puts buildings into a layer.
struct Builder<'a> {
    views: &'a [View],
    terrain: &'a Terrain,
    settings: DetectionSettings<'a>,
    placed: Vec<PlacedCandidate>,
    tracks: Vec<Track>,
    detection: Detection,
}

impl Builder<'_> {
    /// Outlines on the output grid that can be extruded; refused ones go into the layer at once.
    fn clean(
        &mut self,
        buildings: Vec<Consensus>,
        issues: &mut Vec<Issue>,
        summary: &mut DetectionSummary,
    ) -> Vec<(Polygon<f64>, Consensus)> {
        let consensus = self.settings.consensus;
        let rules = Rules { grid_m: consensus.grid_m, min_area_m2: consensus.min_area_m2, max_area_change: 0.05 };
        let mut kept = Vec::with_capacity(buildings.len());
        for building in buildings {
            match clean::clean(&building.polygon, rules) {
                Ok(cleaned) => {
                    let parts = cleaned.parts.into_iter();
                    let largest = parts.max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area()));
                    kept.extend(largest.map(|polygon| (polygon, building)));
                }
                Err(clean::Defect::TooSmall { .. } | clean::Defect::NoArea) => summary.n_small += 1,
                Err(defect) => {
                    let id = identity::ids(std::iter::once(&building.polygon)).remove(0);
                    let issue = Issue::new(
                        Severity::Refused,
                        defect.code(),
                        Subject::Building(id.0.clone()),
                        defect.to_string(),
                    );
                    issues.push(match building.polygon.bounding_rect() {
                        Some(rect) => issue.at(rect.center().x, rect.center().y),
                        None => issue,
                    });
                    let refused = RefusedFootprint {
                        id,
                        part_of: None,
                        reason: defect.code().to_owned(),
                        attributes: JsonMap::new(),
                    };
                    self.detection.layer.refused.push(refused);
                }
            }
        }
        kept
    }

    fn add(&mut self, buildings: Vec<(Polygon<f64>, Consensus)>) {
        let ids = identity::ids(buildings.iter().map(|(polygon, _)| polygon));
        let mut tracks = Tracks::default();
        for (i, ((polygon, building), id)) in buildings.into_iter().zip(ids).enumerate() {
            let sighting = self.sighting(&polygon, &building);
            for &member in &building.members {
                self.placed[member].building = Some(i);
            }
            if self.settings.outline == OutlineKind::Roof {
                tracks.buildings.push(building.members.iter().map(|&m| self.tracks[m].clone()).collect());
            }
            self.detection.layer.footprints.push(footprint(id, polygon, &sighting));
            self.detection.sightings.push(sighting);
        }
        self.detection.tracks = (self.settings.outline == OutlineKind::Roof).then_some(tracks);
    }

    fn sighting(&self, polygon: &Polygon<f64>, building: &Consensus) -> Sighting {
        let views: Vec<usize> = building.members.iter().map(|&m| self.placed[m].view).collect();
        let rings = std::iter::once(polygon.exterior()).chain(polygon.interiors());
        let corners = rings.flat_map(|ring| &ring.0[..ring.0.len().saturating_sub(1)]);
        let corner_sigma_m = corners
            .map(|c| {
                let z = self.terrain.height_at(c.x, c.y).unwrap_or_default();
                let at = DVec3::new(c.x, c.y, z);
                let errors: Vec<PlaceError> =
                    views.iter().map(|&v| PlaceError::at(&self.views[v], at, self.settings.accuracy)).collect();
                PlaceError::joint_sigma_m(&errors, self.settings.accuracy)
            })
            .collect();
        // One view of one is weaker evidence than nine of nine.
        let support = (building.n_views as f64 + 0.5) / (building.n_seen as f64 + 1.0);
        Sighting {
            n_views: building.n_views,
            n_seen: building.n_seen,
            agreement: building.agreement,
            confidence: support.min(1.0) * building.agreement,
            corner_sigma_m,
            is_assembled: building.is_assembled,
            change: None,
        }
    }
}

fn footprint(id: BuildingId, polygon: Polygon<f64>, sighting: &Sighting) -> Footprint {
    let rounded = |v: f64| Value::from((v * 1e3).round() / 1e3);
    let n = sighting.corner_sigma_m.len().max(1) as f64;
    let sigma_m = (sighting.corner_sigma_m.iter().map(|s| s * s).sum::<f64>() / n).sqrt();
    let attributes = [
        ("footprint_n_views", Value::from(sighting.n_views)),
        ("footprint_agreement", rounded(sighting.agreement)),
        ("footprint_confidence", rounded(sighting.confidence)),
        ("footprint_sigma_m", rounded(sigma_m)),
    ];
    let attributes = attributes.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    Footprint { id, part_of: None, polygon, attributes }
}

/// What was left out, in numbers: single ones are in the layer of candidates.
fn tell(summary: &DetectionSummary, issues: &mut Vec<Issue>) {
    let mut note = |n: usize, code: &str, what: &str, hint: &str| {
        if n > 0 {
            let issue = Issue::new(
                Severity::Note,
                code,
                Subject::Input("footprints".to_owned()),
                format!("{n} outlines {what}"),
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
        "lower `consensus.min_area_m2` to keep them",
    );
}

/// Lays roof outlines at the roofs' heights anew: `roof_z_m` per building of the layer, `None` leaves it as it is.
/// Returns how far the corners' mean moved, metres, per building.
///
/// # Errors
/// Never for tracks that [`detect`] made over the same views.
pub fn move_roofs(
    layer: &mut FootprintLayer,
    tracks: &Tracks,
    roof_z_m: &[Option<f64>],
    views: &[View],
    settings: DetectionSettings<'_>,
) -> Vec<f64> {
    let mut candidates = Vec::new();
    let mut seen: Vec<SeenGround> = Vec::new();
    let mut fixed = Vec::new();
    for (i, (tracks, z)) in tracks.buildings.iter().zip(roof_z_m).enumerate() {
        let Some(z) = z else { continue };
        let first = candidates.len();
        for track in tracks {
            let view = &views[track.view];
            let projector = Projector::new(view, Surface::Level(*z));
            let (Some(shape), Some(area)) = (projector.shape(&track.shape_px), projector.seen(BORDER_PX)) else {
                continue;
            };
            let Some(centre) = shape.centroid() else { continue };
            let error = PlaceError::at(view, DVec3::new(centre.x(), centre.y(), *z), settings.accuracy);
            let weight = error.sigma_m(settings.accuracy).powi(2).max(1e-6).recip();
            candidates.push(Candidate { view: seen.len(), shape, weight, score: track.score, is_cut: track.is_cut });
            seen.push(SeenGround { area });
        }
        if candidates.len() > first {
            fixed.push((i, (first..candidates.len()).collect::<Vec<_>>()));
        }
    }
    let drawn = consensus::draw_fixed(&fixed, &candidates, &seen, settings.consensus);
    let rules =
        Rules { grid_m: settings.consensus.grid_m, min_area_m2: settings.consensus.min_area_m2, max_area_change: 0.05 };
    let mut moved = vec![0.0; layer.footprints.len()];
    for (i, polygon) in drawn {
        let Ok(cleaned) = clean::clean(&polygon, rules) else { continue };
        let parts = cleaned.parts.into_iter();
        let Some(largest) = parts.max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area())) else { continue };
        let old = std::mem::replace(&mut layer.footprints[i].polygon, largest);
        if let (Some(a), Some(b)) = (old.centroid(), layer.footprints[i].polygon.centroid()) {
            moved[i] = (a.x() - b.x()).hypot(a.y() - b.y());
        }
    }
    moved
}
