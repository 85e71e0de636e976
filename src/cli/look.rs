//! `sizeup look`: one view of a finished run, step by step.

use std::path::PathBuf;

use clap::Args;

use super::flags::config_file;
use super::ui::warn_of_unfinished;
use super::{Failure, Global, Ui};
use crate::config::RunConfig;
use crate::pipeline::{self, RunSettings};

/// Arguments of `sizeup look`.
#[derive(Debug, Clone, Args)]
#[command(
    allow_missing_positional = true,
    after_help = "Examples:
  sizeup look 012_oblique --output panel.png
  sizeup look sizeup.toml 012_oblique --pass 1 --output first.png
  sizeup look demo/scene/sizeup.toml 012_oblique --result demo/result --output panel.png"
)]
pub struct LookArgs {
    /// Configuration of the run (default: sizeup.toml in this folder), with the settings it ran with.
    pub config: Option<PathBuf>,
    /// Name of the view, or a part of it.
    pub view: String,
    /// Heights after this pass, counted from 1 (default: the last).
    #[arg(long, value_name = "N")]
    pub pass: Option<usize>,
    /// Folder of the run's results, in place of the configuration's.
    #[arg(long, value_name = "FOLDER")]
    pub result: Option<PathBuf>,
    /// Set one key of the configuration, as in the run. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// Picture to write (PNG).
    #[arg(long, short, value_name = "FILE")]
    pub output: PathBuf,
}

pub(super) fn run(args: &LookArgs, global: &Global) -> Result<u8, Failure> {
    let mut config =
        RunConfig::load(&config_file(args.config.as_deref())?, &args.assignments).map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    if let Some(result) = &args.result {
        config.project.output.clone_from(result);
    }
    warn_of_unfinished(&config.project.output, global);
    pipeline::look(&RunSettings::of(&config), &args.view, args.pass, &args.output)
        .map_err(|e| Failure::new(e.exit_code(), &e))?;
    Ui::new(global).say(format!("photo, rendered depth, prior and ordinal pairs in {}", args.output.display()));
    Ok(0)
}
