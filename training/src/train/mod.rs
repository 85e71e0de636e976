//! Training: what it is told, what it sees, how it steps, what it keeps.

pub mod checkpoint;
pub mod features;
pub mod looks;
pub mod loss;
mod matched;
pub mod optimise;
pub mod pictures;
pub mod run;
pub mod sample;
pub mod start;

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::network::NetworkConfig;

/// All of a training but its set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrainConfig {
    /// Root of every random choice: the same seed and set give the same network, to the bit, on the same machine.
    pub seed: u64,
    /// How large the network is and what it sees.
    pub network: NetworkConfig,
    /// Folder of feature files, for a network with `features`: `FOLDER/SCENE/PHOTO.safetensors`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub features: Option<PathBuf>,
    /// Network that the training begins with: a checkpoint, whose best parameters are taken, or what `export` wrote. It has to have the
    /// same layers. Drawn from the seed where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<PathBuf>,
    /// Ground that a pixel of what the network sees covers at least, metres: finer photos are reduced to it, so that one size in pixels is
    /// one size on the ground. Photos are seen as they are where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_m: Option<f64>,
    /// Side of what a network sees at once, pixels; a multiple of what its levels ask for, 32 with all defaults. With features
    /// the side that whole photos are brought to.
    pub crop_px: usize,
    /// Share of crops around a place where two roofs meet, where the photo has one.
    pub at_seams: f64,
    /// Crops in a step.
    pub batch: usize,
    /// Steps in all, unless it stops early.
    pub steps: usize,
    /// Of the optimiser, at its highest.
    pub learning_rate: f64,
    /// Steps until it is at its highest; after that it falls as a cosine to nothing.
    pub warm_up: usize,
    /// How much weights shrink in a step, per learning rate.
    pub weight_decay: f64,
    /// Settings of the loss.
    pub loss: LossConfig,
    /// Ways in which crops are varied.
    pub augment: AugmentConfig,
    /// Scenes of real orthophotos, and how they are learned from.
    pub orthophotos: OrthophotoConfig,
    /// When to look, and when to stop.
    pub stop: StopConfig,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            network: NetworkConfig::default(),
            features: None,
            start: None,
            pixel_m: None,
            crop_px: 192,
            at_seams: 0.0,
            batch: 8,
            steps: 1000,
            learning_rate: 3e-3,
            warm_up: 40,
            weight_decay: 1e-3,
            loss: LossConfig::default(),
            augment: AugmentConfig::default(),
            orthophotos: OrthophotoConfig::default(),
            stop: StopConfig::default(),
        }
    }
}

/// What is made small: `BCE + dice · (1 − Dice)` of buildings on the ground, `roof` times the same of roofs, `middle` times the
/// cross-entropy of how near to its roof's middle each pixel lies, `rise` times that of how far roofs rise, and `seam` times that of where two
/// roofs meet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LossConfig {
    /// Weight of the Dice terms beside the cross-entropies.
    pub dice: f64,
    /// Weight of roofs beside buildings on the ground.
    pub roof: f64,
    /// Weight of middles of roofs.
    pub middle: f64,
    /// Weight of how far roofs rise.
    pub rise: f64,
    /// Weight of where two roofs meet.
    pub seam: f64,
    /// How far a roof's edge reaches into it: from there on all is its middle, pixels.
    pub reach_px: usize,
    /// How much more pixels within reach of another roof count in the cross-entropy of middles: only there is anything to
    /// learn that the mask does not tell.
    pub shared_gain: f64,
    /// How much more pixels where two roofs meet count in the cross-entropy of these than other pixels of roofs: they are few.
    pub seam_gain: f64,
}

impl Default for LossConfig {
    fn default() -> Self {
        Self { dice: 1.0, roof: 0.5, middle: 1.0, rise: 1.0, seam: 1.0, reach_px: 8, shared_gain: 3.0, seam_gain: 4.0 }
    }
}

/// How crops vary. Flips and quarter turns are always there; they turn the lean along.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AugmentConfig {
    /// Most that a crop is enlarged or reduced, as a share of 1, 0 to 0.5.
    pub zoom: f64,
    /// Standard deviation of the gain of each colour and of all, as a share of 1.
    pub colour: f64,
    /// Standard deviation of the exponent of the grey levels, as a share of 1.
    pub gamma: f64,
    /// Share of crops without colour.
    pub grey: f64,
    /// Most standard deviation of noise, grey levels.
    pub noise: f64,
    /// Share of crops that are blurred by a box of three pixels.
    pub blur: f64,
    /// Standard deviation of the gain of the relief, as a share of 1.
    pub relief: f64,
    /// Share of crops in which colours, or where there is depth that, are left out altogether; never both.
    pub drop: f64,
    /// Share of crops whose depth is as if photos had been matched for it: wandering edges, steps, blobs, holes.
    pub matched: f64,
    /// Share of crops whose roofs and ground take other colours: roofs are red, grey, white, blue or of rusty metal, each as often.
    pub painted: f64,
    /// Most standard deviation of the logarithm of light that changes over tens of pixels.
    pub light: f64,
    /// The same of a texture of a few pixels.
    pub texture: f64,
    /// Share of crops over a part of which a shadow falls.
    pub shaded: f64,
    /// Share of crops without depth, besides those of `drop`.
    pub without_depth: f64,
}

/// Scenes whose labels are outlines of roofs drawn on an orthophoto. They teach roofs, middles, seams and, beside a rim, the ground; they
/// teach no rise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OrthophotoConfig {
    /// Names of the scenes, for training and for validation.
    pub scenes: Vec<String>,
    /// Share of crops from these scenes, each scene as often as the others. It also is their weight in the loss on validation.
    pub share: f64,
    /// Width of the rim on each side of an outline in which the ground is unknown, metres: walls stand inside the eaves.
    pub rim_m: f64,
    /// Share of their crops that get the lean of an ordinary photo. Roofs look the same there; the ground is unknown.
    pub leaning: f64,
    /// Share of their crops that get depth made from the outlines, with trees. The other crops have no depth.
    pub raised: f64,
}

impl Default for OrthophotoConfig {
    fn default() -> Self {
        Self { scenes: Vec::new(), share: 0.5, rim_m: 0.4, leaning: 0.5, raised: 0.3 }
    }
}

impl Default for AugmentConfig {
    fn default() -> Self {
        Self {
            zoom: 0.25,
            colour: 0.2,
            gamma: 0.2,
            grey: 0.1,
            noise: 6.0,
            blur: 0.2,
            relief: 0.2,
            drop: 0.0,
            matched: 0.0,
            painted: 0.0,
            light: 0.0,
            texture: 0.0,
            shaded: 0.0,
            without_depth: 0.0,
        }
    }
}

/// When to look, and when to stop.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StopConfig {
    /// Steps between looks at the scenes for validation; a checkpoint is written at each.
    pub every: usize,
    /// Looks without a better one after which it stops.
    pub patience: usize,
}

impl Default for StopConfig {
    fn default() -> Self {
        Self { every: 100, patience: 8 }
    }
}

impl TrainConfig {
    /// Checks every range.
    ///
    /// # Errors
    /// [`TrainError::Config`] for the first setting out of range.
    pub fn validate(&self) -> Result<(), TrainError> {
        if let Some((found, expected)) = self.network.fault() {
            return Err(TrainError::config(format!("network: {found}"), &format!("expected {expected}")));
        }
        let multiple = self.network.multiple();
        if self.network.features.is_empty() && (self.crop_px == 0 || !self.crop_px.is_multiple_of(multiple)) {
            let problem = format!("crop_px = {}: expected a multiple of {multiple}", self.crop_px);
            return Err(TrainError::config(problem, "each level of the network halves the grid"));
        }
        if self.network.features.is_empty() == self.features.is_some() {
            let problem = "`features` and `network.features` go together: one is set without the other";
            return Err(TrainError::config(problem, "the folder of feature files, and their names and channels"));
        }
        if self.pixel_m.is_some() && self.features.is_some() {
            let problem = "`pixel_m` and `features` are both set";
            return Err(TrainError::config(
                problem,
                "features are of whole photos: reduce the photos that they are made from",
            ));
        }
        let within = |value: f64, low: f64, high: f64| value >= low && value <= high;
        let (a, l, o) = (&self.augment, &self.loss, &self.orthophotos);
        for (name, value, low, high) in [
            ("pixel_m", self.pixel_m.unwrap_or(1.0), 0.01, 10.0),
            ("crop_px", self.crop_px as f64, 16.0, 4096.0),
            ("at_seams", self.at_seams, 0.0, 1.0),
            ("batch", self.batch as f64, 1.0, 1024.0),
            ("steps", self.steps as f64, 1.0, 1e8),
            ("learning_rate", self.learning_rate, 1e-8, 1.0),
            ("weight_decay", self.weight_decay, 0.0, 1.0),
            ("loss.dice", l.dice, 0.0, 100.0),
            ("loss.roof", l.roof, 0.0, 100.0),
            ("loss.middle", l.middle, 0.0, 100.0),
            ("loss.rise", l.rise, 0.0, 100.0),
            ("loss.seam", l.seam, 0.0, 100.0),
            ("loss.seam_gain", l.seam_gain, 1.0, 1000.0),
            ("loss.reach_px", l.reach_px as f64, 1.0, 50.0),
            ("loss.shared_gain", l.shared_gain, 1.0, 1000.0),
            ("augment.zoom", a.zoom, 0.0, 0.5),
            ("augment.colour", a.colour, 0.0, 1.0),
            ("augment.gamma", a.gamma, 0.0, 1.0),
            ("augment.grey", a.grey, 0.0, 1.0),
            ("augment.noise", a.noise, 0.0, 100.0),
            ("augment.blur", a.blur, 0.0, 1.0),
            ("augment.relief", a.relief, 0.0, 1.0),
            ("augment.drop", a.drop, 0.0, 0.9),
            ("augment.matched", a.matched, 0.0, 1.0),
            ("augment.painted", a.painted, 0.0, 1.0),
            ("augment.light", a.light, 0.0, 1.0),
            ("augment.texture", a.texture, 0.0, 1.0),
            ("augment.shaded", a.shaded, 0.0, 1.0),
            ("augment.without_depth", a.without_depth, 0.0, 1.0),
            ("orthophotos.share", o.share, 0.0, 1.0),
            ("orthophotos.rim_m", o.rim_m, 0.0, 5.0),
            ("orthophotos.leaning", o.leaning, 0.0, 1.0),
            ("orthophotos.raised", o.raised, 0.0, 1.0),
            ("stop.every", self.stop.every as f64, 1.0, 1e8),
            ("stop.patience", self.stop.patience as f64, 1.0, 1e8),
        ] {
            if !within(value, low, high) {
                return Err(TrainError::config(
                    format!("{name} = {value}: expected {low} to {high}"),
                    "docs/footprint-network.md",
                ));
            }
        }
        Ok(())
    }
}
