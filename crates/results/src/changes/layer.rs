//! `changes.gpkg`: one layer, a row per building or group, styled by class.

use std::path::Path;

use serde_json::Value;

use super::{Change, Class};
use crate::output::attributes::round_m;
use crate::output::geopackage::{FieldOf, NO_DATE, field, write_lineage};
use crate::output::{Lineage, OutputError, wkb};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_whole_by_name;
use sizeup_geo::geodata::features::ColumnKind::{Integer, Real, Text};
use sizeup_geo::geodata::features::{GeometryKind, LayerSpec, Row};
use sizeup_geo::geodata::gpkg;

/// Name of the layer.
pub const LAYER: &str = "changes";

/// Default style, exported from QGIS by `tests/qgis/styles.py`.
const STYLE: &str = include_str!("styles/changes.qml");

/// Between ids of a group, and between reasons.
const SEPARATOR: &str = "; ";

/// A column and how to fill it.
type ChangeField = FieldOf<Change>;

/// The columns, in their order.
const FIELDS: [ChangeField; 19] = [
    field("class", "Change", Text, "new, gone, raised, lowered, footprint_changed, same, unsure or outside", |c| {
        c.class.as_str().into()
    }),
    field("new_id", "New building", Text, "Id in the new result; of several that stand for each other, all", |c| {
        ids(&c.new_ids)
    }),
    field("old_id", "Old building", Text, "Id in the old result; of several that stand for each other, all", |c| {
        ids(&c.old_ids)
    }),
    field(
        "d_height_m",
        "Height difference (m)",
        Real,
        "New height above ground minus the old one, without what is common to all, metres",
        |c| number(c.d_height_m),
    ),
    field(
        "d_roof_z_m",
        "Roof level difference (m)",
        Real,
        "New level of the roof minus the old one, without what is common to all, metres",
        |c| number(c.d_roof_z_m),
    ),
    field(
        "d_ground_z_m",
        "Ground level difference (m)",
        Real,
        "New level of the ground minus the old one, as the results have them, metres",
        |c| number(c.d_ground_z_m),
    ),
    field("sigma_m", "Sigma of the difference (m)", Real, "One standard deviation of the differences, metres", |c| {
        number(c.sigma_m)
    }),
    field("z", "Difference in sigmas", Real, "The difference that decided, in sigmas", |c| number(c.z)),
    field("old_height_m", "Old height (m)", Real, "Height above ground in the old result, metres", |c| {
        number(c.old_height_m)
    }),
    field("new_height_m", "New height (m)", Real, "Height above ground in the new result, metres", |c| {
        number(c.new_height_m)
    }),
    field("old_area_m2", "Old area (m2)", Real, "Area of the footprint in the old result, m2", |c| {
        number(c.old_area_m2)
    }),
    field("new_area_m2", "New area (m2)", Real, "Area of the footprint in the new result, m2", |c| {
        number(c.new_area_m2)
    }),
    field("iou", "Common share", Real, "Intersection over union of the two footprints", |c| number(c.iou)),
    field(
        "gained_m2",
        "Footprint gained (m2)",
        Real,
        "What the footprint has won beyond the footprints' accuracy, m2",
        |c| number(c.gained_m2),
    ),
    field(
        "lost_m2",
        "Footprint lost (m2)",
        Real,
        "What the footprint has lost beyond the footprints' accuracy, m2",
        |c| number(c.lost_m2),
    ),
    field("n_old", "Old buildings", Integer, "Buildings of the old result in the group", |c| c.old_ids.len().into()),
    field("n_new", "New buildings", Integer, "Buildings of the new result in the group", |c| c.new_ids.len().into()),
    field("reasons", "Reasons", Text, "Why it is of its class, the decisive one first", |c| codes(c).into()),
    field("explanation", "In words", Text, "The reasons in words, with the figures", |c| c.explanation.as_str().into()),
];

fn codes(change: &Change) -> String {
    change.reasons.iter().map(|reason| reason.code()).collect::<Vec<_>>().join(SEPARATOR)
}

fn ids(ids: &[String]) -> Value {
    if ids.is_empty() { Value::Null } else { ids.join(SEPARATOR).into() }
}

fn number(value: Option<f64>) -> Value {
    value.map_or(Value::Null, |value| round_m(value).into())
}

/// Writes `path` whole or not at all.
///
/// # Errors
/// [`OutputError`]: GDAL, the file system.
pub fn write(path: &Path, changes: &[Change], crs: &Crs, lineage: &Lineage) -> Result<(), OutputError> {
    let timestamp = format!("{}T00:00:00.000Z", lineage.reference_date.as_deref().unwrap_or(NO_DATE));
    let columns = FIELDS.map(|(column, _)| column);
    let spec = LayerSpec {
        name: LAYER,
        description: "What became of each building between two results",
        geometry: GeometryKind::MultiPolygon,
        columns: &columns,
    };
    let row = |change: &Change| Row {
        wkb: (!change.footprint.0.is_empty()).then(|| wkb::multi_polygon(&change.footprint)),
        values: FIELDS.iter().map(|(_, of)| of(change)).collect(),
    };
    write_whole_by_name(path, |temporary| {
        gpkg::create::<OutputError>(temporary, crs.definition(), &timestamp, |writer| {
            writer.create_data_columns()?;
            writer.layer::<OutputError>(&spec, |push| in_drawing_order(changes).map(row).try_for_each(push))?;
            write_lineage(writer, lineage)?;
            Ok(writer.styles(&[(LAYER, STYLE)], &timestamp)?)
        })
    })
}

/// Changes in drawing order, what has changed last, so that it is drawn over what has not.
fn in_drawing_order(changes: &[Change]) -> impl Iterator<Item = &Change> {
    let of = |is_change: bool| changes.iter().filter(move |change| change.class.is_change() == is_change);
    of(false).chain(of(true))
}

/// The colour of a class on maps (Okabe and Ito's, told apart by colour-blind people too, and greys).
#[must_use]
pub fn colour(class: Class) -> [u8; 3] {
    match class {
        Class::New => [0, 158, 115],
        Class::Gone => [213, 94, 0],
        Class::Raised => [0, 114, 178],
        Class::Lowered => [86, 180, 233],
        Class::FootprintChanged => [204, 121, 167],
        Class::Same => [225, 225, 222],
        Class::Unsure => [240, 228, 66],
        Class::Outside => [170, 170, 175],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_style_has_every_class_in_its_colour() {
        for class in Class::ALL {
            let [r, g, b] = colour(class);
            assert!(STYLE.contains(&format!("= '{}'", class.as_str())), "{class:?}");
            assert!(STYLE.contains(&format!("value=\"{r},{g},{b},255\"")), "{class:?}");
        }
    }
}
