//! A segmentation network, loaded and held against its profile, and what it says of a tile.

use std::path::{Path, PathBuf};

use super::config::SegmenterConfig;
use super::geometry::{self, Lean, relief};
use super::profile::{Activation, SegmenterProfile, port};
use super::small;
use super::tiles;
use super::turned::TurnedOver;
use crate::contours::ViewFault;
use crate::layer::FootprintError;
use sizeup_geo::geodata::raster::{CellWindow, RasterFile, Resampling};
use sizeup_heights::raster::Raster;
use sizeup_photos::onnx::{Network, OnnxError, Tensor};
use sizeup_photos::prior::{PriorError, PriorSource};
use sizeup_survey::View;

/// Gives depth to a network that takes it and has none from files.
pub type OpenDepth<'a> = &'a dyn Fn() -> Result<Box<dyn PriorSource + Send + Sync>, PriorError>;
/// Way of an image into a graph.
#[derive(Debug, Clone)]
struct Inlet {
    name: String,
    side: (usize, usize),
    mean: [f32; 3],
    std: [f32; 3],
}

/// Geometry of a photo besides its colours.
pub(super) struct PhotoGeometry {
    relief: Option<Raster<f32>>,
    pub(super) lean: Lean,
    /// Why there is no depth for a network that takes it.
    pub(super) without_depth: Option<String>,
}

/// The input for depth, and its source if there is one.
struct Depth {
    name: String,
    source: Option<Box<dyn PriorSource + Send + Sync>>,
}

/// A segmentation network, ready to run.
pub struct Segmenter {
    pub(super) config: SegmenterConfig,
    pub(super) profile: SegmenterProfile,
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

impl Segmenter {
    /// Loads the graphs and checks that they fit the profile and each other. A network that takes depth sees level ground.
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
        config.check(profile.dip)?;
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
                "choose another profile, or describe the graph in a TOML file",
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
        let depth = match (given(&profile.depth), open) {
            (None, _) => None,
            (Some(name), Some(open)) => {
                let source = open().map_err(|e| {
                    refuse(
                        format!("{} takes depth, and [prior] gives none: {}", model.display(), without_hint(&e)),
                        "set [prior], or use a network without depth",
                    )
                })?;
                Some(Depth { name, source: Some(source) })
            }
            (Some(name), None) => Some(Depth { name, source: None }),
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

    /// Returns the same network with another `valley` than its profile's, 0 to 1.
    #[must_use]
    pub fn with_valley(mut self, valley: f32) -> Self {
        self.profile.valley = valley;
        self
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
    pub(super) fn geometry_of(&self, view: &View) -> Result<PhotoGeometry, ViewFault> {
        let lean = Lean::of(view).ok_or_else(|| ViewFault::Network {
            problem: "its nadir lies beyond the lens model".to_owned(),
            hint: "networks of contours on the ground see photos that look nearly straight down".to_owned(),
        })?;
        let (relief, without_depth) = match &self.depth {
            None => (None, None),
            Some(Depth { source: None, .. }) => (None, Some("no depth is given".to_owned())),
            Some(Depth { source: Some(source), .. }) => match source.load(view) {
                Ok(prior) => (Some(relief(&prior)), None),
                // Depth that is not there, or says nothing, is no fault; depth that was given and is damaged is one.
                Err(e @ (PriorError::Absent { .. } | PriorError::NoInformation { .. } | PriorError::Photo { .. })) => {
                    (None, Some(without_hint(&e)))
                }
                Err(e) => {
                    return Err(ViewFault::Network {
                        problem: format!("its depth cannot be used: {}", without_hint(&e)),
                        hint: "mend it, or remove it: buildings are then found by colours alone".to_owned(),
                    });
                }
            },
        };
        Ok(PhotoGeometry { relief, lean, without_depth })
    }

    pub(super) fn is_built_in(&self) -> bool {
        self.config.model.is_none()
    }

    /// The ways in which each tile is shown to the network: all of them to networks of our own form, where that was measured to pay.
    pub(super) fn turns(&self) -> &'static [TurnedOver] {
        if self.profile.name == small::PROFILE { &TurnedOver::ALL } else { &TurnedOver::ALL[..1] }
    }

    /// Side of a tile of a photo of this size, its pixels, each of which covers `pixel_m` of the ground: the network's own side, or more of
    /// a photo that is finer than the network is to see.
    pub(super) fn tile_px(&self, photo: (usize, usize), pixel_m: f64) -> usize {
        let side = |inlet: &Inlet| inlet.side.0.max(inlet.side.1);
        let own = self.inlet.as_ref().map(side);
        let first = || {
            let (columns, rows) = self.geometry_side();
            self.backbones.first().map_or(columns.max(rows), |(_, inlet, _)| side(inlet))
        };
        let side = own.unwrap_or_else(first);
        let seen_m = self.config.pixel_m.or_else(|| self.is_built_in().then_some(small::PIXEL_M));
        seen_m.map_or(side, |seen_m| tiles::reduced_side(side, photo, seen_m / pixel_m))
    }

    /// Masks and, where there are any, scores of a tile, looked at turned over; masks are turned over as the tile was.
    pub(super) fn look(
        &self,
        photo: &RasterFile,
        geometry: &PhotoGeometry,
        tile: CellWindow,
        turned: TurnedOver,
    ) -> Result<(Tensor, Option<Vec<f32>>, f32), ViewFault> {
        let unusable = |e: &dyn std::error::Error| ViewFault::Photo { reason: e.to_string() };
        let failed = |e: OnnxError| {
            let (problem, hint) = e.problem_and_hint();
            ViewFault::Network { problem, hint }
        };
        let mut given: Vec<(String, Tensor)> = Vec::new();
        if let Some(inlet) = &self.inlet {
            let input = image(photo, tile, inlet).map_err(|e| unusable(&e))?;
            given.push((inlet.name.clone(), turned.tensor(input)));
        }
        for (graph, inlet, features) in &self.backbones {
            let input = turned.tensor(image(photo, tile, inlet).map_err(|e| unusable(&e))?);
            let names: Vec<&str> = features.iter().map(String::as_str).collect();
            let found = graph.run_many(&[(&inlet.name, &input)], &names).map_err(failed)?;
            given.extend(features.iter().cloned().zip(found));
        }
        let side = self.geometry_side();
        if let Some(Depth { name, .. }) = &self.depth {
            let values = match &geometry.relief {
                Some(relief) => geometry::resample(relief, photo.size(), tile, side),
                // Level ground, as the network learned from photos without depth.
                None => vec![0.0; side.0 * side.1],
            };
            given.push((name.clone(), turned.tensor(Tensor { shape: vec![1, 1, side.1, side.0], values })));
        }
        if let Some(name) = &self.lean {
            let values = geometry.lean.of_tile(tile, side);
            given.push((name.clone(), turned.lean(Tensor { shape: vec![1, 2, side.1, side.0], values })));
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
    pub(super) fn maps(&self, tensor: &Tensor) -> Result<Vec<Raster<f32>>, ViewFault> {
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

/// A message whose own hint gives way to another.
fn without_hint(error: &PriorError) -> String {
    let text = error.to_string();
    text.split("\nhint:").next().unwrap_or_default().to_owned()
}

/// A tile of a photo as `1 × 3 × rows × columns`, normalised. Where a network sees more pixels than the tile has, values lie on lines between
/// those of the photo, as networks' own preprocessing has them.
fn image(
    photo: &RasterFile,
    tile: CellWindow,
    inlet: &Inlet,
) -> Result<Tensor, sizeup_geo::geodata::raster::RasterError> {
    let (columns, rows) = inlet.side;
    // Enlarged, a mean of pixels would be the nearest one: steps that no photo has.
    let is_enlarged = tile.width <= columns && tile.height <= rows && (tile.width, tile.height) != inlet.side;
    let (size, resampling) = match (tile.width, tile.height) {
        own if is_enlarged || own == inlet.side => (own, Resampling::Nearest),
        _ => (inlet.side, Resampling::Average),
    };
    let whole = CellWindow { col: 0, row: 0, ..tile };
    let bands = if photo.n_bands() >= 3 { [1, 2, 3] } else { [1; 3] };
    let mut values = Vec::with_capacity(3 * rows * columns);
    for (channel, band) in bands.into_iter().enumerate() {
        let mut pixels = photo.read_window(band, tile, size, resampling)?;
        let (mean, std) = (inlet.mean[channel], inlet.std[channel]);
        for v in pixels.data_mut() {
            *v = (if v.is_nan() { 0.0 } else { *v } / 255.0 - mean) / std;
        }
        if is_enlarged {
            values.extend(geometry::resample(&pixels, size, whole, inlet.side));
        } else {
            values.extend(pixels.data());
        }
    }
    Ok(Tensor { shape: vec![1, 3, rows, columns], values })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four columns that rise evenly, seen as eight: they rise evenly still, half a step at a time.
    #[test]
    fn a_tile_is_enlarged_without_steps() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("photo.asc");
        let rows = "0 10 20 30\n".repeat(2);
        std::fs::write(&path, format!("ncols 4\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n{rows}")).unwrap();
        let photo = RasterFile::open(&path).unwrap();
        let seen = |side: (usize, usize)| {
            let inlet = Inlet { name: "image".to_owned(), side, mean: [0.0; 3], std: [1.0; 3] };
            let tile = CellWindow { col: 0, row: 0, width: 4, height: 2 };
            let tensor = image(&photo, tile, &inlet).unwrap();
            assert_eq!(tensor.shape, [1, 3, side.1, side.0]);
            tensor.values[..side.0].iter().map(|v| (2550.0 * v).round() / 10.0).collect::<Vec<f32>>()
        };
        assert_eq!(seen((8, 4)), [0.0, 2.5, 7.5, 12.5, 17.5, 22.5, 27.5, 30.0]);
        assert_eq!(seen((4, 2)), [0.0, 10.0, 20.0, 30.0]);
        assert_eq!(seen((2, 1)), [5.0, 25.0]);
    }
}
