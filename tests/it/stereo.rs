//! Depth from photos alone: on a scene whose every depth is known, and on real photos against measured depth.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{DMat3, DQuat, DVec2, DVec3};
use sizeup::camera::{Camera, Distortion};
use sizeup::frames::Rigid;
use sizeup::prior::{
    DepthPrior, FilePriorConfig, FilePriors, PriorKind, PriorSource as _, StereoConfig, StereoPriors,
    ground_correlation, judge_tag,
};
use sizeup::raster::Raster;
use sizeup::stats::{mean, median, quantile};
use sizeup::survey::View;
use sizeup::terrain::Terrain;

use crate::shared_data::shared_data;
use crate::warsaw;

/// A block of 24 × 24 × 16 m on level ground at z = 10 m.
const BLOCK_M: (f64, f64) = (12.0, 26.0);
const GROUND_Z_M: f64 = 10.0;

/// Depth along `ray` (z = 1 in the camera, so the factor is z-depth) and brightness, or the sky.
fn trace(centre: DVec3, ray: DVec3) -> (f64, f64) {
    let (half, roof_z) = BLOCK_M;
    let ground = (GROUND_Z_M - centre.z) / ray.z;
    let roof = (roof_z - centre.z) / ray.z;
    let on_roof = centre + roof * ray;
    if on_roof.x.abs() < half && on_roof.y.abs() < half {
        return (roof, texture(on_roof.x, on_roof.y, 1));
    }
    let wall = |axis: usize| {
        [-half, half].into_iter().filter_map(move |plane| {
            let depth = (plane - centre[axis]) / ray[axis];
            let at = centre + depth * ray;
            let is_on = depth > 0.0 && depth < ground && at[1 - axis].abs() < half && at.z < roof_z;
            is_on.then(|| (depth, texture(at[1 - axis], at.z, 2 + axis as u32)))
        })
    };
    let nearest = wall(0).chain(wall(1)).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.unwrap_or_else(|| {
        let at = centre + ground * ray;
        (ground, texture(at.x, at.y, 0))
    })
}

/// Value noise of two sizes, 0 to 255.
fn texture(x: f64, y: f64, surface: u32) -> f64 {
    let hash = |i: i64, j: i64| {
        let mut h = (i.wrapping_mul(0x9e37) ^ j.wrapping_mul(0x85eb_ca6b) ^ i64::from(surface) << 20) as u64;
        h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d_9e37_79b9);
        ((h ^ (h >> 31)) & 0xffff) as f64 / 65535.0
    };
    let noise = |size: f64| {
        let (u, v) = (x / size, y / size);
        let (i, j) = (u.floor(), v.floor());
        let at = |di: i64, dj: i64| hash(i as i64 + di, j as i64 + dj);
        let (fu, fv) = (u - i, v - j);
        let top = at(0, 0) + (at(1, 0) - at(0, 0)) * fu;
        let bottom = at(0, 1) + (at(1, 1) - at(0, 1)) * fu;
        top + (bottom - top) * fv
    };
    40.0 + 80.0 * noise(1.3) + 80.0 * noise(4.0)
}

/// Looks from `centre` at the foot of the block.
fn view(folder: &Path, name: &str, centre: DVec3, distortion: Distortion) -> (View, Raster<f64>) {
    view_of_size((448, 336), folder, name, centre, distortion)
}

/// The same view with more pixels, or fewer; each holds the brightness at its middle.
fn view_of_size(
    (width, height): (u32, u32),
    folder: &Path,
    name: &str,
    centre: DVec3,
    distortion: Distortion,
) -> (View, Raster<f64>) {
    let forward = (DVec3::new(0.0, 0.0, GROUND_Z_M) - centre).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let camera = Camera { distortion, ..Camera::pinhole(width, height, 480.0 / 448.0 * f64::from(width)) };
    let mut depths = Raster::filled(width as usize, height as usize, 0.0);
    let mut photo = image::GrayImage::new(width, height);
    for (x, y, pixel) in photo.enumerate_pixels_mut() {
        let ray = camera.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
        let (depth, brightness) = trace(centre, rotation.transpose() * ray);
        depths[(x as usize, y as usize)] = depth;
        pixel.0[0] = brightness as u8;
    }
    let path = folder.join(name);
    photo.save(&path).unwrap();
    let camera_from_map = Rigid::from_rotation_and_centre(rotation, centre);
    (View { id: name.into(), camera: Arc::new(camera), camera_from_map, image: Some(path) }, depths)
}

#[test]
fn roofs_and_ground_of_a_known_scene_come_out_to_a_fraction_of_a_metre() {
    let folder = tempfile::tempdir().unwrap();
    let lens = Distortion::Brown { k1: -0.05, k2: 0.02, k3: 0.0, p1: 5e-4, p2: 1e-4 };
    let places = [(0.0, -60.0), (25.0, -58.0), (-25.0, -58.0), (0.0, -90.0), (3.0, -35.0)];
    let (views, truths): (Vec<View>, Vec<Raster<f64>>) = places
        .iter()
        .enumerate()
        .map(|(i, &(x, y))| view(folder.path(), &format!("{i}.png"), DVec3::new(x, y, 110.0), lens.clone()))
        .unzip();
    let terrain = Terrain::Constant(GROUND_Z_M);
    let priors = StereoPriors::new(StereoConfig { max_height_m: 40.0, ..StereoConfig::default() }, &views, &terrain);
    let priors = priors.unwrap();
    let started = Instant::now();
    let prior = priors.load(&views[0]).unwrap();
    let wall_s = started.elapsed().as_secs_f64();

    let (mut on_roof, mut on_ground) = (Vec::new(), Vec::new());
    let to_map = views[0].camera_from_map.inverse();
    for row in 0..336 {
        for col in 0..448 {
            let ray = views[0].camera.unproject(DVec2::new(col as f64 + 0.5, row as f64 + 0.5)).unwrap();
            let (truth, found) = (truths[0][(col, row)], f64::from(prior.values[(col, row)]));
            let true_z = to_map.point(truth * ray).z;
            let error_m = to_map.point(found * ray).z - true_z;
            if (true_z - BLOCK_M.1).abs() < 1e-6 {
                on_roof.push(error_m);
            } else if (true_z - GROUND_Z_M).abs() < 1e-6 {
                on_ground.push(error_m);
            }
        }
    }
    for (what, errors_m) in [("roof", &on_roof), ("ground", &on_ground)] {
        let present: Vec<f64> = errors_m.iter().copied().filter(|e| !e.is_nan()).map(f64::abs).collect();
        let coverage = present.len() as f64 / errors_m.len() as f64;
        let (middle, p90) = (median(&present).unwrap(), quantile(&present, 0.9).unwrap());
        println!("{what}: coverage {coverage:.3}, |error| median {middle:.3} m, P90 {p90:.3} m; {wall_s:.2} s");
        assert!(coverage > 0.9 && middle < 0.15 && p90 < 0.6, "{what}: {coverage} {middle} {p90}");
    }
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = one_thread.install(|| priors.load(&views[0])).unwrap();
    let is_same = again.values.data().iter().zip(prior.values.data()).all(|(a, b)| a.to_bits() == b.to_bits());
    assert!(is_same, "the same on one thread as on many, bit by bit");
}

/// Half a pixel between photo and depth map, or a shift when a photo is reduced, would raise or lower everything: tested
/// where that is not a whole number of times, by way of a JPEG's own half size (1000 × 750 → 500 × 375 → 448 × 336).
#[test]
fn reducing_photos_raises_and_lowers_nothing() {
    let folder = tempfile::tempdir().unwrap();
    // From one side only: a shift of the image is then a change of height.
    let places = [(0.0, -60.0), (28.0, -60.0), (14.0, -95.0)];
    let mut found_m = Vec::new();
    for (size, ending) in [((448, 336), "png"), ((1000, 750), "png"), ((1000, 750), "jpg")] {
        let views: Vec<View> = places
            .iter()
            .enumerate()
            .map(|(i, &(x, y))| {
                let name = format!("{i}_{}.{ending}", size.0);
                view_of_size(size, folder.path(), &name, DVec3::new(x, y, 110.0), Distortion::None).0
            })
            .collect();
        let terrain = Terrain::Constant(GROUND_Z_M);
        let config = StereoConfig { max_height_m: 40.0, long_side_px: 448, ..StereoConfig::default() };
        let prior = StereoPriors::new(config, &views, &terrain).unwrap().load(&views[0]).unwrap();
        let (camera, to_map) = (views[0].camera.resized(448, 336), views[0].camera_from_map.inverse());
        let rotation = views[0].camera_from_map.rotation.transpose();
        let (mut on_roof, mut on_ground) = (Vec::new(), Vec::new());
        for (i, found) in prior.values.data().iter().enumerate().filter(|(_, found)| !found.is_nan()) {
            let ray = camera.unproject(DVec2::new((i % 448) as f64 + 0.5, (i / 448) as f64 + 0.5)).unwrap();
            let (depth, _) = trace(DVec3::new(places[0].0, places[0].1, 110.0), rotation * ray);
            let true_z = to_map.point(depth * ray).z;
            let error_m = to_map.point(f64::from(*found) * ray).z - true_z;
            if (true_z - BLOCK_M.1).abs() < 1e-6 {
                on_roof.push(error_m);
            } else if (true_z - GROUND_Z_M).abs() < 1e-6 {
                on_ground.push(error_m);
            }
        }
        let (roof_m, ground_m) = (median(&on_roof).unwrap(), median(&on_ground).unwrap());
        println!("{} px, {ending}: roof {roof_m:+.3} m, ground {ground_m:+.3} m", size.0);
        // A pixel is 0.25 m here and rays meet under some 15°: half a pixel is half a metre.
        assert!(roof_m.abs() < 0.1 && ground_m.abs() < 0.1, "{size:?} {ending}: {roof_m} {ground_m}");
        found_m.push((roof_m, ground_m));
    }
    // What the sizes have in common is of the matching. Each photo says between which heights its planes lie, and a height
    // between two planes half a metre apart is right to a tenth of that: a tenth of what half a pixel would do.
    for (roof_m, ground_m) in &found_m {
        assert!((roof_m - found_m[0].0).abs() < 0.05 && (ground_m - found_m[0].1).abs() < 0.05, "{found_m:?}");
    }
}

/// Raw poses of a drone. Neighbours then lie several pixels beside the lines on which they are looked for.
#[test]
fn poses_off_by_a_third_of_a_degree_still_give_relief() {
    let folder = tempfile::tempdir().unwrap();
    let places = [(0.0, -60.0), (25.0, -58.0), (-25.0, -58.0), (0.0, -90.0), (3.0, -35.0)];
    // Turns of 0.3° about axes without a pattern, in each camera's frame.
    let axes = [(0.2, -0.7, 0.4), (-0.9, 0.3, 0.1), (0.5, 0.6, -0.6), (0.8, -0.2, 0.5), (-0.4, -0.8, -0.3)];
    let views: Vec<View> = places
        .iter()
        .zip(axes)
        .enumerate()
        .map(|(i, (&(x, y), (a, b, c)))| {
            let name = format!("{i}.png");
            let (mut view, _) = view(folder.path(), &name, DVec3::new(x, y, 110.0), Distortion::None);
            let turn = DQuat::from_axis_angle(DVec3::new(a, b, c).normalize(), 0.3_f64.to_radians());
            let turned = DMat3::from_quat(turn) * view.camera_from_map.rotation;
            view.camera_from_map = Rigid::from_rotation_and_centre(turned, view.centre());
            view
        })
        .collect();
    let config = StereoConfig { max_height_m: 40.0, ..StereoConfig::default() };
    let priors = StereoPriors::new(config, &views, &Terrain::Constant(GROUND_Z_M)).unwrap();
    let prior = priors.load(&views[0]).unwrap();
    let (_, truth) = view(folder.path(), "0.png", DVec3::new(0.0, -60.0, 110.0), Distortion::None);
    // Depths along the true rays: the view's own turn moves all alike.
    let (mut on_roof, mut on_ground, mut n) = (Vec::new(), Vec::new(), [0_usize; 2]);
    let forward = (DVec3::new(0.0, 0.0, GROUND_Z_M) - DVec3::new(0.0, -60.0, 110.0)).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let to_map = DMat3::from_cols(right, forward.cross(right), forward);
    for i in 0..448 * 336 {
        let pixel = DVec2::new((i % 448) as f64 + 0.5, (i / 448) as f64 + 0.5);
        let ray = to_map * views[0].camera.unproject(pixel).unwrap();
        let z = 110.0 + truth.data()[i] * ray.z;
        let error_m = f64::from(prior.values.data()[i]) * ray.z + 110.0 - z;
        let is_roof = (z - BLOCK_M.1).abs() < 1e-6;
        if is_roof || (z - GROUND_Z_M).abs() < 1e-6 {
            n[usize::from(is_roof)] += 1;
            let of_surface = if is_roof { &mut on_roof } else { &mut on_ground };
            of_surface.extend((!error_m.is_nan()).then_some(error_m));
        }
    }
    let shares = [on_ground.len() as f64 / n[0] as f64, on_roof.len() as f64 / n[1] as f64];
    let (roof_m, ground_m) = (median(&on_roof).unwrap(), median(&on_ground).unwrap());
    println!("ground {:.2} of pixels, {ground_m:+.2} m; roof {:.2} of pixels, {roof_m:+.2} m", shares[0], shares[1]);
    // The block is 16 m high; a turn of 0.3° alone makes 3 % of a height, and half a degree between two photos 5 %.
    assert!(shares[0] > 0.7 && shares[1] > 0.7, "{shares:?}");
    assert!((roof_m - ground_m).abs() < 1.0, "{roof_m} {ground_m}");
}

#[test]
fn a_photo_without_company_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (alone, _) = view(folder.path(), "a.png", DVec3::new(0.0, -60.0, 110.0), Distortion::None);
    let views = [alone];
    let priors = StereoPriors::new(StereoConfig::default(), &views, &Terrain::Constant(GROUND_Z_M)).unwrap();
    assert!(priors.load(&views[0]).unwrap_err().to_string().contains("overlap"));
    assert!(
        StereoPriors::new(StereoConfig { long_side_px: 8, ..StereoConfig::default() }, &views, &Terrain::Constant(0.0))
            .is_err()
    );
}

/// Measured depth maps of the same photos, read as what they are or as what they are not.
fn measured(folder: &Path, views: &[View], kind: PriorKind) -> FilePriors {
    let template = folder.join("depth_mvs/{stem}.npz").to_str().unwrap().to_owned();
    FilePriors::new(FilePriorConfig::new(template, kind), views.iter().map(|v| &v.id)).unwrap()
}

#[test]
fn warsaw_from_its_photos_agrees_with_its_measured_depth() {
    let Some(folder) = shared_data("warsaw_ochota_photos") else { return };
    let views = warsaw::views(&folder);
    let measured = measured(&folder, &views, PriorKind::Depth);
    let config = StereoConfig { max_height_m: 40.0, ..StereoConfig::default() };
    let priors = StereoPriors::new(config, &views, &Terrain::Constant(111.0)).unwrap();
    let (mut medians, mut complete, mut within_1_m) = (Vec::new(), Vec::new(), Vec::new());
    for view in &views {
        let started = Instant::now();
        let prior = priors.load(view).unwrap();
        let wall_s = started.elapsed().as_secs_f64();
        let truth = measured.load(view).unwrap();
        let (mut errors, mut n_found, mut n_known, mut n_near) = (Vec::new(), 0, 0, 0);
        let (width, height) = (prior.values.width(), prior.values.height());
        for i in 0..width * height {
            let found = prior.values.data()[i];
            n_found += usize::from(!found.is_nan());
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let small = view.camera.resized(width as u32, height as u32);
            let expected = truth.value_at(&small, DVec2::new(x, y));
            let is_both = !found.is_nan() && !expected.is_nan();
            n_known += usize::from(!expected.is_nan());
            n_near += usize::from((found - expected).abs() < 1.0);
            errors.extend(is_both.then(|| f64::from((found - expected).abs() / expected)));
        }
        let share = n_found as f64 / (width * height) as f64;
        let within = errors.iter().filter(|e| **e < 0.01).count() as f64 / errors.len() as f64;
        medians.push(median(&errors).unwrap());
        complete.push(errors.len() as f64 / n_known as f64);
        within_1_m.push(n_near as f64 / errors.len() as f64);
        println!(
            "{}: {share:.2} of pixels, within 1 m {:.3} of {:.3}, relative error median {:.4}, P90 {:.4}, within 1 % {within:.2}, {wall_s:.2} s",
            view.id,
            within_1_m[within_1_m.len() - 1],
            complete[complete.len() - 1],
            median(&errors).unwrap(),
            quantile(&errors, 0.9).unwrap()
        );
        picture(&prior, &PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("stereo_{}.png", view.id)));
    }
    assert!(median(&medians).unwrap() < 0.01, "{medians:?}");
    // Where a learned multi-view network has depth there (0.58 of the pixels), 0.67 of it is within a metre.
    let (complete, within_1_m) = (mean(&complete).unwrap(), mean(&within_1_m).unwrap());
    println!("of the measured pixels {complete:.3} have depth, {within_1_m:.3} of these within 1 m");
    assert!(complete > 0.58 && within_1_m > 0.67, "{complete} {within_1_m}");
}

/// For looking at: near is bright, missing is black.
fn picture(prior: &DepthPrior, path: &Path) {
    let values: Vec<f64> = prior.values.data().iter().map(|v| f64::from(*v)).collect();
    let (near, far) = (quantile(&values, 0.01).unwrap(), quantile(&values, 0.99).unwrap());
    let grey =
        |v: &f64| if v.is_nan() { 0 } else { (255.0 - 225.0 * ((v - near) / (far - near)).clamp(0.0, 1.0)) as u8 };
    let (width, height) = (prior.values.width() as u32, prior.values.height() as u32);
    image::GrayImage::from_raw(width, height, values.iter().map(grey).collect()).unwrap().save(path).unwrap();
}

#[test]
fn a_wrong_tag_on_warsaw_is_caught() {
    let Some(folder) = shared_data("warsaw_ochota_photos") else { return };
    let views = warsaw::views(&folder);
    let terrain = Terrain::Constant(111.0);
    // Its holes are zeros: none of a depth's values, and a value like any other of an inverse depth.
    let correlations = |kind: PriorKind| -> Vec<_> {
        let priors = measured(&folder, &views, kind);
        views.iter().filter_map(|view| ground_correlation(&priors.load(view).unwrap(), view, &terrain)).collect()
    };
    let right = correlations(PriorKind::Depth);
    println!("{right:?}");
    assert!(right.len() >= 7, "all obliques tell");
    assert_eq!(judge_tag(&right), None);
    let wrong = correlations(PriorKind::InverseDepth);
    println!("{wrong:?}");
    assert_eq!(judge_tag(&wrong).unwrap().code, "prior_looks_inverted");
}
