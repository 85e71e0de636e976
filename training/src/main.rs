//! `sizeup-train`: sets, training, export, measuring.

use std::fmt;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use candle_core::Device;
use clap::{Parser, Subcommand};
use sizeup_geo::files::FileError;
use sizeup_training::config::read_toml;
use sizeup_training::dataset::load::Set;
use sizeup_training::dataset::{DatasetConfig, Split, make};
use sizeup_training::measure::{self, Row};
use sizeup_training::network::Input;
use sizeup_training::train::TrainConfig;
use sizeup_training::train::checkpoint::Checkpoint;
use sizeup_training::train::run::Training;
use sizeup_training::{TrainError, export};

// Activations come and go by the hundred megabytes; the system's allocator gives them back to the system each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Trains networks that find where buildings meet the ground.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Makes a set to learn from: photos with footprints on the ground.
    Dataset {
        /// Scenes to make a set of, as TOML.
        config: PathBuf,
        /// Folder of the set; it may not hold one yet.
        #[arg(short, long)]
        output: PathBuf,
    },
    /// Trains a network on a set, or goes on where it stopped.
    Train {
        /// Settings of the training, as TOML.
        config: PathBuf,
        /// Folder of the set. May be repeated: photos of all sets are learned from.
        #[arg(short, long, required = true)]
        set: Vec<PathBuf>,
        /// Folder of checkpoints, log and pictures.
        #[arg(short, long)]
        output: PathBuf,
    },
    /// Writes a trained network as ONNX, for `sizeup footprints`.
    Export {
        /// Checkpoint to export: `best.safetensors`.
        checkpoint: PathBuf,
        /// The file to write.
        #[arg(short, long)]
        output: PathBuf,
        /// Side of a tile, pixels: what the network sees at once; of a head over features, the side of its masks.
        #[arg(long, default_value_t = 256)]
        tile: usize,
        /// A photo's features, as a head over features learned from: it is written for maps of their sizes, those of one tile where
        /// the file says so.
        #[arg(long, value_name = "FILE")]
        like: Option<PathBuf>,
    },
    /// Compares networks, and what other programs found, with the footprints of a set: precision, recall, F1, intersection over union.
    Measure {
        /// Folder of the set.
        #[arg(short, long)]
        set: PathBuf,
        /// Which scenes: train, val or test.
        #[arg(long, default_value = "test")]
        split: String,
        /// A network to measure, as NAME=FILE: ONNX or a checkpoint. May be repeated.
        #[arg(long, value_name = "NAME=FILE")]
        network: Vec<String>,
        /// Footprints of another program to measure, as NAME=FILE: COCO. May be repeated.
        #[arg(long, value_name = "NAME=FILE")]
        coco: Vec<String>,
        /// Side of a tile for checkpoints, pixels.
        #[arg(long, default_value_t = 256)]
        tile: usize,
        /// How far the map of middles falls between two buildings, 0 to 1: a row of each network for each. May
        /// be repeated; the profile's own where left out.
        #[arg(long)]
        dip: Vec<f32>,
        /// Ground per pixel that finer photos are reduced to, metres, as `footprints.pixel_m`.
        #[arg(long)]
        pixel_m: Option<f64>,
        /// Looks at each tile, 1, 2 or 4, as `footprints.looks`.
        #[arg(long, default_value_t = 1)]
        looks: usize,
        /// Measure each checkpoint once more, blind to an input that it takes: image or depth. May be repeated.
        #[arg(long, value_name = "INPUT")]
        without: Vec<String>,
        /// Folder for the table as JSON, and pictures.
        #[arg(short, long)]
        output: Option<PathBuf>,
    },
    /// Prints the JSON Schema of a configuration file.
    Schema {
        /// Which: dataset or train.
        which: String,
    },
}

fn main() -> ExitCode {
    match run(Arguments::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            talk(&format_args!("error: {error}"));
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
            make::make(&DatasetConfig::read(&config)?, &output, &|line| talk(&line))?;
            Ok(())
        }
        Command::Train { config, set, output } => {
            let config: TrainConfig = read_toml(&config)?;
            let sets = set.iter().map(|set| Set::open(set)).collect::<Result<Vec<Set>, TrainError>>()?;
            let training = Training::new(config, &sets, &output)?;
            training.run(None, &|line| talk(&line))?;
            Ok(())
        }
        Command::Export { checkpoint, output, tile, like } => {
            let network = Checkpoint::read(&checkpoint, &Device::Cpu)?;
            match like {
                Some(like) => export::write_head(&network, &like, tile, &output),
                None => export::write(&network, tile, &output),
            }
        }
        Command::Measure { set, split, network, coco, tile, dip, pixel_m, looks, without, output } => {
            let split = Split::ALL
                .into_iter()
                .find(|s| s.name() == split)
                .ok_or_else(|| TrainError::config(format!("no split is called {split:?}"), "train, val or test"))?;
            let named = |text: &String| match text.split_once('=') {
                Some((name, path)) if !name.is_empty() => Ok((name.to_owned(), PathBuf::from(path))),
                _ => Err(TrainError::config(format!("{text:?} is no NAME=FILE"), "--network both=best.safetensors")),
            };
            let mut rows = vec![Row::Roofs, Row::Visible, Row::Perfect];
            let blind = without.iter().map(|name| {
                let input = [Input::Image, Input::Depth].into_iter().find(|i| i.name() == name);
                input.map(Some).ok_or_else(|| {
                    TrainError::config(format!("no network can be measured without {name:?}"), "image or depth")
                })
            });
            let seen: Vec<Option<Input>> = std::iter::once(Ok(None)).chain(blind).collect::<Result<_, TrainError>>()?;
            let dips: Vec<Option<f32>> = if dip.is_empty() { vec![None] } else { dip.into_iter().map(Some).collect() };
            for text in &network {
                let (name, path) = named(text)?;
                for (without, dip) in seen.iter().flat_map(|w| dips.iter().map(move |d| (*w, *d))) {
                    let of_input = without.map_or_else(String::new, |input| format!(", without {}", input.name()));
                    let of_dip = dip.map_or_else(String::new, |dip| format!(", dip {dip}"));
                    let name = format!("{name}{of_input}{of_dip}");
                    rows.push(Row::Network { name, path: path.clone(), tile, dip, pixel_m, looks, without });
                }
            }
            for text in &coco {
                let (name, path) = named(text)?;
                rows.push(Row::Coco { name, path });
            }
            let measured = measure::measure(&Set::open(&set)?, split, &rows, output.as_deref())?;
            if let Some(folder) = output {
                let path = folder.join("table.json");
                sizeup_geo::files::write_whole(&path, |w| Ok(serde_json::to_writer_pretty(w, &measured)?))?;
            }
            print(&measure::table(&measured))
        }
        Command::Schema { which } => {
            let schema = match which.as_str() {
                "dataset" => schemars::schema_for!(DatasetConfig),
                "train" => schemars::schema_for!(TrainConfig),
                _ => {
                    return Err(TrainError::config(
                        format!("no configuration is called {which:?}"),
                        "dataset or train",
                    ));
                }
            };
            print(&format_args!("{}\n", serde_json::to_string_pretty(&schema).expect("plain data")))
        }
    }
}

/// Prints whole lines of data to stdout. A reader that has seen enough is no failure.
fn print(text: &impl fmt::Display) -> Result<(), TrainError> {
    let mut out = std::io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => {
            Err(FileError::on("cannot print to", Path::new("stdout"))(source).into())
        }
        _ => Ok(()),
    }
}

/// Says something on stderr; nobody listening is no reason to stop.
fn talk(text: &impl fmt::Display) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}
