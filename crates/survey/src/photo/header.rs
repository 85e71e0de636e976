//! What stands in front of a photo's pixels: its size, EXIF and XMP.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use exif::{Context, Exif, Field, In, Tag, Value};

/// Read ahead per photo: EXIF with maker notes and XMP mostly fit.
const BUFFER_BYTES: usize = 1 << 15;
/// Marker of the application segment with EXIF and XMP.
const APP1: u8 = 0xE1;
const EXIF_SIGNATURE: &[u8] = b"Exif\0\0";
const XMP_SIGNATURE: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";
/// Entries of a maker note's directory at most: DJI writes eleven.
const MAX_NOTES: usize = 64;
/// Type of a 32 bit floating-point number in a TIFF directory.
const TIFF_FLOAT: u16 = 11;
/// TIFF tag of an XMP packet.
const TIFF_XMP: Tag = Tag(Context::Tiff, 700);

/// The header of one photo.
pub(super) struct PhotoHeader {
    /// Columns and rows of the raster itself, whatever EXIF says.
    pub size_px: (u32, u32),
    /// Content of the XMP packet; `None` without one.
    pub xmp: Option<Vec<u8>>,
    exif: Option<Exif>,
}

impl PhotoHeader {
    pub(super) fn read(path: &Path) -> Result<Self, String> {
        let file = File::open(path).map_err(|e| format!("cannot open {}: {e}", path.display()))?;
        let mut reader = BufReader::with_capacity(BUFFER_BYTES, file);
        let mut start = [0; 2];
        reader.read_exact(&mut start).map_err(|e| format!("not a photo: {e}"))?;
        let header = if start == [0xFF, 0xD8] { Self::jpeg(&mut reader) } else { Self::tiff(&mut reader) };
        header.map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Walks the segments up to the frame header, which has the size.
    fn jpeg(reader: &mut BufReader<File>) -> Result<Self, String> {
        let cut = |e: std::io::Error| format!("the JPEG ends within its header: {e}");
        let (mut exif, mut xmp) = (None, None);
        loop {
            let mut head = [0; 4];
            reader.read_exact(&mut head).map_err(cut)?;
            let [0xFF, marker, high, low] = head else {
                return Err("not a JPEG: a segment does not begin with FF".to_owned());
            };
            if marker == 0xFF {
                // A fill byte: the marker follows.
                reader.seek_relative(-3).map_err(cut)?;
                continue;
            }
            let n_bytes =
                u16::from_be_bytes([high, low]).checked_sub(2).ok_or("a JPEG segment of impossible length")?;
            let is_frame = matches!(marker, 0xC0..=0xCF) && !matches!(marker, 0xC4 | 0xC8 | 0xCC);
            if marker == 0xDA {
                return Err("the JPEG has no frame header before its pixels".to_owned());
            }
            if !is_frame && marker != APP1 {
                reader.seek_relative(i64::from(n_bytes)).map_err(cut)?;
                continue;
            }
            let mut segment = vec![0; usize::from(n_bytes)];
            reader.read_exact(&mut segment).map_err(cut)?;
            if is_frame {
                let &[_, h1, h0, w1, w0, ..] = segment.as_slice() else {
                    return Err("a JPEG frame header too short".to_owned());
                };
                let side = |high: u8, low: u8| u32::from(u16::from_be_bytes([high, low]));
                return Ok(Self { size_px: (side(w1, w0), side(h1, h0)), xmp, exif });
            }
            if let Some(data) = segment.strip_prefix(EXIF_SIGNATURE) {
                let read = exif::Reader::new().continue_on_error(true).read_raw(data.to_vec());
                exif = exif.or(read.or_else(|e| e.distill_partial_result(|_| {})).ok());
            } else if let Some(data) = segment.strip_prefix(XMP_SIGNATURE) {
                xmp = xmp.or(Some(data.to_vec()));
            }
        }
    }

    fn tiff(reader: &mut BufReader<File>) -> Result<Self, String> {
        reader.seek(SeekFrom::Start(0)).map_err(|e| e.to_string())?;
        let exif = exif::Reader::new()
            .continue_on_error(true)
            .read_from_container(reader)
            .or_else(|e| e.distill_partial_result(|_| {}))
            .map_err(|e| format!("no JPEG and no TIFF with metadata: {e}"))?;
        let side = |tag| exif.get_field(tag, In::PRIMARY).and_then(|field| field.value.get_uint(0));
        let (Some(width_px), Some(height_px)) = (side(Tag::ImageWidth), side(Tag::ImageLength)) else {
            return Err("its image size is not in the header".to_owned());
        };
        let xmp = exif.get_field(TIFF_XMP, In::PRIMARY).and_then(|field| match &field.value {
            Value::Byte(bytes) | Value::Undefined(bytes, _) => Some(bytes.clone()),
            _ => None,
        });
        Ok(Self { size_px: (width_px, height_px), xmp, exif: Some(exif) })
    }

    fn field(&self, tag: Tag) -> Option<&Field> {
        self.exif.as_ref()?.get_field(tag, In::PRIMARY)
    }

    /// A tag's first number, if it is there and finite.
    pub(super) fn number(&self, tag: Tag) -> Option<f64> {
        let number = match &self.field(tag)?.value {
            Value::Rational(v) => v.first()?.to_f64(),
            Value::SRational(v) => v.first()?.to_f64(),
            Value::Double(v) => *v.first()?,
            Value::Float(v) => f64::from(*v.first()?),
            other => f64::from(other.get_uint(0)?),
        };
        number.is_finite().then_some(number)
    }

    /// Text of an EXIF tag; `None` where it is missing.
    pub(super) fn text(&self, tag: Tag) -> Option<String> {
        match &self.field(tag)?.value {
            Value::Ascii(parts) => {
                let text = String::from_utf8_lossy(parts.first()?).trim_matches(['\0', ' ']).to_owned();
                (!text.is_empty()).then_some(text)
            }
            _ => None,
        }
    }

    /// Day on which the photo was taken, `YYYY-MM-DD`. Cameras without a clock write zeros or blanks.
    pub(super) fn day(&self) -> Option<String> {
        // EXIF 2.3, 4.6.5: "YYYY:MM:DD HH:MM:SS".
        let text = self.text(Tag::DateTimeOriginal)?;
        let mut numbers = text.split(' ').next()?.split(':').map(str::parse::<u16>);
        let (Some(Ok(year)), Some(Ok(month)), Some(Ok(day)), None) =
            (numbers.next(), numbers.next(), numbers.next(), numbers.next())
        else {
            return None;
        };
        // The first camera with EXIF is of 1996: earlier is a clock that was never set.
        let is_day = (1996..10_000).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
        is_day.then(|| format!("{year:04}-{month:02}-{day:02}"))
    }

    /// A number of DJI's maker note, by its tag.
    ///
    /// The note is a bare TIFF directory. Its byte order is its own: programs that rewrite EXIF the other way round copy it as it is,
    /// and only one order gives a plausible count of entries.
    pub(super) fn maker_note(&self, wanted: u16) -> Option<f64> {
        let Value::Undefined(note, _) = &self.field(Tag::MakerNote)?.value else { return None };
        self.text(Tag::Make).filter(|make| make == "DJI")?;
        let (n_entries, entries) = note.split_first_chunk::<2>()?;
        let is_little = usize::from(u16::from_le_bytes(*n_entries)) <= MAX_NOTES;
        let short = |bytes: [u8; 2]| if is_little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) };
        entries.as_chunks::<12>().0.iter().take(usize::from(short(*n_entries)).min(MAX_NOTES)).find_map(|entry| {
            let [t0, t1, k0, k1, _, _, _, _, value @ ..] = *entry;
            let value = if is_little { f32::from_le_bytes(value) } else { f32::from_be_bytes(value) };
            let is_it = short([t0, t1]) == wanted && short([k0, k1]) == TIFF_FLOAT && value.is_finite();
            is_it.then(|| in_hundredths(value))
        })
    }

    /// Longitude and latitude of the EXIF GPS tags, degrees.
    pub(super) fn place_deg(&self) -> Option<(f64, f64)> {
        let angle = |tag, reference, negative: &str| {
            let Value::Rational(parts) = &self.field(tag)?.value else { return None };
            let [degrees, minutes, seconds] = parts.get(..3)? else { return None };
            let angle = degrees.to_f64() + minutes.to_f64() / 60.0 + seconds.to_f64() / 3600.0;
            let is_negative = self.text(reference)?.eq_ignore_ascii_case(negative);
            angle.is_finite().then_some(if is_negative { -angle } else { angle })
        };
        let lon_deg = angle(Tag::GPSLongitude, Tag::GPSLongitudeRef, "W")?;
        Some((lon_deg, angle(Tag::GPSLatitude, Tag::GPSLatitudeRef, "S")?))
    }

    /// Altitude of the EXIF GPS tags, metres above whatever the camera meant.
    pub(super) fn altitude_m(&self) -> Option<f64> {
        let is_below = self.field(Tag::GPSAltitudeRef).and_then(|field| field.value.get_uint(0)) == Some(1);
        let altitude_m = self.number(Tag::GPSAltitude)?;
        Some(if is_below { -altitude_m } else { altitude_m })
    }
}

/// A number that was written with two digits behind the point and kept in 32 bits.
fn in_hundredths(value: f32) -> f64 {
    (f64::from(value) * 100.0).round() / 100.0
}

#[cfg(test)]
impl PhotoHeader {
    /// Header of a photo of which EXIF tells the maker only.
    pub(super) fn with_make(make: &str) -> Self {
        let mut tiff = b"II*\0\x08\0\0\0\x01\0\x0F\x01\x02\0".to_vec();
        tiff.extend(u32::try_from(make.len() + 1).unwrap().to_le_bytes());
        tiff.extend(26_u32.to_le_bytes());
        tiff.extend([0; 4]);
        tiff.extend(make.bytes());
        tiff.extend([0; 8]);
        Self { size_px: (320, 240), xmp: None, exif: exif::Reader::new().read_raw(tiff).ok() }
    }
}
