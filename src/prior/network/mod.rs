//! Depth priors from a network that the user brings as an ONNX file.
//!
//! What the network wants is a [`Profile`]: data, not code. The photo is decoded at reduced size, resized exactly as
//! the network's own code does, and the output is taken as the whole photo. One inference at a time, on as many cores
//! as the engine may use; meanwhile other threads decode and prepare the next photos.

mod company;
pub mod preprocess;
pub mod profile;
pub mod resize;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::preprocess::{Cut, Prepared};
use self::profile::{Form, Profile, Wiring};
use self::resize::Rgb;
use super::array::MapShape;
use super::neighbours::Neighbours;
use super::{CacheConfig, CacheKey, DepthPrior, KeyHasher, PriorError, PriorGeometry, PriorKind, PriorSource};
use crate::geodata::raster::{RasterFile, Resampling, Window};
use crate::onnx::{EngineChoice, EngineConfig, Network, Outline, Port, Tensor};
use crate::paths::PathVisitor;
use crate::raster::Raster;
use crate::survey::View;
use crate::terrain::Terrain;

/// Longer side above which a photo is decoded at a whole fraction of its size, pixels: eight times what networks see.
const DECODE_SIDE_PX: usize = 4096;

/// Which network, and what kind of network it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// ONNX file.
    pub model: PathBuf,
    /// Built-in profile: "da3-mono", "da3-metric", "da3-anyview", "depth-anything-v2", "depth-anything-v2-metric",
    /// "metric3d", "moge" or "depth-pro". It declares the numbers' direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// A profile of your own, in place of a built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub custom: Option<Profile>,
    /// Which engine computes, and on what.
    #[serde(default)]
    pub engine: EngineConfig,
    /// Where computed depth is kept, so that each view is computed once.
    #[serde(default)]
    pub cache: CacheConfig,
}

impl NetworkConfig {
    /// Visits every path.
    pub(super) fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        visit(&mut self.model);
        self.engine.visit_paths(visit);
        visit(&mut self.cache.folder);
    }

    fn chosen(&self) -> Result<Profile, PriorError> {
        let refuse = |problem: &str| PriorError::Config {
            problem: problem.to_owned(),
            hint:
                "set `profile` to a built-in one, or `custom` to one of your own; a graph does not tell which way its \
                   numbers run"
                    .to_owned(),
        };
        match (&self.profile, &self.custom) {
            (Some(name), None) => profile::by_name(name),
            (None, Some(custom)) => Ok(custom.clone()),
            (None, None) => Err(refuse("no network profile is set")),
            (Some(_), Some(_)) => Err(refuse("both `profile` and `custom` are set")),
        }
    }
}

/// What a graph wants and gives, and which built-in profiles fit it.
#[derive(Debug)]
pub struct Inspection {
    /// Its inputs.
    pub inputs: Vec<Port>,
    /// Its outputs.
    pub outputs: Vec<Port>,
    /// The engine that runs it.
    pub engine: EngineChoice,
    /// What its file is made of.
    pub outline: Outline,
    /// Every built-in profile with its wiring, or why it does not fit.
    pub profiles: Vec<(Profile, Result<Wiring, String>)>,
}

/// Looks at a graph without running it.
///
/// # Errors
/// [`PriorError::Network`] if the engine cannot load it.
pub fn inspect(model: &Path, engine: &EngineConfig) -> Result<Inspection, PriorError> {
    let network = Network::open_with(model, engine)?;
    let (inputs, outputs) = (network.inputs().to_vec(), network.outputs().to_vec());
    let wired = profile::built_in().into_iter().map(|profile| {
        let wiring = profile.wire(&inputs, &outputs);
        (profile, wiring)
    });
    let profiles = wired.collect();
    Ok(Inspection { inputs, outputs, engine: network.engine(), outline: Outline::read(model)?, profiles })
}

/// Depth from a network.
#[derive(Debug)]
pub struct NetworkPriors {
    network: Network,
    config: NetworkConfig,
    profile: Profile,
    wiring: Wiring,
    /// Files that hold the weights, the graph's own among them.
    files: Vec<PathBuf>,
    /// For networks that take several photos.
    company: Neighbours,
    /// Held while the network runs: one inference takes all the memory and cores that it may.
    turn: Mutex<()>,
}

impl NetworkPriors {
    /// Loads the network and checks that its profile fits. Of the views and the terrain only networks that take several
    /// photos make use.
    ///
    /// # Errors
    /// [`PriorError::Network`], or [`PriorError::Config`] where the profile does not fit.
    pub fn new(config: NetworkConfig, views: &[View], terrain: &Terrain) -> Result<Self, PriorError> {
        let profile = config.chosen()?;
        profile.check()?;
        let network = Network::open_with(&config.model, &config.engine)?;
        let wiring = profile.wire(network.inputs(), network.outputs()).map_err(|problem| PriorError::Config {
            problem: format!("profile {:?} does not fit {}: {problem}", profile.name, config.model.display()),
            hint: "`sizeup prior inspect` shows what the graph wants and which profiles fit".to_owned(),
        })?;
        let beside = |file: &PathBuf| config.model.parent().unwrap_or(Path::new("")).join(file);
        let mut files = vec![config.model.clone()];
        files.extend(Outline::read(&config.model)?.external_files.iter().map(beside));
        let is_company = |view: &&View| wiring.n_views > 1 && view.image.is_some();
        let company = Neighbours::new(views.iter().filter(is_company).cloned().collect(), terrain);
        Ok(Self { network, config, profile, wiring, files, company, turn: Mutex::new(()) })
    }

    /// What the weights may be used for, for the log.
    #[must_use]
    pub fn licence(&self) -> &str {
        &self.profile.licence
    }

    /// The view, and those that go in with it: fewer where the graph leaves the number free and there are no more.
    fn party<'a>(&'a self, view: &'a View) -> Result<Vec<&'a View>, PriorError> {
        let mut party = vec![view];
        party.extend(self.company.choose(view, self.wiring.n_views - 1));
        let is_short = party.len() < self.wiring.n_views;
        let is_fixed = self.network.inputs().iter().any(|port| {
            port.name == self.wiring.input && port.shape.len() == 5 && port.shape[1] == Some(self.wiring.n_views)
        });
        if is_short && is_fixed {
            return Err(PriorError::Photo {
                view: view.id.to_string(),
                problem: format!(
                    "the network takes {} photos at once, and {} see its ground under a fair angle",
                    self.wiring.n_views,
                    party.len() - 1
                ),
                hint: "photos have to overlap; or use a graph of fewer photos".to_owned(),
            });
        }
        Ok(party)
    }

    /// Everything that the graph takes for a party, and the view itself as prepared.
    fn inputs(&self, party: &[&View]) -> Result<(Vec<(String, Tensor)>, Prepared), PriorError> {
        let first = preprocess::prepare(&self.profile, &decode(party[0])?, self.wiring.fixed_size);
        let mut values = first.values.clone();
        for view in &party[1..] {
            // All of one size, as a graph takes them; photos of one camera are, and others are stretched a little.
            let size = Some((first.rows, first.columns));
            values.extend(preprocess::prepare(&self.profile, &decode(view)?, size).values);
        }
        let mut shape = vec![1; self.wiring.rank - 3];
        if let Some(n) = shape.get_mut(1) {
            *n = party.len();
        }
        shape.extend([3, first.rows, first.columns]);
        let mut inputs = vec![(self.wiring.input.clone(), Tensor { shape, values })];
        for name in &self.wiring.constants {
            let value = self.profile.constants.get(name).copied().unwrap_or_default();
            let rank = self.network.inputs().iter().find(|port| port.name == *name).map_or(0, |port| port.shape.len());
            inputs.push((name.clone(), Tensor { shape: vec![1; rank], values: vec![value] }));
        }
        let extrinsics = self.wiring.extrinsics.iter().map(|name| (name.clone(), company::extrinsics(party)));
        inputs.extend(extrinsics);
        let of_size = |name: &String| (name.clone(), company::intrinsics(party, first.rows, first.columns));
        inputs.extend(self.wiring.intrinsics.iter().map(of_size));
        Ok((inputs, first))
    }

    /// Output, then sky and mask where there are any, each cut to the photo.
    fn run(&self, inputs: &[(String, Tensor)], prepared: &Prepared) -> Result<Vec<Raster<f32>>, PriorError> {
        let given: Vec<(&str, &Tensor)> = inputs.iter().map(|(name, tensor)| (name.as_str(), tensor)).collect();
        let wanted: Vec<&str> = [Some(&self.wiring.output), self.wiring.sky.as_ref(), self.wiring.mask.as_ref()]
            .into_iter()
            .flatten()
            .map(String::as_str)
            .collect();
        let results = {
            let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
            // On a thread outside any pool: an engine with a pool of its own would let this thread, if it is a pool's,
            // take up the next view meanwhile, and that one would wait for the turn that this one has.
            let run = || self.network.run_many(&given, &wanted);
            std::thread::scope(|scope| scope.spawn(run).join())
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))?
        };
        let form = |name: &str| if name == self.wiring.output { self.profile.form } else { Form::Map };
        let maps = results.into_iter().zip(wanted).map(|(tensor, name)| {
            let map = map_of(tensor, form(name)).map_err(|problem| PriorError::File {
                path: self.config.model.clone(),
                problem: format!("output {name:?}: {problem}"),
            })?;
            Ok(cut_out(&map, prepared))
        });
        maps.collect()
    }

    /// Metres where the profile says how, and what is no value blanked.
    fn settle(&self, maps: Vec<Raster<f32>>, view: &View, prepared: &Prepared) -> Raster<f32> {
        let mut maps = maps.into_iter();
        let mut values = maps.next().expect("the depth output was asked for");
        let sky = self.wiring.sky.as_ref().and_then(|_| maps.next());
        let mask = self.wiring.mask.as_ref().and_then(|_| maps.next());
        let scale = self.profile.metres_at_focal_px.map_or(1.0, |focal_px| {
            let camera = view.camera.resized(prepared.photo.columns as u32, prepared.photo.rows as u32);
            (f64::midpoint(camera.fx_px, camera.fy_px) / f64::from(focal_px)) as f32
        });
        let is_possible = |v: f32| v.is_finite() && (self.profile.kind == PriorKind::InverseDepth || v > 0.0);
        for value in values.data_mut() {
            *value = if is_possible(*value) { *value * scale } else { f32::NAN };
        }
        if let Some(sky) = sky {
            blank(&mut values, &sky, |sky| sky > self.profile.sky_above);
        }
        if let Some(mask) = mask {
            blank(&mut values, &mask, |mask| mask < self.profile.mask_least || mask.is_nan());
        }
        values
    }
}

impl PriorSource for NetworkPriors {
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError> {
        let party = self.party(view)?;
        let (inputs, prepared) = self.inputs(&party)?;
        let maps = self.run(&inputs, &prepared)?;
        let values = self.settle(maps, view, &prepared);
        let first = values.data().iter().copied().find(|v| !v.is_nan());
        let varies = values.data().iter().any(|v| !v.is_nan() && Some(*v) != first);
        if !varies {
            return Err(PriorError::NoInformation {
                path: self.config.model.clone(),
                problem: format!("for {} it gives one and the same value everywhere, or none", view.id),
            });
        }
        Ok(DepthPrior { values, kind: self.profile.kind, geometry: PriorGeometry::ZDepth })
    }
}

impl CacheKey for NetworkPriors {
    fn feed(&self, view: &View, key: &mut KeyHasher) -> Result<(), PriorError> {
        key.bytes(b"network 2");
        key.json(&self.profile);
        // Engines and processors round differently.
        key.json(&(self.network.engine(), &self.config.engine.providers));
        for file in &self.files {
            key.file(file)?;
        }
        for member in self.party(view)? {
            key.json(&(&member.camera, self.wiring.extrinsics.as_ref().map(|_| &member.camera_from_map)));
            if let Some(image) = &member.image {
                key.file(image)?;
            }
        }
        Ok(())
    }
}

/// One map of an output; of several, the first: the view itself.
fn map_of(tensor: Tensor, form: Form) -> Result<Raster<f32>, String> {
    if form == Form::Points {
        let [.., height, width, 3] = tensor.shape[..] else {
            return Err(format!("its shape is {:?}, expected rows × columns × 3", tensor.shape));
        };
        let z = tensor.values.chunks_exact(3).take(height * width).map(|point| point[2]).collect();
        return Raster::from_vec(width, height, z).ok_or_else(|| "it is empty".to_owned());
    }
    let shape = MapShape::of(&tensor.shape)?;
    let mut values = tensor.values;
    values.truncate(shape.cells());
    Ok(shape.raster(values))
}

/// The part that shows the photo: of a letterbox the middle.
fn cut_out(map: &Raster<f32>, prepared: &Prepared) -> Raster<f32> {
    let Cut { col, row, columns, rows } = prepared.photo;
    if (columns, rows) == (prepared.columns, prepared.rows) {
        return map.clone();
    }
    // Outputs can be smaller than inputs.
    let at = |n: usize, of: usize, size: usize| (n * size + of / 2) / of;
    let (left, right) = (at(col, prepared.columns, map.width()), at(col + columns, prepared.columns, map.width()));
    let (top, bottom) = (at(row, prepared.rows, map.height()), at(row + rows, prepared.rows, map.height()));
    let lines = (top..bottom).flat_map(|y| (left..right).map(move |x| map[(x, y)]));
    Raster::from_vec(right - left, bottom - top, lines.collect()).expect("one value per cell")
}

/// Blanks values by another map of the same shape; another shape says nothing about them.
fn blank(values: &mut Raster<f32>, by: &Raster<f32>, is_none: impl Fn(f32) -> bool) {
    if (by.width(), by.height()) == (values.width(), values.height()) {
        for (value, by) in values.data_mut().iter_mut().zip(by.data()) {
            if is_none(*by) {
                *value = f32::NAN;
            }
        }
    }
}

/// The photo in colour, grey ones three times the same; never whole at once where it is larger than networks see.
fn decode(view: &View) -> Result<Raster<Rgb>, PriorError> {
    let path = view.image.as_deref().ok_or_else(|| PriorError::Photo {
        view: view.id.to_string(),
        problem: "its photo is not known".to_owned(),
        hint: "a network needs the photo's file".to_owned(),
    })?;
    let file = RasterFile::open(path)?;
    let (width, height) = file.size();
    let fraction = width.max(height).div_ceil(DECODE_SIDE_PX);
    let size = (width.div_ceil(fraction), height.div_ceil(fraction));
    let whole = Window { col: 0, row: 0, width, height };
    let resampling = if fraction == 1 { Resampling::Nearest } else { Resampling::Average };
    let mut photo = Raster::filled(size.0, size.1, [0_u8; 3]);
    let n_bands = if file.n_bands() >= 3 { 3 } else { 1 };
    for band in 0..n_bands {
        let values = file.read_window(band + 1, whole, size, resampling)?;
        for (pixel, value) in photo.data_mut().iter_mut().zip(values.data()) {
            let byte = value.round().clamp(0.0, 255.0) as u8; // NaN becomes 0
            if n_bands == 1 { *pixel = [byte; 3] } else { pixel[band] = byte }
        }
    }
    Ok(photo)
}
