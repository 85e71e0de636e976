//! Which building each point of a LAS file is of: an extra dimension by a usual name (LAS 1.4 R15, "Extra Bytes" record).

use las::{PointData, Vlr};

/// Names of the dimension, without regard to case.
const NAMES: [&str; 5] = ["instance", "instance_id", "instanceid", "building_id", "building"];
/// User and number of the record that describes extra dimensions.
const RECORD: (&str, u16) = ("LASF_Spec", 4);
/// Bytes of one description, and where in it the type, the options and the name are.
const DESCRIPTION: usize = 192;
const TYPE_AT: usize = 2;
const OPTIONS_AT: usize = 3;
const NAME: std::ops::Range<usize> = 4..36;

/// The building that each point is of; 0, negative and broken numbers stand for none. Empty where no point is of any.
pub(super) fn instances(vlrs: &[Vlr], points: &PointData) -> Vec<Option<u32>> {
    let Some((offset, kind)) = dimension(vlrs) else { return Vec::new() };
    let record = points.record_len();
    // Extra dimensions are the last bytes of a point's record.
    let at = record.saturating_sub(usize::from(points.format().extra_bytes)) + offset;
    let found: Vec<Option<u32>> =
        points.raw_bytes().chunks_exact(record).map(|bytes| kind.read(bytes.get(at..)?)).collect();
    if found.iter().any(Option::is_some) { found } else { Vec::new() }
}

/// Offset of the dimension among the extra bytes, and its storage.
fn dimension(vlrs: &[Vlr]) -> Option<(usize, NumberStorage)> {
    let record = vlrs.iter().find(|vlr| vlr.user_id == RECORD.0 && vlr.record_id == RECORD.1)?;
    let mut offset = 0;
    for description in record.data.chunks_exact(DESCRIPTION) {
        let name = String::from_utf8_lossy(&description[NAME]);
        let name = name.trim_end_matches('\0').trim().to_ascii_lowercase();
        if NAMES.contains(&name.as_str())
            && let Some(kind) = NumberStorage::of(description[TYPE_AT])
        {
            return Some((offset, kind));
        }
        offset += size(description[TYPE_AT], description[OPTIONS_AT])?;
    }
    None
}

/// Bytes of a dimension; 0 says it in its options, 11 to 30 are the first ten types twice and three times.
fn size(code: u8, options: u8) -> Option<usize> {
    const OF_ONE: [usize; 10] = [1, 1, 2, 2, 4, 4, 8, 8, 4, 8];
    match code {
        0 => Some(usize::from(options)),
        1..=30 => Some(OF_ONE[usize::from(code - 1) % 10] * (usize::from(code - 1) / 10 + 1)),
        _ => None,
    }
}

/// Storage of a number, little-endian.
#[derive(Debug, Clone, Copy)]
enum NumberStorage {
    Unsigned(usize),
    Signed(usize),
    Real(usize),
}

impl NumberStorage {
    fn of(code: u8) -> Option<Self> {
        let bytes = size(code, 0)?;
        match code {
            1 | 3 | 5 | 7 => Some(Self::Unsigned(bytes)),
            2 | 4 | 6 | 8 => Some(Self::Signed(bytes)),
            9 | 10 => Some(Self::Real(bytes)),
            _ => None,
        }
    }

    fn read(self, bytes: &[u8]) -> Option<u32> {
        let (Self::Unsigned(n) | Self::Signed(n) | Self::Real(n)) = self;
        let mut all = [0_u8; 8];
        all[..n].copy_from_slice(bytes.get(..n)?);
        let unsigned = u64::from_le_bytes(all);
        let value = match self {
            Self::Unsigned(_) => u32::try_from(unsigned).ok()?,
            Self::Signed(n) => {
                let unused = 64 - 8 * n as u32;
                u32::try_from((unsigned << unused).cast_signed() >> unused).ok()?
            }
            Self::Real(n) => {
                let value = if n == 4 { f64::from(f32::from_bits(unsigned as u32)) } else { f64::from_bits(unsigned) };
                (value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value)).then_some(value as u32)?
            }
        };
        (value > 0).then_some(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_type_are_read_and_none_is_none() {
        assert_eq!(NumberStorage::of(3).unwrap().read(&[0x39, 0x05, 0xff]), Some(1337));
        assert_eq!(NumberStorage::of(6).unwrap().read(&(-1_i32).to_le_bytes()), None);
        assert_eq!(NumberStorage::of(8).unwrap().read(&77_i64.to_le_bytes()), Some(77));
        assert_eq!(NumberStorage::of(9).unwrap().read(&12.0_f32.to_le_bytes()), Some(12));
        assert_eq!(NumberStorage::of(10).unwrap().read(&12.5_f64.to_le_bytes()), None);
        assert_eq!(NumberStorage::of(1).unwrap().read(&[0]), None);
        assert_eq!(NumberStorage::of(5).unwrap().read(&[1, 0]), None, "cut off");
    }

    #[test]
    fn the_dimension_is_found_behind_others() {
        let describe = |code: u8, options: u8, name: &str| {
            let mut bytes = vec![0_u8; DESCRIPTION];
            (bytes[TYPE_AT], bytes[OPTIONS_AT]) = (code, options);
            bytes[NAME][..name.len()].copy_from_slice(name.as_bytes());
            bytes
        };
        let data = [describe(0, 5, "raw"), describe(13, 0, "two words"), describe(6, 0, "Building_ID")].concat();
        let vlr = Vlr { user_id: RECORD.0.to_owned(), record_id: RECORD.1, data, ..Vlr::default() };
        let (offset, kind) = dimension(&[Vlr::default(), vlr]).unwrap();
        assert_eq!(offset, 5 + 4);
        assert!(matches!(kind, NumberStorage::Signed(4)));
        assert!(dimension(&[Vlr::default()]).is_none());
    }
}
