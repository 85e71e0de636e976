//! Settings of a segmentation network: which one, and how it is run.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::profile::{SegmenterProfile, built_in};
use super::small;
use crate::cadastre::CadastreConfig;
use crate::contours::ContourKind;
use crate::georeference::InputAccuracy;
use crate::layer::FootprintError;
use sizeup_geo::paths::{PathVisitor, visit_template};
use sizeup_photos::onnx::{is_profile_file, profile_in};

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
    /// Built-in profile: "semantic", "small.v1", "sam3" or "fpsam.v1"; or a TOML file that describes another network. Left out where
    /// `model` is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Ground that a pixel of what the network sees covers at least, metres: finer photos are reduced to it. 0.34 for the network that
    /// comes with sizeup; photos are seen as they are where left out for a network of your own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub pixel_m: Option<f64>,
    /// Probability above which there is a building, 0 to 1.
    #[serde(default = "default_above")]
    #[schemars(extend("x-expert" = true))]
    pub above: f32,
    /// The contour that masks follow: "ground", where walls meet the ground, or "roof".
    #[serde(default)]
    pub contour: ContourKind,
    /// How accurate masks, poses and terrain are.
    #[serde(default)]
    pub accuracy: InputAccuracy,
    /// An existing layer whose ids and attributes are kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cadastre: Option<CadastreConfig>,
}

fn default_above() -> f32 {
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
            pixel_m: None,
            above: default_above(),
            contour: ContourKind::default(),
            accuracy: InputAccuracy::default(),
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
    pub(crate) fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        self.model.iter_mut().for_each(&mut *visit);
        if let Some(profile) = self.profile.as_mut().filter(|profile| is_profile_file(profile)) {
            visit_template(profile, visit);
        }
        self.backbones.values_mut().for_each(&mut *visit);
        if let Some(cadastre) = &mut self.cadastre {
            cadastre.visit_paths(visit);
        }
    }

    pub(super) fn chosen(&self) -> Result<SegmenterProfile, FootprintError> {
        let names = || built_in().into_iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
        let refuse = |problem: String| FootprintError::Masks { problem, hint: format!("the profiles are {}", names()) };
        if self.model.is_none() && self.profile.as_deref().is_some_and(|p| p != small::PROFILE) {
            return Err(FootprintError::Masks {
                problem: "a profile is set, and no `model` that it would fit".to_owned(),
                hint: "set `model` to an ONNX file, or leave both out: then the network that comes with sizeup is run"
                    .to_owned(),
            });
        }
        let profile = if self.model.is_none() { Some(small::PROFILE.to_owned()) } else { self.profile.clone() };
        match &profile {
            Some(path) if is_profile_file(path) => profile_in(path).map_err(|problem| FootprintError::Masks {
                problem,
                hint: "`sizeup schema footprint-network` prints every key of such a file".to_owned(),
            }),
            Some(name) => built_in()
                .into_iter()
                .find(|p| p.name == *name)
                .ok_or_else(|| refuse(format!("no segmenter profile {name:?}"))),
            None => Err(refuse("no segmenter profile is set".to_owned())),
        }
    }
}

impl SegmenterConfig {
    /// Whether shares and sizes are in range, with the least dip between buildings that is asked for.
    pub(super) fn check(&self, dip: f32) -> Result<(), FootprintError> {
        let refuse = |problem: String, hint: &str| Err(FootprintError::Masks { problem, hint: hint.to_owned() });
        let is_share = |v: f32| (0.0..=1.0).contains(&v);
        if !is_share(dip) {
            return refuse(format!("dip = {dip}"), "a difference of values from 0 to 1");
        }
        if !is_share(self.above) {
            return refuse(format!("above = {}", self.above), "a share from 0 to 1");
        }
        if let Some(pixel_m) = self.pixel_m.filter(|m| !(0.01..=10.0).contains(m)) {
            return refuse(format!("pixel_m = {pixel_m}"), "metres of ground per pixel, 0.01 to 10");
        }
        Ok(())
    }
}
