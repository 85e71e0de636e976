//! Checks of one shell (3xx) and of its direction (405).

use std::collections::{BTreeMap, HashMap};

use glam::DVec3;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::super::planar::{cross, is_inside};
use super::face::{SoundFace, flatten};
use super::snap::Snapped;
use super::{Code, Found};
use sizeup_geo::groups::Groups;

/// Fewest faces that enclose a volume.
const MIN_FACES: usize = 4;
/// Faces that come this near, in snap tolerances, touch: what is farther is how bent faces meet beside a long edge.
const TOUCHING: f64 = 0.01;

/// The uses of one undirected edge: face, and whether in the direction from the lower to the higher index.
type Uses = Vec<(usize, bool)>;

/// Checks a shell of sound faces; `shell_index` 0 is the outer shell of its solid.
pub fn check(faces: &[SoundFace], shell_index: usize, snapped: &Snapped) -> Vec<Found> {
    if faces.len() < MIN_FACES {
        return vec![Found { code: Code::TooFewPolygons, surface: None, position: None }];
    }
    let edges = edges(faces);
    let (crowded, other): (Vec<Found>, Vec<Found>) = edges
        .iter()
        .filter_map(|(edge, uses)| edge_fault(*edge, uses, faces, snapped))
        .partition(|found| found.code == Code::NonManifoldCase);
    // As val3dity has it: what hangs on by an edge or a vertex, or by nothing, is told before what is open.
    let mut found = crowded;
    if found.is_empty() {
        found.extend(vertex_faults(faces, snapped));
    }
    if found.is_empty() && n_components(faces.len(), &edges) > 1 {
        found.push(Found { code: Code::MultipleConnectedComponents, surface: None, position: None });
    }
    if found.is_empty() {
        found = other;
    }
    if found.is_empty() {
        found.extend(crossing_faces(faces, snapped));
    }
    if found.is_empty() {
        let is_outer = shell_index == 0;
        if (volume(faces, snapped) > 0.0) != is_outer {
            found.push(Found { code: Code::WrongOrientationShell, surface: None, position: None });
        }
    }
    found
}

fn edges(faces: &[SoundFace]) -> BTreeMap<[usize; 2], Uses> {
    let mut edges: BTreeMap<[usize; 2], Uses> = BTreeMap::new();
    for (f, face) in faces.iter().enumerate() {
        for [a, b] in face_edges(face) {
            edges.entry([a.min(b), a.max(b)]).or_default().push((f, a < b));
        }
    }
    edges
}

fn face_edges(face: &SoundFace) -> impl Iterator<Item = [usize; 2]> {
    face.rings.iter().flat_map(|ring| (0..ring.len()).map(move |i| [ring[i], ring[(i + 1) % ring.len()]]))
}

/// Fault of an edge: 302 (open), 303 or 307, by the faces that use it; `None` where it is sound.
fn edge_fault(edge: [usize; 2], uses: &Uses, faces: &[SoundFace], snapped: &Snapped) -> Option<Found> {
    let code = match uses.as_slice() {
        [_] => Code::ShellNotClosed,
        [(_, first), (_, second)] if first == second => Code::PolygonWrongOrientation,
        [_, _] => return None,
        _ => Code::NonManifoldCase,
    };
    let [a, b] = edge.map(|i| DVec3::from_array(snapped.position(i)));
    Some(Found { code, surface: Some(faces[uses[0].0].index), position: Some(((a + b) / 2.0).to_array()) })
}

/// 303: the corners of faces around a vertex fall into more than one fan. A face that meets the vertex twice has two corners
/// there.
fn vertex_faults(faces: &[SoundFace], snapped: &Snapped) -> Vec<Found> {
    // Face, and the neighbours of the vertex along its ring.
    let mut corners_at: BTreeMap<usize, Vec<(usize, [usize; 2])>> = BTreeMap::new();
    for (f, face) in faces.iter().enumerate() {
        for ring in &face.rings {
            for (i, &vertex) in ring.iter().enumerate() {
                let neighbours = [ring[(i + ring.len() - 1) % ring.len()], ring[(i + 1) % ring.len()]];
                corners_at.entry(vertex).or_default().push((f, neighbours));
            }
        }
    }
    let is_pinched = |corners: &[(usize, [usize; 2])]| {
        let mut groups = Groups::new(corners.len());
        let mut first_at: HashMap<usize, usize> = HashMap::new();
        for (c, (_, neighbours)) in corners.iter().enumerate() {
            for neighbour in neighbours {
                groups.join(c, *first_at.entry(*neighbour).or_insert(c));
            }
        }
        groups.count() > 1
    };
    corners_at
        .iter()
        .filter(|(_, corners)| is_pinched(corners))
        .map(|(vertex, corners)| Found {
            code: Code::NonManifoldCase,
            surface: Some(faces[corners[0].0].index),
            position: Some(snapped.position(*vertex)),
        })
        .collect()
}

fn n_components(n_faces: usize, edges: &BTreeMap<[usize; 2], Uses>) -> usize {
    let mut groups = Groups::new(n_faces);
    for uses in edges.values() {
        for pair in uses.windows(2) {
            groups.join(pair[0].0, pair[1].0);
        }
    }
    groups.count()
}

/// 306: an edge of one face pierces another face or lies in it, a vertex touches it, or two faces in one plane overlap.
fn crossing_faces(faces: &[SoundFace], snapped: &Snapped) -> Vec<Found> {
    let boxes = faces.iter().enumerate().map(|(f, face)| {
        let points = face.rings[0].iter().map(|&i| snapped.points[i]);
        GeomWithData::new(Rectangle::from_aabb(AABB::from_points(points.collect::<Vec<_>>().iter())), f)
    });
    let tree: RTree<_> = RTree::bulk_load(boxes.collect::<Vec<_>>());
    let mut found = Vec::new();
    for (f, face) in faces.iter().enumerate() {
        let points: Vec<[f64; 3]> = face.rings[0].iter().map(|&i| snapped.points[i]).collect();
        let mut near: Vec<usize> =
            tree.locate_in_envelope_intersecting(&AABB::from_points(points.iter())).map(|b| b.data).collect();
        near.sort_unstable();
        for other in near.into_iter().filter(|&o| o != f) {
            let other = &faces[other];
            let meeting = || piercing(face, other, snapped).or_else(|| touching(face, other, snapped));
            if let Some(at) = meeting().or_else(|| overlap(face, other, snapped)) {
                let position = std::array::from_fn(|axis| at[axis] + snapped.origin[axis]);
                found.push(Found {
                    code: Code::ShellSelfIntersection,
                    surface: Some(face.index),
                    position: Some(position),
                });
                break;
            }
        }
    }
    found
}

/// Point where an edge of `face` goes through the inside of `other`.
fn piercing(face: &SoundFace, other: &SoundFace, snapped: &Snapped) -> Option<DVec3> {
    let point = |i: usize| DVec3::from_array(snapped.points[i]);
    let on_plane = point(other.rings[0][0]);
    let above = |i: usize| (point(i) - on_plane).dot(other.normal);
    // A face need not be quite plane: what is no farther off than its own corners does not go through it.
    let bent_m = other.rings.iter().flatten().map(|&i| above(i).abs()).fold(0.0, f64::max);
    face_edges(face).find_map(|[a, b]| {
        let (above_a, above_b) = (above(a), above(b));
        let is_through = above_a * above_b < 0.0 && above_a.abs().min(above_b.abs()) > bent_m + snapped.tolerance_m;
        let at = point(a).lerp(point(b), above_a / (above_a - above_b));
        (is_through && is_within(at, other, snapped)).then_some(at)
    })
}

/// A corner of `face` inside `other`, or the middle of an edge that runs through it from border to border.
fn touching(face: &SoundFace, other: &SoundFace, snapped: &Snapped) -> Option<DVec3> {
    let point = |i: usize| DVec3::from_array(snapped.points[i]);
    let origin = point(other.rings[0][0]);
    let is_on_plane = |at: DVec3| (at - origin).dot(other.normal).abs() <= TOUCHING * snapped.tolerance_m;
    let is_in = |at: &DVec3| is_on_plane(*at) && is_within(*at, other, snapped);
    face_edges(face).find_map(|[a, b]| {
        let (a, b) = (point(a), point(b));
        Some(a).filter(is_in).or_else(|| Some(a.lerp(b, 0.5)).filter(|middle| is_on_plane(a) && is_in(middle)))
    })
}

/// Whether a point of a face's plane lies inside the face, farther than the tolerance from all its edges.
fn is_within(at: DVec3, face: &SoundFace, snapped: &Snapped) -> bool {
    let point = |i: usize| DVec3::from_array(snapped.points[i]);
    let is_near_edge = face_edges(face).any(|[a, b]| {
        let (a, along) = (point(a), point(b) - point(a));
        let t = ((at - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (at - (a + along * t)).length() <= snapped.tolerance_m
    });
    if is_near_edge {
        return false;
    }
    // The cell of the point on the face's lattice, by the same rounding.
    let cells = at.to_array().map(|v| (v / snapped.tolerance_m * 10.0).round() as i64);
    let flat = [cells[(face.dropped_axis + 1) % 3], cells[(face.dropped_axis + 2) % 3]];
    let ring = |ring: &Vec<usize>| ring.iter().map(|&i| flatten(i, face.dropped_axis, snapped)).collect::<Vec<_>>();
    face.rings.iter().filter(|r| is_inside(flat, &ring(r))).count() % 2 == 1
}

/// A point that two faces of one plane share.
fn overlap(face: &SoundFace, other: &SoundFace, snapped: &Snapped) -> Option<DVec3> {
    let point = |i: usize| DVec3::from_array(snapped.points[i]);
    let on_plane = point(other.rings[0][0]);
    // A face smaller than the tolerance lies near every plane through it.
    let is_coplanar =
        face.rings[0].iter().all(|&i| (point(i) - on_plane).dot(other.normal).abs() <= TOUCHING * snapped.tolerance_m);
    if !is_coplanar {
        return None;
    }
    let corner = face.rings.iter().flatten().map(|&i| point(i)).find(|p| is_within(*p, other, snapped));
    corner
        .or_else(|| {
            let flat = |i: usize| flatten(i, other.dropped_axis, snapped);
            let strictly = |a: [i64; 2], b: [i64; 2], c: [i64; 2], d: [i64; 2]| {
                cross(a, b, c).signum() * cross(a, b, d).signum() < 0
                    && cross(c, d, a).signum() * cross(c, d, b).signum() < 0
            };
            face_edges(face).find_map(|[a, b]| {
                face_edges(other).find(|[c, d]| strictly(flat(a), flat(b), flat(*c), flat(*d))).map(|[c, _]| point(c))
            })
        })
        .or_else(|| {
            // The same ring twice has neither inner corners nor crossings.
            let sorted = |f: &SoundFace| {
                let mut corners = f.rings[0].clone();
                corners.sort_unstable();
                corners
            };
            (sorted(face) == sorted(other)).then(|| point(face.rings[0][0]))
        })
}

/// Signed volume by the divergence theorem: positive if the faces look outwards.
fn volume(faces: &[SoundFace], snapped: &Snapped) -> f64 {
    let point = |i: usize| DVec3::from_array(snapped.points[i]);
    let ring_volume = |ring: &Vec<usize>| -> f64 {
        ring.windows(2).map(|edge| point(ring[0]).dot(point(edge[0]).cross(point(edge[1])))).sum::<f64>() / 6.0
    };
    faces.iter().flat_map(|face| &face.rings).map(ring_volume).sum()
}
