//! What is wrong with poses and footprints as the user gets them; the truth stays clean.

use std::collections::{BTreeMap, BTreeSet};

use geo::{Translate, Validation};
use geo_types::{LineString, Polygon};
use glam::{DMat3, DVec2, DVec3};

use sizeup_heights::frames::Rigid;
use sizeup_heights::seed;
use sizeup_survey::View;

use super::building::{SimulatedBuilding, polygon};
use super::chance::normal;
use super::config::ErrorConfig;

/// Corners closer than this are the same corner, metres.
const SAME_CORNER_M: f64 = 1e-3;
/// Two edges that turn by less than this (sine) have no useful intersection.
const STRAIGHT: f64 = 0.05;

/// The poses as a survey with limited accuracy would have them.
#[must_use]
pub fn poses(views: &[View], errors: &ErrorConfig, root_seed: u64) -> Vec<View> {
    let disturb = |(i, view): (usize, &View)| {
        let mut rng = seed::stream(root_seed, "pose error", &[i as u64]);
        let mut draw = |sd: f64| DVec3::new(sd * normal(&mut rng), sd * normal(&mut rng), sd * normal(&mut rng));
        let shift = draw(errors.position_m);
        let turn = DMat3::from_quat(glam::DQuat::from_scaled_axis(draw(errors.angle_deg.to_radians())));
        let pose = &view.camera_from_map;
        View {
            camera_from_map: Rigid::from_rotation_and_centre(turn * pose.rotation, pose.centre() + shift),
            ..view.clone()
        }
    };
    views.iter().enumerate().map(disturb).collect()
}

/// The footprints as a mapping agency would have them, in the order of the buildings. Shared walls stay shared: their
/// corners move together, and footprints grow on free sides only. A footprint that would cross itself stays as it is.
#[must_use]
pub fn footprints(buildings: &[SimulatedBuilding], errors: &ErrorConfig, root_seed: u64) -> Vec<Polygon<f64>> {
    let key = |p: DVec2| [p.x, p.y].map(|v| (v / SAME_CORNER_M).round() as i64);
    let rings = |b: &SimulatedBuilding| -> Vec<Vec<DVec2>> {
        std::iter::once(b.footprint.exterior()).chain(b.footprint.interiors()).map(open_ring).collect()
    };
    let edges: BTreeSet<_> = buildings
        .iter()
        .flat_map(|b| rings(b).into_iter().flat_map(|ring| edges_of(&ring)))
        .map(|[a, b]| [key(a), key(b)])
        .collect();
    let is_shared = |a: DVec2, b: DVec2| edges.contains(&[key(b), key(a)]);
    let noise = |p: DVec2| {
        let [x, y] = key(p);
        let mut rng = seed::stream(root_seed, "vertex error", &[x as u64, y as u64]);
        errors.vertex_m * DVec2::new(normal(&mut rng), normal(&mut rng))
    };
    let blocks = blocks(buildings.iter().map(|b| rings(b).concat().into_iter().map(key).collect()));
    let shift_of = |block: usize| {
        let mut rng = seed::stream(root_seed, "building error", &[block as u64]);
        DVec2::from(errors.shift_m) + errors.building_m * DVec2::new(normal(&mut rng), normal(&mut rng))
    };
    let disturb = |(b, block): (&SimulatedBuilding, usize)| {
        let shift = shift_of(block);
        let moved = rings(b).into_iter().map(|ring| {
            let offset = offset_by(&ring, |a, b| if is_shared(a, b) { 0.0 } else { errors.footprint_m });
            ring.iter().zip(offset).map(|(&p, grown)| grown + noise(p) + shift).collect::<Vec<_>>()
        });
        let disturbed = polygon(moved);
        if disturbed.is_valid() { disturbed } else { b.footprint.translate(shift.x, shift.y) }
    };
    buildings.iter().zip(blocks).map(disturb).collect()
}

/// By building, the first one of those that it hangs together with by common corners.
fn blocks(corners_of: impl Iterator<Item = Vec<[i64; 2]>>) -> Vec<usize> {
    let mut first_of: Vec<usize> = Vec::new();
    let mut at_corner: BTreeMap<[i64; 2], usize> = BTreeMap::new();
    for corners in corners_of {
        let building = first_of.len();
        let mut joined: BTreeSet<usize> = [building].into();
        first_of.push(building);
        for corner in corners {
            joined.insert(first_of[*at_corner.entry(corner).or_insert(building)]);
        }
        if joined.len() == 1 {
            continue;
        }
        let first = *joined.first().expect("it holds the building itself");
        first_of.iter_mut().filter(|of| joined.contains(of)).for_each(|of| *of = first);
    }
    first_of
}

/// A ring without its repeated last point.
pub(super) fn open_ring(ring: &LineString<f64>) -> Vec<DVec2> {
    let n = ring.0.len().saturating_sub(1);
    ring.0[..n].iter().map(|c| DVec2::new(c.x, c.y)).collect()
}

fn edges_of(ring: &[DVec2]) -> Vec<[DVec2; 2]> {
    (0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]).collect()
}

/// Moves every edge to its right (outwards, for counter-clockwise exteriors and clockwise holes) by its own distance.
fn offset_by(ring: &[DVec2], distance_m: impl Fn(DVec2, DVec2) -> f64) -> Vec<DVec2> {
    let n = ring.len();
    let edge = |i: usize| {
        let (a, b) = (ring[i % n], ring[(i + 1) % n]);
        let along = (b - a).normalize_or_zero();
        (along, -along.perp(), distance_m(a, b))
    };
    (0..n)
        .map(|i| {
            let (before, out_before, d_before) = edge(i + n - 1);
            let (after, out_after, d_after) = edge(i);
            let turn = before.perp_dot(after);
            if turn.abs() < STRAIGHT {
                return ring[i] + 0.5 * (d_before * out_before + d_after * out_after);
            }
            // The corner of the two moved lines.
            let a = ring[i] + d_before * out_before;
            let b = ring[i] + d_after * out_after;
            a + before * ((b - a).perp_dot(after) / turn)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use geo::Area;

    use super::*;
    use crate::simulate::building::{BuildingKind, Placement};
    use crate::simulate::form::{self, Rect};
    use sizeup_geo::terrain::Terrain;
    use sizeup_heights::stats::mean;

    fn row_of_two() -> Vec<SimulatedBuilding> {
        let at = Placement { origin: DVec2::new(565_000.0, 5_932_000.0), angle_rad: 0.4 };
        let raise = |x0: f64, id: &str| {
            let form = form::gable(Rect::sized(x0, 0.0, 6.0, 10.0), 5.0, 8.0);
            SimulatedBuilding::raise(&form, &at, &Terrain::Constant(3.0), BuildingKind::RowHouse, id.into())
        };
        vec![raise(0.0, "a"), raise(6.0, "b")]
    }

    #[test]
    fn footprints_grow_on_free_sides_only() {
        let errors = ErrorConfig { footprint_m: 0.2, ..ErrorConfig::default() };
        let grown = footprints(&row_of_two(), &errors, 1);
        for polygon in &grown {
            // 6 × 10 m, 0.2 m more on three sides.
            assert!((polygon.unsigned_area() - 6.2 * 10.4).abs() < 1e-6, "{}", polygon.unsigned_area());
        }
    }

    #[test]
    fn shared_walls_stay_shared_under_noise() {
        let [a, b]: [Polygon<f64>; 2] = footprints(&row_of_two(), &ErrorConfig::REALISTIC, 7).try_into().unwrap();
        let shared = a.exterior().0.iter().filter(|p| b.exterior().0.contains(p)).count();
        assert!(shared >= 2, "{a:?} {b:?}");
        assert!(a.is_valid() && b.is_valid());
    }

    #[test]
    fn houses_that_share_a_wall_are_off_by_the_same_and_others_by_something_else() {
        let mut buildings = row_of_two();
        let at = Placement { origin: DVec2::new(565_100.0, 5_932_000.0), angle_rad: 0.0 };
        let form = form::gable(Rect::sized(0.0, 0.0, 8.0, 10.0), 5.0, 8.0);
        let kind = BuildingKind::RowHouse;
        buildings.push(SimulatedBuilding::raise(&form, &at, &Terrain::Constant(3.0), kind, "c".into()));
        let errors = ErrorConfig { building_m: 0.7, ..ErrorConfig::default() };
        let off: Vec<DVec2> = footprints(&buildings, &errors, 1)
            .iter()
            .zip(&buildings)
            .map(|(off, building)| open_ring(off.exterior())[0] - open_ring(building.footprint.exterior())[0])
            .collect();
        assert!(off[0].distance(off[1]) < 1e-6 && off[0].distance(off[2]) > 0.1, "{off:?}");
        assert!(off.iter().all(|off| off.length() > 0.01 && off.length() < 3.0), "{off:?}");
    }

    #[test]
    fn a_courtyard_shrinks_as_its_building_grows() {
        let at = Placement { origin: DVec2::ZERO, angle_rad: 0.0 };
        let form = form::courtyard(Rect::sized(0.0, 0.0, 40.0, 30.0), 10.0, 12.0, 12.0);
        let block = SimulatedBuilding::raise(&form, &at, &Terrain::Constant(0.0), BuildingKind::Courtyard, "a".into());
        let errors = ErrorConfig { footprint_m: 0.2, ..ErrorConfig::default() };
        let grown = &footprints(&[block], &errors, 1)[0];
        assert!((grown.unsigned_area() - (40.4 * 30.4 - 19.6 * 9.6)).abs() < 1e-6);
    }

    #[test]
    fn poses_move_and_turn_by_as_much_as_stated() {
        let pose = crate::simulate::pose(DVec3::new(565_000.0, 5_932_000.0, 170.0), 0.3, 0.7);
        let camera = std::sync::Arc::new(sizeup_heights::camera::Camera::pinhole(100, 80, 90.0));
        let view = View { id: "a.jpg".into(), camera, camera_from_map: pose, image: None };
        let views = vec![view; 3000];
        let errors = ErrorConfig { position_m: 0.05, angle_deg: 0.05, ..ErrorConfig::default() };
        let moved = poses(&views, &errors, 3);
        let of = |f: &dyn Fn(&View) -> f64| mean(&moved.iter().map(f).collect::<Vec<_>>()).unwrap().sqrt();
        let shift = of(&|v| (v.camera_from_map.centre() - pose.centre()).length_squared() / 3.0);
        let turn = of(&|v| {
            let turn = v.camera_from_map.rotation * pose.rotation.transpose();
            (0.5 * (turn.col(0).x + turn.col(1).y + turn.col(2).z - 1.0)).clamp(-1.0, 1.0).acos().powi(2) / 3.0
        });
        assert!((shift - 0.05).abs() < 0.002, "{shift}");
        assert!((turn.to_degrees() - 0.05).abs() < 0.002, "{}", turn.to_degrees());
    }
}
