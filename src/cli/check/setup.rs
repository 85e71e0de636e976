//! `sizeup check`, of the machine and a configuration: what they have and what they lack, with the command that brings it.

use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use super::super::flags::{BY_DEFAULT, config_file};
use super::super::{Failure, Global, print, print_json};
use crate::config::RunConfig;
use crate::tiles;
use sizeup_footprints::{FootprintSource, SMALL};
use sizeup_geo::crs::{self, Crs, CrsError, GridFile, Transform, Transform3d};
use sizeup_geo::files::is_virtual;
use sizeup_geo::geodata;
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_geo::geodata::vector::VectorLayer;
use sizeup_geo::terrain::TerrainConfig;
use sizeup_photos::onnx::{EngineChoice, EngineConfig, runtime};
use sizeup_photos::prior::PriorConfig;
use sizeup_photos::prior::network::known::{self, KnownNetwork};
use sizeup_survey::{HeightConfig, VerticalDatum};

/// Longitude, latitude and height above the ellipsoid (WGS 84).
const ELLIPSOIDAL: &str = "EPSG:4979";

/// Formats that a run writes or people bring, by GDAL's names: without the first two no run finishes.
const DRIVERS: [(&str, bool); 8] = [
    ("GPKG", true),
    ("GTiff", true),
    ("GeoJSON", false),
    ("FlatGeobuf", false),
    ("ESRI Shapefile", false),
    ("JPEG", false),
    ("PNG", false),
    ("COG", false),
];

/// State of something that a run may need.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Presence {
    /// The thing is there.
    Ok,
    /// It is not there, and nothing that was asked about needs it.
    Absent,
    /// It is not there, and a run needs it.
    Missing,
}

/// One thing that was looked at.
#[derive(Debug, Clone, Serialize)]
struct SetupFinding {
    what: String,
    state: Presence,
    /// The finding in words.
    found: String,
    /// Command that brings it, where it is not there.
    #[serde(skip_serializing_if = "Option::is_none")]
    hint: Option<String>,
}

impl SetupFinding {
    fn ok(what: &str, found: impl Into<String>) -> Self {
        Self { what: what.to_owned(), state: Presence::Ok, found: found.into(), hint: None }
    }

    fn lacking(what: &str, is_needed: bool, found: impl Into<String>, hint: impl Into<String>) -> Self {
        let state = if is_needed { Presence::Missing } else { Presence::Absent };
        Self { what: what.to_owned(), state, found: found.into(), hint: Some(hint.into()) }
    }

    fn line(&self) -> String {
        let mark = match self.state {
            Presence::Ok => "ok     ",
            Presence::Absent => "-      ",
            Presence::Missing => "MISSING",
        };
        let hint = self.hint.as_ref().map_or_else(String::new, |hint| format!("\n          hint: {hint}"));
        format!("{mark}  {}: {}{hint}", self.what, self.found)
    }
}

/// Checks the machine, and the configuration that is named or in this folder.
pub(super) fn run(config: Option<&Path>, assignments: &[String], global: &Global) -> Result<u8, Failure> {
    let is_asked = config.is_some() || !assignments.is_empty() || Path::new(BY_DEFAULT).is_file();
    let file = is_asked.then(|| config_file(config)).transpose()?;
    let config = file.map(|path| RunConfig::load(&path, assignments));
    let config = config.transpose().map_err(|e| Failure::new(2, &e))?;
    let mut findings = of_machine(config.as_ref().map(|config| &config.prior));
    findings.extend(config.iter().flat_map(of_config));
    if global.json {
        print_json(&findings)?;
    } else {
        for finding in &findings {
            print(&finding.line())?;
        }
    }
    Ok(if findings.iter().any(|finding| finding.state == Presence::Missing) { 3 } else { 0 })
}

/// The program, the machine, and the libraries it links.
fn of_machine(prior: Option<&PriorConfig>) -> Vec<SetupFinding> {
    let memory = tiles::available_memory_mb().map_or("not known".to_owned(), |mb| format!("{mb} MB for a run"));
    let mut findings = vec![
        SetupFinding::ok("sizeup", env!("CARGO_PKG_VERSION")),
        SetupFinding::ok("processor", format!("{} threads", rayon::current_num_threads())),
        SetupFinding::ok("memory", memory),
        SetupFinding::ok("GDAL", geodata::gdal_version()),
    ];
    findings.extend(proj());
    for (driver, is_needed) in DRIVERS {
        let what = format!("GDAL's {driver}");
        findings.push(if geodata::has_driver(driver) {
            SetupFinding::ok(&what, "there")
        } else {
            SetupFinding::lacking(
                &what,
                is_needed,
                "not in this GDAL",
                "install a GDAL with it: `apt-get install gdal-bin libgdal-dev`",
            )
        });
    }
    findings.push(SetupFinding::ok("embedded network engine", "built in"));
    let engine = match prior {
        Some(PriorConfig::Network(network)) => network.engine.clone(),
        _ => EngineConfig::default(),
    };
    findings.push(match runtime::library(&engine) {
        Ok(path) => SetupFinding::ok("ONNX Runtime", path.display().to_string()),
        Err(_) => SetupFinding::lacking(
            "ONNX Runtime",
            engine.name == EngineChoice::OnnxRuntime,
            "not found; networks run in the embedded engine",
            "`make deps-onnxruntime` in a clone of sizeup, or set ORT_DYLIB_PATH to its library",
        ),
    });
    findings.extend(known::known().iter().map(network_in_place));
    findings.push(SetupFinding::ok("network small", format!("built in: {}", SMALL.about)));
    findings
}

/// Whether a network that sizeup knows by name is in place: a run that needs it says so itself.
fn network_in_place(network: &KnownNetwork) -> SetupFinding {
    let what = format!("network {}", network.name);
    match known::in_place(Path::new(network.name)) {
        Some(path) => SetupFinding::ok(&what, path.display().to_string()),
        None => SetupFinding::lacking(
            &what,
            false,
            "not in place; depth comes from files or from stereo without it",
            format!("`sizeup model get {}`", network.name),
        ),
    }
}

/// Needs of a run.
fn of_config(config: &RunConfig) -> Vec<SetupFinding> {
    let mut findings = vec![heights_grid(&config.project.crs, &config.survey.height)];
    let crs_of_poses = config.survey.crs.clone();
    findings.extend(planes(&config.project.crs, crs_of_poses, &config.footprints, &config.terrain));
    findings.push(file("survey.path", &config.survey.path));
    findings.extend(config.survey.images.iter().map(|path| file("survey.images", path)));
    if let FootprintSource::Layer(layer) = &config.footprints {
        findings.push(file("footprints.path", &layer.path));
    } else if let FootprintSource::Masks(masks) = &config.footprints {
        findings.push(file("footprints.path", before_placeholder(&masks.path)));
    } else {
        findings.extend(config.footprints.file().map(|path| file("footprints.model", &path)));
    }
    findings.extend(config.terrain.dtm.iter().map(|path| file("terrain.dtm", path)));
    match config.prior.chosen().as_ref() {
        PriorConfig::Files(files) => {
            findings.push(file("prior.path", before_placeholder(&files.path)));
        }
        PriorConfig::Network(network) => {
            let mut model = file("prior.model", &network.graph());
            let is_missing = model.state == Presence::Missing;
            model.hint = known::how_to_get(&network.graph()).filter(|_| is_missing).or(model.hint);
            findings.push(model);
        }
        PriorConfig::Stereo(_) if config.survey.images.is_none() => findings.push(SetupFinding::lacking(
            "photos for stereo",
            true,
            "`survey.images` is not set",
            "set survey.images to the folder of the photos",
        )),
        PriorConfig::Stereo(_) | PriorConfig::Auto(_) => {} // `auto` has chosen one of the others
    }
    findings.extend(config.reviews.iter().map(|reviews| file("reviews.path", &reviews.path)));
    findings.push(output(&config.project.output));
    findings
}

/// Whether results can be written: into the folder, or the nearest one above it that is there.
fn output(folder: &Path) -> SetupFinding {
    const WHAT: &str = "project.output";
    let there = folder.ancestors().find(|path| path.exists()).unwrap_or(Path::new("."));
    let there = if there.as_os_str().is_empty() { Path::new(".") } else { there };
    match tempfile::Builder::new().prefix(".partial-").tempfile_in(there) {
        Ok(_) => SetupFinding::ok(WHAT, format!("{} can be written", folder.display())),
        Err(error) => SetupFinding::lacking(
            WHAT,
            true,
            format!("nothing can be written in {}: {error}", there.display()),
            "name another folder with `--output FOLDER`, or allow writing there",
        ),
    }
}

/// The part of a path that is the same for all photos: what stands before the first placeholder is a folder, whatever
/// the photos are called.
fn before_placeholder(path: &str) -> &Path {
    let plain = path.split('{').next().unwrap_or_default();
    if plain.len() == path.len() { Path::new(plain) } else { folder_of(plain) }
}

fn folder_of(before_placeholder: &str) -> &Path {
    let path = Path::new(before_placeholder);
    let folder = if before_placeholder.ends_with('/') { path } else { path.parent().unwrap_or(path) };
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

fn file(what: &str, path: &Path) -> SetupFinding {
    let shown = path.display().to_string();
    if is_virtual(path) || path.exists() {
        SetupFinding::ok(what, shown)
    } else {
        let hint = format!("put it there, or set {what} to where it is; paths count from the configuration's folder");
        SetupFinding::lacking(what, true, format!("{shown} does not exist"), hint)
    }
}

/// PROJ itself, and the grid files that it finds.
fn proj() -> [SetupFinding; 2] {
    let folders: Vec<String> = crs::data_folders().iter().map(|folder| folder.display().to_string()).collect();
    let grids = crs::grids_present();
    let present = if grids.is_empty() { "none".to_owned() } else { grids.join(", ") };
    [
        SetupFinding::ok("PROJ", format!("{}, its files in {}", crs::proj_version(), folders.join(", "))),
        SetupFinding::ok("PROJ's grids", present),
    ]
}

/// How well positions of the poses, the footprints and the terrain reach the project's plane, and the grid that would bring
/// them there better.
fn planes(
    project: &Crs,
    poses: Option<Crs>,
    footprints: &FootprintSource,
    terrain: &TerrainConfig,
) -> Vec<SetupFinding> {
    let footprints = match footprints {
        FootprintSource::Layer(layer) => layer.crs.clone().or_else(|| {
            let source = VectorLayer::open(&layer.path, layer.layer.as_deref()).ok()?;
            source.crs().ok().flatten()
        }),
        _ => None,
    };
    let own = || RasterFile::open(terrain.dtm.as_ref()?).ok()?.crs().ok().flatten();
    let terrain = terrain.crs.clone().or_else(own);
    let systems = [("survey.crs", poses), ("footprints", footprints), ("terrain.dtm", terrain)];
    let known = systems.into_iter().filter_map(|(what, crs)| Some((what, crs?)));
    known.filter_map(|(what, from)| plane(what, &from, project)).collect()
}

/// The same of one of them; `None` where nothing has to be done.
fn plane(what: &str, from: &Crs, to: &Crs) -> Option<SetupFinding> {
    let what = format!("PROJ's way from {what} ({from})");
    let transform = match Transform::new(from, to) {
        Ok(transform) if transform.is_identity() => return None,
        Ok(transform) => transform,
        Err(error) => {
            let text = error.to_string();
            let (found, hint) = text.split_once("\nhint: ").unwrap_or((&text, "`projsync --all`"));
            return Some(SetupFinding::lacking(&what, true, found, hint));
        }
    };
    // In the middle of where the project's system is used.
    let [west, south, east, north] = to.area_of_use_deg()?;
    let middle = (f64::midpoint(west, east), f64::midpoint(south, north));
    let (x, y) = Transform::new(&Crs::parse("EPSG:4326").ok()?, from).ok()?.point(middle.0, middle.1).ok()?;
    let found = format!("to {to}: {}", transform.accuracy_at(x, y).ok()?);
    Some(match transform.better_at(x, y) {
        Some(better) => {
            let hint = how_to_get(&better.grid);
            SetupFinding::lacking(&what, false, format!("{found}; {better}"), hint)
        }
        None => SetupFinding::ok(&what, found),
    })
}

/// The command that brings a grid, or where it comes from.
fn how_to_get(grid: &GridFile) -> String {
    match grid.command() {
        Some(command) => format!("`{command}` brings it (`projsync` is in Debian's package proj-bin)"),
        None => format!("put {grid} into a folder named by PROJ_DATA"),
    }
}

/// Whether PROJ can take the project's heights to the ellipsoid, which globes and satellite positions count from. A run
/// in one height system does without; one whose poses have ellipsoidal heights does not.
fn heights_grid(crs: &Crs, height: &HeightConfig) -> SetupFinding {
    const WHAT: &str = "PROJ's grid of the heights";
    if crs.vertical_name().is_none() {
        return SetupFinding::ok(WHAT, format!("none needed: {crs} has no vertical part"));
    }
    let reach = || -> Result<(), CrsError> {
        let ellipsoid = Transform3d::new(crs, &Crs::parse(ELLIPSOIDAL)?)?;
        let Some([west, south, east, north]) = crs.area_of_use_deg() else { return Ok(()) };
        let to_map = Transform::new(&Crs::parse("EPSG:4326")?, crs)?;
        let (x, y) = to_map.point(f64::midpoint(west, east), f64::midpoint(south, north))?;
        ellipsoid.point(DVec3::new(x, y, 0.0)).map(drop)
    };
    let Err(error) = reach() else { return SetupFinding::ok(WHAT, format!("there, for {crs}")) };
    let is_shift_given = height.geoid_offset.is_some() || height.keep_ellipsoidal;
    let is_needed = height.reference == Some(VerticalDatum::Ellipsoidal) && !is_shift_given;
    let text = error.to_string();
    let (found, advice) = text.split_once("\nhint: ").unwrap_or((&text, ""));
    let grids = Crs::parse(ELLIPSOIDAL).map(|ellipsoid| crs::height_grids(crs, &ellipsoid, None)).unwrap_or_default();
    // PROJ hands out its own; what agencies call the same file is second best.
    let best = grids.iter().find(|grid| grid.command().is_some()).or(grids.first());
    let hint = best.map_or_else(
        || advice.to_owned(),
        |grid| format!("{}; or state the shift: geoid_offset for poses, --geoid-height for 3D Tiles", how_to_get(grid)),
    );
    SetupFinding::lacking(WHAT, is_needed, found, hint)
}
