//! Heights from arrays in memory: the method's crate, without files.
//!
//! Frames: map (easting, northing, up, metres), camera (x right, y down, z forward), image (pixels, the top-left pixel's centre
//! at 0.5). Arrays come as bytes, little-endian, row-major: footprints `n × 2` of `f64`, depths and terrain of `f32`, NaN = no
//! value. Python has looked at their shapes.

use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use geo::Validation as _;
use geo_types::{Coord, LineString, Polygon};
use glam::{DMat3, DVec3};
use pyo3::prelude::*;
use serde::Deserialize;
use sizeup_heights::camera::Camera;
use sizeup_heights::estimate::{BuildingHeight, MethodSettings, PartHeight};
use sizeup_heights::optimise::OptimiseConfig;
use sizeup_heights::photo_consistency::RefinementConfig;
use sizeup_heights::picture::Picture;
use sizeup_heights::prelude::{
    Building, DepthPrior, GroundLevel, HeightsConfig, PriorGeometry, PriorKind, Raster, Rigid, Settings, Terrain, View,
};
use sizeup_heights::terrain::Dem;

use crate::failure::{Failure, told};

/// How often Python is asked whether somebody pressed Ctrl-C.
const ASK_EVERY: Duration = Duration::from_millis(100);
/// A rotation's rows are of length 1 and at right angles to each other up to this: poses come with 6 digits and more.
const ROTATION_OFF: f64 = 1e-3;

/// A view but for its depths.
#[derive(Debug, Deserialize)]
struct ViewFacts {
    name: String,
    camera: Camera,
    /// `R` of `p_camera = R · p_map + t`, row by row.
    rotation: [[f64; 3]; 3],
    /// Translation `t` from map to camera, metres.
    translation: [f64; 3],
    kind: PriorKind,
    geometry: PriorGeometry,
    /// Rows and columns of the depths; none where the view has none.
    shape: Option<[usize; 2]>,
    /// Rows and columns of the grey photo; none where there is none.
    photo_shape: Option<[usize; 2]>,
}

/// The ground's surface but for its heights.
#[derive(Debug, Deserialize)]
struct GridFacts {
    shape: [usize; 2],
    west_m: f64,
    north_m: f64,
    cell_x_m: f64,
    cell_y_m: f64,
}

/// What is asked, but for arrays.
#[derive(Debug, Deserialize)]
struct Question {
    /// Ground of each building: what heights count from, and where walls end, metres.
    ground_m: Vec<[f64; 2]>,
    views: Vec<ViewFacts>,
    /// Ground everywhere, metres, where there is no grid.
    level_m: f64,
    grid: Option<GridFacts>,
    heights: HeightsConfig,
    optimise: OptimiseConfig,
    refinement: RefinementConfig,
    seed: u64,
}

/// Heights of buildings from footprints (rings, the exterior first), depths of the views that have them, and what else is
/// asked as JSON; the answer is JSON too.
#[pyfunction]
pub(crate) fn estimate_heights(
    py: Python<'_>,
    question: &str,
    footprints: Vec<Vec<Vec<u8>>>,
    depths: Vec<Option<Vec<u8>>>,
    photos: Vec<Option<Vec<u8>>>,
    terrain: Option<Vec<u8>>,
) -> PyResult<String> {
    let question: Question = serde_json::from_str(question)
        .map_err(|e| {
            Failure::of_settings(
                without_place(&e),
                "keys are those of [heights] and [optimise] in a configuration file: `sizeup schema run` lists them",
            )
        })
        .map_err(|failure| told(py, failure))?;
    let task = task(question, &footprints, (depths, photos), terrain).map_err(|failure| told(py, failure))?;
    let (answer, answered) = channel();
    std::thread::spawn(move || {
        let Task { buildings, terrain, views, settings } = task;
        let heights = sizeup_heights::estimate_heights(&buildings, &terrain, &views, &settings);
        // Nobody waits any more after Ctrl-C.
        let answers: Vec<serde_json::Value> = heights.iter().map(height).collect();
        let _ = answer.send(serde_json::Value::from(answers).to_string());
    });
    py.detach(move || {
        loop {
            match answered.recv_timeout(ASK_EVERY) {
                Ok(heights) => return Ok(heights),
                Err(RecvTimeoutError::Timeout) => Python::attach(|py| py.check_signals())?,
                Err(RecvTimeoutError::Disconnected) => {
                    let words = "the method ended without an answer: this is a fault of sizeup's\nhint: please report it with the input";
                    return Err(Python::attach(|py| told(py, Failure::from_text(words))));
                }
            }
        }
    })
}

/// What is wrong with a setting or a camera. Where it stands in text that nobody has seen is left out.
fn without_place(error: &serde_json::Error) -> String {
    let text = error.to_string();
    format!("settings or cameras: {}", text.rsplit_once(" at line ").map_or(&*text, |(what, _)| what))
}

/// All that the method takes.
struct Task {
    buildings: Vec<Building>,
    terrain: Terrain,
    views: Vec<View>,
    settings: Settings,
}

fn task(
    question: Question,
    footprints: &[Vec<Vec<u8>>],
    (depths, photos): (Vec<Option<Vec<u8>>>, Vec<Option<Vec<u8>>>),
    terrain: Option<Vec<u8>>,
) -> Result<Task, Failure> {
    if let Some(fault) = question.heights.fault() {
        return Err(Failure::of_settings(
            format!("settings.heights: {fault}"),
            "metres above the ground of the building",
        ));
    }
    if question.optimise.working_px == 0 || question.optimise.stride_px == 0 {
        return Err(Failure::of_settings(
            "settings.optimise: working_px and stride_px are 1 or more, found 0",
            "leave them out for 448 and 4",
        ));
    }
    let building = |(i, (rings, &[reference_m, lowest_m])): (usize, (&Vec<Vec<u8>>, &[f64; 2]))| {
        if !(reference_m.is_finite() && lowest_m.is_finite() && lowest_m <= reference_m) {
            return Err(Failure::of_input(
                format!(
                    "ground of footprints[{i}]: {reference_m} m, lowest {lowest_m} m: expected numbers, the lowest at most the first"
                ),
                "give the terrain's height at the building, metres in the map's vertical datum",
            ));
        }
        Ok(Building { footprint: footprint(i, rings)?, ground: GroundLevel { lowest_m, ..GroundLevel::flat(reference_m) } })
    };
    let buildings =
        footprints.iter().zip(&question.ground_m).enumerate().map(building).collect::<Result<Vec<_>, _>>()?;
    let views = question.views.into_iter().zip(depths.into_iter().zip(photos)).enumerate();
    let views = views.map(|(i, (facts, (depth, photo)))| view(i, facts, depth.as_deref(), photo.as_deref()));
    let views = views.collect::<Result<Vec<_>, _>>()?;
    let terrain = match (question.grid, terrain) {
        (Some(grid), Some(heights)) => Terrain::Grid(surface(&grid, &heights)?),
        _ => Terrain::Constant(question.level_m),
    };
    let method = MethodSettings { optimise: question.optimise, refinement: question.refinement };
    let settings = Settings { heights: question.heights, method, seed: question.seed };
    Ok(Task { buildings, terrain, views, settings })
}

/// A footprint that the method can use, or what is wrong with it.
fn footprint(i: usize, rings: &[Vec<u8>]) -> Result<Polygon<f64>, Failure> {
    let ring = |bytes: &Vec<u8>| {
        let numbers: Vec<f64> = bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        LineString::new(numbers.as_chunks::<2>().0.iter().map(|[x, y]| Coord { x: *x, y: *y }).collect())
    };
    let (exterior, holes) = rings.split_first().ok_or_else(|| {
        Failure::of_input(format!("footprints[{i}]: no ring"), "a footprint is an n × 2 array of easting and northing")
    })?;
    let footprint = Polygon::new(ring(exterior), holes.iter().map(ring).collect());
    footprint.check_validation().map_err(|fault| {
        Failure::of_input(
            format!("footprints[{i}]: {fault}"),
            "a footprint is a simple ring of three corners or more, metres in the map frame, holes inside it; shapely.make_valid mends most",
        )
    })?;
    Ok(footprint)
}

/// A building's height as JSON: of the whole, and of its parts.
fn height(found: &BuildingHeight) -> serde_json::Value {
    let rings = |footprint: &Polygon<f64>| -> Vec<Vec<[f64; 2]>> {
        let rings = std::iter::once(footprint.exterior()).chain(footprint.interiors());
        rings.map(|ring| ring.0.iter().map(|c| [c.x, c.y]).collect()).collect()
    };
    let part = |part: &PartHeight| {
        let mut part_json = serde_json::json!(part.height);
        part_json["rings"] = serde_json::json!(rings(&part.footprint));
        part_json
    };
    serde_json::json!({
        "height_m": found.height_m(),
        "sigma_m": found.sigma_m(),
        "reasons": found.reasons(),
        "views": found.views(),
        "parts": found.parts.iter().map(part).collect::<Vec<_>>(),
    })
}

fn view(i: usize, facts: ViewFacts, depth: Option<&[u8]>, photo: Option<&[u8]>) -> Result<View, Failure> {
    let at = || format!("views[{i}] ({:?})", facts.name);
    facts.camera.validate().map_err(|fault| {
        Failure::of_input(format!("{}: camera: {fault}", at()), "intrinsics are in pixels of the photo's own size")
    })?;
    // Rows of R are columns of its transpose.
    let rotation = DMat3::from_cols_array_2d(&facts.rotation).transpose();
    let off = (rotation * rotation.transpose() - DMat3::IDENTITY).to_cols_array();
    let is_rotation = off.iter().all(|x| x.abs() < ROTATION_OFF) && rotation.determinant() > 0.0;
    let translation = DVec3::from_array(facts.translation);
    if !(is_rotation && translation.is_finite()) {
        return Err(Failure::of_input(
            format!(
                "{}: camera_from_map: expected a rotation (orthonormal, determinant 1) and a translation in metres, found {:?} and {:?}",
                at(),
                facts.rotation,
                facts.translation
            ),
            "p_camera = R · p_map + t, axes x right, y down, z forward; sizeup.Pose.looking_at makes one",
        ));
    }
    let prior = match (facts.shape, depth) {
        (Some([rows, columns]), Some(bytes)) => Some(DepthPrior {
            values: raster(rows, columns, bytes).ok_or_else(|| {
                Failure::of_input(format!("{}: depth: expected {rows} × {columns} numbers", at()), "a 2D array")
            })?,
            kind: facts.kind,
            geometry: facts.geometry,
        }),
        _ => None,
    };
    let camera_from_map = Rigid::new(rotation, translation);
    let picture = match (facts.photo_shape, photo) {
        (Some([rows, columns]), Some(bytes)) => {
            let camera = facts.camera.resized(columns as u32, rows as u32);
            let picture = raster(rows, columns, bytes).and_then(|grey| Picture::new(&grey, &camera, camera_from_map));
            let fault = || {
                Failure::of_input(
                    format!("{}: photo: expected {rows} × {columns} numbers", at()),
                    "a 2D array of grey levels",
                )
            };
            Some(Arc::new(picture.ok_or_else(fault)?))
        }
        _ => None,
    };
    Ok(View { name: facts.name, camera: facts.camera, camera_from_map, prior, picture, green: None })
}

fn surface(grid: &GridFacts, heights: &[u8]) -> Result<Dem, Failure> {
    let unusable = |fault: &dyn std::fmt::Display| {
        Failure::of_input(
            format!("terrain: {fault}"),
            "row 0 is the northernmost, west and north are the corner of its first cell",
        )
    };
    let [rows, columns] = grid.shape;
    let heights = raster(rows, columns, heights).ok_or_else(|| unusable(&"heights are not of the stated shape"))?;
    Dem::new(heights, grid.west_m, grid.north_m, grid.cell_x_m, grid.cell_y_m).map_err(|fault| unusable(&fault))
}

fn raster(rows: usize, columns: usize, bytes: &[u8]) -> Option<Raster<f32>> {
    let values = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    Raster::from_vec(columns, rows, values)
}
