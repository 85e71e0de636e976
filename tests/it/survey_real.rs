//! Real cameras: each checked against something that does not come from the poses themselves.
//!
//! The data lies beside the repository, in `../shared/data`; where it does not, these tests say `skipped`.

use std::collections::HashMap;
use std::fs;
use std::path::PathBuf;

use glam::{DVec2, DVec3};
use sizeup::crs::Crs;
use sizeup::survey::{self, SurveyConfig, ViewKind};

/// A folder of the shared data, or `None` (and a note) where it is absent.
fn data(folder: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(folder);
    let found = path.is_dir().then_some(path);
    if found.is_none() {
        eprintln!("skipped: ../shared/data/{folder} is absent");
    }
    found
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn rotterdam() -> Option<(PathBuf, SurveyConfig)> {
    let folder = data("rotterdam_oblique_cameras")?;
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
    config.resolve_paths(&folder);
    Some((folder, config))
}

/// Largest distance of an image corner on the ground `z = 0` from its independent polygon, per image, metres.
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
        let largest = [DVec2::ZERO, DVec2::new(w, 0.0), DVec2::new(w, h), DVec2::new(0.0, h)]
            .map(|pixel| {
                let ray = view.camera_from_map.inverse().vector(view.camera.unproject(pixel).unwrap());
                let ground = (centre + ray * (-centre.z / ray.z)).truncate();
                ring.iter().map(|corner| corner.distance(ground)).fold(f64::INFINITY, f64::min)
            })
            .into_iter()
            .fold(0.0, f64::max);
        errors.push(largest);
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
    eprintln!("corners of 1403 image footprints: median error {median:.2} m, worst {worst:.2} m");
    assert!(median <= 3.0 && worst < 12.0, "median {median} m, worst {worst} m");
}

#[test]
fn the_usual_reading_of_rotterdams_angles_looks_elsewhere() {
    let Some((folder, mut config)) = rotterdam() else { return };
    let csv = config.csv.as_mut().unwrap();
    (csv.sequence, csv.direction) = (None, None);
    let survey = survey::read(&config, &Crs::parse("EPSG:7415").unwrap()).unwrap();
    assert!(median(corner_errors(&folder, &survey)) > 100.0);
}

fn warsaw() -> Option<(PathBuf, SurveyConfig)> {
    let folder = data("warsaw_ochota_photos")?;
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
