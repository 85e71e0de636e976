//! `sizeup changes`: what changed between two results.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::ui::warn_of_unfinished;
use super::{Call, Failure, Global, Ui, print_json, print_lines};
use sizeup_geo::files::{FileError, read_bytes, write_whole};
use sizeup_geo::unfinished::Unfinished;
use sizeup_results::changes::{
    AreaRule, ChangesConfig, ChangesError, ChangesReport, LevelRule, ResultPair, ShiftRule, SigmaRule, changes_map,
    changes_page, compare, write_layer,
};
use sizeup_results::output::picture::write_png;
use sizeup_results::output::{Lineage, OutputError};

/// Arguments of `sizeup changes`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup changes result-2024 result-2025 --output changes
  sizeup changes old.gpkg new.city.json --output changes --least-m 3 --json
  sizeup changes lod1.city.json result --output changes --old-sigma 0.5     heights of others state no sigma

changes.html is a page to read, changes.png its map; changes.gpkg has a row per building, styled by class for QGIS;
changes.json the same with the summary.
Buildings are matched by place; ids of the new result are kept, and those of the old one stand beside them.")]
pub struct ChangesArgs {
    /// Earlier result: the folder of a run or of a merged city, or its CityJSON or GeoPackage.
    pub old: PathBuf,
    /// Later result: likewise a folder, a CityJSON or a GeoPackage.
    pub new: PathBuf,
    /// Folder to write changes.html, changes.gpkg, changes.json and changes.png into.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: PathBuf,
    /// Least difference worth telling, up, down or sideways, metres.
    #[arg(long, value_name = "METRES", default_value_t = ChangesConfig::default().least_m)]
    pub least_m: f64,
    /// Standard deviations that a difference must reach to be a change.
    #[arg(long, value_name = "N", default_value_t = ChangesConfig::default().n_sigmas)]
    pub sigmas: f64,
    /// Standard deviation of old heights that state none, metres (default: they are not compared).
    #[arg(long, value_name = "METRES")]
    pub old_sigma: Option<f64>,
    /// Standard deviation of new heights that state none, metres (default: they are not compared).
    #[arg(long, value_name = "METRES")]
    pub new_sigma: Option<f64>,
    /// Standard deviation of the corners of footprints that state none, metres.
    #[arg(long, value_name = "METRES", default_value_t = ChangesConfig::default().footprint_sigma_m)]
    pub footprint_sigma: f64,
    /// How far beyond its footprints a result is taken to have looked, metres.
    #[arg(long, value_name = "METRES", default_value_t = ChangesConfig::default().margin_m)]
    pub margin: f64,
    /// Further word on where a result looked: a building beyond is neither new nor gone.
    #[arg(long, value_enum, value_name = "WHICH", default_value = "photos")]
    pub area: AreaArg,
    /// Leave a shift that is common to all buildings in the differences; it is reported all the same.
    #[arg(long)]
    pub keep_shift: bool,
    /// Take sigmas as stated, also where differences scatter more than these say.
    #[arg(long)]
    pub stated_sigmas: bool,
    /// Compare heights above ground only, not levels of roofs: for results that count from different zeros.
    #[arg(long)]
    pub heights_only: bool,
}

/// Where a result looked, on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum AreaArg {
    /// Within the hull of its photos' projection centres too, where its GeoPackage has them.
    Photos,
    /// Around its footprints only: for layers that cover less than the flight.
    Footprints,
}

impl ChangesArgs {
    fn config(&self) -> ChangesConfig {
        ChangesConfig {
            least_m: self.least_m,
            n_sigmas: self.sigmas,
            old_sigma_m: self.old_sigma,
            new_sigma_m: self.new_sigma,
            footprint_sigma_m: self.footprint_sigma,
            margin_m: self.margin,
            area: match self.area {
                AreaArg::Photos => AreaRule::Photos,
                AreaArg::Footprints => AreaRule::Footprints,
            },
            shift: if self.keep_shift { ShiftRule::Keep } else { ShiftRule::TakeOff },
            sigmas: if self.stated_sigmas { SigmaRule::Stated } else { SigmaRule::Widen },
            levels: if self.heights_only { LevelRule::HeightsOnly } else { LevelRule::Compare },
        }
    }
}

pub(super) fn run(args: &ChangesArgs, global: &Global) -> Result<u8, Failure> {
    let config = args.config();
    config.validate().map_err(|e| Failure::new(2, &e))?;
    warn_of_unfinished(&args.old, global);
    warn_of_unfinished(&args.new, global);
    let pair = ResultPair::read(&args.old, &args.new, config.levels).map_err(|e| Failure::new(exit_code(&e), &e))?;
    // Levels are compared where both results say what they count from.
    let levels = if pair.level_reference.is_some() { LevelRule::Compare } else { LevelRule::HeightsOnly };
    let config = ChangesConfig { levels, ..config };
    let comparison = compare(&pair.old.compared(), &pair.new.compared(), &config);
    let command = Call::this().line();
    let report = ChangesReport::new(&pair, comparison, &config, env!("CARGO_PKG_VERSION"), &command);
    write(args, &pair, &report).map_err(|e| Failure::new(4, &e))?;
    Ui::new(global)
        .say(format!("changes.html, changes.gpkg, changes.json and changes.png in {}", args.output.display()));
    if global.json {
        print_json(&report.summary())?;
    } else {
        print_lines(&report)?;
    }
    Ok(0)
}

fn exit_code(error: &ChangesError) -> u8 {
    match error {
        ChangesError::Setting(_) | ChangesError::SameFile { .. } => 2,
        _ => 3,
    }
}

fn write(args: &ChangesArgs, pair: &ResultPair, report: &ChangesReport) -> Result<(), OutputError> {
    let folder = &args.output;
    std::fs::create_dir_all(folder).map_err(FileError::on("cannot create", folder))?;
    let crs = &pair.new.crs;
    let mark = Unfinished::begin(folder, &report.command)?;
    write_layer(&folder.join("changes.gpkg"), &report.changes, crs, &lineage(pair, report))?;
    let map = folder.join("changes.png");
    write_png(&map, &changes_map(report, crs))?;
    let page = changes_page(report, &read_bytes(&map)?);
    write_whole(&folder.join("changes.html"), |out| out.write_all(page.as_bytes()))?;
    report.write(&folder.join("changes.json"))?;
    Ok(mark.finish()?)
}

/// Where the layer comes from: both results with their hashes, and the origin of the new one.
fn lineage(pair: &ResultPair, report: &ChangesReport) -> Lineage {
    let source = pair.new.lineage.clone();
    Lineage {
        version: report.version.clone(),
        commit: crate::recipe::commit().map(str::to_owned),
        command: report.command.clone(),
        inputs: vec![pair.old.file.clone(), pair.new.file.clone()],
        crs: pair.new.crs.definition().to_owned(),
        vertical_reference: report.level_reference.clone().unwrap_or_else(|| "not stated".to_owned()),
        height_definition: "new minus old".to_owned(),
        reference_date: source.as_ref().and_then(|lineage| lineage.reference_date.clone()),
        source: source.map(Box::new),
        ..Lineage::default()
    }
}
