//! `CityJSONSeq` (<https://www.cityjson.org/cityjsonseq/>): a header line, then one feature per line.
//!
//! Each feature has its own vertices, so memory is bounded by one building and lines can be read in any order.

use std::io::{self, Write};
use std::path::Path;

use serde_json::json;

use super::super::prism::Prism;
use super::vertices::VertexPool;
use super::{CityJsonConfig, building, metadata};
use crate::files::write_whole;
use crate::output::grid::Grid;
use crate::output::{CityModel, OutputError};

/// Writes `path` (by convention `….city.jsonl`) whole or not at all.
///
/// # Errors
/// As [`super::write`].
pub fn write_sequence(path: &Path, model: &CityModel<'_>, config: &CityJsonConfig) -> Result<(), OutputError> {
    config.require_valid()?;
    model.require_unique_ids()?;
    let (grid, extent) = Grid::over(model.records, config.scale_m)?;
    let header = json!({
        "type": "CityJSON",
        "version": "2.0",
        "metadata": metadata::metadata(model, extent.as_ref(), config.title.as_deref()),
        "transform": metadata::transform(&grid),
        "CityObjects": {},
        "vertices": [],
    });
    write_whole(path, |out| {
        writeln!(out, "{header}")?;
        let mut pool = VertexPool::default();
        for record in model.records {
            pool.clear();
            let prism = Prism::of(record, &grid, config.min_thickness_m);
            let object = building(record, prism.as_ref(), &grid, &mut pool);
            write_feature(out, &record.id, &object, &pool)?;
        }
        Ok(())
    })?;
    Ok(())
}

fn write_feature(out: &mut dyn Write, id: &str, object: &serde_json::Value, pool: &VertexPool) -> io::Result<()> {
    let id = json!(id);
    write!(out, r#"{{"type":"CityJSONFeature","id":{id},"CityObjects":{{{id}:"#)?;
    serde_json::to_writer(&mut *out, object)?;
    out.write_all(br#"},"vertices":["#)?;
    pool.write_inline(out)?;
    out.write_all(b"]}\n")
}
