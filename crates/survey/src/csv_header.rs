//! How a table of poses is laid out: its separator, and the names of its columns, also where they stand in a comment, in
//! quotes, with units (`Omega [deg]`, `altitude(feet)`, `alt_ft`), or apart from the rows by another separator. A first line
//! `sep=;`, which spreadsheets write for each other, names the separator.

use super::angles::{AngleKind, AngleUnit};
use super::config::CsvConfig;

/// So much of a file shows its layout, bytes.
const HEAD_BYTES: usize = 1 << 16;

/// Metres of a US survey foot.
const US_SURVEY_FOOT_M: f64 = 1200.0 / 3937.0;

/// Words in brackets that state a direction or a reference, and no unit.
const REMARKS: [&str; 20] = [
    "x",
    "y",
    "z",
    "e",
    "n",
    "h",
    "east",
    "easting",
    "north",
    "northing",
    "up",
    "lon",
    "longitude",
    "lat",
    "latitude",
    "ellipsoid",
    "ellipsoidal",
    "orthometric",
    "msl",
    "amsl",
];

/// Separator of the rows, names of the columns, and the rows.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CsvLayout<'a> {
    /// `None` is any run of blanks.
    pub delimiter: Option<u8>,
    /// The columns; `None` where no line names them.
    pub header: Option<CsvHeader>,
    /// The table without a line `sep=`; its end of line stays, so that lines count as in the file.
    pub rows: &'a str,
}

/// The line that names the columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CsvHeader {
    columns: Vec<Column>,
    /// Whether it is the first row rather than a comment.
    pub is_row: bool,
}

/// A column as its header names it.
#[derive(Debug, Clone, PartialEq)]
struct Column {
    /// As it is written, without quotes.
    written: String,
    /// Without the unit.
    name: String,
    /// As it is written; empty without one.
    unit: String,
}

/// Unit of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ColumnUnit {
    /// A length, metres per unit.
    Length(f64),
    /// An angle of this unit, as the header writes it.
    Angle(AngleUnit),
    /// Pixels of the photo.
    Pixels,
}

/// How well a line fits as the one that names the columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum HeaderFit {
    /// It names none of them, or hardly any.
    None,
    /// It names some.
    Some,
    /// It names all that a table needs.
    All,
}

impl ColumnUnit {
    fn parse(word: &str) -> Option<Self> {
        Some(match plain(word).as_str() {
            "m" | "meter" | "meters" | "metre" | "metres" => Self::Length(1.0),
            "cm" => Self::Length(0.01),
            "mm" => Self::Length(0.001),
            "ft" | "feet" | "foot" | "ift" | "intft" | "intlft" | "internationalfeet" | "internationalfoot" => {
                Self::Length(0.3048)
            }
            "usft" | "usfeet" | "usfoot" | "ftus" | "sft" | "surveyft" | "surveyfeet" | "surveyfoot" | "ussurveyft"
            | "ussurveyfeet" | "ussurveyfoot" => Self::Length(US_SURVEY_FOOT_M),
            "°" | "deg" | "degs" | "degree" | "degrees" | "decimaldegree" | "decimaldegrees" => {
                Self::Angle(AngleUnit::Deg)
            }
            "gon" | "gons" | "grad" | "grads" => Self::Angle(AngleUnit::Gon),
            "rad" | "rads" | "radian" | "radians" => Self::Angle(AngleUnit::Rad),
            "px" | "pix" | "pixel" | "pixels" => Self::Pixels,
            _ => return None,
        })
    }
}

impl CsvHeader {
    /// Names that the configuration gives.
    pub(super) fn declared(names: &[String]) -> Self {
        Self { columns: names.iter().map(|name| Column::parse(name)).collect(), is_row: false }
    }

    fn of_line(line: &str, delimiter: Option<u8>, is_row: bool) -> Self {
        let line = line.trim_start_matches('#').trim();
        let columns = match delimiter {
            Some(separator) => fields(line, separator).iter().map(|field| Column::parse(field)).collect(),
            None => line.split_whitespace().map(Column::parse).collect(),
        };
        Self { columns, is_row }
    }

    /// The names as the file writes them.
    pub(super) fn names(&self) -> String {
        let names: Vec<&str> = self.columns.iter().map(|column| column.written.as_str()).collect();
        names.join(", ")
    }

    /// Whether a column has one of these names.
    pub(super) fn is_one_of(&self, column: usize, names: &[&str]) -> bool {
        names.iter().any(|name| plain(&self.columns[column].name) == plain(name))
    }

    /// Position of a column: by its name as it is written, else without its unit, else without regard to blanks, hyphens,
    /// points and underscores.
    pub(super) fn seek(&self, wanted: &str) -> Option<usize> {
        let position = |is_it: &dyn Fn(&Column) -> bool| self.columns.iter().position(is_it);
        let wanted_plain = plain(wanted);
        position(&|column| column.written.eq_ignore_ascii_case(wanted))
            .or_else(|| position(&|column| column.name.eq_ignore_ascii_case(wanted)))
            .or_else(|| position(&|column| !wanted_plain.is_empty() && plain(&column.name) == wanted_plain))
    }

    /// Position of the column that has its default name in the configuration, under one of the names tools give it.
    pub(super) fn seek_any(&self, wanted: &str, own: &str, others: &[&str]) -> Option<usize> {
        let or_other = || others.iter().find_map(|other| self.seek(other)).filter(|_| wanted == own);
        self.seek(wanted).or_else(or_other)
    }

    /// The unit that the header states for a column.
    ///
    /// # Errors
    /// A sentence, where it states one that is not known.
    pub(super) fn unit(&self, column: usize) -> Result<Option<ColumnUnit>, String> {
        let Column { name, unit, .. } = &self.columns[column];
        let is_name = |word: &str| word.starts_with(char::is_alphabetic) && word.contains(|c: char| c.is_ascii_digit());
        if unit.is_empty() || is_name(unit) || REMARKS.contains(&plain(unit).as_str()) {
            return Ok(None);
        }
        let known = "m, ft, US survey feet, deg, gon, rad or px";
        ColumnUnit::parse(unit)
            .map(Some)
            .ok_or_else(|| format!("the header counts {name:?} in {unit:?}, which is no known unit: expected {known}"))
    }

    /// The error of a column that is counted in a unit of another kind.
    pub(super) fn wrong_unit(&self, column: usize, expected: &str) -> String {
        let Column { name, unit, .. } = &self.columns[column];
        format!("the header counts {name:?} in {unit:?}: expected {expected}")
    }

    /// Refuses angle columns whose header names another unit than the one that is declared.
    pub(super) fn check_angles(&self, columns: &[usize], config: &CsvConfig) -> Result<(), String> {
        if matches!(config.angles, AngleKind::Quaternion | AngleKind::Matrix) {
            return Ok(());
        }
        for &column in columns {
            match self.unit(column)? {
                Some(ColumnUnit::Angle(found)) if found != config.unit => {
                    let unit = &self.columns[column].unit;
                    return Err(format!("the header counts angles in {unit:?}: declare `csv.unit`"));
                }
                Some(ColumnUnit::Length(_) | ColumnUnit::Pixels) => return Err(self.wrong_unit(column, "an angle")),
                Some(ColumnUnit::Angle(_)) | None => {}
            }
        }
        Ok(())
    }
}

impl Column {
    /// `"Omega [deg]"` is `Omega` in `deg`, `alt_us_ft` is `alt` in `us_ft`.
    fn parse(field: &str) -> Self {
        let written = field.trim().trim_matches(['"', '\'']).trim();
        let (name, unit) = match written.split_once(['[', '(']) {
            Some((name, unit)) if !name.trim().is_empty() => (name, unit.trim_end_matches([']', ')'])),
            _ => with_unit_behind(written).unwrap_or((written, "")),
        };
        Self { written: written.to_owned(), name: name.trim().to_owned(), unit: unit.trim().to_owned() }
    }
}

/// The name and the unit that follows it behind a blank or an underscore; of several, the longest.
fn with_unit_behind(written: &str) -> Option<(&str, &str)> {
    let mut ends = written.match_indices([' ', '_']).map(|(at, _)| (&written[..at], &written[at + 1..]));
    ends.find(|(name, unit)| !name.is_empty() && ColumnUnit::parse(unit).is_some())
}

/// A name or a unit in lower case without blanks, hyphens, points and underscores.
fn plain(name: &str) -> String {
    name.chars().filter(|c| ![' ', '_', '-', '.'].contains(c)).flat_map(char::to_lowercase).collect()
}

/// Fields of one line, which may be in quotes.
fn fields(line: &str, separator: u8) -> Vec<String> {
    let mut reader = ::csv::ReaderBuilder::new().delimiter(separator).has_headers(false).from_reader(line.as_bytes());
    let record = reader.records().next().and_then(Result::ok).unwrap_or_default();
    record.iter().map(str::to_owned).collect()
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
    b"\t;|,".iter().copied().find(|&separator| line.as_bytes().contains(&separator))
}

/// The separator of a first line `sep=;`, and the length of that line.
fn stated_separator(text: &str) -> Option<(u8, usize)> {
    let line = text.lines().next()?;
    let stated = line.trim_start_matches('"').trim_end_matches(['"', '\r']);
    let (key, separator) = stated.split_once('=')?;
    match separator.as_bytes() {
        [separator] if key.eq_ignore_ascii_case("sep") => Some((*separator, line.len())),
        _ => None,
    }
}

/// The layout of a table; `fit` judges the names of a line.
pub(super) fn layout<'a>(text: &'a str, config: &CsvConfig, fit: impl Fn(&CsvHeader) -> HeaderFit) -> CsvLayout<'a> {
    let stated = stated_separator(text);
    let declared = if config.is_spaced { Some(None) } else { stated.map(|(separator, _)| Some(separator)) };
    let rows = &text[stated.map_or(0, |(_, length)| length)..];
    let head = &rows[..rows.floor_char_boundary(HEAD_BYTES)];
    let lines = || head.lines().filter(|line| !line.trim().is_empty());
    let mut data = lines().filter(|line| !line.starts_with('#'));
    let of_line = |line: &str| declared.unwrap_or_else(|| separator_of(line));
    let (first, second) = (data.next().unwrap_or_default(), data.next());
    if let Some(names) = &config.header {
        return CsvLayout { delimiter: of_line(first), header: Some(CsvHeader::declared(names)), rows };
    }
    let as_row = CsvHeader::of_line(first, of_line(first), true);
    let comments = lines().take_while(|line| line.starts_with('#'));
    let as_comment = comments.map(|line| CsvHeader::of_line(line, separator_of(line), false)).max_by_key(&fit);
    match as_comment.filter(|comment| fit(comment) > fit(&as_row)) {
        Some(header) => CsvLayout { delimiter: of_line(first), header: Some(header), rows },
        None => {
            let header = (!first.is_empty()).then_some(as_row);
            CsvLayout { delimiter: of_line(second.unwrap_or(first)), header, rows }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(field: &str) -> (String, Option<ColumnUnit>) {
        let header = CsvHeader::declared(&[field.to_owned()]);
        (header.columns[0].name.clone(), header.unit(0).unwrap())
    }

    #[test]
    fn units_are_known_in_brackets_and_behind_a_name() {
        let (feet, us_feet) = (Some(ColumnUnit::Length(0.3048)), Some(ColumnUnit::Length(1200.0 / 3937.0)));
        for (field, name, unit) in [
            ("altitude(feet)", "altitude", feet),
            ("alt_ft", "alt", feet),
            ("z [ft]", "z", feet),
            ("height (US survey feet)", "height", us_feet),
            ("alt_us_ft", "alt", us_feet),
            ("\"Elevation [ftUS]\"", "Elevation", us_feet),
            ("altitude [meter]", "altitude", Some(ColumnUnit::Length(1.0))),
            ("latitude [decimal degrees]", "latitude", Some(ColumnUnit::Angle(AngleUnit::Deg))),
            ("omega_rad", "omega", Some(ColumnUnit::Angle(AngleUnit::Rad))),
            ("cx_px", "cx", Some(ColumnUnit::Pixels)),
            ("image name", "image name", None),
            ("px", "px", None),
            ("X (East)", "X", None),
            ("Easting (UTM 32N)", "Easting", None),
        ] {
            assert_eq!(parsed(field), (name.to_owned(), unit), "{field}");
        }
        let refused = CsvHeader::declared(&["z [fathoms]".to_owned()]).unit(0).unwrap_err();
        assert!(refused.contains("\"z\" in \"fathoms\""), "{refused}");
    }

    #[test]
    fn a_column_is_found_by_its_own_name_before_one_with_a_unit() {
        let header = CsvHeader::of_line("# Image Name, z_ft, z, alt_ft", Some(b','), false);
        assert_eq!(header.seek("z"), Some(2));
        assert_eq!(header.seek("alt_ft"), Some(3));
        assert_eq!(header.seek("image_name"), Some(0));
        assert_eq!(header.seek("x"), None);
    }

    #[test]
    fn a_first_line_sep_names_the_separator_and_lines_still_count() {
        let config = CsvConfig::default();
        let layout = layout("sep=;\r\nname;x\na;1,5\n", &config, |_| HeaderFit::None);
        assert_eq!((layout.delimiter, layout.rows), (Some(b';'), "\r\nname;x\na;1,5\n"));
        assert_eq!(layout.header.unwrap().names(), "name, x");
    }
}
