//! `sizeup schema`: what a configuration file can hold, from the code that reads it.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use schemars::Schema;

use super::{Failure, print_json};
use crate::config::RunConfig;
use crate::files::write_whole;
use crate::simulate::SimulateConfig;

/// Arguments of `sizeup schema`.
#[derive(Debug, Clone, Args)]
pub struct SchemaArgs {
    /// Which configuration.
    #[arg(value_enum, required_unless_present = "output")]
    pub name: Option<SchemaName>,
    /// Write all of them into a folder, as `NAME.schema.json`.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
}

/// The configurations.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum SchemaName {
    /// Of `sizeup run`.
    Run,
    /// Of `sizeup simulate`.
    Simulate,
}

/// The schema of a configuration.
#[must_use]
pub fn schema(name: SchemaName) -> Schema {
    match name {
        SchemaName::Run => schemars::schema_for!(RunConfig),
        SchemaName::Simulate => schemars::schema_for!(SimulateConfig),
    }
}

pub(super) fn run(args: &SchemaArgs) -> Result<u8, Failure> {
    if let Some(name) = args.name {
        print_json(&schema(name))?;
    }
    if let Some(folder) = &args.output {
        for name in SchemaName::value_variants() {
            let file_name = name.to_possible_value().map(|v| format!("{}.schema.json", v.get_name()));
            write_whole(&folder.join(file_name.unwrap_or_default()), |out| {
                serde_json::to_writer_pretty(&mut *out, &schema(*name))?;
                out.write_all(b"\n")
            })
            .map_err(|e| Failure::new(4, &e))?;
        }
    }
    Ok(0)
}
