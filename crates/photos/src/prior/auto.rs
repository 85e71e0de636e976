//! Priors without a choice: the best source that there is. A network if its file is in place, else stereo from the photos.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{NetworkConfig, PriorConfig, PriorError, StereoConfig};
use sizeup_geo::paths::PathVisitor;
use sizeup_survey::View;

/// Settings of the choice among the sources of depth that are there.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AutoConfig {
    /// A network, used where its file exists.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network: Option<Box<NetworkConfig>>,
    /// Matching of photos with each other, used otherwise.
    pub stereo: StereoConfig,
}

impl AutoConfig {
    /// The best source that there is.
    #[must_use]
    pub fn chosen(&self) -> PriorConfig {
        match self.network_in_place() {
            Some(network) => PriorConfig::Network(Box::new(network.clone())),
            None => PriorConfig::Stereo(self.stereo.clone()),
        }
    }

    /// Checks that the photos that stereo needs are there.
    pub(super) fn check(&self, views: &[View]) -> Result<(), PriorError> {
        if self.network_in_place().is_some() || views.iter().any(|view| view.image.is_some()) {
            return Ok(());
        }
        Err(PriorError::Config {
            problem: "auto finds no source: no network is in place, and no view has a photo".to_owned(),
            hint: "set survey.images to the folder of the photos, prior.network.model to a network, or choose a source"
                .to_owned(),
        })
    }

    /// Why that one, in words.
    pub(super) fn why(&self) -> String {
        match &self.network {
            Some(network) if self.network_in_place().is_some() => {
                format!("as {} is in place", network.model.display())
            }
            Some(network) => format!("as there is no network {}", network.model.display()),
            None => "as no network is configured".to_owned(),
        }
    }

    pub(super) fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        if let Some(network) = &mut self.network {
            network.visit_paths(visit);
        }
        visit(&mut self.stereo.cache.folder);
    }

    fn network_in_place(&self) -> Option<&NetworkConfig> {
        self.network.as_deref().filter(|network| network.model.is_file())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_is_taken_where_its_file_is_and_stereo_where_it_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("net.onnx");
        let network = Some(Box::new(NetworkConfig::new(&model, "da3-mono")));
        let auto = AutoConfig { network, ..AutoConfig::default() };
        assert!(matches!(auto.chosen(), PriorConfig::Stereo(_)));
        assert!(PriorConfig::Auto(auto.clone()).in_words().contains("there is no network"), "said, not silent");
        std::fs::write(&model, "graph").unwrap();
        assert!(matches!(auto.chosen(), PriorConfig::Network(_)));
        assert!(PriorConfig::Auto(auto).in_words().contains("in place"));
        let none = AutoConfig::default();
        assert!(matches!(none.chosen(), PriorConfig::Stereo(_)));
        assert!(none.check(&[]).unwrap_err().to_string().contains("survey.images"));
    }
}
