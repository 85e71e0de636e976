//! `sizeup completions` and `sizeup man`: what a shell and `man` are to know of the program, from its own arguments.

use std::path::{Path, PathBuf};

use clap::{Args, CommandFactory as _};
use clap_complete::Shell;

use super::{Cli, Failure, print_lines};
use sizeup_geo::files::write_whole;

/// Arguments of `sizeup completions`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  source <(sizeup completions bash)                                          for this shell
  sizeup completions bash > ~/.local/share/bash-completion/completions/sizeup   for every new one
  sizeup completions zsh > ~/.zfunc/_sizeup                                  with ~/.zfunc in $fpath
  sizeup completions fish > ~/.config/fish/completions/sizeup.fish

Packages bring them already.")]
pub struct CompletionsArgs {
    /// Shell to write completions for.
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Arguments of `sizeup man`.
#[derive(Debug, Clone, Args)]
pub struct ManArgs {
    /// Folder for a page per command (`sizeup.1`, `sizeup-run.1`, …).
    #[arg(long, short, value_name = "FOLDER")]
    pub output: PathBuf,
}

pub(super) fn complete(args: &CompletionsArgs) -> Result<u8, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "sizeup", &mut script);
    print_lines(&String::from_utf8_lossy(&script))?;
    Ok(0)
}

pub(super) fn write_pages(args: &ManArgs) -> Result<u8, Failure> {
    std::fs::create_dir_all(&args.output)
        .map_err(|e| Failure::from_text(4, format!("cannot create {}: {e}", args.output.display())))?;
    let mut program = Cli::command().disable_help_subcommand(true);
    program.build();
    write_page(&program, &args.output)?;
    Ok(0)
}

/// The page of a command, and of those below it.
fn write_page(command: &clap::Command, folder: &Path) -> Result<(), Failure> {
    let page = clap_mangen::Man::new(command.clone());
    write_whole(&folder.join(page.get_filename()), |mut file| page.render(&mut file))
        .map_err(|e| Failure::new(4, &e))?;
    command.get_subcommands().filter(|below| below.get_name() != "man").try_for_each(|below| write_page(below, folder))
}
