//! The file's header: metadata with lineage, and the transform.

use std::io::{self, Write};

use serde_json::{Map as JsonMap, Value, json};

use super::{CityJsonConfig, names};
use crate::output::grid::{Extent, OutputGrid};
use crate::output::{CityModel, Overview};
use sizeup_geo::crs::Crs;

/// Steps per metre of header numbers: ten times finer than the finest grid, so rounding only removes noise.
const HEADER_STEPS_PER_M: f64 = 1e5;

/// Everything before the city objects, in the order in which it is written.
pub fn header<R: ?Sized>(
    model: &CityModel<'_, R>,
    overview: &Overview,
    grid: &OutputGrid,
    config: &CityJsonConfig,
) -> JsonMap<String, Value> {
    let mut header = JsonMap::new();
    header.insert("type".to_owned(), json!("CityJSON"));
    header.insert("version".to_owned(), json!("2.0"));
    if let Some(url) = &config.extension_url {
        header.insert("extensions".to_owned(), names::extensions(url));
    }
    header.insert("metadata".to_owned(), metadata(model, overview.extent.as_ref()));
    header.insert("transform".to_owned(), transform(grid));
    header
}

/// Writes the header, a member a line, up to where the city objects begin.
pub fn write_head(out: &mut dyn Write, header: &JsonMap<String, Value>) -> io::Result<()> {
    out.write_all(b"{")?;
    for (name, member) in header {
        writeln!(out, "{}:{member},", json!(name))?;
    }
    out.write_all(br#""CityObjects":{"#)
}

/// CityJSON's `metadata` object: extent, reference system and origin.
fn metadata<R: ?Sized>(model: &CityModel<'_, R>, extent: Option<&Extent>) -> Value {
    let mut metadata = JsonMap::new();
    if let Some(Extent { min_m, max_m }) = extent {
        let corners: Vec<f64> = min_m.iter().chain(max_m).map(|v| tidy(*v)).collect();
        metadata.insert("geographicalExtent".to_owned(), json!(corners));
    }
    if let Some(date) = &model.lineage.reference_date {
        metadata.insert("referenceDate".to_owned(), json!(date));
    }
    if let Some(url) = reference_system(model.crs) {
        metadata.insert("referenceSystem".to_owned(), json!(url));
    }
    let mut lineage = json!(model.lineage.header());
    lineage["vertical_reference_system"] = json!(model.crs.vertical_name());
    metadata.insert("sizeup".to_owned(), lineage);
    Value::Object(metadata)
}

/// CityJSON's `transform` object: scale and translation of the grid.
fn transform(grid: &OutputGrid) -> Value {
    let scale = [grid.scale_m; 3];
    json!({ "scale": scale, "translate": grid.origin_m })
}

/// URL of the CRS: of the compound where EPSG has a code for it, else of its horizontal part (the vertical part is
/// then in the lineage). `https`, because the QGIS loader knows no other.
fn reference_system(crs: &Crs) -> Option<String> {
    let code = crs.epsg().or_else(|| crs.horizontal_epsg())?;
    Some(format!("https://www.opengis.net/def/crs/EPSG/0/{code}"))
}

/// Without the last bits of binary arithmetic.
pub fn tidy(value_m: f64) -> f64 {
    (value_m * HEADER_STEPS_PER_M).round() / HEADER_STEPS_PER_M + 0.0
}
