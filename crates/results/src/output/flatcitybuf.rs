//! FlatCityBuf (<https://github.com/cityjson/flatcitybuf>): the features of `CityJSON` in one binary file that is read over the web by
//! range requests.
//!
//! ```text
//! header    transform, CRS, extent, names and types of attributes
//! indices   an R-tree over the buildings' boxes; trees over `status` and `measuredHeight`
//! features  what CityJSONSeq has, a building each, along a Hilbert curve
//! ```
//!
//! Written by the format's own crate, from the features of [`super::cityjson::write_sequence`]. All of them are in memory, some 17 kB
//! a building: a city of millions is written by tile.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use fcb_core::ColumnType;
use fcb_core::attribute::AttributeSchema;
use fcb_core::header_writer::HeaderWriterOptions;
use fcb_core::{CJType, CJTypeKind, CityJSONSeq, FcbWriter, read_cityjson_from_reader};
use serde_json::Value;

use super::cityjson::{self, CityJsonConfig};
use super::{CityModel, OutputError, Overview, Records};
use sizeup_geo::files::{FileError, write_whole_or};

/// Entries of a node of the R-tree, as the format's own programs have them.
const NODE_SIZE: u16 = 16;
/// Attributes that readers can ask for without reading all features.
const INDEXED: [&str; 2] = ["status", "measuredHeight"];

/// Writes `path` (`….fcb`) whole or not at all.
///
/// # Errors
/// As [`cityjson::write_sequence`]; the format's writer.
pub fn write<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &CityJsonConfig,
) -> Result<Overview, OutputError> {
    let failed = |because: String| FileError::on("cannot write", path)(std::io::Error::other(because));
    let folder = tempfile::tempdir().map_err(FileError::on("cannot write", path))?;
    let lines = folder.path().join("city.city.jsonl");
    let overview = cityjson::write_sequence(&lines, model, config)?;
    let city = read_lines(&lines).map_err(failed)?;
    let objects = city.features.iter().flat_map(|feature| feature.city_objects.values());
    let attributes = columns(objects.filter_map(|object| object.attributes.as_ref()));
    let indexed = INDEXED.map(str::to_owned).into_iter().filter(|name| attributes.contains_key(name));
    let indexed = indexed.map(|name| (name, None)).collect();
    let options = HeaderWriterOptions {
        write_index: true,
        feature_count: city.features.len() as u64,
        index_node_size: NODE_SIZE,
        attribute_indices: Some(indexed),
        geographical_extent: None,
    };
    write_whole_or(path, |out| -> Result<(), OutputError> {
        let mut writer =
            FcbWriter::new(city.cj, Some(options), Some(attributes), None).map_err(|e| failed(e.to_string()))?;
        for feature in &city.features {
            writer.add_feature(feature).map_err(|e| failed(e.to_string()))?;
        }
        writer.write(out).map_err(|e| failed(e.to_string()))?;
        Ok(())
    })?;
    Ok(overview)
}

fn read_lines(path: &Path) -> Result<CityJSONSeq, String> {
    let file = File::open(path).map_err(|e| e.to_string())?;
    match read_cityjson_from_reader(BufReader::new(file), CJTypeKind::Seq) {
        Ok(CJType::Seq(city)) => Ok(city),
        Ok(_) => Err("CityJSONSeq is read as something else".to_owned()),
        Err(e) => Err(e.to_string()),
    }
}

/// Names and types of all attributes, by name: the type that holds every value. The crate itself takes that of the first value, and a
/// whole number before a fraction would cut the fraction off.
fn columns<'a>(of_objects: impl Iterator<Item = &'a Value>) -> AttributeSchema {
    let mut types: BTreeMap<&str, ColumnType> = BTreeMap::new();
    for attributes in of_objects.filter_map(Value::as_object) {
        for (name, value) in attributes {
            let Some(own) = column_type(value) else { continue };
            types.entry(name).and_modify(|known| *known = holding_both(*known, own)).or_insert(own);
        }
    }
    (0..).zip(types).map(|(at, (name, column))| (name.to_owned(), (at, column))).collect()
}

/// The type of a value; `None` of null.
fn column_type(value: &Value) -> Option<ColumnType> {
    match value {
        Value::Null => None,
        Value::Bool(_) => Some(ColumnType::Bool),
        Value::Number(number) if number.is_f64() => Some(ColumnType::Double),
        Value::Number(_) => Some(ColumnType::Long),
        Value::String(_) => Some(ColumnType::String),
        Value::Array(_) | Value::Object(_) => Some(ColumnType::Json),
    }
}

/// The type that values of both can be written as.
fn holding_both(a: ColumnType, b: ColumnType) -> ColumnType {
    match (a, b) {
        _ if a == b => a,
        (ColumnType::Long, ColumnType::Double) | (ColumnType::Double, ColumnType::Long) => ColumnType::Double,
        _ => ColumnType::Json,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_column_takes_the_type_that_holds_all_of_its_values() {
        let of_objects = [
            json!({"storeys": 3, "name": "mill", "width": 4, "use": 7, "built": null}),
            json!({"storeys": 2, "width": 4.5, "use": "school", "built": null}),
        ];
        let found = columns(of_objects.iter());
        let expected = [
            ("name", (0, ColumnType::String)),
            ("storeys", (1, ColumnType::Long)),
            ("use", (2, ColumnType::Json)),
            ("width", (3, ColumnType::Double)),
        ];
        assert_eq!(found, expected.map(|(name, column)| (name.to_owned(), column)).into());
    }
}
