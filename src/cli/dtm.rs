//! `sizeup survey dtm`: a terrain model from the photos, for a run that has none.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::flags::config_file;
use super::ui::GROUND;
use super::{Failure, Global, Ui, print_json};
use crate::config::RunConfig;
use crate::pipeline::{self, RunSettings};
use sizeup_photos::dtm::{Dtm, DtmConfig, SquareOutcome};
use sizeup_results::output::picture::{relief_map, write_png};

/// A standard deviation above this says that one level may serve as well, metres.
const COARSE_M: f64 = 0.3;

/// Arguments of `sizeup survey dtm`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup survey dtm sizeup.toml --output dtm.tif
  sizeup survey dtm sizeup.toml --output dtm.tif --within 40      for hilly ground
  sizeup run sizeup.toml --set 'terrain={dtm=\"dtm.tif\"}'

The configuration's [terrain] is what it starts from: constant_m, a rough level, or dtm, a coarse or shifted model that the
photos correct. A picture is written beside the model. With [dtm] in the configuration `sizeup run` does all this itself.")]
pub struct DtmArgs {
    /// Configuration file (TOML; default: sizeup.toml in this folder), as that of `sizeup run`; it needs no [prior] here.
    pub config: Option<PathBuf>,
    /// The terrain model to write (GeoTIFF), in the project's CRS and the poses' vertical reference.
    #[arg(long, short, value_name = "FILE")]
    pub output: PathBuf,
    /// The ground is within this of the rough level, metres.
    #[arg(long, value_name = "METRES", default_value_t = DtmConfig::default().within_m)]
    pub within: f64,
    /// From one square of ground that is looked at to the next, metres.
    #[arg(long, value_name = "METRES", default_value_t = DtmConfig::default().spacing_m)]
    pub spacing: f64,
    /// Cells of the model, metres.
    #[arg(long, value_name = "METRES", default_value_t = DtmConfig::default().cell_m)]
    pub cell: f64,
    /// How far beyond the footprints the model reaches, metres.
    #[arg(long, value_name = "METRES", default_value_t = DtmConfig::default().margin_m)]
    pub margin: f64,
    /// Set one key of the configuration. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
}

/// Numbers of squares and errors of a terrain model, for `--json`.
#[derive(Debug, Serialize)]
struct DtmSummary {
    n_squares: usize,
    n_ground: usize,
    n_outliers: usize,
    n_unclear: usize,
    n_unseen: usize,
    sigma_m: f64,
    low_m: f64,
    high_m: f64,
}

pub(super) fn run(args: &DtmArgs, global: &Global) -> Result<u8, Failure> {
    let config = RunConfig::load_without_prior(&config_file(args.config.as_deref())?, &args.assignments)
        .map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    let settings =
        DtmConfig { within_m: args.within, spacing_m: args.spacing, cell_m: args.cell, margin_m: args.margin };
    let (ui, run) = (Ui::new(global), RunSettings::of(&config));
    let (dtm, footprints) =
        pipeline::dtm_of_photos(&run.survey, &run.dtm, &settings, &|done, total| ui.advance_named(GROUND, done, total))
            .map_err(|e| Failure::new(e.exit_code(), &e))?;
    ui.finish();
    let crs = &config.project.crs;
    pipeline::write_dtm(&dtm, crs, &args.output).map_err(|e| Failure::new(e.exit_code(), &e))?;
    let picture = args.output.with_extension("png");
    let polygons: Vec<_> = footprints.iter().collect();
    write_png(&picture, &relief_map(&dtm, &polygons, crs)).map_err(|e| Failure::new(4, &e))?;
    let found = summary(&dtm);
    ui.say(format!(
        "ground in {} of {} squares of open ground ({} stand out, {} unclear, {} seen by fewer than three photos)",
        found.n_ground, found.n_squares, found.n_outliers, found.n_unclear, found.n_unseen
    ));
    ui.say(format!("{:.1} to {:.1} m, a square within {:.2} m (1 sigma)", found.low_m, found.high_m, found.sigma_m));
    if found.sigma_m > COARSE_M {
        ui.say(
            "that is coarse: photos from more sides or of higher resolution would help; a surveyed model may be better",
        );
    }
    ui.say(format!("{} and {}", args.output.display(), picture.display()));
    ui.say(format!("next: sizeup run ... --set 'terrain={{dtm=\"{}\"}}'", args.output.display()));
    if global.json {
        print_json(&found)?;
    }
    Ok(0)
}

fn summary(dtm: &Dtm) -> DtmSummary {
    let n = |is: fn(&SquareOutcome) -> bool| dtm.squares.iter().filter(|s| is(&s.outcome)).count();
    let (low_m, high_m) = dtm.dem.range();
    DtmSummary {
        n_squares: dtm.squares.len(),
        n_ground: n(|o| matches!(o, SquareOutcome::Ground(_))),
        n_outliers: n(|o| matches!(o, SquareOutcome::Outlier(_))),
        n_unclear: n(|o| matches!(o, SquareOutcome::Unclear)),
        n_unseen: n(|o| matches!(o, SquareOutcome::Unseen)),
        sigma_m: dtm.sigma_m,
        low_m,
        high_m,
    }
}
