//! From true depth to what a monocular network would say: the prior corruption model.
//!
//! Disparity `d = 1 / depth`, ground disparity `g` along the same ray, relief `d − g`. Per view
//!
//! ```text
//! d' = g + gain(view) · gain(building, view) · (d − g)      relief gain, blunders, losses
//!      then edge warp, bleed, blur, + drift · sd(d) · smooth field, + noise · median(d) · white
//! p  = a · (d' / median(d) + b)                             the unknown affine map; 1/p for kind `depth`
//! ```
//!
//! Source: the prototypes' corruption levels (project notes on the method, section 9). What those leave open is settled
//! here and named: the size of a blunder, the unit of the noise, the shape of drift and warp.

use rand_chacha::ChaCha8Rng;

use crate::prior::PriorKind;
use crate::raster::Raster;
use crate::seed;
use crate::stats::median_low;

use super::chance::{between, happens, normal};
use super::config::PriorLevel;
use super::filter::{blurred, grown, smooth_field, warped};
use super::scene::Seen;
use super::trace::TrueDepth;

/// A blunder replaces a building's own gain by a number between these.
const BLUNDER_GAIN: (f64, f64) = (0.0, 2.0);
/// Range of the exponent of `clean`'s monotone warp, `p = a · ((d / median)^γ + b)`.
const WARP_EXPONENT: (f64, f64) = (0.6, 1.6);
/// Range of the decimal logarithm of the unknown scale `a`.
const LOG10_SCALE: (f64, f64) = (-0.5, 1.5);
/// The unknown shift `b` lies within ± this, in medians of disparity; for kind `depth` it is not negative.
const SHIFT: f64 = 0.3;
/// Kind `depth`: disparity never falls below this share of the median, so depth stays finite and positive.
const LEAST_DISPARITY: f64 = 0.02;
/// Wavelengths of the drift, as a share of the image's longer side.
const DRIFT_WAVES: (f64, f64) = (0.5, 1.5);
/// Wavelengths of the edge warp, pixels.
const WARP_WAVES_PX: (f64, f64) = (24.0, 60.0);

/// One corruption level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corruption {
    /// Relief gain per view: mean and standard deviation.
    pub relief_gain: (f64, f64),
    /// Standard deviation of the extra gain per (building, view), around 1.
    pub building_gain_sd: f64,
    /// Low-frequency bias, in standard deviations of the view's disparity.
    pub drift: f64,
    /// Gaussian blur, pixels of the prior (standard deviation).
    pub blur_px: f64,
    /// White noise, as a share of the view's median disparity (standard deviation).
    pub noise: f64,
    /// Share of (building, view) with a wrong gain.
    pub blunders: f64,
    /// Share of (building, view) without any relief.
    pub lost: f64,
    /// Displacement of everything by a smooth field, pixels of the prior (standard deviation per axis).
    pub edge_warp_px: f64,
    /// Growth of the near side of every edge, pixels of the prior: least and most, drawn per view.
    pub bleed_px: (f64, f64),
    /// Whether a monotone warp takes the place of the affine map.
    pub is_warped: bool,
}

impl PriorLevel {
    /// All levels, from the best to the worst.
    pub const ALL: [Self; 6] = [Self::Clean, Self::Bleed, Self::Mid, Self::Miss, Self::High, Self::Harsh];

    /// What the level does.
    #[must_use]
    pub fn corruption(self) -> Corruption {
        let clean = Corruption {
            relief_gain: (1.0, 0.0),
            building_gain_sd: 0.0,
            drift: 0.0,
            blur_px: 0.0,
            noise: 0.0,
            blunders: 0.0,
            lost: 0.0,
            edge_warp_px: 0.0,
            bleed_px: (0.0, 0.0),
            is_warped: false,
        };
        let mid = Corruption {
            relief_gain: (0.9, 0.07),
            building_gain_sd: 0.10,
            drift: 0.10,
            blur_px: 1.5,
            noise: 0.005,
            blunders: 0.03,
            ..clean
        };
        let high = Corruption {
            relief_gain: (0.75, 0.12),
            building_gain_sd: 0.20,
            drift: 0.25,
            blur_px: 2.5,
            noise: 0.01,
            blunders: 0.08,
            ..clean
        };
        match self {
            Self::Clean => Corruption { is_warped: true, ..clean },
            Self::Mid => mid,
            Self::High => high,
            Self::Miss => Corruption { lost: 0.30, ..mid },
            Self::Harsh => Corruption { lost: 0.20, edge_warp_px: 2.0, ..high },
            Self::Bleed => Corruption { drift: 0.03, blur_px: 0.8, noise: 0.002, bleed_px: (2.0, 3.0), ..clean },
        }
    }
}

/// The gain of one building's relief in one view, on top of the view's own.
#[must_use]
pub fn building_gain(level: &Corruption, root_seed: u64, view_idx: usize, building_idx: usize) -> f64 {
    let mut rng = seed::stream(root_seed, "relief", &[view_idx as u64, building_idx as u64]);
    if happens(&mut rng, level.lost) {
        return 0.0;
    }
    if happens(&mut rng, level.blunders) {
        return between(&mut rng, BLUNDER_GAIN.0, BLUNDER_GAIN.1);
    }
    (1.0 + level.building_gain_sd * normal(&mut rng)).max(0.0)
}

/// The prior of one view, at the size of its truth; `NaN` = sky.
#[must_use]
pub fn prior(truth: &TrueDepth, level: &Corruption, kind: PriorKind, root_seed: u64, view_idx: usize) -> Raster<f32> {
    let mut rng = seed::stream(root_seed, "prior", &[view_idx as u64]);
    let disparity = truth.depth_m.map(|z| 1.0 / z);
    let mut valid: Vec<f32> = disparity.data().iter().copied().filter(|d| d.is_finite()).collect();
    let Some(median) = median_low(&mut valid) else { return disparity };
    let spread = standard_deviation(&valid) / f64::from(median);

    let gain = (level.relief_gain.0 + level.relief_gain.1 * normal(&mut rng)).max(0.05);
    let bleed_px = between(&mut rng, level.bleed_px.0, level.bleed_px.1);
    let relief = relief(truth, |seen| match seen {
        Seen::Building(b) => gain * building_gain(level, root_seed, view_idx, b.at()),
        _ => gain,
    });
    let relief = if bleed_px > 0.0 { grown(&relief, bleed_px) } else { relief };
    let mut map = relief;
    for (r, (&ground, &depth)) in map.data_mut().iter_mut().zip(truth.ground_m.data().iter().zip(truth.depth_m.data()))
    {
        *r = if depth.is_nan() { f32::NAN } else { (*r + ground_disparity(ground)) / median };
    }
    if level.edge_warp_px > 0.0 {
        map = warped(&map, level.edge_warp_px, WARP_WAVES_PX, &mut rng);
    }
    if level.blur_px > 0.0 {
        map = blurred(&map, level.blur_px);
    }
    add_drift(&mut map, level.drift * spread, &mut rng);
    if level.noise > 0.0 {
        map.data_mut().iter_mut().for_each(|p| *p += (level.noise * normal(&mut rng)) as f32);
    }
    declare(&map, level.is_warped, kind, &mut rng)
}

fn ground_disparity(depth_m: f32) -> f32 {
    if depth_m.is_nan() { 0.0 } else { 1.0 / depth_m }
}

/// Gained relief in disparity; 0 on the ground and in the sky.
fn relief(truth: &TrueDepth, gain: impl Fn(Seen) -> f64) -> Raster<f32> {
    // Neighbours mostly see the same thing: its gain is worked out once per run of pixels.
    let mut last = (Seen::Sky, 0.0_f32);
    let mut i = 0;
    truth.depth_m.map(|&z| {
        let (seen, ground) = (truth.seen.data()[i], truth.ground_m.data()[i]);
        i += 1;
        if matches!(seen, Seen::Sky | Seen::Ground) {
            return 0.0;
        }
        if last.0 != seen {
            last = (seen, gain(seen) as f32);
        }
        last.1 * (1.0 / z - ground_disparity(ground))
    })
}

fn add_drift(map: &mut Raster<f32>, sd: f64, rng: &mut ChaCha8Rng) {
    if sd == 0.0 {
        return;
    }
    let longer = map.width().max(map.height()) as f64;
    let waves = (DRIFT_WAVES.0 * longer, DRIFT_WAVES.1 * longer);
    let field = smooth_field(map.width(), map.height(), waves, rng);
    map.data_mut().iter_mut().zip(field.data()).for_each(|(p, f)| *p += sd as f32 * f);
}

/// Through the unknown scale and shift (or monotone warp), into the declared kind.
fn declare(map: &Raster<f32>, is_warped: bool, kind: PriorKind, rng: &mut ChaCha8Rng) -> Raster<f32> {
    let scale = 10_f64.powf(between(rng, LOG10_SCALE.0, LOG10_SCALE.1));
    let shift = between(rng, -SHIFT, SHIFT);
    let exponent = if is_warped { between(rng, WARP_EXPONENT.0, WARP_EXPONENT.1) } else { 1.0 };
    map.map(|&p| {
        let p = f64::from(p);
        let bent = if is_warped { p.max(0.0).powf(exponent) } else { p };
        let value = match kind {
            PriorKind::InverseDepth => scale * (bent + shift),
            PriorKind::Depth if bent.is_nan() => f64::NAN,
            PriorKind::Depth => scale / (bent + shift.abs()).max(LEAST_DISPARITY),
        };
        value as f32
    })
}

fn standard_deviation(values: &[f32]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    (values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / n).sqrt()
}
