//! What segmentation networks do to masks: ragged borders, roofs that bleed in, row houses that merge, holes, misses,
//! and buildings where there are none.
//!
//! Every effect is drawn per view, or per view and building, from streams keyed by both.

use std::collections::BTreeSet;

use glam::Vec2;
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_heights::raster::Raster;
use sizeup_heights::seed;
use sizeup_survey::View;

use super::building::SimulatedBuilding;
use super::chance::{between, happens};
use super::masks::{draw_at, ground_contact};
use super::noise;
use sizeup_geo::terrain::Terrain;

/// How far masks are from the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskLevel {
    /// Masks without errors, as the buildings are seen.
    #[default]
    Exact,
    /// As a network that does its work well.
    Network,
    /// As one that does not.
    Poor,
}

/// Errors of masks, as numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskErrors {
    /// Most that a border is moved by noise with a period of some ten pixels, pixels.
    pub ragged_px: f32,
    /// Share of the (view, building) whose roof bleeds in, and up to which share of the height.
    pub bleed: (f64, f64),
    /// Share of the (view, pair of touching buildings) that merge.
    pub merged: f64,
    /// Share of the (view, building) with a hole.
    pub holed: f64,
    /// Share of the (view, building) that are missed.
    pub missed: f64,
    /// Buildings where there are none, per building and view.
    pub invented: f64,
}

impl MaskLevel {
    /// Strengths of this level's errors.
    #[must_use]
    pub fn errors(self) -> MaskErrors {
        match self {
            Self::Exact => {
                MaskErrors { ragged_px: 0.0, bleed: (0.0, 0.0), merged: 0.0, holed: 0.0, missed: 0.0, invented: 0.0 }
            }
            Self::Network => {
                MaskErrors { ragged_px: 1.5, bleed: (0.5, 0.4), merged: 0.15, holed: 0.1, missed: 0.1, invented: 0.05 }
            }
            Self::Poor => {
                MaskErrors { ragged_px: 3.0, bleed: (0.8, 0.8), merged: 0.35, holed: 0.2, missed: 0.25, invented: 0.1 }
            }
        }
    }
}

/// `H × W` of `building index + 1`, 0 = none, as a network with such errors would give it.
#[must_use]
pub fn masks_with_errors(
    view: &View,
    view_idx: usize,
    buildings: &[SimulatedBuilding],
    terrain: &Terrain,
    errors: &MaskErrors,
    root_seed: u64,
) -> Raster<u16> {
    let stream = |what: &str, building: usize| seed::stream(root_seed, what, &[view_idx as u64, building as u64]);
    let mut mask = ground_contact(view, buildings, terrain);
    bleed(&mut mask, view, buildings, errors, &stream);
    merge(&mut mask, errors.merged, &stream);
    let n_labels = buildings.len();
    let is_missed: Vec<bool> = (0..=n_labels).map(|b| happens(&mut stream("missed mask", b), errors.missed)).collect();
    for label in mask.data_mut() {
        if is_missed[usize::from(*label)] {
            *label = 0;
        }
    }
    holes(&mut mask, n_labels, errors.holed, &stream);
    invent(&mut mask, n_labels, errors.invented, &mut stream("invented mask", 0));
    ragged(&mask, errors.ragged_px, (root_seed as u32) ^ (view_idx as u32).wrapping_mul(0x9e37_79b9))
}

type Stream<'a> = &'a dyn Fn(&str, usize) -> rand_chacha::ChaCha8Rng;

/// The building up to some height, where nothing else is.
fn bleed(
    mask: &mut Raster<u16>,
    view: &View,
    buildings: &[SimulatedBuilding],
    errors: &MaskErrors,
    stream: Stream<'_>,
) {
    let (share, height) = errors.bleed;
    if share == 0.0 {
        return;
    }
    let up_to: Vec<f64> = (0..buildings.len())
        .map(|b| {
            let mut rng = stream("bleeding mask", b);
            if happens(&mut rng, share) { between(&mut rng, 0.0, height) } else { 0.0 }
        })
        .collect();
    // In steps, so that the smear has no gap.
    for step in 1..=4 {
        let level = |i: usize, b: &SimulatedBuilding| b.ground_z_m + up_to[i] * b.height_m * f64::from(step) / 4.0;
        let smear = draw_at(view, buildings, &level);
        mask.data_mut().iter_mut().zip(smear.data()).filter(|(m, _)| **m == 0).for_each(|(m, s)| *m = *s);
    }
}

fn merge(mask: &mut Raster<u16>, share: f64, stream: Stream<'_>) {
    let (width, height) = (mask.width(), mask.height());
    let mut touching: BTreeSet<(u16, u16)> = BTreeSet::new();
    for row in 0..height {
        for col in 0..width {
            let here = mask[(col, row)];
            for other in [mask.get(col + 1, row), mask.get(col, row + 1)].into_iter().flatten() {
                if here != 0 && *other != 0 && here != *other {
                    touching.insert((here.min(*other), here.max(*other)));
                }
            }
        }
    }
    let mut into: Vec<u16> = (0..=u16::MAX).collect();
    for (a, b) in touching {
        if happens(&mut stream("merged mask", usize::from(a) << 16 | usize::from(b)), share) {
            let (a, b) = (into[usize::from(a)], into[usize::from(b)]);
            into.iter_mut().filter(|l| **l == b).for_each(|l| *l = a);
        }
    }
    mask.data_mut().iter_mut().for_each(|l| *l = into[usize::from(*l)]);
}

fn holes(mask: &mut Raster<u16>, n: usize, share: f64, stream: Stream<'_>) {
    let width = mask.width();
    let mut pixels: Vec<Vec<usize>> = vec![Vec::new(); n + 1];
    for (i, &label) in mask.data().iter().enumerate().filter(|(_, l)| **l != 0) {
        pixels[usize::from(label)].push(i);
    }
    for (label, pixels) in pixels.iter().enumerate().filter(|(_, p)| !p.is_empty()) {
        let mut rng = stream("holed mask", label);
        if !happens(&mut rng, share) {
            continue;
        }
        let centre = pixels[rng.random_range(0..pixels.len())];
        let radius = between(&mut rng, 0.08, 0.2) * (pixels.len() as f64).sqrt();
        for &i in pixels {
            let (dx, dy) = ((i % width) as f64 - (centre % width) as f64, (i / width) as f64 - (centre / width) as f64);
            if dx.hypot(dy) < radius {
                mask.data_mut()[i] = 0;
            }
        }
    }
}

fn invent(mask: &mut Raster<u16>, n: usize, per_building: f64, rng: &mut rand_chacha::ChaCha8Rng) {
    let (width, height) = (mask.width(), mask.height());
    let n_here = mask.data().iter().collect::<BTreeSet<_>>().len().saturating_sub(1);
    let n_new = (per_building * n_here as f64).round() as usize;
    for i in 0..n_new.min(usize::from(u16::MAX) - n - 1) {
        let (x, y) = (rng.random_range(0..width), rng.random_range(0..height));
        let radius = between(rng, 0.008, 0.02) * width as f64;
        let label = (n + 1 + i) as u16;
        let reach = radius.ceil() as usize;
        for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            for col in x.saturating_sub(reach)..(x + reach + 1).min(width) {
                let cell = &mut mask[(col, row)];
                if *cell == 0 && (col as f64 - x as f64).hypot(row as f64 - y as f64) < radius {
                    *cell = label;
                }
            }
        }
    }
}

/// Each pixel takes the label of a place beside it.
fn ragged(mask: &Raster<u16>, most_px: f32, key: u32) -> Raster<u16> {
    if most_px == 0.0 {
        return mask.clone();
    }
    let (width, height) = (mask.width(), mask.height());
    let shift = |p: Vec2, key: u32| most_px * noise::fractal(p, 12.0, 3.0, 1.0, key);
    let clamped = |v: f32, n: usize| (v.round().max(0.0) as usize).min(n - 1);
    let labels = (0..width * height).map(|i| {
        // Nothing happens far from borders, which is nearly everywhere.
        let (col, row, own) = (i % width, i / width, mask.data()[i]);
        let reach = (1.5 * most_px).ceil() as usize;
        let (columns, rows) = (
            [col.saturating_sub(reach), col, (col + reach).min(width - 1)],
            [row.saturating_sub(reach), row, (row + reach).min(height - 1)],
        );
        if rows.iter().all(|&r| columns.iter().all(|&c| mask[(c, r)] == own)) {
            return own;
        }
        let p = Vec2::new((i % width) as f32, (i / width) as f32);
        let at = p + Vec2::new(shift(p, key), shift(p, key ^ 0x5bd1_e995));
        mask[(clamped(at.x, width), clamped(at.y, height))]
    });
    Raster::from_vec(width, height, labels.collect()).expect("one label per pixel")
}
