//! From pixels to the ground: every corner's ray meets the terrain, lens distortion inverted.
//!
//! A footprint's standard deviation at a place, from what the survey is accurate to (all metres; `r`: distance to the
//! camera, `θ`: angle of the ray off the vertical, `g`: size of a pixel across the ray):
//!
//! ```text
//! σ² = (σ_mask · g / cos θ)² + σ_position² + (σ_angle · r / cos θ)² + (σ_terrain · tan θ)²
//! ```
//!
//! The last term is the same error for all views and only its direction differs: over views on all sides it cancels.

use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_geo::terrain::Terrain;
use sizeup_survey::View;

/// Standard deviation of a mask's border, pixels.
const MASK_PX: f64 = 0.7;
/// Standard deviation of the terrain's height, metres.
const TERRAIN_M: f64 = 0.2;

/// How accurate poses are: standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("x-expert" = true))]
pub struct InputAccuracy {
    /// Standard deviation of a camera's position, metres.
    pub position_m: f64,
    /// Standard deviation of a camera's attitude, degrees.
    pub angle_deg: f64,
}

impl Default for InputAccuracy {
    fn default() -> Self {
        Self { position_m: 0.05, angle_deg: 0.05 }
    }
}

/// Surface that footprints are laid on.
#[derive(Debug, Clone, Copy)]
pub(super) enum BaseSurface<'a> {
    /// The ground, as a terrain model has it.
    Terrain(&'a Terrain),
    /// A roof, metres in the project's vertical reference.
    Level(f64),
}

/// One view over a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projector<'a> {
    view: &'a View,
    surface: BaseSurface<'a>,
}

impl<'a> Projector<'a> {
    pub(super) fn new(view: &'a View, surface: BaseSurface<'a>) -> Self {
        Self { view, surface }
    }

    /// Point where a pixel's ray meets the surface.
    pub(super) fn point(&self, pixel: Coord<f64>) -> Option<DVec3> {
        let ray = self.view.camera.unproject(DVec2::new(pixel.x, pixel.y))?;
        let direction = self.view.camera_from_map.rotation.transpose() * ray;
        let centre = self.view.camera_from_map.centre();
        match self.surface {
            BaseSurface::Terrain(terrain) => terrain.meets(centre, direction),
            BaseSurface::Level(z) => Terrain::Constant(z).meets(centre, direction),
        }
    }

    /// A footprint on the surface, exteriors counter-clockwise; `None` if any corner meets nothing.
    pub(super) fn shape(&self, shape_px: &MultiPolygon<f64>) -> Option<MultiPolygon<f64>> {
        use geo::orient::{Direction, Orient as _};
        let ring = |ring: &LineString<f64>| -> Option<LineString<f64>> {
            ring.0
                .iter()
                .map(|&c| self.point(c).map(|p| Coord { x: p.x, y: p.y }))
                .collect::<Option<_>>()
                .map(LineString)
        };
        let polygon = |p: &Polygon<f64>| -> Option<Polygon<f64>> {
            Some(Polygon::new(ring(p.exterior())?, p.interiors().iter().map(ring).collect::<Option<_>>()?))
        };
        let polygons: Option<Vec<_>> = shape_px.0.iter().map(polygon).collect();
        Some(MultiPolygon::new(polygons?).orient(Direction::Default))
    }

    /// Part of the surface that the view sees: the border of its image, drawn in by some pixels. `None` if less than three
    /// points of it meet the surface.
    pub(super) fn seen(&self, inset_px: f64) -> Option<Polygon<f64>> {
        use geo::orient::{Direction, Orient as _};
        /// Points per side: distortion bends the border by less than a decimetre between them.
        const PER_SIDE: usize = 12;
        let (width, height) = (f64::from(self.view.camera.width_px), f64::from(self.view.camera.height_px));
        let (low, high) = ([inset_px; 2], [width - inset_px, height - inset_px]);
        let corners = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]];
        let border = (0..4 * PER_SIDE).map(|i| {
            let (a, b) = (corners[i / PER_SIDE], corners[(i / PER_SIDE + 1) % 4]);
            let t = (i % PER_SIDE) as f64 / PER_SIDE as f64;
            Coord { x: a[0] + t * (b[0] - a[0]), y: a[1] + t * (b[1] - a[1]) }
        });
        let on_ground: Vec<Coord<f64>> =
            border.filter_map(|c| self.point(c)).map(|p| Coord { x: p.x, y: p.y }).collect();
        (on_ground.len() >= 3).then(|| Polygon::new(LineString(on_ground), Vec::new()).orient(Direction::Default))
    }
}

/// The parts of a footprint's error at a place in a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlaceError {
    /// Variance of what differs from view to view, m².
    pub own_m2: f64,
    /// Shift of the place by one metre of terrain error, easting and northing.
    pub per_terrain_m: DVec2,
}

impl PlaceError {
    /// At a point seen by a view.
    pub(super) fn at(view: &View, point: DVec3, accuracy: &InputAccuracy) -> Self {
        let ray = point - view.camera_from_map.centre();
        let (across, down) = (ray.truncate(), -ray.z.min(-1e-6));
        let cos = down / ray.length();
        let depth = view.camera_from_map.point(point).z.max(0.0);
        let pixel_m = depth / view.camera.fx_px.min(view.camera.fy_px);
        let mask = MASK_PX * pixel_m / cos;
        let angle = accuracy.angle_deg.to_radians() * ray.length() / cos;
        Self { own_m2: mask * mask + accuracy.position_m.powi(2) + angle * angle, per_terrain_m: across / down }
    }

    /// Standard deviation of one view's footprint, metres.
    pub(super) fn sigma_m(&self) -> f64 {
        (self.own_m2 + TERRAIN_M.powi(2) * self.per_terrain_m.length_squared()).sqrt()
    }

    /// Standard deviation of the weighted mean of several views, metres.
    pub(super) fn joint_sigma_m(errors: &[Self]) -> f64 {
        let weight = |e: &Self| 1.0 / e.sigma_m().powi(2).max(1e-9);
        let total: f64 = errors.iter().map(weight).sum();
        let own: f64 = errors.iter().map(|e| weight(e).powi(2) * e.own_m2).sum::<f64>() / (total * total);
        let terrain = errors.iter().map(|e| weight(e) * e.per_terrain_m).sum::<DVec2>() / total;
        (own + TERRAIN_M.powi(2) * terrain.length_squared()).sqrt()
    }
}

/// Size of a pixel on the ground in the middle of a view, metres.
pub(super) fn ground_pixel_m(projector: &Projector<'_>, view: &View) -> Option<f64> {
    let (x, y) = (0.5 * f64::from(view.camera.width_px), 0.5 * f64::from(view.camera.height_px));
    let [a, b] = [0.0, 1.0].map(|d| projector.point(Coord { x: x + d, y }));
    Some((b? - a?).truncate().length())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use sizeup_heights::camera::{Camera, Distortion};
    use sizeup_heights::frames::Rigid;

    fn view(tilt_deg: f64) -> View {
        let camera = Camera {
            distortion: Distortion::Brown { k1: -0.08, k2: 0.02, k3: 0.0, p1: 1e-3, p2: -5e-4 },
            ..Camera::pinhole(600, 400, 500.0)
        };
        // Looks down, north up in the image, then tilted towards north.
        let down = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
        let rotation = DMat3::from_rotation_x(-f64::to_radians(tilt_deg)) * down;
        let centre = DVec3::new(500_000.0, 5_000_000.0, 170.0);
        View {
            id: "a.jpg".into(),
            camera: Arc::new(camera),
            camera_from_map: Rigid::from_rotation_and_centre(rotation, centre),
            image: None,
        }
    }

    #[test]
    fn what_is_projected_comes_back_to_its_pixel() {
        let terrain = Terrain::Constant(20.0);
        for tilt_deg in [0.0, 12.0] {
            let view = view(tilt_deg);
            let projector = Projector::new(&view, BaseSurface::Terrain(&terrain));
            for pixel in [Coord { x: 3.0, y: 5.0 }, Coord { x: 310.2, y: 77.7 }, Coord { x: 599.0, y: 399.0 }] {
                let point = projector.point(pixel).unwrap();
                let back = view.camera.project(view.camera_from_map.point(point)).unwrap();
                assert!((back - DVec2::new(pixel.x, pixel.y)).length() < 1e-6, "{tilt_deg} {back}");
            }
        }
    }

    #[test]
    fn terrain_error_cancels_between_views_on_both_sides_and_own_errors_average() {
        let error = |x: f64| PlaceError { own_m2: 0.04, per_terrain_m: DVec2::new(x, 0.0) };
        let both = PlaceError::joint_sigma_m(&[error(0.5), error(-0.5)]);
        assert!((both - (0.04_f64 / 2.0).sqrt()).abs() < 1e-12, "{both}");
        let same = PlaceError::joint_sigma_m(&[error(0.5), error(0.5)]);
        assert!((same - (0.02 + 0.01_f64).sqrt()).abs() < 1e-12, "{same}");
    }
}
