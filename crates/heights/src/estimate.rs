//! Heights of buildings in one call: footprints, ground, photos' poses and depth priors in; one height per building out.
//!
//! This is the short way in. [`optimise::solve`](crate::optimise::solve) takes the same apart: priors that are loaded when
//! they are asked for, rays that are kept from one scene to the next, progress.

use geo_types::Polygon;

use crate::camera::Camera;
use crate::frames::{Cam, Map, Rigid};
use crate::optimise::{OptimiseConfig, Problem, Rays, SearchConfig, SolvedHeight, ViewInput, solve};
use crate::prior::DepthPrior;
use crate::render::PlacedCamera;
use crate::scene::{HeightsConfig, Scene};
use crate::terrain::{GroundLevel, Terrain};
use crate::views::NADIR_WITHIN_DEG;

/// One building whose height is wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct Building {
    /// Footprint in the map frame, metres.
    pub footprint: Polygon<f64>,
    /// Ground under it, metres in the vertical datum of the map frame.
    pub ground: GroundLevel,
}

/// One photo: where it was taken from, and the depth that a network or a matcher sees in it.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Name, unique among the photos: random choices about a view depend on it, never on its place in the list.
    pub name: String,
    /// Intrinsics at the photo's own size.
    pub camera: Camera,
    /// Pose: from the map frame to the camera's.
    pub camera_from_map: Rigid<Cam, Map>,
    /// Depth prior of any size and the photo's shape; without one the view has no say.
    pub prior: Option<DepthPrior>,
}

impl View {
    /// Whether heights are measured in it: it looks down, by more than 15° from straight down.
    #[must_use]
    pub fn is_oblique(&self) -> bool {
        let off_nadir_deg = self.camera_from_map.off_nadir_rad().to_degrees();
        off_nadir_deg > NADIR_WITHIN_DEG && off_nadir_deg < 90.0
    }
}

/// Settings of [`estimate_heights`]: the heights looked for, the solver, the seed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings {
    /// The heights that are looked for.
    pub heights: HeightsConfig,
    /// The solver and its constants: `preset` is `robust` (local search) or `paper` (ordinal loss and gradient descent).
    pub optimise: OptimiseConfig,
    /// Root of every random choice: the same seed gives the same heights, on one thread and on many.
    pub seed: u64,
}

/// Heights of buildings above their ground, in metres, in the order of `buildings`: each with a standard deviation, the roof
/// that the priors support, the views that had a say (positions in `views`) and the reasons to doubt it.
///
/// A building that no view sees has `height_m = None` and says why in `reasons`. Frames: map (easting, northing, up, metres);
/// a pose maps it to the camera's (x right, y down, z forward). Source: `SiZeUp` (2026) for `preset = paper`.
#[must_use]
pub fn estimate_heights(
    buildings: &[Building],
    terrain: &Terrain,
    views: &[View],
    settings: &Settings,
) -> Vec<SolvedHeight> {
    let highest_m = buildings.iter().map(|b| b.ground.reference_m).fold(f64::NEG_INFINITY, f64::max);
    let eyes = views.iter().filter(|view| view.is_oblique()).map(|view| view.camera_from_map.centre().z);
    let clearance_m = (eyes.fold(f64::INFINITY, f64::min) - highest_m).max(f64::from(settings.heights.min_m));
    let bounds = settings.heights.bounds(clearance_m);
    let footprints: Vec<_> = buildings.iter().map(|b| (&b.footprint, b.ground)).collect();
    let scene = Scene::new(&footprints, terrain, bounds, bounds.ground_margin_m());
    let optimise = &settings.optimise;
    let inputs: Vec<ViewInput> = views
        .iter()
        .map(|view| {
            let camera = view.camera.reduced_to(optimise.working_px);
            let placed = PlacedCamera::new(camera, view.camera_from_map, scene.origin);
            ViewInput::new(&view.name, placed, view.is_oblique())
        })
        .collect();
    let absent = || "it has none".to_owned();
    let problem = Problem {
        scene: &scene,
        views: &inputs,
        expect_priors: &|_| Vec::new(),
        without_prior: &|view| views[view].prior.is_none().then(absent),
        load_prior: &|view| {
            views[view].prior.as_ref().map(|prior| prior.to_z_depth(&views[view].camera)).ok_or_else(absent)
        },
        green: &|_| None,
        start_m: &[],
        seed: settings.seed,
        rays: &Rays::new(inputs.len(), optimise.stride_px),
        progress: &|_, _, _| {},
    };
    let mut solution = solve(&problem, optimise);
    if let Some(shift) = solution.layer_shift {
        let inputs: Vec<ViewInput> = inputs.iter().map(|view| view.moved(shift.on_ground())).collect();
        let rays = Rays::new(inputs.len(), optimise.stride_px);
        let search = SearchConfig { measure_shift: false, ..optimise.search.clone() };
        let optimise = OptimiseConfig { search, ..optimise.clone() };
        solution = solve(&Problem { views: &inputs, rays: &rays, ..problem }, &optimise);
    }
    for solved in &mut solution.heights {
        solved.keep_within(bounds, optimise.height_reference);
    }
    solution.heights
}
