//! How the program was called. A binary is told by its system; in a module of Python it is Python that was called, so the
//! module says it here.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::error::{ContextKind, ContextValue};
use clap::{CommandFactory as _, Parser as _};

use super::{Cli, conclude, conclude_unread};
use crate::config::nearest;

/// A call of the program.
#[derive(Debug, Clone)]
pub struct Call {
    /// Program to start once more, as runs in tiles do.
    pub program: PathBuf,
    /// The file with the compiled code: libraries that are brought later lie beside it.
    pub code: PathBuf,
    /// Words that were typed, the program's name first.
    pub arguments: Vec<OsString>,
}

/// Set once: a process is one call.
static CALL: OnceLock<Call> = OnceLock::new();

impl Call {
    /// The call of this process's own binary.
    fn of_process() -> Self {
        let arguments: Vec<OsString> = std::env::args_os().collect();
        let named = || arguments.first().cloned().unwrap_or_default().into();
        let program = std::env::current_exe().unwrap_or_else(|_| named());
        Self { code: program.clone(), program, arguments }
    }

    /// The call that is being answered.
    pub fn this() -> &'static Self {
        CALL.get_or_init(Self::of_process)
    }

    /// The command line, for the lineage of results.
    #[must_use]
    pub fn line(&self) -> String {
        // The folder of the program is private to its user.
        let program = self.arguments.first().and_then(|program| Path::new(program).file_name());
        let words = program.into_iter().chain(self.arguments.iter().skip(1).map(OsString::as_os_str));
        words.map(OsStr::to_string_lossy).collect::<Vec<_>>().join(" ")
    }
}

/// Commands of `sizeup-lab`, which a user may expect here.
const OF_LAB: [&str; 3] = ["baseline", "benchmark", "simulate"];

/// With the subcommand that a misspelt one was meant to be: clap sees no likeness between short words such as `rnu` and `run`.
fn with_near_command(mut error: clap::Error, arguments: &[OsString]) -> clap::Error {
    let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidSubcommand) else { return error };
    if OF_LAB.contains(&word.as_str()) {
        let hint = format!("simulation and benchmarks are in a program of their own: `sizeup-lab {word}`");
        error.remove(ContextKind::SuggestedSubcommand);
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![hint.into()]));
        return error;
    }
    if error.get(ContextKind::SuggestedSubcommand).is_some() {
        return error;
    }
    let mut command = &Cli::command();
    for argument in arguments {
        command = command.find_subcommand(argument).unwrap_or(command);
    }
    let names = command.get_subcommands().filter(|known| !known.is_hide_set()).map(clap::Command::get_name);
    if let Some(meant) = nearest(word, names) {
        let meant = ContextValue::Strings(vec![meant.to_owned()]);
        error.insert(ContextKind::SuggestedSubcommand, meant);
    }
    error
}

/// Answers the call of this process's own binary; the number is the exit code.
#[must_use]
pub fn answer() -> u8 {
    answer_call(Call::of_process())
}

/// Answers a call; the number is the exit code. Only the first call of a process counts for where its code lies.
#[must_use]
pub fn answer_call(call: Call) -> u8 {
    let arguments = call.arguments.clone();
    // A second one comes from a test that calls the library twice: the first stays.
    let _ = CALL.set(call);
    match Cli::try_parse_from(&arguments) {
        Ok(cli) => conclude(&cli),
        Err(error) => {
            let arguments = arguments.get(1..).unwrap_or_default();
            conclude_unread(&with_near_command(error, arguments), arguments)
        }
    }
}
