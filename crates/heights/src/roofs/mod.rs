//! The form of a roof: does another one explain the priors better than a flat one?
//!
//! The forms ([`crate::roofs::pitched`], [`crate::roofs::stepped`]) are tried after the search has settled, with the neighbours flat as they
//! are; once more, where that is asked for, when heights have settled beside neighbours whose roofs have forms. Of those that are clearly
//! better than a flat roof, the one that explains most is taken.

pub(crate) mod formed;
pub(crate) mod pitched;
pub(crate) mod planes;
pub(crate) mod stepped;
pub(crate) mod two_levels;
pub(crate) mod wings;

use std::cell::LazyCell;

use glam::{DVec2, Mat2, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use self::pitched::PitchedShape;
use crate::config::SearchConfig;
use crate::evidence::Evidence;
use crate::render::PlacedCamera;
use crate::scene::{HeightBounds, HeightReference, Prism, RoofForm};
use crate::score::Window;

/// Highest point of a tried roof above the height that the search has found, at most, metres.
pub(crate) const REACH_M: f32 = pitched::TALLEST_M + 2.0;
/// A roof whose mean is farther than this from the flat height has to be better in whole windows too, metres.
const FAR_M: f64 = 2.0;
/// No roof of a few numbers explains more than all but this of a prior: a footprint's corners and a roof's furniture are in it.
const LEAST_UNEXPLAINED: f64 = 1e-3;
/// Lead of a hip over a flat roof with rounded edges from which it is believed. Of 360 flat roofs in towns of seeds 31 and 32 (four
/// levels of prior errors, 448 pixels) 45 were called hips without it and 15 are with it, of 60 hips 56 and 47 are.
const OVER_ROUNDED: Margin = Margin { gain: 0.0005, standard_errors: 0.5, n_more: 0.0 };
/// And the same over a flat one, in standard errors over views: of the same roofs 22 and 9 flat ones are called hips without it and with it, of hips 42 and 38.
const HIP_STANDARD_ERRORS: f64 = 2.0;
/// Fewer views cannot tell a form.
const MIN_VIEWS: usize = 4;
/// Share of a footprint's width that places on its roof keep from the walls, at most.
const CLEAR_SHARE: f32 = 0.2;

/// A roof as the evidence has it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Roof {
    /// Form of the roof.
    pub form: RoofForm,
    /// Lowest edge above the building's ground, metres.
    pub eave_m: f64,
    /// Highest line above the building's ground, metres.
    pub ridge_m: f64,
    /// Area mean above the building's ground, metres.
    pub mean_m: f64,
    /// The plan of a stepped one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terrace: Option<Terrace>,
    /// Direction of a gable's ridge, the main body's where there are wings: east and north, of length one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ridge_along: Option<[f64; 2]>,
}

/// A rectangle at one of the two levels of a stepped roof.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Terrace {
    /// Corners, local frame, metres, counter-clockwise; it may reach beyond the footprint.
    pub corners: [[f64; 2]; 4],
    /// Whether it is the upper level.
    pub is_upper: bool,
}

impl Terrace {
    /// Distance of a point from its nearest side, metres, positive inside; negative outside.
    fn depth_m(&self, point: Vec2) -> f32 {
        let corner = |i: usize| DVec2::from_array(self.corners[i % 4]).as_vec2();
        let from_side = |i: usize| {
            let along = (corner(i + 1) - corner(i)).normalize_or_zero();
            along.perp_dot(point - corner(i))
        };
        (0..4).map(from_side).fold(f32::INFINITY, f32::min)
    }
}

impl Roof {
    /// A flat roof at this height above the ground level, metres.
    #[must_use]
    pub fn flat(height_m: f64) -> Self {
        Self {
            form: RoofForm::Flat,
            eave_m: height_m,
            ridge_m: height_m,
            mean_m: height_m,
            terrace: None,
            ridge_along: None,
        }
    }

    /// Which of its heights is meant, metres.
    #[must_use]
    pub fn height_m(self, reference: HeightReference) -> f64 {
        match reference {
            HeightReference::Eave => self.eave_m,
            HeightReference::Mean => self.mean_m,
            HeightReference::Ridge => self.ridge_m,
        }
    }

    /// Whether its mean and the height that is stated lie within the range of heights, and no part of it above.
    #[must_use]
    pub fn is_within(self, bounds: HeightBounds, reference: HeightReference) -> bool {
        bounds.hold(self.mean_m) && bounds.hold(self.height_m(reference)) && self.ridge_m <= f64::from(bounds.max_m)
    }

    /// The same roof higher up.
    #[must_use]
    pub fn raised(self, by_m: f64) -> Self {
        let Self { eave_m, ridge_m, mean_m, .. } = self;
        Self { eave_m: eave_m + by_m, ridge_m: ridge_m + by_m, mean_m: mean_m + by_m, ..self }
    }

    /// The level of a stepped roof at a point, above the building's ground, metres; `None` nearer than so much to the step.
    fn level_m(&self, terrace: &Terrace, point: Vec2, clear_m: f32) -> Option<f64> {
        let depth_m = terrace.depth_m(point);
        let is_upper = (depth_m > 0.0) == terrace.is_upper;
        (depth_m.abs() >= clear_m).then_some(if is_upper { self.ridge_m } else { self.eave_m })
    }
}

/// Roofs of all forms and several pitches over a prism, and stepped as `found` if it is, all with its area mean, each with
/// places on it (local frame, metres): some `n` on a lattice, at least `clear_m` from the walls, or a fifth of a narrow footprint's width.
/// The flat one comes first.
#[must_use]
pub fn candidates(prism: &Prism, found: &Roof, clear_m: f32, n: usize) -> Vec<(Roof, Vec<Vec3>)> {
    let (axes, low, high) = smallest_rectangle(prism);
    let size = high - low;
    let clear_m = clear_m.min(CLEAR_SHARE * size.min_element());
    let spacing_m = (size.x * size.y / n as f32).sqrt();
    let (n_x, n_y) = ((size.x / spacing_m).ceil() as usize, (size.y / spacing_m).ceil() as usize);
    let lattice = (0..n_y).flat_map(|row| (0..n_x).map(move |col| Vec2::new(col as f32 + 0.5, row as f32 + 0.5)));
    let inside: Vec<Vec2> = lattice
        .map(|cell| axes.transpose() * (low + spacing_m * cell))
        .filter(|p| prism.contains(*p) && distance_to_border(prism, *p) >= clear_m)
        .collect();
    if inside.is_empty() {
        return Vec::new();
    }
    let mean_m = found.mean_m;
    let at = |p: &Vec2, height_m: f64| p.extend(prism.ground_z + height_m as f32);
    let mut roofs = vec![(Roof::flat(mean_m), inside.iter().map(|p| at(p, mean_m)).collect())];
    for shape in PitchedShape::all(prism) {
        let shares: Vec<f32> = inside.iter().map(|p| shape.at(*p) - shape.mean).collect();
        for rise_m in shape.rises_m() {
            let eave_m = mean_m - f64::from(shape.mean * rise_m);
            if eave_m <= 0.0 {
                continue;
            }
            let roof = shape.roof(eave_m, f64::from(rise_m), mean_m);
            let place = |(p, share): (&Vec2, &f32)| at(p, mean_m + f64::from(rise_m * share));
            roofs.push((roof, inside.iter().zip(&shares).map(place).collect()));
        }
    }
    if let Some(terrace) = found.terrace {
        let place = |p: &Vec2| Some(at(p, found.level_m(&terrace, *p, clear_m)?));
        roofs.push((*found, inside.iter().filter_map(place).collect()));
    }
    roofs
}

/// A building in one view: what is compared, and how much its agreement weighs.
pub(crate) struct RoofView<'a> {
    pub window: Window,
    pub weight: f64,
    pub placed: &'a PlacedCamera,
    pub evidence: &'a Evidence<'a>,
}

/// By how much a roof has to be better than a flat one over views: on average, in standard errors of that, and for the
/// numbers that describe it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Margin {
    pub gain: f64,
    pub standard_errors: f64,
    /// Numbers that it takes more than a flat one.
    pub n_more: f64,
}

impl Margin {
    /// Whether the scores of a roof in some views are better by it than those of a simpler one.
    fn is_passed(self, views: &[RoofView<'_>], scores: &[f64], simple: &[f64]) -> bool {
        let gains: Vec<f64> = scores.iter().zip(simple).map(|(score, simple)| score - simple).collect();
        // A score holds the agreement too: its greatest is one and the weight of that.
        let of_view = |(view, (score, simple)): (&RoofView<'_>, (&f64, &f64))| {
            let greatest = 1.0 + view.weight;
            (view.window.n_rays(), simple / greatest, score / greatest)
        };
        let of_views = views.iter().zip(scores.iter().zip(simple)).map(of_view);
        is_clear(&gains, self.gain, self.standard_errors) && (self.n_more == 0.0 || carries(self.n_more, of_views))
    }
}

/// Whether rays carry the numbers that one roof takes more than another (Bayes' criterion of information, Schwarz 1978):
///
/// ```text
/// Σ_k n_k / 2 · ln((1 − ρ_k²) / (1 − ρ'_k²))  >  m / 2 · ln Σ_k n_k
/// ```
///
/// `n_k` rays of view k, of whose prior one roof leaves `1 − ρ²` unexplained, the other `1 − ρ'²`; `m` more numbers. Small
/// parts and far photos have few rays: what tells them apart from chance is this, not their size.
pub(crate) fn carries(n_more: f64, views: impl Iterator<Item = (usize, f64, f64)>) -> bool {
    let unexplained = |score: f64| (1.0 - score.max(0.0).powi(2)).max(LEAST_UNEXPLAINED);
    let (mut nats, mut n_rays) = (0.0, 0);
    for (n, simple, other) in views {
        nats += 0.5 * n as f64 * (unexplained(simple) / unexplained(other)).ln();
        n_rays += n;
    }
    nats > 0.5 * n_more * (n_rays.max(1) as f64).ln()
}

/// The scores of a roof in other views.
pub(crate) type ScoresIn<'a> = Box<dyn Fn(&[RoofView<'_>]) -> Vec<f64> + 'a>;

/// The roof of some forms that a building's views show best.
pub(crate) struct RoofFit<'a> {
    pub roof: Roof,
    /// Whether it is more than a flat one by its shape.
    pub is_told: bool,
    pub margin: Margin,
    /// Score in each view, in their order.
    pub scores: Vec<f64>,
    pub scores_in: ScoresIn<'a>,
}

impl RoofFit<'_> {
    /// Whether its scores in some views are clearly better than those of a simpler roof.
    fn is_better(&self, views: &[RoofView<'_>], scores: &[f64], simple: &[f64]) -> bool {
        self.margin.is_passed(views, scores, simple)
    }
}

/// A building's roof as the views judge it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Judged {
    /// The one that they prefer to a flat one, if any.
    pub roof: Option<Roof>,
    /// Those that they do not rule out, with how likely each is against the one that is taken (1: just as likely).
    pub rivals: Vec<(Roof, f64)>,
    /// Mean score of the one that is taken, flat or not; `None` where too few views tell.
    pub score: Option<f64>,
    /// How certain the form of the one that is taken is, 0 to 1; `None` where too few views tell.
    pub certainty: Option<f64>,
}

/// Likelihood of a roof against another: by how many standard errors over views its score falls short, as a normal
/// distribution has it.
fn likelihood(scores: &[f64], taken: &[f64]) -> f64 {
    (-0.5 * standard_errors(taken, scores).max(0.0).powi(2)).exp()
}

/// Share of roofs called so whose form is that, by how many standard errors the form leads: over a flat roof, a flat one over the best
/// other. Logistic curves through 870 roofs of towns of seeds 31 and 32 (four levels of prior errors, 448 pixels).
fn certainty(form: RoofForm, lead: f64) -> Option<f64> {
    let [at_none, per_standard_error] = match form {
        RoofForm::Flat => [3.1, 0.56],
        RoofForm::Gable => [-3.7, 2.6],
        RoofForm::Hip => [0.4, 0.04],
        RoofForm::Stepped => [-0.4, 0.8],
    };
    lead.is_finite().then(|| 1.0 / (1.0 + (-at_none - per_standard_error * lead).exp()))
}

/// By how many standard errors over views one roof's scores are better than another's.
fn standard_errors(scores: &[f64], others: &[f64]) -> f64 {
    let gains: Vec<f64> = scores.iter().zip(others).map(|(score, other)| score - other).collect();
    let n = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean / (variance / n).sqrt().max(f64::MIN_POSITIVE)
}

/// Looks for the roof of one building around the height that the search has found: another one than a flat one where that is
/// clearly better. What is far from that height has to be better in `whole`, too, which takes in all that the building could
/// hide.
pub(crate) fn find<'a>(
    prism: &Prism,
    bounds: HeightBounds,
    height_m: f32,
    config: &SearchConfig,
    near: &[RoofView<'a>],
    whole: impl FnOnce() -> Vec<RoofView<'a>>,
) -> Judged {
    if near.len() < MIN_VIEWS {
        return Judged::default();
    }
    let flat_in =
        |views: &[RoofView<'_>]| -> Vec<f64> { views.iter().map(|v| v.window.score(height_m, v.weight)).collect() };
    let flat = flat_in(near);
    let whole = LazyCell::new(|| {
        let views = whole();
        let flat = flat_in(&views);
        (views, flat)
    });
    let is_far = |roof: &Roof| (roof.mean_m - f64::from(height_m)).abs() > FAR_M;
    let is_better_in_whole = |fit: &RoofFit<'_>| fit.is_better(&whole.0, &(fit.scores_in)(&whole.0), &whole.1);
    let is_believed =
        |fit: &RoofFit<'_>| fit.is_better(near, &fit.scores, &flat) && (!is_far(&fit.roof) || is_better_in_whole(fit));
    let forms = &config.roof_forms;
    let pitched = pitched::best(prism, forms, height_m, near);
    let is_stepped_tried = forms.contains(&RoofForm::Stepped);
    let stepped = is_stepped_tried.then(|| stepped::best(prism, bounds, height_m, near)).flatten();
    let is_rounding = |fit: &RoofFit<'_>| {
        let is_clear_hip = || standard_errors(&fit.scores, &flat) >= HIP_STANDARD_ERRORS;
        let is_over_rounded = || OVER_ROUNDED.is_passed(near, &fit.scores, &pitched::rounded(prism, height_m, near));
        fit.roof.form == RoofForm::Hip && !(is_clear_hip() && is_over_rounded())
    };
    let by_pitch = pitched.as_ref().filter(|fit| fit.is_told && is_believed(fit) && !is_rounding(fit));
    // Six numbers fit a slope too: a step has to be clearly better than the best slope, whether that is believed or not.
    let is_no_slope =
        |step: &&RoofFit<'_>| pitched.as_ref().is_none_or(|pitch| step.is_better(near, &step.scores, &pitch.scores));
    let by_step = stepped.as_ref().filter(|fit| is_believed(fit)).filter(is_no_slope);
    let taken = by_step.or(by_pitch);
    let taken_scores = taken.map_or(&flat, |fit| &fit.scores);
    let flat_roof = Roof::flat(f64::from(height_m));
    let fits = [&pitched, &stepped].into_iter().flatten();
    let all = fits.map(|fit| (fit.roof, &fit.scores)).chain([(flat_roof, &flat)]);
    let taken_roof = taken.map_or(flat_roof, |fit| fit.roof);
    let rivals =
        all.filter(|(roof, _)| *roof != taken_roof).map(|(roof, scores)| (roof, likelihood(scores, taken_scores)));
    let rivals = rivals.collect();
    let others = [&pitched, &stepped].into_iter().flatten();
    let lead = match taken {
        Some(fit) => standard_errors(&fit.scores, &flat),
        None => others.map(|fit| standard_errors(&flat, &fit.scores)).fold(f64::INFINITY, f64::min),
    };
    let certainty = certainty(taken_roof.form, lead);
    Judged { certainty, roof: taken.map(|fit| fit.roof), rivals, score: crate::stats::mean(taken_scores) }
}

/// Whether the views agree that something is better: their mean gain is large enough and stands clear of its standard
/// error.
pub(crate) fn is_clear(gains: &[f64], min_gain: f64, min_standard_errors: f64) -> bool {
    let n = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean > min_gain && mean > min_standard_errors * (variance / n).sqrt()
}

/// The rectangle of least area around the exterior, along one of its edges: axes as rows, low and high corner.
pub(crate) fn smallest_rectangle(prism: &Prism) -> (Mat2, Vec2, Vec2) {
    let exterior = prism.rings().next().unwrap_or(&[]);
    let mut best = (f32::INFINITY, Mat2::IDENTITY, Vec2::ZERO, Vec2::ZERO);
    for edge in exterior.windows(2) {
        let Some(along) = (edge[1] - edge[0]).try_normalize() else { continue };
        let axes = Mat2::from_cols(along, along.perp()).transpose();
        let (low, high) = exterior
            .iter()
            .map(|c| axes * *c)
            .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)));
        let size = high - low;
        if size.x * size.y < best.0 {
            best = (size.x * size.y, axes, low, high);
        }
    }
    (best.1, best.2, best.3)
}

/// The middles of `n × n` cells of a rectangle.
pub(crate) fn grid(low: Vec2, high: Vec2, n: usize) -> impl Iterator<Item = Vec2> {
    (0..n * n).map(move |i| {
        let cell = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
        low + (high - low) * cell
    })
}

/// Distance of a point to the nearest wall, metres.
pub(crate) fn distance_to_border(prism: &Prism, point: Vec2) -> f32 {
    prism
        .edges()
        .map(|(a, b)| {
            let edge = b - a;
            let along = ((point - a).dot(edge) / edge.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
            (point - a - along * edge).length()
        })
        .fold(f32::INFINITY, f32::min)
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;
    use crate::frames::LocalOrigin;
    use crate::terrain::GroundLevel;

    #[test]
    fn a_shed_has_places_clear_of_its_walls_too() {
        let shed = polygon![(x: 0.0, y: 0.0), (x: 3.5, y: 0.0), (x: 3.5, y: 1.6), (x: 0.0, y: 1.6)];
        let prism = Prism::new(&shed, GroundLevel::flat(0.0), LocalOrigin(glam::DVec3::ZERO));
        let all = candidates(&prism, &Roof::flat(2.5), 0.7, 300);
        let (_, places) = all.first().expect("the flat roof");
        let clear_m = places.iter().map(|p| p.x.min(3.5 - p.x).min(p.y).min(1.6 - p.y)).fold(f32::INFINITY, f32::min);
        assert!(places.len() >= 100 && clear_m >= 0.3, "{} places, {clear_m} m", places.len());
    }

    #[test]
    fn a_stepped_roof_is_looked_at_on_both_of_its_levels() {
        let square = polygon![(x: 0.0, y: 0.0), (x: 20.0, y: 0.0), (x: 20.0, y: 20.0), (x: 0.0, y: 20.0)];
        let prism = Prism::new(&square, GroundLevel::flat(5.0), LocalOrigin(glam::DVec3::ZERO));
        let corners = [[4.0, 4.0], [10.0, 4.0], [10.0, 12.0], [4.0, 12.0]];
        for is_upper in [true, false] {
            let terrace = Some(Terrace { corners, is_upper });
            let found =
                Roof { form: RoofForm::Stepped, eave_m: 12.0, ridge_m: 15.0, mean_m: 12.4, terrace, ridge_along: None };
            let all = candidates(&prism, &found, 1.0, 400);
            let (_, places) = all.iter().find(|(roof, _)| *roof == found).unwrap();
            let n_inner = places.iter().filter(|p| (4.0..=10.0).contains(&p.x) && (4.0..=12.0).contains(&p.y)).count();
            assert!(n_inner >= 20 && places.len() - n_inner >= 100, "{n_inner} of {}", places.len());
            for p in places {
                let (beyond_x, beyond_y) = ((p.x - 7.0).abs() - 3.0, (p.y - 8.0).abs() - 4.0);
                let beyond = beyond_x.max(beyond_y);
                assert!(beyond.abs() >= 1.0, "a place at the step: {p}");
                let expected_z = if (beyond < 0.0) == is_upper { 20.0 } else { 17.0 };
                assert_eq!(p.z, expected_z);
            }
        }
    }
}
