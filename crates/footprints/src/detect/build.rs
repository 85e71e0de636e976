//! From agreed footprints to a layer: cleaned, named, and with what is known of how each was seen.

use geo::{Area as _, BoundingRect as _};
use geo_types::Polygon;
use glam::DVec3;
use serde_json::{Map as JsonMap, Value};

use super::{BuildingSightings, Detection, DetectionSummary, PhotoContour, PlacedCandidate, Tracks};
use crate::clean::{self, CleaningRules};
use crate::consensus::Consensus;
use crate::contours::ContourKind;
use crate::georeference::PlaceError;
use crate::source::DetectionSettings;
use crate::{Footprint, RefusedFootprint, identity};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::BuildingId;
use sizeup_survey::View;

/// Puts buildings into a layer.
pub(super) struct LayerBuilder<'a> {
    /// Views of the survey that footprints are looked for in.
    pub views: &'a [View],
    /// Ground under the views.
    pub terrain: &'a Terrain,
    /// Rules for drawing footprints.
    pub settings: DetectionSettings<'a>,
    /// Candidates of single views.
    pub placed: Vec<PlacedCandidate>,
    /// The same as the photos show it, for roofs.
    pub tracks: Vec<PhotoContour>,
    /// Layer, sightings and counts, as far as they are built.
    pub detection: Detection,
}

impl LayerBuilder<'_> {
    /// Footprints on the output grid that can be extruded; refused ones go into the layer at once.
    pub(super) fn clean(
        &mut self,
        buildings: Vec<Consensus>,
        issues: &mut Vec<Issue>,
        summary: &mut DetectionSummary,
    ) -> Vec<(Polygon<f64>, Consensus)> {
        let consensus = self.settings.consensus;
        let rules =
            CleaningRules { grid_m: consensus.grid_m, min_area_m2: consensus.min_area_m2, max_area_change: 0.05 };
        let mut kept = Vec::with_capacity(buildings.len());
        for mut building in buildings {
            match clean::clean(&building.polygon, rules) {
                Ok(cleaned) => {
                    let all_m2: f64 = cleaned.parts.iter().map(geo::Area::unsigned_area).sum();
                    let parts = cleaned.parts.into_iter();
                    let largest = parts.max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area()));
                    kept.extend(largest.map(|polygon| {
                        building.left_out_m2 += all_m2 - polygon.unsigned_area();
                        (polygon, building)
                    }));
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
                        duplicate_of: None,
                        attributes: JsonMap::new(),
                    };
                    self.detection.layer.refused.push(refused);
                }
            }
        }
        kept
    }

    /// Puts footprints into the layer, with ids.
    pub(super) fn add(&mut self, buildings: Vec<(Polygon<f64>, Consensus)>) {
        let ids = identity::ids(buildings.iter().map(|(polygon, _)| polygon));
        let mut tracks = Tracks::default();
        for (i, ((polygon, building), id)) in buildings.into_iter().zip(ids).enumerate() {
            let sighting = self.sighting(&polygon, &building);
            for &member in &building.members {
                self.placed[member].building = Some(i);
            }
            if self.settings.contour == ContourKind::Roof {
                tracks.buildings.push(building.members.iter().map(|&m| self.tracks[m].clone()).collect());
            }
            self.detection.layer.footprints.push(footprint(id, polygon, &sighting));
            self.detection.sightings.push(sighting);
        }
        self.detection.tracks = (self.settings.contour == ContourKind::Roof).then_some(tracks);
    }

    fn sighting(&self, polygon: &Polygon<f64>, building: &Consensus) -> BuildingSightings {
        let views: Vec<usize> = building.members.iter().map(|&m| self.placed[m].view).collect();
        let rings = std::iter::once(polygon.exterior()).chain(polygon.interiors());
        let corners = rings.flat_map(|ring| &ring.0[..ring.0.len().saturating_sub(1)]);
        let corner_sigma_m = corners
            .map(|c| {
                let z = self.terrain.height_at(c.x, c.y).unwrap_or_default();
                let at = DVec3::new(c.x, c.y, z);
                let errors: Vec<PlaceError> =
                    views.iter().map(|&v| PlaceError::at(&self.views[v], at, self.settings.accuracy)).collect();
                PlaceError::joint_sigma_m(&errors)
            })
            .collect();
        // One view of one is weaker evidence than nine of nine.
        let support = (building.n_views as f64 + 0.5) / (building.n_seen as f64 + 1.0);
        let scores = building.members.iter().map(|&m| f64::from(self.placed[m].score));
        let score = scores.sum::<f64>() / building.members.len().max(1) as f64;
        BuildingSightings {
            n_views: building.n_views,
            n_seen: building.n_seen,
            agreement: building.agreement,
            confidence: support.min(1.0) * building.agreement * score,
            corner_sigma_m,
            is_assembled: building.is_assembled,
            left_out_m2: building.left_out_m2,
            change: None,
        }
    }
}

fn footprint(id: BuildingId, polygon: Polygon<f64>, sighting: &BuildingSightings) -> Footprint {
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
