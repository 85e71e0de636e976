//! What is measured: masks of the set, networks, and what other programs found.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use candle_core::Device;
use geo_types::{LineString, MultiPolygon};
use glam::{DMat3, DVec3};
use sizeup_footprints::{ContourSource, MaskConfig, MaskFiles, Segmenter, SegmenterConfig};
use sizeup_heights::camera::Camera;
use sizeup_heights::frames::Rigid;
use sizeup_heights::ids::ViewId;
use sizeup_heights::raster::Raster;
use sizeup_photos::prior::FilePriorConfig;
use sizeup_survey::View;

use crate::dataset::load::{Photo, Set};
use crate::network::Input;
use crate::train::checkpoint::Checkpoint;
use crate::{TrainError, export};

/// One row of the table.
#[derive(Debug, Clone, PartialEq)]
pub enum Row {
    /// The roofs themselves, without any error.
    Roofs,
    /// What is visible of the buildings, without any error: what a perfect network for segmentation gives.
    Visible,
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
            Self::Roofs | Self::Visible => Ok(None),
            Self::Coco { path, .. } => {
                let text = serde_json::json!({ "path": path, "kind": "coco" });
                let config: MaskConfig = serde_json::from_value(text).expect("a mask's configuration");
                Ok(Some(Box::new(MaskFiles::new(config).map_err(|e| failed(&e))?)))
            }
            Self::Network { path, tile, dip, without, .. } => {
                let depth = first.image.prior.as_ref().map(|prior| {
                    let files = set.root.join(scene).join("priors").join("{stem}.npy");
                    FilePriorConfig::new(files.to_string_lossy(), prior.kind)
                });
                let open = |model: &Path| {
                    let config =
                        SegmenterConfig { depth: depth.clone(), dip: *dip, ..SegmenterConfig::new(model, "small.v1") };
                    Segmenter::new(config).map_err(|e| failed(&e))
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
                Ok(Some(Box::new(open(path)?)))
            }
        }
    }

    /// Masks of the set as instances.
    pub(super) fn labels(&self, set: &Set, photo: &Photo) -> Result<Raster<u32>, TrainError> {
        let name = if *self == Self::Roofs { &photo.image.roof } else { &photo.image.visible };
        Ok(set.labels(name, photo.size)?.map(|l| u32::from(*l)))
    }
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
