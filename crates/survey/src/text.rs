//! Text of files as UTF-8, whatever it was written in: every reader of text takes it from here.
//!
//! A byte order mark states UTF-8 or UTF-16 and is dropped. Without one, a zero byte among the first two states UTF-16. All
//! other text is UTF-8, and a byte that is no UTF-8 is a character of Windows-1252, which contains ISO-8859-1: these are what
//! spreadsheets and older programs write.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use sizeup_geo::files::{self, FileError};

/// Bytes that are decoded at a time.
const CHUNK_BYTES: usize = 1 << 16;

/// Characters 0x80 to 0x9F of Windows-1252; ISO-8859-1 has control characters there, which no text contains.
const WINDOWS_1252: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž', '\u{8f}', '\u{90}', '‘', '’',
    '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}', 'ž', 'Ÿ',
];

/// Opens a text file.
pub(crate) fn open(path: &Path) -> Result<BufReader<Utf8<File>>, FileError> {
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    Ok(BufReader::with_capacity(CHUNK_BYTES, Utf8::new(file)))
}

/// Reads a whole text file, as long as it may be.
pub(crate) fn read(path: &Path) -> Result<String, FileError> {
    Ok(decode(&files::read_bytes(path)?))
}

/// Decodes the beginning of a file, or all of it.
pub(crate) fn decode(bytes: &[u8]) -> String {
    let (encoding, mark) = Encoding::of(bytes);
    let mut text = String::with_capacity(bytes.len());
    encoding.decode(&bytes[mark..], true, &mut text);
    text
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Utf8,
    Utf16Le,
    Utf16Be,
}

impl Encoding {
    /// The encoding by the first bytes, and the length of the byte order mark.
    fn of(bytes: &[u8]) -> (Self, usize) {
        match bytes {
            [0xEF, 0xBB, 0xBF, ..] => (Self::Utf8, 3),
            [0xFF, 0xFE, ..] => (Self::Utf16Le, 2),
            [0xFE, 0xFF, ..] => (Self::Utf16Be, 2),
            [0, second, ..] if *second != 0 => (Self::Utf16Be, 0),
            [first, 0, ..] if *first != 0 => (Self::Utf16Le, 0),
            _ => (Self::Utf8, 0),
        }
    }

    /// Appends the text of some bytes; returns how many were used. Bytes of a character that goes on behind them are left
    /// unless it is the end.
    fn decode(self, bytes: &[u8], is_end: bool, text: &mut String) -> usize {
        match self {
            Self::Utf8 => decode_utf8(bytes, is_end, text),
            Self::Utf16Le => decode_utf16(bytes, u16::from_le_bytes, is_end, text),
            Self::Utf16Be => decode_utf16(bytes, u16::from_be_bytes, is_end, text),
        }
    }
}

fn decode_utf8(bytes: &[u8], is_end: bool, text: &mut String) -> usize {
    let mut n_used = 0;
    for chunk in bytes.utf8_chunks() {
        text.push_str(chunk.valid());
        n_used += chunk.valid().len();
        let invalid = chunk.invalid();
        let goes_on = !is_end && n_used + invalid.len() == bytes.len() && is_cut(invalid);
        if goes_on {
            break;
        }
        text.extend(invalid.iter().map(|&byte| match byte {
            0x80..=0x9F => WINDOWS_1252[usize::from(byte - 0x80)],
            other => char::from(other),
        }));
        n_used += invalid.len();
    }
    n_used
}

/// Whether bytes are the beginning of a character of UTF-8.
fn is_cut(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).is_err_and(|e| e.valid_up_to() == 0 && e.error_len().is_none())
}

fn decode_utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16, is_end: bool, text: &mut String) -> usize {
    const HIGH_SURROGATES: std::ops::Range<u16> = 0xD800..0xDC00;
    let mut units: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(|&pair| unit(pair)).collect();
    if !is_end {
        units.pop_if(|last| HIGH_SURROGATES.contains(last));
    }
    text.extend(char::decode_utf16(units.iter().copied()).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)));
    if is_end { bytes.len() } else { 2 * units.len() }
}

/// Bytes of a reader as UTF-8.
pub(crate) struct Utf8<R> {
    inner: R,
    encoding: Option<Encoding>,
    /// Bytes that are read and not decoded yet.
    raw: Vec<u8>,
    text: String,
    /// Bytes of `text` that were handed over.
    n_taken: usize,
    is_end: bool,
}

impl<R: Read> Utf8<R> {
    pub(crate) fn new(inner: R) -> Self {
        Self { inner, encoding: None, raw: Vec::new(), text: String::new(), n_taken: 0, is_end: false }
    }

    /// Decodes the next bytes.
    fn fill(&mut self) -> std::io::Result<()> {
        const LONGEST_MARK: usize = 3;
        self.text.clear();
        self.n_taken = 0;
        let wanted = if self.encoding.is_none() { LONGEST_MARK } else { 1 };
        let n_before = self.raw.len();
        while !self.is_end && self.raw.len() < n_before + wanted {
            let old = self.raw.len();
            self.raw.resize(old + CHUNK_BYTES, 0);
            let read = self.inner.read(&mut self.raw[old..]);
            self.raw.truncate(old + *read.as_ref().unwrap_or(&0));
            match read {
                Ok(n) => self.is_end = n == 0,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        let encoding = *self.encoding.get_or_insert_with(|| {
            let (encoding, mark) = Encoding::of(&self.raw);
            self.raw.drain(..mark);
            encoding
        });
        let n_used = encoding.decode(&self.raw, self.is_end, &mut self.text);
        self.raw.drain(..n_used);
        Ok(())
    }
}

impl<R: Read> Read for Utf8<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        while self.n_taken == self.text.len() && !(self.is_end && self.raw.is_empty()) {
            self.fill()?;
        }
        let ready = &self.text.as_bytes()[self.n_taken..];
        let n = ready.len().min(buffer.len());
        buffer[..n].copy_from_slice(&ready[..n]);
        self.n_taken += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Text of four widths in UTF-8, one of them two units in UTF-16.
    const TEXT: &str = "name;x\nStraße_€_𝄞.jpg;1\n";

    fn utf16(unit: fn(u16) -> [u8; 2]) -> Vec<u8> {
        TEXT.encode_utf16().flat_map(unit).collect()
    }

    /// Hands its bytes over one at a time.
    struct OneByOne<'a>(&'a [u8]);

    impl Read for OneByOne<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            let n = self.0.len().min(buffer.len()).min(1);
            buffer[..n].copy_from_slice(&self.0[..n]);
            self.0 = &self.0[n..];
            Ok(n)
        }
    }

    #[test]
    fn text_is_the_same_in_utf_8_and_utf_16_with_and_without_a_mark_and_wherever_it_is_cut() {
        let with = |mark: &[u8], bytes: Vec<u8>| [mark.to_vec(), bytes].concat();
        let files = [
            TEXT.as_bytes().to_vec(),
            with(b"\xEF\xBB\xBF", TEXT.as_bytes().to_vec()),
            with(b"\xFF\xFE", utf16(u16::to_le_bytes)),
            with(b"\xFE\xFF", utf16(u16::to_be_bytes)),
            utf16(u16::to_le_bytes),
            utf16(u16::to_be_bytes),
        ];
        for bytes in files {
            assert_eq!(decode(&bytes), TEXT);
            let mut streamed = String::new();
            Utf8::new(OneByOne(&bytes)).read_to_string(&mut streamed).unwrap();
            assert_eq!(streamed, TEXT);
        }
    }

    #[test]
    fn bytes_that_are_no_utf_8_are_windows_1252() {
        let bytes = b"Stra\xDFe, \x80 5, M\xFCnchen\xC3";
        let expected = "Straße, € 5, MünchenÃ";
        assert_eq!(decode(bytes), expected);
        let mut streamed = String::new();
        Utf8::new(OneByOne(bytes)).read_to_string(&mut streamed).unwrap();
        assert_eq!(streamed, expected);
    }

    #[test]
    fn an_empty_file_is_empty_text() {
        let mut streamed = String::new();
        Utf8::new(OneByOne(b"")).read_to_string(&mut streamed).unwrap();
        assert_eq!((streamed.as_str(), decode(b"").as_str()), ("", ""));
    }
}
