//! The sections of a `FlatCityBuf` file, put together with the features on disk.

use std::io::{self, Write};
use std::mem::size_of;

use fcb_core::attribute::{AttributeIndexEntry, AttributeSchema, cityfeature_to_index_entries};
use fcb_core::feature_writer::FeatureWriter;
use fcb_core::header_writer::HeaderWriterOptions;
use fcb_core::packed_rtree::{calc_extent, hilbert_sort};
use fcb_core::static_btree::DEFAULT_BRANCHING_FACTOR;
use fcb_core::{
    AttributeIndex, CityJSONSeq, ColumnType, Entry, FcbWriter, FixedStringKey, Float, Key, MAGIC_BYTES_SIZE,
    MemoryIndex, NodeItem, PackedRTree, size_prefixed_root_as_header,
};
use serde_json::{Value, json};

use sizeup_geo::files::{Stored, UnnamedFile};

/// Entries of a node of the R-tree, as the format's own programs have them.
const NODE_SIZE: u16 = 16;
/// Attributes that readers can ask for without reading all features.
const INDEXED: [&str; 2] = ["status", "measuredHeight"];

/// A city whose features are on disk; in memory are their boxes, places and the values of indexed attributes.
pub struct Sections {
    columns: AttributeSchema,
    /// Those of [`INDEXED`] that there are, by column.
    indexed: Vec<String>,
    features: UnnamedFile,
    /// Box of each feature, with its position among the features; metres.
    boxes: Vec<NodeItem>,
    /// Place of each feature in the file.
    stored: Vec<Stored>,
    /// Values of indexed attributes, each with its feature's position.
    values: Vec<(usize, AttributeIndexEntry)>,
}

/// An index over one attribute: its entry in the head, and itself.
type Indexed = (AttributeIndex, Vec<u8>);

impl Sections {
    /// Without features yet, which go to a file.
    pub fn new(columns: AttributeSchema, features: UnnamedFile) -> Self {
        let mut indexed: Vec<String> =
            INDEXED.iter().filter(|name| columns.contains_key(**name)).map(|name| (*name).to_owned()).collect();
        indexed.sort_by_key(|name| columns[name].0);
        Self { columns, indexed, features, boxes: Vec::new(), stored: Vec::new(), values: Vec::new() }
    }

    /// Adds the features of a portion.
    pub fn add(&mut self, portion: &CityJSONSeq) -> io::Result<()> {
        let Some(first) = portion.features.first() else { return Ok(()) };
        let mut writer = FeatureWriter::new(first, self.columns.clone(), None, None);
        for feature in &portion.features {
            let position = self.stored.len();
            let mut around = bounds(&portion.cj.transform.scale, &portion.cj.transform.translate, &feature.vertices);
            around.offset = position as u64;
            self.boxes.push(around);
            let values = cityfeature_to_index_entries(feature, &self.columns, &self.indexed);
            self.values.extend(values.into_iter().map(|value| (position, value)));
            writer.add_feature(feature);
            self.stored.push(self.features.put(&writer.finish_to_feature()).map_err(io::Error::other)?);
        }
        Ok(())
    }

    /// A feature with a value for every index, as a line of the sequence.
    pub fn stand_in(&self) -> String {
        let value = |name: &String| match self.columns[name].1 {
            ColumnType::String => (name.clone(), Value::from("")),
            _ => (name.clone(), Value::from(0.5)),
        };
        let attributes: serde_json::Map<String, Value> = self.indexed.iter().map(value).collect();
        let object = json!({ "type": "Building", "attributes": attributes });
        json!({ "type": "CityJSONFeature", "id": "a", "CityObjects": { "a": object }, "vertices": [] }).to_string()
    }

    /// Writes the file, given what comes before the features and the one that stands in for them.
    pub fn write(mut self, stand_in: CityJSONSeq, out: &mut dyn Write) -> io::Result<()> {
        if !self.boxes.is_empty() {
            let extent = calc_extent(&self.boxes);
            hilbert_sort(&mut self.boxes, &extent);
        }
        let order: Vec<usize> = self.boxes.iter().map(|around| around.offset as usize).collect();
        let (mut offsets, mut end) = (vec![0; order.len()], 0);
        for &position in &order {
            offsets[position] = end;
            end += self.stored[position].n_bytes() as u64;
        }
        let tree = self.tree(&offsets)?;
        let indices = self.indices(&offsets)?;
        let entries: Vec<AttributeIndex> = indices.iter().map(|(entry, _)| *entry).collect();
        out.write_all(&self.head(stand_in, &entries)?)?;
        out.write_all(&tree)?;
        for (_, index) in &indices {
            out.write_all(index)?;
        }
        for position in order {
            out.write_all(&self.features.get(self.stored[position]).map_err(io::Error::other)?)?;
        }
        Ok(())
    }

    /// The R-tree over the boxes, which are in the order of the file.
    fn tree(&self, offsets: &[u64]) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        if self.boxes.is_empty() {
            return Ok(bytes);
        }
        let placed = |around: &NodeItem| NodeItem { offset: offsets[around.offset as usize], ..around.clone() };
        let nodes: Vec<NodeItem> = self.boxes.iter().map(placed).collect();
        let tree = PackedRTree::build(&nodes, &calc_extent(&nodes), NODE_SIZE).map_err(io::Error::other)?;
        tree.stream_write(&mut bytes).map_err(io::Error::other)?;
        Ok(bytes)
    }

    /// The trees over the indexed attributes, by column.
    fn indices(&self, offsets: &[u64]) -> io::Result<Vec<Indexed>> {
        let of_column = |name: &String| match self.columns[name] {
            (column, ColumnType::String) => self.index(offsets, column, |value| match value {
                AttributeIndexEntry::String { index, val } if *index == column => {
                    Some(FixedStringKey::<50>::from_str(val))
                }
                _ => None,
            }),
            (column, ColumnType::Double) => self.index(offsets, column, |value| match value {
                AttributeIndexEntry::Double { index, val } if *index == column => Some(Float(*val)),
                _ => None,
            }),
            (_, other) => Err(io::Error::other(format!(
                "the attribute {name} is of the type {other:?}, not a text or a fraction"
            ))),
        };
        self.indexed.iter().map(of_column).collect()
    }

    fn index<K: Key>(
        &self,
        offsets: &[u64],
        column: u16,
        key: impl Fn(&AttributeIndexEntry) -> Option<K>,
    ) -> io::Result<Indexed> {
        let entry = |(position, value): &(usize, AttributeIndexEntry)| {
            Some(Entry { key: key(value)?, offset: offsets[*position] })
        };
        let entries: Vec<Entry<K>> = self.values.iter().filter_map(entry).collect();
        let index = MemoryIndex::build(&entries, DEFAULT_BRANCHING_FACTOR).map_err(io::Error::other)?;
        let mut bytes = Vec::new();
        index.serialize(&mut bytes).map_err(io::Error::other)?;
        let length = u32::try_from(bytes.len()).map_err(|_| io::Error::other("an index is over 4 GB long"))?;
        Ok((AttributeIndex::new(column, length, index.branching_factor(), index.num_items() as u32), bytes))
    }

    /// The bytes before the indices. The crate writes it with a whole file only, so it writes one of a single feature, in whose head
    /// the entries of the indices are then put right.
    fn head(&self, stand_in: CityJSONSeq, entries: &[AttributeIndex]) -> io::Result<Vec<u8>> {
        let options = HeaderWriterOptions {
            write_index: true,
            feature_count: self.stored.len() as u64,
            index_node_size: NODE_SIZE,
            attribute_indices: Some(self.indexed.iter().map(|name| (name.clone(), None)).collect()),
            geographical_extent: None,
        };
        let CityJSONSeq { cj, features } = stand_in;
        let mut writer =
            FcbWriter::new(cj, Some(options), Some(self.columns.clone()), None).map_err(io::Error::other)?;
        for feature in &features {
            writer.add_feature(feature).map_err(io::Error::other)?;
        }
        let mut bytes = Vec::new();
        writer.write(&mut bytes).map_err(io::Error::other)?;
        let head = &bytes[MAGIC_BYTES_SIZE..];
        let length = head.first_chunk().map(|length| u32::from_le_bytes(*length) as usize);
        let place = {
            let read = size_prefixed_root_as_header(head).map_err(io::Error::other)?;
            read.attribute_index().map(|known| (known.len(), known.bytes().as_ptr().addr() - bytes.as_ptr().addr()))
        };
        if place.map_or(0, |(n, _)| n) != entries.len() {
            let n_found = place.map(|(n, _)| n);
            return Err(io::Error::other(format!(
                "the head has {n_found:?} indices where there are {}",
                entries.len()
            )));
        }
        for (k, entry) in entries.iter().enumerate() {
            let at = place.map_or(0, |(_, at)| at) + k * size_of::<AttributeIndex>();
            bytes[at..at + size_of::<AttributeIndex>()].copy_from_slice(&entry.0);
        }
        bytes.truncate(MAGIC_BYTES_SIZE + size_of::<u32>() + length.unwrap_or(0));
        Ok(bytes)
    }
}

/// The box around some vertices, metres; around the origin without any, as the crate has it.
fn bounds(scale: &[f64], translate: &[f64], vertices: &[Vec<i64>]) -> NodeItem {
    let metres = |axis: usize, steps: Option<i64>| steps.unwrap_or(0) as f64 * scale[axis] + translate[axis];
    let of = |axis: usize| vertices.iter().map(move |vertex| vertex[axis]);
    NodeItem::bounds(metres(0, of(0).min()), metres(1, of(1).min()), metres(0, of(0).max()), metres(1, of(1).max()))
}
