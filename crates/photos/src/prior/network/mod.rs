//! Depth priors from a network that the user brings as an ONNX file.
//!
//! What the network wants is a [`Profile`]: data, not code. The photo is decoded at reduced size, resized exactly as
//! the network's own code does, and the output is taken as the whole photo. One inference at a time, on as many cores
//! as the engine may use; meanwhile other threads decode and prepare the next photos.

mod company;
mod depth_range;
mod inspect;
pub mod known;
mod output;
mod photo;
pub mod preprocess;
pub mod profile;
pub mod resize;

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::inspect::{GraphInspection, inspect};
use self::preprocess::{NetworkInput, PreparedPhoto};
use self::profile::{Company, Fit, Form, Lens, PoseUnit, Profile, Wiring};
use super::neighbours::Neighbours;
use super::{CacheConfig, CacheKey, DepthPrior, KeyHasher, PriorError, PriorGeometry, PriorKind, PriorSource};
use crate::onnx::{Contents, EngineConfig, Network, Tensor, is_profile_file, profile_in};
use sizeup_geo::kept::Kept;
use sizeup_geo::paths::{PathVisitor, visit_template};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::ViewId;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Prepared photos kept at a time for networks that take several: some 2 MB each.
const PHOTOS_KEPT: usize = 32;

/// Which network, and what kind of network it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// ONNX file; or the name of a network that `sizeup model get` has put in place.
    pub model: PathBuf,
    /// Built-in profile: "da3-mono", "da3-metric", "da3-anyview", "depth-anything-v2", "depth-anything-v2-metric",
    /// "metric3d", "moge", "depth-pro", "vggt", "map-anything" or "itermvs". Or a TOML file that describes another network.
    /// It declares the numbers' direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Which engine computes, and on what.
    #[serde(default)]
    pub engine: EngineConfig,
    /// Where computed depth is kept, so that each view is computed once.
    #[serde(default)]
    pub cache: CacheConfig,
}

impl NetworkConfig {
    /// A graph and a built-in profile, with all defaults.
    #[must_use]
    pub fn new(model: impl Into<PathBuf>, profile: &str) -> Self {
        Self {
            model: model.into(),
            profile: Some(profile.to_owned()),
            engine: EngineConfig::default(),
            cache: CacheConfig::default(),
        }
    }

    /// Hands every path of these settings to `visit`, which may change it.
    pub(super) fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        visit(&mut self.model);
        if let Some(profile) = self.profile.as_mut().filter(|profile| is_profile_file(profile)) {
            visit_template(profile, visit);
        }
        self.engine.visit_paths(visit);
        visit(&mut self.cache.folder);
    }

    /// Path of the graph's file.
    #[must_use]
    pub fn graph(&self) -> PathBuf {
        known::in_place(&self.model).unwrap_or_else(|| self.model.clone())
    }

    /// The graph's file, those beside it that hold its weights, and that of a profile; a graph that cannot be read is refused by its
    /// engine.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        let graph = self.graph();
        let contents = Contents::read(&graph).unwrap_or_default();
        let beside = contents.external_files.iter().map(|name| graph.with_file_name(name));
        let profile = self.profile.iter().filter(|profile| is_profile_file(profile)).map(PathBuf::from);
        std::iter::once(graph.clone()).chain(beside).chain(profile).collect()
    }

    /// Whether it matches photos of known poses, in metres: its depth is then in metres as stereo's is.
    #[must_use]
    pub fn matches_in_metres(&self) -> bool {
        let company = self.chosen().ok().and_then(|profile| profile.company);
        company.is_some_and(|company| company.unit == PoseUnit::Metre && !company.depth_range.is_empty())
    }

    fn chosen(&self) -> Result<Profile, PriorError> {
        let refuse = |problem: &str| {
            PriorError::Config {
            problem: problem.to_owned(),
            hint:
                "set `profile` to a built-in one, or to a TOML file that describes the network; a graph does not tell which way \
                   its numbers run"
                    .to_owned(),
        }
        };
        match &self.profile {
            Some(path) if is_profile_file(path) => profile_in(path).map_err(|problem| PriorError::Config {
                problem,
                hint: "`sizeup schema depth-network` prints every key of such a file".to_owned(),
            }),
            Some(name) => profile::by_name(name),
            None => {
                let name = self.model.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
                known::known_by_name(name)
                    .map_err(|_| refuse("no network profile is set"))
                    .and_then(|network| profile::by_name(network.name))
            }
        }
    }
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
    /// Lowest and highest ground, and how far above it roofs are looked for, metres: for networks that match photos.
    ground_m: Option<(f64, f64)>,
    tallest_m: f64,
    /// Photos as they go in, for those networks: each is in the company of several. By rows and columns.
    prepared: Kept<(ViewId, Option<(usize, usize)>), PreparedPhoto>,
    /// Held while the network runs: one inference takes all the memory and cores that it may.
    turn: Mutex<()>,
}

/// A view as the network takes it.
#[derive(Debug)]
pub(super) struct Ready {
    /// Inputs by their names, the image first.
    inputs: Vec<(String, Tensor)>,
    frame: NetworkInput,
}

impl NetworkPriors {
    /// Loads the network and checks that its profile fits. Of the views, the terrain and how far above it roofs are looked
    /// for (`tallest_m`, metres) only networks that take several photos make use.
    ///
    /// # Errors
    /// [`PriorError::Network`], or [`PriorError::Config`] where the profile does not fit.
    pub fn new(
        mut config: NetworkConfig,
        views: &[View],
        terrain: &Terrain,
        tallest_m: f64,
    ) -> Result<Self, PriorError> {
        let profile = config.chosen()?;
        profile.check()?;
        config.model = config.graph();
        if let (false, Some(hint)) = (config.model.exists(), known::how_to_get(&config.model)) {
            let problem = format!("the network {} is not in place", config.model.display());
            return Err(PriorError::Config { problem, hint });
        }
        let network = Network::open_with(&config.model, &config.engine)?;
        let wiring = profile.wire(network.inputs(), network.outputs()).map_err(|problem| PriorError::Config {
            problem: format!("profile {:?} does not fit {}: {problem}", profile.name, config.model.display()),
            hint: "`sizeup model inspect` shows what the graph wants and which profiles fit".to_owned(),
        })?;
        // A graph that is not sound is refused here, with why.
        Contents::read(&config.model)?;
        let files = config.files();
        let is_company = |view: &&View| wiring.n_views > 1 && view.image.is_some();
        let company = Neighbours::new(views.iter().filter(is_company).cloned().collect(), terrain);
        let prepared = Kept::up_to(PHOTOS_KEPT.max(2 * wiring.n_views));
        let ground_m = terrain.range();
        Ok(Self {
            network,
            config,
            profile,
            wiring,
            files,
            company,
            ground_m,
            tallest_m,
            prepared,
            turn: Mutex::new(()),
        })
    }

    /// Licence of the weights, for the log.
    #[must_use]
    pub fn licence(&self) -> &str {
        &self.profile.licence
    }

    /// Whether other photos of the same ground go in with a view's, and the terrain with them.
    pub(super) fn takes_several_photos(&self) -> bool {
        self.wiring.n_views > 1 || self.wiring.depth_range.is_some()
    }

    /// The view, and those that go in with it: fewer where the graph leaves the number free and there are no more.
    fn party<'a>(&'a self, view: &'a View) -> Result<Vec<&'a View>, PriorError> {
        let mut party = vec![view];
        party.extend(self.company.choose(view, self.wiring.n_views - 1));
        let is_short = party.len() < self.wiring.n_views;
        let is_fixed = self.network.inputs().iter().any(|port| {
            port.name == self.wiring.input && port.shape[self.wiring.rank - 4] == Some(self.wiring.n_views)
        });
        let is_alone = party.len() < 2 && self.wiring.depth_range.is_some();
        if (is_short && is_fixed) || is_alone {
            return Err(PriorError::Photo {
                view: view.id.to_string(),
                problem: format!(
                    "the network takes {} photos at once, and {} others see its ground under a fair angle",
                    self.wiring.n_views,
                    party.len() - 1
                ),
                hint: "photos have to overlap; or use a graph of fewer photos".to_owned(),
            });
        }
        Ok(party)
    }

    /// Rows and columns by the photo's full size, whatever it is decoded at; `None` where the profile has a size.
    fn size_of(&self, view: &View) -> Option<(usize, usize)> {
        let is_by_side = matches!(self.profile.fit, Fit::LongestSide | Fit::ShortestSide);
        let camera = &view.camera;
        is_by_side.then(|| preprocess::size(&self.profile, camera.width_px as usize, camera.height_px as usize))
    }

    /// A photo as it goes in, at `size` (rows, columns) where the graph or its company ask for one.
    fn photo(&self, view: &View, size: Option<(usize, usize)>) -> Result<Arc<PreparedPhoto>, PriorError> {
        let read = || {
            let photo = photo::decode(view)?;
            let photo = match self.profile.lens {
                Lens::AsTaken => photo,
                Lens::Ideal => photo::straightened(photo, &view.camera),
            };
            Ok(preprocess::prepare(&self.profile, &photo, size))
        };
        // Who goes in alone goes in once.
        if self.wiring.n_views == 1 { read().map(Arc::new) } else { self.prepared.get(&(view.id.clone(), size), read) }
    }

    /// Everything that the graph takes for a view: decoding and resizing, but no inference yet.
    pub(super) fn prepare(&self, view: &View) -> Result<Ready, PriorError> {
        let party = self.party(view)?;
        let first = self.photo(view, self.wiring.fixed_size.or_else(|| self.size_of(view)))?;
        let frame = first.frame;
        let mut values = Vec::with_capacity(party.len() * first.values.len());
        values.extend(&first.values);
        for view in &party[1..] {
            // All of one size, as a graph takes them; photos of one camera are, and others are stretched a little.
            values.extend(&self.photo(view, Some((frame.rows, frame.columns)))?.values);
        }
        let mut shape = vec![1; self.wiring.rank - 3];
        shape[self.wiring.rank - 4] = party.len();
        shape.extend([3, frame.rows, frame.columns]);
        let mut inputs = vec![(self.wiring.input.clone(), Tensor { shape, values })];
        for name in &self.wiring.constants {
            let value = self.profile.constants.get(name).copied().unwrap_or_default();
            let rank = self.network.inputs().iter().find(|port| port.name == *name).map_or(0, |port| port.shape.len());
            inputs.push((name.clone(), Tensor { shape: vec![1; rank], values: vec![value] }));
        }
        if let (Some(name), Some(Company { unit, direction, .. })) = (&self.wiring.extrinsics, &self.profile.company) {
            inputs.push((name.clone(), company::extrinsics(&party, *unit, *direction)));
        }
        let of_size = |name: &String| (name.clone(), company::intrinsics(&party, frame.rows, frame.columns));
        inputs.extend(self.wiring.intrinsics.iter().map(of_size));
        if let Some(name) = &self.wiring.depth_range {
            let values = self.depth_range(view)?.map(|depth_m| depth_m as f32).to_vec();
            inputs.push((name.clone(), Tensor { shape: vec![1, 2], values }));
        }
        Ok(Ready { inputs, frame })
    }

    /// Nearest and farthest depth that is looked for in a view, metres.
    fn depth_range(&self, view: &View) -> Result<[f64; 2], PriorError> {
        self.ground_m.and_then(|ground_m| depth_range::of(view, ground_m, self.tallest_m)).ok_or_else(|| {
            PriorError::Photo {
                view: view.id.to_string(),
                problem: "it sees no ground, or stands below it: there is no depth to look for".to_owned(),
                hint: "`sizeup survey inspect` looks poses over".to_owned(),
            }
        })
    }

    /// Outputs that are asked for: depth, then sky, mask and poses where there are any.
    fn wanted(&self) -> Vec<&str> {
        let Wiring { output, sky, mask, poses, .. } = &self.wiring;
        [Some(output), sky.as_ref(), mask.as_ref(), poses.as_ref()].into_iter().flatten().map(String::as_str).collect()
    }

    /// One inference: the wanted outputs of a view.
    pub(super) fn infer(&self, ready: &Ready) -> Result<Vec<Tensor>, PriorError> {
        let given: Vec<(&str, &Tensor)> = ready.inputs.iter().map(|(name, tensor)| (name.as_str(), tensor)).collect();
        let wanted = self.wanted();
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        // On a thread outside any pool: an engine with a pool of its own would let this thread, if it is a pool's,
        // take up the next view meanwhile, and that one would wait for the turn that this one has.
        let run = || self.network.run_many(&given, &wanted);
        Ok(std::thread::scope(|scope| scope.spawn(run).join())
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic))?)
    }

    /// The prior in what the network gave for a view.
    pub(super) fn finish(
        &self,
        view: &View,
        frame: &NetworkInput,
        outputs: Vec<Tensor>,
    ) -> Result<DepthPrior, PriorError> {
        let mut outputs = outputs.into_iter();
        let mut map = |name: Option<&String>, form: Form| {
            let Some((name, tensor)) = name.and_then(|name| Some((name, outputs.next()?))) else { return Ok(None) };
            let map = output::map_of(tensor, form).map_err(|problem| PriorError::File {
                path: self.config.model.clone(),
                problem: format!("output {name:?}: {problem}"),
            })?;
            Ok::<_, PriorError>(Some(output::cut_out(map, frame)))
        };
        let depth = map(Some(&self.wiring.output), self.profile.form)?;
        let sky = map(self.wiring.sky.as_ref(), Form::Map)?;
        let mask = map(self.wiring.mask.as_ref(), Form::Map)?;
        let mut values = depth.expect("the depth output was asked for");
        let unit = self.unit(view, frame, outputs.next().as_ref())?;
        let is_possible = |v: f32| v.is_finite() && (self.profile.kind == PriorKind::InverseDepth || v > 0.0);
        for value in values.data_mut() {
            *value = if is_possible(*value) { *value * unit } else { f32::NAN };
        }
        if let Some(sky) = sky {
            output::blank(&mut values, &sky, |sky| sky > self.profile.sky_above);
        }
        if let Some(mask) = mask {
            output::blank(&mut values, &mask, |mask| mask < self.profile.mask_least || mask.is_nan());
        }
        self.check_content(view, &values)?;
        if self.profile.lens == Lens::Ideal {
            values = photo::as_taken(values, &view.camera);
        }
        Ok(DepthPrior { values, kind: self.profile.kind, geometry: PriorGeometry::ZDepth })
    }

    /// Unit of the output: metres, where the profile says how; 1 where it has no unit.
    fn unit(&self, view: &View, frame: &NetworkInput, poses: Option<&Tensor>) -> Result<f32, PriorError> {
        if let Some(focal_px) = self.profile.metres_at_focal_px {
            let camera = view.camera.resized(frame.photo.columns as u32, frame.photo.rows as u32);
            return Ok((f64::midpoint(camera.fx_px, camera.fy_px) / f64::from(focal_px)) as f32);
        }
        let Some(poses) = poses else { return Ok(1.0) };
        let party = self.party(view)?;
        let metres = company::metres_per_unit(&party, poses).map_err(|problem| PriorError::Photo {
            view: view.id.to_string(),
            problem: format!("the poses that the network gives cannot be laid over the calibrated ones: {problem}"),
            hint: "a profile without `poses_output` takes the depth without a unit".to_owned(),
        });
        if party.len() < 2 { Ok(1.0) } else { Ok(metres? as f32) }
    }

    fn check_content(&self, view: &View, values: &Raster<f32>) -> Result<(), PriorError> {
        let first = values.data().iter().copied().find(|v| !v.is_nan());
        if values.data().iter().any(|v| !v.is_nan() && Some(*v) != first) {
            return Ok(());
        }
        Err(PriorError::NoInformation {
            path: self.config.model.clone(),
            problem: format!("for {} it gives one and the same value everywhere, or none", view.id),
        })
    }
}

impl Ready {
    /// Place of the photo in it.
    pub(super) fn frame(&self) -> NetworkInput {
        self.frame
    }
}

impl PriorSource for NetworkPriors {
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError> {
        let ready = self.prepare(view)?;
        let frame = ready.frame;
        let outputs = self.infer(&ready)?;
        self.finish(view, &frame, outputs)
    }
}

impl CacheKey for NetworkPriors {
    fn feed(&self, view: &View, key: &mut KeyHasher) -> Result<(), PriorError> {
        key.bytes(b"network 3");
        key.json(&self.profile);
        // Engines and processors round differently. Where the choice is free, the graph and the photo's size decide.
        key.json(&(self.config.engine.name, self.network.engine(), &self.config.engine.providers));
        for file in &self.files {
            key.file(file)?;
        }
        if self.wiring.depth_range.is_some() {
            key.json(&self.depth_range(view)?);
        }
        for member in self.party(view)? {
            let uses_poses = self.wiring.extrinsics.is_some() || self.wiring.poses.is_some();
            key.json(&(&member.camera, uses_poses.then_some(&member.camera_from_map)));
            if let Some(image) = &member.image {
                key.file(image)?;
            }
        }
        Ok(())
    }
}
