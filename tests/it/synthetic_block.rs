//! Heights of a small block whose truth is known, from priors rendered from that truth.

use std::f64::consts::{FRAC_PI_2, PI};

use geo_types::{Polygon, polygon};
use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::frames::Rigid;
use sizeup::optimise::{OptimiseConfig, OrdinalConfig, Preset, Problem, Reason, Solution, ViewInput, solve};
use sizeup::prior::{DepthPrior, PriorGeometry, PriorKind};
use sizeup::raster::Raster;
use sizeup::render::PlacedCamera;
use sizeup::render::image::SceneTracer;
use sizeup::scene::{HeightBounds, Scene};
use sizeup::terrain::{GroundLevel, Terrain};

/// A 4 × 4 block of houses on level ground, two of them wall to wall, heights 4 to 34 m.
struct Block {
    scene: Scene,
    truth_m: Vec<f32>,
    views: Vec<ViewInput>,
}

fn block() -> Block {
    let mut polygons: Vec<Polygon<f64>> = Vec::new();
    let mut truth_m = Vec::new();
    for i in 0..16 {
        let (x, y) = (f64::from(i % 4) * 32.0, f64::from(i / 4) * 30.0);
        let (w, d) = (14.0 + f64::from(i * 7 % 5), 11.0 + f64::from(i * 3 % 7));
        polygons.push(polygon![(x: x, y: y), (x: x + w, y: y), (x: x + w, y: y + d), (x: x, y: y + d)]);
        truth_m.push(4.0 + (i * 11 % 31) as f32);
    }
    polygons.push(polygon![(x: 14.0, y: 0.0), (x: 24.0, y: 0.0), (x: 24.0, y: 11.0), (x: 14.0, y: 11.0)]);
    truth_m.push(12.0);
    let ground = GroundLevel { reference_m: 0.0, lowest_m: 0.0 };
    let footprints: Vec<_> = polygons.iter().map(|p| (p, ground)).collect();
    let bounds = HeightBounds { min_m: 2.0, max_m: 90.0 };
    let scene = Scene::new(&footprints, &Terrain::Constant(0.0), bounds, 300.0);

    let mut views = Vec::new();
    for station in 0..16 {
        for heading in 0..4 {
            let (x, y) = (f64::from(station % 4) * 45.0 - 20.0, f64::from(station / 4) * 45.0 - 20.0);
            let turn = DMat3::from_rotation_z(f64::from(heading) * FRAC_PI_2);
            let rotation = DMat3::from_rotation_x(PI - 0.785) * turn;
            let look = rotation.transpose() * DVec3::Z;
            let eye = DVec3::new(x, y, 0.0) - look * (120.0 / -look.z);
            let pose = Rigid::from_rotation_and_centre(rotation, eye);
            let placed = PlacedCamera::new(Camera::pinhole(224, 168, 180.0), pose, scene.origin);
            views.push(ViewInput { placed, is_oblique: true, key: views.len() as u64 });
        }
    }
    Block { scene, truth_m, views }
}

impl Block {
    fn priors(&self, warp: impl Fn(f32) -> f32) -> Vec<DepthPrior> {
        let tracer = SceneTracer::new(&self.scene, &self.truth_m);
        let prior = |view: &ViewInput| DepthPrior {
            values: tracer.render(&view.placed).depth.map(|d| warp(*d)),
            kind: PriorKind::Depth,
            geometry: PriorGeometry::ZDepth,
        };
        self.views.iter().map(prior).collect()
    }

    fn solve(&self, priors: &[DepthPrior], config: &OptimiseConfig) -> Solution {
        solve(
            &Problem {
                scene: &self.scene,
                views: &self.views,
                load_prior: &|view| Ok(priors[view].clone()),
                seed: 1,
                start_m: &[],
                progress: &|_, _, _| {},
            },
            config,
        )
    }

    fn errors(&self, solution: &Solution) -> Vec<f64> {
        let error = |(solved, truth): (&sizeup::optimise::SolvedHeight, &f32)| {
            (solved.height_m.expect("every building is seen") - f64::from(*truth)).abs()
        };
        solution.heights.iter().zip(&self.truth_m).map(error).collect()
    }
}

fn small(preset: Preset) -> OptimiseConfig {
    OptimiseConfig { preset, stride_px: 2, ..OptimiseConfig::default() }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn robust_finds_heights_from_an_exact_prior() {
    let block = block();
    let errors = block.errors(&block.solve(&block.priors(|d| d), &small(Preset::Robust)));
    // 0.7 m on the ground per pixel: a quarter of that is what edges can tell.
    assert!(mean(&errors) < 0.2, "{errors:.2?}");
    assert!(errors.iter().all(|e| *e < 0.8), "{errors:.2?}");
}

#[test]
fn ranks_need_only_the_order_of_the_prior() {
    let block = block();
    let mut config = small(Preset::Robust);
    let search = &mut config.search;
    (search.rank_sweeps, search.pitched_roofs) = (2, false);
    (search.agreement_weight, search.local_agreement_weight, search.unmodelled_agreement_weight) = (0.0, 0.0, 0.0);
    let errors = block.errors(&block.solve(&block.priors(|d| (0.01 * d).powi(3)), &config));
    assert!(mean(&errors) < 0.4, "{errors:.2?}");
}

#[test]
fn agreement_of_a_curved_prior_costs_less_than_a_metre() {
    let block = block();
    let errors = block.errors(&block.solve(&block.priors(|d| (0.01 * d).powi(3)), &small(Preset::Robust)));
    // What brings priors to metres is a straight line in inverse depth; a cubed depth is far from one.
    assert!(mean(&errors) < 1.0, "{errors:.2?}");
}

#[test]
fn the_paper_preset_gets_within_metres_of_an_exact_prior() {
    let block = block();
    let solution = block.solve(&block.priors(|d| d), &small(Preset::Paper));
    let errors = block.errors(&solution);
    // The publication reports 1.3 to 7.5 m.
    assert!(mean(&errors) < 2.0, "{errors:.2?}");
    let history = &solution.history;
    assert!(history.last().unwrap().loss < 0.7 * history[0].loss, "the loss falls");
}

#[test]
fn silhouettes_and_ground_sharpen_the_ordinal_loss() {
    let block = block();
    let mut config = small(Preset::Paper);
    config.ordinal = OrdinalConfig {
        margin: 0.05,
        region: sizeup::optimise::Region::BuildingsAndGround,
        gradient: sizeup::optimise::Gradient::CentralDifference,
        step_m: [2.0, 0.05],
        ..OrdinalConfig::default()
    };
    let errors = block.errors(&block.solve(&block.priors(|d| d), &config));
    assert!(mean(&errors) < 1.0, "{errors:.2?}");
}

#[test]
fn one_thread_and_many_give_the_same_bits() {
    let block = block();
    let priors = block.priors(|d| d);
    for preset in [Preset::Robust, Preset::Paper] {
        let on_threads = |n: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| block.solve(&priors, &small(preset)))
        };
        assert!(on_threads(1) == on_threads(3), "{preset:?}");
    }
}

#[test]
fn a_building_that_no_view_sees_is_unknown_and_says_so() {
    let mut block = block();
    block.views.iter_mut().for_each(|v| v.is_oblique = false);
    let solution = block.solve(&block.priors(|d| d), &small(Preset::Robust));
    assert!(solution.heights.iter().all(|h| h.height_m.is_none() && h.reasons == [Reason::SeenByNoView]));
    assert_eq!(solution.used_views, [0_usize; 0]);
}

#[test]
fn constant_priors_say_nothing() {
    let block = block();
    let flat = Raster::filled(224, 168, 5.0);
    let priors =
        vec![DepthPrior { values: flat, kind: PriorKind::Depth, geometry: PriorGeometry::ZDepth }; block.views.len()];
    let solution = block.solve(&priors, &small(Preset::Robust));
    assert!(solution.heights.iter().all(|h| h.height_m.is_none()));
}

#[test]
fn priors_that_cannot_be_loaded_are_listed() {
    let block = block();
    let priors = block.priors(|d| d);
    let load = |view: usize| if view < 10 { Err("gone".to_owned()) } else { Ok(priors[view].clone()) };
    let problem = Problem {
        scene: &block.scene,
        views: &block.views,
        load_prior: &load,
        seed: 1,
        start_m: &[],
        progress: &|_, _, _| {},
    };
    let solution = solve(&problem, &small(Preset::Robust));
    assert!(!solution.failed_views.is_empty());
    assert!(solution.failed_views.iter().all(|(view, why)| *view < 10 && why == "gone"));
    assert!(solution.used_views.iter().all(|view| *view >= 10));
}
