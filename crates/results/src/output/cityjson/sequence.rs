//! `CityJSONSeq` (<https://www.cityjson.org/cityjsonseq/>): a header line, then one feature per line.
//!
//! Each feature has its own vertices, so memory is bounded by one building and lines can be read in any order.

use crate::output::grid::SCALE_M;
use std::io::{self, Write};
use std::path::Path;

use serde_json::json;

use super::object::{Named, ObjectSettings};
use super::vertices::VertexPool;
use super::{CityJsonConfig, cannot_write, metadata};
use crate::output::{CityModel, Families, OutputError, Overview, Records};
use sizeup_geo::files::write_whole_or;

/// Writes `path` (by convention `….city.jsonl`) whole or not at all.
///
/// # Errors
/// As [`super::write()`].
pub fn write_sequence<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &CityJsonConfig,
) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    write_whole_or(path, |out| write_lines(out, model, config, &overview, |e| cannot_write(path, e)))?;
    Ok(overview)
}

/// Writes the lines of the file to anything that takes them; `failed` names it in errors.
pub(in crate::output) fn write_lines<R: Records + ?Sized>(
    out: &mut dyn Write,
    model: &CityModel<'_, R>,
    config: &CityJsonConfig,
    overview: &Overview,
    failed: impl Fn(io::Error) -> OutputError,
) -> Result<(), OutputError> {
    let grid = overview.grid(SCALE_M)?;
    let mut header = metadata::header(model, overview, &grid, config);
    header.insert("CityObjects".to_owned(), json!({}));
    header.insert("vertices".to_owned(), json!([]));
    let objects = ObjectSettings { grid: &grid, config, has_roofs: overview.has_roofs, painting: None };
    writeln!(out, "{}", json!(header)).map_err(&failed)?;
    let mut pool = VertexPool::default();
    let mut families = Families::new(overview);
    model.records.visit(&mut |record| {
        let Some(family) = families.add(record) else { return Ok(()) };
        pool.clear();
        let named = objects.of(&family, &mut pool);
        write_feature(out, &named, &pool).map_err(&failed)
    })
}

/// One line: the root object first, which names the feature.
fn write_feature(out: &mut dyn Write, named: &[Named], pool: &VertexPool) -> io::Result<()> {
    let Some((root, _)) = named.first() else { return Ok(()) };
    write!(out, r#"{{"type":"CityJSONFeature","id":{},"CityObjects":{{"#, json!(root))?;
    for (i, (id, object)) in named.iter().enumerate() {
        write!(out, "{}{}:", if i == 0 { "" } else { "," }, json!(id))?;
        serde_json::to_writer(&mut *out, object)?;
    }
    out.write_all(br#"},"vertices":["#)?;
    pool.write_inline(out)?;
    out.write_all(b"]}\n")
}
