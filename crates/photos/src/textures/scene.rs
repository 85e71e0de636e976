//! Surfaces and terrain that hide each other: which is met first by a ray, and whether a camera sees a point.

use glam::{DVec3, Vec2, Vec3};

use super::{Surface, SurfaceKind};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::ray::{Aabb, Ray};
use sizeup_heights::render::bvh::Bvh;
use sizeup_heights::scene::LocalGround;

/// Boxes reach so far beyond their surface, metres: more than rays are rounded by within kilometres.
const BOX_MARGIN_M: f32 = 0.01;
/// Points are looked at from so far in front of their surface, metres: walls no farther apart than this stand against each other, as in the party
/// walls of the results.
pub(super) const LIFT_M: f32 = 0.1;

/// A surface in its own plane.
#[derive(Debug, Clone)]
pub(super) struct Facet {
    pub building: usize,
    pub kind: SurfaceKind,
    /// A corner of it, local frame.
    pub origin: Vec3,
    /// Unit vectors: outward normal, and two in the plane; on walls `right` is level and `up` goes up.
    pub normal: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    /// Corners in the plane, metres along `right` and `up`.
    pub rings: Vec<Vec<Vec2>>,
}

impl Facet {
    fn new(surface: &Surface, origin: LocalOrigin) -> Self {
        let local = |p: &DVec3| (*p - origin.0).as_vec3();
        let exterior: Vec<Vec3> = surface.rings.first().map_or_else(Vec::new, |ring| ring.iter().map(local).collect());
        let corner = exterior.first().copied().unwrap_or(Vec3::ZERO);
        // Newell's normal: twice the area, whatever the form.
        let edges = || exterior.iter().zip(exterior.iter().cycle().skip(1)).map(|(a, b)| (*a - corner, *b - corner));
        let normal = edges().map(|(a, b)| a.cross(b)).sum::<Vec3>().normalize_or(Vec3::Z);
        let longest = edges().map(|(a, b)| b - a).max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        let right = match surface.kind {
            SurfaceKind::Wall => Vec3::Z.cross(normal),
            SurfaceKind::Roof | SurfaceKind::Ground => longest.unwrap_or(Vec3::X),
        };
        let right = (right - right.dot(normal) * normal).normalize_or(normal.any_orthonormal_vector());
        let up = normal.cross(right);
        let in_plane = |p: &DVec3| {
            let off = local(p) - corner;
            Vec2::new(off.dot(right), off.dot(up))
        };
        let rings = surface.rings.iter().map(|ring| ring.iter().map(in_plane).collect()).collect();
        Self { building: surface.building, kind: surface.kind, origin: corner, normal, right, up, rings }
    }

    /// A place in the plane as a point, local frame.
    pub fn point(&self, at: Vec2) -> Vec3 {
        self.origin + at.x * self.right + at.y * self.up
    }

    /// A point's place in the plane.
    pub fn place(&self, point: Vec3) -> Vec2 {
        let off = point - self.origin;
        Vec2::new(off.dot(self.right), off.dot(self.up))
    }

    /// Whether a place is on the surface (even-odd rule).
    pub fn contains(&self, at: Vec2) -> bool {
        let crosses = |(a, b): (&Vec2, &Vec2)| {
            (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
        };
        let edges = self.rings.iter().flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
        edges.filter(|edge| crosses(*edge)).count() % 2 == 1
    }

    /// The same for places on one level line, from left to right: each edge is met once.
    pub fn contains_each(&self, places: Vec<Vec2>) -> Vec<bool> {
        let Some(y) = places.first().map(|at| at.y) else { return Vec::new() };
        let edges = self.rings.iter().flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
        let met = edges.filter(|(a, b)| (a.y > y) != (b.y > y));
        let mut crossings: Vec<f32> = met.map(|(a, b)| a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x)).collect();
        crossings.sort_unstable_by(f32::total_cmp);
        let mut n_passed = 0;
        let is_within = |at: Vec2| {
            while crossings.get(n_passed).is_some_and(|x| at.x >= *x) {
                n_passed += 1;
            }
            (crossings.len() - n_passed) % 2 == 1
        };
        places.into_iter().map(is_within).collect()
    }

    /// Lowest and highest place along both axes.
    pub fn bounds(&self) -> (Vec2, Vec2) {
        let all = || self.rings.iter().flatten().copied();
        (all().fold(Vec2::INFINITY, Vec2::min), all().fold(Vec2::NEG_INFINITY, Vec2::max))
    }

    /// Ray parameter at which a ray meets the surface, from either side.
    fn meets(&self, ray: &Ray) -> Option<f32> {
        let slope = ray.direction.dot(self.normal);
        let t = (self.origin - ray.origin).dot(self.normal) / slope;
        (slope != 0.0 && t > 0.0 && self.contains(self.place(ray.at(t)))).then_some(t)
    }
}

/// Surfaces of all buildings and the ground, ready for rays.
pub struct SurfaceScene {
    pub(super) facets: Vec<Facet>,
    bvh: Bvh,
    ground: LocalGround,
}

impl SurfaceScene {
    /// Scene of some surfaces over the ground, in a local frame.
    #[must_use]
    pub fn new(surfaces: &[Surface], ground: LocalGround, origin: LocalOrigin) -> Self {
        let facets: Vec<Facet> = surfaces.iter().map(|surface| Facet::new(surface, origin)).collect();
        let boxed = |facet: &Facet| {
            let corners = facet.rings.iter().flatten().map(|at| facet.point(*at));
            let Aabb { min, max } = Aabb::around(corners);
            Aabb { min: min - BOX_MARGIN_M, max: max + BOX_MARGIN_M }
        };
        let boxes: Vec<Aabb> = facets.iter().map(boxed).collect();
        Self { facets, bvh: Bvh::build(&boxes), ground }
    }

    /// The surface that a ray meets first before it meets the ground, and at which parameter.
    #[must_use]
    pub fn first(&self, ray: &Ray) -> Option<(usize, f32)> {
        let mut nearest = None;
        let ground = self.ground.meets(ray).unwrap_or(f32::INFINITY);
        self.bvh.traverse(ray, ground, |i, t_max| match self.facets[i].meets(ray) {
            Some(t) if t < t_max => {
                nearest = Some((i, t));
                t
            }
            _ => t_max,
        });
        nearest
    }

    /// Whether nothing stands between an eye and a point, both in the local frame.
    #[must_use]
    pub fn is_seen(&self, eye: Vec3, point: Vec3) -> bool {
        let ray = Ray::new(eye, point - eye);
        if self.ground.meets(&ray).is_some_and(|t| t < 1.0) {
            return false;
        }
        let mut is_free = true;
        self.bvh.traverse(&ray, 1.0, |i, t_max| {
            let is_hit = self.facets[i].meets(&ray).is_some_and(|t| t < 1.0);
            is_free &= !is_hit;
            if is_hit { 0.0 } else { t_max }
        });
        is_free
    }

    /// Whether a point in front of a building's surface is inside another building: the first surface above it is seen from within.
    pub(super) fn is_inside_neighbour(&self, point: Vec3, own: usize) -> bool {
        // A little aslant, so that it does not run along a wall.
        let ray = Ray::new(point, Vec3::new(0.003, 0.002, 1.0));
        let mut first: Option<(f32, bool)> = None;
        self.bvh.traverse(&ray, f32::INFINITY, |i, t_max| {
            let facet = &self.facets[i];
            match facet.meets(&ray).filter(|t| facet.building != own && *t < t_max) {
                Some(t) => {
                    first = Some((t, facet.normal.dot(ray.direction) > 0.0));
                    t
                }
                None => t_max,
            }
        });
        first.is_some_and(|(_, is_within)| is_within)
    }
}
