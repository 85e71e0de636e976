//! `sizeup view --photo`: one view of a finished run, step by step.

use std::path::{Path, PathBuf};

use clap::Args;

use super::flags::config_file;
use super::ui::warn_of_unfinished;
use super::{Failure, Global, Ui};
use crate::config::{RunConfig, SAVED_NAME};
use crate::pipeline::{self, RunSettings};

/// One photo in place of the whole.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "One photo in place of the city")]
pub struct PhotoArgs {
    /// Picture one view: photo, rendered depth, prior and ordinal pairs. Its name, or a part of it.
    #[arg(long, value_name = "NAME", requires = "output")]
    pub photo: Option<String>,
    /// Heights after this pass, counted from 1 (default: the last).
    #[arg(long, value_name = "N", requires = "photo")]
    pub pass: Option<usize>,
    /// Set one key of the configuration, as in the run. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE", requires = "photo")]
    pub assignments: Vec<String>,
    /// Picture to write (PNG).
    #[arg(long, short, value_name = "FILE", requires = "photo")]
    pub output: Option<PathBuf>,
}

/// Pictures a photo of a result: its folder, or the configuration that it ran with, by default the one in this folder.
pub(super) fn run(
    path: Option<&Path>,
    photo: &str,
    output: &Path,
    args: &PhotoArgs,
    global: &Global,
) -> Result<u8, Failure> {
    let folder = path.filter(|path| path.is_dir());
    let file = match folder {
        Some(folder) => folder.join(SAVED_NAME),
        None => config_file(path)?,
    };
    let mut config = RunConfig::load(&file, &args.assignments).map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    if let Some(folder) = folder {
        folder.clone_into(&mut config.project.output);
    }
    warn_of_unfinished(&config.project.output, global);
    pipeline::look(&RunSettings::of(&config), photo, args.pass, output).map_err(|e| Failure::new(e.exit_code(), &e))?;
    Ui::new(global).say(format!("photo, rendered depth, prior and ordinal pairs in {}", output.display()));
    Ok(0)
}
