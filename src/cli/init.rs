//! `sizeup init`: a folder of photos as a project.

use std::path::PathBuf;

use clap::Args;

use super::survey::three_numbers;
use super::{Failure, Global, Ui, print_json};
use crate::init::{Beginning, InitRequest, Lack, begin};
use sizeup_geo::files::write_whole;

/// Something is missing before the project can be run.
const EXIT_INCOMPLETE: u8 = 3;

/// Arguments of `sizeup init`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup init flight                                  writes sizeup.toml; then: sizeup run sizeup.toml
  sizeup init flight --footprints osm.pbf --ground 48 --output town/sizeup.toml
  sizeup init flight --crs EPSG:2180 --offset 634000,485000,0

Looks into the folder and three levels below for poses (those of photogrammetry before the photos' own), building footprints
and a terrain model, chooses the CRS, and writes a configuration that says why and what is missing.

Exit code 0: the project can be run. 3: something is missing, and the file says what; or there are no photos with poses.")]
pub struct InitArgs {
    /// Folder with the photos, and with poses, footprints and terrain where there are such.
    pub folder: PathBuf,
    /// Configuration to write; its paths count from its own folder.
    #[arg(long, short, value_name = "FILE", default_value = "sizeup.toml")]
    pub output: PathBuf,
    /// The project's projected CRS in metres (default: that of the poses, the footprints or the terrain, else the UTM zone).
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,
    /// Offset taken off the positions of poses in a local frame: easting, northing, height.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three_numbers)]
    pub offset: Option<[f64; 3]>,
    /// Building footprints, in place of what lies in the folder.
    #[arg(long, value_name = "FILE")]
    pub footprints: Option<PathBuf>,
    /// Terrain model, in place of what lies in the folder.
    #[arg(long, value_name = "FILE", conflicts_with = "ground")]
    pub dtm: Option<PathBuf>,
    /// One height of the ground, metres, counted from what the poses' heights count from.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub ground: Option<f64>,
    /// Replace the configuration where it exists.
    #[arg(long)]
    pub force: bool,
}

pub(super) fn run(args: &InitArgs, global: &Global) -> Result<u8, Failure> {
    let output = &args.output;
    if output.exists() && !args.force {
        let hint = "--force replaces it, --output names another file";
        return Err(Failure::from_text(
            2,
            format!("{} exists, and is not overwritten\nhint: {hint}", output.display()),
        ));
    }
    let request = InitRequest {
        folder: args.folder.clone(),
        output: output.clone(),
        crs: args.crs.clone(),
        offset: args.offset,
        footprints: args.footprints.clone(),
        dtm: args.dtm.clone(),
        ground_m: args.ground,
    };
    let begun = begin(&request).map_err(|e| Failure::new(e.exit_code(), &e))?;
    write_whole(output, |file| file.write_all(begun.text.as_bytes())).map_err(|e| Failure::new(4, &e))?;
    tell(&begun, &Ui::new(global));
    if global.json {
        print_json(&begun)?;
    }
    Ok(if begun.is_complete { 0 } else { EXIT_INCOMPLETE })
}

fn tell(begun: &Beginning, ui: &Ui) {
    let say_lack = |lack: &Lack| ui.say(format!("missing: {}: {}\n    how: {}", lack.what, lack.why, lack.how));
    // What makes a flight useless comes before all that is said of it.
    let (of_flight, others): (Vec<&Lack>, Vec<&Lack>) = begun.missing.iter().partition(|lack| lack.is_of_flight());
    of_flight.into_iter().for_each(say_lack);
    tell_found(begun, ui);
    for warning in &begun.warnings {
        ui.warn(warning);
    }
    others.into_iter().for_each(say_lack);
    ui.say(format!("{} written", begun.config.display()));
    if begun.is_complete {
        ui.say(format!("next: {}", begun.next));
    } else {
        ui.say(format!("next: add what is missing, then {}", begun.next));
    }
}

fn tell_found(begun: &Beginning, ui: &Ui) {
    let row = |label: &str, value: String| ui.say(format!("  {label:<12}{value}"));
    row("photos", begun.flight.in_words());
    begun.flight.positioning_in_words().into_iter().for_each(|words| row("positioning", words));
    row("poses", format!("{}: {}", begun.poses.path.display(), begun.poses.why));
    for passed in &begun.poses.passed {
        row("", format!("not {} ({}): {}", passed.path.display(), passed.format, passed.why));
    }
    if let Some(crs) = &begun.crs {
        row("CRS", format!("{} ({}): {}", crs.definition, crs.name, crs.why));
    }
    if !begun.heights.is_empty() {
        row("heights", begun.heights.clone());
    }
    if let Some(layer) = &begun.footprints {
        row("footprints", format!("{}: {}", layer.path.display(), layer.why));
    }
    for passed in &begun.other_layers {
        row("", format!("not {}: {}", passed.name, passed.why));
    }
    if !begun.ground.is_empty() {
        let file = begun.terrain.as_ref().map_or_else(String::new, |file| format!("{}: ", file.path.display()));
        row("ground", format!("{file}{}", begun.ground));
    }
    for passed in &begun.other_rasters {
        row("", format!("not {}: {}", passed.path.display(), passed.why));
    }
    for unused in &begun.flight.unused {
        row("not used", unused.clone());
    }
    let n_more = begun.flight.n_unused.saturating_sub(begun.flight.unused.len());
    if n_more > 0 {
        row("", format!("and {n_more} more"));
    }
}
