//! The scene in the formats a user would bring: COLMAP text, `GeoPackage`, GeoTIFF, `GeoJSON`, a run configuration.

use std::borrow::Borrow;
use std::path::Path;

use geo_types::Polygon;
use glam::DVec3;
use serde_json::{Value, json};

use sizeup_geo::crs::Crs;
use sizeup_geo::files::{FileError, write_whole, write_whole_unflushed};
use sizeup_geo::geodata::geojson::{self, Feature, GeometryValue, JsonObject, Position};
use sizeup_geo::geodata::{FieldType, GridPlace, LayerFeature, write_geotiff, write_polygon_layer};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::raster::Raster;
use sizeup_photos::prior::PriorKind;

use super::SimulateError;
use super::building::SimulatedBuilding;
use super::config::SimulateConfig;

/// DTM cells without a value.
const NODATA: f32 = -9999.0;

fn write_text(path: &Path, text: &str) -> Result<(), FileError> {
    write_whole(path, |w| w.write_all(text.as_bytes()))
}

/// The footprints as the user gets them: polygons, ids, types; no heights.
pub(super) fn write_footprints(
    path: &Path,
    crs: &Crs,
    buildings: impl IntoIterator<Item: Borrow<SimulatedBuilding>>,
    footprints: &[Polygon<f64>],
) -> Result<(), SimulateError> {
    let columns = [("id", FieldType::Text), ("type", FieldType::Text)];
    let features: Vec<LayerFeature> = buildings
        .into_iter()
        .zip(footprints)
        .map(|(b, polygon)| {
            let b = b.borrow();
            let texts = vec![b.id.to_string(), b.kind.as_str().to_owned()];
            LayerFeature { polygon, texts, numbers: Vec::new() }
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

/// Truth of every building, as `GeoJSON` in the project's CRS (with the `crs` member of the 2008 draft, which
/// GDAL and QGIS still read).
pub(super) fn write_truth(
    path: &Path,
    crs: &Crs,
    buildings: impl IntoIterator<Item: Borrow<SimulatedBuilding>>,
) -> Result<(), FileError> {
    let mut members = JsonObject::from_iter([("name".to_owned(), "truth".into())]);
    if let Some(code) = crs.epsg() {
        let name = json!({ "name": format!("urn:ogc:def:crs:EPSG::{code}") });
        members.insert("crs".to_owned(), json!({ "type": "name", "properties": name }));
    }
    geojson::write(path, &members, |push| buildings.into_iter().try_for_each(|b| push(&truth_feature(b.borrow()))))
}

fn truth_feature(b: &SimulatedBuilding) -> Feature {
    let millimetres = |v: f64| (v * 1e3).round() / 1e3;
    let ring = |r: &geo_types::LineString<f64>| {
        r.0.iter().map(|c| Position::from([millimetres(c.x), millimetres(c.y)])).collect()
    };
    let rings = std::iter::once(b.footprint.exterior()).chain(b.footprint.interiors()).map(ring);
    let attributes: [(&str, Value); 7] = [
        ("id", b.id.0.as_str().into()),
        ("height_m", millimetres(b.height_m).into()),
        ("eave_m", millimetres(b.eave_m).into()),
        ("ridge_m", millimetres(b.ridge_m).into()),
        ("ground_z_m", millimetres(b.ground_z_m).into()),
        ("roof", b.roof.as_str().into()),
        ("type", b.kind.as_str().into()),
    ];
    let properties = attributes.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    geojson::feature(None, Some(GeometryValue::Polygon { coordinates: rings.collect() }), properties)
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

/// Origin of the local frame of `sparse/`.
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
