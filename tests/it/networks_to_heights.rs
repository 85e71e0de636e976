//! From photos through a network to heights, and priors computed ahead of a run.
//!
//! The network is a graph of five nodes, depth = exp(mean of the normalised channels), and the photos are painted so
//! that it gives the true depth: what is tested is the way there and back, not a network's skill.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use serde_json::Value;
use sizeup::simulate::simulate;
use tempfile::TempDir;

use crate::skipped::skip;
use crate::tiny_scene::{self, Outcome, sizeup};

const SIZE_PX: (usize, usize) = (336, 252);
const MEAN: [f64; 3] = [0.485, 0.456, 0.406];
const STD: [f64; 3] = [0.229, 0.224, 0.225];
/// What the smallest depth of a photo becomes: well above what the graph calls sky.
const NEAREST: f64 = 0.8;

/// Depths of a .npy of 32-bit floats, row-major.
fn depths(path: &Path) -> Vec<f64> {
    let bytes = fs::read(path).unwrap();
    let n = SIZE_PX.0 * SIZE_PX.1 * 4;
    bytes[bytes.len() - n..].chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect()
}

/// A colour whose normalised channels have this mean, as nearly as bytes allow.
fn colour(mean: f64) -> [u8; 3] {
    let byte = |c: usize, value: f64| ((value * STD[c] + MEAN[c]) * 255.0).round().clamp(0.0, 255.0);
    let value = |c: usize, byte: f64| (byte / 255.0 - MEAN[c]) / STD[c];
    // Each channel takes what those before it left over by rounding or by their limits.
    let mut left = 3.0 * mean;
    std::array::from_fn(|c| {
        let byte = byte(c, left / (3 - c) as f64);
        left -= value(c, byte);
        byte as u8
    })
}

/// A scene of few buildings whose photos are painted.
fn original() -> &'static Path {
    static SCENE: OnceLock<TempDir> = OnceLock::new();
    let scene = SCENE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let mut config = tiny_scene::config();
        (config.camera.width_px, config.camera.height_px) = (SIZE_PX.0 as u32, SIZE_PX.1 as u32);
        config.prior.longest_px = SIZE_PX.0 as u32;
        config.prior.write_true_depth = true;
        simulate(&config, folder.path(), &|_, _| {}).unwrap();
        fs::create_dir(folder.path().join("images")).unwrap();
        for entry in fs::read_dir(folder.path().join("depth")).unwrap() {
            paint(&entry.unwrap().path(), &folder.path().join("images"));
        }
        configure(folder.path());
        folder
    });
    scene.path()
}

fn paint(depth: &Path, images: &Path) {
    let depths = depths(depth);
    let nearest = depths.iter().copied().filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let photo = image::RgbImage::from_fn(SIZE_PX.0 as u32, SIZE_PX.1 as u32, |x, y| {
        let depth = depths[y as usize * SIZE_PX.0 + x as usize];
        image::Rgb(if depth.is_finite() && depth > 0.0 { colour((depth / nearest * NEAREST).ln()) } else { [0; 3] })
    });
    // Whatever the survey calls them: readers go by content.
    let name = format!("{}.jpg", depth.file_stem().unwrap().to_str().unwrap());
    photo.save_with_format(images.join(name), image::ImageFormat::Png).unwrap();
}

fn configure(folder: &Path) {
    let path = folder.join("sizeup.toml");
    let text = fs::read_to_string(&path).unwrap();
    let before_prior = text
        .split("[prior]")
        .next()
        .unwrap()
        .replace("path = \"sparse\"\n", "path = \"sparse\"\nimages = \"images\"\n");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/onnx/depth_of_brightness.onnx");
    let prior = format!(
        "[prior]\nsource = \"network\"\nmodel = \"{}\"\nprofile = \"painted.toml\"\n\n\
         [optimise]\nworking_px = 224\n\n[output]\npictures = false\n\n[output.report]\npage = false\n",
        model.display()
    );
    let profile = format!(
        "name = \"painted\"\nabout = \"a test\"\n\
         inputs = [\"image\"]\noutputs = [\"depth\"]\nkind = \"depth\"\nfit = \"longest_side\"\nside_px = {}\n\
         multiple_of = 14\nmean = {MEAN:?}\nstd = {STD:?}\nsky_output = \"sky\"\nsky_above = 0.3\nlicence = \"ours\"\n",
        SIZE_PX.0
    );
    fs::write(folder.join("painted.toml"), profile).unwrap();
    fs::write(&path, before_prior + &prior).unwrap();
}

fn sizeup_in(folder: &Path, args: &[&str]) -> Outcome {
    let outcome: Outcome = sizeup().current_dir(folder).args(args).output().unwrap().into();
    assert!(matches!(outcome.code, 0 | 5), "{args:?}: {}", outcome.stderr);
    outcome
}

/// A scene of its own, without what earlier commands left.
fn copy_of_scene() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let status = Command::new("cp").arg("-r").arg(original().join(".")).arg(folder.path()).status().unwrap();
    assert!(status.success());
    folder
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let Ok(found) = fs::read_dir(folder.join("prior-cache")) else { return Vec::new() };
    let paths = found.map(|entry| entry.unwrap().path());
    let is_unfinished = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with(".partial-");
    paths.filter(|path| !is_unfinished(path)).collect()
}

fn compute(folder: &Path) -> Value {
    let outcome = sizeup_in(folder, &["model", "compute", "sizeup.toml", "--json", "-q"]);
    serde_json::from_str(&outcome.stdout).unwrap_or_else(|e| panic!("{e}: {}", outcome.stderr))
}

#[test]
fn a_networks_depth_becomes_heights_and_what_was_computed_ahead_is_found() {
    let scene = copy_of_scene();
    let first = compute(scene.path());
    let n = first["n_computed"].as_u64().unwrap();
    assert!(n >= 4 && first["n_wanted"] == n && first["n_found"] == 0 && first["n_kept"] == n, "{first}");
    let second = compute(scene.path());
    assert!(second["n_computed"] == 0 && second["n_found"] == n, "{second}");
    let before = entries(scene.path()).len();
    assert_eq!(before as u64, n);

    sizeup_in(scene.path(), &["run", "sizeup.toml", "-q"]);
    assert!(entries(scene.path()).len() <= before + 4, "a run asks for little more than its first selection");
    let evaluated = sizeup_in(scene.path(), &["evaluate", "result/city.city.json", "truth.geojson"]);
    // Bytes hold these depths to 0.3 %, half a metre here, as likely too far as too near.
    assert!(mean_error_m(&evaluated) < 0.7, "{}", evaluated.stdout);
}

#[test]
fn a_network_that_takes_neighbours_and_poses_gives_heights() {
    let scene = copy_of_scene();
    let path = scene.path().join("sizeup.toml");
    let text = fs::read_to_string(&path).unwrap();
    let company = "licence = \"ours\"\ncompany = { n_views = 3, extrinsics = [\"extrinsics\"], intrinsics = [\"intrinsics\"], \
                   poses_output = [\"predicted_extrinsics\"] }\n";
    assert!(text.contains("depth_of_brightness"));
    fs::write(&path, text.replace("depth_of_brightness", "depth_of_poses")).unwrap();
    let profile = scene.path().join("painted.toml");
    let text = fs::read_to_string(&profile).unwrap();
    assert!(text.contains("licence = \"ours\"\n"));
    fs::write(&profile, text.replace("licence = \"ours\"\n", company)).unwrap();
    sizeup_in(scene.path(), &["run", "sizeup.toml", "-q"]);
    let evaluated = sizeup_in(scene.path(), &["evaluate", "result/city.city.json", "truth.geojson"]);
    assert!(mean_error_m(&evaluated) < 0.7, "{}", evaluated.stdout);
}

/// Mean error of all buildings in what `evaluate` prints, metres.
fn mean_error_m(evaluated: &Outcome) -> f64 {
    let all = evaluated.stdout.lines().find(|line| line.starts_with("all ")).unwrap();
    all.split_whitespace().nth(2).unwrap().parse().unwrap()
}

#[test]
fn a_process_killed_while_it_writes_a_prior_leaves_a_cache_that_the_next_one_completes() {
    let scene = copy_of_scene();
    // An entry has 339 kB: the system kills the process in the middle of its first one.
    let killed = Command::new("bash")
        .args(["-c", "ulimit -f 250; exec \"$@\"", "bash", env!("CARGO_BIN_EXE_sizeup")])
        .args(["model", "compute", "sizeup.toml", "-q"])
        .current_dir(scene.path())
        .stderr(Stdio::null())
        .status()
        .unwrap();
    assert_eq!(killed.code(), None, "a signal ended it");
    assert_eq!(entries(scene.path()), Vec::<PathBuf>::new(), "none half-written");
    let unfinished = fs::read_dir(scene.path().join("prior-cache")).unwrap().count();
    assert!(unfinished >= 1, "it was killed within a write");
    let next = compute(scene.path());
    assert_eq!(next["n_kept"], next["n_wanted"]);
    assert!(next["failed"].as_array().unwrap().is_empty(), "{next}");
}

/// What a process has read and the most memory it has had, bytes, as far as the system tells: looked up while it runs.
fn watch(mut child: Child) -> (u64, u64) {
    let (mut n_read, mut peak) = (0, 0);
    let number = |file: &str, key: &str| -> Option<u64> {
        let text = fs::read_to_string(format!("/proc/{}/{file}", child.id())).ok()?;
        text.lines().find_map(|line| line.strip_prefix(key)?.split_whitespace().next()?.parse().ok())
    };
    let mut look = || {
        n_read = number("io", "rchar:").unwrap_or(n_read);
        peak = number("status", "VmHWM:").map_or(peak, |kb| kb * 1024);
        std::thread::sleep(std::time::Duration::from_millis(2));
    };
    for _ in 0..60_000 {
        look();
        if fs::read_to_string(format!("/proc/{}/stat", child.id())).is_ok_and(|stat| stat.contains(") Z ")) {
            break;
        }
    }
    assert!(matches!(child.wait().unwrap().code(), Some(0 | 5)));
    (n_read, peak)
}

#[test]
fn a_photo_of_45_megapixels_is_read_twice_and_never_decoded_whole() {
    if !Path::new("/proc/self/io").exists() {
        skip("this system does not tell what a process reads");
        return;
    }
    let computing = |folder: &Path| {
        // All stages before it, so that what is watched is little more than the photo.
        sizeup_in(folder, &["run", "sizeup.toml", "-q", "--until", "footprints"]);
        let child = Command::new(env!("CARGO_BIN_EXE_sizeup"))
            .args(["model", "compute", "sizeup.toml", "--all", "-q"])
            .current_dir(folder)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        watch(child)
    };
    // What the program takes for small photos: itself, its libraries and the network.
    let (_, besides) = computing(copy_of_scene().path());
    let scene = copy_of_scene();
    let images = scene.path().join("images");
    let mut photos: Vec<PathBuf> = fs::read_dir(&images).unwrap().map(|entry| entry.unwrap().path()).collect();
    photos.sort();
    let large = photos.iter().position(|path| path.to_string_lossy().contains("oblique")).unwrap();
    for path in &photos {
        fs::remove_file(path).unwrap();
    }
    // Grain, so that the file is as large as those of real cameras are.
    let grain = |x: u32, y: u32| (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503) ^ (x * y)) >> 7 & 63;
    let (width, height) = (7744, 5808);
    let photo =
        image::RgbImage::from_fn(width, height, |x, y| image::Rgb([(60 + x / 60 + grain(x, y)).min(255) as u8; 3]));
    photo.save_with_format(&photos[large], image::ImageFormat::Jpeg).unwrap();
    let n_bytes = fs::metadata(&photos[large]).unwrap().len();
    // The hash of a file that was written within the last two seconds is not remembered: it may change within the clock's tick.
    std::thread::sleep(Duration::from_millis(2100));
    let (n_read, peak) = computing(scene.path());
    assert_eq!(entries(scene.path()).len(), 1);
    let whole = u64::from(width * height) * 3;
    let [of_photo, besides_mb, whole_mb] = [peak.saturating_sub(besides), besides, whole].map(|bytes| bytes >> 20);
    println!("photo of {n_bytes} bytes: {n_read} read, {of_photo} MB on top of {besides_mb}, {whole_mb} MB whole");
    // Once for the name of the cache's entry, once for the network; libraries and their tables besides.
    assert!(n_bytes > 10_000_000 && n_read < n_bytes * 5 / 2 + 5_000_000, "{n_read} of {n_bytes}");
    assert!(peak < besides + whole, "{peak} of {whole} on top of {besides}");
}

#[test]
fn two_processes_share_the_work() {
    let scene = copy_of_scene();
    let start = || {
        Command::new(env!("CARGO_BIN_EXE_sizeup"))
            .args(["model", "compute", "sizeup.toml", "--all", "-q"])
            .current_dir(scene.path())
            .spawn()
            .unwrap()
    };
    let (mut one, mut other) = (start(), start());
    assert!(one.wait().unwrap().success() && other.wait().unwrap().success());
    let after = compute(scene.path());
    assert!(after["n_computed"] == 0 && after["failed"].as_array().unwrap().is_empty(), "{after}");
}
