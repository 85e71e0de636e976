//! The `sizeup-lab` command: arguments in, exit code out.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(sizeup_lab::cli::answer())
}
