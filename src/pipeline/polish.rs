//! Roof heights settled by the photos, where these show the roof and agree on it better than the priors do.
//!
//! The order of depths finds the roof, to half a metre or so; the photos, laid onto it, say where exactly it is. Photos
//! alone would not do: within a wider range there are false matches.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::stages::SceneStage;
use crate::config::RunConfig;
use crate::optimise::{self, Preset, Roof, Solution, SolvedHeight};
use crate::photometry::{self, MIN_PHOTOS, MIN_POINTS, PolishConfig, Settled};
use crate::prior::{Album, Picture};
use crate::ray::Ray;
use crate::render::image::SceneTracer;
use crate::scene::{Prism, Scene};
use crate::stats;
use crate::survey::{Survey, View};

/// Memory for reduced photos.
const PICTURE_BYTES: usize = 512 << 20;
/// Buildings that are looked at together, neighbours, so that they share photos.
const N_TOGETHER: usize = 32;
/// Buildings of a square of this side are neighbours, metres.
const SQUARE_M: f32 = 50.0;
/// Places of a roof that are asked whether a photo sees them, and the share of them that it has to see.
const N_ASKED: usize = 25;
const MIN_SEEN: f64 = 0.7;
/// Of the way to a place, the part that has to be free.
const FREE_WAY: f32 = 0.99;

/// Roofs within this tell of the poses, metres.
const AROUND_M: f64 = 150.0;
/// What the standard error over photos counts for in the stated standard deviation, and what every height is off by besides,
/// metres. Fitted to 180 simulated roofs, half of them under poses that are off by 0.3 m and 0.2°.
const SPREAD_SHARE: f64 = 2.0;
const SYSTEMATIC_M: f64 = 0.1;

/// Raises and lowers the roofs of a solution to where the photos look alike.
pub(super) fn polish(config: &RunConfig, survey: &Survey, stage: &SceneStage, solution: &mut Solution) {
    let settings = &config.optimise.polish;
    let photos: Vec<&View> = survey.views.iter().filter(|view| view.image.is_some()).collect();
    let is_wanted = settings.enabled.unwrap_or(config.optimise.preset != Preset::Paper);
    if !is_wanted || photos.len() < MIN_PHOTOS {
        return;
    }
    let roof_m = |solved: &SolvedHeight| solved.roof.map_or(0.0, |roof| roof.mean_m as f32);
    let heights_m: Vec<f32> = solution.heights.iter().map(roof_m).collect();
    let tracer = SceneTracer::new(&stage.scene, &heights_m);
    let album = Album::new(settings.long_side_px, PICTURE_BYTES);
    let roofs = Roofs { stage, settings, photos: &photos, tracer: &tracer, album: &album };
    let mut found = vec![None; heights_m.len()];
    for together in roofs.by_square().chunks(N_TOGETHER) {
        let settle = |&b: &usize| (b, roofs.settle(b, solution.heights[b].roof.as_ref()));
        for (b, settled) in together.par_iter().map(settle).collect::<Vec<_>>() {
            found[b] = settled;
        }
    }
    let sigmas_m = sigmas_m(&stage.scene, &found);
    for ((solved, settled), sigma_m) in solution.heights.iter_mut().zip(found).zip(sigmas_m) {
        let is_clear = |s: &Settled| s.score >= settings.min_score && s.lead >= settings.min_lead;
        let Some((settled, sigma_m)) = settled.filter(is_clear).zip(sigma_m) else { continue };
        if solved.sigma_m.is_none_or(|of_priors_m| sigma_m < of_priors_m) {
            solved.raise(settled.raised_m, sigma_m);
        }
    }
}

/// The standard deviation to state for each roof that the photos settle. Poses that are off show in how much photos left out
/// move the roofs around; a single roof may hide it by chance.
fn sigmas_m(scene: &Scene, found: &[Option<Settled>]) -> Vec<Option<f64>> {
    let middle = |prism: &Prism| prism.centre_at(0.0).truncate().as_dvec2().to_array();
    let known = found
        .iter()
        .zip(&scene.prisms)
        .filter_map(|(settled, prism)| Some(GeomWithData::new(middle(prism), settled.as_ref()?.sigma_m)));
    let known = RTree::bulk_load(known.collect());
    let around = |at: [f64; 2]| {
        let close: Vec<f64> = known.locate_within_distance(at, AROUND_M * AROUND_M).map(|near| near.data).collect();
        stats::median(&close).unwrap_or(0.0)
    };
    let of_one = |(settled, prism): (&Option<Settled>, &Prism)| {
        let spread_m = settled.as_ref()?.sigma_m.max(around(middle(prism)));
        Some((SPREAD_SHARE * spread_m).hypot(SYSTEMATIC_M))
    };
    found.iter().zip(&scene.prisms).map(of_one).collect()
}

/// What roofs are looked at with.
struct Roofs<'a> {
    stage: &'a SceneStage,
    settings: &'a PolishConfig,
    photos: &'a [&'a View],
    tracer: &'a SceneTracer<'a>,
    album: &'a Album,
}

impl Roofs<'_> {
    /// All buildings, neighbours together.
    fn by_square(&self) -> Vec<usize> {
        let square = |b: usize| {
            let at = self.stage.scene.prisms[b].centre_at(0.0) / SQUARE_M;
            (at.y.floor() as i32, at.x.floor() as i32)
        };
        let mut order: Vec<usize> = (0..self.stage.scene.prisms.len()).collect();
        order.sort_by_key(|&b| square(b));
        order
    }

    /// Of the ways that a roof's form can lie the one on which the photos look alike most.
    fn settle(&self, building: usize, roof: Option<&Roof>) -> Option<Settled> {
        let (prism, settings) = (&self.stage.scene.prisms[building], self.settings);
        let surfaces = optimise::surfaces(prism, roof?, settings.clear_m as f32, settings.n_points);
        let settled = surfaces.iter().filter(|s| s.len() >= MIN_POINTS).filter_map(|s| self.settle_on(building, s));
        settled.reduce(|best, other| if other.score > best.score { other } else { best })
    }

    fn settle_on(&self, building: usize, surface: &[Vec3]) -> Option<Settled> {
        let origin = self.stage.scene.origin.0;
        let in_map: Vec<DVec3> = surface.iter().map(|p| p.as_dvec3() + origin).collect();
        let middle = in_map.iter().sum::<DVec3>() / in_map.len() as f64;
        let sees = |photo: usize| self.sees(self.photos[photo], building, surface);
        let chosen = photometry::choose(self.photos, middle, self.settings.n_photos, sees);
        if chosen.len() < MIN_PHOTOS {
            return None;
        }
        // A photo that cannot be read has been told of where it is the prior's; here the others will do.
        let pictures: Vec<Arc<Picture>> =
            chosen.iter().filter_map(|&photo| self.album.picture(self.photos[photo]).ok()).collect();
        let pictures: Vec<&Picture> = pictures.iter().map(|picture| &**picture).collect();
        photometry::settle(&pictures, &in_map, self.settings)
    }

    /// Whether nothing hides most of a roof from a photo.
    fn sees(&self, photo: &View, building: usize, surface: &[Vec3]) -> bool {
        let eye = (photo.camera_from_map.centre() - self.stage.scene.origin.0).as_vec3();
        let asked = || surface.iter().step_by(surface.len().div_ceil(N_ASKED));
        let mut scratch = Vec::new();
        let mut is_seen = |place: &Vec3| {
            let (way, face) = self.tracer.trace(&Ray::new(eye, *place - eye), &mut scratch);
            way.is_nan() || way > FREE_WAY || face.building().is_some_and(|met| met.at() == building)
        };
        let n_seen = asked().filter(|place| is_seen(place)).count();
        n_seen as f64 >= MIN_SEEN * asked().count() as f64
    }
}
