//! `sizeup-lab schema`: settings of a simulated scene, for editors.

use std::path::PathBuf;

use clap::Args;

use sizeup::cli::{Failure, print_json};
use sizeup_geo::files::write_json;
use sizeup_truth::simulate::SimulateConfig;

/// Arguments of `sizeup-lab schema`.
#[derive(Debug, Clone, Args)]
pub(super) struct SchemaArgs {
    /// Write `simulate.schema.json` into a folder instead.
    #[arg(long, short, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

pub(super) fn run(args: &SchemaArgs) -> Result<u8, Failure> {
    // Serialising puts the keys in the order in which people read them; the bare value does not.
    let schema = serde_json::to_value(schemars::schema_for!(SimulateConfig)).map_err(|e| Failure::new(4, &e))?;
    match &args.output {
        Some(folder) => {
            write_json(&folder.join("simulate.schema.json"), &schema).map_err(|e| Failure::new(4, &e))?;
        }
        None => print_json(&schema)?,
    }
    Ok(0)
}
