//! Where a project's priors come from: one choice of the configuration, one source.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    AutoConfig, CachedPriors, DepthPrior, DepthUnit, FilePriorConfig, FilePriors, NetworkConfig, NetworkPriors,
    PriorError, PriorSource, StereoConfig, StereoPriors, ahead,
};
use sizeup_geo::paths::{PathVisitor, visit_template};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::ViewId;
use sizeup_survey::View;

/// Where the priors come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "source", rename_all = "snake_case")]
pub enum PriorConfig {
    /// Maps that somebody else computed, one file per photo.
    Files(FilePriorConfig),
    /// A depth network as an ONNX file.
    Network(Box<NetworkConfig>),
    /// No network at all: the photos matched with each other.
    Stereo(StereoConfig),
    /// The best that there is: a network if its file is in place, else stereo.
    Auto(AutoConfig),
}

impl PriorConfig {
    /// Hands every path of these settings to `visit`, which may change it.
    pub fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        match self {
            Self::Files(files) => {
                visit_template(&mut files.path, visit);
                files.names.iter_mut().for_each(visit);
            }
            Self::Network(network) => network.visit_paths(visit),
            Self::Stereo(stereo) => visit(&mut stereo.cache.folder),
            Self::Auto(auto) => auto.visit_paths(visit),
        }
    }

    /// Whether the name of a prior depends on its photo's position in the survey.
    #[must_use]
    pub fn asks_for_positions(&self) -> bool {
        matches!(self, Self::Files(files) if files.path.contains("{index}")) // `auto` has no names of files
    }

    /// Files that all priors depend on: a network's graph and its weights beside it, the names in a stack.
    #[must_use]
    pub fn shared_files(&self) -> Vec<PathBuf> {
        match self {
            Self::Files(files) => files.names.iter().cloned().collect(),
            Self::Network(network) => network.files(),
            Self::Stereo(_) => Vec::new(),
            Self::Auto(_) => self.chosen().shared_files(),
        }
    }

    /// Files that each photo's prior is made from: its file, or the photo.
    ///
    /// # Errors
    /// [`PriorError::Config`] for settings that cannot work.
    pub fn file_of_each(&self, views: &[View]) -> Result<Vec<Option<PathBuf>>, PriorError> {
        match self {
            Self::Files(config) => {
                let files = FilePriors::new(config.clone(), views.iter().map(|view| &view.id))?;
                views.iter().map(|view| files.path_of(&view.id).map(Some)).collect()
            }
            Self::Auto(_) | Self::Network(_) | Self::Stereo(_) => {
                Ok(views.iter().map(|view| view.image.clone()).collect())
            }
        }
    }

    /// The source that priors come from: itself, or what `auto` chooses.
    #[must_use]
    pub fn chosen(&self) -> Cow<'_, Self> {
        match self {
            Self::Auto(auto) => Cow::Owned(auto.chosen()),
            Self::Files(_) | Self::Network(_) | Self::Stereo(_) => Cow::Borrowed(self),
        }
    }

    /// Whether priors are depths in metres as the poses have them, with nothing left to calibrate.
    #[must_use]
    pub fn is_in_metres(&self) -> bool {
        match &*self.chosen() {
            Self::Files(files) => files.unit == DepthUnit::Metre,
            _ => self.matches_photos(),
        }
    }

    /// Unit that files are said to have; `None` where priors are computed.
    #[must_use]
    pub fn unit_of_files(&self) -> Option<DepthUnit> {
        match self {
            Self::Files(files) => Some(files.unit),
            Self::Network(_) | Self::Stereo(_) | Self::Auto(_) => None,
        }
    }

    /// Whether priors come from matching the photos with each other by their poses.
    #[must_use]
    pub fn matches_photos(&self) -> bool {
        match &*self.chosen() {
            Self::Stereo(_) => true,
            Self::Network(network) => network.matches_in_metres(),
            Self::Files(_) | Self::Auto(_) => false,
        }
    }

    /// Source of priors, in words.
    #[must_use]
    pub fn in_words(&self) -> String {
        match self {
            Self::Files(_) => "files".to_owned(),
            Self::Network(network) => format!("the network {}", network.model.display()),
            Self::Stereo(_) => "stereo, the photos matched with each other".to_owned(),
            Self::Auto(auto) => format!("{}: {}", self.chosen().in_words(), auto.why()),
        }
    }

    /// Gets the source ready for a survey over a terrain; no prior is read or computed yet. What computes metres looks for
    /// roofs up to `highest_m` above the ground.
    ///
    /// # Errors
    /// [`PriorError`] for settings that cannot work.
    pub fn open(&self, views: &[View], terrain: &Terrain, highest_m: f32) -> Result<Priors, PriorError> {
        Ok(match self {
            Self::Files(config) => {
                Priors::Files(Box::new(FilePriors::new(config.clone(), views.iter().map(|v| &v.id))?))
            }
            Self::Network(config) => {
                let network = NetworkPriors::new((**config).clone(), views, terrain, f64::from(highest_m))?;
                Priors::Network(Box::new(CachedPriors::new(network, config.cache.open()?)))
            }
            Self::Stereo(config) => {
                let settings = StereoConfig { max_height_m: f64::from(highest_m), ..config.clone() };
                let stereo = StereoPriors::new(settings, views, terrain)?;
                Priors::Stereo(Box::new(CachedPriors::new(stereo, config.cache.open()?)))
            }
            Self::Auto(auto) => {
                auto.check(views)?;
                auto.chosen().open(views, terrain, highest_m)?
            }
        })
    }
}

/// The priors of one survey.
pub enum Priors {
    /// Priors that lie in files.
    Files(Box<FilePriors>),
    /// Priors that a network computes.
    Network(Box<CachedPriors<NetworkPriors>>),
    /// Priors that are matched from the photos alone.
    Stereo(Box<CachedPriors<StereoPriors>>),
}

impl Priors {
    /// For a part of a survey: `positions` are those of its photos in the whole of it, which file names can ask for.
    pub fn set_positions(&mut self, positions: HashMap<ViewId, usize>) {
        if let Self::Files(files) = self {
            files.set_positions(positions);
        }
    }

    /// Files that a view's prior is made from, for the lineage: its file, or its photo.
    ///
    /// # Errors
    /// [`PriorError::Config`] for a photo outside the survey where its position is asked for.
    pub fn file_of(&self, view: &View) -> Result<Option<PathBuf>, PriorError> {
        match self {
            Self::Files(files) => files.path_of(&view.id).map(Some),
            Self::Network(_) | Self::Stereo(_) => Ok(view.image.clone()),
        }
    }
}

impl Priors {
    /// Whether what is computed is kept.
    #[must_use]
    pub fn has_cache(&self) -> bool {
        match self {
            Self::Files(_) => false,
            Self::Network(network) => network.has_cache(),
            Self::Stereo(stereo) => stereo.has_cache(),
        }
    }

    /// Whether they are others over another terrain: what several photos show together is looked for near the ground.
    #[must_use]
    pub fn depend_on_terrain(&self) -> bool {
        match self {
            Self::Files(_) => false,
            Self::Network(network) => network.source().takes_several_photos(),
            Self::Stereo(_) => true,
        }
    }

    /// Whether priors that were used are read, not computed, when they are asked for again.
    #[must_use]
    pub fn are_at_hand(&self) -> bool {
        matches!(self, Self::Files(_)) || self.has_cache()
    }

    /// Why a view has no prior, as far as that can be told without reading or computing one: its file is missing.
    #[must_use]
    pub fn absence(&self, view: &View) -> Option<PriorError> {
        match self {
            Self::Files(files) => files.present_path_of(&view.id).err(),
            Self::Network(_) | Self::Stereo(_) => None,
        }
    }

    /// Whether a view's prior need not be computed any more: it is in a file, or in the cache.
    ///
    /// # Errors
    /// [`PriorError`] as loading it, as far as that can be told without computing.
    pub fn is_kept(&self, view: &View) -> Result<bool, PriorError> {
        match self {
            Self::Files(_) => Ok(true),
            Self::Network(network) => network.is_kept(view),
            Self::Stereo(stereo) => stereo.is_kept(view),
        }
    }
}

impl Priors {
    /// Computes what is wanted and not kept yet, into the cache: per view whether it was kept, or why there is none.
    /// `done` is called once per view.
    #[must_use]
    pub fn compute_ahead(&self, views: &[&View], done: &(dyn Fn() + Sync)) -> Vec<Result<bool, String>> {
        match self {
            Self::Files(_) => views.iter().map(|_| Ok(true)).collect(),
            Self::Network(network) => ahead::in_stages(network, views, done),
            Self::Stereo(stereo) => ahead::one_by_one(stereo, views, done),
        }
    }
}

impl PriorSource for Priors {
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError> {
        match self {
            Self::Files(files) => files.load(view),
            Self::Network(network) => network.load(view),
            Self::Stereo(stereo) => stereo.load(view),
        }
    }
}
