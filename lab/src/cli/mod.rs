//! The command line of the laboratory: one file per subcommand. Output, options and exit codes are those of `sizeup`.

mod baseline;
mod benchmark;
mod schema;
mod simulate;

use clap::{Parser, Subcommand};

use sizeup::cli::{Global, conclude_unread, prepare, report};

/// Measure sizeup: simulate scenes with known truth, run simple methods, write tables of accuracy.
#[derive(Debug, Parser)]
#[command(name = "sizeup-lab", version, propagate_version = true, arg_required_else_help = true)]
pub struct Lab {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: Global,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simulate a scene with known truth, in the files that a user would bring.
    Simulate(simulate::SimulateArgs),
    /// Estimate heights in a quick and simple way, to compare with: from priors, a point cloud, or known heights.
    Baseline(baseline::BaselineArgs),
    /// Measure accuracy and speed on simulated scenes, every method on each, and write the tables.
    Benchmark(benchmark::BenchmarkArgs),
    /// Print the JSON Schema of a simulated scene's settings.
    Schema(schema::SchemaArgs),
}

/// Runs the command of this process; the number is the exit code.
#[must_use]
pub fn answer() -> u8 {
    let arguments: Vec<_> = std::env::args_os().collect();
    let lab = match Lab::try_parse_from(&arguments) {
        Ok(lab) => lab,
        Err(error) => return conclude_unread(&error, arguments.get(1..).unwrap_or_default()),
    };
    let outcome = prepare(&lab.global).and_then(|()| match &lab.command {
        Command::Simulate(args) => simulate::run(args, &lab.global),
        Command::Baseline(args) => baseline::run(args, &lab.global),
        Command::Benchmark(args) => benchmark::run(args, &lab.global),
        Command::Schema(args) => schema::run(args),
    });
    report(&outcome, &lab.global)
}
