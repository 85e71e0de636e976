//! Attributes of buildings in glTF: `EXT_structural_metadata`, one property table per tile, one row per building.
//!
//! Numbers are 64-bit reals, whatever the column holds: readers in JavaScript have no other whole numbers that would
//! be safe. A missing number is [`NO_NUMBER`], a missing text is empty.

use std::collections::BTreeSet;

use serde_json::{Map as JsonMap, Value, json};

use super::glb::Buffers;
use sizeup_geo::geodata::features::{Column, ColumnKind};

/// Stands for a number that is not known.
const NO_NUMBER: f64 = f64::MIN;
/// Name of the class of the schema.
const CLASS: &str = "building";

/// Columns under names that the schema allows.
#[derive(Debug)]
pub struct NamedColumns {
    named: Vec<(String, Column)>,
}

impl NamedColumns {
    /// Table of columns; names of others are brought to letters, digits and underscores, and made unique.
    #[must_use]
    pub fn new(columns: &[Column]) -> Self {
        let mut taken: BTreeSet<String> = BTreeSet::new();
        let mut identifier = |name: &str| {
            let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
            let plain = if plain.starts_with(|c: char| c.is_ascii_digit()) { format!("_{plain}") } else { plain };
            let numbered = (2..).map(|n| format!("{plain}_{n}"));
            let free = std::iter::once(plain.clone()).chain(numbered).find(|name| !taken.contains(name));
            let free = free.expect("numbers do not run out");
            taken.insert(free.clone());
            free
        };
        Self { named: columns.iter().map(|column| (identifier(&column.name), column.clone())).collect() }
    }

    /// The schema of `EXT_structural_metadata`.
    #[must_use]
    pub fn schema(&self) -> Value {
        let property = |(id, column): &(String, Column)| {
            let mut property = match column.kind {
                ColumnKind::Text => json!({ "type": "STRING", "noData": "" }),
                ColumnKind::Real | ColumnKind::Integer | ColumnKind::Flag => {
                    json!({ "type": "SCALAR", "componentType": "FLOAT64", "noData": NO_NUMBER })
                }
            };
            property["name"] = json!(column.name);
            if !column.meaning.is_empty() {
                property["description"] = json!(column.meaning);
            }
            (id.clone(), property)
        };
        let properties: JsonMap<String, Value> = self.named.iter().map(property).collect();
        json!({ "id": "sizeup", "classes": { CLASS: { "name": "Building", "properties": properties } } })
    }

    /// The property table of a tile; its values go into `buffers`.
    pub fn table(&self, rows: &[&[Value]], buffers: &mut Buffers) -> Value {
        let mut properties = JsonMap::new();
        for (i, (id, column)) in self.named.iter().enumerate() {
            let values = rows.iter().map(|row| &row[i]);
            let property = match column.kind {
                ColumnKind::Text => {
                    let mut text = Vec::new();
                    let mut offsets = 0_u32.to_le_bytes().to_vec();
                    for value in values {
                        match value {
                            Value::Null => {}
                            Value::String(words) => text.extend_from_slice(words.as_bytes()),
                            other => text.extend_from_slice(other.to_string().as_bytes()),
                        }
                        offsets.extend((text.len() as u32).to_le_bytes());
                    }
                    if text.is_empty() {
                        // A view must hold something; where all are missing, the property can be left out.
                        continue;
                    }
                    json!({ "values": buffers.view(&text), "stringOffsets": buffers.view(&offsets) })
                }
                ColumnKind::Real | ColumnKind::Integer | ColumnKind::Flag => {
                    let numbers = values.map(|value| value.as_f64().unwrap_or(NO_NUMBER));
                    json!({ "values": buffers.view(&numbers.flat_map(f64::to_le_bytes).collect::<Vec<u8>>()) })
                }
            };
            properties.insert(id.clone(), property);
        }
        json!({ "class": CLASS, "count": rows.len(), "properties": properties })
    }
}
