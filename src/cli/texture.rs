//! `sizeup texture`: a finished result with the colours of its photos.

use std::path::PathBuf;

use clap::Args;

use super::ui::warn_of_unfinished;
use super::{Failure, Global, Ui, counted, print_json};
use crate::config::{RunConfig, SAVED_NAME};
use crate::pipeline::{self, RunSettings};
use sizeup_photos::textures::TexturedArea;

/// Arguments of `sizeup texture`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup texture result
  sizeup texture result --set output.textures.texel_m=0.2

It writes result/textured/ with city.city.json, its pictures, and city.glb, and puts the textures into result/report.html. `sizeup run`
does the same where the configuration has `output.textures.enabled = true`.")]
pub struct TextureArgs {
    /// Folder of a finished result, with its `config.toml` and `stages`.
    pub result: PathBuf,
    /// Set one key of the configuration. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
}

pub(super) fn run(args: &TextureArgs, global: &Global) -> Result<u8, Failure> {
    let path = args.result.join(SAVED_NAME);
    let mut config = RunConfig::load(&path, &args.assignments).map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    config.project.output.clone_from(&args.result);
    warn_of_unfinished(&args.result, global);
    let pipeline::Texturing { summary, issues, written } =
        pipeline::texture(&RunSettings::of(&config)).map_err(|e| Failure::new(e.exit_code(), &e))?;
    let ui = Ui::new(global);
    for issue in &issues {
        let hint = issue.hint.as_ref().map_or_else(String::new, |hint| format!("\n  hint: {hint}"));
        ui.say(format!("{}: {}{hint}", issue.subject.name(), issue.message));
    }
    let share =
        |area: &TexturedArea| area.seen_share().map_or_else(|| "none".to_owned(), |s| format!("{:.0} %", 100.0 * s));
    ui.say(format!(
        "{} in {}, texels of {:.2} m: {} of the roofs and {} of the walls from photos; {}",
        counted(summary.buildings.len(), "building"),
        counted(summary.n_pages, "picture"),
        summary.texel_m,
        share(&summary.roofs),
        share(&summary.walls),
        written.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    ));
    if global.json {
        print_json(&summary)?;
    }
    Ok(0)
}
