//! Prior files of every format give the same depths; files that mean something else are refused.

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;

use exr::prelude::WritableImage as _;
use gdal::DriverManager;
use gdal::raster::Buffer;
use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::frames::Rigid;
use sizeup::ids::ViewId;
use sizeup::prior::{DepthUnit, FilePriorConfig, FilePriors, PriorError, PriorKind, PriorSource as _};
use sizeup::survey::View;

use crate::shared_data::shared_data;

fn view(name: &str, width_px: u32, height_px: u32) -> View {
    View {
        id: ViewId::from(name),
        camera: Arc::new(Camera::pinhole(width_px, height_px, 1000.0)),
        camera_from_map: Rigid::new(DMat3::IDENTITY, DVec3::ZERO),
        image: None,
    }
}

fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + header.len()) % 64 != 63 {
        header.push(' ');
    }
    header.push('\n');
    let length = u16::try_from(header.len()).unwrap().to_le_bytes();
    [b"\x93NUMPY\x01\x00".as_slice(), &length, header.as_bytes(), data].concat()
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn write_npz(path: &Path, arrays: &[(&str, Vec<u8>)]) {
    let mut archive = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    for (name, data) in arrays {
        archive.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(data).unwrap();
    }
    archive.finish().unwrap();
}

/// 4 × 3 depths; the photo is 8 × 6.
const DEPTHS: [f32; 12] = [10., 11., 12., 13., 20., 21., 22., 23., 30., 31., 32., 0.];

fn load(path: &Path, config: &FilePriorConfig) -> Result<sizeup::prior::DepthPrior, PriorError> {
    let view = view("a.jpg", 8, 6);
    let config = FilePriorConfig { path: path.to_str().unwrap().to_owned(), ..config.clone() };
    FilePriors::new(config, [&view.id])?.load(&view)
}

fn depth() -> FilePriorConfig {
    FilePriorConfig::new("", PriorKind::Depth)
}

#[test]
fn every_format_gives_the_same_depths() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("a.npy"), npy("<f4", "(3, 4)", &bytes(&DEPTHS))).unwrap();
    write_npz(
        &path("a.npz"),
        &[("depth", npy("<f4", "(1, 3, 4)", &bytes(&DEPTHS))), ("conf", npy("<f4", "(1, 3, 4)", &bytes(&[1.0; 12])))],
    );
    let bottom_up: Vec<f32> = DEPTHS.chunks(4).rev().flatten().copied().collect();
    std::fs::write(path("a.pfm"), [b"Pf\n4 3\n-1.0\n".to_vec(), bytes(&bottom_up)].concat()).unwrap();
    let tiff = DriverManager::get_driver_by_name("GTiff").unwrap();
    let dataset = tiff.create_with_band_type::<f32, _>(path("a.tif"), 4, 3, 1).unwrap();
    dataset.rasterband(1).unwrap().write((0, 0), (4, 3), &mut Buffer::new((4, 3), DEPTHS.to_vec())).unwrap();
    drop(dataset);
    let millimetres: Vec<u16> = DEPTHS.iter().map(|d| (d * 1000.0) as u16).collect();
    image::ImageBuffer::<image::Luma<u16>, _>::from_raw(4, 3, millimetres).unwrap().save(path("a.png")).unwrap();

    let rows = exr::prelude::FlatSamples::F32(DEPTHS.to_vec());
    let channels = exr::prelude::AnyChannels::sort([exr::prelude::AnyChannel::new("Z", rows)].into_iter().collect());
    exr::prelude::Image::from_channels((4, 3), channels).write().to_file(path("a.exr")).unwrap();

    let unscaled = ["a.npy", "a.npz", "a.pfm", "a.tif", "a.exr"].map(|file| (file, 1.0));
    for (file, scale) in unscaled.into_iter().chain([("a.png", 0.001)]) {
        let prior = load(&path(file), &FilePriorConfig { scale, ..depth() }).unwrap();
        assert_eq!((prior.values.width(), prior.values.height()), (4, 3), "{file}");
        for (found, expected) in prior.values.data().iter().zip(DEPTHS) {
            let is_same = if expected > 0.0 { (found - expected).abs() < 1e-5 } else { found.is_nan() };
            assert!(is_same, "{file}: {found} {expected}");
        }
    }
}

#[test]
fn a_file_without_a_declared_kind_is_refused_with_how_to_tag_it() {
    let error = FilePriors::new(FilePriorConfig { kind: None, ..depth() }, []).unwrap_err().to_string();
    assert!(error.contains("kind = \"inverse_depth\"") && error.contains("MiDaS"), "{error}");
}

#[test]
fn inverse_depth_is_in_no_metres() {
    let config = FilePriorConfig { kind: Some(PriorKind::InverseDepth), unit: DepthUnit::Metre, ..depth() };
    let error = FilePriors::new(config, []).unwrap_err().to_string();
    assert!(error.contains("unit") && error.contains("kind = \"depth\""), "{error}");
}

#[test]
fn a_stack_needs_names_and_finds_each_photo_by_them() {
    let folder = tempfile::tempdir().unwrap();
    let (stack, names) = (folder.path().join("all.npz"), folder.path().join("order.txt"));
    let two: Vec<f32> = DEPTHS.iter().chain(&DEPTHS.map(|d| d + 100.0)).copied().collect();
    write_npz(&stack, &[("depth", npy("<f4", "(2, 3, 4)", &bytes(&two)))]);
    assert!(load(&stack, &depth()).unwrap_err().to_string().contains("`names`"));
    std::fs::write(&names, "b.jpg\na\n").unwrap();
    let prior = load(&stack, &FilePriorConfig { names: Some(names.clone()), ..depth() }).unwrap();
    assert_eq!(prior.values.data()[0], 110.0);
    std::fs::write(&names, "b.jpg\n").unwrap();
    let error = load(&stack, &FilePriorConfig { names: Some(names), ..depth() }).unwrap_err().to_string();
    assert!(error.contains("stack of 2") && error.contains("1 photos"), "{error}");
}

/// `fixtures/priors/da3_mini.npz`, which `NumPy` wrote: compressed, with poses as large as the maps beside them.
#[test]
fn an_export_of_depth_anything_3_is_read_by_the_names_beside_it() {
    let export = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/priors/da3_mini.npz");
    let folder = tempfile::tempdir().unwrap();
    let names = folder.path().join("names.txt");
    // The photo of the tests is the second one.
    std::fs::write(&names, "north/b.jpg\na.jpg\n").unwrap();
    let config = FilePriorConfig {
        names: Some(names.clone()),
        confidence_key: Some("conf".into()),
        min_confidence: 1.1,
        ..depth()
    };
    let prior = load(&export, &config).unwrap();
    assert_eq!((prior.values.width(), prior.values.height()), (4, 3));
    assert!(prior.values.data()[1].is_nan(), "it is little confident there");
    for (at, depth_m) in [(0, 110.0), (11, 133.0)] {
        assert!((prior.values.data()[at] - depth_m).abs() < 1e-4, "{}", prior.values.data()[at]);
    }
    let error = load(&export, &FilePriorConfig { names: None, ..config.clone() }).unwrap_err().to_string();
    assert!(error.contains("stack of 2 maps") && error.contains("`names`"), "{error}");
    std::fs::write(&names, "b.jpg\nc.jpg\n").unwrap();
    let error = load(&export, &config).unwrap_err().to_string();
    assert!(error.contains("does not list a.jpg"), "{error}");
}

#[test]
fn other_shapes_empty_maps_and_pictures_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let refused = |file: &str, words: &str| {
        let error = load(&path(file), &depth()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    std::fs::write(path("wide.npy"), npy("<f4", "(2, 6)", &bytes(&DEPTHS))).unwrap();
    refused("wide.npy", "6 × 2 pixels, the photo a.jpg 8 × 6");
    std::fs::write(path("nan.npy"), npy("<f4", "(3, 4)", &bytes(&[f32::NAN; 12]))).unwrap();
    refused("nan.npy", "no value at all");
    std::fs::write(path("flat.npy"), npy("<f4", "(3, 4)", &bytes(&[7.0; 12]))).unwrap();
    refused("flat.npy", "7 everywhere");
    image::RgbImage::new(8, 6).save(path("picture.png")).unwrap();
    refused("picture.png", "a picture of a depth map");
    std::fs::write(path("a.exe"), b"").unwrap();
    refused("a.exe", "format is unknown");
    refused("absent.npy", "does not exist");
    write_npz(&path("other.npz"), &[("x", vec![]), ("y", vec![])]);
    refused("other.npz", "x, y");
    std::fs::write(path("cut.npz"), b"PK\x03\x04").unwrap();
    refused("cut.npz", "no .npz archive");
}

#[test]
fn sides_rounded_to_fourteen_pass_and_others_do_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("da3.npy");
    // A photo of 16:9 at 504 columns: 283.5 rows, rounded to 280 by a network with patches of 14.
    let ramp: Vec<f32> = (1..=504 * 281).map(|i| i as f32).collect();
    let photo = view("a.jpg", 1920, 1080);
    let load = |rows: usize| {
        std::fs::write(&path, npy("<f4", &format!("({rows}, 504)"), &bytes(&ramp[..504 * rows]))).unwrap();
        FilePriors::new(FilePriorConfig { path: path.to_str().unwrap().to_owned(), ..depth() }, [&photo.id])
            .unwrap()
            .load(&photo)
    };
    // Off by 3 pixels both, one a multiple of the patch, one not.
    assert!(load(280).is_ok() && load(281).is_err());
    let refused = load(274).unwrap_err();
    assert!(
        refused.to_string().contains("504 × 274 pixels") && refused.to_string().contains("14 or 16 pixels"),
        "{refused}"
    );
}

#[test]
fn low_confidence_is_left_out_and_zero_disparity_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut confidences = [0.9_f32; 12];
    confidences[1] = 0.1;
    write_npz(
        &path,
        &[("depth", npy("<f4", "(3, 4)", &bytes(&DEPTHS))), ("conf", npy("<f4", "(3, 4)", &bytes(&confidences)))],
    );
    let config = FilePriorConfig { confidence_key: Some("conf".into()), min_confidence: 0.5, ..depth() };
    let prior = load(&path, &config).unwrap();
    assert!(prior.values.data()[1].is_nan() && prior.values.data()[0] == 10.0 && prior.values.data()[11].is_nan());
    let inverse = load(&path, &FilePriorConfig { kind: Some(PriorKind::InverseDepth), ..depth() }).unwrap();
    assert_eq!(inverse.values.data()[11], 0.0);
}

#[test]
fn warsaw_depths_are_read_as_measured() {
    let Some(folder) = shared_data("warsaw_ochota_photos/depth_mvs") else { return };
    let template = folder.join("{stem}.npz").to_str().unwrap().to_owned();
    let photos = ["img_3149.jpg", "img_3151.jpg", "img_3157.jpg"].map(|name| view(name, 1000, 750));
    let priors =
        FilePriors::new(FilePriorConfig::new(template, PriorKind::Depth), photos.iter().map(|v| &v.id)).unwrap();
    // Share of holes and farthest depth as numpy sees them.
    for (photo, (holes, farthest)) in photos.iter().zip([(0.238_571, 548.2), (0.521_168, 459.75), (0.116_389, 323.05)])
    {
        let prior = priors.load(photo).unwrap();
        assert_eq!((prior.values.width(), prior.values.height()), (500, 375));
        let n_holes = prior.values.data().iter().filter(|v| v.is_nan()).count();
        assert!((n_holes as f64 / 187_500.0 - holes).abs() < 1e-6, "{}", photo.id);
        let max = prior.values.data().iter().copied().filter(|v| !v.is_nan()).fold(0.0, f32::max);
        assert!((max - farthest).abs() < 0.01, "{max}");
    }
}
