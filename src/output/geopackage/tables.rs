//! The tables without geometry: meanings of columns, lineage, default styles.

use super::super::{Lineage, OutputError};
use crate::geodata::gpkg::{Writer, text};

/// Default styles by layer, exported from QGIS by `tests/qgis/styles.py`.
pub const STYLES: [(&str, &str); 5] = [
    ("buildings", include_str!("styles/buildings.qml")),
    ("buildings_lod1", include_str!("styles/buildings_lod1.qml")),
    ("tiles", include_str!("styles/tiles.qml")),
    ("cameras", include_str!("styles/cameras.qml")),
    ("qa_issues", include_str!("styles/qa_issues.qml")),
];

/// The metadata extension with our lineage as JSON (OGC 12-128r15, F.8).
pub fn lineage(writer: &mut Writer<'_>, lineage: &Lineage, timestamp: &str) -> Result<(), OutputError> {
    writer.sql(
        "CREATE TABLE gpkg_metadata (id INTEGER CONSTRAINT m_pk PRIMARY KEY ASC NOT NULL, md_scope TEXT NOT NULL \
         DEFAULT 'dataset', md_standard_uri TEXT NOT NULL, mime_type TEXT NOT NULL DEFAULT 'text/xml', \
         metadata TEXT NOT NULL DEFAULT '')",
    )?;
    writer.sql(
        "CREATE TABLE gpkg_metadata_reference (reference_scope TEXT NOT NULL, table_name TEXT, column_name TEXT, \
         row_id_value INTEGER, timestamp DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')), \
         md_file_id INTEGER NOT NULL, md_parent_id INTEGER, \
         CONSTRAINT crmr_mfi_fk FOREIGN KEY (md_file_id) REFERENCES gpkg_metadata(id), \
         CONSTRAINT crmr_mpi_fk FOREIGN KEY (md_parent_id) REFERENCES gpkg_metadata(id))",
    )?;
    let tables = ["gpkg_metadata", "gpkg_metadata_reference"];
    writer.extension(&tables, "gpkg_metadata", "http://www.geopackage.org/spec121/#extension_metadata")?;
    let json = serde_json::to_string_pretty(lineage).unwrap_or_default();
    writer.sql(&format!(
        "INSERT INTO gpkg_metadata (id, md_scope, md_standard_uri, mime_type, metadata) \
         VALUES (1, 'dataset', 'https://crates.io/crates/sizeup', 'application/json', {})",
        text(&json)
    ))?;
    writer.sql(&format!(
        "INSERT INTO gpkg_metadata_reference (reference_scope, timestamp, md_file_id) VALUES ('geopackage', {}, 1)",
        text(timestamp)
    ))?;
    Ok(())
}

/// QGIS's table of styles.
pub fn styles(writer: &mut Writer<'_>, has_layer: impl Fn(&str) -> bool, timestamp: &str) -> Result<(), OutputError> {
    let present: Vec<(&str, &str)> = STYLES.into_iter().filter(|(layer, _)| has_layer(layer)).collect();
    Ok(writer.styles(&present, timestamp)?)
}
