//! The `sizeup` command: arguments in, exit code out.

use std::process::ExitCode;

use clap::Parser as _;
use sizeup::cli::{Cli, dispatch, talk};

fn main() -> ExitCode {
    let cli = Cli::parse();
    match dispatch(&cli) {
        Ok(code) => ExitCode::from(code),
        Err(failure) => {
            talk(&failure);
            ExitCode::from(failure.exit_code)
        }
    }
}
