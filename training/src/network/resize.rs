//! Bilinear resizing between grids over the same photo, whatever their strides.
//!
//! ```text
//! source position of cell i:  (i + ½) · n_from / n_to − ½,  clamped into the grid
//! ```
//!
//! This is ONNX's `Resize` with `half_pixel` coordinates. It is linear, so its way back is its transpose.

use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor, WithDType, bail};
use rayon::prelude::*;

use super::conv::{held, tensor};

/// Brings `batch × channels × rows × columns` to another number of rows and columns.
///
/// # Errors
/// Shapes that do not fit.
pub fn resize(x: &Tensor, rows: usize, columns: usize) -> Result<Tensor> {
    if x.dims4()?.2 == rows && x.dims4()?.3 == columns {
        return Ok(x.clone());
    }
    if x.device().is_cpu() {
        return x.contiguous()?.apply_op1(Resize { rows, columns });
    }
    // As two products with constant matrices, which any device can do.
    let weights = |from: usize, to: usize| -> Result<Tensor> {
        let mut values = vec![0_f32; from * to];
        for (i, (low, high, share)) in taps(from, to).into_iter().enumerate() {
            values[i * from + low] += 1.0 - share as f32;
            values[i * from + high] += share as f32;
        }
        Tensor::from_vec(values, (to, from), x.device())
    };
    let (_, _, from_rows, from_columns) = x.dims4()?;
    let across = x.contiguous()?.broadcast_matmul(&weights(from_columns, columns)?.t()?)?;
    weights(from_rows, rows)?.broadcast_matmul(&across)
}

struct Resize {
    rows: usize,
    columns: usize,
}

/// For each cell: the two source cells, and the second one's share.
fn taps(from: usize, to: usize) -> Vec<(usize, usize, f64)> {
    let tap = |i: usize| {
        let at = ((i as f64 + 0.5) * from as f64 / to as f64 - 0.5).clamp(0.0, from as f64 - 1.0);
        let low = at.floor() as usize;
        (low, (low + 1).min(from - 1), at - low as f64)
    };
    (0..to).map(tap).collect()
}

fn forward<T: WithDType>(x: &[T], from: (usize, usize), to: (usize, usize)) -> Vec<T> {
    let (of_rows, of_columns) = (taps(from.0, to.0), taps(from.1, to.1));
    let mut y = vec![T::zero(); x.len() / (from.0 * from.1) * to.0 * to.1];
    y.par_chunks_mut(to.0 * to.1).zip(x.par_chunks(from.0 * from.1)).for_each(|(y, x)| {
        for (y, &(top, bottom, down)) in y.chunks_exact_mut(to.1).zip(&of_rows) {
            let (top, bottom) = (&x[top * from.1..][..from.1], &x[bottom * from.1..][..from.1]);
            let down = T::from_f64(down);
            for (y, &(left, right, along)) in y.iter_mut().zip(&of_columns) {
                let along = T::from_f64(along);
                let upper = top[left] + (top[right] - top[left]) * along;
                let lower = bottom[left] + (bottom[right] - bottom[left]) * along;
                *y = upper + (lower - upper) * down;
            }
        }
    });
    y
}

fn backward<T: WithDType>(dy: &[T], from: (usize, usize), to: (usize, usize)) -> Vec<T> {
    let (of_rows, of_columns) = (taps(from.0, to.0), taps(from.1, to.1));
    let mut dx = vec![T::zero(); dy.len() / (to.0 * to.1) * from.0 * from.1];
    dx.par_chunks_mut(from.0 * from.1).zip(dy.par_chunks(to.0 * to.1)).for_each(|(dx, dy)| {
        for (dy, &(top, bottom, down)) in dy.chunks_exact(to.1).zip(&of_rows) {
            let down = T::from_f64(down);
            for (v, &(left, right, along)) in dy.iter().zip(&of_columns) {
                let along = T::from_f64(along);
                let lower = *v * down;
                let upper = *v - lower;
                dx[top * from.1 + right] += upper * along;
                dx[top * from.1 + left] += upper - upper * along;
                dx[bottom * from.1 + right] += lower * along;
                dx[bottom * from.1 + left] += lower - lower * along;
            }
        }
    });
    dx
}

impl CustomOp1 for Resize {
    fn name(&self) -> &'static str {
        "bilinear resizing"
    }

    fn cpu_fwd(&self, x: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let to = (self.rows, self.columns);
        if rows * columns * to.0 * to.1 == 0 {
            bail!("cannot resize {rows} × {columns} to {} × {}", to.0, to.1);
        }
        let y = match x {
            CpuStorage::F32(x) => CpuStorage::F32(forward(held(x, layout), (rows, columns), to)),
            CpuStorage::F64(x) => CpuStorage::F64(forward(held(x, layout), (rows, columns), to)),
            _ => bail!("resizing takes floats"),
        };
        Ok((y, Shape::from((batch, channels, to.0, to.1))))
    }

    fn bwd(&self, x: &Tensor, _y: &Tensor, dy: &Tensor) -> Result<Option<Tensor>> {
        let (_, _, rows, columns) = x.dims4()?;
        let to = (self.rows, self.columns);
        let dy = dy.flatten_all()?;
        let dx = match dy.dtype() {
            candle_core::DType::F64 => tensor(backward(&dy.to_vec1::<f64>()?, (rows, columns), to), x)?,
            _ => tensor(backward(&dy.to_vec1::<f32>()?, (rows, columns), to), x)?,
        };
        Ok(Some(dx))
    }
}
