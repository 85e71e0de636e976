//! Priors without a choice: a network if its file is in place, else stereo from the photos.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{CacheConfig, NetworkConfig, PriorConfig, PriorError, StereoConfig};
use crate::onnx::is_profile_file;
use sizeup_geo::paths::{PathVisitor, visit_template};
use sizeup_survey::View;

/// Settings of the choice between a network and stereo.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AutoConfig {
    /// ONNX file of a network, used where it exists.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<PathBuf>,
    /// Profile of the network, as for `source = "network"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Where computed depth is kept, so that each view is computed once.
    pub cache: CacheConfig,
}

impl AutoConfig {
    /// Returns the network if its file is there, else stereo.
    #[must_use]
    pub fn chosen(&self) -> PriorConfig {
        let (cache, profile) = (self.cache.clone(), self.profile.clone());
        match self.model_in_place() {
            Some(model) => {
                PriorConfig::Network(Box::new(NetworkConfig { profile, cache, ..NetworkConfig::new(model, "") }))
            }
            None => PriorConfig::Stereo(StereoConfig { cache, ..StereoConfig::default() }),
        }
    }

    /// Checks that the photos that stereo needs are there.
    pub(super) fn check(&self, views: &[View]) -> Result<(), PriorError> {
        if self.model_in_place().is_some() || views.iter().any(|view| view.image.is_some()) {
            return Ok(());
        }
        Err(PriorError::Config {
            problem: "auto finds no source: no network is in place, and no view has a photo".to_owned(),
            hint: "set survey.images to the folder of the photos, prior.model to a network, or choose a source"
                .to_owned(),
        })
    }

    /// Reason of the choice, in words.
    pub(super) fn why(&self) -> String {
        match &self.model {
            Some(model) if model.is_file() => format!("as {} is in place", model.display()),
            Some(model) => format!("as there is no network {}", model.display()),
            None => "as no network is configured".to_owned(),
        }
    }

    pub(super) fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        self.model.iter_mut().for_each(&mut *visit);
        if let Some(profile) = self.profile.as_mut().filter(|profile| is_profile_file(profile)) {
            visit_template(profile, visit);
        }
        visit(&mut self.cache.folder);
    }

    fn model_in_place(&self) -> Option<&PathBuf> {
        self.model.as_ref().filter(|model| model.is_file())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_is_taken_where_its_file_is_and_stereo_where_it_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("net.onnx");
        let auto =
            AutoConfig { model: Some(model.clone()), profile: Some("da3-mono".to_owned()), ..AutoConfig::default() };
        assert!(matches!(auto.chosen(), PriorConfig::Stereo(_)));
        assert!(PriorConfig::Auto(auto.clone()).in_words().contains("there is no network"), "said, not silent");
        std::fs::write(&model, "graph").unwrap();
        let PriorConfig::Network(network) = auto.chosen() else { panic!("the network is in place") };
        assert_eq!((network.model, network.profile.as_deref()), (model, Some("da3-mono")));
        assert!(PriorConfig::Auto(auto).in_words().contains("in place"));
        let none = AutoConfig::default();
        assert!(matches!(none.chosen(), PriorConfig::Stereo(_)));
        assert!(none.check(&[]).unwrap_err().to_string().contains("survey.images"));
    }
}
