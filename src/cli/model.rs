//! `sizeup model`: networks, those that sizeup knows by name and those that people bring.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::{Args, Subcommand};
use serde_json::json;

use super::prior::{ComputeArgs, InspectPriorArgs, run_compute, run_inspect};
use super::{Failure, Global, Ui, print, print_json};
use sizeup_footprints::{SMALL, SmallNetwork};
use sizeup_photos::prior::network::known::{KnownNetwork, known, known_by_name};
use sizeup_photos::prior::network::profile::{self, Profile};

/// Subcommands of `sizeup model`.
#[derive(Debug, Clone, Subcommand)]
pub enum ModelCommand {
    /// List the networks that sizeup knows: licence, source, size, and which are in place; then those whose graph you bring.
    List,
    /// Put a network in place: fetch its published weights, check them, and write what `prior.model = "NAME"` finds.
    Get(GetArgs),
    /// Say whether a file is a checkpoint that sizeup knows.
    Check(CheckArgs),
    /// Say what an ONNX graph wants and gives, and which built-in profile fits it.
    Inspect(InspectPriorArgs),
    /// Compute depth priors into the cache ahead of a run.
    Compute(ComputeArgs),
}

/// Arguments of `sizeup model get`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup model get itermvs                          fetches with curl
  sizeup model get itermvs --from model_000015.ckpt a file that you have

Networks lie in the folder that SIZEUP_MODELS names, else in ~/.local/share/sizeup/models. Afterwards:
  [prior]
  source = \"network\"
  model = \"itermvs\"")]
pub struct GetArgs {
    /// Name in `sizeup model list`.
    pub name: String,
    /// The published checkpoint, where it is on this machine already.
    #[arg(long, value_name = "FILE", conflicts_with = "url")]
    pub from: Option<PathBuf>,
    /// Another address of the same file, as of a mirror; its content is checked all the same.
    #[arg(long, value_name = "URL")]
    pub url: Option<String>,
    /// Folder to put it into.
    #[arg(long, value_name = "FOLDER")]
    pub folder: Option<PathBuf>,
}

/// Arguments of `sizeup model check`.
#[derive(Debug, Clone, Args)]
pub struct CheckArgs {
    /// Checkpoint that was downloaded.
    pub file: PathBuf,
}

/// Where networks are put in place on this machine.
pub(super) fn folder() -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).filter(|path| !path.is_empty()).map(PathBuf::from);
    let data = || named("XDG_DATA_HOME").or_else(|| Some(named("HOME")?.join(".local/share")));
    named("SIZEUP_MODELS").or_else(|| Some(data()?.join("sizeup/models")))
}

pub(super) fn run(command: &ModelCommand, global: &Global) -> Result<u8, Failure> {
    match command {
        ModelCommand::List => list(global),
        ModelCommand::Get(args) => get(args, global),
        ModelCommand::Check(args) => check(args, global),
        ModelCommand::Inspect(args) => run_inspect(args, global),
        ModelCommand::Compute(args) => run_compute(args, global),
    }
}

fn list(global: &Global) -> Result<u8, Failure> {
    let folder = folder();
    let place = |network: &KnownNetwork| {
        folder.as_deref().filter(|folder| network.is_in(folder)).map(|folder| network.graph_in(folder))
    };
    if global.json {
        let row = |network: &KnownNetwork| json!({ "network": network, "in_place": place(network) });
        let own = json!({ "network": SMALL, "in_place": "built in" });
        let brought = brought();
        let profiles = brought.iter().map(|Profile { name, about, licence, .. }| {
            json!({ "network": { "name": name, "about": about, "licence": licence }, "in_place": null })
        });
        print_json(&known().iter().map(row).chain([own]).chain(profiles).collect::<Vec<_>>())?;
        return Ok(0);
    }
    for network in known() {
        let KnownNetwork { name, about, licence, bytes, sha256, source, .. } = &network;
        let megabytes = *bytes as f64 / 1e6;
        let state = match place(&network) {
            Some(path) => format!("in place: {}", path.display()),
            None => format!("not in place: `sizeup model get {name}`"),
        };
        let indent = " ".repeat(13);
        print(&format_args!(
            "{name:<12} {about}\n{indent}licence {licence}, {megabytes:.1} MB, SHA-256 {sha256}\n{indent}from {source}\n{indent}{state}"
        ))?;
    }
    let SmallNetwork { name, about, licence, source, measured, bytes } = SMALL;
    let (megabytes, indent) = (bytes as f64 / 1e6, " ".repeat(13));
    print(&format_args!(
        "{name:<12} {about}\n{indent}licence {licence}, {megabytes:.1} MB, {source}\n{indent}{measured}\n\
         {indent}built in: `source = \"network\"` under [footprints], without a model"
    ))?;
    print(&"\nGraphs (ONNX) that you bring, by profile: `model = \"FILE\"` and `profile = \"NAME\"` under [prior]")?;
    for Profile { name, about, licence, .. } in brought() {
        print(&format_args!("{name:<25} {about}\n{}licence of its weights: {licence}", " ".repeat(26)))?;
    }
    Ok(0)
}

/// Profiles of networks of which sizeup has no graph.
fn brought() -> Vec<Profile> {
    let known = known();
    let is_brought = |profile: &Profile| known.iter().all(|network| network.name != profile.name);
    profile::built_in().into_iter().filter(is_brought).collect()
}

fn get(args: &GetArgs, global: &Global) -> Result<u8, Failure> {
    let network = known_by_name(&args.name).map_err(|e| Failure::new(2, &e))?;
    let ui = Ui::new(global);
    let folder = args.folder.clone().or_else(folder).ok_or_else(|| {
        Failure::from_text(2, "no folder for networks is known\nhint: `--folder`, or set SIZEUP_MODELS or HOME")
    })?;
    let graph = if let Some(file) = &args.from {
        network.put_together(file, &folder)
    } else {
        let url = args.url.as_deref().unwrap_or(network.source);
        let fetched = tempfile::NamedTempFile::new()
            .map_err(|e| Failure::from_text(4, format!("cannot make a temporary file: {e}")))?;
        ui.say(format!("fetching {url}"));
        fetch(&network, url, fetched.path())?;
        network.put_together(fetched.path(), &folder)
    };
    let graph = graph.map_err(|e| Failure::new(3, &e))?;
    if global.json {
        print_json(&json!({ "network": network, "in_place": graph }))?;
    } else {
        ui.say(format!(
            "{} is in place (licence of its weights: {}): {}\nuse it with\n  [prior]\n  source = \"network\"\n  model = \"{}\"",
            network.name,
            network.licence,
            graph.display(),
            network.name
        ));
    }
    Ok(0)
}

/// Loads an address into a file by curl, which knows about proxies and certificates.
fn fetch(network: &KnownNetwork, url: &str, target: &Path) -> Result<(), Failure> {
    let by_hand =
        format!("load {url} on a machine that reaches it, and call `sizeup model get {} --from FILE`", network.name);
    let limit = network.bytes.to_string();
    let curl = Command::new("curl")
        .args(["--fail", "--location", "--silent", "--show-error", "--max-time", "600", "--max-filesize", &limit])
        .arg("--output")
        .arg(target)
        .arg("--")
        .arg(url)
        .stdin(Stdio::null())
        .output()
        .map_err(|e| Failure::from_text(4, format!("curl cannot be called: {e}\nhint: install it, or {by_hand}")))?;
    if curl.status.success() {
        return Ok(());
    }
    let reason = String::from_utf8_lossy(&curl.stderr);
    Err(Failure::from_text(4, format!("cannot fetch {url}: {}\nhint: {by_hand}", reason.trim())))
}

fn check(args: &CheckArgs, global: &Global) -> Result<u8, Failure> {
    let mut problems = Vec::new();
    for network in known() {
        match network.check(&args.file) {
            Ok(()) => {
                if global.json {
                    print_json(&json!({ "network": network }))?;
                } else {
                    let (file, name, about) = (args.file.display(), network.name, network.about);
                    print(&format_args!("{file} is the checkpoint of {name}: {about}"))?;
                }
                return Ok(0);
            }
            Err(problem) => problems.push(problem.to_string()),
        }
    }
    if args.file.extension().is_some_and(|extension| extension == "onnx") {
        problems
            .push(format!("hint: of a graph `sizeup model inspect {}` says which profiles fit", args.file.display()));
    }
    Err(Failure::from_text(3, problems.join("\n")))
}
