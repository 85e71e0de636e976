//! A prior whose order holds and whose shape does not, straightened along the ground of its view.
//!
//! ```text
//! p ≈ c(v)      c: rising curve,  v: inverse depth at which the same ray meets the terrain, 1/m
//! p ← c⁻¹(p)    where c is no line
//! ```
//!
//! The score compares how values vary, blind to scale and shift but not to a bend: where a prior is, say, the root of inverse
//! depth, or its rank, the ground itself runs in a curve, and a town of houses is best explained by towers. The poses and the
//! terrain know how the ground runs. As in [`crate::evidence::calibrate`] what stands on it is *nearer*, so the curve is drawn to the
//! far envelope. It has few knots, and takes a drift of the prior along the way into the photo with it.
//!
//! Depth that was shifted, as most programs do that export it stretched to 0..1, has a shape of its own: `d ≈ scale · z + shift`
//! with the ground's depth `z`. Two numbers straighten it, which is more exact than a curve.
//!
//! A network, or a file format, bends all its maps alike and the same way, and what bends single ones is drift, which one view's rows
//! do not tell from a bend. So all photos decide together, however noisy each one is. Buildings have no part in it.

use serde::{Deserialize, Serialize};

use crate::evidence::Evidence;
use crate::evidence::calibrate::{CUT_OFF, Calibration, ROUNDS, robust_line, thinned, weighted_line};
use crate::stats;

/// Knots of the curve, each the ground of as many rays.
const N_KNOTS: usize = 12;
/// Rays below which a view's ground tells nothing of a curve.
const MIN_RAYS: usize = 600;
/// Rays that curves are fitted to, about: each knot has 200 and more, and the ground between them is smooth.
const N_SAMPLES: usize = 2400;
/// Share of the photos that bend the same way where the survey's priors are bent.
const MOST: f64 = 0.75;
/// Least bend of most photos, as a share of the curve's rise. The median over the photos of a simulated village and district, of
/// Rotterdam and of Delft's laser surface with trees, each with the errors of a network, is between -.013 and .004 as they are and
/// between -.16 and -.14 where the same values are replaced by their square roots; this is between them. One photo strays by .04.
const MIN_BEND: f64 = 0.05;

/// Depth is taken as shifted where a shift leaves less than this share of what inverse depth leaves, median over photos. With the errors
/// of a network, over Delft's laser surface with trees (86 photos), the median is 1.08 where depth is up to scale and .70 where the
/// same depth is stretched to 0..1, photo by photo; this is the geometric mean of the two.
const SHIFTED_SHARE: f64 = 0.87;
/// Errors of depth below this share of it are none: a prior that fits a line so well needs no other shape.
const EXACT: f64 = 1e-3;

/// Shape of the priors of a survey along the ground: a network, or a file format, bends all its maps alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PriorShape {
    /// A line in inverse depth, as declared.
    #[default]
    Line,
    /// Any other rising curve.
    Bent,
    /// Depth up to scale and shift.
    ShiftedDepth,
}

impl PriorShape {
    /// The shape of some photos: shifted depth by the median of its fits, bent where most bend the same way.
    pub(crate) fn of(photos: &[&GroundFits]) -> Self {
        let shares: Vec<f64> = photos.iter().filter_map(|fits| fits.shifted_share).collect();
        let mut bends: Vec<f64> = photos.iter().filter_map(|fits| fits.bend).collect();
        bends.sort_by(f64::total_cmp);
        let [low, high] = [1.0 - MOST, MOST].map(|share| stats::quantile_of_sorted(&bends, share).unwrap_or(0.0));
        if stats::median(&shares).is_some_and(|share| share < SHIFTED_SHARE) {
            Self::ShiftedDepth
        } else if low > MIN_BEND || high < -MIN_BEND {
            Self::Bent
        } else {
            Self::Line
        }
    }
}

/// Fits of a view's prior along the ground.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GroundFits {
    /// Fit as depth up to scale and shift.
    shifted: Option<GroundCurve>,
    /// Share that this fit leaves of what a line in inverse depth leaves.
    shifted_share: Option<f64>,
    /// How far the prior's curve bends off a line, see [`Polyline::bend`].
    bend: Option<f64>,
    /// Curve of the prior along the ground.
    bent: Option<GroundCurve>,
}

impl GroundFits {
    /// No fit: the prior is taken as it is.
    pub(crate) const NONE: Self = Self { shifted: None, shifted_share: None, bend: None, bent: None };

    /// Fits along the ground of a view; none where the photo shows too little ground.
    #[must_use]
    pub fn along_ground(evidence: &Evidence<'_>) -> Self {
        let rays = evidence.profiles.rays.iter().zip(&evidence.nearness);
        let samples = rays.map(|(ray, &nearness)| (f64::from(ray.ground.recip()), f64::from(nearness)));
        let samples: Vec<_> = samples.filter(|(v, p)| v.is_finite() && *v > 0.0 && p.is_finite()).collect();
        if samples.len() < MIN_RAYS {
            return Self::default();
        }
        let samples = thinned(samples, N_SAMPLES);
        let line = robust_line(&samples);
        let shifted = evidence.is_depth.then(|| shifted_depth(&samples, line)).flatten();
        let curve = Polyline::fit(samples);
        let bend = curve.as_ref().and_then(Polyline::bend);
        let (shifted, shifted_share) = shifted.unzip();
        Self { shifted, shifted_share, bend, bent: curve.map(GroundCurve::Bent) }
    }

    /// The curve that straightens the view, where its survey has a shape.
    #[must_use]
    pub fn curve(&self, shape: PriorShape) -> Option<&GroundCurve> {
        match shape {
            PriorShape::Line => None,
            PriorShape::Bent => self.bent.as_ref(),
            PriorShape::ShiftedDepth => self.shifted.as_ref(),
        }
    }
}

/// Curve from a prior's values to inverse depth.
#[derive(Debug, Clone, PartialEq)]
pub enum GroundCurve {
    /// Any rising shape.
    Bent(Polyline),
    /// Depth up to scale and shift.
    ShiftedDepth {
        /// Prior per metre of depth.
        scale: f64,
        /// Prior at depth 0.
        shift: f64,
    },
}

/// A rising polyline from inverse depth to the prior's values, with straight ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyline {
    /// Inverse depth, 1/m, and prior; both rise.
    knots: Vec<(f64, f64)>,
}

impl GroundCurve {
    /// Inverse depth, 1/m, that a value stands for; `NaN` nearer than the camera.
    #[must_use]
    pub fn inverse_depth(&self, prior: f64) -> f64 {
        match self {
            Self::Bent(curve) => interpolate(&curve.knots, prior, |&(v, p)| (p, v)),
            Self::ShiftedDepth { scale, shift } => {
                let depth = (prior.recip() - shift) / scale;
                if depth > 0.0 { depth.recip() } else { f64::NAN }
            }
        }
    }
}

/// The scale and shift of depth along the far envelope of (inverse depth of the ground, inverse prior), and the share that they leave
/// of what a line in inverse depth leaves.
fn shifted_depth(samples: &[(f64, f64)], line: Option<Calibration>) -> Option<(GroundCurve, f64)> {
    let is_rising = |line: &Calibration| line.gain() > 0.0;
    // As errors of depth, in parts of it: the prior's scale cancels.
    let left = |samples: &[(f64, f64)], line: Calibration| {
        let left = samples.iter().map(|s| line.residual(s) / (line.gain() * s.0).abs());
        stats::far_side_sigma(left).unwrap_or(0.0)
    };
    let depths: Vec<(f64, f64)> = samples.iter().map(|(v, p)| (-v.recip(), -p.recip())).collect();
    let by_depth = robust_line(&depths).filter(is_rising)?;
    let left_by_depth = left(&depths, by_depth);
    let share = line.filter(is_rising).map_or(0.0, |line| (left_by_depth + EXACT) / (left(samples, line) + EXACT));
    Some((GroundCurve::ShiftedDepth { scale: by_depth.gain(), shift: -by_depth.offset() }, share))
}

impl Polyline {
    /// Through the far envelope of (inverse depth of the ground, prior); `None` where that does not rise.
    fn fit(mut samples: Vec<(f64, f64)>) -> Option<Self> {
        samples.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let bins: Vec<&[(f64, f64)]> = samples.chunks(samples.len().div_ceil(N_KNOTS)).collect();
        let mut curve = Self { knots: bins.iter().map(|bin| middle(bin)).collect() };
        for _ in 0..ROUNDS {
            let sigma = stats::far_side_sigma(samples.iter().map(|s| curve.residual(s)))?;
            if sigma <= 0.0 {
                break;
            }
            let shifts: Vec<f64> = bins.iter().map(|bin| curve.shift(bin, sigma)).collect();
            curve.knots.iter_mut().zip(shifts).for_each(|(knot, shift)| knot.1 += shift);
        }
        curve.rising()
    }

    /// The same with neighbouring knots that do not rise pooled into their mean.
    fn rising(self) -> Option<Self> {
        let mut pooled: Vec<(f64, (f64, f64))> = Vec::new();
        for knot in self.knots {
            let mut new = (1.0, knot);
            while let Some(&(n, before)) =
                pooled.last().filter(|(_, before)| before.0 >= new.1.0 || before.1 >= new.1.1)
            {
                let (m, after) = new;
                let mean = |a: f64, b: f64| (n * a + m * b) / (n + m);
                new = (n + m, (mean(before.0, after.0), mean(before.1, after.1)));
                pooled.pop();
            }
            pooled.push(new);
        }
        let knots: Vec<(f64, f64)> = pooled.into_iter().map(|(_, knot)| knot).collect();
        (knots.len() > 1).then_some(Self { knots })
    }

    /// The weighted mean of what the curve leaves of a bin.
    fn shift(&self, bin: &[(f64, f64)], sigma: f64) -> f64 {
        let (mut weights, mut sum) = (0.0, 0.0);
        for residual in bin.iter().map(|sample| self.residual(sample)) {
            let weight = stats::biweight(residual, sigma, CUT_OFF);
            weights += weight;
            sum += weight * residual;
        }
        if weights > 0.0 { sum / weights } else { 0.0 }
    }

    fn residual(&self, &(v, p): &(f64, f64)) -> f64 {
        p - interpolate(&self.knots, v, |knot| *knot)
    }

    /// How far the curve bends off a line, as a share of its rise: by how much the parabola through its knots sags in their middle
    /// below the line through its ends; negative where it lies above.
    fn bend(&self) -> Option<f64> {
        let [first, .., last] = &self.knots[..] else { return None };
        // Along u = -1..1 the parabola's leading term is what [1, u] leaves of u², times a factor.
        let places = self.knots.iter().map(|knot| 2.0 * (knot.0 - first.0) / (last.0 - first.0) - 1.0);
        let squares: Vec<(f64, f64)> = places.map(|u| (u, u * u)).collect();
        let line = weighted_line(&squares, |_| 1.0)?;
        let left: Vec<f64> = squares.iter().map(|square| line.residual(square)).collect();
        let along: f64 = left.iter().zip(&self.knots).map(|(left, knot)| left * knot.1).sum();
        let bend = along / left.iter().map(|left| left * left).sum::<f64>() / (last.1 - first.1);
        bend.is_finite().then_some(bend)
    }
}

/// Mean inverse depth and median prior of a bin.
fn middle(bin: &[(f64, f64)]) -> (f64, f64) {
    let v: Vec<f64> = bin.iter().map(|s| s.0).collect();
    let p: Vec<f64> = bin.iter().map(|s| s.1).collect();
    (stats::mean(&v).unwrap_or(f64::NAN), stats::median(&p).unwrap_or(f64::NAN))
}

/// A polyline at `x`, its ends prolonged; `axes` says which of a knot's numbers is x and which is the value.
fn interpolate(knots: &[(f64, f64)], x: f64, axes: impl Fn(&(f64, f64)) -> (f64, f64)) -> f64 {
    let after = knots.partition_point(|knot| axes(knot).0 <= x).clamp(1, knots.len() - 1);
    let ((x0, y0), (x1, y1)) = (axes(&knots[after - 1]), axes(&knots[after]));
    y0 + (x - x0) / (x1 - x0) * (y1 - y0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ground from 200 to 80 m away, with things up to 15 % nearer on a third of it, as a prior sees it.
    fn samples(prior: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        let of = |i: usize| {
            let v = 1.0 / 200.0 + (1.0 / 80.0 - 1.0 / 200.0) * (i % 997) as f64 / 996.0;
            let stands = i.is_multiple_of(3);
            let nearer = if stands { 1.0 + 0.15 * (i % 7) as f64 / 6.0 } else { 1.0 };
            (v, prior(v * nearer))
        };
        (0..9000).map(of).collect()
    }

    fn bend_of(prior: impl Fn(f64) -> f64) -> f64 {
        Polyline::fit(samples(prior)).unwrap().bend().unwrap()
    }

    fn shifted(samples: &[(f64, f64)]) -> Option<(GroundCurve, f64)> {
        shifted_depth(samples, robust_line(samples))
    }

    #[test]
    fn a_root_and_a_cube_come_out_straight() {
        for power in [0.33, 3.0] {
            let curve = Polyline::fit(samples(|v| 7.0 * (v - 0.0049).powf(power) - 2.0)).unwrap();
            for v in [1.0 / 180.0, 1.0 / 140.0, 1.0 / 100.0, 1.0 / 85.0] {
                let found = GroundCurve::Bent(curve.clone()).inverse_depth(7.0 * (v - 0.0049_f64).powf(power) - 2.0);
                assert!((found - v).abs() < 0.02 * v, "power {power}: {found} is not {v}");
            }
        }
    }

    #[test]
    fn depth_stretched_to_0_and_1_comes_out_straight_and_depth_up_to_scale_is_left_alone() {
        let stretched = |v: f64| ((v.recip() - 60.0) / 150.0).recip();
        let noise = |v: f64| 1.0 + 0.01 * (v * 1e7).sin();
        let (curve, share) = shifted(&samples(|v| stretched(v * noise(v)))).unwrap();
        assert!(share < SHIFTED_SHARE, "{share}");
        for v in [1.0 / 180.0, 1.0 / 140.0, 1.0 / 100.0, 1.0 / 75.0] {
            let found = curve.inverse_depth(stretched(v));
            assert!((found - v).abs() < 0.01 * v, "{found} is not {v}");
        }
        let (_, share) = shifted(&samples(|v| 7.0 * v * noise(v))).unwrap();
        assert!(share > SHIFTED_SHARE, "{share}");
    }

    #[test]
    fn the_bend_of_a_parabola_is_its_sag_and_a_line_has_none_whatever_stands_on_the_ground() {
        let knots = (0..12).map(|i| f64::from(i) / 11.0).map(|v| (v, v * v)).collect();
        let bend = Polyline { knots }.bend().unwrap();
        assert!((bend - 0.25).abs() < 1e-9, "{bend}");
        let line = bend_of(|v| 7.0 * v - 2.0);
        assert!(line.abs() < 0.01, "{line}");
        let noisy = bend_of(|v| v + 1e-3 * (v * 1e7).sin());
        assert!(noisy.abs() < MIN_BEND, "{noisy}");
    }

    #[test]
    fn photos_that_bend_the_same_way_are_bent_however_much_each_one_drifts() {
        // The errors of a photo are as large as the bend that a root makes.
        let drift = |photo: i32| 0.5 * MIN_BEND * f64::from(photo % 5 - 2);
        let fits = |bend: f64| -> Vec<GroundFits> {
            (0..20).map(|photo| GroundFits { bend: Some(bend + drift(photo)), ..GroundFits::NONE }).collect()
        };
        let shape = |bend: f64| PriorShape::of(&fits(bend).iter().collect::<Vec<_>>());
        assert_eq!([-0.15, 0.0, 0.15].map(shape), [PriorShape::Bent, PriorShape::Line, PriorShape::Bent]);
    }

    #[test]
    fn knots_that_fall_are_pooled() {
        let knots = vec![(1.0, 1.0), (2.0, 4.0), (3.0, 2.0), (4.0, 5.0)];
        assert_eq!(Polyline { knots }.rising().unwrap().knots, [(1.0, 1.0), (2.5, 3.0), (4.0, 5.0)]);
    }

    #[test]
    fn a_prior_that_falls_towards_the_camera_is_not_turned_round() {
        assert_eq!(Polyline::fit(samples(|v| -v.sqrt())), None);
    }
}
