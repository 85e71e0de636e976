//! A simulated scene of seconds for tests of the whole path: made once, altered by each test in a copy of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use assert_cmd::Command;
use serde_json::Value;
use sizeup::config::RunConfig;
use sizeup::crs::Crs;
use sizeup::simulate::{ErrorConfig, SimulateConfig, SimulationSummary, simulate, simulate_with_views};
use sizeup::survey::{self, View, ViewKind};
use tempfile::TempDir;

/// Buildings of the scene.
pub const N_BUILDINGS: usize = 6;
/// Photos of the scene.
pub const N_VIEWS: usize = 20;

/// Settings of the scene: few buildings, no photos, small priors.
pub fn config() -> SimulateConfig {
    let mut config = SimulateConfig::default();
    config.town.n_buildings = N_BUILDINGS;
    config.flight.n_views = Some(N_VIEWS);
    (config.camera.width_px, config.camera.height_px) = (160, 120);
    config.prior.longest_px = 160;
    config.terrain.margin_m = 400.0;
    config.images.enabled = false;
    config
}

/// Simulates a scene with the nadir photos of a flight alone. The others are not rendered: most of a simulation's time goes into photos.
pub fn simulate_from_above(config: &SimulateConfig, folder: &Path) -> SimulationSummary {
    let planned = tempfile::tempdir().unwrap();
    let errors = ErrorConfig { position_m: 0.0, angle_deg: 0.0, ..config.errors };
    let mut plan = SimulateConfig { errors, ..config.clone() };
    (plan.images.enabled, plan.masks.enabled, plan.prior.longest_px) = (false, false, 16);
    let planned = simulate(&plan, planned.path(), &|_, _| {}).unwrap();
    let run = RunConfig::load(&planned.run_config, &[]).unwrap();
    let poses = survey::read(&run.survey, &Crs::parse(&config.crs).unwrap()).unwrap();
    let nadir: Vec<View> = poses.views.into_iter().filter(|view| view.kind() == ViewKind::Nadir).collect();
    let summary = simulate_with_views(config, &nadir, folder, &|_, _| {}).unwrap();
    assert_eq!(summary.n_views, planned.n_nadir);
    summary
}

/// Runs write no report: its page takes as long as the heights of so few buildings.
const NO_PAGE: &str = "report.page = false\n";

fn original() -> &'static Path {
    static SCENE: OnceLock<TempDir> = OnceLock::new();
    let scene = SCENE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        simulate(&config(), folder.path(), &|_, _| {}).unwrap();
        // Low resolution wherever the scene is run.
        let path = folder.path().join("sizeup.toml");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, format!("{text}\n[optimise]\nworking_px = 160\n\n[output]\npictures = false\n{NO_PAGE}"))
            .unwrap();
        folder
    });
    scene.path()
}

/// Copies a folder with all that is in it.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// The binary with its own empty environment of settings.
pub fn sizeup() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sizeup"));
    command.env_remove("RUST_LOG");
    command
}

/// The laboratory's binary, beside the program's: `cargo build --workspace` and `make test` build both.
pub fn lab() -> Command {
    let name = format!("sizeup-lab{}", std::env::consts::EXE_SUFFIX);
    let path = Path::new(env!("CARGO_BIN_EXE_sizeup")).with_file_name(name);
    assert!(path.is_file(), "{} is missing: cargo build --workspace", path.display());
    let mut command = Command::new(path);
    command.env_remove("RUST_LOG");
    command
}

/// What a command left behind.
pub struct Outcome {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl From<Output> for Outcome {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code().expect("no signal ended it"),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

/// A copy of the scene, to be altered.
pub struct Scene {
    folder: TempDir,
}

impl Scene {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        copy(original(), folder.path());
        Self { folder }
    }

    /// A copy whose runs write the page of the report too.
    pub fn with_page() -> Self {
        let scene = Self::new();
        scene.edit("sizeup.toml", |text| text.replace(NO_PAGE, ""));
        scene
    }

    /// One that a test has made itself.
    pub fn of(folder: TempDir) -> Self {
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `sizeup run sizeup.toml` and more arguments, in the scene's folder.
    pub fn run(&self, more: &[&str]) -> Outcome {
        self.sizeup(&[&["run", "sizeup.toml"], more].concat())
    }

    /// Any command in the scene's folder.
    pub fn sizeup(&self, args: &[&str]) -> Outcome {
        sizeup().current_dir(self.folder.path()).args(args).output().unwrap().into()
    }

    /// Any command of the laboratory in the scene's folder.
    pub fn lab(&self, args: &[&str]) -> Outcome {
        lab().current_dir(self.folder.path()).args(args).output().unwrap().into()
    }

    pub fn edit(&self, name: &str, change: impl FnOnce(String) -> String) {
        let path = self.path(name);
        let text = fs::read_to_string(&path).unwrap();
        let changed = change(text.clone());
        assert_ne!(text, changed, "the edit of {name} does nothing");
        fs::write(path, changed).unwrap();
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(name)).unwrap()).unwrap()
    }

    /// The true footprints as a GeoJSON layer, altered, in place of those on disk.
    pub fn change_footprints(&self, change: impl FnOnce(&mut Vec<Value>)) {
        let mut layer = self.json("truth.geojson");
        change(layer["features"].as_array_mut().unwrap());
        fs::write(self.path("footprints.geojson"), layer.to_string()).unwrap();
        self.edit("sizeup.toml", |text| text.replace("footprints.gpkg", "footprints.geojson"));
    }

    /// Replaces a photo's prior by `values` (row-major) of a size.
    pub fn write_prior(&self, stem: &str, width: usize, height: usize, values: &[f32]) {
        write_npy(&self.path(&format!("priors/{stem}.npy")), width, height, values);
    }

    /// Stems of the photos, sorted.
    pub fn stems(&self) -> Vec<String> {
        let stem = |entry: fs::DirEntry| entry.path().file_stem().unwrap().to_string_lossy().into_owned();
        let mut stems: Vec<String> = fs::read_dir(self.path("priors")).unwrap().map(|e| stem(e.unwrap())).collect();
        stems.sort();
        stems
    }

    /// Issues of the last run with this code.
    pub fn issues(&self, code: &str) -> Vec<Value> {
        let issues = self.json("result/issues.json");
        issues.as_array().unwrap().iter().filter(|issue| issue["code"] == code).cloned().collect()
    }

    /// Id and status of every building in the city model.
    pub fn statuses(&self) -> Vec<(String, String)> {
        let city = self.json("result/city.city.json");
        let objects = city["CityObjects"].as_object().unwrap();
        let status = |object: &Value| {
            let attributes = object["attributes"].as_object().unwrap();
            let found = attributes.iter().find(|(name, _)| name.ends_with("status"));
            found.and_then(|(_, value)| value.as_str()).expect("every building has a status").to_owned()
        };
        objects.iter().map(|(id, object)| (id.clone(), status(object))).collect()
    }

    /// Files below the results, by path, without those of half a write.
    pub fn files(&self, folder: &str) -> Vec<PathBuf> {
        let mut found = Vec::new();
        let mut folders = vec![self.path(folder)];
        while let Some(next) = folders.pop() {
            for entry in fs::read_dir(next).into_iter().flatten() {
                let path = entry.unwrap().path();
                if path.is_dir() { folders.push(path) } else { found.push(path) }
            }
        }
        found.sort();
        found
    }

    /// Panics if anything half-written lies in the scene's folder.
    pub fn assert_no_litter(&self) {
        for path in self.files("") {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            assert!(!name.starts_with(".partial-") && !name.ends_with("-journal"), "{}", path.display());
        }
    }
}

/// `H × W` values as `.npy`, version 1.0, 32-bit floats.
pub fn write_npy(path: &Path, width: usize, height: usize, values: &[f32]) {
    assert_eq!(values.len(), width * height);
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    fs::write(path, bytes).unwrap();
}
