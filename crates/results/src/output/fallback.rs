//! Heights for buildings whose height is not known: none, an attribute of the input, or what the neighbours have.
//!
//! An attribute's value is a number, or text as `OpenStreetMap` has it: `12`, `12,5`, `12 m`, `40 ft`, `40'6"`, `3;4`. A value with a unit
//! is a height; a number alone counts as many units as [`FallbackConfig::metres_per_unit`] says; of several the greatest counts.
//! Values that cannot be read, or make a height outside of the range of heights, are refused with a reason that shows them.

use geo::Centroid as _;
use rstar::RTree;
use rstar::primitives::GeomWithData;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::unmeasured::ATTRIBUTE_REFUSED;
use super::{BuildingRecord, Status};
use sizeup_geo::geodata::vector::plain_text;
use sizeup_heights::scene::HeightBounds;
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
    /// Attribute of the footprints, or tag of OpenStreetMap, that holds a height above ground or a number of storeys
    /// (`source = "attribute"`): a number, or a text such as `12,5`, `12 m`, `40 ft` or `3;4` (the greatest counts).
    pub attribute: Option<String>,
    /// Metres per unit of the attribute: 1 for heights in metres, about 3 for storeys. Values with a unit of their own take that.
    pub metres_per_unit: f64,
    /// Nearest measured buildings that the median is taken over (`source = "neighbourhood"`).
    #[serde(skip)]
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
            _ => None,
        }
    }
}

/// Gives heights to the buildings that have a ground and a footprint, but no height. Heights of attributes lie within `bounds`. The
/// standard deviation of a neighbourhood's height is that of the neighbours' heights (from their median absolute deviation).
pub fn fill(records: &mut [BuildingRecord], config: &FallbackConfig, bounds: HeightBounds) {
    if config.source == FallbackSource::None {
        return;
    }
    let measured = RTree::bulk_load(records.iter().filter_map(measured_height).collect());
    for record in records.iter_mut().filter(|r| r.status == Status::Unknown && r.ground_z_m.is_some()) {
        let (found, reason) = match config.source {
            FallbackSource::Attribute => (of_attribute(record, config, bounds), "height_from_attribute"),
            _ => (Ok(of_neighbours(record, &measured, config.n_neighbours)), "height_from_neighbours"),
        };
        match found {
            Ok(Some((height_m, sigma_m))) => {
                (record.height_m, record.height_sigma_m, record.status) = (Some(height_m), sigma_m, Status::Fallback);
                record.reasons.push(reason.to_owned());
            }
            Ok(None) => record.reasons.push("no_fallback".to_owned()),
            Err(refusal) => record.reasons.extend(["no_fallback".to_owned(), refusal]),
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

/// `None` where there is no value.
///
/// # Errors
/// A reason that shows a value that is no height.
fn of_attribute(
    record: &BuildingRecord,
    config: &FallbackConfig,
    bounds: HeightBounds,
) -> Result<Option<(f64, Option<f64>)>, String> {
    let name = config.attribute.as_deref().unwrap_or_default();
    let Some(value) = sizeup_footprints::attribute(&record.attributes, name) else { return Ok(None) };
    let refused = |what: &str| Err(format!("{ATTRIBUTE_REFUSED}{name} = {} {what}", shown(&value)));
    let Some(height_m) = height_m(&value, config.metres_per_unit) else { return refused("is no height") };
    let HeightBounds { min_m, max_m } = bounds;
    if height_m < f64::from(min_m) {
        return refused(&format!("({height_m} m) is below heights.min_m of {min_m} m"));
    }
    if height_m > f64::from(max_m) {
        return refused(&format!("({height_m} m) is above heights.max_m of {max_m} m"));
    }
    Ok(Some((height_m, None)))
}

/// Longest part of a value that a reason shows, characters.
const LONGEST_SHOWN: usize = 40;

/// A value as a reason shows it; reasons are separated by a semicolon and a space.
fn shown(value: &Value) -> String {
    let text = if value.is_number() { plain_text(value) } else { value.to_string() };
    text.replace("; ", ";").chars().take(LONGEST_SHOWN).collect()
}

/// Metres by a value of an attribute; `None` where it is no number with a unit or without.
fn height_m(value: &Value, metres_per_unit: f64) -> Option<f64> {
    let height_m = match value {
        Value::Number(number) => metres_per_unit * number.as_f64()?,
        Value::String(text) => {
            let heights = text.split(';').map(|one| height_of_text_m(one.trim(), metres_per_unit));
            heights.collect::<Option<Vec<f64>>>()?.into_iter().reduce(f64::max)?
        }
        _ => return None,
    };
    height_m.is_finite().then_some(height_m)
}

/// Names of units as people write them behind a number, lower case.
const METRES: [&str; 5] = ["m", "metre", "metres", "meter", "meters"];
const FEET: [&str; 6] = ["feet", "foot", "ft", "'", "\u{2032}", "\u{2019}"];
const INCHES: [&str; 7] = ["inches", "inch", "in", "\"", "\u{2033}", "\u{201d}", "''"];
/// The international foot and inch, metres.
const FOOT_M: f64 = 0.3048;
const INCH_M: f64 = 0.0254;

fn height_of_text_m(text: &str, metres_per_unit: f64) -> Option<f64> {
    if let Ok(number) = text.parse::<f64>() {
        return Some(metres_per_unit * number);
    }
    let (number, unit) = leading_number(text)?;
    if unit.is_empty() {
        return Some(metres_per_unit * number);
    }
    if METRES.contains(&unit.as_str()) {
        return Some(number);
    }
    let behind_feet = FEET.iter().find_map(|feet| unit.strip_prefix(feet))?.trim_start();
    if behind_feet.is_empty() {
        return Some(FOOT_M * number);
    }
    let (inches, unit) = leading_number(behind_feet)?;
    INCHES.contains(&unit.as_str()).then_some(FOOT_M * number + INCH_M * inches)
}

/// The number at the start of a text, with a point or a comma before its decimals, and what comes behind it in lower case.
fn leading_number(text: &str) -> Option<(f64, String)> {
    let end = text.find(|c: char| !(c.is_ascii_digit() || "+-.,".contains(c))).unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    let has_point = number.contains('.');
    let number = if has_point { number.to_owned() } else { number.replacen(',', ".", 1) };
    Some((number.parse().ok()?, unit.trim().trim_end_matches('.').to_lowercase()))
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

    const BOUNDS: HeightBounds = HeightBounds { min_m: 2.0, max_m: 150.0 };

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
        fill(&mut records, &config, BOUNDS);
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
        fill(&mut records, &config, BOUNDS);
        assert_eq!((records[4].height_m, records[4].status), (Some(12.0), Status::Fallback));
        assert_eq!((records[5].height_m, records[5].status), (None, Status::Unknown));
        let refusal = "attribute_refused: storeys = -1 (-3 m) is below heights.min_m of 2 m";
        assert_eq!(records[5].reasons, [refusal, "no_fallback", "seen_by_no_view"]);
    }

    fn from_attribute(value: Value, metres_per_unit: f64) -> BuildingRecord {
        let mut records = vec![unknown("a", 0.0)];
        records[0].attributes.insert("h".to_owned(), value);
        let (source, attribute) = (FallbackSource::Attribute, Some("h".to_owned()));
        let config = FallbackConfig { source, attribute, metres_per_unit, ..FallbackConfig::default() };
        fill(&mut records, &config, BOUNDS);
        records.remove(0)
    }

    #[test]
    fn heights_with_units_commas_and_several_values_are_read_as_people_write_them() {
        let of = |text: &str| from_attribute(json!(text), 1.0).height_m;
        for (text, height_m) in [
            ("12", 12.0),
            (" 12.5 ", 12.5),
            ("12,5", 12.5),
            ("12 m", 12.0),
            ("12,5m", 12.5),
            ("12 Metres", 12.0),
            ("40 ft", 12.192),
            ("40ft.", 12.192),
            ("40'", 12.192),
            ("40'6\"", 12.3444),
            ("40 ft 6 in", 12.3444),
            ("3;4", 4.0),
            ("9 m; 40 ft", 12.192),
        ] {
            assert!(of(text).is_some_and(|found| (found - height_m).abs() < 1e-9), "{text}: {:?}", of(text));
        }
        assert_eq!(from_attribute(json!("12 m"), 3.0).height_m, Some(12.0), "a height, whatever a storey has");
        assert_eq!(from_attribute(json!("3;4"), 3.0).height_m, Some(12.0));
    }

    #[test]
    fn what_is_no_height_is_refused_by_a_reason_that_shows_it() {
        let refused = |value: Value, says: &str| {
            let record = from_attribute(value, 1.0);
            assert_eq!((record.height_m, record.status), (None, Status::Unknown), "{record:?}");
            assert!(record.reasons[0].starts_with("attribute_refused: h = "), "{:?}", record.reasons);
            assert!(record.reasons[0].ends_with(says), "{:?}", record.reasons);
        };
        refused(json!("twelve"), "h = \"twelve\" is no height");
        for text in ["", "~12", "12 cm", "1,234.5 m", "3;?", "12 m high", "3-4", "nan"] {
            refused(json!(text), " is no height");
        }
        refused(json!(true), "h = true is no height");
        refused(json!("9999"), "h = \"9999\" (9999 m) is above heights.max_m of 150 m");
        refused(json!(1e6), "h = 1000000 (1000000 m) is above heights.max_m of 150 m");
        refused(json!(0), "h = 0 (0 m) is below heights.min_m of 2 m");
        refused(json!(-9.5), "below heights.min_m of 2 m");
        assert_eq!(
            from_attribute(Value::Null, 1.0).reasons,
            ["no_fallback", "seen_by_no_view"],
            "nothing is shown of nothing"
        );
    }

    #[test]
    fn tags_of_openstreetmap_are_attributes() {
        let mut records = vec![unknown("a", 0.0)];
        records[0].attributes.insert("other_tags".to_owned(), json!(r#""building:levels"=>"4","height"=>"40 ft""#));
        let of = |name: &str, metres_per_unit: f64| {
            let (source, attribute) = (FallbackSource::Attribute, Some(name.to_owned()));
            let config = FallbackConfig { source, attribute, metres_per_unit, ..FallbackConfig::default() };
            let mut records = records.clone();
            fill(&mut records, &config, BOUNDS);
            records[0].height_m
        };
        assert_eq!(of("building:levels", 3.0), Some(12.0));
        assert_eq!(of("height", 1.0), Some(12.192));
        assert_eq!(of("roof:height", 1.0), None);
    }

    #[test]
    fn without_a_choice_nothing_is_made_up() {
        let mut records = street();
        fill(&mut records, &FallbackConfig::default(), BOUNDS);
        assert_eq!(records, street());
    }
}
