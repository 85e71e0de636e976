//! The tables without geometry: meanings of columns, lineage, default styles.

use super::super::{Lineage, OutputError};
use sizeup_geo::geodata::gpkg::{Writer, text};

/// Default styles by layer, exported from QGIS by `tests/qgis/styles.py`.
pub const STYLES: [(&str, &str); 8] = [
    ("buildings", include_str!("styles/buildings.qml")),
    ("buildings_lod1", include_str!("styles/buildings_lod1.qml")),
    ("buildings_lod13", include_str!("styles/buildings_lod1.qml")),
    ("buildings_lod2", include_str!("styles/buildings_lod2.qml")),
    ("footprints_moved", include_str!("styles/footprints_moved.qml")),
    ("tiles", include_str!("styles/tiles.qml")),
    ("cameras", include_str!("styles/cameras.qml")),
    ("qa_issues", include_str!("styles/qa_issues.qml")),
];

/// The table of the lineage: not in `gpkg_metadata`, which GDAL prints with every layer.
pub const LINEAGE_TABLE: &str = "sizeup_lineage";

/// A table with our lineage as JSON in its only row.
pub fn lineage(writer: &mut Writer<'_>, lineage: &Lineage) -> Result<(), OutputError> {
    writer.sql(&format!("CREATE TABLE {LINEAGE_TABLE} (id INTEGER PRIMARY KEY NOT NULL, lineage TEXT NOT NULL)"))?;
    let json = serde_json::to_string_pretty(lineage).unwrap_or_default();
    writer.sql(&format!("INSERT INTO {LINEAGE_TABLE} (id, lineage) VALUES (1, {})", text(&json)))?;
    Ok(())
}

/// QGIS's table of styles.
pub fn styles(writer: &mut Writer<'_>, has_layer: impl Fn(&str) -> bool, timestamp: &str) -> Result<(), OutputError> {
    let present: Vec<(&str, &str)> = STYLES.into_iter().filter(|(layer, _)| has_layer(layer)).collect();
    Ok(writer.styles(&present, timestamp)?)
}
