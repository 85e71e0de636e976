//! What the header of a LAS or LAZ file claims, held against the file's length before any memory is taken for it: the
//! reader behind believes every number (LAS 1.4 R15; `LASzip`, "chunk table" and "layered chunks").
//!
//! ```text
//! LAS    offset of points + points · record ≤ length
//! LAZ    chunks ≤ bytes before their table;  layered: every chunk ends before their table begins, however many the table counts
//! both   points · (position, class, instance) ≤ what one input may take;  the first extended record ends within the file
//! ```

use std::io::{Read, Seek, SeekFrom};

use laz::laszip::{ChunkTable, LazVlr};

use crate::limits::{self, Excess};

/// Bytes that one point takes in memory: position, class, instance.
const IN_MEMORY: u64 = 24 + 1 + 8;
/// Bytes of a header of LAS 1.0 to 1.2.
const SHORTEST_HEADER: usize = 227;
/// Head of a variable length record, and of an extended one; where their lengths are.
const RECORD_HEAD: u64 = 54;
const EXTENDED_HEAD: u64 = 60;
const LENGTH_AT: usize = 20;
/// User and number of `LASzip`'s record.
const LASZIP: (&[u8], u16) = (b"laszip encoded", 22204);
/// `LASzip`'s compressor whose chunks consist of layers.
const LAYERED: u16 = 3;

/// Why a file is not handed over.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum Claim {
    /// More than one input may take, or than the file can hold.
    #[error(transparent)]
    Excess(#[from] Excess),
    /// A number that leads out of the file.
    #[error("{what} {claimed}, the file has {length} bytes\nhint: it is cut off or damaged: copy it again")]
    Beyond {
        /// Part of the file that leads out of it.
        what: &'static str,
        /// Position at which it would end.
        claimed: u64,
        /// Length of the file, bytes.
        length: u64,
    },
    /// Statement on its compression that contradicts itself.
    #[error(
        "its points are said to be compressed as {compressor}, its items are those of {LAYERED}\nhint: it is damaged: copy it again"
    )]
    Mixed {
        /// Number of the compressor that the header names.
        compressor: u16,
    },
    /// Chunks with fewer points than the file.
    #[error("its chunks have {counted} points, the file {n_points}\nhint: it is damaged: copy it again")]
    Uncounted {
        /// Points by the table of chunks.
        counted: u64,
        /// Points by the header.
        n_points: u64,
    },
    /// A part of a point that is longer or shorter than its kind.
    #[error("its points have an item of kind {kind} with {size} bytes\nhint: it is damaged: copy it again")]
    Item {
        /// Number that LAZ gives the kind of item.
        kind: u16,
        /// Size of the item as the file states it, bytes.
        size: u16,
    },
    /// Points that are longer or shorter than what they are made of.
    #[error("its points have {record} bytes, what they are made of {items}\nhint: it is damaged: copy it again")]
    Record {
        /// Length of a point by the header, bytes.
        record: u16,
        /// Length of its items, bytes.
        items: u64,
    },
    /// It does not say what its compressed points are made of.
    #[error("its points are compressed, and nothing says what they are made of\nhint: it is damaged: copy it again")]
    NoItems,
    /// A file that ends before the part named here.
    #[error("it ends within its {0}")]
    Cut(&'static str),
}

/// Checks a file from its beginning. Returns where its points end at the latest.
pub(super) fn check(file: &mut (impl Read + Seek)) -> Result<u64, Claim> {
    let length = file.seek(SeekFrom::End(0)).map_err(|_| Claim::Cut("header"))?;
    let header = LasHeader::read(file)?;
    limits::check(header.n_points.saturating_mul(IN_MEMORY), Some(length))?;
    within("its points begin at byte", u64::from(header.points_at), length)?;
    if let Some(at) = header.extended_at {
        let head = bytes::<{ EXTENDED_HEAD as usize }>(file, at).ok_or(Claim::Cut("extended record"))?;
        let end = at.saturating_add(EXTENDED_HEAD).saturating_add(u64_at(&head, LENGTH_AT));
        within("an extended record ends at byte", end, length)?;
    }
    if header.is_compressed {
        return check_chunks(file, &header, length);
    }
    let points = header.n_points.saturating_mul(u64::from(header.record));
    within("its points end at byte", points.saturating_add(u64::from(header.points_at)), length).map(|()| length)
}

fn within(what: &'static str, claimed: u64, length: u64) -> Result<(), Claim> {
    if claimed <= length { Ok(()) } else { Err(Claim::Beyond { what, claimed, length }) }
}

/// Parts of a header that matter.
struct LasHeader {
    header_size: u16,
    points_at: u32,
    n_records: u32,
    is_compressed: bool,
    record: u16,
    n_points: u64,
    extended_at: Option<u64>,
}

impl LasHeader {
    fn read(file: &mut (impl Read + Seek)) -> Result<Self, Claim> {
        let bytes = bytes::<SHORTEST_HEADER>(file, 0).ok_or(Claim::Cut("header"))?;
        let is_1_4 = bytes[24] == 1 && bytes[25] >= 4;
        let tail = if is_1_4 { bytes_of_1_4(file)? } else { [0; 20] };
        let n_extended = u32_at(&tail, 8);
        let legacy = u64::from(u32_at(&bytes, 107));
        Ok(Self {
            // The reader goes by the version where the header says to be shorter.
            header_size: u16_at(&bytes, 94).max(size_of_version([bytes[24], bytes[25]])),
            points_at: u32_at(&bytes, 96),
            n_records: u32_at(&bytes, 100),
            is_compressed: bytes[104] & 0xC0 != 0,
            record: u16_at(&bytes, 105),
            n_points: legacy.max(u64_at(&tail, 12)),
            extended_at: (is_1_4 && n_extended > 0).then(|| u64_at(&tail, 0)),
        })
    }
}

/// Bytes of a version's header.
fn size_of_version(version: [u8; 2]) -> u16 {
    match version {
        [1, minor] if minor >= 4 => 375,
        [1, 3] => 235,
        _ => SHORTEST_HEADER as u16,
    }
}

/// Start of the extended records, their number, and the number of points.
fn bytes_of_1_4(file: &mut (impl Read + Seek)) -> Result<[u8; 20], Claim> {
    bytes(file, 235).ok_or(Claim::Cut("header"))
}

/// The table of chunks, and the layers of each.
fn check_chunks(file: &mut (impl Read + Seek), header: &LasHeader, length: u64) -> Result<u64, Claim> {
    let first = u64::from(header.points_at) + 8;
    let end = match table_place(file, u64::from(header.points_at), length)? {
        Some(table_at) => {
            within("its chunk table begins at byte", table_at.saturating_add(8), length)?;
            let head = bytes::<8>(file, table_at).ok_or(Claim::Cut("chunk table"))?;
            let n_chunks = u64::from(u32_at(&head, 4));
            // Each chunk begins with a whole point.
            let least = first.saturating_add(n_chunks.saturating_mul(u64::from(header.record).max(1)));
            within("its chunks end at byte", least, table_at)?;
            table_at
        }
        None => length,
    };
    let Some(record) = laszip_record(file, header)? else { return Ok(end) };
    if let Some(n_layers) = layers_of(&record)? {
        // The reader goes by the items in one place, and by the header in another.
        let point = items(&record).map(|item| u64::from(u16_at(item, 2))).sum();
        if point != u64::from(header.record) {
            return Err(Claim::Record { record: header.record, items: point });
        }
        check_layers(file, [first, end], point, n_layers)?;
    }
    check_points(file, header, &record)?;
    Ok(end)
}

/// Where chunks have any number of points, the reader asks their table for each, and goes beyond it where points are left.
fn check_points(file: &mut (impl Read + Seek), header: &LasHeader, record: &[u8]) -> Result<(), Claim> {
    // What cannot be read here the reader refuses itself, or does without.
    let Ok(record) = LazVlr::from_buffer(record) else { return Ok(()) };
    if !record.uses_variable_size_chunks() || file.seek(SeekFrom::Start(u64::from(header.points_at))).is_err() {
        return Ok(());
    }
    let Ok(table) = ChunkTable::read_from(file, &record) else { return Ok(()) };
    let counted = table.as_ref().iter().fold(0_u64, |sum, chunk| sum.saturating_add(chunk.point_count));
    if counted < header.n_points { Err(Claim::Uncounted { counted, n_points: header.n_points }) } else { Ok(()) }
}

/// Position of the chunk table: said in front of the points, or by writers that cannot go back at the end; `None` without one.
fn table_place(file: &mut (impl Read + Seek), points_at: u64, length: u64) -> Result<Option<u64>, Claim> {
    for at in [points_at, length.saturating_sub(8)] {
        let place = u64_at(&bytes::<8>(file, at).ok_or(Claim::Cut("chunk table"))?, 0);
        if place.cast_signed() > points_at.cast_signed() {
            return Ok(Some(place));
        }
    }
    Ok(None)
}

/// Goes from chunk to chunk as the reader will: a point, a count, the lengths of the layers, the layers. The reader asks no
/// table how many there are, so this goes on as long as there is room for one more.
fn check_layers(
    file: &mut (impl Read + Seek),
    [mut at, end]: [u64; 2],
    record: u64,
    n_layers: u64,
) -> Result<(), Claim> {
    let mut lengths = vec![0; usize::try_from(4 * n_layers).map_err(|_| Claim::Cut("chunk"))?];
    loop {
        let layers_at = at + record + 4 + 4 * n_layers;
        if layers_at > end {
            return Ok(());
        }
        let read = file.seek(SeekFrom::Start(at + record + 4)).and_then(|_| file.read_exact(&mut lengths));
        read.map_err(|_| Claim::Cut("chunk"))?;
        let layers: u64 = lengths.chunks_exact(4).map(|bytes| u64::from(u32_at(bytes, 0))).sum();
        at = layers_at + layers;
        within("a chunk ends at byte", at, end)?;
    }
}

/// A file whose points end somewhere: who comes there by reading finds nothing more; who goes there finds what is there. So a
/// chunk table is not taken for one more chunk, which would be as long as its bytes happen to say.
pub(super) struct UpTo<R> {
    file: R,
    at: u64,
    end: u64,
    is_over: bool,
}

impl<R> UpTo<R> {
    /// From the beginning of a file.
    pub(super) fn new(file: R, end: u64) -> Self {
        Self { file, at: 0, end, is_over: false }
    }
}

impl<R: Read> Read for UpTo<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        if self.is_over {
            return Ok(0);
        }
        let left = self.end.checked_sub(self.at).filter(|left| *left > 0);
        let most = left.map_or(into.len(), |left| into.len().min(usize::try_from(left).unwrap_or(usize::MAX)));
        let n = self.file.read(&mut into[..most])?;
        self.at += n as u64;
        self.is_over = left == Some(n as u64);
        Ok(n)
    }
}

impl<R: Seek> Seek for UpTo<R> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let at = self.file.seek(to)?;
        // To ask where one is moves nothing.
        self.is_over &= at == self.at;
        self.at = at;
        Ok(at)
    }
}

/// Statement of `LASzip` on its compression; `None` where it says nothing.
fn laszip_record(file: &mut (impl Read + Seek), header: &LasHeader) -> Result<Option<Vec<u8>>, Claim> {
    let mut at = u64::from(header.header_size);
    for _ in 0..header.n_records {
        let head = bytes::<{ RECORD_HEAD as usize }>(file, at).ok_or(Claim::Cut("records"))?;
        let length = u16_at(&head, LENGTH_AT);
        at += RECORD_HEAD;
        if head[2..].starts_with(LASZIP.0) && u16_at(&head, 18) == LASZIP.1 {
            let mut record = vec![0; usize::from(length)];
            let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut record));
            read.map_err(|_| Claim::Cut("records"))?;
            return Ok(Some(record));
        }
        at += u64::from(length);
    }
    Ok(None)
}

/// How many layers a chunk has; `None` where chunks have none. By what a point is made of: kind, size and version of each item. The reader goes by the items whether there are layers,
/// whatever the compressor is called.
fn layers_of(record: &[u8]) -> Result<Option<u64>, Claim> {
    /// The first kind of item that only layers hold, and the first version of items in layers.
    const LAYERED_ITEMS: [u16; 2] = [10, 3];
    if record.len() < ITEMS_AT {
        return Ok(None);
    }
    if record_items(record) == 0 {
        return Err(Claim::NoItems);
    }
    // The reader goes by the kind in one place, and by the size in another.
    if let Some(item) =
        items(record).find(|item| size_of_kind(u16_at(item, 0)).is_some_and(|size| size != u16_at(item, 2)))
    {
        return Err(Claim::Item { kind: u16_at(item, 0), size: u16_at(item, 2) });
    }
    let compressor = u16_at(record, 0);
    let is_layered =
        items(record).any(|item| u16_at(item, 0) >= LAYERED_ITEMS[0] || u16_at(item, 4) >= LAYERED_ITEMS[1]);
    if is_layered && compressor != LAYERED {
        return Err(Claim::Mixed { compressor });
    }
    let n = items(record).map(|item| match u16_at(item, 0) {
        10 => 9,                         // point
        11 | 13 => 1,                    // colour, wave packet
        12 => 2,                         // colour with near infrared
        _ => u64::from(u16_at(item, 2)), // extra bytes, each on its own
    });
    Ok((compressor == LAYERED).then(|| n.sum()))
}

/// Offset at which `LASzip`'s record lists what a point is made of.
const ITEMS_AT: usize = 34;

/// Kind, size and version of each item of a point.
fn items(record: &[u8]) -> impl Iterator<Item = &[u8]> {
    record.get(ITEMS_AT..).unwrap_or_default().chunks_exact(6).take(usize::from(record_items(record)))
}

/// Bytes of an item; `None` for extra bytes, of which there are any number.
fn size_of_kind(kind: u16) -> Option<u16> {
    match kind {
        6 => Some(20),      // point
        7 | 12 => Some(8),  // time; colour with near infrared
        8 | 11 => Some(6),  // colour
        9 | 13 => Some(29), // wave packet
        10 => Some(30),     // point in layers
        _ => None,
    }
}

fn record_items(record: &[u8]) -> u16 {
    if record.len() >= ITEMS_AT { u16_at(record, 32) } else { 0 }
}

fn bytes<const N: usize>(file: &mut (impl Read + Seek), at: u64) -> Option<[u8; N]> {
    let mut bytes = [0; N];
    file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut bytes)).ok()?;
    Some(bytes)
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from(u16_at(bytes, at)) | u32::from(u16_at(bytes, at + 2)) << 16
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use las::point::Format;
    use las::{Builder, Point, Writer};

    use super::*;

    /// A cloud of 1,000 points, of a format, packed or not.
    fn cloud(format: u8, is_compressed: bool) -> Vec<u8> {
        let mut builder = Builder::from((1, 4));
        builder.point_format = Format::new(format).unwrap();
        builder.point_format.is_compressed = is_compressed;
        let mut writer = Writer::new(Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
        let has = Format::new(format).unwrap();
        for i in 0..1_000_u16 {
            let x = f64::from(i % 32);
            let gps_time = has.has_gps_time.then_some(f64::from(i));
            let color = has.has_color.then(|| las::Color::new(i, i, i));
            writer.write_point(Point { x, y: x * 0.5, z: 3.0, gps_time, color, ..Point::default() }).unwrap();
        }
        writer.close().unwrap();
        writer.into_inner().unwrap().into_inner()
    }

    #[test]
    fn sound_files_of_every_kind_pass() {
        for (format, is_compressed) in [(0, false), (3, true), (6, false), (6, true), (7, true)] {
            let bytes = cloud(format, is_compressed);
            assert!(check(&mut Cursor::new(bytes)).is_ok(), "format {format}, compressed: {is_compressed}");
        }
    }

    #[test]
    fn claims_beyond_the_file_are_refused() {
        let refused = |mut bytes: Vec<u8>, at: usize, number: &[u8]| {
            bytes[at..at + number.len()].copy_from_slice(number);
            check(&mut Cursor::new(bytes)).unwrap_err()
        };
        let plain = cloud(6, false);
        assert!(matches!(refused(plain.clone(), 247, &1_001_u64.to_le_bytes()), Claim::Beyond { .. }));
        assert!(matches!(refused(plain.clone(), 247, &u64::MAX.to_le_bytes()), Claim::Excess(_)));
        assert!(matches!(refused(plain.clone(), 96, &u32::MAX.to_le_bytes()), Claim::Beyond { .. }));
        assert_eq!(check(&mut Cursor::new(&plain[..200])), Err(Claim::Cut("header")));
        let packed = cloud(7, true);
        let points_at = u32_at(&packed, 96) as usize;
        let table_at = u64_at(&packed, points_at) as usize;
        assert!(matches!(refused(packed.clone(), table_at + 4, &u32::MAX.to_le_bytes()), Claim::Beyond { .. }));
        // The first layer's length, behind the table's place, a point and a count.
        let layer_at = points_at + 8 + usize::from(u16_at(&packed, 105)) + 4;
        assert!(matches!(refused(packed.clone(), layer_at, &u32::MAX.to_le_bytes()), Claim::Beyond { .. }));
        assert!(check(&mut Cursor::new(&packed[..packed.len() / 2])).is_err());
        // The same behind a header that says to be shorter than its version's, which would hide the record of the compression.
        let mut short = packed.clone();
        short[94..96].copy_from_slice(&119_u16.to_le_bytes());
        assert!(check(&mut Cursor::new(&short)).is_ok());
        assert!(matches!(refused(short, layer_at, &u32::MAX.to_le_bytes()), Claim::Beyond { .. }));
        // The compressor of other point formats, over items that come in layers.
        let record_at = packed.windows(LASZIP.0.len()).position(|found| found == LASZIP.0).unwrap() - 2;
        for compressor in [1_u16, 2] {
            let mixed = refused(packed.clone(), record_at + 54, &compressor.to_le_bytes());
            assert_eq!(mixed, Claim::Mixed { compressor });
        }
        // Points that the header has longer than their items, which would hide the lengths too.
        let long = refused(packed.clone(), 105, &60_u16.to_le_bytes());
        assert_eq!(long, Claim::Record { record: 60, items: 36 });
        // A point whose size is not that of its kind would hide them too.
        let mut small = packed.clone();
        let size_at =
            packed.windows(LASZIP.0.len()).position(|found| found == LASZIP.0).unwrap() - 2 + 54 + ITEMS_AT + 2;
        small[size_at..size_at + 2].copy_from_slice(&20_u16.to_le_bytes());
        assert_eq!(check(&mut Cursor::new(small)), Err(Claim::Item { kind: 10, size: 20 }));
        // No items, which the reader takes for granted.
        assert_eq!(refused(packed.clone(), record_at + 54 + 32, &0_u16.to_le_bytes()), Claim::NoItems);
        // Chunks of any number of points, and a table that counts none of them.
        let mut any_size = packed.clone();
        any_size[record_at + 54 + 12..record_at + 54 + 16].copy_from_slice(&u32::MAX.to_le_bytes());
        let uncounted = refused(any_size, table_at + 4, &0_u32.to_le_bytes());
        assert_eq!(uncounted, Claim::Uncounted { counted: 0, n_points: 1_000 });
        // A table that counts no chunks does not keep the reader from reading them, nor does a table that is nowhere.
        let mut uncounted = packed.clone();
        uncounted[table_at + 4..table_at + 8].fill(0);
        assert!(matches!(refused(uncounted, layer_at, &u32::MAX.to_le_bytes()), Claim::Beyond { .. }));
        let mut placeless = packed.clone();
        placeless[points_at..points_at + 8].fill(0);
        placeless.extend([0; 8]);
        assert!(matches!(refused(placeless, layer_at, &u32::MAX.to_le_bytes()), Claim::Beyond { .. }));
    }

    #[test]
    fn a_chunk_table_is_not_read_as_a_chunk() {
        let mut packed = cloud(6, true);
        let points_at = u32_at(&packed, 96) as usize;
        let table_at = u64_at(&packed, points_at) as usize;
        // Chunks of one point, so that a second is looked for where the table lies. There it would be one without layers; other
        // bytes would make it one of gigabytes.
        let record_at = packed.windows(LASZIP.0.len()).position(|found| found == LASZIP.0).unwrap() - 2;
        packed[record_at + 54 + 12..record_at + 54 + 16].copy_from_slice(&1_u32.to_le_bytes());
        packed.truncate(table_at);
        packed.extend([0; 400]);
        let end = check(&mut Cursor::new(&packed)).unwrap();
        assert_eq!(end, table_at as u64);
        let mut reader = las::Reader::new(UpTo::new(Cursor::new(packed), end)).unwrap();
        let mut n_read = 0;
        let error = loop {
            match reader.read_points(1) {
                Ok(points) if points.is_empty() => panic!("all were read"),
                Ok(_) => n_read += 1,
                Err(error) => break error.to_string(),
            }
        };
        assert_eq!(n_read, 1, "{error}");
    }

    #[test]
    fn an_end_holds_for_those_who_read_on() {
        let mut file = UpTo::new(Cursor::new((0..10_u8).collect::<Vec<_>>()), 6);
        let mut found = Vec::new();
        file.read_to_end(&mut found).unwrap();
        assert_eq!(found, [0, 1, 2, 3, 4, 5]);
        assert_eq!(file.stream_position().unwrap(), 6);
        assert_eq!(file.read(&mut [0; 4]).unwrap(), 0);
        for from in [6, 8] {
            file.seek(SeekFrom::Start(9)).unwrap();
            file.seek(SeekFrom::Start(from)).unwrap();
            found.clear();
            file.read_to_end(&mut found).unwrap();
            assert_eq!(found, ((from as u8)..10).collect::<Vec<_>>());
        }
    }
}
