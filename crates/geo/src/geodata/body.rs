//! Bodies among features: the faces of a building's walls, roofs and floor, kept as one geometry in three dimensions.
//!
//! A feature is the body of a building where its faces say so by their heights: one stands upright, or one lies over another,
//! or they join along edges and slope. Its outline in plan is the union of the faces that do not stand upright. Parts of an ordinary footprint
//! lie side by side and apart, and stay parts.

use geo::orient::Direction;
use geo::{Area as _, Euclidean, Length as _, Orient as _, unary_union};
use geo_types::{MultiPolygon, Polygon};

/// An upright face has an area in plan below this share of its squared perimeter there: it is a five-hundredth as wide as long.
const UPRIGHT_SHARE: f64 = 1e-3;
/// Heights that differ by less are one height, in the unit of the file's heights.
const SAME_LEVEL: f64 = 0.1;
/// Faces over which the height changes by more slope.
const SLOPE: f64 = 0.5;
/// Faces lie over each other where their areas add up to so much more than their union has.
const OVERLAP: f64 = 1.01;

/// A face of a feature in three dimensions.
#[derive(Debug)]
pub(super) struct Face {
    /// The face seen from above.
    plan: Polygon<f64>,
    /// Lowest and highest of its corners.
    range: [f64; 2],
}

impl Face {
    /// A face in plan, and the heights of its corners.
    pub(super) fn new(plan: &Polygon<f64>, heights: impl IntoIterator<Item = f64>) -> Self {
        let start = [f64::INFINITY, f64::NEG_INFINITY];
        let range = heights.into_iter().fold(start, |[low, high], z| [low.min(z), high.max(z)]);
        // Floors run the other way round than roofs, and a union takes one way only.
        Self { plan: plan.orient(Direction::Default), range }
    }

    fn rise(&self) -> f64 {
        self.range[1] - self.range[0]
    }

    /// Whether it has no area in plan. In plan alone, so that degrees beside metres do no harm.
    fn is_upright(&self) -> bool {
        let perimeter = Euclidean.length(self.plan.exterior());
        self.plan.unsigned_area() <= UPRIGHT_SHARE * perimeter * perimeter
    }
}

/// The outline in plan, where the faces are those of a body.
pub(super) fn outline(faces: &[Face]) -> Option<MultiPolygon<f64>> {
    let [low, high] = faces.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], face| {
        [low.min(face.range[0]), high.max(face.range[1])]
    });
    if faces.len() < 2 || high.is_nan() || high - low <= SAME_LEVEL {
        return None;
    }
    let has_wall = faces.iter().any(|face| face.is_upright() && face.rise() > SAME_LEVEL);
    let lying: Vec<&Face> = faces.iter().filter(|face| !face.is_upright()).collect();
    let united = united(&lying)?;
    let is_over_another =
        || lying.iter().map(|face| face.plan.unsigned_area()).sum::<f64>() > OVERLAP * united.unsigned_area();
    let is_roof = || united.0.len() < lying.len() && lying.iter().any(|face| face.rise() > SLOPE);
    (has_wall || is_over_another() || is_roof()).then_some(united)
}

/// The outline in plan of what is one surface by its kind.
pub(super) fn outline_of_surface(faces: &[Face]) -> Option<MultiPolygon<f64>> {
    united(&faces.iter().filter(|face| !face.is_upright()).collect::<Vec<_>>())
}

fn united(faces: &[&Face]) -> Option<MultiPolygon<f64>> {
    let is_number = |face: &&Face| face.plan.exterior().coords().all(|c| c.x.is_finite() && c.y.is_finite());
    // What is no number is refused by whoever uses the feature.
    let is_sound = !faces.is_empty() && faces.iter().all(is_number);
    is_sound.then(|| unary_union(faces.iter().map(|face| &face.plan))).filter(|united| !united.0.is_empty())
}

#[cfg(test)]
mod tests {
    use geo_types::{Coord, LineString};

    use super::*;

    fn face(corners: &[[f64; 3]]) -> Face {
        let ring: LineString<f64> = corners.iter().map(|p| Coord { x: p[0], y: p[1] }).collect();
        Face::new(&Polygon::new(ring, Vec::new()), corners.iter().map(|p| p[2]))
    }

    fn level(x: f64, z: f64) -> Face {
        face(&[[x, 0.0, z], [x + 10.0, 0.0, z], [x + 10.0, 8.0, z], [x, 8.0, z]])
    }

    #[test]
    fn walls_floor_and_roof_are_one_outline() {
        let wall = face(&[[0.0, 0.0, 3.0], [10.0, 0.0, 3.0], [10.0, 0.0, 9.0], [0.0, 0.0, 9.0]]);
        let outline = outline(&[wall, level(0.0, 3.0), level(0.0, 9.0)]).unwrap();
        assert_eq!((outline.0.len(), outline.unsigned_area()), (1, 80.0));
    }

    #[test]
    fn a_floor_under_a_roof_and_two_sloping_roofs_are_bodies_without_walls() {
        assert_eq!(outline(&[level(0.0, 3.0), level(0.0, 9.0)]).unwrap().unsigned_area(), 80.0);
        let slope =
            |y: f64, eave_y: f64| face(&[[0.0, eave_y, 3.0], [10.0, eave_y, 3.0], [10.0, y, 6.0], [0.0, y, 6.0]]);
        let gable = outline(&[slope(4.0, 0.0), slope(4.0, 8.0)]).unwrap();
        assert_eq!((gable.0.len(), gable.unsigned_area()), (1, 80.0));
    }

    #[test]
    fn parts_side_by_side_stay_parts_whatever_their_level() {
        assert_eq!(outline(&[level(0.0, 3.0), level(20.0, 3.0)]), None);
        assert_eq!(outline(&[level(0.0, 3.0), level(20.0, 9.0)]), None);
        assert_eq!(outline(&[level(0.0, 3.0), level(10.0, 9.0)]), None, "terraces with a level each");
        assert_eq!(outline(&[level(0.0, 0.0), level(0.0, 0.0)]), None, "repeated without heights");
    }

    #[test]
    fn upright_faces_are_told_in_degrees_too() {
        let wall = face(&[[7.0, 53.0, 3.0], [7.000_1, 53.000_2, 3.0], [7.000_1, 53.000_2, 9.0], [7.0, 53.0, 9.0]]);
        assert!(wall.is_upright());
        let roof = face(&[[7.0, 53.0, 3.0], [7.000_1, 53.0, 3.0], [7.000_1, 53.000_001, 9.0], [7.0, 53.000_001, 9.0]]);
        assert!(!roof.is_upright(), "a decimetre wide");
    }
}
