//! The loop: a step, now and then a look at the scenes for validation, a checkpoint, a line of the log and pictures.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use candle_core::{DType, Device};
use sizeup_geo::files;

use super::checkpoint::{Checkpoint, Progress};
use super::loss::{loss, overlap};
use super::optimise::{Moments, learning_rate};
use super::sample::{Batch, Scene};
use super::{TrainConfig, features, pictures, sample, start};
use crate::TrainError;
use crate::dataset::Split;
use crate::dataset::load::Set;
use crate::dataset::manifest::{FILE, FileEntry};
use crate::network::evaluate::logits;
use crate::network::parameters::Parameters;

/// To go on from.
pub const LAST: &str = "last.safetensors";
/// To use: the parameters of the best look.
pub const BEST: &str = "best.safetensors";
/// Losses, a line per look.
pub const LOG: &str = "log.csv";
const HEADER: &str = "step,learning_rate,train_loss,val_loss,val_iou\n";

/// The device to compute on: a GPU in a program built for one, else the CPU.
///
/// # Errors
/// A GPU that does not work.
pub fn device() -> Result<Device, TrainError> {
    Ok(Device::cuda_if_available(0)?)
}

/// What a training is made of.
#[derive(Debug)]
pub struct Training {
    config: TrainConfig,
    train: Vec<Scene>,
    val: Vec<Scene>,
    set: String,
    out: PathBuf,
    device: Device,
}

impl Training {
    /// Gets the photos of one set or of several ready.
    ///
    /// # Errors
    /// [`TrainError`] for settings and sets that cannot be used.
    pub fn new(config: TrainConfig, sets: &[Set], out: &Path) -> Result<Self, TrainError> {
        config.validate()?;
        check_scenes(sets, &config)?;
        let of = |split: Split| -> Result<Vec<Scene>, TrainError> {
            let mut photos = Vec::new();
            for set in sets {
                photos.extend(set.photos(split)?);
            }
            if photos.is_empty() {
                let root = sets.first().map_or(Path::new(""), |set| &set.root);
                let problem = format!("no photos for {:?}", split.name());
                let hint = "a set needs a scene with `split = \"train\"` and one with \"val\"";
                return Err(TrainError::set(root, problem, hint));
            }
            Scene::ready(photos, &config)
        };
        let (train, val) = (of(Split::Train)?, of(Split::Val)?);
        features::check(&train.iter().chain(&val).collect::<Vec<&Scene>>(), &config)?;
        let digests = sets.iter().map(|set| Ok(FileEntry::of(&set.root.join(FILE))?.sha256));
        let set = digests.collect::<Result<Vec<_>, TrainError>>()?.join(" ");
        Ok(Self { config, train, val, set, out: out.to_owned(), device: device()? })
    }

    /// Trains, from the last checkpoint where there is one; `told` hears each line of the log. Stops after `most_steps` more
    /// steps where that is given, as a kill would.
    ///
    /// # Errors
    /// [`TrainError`]; what was computed until the last look is in its checkpoint.
    pub fn run(&self, most_steps: Option<usize>, told: &dyn Fn(&str)) -> Result<Checkpoint, TrainError> {
        let path = self.out.join(LAST);
        let mut state = if path.exists() { self.resumed(&path)? } else { self.fresh()? };
        let first = state.progress.step;
        let n = state.parameters.n_values();
        told(&format!("{n} parameters, {} photos, from step {first}", self.train.len()));
        while state.progress.step < self.config.steps && !self.is_over(&state) {
            if most_steps.is_some_and(|most| state.progress.step - first >= most) {
                return Ok(state);
            }
            self.step(&mut state)?;
            if state.progress.step.is_multiple_of(self.config.stop.every) || state.progress.step == self.config.steps {
                self.look(&mut state, told)?;
            }
        }
        Ok(state)
    }

    fn is_over(&self, state: &Checkpoint) -> bool {
        state.progress.n_since >= self.config.stop.patience
    }

    fn fresh(&self) -> Result<Checkpoint, TrainError> {
        let parameters = match &self.config.start {
            Some(path) => start::parameters(path, &self.config.network, &self.device)?,
            None => Parameters::new(&self.config.network, self.config.seed, DType::F32, &self.device)?,
        };
        let best = copy(&parameters)?;
        files::write_whole(&self.out.join(LOG), |w| w.write_all(HEADER.as_bytes()))?;
        Ok(Checkpoint {
            config: self.config.clone(),
            progress: Progress {
                step: 0,
                best_loss: None,
                best_step: 0,
                best_iou: 0.0,
                n_since: 0,
                loss_sum: (0.0, 0),
            },
            set: self.set.clone(),
            moments: Some(Moments::new(&parameters)?),
            parameters,
            best,
        })
    }

    fn resumed(&self, path: &Path) -> Result<Checkpoint, TrainError> {
        let state = Checkpoint::read(path, &self.device)?;
        state.check(path, &self.config, &self.set)?;
        // The log may be ahead of the checkpoint by a line.
        let log = files::read_text(&self.out.join(LOG)).unwrap_or_else(|_| HEADER.to_owned());
        let is_done = |line: &&str| {
            line.split(',').next().and_then(|s| s.parse().ok()).is_none_or(|s: usize| s <= state.progress.step)
        };
        let kept: String = log.lines().filter(is_done).map(|line| format!("{line}\n")).collect();
        files::write_whole(&self.out.join(LOG), |w| w.write_all(kept.as_bytes()))?;
        Ok(state)
    }

    fn step(&self, state: &mut Checkpoint) -> Result<(), TrainError> {
        let step = state.progress.step + 1;
        let batch = if self.config.network.features.is_empty() {
            sample::of_step(&self.train, &self.config, step, &self.device)?
        } else {
            features::of_step(&self.train, &self.config, step, &self.device)?
        };
        let size = (batch.target.dim(2)?, batch.target.dim(3)?);
        let found = logits(&self.config.network, &state.parameters, &batch.inputs, size)?;
        let loss = loss(&found, &batch, &self.config.loss)?;
        let gradients = loss.backward()?;
        let value = f64::from(loss.to_scalar::<f32>()?);
        if !value.is_finite() {
            let problem = format!("the loss is {value} at step {step}");
            return Err(TrainError::config(problem, "a smaller `learning_rate`; the last checkpoint is whole"));
        }
        let moments = state.moments.as_mut().expect("a training has them");
        moments.step(&state.parameters, &gradients, &self.config, step)?;
        state.progress.step = step;
        state.progress.loss_sum.0 += value;
        state.progress.loss_sum.1 += 1;
        Ok(())
    }

    fn whole(&self, scene: &Scene) -> Result<Batch, TrainError> {
        if self.config.network.features.is_empty() {
            sample::whole(scene, &self.config, &self.device)
        } else {
            features::batch(&[scene], &self.config, &self.device)
        }
    }

    fn look(&self, state: &mut Checkpoint, told: &dyn Fn(&str)) -> Result<(), TrainError> {
        // Of orthophotos and of others: number of photos, sum of losses, pixels of both, pixels of either.
        let mut sums = [[0.0; 4]; 2];
        let mut shown = Vec::new();
        for (i, scene) in self.val.iter().enumerate() {
            let batch = self.whole(scene)?;
            let size = (batch.target.dim(2)?, batch.target.dim(3)?);
            let found = logits(&self.config.network, &state.parameters, &batch.inputs, size)?.detach();
            let loss = f64::from(loss(&found, &batch, &self.config.loss)?.to_scalar::<f32>()?);
            let (both, either) = overlap(&found, &batch)?;
            let group = &mut sums[usize::from(!scene.is_orthophoto())];
            group.iter_mut().zip([1.0, loss, both, either]).for_each(|(sum, value)| *sum += value);
            if pictures::is_shown(i, self.val.len()) {
                shown.push((scene, sample::reduction(&scene.photo, &self.config), found));
            }
        }
        let share = self.config.orthophotos.share;
        let weights = match sums.map(|group| group[0] > 0.0) {
            [true, true] => [share, 1.0 - share],
            has => has.map(f64::from),
        };
        let iou_of = |[_, _, both, either]: [f64; 4]| if either > 0.0 { both / either } else { 1.0 };
        let mean = |value: &dyn Fn([f64; 4]) -> f64| {
            let terms = sums.iter().zip(weights).filter(|(_, weight)| *weight > 0.0);
            terms.map(|(group, weight)| weight * value(*group)).sum::<f64>()
        };
        let (val_loss, iou) = (mean(&|group| group[1] / group[0]), mean(&iou_of));
        let of_orthophotos = if weights[0] > 0.0 && weights[1] > 0.0 {
            format!(" ({:.1} % of orthophotos, {:.1} % of others)", 100.0 * iou_of(sums[0]), 100.0 * iou_of(sums[1]))
        } else {
            String::new()
        };
        let progress = &mut state.progress;
        let (total, n) = std::mem::take(&mut progress.loss_sum);
        let train_loss = total / n.max(1) as f64;
        if progress.best_loss.is_none_or(|best| val_loss < best) {
            (progress.best_loss, progress.best_step, progress.best_iou, progress.n_since) =
                (Some(val_loss), progress.step, iou, 0);
            state.best = copy(&state.parameters)?;
        } else {
            progress.n_since += 1;
        }
        let step = state.progress.step;
        let mut log = files::read_text(&self.out.join(LOG))?;
        let rate = learning_rate(&self.config, step);
        writeln!(log, "{step},{rate:.3e},{train_loss:.5},{val_loss:.5},{iou:.5}").expect("text grows");
        files::write_whole(&self.out.join(LOG), |w| w.write_all(log.as_bytes()))?;
        pictures::curve(&log, &self.out.join("curve.png"))?;
        pictures::overlays(&shown, &self.out.join("val.png"))?;
        state.write(&self.out.join(LAST))?;
        told(&format!(
            "step {step}: loss {train_loss:.4}, on validation {val_loss:.4}, IoU {:.1} %{of_orthophotos}{}",
            100.0 * iou,
            if state.progress.n_since == 0 { ", the best so far" } else { "" }
        ));
        let network = Checkpoint {
            config: state.config.clone(),
            progress: state.progress.clone(),
            set: state.set.clone(),
            parameters: state.best.clone(),
            best: state.best.clone(),
            moments: None,
        };
        network.write(&self.out.join(BEST))
    }
}

/// Checks that no scene is in two sets, for what one set tests another one may learn from, and that every scene exists that the
/// configuration names.
fn check_scenes(sets: &[Set], config: &TrainConfig) -> Result<(), TrainError> {
    let mut names = BTreeSet::new();
    for set in sets {
        if let Some(twice) = set.manifest.scenes.iter().find(|scene| !names.insert(&scene.name)) {
            let problem = format!("its scene {:?} is in another set, too", twice.name);
            return Err(TrainError::set(&set.root, problem, "a scene is in one set and one split only"));
        }
    }
    if let Some(unknown) = config.orthophotos.scenes.iter().find(|name| !names.contains(name)) {
        let found = names.into_iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        let problem = format!("orthophotos.scenes: there is no scene {unknown:?} among {found}");
        return Err(TrainError::config(problem, "a scene of one of the sets given with --set"));
    }
    Ok(())
}

/// Parameters of their own with the same values.
fn copy(parameters: &Parameters) -> Result<Parameters, TrainError> {
    let vars = parameters
        .vars
        .iter()
        .map(|(name, var)| Ok((name.clone(), candle_core::Var::from_tensor(&var.as_tensor().copy()?.detach())?)));
    Ok(Parameters { vars: vars.collect::<Result<_, TrainError>>()? })
}
