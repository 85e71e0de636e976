//! The few things of an ONNX file that engines do not tell: its external data, its operators, how it resizes.
//!
//! An ONNX file is one protobuf message (onnx.proto of github.com/onnx/onnx). Only these fields are looked at:
//!
//! ```text
//! Model:     7 graph, 8 opset_import          OperatorSet: 1 domain, 2 version
//! Graph:     1 node, 5 initializer            Node:        4 op_type, 5 attribute
//! Attribute: 1 name, 4 s, 6 g                 Tensor:      13 external_data (1 key, 2 value)
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::OnnxError;
use sizeup_geo::files;
use sizeup_geo::paths::within;

/// Deepest graph within graphs (loops, branches) that is looked at.
const DEEPEST: usize = 16;

/// Contents of an ONNX file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Contents {
    /// Number of occurrences of each operator.
    pub operators: BTreeMap<String, usize>,
    /// Version of the standard operators; 0 if it does not say.
    pub opset: u64,
    /// Files that hold its weights, relative to it; empty where it holds them itself.
    pub external_files: Vec<PathBuf>,
    /// Up to where each of them has to reach, bytes.
    reach: BTreeMap<PathBuf, u64>,
    /// Whether it resizes with cubic interpolation.
    pub has_cubic_resize: bool,
}

impl Contents {
    /// Contents of a file.
    ///
    /// # Errors
    /// [`OnnxError::Load`] if it cannot be read or is no ONNX file.
    pub fn read(path: &Path) -> Result<Self, OnnxError> {
        let failed = |reason: String| OnnxError::Load {
            path: path.to_owned(),
            reason,
            hint: "is it an ONNX file, and whole? PyTorch's .pt and .safetensors have to be exported first".to_owned(),
        };
        let bytes = files::read_bytes(path).map_err(|e| failed(e.source.to_string()))?;
        let contents = Self::of(&bytes).and_then(|contents| contents.check_files(path).map(|()| contents));
        contents.map_err(|problem| failed(format!("it is no sound ONNX file: {problem}")))
    }

    /// Holds what is wanted of other files against their lengths; that they are missing is for the engine to say.
    fn check_files(&self, path: &Path) -> Result<(), String> {
        for (name, end) in &self.reach {
            let length = path.with_file_name(name).metadata().map(|found| found.len());
            if let Some(length) = length.ok().filter(|length| length < end) {
                return Err(format!("it wants {end} bytes of {}, which has {length}", name.display()));
            }
        }
        Ok(())
    }

    /// Contents of a file's bytes.
    fn of(bytes: &[u8]) -> Result<Self, String> {
        Message::Model.check(bytes, 0)?;
        let mut contents = Self::default();
        let mut has_graph = false;
        for field in Fields(bytes) {
            match field? {
                (7, ProtoField::Bytes(graph)) => {
                    has_graph = true;
                    contents.look_at_graph(graph, 0)?;
                }
                (8, ProtoField::Bytes(set)) => contents.look_at_operator_set(set)?,
                _ => {}
            }
        }
        contents.external_files.sort_unstable();
        contents.external_files.dedup();
        if has_graph { Ok(contents) } else { Err("it holds no graph".to_owned()) }
    }

    fn look_at_operator_set(&mut self, set: &[u8]) -> Result<(), String> {
        let (mut domain, mut version) = (&b""[..], 0);
        for field in Fields(set) {
            match field? {
                (1, ProtoField::Bytes(name)) => domain = name,
                (2, ProtoField::Number(n)) => version = n,
                _ => {}
            }
        }
        if domain.is_empty() || domain == b"ai.onnx" {
            self.opset = version;
        }
        Ok(())
    }

    fn look_at_graph(&mut self, graph: &[u8], depth: usize) -> Result<(), String> {
        if depth > DEEPEST {
            return Err(format!("it nests graphs more than {DEEPEST} deep"));
        }
        for field in Fields(graph) {
            match field? {
                (1, ProtoField::Bytes(node)) => self.look_at_node(node, depth)?,
                (5, ProtoField::Bytes(tensor)) => self.look_at_tensor(tensor)?,
                _ => {}
            }
        }
        Ok(())
    }

    fn look_at_node(&mut self, node: &[u8], depth: usize) -> Result<(), String> {
        let mut operator = String::new();
        let mut is_cubic = false;
        for field in Fields(node) {
            match field? {
                (4, ProtoField::Bytes(name)) => operator = String::from_utf8_lossy(name).into_owned(),
                (5, ProtoField::Bytes(attribute)) => {
                    let (mut name, mut text) = (&b""[..], &b""[..]);
                    for field in Fields(attribute) {
                        match field? {
                            (1, ProtoField::Bytes(bytes)) => name = bytes,
                            (4, ProtoField::Bytes(bytes)) => text = bytes,
                            (6, ProtoField::Bytes(graph)) => self.look_at_graph(graph, depth + 1)?,
                            _ => {}
                        }
                    }
                    is_cubic |= name == b"mode" && text == b"cubic";
                }
                _ => {}
            }
        }
        self.has_cubic_resize |= is_cubic && operator == "Resize";
        *self.operators.entry(operator).or_default() += 1;
        Ok(())
    }

    fn look_at_tensor(&mut self, tensor: &[u8]) -> Result<(), String> {
        let (mut location, mut offset, mut length) = (None, 0_u64, 0_u64);
        for field in Fields(tensor) {
            let (13, ProtoField::Bytes(entry)) = field? else { continue };
            let (mut key, mut value) = (&b""[..], &b""[..]);
            for field in Fields(entry) {
                match field? {
                    (1, ProtoField::Bytes(bytes)) => key = bytes,
                    (2, ProtoField::Bytes(bytes)) => value = bytes,
                    _ => {}
                }
            }
            let number = || {
                let number = std::str::from_utf8(value).ok().and_then(|text| text.parse().ok());
                number.ok_or_else(|| format!("a place in its weights is {:?}", String::from_utf8_lossy(value)))
            };
            match key {
                b"location" => location = Some(String::from_utf8_lossy(value).into_owned()),
                b"offset" => offset = number()?,
                b"length" => length = number()?,
                _ => {}
            }
        }
        if let Some(location) = location {
            let name =
                within(&location).ok_or_else(|| format!("its weights are in {location:?}, outside its folder"))?;
            let end = self.reach.entry(name.to_owned()).or_default();
            *end = offset.saturating_add(length).max(*end);
            self.external_files.push(name.to_owned());
        }
        Ok(())
    }
}

/// The messages that an ONNX file is made of, as far as engines look at them.
#[derive(Debug, Clone, Copy)]
enum Message {
    Model,
    Graph,
    Node,
    Attribute,
    Tensor,
    Value,
    Type,
    TensorType,
    Sequence,
    Shape,
    /// Without messages of its own.
    Plain,
}

impl Message {
    /// The message in a field; `None` for text, numbers and what is not looked at.
    fn at(self, field: u64) -> Option<Self> {
        Some(match (self, field) {
            (Self::Model, 7) | (Self::Attribute, 6) => Self::Graph,
            (Self::Model, 8 | 14) | (Self::Tensor, 13) | (Self::Shape, 1) => Self::Plain,
            (Self::Graph, 1) => Self::Node,
            (Self::Graph | Self::Attribute, 5) => Self::Tensor,
            (Self::Graph, 11..=13) => Self::Value,
            (Self::Node, 5) => Self::Attribute,
            (Self::Value, 2) | (Self::Sequence, 1) => Self::Type,
            (Self::Type, 1) => Self::TensorType,
            (Self::Type, 4) => Self::Sequence,
            (Self::TensorType, 2) => Self::Shape,
            _ => return None,
        })
    }

    /// Checks that whatever is in it ends within it: engines take memory for any length that they read.
    fn check(self, bytes: &[u8], depth: usize) -> Result<(), String> {
        // A graph in a graph is four messages deeper.
        if depth > 4 * DEEPEST {
            return Err(format!("it nests graphs more than {DEEPEST} deep"));
        }
        for field in Fields(bytes) {
            if let (number, ProtoField::Bytes(inner)) = field?
                && let Some(message) = self.at(number)
            {
                message.check(inner, depth + 1)?;
            }
        }
        Ok(())
    }
}

/// A field's content: a number, or bytes (text, a message); fixed-length numbers are passed over.
enum ProtoField<'a> {
    Number(u64),
    Bytes(&'a [u8]),
    Fixed,
}

/// The fields of a message, with their numbers.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn number(&mut self) -> Option<u64> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let (byte, rest) = self.0.split_first()?;
            self.0 = rest;
            value |= u64::from(byte & 0x7f).checked_shl(shift)?;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    fn take(&mut self, n: u64) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(usize::try_from(n).ok()?)?;
        self.0 = rest;
        Some(taken)
    }

    fn field(&mut self) -> Option<(u64, ProtoField<'a>)> {
        let tag = self.number()?;
        let field = match tag & 7 {
            0 => ProtoField::Number(self.number()?),
            1 => self.take(8).map(|_| ProtoField::Fixed)?,
            2 => {
                let length = self.number()?;
                ProtoField::Bytes(self.take(length)?)
            }
            5 => self.take(4).map(|_| ProtoField::Fixed)?,
            _ => return None,
        };
        Some((tag >> 3, field))
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<(u64, ProtoField<'a>), String>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let field = self.field().ok_or_else(|| "it is cut off or garbled".to_owned());
        if field.is_err() {
            self.0 = &[];
        }
        Some(field)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A field of bytes, short enough for one byte of length.
    fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
        [&[number << 3 | 2, u8::try_from(bytes.len()).unwrap()], bytes].concat()
    }

    #[test]
    fn operators_external_files_and_cubic_resizing_are_found_also_in_branches() {
        let cubic = [field(4, b"Resize"), field(5, &[field(1, b"mode"), field(4, b"cubic")].concat())].concat();
        let branch = [field(4, b"If"), field(5, &[field(1, b"then"), field(6, &field(1, &cubic))].concat())].concat();
        let location = field(13, &[field(1, b"location"), field(2, b"a.data")].concat());
        let graph = [field(1, &branch), field(5, &location), field(5, &location)].concat();
        let bytes = [field(7, &graph), field(8, &[0x10, 17])].concat();
        let contents = Contents::of(&bytes).unwrap();
        assert!(contents.has_cubic_resize);
        assert_eq!(contents.operators.keys().collect::<Vec<_>>(), ["If", "Resize"]);
        assert_eq!((contents.opset, contents.external_files), (17, vec![PathBuf::from("a.data")]));
        // Text within messages that are otherwise passed over: the name of a dimension, longer than all of the file.
        let huge = [&[2 << 3 | 2][..], &[0xff, 0xff, 0xff, 0xff, 0x7f], b"n"].concat();
        let value = field(11, &field(2, &field(1, &field(2, &field(1, &huge)))));
        assert!(Contents::of(&field(7, &value)).unwrap_err().contains("cut off"));
        let elsewhere = field(5, &field(13, &[field(1, b"location"), field(2, b"../../a.data")].concat()));
        assert!(Contents::of(&field(7, &elsewhere)).unwrap_err().contains("outside its folder"));
        assert!(Contents::of(&bytes[..bytes.len() / 2]).unwrap_err().contains("cut off"));
        assert!(Contents::of(b"").unwrap_err().contains("no graph"));
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = Contents::of(&bytes);
            let _ = Contents::of(&[&[0x3a, 0xff, 0x01], bytes.as_slice()].concat());
        }
    }
}
