//! Scenes as they are: simulated here, or read from a user's photos, poses, footprints and heights.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::DynamicImage;
use image::imageops::FilterType;
use sizeup_geo::crs::Crs;
use sizeup_geo::terrain::{self, MapBox};
use sizeup_heights::ids::{BuildingId, ViewId};
use sizeup_photos::prior::{FilePriors, PriorKind, PriorSource as _};
use sizeup_survey::{View, ViewKind};
use sizeup_truth::simulate::{self, SimulateConfig, SimulatedTown, VisibleWorld};

use super::{PhotosConfig, SceneConfig};
use crate::TrainError;

/// How far beyond the cameras the ground is needed, in flying heights.
const GROUND_MARGIN: f64 = 1.5;

/// A scene whose photos and depth lie in the set.
pub(super) struct Source {
    pub world: SimulatedTown,
    pub sight: VisibleWorld,
    /// Near-nadir views at the size of the set's photos, with their files.
    pub views: Vec<View>,
    /// What the numbers of `priors/*.npy` are, where there are any.
    pub prior: Option<PriorKind>,
    /// Where all buildings are drawn.
    pub complete_m: Option<[f64; 4]>,
    /// What is to be said of it.
    pub notes: Vec<String>,
}

impl Source {
    /// Gets a scene's photos and depth into `folder`.
    pub fn prepare(scene: &SceneConfig, folder: &Path, progress: &dyn Fn(usize, usize)) -> Result<Self, TrainError> {
        match (&scene.simulate, &scene.photos) {
            (Some(config), None) => simulated(scene, config, folder, progress),
            (None, Some(config)) => own(scene, config, folder),
            _ => Err(TrainError::config(
                format!("scene {:?} has both `simulate` and `photos`, or neither", scene.name),
                "a scene is simulated, or made of photos of your own",
            )),
        }
    }
}

fn simulated(
    scene: &SceneConfig,
    config: &SimulateConfig,
    folder: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<Source, TrainError> {
    let failed = TrainError::scene(&scene.name);
    let mut config = config.clone();
    // Its masks would be the labels once more.
    config.masks.enabled = false;
    config.images.enabled = true;
    let world = simulate::world(&config).map_err(&failed)?;
    let mut views = simulate::plan(&config, &world);
    views.retain(|view| view.kind() == ViewKind::Nadir);
    simulate::simulate_with_views(&config, &views, folder, progress).map_err(failed)?;
    for view in &mut views {
        view.image = Some(folder.join("images").join(&view.id.0));
    }
    let sight = VisibleWorld::of_simulation(&config, &world);
    Ok(Source { world, sight, views, prior: Some(config.prior.kind), complete_m: None, notes: Vec::new() })
}

fn own(scene: &SceneConfig, config: &PhotosConfig, folder: &Path) -> Result<Source, TrainError> {
    let name = scene.name.as_str();
    let crs = Crs::parse(&config.crs).map_err(TrainError::scene(name))?;
    let survey = sizeup_survey::read(&config.survey, &crs).map_err(TrainError::scene(name))?;
    let mut notes: Vec<String> = survey.issues.iter().map(|issue| issue.message.clone()).collect();
    let n_all = survey.views.len();
    let mut views: Vec<View> = survey.views.into_iter().filter(|v| v.kind() == ViewKind::Nadir).collect();
    if views.is_empty() {
        return Err(TrainError::scene(name)(format!(
            "none of its {n_all} photos looks nearly straight down (within 15 degrees)\n\
             hint: networks of footprints learn from near-nadir photos; check the poses with `sizeup survey inspect`"
        )));
    }
    if views.len() < n_all {
        notes.push(format!("{} of {n_all} photos are not near-nadir and are left out", n_all - views.len()));
    }
    let terrain = ground(config, &crs, &views).map_err(TrainError::scene(name))?;
    let layer = sizeup_footprints::read(&config.footprints, &crs).map_err(TrainError::scene(name))?;
    let mut prisms: Vec<(BuildingId, geo_types::Polygon<f64>, f64)> = Vec::new();
    for footprint in layer.footprints {
        let height = footprint.attributes.get(&config.height_field).and_then(serde_json::Value::as_f64);
        let Some(height_m) = height.filter(|h| *h > 0.0 && *h < 1000.0) else {
            return Err(TrainError::scene(name)(format!(
                "building {:?} has no height: expected metres above 0 in {:?}, found {:?}\n\
                 hint: heights say what hides what; leave out buildings without one, and what is near them with `complete_m`",
                footprint.id.0,
                config.height_field,
                footprint.attributes.get(&config.height_field)
            )));
        };
        prisms.push((footprint.id, footprint.polygon, height_m));
    }
    let world = SimulatedTown::of_prisms(&prisms, terrain, &config.crs).map_err(TrainError::scene(name))?;
    let sight = VisibleWorld::of_buildings(&world);
    for view in &mut views {
        photo_into(view, config.longest_px, folder, name)?;
    }
    let prior = match &config.prior {
        None => None,
        Some(prior) => {
            let files = FilePriors::new(prior.clone(), views.iter().map(|v| &v.id)).map_err(TrainError::scene(name))?;
            let mut kind = None;
            for view in &views {
                let found = files.load(view).map_err(TrainError::scene(name))?;
                let path = folder.join("priors").join(format!("{}.npy", stem(&view.id)));
                write_npy(&path, &found.values)?;
                kind = Some(found.kind);
            }
            kind
        }
    };
    Ok(Source { world, sight, views, prior, complete_m: config.complete_m, notes })
}

fn ground(
    config: &PhotosConfig,
    crs: &Crs,
    views: &[View],
) -> Result<sizeup_geo::terrain::Terrain, sizeup_geo::terrain::TerrainError> {
    let centres = || views.iter().map(View::centre);
    let height_m = centres().map(|c| c.z).fold(0.0, f64::max);
    let around = MapBox::around(centres().map(|c| (c.x, c.y))).expect("there is a view");
    terrain::load(&config.terrain, crs, around.grown(GROUND_MARGIN * height_m.max(100.0)))
}

/// Brings a photo into the set, reduced where that is asked for; the view follows.
fn photo_into(view: &mut View, longest_px: Option<u32>, folder: &Path, scene: &str) -> Result<(), TrainError> {
    let Some(from) = view.image.clone() else {
        return Err(TrainError::scene(scene)(format!(
            "there is no file for the photo {}\nhint: `survey.images` is the folder of the photos",
            view.id.0
        )));
    };
    let photo = read_photo(&from)?;
    let expected = (view.camera.width_px, view.camera.height_px);
    if (photo.width(), photo.height()) != expected {
        let problem = format!(
            "expected {} × {} pixels as its camera has, found {} × {}",
            expected.0,
            expected.1,
            photo.width(),
            photo.height()
        );
        return Err(TrainError::set(&from, problem, "photos are taken as they are stored, never turned or resized"));
    }
    let camera = longest_px.map_or_else(|| (*view.camera).clone(), |longest| view.camera.reduced_to(longest));
    let (width, height) = (camera.width_px, camera.height_px);
    let reduced =
        if (width, height) == expected { photo } else { photo.resize_exact(width, height, FilterType::Triangle) };
    let id = ViewId(format!("{}.png", stem(&view.id)));
    let path = folder.join("images").join(&id.0);
    let rgb = reduced.to_rgb8();
    super::make::write_png(&path, rgb.as_raw(), (width, height), image::ExtendedColorType::Rgb8)?;
    (view.camera, view.id, view.image) = (Arc::new(camera), id, Some(path));
    Ok(())
}

/// Opens a photo; what cannot be decoded is named.
pub(super) fn read_photo(path: &Path) -> Result<DynamicImage, TrainError> {
    let unusable = |reason: String| {
        TrainError::set(
            path,
            format!("it cannot be read as a photo: {reason}"),
            "is the file whole? Copy it anew, or leave it out",
        )
    };
    let reader = image::ImageReader::open(path).map_err(|e| unusable(e.to_string()))?;
    reader.with_guessed_format().map_err(|e| unusable(e.to_string()))?.decode().map_err(|e| unusable(e.to_string()))
}

pub(super) fn stem(id: &ViewId) -> String {
    PathBuf::from(&id.0).file_stem().map_or_else(|| id.0.clone(), |s| s.to_string_lossy().into_owned())
}

fn write_npy(path: &Path, map: &sizeup_heights::raster::Raster<f32>) -> Result<(), TrainError> {
    use npyz::WriterBuilder as _;
    sizeup_geo::files::write_whole_unflushed(path, |w| {
        let shape = [map.height() as u64, map.width() as u64];
        let mut npy = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(w).begin_nd()?;
        npy.extend(map.data().iter().copied())?;
        npy.finish()
    })?;
    Ok(())
}
