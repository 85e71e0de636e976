//! The attributes of a building as all formats write them: one list of names, units and meanings.
//!
//! Numbers in metres are rounded to [`DECIMALS_M`] decimals (a millimetre), below anything that is measured here.
//! The user's own attributes follow under their own names; one that would hide ours is written as `input_<name>`.

use geo::{Area as _, MinimumRotatedRect as _};
use geo_types::Polygon;
use serde_json::{Map as JsonMap, Number, Value};

use super::facts::SolidFacts;
use super::{BuildingRecord, HeightReference, RoofForm, Status};
use sizeup_geo::geodata::features::{Column, ColumnKind};
use sizeup_heights::optimise::Terrace;

/// Decimals of a metre in files.
const DECIMALS_M: i32 = 3;

/// `CityGML`'s name of a building's height.
pub const MEASURED_HEIGHT: &str = "measuredHeight";

/// Prefix of a user's attribute whose name is taken.
const CARRIED_PREFIX: &str = "input_";

/// One of our attributes: its column, and its value for a building whose solid is known.
#[derive(Debug, Clone)]
pub struct Field {
    /// Column of the attribute: its name, type and meaning.
    pub column: Column,
    value: fn(&BuildingRecord, &SolidFacts) -> Value,
}

impl Field {
    const fn new(
        name: &'static str,
        title: &'static str,
        kind: ColumnKind,
        meaning: &'static str,
        value: fn(&BuildingRecord, &SolidFacts) -> Value,
    ) -> Self {
        Self { column: Column::new(name, title, kind, meaning), value }
    }

    /// Value; [`Value::Null`] if not known. Lists stay lists.
    #[must_use]
    pub fn value(&self, record: &BuildingRecord, solid: &SolidFacts) -> Value {
        (self.value)(record, solid)
    }

    /// Whether it holds a list, which formats without lists write as text.
    #[must_use]
    pub fn is_list(&self) -> bool {
        matches!(&*self.column.name, "reasons" | "views" | "solid_faults")
    }
}

/// Our own attributes in the order in which they are written; the id comes before them. Names are told apart by their
/// first ten characters, which is all that a Shapefile keeps.
pub const FIELDS: [Field; 38] = {
    use ColumnKind::{Integer, Real, Text};
    [
        Field::new(
            "part_of",
            "Part of",
            Text,
            "Building of the input that this is a part of, where it has several",
            |b, _| text(b.part_of.as_deref()),
        ),
        Field::new("height_m", "Height (m)", Real, "Roof level minus ground level, metres", |b, _| known(b.height_m)),
        Field::new(
            "ground_z_m",
            "Ground level (m)",
            Real,
            "Ground level the height counts from, metres in the vertical reference",
            |b, _| known(b.ground_z_m),
        ),
        Field::new(
            "base_z_m",
            "Base level (m)",
            Real,
            "Lowest ground under the footprint, where walls end, metres",
            |b, _| known(b.base_z_m),
        ),
        Field::new(
            "ground_min_z_m",
            "Lowest ground at the walls (m)",
            Real,
            "Lowest ground along the outline of the building, each metre and at its corners, metres in the vertical reference; its standard \
             deviation is ground_sigma_m. Empty where the terrain has no value there",
            |b, _| known(b.ground_ends_z_m.map(|[lowest, _]| lowest)),
        ),
        Field::new(
            "ground_max_z_m",
            "Highest ground at the walls (m)",
            Real,
            "Highest ground along the outline of the building, likewise: less ground_min_z_m it is what the ground falls from back to front",
            |b, _| known(b.ground_ends_z_m.map(|[_, highest]| highest)),
        ),
        Field::new("roof_z_m", "Roof level (m)", Real, "Roof level, metres in the vertical reference", |b, _| {
            known(b.roof_z_m())
        }),
        Field::new("height_sigma_m", "Height sigma (m)", Real, "One standard deviation of height_m, metres", |b, _| {
            known(b.height_sigma_m)
        }),
        Field::new(
            "roof_sigma_m",
            "Roof level sigma (m)",
            Real,
            "One standard deviation of roof_z_m, metres",
            |b, _| known(b.roof_sigma_m),
        ),
        Field::new(
            "ground_sigma_m",
            "Ground sigma (m)",
            Real,
            "One standard deviation of ground_z_m, ground_min_z_m and ground_max_z_m, metres; empty where no photo shows the ground around the building: height_sigma_m is then \
             that of the roof level alone",
            |b, _| known(b.ground_sigma_m),
        ),
        Field::new(
            "height_reference",
            "Height stands for",
            Text,
            "Which height of a pitched roof: eave, mean or ridge",
            |b, _| b.height_reference.as_str().into(),
        ),
        Field::new(
            "roof_form",
            "Roof form",
            Text,
            "Form of the roof: flat (or no other form seen), gable, hip or stepped (two levels)",
            |b, _| text(b.roof.map(|roof| roof.form.as_str())),
        ),
        Field::new(
            "form_certainty",
            "Certainty of the form",
            Real,
            "How certain the form of the roof is, 0 to 1: the share of simulated roofs called so, as clearly, that are; empty where no form was \
             looked for, and where the photos took another form",
            |b, _| known(b.roof.and_then(|roof| roof.certainty)),
        ),
        Field::new(
            "eave_height_m",
            "Eave height (m)",
            Real,
            "Lowest edge of the roof above ground level, metres",
            |b, _| known(b.roof.map(|roof| roof.eave_height_m)),
        ),
        Field::new(
            "ridge_height_m",
            "Ridge height (m)",
            Real,
            "Highest line of the roof above ground level, metres",
            |b, _| known(b.roof.map(|roof| roof.ridge_height_m)),
        ),
        Field::new(
            "ridge_azimuth_deg",
            "Direction of the ridge (degrees)",
            Real,
            "Where the ridge of a gable runs, the main body's where there are wings: degrees clockwise from grid north, 0 to 180",
            |b, _| known(b.roof.and_then(|roof| roof.ridge_azimuth_deg)),
        ),
        Field::new(
            "roof_step",
            "Plan of the roof's step",
            Text,
            "Of a stepped roof, JSON: the rectangle (`corners`, map coordinates) of the upper level (`is_upper`) or the lower one",
            |b, _| b.roof.and_then(|roof| roof.step).map_or(Value::Null, |step| roof_step(step).into()),
        ),
        Field::new(
            "roof_70p_z_m",
            "Roof level, 70th percentile (m)",
            Real,
            "Level that 70 % of the roof's area lies below, metres in the vertical reference: of flat and stepped roofs, and of \
             gables and hips over rectangles; empty where the roof's form is not known or does not tell it (other footprints)",
            |b, _| known(roof_70p_z_m(b)),
        ),
        Field::new(
            "roof_planes",
            "Planes of the roof",
            Text,
            "JSON, the largest plane first: its own area (`area_m2`), its slope (`slope_deg`, 0 flat) and where it falls \
             (`aspect_deg`, clockwise from grid north); empty where the roof's form is not known",
            |_, solid| match solid.roof.as_slice() {
                [] => Value::Null,
                planes => serde_json::to_string(planes).unwrap_or_default().into(),
            },
        ),
        Field::new(
            "storeys_estimated",
            "Storeys above ground (estimated)",
            Integer,
            "Estimated storeys above ground, without the attic: eave height by 3 m, rounded, at least 1",
            |b, _| storeys(b).map_or(Value::Null, |storeys| storeys.n.into()),
        ),
        Field::new("sigma_storeys", "Sigma of that", Real, "One standard deviation of storeys_estimated", |b, _| {
            known(storeys(b).map(|storeys| storeys.sigma))
        }),
        Field::new(
            "footprint_area_m2",
            "Footprint area (m2)",
            Real,
            "Area of the footprint without its courtyards, m2; also that of the block's roof and floor",
            |b, _| known(b.footprint.as_ref().map(geo::Area::unsigned_area)),
        ),
        Field::new(
            "off_east_m",
            "Footprint is off to the east (m)",
            Real,
            "By how much the footprint lies east of where the photos show the building, metres; empty where it fits, or too little is seen \
             to say",
            |b, _| known(b.footprint_shift.map(|shift| shift.east_m)),
        ),
        Field::new(
            "off_north_m",
            "Footprint is off to the north (m)",
            Real,
            "By how much the footprint lies north of where the photos show the building, metres",
            |b, _| known(b.footprint_shift.map(|shift| shift.north_m)),
        ),
        Field::new(
            "off_sigma_m",
            "Sigma of that (m)",
            Real,
            "One standard deviation of off_east_m and of off_north_m, metres",
            |b, _| known(b.footprint_shift.map(|shift| shift.sigma_m)),
        ),
        Field::new(
            "too_large_m",
            "Walls are too far out (m)",
            Real,
            "By how much the walls of the footprint stand farther out than the roof that the photos show, metres, compared with the other \
             footprints; negative where the roof reaches beyond them; 0 where neither is told",
            |b, _| known(b.footprint_shift.map(|shift| shift.too_large_m)),
        ),
        Field::new("solid_volume_m3", "Volume (m3)", Real, "Volume of the block, m3", |_, solid| {
            known(solid.measures.map(|measures| measures.volume_m3))
        }),
        Field::new(
            "wall_area_m2",
            "Wall area (m2)",
            Real,
            "Walls of the block from base to roof, courtyards' and party walls too, m2",
            |_, solid| known(solid.measures.map(|measures| measures.walls_m2)),
        ),
        Field::new(
            "lod2_volume_m3",
            "Volume with the roof (m3)",
            Real,
            "Volume of the solid with its roof (LOD 2.0), m3; that of the block where the roof is flat or not known",
            |_, solid| known(solid.roofed_measures.map(|measures| measures.volume_m3)),
        ),
        Field::new(
            "lod2_wall_area_m2",
            "Wall area with gables (m2)",
            Real,
            "Walls of the solid with its roof (LOD 2.0), gable ends, steps and party walls too, m2",
            |_, solid| known(solid.roofed_measures.map(|measures| measures.walls_m2)),
        ),
        Field::new(
            "party_wall_area_m2",
            "Party wall area (m2)",
            Real,
            "Of the walls, those that stand against a neighbour's, m2; empty where neighbours were not looked at",
            |b, solid| known(b.party_wall_m2.filter(|_| solid.measures.is_some())),
        ),
        Field::new(
            "status",
            "Status",
            Text,
            "measured, reviewed, given, doubtful, fallback, unknown or refused",
            |b, _| b.status.as_str().into(),
        ),
        Field::new(
            "quality_ok",
            "Fit for use",
            Integer,
            "1 where the height is measured, reviewed or given without doubt and the solid is valid, else 0",
            |b, solid| {
                let is_known = matches!(b.status, Status::Measured | Status::Reviewed | Status::Given);
                i64::from(is_known && solid.is_valid()).into()
            },
        ),
        Field::new("reasons", "Reasons", Text, "Why the status is what it is", |b, _| b.reasons.clone().into()),
        Field::new("n_views", "Photos", Integer, "Number of photos the height was measured in", |b, _| {
            b.views.len().into()
        }),
        Field::new("views", "Names of the photos", Text, "Photos the height was measured in", |b, _| {
            b.views.clone().into()
        }),
        Field::new(
            "solid_faults",
            "Faults of the solid",
            Text,
            "val3dity's codes of what `sizeup check` finds in the solid; an empty list or text: it is valid",
            |_, solid| match solid.measures {
                Some(_) => solid.faults.iter().map(u16::to_string).collect::<Vec<_>>().into(),
                None => Value::Null,
            },
        ),
        Field::new(
            "no_solid_reason",
            "Why no solid",
            Text,
            "Why the building has no 3D geometry, where it has none",
            |_, solid| text(solid.no_solid_reason),
        ),
    ]
};

/// Height of a storey, metres: what is usual where nothing better is known (Roy, Pronk, Agugiaro and Ledoux 2023,
/// doi:10.1080/13658816.2022.2160454, section 1, on the geometric method).
const STOREY_M: f64 = 3.0;
/// Standard deviation of storeys by an exact height: the same source finds the geometric method right for somewhat less than 70 % of
/// 172,000 Dutch homes, as a normal error of 0.5 storeys is (68 % within half a storey).
const STOREY_SIGMA: f64 = 0.5;

/// Storeys above ground.
struct Storeys {
    n: i64,
    sigma: f64,
}

/// Estimates the storeys of a building, without its attic: `n = max(1, round(h / 3 m))`, `h` the height of the eaves, or of the roof
/// where its form is not known.
fn storeys(record: &BuildingRecord) -> Option<Storeys> {
    let height_m =
        record.roof.map(|roof| roof.eave_height_m).or(record.height_m).filter(|_| record.height_m.is_some())?;
    let of_height = record.height_sigma_m.unwrap_or(0.0) / STOREY_M;
    Some(Storeys { n: (height_m / STOREY_M).round().max(1.0) as i64, sigma: STOREY_SIGMA.hypot(of_height) })
}

/// Estimates the storeys of a building above ground, without its attic.
#[must_use]
pub fn n_storeys(record: &BuildingRecord) -> Option<i64> {
    storeys(record).map(|storeys| storeys.n)
}

/// A step as text, rounded as all metres are.
fn roof_step(step: Terrace) -> String {
    let corners = step.corners.map(|corner| corner.map(round_m));
    serde_json::to_string(&Terrace { corners, ..step }).unwrap_or_default()
}

/// A footprint that fills this share of the smallest rectangle around it is one: the rest moves a percentile of a slope by no
/// more than the same share of its rise.
const RECTANGLE_SHARE: f64 = 0.98;

/// The level below which 70 % of a roof's area lies, metres in the vertical reference, where its form tells it.
///
/// ```text
/// flat      the roof level
/// stepped   the lower level where it holds 70 % of the area, else the upper one;
///           the lower one's share is (ridge − mean) / (ridge − eave)
/// gable     eave + 0.7 (ridge − eave)                              over a rectangle
/// hip       eave + t (ridge − eave),  (1 − t)(1 − k t) = 0.3         over a rectangle, k: its shorter side by its longer
/// ```
/// Over other footprints the area between eave and ridge depends on where the ridge lies: `None`.
#[must_use]
pub fn roof_70p_z_m(record: &BuildingRecord) -> Option<f64> {
    const SHARE: f64 = 0.7;
    let (roof, ground_z_m) = (record.roof?, record.ground_z_m?);
    let rise_m = roof.ridge_height_m - roof.eave_height_m;
    let height_m = match roof.form {
        RoofForm::Flat => return record.roof_z_m(),
        RoofForm::Stepped if record.height_reference == HeightReference::Mean => {
            let lower_share = (roof.ridge_height_m - record.height_m?) / rise_m;
            // A mean beside both levels is not of this roof.
            (0.0..=1.0).contains(&lower_share).then_some(())?;
            if lower_share >= SHARE { roof.eave_height_m } else { roof.ridge_height_m }
        }
        RoofForm::Gable => {
            rectangle_sides_m(record.footprint.as_ref()?)?;
            roof.eave_height_m + SHARE * rise_m
        }
        RoofForm::Hip => {
            let [shorter_m, longer_m] = rectangle_sides_m(record.footprint.as_ref()?)?;
            let k = shorter_m / longer_m;
            let t = (1.0 + k - ((1.0 + k).powi(2) - 4.0 * SHARE * k).sqrt()) / (2.0 * k);
            roof.eave_height_m + t * rise_m
        }
        RoofForm::Stepped => return None,
    };
    Some(ground_z_m + height_m)
}

/// The shorter and the longer side of a footprint that is a rectangle, metres; `None` for one that is not.
fn rectangle_sides_m(footprint: &Polygon<f64>) -> Option<[f64; 2]> {
    let rectangle = footprint.minimum_rotated_rect()?;
    let corners = &rectangle.exterior().0;
    let side = |from: usize| (corners[from + 1].x - corners[from].x).hypot(corners[from + 1].y - corners[from].y);
    let sides = [side(0).min(side(1)), side(0).max(side(1))];
    (footprint.unsigned_area() >= RECTANGLE_SHARE * sides[0] * sides[1] && sides[0] > 0.0).then_some(sides)
}

fn known(value_m: Option<f64>) -> Value {
    value_m.map_or(Value::Null, metres)
}

fn text(value: Option<&str>) -> Value {
    value.map_or(Value::Null, Value::from)
}

/// The id, before [`FIELDS`] in formats that have no place of their own for it.
pub const ID: Column = Column::new("id", "Building", ColumnKind::Text, "Id of the building in the input");

/// Names that a format needs for itself, beside [`FIELDS`].
const RESERVED: [&str; 5] = ["id", "fid", "geom", "measuredheight", "rtree"];

/// A number of metres as written in files.
#[must_use]
pub fn metres(value_m: f64) -> Value {
    Number::from_f64(round_m(value_m)).map_or(Value::Null, Value::Number)
}

/// Rounded to a millimetre, without a negative zero.
#[must_use]
pub fn round_m(value_m: f64) -> f64 {
    let factor = 10_f64.powi(DECIMALS_M);
    (value_m * factor).round() / factor + 0.0
}

/// Under which name a user's attribute is written.
#[must_use]
pub fn carried_name(name: &str) -> String {
    if is_taken(name) { format!("{CARRIED_PREFIX}{name}") } else { name.to_owned() }
}

/// The user's name of a carried attribute: the inverse of [`carried_name`].
#[must_use]
pub fn original_name(name: &str) -> &str {
    match name.strip_prefix(CARRIED_PREFIX) {
        Some(original) if is_taken(original) => original,
        _ => name,
    }
}

/// Whether an attribute name is ours, compared without case as `GeoPackage` does.
#[must_use]
pub fn is_taken(name: &str) -> bool {
    let lower = name.to_lowercase();
    RESERVED.contains(&lower.as_str()) || is_field(&lower)
}

/// Whether it is the name of a field of ours.
#[must_use]
pub fn is_field(name: &str) -> bool {
    FIELDS.iter().any(|field| field.column.name == name)
}

/// Our own attributes where known, and `measuredHeight`.
#[must_use]
pub fn own(record: &BuildingRecord, solid: &SolidFacts) -> JsonMap<String, Value> {
    let mut attributes = JsonMap::new();
    if let Some(height_m) = record.height_m {
        attributes.insert(MEASURED_HEIGHT.to_owned(), metres(height_m));
    }
    for field in &FIELDS {
        let value = field.value(record, solid);
        if !value.is_null() {
            attributes.insert(field.column.name.as_ref().to_owned(), value);
        }
    }
    attributes
}

/// The user's own attributes under the names they have in files.
pub fn carried(record: &BuildingRecord) -> impl Iterator<Item = (String, Value)> {
    record.attributes.iter().map(|(name, value)| (carried_name(name), value.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_taken_name_is_carried_beside_ours_and_finds_back() {
        for name in ["height_m", "STATUS", "fid", "measuredHeight"] {
            assert_eq!(carried_name(name), format!("input_{name}"));
            assert_eq!(original_name(&carried_name(name)), name);
        }
        assert_eq!((carried_name("street").as_str(), original_name("input_street")), ("street", "input_street"));
    }

    #[test]
    fn a_shapefile_tells_all_names_apart() {
        let short: std::collections::BTreeSet<String> =
            FIELDS.iter().map(|field| field.column.name.chars().take(10).collect()).collect();
        assert_eq!(short.len(), FIELDS.len());
        assert!(FIELDS.iter().all(|field| !field.column.title.is_empty()));
    }

    use crate::output::RoofShape;
    use geo_types::polygon;

    /// A house of 16 m by 8 m, turned by 30°, on ground at 100 m, with a roof from 4 m to 9 m and a mean height.
    fn house(form: RoofForm, mean_m: f64) -> BuildingRecord {
        let turned = |x: f64, y: f64| (0.866_025_4 * x - 0.5 * y, 0.5 * x + 0.866_025_4 * y);
        let footprint = Polygon::new(
            [(0.0, 0.0), (16.0, 0.0), (16.0, 8.0), (0.0, 8.0)].map(|(x, y)| turned(x, y)).to_vec().into(),
            vec![],
        );
        let roof = RoofShape::new(form, 4.0, 9.0);
        BuildingRecord { roof: Some(roof), ..crate::output::record::tests::record("a", footprint, 100.0, 99.0, mean_m) }
    }

    /// The level below which 70 % of a roof lies that rises from 4 m to 9 m by shares of a house of 16 m by 8 m, counted.
    fn counted_70p_z_m(rise_share: impl Fn(f64, f64) -> f64) -> f64 {
        let middles = |n: usize| (0..n).map(|i| i as f64 + 0.5);
        let places = middles(320).flat_map(|x| middles(160).map(move |y| (x / 20.0, y / 20.0)));
        let mut levels: Vec<f64> = places.map(|(x, y)| 104.0 + 5.0 * rise_share(x, y)).collect();
        levels.sort_by(f64::total_cmp);
        levels[levels.len() * 7 / 10]
    }

    #[test]
    fn seventy_percent_of_a_roof_lie_below_its_70th_percentile() {
        let to_wall = |x: f64, y: f64| x.min(16.0 - x).min(y).min(8.0 - y);
        let gable = counted_70p_z_m(|_, y| 1.0 - (y - 4.0).abs() / 4.0);
        let hip = counted_70p_z_m(|x, y| to_wall(x, y) / 4.0);
        for (form, mean_m, expected) in [(RoofForm::Gable, 6.5, gable), (RoofForm::Hip, 6.083, hip)] {
            let found = roof_70p_z_m(&house(form, mean_m)).unwrap();
            // Places 5 cm apart: levels are counted in steps of 6 cm.
            assert!((found - expected).abs() < 0.035, "{form:?}: {found} for {expected}");
        }
        // Lower over three quarters, and over half of the area.
        for (x, expected) in [(12.0, 104.0), (8.0, 109.0)] {
            assert_eq!(counted_70p_z_m(|at, _| if at < x { 0.0 } else { 1.0 }), expected);
            let mean_m = 4.0 + 5.0 * (1.0 - x / 16.0);
            assert_eq!(roof_70p_z_m(&house(RoofForm::Stepped, mean_m)), Some(expected));
        }
        assert_eq!(roof_70p_z_m(&house(RoofForm::Flat, 6.5)), Some(106.5));
    }

    #[test]
    fn a_percentile_that_the_record_does_not_tell_is_left_out() {
        let unseen = BuildingRecord { roof: None, ..house(RoofForm::Gable, 6.5) };
        let of_ridge = BuildingRecord { height_reference: HeightReference::Ridge, ..house(RoofForm::Stepped, 9.0) };
        for record in [unseen, of_ridge, house(RoofForm::Stepped, 12.0)] {
            assert_eq!(roof_70p_z_m(&record), None, "{record:?}");
        }
        // Over an L the ridge of a gable may lie anywhere.
        let l = polygon![(x: 0.0, y: 0.0), (x: 16.0, y: 0.0), (x: 16.0, y: 4.0), (x: 6.0, y: 4.0), (x: 6.0, y: 8.0), (x: 0.0, y: 8.0)];
        for form in [RoofForm::Gable, RoofForm::Hip] {
            let record = BuildingRecord { footprint: Some(l.clone()), ..house(form, 6.0) };
            assert_eq!(roof_70p_z_m(&record), None, "{form:?}");
        }
    }

    #[test]
    fn metres_have_three_decimals_and_no_negative_zero() {
        assert_eq!(metres(12.345_678).to_string(), "12.346");
        assert_eq!(metres(-0.000_1).to_string(), "0.0");
        assert_eq!(metres(f64::NAN), Value::Null);
    }
}
