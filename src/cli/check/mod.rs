//! `sizeup check`: the machine, a configuration, or a city.

mod city;
#[cfg(feature = "cjval")]
mod form;
#[cfg(not(feature = "cjval"))]
#[path = "no_form.rs"]
mod form;
mod setup;

use std::path::{Path, PathBuf};

use clap::Args;

use super::{Failure, Global};
use city::CityArgs;

/// Arguments of `sizeup check`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup check                                  what this machine has
  sizeup check sizeup.toml                      also what this run needs
  sizeup check result                           the city of a result
  sizeup check rotterdam.city.json --all        anybody's CityJSON: codes as val3dity's, and the place of each fault
  sizeup check city.city.jsonl --json

Exit code 0: nothing is missing, no fault. 3: something that is needed is missing, or the city has faults or cannot be read.")]
pub struct CheckArgs {
    /// Configuration of a run (.toml; default: sizeup.toml in this folder, where there is one); or CityJSON 1.0, 1.1, 2.0,
    /// CityJSONSeq (.jsonl), or the folder of a result.
    pub path: Option<PathBuf>,
    /// Set one key of the configuration. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// How a city is checked.
    #[command(flatten)]
    pub city: CityArgs,
}

pub(super) fn run(args: &CheckArgs, global: &Global) -> Result<u8, Failure> {
    let is_config = |path: &&Path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    match args.path.as_deref() {
        Some(path) if !is_config(&path) => city::run(path, &args.city, global),
        config => setup::run(config, &args.assignments, global),
    }
}
