//! Reads a set and checks it: what is missing, damaged or does not fit is named with its file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::DVec2;
use sizeup_footprints::segment::geometry::{Lean, relief, resample};
use sizeup_geo::files;
use sizeup_geo::geodata::raster::CellWindow;
use sizeup_heights::prior::{DepthPrior, PriorGeometry};
use sizeup_heights::raster::Raster;
use sizeup_heights::views::NADIR_WITHIN_DEG;

use super::Split;
use super::coco::{CocoImage, CocoSet};
use super::labels::UNKNOWN;
use super::manifest::{FILE, FORMAT, FileEntry, Manifest};
use super::sources::read_photo;
use crate::TrainError;

/// A set whose files are those that its manifest lists.
#[derive(Debug)]
pub struct Set {
    /// Folder of the set.
    pub root: PathBuf,
    /// Contents of the set.
    pub manifest: Manifest,
}

/// A photo with its labels, all at the photo's size, row by row.
#[derive(Debug, Clone)]
pub struct Photo {
    /// What the set says of it.
    pub image: CocoImage,
    /// Columns and rows of the photo.
    pub size: (usize, usize),
    /// Red, green, blue, 0 to 255.
    pub rgb: Vec<[u8; 3]>,
    /// How far things stand out of the ground's plane; empty without depth.
    pub relief: Vec<f32>,
    /// Which way upright things lean.
    pub lean: Lean,
    /// Whose footprint on the ground a pixel lies in.
    pub ground: Raster<u16>,
    /// Whose roof a pixel shows.
    pub roof: Raster<u16>,
}

impl Set {
    /// Opens a set and holds every file against its size and SHA-256.
    ///
    /// # Errors
    /// [`TrainError::Set`] with the file, what was expected and what was found.
    pub fn open(root: &Path) -> Result<Self, TrainError> {
        let path = root.join(FILE);
        let remake = "make the set anew with `sizeup-train dataset`";
        if !path.exists() {
            return Err(TrainError::set(&path, "there is no such file: expected a set", remake));
        }
        let bytes = files::read_bytes(&path)?;
        let manifest: Manifest = serde_json::from_slice(&bytes)
            .map_err(|e| TrainError::set(&path, format!("it is no manifest of a set: {e}"), remake))?;
        if manifest.format != FORMAT {
            let problem = format!("expected the form {FORMAT:?}, found {:?}", manifest.format);
            return Err(TrainError::set(&path, problem, remake));
        }
        let mut names = BTreeSet::new();
        if let Some(twice) = manifest.scenes.iter().find(|s| !names.insert(&s.name)) {
            let problem = format!("the scene {:?} is in it twice", twice.name);
            return Err(TrainError::set(&path, problem, "a scene is in one split only"));
        }
        for (name, expected) in &manifest.files {
            let file = root.join(name);
            if !file.exists() {
                return Err(TrainError::set(&file, "the manifest lists it, and it is missing", "copy the whole set"));
            }
            let found = FileEntry::of(&file)?;
            if found != *expected {
                let problem = format!(
                    "it is not the file that the manifest lists: expected {} bytes with SHA-256 {}, found {} with {}",
                    expected.bytes, expected.sha256, found.bytes, found.sha256
                );
                return Err(TrainError::set(&file, problem, "copy it anew, or make the set anew"));
            }
        }
        Ok(Self { root: root.to_owned(), manifest })
    }

    /// The COCO file of a split; empty where the set has none.
    ///
    /// # Errors
    /// [`TrainError::Set`] for one that is damaged or contradicts itself.
    pub fn coco(&self, split: Split) -> Result<CocoSet, TrainError> {
        let name = format!("{}.json", split.name());
        if !self.manifest.files.contains_key(&name) {
            return Ok(CocoSet::default());
        }
        let path = self.root.join(name);
        let coco: CocoSet = serde_json::from_slice(&files::read_bytes(&path)?)
            .map_err(|e| TrainError::set(&path, format!("it is no COCO file of a set: {e}"), "make the set anew"))?;
        let mut instances: BTreeMap<usize, usize> = coco.images.iter().map(|i| (i.id, 0)).collect();
        for annotation in &coco.annotations {
            let Some(n) = instances.get_mut(&annotation.image_id) else {
                let problem =
                    format!("instance {} is in photo {}, which it does not list", annotation.id, annotation.image_id);
                return Err(TrainError::set(&path, problem, "`image_id` names one of `images`"));
            };
            *n += 1;
        }
        for image in &coco.images {
            let refuse = |problem: String, hint: &str| {
                Err(TrainError::set(&path, format!("{}: {problem}", image.file_name), hint))
            };
            if image.off_nadir_deg > NADIR_WITHIN_DEG {
                let found =
                    format!("it looks {:.1}° off the nadir, expected {NADIR_WITHIN_DEG}° at most", image.off_nadir_deg);
                return refuse(found, "footprints on the ground are learned from near-nadir photos: leave it out");
            }
            if instances.get(&image.id) == Some(&0) {
                let found = "it has no footprints; a network would learn that what it shows is no building".to_owned();
                return refuse(found, "draw its buildings, or leave it out");
            }
            let scene = self.manifest.scenes.iter().find(|s| s.name == image.scene);
            if scene.is_none_or(|s| s.split != split) {
                let found = format!("its scene {:?} is not in the split {:?}", image.scene, split.name());
                return refuse(found, "a scene is in one split only: what is tested was never seen");
            }
        }
        Ok(coco)
    }

    /// All photos of a split.
    ///
    /// # Errors
    /// [`TrainError::Set`] for the first that cannot be used.
    pub fn photos(&self, split: Split) -> Result<Vec<Photo>, TrainError> {
        self.coco(split)?.images.into_iter().map(|image| self.photo(image)).collect()
    }

    fn photo(&self, image: CocoImage) -> Result<Photo, TrainError> {
        let path = self.root.join(&image.file_name);
        let rgb = read_photo(&path)?.to_rgb8();
        let size = (image.width as usize, image.height as usize);
        if rgb.dimensions() != (image.width, image.height) {
            return Err(misfit(&path, size, (rgb.width() as usize, rgb.height() as usize)));
        }
        let lean = Lean { nadir_px: image.nadir_px, focal_px: image.focal_px };
        let relief = match &image.prior {
            None => Vec::new(),
            Some(prior) => {
                let path = self.root.join(&prior.file);
                let values = read_npy(&path)?;
                // A prior is the whole photo, resized; rounding may leave one row or column.
                let off = (values.width() as f64 / size.0 as f64 * size.1 as f64 - values.height() as f64).abs();
                if off > 1.5 {
                    return Err(misfit(&path, size, (values.width(), values.height())));
                }
                let depth = DepthPrior { values, kind: prior.kind, geometry: PriorGeometry::ZDepth };
                resample(&relief(&depth), size, CellWindow { col: 0, row: 0, width: size.0, height: size.1 }, size)
            }
        };
        let (ground, roof) = (self.labels(&image.ground, size)?, self.labels(&image.roof, size)?);
        Ok(Photo { rgb: rgb.pixels().map(|p| p.0).collect(), size, relief, lean, ground, roof, image })
    }

    /// Labels of a photo: `ground`, `roof` or `visible` of what the set says of it.
    ///
    /// # Errors
    /// [`TrainError::Set`] for a file of another size or kind.
    pub fn labels(&self, name: &str, size: (usize, usize)) -> Result<Raster<u16>, TrainError> {
        let path = self.root.join(name);
        let image::DynamicImage::ImageLuma16(labels) = read_photo(&path)? else {
            return Err(TrainError::set(
                &path,
                "expected 16-bit labels of one channel, found another kind",
                "make the set anew",
            ));
        };
        let found = (labels.width() as usize, labels.height() as usize);
        let misfits = || misfit(&path, size, found);
        if found != size {
            return Err(misfits());
        }
        Raster::from_vec(size.0, size.1, labels.into_raw()).ok_or_else(misfits)
    }
}

impl Photo {
    /// The photo with blocks of `n × n` pixels made one: the mean of their colours, the label and the relief of their middle. Thinning a
    /// much finer photo out instead gives noise that no network sees in use.
    #[must_use]
    pub fn reduced(self, n: usize) -> Self {
        if n < 2 {
            return self;
        }
        let (width, size) = (self.size.0, (self.size.0 / n, self.size.1 / n));
        let cells = || (0..size.0 * size.1).map(|i| (i % size.0 * n, i / size.0 * n));
        let middles: Vec<usize> = cells().map(|(col, row)| (row + n / 2) * width + col + n / 2).collect();
        let mean = |(col, row): (usize, usize)| {
            let block = (row..row + n).flat_map(|r| (col..col + n).map(move |c| r * width + c));
            let sum = block.fold([0_usize; 3], |sum, i| [0, 1, 2].map(|c| sum[c] + usize::from(self.rgb[i][c])));
            sum.map(|s| (s / (n * n)) as u8)
        };
        let labels = |from: &Raster<u16>| {
            let values = middles.iter().map(|i| from.data()[*i]).collect();
            Raster::from_vec(size.0, size.1, values).expect("one label per pixel")
        };
        let scale = 1.0 / n as f64;
        Self {
            rgb: cells().map(mean).collect(),
            relief: if self.relief.is_empty() { Vec::new() } else { middles.iter().map(|i| self.relief[*i]).collect() },
            lean: Lean { nadir_px: self.lean.nadir_px.map(|v| v * scale), focal_px: self.lean.focal_px * scale },
            ground: labels(&self.ground),
            roof: labels(&self.roof),
            image: CocoImage { ground_sample_m: self.image.ground_sample_m * n as f64, ..self.image },
            size,
        }
    }

    /// The lean at a pixel's centre.
    #[must_use]
    pub fn lean_at(&self, col: usize, row: usize) -> DVec2 {
        self.lean.at(DVec2::new(col as f64 + 0.5, row as f64 + 0.5))
    }

    /// Share of the pixels that lie in a footprint.
    #[must_use]
    pub fn built_share(&self) -> f64 {
        let n = self.ground.data().iter().filter(|l| **l != 0 && **l != UNKNOWN).count();
        n as f64 / self.ground.data().len() as f64
    }
}

fn misfit(path: &Path, expected: (usize, usize), found: (usize, usize)) -> TrainError {
    let problem =
        format!("expected the photo's {} × {} pixels, found {} × {}", expected.0, expected.1, found.0, found.1);
    TrainError::set(path, problem, "labels and depth are of the whole photo, never cropped or turned")
}

fn read_npy(path: &Path) -> Result<Raster<f32>, TrainError> {
    let unusable = |reason: String| {
        TrainError::set(
            path,
            format!("it cannot be read as depth: {reason}"),
            "expected a .npy of 32-bit floats, rows × columns",
        )
    };
    let bytes = files::read_bytes(path)?;
    let npy = npyz::NpyFile::new(&bytes[..]).map_err(|e| unusable(e.to_string()))?;
    let [height, width] = npy.shape()[..] else { return Err(unusable(format!("its shape is {:?}", npy.shape()))) };
    let values = npy.into_vec::<f32>().map_err(|e| unusable(e.to_string()))?;
    Raster::from_vec(width as usize, height as usize, values).ok_or_else(|| unusable("it is cut off".to_owned()))
}
