//! `sizeup view`: a result in the browser, or one of its photos in a picture.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Args;

use super::look::{self, PhotoArgs};
use super::ui::warn_of_unfinished;
use super::{Failure, Global, Ui, print};
use sizeup_results::report::{ServeError, Server, tileset_of};

/// Arguments of `sizeup view`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup view result             the tiles of a result, or made of its city.city.json
  sizeup view tiles --no-open    what `sizeup export … --to 3dtiles` wrote; the address is printed
  sizeup view result --photo 012_oblique --output panel.png
  sizeup view sizeup.toml --photo 012_oblique --pass 1 --output first.png

Only this machine can open it. Stop it with Ctrl-C.")]
pub struct ViewArgs {
    /// Folder of a result, or of 3D Tiles; for a photo also the configuration of the run (default: sizeup.toml in this folder).
    #[arg(required_unless_present = "photo")]
    pub path: Option<PathBuf>,
    /// Port on 127.0.0.1; 0 takes any free one.
    #[arg(long, value_name = "PORT", default_value_t = 0)]
    pub port: u16,
    /// Print the address, and open no browser.
    #[arg(long)]
    pub no_open: bool,
    /// One photo in place of the whole.
    #[command(flatten)]
    pub photo: PhotoArgs,
}

pub(super) fn run(args: &ViewArgs, global: &Global) -> Result<u8, Failure> {
    let code = |e: &ServeError| match e {
        ServeError::Port { .. } => 4,
        ServeError::Tiles(error) => error.exit_code(),
        _ => 3,
    };
    if let (Some(photo), Some(output)) = (&args.photo.photo, &args.photo.output) {
        return look::run(args.path.as_deref(), photo, output, &args.photo, global);
    }
    let path = args.path.as_deref().unwrap_or(Path::new("."));
    warn_of_unfinished(path, global);
    let tiles = tileset_of(path).map_err(|e| Failure::new(code(&e), &e))?;
    let server = Server::bind(&tiles, path, args.port).map_err(|e| Failure::new(code(&e), &e))?;
    print(&server.address())?;
    if !args.no_open && !open(&server.address()) {
        Ui::new(global).say("no browser could be started: open the address yourself");
    }
    server.run();
    Ok(0)
}

/// Asks the system to open an address.
fn open(address: &str) -> bool {
    let (program, before): (&str, &[&str]) = if cfg!(target_os = "macos") {
        ("open", &[])
    } else if cfg!(windows) {
        ("cmd", &["/C", "start", ""])
    } else {
        ("xdg-open", &[])
    };
    let mut command = Command::new(program);
    command.args(before).arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.spawn().is_ok()
}
