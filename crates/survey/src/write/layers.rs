//! GIS layers: camera points, view axes to the ground, image footprints on the ground below each camera.
//!
//! `GeoJSON` is in longitude and latitude, as its standard wants; `GeoPackage` in the project's CRS.

use std::path::Path;

use glam::{DVec2, DVec3};
use serde_json::{Value, json};

use super::Converted;
use crate::angles::opk_deg;
use crate::{Survey, SurveyError, View, ViewKind, ground};
use sizeup_geo::crs::{Crs, CrsError, Transform};
use sizeup_geo::files::{write_whole, write_whole_by_name};
use sizeup_geo::geodata::view_layers::{self, Attributes, Layer, Shape};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::Terrain;

/// Decimals of a degree in `GeoJSON`: 1e-9° is 0.1 mm.
const DEGREE_DECIMALS: f64 = 1e9;

/// The three layers in the project's CRS.
fn layers(survey: &Survey, terrain: &Terrain) -> Vec<Layer> {
    let mut cameras = Layer::new("camera_points");
    let mut axes = Layer::new("view_axes");
    let mut footprints = Layer::new("image_footprints");
    let fallback_m = terrain.range().map_or(0.0, |(low_m, high_m)| 0.5 * (low_m + high_m));
    for view in &survey.views {
        let centre = view.camera_from_map.centre();
        let attributes = attributes(view);
        cameras.features.push((Shape::Point(centre), attributes.clone()));
        if let Some(end) = ground::centre_on_ground(view, terrain) {
            let end_m = terrain.height_at(end.x, end.y).unwrap_or(fallback_m);
            axes.features.push((Shape::Line(vec![centre, end.extend(end_m)]), attributes.clone()));
        }
        let ground_m = terrain.height_at(centre.x, centre.y).unwrap_or(fallback_m);
        let ring = ground::outline(view, ground_m);
        if ring.len() > 2 {
            footprints
                .features
                .push((Shape::Polygon(ring.iter().map(|p: &DVec2| p.extend(ground_m)).collect()), attributes));
        }
    }
    vec![cameras, axes, footprints]
}

fn attributes(view: &View) -> Attributes {
    let [omega_deg, phi_deg, kappa_deg] = opk_deg(view.camera_from_map.rotation);
    let axis = view.axis_in_map();
    Attributes {
        name: view.id.0.clone(),
        kind: if view.kind() == ViewKind::Nadir { "nadir" } else { "oblique" },
        numbers: vec![
            ("off_nadir_deg", view.off_nadir_deg()),
            ("azimuth_deg", axis.x.atan2(axis.y).to_degrees().rem_euclid(360.0)),
            ("omega_deg", omega_deg),
            ("phi_deg", phi_deg),
            ("kappa_deg", kappa_deg),
        ],
    }
}

pub(super) fn write_geopackage(
    survey: &Survey,
    project_crs: &Crs,
    terrain: &Terrain,
    path: &Path,
) -> Result<Converted, SurveyError> {
    let layers = layers(survey, terrain);
    write_whole_by_name(path, |temporary| -> Result<(), SurveyError> {
        view_layers::write_geopackage(&layers, project_crs.definition(), temporary)
            .map_err(|e| SurveyError::config(format!("cannot write {}: {e}", path.display()), ""))
    })?;
    Ok(Converted { files: vec![path.to_owned()], issues: Vec::new() })
}

pub(super) fn write_geojson(
    survey: &Survey,
    project_crs: &Crs,
    terrain: &Terrain,
    folder: &Path,
) -> Result<Converted, SurveyError> {
    // `survey.geojson` names a folder `survey`: three layers do not fit one file.
    let folder = folder.with_extension("");
    let mut converted = Converted::default();
    let lonlat_from_map = if let Ok(transform) = Transform::new(project_crs, &Crs::parse("EPSG:4326")?) {
        transform
    } else {
        let base = project_crs.geographic_base()?;
        let message = format!("no accurate way from {project_crs} to WGS 84: longitudes and latitudes are in {base}");
        let subject = Subject::Input(folder.display().to_string());
        converted.issues.push(Issue::new(Severity::Warning, "geojson_datum", subject, message));
        Transform::new(project_crs, &base)?
    };
    for layer in layers(survey, terrain) {
        let features: Result<Vec<Value>, CrsError> =
            layer.features.iter().map(|(shape, attributes)| feature(shape, attributes, &lonlat_from_map)).collect();
        let collection = json!({ "type": "FeatureCollection", "name": layer.name, "features": features? });
        let path = folder.join(layer.name).with_extension("geojson");
        write_whole(&path, |file| {
            serde_json::to_writer(&mut *file, &collection)?;
            writeln!(file)
        })?;
        converted.files.push(path);
    }
    Ok(converted)
}

fn feature(shape: &Shape, attributes: &Attributes, lonlat_from_map: &Transform) -> Result<Value, CrsError> {
    let position = |p: &DVec3| -> Result<Value, CrsError> {
        let (lon_deg, lat_deg) = lonlat_from_map.point(p.x, p.y)?;
        let rounded = |degrees: f64| (degrees * DEGREE_DECIMALS).round() / DEGREE_DECIMALS;
        Ok(json!([rounded(lon_deg), rounded(lat_deg), (p.z * 1e4).round() / 1e4]))
    };
    let positions = |points: &[DVec3]| points.iter().map(position).collect::<Result<Vec<Value>, CrsError>>();
    let geometry = match shape {
        Shape::Point(p) => json!({ "type": "Point", "coordinates": position(p)? }),
        Shape::Line(points) => json!({ "type": "LineString", "coordinates": positions(points)? }),
        Shape::Polygon(ring) => {
            let mut ring = positions(ring)?;
            ring.extend(ring.first().cloned());
            // RFC 7946: outer rings run counterclockwise; an image's outline seen from above runs clockwise.
            ring.reverse();
            json!({ "type": "Polygon", "coordinates": [ring] })
        }
    };
    let mut properties = serde_json::Map::new();
    properties.insert("name".to_owned(), attributes.name.clone().into());
    properties.insert("kind".to_owned(), attributes.kind.into());
    for (name, number) in &attributes.numbers {
        properties.insert((*name).to_owned(), (*number).into());
    }
    Ok(json!({ "type": "Feature", "properties": properties, "geometry": geometry }))
}
