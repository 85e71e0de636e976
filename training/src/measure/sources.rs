//! What is measured: masks of the set, networks, and what other programs found.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use candle_core::Device;
use geo_types::{LineString, MultiPolygon};
use glam::{DMat3, DVec2, DVec3};
use sizeup_footprints::segment::apart::Apart;
use sizeup_footprints::segment::roofs::{MOST_RISE, Maps, footprints};
use sizeup_footprints::{ContourSource, MaskConfig, MaskFiles, Segmenter, SegmenterConfig};
use sizeup_heights::camera::Camera;
use sizeup_heights::frames::Rigid;
use sizeup_heights::ids::ViewId;
use sizeup_heights::raster::Raster;
use sizeup_photos::prior::{FilePriorConfig, FilePriors};
use sizeup_survey::View;

use super::LEAST_PX;
use crate::dataset::labels::{Middles, UNKNOWN, middles};
use crate::dataset::load::{Photo, Set};
use crate::dataset::rises::rises;
use crate::network::Input;
use crate::train::LossConfig;
use crate::train::checkpoint::Checkpoint;
use crate::{TrainError, export};

/// How far a map of middles without any error falls between two roofs, at least.
const PERFECT_DIP: f32 = 0.2;

/// One row of the table.
#[derive(Debug, Clone, PartialEq)]
pub enum Row {
    /// The roofs themselves, without any error.
    Roofs,
    /// What is visible of the buildings, without any error: what a perfect network for segmentation gives.
    Visible,
    /// The maps of a perfect network, through the watershed and the laying down of roofs: the most that this way can reach.
    Perfect,
    /// A network: an ONNX file of the profile `small.v1`, or a checkpoint.
    Network {
        /// Its name in the table.
        name: String,
        /// Path of the network's file.
        path: PathBuf,
        /// Side of a tile, for a checkpoint.
        tile: usize,
        /// How far the map of middles falls between two buildings; the profile's where left out.
        dip: Option<f32>,
        /// Ground per pixel that finer photos are reduced to, metres; none are where left out.
        pixel_m: Option<f64>,
        /// Number of looks at each tile.
        looks: usize,
        /// An input that it does not get to see; for a checkpoint only.
        without: Option<Input>,
    },
    /// Footprints of another program: a COCO file that names photos as the set does.
    Coco {
        /// Its name in the table.
        name: String,
        /// Path of the COCO file.
        path: PathBuf,
    },
}

impl Row {
    /// Its name in the table.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Roofs => "roof masks, perfect",
            Self::Visible => "visible masks, perfect",
            Self::Perfect => "maps of ground, roofs and rises, perfect",
            Self::Network { name, .. } | Self::Coco { name, .. } => name,
        }
    }

    /// What gives footprints for the photos of a scene; nothing for masks of the set.
    pub(super) fn open(
        &self,
        set: &Set,
        scene: &str,
        first: &Photo,
    ) -> Result<Option<Box<dyn ContourSource>>, TrainError> {
        let failed = |e: &dyn std::fmt::Display| TrainError::Scene { scene: scene.to_owned(), problem: e.to_string() };
        match self {
            Self::Roofs | Self::Visible | Self::Perfect => Ok(None),
            Self::Coco { path, .. } => {
                let text = serde_json::json!({ "path": path, "kind": "coco" });
                let config: MaskConfig = serde_json::from_value(text).expect("a mask's configuration");
                Ok(Some(Box::new(MaskFiles::new(config).map_err(|e| failed(&e))?)))
            }
            Self::Network { path, tile, dip, pixel_m, looks, without, .. } => {
                let depth = first.image.prior.as_ref().map(|prior| {
                    let files = set.root.join(scene).join("priors").join("{stem}.npy");
                    FilePriorConfig::new(files.to_string_lossy(), prior.kind)
                });
                let open = |model: &Path| {
                    let config = SegmenterConfig {
                        pixel_m: *pixel_m,
                        looks: Some(*looks),
                        ..SegmenterConfig::new(model, "small.v1")
                    };
                    let opened = match &depth {
                        None => Segmenter::new(config),
                        Some(depth) => {
                            let files = || Ok(Box::new(FilePriors::new(depth.clone(), [])?) as Box<_>);
                            Segmenter::with_depth(config, Some(&files))
                        }
                    };
                    let network = opened.map_err(|e| failed(&e))?;
                    Ok::<Segmenter, TrainError>(match dip {
                        Some(dip) => network.with_valley(*dip),
                        None => network,
                    })
                };
                if path.extension().is_some_and(|e| e == "safetensors") {
                    let folder = tempfile::tempdir().map_err(|e| failed(&e))?;
                    let model = folder.path().join("network.onnx");
                    let mut network = Checkpoint::read(path, &Device::Cpu)?;
                    if let Some(input) = without {
                        network = network.blind_to(*input)?;
                    }
                    export::write(&network, *tile, &model)?;
                    return Ok(Some(Box::new(open(&model)?)));
                }
                if let Some(input) = without {
                    let problem = format!("{} cannot be measured without {:?}", path.display(), input.name());
                    return Err(TrainError::config(problem, "an ONNX file sees what it sees: name its checkpoint"));
                }
                Ok(Some(Box::new(open(path)?)))
            }
        }
    }

    /// Masks of the set as instances.
    pub(super) fn labels(&self, set: &Set, photo: &Photo) -> Result<Raster<u32>, TrainError> {
        if *self == Self::Perfect {
            return Ok(laid_down(photo));
        }
        let name = if *self == Self::Roofs { &photo.image.roof } else { &photo.image.visible };
        Ok(set.labels(name, photo.size)?.map(|l| u32::from(*l)))
    }
}

/// Footprints from a photo's own labels, as from a network that says nothing else.
fn laid_down(photo: &Photo) -> Raster<u32> {
    let is_there = |label: &u16| f32::from(u8::from(!matches!(*label, 0 | UNKNOWN)));
    let nadir = DVec2::from(photo.lean.nadir_px);
    let rises = rises(&photo.ground, &photo.roof, nadir);
    let rise = |label: &u16| rises.get(label).map_or(0.0, |r| *r as f32 / MOST_RISE);
    let Middles { near, is_seam, .. } = middles(&photo.roof, LossConfig::default().reach_px);
    let raster = |values: Vec<f32>| Raster::from_vec(photo.size.0, photo.size.1, values).expect("one value per pixel");
    let maps = Maps {
        ground: photo.ground.map(is_there),
        roof: photo.roof.map(is_there),
        middle: raster(near),
        seam: raster(is_seam.iter().map(|is| f32::from(u8::from(*is))).collect()),
        rise: photo.roof.map(rise),
    };
    footprints(&maps, nadir, Apart { above: 0.5, dip: PERFECT_DIP, least_px: LEAST_PX / 4 })
}

/// A view that sees what the photo's network is told: straight down, its nadir where the photo's is.
pub(super) fn view_of(set: &Set, photo: &Photo) -> View {
    let (width, height) = photo.size;
    let mut camera = Camera::pinhole(width as u32, height as u32, photo.lean.focal_px);
    (camera.cx_px, camera.cy_px) = photo.lean.nadir_px.into();
    let file = set.root.join(&photo.image.file_name);
    let name = file.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let down = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    View {
        id: ViewId(name),
        camera: Arc::new(camera),
        camera_from_map: Rigid::from_rotation_and_centre(down, DVec3::new(0.0, 0.0, 100.0)),
        image: Some(file),
    }
}

/// Shapes in pixels as labels 1, 2, …: a pixel belongs to the first shape that holds its centre (even-odd rule).
#[must_use]
pub fn fill(shapes: &[MultiPolygon<f64>], (width, height): (usize, usize)) -> Raster<u32> {
    let mut labels = Raster::filled(width, height, 0);
    for (label, shape) in (1..).zip(shapes) {
        let rings: Vec<&LineString<f64>> =
            shape.iter().flat_map(|p| std::iter::once(p.exterior()).chain(p.interiors())).collect();
        for row in 0..height {
            let y = row as f64 + 0.5;
            let mut crossings: Vec<f64> = Vec::new();
            for line in rings.iter().flat_map(|ring| ring.lines()) {
                let (a, b) = (line.start, line.end);
                if (a.y > y) != (b.y > y) {
                    crossings.push(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
                }
            }
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let from = (pair[0] - 0.5).ceil().max(0.0) as usize;
                let to = ((pair[1] - 0.5).ceil().max(0.0) as usize).min(width);
                for col in from..to.max(from) {
                    let cell = &mut labels[(col, row)];
                    if *cell == 0 {
                        *cell = label;
                    }
                }
            }
        }
    }
    labels
}
