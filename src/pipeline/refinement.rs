//! Roof heights refined by the photos, where these show the roof and agree on it better than the priors do.
//!
//! The order of depths finds the roof, to half a metre or so; the photos, laid onto it, say where exactly it is. Photos
//! alone would not do: within a wider range there are false matches.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::ground_told;
use super::stages::SceneStage;
use crate::config::RunConfig;
use sizeup_heights::optimise::{self, Doubts, Preset, Roof, Solution, SolvedHeight};
use sizeup_heights::ray::Ray;
use sizeup_heights::render::image::SceneTracer;
use sizeup_heights::scene::{Prism, RoofForm, Scene};
use sizeup_heights::stats;
use sizeup_photos::photo_consistency::{self, MIN_PHOTOS, MIN_PLACES, Refined, RefinementConfig};
use sizeup_photos::prior::{Album, Picture};
use sizeup_survey::{Survey, View, ViewKind};

/// Memory for reduced photos.
const PICTURE_BYTES: usize = 512 << 20;
/// Buildings that are looked at together, neighbours, so that they share photos.
const N_TOGETHER: usize = 32;
/// Buildings of a square of this side are neighbours, metres.
const SQUARE_M: f32 = 50.0;
/// Places of a roof that are asked whether a photo sees them, the share of them that it has to show, and of these the share
/// that nothing may hide.
const N_ASKED: usize = 25;
const MIN_SHOWN: f64 = 0.5;
const MIN_FREE: f64 = 0.7;
/// Part of the way to a place that has to be free.
const FREE_WAY: f32 = 0.99;

/// Photos have a say where they are more certain than priors can be: this share of the jackknife over views and so many of its pixels,
/// however well heights explain a prior.
const PRIOR_VIEWS_SHARE: f64 = 0.5;
const PRIOR_PX: f64 = 0.65;
/// Roofs within this tell of the poses, metres.
const AROUND_M: f64 = 150.0;
/// Weight of the standard error over photos in the stated standard deviation: fitted to 180 simulated roofs, half of them
/// under poses that are off by 0.3 m and 0.2°.
const SPREAD_SHARE: f64 = 2.0;
/// Error of every height besides, metres: dormers, parapets, what lies within a step of a wall. Fitted, with what pitches and forms
/// leave open, to 509 roofs in simulated photos, a third of them real ones (Rotterdam, west).
const SYSTEMATIC_M: f64 = 0.1;

/// Step among a roof's places that tell its pitch.
const THINNED: usize = 3;
/// Roofs of another pitch or form on which the photos look less alike by this are an e-th as likely.
const SCORE_SCALE: f64 = 0.02;
/// A roof of which more than this share looks clearly better at another height has several levels that none of the candidates
/// has: with a quarter of it wrong, a step of a storey is off by as much as the priors are.
const MAX_ELSEWHERE_SHARE: f64 = 0.25;
/// Share of a roof's places, of those whose height the photos tell one by one, that has to lie on it.
const MIN_SAME: f64 = 0.75;
/// A stepped roof is taken for one of another form only where the photos tell the height of so much of it, and find so much of
/// that on the other form: what the priors see beside a level may be hidden from steep photos.
const MIN_KNOWN_OF_STEPPED: f64 = 0.8;
const MIN_SAME_OF_STEPPED: f64 = 0.95;
/// How much more alike the photos have to look on another form of roof than on the one that the priors show.
const OTHER_FORM_SCORE: f64 = 0.02;

/// Whether photos, where there are any, refine roofs.
pub(super) fn is_on(config: &RunConfig) -> bool {
    config.refinement.enabled.unwrap_or(config.optimise.preset != Preset::Paper)
}

/// Whether the photo of a view, of whatever kind, is asked about roofs.
fn asks_photo(config: &RunConfig, view: &View) -> bool {
    is_on(config) && view.image.is_some()
}

/// Whether the photo of a view, of whatever kind, is read while heights are found: for the roofs, for what is green, or for the ground.
#[must_use]
pub fn reads_photo(config: &RunConfig, view: &View) -> bool {
    let is_looked_at = config.optimise.leaves_out_vegetation() && view.kind() == ViewKind::Oblique;
    asks_photo(config, view) || ((is_looked_at || ground_told::asks(config)) && view.image.is_some())
}

/// Memory that photos take at most where there are so many, bytes: those of roofs, then those of the ground.
#[must_use]
pub fn photo_bytes(config: &RunConfig, n_photos: usize) -> usize {
    let of_roofs = n_photos.saturating_mul(Album::bytes_of_one(config.refinement.long_side_px));
    PICTURE_BYTES.min(of_roofs).max(ground_told::photo_bytes(n_photos))
}

/// Raises and lowers the roofs of a solution to where the photos look alike. Returns the views whose photo cannot be read, and
/// why.
pub(super) fn refine(
    config: &RunConfig,
    survey: &Survey,
    stage: &SceneStage,
    solution: &mut Solution,
) -> Vec<(usize, String)> {
    let settings = &config.refinement;
    let views: Vec<usize> = (0..survey.views.len()).filter(|&v| asks_photo(config, &survey.views[v])).collect();
    let photos: Vec<&View> = views.iter().map(|&v| &survey.views[v]).collect();
    if photos.len() < MIN_PHOTOS {
        return Vec::new();
    }
    let roof_m = |solved: &SolvedHeight| solved.roof.map_or(0.0, |roof| roof.mean_m as f32);
    let heights_m: Vec<f32> = solution.heights.iter().map(roof_m).collect();
    let tracer = SceneTracer::new(&stage.scene, &heights_m);
    let album = Album::new(settings.long_side_px, PICTURE_BYTES);
    let unread = Mutex::default();
    let roofs = Roofs { stage, settings, photos: &photos, tracer: &tracer, album: &album, unread: &unread };
    let mut found = vec![None; heights_m.len()];
    for together in roofs.by_square().chunks(N_TOGETHER) {
        let refine = |&b: &usize| (b, roofs.refine(b, solution.heights[b].roof.as_ref()));
        for (b, refined) in together.par_iter().map(refine).collect::<Vec<_>>() {
            found[b] = refined;
        }
    }
    let sigmas_m = sigmas_m(&stage.scene, &found);
    let is_clear = |s: &Refined| s.score >= settings.min_score && s.lead >= settings.min_lead;
    for ((solved, found), sigma_m) in solution.heights.iter_mut().zip(found).zip(sigmas_m) {
        let Some((found, sigma_m)) = found.filter(|found| is_clear(&found.refined)).zip(sigma_m) else {
            continue;
        };
        let roof = found.roof.raised(found.refined.raised_m);
        // The photos try all forms themselves: what the priors leave open between them makes no photo more certain.
        let of_priors_m = solved.sigma_m.map(|_| {
            let Doubts { views_m, pixel_m, .. } = solved.doubts;
            solved.doubts.sigma_of_known_form_m().max((PRIOR_VIEWS_SHARE * views_m).hypot(PRIOR_PX * pixel_m))
        });
        if roof.eave_m > 0.0 && of_priors_m.is_none_or(|of_priors_m| sigma_m < of_priors_m) {
            // Where the two part by more than both allow, one of them is wrong (Birge's ratio).
            let parted = solved
                .roof
                .zip(solved.sigma_m)
                .map_or(1.0, |(before, stated_m)| (roof.mean_m - before.mean_m).abs() / sigma_m.hypot(stated_m));
            let sigma_m = sigma_m * parted.max(1.0);
            solved.refine(roof, stage.scene.bounds, config.optimise.height_reference, sigma_m);
        }
    }
    let unread: BTreeMap<usize, String> = unread.into_inner().unwrap_or_else(PoisonError::into_inner);
    unread.into_iter().map(|(photo, why)| (views[photo], why)).collect()
}

/// The standard deviation to state for each roof that the photos refine. Poses that are off show in how much photos left out
/// move the roofs around; a single roof may hide it by chance.
fn sigmas_m(scene: &Scene, found: &[Option<FoundRoof>]) -> Vec<Option<f64>> {
    let middle = |prism: &Prism| prism.centre_at(0.0).truncate().as_dvec2().to_array();
    let known = found
        .iter()
        .zip(&scene.prisms)
        .filter_map(|(found, prism)| Some(GeomWithData::new(middle(prism), found.as_ref()?.refined.sigma_m)));
    let known = RTree::bulk_load(known.collect());
    let around = |at: [f64; 2]| {
        let close: Vec<f64> = known.locate_within_distance(at, AROUND_M * AROUND_M).map(|near| near.data).collect();
        stats::median(&close).unwrap_or(0.0)
    };
    let of_one = |(found, prism): (&Option<FoundRoof>, &Prism)| {
        let found = found.as_ref()?;
        let spread_m = found.refined.sigma_m.max(around(middle(prism)));
        Some((SPREAD_SHARE * spread_m).hypot(SYSTEMATIC_M).hypot(found.form_m))
    };
    found.iter().zip(&scene.prisms).map(of_one).collect()
}

/// The roof on which the photos look alike most.
#[derive(Debug, Clone, Copy)]
struct FoundRoof {
    /// As the priors have its height.
    roof: Roof,
    refined: Refined,
    /// Standard deviation of the height over roofs of other pitches and forms on which the photos look nearly as much alike, metres.
    form_m: f64,
}

/// Standard deviation of heights over roofs, by how alike the photos look on each: heights and scores.
fn form_m(roofs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let roofs: Vec<(f64, f64)> = roofs.collect();
    let best = roofs.iter().map(|(_, score)| *score).fold(f64::NEG_INFINITY, f64::max);
    let weight = |score: f64| ((score - best) / SCORE_SCALE).exp();
    let sum: f64 = roofs.iter().map(|(_, score)| weight(*score)).sum();
    let mean_of = |of: &dyn Fn(f64) -> f64| {
        roofs.iter().map(|(height_m, score)| weight(*score) * of(*height_m)).sum::<f64>() / sum
    };
    let mean_m = mean_of(&|height_m| height_m);
    mean_of(&|height_m| (height_m - mean_m).powi(2)).sqrt()
}

/// Input of the look at roofs.
struct Roofs<'a> {
    stage: &'a SceneStage,
    settings: &'a RefinementConfig,
    photos: &'a [&'a View],
    tracer: &'a SceneTracer<'a>,
    album: &'a Album,
    /// By photo: why it cannot be read.
    unread: &'a Mutex<BTreeMap<usize, String>>,
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

    /// The roof on which the photos look alike most, at the height where they do.
    fn refine(&self, building: usize, roof: Option<&Roof>) -> Option<FoundRoof> {
        let (prism, settings, found) = (&self.stage.scene.prisms[building], self.settings, roof?);
        // A step takes places away: none has more than the flat one, which comes first.
        let mut candidates = optimise::candidates(prism, found, settings.clear_m as f32, settings.n_points);
        candidates.retain(|(_, places)| places.len() >= MIN_PLACES);
        let (_, level) = candidates.first()?;
        let pictures = self.pictures(building, level)?;
        let pictures: Vec<&Picture> = pictures.iter().map(|picture| &**picture).collect();
        let refine = |(roof, places): &(Roof, Vec<Vec3>), every: usize| {
            let in_map = places.iter().step_by(every).map(|p| p.as_dvec3() + self.stage.scene.origin.0);
            Some((*roof, photo_consistency::refine(&pictures, &in_map.collect::<Vec<_>>(), settings)?))
        };
        // Few places tell the better pitches of a form, all of them the form; of a few, what two photos share would be too few.
        let shows = |picture: &Picture, place: &Vec3| picture.shows(place.as_dvec3() + self.stage.scene.origin.0);
        let is_whole = pictures.iter().all(|picture| level.iter().all(|place| shows(picture, place)));
        let every = if is_whole { THINNED } else { 1 };
        let coarse: Vec<Option<Refined>> =
            candidates.iter().map(|candidate| Some(refine(candidate, every)?.1)).collect();
        let form_m = form_m(candidates.iter().zip(&coarse).filter_map(|((roof, _), refined)| {
            let refined = refined.as_ref()?;
            Some((roof.mean_m + refined.raised_m, refined.score))
        }));
        let best_of = |form: RoofForm| {
            let of_form = (0..candidates.len()).filter(|&i| candidates[i].0.form == form);
            of_form
                .filter_map(|i| Some((i, coarse[i].as_ref()?.score)))
                .max_by(|(_, a), (_, b)| a.total_cmp(b))
                .map(|(i, _)| i)
        };
        let forms = [RoofForm::Flat, RoofForm::Gable, RoofForm::Hip, RoofForm::Stepped, RoofForm::Mixed];
        let fine = forms.into_iter().filter_map(best_of);
        let merit = |(roof, refined): &(Roof, Refined)| {
            refined.score - if roof.form == found.form { 0.0 } else { OTHER_FORM_SCORE }
        };
        let mut all: Vec<(usize, (Roof, Refined))> =
            fine.filter_map(|i| Some((i, refine(&candidates[i], 1)?))).collect();
        all.sort_by(|(_, a), (_, b)| merit(b).total_cmp(&merit(a)));
        // The next best where the photos' favourite leaves out what the priors have seen.
        let is_believed = |(at, (roof, refined)): &(usize, (Roof, Refined))| {
            let is_step_lost = found.terrace.is_some() && roof.terrace.is_none();
            self.is_one_surface(&pictures, &candidates[*at].1, refined, is_step_lost)
        };
        let (_, (roof, refined)) = all.into_iter().find(is_believed)?;
        Some(FoundRoof { roof, refined, form_m })
    }

    /// Whether the photos look alike on all of a refined roof, and not on its best part alone.
    fn is_one_surface(&self, pictures: &[&Picture], places: &[Vec3], refined: &Refined, is_step_lost: bool) -> bool {
        let settings = self.settings;
        let in_map = |raised_m: f64| -> Vec<DVec3> {
            let origin = self.stage.scene.origin.0 + raised_m * DVec3::Z;
            places.iter().map(|p| p.as_dvec3() + origin).collect()
        };
        let elsewhere = photo_consistency::elsewhere_share(pictures, &in_map(0.0), refined, settings);
        if elsewhere > MAX_ELSEWHERE_SHARE {
            return false;
        }
        let raised = in_map(refined.raised_m);
        let agreement = photo_consistency::agreement(pictures, &raised, settings.min_score, settings.min_lead);
        let (min_known, min_same) =
            if is_step_lost { (MIN_KNOWN_OF_STEPPED, MIN_SAME_OF_STEPPED) } else { (0.0, MIN_SAME) };
        agreement.known >= min_known && agreement.same >= min_same
    }

    /// The photos to compare on a roof: from all sides, those that nothing hides it from.
    fn pictures(&self, building: usize, level: &[Vec3]) -> Option<Vec<Arc<Picture>>> {
        let middle = (level.iter().sum::<Vec3>() / level.len() as f32).as_dvec3() + self.stage.scene.origin.0;
        let sees = |photo: usize| self.sees(self.photos[photo], building, level);
        let chosen = photo_consistency::choose(self.photos, middle, self.settings.n_photos, sees);
        // A photo that cannot be read is told of and left out: the others will do.
        let read = |&photo: &usize| match self.album.picture(self.photos[photo]) {
            Ok(picture) => Some(picture),
            Err(why) => {
                self.unread.lock().unwrap_or_else(PoisonError::into_inner).insert(photo, why.to_string());
                None
            }
        };
        let pictures: Vec<_> = chosen.iter().filter_map(read).collect();
        (pictures.len() >= MIN_PHOTOS).then_some(pictures)
    }

    /// Whether a photo shows a roof: half of it, and most of that with nothing before it.
    fn sees(&self, photo: &View, building: usize, surface: &[Vec3]) -> bool {
        let origin = self.stage.scene.origin.0;
        let eye = (photo.centre() - origin).as_vec3();
        let mut scratch = Vec::new();
        let (mut n_asked, mut n_shown, mut n_free) = (0.0, 0.0, 0.0);
        for &place in surface.iter().step_by(surface.len().div_ceil(N_ASKED)) {
            n_asked += 1.0;
            if photo.pixel_of(place.as_dvec3() + origin).is_none() {
                continue;
            }
            n_shown += 1.0;
            let (way, face) = self.tracer.trace(&Ray::new(eye, place - eye), &mut scratch);
            if way.is_nan() || way > FREE_WAY || face.building().is_some_and(|met| met.at() == building) {
                n_free += 1.0;
            }
        }
        n_shown >= MIN_SHOWN * n_asked && n_free >= MIN_FREE * n_shown
    }
}

#[cfg(test)]
mod tests {
    use super::form_m;

    #[test]
    fn roofs_on_which_the_photos_look_as_much_alike_leave_the_height_open() {
        let of = |roofs: &[(f64, f64)]| form_m(roofs.iter().copied());
        assert!((of(&[(10.0, 0.8), (12.0, 0.8)]) - 1.0).abs() < 1e-9);
        assert!(of(&[(10.0, 0.8), (12.0, 0.6)]) < 0.02, "by far the best");
        assert!(of(&[(10.0, 0.8)]) == 0.0);
    }
}
