//! From the tensors that a network gives to maps of one photo.

use super::preprocess::{NetworkInput, PhotoCut};
use super::profile::Form;
use crate::onnx::Tensor;
use crate::prior::array::{MOST, MapShape};
use sizeup_heights::raster::Raster;

/// One map of an output; of several, the first: the view itself.
pub(super) fn map_of(tensor: Tensor, form: Form) -> Result<Raster<f32>, String> {
    if form == Form::Points {
        let [.., height, width, 3] = tensor.shape[..] else {
            return Err(format!("its shape is {:?}, expected rows × columns × 3", tensor.shape));
        };
        let z = tensor.values.chunks_exact(3).take(height * width).map(|point| point[2]).collect();
        return Raster::from_vec(width, height, z).ok_or_else(|| "it is empty".to_owned());
    }
    let shape = MapShape::of(&tensor.shape, MOST)?;
    let mut values = tensor.values;
    values.truncate(shape.cells());
    Ok(shape.raster(values))
}

/// The part that shows the photo: of a letterbox the middle.
pub(super) fn cut_out(map: Raster<f32>, frame: &NetworkInput) -> Raster<f32> {
    let PhotoCut { col, row, columns, rows } = frame.photo;
    if (columns, rows) == (frame.columns, frame.rows) {
        return map;
    }
    // Outputs can be smaller than inputs.
    let at = |n: usize, of: usize, size: usize| (n * size + of / 2) / of;
    let (left, right) = (at(col, frame.columns, map.width()), at(col + columns, frame.columns, map.width()));
    let (top, bottom) = (at(row, frame.rows, map.height()), at(row + rows, frame.rows, map.height()));
    let map = &map;
    let lines = (top..bottom).flat_map(|y| (left..right).map(move |x| map[(x, y)]));
    Raster::from_vec(right - left, bottom - top, lines.collect()).expect("one value per cell")
}

/// Blanks values by another map of the same photo, of any size.
pub(super) fn blank(values: &mut Raster<f32>, by: &Raster<f32>, is_none: impl Fn(f32) -> bool) {
    let (width, height) = (values.width(), values.height());
    // The cell of `by` that holds the middle of cell `i` of `n`.
    let nearest = |i: usize, n: usize, n_by: usize| (2 * i + 1) * n_by / (2 * n);
    for (i, value) in values.data_mut().iter_mut().enumerate() {
        let (col, row) = (nearest(i % width, width, by.width()), nearest(i / width, height, by.height()));
        if is_none(by[(col, row)]) {
            *value = f32::NAN;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(values: &[f32]) -> Raster<f32> {
        Raster::from_vec(values.len(), 1, values.to_vec()).unwrap()
    }

    #[test]
    fn sky_of_another_size_blanks_what_lies_there() {
        let mut values = row(&[1., 2., 3., 4.]);
        blank(&mut values, &row(&[0., 1.]), |sky| sky > 0.5);
        assert!(values.data()[..2] == [1., 2.] && values.data()[2..].iter().all(|v| v.is_nan()));
        let mut values = row(&[1., 2.]);
        blank(&mut values, &row(&[1., 0., 0., 0., 0., 0.]), |sky| sky > 0.5);
        assert!(values.data() == [1., 2.], "the middle of the first lies in the second of six");
    }
}
