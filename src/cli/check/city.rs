//! `sizeup check` of a city: form and solids of a `CityJSON` file.

use std::path::Path;

use clap::Args;
use serde::Serialize;

use super::super::ui::warn_of_unfinished;
use super::super::{Failure, Global, print, print_json};
use super::form::Form;
use sizeup_geo::unfinished::told_of;
use sizeup_results::output::read::{CITYJSON_RESULTS, result_file};
use sizeup_results::output::validate::{Fault, ValidateConfig, Validation, validate_file};

/// Faults that are printed one by one unless all are asked for.
const N_PRINTED: usize = 20;
/// The file holds faults.
const EXIT_INVALID: u8 = 3;

/// How a city is checked.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "For a city")]
pub struct CityArgs {
    /// Check the solids only, not the form: schema, references, indices, semantics (by cjval).
    #[arg(long)]
    pub no_schema: bool,
    /// Print every fault, not only the first twenty; go on with the form of a sequence after 200 of its faults.
    #[arg(long)]
    pub all: bool,
    /// Vertices closer than this are one, metres.
    #[arg(long, value_name = "METRES", default_value_t = ValidateConfig::default().snap_tolerance_m)]
    pub snap_tolerance: f64,
    /// Largest distance of a vertex from its face's plane, metres.
    #[arg(long, value_name = "METRES", default_value_t = ValidateConfig::default().planarity_distance_m)]
    pub planarity_distance: f64,
}

/// Checks a city: a file, or the folder of a result.
pub(super) fn run(path: &Path, args: &CityArgs, global: &Global) -> Result<u8, Failure> {
    if !(args.snap_tolerance > 0.0 && args.planarity_distance > 0.0) {
        return Err(Failure::from_text(2, "tolerances are lengths in metres, above 0"));
    }
    let file = result_file(path, CITYJSON_RESULTS).map_err(|e| Failure::new(3, &e))?;
    warn_of_unfinished(&file, global);
    let form = if args.no_schema { None } else { Some(Form::check(&file, args.all)?) };
    let n_printed = if args.all { usize::MAX } else { N_PRINTED };
    if let Some(form) = form.as_ref().filter(|_| !global.json) {
        print(&form.lines(n_printed))?;
    }
    let config = ValidateConfig {
        snap_tolerance_m: args.snap_tolerance,
        planarity_distance_m: args.planarity_distance,
        ..ValidateConfig::default()
    };
    let solids = validate_file(&file, &config).map_err(|e| Failure::new(3, &e))?;
    let is_valid = solids.is_valid() && form.as_ref().is_none_or(Form::is_sound);
    if global.json {
        print_json(&ValidationOutcome { solids, form, unfinished: told_of(&file) })?;
    } else {
        print(&solid_lines(&solids, n_printed))?;
    }
    Ok(if is_valid { 0 } else { EXIT_INVALID })
}

/// Both checks as JSON.
#[derive(Serialize)]
struct ValidationOutcome {
    #[serde(flatten)]
    solids: Validation,
    #[serde(skip_serializing_if = "Option::is_none")]
    form: Option<Form>,
    /// The first line of the mark of a writer that has not come to its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    unfinished: Option<String>,
}

/// Findings on the solids, as lines.
fn solid_lines(outcome: &Validation, n_printed: usize) -> String {
    let Validation { n_valid, n_geometries, n_without_geometry, n_templates, .. } = outcome;
    let mut lines =
        vec![format!("{n_valid} of {n_geometries} geometries are valid; {n_without_geometry} objects have none")];
    if *n_templates > 0 {
        lines.push(format!("{n_templates} template instances were not checked"));
    }
    for (number, n) in &outcome.n_by_code {
        let name = outcome.faults.iter().find(|fault| fault.number == *number).map(|fault| fault.code.to_string());
        lines.push(format!("{n:>8}  {}", name.unwrap_or_default()));
    }
    lines.extend(outcome.faults.iter().take(n_printed).map(line));
    lines.extend(more(outcome.faults.len(), n_printed));
    lines.join("\n")
}

/// How many faults are not printed, where some are not.
pub(super) fn more(n: usize, n_printed: usize) -> Option<String> {
    (n > n_printed).then(|| format!("… and {} more: --all prints them, --json too", n - n_printed))
}

fn line(fault: &Fault) -> String {
    let surface = fault.surface.map_or_else(String::new, |surface| format!(" surface {surface}"));
    let place = fault.position.map_or_else(String::new, |[x, y, z]| format!(" at {x:.3} {y:.3} {z:.3}"));
    let Fault { code, object, lod, solid, shell, .. } = fault;
    format!("{code}: {object} (LOD {lod}) solid {solid} shell {shell}{surface}{place}")
}
