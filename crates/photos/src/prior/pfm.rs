//! Portable float maps: `Pf`, width, height and a scale whose sign is the byte order, then `f32` rows from the bottom
//! up (<https://www.pauldebevec.com/Research/HDR/PFM/>).

use std::io::Read;

use super::array::MapShape;
use sizeup_heights::raster::Raster;

/// Reads a one-channel map of at most `most` values; the scale's size is ignored, as everybody does.
pub(super) fn read(mut stream: impl Read, most: u64) -> Result<Raster<f32>, String> {
    let mut word = || next_word(&mut stream);
    match word()?.as_str() {
        "Pf" => {}
        "PF" => return Err("it is a colour map (PF), expected one channel (Pf)".to_owned()),
        _ => return Err("it is no PFM file: expected it to start with Pf".to_owned()),
    }
    let mut length = |what: &str| {
        let text = word()?;
        text.parse::<usize>().map_err(|_| format!("its {what} is {text:?}, expected a whole number"))
    };
    let (width, height) = (length("width")?, length("height")?);
    let scale = word()?;
    let scale: f32 = scale.parse().map_err(|_| format!("its scale is {scale:?}, expected a number"))?;
    let shape = MapShape::of(&[height, width], most)?;
    shape.check_memory(8)?;

    let n_wanted = shape.cells() * 4;
    let mut bytes = Vec::new();
    stream.take(n_wanted as u64).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    if bytes.len() < n_wanted {
        return Err(format!("it ends after {} bytes of data, expected {n_wanted}", bytes.len()));
    }
    let is_little_endian = scale.is_sign_negative();
    let number = |b: &[u8]| {
        let b = [b[0], b[1], b[2], b[3]];
        if is_little_endian { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) }
    };
    // A one-column or one-row map is a map, whatever dimensions of one mean elsewhere.
    let rows = bytes.chunks_exact(width * 4).rev();
    let values = rows.flat_map(|row| row.chunks_exact(4).map(number)).collect();
    Ok(Raster::from_vec(width, height, values).expect("one value per cell"))
}

/// Up to the next white space, of which exactly one byte is eaten: the data follow at once.
fn next_word(stream: &mut impl Read) -> Result<String, String> {
    const LONGEST: usize = 32;
    let mut word = String::new();
    let mut byte = [0_u8];
    loop {
        stream.read_exact(&mut byte).map_err(|_| "it ends within its header".to_owned())?;
        match byte[0] {
            b' ' | b'\n' | b'\t' if word.is_empty() => {}
            b' ' | b'\n' | b'\t' => return Ok(word),
            b'\r' => {}
            printable @ 0x21..=0x7e if word.len() < LONGEST => word.push(char::from(printable)),
            _ => return Err("it is no PFM file: its header is not text".to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::prior::array::MOST;

    #[test]
    fn rows_come_from_the_bottom_in_either_byte_order() {
        let values = [1.0_f32, 2.0, 3.0, 4.0];
        let little = [b"Pf\n2 2\n-1.0\n".to_vec(), values.iter().flat_map(|v| v.to_le_bytes()).collect()].concat();
        let big = [b"Pf\n2 2\n1.0\n".to_vec(), values.iter().flat_map(|v| v.to_be_bytes()).collect()].concat();
        for bytes in [little, big] {
            assert_eq!(read(bytes.as_slice(), MOST).unwrap().data(), [3.0, 4.0, 1.0, 2.0]);
        }
    }

    #[test]
    fn colour_and_short_files_are_refused() {
        assert!(read(b"PF\n2 2\n-1\n".as_slice(), MOST).unwrap_err().contains("colour"));
        assert!(read(b"Pf\n20000 20000\n-1\n1234".as_slice(), MOST).unwrap_err().contains("after 4 bytes"));
        assert!(read(b"Pf\n99999999999 99999999999\n-1\n".as_slice(), MOST).is_err());
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = read(bytes.as_slice(), MOST);
            let _ = read([b"Pf\n", bytes.as_slice()].concat().as_slice(), MOST);
        }
    }
}
