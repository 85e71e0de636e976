//! FlatCityBuf (<https://github.com/cityjson/flatcitybuf>): the features of `CityJSON` in one binary file that is read over the web by
//! range requests.
//!
//! ```text
//! header    transform, CRS, extent, names and types of attributes
//! indices   an R-tree over the buildings' boxes; trees over `status` and `measuredHeight`
//! features  what CityJSONSeq has, a building each, along a Hilbert curve
//! ```
//!
//! Features are turned into bytes by the format's own crate, from the lines of [`super::cityjson::write_sequence`], a portion at a
//! time; the crate's writer would have the whole city in memory, some 17 kB a building. The file is put together in [`sections`],
//! to the same bytes.

mod sections;

use std::collections::BTreeMap;
use std::io::{self, BufRead as _, BufReader, BufWriter, Read as _, Write};
use std::path::Path;

use fcb_core::attribute::AttributeSchema;
use fcb_core::{CJType, CJTypeKind, CityJSONSeq, ColumnType, read_cityjson_from_reader};
use serde_json::Value;

use super::cityjson::{self, CityJsonConfig};
use super::{CityModel, OutputError, Overview, Records};
use sections::Sections;
use sizeup_geo::files::{FileError, UnnamedFile, write_whole};

/// Features in memory at a time.
const PORTION: usize = 1000;

/// Writes `path` (`….fcb`) whole or not at all. What lies on disk meanwhile has no name and is in the same folder.
///
/// # Errors
/// As [`cityjson::write_sequence`]; the format's writer.
pub fn write<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &CityJsonConfig,
) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (lines, features) = (UnnamedFile::new(folder)?, UnnamedFile::new(folder)?);
    let failed = |e| OutputError::from(FileError::on("cannot write", path)(e));
    let mut out = BufWriter::with_capacity(1 << 20, &lines);
    cityjson::write_lines(&mut out, model, config, &overview, failed)?;
    out.flush().map_err(failed)?;
    drop(out);
    write_whole(path, |out| convert(&SequenceLines::new(lines)?, features, out))?;
    Ok(overview)
}

/// Writes the file of some lines; the other file takes the features until all are known.
fn convert(lines: &SequenceLines, features: UnnamedFile, out: &mut dyn Write) -> io::Result<()> {
    let mut types = BTreeMap::new();
    lines.visit(|portion| {
        let objects = portion.features.iter().flat_map(|feature| feature.city_objects.values());
        add_types(&mut types, objects.filter_map(|object| object.attributes.as_ref()));
        Ok(())
    })?;
    let mut sections = Sections::new(columns(types), features);
    lines.visit(|portion| sections.add(portion))?;
    let stand_in = lines.portion(&sections.stand_in())?;
    sections.write(stand_in, out)
}

/// The lines of a `CityJSONSeq` on disk.
struct SequenceLines {
    file: UnnamedFile,
    /// The first of them, which has all but the features.
    head: String,
}

impl SequenceLines {
    fn new(file: UnnamedFile) -> io::Result<Self> {
        let mut head = String::new();
        BufReader::new(file.reader()).read_line(&mut head)?;
        Ok(Self { file, head })
    }

    /// All features in their order, a portion after the other.
    fn visit(&self, mut each: impl FnMut(&CityJSONSeq) -> io::Result<()>) -> io::Result<()> {
        let mut lines = BufReader::with_capacity(1 << 20, self.file.reader()).lines().skip(1).peekable();
        while lines.peek().is_some() {
            let portion: Vec<String> = lines.by_ref().take(PORTION).collect::<io::Result<_>>()?;
            each(&self.portion(&portion.join("\n"))?)?;
        }
        Ok(())
    }

    /// The features of some lines.
    fn portion(&self, lines: &str) -> io::Result<CityJSONSeq> {
        let text = BufReader::new(self.head.as_bytes().chain(lines.as_bytes()));
        match read_cityjson_from_reader(text, CJTypeKind::Seq) {
            Ok(CJType::Seq(portion)) => Ok(portion),
            Ok(_) => Err(io::Error::other("CityJSONSeq is read as something else")),
            Err(e) => Err(io::Error::other(e)),
        }
    }
}

/// Adds the types of some objects' attributes: that of a name is the one that holds every value. The crate itself takes that of the first
/// value, and a whole number before a fraction would cut the fraction off.
fn add_types<'a>(types: &mut BTreeMap<String, ColumnType>, of_objects: impl Iterator<Item = &'a Value>) {
    for (name, value) in of_objects.filter_map(Value::as_object).flatten() {
        let Some(own) = column_type(value) else { continue };
        match types.get_mut(name) {
            Some(known) => *known = holding_both(*known, own),
            None => drop(types.insert(name.clone(), own)),
        }
    }
}

/// The columns of a file, numbered by name.
fn columns(types: BTreeMap<String, ColumnType>) -> AttributeSchema {
    (0..).zip(types).map(|(at, (name, column))| (name, (at, column))).collect()
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
    use fcb_core::FcbWriter;
    use fcb_core::header_writer::HeaderWriterOptions;
    use serde_json::json;

    use super::*;

    /// A sequence of boxes on a grid with gaps, some without a height, some in two objects, one without vertices.
    fn sequence(n: usize) -> SequenceLines {
        let head = json!({
            "type": "CityJSON", "version": "2.0", "CityObjects": {}, "vertices": [],
            "transform": { "scale": [0.001, 0.001, 0.001], "translate": [565_000.0, 5_932_000.0, 24.0] },
            "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/25832" },
        });
        let feature = |i: usize| {
            let (x, y) = ((i * 7919 % 1009) as i64 * 30_000, (i * 104_729 % 997) as i64 * 20_000);
            let vertices: Vec<[i64; 3]> = [[0, 0, 0], [9000, 0, 0], [9000, 7000, 0], [0, 7000, 4000 + i as i64]]
                .map(|[a, b, z]| [x + a, y + b, z])
                .into_iter()
                .filter(|_| i != 3)
                .collect();
            let geometry = json!([{ "type": "MultiSurface", "lod": "1.2", "boundaries": [[[0, 1, 2, 3]]] }]);
            let height = (!i.is_multiple_of(5)).then(|| 3.0 + (i % 400) as f64 / 8.0);
            let status = if height.is_none() { "unknown" } else { "measured" };
            let attributes =
                json!({ "status": status, "measuredHeight": height, "n": i, "name": format!("house {i}") });
            let mut objects = serde_json::Map::new();
            let geometry = if i == 3 { json!([]) } else { geometry };
            objects
                .insert(format!("b{i}"), json!({ "type": "Building", "attributes": attributes, "geometry": geometry }));
            if i.is_multiple_of(11) {
                let part = json!({ "type": "BuildingPart", "parents": [format!("b{i}")], "attributes": { "status": "doubtful", "measuredHeight": 2.5 }, "geometry": [] });
                objects.insert(format!("b{i}-1"), part);
            }
            json!({ "type": "CityJSONFeature", "id": format!("b{i}"), "CityObjects": objects, "vertices": vertices })
        };
        let file = unnamed();
        writeln!(&file, "{head}").unwrap();
        (0..n).for_each(|i| writeln!(&file, "{}", feature(i)).unwrap());
        SequenceLines::new(file).unwrap()
    }

    /// A file that leaves nothing, in the system's folder for such files.
    fn unnamed() -> UnnamedFile {
        UnnamedFile::new(&std::env::temp_dir()).unwrap()
    }

    /// A sequence written by the crate's own writer, with all of it in memory.
    fn by_the_crate(lines: &SequenceLines) -> Vec<u8> {
        let text = BufReader::new(lines.file.reader());
        let Ok(CJType::Seq(city)) = read_cityjson_from_reader(text, CJTypeKind::Seq) else { panic!() };
        let mut types = BTreeMap::new();
        let objects = city.features.iter().flat_map(|feature| feature.city_objects.values());
        add_types(&mut types, objects.filter_map(|object| object.attributes.as_ref()));
        let options = HeaderWriterOptions {
            write_index: true,
            feature_count: city.features.len() as u64,
            index_node_size: 16,
            attribute_indices: Some(["measuredHeight", "status"].map(|name| (name.to_owned(), None)).into()),
            geographical_extent: None,
        };
        let mut writer = FcbWriter::new(city.cj, Some(options), Some(columns(types)), None).unwrap();
        city.features.iter().for_each(|feature| writer.add_feature(feature).unwrap());
        let mut bytes = Vec::new();
        writer.write(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn a_city_written_in_portions_has_the_bytes_of_the_formats_own_writer() {
        for n in [1, 2, 40, 2 * PORTION + 37] {
            let lines = sequence(n);
            let mut bytes = Vec::new();
            convert(&lines, unnamed(), &mut bytes).unwrap();
            let expected = by_the_crate(&lines);
            let first = bytes.iter().zip(&expected).position(|(a, b)| a != b);
            assert!(bytes == expected, "{n} features: {} bytes, not {}, from {first:?}", bytes.len(), expected.len());
        }
    }

    #[test]
    fn a_column_takes_the_type_that_holds_all_of_its_values() {
        let of_objects = [
            json!({"storeys": 3, "name": "mill", "width": 4, "use": 7, "built": null}),
            json!({"storeys": 2, "width": 4.5, "use": "school", "built": null}),
        ];
        let mut types = BTreeMap::new();
        add_types(&mut types, of_objects.iter());
        let found = columns(types);
        let expected = [
            ("name", (0, ColumnType::String)),
            ("storeys", (1, ColumnType::Long)),
            ("use", (2, ColumnType::Json)),
            ("width", (3, ColumnType::Double)),
        ];
        assert_eq!(found, expected.map(|(name, column)| (name.to_owned(), column)).into());
    }
}
