//! Buildings from a segmentation network that the user brings as ONNX files.
//!
//! What the network wants is a [`SegmenterProfile`]: data, not code. Photos are cut into tiles, each brought to the
//! network's square; what the tiles say is put together again at the photo's own pixels.

mod apart;
pub mod geometry;
pub mod profile;
mod small;
mod tiles;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::small::{SMALL, SmallNetwork};

use self::apart::{Apart, split};
use self::geometry::{Lean, relief};
use self::profile::{Activation, Gives, SegmenterProfile, built_in, port};
use self::tiles::{Joiner, Mosaic, at_photo_size};
use super::cadastre::CadastreConfig;
use super::consensus::ConsensusConfig;
use super::contours::{ContourKind, ContourSource, Look, ViewFault};
use super::georeference::InputAccuracy;
use super::layer::FootprintError;
use super::vectorise::{Contour, Instances, MaskFault, Vectorising, contours, contours_at_level};
use sizeup_geo::geodata::raster::{RasterFile, Resampling, Window};
use sizeup_geo::paths::{PathVisitor, visit_template};
use sizeup_heights::raster::Raster;
use sizeup_photos::onnx::{Network, OnnxError, Tensor};
use sizeup_photos::prior::{FilePriorConfig, FilePriors, PriorError, PriorSource};
use sizeup_survey::View;

/// Least part of a map that is a building beside another one, as a share of the least building that is looked for.
const PART_SHARE: f64 = 0.25;

/// Gives depth to a network that takes it and has none from files.
pub type OpenDepth<'a> = &'a dyn Fn() -> Result<Box<dyn PriorSource + Send + Sync>, PriorError>;

/// Which network, and how it is run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SegmenterConfig {
    /// ONNX file: the network, or the head where the profile has backbones; the network that comes with sizeup where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<PathBuf>,
    /// ONNX files of the profile's backbones, by their names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(extend("x-expert" = true))]
    pub backbones: BTreeMap<String, PathBuf>,
    /// Built-in profile: "semantic", "small.v1", "sam3" or "fpsam.v1"; that of the network where `model` is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// A profile of your own, in place of a built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub custom: Option<SegmenterProfile>,
    /// Side of a tile, pixels of the photo; the network's own side where left out, so that nothing is resized.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub tile_px: Option<usize>,
    /// Share of a tile that overlaps the next one, 0 to 0.5.
    #[serde(default = "default_overlap")]
    #[schemars(extend("x-expert" = true))]
    pub overlap: f64,
    /// Probability above which there is a building, 0 to 1.
    #[serde(default = "default_above")]
    #[schemars(extend("x-expert" = true))]
    pub above: f32,
    /// For networks that say how near to a middle a pixel lies: how far that falls between two buildings, 0 to 1; the profile's own
    /// where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub dip: Option<f32>,
    /// Least score of an instance, 0 to 1.
    #[serde(default = "default_min_score")]
    #[schemars(extend("x-expert" = true))]
    pub min_score: f32,
    /// The contour that masks follow: "ground", where walls meet the ground, or "roof".
    #[serde(default, alias = "outline")]
    pub contour: ContourKind,
    /// Depth of every photo from files, for networks that take it, by `{stem}` or `{name}`; that of `[prior]` where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<FilePriorConfig>,
    /// How accurate masks, poses and terrain are.
    #[serde(default)]
    pub accuracy: InputAccuracy,
    /// How views become one footprint per building.
    #[serde(default)]
    pub consensus: ConsensusConfig,
    /// An existing layer whose ids and attributes are kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cadastre: Option<CadastreConfig>,
}

fn default_overlap() -> f64 {
    0.2
}

fn default_above() -> f32 {
    0.5
}

fn default_min_score() -> f32 {
    0.5
}

impl SegmenterConfig {
    /// A network with a built-in profile and all defaults.
    #[must_use]
    pub fn new(model: impl Into<PathBuf>, profile: &str) -> Self {
        Self {
            model: Some(model.into()),
            backbones: BTreeMap::new(),
            profile: Some(profile.to_owned()),
            custom: None,
            tile_px: None,
            overlap: default_overlap(),
            above: default_above(),
            dip: None,
            min_score: default_min_score(),
            contour: ContourKind::default(),
            depth: None,
            accuracy: InputAccuracy::default(),
            consensus: ConsensusConfig::default(),
            cadastre: None,
        }
    }

    /// The network that comes with sizeup, with all defaults.
    #[must_use]
    pub fn built_in() -> Self {
        Self { model: None, profile: None, ..Self::new("", small::PROFILE) }
    }

    /// Which network it is, in words.
    #[must_use]
    pub fn in_words(&self) -> String {
        self.model.as_ref().map_or_else(|| small::IN_WORDS.to_owned(), |path| format!("the network {}", path.display()))
    }

    /// Hands every path of these settings to `visit`, which may change it.
    pub(super) fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        self.model.iter_mut().for_each(&mut *visit);
        self.backbones.values_mut().for_each(&mut *visit);
        if let Some(depth) = &mut self.depth {
            visit_template(&mut depth.path, visit);
        }
        if let Some(cadastre) = &mut self.cadastre {
            cadastre.visit_paths(visit);
        }
    }

    fn chosen(&self) -> Result<SegmenterProfile, FootprintError> {
        let names = || built_in().into_iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
        let refuse = |problem: String| FootprintError::Masks { problem, hint: format!("the profiles are {}", names()) };
        if self.model.is_none()
            && (self.custom.is_some() || self.profile.as_deref().is_some_and(|p| p != small::PROFILE))
        {
            return Err(FootprintError::Masks {
                problem: "a profile is set, and no `model` that it would fit".to_owned(),
                hint: "set `model` to an ONNX file, or leave both out: then the network that comes with sizeup is run"
                    .to_owned(),
            });
        }
        let profile = if self.model.is_none() { Some(small::PROFILE.to_owned()) } else { self.profile.clone() };
        match (&profile, &self.custom) {
            (Some(name), None) => built_in()
                .into_iter()
                .find(|p| p.name == *name)
                .ok_or_else(|| refuse(format!("no segmenter profile {name:?}"))),
            (None, Some(custom)) => Ok(custom.clone()),
            (None, None) => Err(refuse("no segmenter profile is set".to_owned())),
            (Some(_), Some(_)) => Err(refuse("both `profile` and `custom` are set".to_owned())),
        }
    }
}

/// Way of an image into a graph.
#[derive(Debug, Clone)]
struct Inlet {
    name: String,
    side: (usize, usize),
    mean: [f32; 3],
    std: [f32; 3],
}

/// Geometry of a photo besides its colours.
struct Geometry {
    relief: Option<Raster<f32>>,
    lean: Lean,
}

/// The input for depth, and where that comes from.
struct Depth {
    name: String,
    source: Box<dyn PriorSource + Send + Sync>,
    /// The setting that says so.
    setting: &'static str,
}

/// A segmentation network, ready to run.
pub struct Segmenter {
    config: SegmenterConfig,
    profile: SegmenterProfile,
    network: Network,
    /// The network's own image input; none for a head over backbones.
    inlet: Option<Inlet>,
    backbones: Vec<(Network, Inlet, Vec<String>)>,
    /// Inputs for depth and lean, where the graph has them.
    depth: Option<Depth>,
    lean: Option<String>,
    masks: String,
    scores: Option<String>,
    presence: Option<String>,
}

impl std::fmt::Debug for Segmenter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Segmenter").field("config", &self.config).finish_non_exhaustive()
    }
}

impl SegmenterConfig {
    /// Whether shares and sizes are in range, with the least dip between buildings that is asked for.
    fn check(&self, dip: f32) -> Result<(), FootprintError> {
        let refuse = |problem: String, hint: &str| Err(FootprintError::Masks { problem, hint: hint.to_owned() });
        let is_share = |v: f32| (0.0..=1.0).contains(&v);
        if !is_share(dip) {
            return refuse(format!("dip = {dip}"), "a difference of values from 0 to 1");
        }
        if !is_share(self.above) || !is_share(self.min_score) || !(0.0..=0.5).contains(&self.overlap) {
            let found = format!("above = {}, min_score = {}, overlap = {}", self.above, self.min_score, self.overlap);
            return refuse(found, "shares from 0 to 1; the overlap from 0 to 0.5");
        }
        if self.tile_px.is_some_and(|tile| tile < 16) {
            return refuse("`tile_px` is below 16".to_owned(), "a tile is at least 16 pixels wide");
        }
        Ok(())
    }
}

impl Segmenter {
    /// Loads the graphs and checks that they fit the profile and each other.
    ///
    /// # Errors
    /// [`FootprintError::Masks`] or [`FootprintError::Network`].
    pub fn new(config: SegmenterConfig) -> Result<Self, FootprintError> {
        Self::with_depth(config, None)
    }

    /// The same; a network that takes depth and has none from files gets it from `open`.
    ///
    /// # Errors
    /// As [`Self::new`], and what `open` says.
    pub fn with_depth(config: SegmenterConfig, open: Option<OpenDepth<'_>>) -> Result<Self, FootprintError> {
        let profile = config.chosen()?;
        let refuse = |problem: String, hint: &str| FootprintError::Masks { problem, hint: hint.to_owned() };
        config.check(config.dip.unwrap_or(profile.dip))?;
        let network = match &config.model {
            Some(path) => Network::open(path)?,
            None => Network::built_in(small::IN_WORDS, small::ONNX)?,
        };
        let model = config.model.clone().unwrap_or_else(|| PathBuf::from(small::IN_WORDS));
        let names =
            |ports: &[sizeup_photos::onnx::Port]| ports.iter().map(|p| p.name.clone()).collect::<Vec<_>>().join(", ");
        let unfit = |what: &str, path: &Path, found: String| {
            refuse(
                format!("profile {:?} does not fit {}: no {what} among {found}", profile.name, path.display()),
                "choose another profile, or describe the graph as `custom`",
            )
        };
        let inlet = |network: &Network, path: &Path, names_of: &[String], side: usize, mean, std| {
            let input =
                port(names_of, network.inputs()).ok_or_else(|| unfit("image input", path, names(network.inputs())))?;
            let side = match input.shape[..] {
                [_, _, Some(rows), Some(columns)] => (columns, rows),
                _ => (side, side),
            };
            Ok::<Inlet, FootprintError>(Inlet { name: input.name.clone(), side, mean, std })
        };
        let is_own = profile.backbones.is_empty() && {
            // A network that goes by depth alone has no image.
            let by_depth_alone = port(&profile.depth, network.inputs()).is_some();
            !by_depth_alone || port(&profile.inputs, network.inputs()).is_some()
        };
        let own = if is_own {
            let p = &profile;
            Some(inlet(&network, &model, &p.inputs, p.side_px, p.mean, p.std)?)
        } else {
            None
        };
        let mut backbones = Vec::new();
        for b in &profile.backbones {
            let path = config.backbones.get(&b.name).ok_or_else(|| {
                refuse(
                    format!("profile {:?} needs a backbone {:?}", profile.name, b.name),
                    "set its file under `backbones`",
                )
            })?;
            let graph = Network::open(path)?;
            // A head takes the features it has inputs for.
            let wanted: Vec<String> =
                b.features.iter().filter(|f| network.inputs().iter().any(|i| i.name == **f)).cloned().collect();
            if let Some(missing) = wanted.iter().find(|f| !graph.outputs().iter().any(|o| o.name == **f)) {
                return Err(unfit(&format!("output {missing:?}"), path, names(graph.outputs())));
            }
            let inlet = inlet(&graph, path, &b.inputs, b.side_px, b.mean, b.std)?;
            backbones.push((graph, inlet, wanted));
        }
        let given = |names: &[String]| port(names, network.inputs()).map(|p| p.name.clone());
        let lean = given(&profile.lean);
        let depth = match (given(&profile.depth), &config.depth, open) {
            (None, _, _) => None,
            (Some(name), Some(files), _) => {
                let files = FilePriors::new(files.clone(), [])
                    .map_err(|e| refuse(format!("`depth`: {e}"), "as under [prior] with `source = \"files\"`"))?;
                Some(Depth { name, source: Box::new(files), setting: "footprints.depth" })
            }
            (Some(name), None, Some(open)) => {
                let source = open().map_err(|e| {
                    refuse(
                        format!("{} takes depth, and [prior] gives none: {}", model.display(), without_hint(&e)),
                        "`footprints.depth` may name files",
                    )
                })?;
                Some(Depth { name, source, setting: "[prior]" })
            }
            (Some(name), None, None) => {
                return Err(refuse(
                    format!("{} takes depth ({name:?}), and `depth` is not set", model.display()),
                    "`depth = { path = \"priors/{stem}.npy\", kind = \"inverse_depth\" }`; or a network without depth",
                ));
            }
        };
        let is_geometry =
            |name: &String| lean.as_ref() == Some(name) || depth.as_ref().is_some_and(|d| d.name == *name);
        if let Some(open) = network.inputs().iter().filter(|i| !is_geometry(&i.name)).find(|i| {
            !backbones.iter().any(|(_, _, features)| features.contains(&i.name))
                && own.as_ref().is_none_or(|own| own.name != i.name)
        }) {
            return Err(unfit(&format!("source for its input {:?}", open.name), &model, names(network.inputs())));
        }
        let masks = port(&profile.masks, network.outputs())
            .ok_or_else(|| unfit("mask output", &model, names(network.outputs())))?
            .name
            .clone();
        let named = |names: &[String]| port(names, network.outputs()).map(|p| p.name.clone());
        let (scores, presence) = (named(&profile.scores), named(&profile.presence));
        Ok(Self { config, profile, network, inlet: own, backbones, depth, lean, masks, scores, presence })
    }

    /// Columns and rows that depth and lean have in a tile: the image's, or the graph's own.
    fn geometry_side(&self) -> (usize, usize) {
        let names = [self.depth.as_ref().map(|d| &d.name), self.lean.as_ref()];
        let own = names.into_iter().flatten().find_map(|name| {
            match self.network.inputs().iter().find(|p| p.name == *name)?.shape[..] {
                [_, _, Some(rows), Some(columns)] => Some((columns, rows)),
                _ => None,
            }
        });
        let square = (self.profile.side_px, self.profile.side_px);
        own.or_else(|| self.inlet.as_ref().map(|inlet| inlet.side)).unwrap_or(square)
    }

    /// Geometry by a view's pose and depth, for networks that take it.
    fn geometry_of(&self, view: &View) -> Result<Geometry, ViewFault> {
        let lean = Lean::of(view).ok_or_else(|| ViewFault::Network {
            problem: "its nadir lies beyond the lens model".to_owned(),
            hint: "networks of contours on the ground see photos that look nearly straight down".to_owned(),
        })?;
        let relief = match &self.depth {
            None => None,
            Some(depth) => {
                let prior = depth.source.load(view).map_err(|e| ViewFault::Network {
                    problem: format!("its depth cannot be used: {}", without_hint(&e)),
                    hint: format!("{} says where it is; photos that look straight down need it", depth.setting),
                })?;
                Some(relief(&prior))
            }
        };
        Ok(Geometry { relief, lean })
    }

    fn tile_px(&self) -> usize {
        let side = |inlet: &Inlet| inlet.side.0.max(inlet.side.1);
        let own = self.inlet.as_ref().map(side);
        let first = || {
            let (columns, rows) = self.geometry_side();
            self.backbones.first().map_or(columns.max(rows), |(_, inlet, _)| side(inlet))
        };
        self.config.tile_px.unwrap_or_else(|| own.unwrap_or_else(first))
    }

    /// Masks and, where there are any, scores of a tile.
    fn look(
        &self,
        photo: &RasterFile,
        geometry: &Geometry,
        tile: Window,
    ) -> Result<(Tensor, Option<Vec<f32>>, f32), ViewFault> {
        let unusable = |e: &dyn std::error::Error| ViewFault::Photo { reason: e.to_string() };
        let failed = |e: OnnxError| {
            let (problem, hint) = e.problem_and_hint();
            ViewFault::Network { problem, hint }
        };
        let mut given: Vec<(String, Tensor)> = Vec::new();
        if let Some(inlet) = &self.inlet {
            given.push((inlet.name.clone(), image(photo, tile, inlet).map_err(|e| unusable(&e))?));
        }
        for (graph, inlet, features) in &self.backbones {
            let input = image(photo, tile, inlet).map_err(|e| unusable(&e))?;
            let names: Vec<&str> = features.iter().map(String::as_str).collect();
            let found = graph.run_many(&[(&inlet.name, &input)], &names).map_err(failed)?;
            given.extend(features.iter().cloned().zip(found));
        }
        let side = self.geometry_side();
        if let (Some(Depth { name, .. }), Some(relief)) = (&self.depth, &geometry.relief) {
            let values = geometry::resample(relief, photo.size(), tile, side);
            given.push((name.clone(), Tensor { shape: vec![1, 1, side.1, side.0], values }));
        }
        if let Some(name) = &self.lean {
            let values = geometry.lean.of_tile(tile, side);
            given.push((name.clone(), Tensor { shape: vec![1, 2, side.1, side.0], values }));
        }
        let inputs: Vec<(&str, &Tensor)> = given.iter().map(|(name, tensor)| (name.as_str(), tensor)).collect();
        let wanted: Vec<&str> = [Some(&self.masks), self.scores.as_ref(), self.presence.as_ref()]
            .into_iter()
            .flatten()
            .map(String::as_str)
            .collect();
        let mut results = self.network.run_many(&inputs, &wanted).map_err(failed)?.into_iter();
        let masks = results.next().ok_or_else(|| self.misshapen("nothing"))?;
        let scores = self.scores.as_ref().and_then(|_| results.next()).map(|t| t.values);
        let presence = self.presence.as_ref().and_then(|_| results.next()).and_then(|t| t.values.first().copied());
        let active = |v: f32| self.active(v);
        Ok((masks, scores.map(|s| s.into_iter().map(active).collect()), presence.map_or(1.0, active)))
    }

    fn active(&self, value: f32) -> f32 {
        match self.profile.activation {
            Activation::Sigmoid => 1.0 / (1.0 + (-value).exp()),
            Activation::None => value,
        }
    }

    fn misshapen(&self, found: &str) -> ViewFault {
        ViewFault::Network {
            problem: format!("{} gives {found} as its masks", self.config.in_words()),
            hint: format!("{:?} is expected to be batch × maps × rows × columns, a batch of one", self.masks),
        }
    }

    /// The maps of a tensor `batch × maps × rows × columns` (leading dimensions may lack), as probabilities.
    fn maps(&self, tensor: &Tensor) -> Result<Vec<Raster<f32>>, ViewFault> {
        let refuse = || self.misshapen(&format!("a tensor of shape {:?}", tensor.shape));
        let (n, rows, columns) = match tensor.shape[..] {
            [rows, columns] => (1, rows, columns),
            [n, rows, columns] | [1, n, rows, columns] => (n, rows, columns),
            _ => return Err(refuse()),
        };
        if n * rows * columns != tensor.values.len() || rows * columns == 0 {
            return Err(refuse());
        }
        let map = |values: &[f32]| {
            Raster::from_vec(columns, rows, values.iter().map(|v| self.active(*v)).collect()).ok_or_else(refuse)
        };
        tensor.values.chunks_exact(rows * columns).map(map).collect()
    }
}

impl ContourSource for Segmenter {
    fn contours(&self, view: &View, look: Look) -> Result<Vec<Contour>, ViewFault> {
        let path = view.image.as_deref().ok_or_else(|| ViewFault::Photo { reason: "it is not known".to_owned() })?;
        let photo = RasterFile::open(path).map_err(|e| ViewFault::Photo { reason: e.to_string() })?;
        let size = photo.size();
        if size != (view.camera.width_px as usize, view.camera.height_px as usize) {
            return Err(ViewFault::Size {
                path: path.to_owned(),
                mask: size,
                photo: (view.camera.width_px, view.camera.height_px),
            });
        }
        let geometry = self.geometry_of(view)?;
        let tile_px = self.tile_px();
        let windows = tiles::tiles(size, tile_px, (self.config.overlap * tile_px as f64) as usize);
        let how = Vectorising {
            instances: Instances::ByLabel,
            min_area_px2: look.min_area_px2,
            tolerance_px: look.tolerance_px,
        };
        let in_photo = |fault: MaskFault| ViewFault::Mask { path: path.to_owned(), fault };
        match self.profile.gives {
            Gives::Semantic => {
                let mut mosaics: Vec<Mosaic> = Vec::new();
                for tile in windows {
                    let (masks, _, _) = self.look(&photo, &geometry, tile)?;
                    // Of more than two channels, the first is what the profile speaks of.
                    for (i, map) in self.maps(&masks)?.iter().take(2).enumerate() {
                        if mosaics.len() == i {
                            mosaics.push(Mosaic::new(size.0, size.1));
                        }
                        mosaics[i].add(tile, &at_photo_size(map, tile));
                    }
                }
                let mut maps = mosaics.into_iter().map(Mosaic::finish);
                let Some(buildings) = maps.next() else { return Ok(Vec::new()) };
                match maps.next() {
                    None => contours_at_level(&buildings, self.config.above, how).map_err(in_photo),
                    Some(middles) => {
                        let apart = Apart {
                            above: self.config.above,
                            dip: self.config.dip.unwrap_or(self.profile.dip),
                            least_px: (PART_SHARE * look.min_area_px2).ceil() as usize,
                        };
                        contours(&split(&buildings, &middles, apart), how).map_err(in_photo)
                    }
                }
            }
            Gives::Instances => {
                let mut joiner = Joiner::new(size.0, size.1);
                for tile in windows {
                    let (masks, scores, presence) = self.look(&photo, &geometry, tile)?;
                    let maps = self.maps(&masks)?;
                    let scored = maps.into_iter().enumerate().map(|(i, map)| {
                        let score = presence * scores.as_ref().map_or(1.0, |s| s.get(i).copied().unwrap_or(0.0));
                        (map, score)
                    });
                    let kept = scored.filter(|(_, score)| *score >= self.config.min_score);
                    joiner.add(tile, kept.map(|(map, score)| (at_photo_size(&map, tile), score)).collect());
                }
                let (labels, scores) = joiner.finish();
                let mut found = contours(&labels, how).map_err(in_photo)?;
                for contour in &mut found {
                    contour.score = scores[contour.label as usize].clamp(0.0, 1.0);
                }
                Ok(found)
            }
        }
    }

    fn file_of(&self, view: &View) -> Option<PathBuf> {
        view.image.clone()
    }
}

/// A message whose own hint gives way to another.
fn without_hint(error: &PriorError) -> String {
    let text = error.to_string();
    text.split("\nhint:").next().unwrap_or_default().to_owned()
}

/// A tile of a photo as `1 × 3 × rows × columns`, normalised.
fn image(photo: &RasterFile, tile: Window, inlet: &Inlet) -> Result<Tensor, sizeup_geo::geodata::raster::RasterError> {
    let (columns, rows) = inlet.side;
    let resampling = if (tile.width, tile.height) == inlet.side { Resampling::Nearest } else { Resampling::Average };
    let bands = if photo.n_bands() >= 3 { [1, 2, 3] } else { [1; 3] };
    let mut values = Vec::with_capacity(3 * rows * columns);
    for (channel, band) in bands.into_iter().enumerate() {
        let pixels = photo.read_window(band, tile, inlet.side, resampling)?;
        let (mean, std) = (inlet.mean[channel], inlet.std[channel]);
        let normal = |v: &f32| (if v.is_nan() { 0.0 } else { *v } / 255.0 - mean) / std;
        values.extend(pixels.data().iter().map(normal));
    }
    Ok(Tensor { shape: vec![1, 3, rows, columns], values })
}
