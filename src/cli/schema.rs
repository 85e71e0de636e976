//! `sizeup schema`: what a configuration file, a city of ours, a list of changes, a report on aligned poses or a line of progress
//! can hold, from the code that reads and writes it.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::Value;

use super::{Failure, ProgressEvent, print_json};
use crate::config::RunConfig;
use sizeup_footprints::SegmenterProfile;
use sizeup_geo::files::write_json;
use sizeup_photos::align::AlignReport;
use sizeup_photos::prior::network::profile::Profile;
use sizeup_results::changes::ChangesReport;
use sizeup_results::output::cityjson::extension_schema;

/// Arguments of `sizeup schema`.
#[derive(Debug, Clone, Args)]
pub struct SchemaArgs {
    /// Schema to print.
    #[arg(value_enum, required_unless_present = "output")]
    pub name: Option<SchemaName>,
    /// Write all of them into a folder.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
}

/// Documents that have a schema.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum SchemaName {
    /// Configuration of `sizeup run`.
    Run,
    /// Profile of a depth network: the TOML file that `prior.profile` names.
    DepthNetwork,
    /// Profile of a network that finds buildings: the TOML file that `footprints.profile` names.
    FootprintNetwork,
    /// `changes.json`, which `sizeup changes` writes.
    Changes,
    /// `align.json`, which `sizeup survey align` and runs that align write.
    Align,
    /// A line that `--progress json` writes.
    Progress,
    /// Our extension of CityJSON: names and types of the attributes that a city of ours has.
    CityjsonExtension,
}

/// The schema of a configuration, or of our extension.
#[must_use]
pub fn schema(name: SchemaName) -> Value {
    // Serialising puts the keys in the order in which people read them; the bare value does not.
    let readable = |schema: schemars::Schema| serde_json::to_value(schema).unwrap_or_default();
    match name {
        SchemaName::Run => readable(schemars::schema_for!(RunConfig)),
        SchemaName::DepthNetwork => readable(schemars::schema_for!(Profile)),
        SchemaName::FootprintNetwork => readable(schemars::schema_for!(SegmenterProfile)),
        SchemaName::Changes => readable(schemars::schema_for!(ChangesReport)),
        SchemaName::Align => readable(schemars::schema_for!(AlignReport)),
        SchemaName::Progress => readable(schemars::schema_for!(ProgressEvent)),
        SchemaName::CityjsonExtension => extension_schema(),
    }
}

impl SchemaName {
    /// Name of the file; extensions of `CityJSON` have names of their own kind.
    fn file_name(self) -> &'static str {
        match self {
            Self::Run => "run.schema.json",
            Self::DepthNetwork => "depth-network.schema.json",
            Self::FootprintNetwork => "footprint-network.schema.json",
            Self::Changes => "changes.schema.json",
            Self::Align => "align.schema.json",
            Self::Progress => "progress.schema.json",
            Self::CityjsonExtension => "sizeup.ext.json",
        }
    }
}

pub(super) fn run(args: &SchemaArgs) -> Result<u8, Failure> {
    if let Some(name) = args.name {
        print_json(&schema(name))?;
    }
    if let Some(folder) = &args.output {
        for name in SchemaName::value_variants() {
            write_json(&folder.join(name.file_name()), &schema(*name)).map_err(|e| Failure::new(4, &e))?;
        }
    }
    Ok(0)
}
