//! Small sets and small networks.

use std::path::Path;

use sizeup_training::dataset::{DatasetConfig, make};
use sizeup_training::network::NetworkConfig;
use sizeup_training::train::{AugmentConfig, StopConfig, TrainConfig};

/// A village with row houses to learn from, another one to look at: 160 × 128 pixels, half a metre each.
pub const VILLAGES: &str = r#"
[[scene]]
name = "a"
split = "train"
licence = "CC0-1.0: simulated"
simulate = { seed = 5, town = { kind = "village", n_buildings = 16 }, flight = { height_m = 70.0, n_views = 20 }, camera = { width_px = 160, height_px = 128 }, terrain = { margin_m = 150.0 }, prior = { longest_px = 160 } }

[[scene]]
name = "b"
split = "val"
licence = "CC0-1.0: simulated"
simulate = { seed = 2, town = { kind = "village", n_buildings = 8 }, flight = { height_m = 70.0, n_views = 12 }, camera = { width_px = 160, height_px = 128 }, terrain = { margin_m = 150.0 }, prior = { longest_px = 160 } }
"#;

pub fn villages(folder: &Path) {
    let config: DatasetConfig = toml::from_str(VILLAGES).unwrap();
    make::make(&config, folder, &|_| ()).unwrap();
}

/// A network of a few thousand parameters with every kind of layer.
pub fn small_network() -> NetworkConfig {
    NetworkConfig {
        texture: vec![8, 12],
        geometry: vec![4],
        projected: 4,
        widths: vec![8, 16, 16],
        decoder: 8,
        ..NetworkConfig::default()
    }
}

pub fn quick() -> TrainConfig {
    TrainConfig {
        network: small_network(),
        crop_px: 64,
        batch: 2,
        steps: 6,
        warm_up: 1,
        augment: AugmentConfig::default(),
        stop: StopConfig { every: 2, patience: 9 },
        ..TrainConfig::default()
    }
}
