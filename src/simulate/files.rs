//! The scene in the formats a user would bring: COLMAP text, `GeoPackage`, GeoTIFF, `GeoJSON`, a run configuration.

use std::fmt::Write as _;
use std::path::Path;

use geo_types::Polygon;
use glam::{DQuat, DVec3};
use serde_json::{Value, json};

use crate::camera::{Camera, Distortion};
use crate::crs::Crs;
use crate::files::{FileError, write_whole, write_whole_unflushed};
use crate::geodata::{FieldType, GridPlace, LayerFeature, write_geotiff, write_polygon_layer};
use crate::prior::PriorKind;
use crate::raster::Raster;
use crate::survey::View;
use crate::terrain::Terrain;

use super::SimulateError;
use super::building::Building;
use super::config::SimulateConfig;
use super::tie_points::TiePoint;

/// DTM cells without a value.
const NODATA: f32 = -9999.0;

fn write_text(path: &Path, text: &str) -> Result<(), FileError> {
    write_whole(path, |w| w.write_all(text.as_bytes()))
}

/// The COLMAP text model: `camera_from_world` with the world's origin at `offset` in the map.
///
/// COLMAP's pixel convention is ours: the top-left pixel's centre is (0.5, 0.5).
pub(super) fn write_colmap(
    folder: &Path,
    views: &[View],
    offset: DVec3,
    points: &[TiePoint],
) -> Result<(), SimulateError> {
    let mut cameras: Vec<&Camera> = Vec::new();
    let mut images =
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n".to_owned();
    let mut sightings: Vec<Vec<(f64, f64, usize)>> = vec![Vec::new(); views.len()];
    let mut cloud = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n".to_owned();
    for (i, point) in points.iter().enumerate() {
        let p = point.position - offset;
        // Writing to a string cannot fail.
        let _ = write!(cloud, "{} {:.4} {:.4} {:.4} 128 128 128 {:.3}", i + 1, p.x, p.y, p.z, point.error_px);
        for (view, pixel) in &point.sightings {
            let _ = write!(cloud, " {} {}", view + 1, sightings[*view].len());
            sightings[*view].push((pixel.x, pixel.y, i + 1));
        }
        cloud.push('\n');
    }
    for (i, view) in views.iter().enumerate() {
        let known = cameras.iter().position(|c| **c == *view.camera);
        let camera_id = 1 + known.unwrap_or_else(|| {
            cameras.push(&view.camera);
            cameras.len() - 1
        });
        let pose = &view.camera_from_map;
        let q = DQuat::from_mat3(&pose.rotation).normalize();
        let t = -(pose.rotation * (pose.centre() - offset));
        let _ = writeln!(
            images,
            "{} {:.12} {:.12} {:.12} {:.12} {:.6} {:.6} {:.6} {camera_id} {}",
            i + 1,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z,
            view.id
        );
        let seen: Vec<String> = sightings[i].iter().map(|(x, y, id)| format!("{x:.3} {y:.3} {id}")).collect();
        let _ = writeln!(images, "{}", seen.join(" "));
    }
    let mut lenses = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n".to_owned();
    for (i, camera) in cameras.iter().enumerate() {
        let _ = writeln!(lenses, "{} {}", i + 1, colmap_camera(camera)?);
    }
    write_text(&folder.join("cameras.txt"), &lenses)?;
    write_text(&folder.join("images.txt"), &images)?;
    Ok(write_text(&folder.join("points3D.txt"), &cloud)?)
}

fn colmap_camera(c: &Camera) -> Result<String, SimulateError> {
    let (model, lens) = match c.distortion {
        Distortion::None => ("PINHOLE", String::new()),
        Distortion::Brown { k1, k2, k3: 0.0, p1, p2 } => ("OPENCV", format!(" {k1} {k2} {p1} {p2}")),
        Distortion::Brown { k1, k2, k3, p1, p2 } => ("FULL_OPENCV", format!(" {k1} {k2} {p1} {p2} {k3} 0 0 0")),
        ref other => {
            return Err(SimulateError::Setting {
                setting: "lens of the given views",
                found: format!("{other:?}"),
                expected: "a pinhole or Brown-Conrady lens",
            });
        }
    };
    Ok(format!("{model} {} {} {} {} {} {}{lens}", c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px))
}

/// The footprints as the user gets them: outlines, ids, types; no heights.
pub(super) fn write_footprints(
    path: &Path,
    crs: &Crs,
    buildings: &[Building],
    outlines: &[Polygon<f64>],
) -> Result<(), SimulateError> {
    let columns = [("id", FieldType::Text), ("type", FieldType::Text)];
    let features: Vec<LayerFeature> = buildings
        .iter()
        .zip(outlines)
        .map(|(b, polygon)| LayerFeature {
            polygon,
            texts: vec![b.id.to_string(), b.kind.as_str().to_owned()],
            numbers: Vec::new(),
        })
        .collect();
    Ok(write_polygon_layer(path, "footprints", crs, &columns, &features)?)
}

/// The DTM; nothing for constant ground.
pub(super) fn write_dtm(path: &Path, crs: &Crs, terrain: &Terrain) -> Result<(), SimulateError> {
    let Terrain::Grid(dem) = terrain else { return Ok(()) };
    let place = GridPlace { corner_m: dem.corner_m(), cell_m: dem.cell_m(), crs, nodata: NODATA };
    Ok(write_geotiff(path, dem.heights_m(), &place)?)
}

/// What is true of every building, as `GeoJSON` in the project's CRS (with the `crs` member of the 2008 draft, which
/// GDAL and QGIS still read).
pub(super) fn write_truth(path: &Path, crs: &Crs, buildings: &[Building]) -> Result<(), FileError> {
    let features: Vec<Value> = buildings.iter().map(truth_feature).collect();
    let mut collection = json!({ "type": "FeatureCollection", "name": "truth" });
    if let Some(code) = crs.epsg() {
        collection["crs"] =
            json!({ "type": "name", "properties": { "name": format!("urn:ogc:def:crs:EPSG::{code}") } });
    }
    collection["features"] = Value::Array(features);
    write_whole(path, |w| Ok(serde_json::to_writer(w, &collection)?))
}

fn truth_feature(b: &Building) -> Value {
    let millimetres = |v: f64| (v * 1e3).round() / 1e3;
    let ring = |r: &geo_types::LineString<f64>| -> Value {
        r.0.iter().map(|c| json!([millimetres(c.x), millimetres(c.y)])).collect()
    };
    let rings: Vec<Value> = std::iter::once(b.footprint.exterior()).chain(b.footprint.interiors()).map(ring).collect();
    json!({
        "type": "Feature",
        "properties": {
            "id": b.id.0,
            "height_m": millimetres(b.height_m),
            "eave_m": millimetres(b.eave_m),
            "ridge_m": millimetres(b.ridge_m),
            "ground_z_m": millimetres(b.ground_z_m),
            "roof": b.roof.as_str(),
            "type": b.kind.as_str(),
        },
        "geometry": { "type": "Polygon", "coordinates": rings },
    })
}

/// `H × W` values as `.npy`, 32-bit floats.
pub(super) fn write_npy(path: &Path, map: &Raster<f32>) -> Result<(), FileError> {
    use npyz::WriterBuilder as _;
    write_whole_unflushed(path, |w| {
        let shape = [map.height() as u64, map.width() as u64];
        let mut npy = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(w).begin_nd()?;
        npy.extend(map.data().iter().copied())?;
        npy.finish()
    })
}

/// Where the local frame of `sparse/` lies.
pub(super) fn write_georef(path: &Path, crs: &Crs, offset: DVec3) -> Result<(), FileError> {
    let georef =
        json!({ "crs": crs.to_string(), "offset": offset.to_array(), "meaning": "map = local + offset, metres" });
    write_text(path, &format!("{georef:#}\n"))
}

/// A run configuration that finds everything else beside it.
pub(super) fn write_run_config(
    path: &Path,
    config: &SimulateConfig,
    crs: &Crs,
    offset: DVec3,
    has_dtm: bool,
) -> Result<(), FileError> {
    let kind = match config.prior.kind {
        PriorKind::Depth => "depth",
        PriorKind::InverseDepth => "inverse_depth",
    };
    let images = if config.images.enabled { "images = \"images\"\n" } else { "" };
    let terrain =
        if has_dtm { "dtm = \"dtm.tif\"".to_owned() } else { format!("constant_m = {:?}", config.terrain.base_z_m) };
    let text = format!(
        "# Written with a simulated scene; the truth lies beside it in truth.geojson.\n\
         seed = {seed}\n\n[project]\ncrs = \"{crs}\"\noutput = \"result\"\n\n\
         [survey]\nformat = \"colmap\"\npath = \"sparse\"\n{images}offset = [{x:?}, {y:?}, {z:?}]\n\n\
         [footprints]\npath = \"footprints.gpkg\"\nid_field = \"id\"\n\n[terrain]\n{terrain}\n\n\
         [ground]\nreference = \"mean\"\n\n\
         [prior]\nsource = \"files\"\npath = \"priors/{{stem}}.npy\"\nkind = \"{kind}\"\ngeometry = \"z_depth\"\n",
        seed = config.seed,
        x = offset.x,
        y = offset.y,
        z = offset.z,
    );
    write_text(path, &text)
}
