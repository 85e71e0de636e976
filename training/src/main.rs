//! `sizeup-train`: sets, training, export, measuring.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use candle_core::Device;
use sizeup_training::config::read_toml;
use sizeup_training::dataset::load::Set;
use sizeup_training::dataset::{DatasetConfig, make};
use sizeup_training::train::TrainConfig;
use sizeup_training::train::checkpoint::Checkpoint;
use sizeup_training::train::run::Training;
use sizeup_training::{TrainError, export};

/// Trains networks that find where buildings meet the ground.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Makes a set to learn from: photos with outlines on the ground.
    Dataset {
        /// Scenes, as TOML.
        config: PathBuf,
        /// Folder of the set; it may not hold one yet.
        #[arg(short, long)]
        output: PathBuf,
    },
    /// Trains a network on a set, or goes on where it stopped.
    Train {
        /// Settings, as TOML.
        config: PathBuf,
        /// Folder of the set.
        #[arg(short, long)]
        set: PathBuf,
        /// Folder of checkpoints, log and pictures.
        #[arg(short, long)]
        output: PathBuf,
    },
    /// Writes a trained network as ONNX, for `sizeup footprints`.
    Export {
        /// A checkpoint: `best.safetensors`.
        checkpoint: PathBuf,
        /// The file to write.
        #[arg(short, long)]
        output: PathBuf,
        /// Side of a tile, pixels: what the network sees at once.
        #[arg(long, default_value_t = 256)]
        tile: usize,
    },
}

fn main() -> ExitCode {
    match run(Arguments::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(match error {
                TrainError::Config { .. } => 2,
                TrainError::Set { .. } | TrainError::Scene { .. } | TrainError::Checkpoint { .. } => 3,
                TrainError::File(_) | TrainError::Tensor(_) => 4,
            })
        }
    }
}

fn run(command: Command) -> Result<(), TrainError> {
    match command {
        Command::Dataset { config, output } => {
            make::make(&DatasetConfig::read(&config)?, &output, &|line| eprintln!("{line}"))?;
            Ok(())
        }
        Command::Train { config, set, output } => {
            let config: TrainConfig = read_toml(&config)?;
            let training = Training::new(config, &Set::open(&set)?, &output)?;
            training.run(None, &|line| eprintln!("{line}"))?;
            Ok(())
        }
        Command::Export { checkpoint, output, tile } => {
            let network = Checkpoint::read(&checkpoint, &Device::Cpu)?;
            export::write(&network, tile, &output)
        }
    }
}
