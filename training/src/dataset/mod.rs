//! Sets to learn from: near-nadir photos with the footprints of all buildings *on the ground*, as in the paper's `VertiFP`.
//!
//! ```text
//! SET/manifest.json              counts, licences, and every file with its size and SHA-256
//! SET/train.json val.json test.json   COCO: an instance per building and photo, its footprint on the ground
//! SET/SCENE/images/*.jpg|png     photos                      SET/SCENE/priors/*.npy    depth, where there is any
//! SET/SCENE/ground/*.png         16-bit: whose footprint on the ground a pixel lies in; 65535: not known
//! SET/SCENE/roof/*.png           16-bit: whose roof, flat at the building's mean height
//! SET/SCENE/visible/*.png        16-bit: which building the pixel shows
//! ```
//!
//! A scene is in one split only: what is tested was never seen.

pub mod coco;
pub mod labels;
pub mod load;
pub mod make;
pub mod manifest;
pub mod rises;
mod sources;

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_footprints::FootprintConfig;
use sizeup_geo::terrain::TerrainConfig;
use sizeup_photos::prior::FilePriorConfig;
use sizeup_survey::SurveyConfig;
use sizeup_truth::simulate::SimulateConfig;

/// What a scene is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Scenes to learn from.
    Train,
    /// To tell when to stop.
    Val,
    /// Scenes to measure on.
    Test,
}

impl Split {
    /// All three, in the order in which they are used.
    pub const ALL: [Self; 3] = [Self::Train, Self::Val, Self::Test];

    /// Its name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
        }
    }
}

/// A set: its scenes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DatasetConfig {
    /// Where photos come from, and what for.
    pub scene: Vec<SceneConfig>,
}

/// One scene of a set: simulated, or photos of the user's own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneConfig {
    /// Its name and its folder: letters, digits, `-` and `_`.
    pub name: String,
    /// Use of the scene: training, validation or test.
    pub split: Split,
    /// Under which licence its photos are.
    pub licence: String,
    /// A simulated scene; its near-nadir photos are taken, the others are not rendered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulate: Option<SimulateConfig>,
    /// Photos of the user's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photos: Option<PhotosConfig>,
}

/// Photos with poses, footprints and heights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhotosConfig {
    /// Projected CRS in metres that everything is brought to.
    pub crs: String,
    /// Poses and photos, as in a run's configuration.
    pub survey: SurveyConfig,
    /// Footprints on the ground, as in a run's configuration.
    pub footprints: FootprintConfig,
    /// Attribute of the footprints with the height above the ground, metres.
    pub height_field: String,
    /// The ground, as in a run's configuration.
    pub terrain: TerrainConfig,
    /// Depth of every photo, where there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<FilePriorConfig>,
    /// West, south, east, north of where *all* buildings are footprintd, metres; beyond it photos say nothing. All of what the
    /// photos see where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub complete_m: Option<[f64; 4]>,
    /// Longer side that photos are reduced to, pixels; as they are where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub longest_px: Option<u32>,
}

impl DatasetConfig {
    /// Reads a TOML file; its paths are relative to it.
    ///
    /// # Errors
    /// [`crate::TrainError`] for a file that cannot be read or understood.
    pub fn read(path: &Path) -> Result<Self, crate::TrainError> {
        let mut config: Self = crate::config::read_toml(path)?;
        let base = path.parent().unwrap_or(Path::new(""));
        let mut absolute = |p: &mut PathBuf| *p = base.join(&*p);
        for scene in &mut config.scene {
            if let Some(photos) = &mut scene.photos {
                photos.survey.visit_paths(&mut absolute);
                absolute(&mut photos.footprints.path);
                photos.terrain.dtm.iter_mut().for_each(&mut absolute);
                if let Some(prior) = &mut photos.prior {
                    sizeup_geo::paths::visit_template(&mut prior.path, &mut absolute);
                }
            }
            if let Some(cityjson) = scene.simulate.as_mut().and_then(|s| s.cityjson.as_mut()) {
                absolute(&mut cityjson.path);
            }
        }
        Ok(config)
    }
}
