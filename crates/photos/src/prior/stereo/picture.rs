//! Reading a photo for comparison with others.

use sizeup_geo::geodata::raster::{CellWindow, RasterFile, Resampling};
use sizeup_heights::picture::{Picture, PosedCamera};
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

use crate::prior::PriorError;

/// Camera of the reduced, distortion-free picture of a view.
pub(super) fn ideal_camera(view: &View, long_side_px: u32) -> PosedCamera {
    PosedCamera { camera: view.camera.reduced_to(long_side_px).ideal(), camera_from_map: view.camera_from_map }
}

/// Decodes the photo of a view at reduced size (from a JPEG's own coarser scales where it is one), whatever its size.
pub(crate) fn load_picture(view: &View, long_side_px: u32) -> Result<Picture, PriorError> {
    let refuse = |problem: String| PriorError::Photo {
        view: view.id.to_string(),
        problem,
        hint: "is it the photo that the pose belongs to?".to_owned(),
    };
    let path = view.image.as_deref().ok_or_else(|| refuse("its photo is not known".to_owned()))?;
    let file = RasterFile::open(path)?;
    let (width, height) = file.size();
    let aspect_is_off =
        (width as f64 * f64::from(view.camera.height_px) - height as f64 * f64::from(view.camera.width_px)).abs()
            > 0.01 * width as f64 * f64::from(view.camera.height_px);
    if aspect_is_off {
        return Err(refuse(format!(
            "its photo has {width} × {height} pixels, its camera {} × {}",
            view.camera.width_px, view.camera.height_px
        )));
    }
    let distorted_camera = view.camera.reduced_to(long_side_px);
    let size = (distorted_camera.width_px as usize, distorted_camera.height_px as usize);
    let whole = CellWindow { col: 0, row: 0, width, height };
    let band = |i: usize| file.read_window(i, whole, size, Resampling::Average);
    let grey = if file.n_bands() >= 3 {
        let (red, green, blue) = (band(1)?, band(2)?, band(3)?);
        let mixed = red.data().iter().zip(green.data()).zip(blue.data()).map(|((r, g), b)| r + g + b);
        Raster::from_vec(size.0, size.1, mixed.map(|sum| sum / 3.0).collect()).expect("bands are alike")
    } else {
        band(1)?
    };
    Ok(Picture::new(&grey, &distorted_camera, view.camera_from_map).expect("the photo was read at the camera's size"))
}
