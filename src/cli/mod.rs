//! The command line: one file per subcommand, each one library call and what to say about it.
//!
//! stdout is data (tables, JSON), stderr is talk. Exit codes: 0 ok, 2 usage or configuration, 3 bad input, 4 failed,
//! 5 finished with failed items.

mod call;
mod changes;
mod check;
mod demo;
mod dtm;
mod evaluate;
mod export;
mod flags;
mod footprints;
mod init;
mod look;
mod manual;
mod model;
mod overall;
mod prior;
mod progress;
mod run;
mod schema;
mod survey;
mod texture;
mod tiles;
mod ui;
mod view;

use std::ffi::OsString;
use std::fmt;
use std::io::{self, ErrorKind, Write as _};

use clap::{Args, Parser, Subcommand};

pub use call::{Call, answer, answer_call};
pub use demo::simulate_scene;
pub use flags::config_file;
pub use progress::{MessageLevel, ProgressEvent, ProgressForm};
pub use run::tell_summary;
pub use ui::Ui;

use sizeup_geo::limits::Limits;

/// Finished, but some items of the input have no result.
pub const EXIT_FAILED_ITEMS: u8 = 5;

/// Find the heights of buildings in oblique aerial photos.
///
/// sizeup reads photos' poses, building footprints and depth priors, finds one height per building, and writes a
/// georeferenced LOD1 city as CityJSON and GeoPackage. Start with `sizeup demo`, or with `sizeup init` and your photos.
#[derive(Debug, Parser)]
#[command(name = "sizeup", version, propagate_version = true, arg_required_else_help = true)]
pub struct Cli {
    /// Subcommand that is run.
    #[command(subcommand)]
    pub command: Command,
    /// Options of every subcommand.
    #[command(flatten)]
    pub global: Global,
}

/// Where `--help` lists the options of every subcommand.
const GLOBAL: &str = "Everywhere";

/// Options of every subcommand.
#[derive(Debug, Clone, Args)]
pub struct Global {
    /// Say nothing but errors.
    #[arg(long, short, global = true, help_heading = GLOBAL)]
    pub quiet: bool,
    /// Print a machine-readable summary to stdout.
    #[arg(long, global = true, help_heading = GLOBAL)]
    pub json: bool,
    /// How progress is told on stderr: bars and lines to read, or one JSON object a line for programs.
    #[arg(long, global = true, value_enum, value_name = "FORM", default_value = "text", help_heading = GLOBAL)]
    pub progress: ProgressForm,
    /// Threads to use (default: all cores, which is also the most). The result does not depend on it.
    #[arg(long, global = true, value_name = "N", help_heading = GLOBAL)]
    pub threads: Option<usize>,
    /// Most memory that reading one file may take, megabytes (default: the configuration's `limits.input_mb`, 4096).
    #[arg(long, global = true, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..), help_heading = GLOBAL)]
    pub input_memory: Option<u64>,
    /// Let input be on servers (`/vsicurl/…`, `/vsis3/…`), and files refer to such.
    #[arg(long, global = true, help_heading = GLOBAL)]
    pub allow_remote: bool,
}

/// Subcommands of `sizeup`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Begin a project from a folder of photos: look what is there, write sizeup.toml, say what is missing.
    Init(init::InitArgs),
    /// Find the heights of buildings: poses, footprints and priors in, a LOD1 city out.
    Run(run::RunArgs),
    /// Run a city in tiles: plan, run each, merge.
    #[command(subcommand)]
    Tiles(tiles::TilesCommand),
    /// Find building footprints in the nadir photos' masks: one clean layer, once per building.
    Footprints(footprints::FootprintsArgs),
    /// Check, align and convert poses before anything is computed from them; make a terrain model from the photos.
    #[command(subcommand)]
    Survey(survey::SurveyCommand),
    /// Depth networks: list them, put one in place, inspect a graph; compute depth priors ahead of a run.
    #[command(subcommand)]
    Model(model::ModelCommand),
    /// Check this machine, a configuration, or the solids of a CityJSON file, anybody's.
    Check(check::CheckArgs),
    /// Write a city in another format: CityJSON, CityJSONSeq, GeoPackage, FlatGeobuf, FlatCityBuf, GeoJSON, 3D Tiles.
    Export(export::ExportArgs),
    /// Compare a result with a reference and print how far off it is.
    Evaluate(evaluate::EvaluateArgs),
    /// Tell what changed between two results: new, gone, raised, lowered, footprint changed, same.
    Changes(changes::ChangesArgs),
    /// Paint a finished result with its photos: CityJSON with textures, and one glTF file that opens anywhere.
    Texture(texture::TextureArgs),
    /// Show a result in the browser, streaming its tiles: for cities too large for one page. Or picture one of its photos.
    View(view::ViewArgs),
    /// Simulate a small town, find its heights, evaluate and picture them.
    Demo(demo::DemoArgs),
    /// Print the JSON Schema of a configuration file.
    #[command(hide = true)]
    Schema(schema::SchemaArgs),
    /// Print what a shell needs to complete sizeup's commands and options.
    #[command(hide = true)]
    Completions(manual::CompletionsArgs),
    /// Write manual pages, for packages.
    #[command(hide = true)]
    Man(manual::ManArgs),
}

/// Something cannot be written, or failed.
const EXIT_FAILED: u8 = 4;

/// Advice where a disk is full.
const FULL: &str = "the disk is full: free some space, or write to another disk (most commands take `--output`)";

/// Advice where the system lets nothing be written.
fn hint_on_writing(error: &io::Error) -> Option<&'static str> {
    match error.kind() {
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => Some(
            "you may not write there: name another folder (most commands take `--output`), or change its permissions",
        ),
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Some(FULL),
        _ => None,
    }
}

/// Mark before the advice in the text of an error.
const HINT: &str = "\nhint: ";

/// Error that ended a command, ready to print.
#[derive(Debug)]
pub struct Failure {
    /// The process's exit code.
    pub exit_code: u8,
    message: String,
}

impl Failure {
    /// From an error and the exit code it stands for; causes that the text leaves out follow it.
    pub fn new(exit_code: u8, error: &dyn std::error::Error) -> Self {
        let mut message = format!("error: {error}");
        let mut cause = error.source();
        let mut hint = None;
        while let Some(source) = cause {
            hint = hint.or_else(|| source.downcast_ref::<io::Error>().and_then(hint_on_writing));
            let text = source.to_string();
            if !message.contains(&text) {
                message.push_str("\n  because: ");
                message.push_str(&text);
            }
            cause = source.source();
        }
        // Engines that write files themselves have words of their own.
        let is_full = message.contains("disk is full").then_some(FULL);
        if let Some(hint) = hint.or(is_full).filter(|_| exit_code == EXIT_FAILED && !message.contains(HINT)) {
            message.push_str(HINT);
            message.push_str(hint);
        }
        Self { exit_code, message }
    }

    /// A failure in words, with the exit code that goes with it.
    #[must_use]
    pub fn from_text(exit_code: u8, text: impl fmt::Display) -> Self {
        Self { exit_code, message: format!("error: {text}") }
    }

    /// Message of the error, with advice where there is any.
    #[must_use]
    pub fn message_and_hint(&self) -> (String, Option<String>) {
        let text = self.message.trim_start_matches("error: ").trim();
        match text.split_once(HINT) {
            Some((message, hint)) => (message.to_owned(), Some(hint.to_owned())),
            None => (text.to_owned(), None),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

/// Applies the options of every subcommand to this process: logging, limits, threads, and where networks are.
///
/// # Errors
/// [`Failure`] where threads cannot be started.
pub fn prepare(global: &Global) -> Result<(), Failure> {
    ui::start_logging(global);
    sizeup_photos::onnx::runtime::look_in(runtime_places());
    Limits::insist(global.input_memory, global.allow_remote);
    if let Some(folder) = model::folder() {
        sizeup_photos::prior::network::known::look_in(folder);
    }
    if let Some(n) = global.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads(n, global)).build_global();
        pool.map_err(|e| Failure::new(4, &e))?;
    }
    Ok(())
}

/// Runs a command; the number is the exit code.
///
/// # Errors
/// [`Failure`] with the exit code and the text to print.
fn dispatch(cli: &Cli) -> Result<u8, Failure> {
    prepare(&cli.global)?;
    match &cli.command {
        Command::Init(args) => init::run(args, &cli.global),
        Command::Run(args) => run::run(args, &cli.global),
        Command::Tiles(command) => tiles::run(command, &cli.global),
        Command::Footprints(args) => footprints::run(args, &cli.global),
        Command::Survey(command) => survey::run(command, &cli.global),
        Command::Model(command) => model::run(command, &cli.global),
        Command::Check(args) => check::run(args, &cli.global),
        Command::Export(args) => export::run(args, &cli.global),
        Command::Evaluate(args) => evaluate::run(args, &cli.global),
        Command::Changes(args) => changes::run(args, &cli.global),
        Command::Texture(args) => texture::run(args, &cli.global),
        Command::View(args) => view::run(args, &cli.global),
        Command::Demo(args) => demo::run(args, &cli.global),
        Command::Schema(args) => schema::run(args),
        Command::Completions(args) => manual::complete(args),
        Command::Man(args) => manual::write_pages(args),
    }
}

/// Runs a command and reports how it ended; the number is the exit code.
#[must_use]
pub fn conclude(cli: &Cli) -> u8 {
    report(&dispatch(cli), &cli.global)
}

/// Reports how a command ended; the number is the exit code.
#[must_use]
pub fn report(outcome: &Result<u8, Failure>, global: &Global) -> u8 {
    match (outcome, global.progress) {
        (&Ok(code), ProgressForm::Json) => ProgressEvent::Done { code }.emit(),
        (Err(failure), ProgressForm::Json) => ProgressEvent::of_failure(failure).emit(),
        (Ok(_), ProgressForm::Text) => {}
        (Err(failure), ProgressForm::Text) => talk(failure),
    }
    outcome.as_ref().map_or_else(|failure| failure.exit_code, |code| *code)
}

/// Says what is wrong with a command line that cannot be read, or prints the help it asks for; the number is the exit code.
#[must_use]
pub fn conclude_unread(error: &clap::Error, arguments: &[OsString]) -> u8 {
    let is_json = arguments.windows(2).any(|pair| pair == ["--progress", "json"])
        || arguments.iter().any(|argument| argument == "--progress=json");
    if is_json && error.use_stderr() {
        ProgressEvent::of_failure(&Failure::from_text(2, error.render())).emit();
    } else {
        // Nobody listening is no reason to stop.
        let _ = error.print();
    }
    u8::try_from(error.exit_code()).unwrap_or(2)
}

/// As many threads as are asked for, but not more than the machine runs at once: more are slower, and memory goes with them.
fn threads(wanted: usize, global: &Global) -> usize {
    let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get).max(FEW_THREADS);
    if wanted > most {
        Ui::new(global).say(format!("--threads {wanted}: {most} are used, more do not help on this machine"));
    }
    wanted.min(most)
}

/// So many threads are never too many.
const FEW_THREADS: usize = 8;

/// Where ONNX Runtime's library may be: where the environment says, beside the program, or where `make
/// deps-onnxruntime` puts it.
fn runtime_places() -> Vec<std::path::PathBuf> {
    let file = format!("{}onnxruntime{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let named = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()).map(Into::into);
    let folder = Call::this().code.parent();
    let beside = folder.map(|folder| folder.join(&file));
    let of_make = folder.map(|folder| folder.join("../onnxruntime").join(&file));
    named.into_iter().chain(beside).chain(of_make).collect()
}

/// Prints a value as JSON to stdout.
///
/// # Errors
/// [`Failure`] where stdout cannot be written.
pub fn print_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Failure::new(4, &e))?;
    print(&text)
}

/// Prints a line of data to stdout.
///
/// # Errors
/// [`Failure`] where stdout cannot be written.
pub fn print(text: &impl fmt::Display) -> Result<(), Failure> {
    print_lines(&format_args!("{text}\n"))
}

/// Prints whole lines of data to stdout: the only place that writes there. A reader that has seen enough, as in
/// `sizeup evaluate … | head -1`, is no failure.
fn print_lines(text: &impl fmt::Display) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Failure::from_text(4, format!("cannot print: {e}"))),
        _ => Ok(()),
    }
}

/// A number and what there is of it: "1 building", "2 buildings".
fn counted(n: usize, what: &str) -> String {
    counted_as(n, what, &format!("{what}s"))
}

/// The same where several are called otherwise: "1 try", "2 tries".
fn counted_as(n: usize, one: &str, several: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { several })
}

/// Says something on stderr; nobody listening is no reason to stop.
pub fn talk(text: &impl fmt::Display) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}
