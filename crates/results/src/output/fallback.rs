//! Heights for buildings whose height is not known: none, an attribute of the input, or what the neighbours have.

use geo::Centroid as _;
use rstar::RTree;
use rstar::primitives::GeomWithData;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{BuildingRecord, Status};
use sizeup_heights::stats;

/// Where the height of a building comes from that the photos do not tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FallbackSource {
    /// From nowhere: it stays unknown.
    #[default]
    None,
    /// From an attribute of the footprint.
    Attribute,
    /// The median of the nearest buildings that were measured or reviewed.
    Neighbourhood,
}

/// Treatment of buildings whose height is not known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FallbackConfig {
    /// Where their height comes from; they then have the status `fallback`, and a reason that says which.
    pub source: FallbackSource,
    /// Attribute of the footprints that holds a height above ground or a number of storeys (`source = "attribute"`).
    pub attribute: Option<String>,
    /// Metres per unit of the attribute: 1 for heights in metres, about 3 for storeys.
    pub metres_per_unit: f64,
    /// Nearest measured buildings that the median is taken over (`source = "neighbourhood"`).
    #[schemars(extend("x-expert" = true))]
    pub n_neighbours: usize,
}

impl Default for FallbackConfig {
    fn default() -> Self {
        Self { source: FallbackSource::None, attribute: None, metres_per_unit: 1.0, n_neighbours: 5 }
    }
}

impl FallbackConfig {
    /// Fault of the settings, if any.
    #[must_use]
    pub fn fault(&self) -> Option<&'static str> {
        let is_positive = self.metres_per_unit > 0.0 && self.metres_per_unit.is_finite();
        match self.source {
            FallbackSource::Attribute if self.attribute.is_none() => {
                Some("source is \"attribute\", but no attribute is named")
            }
            FallbackSource::Attribute if !is_positive => Some("metres_per_unit has to be greater than 0"),
            FallbackSource::Neighbourhood if self.n_neighbours == 0 => Some("n_neighbours has to be 1 or more"),
            _ => None,
        }
    }
}

/// Gives heights to the buildings that have a ground and a footprint, but no height. The standard deviation of a
/// neighbourhood's height is that of the neighbours' heights (from their median absolute deviation).
pub fn fill(records: &mut [BuildingRecord], config: &FallbackConfig) {
    if config.source == FallbackSource::None {
        return;
    }
    let measured = RTree::bulk_load(records.iter().filter_map(measured_height).collect());
    for record in records.iter_mut().filter(|r| r.status == Status::Unknown && r.ground_z_m.is_some()) {
        let (found, reason) = match config.source {
            FallbackSource::Attribute => (of_attribute(record, config), "height_from_attribute"),
            _ => (of_neighbours(record, &measured, config.n_neighbours), "height_from_neighbours"),
        };
        match found {
            Some((height_m, sigma_m)) => {
                (record.height_m, record.height_sigma_m, record.status) = (Some(height_m), sigma_m, Status::Fallback);
                record.reasons.push(reason.to_owned());
            }
            None => record.reasons.push("no_fallback".to_owned()),
        }
        record.reasons.sort_unstable();
    }
}

type PlacedHeight = GeomWithData<[f64; 2], f64>;

fn measured_height(record: &BuildingRecord) -> Option<PlacedHeight> {
    let height_m = record.height_m.filter(|_| matches!(record.status, Status::Measured | Status::Reviewed))?;
    Some(PlacedHeight::new(place(record)?, height_m))
}

fn place(record: &BuildingRecord) -> Option<[f64; 2]> {
    record.footprint.as_ref()?.centroid().map(|p| [p.x(), p.y()])
}

fn of_attribute(record: &BuildingRecord, config: &FallbackConfig) -> Option<(f64, Option<f64>)> {
    let value = match record.attributes.get(config.attribute.as_deref()?)? {
        Value::Number(number) => number.as_f64()?,
        Value::String(text) => text.trim().parse().ok()?,
        _ => return None,
    };
    let height_m = value * config.metres_per_unit;
    (height_m > 0.0 && height_m.is_finite()).then_some((height_m, None))
}

fn of_neighbours(record: &BuildingRecord, measured: &RTree<PlacedHeight>, n: usize) -> Option<(f64, Option<f64>)> {
    let nearest = measured.nearest_neighbor_iter(&place(record)?);
    let heights_m: Vec<f64> = nearest.take(n).map(|near| near.data).collect();
    let median_m = stats::median(&heights_m)?;
    let deviations: Vec<f64> = heights_m.iter().map(|h| (h - median_m).abs()).collect();
    let sigma_m = stats::median(&deviations).map(|mad| stats::SIGMA_PER_MAD * mad).filter(|sigma_m| *sigma_m > 0.0);
    Some((median_m, sigma_m))
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};
    use geo_types::Polygon;
    use serde_json::json;

    use super::*;
    use crate::output::record::tests::record;

    fn at(x: f64) -> Polygon<f64> {
        Rect::new(coord! { x: x, y: 0.0 }, coord! { x: x + 10.0, y: 10.0 }).to_polygon()
    }

    fn unknown(id: &str, x: f64) -> BuildingRecord {
        BuildingRecord {
            height_m: None,
            height_sigma_m: None,
            status: Status::Unknown,
            reasons: vec!["seen_by_no_view".to_owned()],
            ..record(id, at(x), 3.0, 2.0, 0.0)
        }
    }

    fn street() -> Vec<BuildingRecord> {
        let mut street: Vec<_> = [(20.0, 8.0), (40.0, 9.0), (60.0, 10.0), (900.0, 70.0)]
            .map(|(x, h)| record(&format!("{x}"), at(x), 3.0, 2.0, h))
            .into();
        street.push(unknown("hidden", 0.0));
        street
    }

    #[test]
    fn a_building_takes_the_median_of_its_nearest_measured_neighbours() {
        let mut records = street();
        // A doubtful neighbour has no say.
        records.push(BuildingRecord { status: Status::Doubtful, ..record("odd", at(10.0), 3.0, 2.0, 90.0) });
        let config =
            FallbackConfig { source: FallbackSource::Neighbourhood, n_neighbours: 3, ..FallbackConfig::default() };
        fill(&mut records, &config);
        let hidden = &records[4];
        assert_eq!((hidden.height_m, hidden.status), (Some(9.0), Status::Fallback));
        assert!((hidden.height_sigma_m.unwrap() - stats::SIGMA_PER_MAD).abs() < 1e-9);
        assert_eq!(hidden.reasons, ["height_from_neighbours", "seen_by_no_view"]);
        assert_eq!(records[..4], street()[..4], "what is measured stays");
    }

    #[test]
    fn storeys_become_metres_and_what_has_none_stays_unknown() {
        let mut records = street();
        records.push(unknown("bare", 80.0));
        records[4].attributes.insert("storeys".to_owned(), json!("4"));
        records[5].attributes.insert("storeys".to_owned(), json!(-1));
        let config = FallbackConfig {
            source: FallbackSource::Attribute,
            attribute: Some("storeys".to_owned()),
            metres_per_unit: 3.0,
            ..FallbackConfig::default()
        };
        fill(&mut records, &config);
        assert_eq!((records[4].height_m, records[4].status), (Some(12.0), Status::Fallback));
        assert_eq!((records[5].height_m, records[5].status), (None, Status::Unknown));
        assert_eq!(records[5].reasons, ["no_fallback", "seen_by_no_view"]);
    }

    #[test]
    fn without_a_choice_nothing_is_made_up() {
        let mut records = street();
        fill(&mut records, &FallbackConfig::default());
        assert_eq!(records, street());
    }
}
