//! Footprints with all attributes as rows of a table: what `GeoPackage` and `FlatGeobuf` share.

use std::collections::BTreeMap;

use serde_json::Value;

use super::attributes::{self, FIELDS, Field, ID};
use super::facts::SolidFacts;
use super::grid::OutputGrid;
use super::{BuildingRecord, OutputError, Overview, Records, wkb};
use sizeup_geo::geodata::features::{Column, ColumnKind, Row, free_title};

/// Between the items of a list in a text column.
pub const LIST_SEPARATOR: &str = "; ";

/// The columns of all buildings, and how a building becomes a row.
#[derive(Debug)]
pub struct FootprintRows {
    /// The id, ours, then the user's.
    pub columns: Vec<Column>,
    carried: Vec<Carried>,
    grid: OutputGrid,
    min_thickness_m: f64,
}

impl FootprintRows {
    /// For the buildings of an overview; grid and thickness tell which have a solid.
    #[must_use]
    pub fn new(overview: &Overview, grid: OutputGrid, min_thickness_m: f64) -> Self {
        Self { columns: columns(overview), carried: carried_columns(overview), grid, min_thickness_m }
    }

    /// For all buildings of a model on a grid of this scale, and what there is of them.
    ///
    /// # Errors
    /// [`OutputError`]: duplicate ids, a scene larger than the grid.
    pub fn of<R: Records + ?Sized>(
        records: &R,
        scale_m: f64,
        min_thickness_m: f64,
    ) -> Result<(Overview, Self), OutputError> {
        let overview = Overview::of(records)?;
        let footprints = Self::new(&overview, overview.grid(scale_m)?, min_thickness_m);
        Ok((overview, footprints))
    }

    /// Attributes of one building, in the order of the columns.
    #[must_use]
    pub fn row(&self, record: &BuildingRecord) -> Row {
        let (_, solid) = SolidFacts::of(record, &self.grid, self.min_thickness_m);
        let mut values = own_values(record, &FIELDS, &solid);
        values.extend(self.carried.iter().map(|c| record.attributes.get(&c.name).map_or(Value::Null, |v| c.value(v))));
        Row { wkb: record.footprint.as_ref().map(wkb::polygon), values }
    }
}

/// The columns of the buildings of an overview: the id, ours, then the user's under what the user calls them.
#[must_use]
pub fn columns(overview: &Overview) -> Vec<Column> {
    let mut columns: Vec<Column> = std::iter::once(ID).chain(FIELDS.into_iter().map(|field| field.column)).collect();
    for Carried { name, column, kind } in carried_columns(overview) {
        let title = free_title(&name, &columns);
        columns.push(Column::carried(column, title, kind));
    }
    columns
}

/// The id and the values of some of our fields, lists as text.
#[must_use]
pub fn own_values(record: &BuildingRecord, fields: &[Field], solid: &SolidFacts) -> Vec<Value> {
    let values = fields.iter().map(|field| flat(field.value(record, solid)));
    std::iter::once(record.id.as_str().into()).chain(values).collect()
}

/// A list as text; anything else as it is.
fn flat(value: Value) -> Value {
    match value {
        Value::Array(items) => {
            let words: Vec<&str> = items.iter().filter_map(Value::as_str).collect();
            words.join(LIST_SEPARATOR).into()
        }
        other => other,
    }
}

/// A user's attribute as a column.
#[derive(Debug)]
struct Carried {
    /// Name of the attribute in the user's layer.
    name: String,
    /// Name of the column.
    column: String,
    kind: ColumnKind,
}

impl Carried {
    fn value(&self, value: &Value) -> Value {
        match (self.kind, value) {
            (ColumnKind::Integer, Value::Bool(flag)) => i64::from(*flag).into(),
            (ColumnKind::Text, Value::String(_)) | (_, Value::Null | Value::Number(_)) => value.clone(),
            (_, other) => other.to_string().into(),
        }
    }
}

/// One column per attribute name; names that differ only by case get a number, because the format does not tell them
/// apart.
fn carried_columns(overview: &Overview) -> Vec<Carried> {
    let mut n_used: BTreeMap<String, usize> = BTreeMap::new();
    let carried = overview.attributes.iter().map(|(name, kind)| {
        let column = attributes::carried_name(name);
        let n = n_used.entry(column.to_lowercase()).and_modify(|n| *n += 1).or_insert(1);
        let column = if *n == 1 { column } else { format!("{column}_{n}") };
        Carried { name: name.clone(), column, kind: kind.unwrap_or(ColumnKind::Text) }
    });
    carried.collect()
}
