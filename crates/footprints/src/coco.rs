//! COCO JSON: polygons, or run lengths of masks, of many photos in one file.
//!
//! Both forms of run lengths are read: plain counts, and the compressed text of the COCO tools (base 48, five bits per
//! character, sixth bit: more follows; from the fourth count on, differences to the count two before). Runs go down
//! columns, background first. Source: the format's own description (cocodataset.org, "data format").

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use geo::{BooleanOps as _, CoordsIter as _, MakeValid as _, MapCoords as _, Translate as _, Validation as _};
use geo_types::{Coord, LineString, MultiPolygon, Polygon, Rect};
use serde::Deserialize;

use super::contours::{ContourFineness, ViewFault};
use super::layer::FootprintError;
use super::vectorise::{Contour, Instances, MaskFault, Vectorising, contours};
use sizeup_geo::paths;
use sizeup_geo::template;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Most pixels of one mask: beyond that a size is a mistake or an attack.
const MAX_PIXELS: u64 = 1 << 30;

#[derive(Deserialize)]
struct CocoDocument {
    images: Vec<Image>,
    annotations: Vec<Annotation>,
    #[serde(default)]
    categories: Vec<Category>,
}

#[derive(Deserialize)]
struct Image {
    id: i64,
    file_name: String,
    width: u32,
    height: u32,
}

#[derive(Deserialize)]
struct Category {
    id: i64,
    #[serde(default)]
    name: String,
}

#[derive(Deserialize)]
struct Annotation {
    image_id: i64,
    #[serde(default)]
    category_id: i64,
    #[serde(default)]
    score: Option<f32>,
    segmentation: Segmentation,
    /// From a wall's foot to its roof, x and y in pixels, where a program says so.
    #[serde(default)]
    offset: Option<serde_json::Value>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum Segmentation {
    Polygons(Vec<Vec<f64>>),
    Runs { size: [u32; 2], counts: RunLengths },
}

#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum RunLengths {
    Plain(Vec<u64>),
    Compressed(String),
}

/// The buildings of one image.
#[derive(Debug, Clone)]
struct Buildings {
    width: u32,
    height: u32,
    shapes: Vec<(Segmentation, f32)>,
}

/// A COCO file by photo.
#[derive(Debug)]
pub(super) struct CocoFile {
    path: PathBuf,
    by_name: BTreeMap<String, Buildings>,
}

fn refuse(problem: String, hint: &str) -> FootprintError {
    FootprintError::Masks { problem, hint: hint.to_owned() }
}

fn parse<T: serde::de::DeserializeOwned>(path: &Path, expected: &str) -> Result<T, FootprintError> {
    let shown = path.display();
    let file = std::fs::File::open(path)
        .map_err(|e| refuse(format!("cannot read {shown}: {e}"), "`path` is the COCO JSON file"))?;
    serde_json::from_reader(std::io::BufReader::new(file))
        .map_err(|e| refuse(format!("{shown} is no COCO file: {e}"), expected))
}

/// Reads a file; `category` is a name or a number.
pub(super) fn read(path: &Path, category: Option<&str>) -> Result<CocoFile, FootprintError> {
    let shown = path.display();
    let document: CocoDocument = parse(path, "expected images, annotations and categories")?;
    let wanted: Option<Vec<i64>> = match category {
        None => None,
        Some(wanted) => {
            let is_wanted = |c: &&Category| c.name == wanted || c.id.to_string() == wanted;
            let ids: Vec<i64> = document.categories.iter().filter(is_wanted).map(|c| c.id).collect();
            if ids.is_empty() {
                let names: Vec<&str> = document.categories.iter().map(|c| c.name.as_str()).collect();
                let problem = format!("{shown} has no category {wanted:?}, but {}", names.join(", "));
                return Err(refuse(problem, "set `category` to one of them, or leave it out"));
            }
            Some(ids)
        }
    };
    let mut by_id: BTreeMap<i64, (String, Buildings)> = document
        .images
        .into_iter()
        .map(|i| (i.id, (i.file_name, Buildings { width: i.width, height: i.height, shapes: Vec::new() })))
        .collect();
    for annotation in document.annotations {
        if wanted.as_ref().is_some_and(|ids| !ids.contains(&annotation.category_id)) {
            continue;
        }
        if let Some((_, buildings)) = by_id.get_mut(&annotation.image_id) {
            buildings.shapes.push((annotation.segmentation, annotation.score.unwrap_or(1.0).clamp(0.0, 1.0)));
        }
    }
    Ok(CocoFile { path: path.to_owned(), by_name: by_id.into_values().collect() })
}

impl CocoFile {
    /// By the photo's name, else by its name without folder, else by its stem.
    fn find(&self, view: &View) -> Option<&Buildings> {
        let last = |name: &str| paths::file_name(name).to_owned();
        let name = &view.id.0;
        self.by_name.get(name).or_else(|| {
            let same = |f: &dyn Fn(&str) -> String| {
                let mut found = self.by_name.iter().filter(|(other, _)| f(other) == f(name));
                found.next().filter(|_| found.next().is_none()).map(|(_, b)| b)
            };
            same(&last).or_else(|| same(&|n: &str| template::stem(&last(n)).to_owned()))
        })
    }

    /// Whether it names a view.
    pub(super) fn lists(&self, view: &View) -> bool {
        self.find(view).is_some()
    }

    /// The buildings of a view.
    pub(super) fn contours(
        &self,
        view: &View,
        look: ContourFineness,
        min_score: f32,
    ) -> Result<Vec<Contour>, ViewFault> {
        let Some(image) = self.find(view) else { return Err(ViewFault::Unlisted { path: self.path.clone() }) };
        let scale = super::masks::scale_of((image.width as usize, image.height as usize), view, &self.path)?;
        let mut found = Vec::new();
        for (i, (shape, score)) in image.shapes.iter().enumerate().filter(|(_, (_, score))| *score >= min_score) {
            let unusable = |reason: String| ViewFault::Unreadable {
                path: self.path.clone(),
                reason: format!("its annotation {} of this photo is {reason}", i + 1),
            };
            let how = Vectorising {
                instances: Instances::ByLabel,
                min_area_px2: look.min_area_px2 / (scale[0] * scale[1]),
                tolerance_px: look.tolerance_px / scale[0].max(scale[1]),
            };
            let shape_px = shape.contour([image.width, image.height], how).map_err(|fault| match fault {
                ShapeFault::Unusable(reason) => unusable(reason),
                ShapeFault::Mask(fault) => ViewFault::Mask { path: self.path.clone(), fault },
            })?;
            if shape_px.0.is_empty() {
                continue;
            }
            let size = [f64::from(image.width), f64::from(image.height)];
            // Annotators stop a pixel short of the border.
            let on_border = |c: &Coord<f64>| c.x <= 1.0 || c.y <= 1.0 || c.x >= size[0] - 1.0 || c.y >= size[1] - 1.0;
            let is_cut = shape_px.0.iter().flat_map(|p| &p.exterior().0).any(on_border);
            let shape_px = shape_px.map_coords(|c| Coord { x: c.x * scale[0], y: c.y * scale[1] });
            found.push(Contour { shape_px, score: *score, is_cut, label: found.len() as u32 + 1 });
        }
        Ok(found)
    }
}

/// Why an annotation gives no contour.
#[derive(Debug, thiserror::Error)]
enum ShapeFault {
    #[error("{0}")]
    Unusable(String),
    #[error("a mask without contours: {0}")]
    Mask(MaskFault),
}

impl Segmentation {
    /// The contour in an image, pixels of that.
    fn contour(&self, [width, height]: [u32; 2], how: Vectorising) -> Result<MultiPolygon<f64>, ShapeFault> {
        match self {
            Self::Polygons(parts) => Ok(within(polygons(parts).map_err(ShapeFault::Unusable)?, [width, height])),
            Self::Runs { size, counts } => {
                if *size != [height, width] {
                    return Err(ShapeFault::Unusable(format!(
                        "a mask of {} × {} pixels in an image of {width} × {height}",
                        size[1], size[0]
                    )));
                }
                let (mask, origin) = decode(*size, counts).map_err(ShapeFault::Unusable)?;
                let parts = contours(&mask, how).map_err(ShapeFault::Mask)?;
                Ok(parts.into_iter().next().map_or_else(
                    || MultiPolygon::new(Vec::new()),
                    |o| o.shape_px.translate(origin[0] as f64, origin[1] as f64),
                ))
            }
        }
    }
}

/// The part of a building that a COCO file's annotations follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Annotated {
    /// The footprint that is to be compared.
    #[default]
    Footprint,
    /// Roofs, each with an `offset`, x and y in pixels, from the wall's foot to the roof (BONAI's convention): the footprint on
    /// the ground is the roof's, moved back by it.
    RoofAndOffset,
}

/// The instances of one photo.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoInstances {
    /// The photo's file name.
    pub name: String,
    /// Columns and rows of the photo.
    pub size: [u32; 2],
    /// Contours, pixels; they may overlap.
    pub shapes_px: Vec<MultiPolygon<f64>>,
}

/// All instances of a COCO file by photo, in the order of their ids, whoever wrote it. A bare list of annotations, as detectors
/// write their results, belongs to the photos of `images_of`. Instances whose score is below `min_score` are left out.
///
/// # Errors
/// [`FootprintError::Masks`] for a file that cannot be used, with the annotation.
pub fn coco_instances(
    path: &Path,
    images_of: Option<&Path>,
    annotated: Annotated,
    min_score: f32,
) -> Result<Vec<PhotoInstances>, FootprintError> {
    #[derive(Deserialize)]
    struct Images {
        images: Vec<Image>,
    }
    let shown = path.display();
    let (images, annotations) = if is_list(path) {
        let annotations: Vec<Annotation> =
            parse(path, "expected a list of annotations with image_id and segmentation")?;
        let Some(of) = images_of else {
            return Err(refuse(
                format!("{shown} is a list of annotations and names no photos"),
                "expected images, annotations and categories",
            ));
        };
        (parse::<Images>(of, "expected images")?.images, annotations)
    } else {
        let document: CocoDocument =
            parse(path, "expected images, annotations and categories, or a list of annotations")?;
        (document.images, document.annotations)
    };
    let mut photos: BTreeMap<i64, PhotoInstances> = BTreeMap::new();
    for image in images {
        let photo = PhotoInstances { name: image.file_name, size: [image.width, image.height], shapes_px: Vec::new() };
        photos.insert(image.id, photo);
    }
    for (i, annotation) in annotations.iter().enumerate().filter(|(_, a)| a.score.unwrap_or(1.0) >= min_score) {
        let at = format!("{shown}: annotation {}", i + 1);
        let Some(photo) = photos.get_mut(&annotation.image_id) else {
            return Err(refuse(
                format!("{at} is of photo {}, which is not among the images", annotation.image_id),
                "annotations name their photo by `image_id`; are both files of the same photos?",
            ));
        };
        let how = Vectorising { instances: Instances::ByLabel, min_area_px2: 0.0, tolerance_px: 0.0 };
        let shape = annotation.segmentation.contour(photo.size, how).map_err(|fault| {
            refuse(format!("{at} of {} is {fault}", photo.name), "polygons, or run lengths of the photo's size")
        })?;
        photo.shapes_px.push(match annotated {
            Annotated::Footprint => shape,
            Annotated::RoofAndOffset => {
                let [x, y] = annotation.offset().ok_or_else(|| {
                    refuse(
                        format!("{at} of {} has no offset", photo.name),
                        "expected `\"offset\": [x, y]`, pixels, beside each roof",
                    )
                })?;
                within(shape.translate(-x, -y), photo.size)
            }
        });
    }
    Ok(photos.into_values().collect())
}

impl Annotation {
    fn offset(&self) -> Option<[f64; 2]> {
        let offset: [f64; 2] = serde_json::from_value(self.offset.clone()?).ok()?;
        offset.iter().all(|v| v.is_finite()).then_some(offset)
    }
}

/// Whether a file's JSON is a list; not where it cannot be read, which reading it will say.
fn is_list(path: &Path) -> bool {
    let first = |file| std::io::BufReader::new(file).bytes().find(|b| !matches!(b, Ok(b) if b.is_ascii_whitespace()));
    matches!(std::fs::File::open(path).ok().and_then(first), Some(Ok(b'[')))
}

/// Whether a JSON file is COCO: a list of annotations, or images with annotations.
#[must_use]
pub fn is_coco(path: &Path) -> bool {
    #[derive(Deserialize)]
    struct CocoMembers {
        images: Option<Vec<serde::de::IgnoredAny>>,
        annotations: Option<Vec<serde::de::IgnoredAny>>,
    }
    let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    is_json
        && (is_list(path)
            || std::fs::File::open(path)
                .ok()
                .and_then(|file| serde_json::from_reader::<_, CocoMembers>(std::io::BufReader::new(file)).ok())
                .is_some_and(|parts| parts.images.is_some() && parts.annotations.is_some()))
}

/// Part that lies in the image, as contours that neither cross themselves nor each other: what they hold an odd number of
/// times.
fn within(shape: MultiPolygon<f64>, [width, height]: [u32; 2]) -> MultiPolygon<f64> {
    let shape =
        if shape.is_valid() { shape } else { shape.make_valid().unwrap_or_else(|_| MultiPolygon::new(Vec::new())) };
    let (width, height) = (f64::from(width), f64::from(height));
    if shape.coords_iter().all(|c| c.x >= 0.0 && c.y >= 0.0 && c.x <= width && c.y <= height) {
        return shape;
    }
    shape.intersection(&Rect::new((0.0, 0.0), (width, height)).to_polygon())
}

/// Rings as flat lists of x, y.
fn polygons(parts: &[Vec<f64>]) -> Result<MultiPolygon<f64>, String> {
    let ring = |flat: &Vec<f64>| {
        if flat.len() % 2 == 1 || flat.iter().any(|v| !v.is_finite()) {
            return Err(format!("a polygon of {} numbers: expected pairs x, y", flat.len()));
        }
        let mut ring: LineString<f64> = flat.chunks_exact(2).map(|p| Coord { x: p[0], y: p[1] }).collect();
        ring.close();
        Ok(Polygon::new(ring, Vec::new()))
    };
    let parts: Vec<Polygon<f64>> = parts.iter().filter(|p| p.len() >= 6).map(ring).collect::<Result<_, _>>()?;
    Ok(MultiPolygon::new(parts))
}

/// The mask around its own pixels, with a pixel of background where the image has it, and where it lies in the image.
fn decode([height, width]: [u32; 2], counts: &RunLengths) -> Result<(Raster<u32>, [usize; 2]), String> {
    let n = u64::from(height) * u64::from(width);
    if n > MAX_PIXELS {
        return Err(format!("a mask of {width} × {height} pixels, too large to be one"));
    }
    let runs = match counts {
        RunLengths::Plain(runs) => runs.clone(),
        RunLengths::Compressed(text) => decompress(text)?,
    };
    let total = runs.iter().try_fold(0_u64, |sum, run| sum.checked_add(*run));
    if total != Some(n) {
        let total = total.map_or("too many".to_owned(), |t| t.to_string());
        return Err(format!("runs of {total} pixels in a mask of {n}"));
    }
    let (width, height) = (width as usize, height as usize);
    let spans = || {
        runs.iter().scan(0_usize, |at, &run| {
            let from = *at;
            *at += run as usize;
            Some((from, *at))
        })
    };
    let inside: Vec<(usize, usize)> = spans().skip(1).step_by(2).filter(|(from, to)| to > from).collect();
    let (Some(&(first, _)), Some(&(_, after))) = (inside.first(), inside.last()) else {
        return Ok((Raster::filled(1, 1, 0), [0, 0]));
    };
    // Columns are known from the ends; rows only where no run goes over a column's end.
    let (left, right) = (first / height, (after - 1) / height + 1);
    let wraps = inside.iter().any(|(from, to)| from / height != (to - 1) / height);
    let (top, bottom) = if wraps {
        (0, height)
    } else {
        let top = inside.iter().map(|(from, _)| from % height).min().unwrap_or(0);
        (top, inside.iter().map(|(_, to)| (to - 1) % height + 1).max().unwrap_or(height))
    };
    let (left, top) = (left.saturating_sub(1), top.saturating_sub(1));
    let (right, bottom) = ((right + 1).min(width), (bottom + 1).min(height));
    let mut mask = Raster::filled(right - left, bottom - top, 0_u32);
    for (from, to) in inside {
        for i in from..to {
            mask[(i / height - left, i % height - top)] = 1;
        }
    }
    Ok((mask, [left, top]))
}

fn decompress(text: &str) -> Result<Vec<u64>, String> {
    let mut runs: Vec<i64> = Vec::new();
    let mut bytes = text.bytes().peekable();
    while bytes.peek().is_some() {
        let (mut value, mut shift) = (0_i64, 0_u32);
        loop {
            let byte = bytes.next().ok_or("no run lengths: compressed runs end within a number")?;
            let six = i64::from(byte) - 48;
            if !(0..64).contains(&six) || shift > 50 {
                return Err(format!("no run lengths: {:?} in compressed runs", char::from(byte)));
            }
            value |= (six & 0x1f) << shift;
            shift += 5;
            if six & 0x20 == 0 {
                // The fifth bit is the sign.
                if six & 0x10 != 0 {
                    value |= -1 << shift;
                }
                break;
            }
        }
        if runs.len() > 2 {
            value += runs[runs.len() - 2];
        }
        runs.push(value);
    }
    runs.into_iter().map(|run| u64::try_from(run).map_err(|_| format!("a run of {run} pixels"))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_runs_go_down_columns_and_start_with_background() {
        // 3 rows × 4 columns: column 1 full, and the first pixel of column 2.
        let (mask, origin) = decode([3, 4], &RunLengths::Plain(vec![3, 4, 5])).unwrap();
        assert_eq!((mask.width(), mask.height(), origin), (4, 3, [0, 0]));
        assert_eq!(mask.data(), [0, 1, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0]);
        assert!(decode([3, 4], &RunLengths::Plain(vec![3, 4, 4])).unwrap_err().contains("runs of"));
    }

    #[test]
    fn compressed_runs_are_what_the_coco_tools_write() {
        // By hand: 6 -> '6'; 1 -> '1'; 40 -> 40 = 0b01000 + 1·32: 'X' (8 | 32 = 40 -> 88), '1'; then the difference of
        // 4 to the run of 1 two before: 3 -> '3'; and of 30 to 40: −10 -> 'F' ((−10 & 31) = 22, sign bit set, no more).
        assert_eq!(decompress("61X13F").unwrap(), [6, 1, 40, 4, 30]);
        assert!(decompress("6 1").is_err() && decompress("X").is_err());
    }

    /// Against pycocotools 2.0: `encode` of a mask of 37 rows and 53 columns with a block from (row 3, column 5) to
    /// before (30, 20), a hole in it from (8, 9) to before (12, 15), and a block in the lower right corner.
    #[test]
    fn a_mask_of_the_coco_tools_is_read_pixel_by_pixel() {
        let text = "l5k0:000000ZOJ=6CJ=6CJ=6CJ=6CJ=6CJ=6900000000dS1YOSmN000";
        let (mask, [left, top]) = decode([37, 53], &RunLengths::Compressed(text.to_owned())).unwrap();
        for row in 0..37 {
            for col in 0..53 {
                let is_block = (3..30).contains(&row) && (5..20).contains(&col);
                let is_hole = (8..12).contains(&row) && (9..15).contains(&col);
                let expected = (is_block && !is_hole) || (row >= 33 && col >= 50);
                let inner = |i: usize, first: usize| i.checked_sub(first);
                let found = inner(col, left).zip(inner(row, top)).and_then(|(c, r)| mask.get(c, r)).copied();
                assert_eq!(found.unwrap_or(0), u32::from(expected), "{row} {col}");
            }
        }
    }
}
