//! Reading photos for networks: in colour, at reduced size.

use super::resize::Rgb;
use crate::geodata::raster::{RasterFile, Resampling, Window};
use crate::prior::PriorError;
use crate::raster::Raster;
use crate::survey::View;

/// Longer side above which a photo is decoded at a whole fraction of its size, pixels: eight times what networks see.
const DECODE_SIDE_PX: usize = 4096;

/// The photo in colour, grey ones three times the same; never whole at once where it is larger than networks see.
pub(super) fn decode(view: &View) -> Result<Raster<Rgb>, PriorError> {
    let path = view.image.as_deref().ok_or_else(|| PriorError::Photo {
        view: view.id.to_string(),
        problem: "its photo is not known".to_owned(),
        hint: "a network needs the photo's file".to_owned(),
    })?;
    let file = RasterFile::open(path)?;
    let (width, height) = file.size();
    let fraction = width.max(height).div_ceil(DECODE_SIDE_PX);
    let size = (width.div_ceil(fraction), height.div_ceil(fraction));
    let whole = Window { col: 0, row: 0, width, height };
    let resampling = if fraction == 1 { Resampling::Nearest } else { Resampling::Average };
    let mut photo = Raster::filled(size.0, size.1, [0_u8; 3]);
    let n_bands = if file.n_bands() >= 3 { 3 } else { 1 };
    for band in 0..n_bands {
        let values = file.read_window(band + 1, whole, size, resampling)?;
        for (pixel, value) in photo.data_mut().iter_mut().zip(values.data()) {
            let byte = value.round().clamp(0.0, 255.0) as u8; // NaN becomes 0
            if n_bands == 1 { *pixel = [byte; 3] } else { pixel[band] = byte }
        }
    }
    Ok(photo)
}
