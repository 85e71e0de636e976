//! `OpenEXR` depth maps, as renderers and some networks write them: one channel of floats in the first flat layer.

use std::io::{Read, Seek, SeekFrom};

use exr::block::chunk::CompressedBlock;
use exr::meta::BlockDescription;
use exr::meta::attribute::LevelMode;
use exr::prelude::{FlatSamples, ReadChannels as _, ReadLayers as _, Vec2, f16, read};

use super::array::MapShape;
use sizeup_geo::limits;
use sizeup_heights::raster::Raster;

/// Channels that hold depth where none is named, first come first served.
const USUAL: [&str; 5] = ["Z", "depth", "Depth", "Y", "R"];

/// Reads a channel: the one named, the only one, or one with a usual name (`Z`, `depth`, `Y`, `R`).
/// It has at most `most` values.
pub(super) fn read_map(
    mut stream: impl Read + Seek + Send,
    most: u64,
    key: Option<&str>,
) -> Result<Raster<f32>, String> {
    let stored = stream.seek(SeekFrom::End(0)).and_then(|length| stream.rewind().map(|()| length));
    let stored = stored.map_err(|e| format!("it cannot be read: {e}"))?;
    // The header's claims are held against the photo, the file and the limits before a pixel is unpacked.
    let reader = exr::block::read(&mut stream, false).map_err(|e| format!("it is no sound EXR file: {e}"))?;
    let headers = reader.headers();
    let header = headers.first().ok_or("it has no layer")?;
    let shape = MapShape::of(&[1, header.layer_size.height(), header.layer_size.width()], most)?;
    // A block is read as a whole, and a tile may be larger than its layer.
    for header in headers {
        limits::check(header.max_block_byte_size() as u64, Some(stored)).map_err(|e| e.to_string())?;
        if matches!(header.blocks, BlockDescription::Tiles(tiles) if tiles.level_mode != LevelMode::Singular) {
            return Err("it holds several resolutions\nhint: write it with one".to_owned());
        }
    }
    // All channels are unpacked, and the one that is wanted becomes floats.
    let of_pixel: u64 = header.channels.list.iter().map(|c| c.sample_type.bytes_per_sample() as u64).sum();
    limits::check((shape.cells() as u64).saturating_mul(of_pixel + 4), Some(stored)).map_err(|e| e.to_string())?;
    let is_tiled = matches!(header.blocks, BlockDescription::Tiles(_));
    let names: Vec<String> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
    let wanted = choose(&names, key)?.to_owned();
    let reader = if is_tiled {
        check_tiles(reader)?;
        stream.rewind().map_err(|e| format!("it cannot be read: {e}"))?;
        exr::block::read(&mut stream, false).map_err(|e| format!("it is no sound EXR file: {e}"))?
    } else {
        reader
    };
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_chunks(reader)
        .map_err(|e| format!("it cannot be read: {e}"))?;
    let channels = image.layer_data.channel_data.list;
    let channel = channels.into_iter().find(|channel| channel.name.to_string() == wanted);
    let channel = channel.ok_or_else(|| format!("channel {wanted:?} is in another layer than the first"))?;
    let values: Vec<f32> = match channel.sample_data {
        FlatSamples::F16(values) => values.into_iter().map(f16::to_f32).collect(),
        FlatSamples::F32(values) => values,
        FlatSamples::U32(values) => values.into_iter().map(|v| v as f32).collect(),
    };
    let n = values.len();
    Raster::from_vec(shape.width, shape.height, values)
        .ok_or_else(|| format!("channel {wanted:?} has {n} values, expected {} × {}", shape.width, shape.height))
}

/// Each tile says itself of which resolution it is, and the reader believes it.
fn check_tiles(reader: exr::block::reader::Reader<impl Read + Seek>) -> Result<(), String> {
    for chunk in reader.all_chunks(false).map_err(|e| format!("it cannot be read: {e}"))? {
        let chunk = chunk.map_err(|e| format!("it cannot be read: {e}"))?;
        if matches!(chunk.compressed_block, CompressedBlock::Tile(tile) if tile.coordinates.level_index != Vec2(0, 0)) {
            return Err("one of its tiles is of another resolution than the file\nhint: it is damaged: copy it again"
                .to_owned());
        }
    }
    Ok(())
}

fn choose<'a>(names: &'a [String], key: Option<&str>) -> Result<&'a str, String> {
    let find = |name: &str| names.iter().find(|n| *n == name).map(String::as_str);
    let listed = || names.join(", ");
    match (key, names) {
        (Some(key), _) => find(key).ok_or_else(|| format!("it has no channel {key:?}, but {}", listed())),
        (None, [only]) => Ok(only),
        // Three colours are a picture of a depth map, unless somebody says that one of them is one.
        (None, _) if find("Z").is_none() && find("G").is_some() => {
            Err(format!("it has the channels {}: a picture?\nhint: set `key` to the one that holds depth", listed()))
        }
        (None, _) => USUAL
            .into_iter()
            .find_map(find)
            .ok_or_else(|| format!("it has the channels {}\nhint: set `key` to one of them", listed())),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use exr::prelude::{
        AnyChannel, AnyChannels, Blocks, Encoding, Image, Layer, LayerAttributes, SmallVec, WritableImage as _,
    };
    use proptest::prelude::*;

    use super::*;

    fn exr(channels: &[(&str, FlatSamples)]) -> Vec<u8> {
        let list: SmallVec<[AnyChannel<FlatSamples>; 4]> =
            channels.iter().map(|(name, samples)| AnyChannel::new(*name, samples.clone())).collect();
        let layer =
            Layer::new((3, 2), LayerAttributes::named("depth"), Encoding::SMALL_LOSSLESS, AnyChannels::sort(list));
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    fn six() -> Vec<f32> {
        vec![1.0, 2.5, 3.0, 4.0, f32::INFINITY, 6.0]
    }

    #[test]
    fn depth_is_read_by_its_usual_name_by_key_and_alone() {
        let halves = FlatSamples::F16(six().into_iter().map(f16::from_f32).collect());
        let other = FlatSamples::F32(vec![0.0; 6]);
        let read =
            |bytes: &[u8], key: Option<&str>| read_map(Cursor::new(bytes), 1 << 20, key).map(|r| r.data().to_vec());
        assert_eq!(read(&exr(&[("Z", FlatSamples::F32(six())), ("A", other.clone())]), None), Ok(six()));
        assert_eq!(read(&exr(&[("V", halves.clone())]), None), Ok(six()));
        let colours = exr(&[("R", halves), ("G", other.clone()), ("B", other)]);
        assert!(read(&colours, None).unwrap_err().contains("a picture?"));
        assert_eq!(read(&colours, Some("R")), Ok(six()));
        assert!(read(&colours, Some("depth")).unwrap_err().contains("B, G, R"));
    }

    #[test]
    fn damaged_files_are_refused() {
        let whole = exr(&[("Z", FlatSamples::F32(six()))]);
        for bytes in [&whole[..whole.len() / 2], b"no picture", b""] {
            assert!(read_map(Cursor::new(bytes), 1 << 20, None).is_err());
        }
    }

    #[test]
    fn tiles_that_contradict_the_file_are_refused() {
        let tiled = |side: usize| {
            let samples = FlatSamples::F32(six());
            let blocks = Blocks::Tiles(Vec2(side, side));
            let encoding = Encoding { blocks, ..Encoding::UNCOMPRESSED };
            let list: SmallVec<[AnyChannel<FlatSamples>; 4]> = [AnyChannel::new("Z", samples)].into_iter().collect();
            let layer = Layer::new((3, 2), LayerAttributes::named("depth"), encoding, AnyChannels::sort(list));
            let mut bytes = Cursor::new(Vec::new());
            Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
            bytes.into_inner()
        };
        assert_eq!(read_map(Cursor::new(tiled(64)), 1 << 20, None).map(|map| map.data().to_vec()), Ok(six()));
        // The resolution that the only tile says to be of, before its 24 bytes and their number.
        let mut bytes = tiled(64);
        let at = bytes.len() - 24 - 4 - 8;
        bytes[at] = 4;
        let refused = read_map(Cursor::new(bytes), 1 << 20, None).unwrap_err();
        assert!(refused.contains("another resolution"), "{refused}");
        // The tile's height, of 4 GB.
        let mut bytes = tiled(64);
        let at = bytes.windows(8).position(|found| found == b"tiledesc").unwrap() + 9 + 4 + 4;
        bytes[at..at + 4].copy_from_slice(&16_318_528_u32.to_le_bytes());
        let refused = read_map(Cursor::new(bytes), 1 << 20, None).unwrap_err();
        assert!(refused.contains("claim to hold"), "{refused}");
    }

    proptest! {
        #[test]
        fn no_damage_makes_it_panic(at in 0_usize..400, byte in any::<u8>()) {
            let mut bytes = exr(&[("Z", FlatSamples::F32(six()))]);
            let at = at % bytes.len();
            bytes[at] = byte;
            let _ = read_map(Cursor::new(bytes), 1 << 20, None);
        }
    }
}
