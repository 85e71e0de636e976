//! Clouds from files.

use std::fs;
use std::io::{BufReader, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::contained::contained;
use super::{Cloud, claims, instances};
use crate::files::{self, FileError, write_whole};

/// Points are unpacked so many bytes at a time: a million of the usual ones, and few of those that say to have 65 kB each.
const BYTES_AT_ONCE: u64 = 32 << 20;
/// Values of GeoTIFF's key of the vertical system that are EPSG codes.
const CODES: std::ops::Range<u16> = 1_024..32_767;

/// Why a cloud cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CloudError {
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// No LAS or LAZ.
    #[error("cannot read {} as LAS or LAZ", path.display())]
    Las {
        /// Path of the point cloud's file.
        path: PathBuf,
        /// Error that the reader reported.
        #[source]
        source: las::Error,
    },
    /// A header that claims more than there is, or than may be read.
    #[error("{} is no sound LAS or LAZ: {problem}", path.display())]
    Claim {
        /// Path of the point cloud's file.
        path: PathBuf,
        /// The claim of its header that cannot hold.
        problem: String,
    },
    /// A line of a text file is no point.
    #[error("{}, line {line}: {text:?} is not `x y z [instance]`\nhint: columns split by spaces, tabs, commas or semicolons", path.display())]
    Line {
        /// Path of the point cloud's file.
        path: PathBuf,
        /// Number of the line, counted from 1.
        line: usize,
        /// Text of the line.
        text: String,
    },
    /// Clouds of one folder that do not go together.
    #[error("{} has another CRS, or other columns, than the clouds before it in its folder\nhint: one folder holds one cloud in tiles", path.display())]
    Tile {
        /// Path of the first cloud that differs.
        path: PathBuf,
    },
    /// A file without any point.
    #[error("{} holds no points", path.display())]
    Empty {
        /// Path of the point cloud's file.
        path: PathBuf,
    },
}

/// Whether a path is taken for a cloud: a file by its extension, or a folder with such files.
#[must_use]
pub fn is_cloud(path: &Path) -> bool {
    const EXTENSIONS: [&str; 4] = ["las", "laz", "xyz", "txt"];
    if path.is_dir() {
        return !tiles(path).is_empty();
    }
    path.extension().is_some_and(|found| EXTENSIONS.iter().any(|e| found.eq_ignore_ascii_case(e)))
}

/// The clouds of a folder, by name.
fn tiles(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut tiles: Vec<PathBuf> = entries.filter(|path| path.is_file() && is_cloud(path)).collect();
    tiles.sort();
    tiles
}

/// Reads LAS or LAZ by extension, else text; of a folder, all its clouds as one, which must agree in their CRS. Positions that are not finite are left out.
///
/// # Errors
/// [`CloudError`].
pub fn read(path: &Path) -> Result<Cloud, CloudError> {
    if path.is_dir() {
        return read_tiles(path);
    }
    let is_las = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("las") || e.eq_ignore_ascii_case("laz"));
    let cloud = if is_las { read_las(path)? } else { read_text(path)? };
    if cloud.points.is_empty() {
        return Err(CloudError::Empty { path: path.to_owned() });
    }
    Ok(cloud)
}

fn read_tiles(folder: &Path) -> Result<Cloud, CloudError> {
    let mut whole: Option<Cloud> = None;
    for path in tiles(folder) {
        let tile = read(&path)?;
        let Some(whole) = &mut whole else {
            whole = Some(tile);
            continue;
        };
        let agree = whole.crs == tile.crs
            && whole.classes.is_empty() == tile.classes.is_empty()
            && whole.instances.is_empty() == tile.instances.is_empty();
        if !agree {
            return Err(CloudError::Tile { path });
        }
        whole.points.extend(tile.points);
        whole.classes.extend(tile.classes);
        whole.instances.extend(tile.instances);
    }
    whole.ok_or_else(|| CloudError::Empty { path: folder.to_owned() })
}

fn read_las(path: &Path) -> Result<Cloud, CloudError> {
    let mut file = BufReader::new(fs::File::open(path).map_err(FileError::on("cannot read", path))?);
    let checked = claims::check(&mut file);
    let end = checked.map_err(|e| CloudError::Claim { path: path.to_owned(), problem: e.to_string() })?;
    file.rewind().map_err(FileError::on("cannot read", path))?;
    let failed = |source| CloudError::Las { path: path.to_owned(), source };
    // Whether packed points make sense shows when they are unpacked.
    let garbled = |words: String| {
        let problem = format!("its points are garbled ({words})\nhint: copy it again");
        CloudError::Claim { path: path.to_owned(), problem }
    };
    let file = claims::UpTo::new(file, end);
    let mut reader = contained(|| las::Reader::new(file)).map_err(garbled)?.map_err(failed)?;
    let header = reader.header();
    let wkt = header.get_wkt_crs_bytes().and_then(|bytes| std::str::from_utf8(bytes).ok());
    let crs = wkt.map(|text| text.trim_end_matches('\0').to_owned()).or_else(|| {
        let keys = header.get_geotiff_crs().ok().flatten()?;
        let plane = keys.get_projected_crs_geo_key_value()?;
        let heights = keys.get_vertical_crs_geo_key_value().filter(|code| CODES.contains(code));
        Some(heights.map_or_else(|| format!("EPSG:{plane}"), |heights| format!("EPSG:{plane}+{heights}")))
    });
    let vlrs = header.vlrs().clone();
    let n_at_once = (BYTES_AT_ONCE / u64::from(header.point_format().len().max(1))).max(1);
    let mut cloud = Cloud { crs, ..Cloud::default() };
    // Memory grows with the points that come, not with those that are announced.
    loop {
        let piece = contained(|| reader.read_points(n_at_once)).map_err(garbled)?.map_err(failed)?;
        if piece.is_empty() {
            break;
        }
        cloud.points.extend(piece.x().zip(piece.y()).zip(piece.z()).map(|((x, y), z)| DVec3::new(x, y, z)));
        cloud.classes.extend(piece.classification());
        let instances = instances::instances(&vlrs, &piece);
        cloud.instances.extend(instances);
        cloud.instances.resize(cloud.points.len(), None);
    }
    // A column of nothing but 0 names no buildings.
    if cloud.instances.iter().all(Option::is_none) {
        cloud.instances.clear();
    }
    Ok(cloud)
}

fn read_text(path: &Path) -> Result<Cloud, CloudError> {
    let text = files::read_text(path)?;
    let mut cloud = Cloud::default();
    let mut has_instances = None;
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let malformed = || CloudError::Line { path: path.to_owned(), line: i + 1, text: line.to_owned() };
        let columns: Vec<&str> = line.split([' ', '\t', ',', ';']).filter(|c| !c.is_empty()).collect();
        let values: Option<Vec<f64>> = columns.iter().take(3).map(|c| c.parse().ok()).collect();
        let values = match values {
            Some(values) if values.len() == 3 => values,
            // One line of column names is usual.
            _ if cloud.points.is_empty() && i == 0 => continue,
            _ => return Err(malformed()),
        };
        let point = DVec3::new(values[0], values[1], values[2]);
        if !point.is_finite() {
            continue;
        }
        // Instances are on every line or on none.
        let instance = columns.get(3).and_then(|c| c.parse::<f64>().ok()).filter(|v| *v >= 0.0 && v.fract() == 0.0);
        if *has_instances.get_or_insert(instance.is_some()) {
            cloud.instances.push(Some(instance.ok_or_else(malformed)? as u32).filter(|i| *i > 0));
        }
        cloud.points.push(point);
    }
    // A column of nothing but 0 names no buildings.
    if cloud.instances.iter().all(Option::is_none) {
        cloud.instances.clear();
    }
    Ok(cloud)
}

/// Writes `x y z` or `x y z instance` in millimetres.
///
/// # Errors
/// [`FileError`].
pub fn write_text(path: &Path, cloud: &Cloud) -> Result<(), FileError> {
    write_whole(path, |out| {
        let mut text = Vec::with_capacity(cloud.points.len() * 40);
        for (i, p) in cloud.points.iter().enumerate() {
            write!(text, "{:.3} {:.3} {:.3}", p.x, p.y, p.z)?;
            match cloud.instances.get(i) {
                Some(instance) => writeln!(text, " {}", instance.unwrap_or(0))?,
                None => writeln!(text)?,
            }
        }
        out.write_all(&text)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(text: &str) -> Result<Cloud, CloudError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.xyz");
        fs::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn text_with_commas_names_and_instances_is_read() {
        let cloud = written("x,y,z,instance\n1.5,2,3,7\n4,5,6,8\n\nnan,1,1,2\n").unwrap();
        assert_eq!(cloud.points, [DVec3::new(1.5, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]);
        assert_eq!(cloud.instances, [Some(7), Some(8)]);
        assert_eq!(written("1 2 3 0\n4 5 6 9\n").unwrap().instances, [None, Some(9)]);
        assert!(written("1 2 3 0\n").unwrap().instances.is_empty());
    }

    #[test]
    fn a_bad_line_is_named_and_no_points_are_an_error() {
        let bad = written("1 2 3\n1 2\n").unwrap_err().to_string();
        assert!(bad.contains("line 2") && bad.contains("hint:"), "{bad}");
        assert!(matches!(written("# nothing\n"), Err(CloudError::Empty { .. })));
        assert!(matches!(written("1 2 3 4\n1 2 3\n"), Err(CloudError::Line { line: 2, .. })));
    }

    #[test]
    fn garbled_points_are_refused_however_their_decoder_ends() {
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = las::point::Format::new(6).unwrap();
        builder.point_format.is_compressed = true;
        let mut writer = las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
        for i in 0..2_000_u16 {
            let place = f64::from(i).sin() * 1e3;
            writer.write_point(las::Point { x: place, y: place, gps_time: Some(place), ..Default::default() }).unwrap();
        }
        writer.close().unwrap();
        let sound = writer.into_inner().unwrap().into_inner();
        // Behind header, record, place of the table, point, count and lengths of layers.
        let points_at = u32::from_le_bytes(sound[96..100].try_into().unwrap()) as usize;
        let (from, to) = (points_at + 8 + 30 + 4 + 36, sound.len() - 40);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.laz");
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as usize
        };
        let mut endings = Vec::new();
        for _ in 0..300 {
            let mut garbled = sound.clone();
            for _ in 0..40 {
                garbled[from + noise() % (to - from)] = noise() as u8;
            }
            fs::write(&path, garbled).unwrap();
            endings.extend(read(&path).err().map(|e| e.to_string()));
        }
        assert!(endings.iter().any(|ending| ending.contains("its points are garbled")), "{endings:?}");
    }
}
