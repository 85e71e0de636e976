//! The derivative of one view's ordinal loss by the buildings' heights, in parts that stand alone.
//!
//! With `R` the rendered depth of a pixel, `M` the scale of the view (median absolute deviation + ε) and `s` a pair's
//! label:
//!
//! | part | what it knows |
//! |---|---|
//! | [`interior`] | a roof pixel gets nearer as its roof rises, `dR/dh = 1/d_z < 0`; walls and ground do not move |
//! | [`scale`] | `M` is itself made of two pixels' depths (the *exact* mode; otherwise `M` is held fixed) |
//! | [`central_difference`] | both rays of a pair evaluated anew for `h ± δ`: silhouettes that pass a pixel are in it |
//! | [`edge_sampled`] | the boundary term that `interior` lacks: where roof edges jump in depth, how fast they move, and what they cover |
//!
//! `interior + edge_sampled` is the derivative of the *expected* loss, the reference that the others are measured by.

pub(crate) mod central_difference;
pub(crate) mod edge_sampled;
pub(crate) mod interior;
pub(crate) mod scale;
#[cfg(test)]
mod tests;

/// `(building, derivative by its height in metres)`.
pub(crate) type HeightSlope = (u32, f64);

/// Adds up the slopes of each building and divides by `n`; each building once, ascending. The stable sort keeps the
/// order they came in, so the sum is the same every time.
pub(crate) fn sum_by_building(mut slopes: Vec<HeightSlope>, n: usize) -> Vec<HeightSlope> {
    slopes.sort_by_key(|&(building, _)| building);
    slopes
        .chunk_by(|a, b| a.0 == b.0)
        .map(|same| (same[0].0, same.iter().map(|s| s.1).sum::<f64>() / n as f64))
        .collect()
}
