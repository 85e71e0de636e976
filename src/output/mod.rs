//! Results on disk: one record per building, and one file per format that writes them.
//!
//! | format | writer | for |
//! |---|---|---|
//! | CityJSON 2.0 | [`cityjson`] | exchange, 3DCityDB, validators |
//! | CityJSONSeq 2.0 | [`cityjson::write_sequence`] | streams, tilers |
//! | GeoPackage 1.2 | [`geopackage`] | QGIS, any GIS |
//! | PNG | [`picture`] | a first look |
//! | JSON | [`reports`] | pipelines |
//!
//! [`read`] brings results and references back, [`validate`] checks the solids of any `CityJSON` file.
//!
//! All of them take one [`CityModel`]; every building of the input is in every file, with a status and reasons.

pub mod attributes;
pub mod cityjson;
mod error;
pub mod geopackage;
pub mod grid;
mod lineage;
pub mod outline;
pub mod picture;
pub mod planar;
pub mod prism;
pub mod read;
mod record;
pub mod reports;
pub mod validate;

use crate::crs::Crs;
use crate::issue::Issue;
use crate::survey::Survey;

pub use error::{MalformedFile, OutputError};
pub use lineage::{InputFile, Lineage, sha256_hex};
pub use record::{BuildingRecord, HeightReference, Status};

/// Everything a writer needs to know of a result.
#[derive(Debug, Clone, Copy)]
pub struct CityModel<'a> {
    /// Every building of the input, in the order in which it is to be written.
    pub records: &'a [BuildingRecord],
    /// The project's CRS; may be a compound.
    pub crs: &'a Crs,
    /// Where the result comes from.
    pub lineage: &'a Lineage,
    /// What was wrong with single items of the input.
    pub issues: &'a [Issue],
    /// The photos and their poses.
    pub survey: &'a Survey,
}

impl CityModel<'_> {
    /// Checks what all formats rely on: one record per id.
    ///
    /// # Errors
    /// [`OutputError::DuplicateId`].
    pub fn require_unique_ids(&self) -> Result<(), OutputError> {
        let mut seen = std::collections::HashSet::with_capacity(self.records.len());
        match self.records.iter().find(|record| !seen.insert(record.id.as_str())) {
            Some(record) => Err(OutputError::DuplicateId { id: record.id.clone() }),
            None => Ok(()),
        }
    }
}
