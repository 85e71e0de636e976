//! The scene as triangles in the `Local` frame (`f32`, metres), and rays against it.
//!
//! Ground and things on it are kept apart, so that the ground *behind* a building can be asked for as well: priors
//! need it, because a building's relief counts from there.

use glam::{DVec3, Vec3};

use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::ids::BuildingIdx;
use sizeup_heights::ray::{Aabb, Ray};
use sizeup_heights::render::bvh::Bvh;

use super::building::RoofOrWall;
use super::clutter::{ClutterTriangle, Stuff};
use super::ground::SimulatedGround;
use super::town::SimulatedTown;

/// Hits nearer than this are the surface that the ray left, metres along a unit direction.
const NEAREST: f32 = 1e-3;
/// Half-width of the seam between triangles, in barycentric units: no ray slips through.
const SEAM: f32 = 1e-5;

/// Object that a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeenObject {
    /// The sky: the ray meets nothing.
    Sky,
    /// The terrain at the pixel.
    Ground,
    /// A tree or a car.
    Clutter,
    /// A building of the scene.
    Building(BuildingIdx),
}

/// Material of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Material {
    Ground,
    Roof(BuildingIdx),
    Wall(BuildingIdx),
    Clutter(Stuff, u32),
}

/// Appearance of a triangle from outside.
#[derive(Debug, Clone, Copy)]
pub(super) struct TriangleSurface {
    /// Unit length, counter-clockwise rule.
    pub normal: Vec3,
    pub material: Material,
}

impl TriangleSurface {
    pub fn seen(&self) -> SeenObject {
        match self.material {
            Material::Ground => SeenObject::Ground,
            Material::Roof(b) | Material::Wall(b) => SeenObject::Building(b),
            Material::Clutter(..) => SeenObject::Clutter,
        }
    }
}

/// Point where a ray meets a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfaceHit {
    /// Ray parameter: z-depth for camera rays, metres.
    pub t: f32,
    pub surface: TriangleSurface,
}

/// Triangles with a hierarchy over them.
#[derive(Debug)]
struct TracedMesh {
    /// One corner and the edges to the other two.
    triangles: Vec<[Vec3; 3]>,
    surfaces: Vec<TriangleSurface>,
    bvh: Bvh,
}

impl TracedMesh {
    fn new(corners: &[([Vec3; 3], Material)]) -> Self {
        let boxes: Vec<Aabb> = corners.iter().map(|(c, _)| Aabb::around(*c)).collect();
        let surface = |&([a, b, c], material): &([Vec3; 3], Material)| TriangleSurface {
            normal: (b - a).cross(c - a).normalize_or_zero(),
            material,
        };
        Self {
            triangles: corners.iter().map(|&([a, b, c], _)| [a, b - a, c - a]).collect(),
            surfaces: corners.iter().map(surface).collect(),
            bvh: Bvh::build(&boxes),
        }
    }

    fn nearest(&self, ray: &Ray, t_max: f32) -> Option<(f32, usize)> {
        let mut found = None;
        self.bvh.traverse(ray, t_max, |i, t_max| match crossing(ray, &self.triangles[i], t_max) {
            Some(t) => {
                found = Some((t, i));
                t
            }
            None => t_max,
        });
        found
    }

    fn blocks(&self, ray: &Ray) -> bool {
        let mut blocked = false;
        self.bvh.traverse(ray, f32::MAX, |i, t_max| {
            blocked |= crossing(ray, &self.triangles[i], t_max).is_some();
            if blocked { 0.0 } else { t_max }
        });
        blocked
    }
}

/// Möller and Trumbore (1997), both sides.
pub(super) fn crossing(ray: &Ray, [corner, edge1, edge2]: &[Vec3; 3], t_max: f32) -> Option<f32> {
    let p = ray.direction.cross(*edge2);
    let determinant = edge1.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let s = ray.origin - *corner;
    let u = s.dot(p) * inverse;
    if !(-SEAM..=1.0 + SEAM).contains(&u) {
        return None;
    }
    let q = s.cross(*edge1);
    let v = ray.direction.dot(q) * inverse;
    if v < -SEAM || u + v > 1.0 + SEAM {
        return None;
    }
    let t = edge2.dot(q) * inverse;
    (t > NEAREST && t < t_max).then_some(t)
}

/// Everything a ray can meet.
#[derive(Debug)]
pub(super) struct TracedScene {
    /// Origin of the `Local` frame.
    pub origin: LocalOrigin,
    ground: SimulatedGround,
    things: TracedMesh,
    /// One around every building, tree and car.
    boxes: Vec<Aabb>,
}

impl TracedScene {
    pub fn new(world: &SimulatedTown, clutter: &[ClutterTriangle]) -> Self {
        let centre = world.extent.centre();
        let origin = LocalOrigin(DVec3::new(centre.x.round(), centre.y.round(), 0.0));
        let local = |p: DVec3| (p - origin.0).as_vec3();
        let mut things = Vec::new();
        let mut boxes: Vec<Aabb> = world
            .buildings
            .iter()
            .map(|b| Aabb::around(b.triangles.iter().flat_map(|t| t.corners).map(local)))
            .collect();
        let of_one = clutter.chunk_by(|a, b| a.owner == b.owner);
        boxes.extend(of_one.map(|pieces| Aabb::around(pieces.iter().flat_map(|p| p.corners).map(local))));
        for (i, building) in world.buildings.iter().enumerate() {
            let idx = BuildingIdx::new(i);
            things.extend(building.triangles.iter().map(|t| {
                let material = if t.part == RoofOrWall::Roof { Material::Roof(idx) } else { Material::Wall(idx) };
                (t.corners.map(local), material)
            }));
        }
        things.extend(clutter.iter().map(|p| (p.corners.map(local), Material::Clutter(p.stuff, p.owner))));
        Self { origin, ground: SimulatedGround::new(&world.terrain, origin.0), things: TracedMesh::new(&things), boxes }
    }

    /// One box around every building, tree and car.
    pub fn boxes(&self) -> impl Iterator<Item = &Aabb> {
        self.boxes.iter()
    }

    /// Triangles of buildings and clutter.
    pub fn n_triangles(&self) -> usize {
        self.things.triangles.len()
    }

    /// Point where a ray meets the ground, whatever stands in front of it.
    pub fn ground_hit(&self, ray: &Ray) -> Option<SurfaceHit> {
        let (t, normal) = self.ground.nearest(ray, f32::MAX)?;
        Some(SurfaceHit { t, surface: TriangleSurface { normal, material: Material::Ground } })
    }

    /// First hit of a ray, given where it meets the ground.
    pub fn first_hit(&self, ray: &Ray, ground: Option<SurfaceHit>) -> Option<SurfaceHit> {
        let t_max = ground.map_or(f32::MAX, |hit| hit.t);
        match self.things.nearest(ray, t_max) {
            Some((t, i)) => Some(SurfaceHit { t, surface: self.things.surfaces[i] }),
            None => ground,
        }
    }

    /// Whether something stands in the way; the ground does not count.
    pub fn is_shaded(&self, from: Vec3, towards: Vec3) -> bool {
        self.things.blocks(&Ray::new(from, towards))
    }

    /// Whether anything, ground included, lies between two points, the last 5 cm excepted.
    pub fn is_hidden(&self, from: Vec3, to: Vec3) -> bool {
        let way = to - from;
        let ray = Ray::new(from, way);
        let t_max = 1.0 - 0.05 / way.length();
        self.things.nearest(&ray, t_max).is_some() || self.ground.nearest(&ray, t_max).is_some()
    }
}
