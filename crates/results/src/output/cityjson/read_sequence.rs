//! Reading `CityJSONSeq` line by line: memory does not grow with the file.

use std::fs;
use std::io::{BufRead as _, BufReader, Lines};
use std::path::{Path, PathBuf};

use super::super::error::{MalformedFile, OutputError};
use super::read::{CityFile, RawFile, RawTransform, crs_of, open, require_version};
use sizeup_geo::files::FileError;

/// A sequence, feature by feature: iterates over city models of one feature each, in a CRS of their own.
#[derive(Debug)]
pub struct CitySequence {
    path: PathBuf,
    lines: Lines<BufReader<fs::File>>,
    n_lines: usize,
    transform: Option<RawTransform>,
    header: CityFile,
    /// A header may hold objects itself, where it is a whole city model.
    is_header_due: bool,
}

impl CitySequence {
    /// Reads the header.
    ///
    /// # Errors
    /// As [`CityFile::read`].
    pub fn open(path: &Path) -> Result<Self, OutputError> {
        let lines = open(path)?.lines();
        let header = CityFile::default();
        let mut sequence =
            Self { path: path.to_owned(), lines, n_lines: 0, transform: None, header, is_header_due: true };
        let Some(raw) = sequence.next_line()? else { return Ok(sequence) };
        sequence.header = sequence.read_header(raw).map_err(|reason| sequence.malformed(&reason))?;
        Ok(sequence)
    }

    /// First line: CRS and metadata, and as a rule no objects.
    #[must_use]
    pub fn header(&self) -> &CityFile {
        &self.header
    }

    fn read_header(&mut self, raw: RawFile) -> Result<CityFile, String> {
        require_version(&raw)?;
        self.transform.clone_from(&raw.transform);
        let mut header =
            CityFile { crs: crs_of(&raw.metadata)?, metadata: raw.metadata.clone(), ..CityFile::default() };
        header.add(raw, self.transform.as_ref())?;
        Ok(header)
    }

    fn malformed(&self, reason: &str) -> OutputError {
        MalformedFile { path: self.path.clone(), reason: format!("line {}: {reason}", self.n_lines) }.into()
    }

    /// The next line that is not empty.
    fn next_line(&mut self) -> Result<Option<RawFile>, OutputError> {
        for line in self.lines.by_ref() {
            self.n_lines += 1;
            let line = line.map_err(FileError::on("cannot read", &self.path))?;
            if !line.trim().is_empty() {
                return serde_json::from_str(&line).map(Some).map_err(|e| self.malformed(&e.to_string()));
            }
        }
        Ok(None)
    }

    fn next_feature(&mut self) -> Result<Option<CityFile>, OutputError> {
        if std::mem::take(&mut self.is_header_due) && !self.header.objects.is_empty() {
            return Ok(Some(std::mem::take(&mut self.header)));
        }
        let Some(raw) = self.next_line()? else { return Ok(None) };
        if raw.kind != "CityJSONFeature" {
            return Err(self.malformed(&format!("expected a CityJSONFeature, found {:?}", raw.kind)));
        }
        let mut city = CityFile::default();
        city.add(raw, self.transform.as_ref()).map_err(|reason| self.malformed(&reason))?;
        Ok(Some(city))
    }

    /// All features as one model.
    pub(super) fn into_one(mut self) -> Result<CityFile, OutputError> {
        self.is_header_due = false;
        let mut city = std::mem::take(&mut self.header);
        while let Some(raw) = self.next_line()? {
            if raw.kind != "CityJSONFeature" {
                return Err(self.malformed(&format!("expected a CityJSONFeature, found {:?}", raw.kind)));
            }
            city.add(raw, self.transform.as_ref()).map_err(|reason| self.malformed(&reason))?;
        }
        Ok(city)
    }
}

impl Iterator for CitySequence {
    type Item = Result<CityFile, OutputError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_feature().transpose()
    }
}
