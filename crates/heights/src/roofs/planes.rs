//! The planes that a roof consists of, for solids with roofs.
//!
//! ```text
//! z(p) = level + slope · p        above the building's ground; p local frame, metres
//! gable   highest of the planes over whose rectangle p lies: two to a ridge, and as many to each wing
//! hip     lowest of the planes that rise from the walls; of convex footprints only
//! others  first of the planes over whose rectangle p lies: the inner level or its gable, then the rest
//! ```

use glam::{DMat2, DVec2};

use crate::roofs::pitched::PitchedShape;
use crate::roofs::wings::WingGable;
use crate::roofs::{Roof, Terrace, smallest_rectangle};
use crate::scene::{Prism, RoofForm};

/// Walls that turn by less lie on one line: sine of the angle (half a degree).
const STRAIGHT: f64 = 0.009;
/// Places so near to a rectangle lie in it, metres.
const EDGE_M: f64 = 1e-3;

/// Which of the planes over a place is the roof there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// The highest of those over whose rectangle it lies.
    Highest,
    /// The lowest of all.
    Lowest,
    /// The first over whose rectangle it lies.
    First,
}

/// A plane of a roof.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoofPlane {
    /// Rectangle that it lies over, counter-clockwise, local frame, metres; everywhere where there is none.
    pub over: Option<[DVec2; 4]>,
    /// Rise per metre to the east and to the north.
    pub slope: DVec2,
    /// Height above the building's ground at the local frame's origin, metres.
    pub level_m: f64,
}

impl RoofPlane {
    /// Height of it above the building's ground at a point of the local frame, metres.
    #[must_use]
    pub fn height_m(&self, at: DVec2) -> f64 {
        self.level_m + self.slope.dot(at)
    }

    fn level(level_m: f64, over: Option<[DVec2; 4]>) -> Self {
        Self { over, slope: DVec2::ZERO, level_m }
    }
}

/// A roof as planes.
#[derive(Debug, Clone, PartialEq)]
pub struct RoofPlanes {
    /// In an order that counts where the rule is [`Rule::First`].
    pub planes: Vec<RoofPlane>,
    /// Which of them is the roof at a place.
    pub rule: Rule,
}

/// A rectangle along axes (rows).
#[derive(Clone, Copy)]
struct Rectangle {
    axes: DMat2,
    low: DVec2,
    high: DVec2,
}

impl Rectangle {
    fn corners(&self) -> [DVec2; 4] {
        let (low, high) = (self.low, self.high);
        [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)].map(|p| self.axes.transpose() * p)
    }

    /// The two planes of a gable between two eaves whose ridge runs along its first axis or its second.
    fn gable(&self, [low, high]: [f64; 2], eave_m: f64, rise_m: f64, is_along_first: bool) -> [RoofPlane; 2] {
        let axis = usize::from(is_along_first);
        let middle = f64::midpoint(low, high);
        let pitch = rise_m / (0.5 * (high - low));
        let (mut first, mut second) = (*self, *self);
        (first.high[axis], second.low[axis]) = (middle, middle);
        [(first, low, pitch), (second, high, -pitch)].map(|(half, eave, pitch)| RoofPlane {
            over: Some(half.corners()),
            slope: pitch * self.axes.row(axis),
            level_m: eave_m - pitch * eave,
        })
    }
}

impl RoofPlanes {
    /// Those of a roof over its footprint; `None` of a hip over a footprint that is not convex, and of a gable whose ridge is not
    /// known.
    #[must_use]
    pub fn of(roof: &Roof, prism: &Prism) -> Option<Self> {
        let rise_m = roof.ridge_m - roof.eave_m;
        match (roof.form, roof.terrace) {
            (RoofForm::Flat, _) => {
                let planes = vec![RoofPlane::level(roof.mean_m, None)];
                Some(Self { planes, rule: Rule::First })
            }
            (RoofForm::Gable, _) => {
                let along = DVec2::from_array(roof.ridge_along?);
                let towards = |shape: &PitchedShape<'_>| shape.ridge_along().map(|own| own.dot(along).abs());
                let shapes = PitchedShape::all(prism).into_iter().filter_map(|shape| Some((towards(&shape)?, shape)));
                let (_, shape) = shapes.max_by(|(a, _), (b, _)| a.total_cmp(b))?;
                let (axes, gables) = shape.gables();
                let of_gable = |gable: &WingGable| {
                    let reach = gable.reach.map(glam::Vec2::as_dvec2);
                    let over = Rectangle { axes: axes.as_dmat2(), low: reach[0], high: reach[1] };
                    let across = usize::from(gable.is_along_x);
                    let eaves = [gable.low, gable.high].map(|corner| f64::from(corner[across]));
                    let rise_m = rise_m * f64::from(gable.half_width_m() / shape.run_m());
                    over.gable(eaves, roof.eave_m, rise_m, gable.is_along_x)
                };
                Some(Self { planes: gables.iter().flat_map(of_gable).collect(), rule: Rule::Highest })
            }
            (RoofForm::Hip, _) => hip(roof, prism),
            (RoofForm::Stepped, None) => None,
            (RoofForm::Stepped, Some(terrace)) => Some(terraced(roof, &terrace)),
        }
    }

    /// The roof's height above the building's ground at a point of the local frame, metres; `None` beside all planes.
    #[must_use]
    pub fn height_m(&self, at: DVec2) -> Option<f64> {
        let is_over = |plane: &&RoofPlane| plane.over.is_none_or(|corners| is_within(&corners, at));
        let mut heights = self.planes.iter().filter(is_over).map(|plane| plane.height_m(at));
        match self.rule {
            Rule::Highest => heights.reduce(f64::max),
            Rule::Lowest => heights.reduce(f64::min),
            Rule::First => heights.next(),
        }
    }
}

/// Whether a point lies in a rectangle, or next to it.
fn is_within(corners: &[DVec2; 4], at: DVec2) -> bool {
    (0..4).all(|i| {
        let side = corners[(i + 1) % 4] - corners[i];
        side.perp_dot(at - corners[i]) >= -EDGE_M * side.length()
    })
}

/// A step with the inner level first.
fn terraced(roof: &Roof, terrace: &Terrace) -> RoofPlanes {
    let corners = terrace.corners.map(DVec2::from_array);
    let (inner_m, outer_m) = if terrace.is_upper { (roof.ridge_m, roof.eave_m) } else { (roof.eave_m, roof.ridge_m) };
    let planes = vec![RoofPlane::level(inner_m, Some(corners)), RoofPlane::level(outer_m, None)];
    RoofPlanes { planes, rule: Rule::First }
}

/// Planes that rise from the walls of a convex footprint, all as steep, to the point that is farthest from all of them.
fn hip(roof: &Roof, prism: &Prism) -> Option<RoofPlanes> {
    let mut rings = prism.rings();
    let (exterior, None) = (rings.next()?, rings.next()) else { return None };
    let mut corners: Vec<DVec2> = exterior.iter().map(|corner| corner.as_dvec2()).collect();
    if corners.windows(2).map(|wall| wall[0].perp_dot(wall[1])).sum::<f64>() < 0.0 {
        corners.reverse();
    }
    let mut walls: Vec<[DVec2; 2]> = Vec::new();
    for wall in corners.windows(2).map(|wall| [wall[0], wall[1]]) {
        let Some(along) = (wall[1] - wall[0]).try_normalize() else { continue };
        match walls.last_mut() {
            Some(last) if (last[1] - last[0]).normalize_or_zero().perp_dot(along).abs() < STRAIGHT => last[1] = wall[1],
            _ => walls.push(wall),
        }
    }
    let inward = |wall: &[DVec2; 2]| (wall[1] - wall[0]).normalize_or_zero().perp();
    if let [first, .., last] = walls[..]
        && (last[1] - last[0]).normalize_or_zero().perp_dot((first[1] - first[0]).normalize_or_zero()).abs() < STRAIGHT
    {
        walls[0][0] = last[0];
        walls.pop();
    }
    let n = walls.len();
    let turns = (0..n).map(|i| inward(&walls[i]).perp_dot(inward(&walls[(i + 1) % n])));
    if n < 3 || turns.into_iter().any(|turn| turn <= 0.0) {
        return None;
    }
    let (axes, low, high) = smallest_rectangle(prism);
    let deepest_m = f64::from(PitchedShape::deepest_m(prism, axes, low, high));
    let pitch = (roof.ridge_m - roof.eave_m) / deepest_m;
    let plane = |wall: &[DVec2; 2]| {
        let slope = pitch * inward(wall);
        RoofPlane { over: None, slope, level_m: roof.eave_m - slope.dot(wall[0]) }
    };
    (deepest_m > 0.0).then(|| RoofPlanes { planes: walls.iter().map(plane).collect(), rule: Rule::Lowest })
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::roofs::candidates;
    use crate::roofs::wings::tests::{HOUSE as WINGED, prism};

    const HOUSE: [(f64, f64); 4] = [(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)];

    /// Every form that is fitted to priors, at every place that it is looked at, is as high as its planes.
    #[test]
    fn planes_are_the_roofs_that_are_fitted() {
        for (corners, turn) in [(&HOUSE[..], 0.0), (&HOUSE, 0.7), (&WINGED, 0.0), (&WINGED, 2.1)] {
            let prism = prism(corners, turn);
            let (axes, low, high) = smallest_rectangle(&prism);
            let corner =
                |x: f32, y: f32| (axes.transpose() * (low + (high - low) * Vec2::new(x, y))).as_dvec2().to_array();
            let terrace = Terrace {
                corners: [corner(0.0, 0.0), corner(0.6, 0.0), corner(0.6, 0.55), corner(0.0, 0.55)],
                is_upper: true,
            };
            let found = Roof {
                form: RoofForm::Stepped,
                eave_m: 5.0,
                ridge_m: 9.0,
                mean_m: 6.0,
                terrace: Some(terrace),
                ridge_along: None,
            };
            let mut forms = std::collections::BTreeMap::new();
            for (roof, places) in candidates(&prism, &found, 0.3, 300) {
                let Some(planes) = RoofPlanes::of(&roof, &prism) else {
                    assert_eq!((roof.form, corners.len()), (RoofForm::Hip, 6), "only a hip over wings has none");
                    continue;
                };
                *forms.entry(roof.form.as_str()).or_insert(0) += 1;
                for place in &places {
                    let height_m = planes.height_m(place.truncate().as_dvec2()).unwrap();
                    assert!((height_m - f64::from(place.z)).abs() < 0.01, "{roof:?} at {place}: {height_m}");
                }
            }
            let n_forms = if corners.len() == 4 { 4 } else { 3 };
            assert_eq!(forms.len(), n_forms, "{forms:?}");
        }
    }

    #[test]
    fn a_gable_without_its_ridge_has_no_planes() {
        let roof = Roof { form: RoofForm::Gable, eave_m: 4.0, ridge_m: 8.0, ..Roof::flat(6.0) };
        assert_eq!(RoofPlanes::of(&roof, &prism(&HOUSE, 0.0)), None);
    }
}
