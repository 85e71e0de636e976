//! A network as an ONNX file: the same layers, with a fixed side, in operators that every engine knows.
//!
//! An ONNX file is one protobuf message (onnx.proto of github.com/onnx/onnx); these are the fields that are written:
//!
//! ```text
//! Model:  1 ir_version, 2 producer_name, 7 graph, 8 opset_import, 14 metadata_props     OperatorSet: 1 domain, 2 version
//! Graph:  1 node, 2 name, 5 initializer, 11 input, 12 output       Node: 1 input, 2 output, 3 name, 4 op_type, 5 attribute
//! Tensor: 1 dims, 2 data_type, 8 name, 9 raw_data                  Attribute: 1 name, 2 f, 3 i, 4 s, 8 ints, 20 type
//! Value:  1 name, 2 type (1 tensor_type: 1 elem_type, 2 shape (1 dim: 1 value))
//! ```

use std::collections::BTreeMap;

use candle_core::{DType, Result, bail};

use super::norm::EPSILON;
use super::parameters::{Parameters, kind_of};
use super::{Builder, Kernel, NetworkConfig, network};

/// Version of the file's form and of the operators: old enough for every engine.
const IR_VERSION: u64 = 8;
const OPSET: u64 = 17;
/// Code of 32-bit reals in `TensorProto.DataType`.
const FLOAT: u64 = 1;
const INT64: u64 = 7;

/// A protobuf message in the making.
#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn number(&mut self, field: u64, value: u64) -> &mut Self {
        self.varint(field << 3);
        self.varint(value);
        self
    }

    fn float(&mut self, field: u64, value: f32) -> &mut Self {
        self.varint(field << 3 | 5);
        self.0.extend(value.to_le_bytes());
        self
    }

    fn bytes(&mut self, field: u64, bytes: &[u8]) -> &mut Self {
        self.varint(field << 3 | 2);
        self.varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
        self
    }

    fn text(&mut self, field: u64, text: &str) -> &mut Self {
        self.bytes(field, text.as_bytes())
    }

    fn message(&mut self, field: u64, fill: impl FnOnce(&mut Self)) -> &mut Self {
        let mut inner = Self::default();
        fill(&mut inner);
        self.bytes(field, &inner.0)
    }
}

/// An attribute of a node.
enum Attribute<'a> {
    Ints(&'a str, &'a [usize]),
    Int(&'a str, u64),
    Float(&'a str, f32),
    Text(&'a str, &'a str),
}

impl Attribute<'_> {
    /// Codes of `AttributeProto.AttributeType`: 1 float, 2 int, 3 string, 7 ints.
    fn write(&self, m: &mut Message) {
        match self {
            Self::Float(name, v) => m.text(1, name).float(2, *v).number(20, 1),
            Self::Int(name, v) => m.text(1, name).number(3, *v).number(20, 2),
            Self::Text(name, v) => m.text(1, name).text(4, v).number(20, 3),
            Self::Ints(name, v) => {
                m.text(1, name);
                v.iter().for_each(|v| {
                    m.number(8, *v as u64);
                });
                m.number(20, 7)
            }
        };
    }
}

/// A network in ONNX, its inputs `1 × channels × rows × columns` with the sizes of `given`, its output `logits`.
///
/// `given`: name, channels, rows and columns of every input, in the configuration's order. `about`: what stands in the file's
/// metadata.
///
/// # Errors
/// Parameters that are not this network's.
pub fn write(
    config: &NetworkConfig,
    parameters: &Parameters,
    given: &[(String, [usize; 3])],
    size: (usize, usize),
    about: &[(&str, String)],
) -> Result<Vec<u8>> {
    let mut export = Export { parameters, nodes: Message::default(), constants: Message::default(), n: 0 };
    let values: Vec<(String, Value)> =
        given.iter().map(|(name, shape)| (name.clone(), Value { name: name.clone(), shape: *shape })).collect();
    let logits = network(&mut export, config, &values, size)?;
    export.node("Identity", &[&logits.name], "logits", &[]);
    let port = |m: &mut Message, name: &str, [channels, rows, columns]: [usize; 3]| {
        m.text(1, name).message(2, |m| {
            m.message(1, |m| {
                m.number(1, FLOAT).message(2, |m| {
                    for n in [1, channels, rows, columns] {
                        m.message(1, |m| {
                            m.number(1, n as u64);
                        });
                    }
                });
            });
        });
    };
    let mut graph = Message(export.nodes.0);
    graph.text(2, "footprints");
    graph.0.extend(export.constants.0);
    for (name, shape) in given {
        graph.message(11, |m| port(m, name, *shape));
    }
    graph.message(12, |m| port(m, "logits", logits.shape));
    let mut model = Message::default();
    model.number(1, IR_VERSION).text(2, "sizeup-train").bytes(7, &graph.0);
    model.message(8, |m| {
        m.text(1, "").number(2, OPSET);
    });
    for (key, value) in about {
        model.message(14, |m| {
            m.text(1, key).text(2, value);
        });
    }
    Ok(model.0)
}

/// Parameters in a file that [`write`] made, by name, without their shapes.
///
/// # Errors
/// What is wrong with a file that is none, in words.
pub fn read(bytes: &[u8]) -> std::result::Result<BTreeMap<String, Vec<f32>>, String> {
    let fields_of = |bytes, wanted: u64| -> std::result::Result<Vec<&[u8]>, String> {
        let all = fields(bytes)?.into_iter();
        Ok(all.filter_map(|(n, found)| if n == wanted { found } else { None }).collect())
    };
    let graph = *fields_of(bytes, 7)?.first().ok_or("it holds no graph")?;
    let mut found = BTreeMap::new();
    for tensor in fields_of(graph, 5)? {
        let name = *fields_of(tensor, 8)?.first().ok_or("it holds a constant without a name")?;
        let name = String::from_utf8_lossy(name).into_owned();
        if matches!(kind_of(&name), "weight" | "bias" | "gain") {
            let raw = *fields_of(tensor, 9)?.first().ok_or_else(|| format!("{name} holds no raw numbers"))?;
            if !raw.len().is_multiple_of(4) {
                return Err(format!("{name} is no list of 32-bit numbers"));
            }
            let values = raw.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            found.insert(name, values.collect());
        }
    }
    if found.is_empty() { Err("it holds no parameters".to_owned()) } else { Ok(found) }
}

/// Field of a protobuf message: its number, and its bytes where it has a length.
type Field<'a> = (u64, Option<&'a [u8]>);

fn fields(mut bytes: &[u8]) -> std::result::Result<Vec<Field<'_>>, String> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let key = varint(&mut bytes)?;
        let n = match key & 7 {
            0 => {
                varint(&mut bytes)?;
                found.push((key >> 3, None));
                continue;
            }
            1 => 8,
            2 => varint(&mut bytes)? as usize,
            5 => 4,
            kind => return Err(format!("it has a field of kind {kind}")),
        };
        let (field, rest) = bytes.split_at_checked(n).ok_or("it is cut off")?;
        found.push((key >> 3, (key & 7 == 2).then_some(field)));
        bytes = rest;
    }
    Ok(found)
}

fn varint(bytes: &mut &[u8]) -> std::result::Result<u64, String> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = bytes.split_first().ok_or("it is cut off")?;
        value |= u64::from(byte & 0x7f) << shift;
        *bytes = rest;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err("it has a number of more than 64 bits".to_owned())
}

#[derive(Clone)]
struct Value {
    name: String,
    shape: [usize; 3],
}

struct Export<'a> {
    parameters: &'a Parameters,
    nodes: Message,
    constants: Message,
    n: usize,
}

impl Export<'_> {
    fn fresh(&mut self, what: &str) -> String {
        self.n += 1;
        format!("{what}_{}", self.n)
    }

    fn node(&mut self, operator: &str, inputs: &[&str], output: &str, attributes: &[Attribute<'_>]) {
        self.nodes.message(1, |m| {
            inputs.iter().for_each(|i| {
                m.text(1, i);
            });
            m.text(2, output).text(3, output).text(4, operator);
            attributes.iter().for_each(|a| {
                m.message(5, |m| a.write(m));
            });
        });
    }

    fn constant(&mut self, name: &str, dims: &[usize], kind: u64, raw: &[u8]) {
        self.constants.message(5, |m| {
            dims.iter().for_each(|d| {
                m.number(1, *d as u64);
            });
            m.number(2, kind).text(8, name).bytes(9, raw);
        });
    }

    /// A parameter under its own name, in another shape of as many values where one is given.
    fn parameter(&mut self, name: &str, dims: Option<&[usize]>) -> Result<()> {
        let tensor = self.parameters.get(name)?.to_dtype(DType::F32)?;
        let raw: Vec<u8> = tensor.flatten_all()?.to_vec1::<f32>()?.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.constant(name, dims.unwrap_or(tensor.dims()), FLOAT, &raw);
        Ok(())
    }

    fn integers(&mut self, values: &[i64]) -> String {
        let name = self.fresh("sizes");
        let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.constant(&name, &[values.len()], INT64, &raw);
        name
    }
}

impl Builder for Export<'_> {
    type Value = Value;

    fn shape(&self, x: &Value) -> Result<[usize; 3]> {
        Ok(x.shape)
    }

    fn conv(&mut self, name: &str, x: &Value, k: Kernel) -> Result<Value> {
        let (weight, bias) = (format!("{name}.weight"), format!("{name}.bias"));
        self.parameter(&weight, None)?;
        self.parameter(&bias, None)?;
        let (half, [_, rows, columns]) = (k.side / 2, x.shape);
        let shape = [k.n_out, rows.div_ceil(k.stride), columns.div_ceil(k.stride)];
        // Zeros behind the last row and column only as far as the last output reads.
        let behind = |n: usize, n_out: usize| ((n_out - 1) * k.stride + k.side).saturating_sub(n + half);
        let output = self.fresh("conv");
        let attributes = [
            Attribute::Ints("kernel_shape", &[k.side, k.side]),
            Attribute::Ints("strides", &[k.stride, k.stride]),
            Attribute::Ints("pads", &[half, half, behind(rows, shape[1]), behind(columns, shape[2])]),
        ];
        self.node("Conv", &[&x.name, &weight, &bias], &output, &attributes);
        Ok(Value { name: output, shape })
    }

    /// Groups become channels, are normalised as instances, and get each channel's gain and bias after that.
    fn norm(&mut self, name: &str, x: &Value, n_groups: usize) -> Result<Value> {
        let [channels, rows, columns] = x.shape;
        let (gain, bias) = (format!("{name}.gain"), format!("{name}.bias"));
        self.parameter(&gain, Some(&[1, channels, 1, 1]))?;
        self.parameter(&bias, Some(&[1, channels, 1, 1]))?;
        let (ones, zeros) = (self.fresh("ones"), self.fresh("zeros"));
        let floats = |v: f32| v.to_le_bytes().repeat(n_groups);
        self.constant(&ones, &[n_groups], FLOAT, &floats(1.0));
        self.constant(&zeros, &[n_groups], FLOAT, &floats(0.0));
        let grouped_size = self.integers(&[1, n_groups as i64, -1]);
        let full_size = self.integers(&[1, channels as i64, rows as i64, columns as i64]);
        let [grouped, normal, full, scaled, moved, cut] =
            ["grouped", "normal", "full", "scaled", "moved", "cut"].map(|what| self.fresh(what));
        self.node("Reshape", &[&x.name, &grouped_size], &grouped, &[]);
        let epsilon = [Attribute::Float("epsilon", EPSILON as f32)];
        self.node("InstanceNormalization", &[&grouped, &ones, &zeros], &normal, &epsilon);
        self.node("Reshape", &[&normal, &full_size], &full, &[]);
        self.node("Mul", &[&full, &gain], &scaled, &[]);
        self.node("Add", &[&scaled, &bias], &moved, &[]);
        self.node("Relu", &[&moved], &cut, &[]);
        Ok(Value { name: cut, shape: x.shape })
    }

    fn resize(&mut self, x: &Value, rows: usize, columns: usize) -> Result<Value> {
        if x.shape[1..] == [rows, columns] {
            return Ok(x.clone());
        }
        let sizes = self.integers(&[1, x.shape[0] as i64, rows as i64, columns as i64]);
        let output = self.fresh("resized");
        let attributes =
            [Attribute::Text("mode", "linear"), Attribute::Text("coordinate_transformation_mode", "half_pixel")];
        self.node("Resize", &[&x.name, "", "", &sizes], &output, &attributes);
        Ok(Value { name: output, shape: [x.shape[0], rows, columns] })
    }

    fn concat(&mut self, xs: &[Value]) -> Result<Value> {
        let Some(first) = xs.first() else { bail!("nothing to concatenate") };
        let output = self.fresh("both");
        let names: Vec<&str> = xs.iter().map(|x| x.name.as_str()).collect();
        self.node("Concat", &names, &output, &[Attribute::Int("axis", 1)]);
        let channels = xs.iter().map(|x| x.shape[0]).sum();
        Ok(Value { name: output, shape: [channels, first.shape[1], first.shape[2]] })
    }
}
