//! Whether a roof is where the photos look alike around each of its places, one by one.
//!
//! Laid onto a roof as a whole, photos find its best-textured part; that an annex or another wing lies elsewhere hardly shows.

use glam::DVec3;

use super::{ProjectedSurface, SAME_M, SAME_PX, better_pairs, correlation, ground_sample_m, normalise, telling_pairs};
use crate::picture::Picture;

/// Move of photos against each other from one height to the next, pixels.
const STEP_PX: f64 = 0.75;
/// Photos that are compared: more tell hardly more, and pairs grow with their square.
const MAX_PICTURES: usize = 6;
/// Places within this of one are what is around it, metres; or so many spacings of the places.
const AROUND_M: f64 = 1.2;
const AROUND_SPACINGS: f64 = 2.2;
/// Heights that are tried, against the surface, metres: annexes lie storeys below.
const RANGE_M: [f64; 2] = [-6.0, 4.0];
/// Most heights tried in one search; the step grows beyond.
const MAX_LEVELS: usize = 400;
/// Step among the places that are asked.
const EVERY: usize = 2;

/// Agreement of a surface with the photos, place by place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotoAgreement {
    /// Share of the places whose height the photos tell.
    pub known: f64,
    /// Share of these that lie on the surface.
    pub same: f64,
}

/// Compares pictures around each place of a surface (map frame, metres): a place is known where the photos look alike at one
/// height, by `min_score` and `min_lead`, and lies on the surface if that height is within 0.5 m of it.
#[must_use]
pub fn agreement(pictures: &[&Picture], surface: &[DVec3], min_score: f64, min_lead: f64) -> PhotoAgreement {
    let pictures = &pictures[..pictures.len().min(MAX_PICTURES)];
    let middle = surface.iter().sum::<DVec3>() / surface.len() as f64;
    let (pairs, shift) = telling_pairs(pictures, middle);
    let [low_m, high_m] = RANGE_M;
    let step_m = (STEP_PX * ground_sample_m(pictures, middle) / shift).max((high_m - low_m) / MAX_LEVELS as f64);
    let n_levels = ((high_m - low_m) / step_m).ceil() as usize + 1;
    let raised_m = |level: usize| low_m + step_m * level as f64;
    let windows = windows(surface);
    let shown: Vec<ProjectedSurface<'_>> =
        pictures.iter().map(|picture| ProjectedSurface::new(picture, surface)).collect();
    let counts = vec![true; pairs.len()];
    // By window, level by level.
    let mut scores = vec![Vec::with_capacity(n_levels); windows.len()];
    for level in 0..n_levels {
        let greys: Vec<Vec<f32>> = shown.iter().map(|shown| shown.greys(raised_m(level)).collect()).collect();
        for (of_window, window) in scores.iter_mut().zip(&windows) {
            of_window.push(better_pairs(&correlations(&greys, window, &pairs), &counts));
        }
    }
    let same = (SAME_M / step_m).max(SAME_PX / STEP_PX).ceil() as usize;
    let (mut n_known, mut n_same) = (0, 0);
    for of_window in &scores {
        let at = |level: usize| of_window[level];
        let best = (0..n_levels).fold(0, |best, i| if at(i) > at(best) { i } else { best });
        let others = (0..n_levels).filter(|i| i.abs_diff(best) > same).map(at).fold(-1.0, f64::max);
        if at(best) >= min_score && at(best) - others >= min_lead {
            n_known += 1;
            n_same += usize::from(raised_m(best).abs() <= 0.5 * SAME_M);
        }
    }
    let share = |n: usize, of: usize| if of == 0 { 0.0 } else { n as f64 / of as f64 };
    PhotoAgreement { known: share(n_known, windows.len()), same: share(n_same, n_known) }
}

/// Correlations of pairs of photos, over the places of a window; `NaN` where one of a pair does not show them.
fn correlations(greys: &[Vec<f32>], window: &[usize], pairs: &[[usize; 2]]) -> Vec<f64> {
    let in_window = |greys: &Vec<f32>| {
        let mut seen: Vec<f32> = window.iter().map(|&place| greys[place]).collect();
        normalise(&mut seen);
        seen
    };
    let seen: Vec<Vec<f32>> = greys.iter().map(in_window).collect();
    pairs.iter().map(|&[a, b]| correlation(&seen[a], &seen[b])).collect()
}

/// Neighbours of some of the places: indices of places.
fn windows(surface: &[DVec3]) -> Vec<Vec<usize>> {
    let nearest = |p: &DVec3| {
        let distances = surface.iter().map(|q| (*q - *p).truncate().length()).filter(|d| *d > 1e-6);
        distances.fold(f64::INFINITY, f64::min)
    };
    let asked = || surface.iter().step_by(EVERY);
    let spacings: Vec<f64> = asked().take(20).map(nearest).collect();
    let spacing_m = crate::stats::median(&spacings).unwrap_or(0.0);
    let radius_m = AROUND_M.max(AROUND_SPACINGS * spacing_m);
    let around = |p: &DVec3| {
        let is_near = |j: &usize| (surface[*j] - *p).truncate().length_squared() <= radius_m * radius_m;
        (0..surface.len()).filter(is_near).collect()
    };
    asked().map(around).collect()
}

#[cfg(test)]
mod tests {
    use crate::camera::Camera;
    use crate::frames::Rigid;

    use super::*;

    /// Roofs at 10 and 4 m, west and east of x = 0.
    const LEVELS_M: [f64; 2] = [10.0, 4.0];

    fn texture(at: DVec3) -> f32 {
        let wave = |f: f64, g: f64| (f * at.x + g * at.y + at.z).sin();
        (60.0 * (wave(2.3, 1.1) + wave(-1.2, 3.1) + wave(4.3, -2.7))) as f32
    }

    /// Surface that a ray meets: the upper roof, its wall, or the lower one.
    fn seen(centre: DVec3, ray: DVec3) -> f32 {
        let on = |z: f64| centre + ray * ((z - centre.z) / ray.z);
        let [upper, lower] = LEVELS_M.map(on);
        if upper.x < 0.0 {
            texture(upper)
        } else if lower.x < 0.0 {
            0.0
        } else {
            texture(lower)
        }
    }

    #[test]
    fn what_lies_elsewhere_is_told_place_by_place() {
        let eyes = [[40.0, 10.0], [-40.0, 5.0], [0.0, 45.0], [10.0, -40.0], [30.0, 30.0], [-30.0, -25.0]];
        let pictures = eyes.map(|[x, y]| {
            let pose = Rigid::looking_at(DVec3::new(x, y, 80.0), DVec3::new(0.0, 0.0, 7.0));
            Picture::seeing(Camera::pinhole(400, 400, 800.0), pose, seen)
        });
        let pictures: Vec<&Picture> = pictures.iter().collect();
        let plan = || (0..400).map(|i| DVec3::new(f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5, 0.0));
        let level = |at: DVec3| LEVELS_M[usize::from(at.x > 0.0)];
        let agreement_on = |surface: Vec<DVec3>| agreement(&pictures, &surface, 0.5, 0.1);
        let right = agreement_on(plan().map(|p| p + level(p) * DVec3::Z).collect());
        assert!(right.known > 0.75 && right.same > 0.95, "{right:?}");
        // The lower half lies elsewhere; next to the step neither half is known.
        let one_level = agreement_on(plan().map(|p| p + LEVELS_M[0] * DVec3::Z).collect());
        assert!(one_level.known > 0.6 && (0.4..0.65).contains(&one_level.same), "{one_level:?}");
        // Above all of it nothing looks alike nearby, but below.
        let above = agreement_on(plan().map(|p| p + 12.0 * DVec3::Z).collect());
        assert!(above.same < 0.05, "{above:?}");
    }
}
