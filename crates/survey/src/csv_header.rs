//! How a table of poses is laid out: its separator, and the names of its columns, also where they stand in a comment, in
//! quotes, with units in brackets, or apart from the rows by another separator.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use super::SurveyError;
use super::angles::{AngleKind, AngleUnit};
use super::config::CsvConfig;
use sizeup_geo::files::FileError;

/// So much of a file shows its layout.
const HEAD_BYTES: u64 = 1 << 16;

/// Separator of the rows and names of the columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CsvLayout {
    /// `None` is any run of blanks.
    pub delimiter: Option<u8>,
    /// The columns; `None` where no line names them.
    pub header: Option<CsvHeader>,
}

/// The line that names the columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CsvHeader {
    /// Names without quotes and units.
    pub names: Vec<String>,
    /// Units that stand in brackets behind them.
    units: Vec<String>,
    /// Whether it is the first row rather than a comment.
    pub is_row: bool,
}

impl CsvHeader {
    /// Names that the configuration gives.
    pub(super) fn declared(names: &[String]) -> Self {
        Self { names: names.to_vec(), units: vec![String::new(); names.len()], is_row: false }
    }

    fn of_line(line: &str, delimiter: Option<u8>, is_row: bool) -> Self {
        let line = line.trim_start_matches('\u{feff}').trim_start_matches('#').trim();
        let fields: Vec<&str> = match delimiter {
            Some(separator) => line.split(char::from(separator)).collect(),
            None => line.split_whitespace().collect(),
        };
        let (names, units) = fields.into_iter().map(name_and_unit).unzip();
        Self { names, units, is_row }
    }

    /// Position of a column.
    pub(super) fn seek(&self, wanted: &str) -> Option<usize> {
        self.names.iter().position(|name| name.eq_ignore_ascii_case(wanted))
    }

    /// Position of the column that has its default name in the configuration, under one of the names tools give it.
    pub(super) fn seek_any(&self, wanted: &str, own: &str, others: &[&str]) -> Option<usize> {
        let or_other = || others.iter().find_map(|other| self.seek(other)).filter(|_| wanted == own);
        self.seek(wanted).or_else(or_other)
    }

    /// Refuses angle columns whose header names another unit than the one that is declared.
    pub(super) fn check_unit(&self, columns: &[usize], config: &CsvConfig) -> Result<(), String> {
        if matches!(config.angles, AngleKind::Quaternion | AngleKind::Matrix) {
            return Ok(());
        }
        for unit in columns.iter().filter_map(|&column| self.units.get(column)) {
            let found = match unit.to_ascii_lowercase().as_str() {
                "gon" | "grad" | "grads" => AngleUnit::Gon,
                "rad" | "radian" | "radians" => AngleUnit::Rad,
                "deg" | "degree" | "degrees" | "°" => AngleUnit::Deg,
                _ => continue,
            };
            if found != config.unit {
                return Err(format!("the header counts angles in {unit:?}: declare `csv.unit`"));
            }
        }
        Ok(())
    }
}

/// `"Omega [deg]"` is `Omega` in `deg`.
fn name_and_unit(field: &str) -> (String, String) {
    let field = field.trim().trim_matches(['"', '\'']).trim();
    match field.split_once(['[', '(']) {
        Some((name, unit)) if !name.trim().is_empty() => {
            (name.trim().to_owned(), unit.trim_end_matches([']', ')']).trim().to_owned())
        }
        _ => (field.to_owned(), String::new()),
    }
}

/// Whether some line names omega, phi and kappa.
pub(crate) fn names_angles(head: &str) -> bool {
    let has_all = |line: &str| {
        let header = CsvHeader::of_line(line, separator_of(line), true);
        ["omega", "phi", "kappa"].iter().all(|name| header.seek(name).is_some())
    };
    head.lines().take(50).any(has_all)
}

/// The separator that a line contains; `None` where it has blanks only.
fn separator_of(line: &str) -> Option<u8> {
    b"\t;,".iter().copied().find(|&separator| line.as_bytes().contains(&separator))
}

/// Looks at the head of a file; `is_header` tells whether a line's names are the table's.
pub(super) fn layout(
    path: &Path,
    config: &CsvConfig,
    is_header: impl Fn(&CsvHeader) -> bool,
) -> Result<CsvLayout, SurveyError> {
    let declared = match config.delimiter.as_str() {
        "" => None,
        "tab" | "\t" => Some(Some(b'\t')),
        "whitespace" => Some(None),
        one if one.len() == 1 => Some(Some(one.as_bytes()[0])),
        other => {
            let message = format!("csv.delimiter {other:?}");
            return Err(SurveyError::config(message, "one character, or \"tab\" or \"whitespace\""));
        }
    };
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    let mut head = Vec::new();
    file.take(HEAD_BYTES).read_to_end(&mut head).map_err(FileError::on("cannot read", path))?;
    let head = String::from_utf8_lossy(&head);
    let lines = || head.lines().filter(|line| !line.trim().is_empty());
    let mut rows = lines().filter(|line| !line.starts_with('#'));
    let of_line = |line: &str| declared.unwrap_or_else(|| separator_of(line));
    let (first, second) = (rows.next().unwrap_or_default(), rows.next());
    if let Some(names) = &config.header {
        return Ok(CsvLayout { delimiter: of_line(first), header: Some(CsvHeader::declared(names)) });
    }
    let as_row = CsvHeader::of_line(first, of_line(first), true);
    let comments = lines().take_while(|line| line.starts_with('#'));
    let in_comment =
        comments.map(|line| CsvHeader::of_line(line, separator_of(line), false)).filter(|h| is_header(h)).last();
    match in_comment.filter(|_| !is_header(&as_row)) {
        Some(header) => Ok(CsvLayout { delimiter: of_line(first), header: Some(header) }),
        None => {
            Ok(CsvLayout { delimiter: of_line(second.unwrap_or(first)), header: (!first.is_empty()).then_some(as_row) })
        }
    }
}
