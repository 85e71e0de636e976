//! Reading photos for networks: in colour, at reduced size, and as a camera without lens distortion would have taken them
//! where the network wants that; and laying what it gives back into the photo as taken.

use glam::DVec2;
use rayon::prelude::*;

use super::resize::Rgb;
use crate::prior::PriorError;
use sizeup_geo::geodata::raster::{CellWindow, RasterFile, Resampling};
use sizeup_heights::camera::Camera;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

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
    let whole = CellWindow { col: 0, row: 0, width, height };
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

/// The photo as a camera without lens distortion would have taken it, its border repeated where the photo ends.
pub(super) fn straightened(photo: Raster<Rgb>, camera: &Camera) -> Raster<Rgb> {
    if camera.is_ideal() {
        return photo;
    }
    let (width, height) = (photo.width(), photo.height());
    let as_taken = camera.resized(width as u32, height as u32);
    let ideal = as_taken.ideal();
    let most = DVec2::new(width as f64 - 1.0, height as f64 - 1.0);
    let seen = |i: usize| {
        let pixel = middle_of(i, width);
        let there = ideal.unproject(pixel).and_then(|ray| as_taken.project(ray)).unwrap_or(pixel);
        // From positions to places between the middles of pixels.
        let place = (there - 0.5).clamp(DVec2::ZERO, most);
        let (col, row) = (place.x as usize, place.y as usize);
        let (next_col, next_row) = ((col + 1).min(width - 1), (row + 1).min(height - 1));
        let (x, y) = (place.x.fract() as f32, place.y.fract() as f32);
        std::array::from_fn(|c| {
            let at = |col: usize, row: usize| f32::from(photo[(col, row)][c]);
            let mix = |row: usize| at(col, row) * (1.0 - x) + at(next_col, row) * x;
            (mix(row) * (1.0 - y) + mix(next_row) * y).round() as u8
        })
    };
    let pixels = (0..width * height).into_par_iter().map(seen).collect();
    Raster::from_vec(width, height, pixels).expect("one colour per pixel")
}

/// Values of the photo without distortion, laid into the photo as taken: the nearest value, since means over an edge
/// of depth are depths where nothing is. NaN where the photo without distortion does not reach.
pub(super) fn as_taken(values: Raster<f32>, camera: &Camera) -> Raster<f32> {
    if camera.is_ideal() {
        return values;
    }
    let (width, height) = (values.width(), values.height());
    let as_taken = camera.resized(width as u32, height as u32);
    let ideal = as_taken.ideal();
    let value = |i: usize| {
        let there = as_taken.unproject(middle_of(i, width)).and_then(|ray| ideal.project(ray));
        let cell = there.filter(|place| place.cmpge(DVec2::ZERO).all());
        cell.and_then(|place| values.get(place.x as usize, place.y as usize).copied()).unwrap_or(f32::NAN)
    };
    let values = (0..width * height).into_par_iter().map(value).collect();
    Raster::from_vec(width, height, values).expect("one value per pixel")
}

fn middle_of(i: usize, width: usize) -> DVec2 {
    DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)
}

#[cfg(test)]
mod tests {
    use sizeup_heights::camera::Distortion;

    use super::*;

    /// Lines that a lens bends are straight in the picture without distortion, and what is laid back lies on them again.
    #[test]
    fn a_value_comes_back_to_the_pixel_whose_ray_it_belongs_to() {
        let distortion = Distortion::Brown { k1: -0.12, k2: 0.02, k3: 0.0, p1: 0.001, p2: -0.0005 };
        let camera = Camera { distortion, ..Camera::pinhole(160, 120, 110.0) };
        let ideal = camera.ideal();
        // Red is where the pixel's ray points to.
        let slope = |camera: &Camera, i: usize| camera.unproject(middle_of(i, 160)).unwrap().x;
        let red = |x: f64| (127.0 + 127.0 * x).round() as u8;
        let photo: Vec<Rgb> = (0..160 * 120).map(|i| [red(slope(&camera, i)), 0, 0]).collect();
        let straight = straightened(Raster::from_vec(160, 120, photo).unwrap(), &camera);
        let off = |i: usize| f64::from(straight.data()[i][0]) - (127.0 + 127.0 * slope(&ideal, i));
        // One grey level of rounding on each of two ways; borders are repeated.
        let inner = |i: &usize| (20..140).contains(&(i % 160)) && (20..100).contains(&(i / 160));
        assert!((0..160 * 120).filter(inner).all(|i| off(i).abs() <= 1.1));
        let of_rays = Raster::from_vec(160, 120, (0..160 * 120).map(|i| slope(&ideal, i) as f32).collect()).unwrap();
        let back = as_taken(of_rays, &camera);
        let pixel = 1.0 / 110.0;
        assert!((0..160 * 120).filter(inner).all(|i| (f64::from(back.data()[i]) - slope(&camera, i)).abs() < pixel));
    }
}
