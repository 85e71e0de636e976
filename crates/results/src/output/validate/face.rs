//! Checks of one face: its rings (1xx) and how they lie to each other (2xx).

use glam::DVec3;

use super::super::cityjson::read::CitySurface;
use super::super::planar::{cross, is_inside, segments_meet, twice_area};
use super::snap::Snapped;
use super::{Code, ValidateConfig};
use sizeup_geo::groups::Groups;
use sizeup_geo::triangles::triangulate;

/// Cells per snap tolerance when positions are rounded within a face.
const CELLS_PER_TOLERANCE: f64 = 10.0;

/// A face that passed the checks of its rings and its plane.
pub struct SoundFace {
    /// Surface of the shell.
    pub index: usize,
    /// Rings of indices into [`Snapped::points`], exterior first, not closed.
    pub rings: Vec<Vec<usize>>,
    /// Unit normal, towards the side from which the exterior ring is counter-clockwise.
    pub normal: DVec3,
    /// The axis that is dropped to look at it in a plane.
    pub dropped_axis: usize,
}

/// A fault of a face and where it is.
type FaceFault = (Code, [f64; 3]);

impl SoundFace {
    /// Checks a surface.
    ///
    /// # Errors
    /// The faults of the first level that has any.
    pub fn new(surface: &CitySurface, snapped: &Snapped, config: &ValidateConfig) -> Result<Self, Vec<FaceFault>> {
        let rings: Vec<Vec<usize>> =
            surface.rings.iter().map(|ring| ring.iter().map(|v| snapped.index(*v)).collect()).collect();
        sound(point_faults(&rings, snapped))?;
        let point = |i: usize| DVec3::from_array(snapped.points[i]);
        let area: DVec3 = newell(&rings[0], point);
        let normal = area.normalize_or_zero();
        let [x, y, z] = normal.abs().to_array();
        let dropped_axis = match (z >= x && z >= y, y >= x) {
            (true, _) => 2,
            (false, true) => 1,
            (false, false) => 0,
        };
        let flat: Vec<Vec<[i64; 2]>> =
            rings.iter().map(|ring| ring.iter().map(|&i| flatten(i, dropped_axis, snapped)).collect()).collect();
        let place = |ring: usize, position: usize| snapped.position(rings[ring][position]);

        sound(ring_faults(&flat, &place))?;
        sound(distance_faults(&rings, normal, snapped, config))?;
        sound(between_rings(&flat, &place))?;
        let face = Self { index: surface.place[2], rings, normal, dropped_axis };
        sound(face.turned_parts(&flat, snapped, config))?;
        Ok(face)
    }

    /// Triangles of the face as indices into [`Snapped::points`].
    fn triangles(&self, flat: &[Vec<[i64; 2]>]) -> Vec<[usize; 3]> {
        let corners: Vec<usize> = self.rings.iter().flatten().copied().collect();
        let rings = flat.iter().map(|ring| ring.iter().map(|p| p.map(|v| v as f64)));
        triangulate(rings).into_iter().map(|t| t.map(|i| corners[i])).collect()
    }

    /// 204: a triangle turned out of the face's plane.
    fn turned_parts(&self, flat: &[Vec<[i64; 2]>], snapped: &Snapped, config: &ValidateConfig) -> Vec<FaceFault> {
        let most_turned = config.planarity_normal_deg.to_radians();
        // A corner, and the edge opposite, are known to half the snap tolerance each: that alone may turn what is thinner.
        let least_thick_m = std::f64::consts::FRAC_1_SQRT_2 * config.snap_tolerance_m / most_turned.tan();
        let turned = self.triangles(flat).into_iter().find(|triangle| {
            let [a, b, c] = triangle.map(|i| DVec3::from_array(snapped.points[i]));
            let area = (b - a).cross(c - a);
            // The triangulation may turn either way round; only the plane counts.
            let longest_m = a.distance(b).max(b.distance(c)).max(c.distance(a));
            let is_turned = || area.normalize().dot(self.normal).abs() < most_turned.cos();
            area.length() > least_thick_m * longest_m && is_turned()
        });
        let fault = |t: [usize; 3]| (Code::NonPlanarPolygonNormalsDeviation, snapped.position(t[0]));
        turned.map(fault).into_iter().collect()
    }
}

fn sound(faults: Vec<FaceFault>) -> Result<(), Vec<FaceFault>> {
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}

/// A point of a face on an integer lattice in the plane of the two axes that are kept, their order chosen so that a
/// ring that is counter-clockwise along the dropped axis is so in the plane.
pub fn flatten(index: usize, dropped_axis: usize, snapped: &Snapped) -> [i64; 2] {
    let p = snapped.points[index].map(|v| (v / snapped.tolerance_m * CELLS_PER_TOLERANCE).round() as i64);
    [p[(dropped_axis + 1) % 3], p[(dropped_axis + 2) % 3]]
}

/// Twice the area vector of a ring.
pub fn newell(ring: &[usize], point: impl Fn(usize) -> DVec3) -> DVec3 {
    let origin = point(ring[0]);
    ring.windows(2).map(|edge| (point(edge[0]) - origin).cross(point(edge[1]) - origin)).sum()
}

/// 101, 102: counted on snapped vertices.
fn point_faults(rings: &[Vec<usize>], snapped: &Snapped) -> Vec<FaceFault> {
    let mut faults = Vec::new();
    if rings.is_empty() {
        faults.push((Code::TooFewPoints, snapped.origin));
    }
    for ring in rings {
        let mut distinct = ring.clone();
        distinct.sort_unstable();
        distinct.dedup();
        if distinct.len() < 3 {
            let at = ring.first().map_or(snapped.origin, |&i| snapped.position(i));
            faults.push((Code::TooFewPoints, at));
        } else if let Some(i) = (0..ring.len()).find(|&i| ring[i] == ring[(i + 1) % ring.len()]) {
            faults.push((Code::ConsecutivePointsSame, snapped.position(ring[i])));
        }
    }
    faults
}

/// 104: two edges that are not neighbours meet, or two neighbours turn straight back.
fn ring_faults(flat: &[Vec<[i64; 2]>], place: &impl Fn(usize, usize) -> [f64; 3]) -> Vec<FaceFault> {
    let first_fault = |(r, ring): (usize, &Vec<[i64; 2]>)| {
        let n = ring.len();
        let edge = |i: usize| [ring[i], ring[(i + 1) % n]];
        let meets = |i: usize, j: usize| {
            let are_neighbours = j - i == 1 || (i == 0 && j == n - 1);
            !are_neighbours && segments_meet(edge(i), edge(j))
        };
        let turns_back = |i: usize| {
            let [a, b] = edge(i);
            let c = ring[(i + 2) % n];
            cross(a, b, c) == 0 && (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1]) < 0
        };
        (0..n)
            .find(|&i| turns_back(i) || (i + 1..n).any(|j| meets(i, j)))
            .map(|i| (Code::RingSelfIntersection, place(r, i)))
    };
    flat.iter().enumerate().filter_map(first_fault).collect()
}

/// 203: the vertex farthest from the plane through the mean of the exterior ring.
fn distance_faults(rings: &[Vec<usize>], normal: DVec3, snapped: &Snapped, config: &ValidateConfig) -> Vec<FaceFault> {
    let point = |i: usize| DVec3::from_array(snapped.points[i]);
    let centre = rings[0].iter().map(|&i| point(i)).sum::<DVec3>() / rings[0].len() as f64;
    let distance = |i: usize| (point(i) - centre).dot(normal).abs();
    let farthest = rings.iter().flatten().copied().max_by(|a, b| distance(*a).total_cmp(&distance(*b)));
    let is_off = |i: &usize| distance(*i) > config.planarity_distance_m;
    let fault = |i: usize| (Code::NonPlanarPolygonDistancePlane, snapped.position(i));
    farthest.filter(is_off).map(fault).into_iter().collect()
}

/// 205: rings that touch each other in a circle, as two holes and the exterior in three points, cut the face in two.
fn cuts_interior(touches: &[(usize, [i64; 2])], n_rings: usize) -> bool {
    let mut incidences = touches.to_vec();
    incidences.sort_unstable();
    incidences.dedup();
    let mut points: Vec<[i64; 2]> = incidences.iter().map(|(_, point)| *point).collect();
    points.sort_unstable();
    points.dedup();
    let mut groups = Groups::new(n_rings + points.len());
    // A ring and a point that are joined already: a way round.
    !incidences
        .iter()
        .all(|(ring, point)| points.binary_search(point).is_ok_and(|position| groups.join(*ring, n_rings + position)))
}

/// 201, 202, 205–208: each hole against the exterior and the holes before it.
fn between_rings(flat: &[Vec<[i64; 2]>], place: &impl Fn(usize, usize) -> [f64; 3]) -> Vec<FaceFault> {
    let mut faults = Vec::new();
    let mut touches: Vec<(usize, [i64; 2])> = Vec::new();
    let exterior_turns = twice_area(&flat[0]).signum();
    for (h, hole) in flat.iter().enumerate().skip(1) {
        for (o, other) in flat.iter().enumerate().take(h) {
            let contact = Contact::between(hole, other);
            if let Contact::Touching(points) = &contact {
                touches.extend(points.iter().flat_map(|&point| [(h, point), (o, point)]));
            }
            let code = match contact {
                Contact::Same => Some(Code::DuplicatedRings),
                Contact::Crossing => Some(Code::IntersectionRings),
                Contact::Touching(points) if points.len() > 1 => Some(Code::PolygonInteriorDisconnected),
                Contact::Apart | Contact::Touching(_) => match (o, side(hole, other)) {
                    (0, RingSide::Outside) => Some(Code::InnerRingOutside),
                    (1.., RingSide::Inside) => Some(Code::InnerRingsNested),
                    (1.., _) if side(other, hole) == RingSide::Inside => Some(Code::InnerRingsNested),
                    _ => None,
                },
            };
            faults.extend(code.map(|code| (code, place(h, 0))));
        }
        if faults.is_empty() && twice_area(hole).signum() == exterior_turns {
            faults.push((Code::OrientationRingsSame, place(h, 0)));
        }
    }
    if faults.is_empty() && cuts_interior(&touches, flat.len()) {
        faults.push((Code::PolygonInteriorDisconnected, place(flat.len() - 1, 0)));
    }
    faults
}

/// Relation of two rings.
enum Contact {
    Apart,
    /// In these points, without crossing.
    Touching(Vec<[i64; 2]>),
    /// They cross, or share a piece of an edge.
    Crossing,
    /// They have the same points.
    Same,
}

impl Contact {
    fn between(a: &[[i64; 2]], b: &[[i64; 2]]) -> Self {
        let sorted = |ring: &[[i64; 2]]| {
            let mut points = ring.to_vec();
            points.sort_unstable();
            points
        };
        if sorted(a) == sorted(b) {
            return Self::Same;
        }
        let mut touches: Vec<[i64; 2]> = Vec::new();
        for (i, &a0) in a.iter().enumerate() {
            let edge_a = [a0, a[(i + 1) % a.len()]];
            for (j, &b0) in b.iter().enumerate() {
                let edge_b = [b0, b[(j + 1) % b.len()]];
                if !segments_meet(edge_a, edge_b) {
                    continue;
                }
                let on_b = edge_a.iter().filter(|p| cross(edge_b[0], edge_b[1], **p) == 0 && is_between(**p, edge_b));
                let on_a = edge_b.iter().filter(|p| cross(edge_a[0], edge_a[1], **p) == 0 && is_between(**p, edge_a));
                let mut shared: Vec<[i64; 2]> = on_b.chain(on_a).copied().collect();
                shared.sort_unstable();
                shared.dedup();
                if shared.len() != 1 {
                    // None: they cross in their interiors. Two: they lie on each other.
                    return Self::Crossing;
                }
                touches.extend(shared);
            }
        }
        touches.sort_unstable();
        touches.dedup();
        if touches.is_empty() {
            Self::Apart
        } else if side(a, b) == RingSide::Both {
            Self::Crossing
        } else {
            Self::Touching(touches)
        }
    }
}

fn is_between(p: [i64; 2], [a, b]: [[i64; 2]; 2]) -> bool {
    (0..2).all(|axis| p[axis] >= a[axis].min(b[axis]) && p[axis] <= a[axis].max(b[axis]))
}

/// On which side of a ring the points of another lie; points on the ring do not count.
#[derive(PartialEq, Eq)]
enum RingSide {
    Inside,
    Outside,
    Both,
}

fn side(ring: &[[i64; 2]], of: &[[i64; 2]]) -> RingSide {
    let is_on = |p: &[i64; 2]| {
        (0..of.len()).any(|i| {
            let edge = [of[i], of[(i + 1) % of.len()]];
            cross(edge[0], edge[1], *p) == 0 && is_between(*p, edge)
        })
    };
    let mut off_ring = ring.iter().filter(|p| !is_on(p)).map(|p| is_inside(*p, of));
    match off_ring.next() {
        None => RingSide::Inside,
        Some(first) if off_ring.all(|inside| inside == first) => {
            if first {
                RingSide::Inside
            } else {
                RingSide::Outside
            }
        }
        Some(_) => RingSide::Both,
    }
}
