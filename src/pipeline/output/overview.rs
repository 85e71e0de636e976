//! The city from above and aside, drawn on the CPU: for print, for documents, and for browsers without WebGL.
//!
//! Each pixel is a ray into the scene; its colour is the building's height, shaded by how the face lies to the sun, and
//! darker where another ray towards the sun meets a building. Edges are where two neighbouring pixels show different faces;
//! those of doubtful buildings are orange.

use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use image::imageops::{FilterType, resize};
use image::{Rgb, RgbImage};
use rayon::prelude::*;

use sizeup_heights::camera::Camera;
use sizeup_heights::frames::{Map, Rigid};
use sizeup_heights::optimise::SolvedHeight;
use sizeup_heights::ray::{Aabb, Ray};
use sizeup_heights::render::PlacedCamera;
use sizeup_heights::render::image::{Face, SceneTracer};
use sizeup_heights::scene::Scene;
use sizeup_results::output::picture::colour::{self, ALERT, INK, NO_VALUE, WHITE, height_colour};

/// Size of the picture, and how much larger it is drawn before it is reduced.
const SIZE_PX: [u32; 2] = [1200, 720];
const OVERSAMPLING: f64 = 1.5;
/// Angle across the picture, and of the line of sight below the horizon, degrees.
const ACROSS_DEG: f64 = 36.0;
const DOWN_DEG: f64 = 36.0;
/// Bearing of the line of sight: towards the north-north-east, degrees.
const BEARING_DEG: f64 = 25.0;
/// Share of the city's ball that has to fit: its corners may be cut.
const FIT: f64 = 0.86;
/// Direction to the sun: in the west, so that walls to the south and to the west differ.
const SUN: Vec3 = Vec3::new(-0.73, 0.12, 0.67);
/// Light from the sky and from the sun.
const SKY: f32 = 0.5;
const SUNLIGHT: f32 = 0.5;
/// Shadow rays begin this far from the surface, metres.
const OFF_M: f32 = 0.05;
/// How dark edges are, and how strong those of doubtful buildings.
const EDGE: f32 = 0.6;
const ALERT_EDGE: f32 = 1.0;
/// Colour of the ground.
const GROUND: colour::Rgb = [236, 233, 226];
/// Distance over which the ground's slope is taken, metres.
const SLOPE_M: f32 = 2.0;

/// Content of a pixel: a colour, and which face, so that edges are found.
#[derive(Clone, Copy)]
struct PixelSight {
    colour: [f32; 3],
    /// Building, and which of its faces; `None` for ground and sky.
    face: Option<(u32, u32)>,
}

/// Draws a scene with its heights; buildings without one as low grey blocks.
pub(in crate::pipeline) fn draw(scene: &Scene, solved: &[SolvedHeight]) -> RgbImage {
    let heights_m: Vec<f32> = solved.iter().map(|s| s.height_m.map_or(scene.bounds.min_m, |h| h as f32)).collect();
    let colours = solved.iter().map(|s| s.height_m.map_or(NO_VALUE, height_colour)).collect();
    let is_doubtful = |face: Option<(u32, u32)>| {
        face.and_then(|(b, _)| solved.get(b as usize)).is_some_and(|s| s.height_m.is_some() && !s.reasons.is_empty())
    };
    let [width, height] = SIZE_PX.map(|n| (f64::from(n) * OVERSAMPLING) as u32);
    let placed = camera(scene, &heights_m, [width, height]);
    let painter = Painter { scene, tracer: SceneTracer::new(scene, &heights_m), colours };
    let rows: Vec<Vec<PixelSight>> = (0..height).into_par_iter().map(|y| painter.row(&placed, width, y)).collect();
    let sharp = RgbImage::from_fn(width, height, |x, y| {
        let (x, y) = (x as usize, y as usize);
        let here = rows[y][x];
        let beside = [rows[y].get(x + 1), rows.get(y + 1).and_then(|row| row.get(x))];
        let next = beside.into_iter().flatten().find(|next| next.face != here.face);
        let Some(next) = next else { return Rgb(here.colour.map(|v| v.round() as u8)) };
        // Edges of what is doubtful are in the colour of doubt.
        let (ink, share) =
            if is_doubtful(here.face) || is_doubtful(next.face) { (ALERT, ALERT_EDGE) } else { (INK, EDGE) };
        let drawn = |c: usize| here.colour[c] + (f32::from(ink[c]) - here.colour[c]) * share;
        Rgb(std::array::from_fn(|c| drawn(c).round() as u8))
    });
    resize(&sharp, SIZE_PX[0], SIZE_PX[1], FilterType::Triangle)
}

/// A camera that sees all buildings from the south-south-west.
fn camera(scene: &Scene, heights_m: &[f32], [width, height]: [u32; 2]) -> PlacedCamera {
    let boxes = scene.prisms.iter().zip(heights_m).map(|(p, h)| p.bounds_below(p.ground_z + h));
    let whole = boxes.fold(Aabb::EMPTY, Aabb::union);
    let (low, high) = if scene.prisms.is_empty() { (Vec3::ZERO, Vec3::ONE) } else { (whole.min, whole.max) };
    let centre = (0.5 * (low + high)).as_dvec3();
    let radius_m = 0.5 * f64::from((high - low).length()).max(20.0);
    let distance_m = FIT * radius_m / (0.5 * ACROSS_DEG.to_radians()).tan() + 0.5 * radius_m;
    let focal_px = 0.5 * f64::from(width) / (0.5 * ACROSS_DEG.to_radians()).tan();
    // Camera axes: x right, y down, z forward.
    let (sin, cos) = BEARING_DEG.to_radians().sin_cos();
    let (down, level) = DOWN_DEG.to_radians().sin_cos();
    let forward = DVec3::new(sin * level, cos * level, -down);
    let right = DVec3::new(cos, -sin, 0.0);
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let eye = scene.origin.0 + centre - distance_m * forward;
    let pose: Rigid<sizeup_heights::frames::Cam, Map> = Rigid::from_rotation_and_centre(rotation, eye);
    PlacedCamera::new(Camera::pinhole(width, height, focal_px), pose, scene.origin)
}

struct Painter<'a> {
    scene: &'a Scene,
    tracer: SceneTracer<'a>,
    colours: Vec<colour::Rgb>,
}

impl Painter<'_> {
    fn row(&self, placed: &PlacedCamera, width: u32, y: u32) -> Vec<PixelSight> {
        let mut scratch = Vec::new();
        let sky = PixelSight { colour: WHITE.map(f32::from), face: None };
        let at = |x: u32| {
            let ray = placed.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))?;
            let (t, face) = self.tracer.trace(&ray, &mut scratch);
            let point = ray.origin + t * ray.direction;
            let (colour, normal, face) = match face {
                Face::Nothing => return None,
                Face::Ground => (GROUND, self.slope(point), None),
                Face::Roof(b) => (self.colours[b.at()], Vec3::Z, Some((b.0, u32::MAX))),
                Face::Wall(b) => {
                    let (edge, normal) = self.wall(b.at(), point.truncate(), ray.direction.truncate());
                    (self.colours[b.at()], normal.extend(0.0), Some((b.0, edge)))
                }
            };
            let sun = normal.dot(SUN).max(0.0);
            let lit =
                if sun > 0.0 && !self.is_shaded(point + OFF_M * normal, &mut scratch) { sun / SUN.z } else { 0.0 };
            let light = (SKY + SUNLIGHT * lit).min(1.1);
            Some(PixelSight { colour: colour.map(|c| (f32::from(c) * light).min(255.0)), face })
        };
        (0..width).map(at).map(|sight| sight.unwrap_or(sky)).collect()
    }

    fn is_shaded(&self, point: Vec3, scratch: &mut Vec<sizeup_heights::scene::RayInterval>) -> bool {
        self.tracer.trace(&Ray::new(point, SUN), scratch).1.building().is_some()
    }

    /// Which wall a point lies on, and its normal against the line of sight.
    fn wall(&self, building: usize, point: Vec2, sight: Vec2) -> (u32, Vec2) {
        let away = |(a, b): (Vec2, Vec2)| {
            let along = b - a;
            let share = ((point - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
            (a + share * along).distance_squared(point)
        };
        let edges = (0_u32..).zip(self.scene.prisms[building].edges());
        let Some((i, (a, b))) = edges.min_by(|x, y| away(x.1).total_cmp(&away(y.1))) else { return (0, Vec2::X) };
        let normal = (b - a).perp().normalize_or(Vec2::X);
        (i, if normal.dot(sight) > 0.0 { -normal } else { normal })
    }

    fn slope(&self, point: Vec3) -> Vec3 {
        let z = |dx: f32, dy: f32| self.scene.ground.height_at(point.truncate() + Vec2::new(dx, dy));
        let normal = Vec3::new(z(-SLOPE_M, 0.0) - z(SLOPE_M, 0.0), z(0.0, -SLOPE_M) - z(0.0, SLOPE_M), 2.0 * SLOPE_M);
        if normal.is_finite() { normal.normalize() } else { Vec3::Z }
    }
}
