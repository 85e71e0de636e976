//! From the tensors that a network gives to maps of one photo.

use super::preprocess::{NetworkInput, PhotoCut};
use super::profile::Form;
use crate::onnx::Tensor;
use crate::prior::array::{MOST, MapShape};
use sizeup_heights::raster::Raster;

/// The outputs of each photo of a batch; `outputs` are those of the batch.
pub(super) fn split_batch(outputs: Vec<Tensor>, n_photos: usize) -> Result<Vec<Vec<Tensor>>, String> {
    if n_photos == 1 {
        return Ok(vec![outputs]);
    }
    let mut of_photos: Vec<Vec<Tensor>> = (0..n_photos).map(|_| Vec::with_capacity(outputs.len())).collect();
    for Tensor { mut shape, values } in outputs {
        if shape.first() != Some(&n_photos) || values.is_empty() {
            return Err(format!(
                "it gives a tensor of shape {shape:?} for {n_photos} photos at once\nhint: set `batch = 1`"
            ));
        }
        shape[0] = 1;
        for (outputs, values) in of_photos.iter_mut().zip(values.chunks_exact(values.len() / n_photos)) {
            outputs.push(Tensor { shape: shape.clone(), values: values.to_vec() });
        }
    }
    Ok(of_photos)
}

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
    fn a_batch_comes_apart_photo_by_photo() {
        let depth = Tensor { shape: vec![2, 1, 1, 3], values: vec![1., 2., 3., 4., 5., 6.] };
        let sky = Tensor { shape: vec![2, 1], values: vec![7., 8.] };
        let photos = split_batch(vec![depth.clone(), sky], 2).unwrap();
        assert_eq!(photos[1][0], Tensor { shape: vec![1, 1, 1, 3], values: vec![4., 5., 6.] });
        assert_eq!(photos[0][1].values, [7.]);
        let single = Tensor { shape: vec![1, 1, 1, 6], ..depth };
        assert!(split_batch(vec![single], 2).unwrap_err().contains("batch = 1"));
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
