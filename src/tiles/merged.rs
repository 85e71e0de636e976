//! The buildings of all tiles as one result, read from the tiles' files as often as writers ask.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;

use serde::de::DeserializeOwned;

use sizeup_geo::files::FileError;
use sizeup_results::output::{BuildingRecord, OutputError, Records};

/// Buildings from files of one record a line, then some from memory.
#[derive(Debug)]
pub struct TileRecords {
    /// Files of the tiles, in the plan's order.
    pub files: Vec<PathBuf>,
    /// Buildings that belong to no tile.
    pub rest: Vec<BuildingRecord>,
}

impl Records for TileRecords {
    fn visit(&self, visit: &mut dyn FnMut(&BuildingRecord) -> Result<(), OutputError>) -> Result<(), OutputError> {
        for path in &self.files {
            visit_lines(path, &mut |record| visit(&record))?;
        }
        self.rest.iter().try_for_each(visit)
    }
}

/// Hands every line of a file to `visit`.
pub fn visit_lines<T: DeserializeOwned>(
    path: &PathBuf,
    visit: &mut dyn FnMut(T) -> Result<(), OutputError>,
) -> Result<(), OutputError> {
    let failed = |e| OutputError::from(FileError::on("cannot read", path)(e));
    for line in BufReader::new(File::open(path).map_err(failed)?).lines() {
        visit(serde_json::from_str(&line.map_err(failed)?).map_err(|e| failed(e.into()))?)?;
    }
    Ok(())
}
