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

/// Batch, channels and pixels of a tensor whose channels fall into `n_groups`.
fn sizes(shape: &Shape, n_groups: usize) -> Result<(usize, usize, usize)> {
    let (batch, channels, rows, columns) = shape.dims4()?;
    if n_groups == 0 || channels % n_groups != 0 {
        bail!("{channels} channels do not fall into {n_groups} groups");
    }
    Ok((batch, channels, rows * columns))
}

/// Values that are summed in their own precision before they go into a double one: eight sums side by side, which the
/// processor adds at once.
const BLOCK: usize = 512;
const LANES: usize = 8;

/// `sum of f(a, b)` over two slices, in a fixed order.
pub(super) fn sum_of<T: WithDType>(a: &[T], b: &[T], f: impl Fn(T, T) -> T) -> f64 {
    let mut total = 0.0;
    for (a, b) in a.chunks(BLOCK).zip(b.chunks(BLOCK)) {
        let mut lanes = [T::zero(); LANES];
        for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
            for k in 0..LANES {
                lanes[k] += f(a[k], b[k]);
            }
        }
        let rest = a.len() / LANES * LANES;
        total += lanes.iter().map(|v| v.to_f64()).sum::<f64>();
        total += a[rest..].iter().zip(&b[rest..]).map(|(a, b)| f(*a, *b).to_f64()).sum::<f64>();
    }
    total
}

/// Mean and one over the deviation of a group.
fn moments<T: WithDType>(group: &[T]) -> (f64, f64) {
    let n = group.len() as f64;
    let mean = sum_of(group, group, |v, _| v) / n;
    let middle = T::from_f64(mean);
    let variance = sum_of(group, group, |v, _| (v - middle) * (v - middle)) / n;
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
            let (middle, width) = (T::from_f64(mean), T::from_f64(scale));
            // Per channel: sums of dy and of dy · n, where the rectifier lets through.
            let channel = |k: usize| k * pixels..(k + 1) * pixels;
            let mut through = dy.to_vec();
            through.iter_mut().zip(y).for_each(|(d, y)| *d = if *y > T::zero() { *d } else { T::zero() });
            let sums: Vec<(f64, f64)> = (0..per_group)
                .map(|k| {
                    let (x, d) = (&x[channel(k)], &through[channel(k)]);
                    (sum_of(d, d, |d, _| d), sum_of(d, x, |d, x| d * ((x - middle) * width)))
                })
                .collect();
            let gain = |k: usize| g[i % n_groups * per_group + k].to_f64();
            let n = size as f64;
            let total: f64 = sums.iter().enumerate().map(|(k, s)| gain(k) * s.0).sum::<f64>() / n;
            let total_n: f64 = sums.iter().enumerate().map(|(k, s)| gain(k) * s.1).sum::<f64>() / n;
            let (shift, slope) = (T::from_f64(scale * total), T::from_f64(scale * total_n));
            for k in 0..per_group {
                let factor = T::from_f64(scale * gain(k));
                let (x, d) = (&x[channel(k)], &through[channel(k)]);
                dx[channel(k)].iter_mut().zip(x).zip(d).for_each(|((dx, x), d)| {
                    *dx = *d * factor - shift - (*x - middle) * width * slope;
                });
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
