//! GIS layers: camera points, view axes to the ground, image footprints on the ground below each camera.
//!
//! `GeoJSON` is in longitude and latitude, as its standard wants; `GeoPackage` in the project's CRS.

use std::path::Path;

use glam::{DVec2, DVec3};

use super::Converted;
use crate::angles::opk_deg;
use crate::{Survey, SurveyError, View, ViewKind, ground};
use sizeup_geo::crs::{Crs, CrsError};
use sizeup_geo::files::write_whole_by_name;
use sizeup_geo::geodata::geojson::{self, Feature, GeometryValue, JsonObject, LonLat};
use sizeup_geo::geodata::view_layers::{self, Attributes, FeatureShape, Layer};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::Terrain;

/// The three layers in the project's CRS.
fn layers(survey: &Survey, terrain: &Terrain) -> Vec<Layer> {
    let mut cameras = Layer::new("camera_points");
    let mut axes = Layer::new("view_axes");
    let mut footprints = Layer::new("image_footprints");
    let fallback_m = terrain.range().map_or(0.0, |(low_m, high_m)| 0.5 * (low_m + high_m));
    for view in &survey.views {
        let centre = view.camera_from_map.centre();
        let attributes = attributes(view);
        cameras.features.push((FeatureShape::Point(centre), attributes.clone()));
        if let Some(end) = ground::centre_on_ground(view, terrain) {
            let end_m = terrain.height_at(end.x, end.y).unwrap_or(fallback_m);
            axes.features.push((FeatureShape::Line(vec![centre, end.extend(end_m)]), attributes.clone()));
        }
        let ground_m = terrain.height_at(centre.x, centre.y).unwrap_or(fallback_m);
        let ring = ground::footprint(view, ground_m);
        if ring.len() > 2 {
            footprints
                .features
                .push((FeatureShape::Polygon(ring.iter().map(|p: &DVec2| p.extend(ground_m)).collect()), attributes));
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
    let lonlat = if let Ok(lonlat) = LonLat::wgs84(project_crs) {
        lonlat
    } else {
        let base = project_crs.geographic_base()?;
        let message = format!("no accurate way from {project_crs} to WGS 84: longitudes and latitudes are in {base}");
        let subject = Subject::Input(folder.display().to_string());
        converted.issues.push(Issue::new(Severity::Warning, "geojson_datum", subject, message));
        LonLat::new(project_crs, &base)?
    };
    for layer in layers(survey, terrain) {
        let path = folder.join(layer.name).with_extension("geojson");
        let members = JsonObject::from_iter([("name".to_owned(), layer.name.into())]);
        geojson::write(&path, &members, |push| -> Result<(), SurveyError> {
            layer.features.iter().try_for_each(|(shape, attributes)| push(&feature(shape, attributes, &lonlat)?))
        })?;
        converted.files.push(path);
    }
    Ok(converted)
}

fn feature(shape: &FeatureShape, attributes: &Attributes, lonlat: &LonLat) -> Result<Feature, CrsError> {
    let places = |points: &[DVec3]| points.iter().map(DVec3::to_array).collect::<Vec<_>>();
    let geometry = match shape {
        FeatureShape::Point(place) => GeometryValue::Point { coordinates: lonlat.position(&place.to_array())? },
        FeatureShape::Line(points) => lonlat.line(places(points))?,
        FeatureShape::Polygon(ring) => lonlat.area(places(ring))?,
    };
    let numbers = attributes.numbers.iter().map(|(name, number)| ((*name).to_owned(), (*number).into()));
    let words = [("name".to_owned(), attributes.name.as_str().into()), ("kind".to_owned(), attributes.kind.into())];
    Ok(geojson::feature(None, Some(geometry), words.into_iter().chain(numbers).collect()))
}
