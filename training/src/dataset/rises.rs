//! How far roofs rise above their feet, found from the labels of a photo alone.
//!
//! ```text
//! foot = n + (1 − r) · (p − n)       n: nadir, p: a pixel of the roof, r: the rise (`segment/roofs.rs` in sizeup)
//! ```
//!
//! The rise of a building is the one by which its roof's label comes to lie best on its label on the ground. It needs no heights, so that
//! any set has it. Pixels that the photo's border cuts off on the other side say nothing.

use std::collections::BTreeMap;

use glam::DVec2;
use sizeup_footprints::segment::roofs::MOST_RISE;
use sizeup_heights::raster::Raster;

use super::labels::UNKNOWN;

/// Most pixels of a label that take part.
const MOST_PX: usize = 1200;
/// Least pixels of roof and ground that have a counterpart within the photo, as a count and as a share.
const LEAST: (usize, f64) = (16, 0.3);
/// Least share that has to fit, for roof and for ground.
const LEAST_FIT: f64 = 0.6;
/// Steps of the search over all rises, and of that around the best.
const STEPS: [f64; 2] = [0.01, 0.001];

/// The rise of every building whose labels tell it.
#[must_use]
pub fn rises(ground: &Raster<u16>, roof: &Raster<u16>, nadir: DVec2) -> BTreeMap<u16, f64> {
    let (on_ground, on_roof) = (places(ground), places(roof));
    let of = |(label, roof_px): (&u16, &Vec<DVec2>)| {
        let fit = |r: f64| {
            let feet = fit(roof_px, *label, ground, |p| nadir + (1.0 - r) * (p - nadir));
            let roofs = fit(on_ground.get(label)?, *label, roof, |g| nadir + (g - nadir) / (1.0 - r));
            Some(feet?.min(roofs?))
        };
        let best = |centre: f64, half: usize, step: f64| {
            let tried = (0..=2 * half).map(|i| centre + (i as f64 - half as f64) * step);
            let fits = tried.filter(|r| (0.0..=f64::from(MOST_RISE)).contains(r)).filter_map(|r| Some((r, fit(r)?)));
            fits.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.total_cmp(&a.0)))
        };
        let half = 0.5 * f64::from(MOST_RISE);
        let (coarse, _) = best(half, (half / STEPS[0]) as usize, STEPS[0])?;
        let (rise, fit) = best(coarse, (STEPS[0] / STEPS[1]) as usize, STEPS[1])?;
        (fit >= LEAST_FIT).then_some((*label, rise))
    };
    on_roof.iter().filter_map(of).collect()
}

/// Pixel centres of every building, some of many.
fn places(labels: &Raster<u16>) -> BTreeMap<u16, Vec<DVec2>> {
    let mut places: BTreeMap<u16, Vec<DVec2>> = BTreeMap::new();
    for (i, &label) in labels.data().iter().enumerate().filter(|(_, l)| !matches!(**l, 0 | UNKNOWN)) {
        let (col, row) = (i % labels.width(), i / labels.width());
        places.entry(label).or_default().push(DVec2::new(col as f64 + 0.5, row as f64 + 0.5));
    }
    for of_one in places.values_mut() {
        let step = of_one.len().div_ceil(MOST_PX);
        *of_one = of_one.iter().copied().step_by(step).collect();
    }
    places
}

/// Share of some places that come to lie on a label, of those that come to lie in the photo; nothing where these are too few.
fn fit(places: &[DVec2], label: u16, on: &Raster<u16>, to: impl Fn(DVec2) -> DVec2) -> Option<f64> {
    let (mut n_inside, mut n_fit) = (0_usize, 0_usize);
    for place in places.iter().map(|p| to(*p)).filter(|p| p.x >= 0.0 && p.y >= 0.0) {
        if let Some(found) = on.get(place.x as usize, place.y as usize) {
            n_inside += 1;
            n_fit += usize::from(*found == label);
        }
    }
    let enough = n_inside >= LEAST.0 && n_inside as f64 >= LEAST.1 * places.len() as f64;
    enough.then(|| n_fit as f64 / n_inside as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two blocks of 12 × 10 pixels on the ground, seen from a nadir to the left, with rises of 0.1 and 0.25; the third's roof lies beyond
    /// the photo.
    #[test]
    fn rises_are_those_by_which_the_roofs_were_drawn() {
        let nadir = DVec2::new(-20.0, 30.0);
        let blocks = [(1, 30.0, 25.0, 0.1), (2, 42.0, 25.0, 0.25), (3, 88.0, 40.0, 0.3)];
        let draw = |is_roof: bool| {
            let value = |i: usize| {
                let p = DVec2::new((i % 100) as f64 + 0.5, (i / 100) as f64 + 0.5);
                let inside = blocks.iter().find(|(_, left, top, rise)| {
                    let g = if is_roof { nadir + (1.0 - rise) * (p - nadir) } else { p };
                    (*left..left + 12.0).contains(&g.x) && (*top..top + 10.0).contains(&g.y)
                });
                inside.map_or(0, |b| b.0)
            };
            Raster::from_vec(100, 70, (0..7000).map(value).collect()).unwrap()
        };
        let found = rises(&draw(false), &draw(true), nadir);
        assert_eq!(found.keys().copied().collect::<Vec<u16>>(), [1, 2]);
        // Half a pixel at 60 pixels from the nadir.
        assert!((found[&1] - 0.1).abs() < 0.01 && (found[&2] - 0.25).abs() < 0.01, "{found:?}");
    }
}
