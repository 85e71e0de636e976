//! COLMAP's text files.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::{Cameras, ImageRow, models};
use crate::camera::Camera;
use crate::files::FileError;
use crate::survey::SurveyError;
use crate::survey::error::Place;

/// Reads `cameras.txt`.
pub(super) fn cameras(path: &Path) -> Result<Cameras, SurveyError> {
    let mut cameras = Cameras::new();
    let mut lines = Lines::open(path)?;
    while let Some(line) = lines.next_data()? {
        let row = camera_row(line);
        let (id, camera) = row.map_err(|message| lines.error(message))?;
        if cameras.insert(id, camera).is_some() {
            return Err(lines.error(format!("camera {id} is there twice")));
        }
    }
    Ok(cameras)
}

/// `ID MODEL WIDTH HEIGHT PARAMS…`; a model we do not have is the photos' trouble, not the file's.
fn camera_row(line: &str) -> Result<(u32, Result<Arc<Camera>, String>), String> {
    let fields: Vec<&str> = line.split_ascii_whitespace().collect();
    if fields.len() < 5 {
        return Err(format!("{} fields: expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS", fields.len()));
    }
    let params: Result<Vec<f64>, String> = fields[4..].iter().map(|field| number(field)).collect();
    let camera = models::camera(fields[1], number(fields[2])?, number(fields[3])?, &params?);
    Ok((number(fields[0])?, camera))
}

/// Reads `images.txt`: two lines each, of which the second (the observations) is skipped and may be empty.
pub(super) fn images(path: &Path, mut take: impl FnMut(ImageRow)) -> Result<(), SurveyError> {
    let mut lines = Lines::open(path)?;
    while let Some(line) = lines.next_data()? {
        let row = image_row(line);
        let row = row.map_err(|message| {
            lines
                .error(message)
                .hint("each image has two lines: its pose, and its observations, which may be an empty line")
        })?;
        take(row);
        lines.skip_one()?;
    }
    Ok(())
}

/// `ID QW QX QY QZ TX TY TZ CAMERA NAME`; the name is the rest of the line and may hold spaces.
fn image_row(line: &str) -> Result<ImageRow, String> {
    const N_FIELDS: usize = 9;
    let mut rest = line;
    let mut fields = [""; N_FIELDS];
    for field in &mut fields {
        let (first, after) = rest.split_once([' ', '\t']).ok_or("expected ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")?;
        *field = first;
        rest = after.trim_start();
    }
    if rest.is_empty() {
        return Err("the image has no name".to_owned());
    }
    let _id: u32 = number(fields[0])?;
    let mut values = [0.0; 7];
    for (value, field) in values.iter_mut().zip(&fields[1..8]) {
        *value = number(field)?;
    }
    Ok(ImageRow {
        wxyz: [values[0], values[1], values[2], values[3]],
        translation: DVec3::new(values[4], values[5], values[6]),
        camera_id: number(fields[8])?,
        name: rest.to_owned(),
    })
}

fn number<T: std::str::FromStr>(field: &str) -> Result<T, String> {
    field.parse().map_err(|_| format!("{field:?} is not a number of the expected kind"))
}

/// Lines of a text file with their numbers; one buffer, whatever the file's size.
struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    line: Vec<u8>,
    number: u64,
}

impl<'a> Lines<'a> {
    fn open(path: &'a Path) -> Result<Self, SurveyError> {
        let file = File::open(path).map_err(FileError::on("cannot open", path))?;
        Ok(Self { path, reader: BufReader::with_capacity(1 << 18, file), line: Vec::new(), number: 0 })
    }

    /// The next line that is neither empty nor a comment.
    fn next_data(&mut self) -> Result<Option<&str>, SurveyError> {
        loop {
            self.line.clear();
            let n = self.reader.read_until(b'\n', &mut self.line).map_err(FileError::on("cannot read", self.path))?;
            if n == 0 {
                return Ok(None);
            }
            self.number += 1;
            let text = self.line.trim_ascii();
            if !text.is_empty() && text[0] != b'#' {
                break;
            }
        }
        match std::str::from_utf8(self.line.trim_ascii()) {
            Ok(text) => Ok(Some(text)),
            Err(_) => Err(SurveyError::malformed(self.path, Place::Line(self.number), "not UTF-8 text")),
        }
    }

    /// Passes over one line without keeping it.
    fn skip_one(&mut self) -> Result<(), SurveyError> {
        self.number += 1;
        self.reader.skip_until(b'\n').map_err(FileError::on("cannot read", self.path))?;
        Ok(())
    }

    fn error(&self, message: impl Into<String>) -> SurveyError {
        SurveyError::malformed(self.path, Place::Line(self.number), message)
    }
}
