//! Group normalisation (Wu and He, 2018, arXiv 1803.08494) with the rectifier behind it, in one pass each way.
//!
//! ```text
//! n = (x − mean of its group) / sqrt(variance of its group + 1e-5),    y = max(0, g[c] · n + b[c])
//! ```
//!
//! It knows no running averages: a network does the same while it is trained and after, whatever the batch.

use candle_core::{CpuStorage, CustomOp3, DType, Layout, Result, Shape, Tensor, WithDType, bail};
use rayon::prelude::*;

use super::conv::{held, tensor};

/// Added to the variance, as everywhere.
pub const EPSILON: f64 = 1e-5;

/// Normalises groups of channels and cuts off what is negative.
///
/// `x`: `batch × channels × rows × columns`, `g` and `b`: `channels`; `n_groups` divides the channels.
///
/// # Errors
/// Shapes that do not fit.
pub fn group_norm_relu(x: &Tensor, g: &Tensor, b: &Tensor, n_groups: usize) -> Result<Tensor> {
    if x.device().is_cpu() {
        return x.contiguous()?.apply_op3(&g.contiguous()?, &b.contiguous()?, GroupNorm { n_groups });
    }
    let (batch, channels, rows, columns) = x.dims4()?;
    let grouped = x.reshape((batch, n_groups, channels / n_groups * rows * columns))?;
    let centred = grouped.broadcast_sub(&grouped.mean_keepdim(2)?)?;
    let deviation = (centred.sqr()?.mean_keepdim(2)? + EPSILON)?.sqrt()?;
    let normal = centred.broadcast_div(&deviation)?.reshape((batch, channels, rows, columns))?;
    let line = |t: &Tensor| t.reshape((1, channels, 1, 1));
    normal.broadcast_mul(&line(g)?)?.broadcast_add(&line(b)?)?.relu()
}

struct GroupNorm {
    n_groups: usize,
}

/// Batch, channels, pixels.
fn sizes(shape: &Shape, n_groups: usize) -> Result<(usize, usize, usize)> {
    let (batch, channels, rows, columns) = shape.dims4()?;
    if n_groups == 0 || channels % n_groups != 0 {
        bail!("{channels} channels do not fall into {n_groups} groups");
    }
    Ok((batch, channels, rows * columns))
}

/// Mean and one over the deviation of a group, summed in double precision.
fn moments<T: WithDType>(group: &[T]) -> (f64, f64) {
    let n = group.len() as f64;
    let mean = group.iter().map(|v| v.to_f64()).sum::<f64>() / n;
    let variance = group.iter().map(|v| (v.to_f64() - mean).powi(2)).sum::<f64>() / n;
    (mean, 1.0 / (variance + EPSILON).sqrt())
}

fn forward<T: WithDType>(x: &[T], g: &[T], b: &[T], n_groups: usize, pixels: usize) -> Vec<T> {
    let per_group = g.len() / n_groups;
    let mut y = vec![T::zero(); x.len()];
    let groups = y.par_chunks_mut(per_group * pixels).zip(x.par_chunks(per_group * pixels)).enumerate();
    groups.for_each(|(i, (y, x))| {
        let (mean, scale) = moments(x);
        for (k, (y, x)) in y.chunks_exact_mut(pixels).zip(x.chunks_exact(pixels)).enumerate() {
            let c = i % n_groups * per_group + k;
            let gain = T::from_f64(g[c].to_f64() * scale);
            let shift = T::from_f64(b[c].to_f64() - g[c].to_f64() * scale * mean);
            y.iter_mut().zip(x).for_each(|(y, x)| {
                let v = *x * gain + shift;
                *y = if v > T::zero() { v } else { T::zero() };
            });
        }
    });
    y
}

/// Gradients to `x`, `g` and `b`; those to `g` and `b` per sample first, then summed in the batch's order.
fn backward<T: WithDType>(
    (x, g, y, dy): (&[T], &[T], &[T], &[T]),
    n_groups: usize,
    pixels: usize,
) -> (Vec<T>, Vec<T>, Vec<T>) {
    let (channels, per_group) = (g.len(), g.len() / n_groups);
    let size = per_group * pixels;
    let mut dx = vec![T::zero(); x.len()];
    let of_groups: Vec<Vec<(f64, f64)>> = dx
        .par_chunks_mut(size)
        .enumerate()
        .map(|(i, dx)| {
            let part = i * size..(i + 1) * size;
            let (x, y, dy) = (&x[part.clone()], &y[part.clone()], &dy[part]);
            let (mean, scale) = moments(x);
            let normal = |v: T| (v.to_f64() - mean) * scale;
            // Per channel: sums of dy and of dy · n, where the rectifier lets through.
            let mut sums = vec![(0.0, 0.0); per_group];
            for (k, sum) in sums.iter_mut().enumerate() {
                for p in k * pixels..(k + 1) * pixels {
                    if y[p] > T::zero() {
                        let v = dy[p].to_f64();
                        sum.0 += v;
                        sum.1 += v * normal(x[p]);
                    }
                }
            }
            let gain = |k: usize| g[i % n_groups * per_group + k].to_f64();
            let n = size as f64;
            let total: f64 = sums.iter().enumerate().map(|(k, s)| gain(k) * s.0).sum::<f64>() / n;
            let total_n: f64 = sums.iter().enumerate().map(|(k, s)| gain(k) * s.1).sum::<f64>() / n;
            for k in 0..per_group {
                for p in k * pixels..(k + 1) * pixels {
                    let through = if y[p] > T::zero() { gain(k) * dy[p].to_f64() } else { 0.0 };
                    dx[p] = T::from_f64(scale * (through - total - normal(x[p]) * total_n));
                }
            }
            sums
        })
        .collect();
    let (mut dg, mut db) = (vec![0.0; channels], vec![0.0; channels]);
    for (i, sums) in of_groups.iter().enumerate() {
        for (k, (of_b, of_g)) in sums.iter().enumerate() {
            db[i % n_groups * per_group + k] += of_b;
            dg[i % n_groups * per_group + k] += of_g;
        }
    }
    let cast = |v: Vec<f64>| v.into_iter().map(T::from_f64).collect();
    (dx, cast(dg), cast(db))
}

impl CustomOp3 for GroupNorm {
    fn name(&self) -> &'static str {
        "group normalisation and rectifier"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        g: &CpuStorage,
        g_layout: &Layout,
        b: &CpuStorage,
        b_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (_, _, pixels) = sizes(x_layout.shape(), self.n_groups)?;
        let n = self.n_groups;
        let y = match (x, g, b) {
            (CpuStorage::F32(x), CpuStorage::F32(g), CpuStorage::F32(b)) => {
                CpuStorage::F32(forward(held(x, x_layout), held(g, g_layout), held(b, b_layout), n, pixels))
            }
            (CpuStorage::F64(x), CpuStorage::F64(g), CpuStorage::F64(b)) => {
                CpuStorage::F64(forward(held(x, x_layout), held(g, g_layout), held(b, b_layout), n, pixels))
            }
            _ => bail!("group normalisation takes floats of one kind"),
        };
        Ok((y, x_layout.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        g: &Tensor,
        b: &Tensor,
        y: &Tensor,
        dy: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        if x.dtype() == DType::F64 { self.back::<f64>(x, g, b, y, dy) } else { self.back::<f32>(x, g, b, y, dy) }
    }
}

impl GroupNorm {
    #[expect(clippy::type_complexity, reason = "as candle asks for it")]
    fn back<T: WithDType>(
        &self,
        x: &Tensor,
        g: &Tensor,
        b: &Tensor,
        y: &Tensor,
        dy: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let (_, _, pixels) = sizes(x.shape(), self.n_groups)?;
        let flat = |t: &Tensor| t.flatten_all()?.to_vec1::<T>();
        let (xs, gs, ys, dys) = (flat(x)?, flat(g)?, flat(y)?, flat(dy)?);
        let (dx, dg, db) = backward((&xs, &gs, &ys, &dys), self.n_groups, pixels);
        Ok((Some(tensor(dx, x)?), Some(tensor(dg, g)?), Some(tensor(db, b)?)))
    }
}
