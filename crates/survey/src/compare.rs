//! Image footprints against independent ground polygons: the only check that tells one downward-looking reading of the
//! angles from another.
//!
//! ```text
//! e(view) = max over the image's corners c of min over the polygon's corners p of |ground(c) − p|
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use geo_types::{Geometry, Polygon};
use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::ground::on_plane;
use super::report::Spread;
use super::{Survey, SurveyError, View};
use sizeup_geo::crs::{Crs, Transform};
use sizeup_geo::geodata::vector::{FeatureGeometry, VectorLayer};
use sizeup_geo::terrain::Terrain;

/// Places where photos are known to look, by their names, in the project's CRS.
#[derive(Debug, Clone, Default)]
pub struct GroundPolygons(BTreeMap<String, Vec<DVec2>>);

/// Distances of image corners on the ground from the polygons' corners.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CornerErrors {
    /// Views with a polygon.
    pub n_compared: usize,
    /// Views without a polygon.
    pub n_without_polygon: usize,
    /// Worst corners of these views, metres; absent without any.
    pub worst_corner_m: Option<Spread>,
    /// 99 % of the worst corners are nearer than this, metres.
    pub p99_m: Option<f64>,
}

impl GroundPolygons {
    /// Reads a layer of polygons whose attribute `id_field` holds the photos' names.
    ///
    /// # Errors
    /// [`SurveyError`] where the layer cannot be read, lacks the attribute, or its CRS cannot be reached.
    pub fn read(path: &Path, id_field: &str, project_crs: &Crs) -> Result<Self, SurveyError> {
        let refuse = |message: String| SurveyError::config(format!("{}: {message}", path.display()), "");
        let mut layer = VectorLayer::open(path, None).map_err(|e| refuse(e.to_string()))?;
        if !layer.field_names().any(|name| name == id_field) {
            let names: Vec<&str> = layer.field_names().collect();
            return Err(refuse(format!("no attribute {id_field:?}; it has {}", names.join(", "))));
        }
        let crs = layer.crs().map_err(|e| refuse(e.to_string()))?;
        let to_project = Transform::new(crs.as_ref().unwrap_or(project_crs), project_crs)?;
        let mut polygons = BTreeMap::new();
        for feature in layer.features() {
            let name = match feature.attributes.get(id_field) {
                Some(serde_json::Value::String(name)) => name.clone(),
                Some(value) => value.to_string(),
                None => continue,
            };
            let FeatureGeometry::Shape(shape) = feature.geometry else { continue };
            let Some(polygon) = polygon_of(shape) else { continue };
            let corners: Result<Vec<DVec2>, _> = polygon
                .exterior()
                .coords()
                .map(|corner| to_project.point(corner.x, corner.y).map(|(x, y)| DVec2::new(x, y)))
                .collect();
            polygons.insert(name, corners?);
        }
        Ok(Self(polygons))
    }

    /// Compares every view that has a polygon; the photo's folder does not matter.
    #[must_use]
    pub fn compare(&self, survey: &Survey, terrain: &Terrain) -> CornerErrors {
        let file_name = |view: &View| Path::new(&view.id.0).file_name().map(|name| name.to_string_lossy().into_owned());
        let found = |view: &View| self.0.get(&view.id.0).or_else(|| self.0.get(&file_name(view)?));
        let mut errors: Vec<f64> =
            survey.views.iter().filter_map(|view| worst_corner_m(view, found(view)?, terrain)).collect();
        errors.sort_by(f64::total_cmp);
        let p99 = errors.get((errors.len() * 99).div_ceil(100).saturating_sub(1));
        CornerErrors {
            n_compared: errors.len(),
            n_without_polygon: survey.views.len() - errors.len(),
            p99_m: p99.copied(),
            worst_corner_m: Spread::of(errors),
        }
    }
}

fn polygon_of(shape: Geometry) -> Option<Polygon> {
    match shape {
        Geometry::Polygon(polygon) => Some(polygon),
        Geometry::MultiPolygon(polygons) => polygons.0.into_iter().next(),
        _ => None,
    }
}

fn worst_corner_m(view: &View, polygon: &[DVec2], terrain: &Terrain) -> Option<f64> {
    let middle = polygon.iter().sum::<DVec2>() / polygon.len().max(1) as f64;
    let ground_m = terrain.height_at(middle.x, middle.y)?;
    let (w, h) = (f64::from(view.camera.width_px), f64::from(view.camera.height_px));
    [DVec2::ZERO, DVec2::new(w, 0.0), DVec2::new(w, h), DVec2::new(0.0, h)].into_iter().try_fold(0.0, |worst, pixel| {
        let corner = on_plane(view, pixel, ground_m)?;
        Some(polygon.iter().map(|p| p.distance(corner)).fold(f64::INFINITY, f64::min).max(worst))
    })
}

impl std::fmt::Display for CornerErrors {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Some(Spread { median, max, .. }) = self.worst_corner_m else {
            return writeln!(f, "No view has a ground polygon of its name.");
        };
        let p99_m = self.p99_m.unwrap_or(max);
        writeln!(
            f,
            "Worst corners of {} image footprints against the given polygons: median {median:.1} m, 99 % within \
             {p99_m:.1} m, all within {max:.1} m ({} views without a polygon)",
            self.n_compared, self.n_without_polygon
        )
    }
}
