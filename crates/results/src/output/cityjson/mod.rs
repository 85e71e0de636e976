//! `CityJSON` 2.0 (<https://www.cityjson.org/specs/2.0.1/>): LOD 1.2 solids with semantics, in one file or as a sequence.
//!
//! Written building by building; only the list of distinct vertices is kept until the end (some 30 bytes each), and in
//! a sequence not even that. A building without a solid has its footprint as LOD 0 and attributes that say why.

mod metadata;
mod names;
mod object;
pub(super) mod pieces;
pub mod read;
mod read_sequence;
mod sequence;
mod vertices;

use crate::output::grid::SCALE_M;
use crate::output::prism::MIN_THICKNESS_M;
use std::io::{self, Write};
use std::path::Path;

use geo::Area as _;

use super::buildings::{Families, Overview, Records};
use super::footprint::SnappedFootprint;
use super::grid::OutputGrid;
use super::prism::{NoSolid, SnappedPrism};
use super::textured::Painting;
use super::{BuildingRecord, CityModel, OutputError};
pub use names::{AttributeNames, EXTENSION_PREFIX, extension_schema};
use object::ObjectSettings;
pub use read_sequence::CitySequence;
#[cfg(feature = "flatcitybuf")]
pub(super) use sequence::write_lines;
pub use sequence::write_sequence;
use sizeup_geo::files::{FileError, write_whole_or};
use sizeup_geo::issue::{Issue, Severity, Subject};
use vertices::VertexPool;

/// How `CityJSON` is written.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CityJsonConfig {
    /// Names of the buildings' attributes.
    pub names: AttributeNames,
    /// Where `schemas/sizeup.ext.json` is published. If set, the file declares our extension there, and our attributes
    /// have its names (`+sizeup-height_m`), so that validators check their types.
    pub extension_url: Option<String>,
}

/// Writes `path` (by convention `….city.json`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, settings out of range, a scene larger than the grid, the file system.
pub fn write<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &CityJsonConfig,
) -> Result<Overview, OutputError> {
    write_any(path, model, config, None)
}

/// As [`write()`], with textures.
pub(super) fn write_painted(
    path: &Path,
    model: &CityModel<'_>,
    config: &CityJsonConfig,
    painting: &Painting<'_>,
) -> Result<Overview, OutputError> {
    write_any(path, model, config, Some(painting))
}

fn write_any<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &CityJsonConfig,
    painting: Option<&Painting<'_>>,
) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    let mut header = metadata::header(model, &overview, &grid, config);
    if let Some(painting) = painting {
        header.insert("appearance".to_owned(), painting.appearance());
    }
    let objects = ObjectSettings { grid: &grid, config, has_roofs: overview.has_roofs, painting };
    write_whole_or(path, |out| {
        let mut pool = VertexPool::default();
        let mut separator = "\n";
        let mut write = |out: &mut dyn Write, named: &[object::Named]| -> io::Result<()> {
            for (id, object) in named {
                out.write_all(separator.as_bytes())?;
                separator = ",\n";
                serde_json::to_writer(&mut *out, id)?;
                out.write_all(b":")?;
                serde_json::to_writer(&mut *out, object)?;
            }
            Ok(())
        };
        let failed = |e| cannot_write(path, e);
        metadata::write_head(out, &header).map_err(failed)?;
        let mut families = Families::new(&overview);
        model.records.visit(&mut |record| match families.add(record) {
            Some(family) => write(out, &objects.of(&family, &mut pool)).map_err(failed),
            None => Ok(()),
        })?;
        out.write_all(b"\n},\n\"vertices\":[").and_then(|()| pool.write(out)).map_err(failed)?;
        writeln!(out, "]}}").map_err(failed)
    })?;
    Ok(overview)
}

fn cannot_write(path: &Path, error: io::Error) -> OutputError {
    FileError::on("cannot write", path)(error).into()
}

/// Code of the note of a footprint that had to be mended on the output grid.
const FOOTPRINT_MENDED: &str = "footprint_mended_on_grid";

/// Issues of buildings that will have no solid although footprint and height are known, and footprints that the output grid changes by more than
/// rounding: one issue per such building.
///
/// # Errors
/// As [`write()`], but for the file system.
pub fn check(records: &[BuildingRecord]) -> Result<Vec<Issue>, OutputError> {
    let (grid, _) = OutputGrid::over(records, SCALE_M)?;
    let told = |record: &BuildingRecord, severity, code: &str, message: String| {
        let issue = Issue::new(severity, code, Subject::Building(record.id.clone()), message);
        Some(match record.footprint.as_ref().and_then(|footprint| footprint.exterior().0.first()) {
            Some(corner) => issue.at(corner.x, corner.y),
            None => issue,
        })
    };
    let issue = |record: &BuildingRecord| match SnappedPrism::of(record, &grid, MIN_THICKNESS_M) {
        Ok(prism) => {
            let footprint = record.footprint.as_ref().filter(|o| SnappedFootprint::is_repaired(o, &grid))?;
            let change_m2 = prism.footprint().to_polygon(&grid).unsigned_area() - footprint.unsigned_area();
            let scale_mm = 1e3 * grid.scale_m;
            let message = format!(
                "its footprint touches itself once rounded to {scale_mm} mm, and was mended: its area changed by {change_m2:+.3} m²"
            );
            told(record, Severity::Note, FOOTPRINT_MENDED, message)
        }
        Err(NoSolid::NoFootprint | NoSolid::NoHeight) => None,
        Err(fault) => told(record, Severity::Warning, fault.code(), format!("no 3D solid was written: {fault}")),
    };
    Ok(records.iter().filter_map(issue).collect())
}
