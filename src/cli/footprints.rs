//! `sizeup footprints`: building footprints from nadir photos, as a stage of its own.

use std::path::PathBuf;

use clap::Args;

use super::flags::config_file;
use super::run::tell_issues;
use super::{Call, EXIT_FAILED_ITEMS, Failure, Global, Ui, counted, print_json};
use crate::config::RunConfig;
use crate::pipeline::{self, RunOptions, Stage};
use sizeup_footprints::DetectionSummary;

/// Arguments of `sizeup footprints`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup footprints sizeup.toml
  sizeup footprints sizeup.toml --set 'footprints={source=\"masks\", path=\"masks/{stem}.png\", kind=\"instance\"}'
  sizeup run sizeup.toml --from heights       go on from the footprints to the heights

The result is footprints.gpkg with the layers footprints and candidates, and pictures of the nadir\nphotos with the footprints drawn over them (40 at most).")]
pub struct FootprintsArgs {
    /// Configuration file (TOML; default: sizeup.toml in this folder), as that of `sizeup run`; it needs no [prior] here.
    pub config: Option<PathBuf>,
    /// Set one key of the configuration, as in `--set footprints.consensus.snap_deg=0`. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// Folder of the results, in place of the configuration's.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
}

pub(super) fn run(args: &FootprintsArgs, global: &Global) -> Result<u8, Failure> {
    let mut config = RunConfig::load_without_prior(&config_file(args.config.as_deref())?, &args.assignments)
        .map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    if let Some(output) = &args.output {
        config.project.output.clone_from(output);
    }
    let options = RunOptions { from: Stage::Survey, until: Stage::Footprints, command: Call::this().line() };
    let ui = Ui::new(global);
    let summary =
        pipeline::run(&config, &options, &|event| ui.tell(event)).map_err(|e| Failure::new(e.exit_code(), &e))?;
    ui.finish();
    ui.say(format!("{} in {}", counted(summary.n_buildings, "building"), summary.output.display()));
    if let Some(found) = &summary.detection {
        tell_detection(&ui, found);
    }
    tell_issues(&ui, &summary);
    if global.json {
        print_json(&summary)?;
    }
    Ok(if summary.n_refused > 0 { EXIT_FAILED_ITEMS } else { 0 })
}

/// Findings of the nadir photos.
pub(super) fn tell_detection(ui: &Ui, found: &DetectionSummary) {
    if !found.footprints_from.is_empty() {
        ui.say(format!("footprints by {}", found.footprints_from));
    }
    ui.say(format!(
        "from {} contours in {} of {} nadir photos; left out: {} shown by too few photos, {} contradicted, {} too small",
        found.n_candidates,
        found.n_views - found.n_views_without,
        found.n_views,
        found.n_unsupported,
        found.n_contradicted,
        found.n_small
    ));
    for (change, n) in &found.by_change {
        ui.say(format!("{n:>8} {}", change.as_str().replace('_', " ")));
    }
}
