//! COLMAP's binary files: little-endian, counts in front. No count is believed beyond what the file can hold.

use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::Path;

use glam::DVec3;

use super::{CamerasById, ImageRow, models};
use crate::SurveyError;
use crate::error::Place;
use crate::text::decode;
use sizeup_geo::files::FileError;

/// Bytes of a camera without its parameters.
const CAMERA_BYTES: u64 = 4 + 4 + 8 + 8;
/// Bytes of an image without its name and observations.
const IMAGE_BYTES: u64 = 4 + 7 * 8 + 4 + 1 + 8;
/// Bytes of an observation.
const OBSERVATION_BYTES: u64 = 8 + 8 + 8;
/// Bytes of a point without its observations, and of one of these.
const POINT_BYTES: u64 = 8 + 3 * 8 + 3 + 8 + 8;
const SIGHTING_BYTES: u64 = 4 + 4;
/// Longer names than this no file system has.
const MAX_NAME_BYTES: usize = 4096;

/// Reads `cameras.bin`, the cameras by their ids.
pub(super) fn cameras(path: &Path) -> Result<CamerasById, SurveyError> {
    let mut bytes = Bytes::open(path)?;
    let n_cameras = bytes.count("cameras", CAMERA_BYTES)?;
    let mut cameras = CamerasById::new();
    for _ in 0..n_cameras {
        let id = bytes.u32()?;
        let number = bytes.u32()?.cast_signed();
        let (width_px, height_px) = (bytes.u64()?, bytes.u64()?);
        let Some((name, n_params)) = models::by_number(number) else {
            let message = format!("camera {id} has model number {number}, which COLMAP does not have");
            return Err(bytes.error(message).hint("without its model the length of its parameters is unknown"));
        };
        let mut params = vec![0.0; n_params];
        for param in &mut params {
            *param = bytes.f64()?;
        }
        if cameras.insert(id, models::camera(name, width_px, height_px, &params)).is_some() {
            return Err(bytes.error(format!("camera {id} is there twice")));
        }
    }
    Ok(cameras)
}

/// Reads `images.bin`; observations are passed over.
pub(super) fn images(path: &Path, mut take: impl FnMut(ImageRow)) -> Result<(), SurveyError> {
    let mut bytes = Bytes::open(path)?;
    let n_images = bytes.count("images", IMAGE_BYTES)?;
    for _ in 0..n_images {
        let _id = bytes.u32()?;
        let mut values = [0.0; 7];
        for value in &mut values {
            *value = bytes.f64()?;
        }
        let camera_id = bytes.u32()?;
        let name = bytes.name()?;
        let n_observations = bytes.count("observations", OBSERVATION_BYTES)?;
        bytes.skip(n_observations * OBSERVATION_BYTES)?;
        take(ImageRow {
            wxyz: [values[0], values[1], values[2], values[3]],
            translation: DVec3::new(values[4], values[5], values[6]),
            camera_id,
            name,
        });
    }
    Ok(())
}

/// Reads `points3D.bin`: positions of points that at least so many photos see.
pub(super) fn points(path: &Path, min_photos: u64, mut take: impl FnMut(DVec3)) -> Result<(), SurveyError> {
    let mut bytes = Bytes::open(path)?;
    let n_points = bytes.count("points", POINT_BYTES)?;
    for _ in 0..n_points {
        let _id = bytes.u64()?;
        let at = DVec3::new(bytes.f64()?, bytes.f64()?, bytes.f64()?);
        let _colour: [u8; 3] = bytes.array()?;
        let _error_px = bytes.f64()?;
        let n_photos = bytes.count("observations", SIGHTING_BYTES)?;
        bytes.skip(n_photos * SIGHTING_BYTES)?;
        if n_photos >= min_photos {
            take(at);
        }
    }
    Ok(())
}

/// A file read front to back, knowing how much is left.
struct Bytes<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    position: u64,
    length: u64,
}

impl<'a> Bytes<'a> {
    fn open(path: &'a Path) -> Result<Self, SurveyError> {
        let file = File::open(path).map_err(FileError::on("cannot open", path))?;
        let length = file.metadata().map_err(FileError::on("cannot read", path))?.len();
        Ok(Self { path, reader: BufReader::with_capacity(1 << 18, file), position: 0, length })
    }

    fn error(&self, message: impl Into<String>) -> SurveyError {
        SurveyError::malformed(self.path, Place::Byte(self.position), message)
    }

    fn left(&self) -> u64 {
        self.length.saturating_sub(self.position)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], SurveyError> {
        if self.left() < N as u64 {
            return Err(self.error("the file ends in the middle of a record").hint("it is truncated: copy it again"));
        }
        let mut bytes = [0; N];
        self.reader.read_exact(&mut bytes).map_err(FileError::on("cannot read", self.path))?;
        self.position += N as u64;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32, SurveyError> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, SurveyError> {
        self.array().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, SurveyError> {
        self.array().map(f64::from_le_bytes)
    }

    /// A count, refused when that many records cannot follow.
    fn count(&mut self, what: &str, record_bytes: u64) -> Result<u64, SurveyError> {
        let n = self.u64()?;
        let n_possible = self.left() / record_bytes;
        if n > n_possible {
            let message = format!("{n} {what} are announced, but the rest of the file holds at most {n_possible}");
            return Err(self.error(message).hint("it is truncated, or not a COLMAP binary file"));
        }
        Ok(n)
    }

    /// A name up to its zero byte.
    fn name(&mut self) -> Result<String, SurveyError> {
        let mut name = Vec::new();
        loop {
            match self.array::<1>()? {
                [0] => break,
                [byte] => name.push(byte),
            }
            if name.len() > MAX_NAME_BYTES {
                return Err(self.error(format!("an image name of more than {MAX_NAME_BYTES} bytes")));
            }
        }
        Ok(decode(&name))
    }

    fn skip(&mut self, n_bytes: u64) -> Result<(), SurveyError> {
        let step = i64::try_from(n_bytes).map_err(|_| self.error("a record beyond the end of the file"))?;
        self.reader.seek_relative(step).map_err(FileError::on("cannot read", self.path))?;
        self.position += n_bytes;
        Ok(())
    }
}
