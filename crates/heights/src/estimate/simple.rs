//! Heights of buildings in one call, with everything in memory.

use std::collections::BTreeSet;
use std::sync::Arc;

use geo::Area as _;
use geo_types::Polygon;

use super::rounds::estimate;
use super::task::{Building, LocalFrame, MethodSettings, NamedCamera, Photos, Priors, Task, extent};
use crate::camera::Camera;
use crate::frames::{Cam, LocalOrigin, Map, Rigid};
use crate::optimise::{Reason, SolvedHeight};
use crate::picture::{Picture, PosedCamera};
use crate::prior::DepthPrior;
use crate::raster::Raster;
use crate::scene::HeightsConfig;
use crate::terrain::Terrain;
use crate::views::ViewKind;

/// One photo: camera, pose, and the depth that a network or a matcher computes from it.
#[derive(Debug, Clone)]
pub struct View {
    /// Name, unique among the photos: random choices about a photo depend on it, never on its place in the list.
    pub name: String,
    /// Intrinsics at the photo's own size.
    pub camera: Camera,
    /// Pose: from the map frame to the camera's.
    pub camera_from_map: Rigid<Cam, Map>,
    /// Depth prior of any size and the photo's shape; `None`: the photo is not used for the search.
    pub prior: Option<DepthPrior>,
    /// The photo itself, reduced and grey; `None`: the photo refines no roof.
    pub picture: Option<Arc<Picture>>,
    /// Pixels of the photo that are as green as leaves, at any size; `None`: trees are not masked.
    pub green: Option<Arc<Raster<bool>>>,
}

/// Settings of [`estimate_heights`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings {
    /// Range of heights.
    pub heights: HeightsConfig,
    /// Solver and refinement: `optimise.preset` is `robust` (global search, then roofs) or `paper` (ordinal loss and gradient
    /// descent).
    pub method: MethodSettings,
    /// Root of every random choice: the same seed gives the same heights, on one thread and on many.
    pub seed: u64,
}

/// Part of a building at one roof level.
#[derive(Debug, Clone, PartialEq)]
pub struct PartHeight {
    /// Footprint in the map frame, metres.
    pub footprint: Polygon<f64>,
    /// Height of the part, above the ground of the building.
    pub height: SolvedHeight,
}

/// Height of a building, in one part or in several at roof levels of their own.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BuildingHeight {
    /// The parts; most buildings have one.
    pub parts: Vec<PartHeight>,
}

impl BuildingHeight {
    /// Height above the ground, metres, mean over the area of the parts that have one; `None` if none has.
    #[must_use]
    pub fn height_m(&self) -> Option<f64> {
        self.mean(|part| part.height_m)
    }

    /// One standard deviation of the height, metres; errors are taken to be common to all parts.
    #[must_use]
    pub fn sigma_m(&self) -> Option<f64> {
        self.mean(|part| part.sigma_m)
    }

    /// Reasons for doubt about any part, each once.
    #[must_use]
    pub fn reasons(&self) -> Vec<Reason> {
        let of_parts: BTreeSet<Reason> = self.parts.iter().flat_map(|part| part.height.reasons.clone()).collect();
        of_parts.into_iter().collect()
    }

    /// Positions of the views used, ascending.
    #[must_use]
    pub fn views(&self) -> Vec<usize> {
        let of_parts: BTreeSet<usize> = self.parts.iter().flat_map(|part| part.height.views.clone()).collect();
        of_parts.into_iter().collect()
    }

    fn mean(&self, of: impl Fn(&SolvedHeight) -> Option<f64>) -> Option<f64> {
        let known = self.parts.iter().filter_map(|part| Some((part.footprint.unsigned_area(), of(&part.height)?)));
        let (area_m2, sum) = known.fold((0.0, 0.0), |(area, sum), (a, value)| (area + a, sum + a * value));
        (area_m2 > 0.0).then(|| sum / area_m2)
    }
}

/// Estimates the heights of buildings above their ground, in metres, in the order of `buildings`: the parts of each building with
/// height, standard deviation, roof, the views used (positions in `views`) and the reasons for doubt.
///
/// A building that no view sees has `height_m = None` and the cause in `reasons`. Frames: map (easting, northing, up, metres); a pose
/// maps it to the camera's (x right, y down, z forward). Source: `SiZeUp` (2026) for `preset = paper`.
#[must_use]
pub fn estimate_heights(
    buildings: &[Building],
    terrain: &Terrain,
    views: &[View],
    settings: &Settings,
) -> Vec<BuildingHeight> {
    let cameras: Vec<NamedCamera> = views.iter().map(named).collect();
    let highest_m = buildings.iter().map(|b| b.ground.reference_m).fold(f64::NEG_INFINITY, f64::max);
    let centre = |camera: &NamedCamera| camera.posed.camera_from_map.centre();
    let kind = ViewKind::for_heights(cameras.iter().map(NamedCamera::kind));
    let eyes = cameras.iter().filter(|camera| camera.kind() == kind).map(|camera| centre(camera).z - highest_m);
    let clearance_m = eyes.fold(f64::INFINITY, f64::min).max(f64::from(settings.heights.min_m));
    let area = extent(buildings.iter().map(|building| &building.footprint));
    let origin =
        area.map_or(LocalOrigin(glam::DVec3::ZERO), |area| LocalFrame::origin(cameras.iter().map(centre), area));
    let task = Task {
        buildings,
        terrain,
        frame: LocalFrame { origin, bounds: settings.heights.bounds(clearance_m) },
        views: &cameras,
        priors: &InMemory(views),
        photos: Some(&InMemory(views)),
        seed: settings.seed,
        progress: &|_, _, _| {},
    };
    let heights = estimate(&task, &settings.method);
    let mut of_buildings = vec![BuildingHeight::default(); buildings.len()];
    for (part, height) in heights.parts.into_iter().zip(heights.solution.heights) {
        of_buildings[part.building].parts.push(PartHeight { footprint: part.footprint, height });
    }
    of_buildings
}

fn named(view: &View) -> NamedCamera {
    let posed = PosedCamera { camera: view.camera.clone(), camera_from_map: view.camera_from_map };
    NamedCamera { name: view.name.clone(), posed }
}

struct InMemory<'a>(&'a [View]);

impl Priors for InMemory<'_> {
    fn load(&self, view: usize) -> Result<DepthPrior, String> {
        let of = &self.0[view];
        of.prior.as_ref().map(|prior| prior.to_z_depth(&of.camera)).ok_or_else(|| "it has none".to_owned())
    }

    fn absence(&self, view: usize) -> Option<String> {
        self.0[view].prior.is_none().then(|| "it has none".to_owned())
    }

    fn green(&self, view: usize) -> Option<Arc<Raster<bool>>> {
        self.0[view].green.clone()
    }
}

impl Photos for InMemory<'_> {
    fn has(&self, view: usize) -> bool {
        self.0[view].picture.is_some()
    }

    fn picture(&self, view: usize) -> Result<Arc<Picture>, String> {
        self.0[view].picture.clone().ok_or_else(|| "it has none".to_owned())
    }
}
