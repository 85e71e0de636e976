//! What is wrong with poses and footprints as the user gets them; the truth stays clean.

use std::collections::BTreeSet;

use geo::Validation;
use geo_types::{LineString, Polygon};
use glam::{DMat3, DVec2, DVec3};

use crate::frames::Rigid;
use crate::seed;
use crate::survey::View;

use super::building::{Building, polygon};
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
/// corners move together, and outlines grow on free sides only. A footprint that would cross itself stays as it is.
#[must_use]
pub fn footprints(buildings: &[Building], errors: &ErrorConfig, root_seed: u64) -> Vec<Polygon<f64>> {
    let key = |p: DVec2| [p.x, p.y].map(|v| (v / SAME_CORNER_M).round() as i64);
    let rings = |b: &Building| -> Vec<Vec<DVec2>> {
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
    let disturb = |b: &Building| {
        let moved = rings(b).into_iter().map(|ring| {
            let offset = outlined(&ring, |a, b| if is_shared(a, b) { 0.0 } else { errors.outline_m });
            ring.iter().zip(offset).map(|(&p, grown)| grown + noise(p)).collect::<Vec<_>>()
        });
        let disturbed = polygon(moved);
        if disturbed.is_valid() { disturbed } else { b.footprint.clone() }
    };
    buildings.iter().map(disturb).collect()
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
fn outlined(ring: &[DVec2], distance_m: impl Fn(DVec2, DVec2) -> f64) -> Vec<DVec2> {
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
