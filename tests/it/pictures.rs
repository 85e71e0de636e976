//! Pictures are drawn, and left in the target folder's `tmp/pictures` for people to look at.

use std::path::PathBuf;
use std::sync::Arc;

use geo::polygon;
use glam::{DMat3, DVec2, DVec3};
use image::{Rgb, RgbImage};
use sizeup::camera::Camera;
use sizeup::frames::{Cam, Map, Rigid};
use sizeup::output::picture::{
    MapConfig, OverlayConfig, PanelConfig, PanelDepths, Polyline, depth_panel, map, overlay, write_png,
};
use sizeup::output::picture::{PicturedPair, beside, pairs_picture};
use sizeup::output::{BuildingRecord, Status};
use sizeup::prior::PriorKind;
use sizeup::raster::Raster;
use sizeup::survey::{Survey, View};

use crate::outputs::{Town, building, town};

fn keep(name: &str, picture: &RgbImage) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("pictures").join(name);
    write_png(&path, picture).unwrap();
    path
}

/// 14 × 10 plots with houses, a few towers, some without a height, and cameras on a grid looking five ways.
fn large_town() -> Town {
    let mut town = town();
    let (e, n) = (93_000.0, 436_000.0);
    let mut records: Vec<BuildingRecord> = Vec::new();
    for i in 0..140_u32 {
        let (col, row) = (i % 14, i / 14);
        let (x, y) = (e + 46.0 * f64::from(col), n + 52.0 * f64::from(row) + 6.0 * f64::from(col % 3));
        let (w, h) = (14.0 + f64::from((i * 7) % 19), 16.0 + f64::from((i * 5) % 23));
        let footprint = if i % 9 == 4 {
            polygon!(
                exterior: [(x: x, y: y), (x: x + 36.0, y: y), (x: x + 36.0, y: y + 38.0), (x: x, y: y + 38.0)],
                interiors: [[(x: x + 11.0, y: y + 11.0), (x: x + 11.0, y: y + 27.0), (x: x + 25.0, y: y + 27.0), (x: x + 25.0, y: y + 11.0)]],
            )
        } else {
            polygon![(x: x, y: y), (x: x + w, y: y - 2.0), (x: x + w, y: y + h), (x: x + w / 2.0, y: y + h), (x: x + w / 2.0, y: y + h * 0.7), (x: x, y: y + h * 0.7)]
        };
        let height = match i % 23 {
            7 => None,
            11 => Some(64.0),
            _ => Some(4.0 + f64::from((i * 13) % 17)),
        };
        let status = match (height, i % 12) {
            (None, _) => Status::Unknown,
            (_, 5) => Status::Doubtful,
            _ => Status::Measured,
        };
        records.push(building(&format!("b{i}"), Some(footprint), height, status));
    }
    let down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
    let camera = Arc::new(Camera::pinhole(6000, 4000, 5000.0));
    let mut views = Vec::new();
    for i in 0..60_u32 {
        let heading = f64::from(i % 5) * std::f64::consts::FRAC_PI_2;
        let tilt = if i % 5 == 4 { 0.0 } else { 0.75 };
        let rotation = DMat3::from_rotation_x(tilt) * down * DMat3::from_rotation_z(heading);
        let centre = DVec3::new(e - 60.0 + 80.0 * f64::from(i % 10), n - 60.0 + 110.0 * f64::from(i / 10), 130.0);
        let camera_from_map: Rigid<Cam, Map> = Rigid::from_rotation_and_centre(rotation, centre);
        views.push(View {
            id: format!("{i:03}.jpg").as_str().into(),
            camera: camera.clone(),
            camera_from_map,
            image: None,
        });
    }
    town.records = records;
    town.survey = Survey { views, issues: Vec::new() };
    town
}

#[test]
fn the_map_shows_every_status_and_is_the_same_every_time() {
    let town = large_town();
    let picture = map(&town.model(), &MapConfig::default());
    keep("map.png", &picture);
    assert_eq!(picture, map(&town.model(), &MapConfig::default()));
    assert_eq!(picture.width(), 1600);
    let n_coloured = picture.pixels().filter(|p| p[0].abs_diff(p[1]) > 30 || p[1].abs_diff(p[2]) > 30).count();
    assert!(n_coloured > 50_000, "{n_coloured}");
}

#[test]
fn only_doubtful_heights_are_marked_on_the_map_and_no_camera_is_drawn() {
    // Vermilion, as it is drawn over whatever is below.
    let n_marked = |town: &Town| {
        let picture = map(&town.model(), &MapConfig::default());
        picture.pixels().filter(|p| p[0] > 180 && p[1].abs_diff(94) < 40 && p[2] < 60).count()
    };
    let mut town = large_town();
    let of_status = |town: &mut Town, status| town.records.iter_mut().for_each(|record| record.status = status);
    of_status(&mut town, Status::Fallback);
    assert_eq!(n_marked(&town), 0);
    town.records[0].status = Status::Doubtful;
    assert!(n_marked(&town) > 50, "{}", n_marked(&town));
    let with_cameras = map(&town.model(), &MapConfig::default());
    town.survey.views.clear();
    assert_eq!(with_cameras, map(&town.model(), &MapConfig::default()));
}

#[test]
fn a_map_of_nothing_is_still_a_map() {
    let mut town = town();
    town.records.clear();
    town.survey.views.clear();
    keep("map_empty.png", &map(&town.model(), &MapConfig::default()));
}

#[test]
fn small_maps_scale_down() {
    let picture = map(&town().model(), &MapConfig { width_px: 800, ..MapConfig::default() });
    keep("map_small.png", &picture);
    assert_eq!(picture.width(), 800);
}

/// A photo-like ramp and a depth map of a block on a plane.
fn block_scene() -> (RgbImage, Raster<f32>, Raster<f32>) {
    let (w, h) = (600_u32, 400_u32);
    let is_block = |x: u32, y: u32| (220..380).contains(&x) && (130..290).contains(&y);
    let photo = RgbImage::from_fn(w, h, |x, y| {
        let v = (90 + (x / 8 + y / 8) % 2 * 14 + y / 6) as u8;
        Rgb(if is_block(x, y) { [v + 60, v + 30, v] } else { [v, v + 16, v] })
    });
    let depth = |x: u32, y: u32| 140.0 - 0.15 * y as f32 - if is_block(x, y) { 24.0 } else { 0.0 };
    let values =
        |f: &dyn Fn(u32, u32) -> f32| (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect();
    let rendered =
        Raster::from_vec(w as usize, h as usize, values(&|x, y| if y < 12 { f32::NAN } else { depth(x, y) })).unwrap();
    let prior = Raster::from_vec(w as usize, h as usize, values(&|x, y| 50.0 / depth(x, y) + 0.02)).unwrap();
    (photo, rendered, prior)
}

#[test]
fn an_inverse_prior_is_turned_so_that_near_looks_alike() {
    let (photo, rendered, prior) = block_scene();
    let depths = PanelDepths { rendered_m: &rendered, prior: &prior, prior_kind: PriorKind::InverseDepth };
    let panel = depth_panel(&photo, &depths, "IMG_0042.jpg, 18 of 140 buildings", &PanelConfig::default());
    keep("depth_panel.png", &panel);
    // In both depth pictures the block is lighter (nearer) than the ground to its left.
    let lightness =
        |i: u32, x: u32| panel.get_pixel(16 + x + i * (640 + 16), 74 + 210).0.map(u32::from).iter().sum::<u32>();
    for i in [1, 2] {
        assert!(lightness(i, 320) > lightness(i, 120) + 100, "{} {}", lightness(i, 320), lightness(i, 120));
    }
}

#[test]
fn edges_are_drawn_over_the_photo_and_cut_at_its_rim() {
    let (photo, ..) = block_scene();
    let camera = Camera::pinhole(600, 400, 500.0);
    let corner = |x: f64, y: f64, z: f64| camera.project(DVec3::new(x, y, z)).unwrap_or(DVec2::NAN).to_array();
    let ring = |z: f64| {
        [(-18.0, -16.0), (18.0, -16.0), (18.0, 20.0), (-18.0, 20.0), (-18.0, -16.0)].map(|(x, y)| corner(x, y, z))
    };
    let mut lines = vec![
        Polyline { points_px: ring(110.0).to_vec(), colour: [0, 158, 115] },
        Polyline { points_px: ring(86.0).to_vec(), colour: [0, 158, 115] },
    ];
    lines.push(Polyline { points_px: vec![[-500.0, 200.0], [900.0, 250.0]], colour: [213, 94, 0] });
    let key: [(&str, [u8; 3]); 2] = [("measured prism", [0, 158, 115]), ("reference", [213, 94, 0])];
    let picture = overlay(&photo, &lines, &key, &OverlayConfig::default());
    keep("overlay.png", &picture);
    assert_eq!(picture.dimensions(), (600, 400));
}

#[test]
fn ordinal_pairs_that_cost_something_are_drawn_in_their_colour() {
    let photo = image::RgbImage::from_pixel(64, 48, image::Rgb([10, 10, 10]));
    let pair = |cost| PicturedPair { ends: [[0.1, 0.1], [0.9, 0.9]], cost };
    // Vermilion on a grey photo: far more red than blue, thin and smoothed as the line is.
    let n_red = |pairs: &[PicturedPair]| {
        let drawn = pairs_picture(&photo, pairs, 320);
        let picture = drawn.rows().skip(74).take(240).flatten();
        picture.filter(|p| i32::from(p.0[0]) - i32::from(p.0[2]) > 60).count()
    };
    assert_eq!(n_red(&[pair(0.0)]), 0);
    // The diagonal of 256 × 192 px is crossed by at least one pixel per column.
    assert!(n_red(&[pair(0.4)]) >= 250, "{}", n_red(&[pair(0.4)]));
    assert_eq!(beside(&photo, &image::RgbImage::new(10, 100)).dimensions(), (74, 100));
}
