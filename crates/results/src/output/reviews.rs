//! Decisions of people about single buildings: a height that was confirmed or corrected, or marked as wrong.
//!
//! They are kept in a GeoJSON beside the result (the QGIS plugin writes it), which no run replaces, and are applied to the
//! records by the building's id. Only the properties count; where a feature lies is for maps.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{BuildingRecord, OutputError, Records, Status};
use sizeup_geo::geodata::geojson::FeatureCollection;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::ids::with_wholes;

/// Heights closer than this are the same: files keep millimetres, metres.
const SAME_M: f64 = 0.002;
/// The reason of a height that a person confirmed or corrected.
pub const REVIEWED: &str = "reviewed";
/// The reason of a height that a person found wrong.
pub const REVIEWED_WRONG: &str = "reviewed_wrong";

/// Where decisions of people are.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReviewsConfig {
    /// GeoJSON with a feature per building and the properties `building_id`, `decision` (`confirmed`, `corrected` or
    /// `wrong`), `height_m`, `sigma_m`, `note`, `author`, `date`, as the review panel of the QGIS plugin writes it.
    pub path: PathBuf,
}

/// Decision about a building.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ReviewDecision {
    /// The height that was found is right.
    Confirmed,
    /// Another height is right.
    Corrected,
    /// The height is wrong, and the right one is not known.
    Wrong,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Review {
    building_id: String,
    decision: ReviewDecision,
    /// Above the building's ground, metres; of what was confirmed, or in place of what was found.
    #[serde(default)]
    height_m: Option<f64>,
    /// One standard deviation, metres.
    #[serde(default)]
    sigma_m: Option<f64>,
}

/// Why decisions cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReviewsError {
    /// The file is absent or unreadable.
    #[error("cannot read {}: {source}\nhint: reviews.path names the file of decisions; leave [reviews] out if there are none", path.display())]
    Read {
        /// Path of the file of decisions.
        path: PathBuf,
        /// Error that the system reported.
        source: std::io::Error,
    },
    /// The file is something else.
    #[error("{} holds no decisions: {message}", path.display())]
    Malformed {
        /// Path of the file of decisions.
        path: PathBuf,
        /// The problem with the file, in words.
        message: String,
    },
}

/// Decisions by the building's id.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Reviews {
    by_id: BTreeMap<String, Review>,
}

impl Reviews {
    /// Reads a file; a building that occurs twice, or a height that is none, is refused.
    ///
    /// # Errors
    /// [`ReviewsError`].
    pub fn read(path: &Path) -> Result<Self, ReviewsError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ReviewsError::Read { path: path.to_owned(), source })?;
        Self::parse(&text).map_err(|message| ReviewsError::Malformed { path: path.to_owned(), message })
    }

    fn parse(text: &str) -> Result<Self, String> {
        let collection = text.parse::<FeatureCollection>().map_err(|e| e.to_string())?;
        let mut by_id = BTreeMap::new();
        for feature in collection.features {
            let properties = Value::Object(feature.properties.unwrap_or_default());
            let review: Review = serde_json::from_value(properties).map_err(|e| e.to_string())?;
            let id = review.building_id.clone();
            let is_length = |metres: f64| metres > 0.0 && metres.is_finite();
            if review.decision != ReviewDecision::Wrong && !review.height_m.is_some_and(is_length) {
                return Err(format!("{id}: height_m has to be a number of metres above 0"));
            }
            if review.sigma_m.is_some_and(|sigma_m| !(sigma_m >= 0.0 && sigma_m.is_finite())) {
                return Err(format!("{id}: sigma_m has to be a number of metres, 0 or more"));
            }
            if by_id.insert(id.clone(), review).is_some() {
                return Err(format!("{id} occurs more than once"));
            }
        }
        Ok(Self { by_id })
    }

    /// Applies the decisions. A reviewed building has the status `reviewed` and the reviewed height; one that was marked as
    /// wrong is `unknown`. What has no footprint or no ground stays as it is.
    pub fn apply(&self, records: &mut [BuildingRecord]) {
        for record in records {
            let has_place = record.status != Status::Refused && record.ground_z_m.is_some();
            if let Some(review) = self.by_id.get(&record.id).filter(|_| has_place) {
                review.apply(record);
            }
        }
    }

    /// Those about some footprints and the parts that footprints are split into (`ID#1`).
    #[must_use]
    pub fn about(&self, is_footprint: impl Fn(&str) -> bool) -> Self {
        let of_them = self.by_id.iter().filter(|(id, _)| with_wholes(id).any(&is_footprint));
        Self { by_id: of_them.map(|(id, review)| (id.clone(), review.clone())).collect() }
    }

    /// Whether there is no decision at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.by_id.is_empty()
    }

    /// Issues of the decisions that fit no building of a result.
    ///
    /// # Errors
    /// [`OutputError`] where the buildings cannot be read.
    pub fn unmatched<R: Records + ?Sized>(&self, records: &R) -> Result<Vec<Issue>, OutputError> {
        let mut lost: BTreeSet<&str> = self.by_id.keys().map(String::as_str).collect();
        if !lost.is_empty() {
            records.visit(&mut |record| {
                lost.remove(record.id.as_str());
                Ok(())
            })?;
        }
        let of_lost = lost.into_iter().map(|id| {
            let message = "it was reviewed, and is not among the buildings of this result".to_owned();
            Issue::new(Severity::Warning, "review_unmatched", Subject::Building(id.to_owned()), message)
                .hint("decisions are matched by id: name the same footprints.id_field as when it was reviewed")
        });
        Ok(of_lost.collect())
    }
}

impl Review {
    fn apply(&self, record: &mut BuildingRecord) {
        let height_m = self.height_m.filter(|_| self.decision != ReviewDecision::Wrong);
        let is_same = height_m.zip(record.height_m).is_some_and(|(now, found)| (now - found).abs() < SAME_M);
        if !is_same {
            // What was measured is of another height.
            record.roof = None;
            record.views.clear();
            record.height_m = height_m;
        }
        record.height_sigma_m = self.sigma_m.filter(|_| height_m.is_some());
        record.roof_sigma_m = None;
        let (status, reason) =
            if height_m.is_some() { (Status::Reviewed, REVIEWED) } else { (Status::Unknown, REVIEWED_WRONG) };
        record.status = status;
        record.reasons = vec![reason.to_owned()];
    }
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;
    use crate::output::record::tests::record;

    fn of(features: &str) -> Result<Reviews, String> {
        Reviews::parse(&format!(r#"{{"type": "FeatureCollection", "features": [{features}]}}"#))
    }

    fn feature(properties: &str) -> String {
        format!(r#"{{"type": "Feature", "geometry": null, "properties": {{{properties}}}}}"#)
    }

    fn records() -> Vec<BuildingRecord> {
        let footprint = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.0, y: 9.0)];
        let doubtful = |id: &str| BuildingRecord {
            status: Status::Doubtful,
            reasons: vec!["flat_score".to_owned()],
            views: vec!["1.jpg".to_owned()],
            ..record(id, footprint.clone(), 2.0, 1.5, 9.0)
        };
        ["a", "b", "c", "d"].map(doubtful).to_vec()
    }

    #[test]
    fn decisions_replace_heights_statuses_and_reasons() {
        let confirmed = feature(r#""building_id": "a", "decision": "confirmed", "height_m": 9.001, "sigma_m": 0.2"#);
        let corrected = feature(r#""building_id": "b", "decision": "corrected", "height_m": 12.5, "note": "a tower""#);
        let wrong = feature(r#""building_id": "c", "decision": "wrong", "height_m": null"#);
        let mut all = records();
        of(&[confirmed, corrected, wrong].join(",")).unwrap().apply(&mut all);
        let told: Vec<_> = all
            .iter()
            .map(|r| (r.status, r.height_m, r.height_sigma_m, r.reasons[0].as_str(), r.views.len()))
            .collect();
        assert_eq!(
            told,
            [
                (Status::Reviewed, Some(9.0), Some(0.2), "reviewed", 1),
                (Status::Reviewed, Some(12.5), None, "reviewed", 0),
                (Status::Unknown, None, None, "reviewed_wrong", 0),
                (Status::Doubtful, Some(9.0), Some(0.25), "flat_score", 1),
            ]
        );
    }

    #[test]
    fn a_decision_about_a_building_that_is_not_there_is_told() {
        let lost = of(&feature(r#""building_id": "z", "decision": "wrong""#)).unwrap();
        let issues = lost.unmatched(records().as_slice()).unwrap();
        assert_eq!((issues.len(), issues[0].code.as_str()), (1, "review_unmatched"));
    }

    #[test]
    fn decisions_that_are_none_are_refused_with_the_building() {
        for (properties, said) in [
            (r#""building_id": "a", "decision": "corrected""#, "a: height_m"),
            (r#""building_id": "a", "decision": "corrected", "height_m": -3"#, "a: height_m"),
            (r#""building_id": "a", "decision": "corrected", "height_m": 3, "sigma_m": -1"#, "a: sigma_m"),
            (r#""building_id": "a", "decision": "maybe""#, "maybe"),
        ] {
            let message = of(&feature(properties)).unwrap_err();
            assert!(message.contains(said), "{message}");
        }
        let twice = feature(r#""building_id": "a", "decision": "wrong""#);
        assert!(of(&format!("{twice},{twice}")).unwrap_err().contains("more than once"));
    }
}
