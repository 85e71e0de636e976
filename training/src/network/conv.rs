//! Convolution on the CPU, written as products of matrices over a few rows of the image at a time.
//!
//! ```text
//! y[o, p] = b[o] + sum over i, k of  w[o, i, k] · x[i, s·p + k − h]        s: stride, h = side / 2 (zeros outside)
//! ```
//!
//! The unfolded rows are made anew on the way back, so that nothing but activations is kept between the two ways. Sums run in
//! the order of the batch, so that the number of threads changes no bit. On a GPU candle's own is used.

use candle_core::{CpuStorage, CustomOp3, DType, Device, Layout, Result, Shape, Tensor, WithDType, bail};
use rayon::prelude::*;

use super::norm::sum_of;

/// Values of an unfolded block of rows: small enough for the cache, large enough for a product to be worth its start.
const BLOCK_VALUES: usize = 1 << 19;

/// `y = w * x + b`, zeros beyond the border; rows and columns of `y` are those of `x` over the stride, rounded up.
///
/// `x`: `batch × in × rows × columns`, `w`: `out × in × side × side` with an odd side, `b`: `out`.
///
/// # Errors
/// Shapes that do not fit.
pub fn conv2d(x: &Tensor, w: &Tensor, b: &Tensor, stride: usize) -> Result<Tensor> {
    let side = w.dim(2)?;
    if x.device().is_cpu() {
        return x.contiguous()?.apply_op3(&w.contiguous()?, &b.contiguous()?, Convolution { stride });
    }
    let y = x.conv2d(w, side / 2, stride, 1, 1)?;
    y.broadcast_add(&b.reshape((1, (), 1, 1))?)
}

struct Convolution {
    stride: usize,
}

/// The sizes of one convolution.
#[derive(Clone, Copy)]
struct Sizes {
    batch: usize,
    n_in: usize,
    rows: usize,
    columns: usize,
    n_out: usize,
    side: usize,
    stride: usize,
    out_rows: usize,
    out_columns: usize,
}

impl Sizes {
    fn of(x: &Shape, w: &Shape, stride: usize) -> Result<Self> {
        let (batch, n_in, rows, columns) = x.dims4()?;
        let (n_out, of_in, side, side2) = w.dims4()?;
        if n_in != of_in || side != side2 || side % 2 == 0 || stride == 0 {
            bail!("a convolution with weights {w:?} and stride {stride} does not take {x:?}");
        }
        let (out_rows, out_columns) = (rows.div_ceil(stride), columns.div_ceil(stride));
        Ok(Self { batch, n_in, rows, columns, n_out, side, stride, out_rows, out_columns })
    }

    /// Values of one sample's input and output, and of one unfolded column.
    fn strides(&self) -> (usize, usize, usize) {
        (
            self.n_in * self.rows * self.columns,
            self.n_out * self.out_rows * self.out_columns,
            self.n_in * self.side * self.side,
        )
    }

    /// Output rows, a block at a time.
    fn blocks(&self) -> impl Iterator<Item = std::ops::Range<usize>> + use<> {
        let per_row = self.strides().2 * self.out_columns;
        let (step, end) = ((BLOCK_VALUES / per_row).max(1), self.out_rows);
        (0..end).step_by(step).map(move |first| first..(first + step).min(end))
    }

    /// For a tap of the kernel: where an output row reads, and the output columns that read inside.
    fn tap(&self, row: usize, k: usize) -> Option<usize> {
        (row * self.stride + k).checked_sub(self.side / 2).filter(|r| *r < self.rows)
    }

    /// First output column that reads inside, and one after the last.
    fn span(&self, k: usize) -> (usize, usize) {
        let half = self.side / 2;
        let first = half.saturating_sub(k).div_ceil(self.stride);
        let end = (self.columns + half).saturating_sub(k).div_ceil(self.stride).min(self.out_columns);
        (first.min(end), end)
    }

    /// The unfolded image of some output rows: `(in · side · side) × (rows · out_columns)`.
    fn unfold<T: WithDType>(&self, x: &[T], block: std::ops::Range<usize>) -> Result<Tensor> {
        let n = block.len() * self.out_columns;
        // Filled from the front, so that nothing is zeroed first or copied after.
        let mut into = Vec::with_capacity(self.strides().2 * n);
        self.each_tap(|_, channel, ky, kx| {
            let (first, end) = self.span(kx);
            for row in block.clone() {
                let Some(source) = self.tap(row, ky) else {
                    into.resize(into.len() + self.out_columns, T::zero());
                    continue;
                };
                into.resize(into.len() + first, T::zero());
                let from = &x[(channel * self.rows + source) * self.columns..][..self.columns];
                let start = first * self.stride + kx - self.side / 2;
                if self.stride == 1 {
                    into.extend_from_slice(&from[start..start + end - first]);
                } else {
                    into.extend(from[start..].iter().step_by(self.stride).take(end - first).copied());
                }
                into.resize(into.len() + self.out_columns - end, T::zero());
            }
        });
        Tensor::from_vec(into, (self.strides().2, n), &Device::Cpu)
    }

    /// The reverse: adds what the unfolded rows hold to where it came from.
    fn fold<T: WithDType>(&self, unfolded: &[T], block: std::ops::Range<usize>, x: &mut [T]) {
        let n = block.len() * self.out_columns;
        self.each_tap(|line, channel, ky, kx| {
            let (first, end) = self.span(kx);
            for (i, row) in block.clone().enumerate() {
                let Some(source) = self.tap(row, ky) else { continue };
                let to = &mut x[(channel * self.rows + source) * self.columns..][..self.columns];
                let from = &unfolded[line * n + i * self.out_columns..][first..end];
                let start = first * self.stride + kx - self.side / 2;
                to[start..].iter_mut().step_by(self.stride).zip(from).for_each(|(t, f)| *t += *f);
            }
        });
    }

    fn each_tap(&self, mut look: impl FnMut(usize, usize, usize, usize)) {
        let mut line = 0;
        for channel in 0..self.n_in {
            for ky in 0..self.side {
                for kx in 0..self.side {
                    look(line, channel, ky, kx);
                    line += 1;
                }
            }
        }
    }
}

/// A small matrix as a tensor of its own, to multiply it with candle's kernels.
fn matrix<T: WithDType>(values: &[T], rows: usize, columns: usize) -> Result<Tensor> {
    Tensor::from_slice(values, (rows, columns), &Device::Cpu)
}

fn values<T: WithDType>(tensor: &Tensor) -> Result<Vec<T>> {
    tensor.flatten_all()?.to_vec1::<T>()
}

fn forward<T: WithDType>(sizes: Sizes, x: &[T], w: &[T], b: &[T]) -> Result<Vec<T>> {
    let (per_in, per_out, per_column) = sizes.strides();
    let area = sizes.out_rows * sizes.out_columns;
    let mut y = vec![T::zero(); sizes.batch * per_out];
    y.par_chunks_mut(per_out).zip(x.par_chunks(per_in)).try_for_each(|(y, x)| {
        let w = matrix(w, sizes.n_out, per_column)?;
        for block in sizes.blocks() {
            let n = block.len() * sizes.out_columns;
            let product: Vec<T> = values(&w.matmul(&sizes.unfold(x, block.clone())?)?)?;
            for (o, line) in product.chunks_exact(n).enumerate() {
                let to = &mut y[o * area + block.start * sizes.out_columns..][..n];
                to.iter_mut().zip(line).for_each(|(t, v)| *t = *v + b[o]);
            }
        }
        Ok::<(), candle_core::Error>(())
    })?;
    Ok(y)
}

/// Gradients of one sample: to `x`, `w` and `b`.
fn backward_of_one<T: WithDType>(sizes: Sizes, x: &[T], w: &Tensor, dy: &[T]) -> Result<(Vec<T>, Vec<T>, Vec<T>)> {
    let (per_in, _, per_column) = sizes.strides();
    let area = sizes.out_rows * sizes.out_columns;
    let mut dx = vec![T::zero(); per_in];
    let mut dw = vec![T::zero(); sizes.n_out * per_column];
    let mut db = vec![T::zero(); sizes.n_out];
    for block in sizes.blocks() {
        let n = block.len() * sizes.out_columns;
        let mut lines = Vec::with_capacity(sizes.n_out * n);
        for (o, sum) in db.iter_mut().enumerate() {
            let line = &dy[o * area + block.start * sizes.out_columns..][..n];
            *sum += T::from_f64(sum_of(line, line, |v, _| v));
            lines.extend_from_slice(line);
        }
        let dy = Tensor::from_vec(lines, (sizes.n_out, n), &Device::Cpu)?;
        let part: Vec<T> = values(&dy.matmul(&sizes.unfold(x, block.clone())?.t()?)?)?;
        dw.iter_mut().zip(part).for_each(|(sum, v)| *sum += v);
        let back: Vec<T> = values(&w.t()?.matmul(&dy)?)?;
        sizes.fold(&back, block, &mut dx);
    }
    Ok((dx, dw, db))
}

fn backward<T: WithDType>(sizes: Sizes, x: &Tensor, w: &Tensor, dy: &Tensor) -> Result<(Vec<T>, Vec<T>, Vec<T>)> {
    let (per_in, per_out, per_column) = sizes.strides();
    let (x, dy): (Vec<T>, Vec<T>) = (values(x)?, values(&dy.contiguous()?)?);
    let w = w.reshape((sizes.n_out, per_column))?.detach();
    let parts = x.par_chunks(per_in).zip(dy.par_chunks(per_out)).map(|(x, dy)| backward_of_one(sizes, x, &w, dy));
    let parts: Vec<(Vec<T>, Vec<T>, Vec<T>)> = parts.collect::<Result<_>>()?;
    let mut dx = Vec::with_capacity(x.len());
    let mut dw = vec![T::zero(); sizes.n_out * per_column];
    let mut db = vec![T::zero(); sizes.n_out];
    for (part_x, part_w, part_b) in parts {
        dx.extend(part_x);
        dw.iter_mut().zip(part_w).for_each(|(sum, v)| *sum += v);
        db.iter_mut().zip(part_b).for_each(|(sum, v)| *sum += v);
    }
    Ok((dx, dw, db))
}

impl CustomOp3 for Convolution {
    fn name(&self) -> &'static str {
        "convolution in blocks of rows"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        w: &CpuStorage,
        w_layout: &Layout,
        b: &CpuStorage,
        b_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let sizes = Sizes::of(x_layout.shape(), w_layout.shape(), self.stride)?;
        let shape = Shape::from((sizes.batch, sizes.n_out, sizes.out_rows, sizes.out_columns));
        let y = match (x, w, b) {
            (CpuStorage::F32(x), CpuStorage::F32(w), CpuStorage::F32(b)) => {
                CpuStorage::F32(forward(sizes, held(x, x_layout), held(w, w_layout), held(b, b_layout))?)
            }
            (CpuStorage::F64(x), CpuStorage::F64(w), CpuStorage::F64(b)) => {
                CpuStorage::F64(forward(sizes, held(x, x_layout), held(w, w_layout), held(b, b_layout))?)
            }
            _ => bail!("a convolution takes floats of one kind"),
        };
        Ok((y, shape))
    }

    fn bwd(
        &self,
        x: &Tensor,
        w: &Tensor,
        b: &Tensor,
        _y: &Tensor,
        dy: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let sizes = Sizes::of(x.shape(), w.shape(), self.stride)?;
        let made = |dx, dw, db| Ok((Some(dx), Some(dw), Some(db)));
        if x.dtype() == DType::F64 {
            let (dx, dw, db) = backward::<f64>(sizes, x, w, dy)?;
            made(tensor(dx, x)?, tensor(dw, w)?, tensor(db, b)?)
        } else {
            let (dx, dw, db) = backward::<f32>(sizes, x, w, dy)?;
            made(tensor(dx, x)?, tensor(dw, w)?, tensor(db, b)?)
        }
    }
}

/// The part of a storage that a contiguous tensor holds.
pub(super) fn held<'a, T>(storage: &'a [T], layout: &Layout) -> &'a [T] {
    &storage[layout.start_offset()..][..layout.shape().elem_count()]
}

/// Values in the shape of another tensor.
pub(super) fn tensor<T: WithDType>(values: Vec<T>, like: &Tensor) -> Result<Tensor> {
    Tensor::from_vec(values, like.shape().clone(), like.device())
}
