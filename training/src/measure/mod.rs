//! The paper's Table 1: per photo, instances found against instances on the ground.
//!
//! The protocol is `sizeup_truth::evaluate::photos`, as in `sizeup evaluate`: areas of each true instance and its counterpart,
//! and detection at an intersection over union of a half beside them. Instances below [`LEAST_PX`] pixels count for nothing.
//! The intersection over union of pixels is that of all buildings of a photo together, mean over photos: it does not see whether they are told apart.
//! Footprints come through the same code as in `sizeup footprints`: tiles, watershed, contours.

mod matching;
mod sources;

pub use matching::{Compared, compare};
pub use sources::{Row, fill};

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;
use sizeup_footprints::ContourFineness;
use sizeup_heights::raster::Raster;
use sizeup_truth::evaluate::{PhotoAreas, PhotoEvaluation, evaluate_photos};

use crate::TrainError;
use crate::dataset::Split;
use crate::dataset::load::{Photo, Set};
use crate::dataset::make::write_png;

/// Smaller instances count for nothing, pixels: corners at a photo's border.
pub const LEAST_PX: usize = 64;
/// Tolerance of contours, pixels.
const TOLERANCE_PX: f64 = 0.5;
/// Pictures per row and scene.
const SHOWN: usize = 3;

/// One row of the table.
#[derive(Debug, Clone, Serialize)]
pub struct Measured {
    /// Name of what was measured.
    pub name: String,
    /// Intersection over union of all buildings' pixels, mean over photos.
    pub iou_of_pixels: f64,
    /// Measures of instances and areas.
    pub instances: PhotoEvaluation,
}

impl Measured {
    /// The measures of photos.
    #[must_use]
    pub fn of(name: &str, photos: &[Compared]) -> Self {
        let areas: Vec<PhotoAreas> = photos.iter().map(|p| p.areas.clone()).collect();
        let sum: f64 = photos.iter().map(Compared::iou_of_pixels).sum();
        Self {
            name: name.to_owned(),
            iou_of_pixels: sum / photos.len().max(1) as f64,
            instances: evaluate_photos(&areas),
        }
    }
}

/// The table as text for people, its figures in per cent.
///
/// # Panics
/// Never: text can always grow.
#[must_use]
pub fn table(rows: &[Measured]) -> String {
    let mut text = String::from(
        "| | area by building: IoU | P | R | F1 | area by photo: IoU | F1 | detection by photo: P | R | F1 | IoU of pixels | found / true |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let i = &row.instances;
        let (area, photo, hit) = (&i.area_by_building, &i.area_by_photo, &i.detection_by_photo);
        let figures = [
            area.iou,
            area.precision,
            area.recall,
            area.f1,
            photo.iou,
            photo.f1,
            hit.precision,
            hit.recall,
            hit.f1,
            row.iou_of_pixels,
        ];
        let figures = figures.map(|v| format!("{:.1}", 100.0 * v)).join(" | ");
        writeln!(text, "| {} | {figures} | {} / {} |", row.name, i.n_found, i.n_truth).expect("text grows");
    }
    text
}

/// Measures rows on a split, with a few pictures of each where a folder for them is given.
///
/// # Errors
/// [`TrainError`] for a row that cannot be computed.
pub fn measure(set: &Set, split: Split, rows: &[Row], pictures: Option<&Path>) -> Result<Vec<Measured>, TrainError> {
    let photos = set.photos(split)?;
    if photos.is_empty() {
        return Err(TrainError::set(
            &set.root,
            format!("it has no photos for {:?}", split.name()),
            "choose another split",
        ));
    }
    rows.iter().map(|row| measure_row(set, &photos, row, pictures)).collect()
}

fn measure_row(set: &Set, photos: &[Photo], row: &Row, pictures: Option<&Path>) -> Result<Measured, TrainError> {
    let mut counts = Vec::new();
    let mut n_shown = std::collections::BTreeMap::new();
    for scene in &set.manifest.scenes {
        let of_scene: Vec<&Photo> = photos.iter().filter(|p| p.image.scene == scene.name).collect();
        let Some(first) = of_scene.first() else { continue };
        let source = row.open(set, &scene.name, first)?;
        for photo in of_scene {
            let found = match &source {
                None => row.labels(set, photo)?,
                Some(source) => {
                    let view = sources::view_of(set, photo);
                    let look = ContourFineness {
                        min_area_px2: LEAST_PX as f64,
                        tolerance_px: TOLERANCE_PX,
                        pixel_m: photo.image.ground_sample_m,
                    };
                    let found = source.contours(&view, look).map_err(|e| TrainError::Scene {
                        scene: scene.name.clone(),
                        problem: format!("{} on {}: {e}", row.name(), photo.image.file_name),
                    })?;
                    let shapes: Vec<_> = found.contours.into_iter().map(|o| o.shape_px).collect();
                    fill(&shapes, photo.size)
                }
            };
            counts.push(compare(&photo.ground, &found, LEAST_PX));
            let n = n_shown.entry(&scene.name).or_insert(0);
            if let Some(folder) = pictures.filter(|_| *n < SHOWN) {
                let name = format!("{}-{}-{n}.png", row.name().replace(' ', "-"), scene.name);
                picture(photo, &found, &folder.join(name))?;
                *n += 1;
            }
        }
    }
    Ok(Measured::of(row.name(), &counts))
}

/// A photo with true footprints in white and found ones in red.
fn picture(photo: &Photo, found: &Raster<u32>, path: &Path) -> Result<(), TrainError> {
    let (width, height) = photo.size;
    let mut bytes = Vec::with_capacity(3 * width * height);
    for row in 0..height {
        for col in 0..width {
            let colour = if is_edge(found, col, row) {
                [255, 50, 20]
            } else if is_edge(&photo.ground, col, row) {
                [255; 3]
            } else {
                photo.rgb[row * width + col]
            };
            bytes.extend(colour);
        }
    }
    write_png(path, &bytes, (width as u32, height as u32), image::ExtendedColorType::Rgb8)
}

fn is_edge<T: PartialEq>(map: &Raster<T>, col: usize, row: usize) -> bool {
    let here = &map[(col, row)];
    map.get(col + 1, row).is_some_and(|v| v != here) || map.get(col, row + 1).is_some_and(|v| v != here)
}
