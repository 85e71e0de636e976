//! `NumPy`'s .npy: a text header, then raw numbers (numpy.lib.format, versions 1.0 to 3.0).
//!
//! ```text
//! \x93NUMPY major minor | header length (u16, from version 2 u32, little-endian) | header | data
//! header: {'descr': '<f4', 'fortran_order': False, 'shape': (375, 500), }
//! ```
//!
//! Read by hand: the file is untrusted, only one map of a stack is wanted, and only ten number types occur.

use std::io::Read;

use half::f16;

use super::array::MapShape;
use sizeup_heights::raster::Raster;

/// Longest header that is believed, bytes; numpy's own limit for safe parsing is 10 000.
const MAX_HEADER: usize = 10_000;

/// Storage of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Number {
    F16,
    F32,
    F64,
    U8,
    U16,
    U32,
    I16,
    I32,
}

/// Fields of the header.
#[derive(Debug, Clone, PartialEq, Eq)]
struct NpyHeader {
    number: Number,
    is_big_endian: bool,
    is_column_major: bool,
    shape: Vec<usize>,
}

/// Number of maps of an array, and the one at `index` as `f32`, read from the start of a stream; of at most `most`
/// values.
pub(super) fn read_map(
    mut stream: impl Read,
    most: u64,
    index: impl FnOnce(usize) -> Result<usize, String>,
) -> Result<Raster<f32>, String> {
    let header = read_header(&mut stream)?;
    let shape = MapShape::of(&header.shape, most)?;
    let index = index(shape.n)?;
    if index >= shape.n {
        return Err(format!("it holds {} maps, and map {} was asked for", shape.n, index + 1));
    }
    if header.is_column_major && shape.n > 1 {
        return Err("it is a stack in Fortran order; save it with numpy.ascontiguousarray".to_owned());
    }
    let size = header.number.size();
    shape.check_memory(size as u64 + 4)?;
    let n_skipped = (index as u64).checked_mul((shape.cells() * size) as u64).ok_or("it is impossibly large")?;
    let skipped = std::io::copy(&mut stream.by_ref().take(n_skipped), &mut std::io::sink());
    let skipped = skipped.map_err(|e| e.to_string())?;

    // A stream grows the buffer as far as it really goes, whatever the header promises.
    let n_wanted = shape.cells() * size;
    let mut bytes = Vec::new();
    stream.take(n_wanted as u64).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    if skipped < n_skipped || bytes.len() < n_wanted {
        let found = skipped + bytes.len() as u64;
        return Err(format!("it ends after {found} bytes of data, expected {}", n_skipped + n_wanted as u64));
    }
    let values: Vec<f32> = bytes.chunks_exact(size).map(|b| header.number.value(b, header.is_big_endian)).collect();
    Ok(if header.is_column_major { transposed(&shape, &values) } else { shape.raster(values) })
}

fn transposed(shape: &MapShape, columns: &[f32]) -> Raster<f32> {
    let cells = (0..shape.height).flat_map(|row| (0..shape.width).map(move |col| columns[col * shape.height + row]));
    shape.raster(cells.collect())
}

impl Number {
    /// From numpy's type code without its byte order, as in `f4`.
    fn parse(code: &str) -> Option<Self> {
        Some(match code {
            "f2" => Self::F16,
            "f4" => Self::F32,
            "f8" => Self::F64,
            "u1" => Self::U8,
            "u2" => Self::U16,
            "u4" => Self::U32,
            "i2" => Self::I16,
            "i4" => Self::I32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F16 | Self::U16 | Self::I16 => 2,
            Self::F32 | Self::U32 | Self::I32 => 4,
            Self::F64 => 8,
        }
    }

    fn value(self, bytes: &[u8], is_big_endian: bool) -> f32 {
        let mut low_first = [0_u8; 8];
        let bytes_used = &mut low_first[..bytes.len()];
        bytes_used.copy_from_slice(bytes);
        if is_big_endian {
            bytes_used.reverse();
        }
        let [a, b, c, d, ..] = low_first;
        match self {
            Self::F16 => f16::from_le_bytes([a, b]).to_f32(),
            Self::F32 => f32::from_le_bytes([a, b, c, d]),
            Self::F64 => f64::from_le_bytes(low_first) as f32,
            Self::U8 => a as f32,
            Self::U16 => u16::from_le_bytes([a, b]) as f32,
            Self::U32 => u32::from_le_bytes([a, b, c, d]) as f32,
            Self::I16 => i16::from_le_bytes([a, b]) as f32,
            Self::I32 => i32::from_le_bytes([a, b, c, d]) as f32,
        }
    }
}

fn read_header(stream: &mut impl Read) -> Result<NpyHeader, String> {
    let mut start = [0_u8; 8];
    stream.read_exact(&mut start).map_err(|_| "it is no .npy array: too short".to_owned())?;
    let [magic @ .., major, _minor] = &start;
    if magic != b"\x93NUMPY" {
        return Err("it is no .npy array: expected it to start with \\x93NUMPY".to_owned());
    }
    let mut length = [0_u8; 4];
    let n_length = if *major == 1 { 2 } else { 4 };
    stream.read_exact(&mut length[..n_length]).map_err(|e| e.to_string())?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_HEADER {
        return Err(format!("its header claims {length} bytes, expected at most {MAX_HEADER}"));
    }
    let mut text = vec![0_u8; length];
    stream.read_exact(&mut text).map_err(|_| "it ends within its header".to_owned())?;
    let text = String::from_utf8(text).map_err(|_| "its header is not text".to_owned())?;
    parse_header(&text)
}

/// The dictionary that numpy writes; no other Python is understood.
fn parse_header(text: &str) -> Result<NpyHeader, String> {
    let entry = |key: &str| {
        let (_, after) = text.split_once(&format!("'{key}':")).ok_or_else(|| format!("its header has no {key:?}"))?;
        Ok::<_, String>(after.trim_start())
    };
    let descr = entry("descr")?;
    let code = descr
        .strip_prefix('\'')
        .and_then(|rest| rest.split_once('\''))
        .ok_or("it is a structured array, expected plain numbers")?
        .0;
    let (order, number) = code.split_at_checked(1).ok_or("its number type is empty")?;
    let number = Number::parse(number).ok_or_else(|| {
        format!("its numbers are of type {code:?}, expected floats (f2, f4, f8) or integers up to 32 bits")
    })?;
    let is_big_endian = match order {
        "<" | "|" | "=" => false,
        ">" => true,
        _ => return Err(format!("its byte order {order:?} is unknown")),
    };
    let is_column_major = match entry("fortran_order")? {
        order if order.starts_with("True") => true,
        order if order.starts_with("False") => false,
        _ => return Err("its fortran_order is neither True nor False".to_owned()),
    };
    let shape = entry("shape")?;
    let shape = shape.strip_prefix('(').and_then(|s| s.split_once(')')).ok_or("its shape is no tuple")?.0;
    let lengths = shape.split(',').map(str::trim).filter(|s| !s.is_empty());
    let shape: Result<Vec<usize>, _> = lengths.map(str::parse).collect();
    let shape = shape.map_err(|_| format!("its shape ({}) is no list of lengths", text.escape_debug()))?;
    Ok(NpyHeader { number, is_big_endian, is_column_major, shape })
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::prior::array::MOST;

    /// A version 1.0 file as numpy writes it.
    pub(in crate::prior) fn npy(descr: &str, is_fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let order = if is_fortran { "True" } else { "False" };
        let mut header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
        while (10 + header.len()) % 64 != 63 {
            header.push(' ');
        }
        header.push('\n');
        let length = u16::try_from(header.len()).unwrap().to_le_bytes();
        [b"\x93NUMPY\x01\x00".as_slice(), &length, header.as_bytes(), data].concat()
    }

    fn first(bytes: &[u8]) -> Result<Raster<f32>, String> {
        read_map(bytes, MOST, |_| Ok(0))
    }

    #[test]
    fn every_number_type_and_byte_order_reads_the_same_value() {
        let cases: [(&str, Vec<u8>); 10] = [
            ("<f2", f16::from_f32(7.0).to_le_bytes().to_vec()),
            (">f2", f16::from_f32(7.0).to_be_bytes().to_vec()),
            ("<f4", 7.0_f32.to_le_bytes().to_vec()),
            (">f4", 7.0_f32.to_be_bytes().to_vec()),
            ("<f8", 7.0_f64.to_le_bytes().to_vec()),
            (">f8", 7.0_f64.to_be_bytes().to_vec()),
            ("|u1", vec![7]),
            (">u2", 7_u16.to_be_bytes().to_vec()),
            ("<u4", 7_u32.to_le_bytes().to_vec()),
            ("<i2", 7_i16.to_le_bytes().to_vec()),
        ];
        for (descr, data) in cases {
            assert_eq!(first(&npy(descr, false, "(1, 1)", &data)).unwrap().data(), [7.0], "{descr}");
        }
    }

    #[test]
    fn fortran_order_is_transposed_and_a_stack_is_indexed() {
        let six: Vec<u8> = (0..6_u8).collect();
        // numpy.asfortranarray(numpy.arange(6).reshape(2, 3)) stores 0 3 1 4 2 5.
        assert_eq!(first(&npy("|u1", true, "(2, 3)", &[0, 3, 1, 4, 2, 5])).unwrap().data(), [0., 1., 2., 3., 4., 5.]);
        let stack = npy("|u1", false, "(3, 1, 2)", &six);
        assert_eq!(read_map(stack.as_slice(), MOST, |n| Ok(n - 1)).unwrap().data(), [4.0, 5.0]);
        assert!(read_map(stack.as_slice(), MOST, Ok).unwrap_err().contains("holds 3 maps"));
    }

    #[test]
    fn lies_are_refused_before_memory_is_taken() {
        let refused = |bytes: &[u8], words: &str| {
            let error = first(bytes).unwrap_err();
            assert!(error.contains(words), "{error}");
        };
        refused(b"", "too short");
        refused(b"PK\x03\x04 something", "no .npy");
        refused(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}", "claims 4294967295");
        refused(&npy("<f4", false, "(20000, 20000)", &[0; 8]), "ends after 8 bytes");
        refused(&npy("<f4", false, "(18446744073709551615, 2)", &[]), "more than four times");
        refused(&npy("|O", false, "(2, 2)", &[0; 8]), "of type");
        refused(&npy("<f4", false, "(2, x)", &[]), "no list of lengths");
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = first(&bytes);
            let _ = first(&[b"\x93NUMPY\x01\x00", bytes.as_slice()].concat());
        }

        #[test]
        fn no_header_makes_it_panic(descr in ".{0,6}", shape in "[(), 0-9]{0,40}", data in any::<[u8; 16]>()) {
            let _ = first(&npy(&descr, false, &shape, &data));
            let _ = first(&npy("<f4", true, &shape, &data));
        }
    }
}
