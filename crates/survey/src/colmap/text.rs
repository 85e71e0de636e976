//! COLMAP's text files.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::{CamerasById, ImageRow, models};
use crate::error::Place;
use crate::{SurveyError, text};
use sizeup_geo::files::FileError;
use sizeup_heights::camera::Camera;

/// Reads `cameras.txt`, the cameras by their ids.
pub(super) fn cameras(path: &Path) -> Result<CamerasById, SurveyError> {
    let mut cameras = CamerasById::new();
    let mut lines = NumberedLines::open(path)?;
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

/// Reads `images.txt`: a pose per image, and a line of observations after it, which may be empty. Tools that strip blank
/// lines leave the empty ones out: a line that is no list of observations is the next image.
pub(super) fn images(path: &Path, mut take: impl FnMut(ImageRow)) -> Result<(), SurveyError> {
    let mut lines = NumberedLines::open(path)?;
    let mut is_waiting = lines.next_data()?.is_some();
    while is_waiting {
        let row = image_row(lines.text()?).map_err(|message| {
            lines
                .error(message)
                .hint("each image has two lines: its pose, and its observations, which may be an empty line")
        })?;
        take(row);
        is_waiting = match lines.next_line()? {
            Some(line) if line.is_empty() || are_observations(line) => lines.next_data()?.is_some(),
            Some(line) if line.starts_with('#') => lines.next_data()?.is_some(),
            following => following.is_some(),
        };
    }
    Ok(())
}

/// Reads `points3D.txt`, `ID X Y Z R G B ERROR (IMAGE_ID POINT2D_IDX)…`: positions of points that at least so many photos see.
pub(super) fn points(path: &Path, min_photos: usize, mut take: impl FnMut(DVec3)) -> Result<(), SurveyError> {
    const N_FIELDS: usize = 8;
    let mut lines = NumberedLines::open(path)?;
    while let Some(line) = lines.next_data()? {
        let mut position = line.split_ascii_whitespace().skip(1).map(number::<f64>);
        let mut next = || position.next().unwrap_or_else(|| Err("expected ID X Y Z R G B ERROR TRACK".to_owned()));
        let at = next().and_then(|x| Ok(DVec3::new(x, next()?, next()?)));
        let n_fields = line.split_ascii_whitespace().count();
        let at = at.map_err(|message| lines.error(message))?;
        if n_fields >= N_FIELDS + 2 * min_photos {
            take(at);
        }
    }
    Ok(())
}

/// Whether a line lists observations (`X Y POINT3D_ID` each) and no pose: numbers only, in threes. The tenth field of a
/// pose is a name; so long a line of numbers is no pose whatever follows.
fn are_observations(line: &str) -> bool {
    const N_TOLD_APART: usize = 13;
    let mut n_fields = 0;
    for field in line.split_ascii_whitespace().take(N_TOLD_APART) {
        if field.parse::<f64>().is_err() {
            return false;
        }
        n_fields += 1;
    }
    n_fields == N_TOLD_APART || n_fields % 3 == 0
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
struct NumberedLines<'a> {
    path: &'a Path,
    reader: BufReader<text::Utf8<File>>,
    line: Vec<u8>,
    number: u64,
}

impl<'a> NumberedLines<'a> {
    fn open(path: &'a Path) -> Result<Self, SurveyError> {
        Ok(Self { path, reader: text::open(path)?, line: Vec::new(), number: 0 })
    }

    /// The next line that is neither empty nor a comment.
    fn next_data(&mut self) -> Result<Option<&str>, SurveyError> {
        while self.advance()? {
            let text = self.line.trim_ascii();
            if !text.is_empty() && text[0] != b'#' {
                return self.text().map(Some);
            }
        }
        Ok(None)
    }

    /// The next line, whatever it holds, without the blanks around it.
    fn next_line(&mut self) -> Result<Option<&str>, SurveyError> {
        if self.advance()? { self.text().map(Some) } else { Ok(None) }
    }

    /// Reads one line; `false` at the end.
    fn advance(&mut self) -> Result<bool, SurveyError> {
        self.line.clear();
        let n = self.reader.read_until(b'\n', &mut self.line).map_err(FileError::on("cannot read", self.path))?;
        self.number += u64::from(n > 0);
        Ok(n > 0)
    }

    /// The line that was read last.
    fn text(&self) -> Result<&str, SurveyError> {
        std::str::from_utf8(self.line.trim_ascii())
            .map_err(|_| SurveyError::malformed(self.path, Place::Line(self.number), "not UTF-8 text"))
    }

    fn error(&self, message: impl Into<String>) -> SurveyError {
        SurveyError::malformed(self.path, Place::Line(self.number), message)
    }
}
