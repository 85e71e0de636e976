//! Real cameras: each checked against something that does not come from the poses themselves.
//!
//! Where the data are not on the machine, these tests say `skipped`.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use gdal::vector::LayerAccess as _;
use glam::{DVec2, DVec3};
use sizeup::crs::{Crs, TrueNorth};
use sizeup::output::picture;
use sizeup::survey::{self, Format, HeightConfig, Site, SurveyConfig, Target, VerticalDatum, ViewKind};

use crate::shared_data::shared_data;

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// How the camera file of Rotterdam is to be read.
pub fn rotterdam_survey(folder: &Path) -> SurveyConfig {
    let mut config: SurveyConfig = toml::from_str(
        r#"
        format = "csv"
        path = "camera_parameters.txt"
        crs = "EPSG:7415"
        [csv]
        name = "image_id"
        angles = "opk"
        sequence = "zyx"
        direction = "world_to_camera"
        "#,
    )
    .unwrap();
    config.visit_paths(&mut |path| *path = folder.join(&*path));
    config
}

fn rotterdam() -> Option<(PathBuf, SurveyConfig)> {
    let folder = shared_data("rotterdam_oblique_cameras")?;
    let config = rotterdam_survey(&folder);
    Some((folder, config))
}

/// Distance of the worst image corner on the ground `z = 0` from its independent polygon, per image, metres.
fn corner_errors(folder: &std::path::Path, survey: &survey::Survey) -> Vec<f64> {
    let text = fs::read_to_string(folder.join("image_footprints.geojson")).unwrap();
    let layer: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut polygons = HashMap::new();
    for feature in layer["features"].as_array().unwrap() {
        let ring = feature["geometry"]["coordinates"][0].as_array().unwrap();
        let ring: Vec<DVec2> =
            ring.iter().map(|p| DVec2::new(p[0].as_f64().unwrap(), p[1].as_f64().unwrap())).collect();
        polygons.insert(feature["properties"]["image_id"].as_str().unwrap().to_owned(), ring);
    }
    let mut errors = Vec::new();
    for view in &survey.views {
        let ring = &polygons[&view.id.0];
        let (w, h) = (f64::from(view.camera.width_px), f64::from(view.camera.height_px));
        let centre = view.camera_from_map.centre();
        let distances = [DVec2::ZERO, DVec2::new(w, 0.0), DVec2::new(w, h), DVec2::new(0.0, h)].map(|pixel| {
            let ray = view.camera_from_map.inverse().vector(view.camera.unproject(pixel).unwrap());
            let ground = (centre + ray * (-centre.z / ray.z)).truncate();
            ring.iter().map(|corner| corner.distance(ground)).fold(f64::INFINITY, f64::min)
        });
        errors.push(distances.into_iter().fold(0.0, f64::max));
    }
    errors
}

#[test]
fn rotterdams_1403_cameras_see_their_independent_ground_polygons() {
    let Some((folder, config)) = rotterdam() else { return };
    let survey = survey::read(&config, &Crs::parse("EPSG:7415").unwrap()).unwrap();
    assert_eq!((survey.views.len(), survey.issues.len()), (1403, 0));
    let errors = corner_errors(&folder, &survey);
    let worst = errors.iter().copied().fold(0.0, f64::max);
    let median = median(errors);
    eprintln!("worst corners of 1403 image footprints: median error {median:.2} m, worst {worst:.2} m");
    assert!(median <= 3.0 && worst < 14.0, "median {median} m, worst {worst} m");
}

#[test]
fn the_usual_reading_of_rotterdams_angles_looks_elsewhere() {
    let Some((folder, mut config)) = rotterdam() else { return };
    let csv = config.csv.as_mut().unwrap();
    (csv.sequence, csv.direction) = (None, None);
    let survey = survey::read(&config, &Crs::parse("EPSG:7415").unwrap()).unwrap();
    assert!(median(corner_errors(&folder, &survey)) > 100.0);
    // Both readings look down, so the report cannot choose: it says so.
    let (_, report) = survey::inspect(&config, &Crs::parse("EPSG:7415").unwrap(), Site::default()).unwrap();
    assert!(report.is_sound());
    assert!(report.equally_plausible[0].change.contains("world_to_camera"), "{report}");
}

fn warsaw() -> Option<(PathBuf, SurveyConfig)> {
    let folder = shared_data("warsaw_ochota_photos")?;
    let config = SurveyConfig {
        images: Some(folder.join("images")),
        offset: [634_000.0, 485_000.0, 0.0],
        ..SurveyConfig::at(folder.join("sparse"))
    };
    Some((folder, config))
}

#[test]
fn warsaws_sparse_points_land_on_their_observations() {
    let Some((folder, config)) = warsaw() else { return };
    let survey = survey::read(&config, &Crs::parse("EPSG:2180").unwrap()).unwrap();
    assert_eq!((survey.views.len(), survey.issues.len()), (12, 0));
    assert!(survey.views.iter().all(|view| view.image.is_some()));
    assert_eq!(survey.views.iter().filter(|view| view.kind() == ViewKind::Nadir).count(), 5);

    let points: HashMap<i64, DVec3> = fs::read_to_string(folder.join("sparse/points3D.txt"))
        .unwrap()
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let mut fields = line.split(' ');
            let id = fields.next().unwrap().parse().unwrap();
            let mut next = || fields.next().unwrap().parse::<f64>().unwrap();
            (id, DVec3::new(next(), next(), next()) + DVec3::from(config.offset))
        })
        .collect();
    let images = fs::read_to_string(folder.join("sparse/images.txt")).unwrap();
    let mut lines = images.lines().filter(|line| !line.starts_with('#'));
    let mut errors = Vec::new();
    while let (Some(pose), Some(observations)) = (lines.next(), lines.next()) {
        let name = pose.rsplit(' ').next().unwrap();
        let view = survey.views.iter().find(|view| view.id.0 == name).unwrap();
        let values: Vec<f64> = observations.split(' ').map(|v| v.parse().unwrap()).collect();
        for observation in values.chunks(3) {
            let Some(&point) = points.get(&(observation[2] as i64)) else { continue };
            let pixel = view.camera.project(view.camera_from_map.point(point)).unwrap();
            errors.push(pixel.distance(DVec2::new(observation[0], observation[1])));
        }
    }
    let (n, median) = (errors.len(), median(errors));
    eprintln!("{n} observations of sparse points: median reprojection error {median:.2} px");
    assert!(n > 10_000 && median < 1.5, "{n} observations, median {median} px");
}

#[test]
fn a_photo_too_many_and_a_photo_too_few_are_told() {
    let Some((folder, mut config)) = warsaw() else { return };
    let photos = tempfile::tempdir().unwrap();
    fs::copy(folder.join("images/img_3149.jpg"), photos.path().join("img_3149.jpg")).unwrap();
    fs::write(photos.path().join("stray.jpg"), b"").unwrap();
    config.images = Some(photos.path().to_owned());
    let survey = survey::read(&config, &Crs::parse("EPSG:2180").unwrap()).unwrap();
    let count = |code: &str| survey.issues.iter().filter(|issue| issue.code == code).count();
    assert_eq!((count("pose_without_photo"), count("photo_without_pose")), (11, 1));
    assert_eq!(survey.views.len(), 12);
}

fn rtk() -> Option<(PathBuf, SurveyConfig)> {
    let folder = shared_data("dji_rtk_photo")?;
    let height = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    // Base stations in China broadcast CGCS2000; PROJ knows no accurate operation from WGS 84 to it.
    let crs = Some(Crs::parse("EPSG:4490").unwrap());
    Some((folder.clone(), SurveyConfig { format: Format::Photos, crs, height, ..SurveyConfig::at(folder) }))
}

#[test]
fn the_rtk_photo_has_its_surveyed_pose() {
    let Some((folder, config)) = rtk() else { return };
    let crs = Crs::parse("EPSG:4547").unwrap();
    let survey = survey::read(&config, &crs).unwrap();
    let view = &survey.views[0];
    // The authors' pose: 4 × 4 camera to world, in a local frame whose origin SOURCE.txt derives from this photo's own
    // easting and northing (so only the height and the angles are independent of it).
    let numbers: Vec<f64> = fs::read_to_string(folder.join("DJI_20230513163714_0033_T_pose.txt"))
        .unwrap()
        .split_ascii_whitespace()
        .map(|n| n.parse().unwrap())
        .collect();
    let centre = DVec3::new(numbers[3] + 401_446.94, numbers[7] + 3_131_257.31, numbers[11]);
    let off = view.camera_from_map.centre() - centre;
    let up = view.camera_from_map.inverse().vector(-DVec3::Y);
    // Their frame is called local and ENU-like, so its north is taken as true: the grid's convergence (0.48°) comes off
    // again. Against the grid's north the gimbal would be 0.67° off; one photo cannot tell the two apart.
    let place = view.camera_from_map.centre();
    let north = TrueNorth::of(&crs).unwrap().at(place.x, place.y).unwrap();
    let yaw_deg = up.x.atan2(up.y).to_degrees() - north.azimuth_rad.to_degrees();
    let surveyed_yaw_deg = (-numbers[1]).atan2(-numbers[5]).to_degrees();
    eprintln!("RTK photo: position off by {off}, yaw {yaw_deg:.2}° against {surveyed_yaw_deg:.2}°");
    assert!(off.length() < 1.0, "{off}");
    assert!((yaw_deg - surveyed_yaw_deg).abs() < 0.5, "{yaw_deg} against {surveyed_yaw_deg}");
    // The surveyed focal length is 1125 px; the 35 mm equivalent would say 1031 or 1098.
    assert!((view.camera.fx_px - 1125.0).abs() < 1.0, "{}", view.camera.fx_px);
}

#[test]
fn the_rtk_state_and_the_source_of_the_focal_length_are_reported() {
    let Some((_, config)) = rtk() else { return };
    let (_, report) = survey::inspect(&config, &Crs::parse("EPSG:4547").unwrap(), Site::default()).unwrap();
    assert_eq!(report.rtk.get("fixed"), Some(&1));
    assert_eq!(report.focal.keys().collect::<Vec<_>>(), ["focal length / pixel pitch"]);
    assert!(report.is_sound(), "{report}");
}

#[test]
fn photos_without_rtk_need_their_height_declared() {
    let Some(folder) = shared_data("dji_xmp_photos") else { return };
    let utm = Crs::parse("EPSG:32615").unwrap();
    let config = SurveyConfig::at(&folder);
    let refused = survey::read(&config, &utm).unwrap_err().to_string();
    assert!(refused.contains("height.reference"), "{refused}");
    let height =
        HeightConfig { reference: Some(VerticalDatum::AboveTakeoff), base: Some(2.0), ..HeightConfig::default() };
    let survey = survey::read(&SurveyConfig { height, ..config }, &utm).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(survey.views.len(), 4, "{:?}", survey.issues);
    for view in &survey.views {
        assert_eq!(view.kind(), ViewKind::Nadir);
        assert!((view.camera_from_map.centre().z - 42.0).abs() < 3.0, "RelativeAltitude is about 40 m");
        // The raster was resized to 1000 columns although EXIF still says 4000; 20 mm equivalent, 94° of diagonal.
        assert_eq!(view.camera.width_px, 1000);
        assert!((view.camera.fx_px - 530.0).abs() < 10.0, "{}", view.camera.fx_px);
        assert!(view.image.is_some());
    }
}

/// A JPEG without the segments of its header that hold XMP.
fn without_xmp(jpeg: &[u8]) -> Vec<u8> {
    let (mut kept, mut rest) = (jpeg[..2].to_vec(), &jpeg[2..]);
    while rest[1] != 0xDA {
        let length = 2 + usize::from(u16::from_be_bytes([rest[2], rest[3]]));
        if !rest[4..].starts_with(b"http://ns.adobe.com/xap/1.0/") {
            kept.extend(&rest[..length]);
        }
        rest = &rest[length..];
    }
    kept.extend(rest);
    kept
}

#[test]
fn the_maker_notes_of_drone_photos_say_what_their_xmp_says() {
    let Some(folder) = shared_data("dji_xmp_photos") else { return };
    let stripped = tempfile::tempdir().unwrap();
    let photos = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    for path in photos.filter(|path| path.extension().is_some_and(|e| e == "jpg")) {
        let photo = without_xmp(&fs::read(&path).unwrap());
        fs::write(stripped.path().join(path.file_name().unwrap()), photo).unwrap();
    }
    let utm = Crs::parse("EPSG:32615").unwrap();
    let height = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    let read = |path: &std::path::Path| {
        let config = SurveyConfig { height: height.clone(), ..SurveyConfig::at(path) };
        survey::read(&config, &utm).unwrap_or_else(|e| panic!("{e}"))
    };
    let (whole, stripped) = (read(&folder), read(stripped.path()));
    assert_eq!((whole.views.len(), stripped.views.len()), (4, 4), "{:?}", stripped.issues);
    // One of the four had its EXIF turned to the other byte order, its maker note as it was.
    for (with_xmp, without) in whole.views.iter().zip(&stripped.views) {
        let off = with_xmp.camera_from_map.rotation - without.camera_from_map.rotation;
        // Places differ by the digits of EXIF, and so does the convergence.
        assert!(off.to_cols_array().iter().all(|off| off.abs() < 1e-6), "{}: {off}", with_xmp.id);
    }
}

#[test]
fn a_wrong_declaration_is_reported_with_the_one_that_fits() {
    let Some((folder, mut config)) = rotterdam() else { return };
    let csv = config.csv.as_mut().unwrap();
    (csv.sequence, csv.direction, csv.unit) = (None, None, survey::angles::AngleUnit::Rad);
    // The area that the photos show, from the independent polygons of the first photos' surroundings.
    let right = survey::read(&rotterdam().unwrap().1, &Crs::parse("EPSG:7415").unwrap()).unwrap();
    let points: geo::MultiPoint = right
        .views
        .iter()
        .filter_map(|view| survey::ground::centre_on_ground(view, &sizeup::terrain::Terrain::Constant(0.0)))
        .map(|p| geo::Point::new(p.x, p.y))
        .collect::<Vec<_>>()
        .into();
    let area = geo::ConvexHull::convex_hull(&points);
    let site = Site { terrain: None, area: Some(&area) };
    let (_, report) = survey::inspect(&config, &Crs::parse("EPSG:7415").unwrap(), site).unwrap();
    eprintln!("{report}{}", folder.display());
    assert!(!report.is_sound());
    assert!(report.trials.iter().any(|trial| trial.change.contains("deg")), "{:?}", report.trials);
}

#[test]
fn round_trips_keep_poses_to_a_billionth() {
    let Some((_, config)) = warsaw() else { return };
    let crs = Crs::parse("EPSG:2180").unwrap();
    let original = survey::read(&config, &crs).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let terrain = sizeup::terrain::Terrain::Constant(110.0);
    for (target, name, settings) in
        [(Target::Colmap, "model", "model/survey.toml"), (Target::Csv, "poses.csv", "poses.survey.toml")]
    {
        let path = folder.path().join(name);
        survey::convert(&config, &crs, &terrain, target, &path).unwrap();
        let settings = folder.path().join(settings);
        let mut back: SurveyConfig = toml::from_str(&fs::read_to_string(&settings).unwrap()).unwrap();
        back.visit_paths(&mut |path| *path = settings.parent().unwrap().join(&*path));
        let back = survey::read(&back, &crs).unwrap();
        assert_eq!(back.views.len(), original.views.len());
        for (a, b) in original.views.iter().zip(&back.views) {
            assert_eq!((&a.id, &a.camera), (&b.id, &b.camera));
            assert!((a.camera_from_map.centre() - b.camera_from_map.centre()).length() < 1e-9, "{name}: {}", a.id);
            let turned = a.camera_from_map.rotation - b.camera_from_map.rotation;
            assert!(turned.to_cols_array().into_iter().all(|d| d.abs() < 1e-9), "{name}: {}", a.id);
        }
    }
    for (target, name) in [(Target::GeoJson, "layers.geojson"), (Target::GeoPackage, "layers.gpkg")] {
        let converted = survey::convert(&config, &crs, &terrain, target, &folder.path().join(name)).unwrap();
        assert!(converted.files.iter().all(|file| file.is_file()), "{:?}", converted.files);
    }
    let package = gdal::Dataset::open(folder.path().join("layers.gpkg")).unwrap();
    assert_eq!(package.layer_count(), 3);
    for mut layer in package.layers() {
        assert_eq!(layer.feature_count(), 12, "{}", layer.name());
        let extent = layer.get_extent().unwrap();
        assert!(
            extent.MinX > 634_000.0 && extent.MaxX < 637_000.0 && extent.MinY > 484_000.0,
            "easting before northing"
        );
        assert_eq!(layer.spatial_ref().unwrap().auth_code().unwrap(), 2180);
        let off_nadir_deg: Vec<f64> = layer
            .features()
            .map(|feature| feature.field_as_double(feature.field_index("off_nadir_deg").unwrap()).unwrap().unwrap())
            .collect();
        assert!(off_nadir_deg.iter().all(|&angle| angle < 33.0));
    }
    let layer = fs::read_to_string(folder.path().join("layers/image_footprints.geojson")).unwrap();
    let layer: serde_json::Value = serde_json::from_str(&layer).unwrap();
    assert_eq!(layer["features"].as_array().unwrap().len(), 12);
    let corner = &layer["features"][0]["geometry"]["coordinates"][0][0];
    assert!((corner[0].as_f64().unwrap() - 20.97).abs() < 0.05 && (corner[1].as_f64().unwrap() - 52.22).abs() < 0.05);
}

#[test]
fn the_picture_shows_both_kinds_of_view() {
    let Some((_, config)) = warsaw() else { return };
    let survey = survey::read(&config, &Crs::parse("EPSG:2180").unwrap()).unwrap();
    let ground = sizeup::terrain::Terrain::Constant(110.0);
    let map = picture::survey_map(&survey, Some(&ground), &Crs::parse("EPSG:2180").unwrap());
    let n_of = |colour: [u8; 3]| map.pixels().filter(|pixel| pixel.0 == colour).count();
    assert!(n_of([0, 114, 178]) > 50 && n_of([213, 94, 0]) > 50, "nadir blue, oblique orange");
    if let Some(keep) = std::env::var_os("SIZEUP_KEEP_PICTURES") {
        picture::write_png(&PathBuf::from(keep).join("survey_warsaw.png"), &map).unwrap();
    }
}

#[test]
fn a_thousand_photos_are_a_thousand_views() {
    let Some(source) = shared_data("dji_xmp_photos") else { return };
    let folder = tempfile::tempdir().unwrap();
    for i in 0..1000 {
        std::os::unix::fs::symlink(source.join("DJI_0018.jpg"), folder.path().join(format!("{i:04}.jpg"))).unwrap();
    }
    let height = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    let config = SurveyConfig { height, ..SurveyConfig::at(folder.path()) };
    let survey = survey::read(&config, &Crs::parse("EPSG:32615").unwrap()).unwrap();
    assert_eq!(survey.views.len(), 1000);
}

#[test]
fn a_datum_without_a_way_to_wgs_84_still_gets_its_layers() {
    let Some((_, config)) = rtk() else { return };
    let folder = tempfile::tempdir().unwrap();
    let crs = Crs::parse("EPSG:4547").unwrap();
    let terrain = sizeup::terrain::Terrain::Constant(24.0);
    let path = folder.path().join("layers.geojson");
    let converted = survey::convert(&config, &crs, &terrain, Target::GeoJson, &path).unwrap();
    assert_eq!(converted.files.len(), 3);
    let text = fs::read_to_string(folder.path().join("layers/camera_points.geojson")).unwrap();
    assert!(text.contains("112.99058") && text.contains("28.29496"), "{text}");
}
