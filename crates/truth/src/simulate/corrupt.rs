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

use sizeup_heights::raster::Raster;
use sizeup_heights::seed;
use sizeup_heights::stats::median_low;
use sizeup_photos::prior::PriorKind;

use super::chance::{between, happens, normal};
use super::config::PriorLevel;
use super::filter::{blurred, grown, smooth_field, warped};
use super::scene::SeenObject;
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

/// Strengths of the errors that a level of priors has.
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

    /// Effect of the level.
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
        SeenObject::Building(b) => gain * building_gain(level, root_seed, view_idx, b.at()),
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
fn relief(truth: &TrueDepth, gain: impl Fn(SeenObject) -> f64) -> Raster<f32> {
    // Neighbours mostly see the same thing: its gain is worked out once per run of pixels.
    let mut last = (SeenObject::Sky, 0.0_f32);
    let mut i = 0;
    truth.depth_m.map(|&z| {
        let (seen, ground) = (truth.seen.data()[i], truth.ground_m.data()[i]);
        i += 1;
        if matches!(seen, SeenObject::Sky | SeenObject::Ground) {
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
        // Undefined stays so: `NaN` to any power is `NaN`. A warped disparity is a true one, so not negative.
        let bent = if is_warped { p.powf(exponent) } else { p };
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

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_heights::ids::BuildingIdx;
    use sizeup_heights::stats::{mean, quantile};

    /// A tilted ground with two boxes on it, seen at an angle: depth grows up the image.
    fn truth() -> TrueDepth {
        let (width, height) = (160, 120);
        let ground = |i: usize| 120.0 + (height - i / width) as f32;
        let building = |i: usize| {
            let (col, row) = (i % width, i / width);
            match (col, row) {
                (20..60, 30..80) => Some(0),
                (90..140, 40..100) => Some(1),
                _ => None,
            }
        };
        let image =
            |f: &dyn Fn(usize) -> f32| Raster::from_vec(width, height, (0..width * height).map(f).collect()).unwrap();
        let depth = |i: usize| if i < 3 * width { f32::NAN } else { ground(i) * building(i).map_or(1.0, |_| 0.85) };
        let seen = (0..width * height)
            .map(|i| {
                if i < 3 * width {
                    SeenObject::Sky
                } else {
                    building(i).map_or(SeenObject::Ground, |b| SeenObject::Building(BuildingIdx(b)))
                }
            })
            .collect();
        TrueDepth {
            depth_m: image(&depth),
            ground_m: image(&ground),
            seen: Raster::from_vec(width, height, seen).unwrap(),
        }
    }

    fn only(change: impl FnOnce(&mut Corruption)) -> Corruption {
        let mut level = Corruption { is_warped: false, ..PriorLevel::Clean.corruption() };
        change(&mut level);
        level
    }

    /// Scale and shift that map `truth`'s disparity to the prior, from two ground pixels.
    fn ungained(truth: &TrueDepth, prior: &Raster<f32>, pixel: usize) -> f64 {
        let d = |i: usize| 1.0 / f64::from(truth.depth_m.data()[i]);
        let (low, high) = (160 * 10, 160 * 119);
        let p = |i: usize| f64::from(prior.data()[i]);
        let scale = (p(high) - p(low)) / (d(high) - d(low));
        (p(pixel) - p(low)) / scale + d(low)
    }

    #[test]
    fn a_clean_prior_keeps_every_order_and_the_sky() {
        let truth = truth();
        for (view, kind) in [(0, PriorKind::InverseDepth), (1, PriorKind::Depth), (2, PriorKind::InverseDepth)] {
            let prior = prior(&truth, &PriorLevel::Clean.corruption(), kind, 4, view);
            let mut pairs: Vec<(f32, f32)> =
                truth.depth_m.data().iter().copied().zip(prior.data().iter().copied()).collect();
            assert!(pairs.iter().all(|(z, p)| z.is_nan() == p.is_nan()));
            pairs.retain(|(z, _)| !z.is_nan());
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
            for pair in pairs.windows(2) {
                let nearer_first = if kind == PriorKind::Depth { pair[1].1 - pair[0].1 } else { pair[0].1 - pair[1].1 };
                if pair[1].0 > pair[0].0 * (1.0 + 1e-5) {
                    assert!(nearer_first > 0.0, "{pair:?}");
                } else {
                    assert!(nearer_first >= 0.0, "{pair:?}");
                }
            }
        }
    }

    #[test]
    fn gains_have_the_stated_statistics() {
        for level in PriorLevel::ALL {
            let c = level.corruption();
            let gains: Vec<f64> = (0..20_000).map(|i| building_gain(&c, 9, i / 100, i % 100)).collect();
            let lost = gains.iter().filter(|g| **g == 0.0).count() as f64 / gains.len() as f64;
            assert!((lost - c.lost).abs() < 0.01, "{level:?} {lost}");
            // Blunders and losses apart, half of a normal distribution lies within 0.6745 standard deviations.
            let kept: Vec<f64> = gains.into_iter().filter(|g| *g != 0.0).collect();
            let half_width = 0.5 * (quantile(&kept, 0.75).unwrap() - quantile(&kept, 0.25).unwrap());
            assert!((half_width / 0.6745 - c.building_gain_sd).abs() < 0.02, "{level:?} {half_width}");
            assert!((mean(&kept).unwrap() - 1.0).abs() < 0.01);
        }
    }

    #[test]
    fn relief_is_scaled_against_the_ground_behind() {
        let truth = truth();
        let level = only(|c| c.relief_gain = (0.8, 0.0));
        let prior = prior(&truth, &level, PriorKind::InverseDepth, 4, 0);
        let pixel = 160 * 50 + 40;
        let (d, g) = (1.0 / f64::from(truth.depth_m.data()[pixel]), 1.0 / f64::from(truth.ground_m.data()[pixel]));
        let found = (ungained(&truth, &prior, pixel) - g) / (d - g);
        assert!((found - 0.8).abs() < 1e-3, "{found}");
    }

    #[test]
    fn gains_per_view_have_the_stated_statistics() {
        let truth = truth();
        let c = PriorLevel::High.corruption();
        let level = only(|l| l.relief_gain = c.relief_gain);
        let pixel = 160 * 50 + 40;
        let (d, g) = (1.0 / f64::from(truth.depth_m.data()[pixel]), 1.0 / f64::from(truth.ground_m.data()[pixel]));
        let gains: Vec<f64> = (0..400)
            .map(|view| {
                let prior = prior(&truth, &level, PriorKind::InverseDepth, 4, view);
                (ungained(&truth, &prior, pixel) - g) / (d - g)
            })
            .collect();
        let m = mean(&gains).unwrap();
        let sd = mean(&gains.iter().map(|v| (v - m).powi(2)).collect::<Vec<_>>()).unwrap().sqrt();
        assert!((m - c.relief_gain.0).abs() < 0.02 && (sd - c.relief_gain.1).abs() < 0.015, "{m} {sd}");
    }

    /// Standard deviation of what a level adds, in medians of disparity.
    fn added(level: &Corruption) -> f64 {
        let truth = truth();
        let plain = prior(&truth, &only(|_| ()), PriorKind::InverseDepth, 4, 3);
        let changed = prior(&truth, level, PriorKind::InverseDepth, 4, 3);
        // Scale and shift differ, because more was drawn before them: fit them out.
        let pairs: Vec<(f64, f64)> = plain
            .data()
            .iter()
            .zip(changed.data())
            .filter(|(a, _)| !a.is_nan())
            .map(|(a, b)| (f64::from(*a), f64::from(*b)))
            .collect();
        let n = pairs.len() as f64;
        let (ma, mb) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
        let slope = pairs.iter().map(|p| (p.0 - ma) * (p.1 - mb)).sum::<f64>()
            / pairs.iter().map(|p| (p.0 - ma).powi(2)).sum::<f64>();
        let residual = pairs.iter().map(|p| (p.1 - mb - slope * (p.0 - ma)).powi(2)).sum::<f64>() / n;
        let sd_plain = (pairs.iter().map(|p| (p.0 - ma).powi(2)).sum::<f64>() / n).sqrt();
        residual.sqrt() / slope / sd_plain
    }

    #[test]
    fn noise_and_drift_are_as_strong_as_stated() {
        let truth = truth();
        let mut disparity: Vec<f32> = truth.depth_m.data().iter().filter(|z| !z.is_nan()).map(|z| 1.0 / z).collect();
        let sd = standard_deviation(&disparity);
        let median = f64::from(median_low(&mut disparity).unwrap());
        let noise = added(&only(|c| c.noise = 0.01)) * sd / median;
        assert!((noise - 0.01).abs() < 5e-4, "{noise}");
        // The fit takes some of the drift for a change of scale.
        let drift = added(&only(|c| c.drift = 0.25));
        assert!((0.15..0.27).contains(&drift), "{drift}");
    }

    #[test]
    fn bleeding_moves_edges_outwards_and_nothing_else() {
        let truth = truth();
        let level = only(|c| c.bleed_px = (2.0, 3.0));
        let prior = prior(&truth, &level, PriorKind::InverseDepth, 4, 0);
        let d = |pixel: usize| ungained(&truth, &prior, pixel) - 1.0 / f64::from(truth.ground_m.data()[pixel]);
        let row = 160 * 60;
        assert!(d(row + 18) > 5e-4 && d(row + 61) > 5e-4, "two pixels beside the box");
        assert!(d(row + 15).abs() < 1e-5 && d(row + 65).abs() < 1e-5, "five pixels beside the box");
    }

    #[test]
    fn only_depth_is_never_negative_and_every_level_keeps_the_sky() {
        let truth = truth();
        for level in PriorLevel::ALL {
            for kind in [PriorKind::Depth, PriorKind::InverseDepth] {
                let prior = prior(&truth, &level.corruption(), kind, 4, 0);
                let same_holes = prior.data().iter().zip(truth.depth_m.data()).all(|(p, z)| p.is_nan() == z.is_nan());
                assert!(same_holes, "{level:?}");
                assert!(kind == PriorKind::InverseDepth || prior.data().iter().all(|p| p.is_nan() || *p > 0.0));
            }
        }
    }
}
