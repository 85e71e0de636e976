//! Where a project's footprints come from: one choice of the configuration.

use std::borrow::Cow;
use std::path::PathBuf;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize};

use super::layer::FootprintConfig;
use super::masks::MaskConfig;
use super::segment::{SMALL, SegmenterConfig};
use super::{CadastreConfig, ConsensusConfig, ContourKind, InputAccuracy};
use sizeup_geo::paths::PathVisitor;

/// Where the footprints come from. A table without `source` is an existing layer.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "source", rename_all = "snake_case")]
pub enum FootprintSource {
    /// An existing vector layer.
    Layer(FootprintConfig),
    /// Masks of the nadir photos that somebody else computed.
    Masks(MaskConfig),
    /// A segmentation network, run on the nadir photos: an ONNX file, or the one that comes with sizeup.
    Network(SegmenterConfig),
}

/// Source of the footprints, as a configuration states it.
#[derive(Deserialize, JsonSchema)]
#[serde(tag = "source", rename_all = "snake_case")]
enum Tagged {
    /// An existing vector layer; what a table without `source` is.
    Layer(FootprintConfig),
    /// Masks of the nadir photos that somebody else computed.
    Masks(MaskConfig),
    /// A segmentation network, run on the nadir photos: an ONNX file, or the one that comes with sizeup.
    Network(SegmenterConfig),
}

impl<'de> Deserialize<'de> for FootprintSource {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error as _;
        let mut table = serde_json::Map::deserialize(deserializer)?;
        table.entry("source").or_insert_with(|| "layer".into());
        let tagged: Tagged = serde_json::from_value(table.into()).map_err(D::Error::custom)?;
        Ok(match tagged {
            Tagged::Layer(layer) => Self::Layer(layer),
            Tagged::Masks(masks) => Self::Masks(masks),
            Tagged::Network(network) => Self::Network(network),
        })
    }
}

impl JsonSchema for FootprintSource {
    fn schema_name() -> Cow<'static, str> {
        "FootprintSource".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = Tagged::json_schema(generator);
        // A table without `source` is a layer.
        let variants = schema.get_mut("oneOf").and_then(|v| v.as_array_mut());
        let required = variants.and_then(|v| v.first_mut()).and_then(|v| v.get_mut("required"));
        if let Some(names) = required.and_then(|v| v.as_array_mut()) {
            names.retain(|name| name != "source");
        }
        schema
    }
}

/// Settings that masks and networks have in common.
#[derive(Debug, Clone, Copy)]
pub struct DetectionSettings<'a> {
    /// The contour that masks follow.
    pub contour: ContourKind,
    /// How accurate masks, poses and terrain are.
    pub accuracy: &'a InputAccuracy,
    /// How views become one footprint per building.
    pub consensus: &'a ConsensusConfig,
    /// Settings for holding the found against an existing layer; `None` without one.
    pub cadastre: Option<&'a CadastreConfig>,
}

impl FootprintSource {
    /// Hands every path of these settings to `visit`, which may change it.
    pub fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        match self {
            Self::Layer(layer) => visit(&mut layer.path),
            Self::Masks(masks) => masks.visit_paths(visit),
            Self::Network(network) => network.visit_paths(visit),
        }
    }

    /// The layer file or the network, for the lineage; masks are files per view.
    #[must_use]
    pub fn file(&self) -> Option<PathBuf> {
        match self {
            Self::Layer(layer) => Some(layer.path.clone()),
            Self::Masks(_) => None,
            Self::Network(network) => network.model.clone(),
        }
    }

    /// Where footprints come from, in words; of the network that comes with sizeup how good it is, too.
    #[must_use]
    pub fn in_words(&self) -> String {
        match self {
            Self::Layer(layer) => format!("the layer {}", layer.path.display()),
            Self::Masks(masks) => format!("the masks {}", masks.path),
            Self::Network(network) if network.model.is_none() => format!("{}: {}", network.in_words(), SMALL.measured),
            Self::Network(network) => network.in_words(),
        }
    }

    /// Whether contours are those of roofs, which move with the heights found.
    #[must_use]
    pub fn is_of_roofs(&self) -> bool {
        match self {
            Self::Masks(c) => c.contour == ContourKind::Roof,
            Self::Network(c) => c.contour == ContourKind::Roof,
            Self::Layer(_) => false,
        }
    }

    /// Settings by which footprints found in photos are put together; `None` for a layer.
    #[must_use]
    pub fn detection(&self) -> Option<DetectionSettings<'_>> {
        match self {
            Self::Layer(_) => None,
            Self::Masks(c) => Some(DetectionSettings {
                contour: c.contour,
                accuracy: &c.accuracy,
                consensus: &ConsensusConfig::STANDARD,
                cadastre: c.cadastre.as_ref(),
            }),
            Self::Network(c) => Some(DetectionSettings {
                contour: c.contour,
                accuracy: &c.accuracy,
                consensus: &ConsensusConfig::STANDARD,
                cadastre: c.cadastre.as_ref(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_without_a_source_is_a_layer_and_mistakes_are_named() {
        let read = |text: &str| toml::from_str::<FootprintSource>(text);
        assert!(matches!(read("path = 'a.gpkg'").unwrap(), FootprintSource::Layer(_)));
        let masks = read("source = 'masks'\npath = 'm/{stem}.png'\nkind = 'instance'").unwrap();
        assert!(matches!(&masks, FootprintSource::Masks(m) if m.contour == ContourKind::Ground));
        assert_eq!(read(&toml::to_string(&masks).unwrap()).unwrap(), masks);
        assert!(read("path = 'a.gpkg'\nid_feild = 'x'").unwrap_err().to_string().contains("id_feild"));
        assert!(read("source = 'sketch'\npath = 'a'").unwrap_err().to_string().contains("sketch"));
    }
}
