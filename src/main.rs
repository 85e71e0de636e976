//! The `sizeup` command: arguments in, exit code out.

use std::process::ExitCode;

use clap::Parser as _;
use sizeup::cli::{Cli, conclude, conclude_unread};

fn main() -> ExitCode {
    ExitCode::from(match Cli::try_parse() {
        Ok(cli) => conclude(&cli),
        Err(error) => conclude_unread(&error, &std::env::args_os().skip(1).collect::<Vec<_>>()),
    })
}
