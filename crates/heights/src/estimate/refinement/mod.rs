//! Roof heights refined by the photos, where these show the roof and agree on it better than the priors do.
//!
//! The order of depths finds the roof, to half a metre or so; the photos, laid onto it, say where exactly it is. Photos
//! alone would not do: within a wider range there are false matches. Where they are not clear enough to be believed, their height is
//! weighed against that of the priors:
//!
//! ```text
//! h = h₁ + (h₂ − h₁) σ₁²/(σ₁² + σ₂²)      1: priors, 2: photos
//! σ₂² = s²/p                              p: share of the roof's places that the photos find on the roof
//! ```

mod levels;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::parts::Parts;
use super::task::{NamedCamera, Photos};
use crate::optimise::{self, Doubts, Roof, Solution, SolvedHeight};
use crate::photo_consistency::{
    self, FLATTEST, FLATTEST_OF_FEW, MIN_PHOTOS, MIN_PLACES, PhotoAgreement, Refined, RefinementConfig,
};
use crate::picture::{Picture, PosedCamera};
use crate::ray::Ray;
use crate::render::image::SceneTracer;
use crate::scene::{HeightReference, Prism, RoofForm, Scene};
use crate::stats;

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

/// Standard deviation of the height by photos that are not clear, were they to find all places of a roof on it, metres. Fitted, for the
/// least error, to 197 roofs that simulated photos were not clear on, half of them real ones (towns of seeds 31 and 32; Rotterdam,
/// west): 0.46 m off by the priors, 0.38 m weighed.
const UNCLEAR_M: f64 = 0.4;

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

/// Refinement of the roofs of a scene.
pub(super) struct Refinement<'a> {
    pub settings: &'a RefinementConfig,
    /// Which of a roof's heights is stated.
    pub reference: HeightReference,
    /// Offset that the photos were moved by, map frame, metres.
    pub moved_m: DVec3,
    /// Whether footprints are split where the photos show several roof levels.
    pub split_levels: bool,
}

impl Refinement<'_> {
    /// Raises and lowers the roofs of a solution to where the photos look alike, and splits footprints that hold several roof levels.
    /// Returns the photos that cannot be read, and why.
    pub fn run(
        &self,
        views: &[NamedCamera],
        photos: &dyn Photos,
        scene: &mut Scene,
        parts: &mut Parts,
        solution: &mut Solution,
    ) -> Vec<(usize, String)> {
        let &Self { settings, reference, moved_m, split_levels } = self;
        let with_photo: Vec<usize> = (0..views.len()).filter(|&view| photos.has(view)).collect();
        if with_photo.len() < MIN_PHOTOS {
            return Vec::new();
        }
        let posed = |&view: &usize| {
            let PosedCamera { camera, camera_from_map } = views[view].posed.clone();
            PosedCamera { camera, camera_from_map: camera_from_map.moved(moved_m) }
        };
        let cameras: Vec<PosedCamera> = with_photo.iter().map(posed).collect();
        let picture = |photo: usize| {
            let read = photos.picture(with_photo[photo]);
            read.map(|picture| if moved_m == DVec3::ZERO { picture } else { Arc::new(picture.moved(moved_m)) })
        };
        let unread = Mutex::default();
        let album = Album { settings, cameras: &cameras, picture: &picture, unread: &unread };
        let (found, found_levels) = {
            let tracer = SceneTracer::new(scene, &roof_heights(&solution.heights));
            let roofs = Roofs { scene, tracer: &tracer, album: &album };
            let found = roofs.refine_all(&solution.heights);
            let levels = if split_levels { roofs.find_levels(parts, &solution.heights) } else { Vec::new() };
            (found, levels)
        };
        let found = levels::split(&album, scene, parts, solution, found, found_levels);
        let spreads_m = spreads_m(scene, &found);
        for ((solved, found), around_m) in solution.heights.iter_mut().zip(found).zip(spreads_m) {
            // Where no roof around is one on which the photos agree, they have shown nothing of their poses.
            let Some((found, around_m)) = found.zip(around_m) else { continue };
            if let Some((roof, sigma_m)) = believed(solved, &found, around_m, settings) {
                solved.refine(roof, scene.bounds, reference, sigma_m);
            } else if let Some((roof, sigma_m)) = weighed(solved, &found, around_m, settings) {
                solved.lean(roof, scene.bounds, reference, sigma_m);
            }
        }
        let unread: BTreeMap<usize, String> = unread.into_inner().unwrap_or_else(PoisonError::into_inner);
        unread.into_iter().map(|(photo, why)| (with_photo[photo], why)).collect()
    }
}

/// Mean heights of roofs, metres; 0 where there is none.
fn roof_heights(heights: &[SolvedHeight]) -> Vec<f32> {
    heights.iter().map(|solved| solved.roof.map_or(0.0, |roof| roof.mean_m as f32)).collect()
}

/// The roof that the photos show and the standard deviation to state, metres, where they are clear, and more certain than the priors.
fn believed(
    solved: &SolvedHeight,
    found: &FoundRoof,
    around_m: f64,
    settings: &RefinementConfig,
) -> Option<(Roof, f64)> {
    let Refined { sigma_m, raised_m, .. } = found.refined;
    if !found.is_clear(settings) {
        return None;
    }
    let sigma_m = (SPREAD_SHARE * sigma_m.max(around_m)).hypot(SYSTEMATIC_M).hypot(found.form_m);
    let roof = found.roof.raised(raised_m);
    // The photos try all forms themselves: what the priors leave open between them makes no photo more certain.
    let of_priors_m = solved.sigma_m.map(|_| {
        let Doubts { views_m, pixel_m, .. } = solved.doubts;
        solved.doubts.sigma_of_known_form_m().max((PRIOR_VIEWS_SHARE * views_m).hypot(PRIOR_PX * pixel_m))
    });
    if roof.eave_m <= 0.0 || of_priors_m.is_some_and(|of_priors_m| sigma_m >= of_priors_m) {
        return None;
    }
    let parted = solved.roof.filter(|_| solved.sigma_m.is_some()).map_or(1.0, |before| {
        parted(roof.mean_m - before.mean_m, sigma_m.hypot(solved.doubts.sigma_beside_photos_m()))
    });
    Some((roof, sigma_m * parted))
}

/// The roof of the priors, moved towards where photos look alike most that are not clear enough to be believed, and the standard
/// deviation to state, metres.
fn weighed(
    solved: &SolvedHeight,
    found: &FoundRoof,
    around_m: f64,
    settings: &RefinementConfig,
) -> Option<(Roof, f64)> {
    let before = solved.roof.filter(|_| solved.sigma_m.is_some())?;
    let of_priors_m = solved.doubts.sigma_beside_photos_m();
    let share = found.agreement.known * found.agreement.same;
    // Of priors that know so little, the photos were asked for a small part of what may be.
    if share <= 0.0 || of_priors_m >= settings.within_m {
        return None;
    }
    let of_photos_m = (UNCLEAR_M / share.sqrt()).hypot(SPREAD_SHARE * around_m);
    let both_m = of_priors_m.hypot(of_photos_m);
    let apart_m = found.roof.mean_m + found.refined.raised_m - before.mean_m;
    let roof = before.raised(apart_m * (of_priors_m / both_m).powi(2));
    let sigma_m = of_priors_m * of_photos_m / both_m * parted(apart_m, both_m);
    (roof.eave_m > 0.0).then_some((roof, sigma_m))
}

/// By how much two heights that are so far apart make a standard deviation larger, where that is more than both allow: one of them is
/// wrong (Birge's ratio).
fn parted(apart_m: f64, both_m: f64) -> f64 {
    (apart_m.abs() / both_m).max(1.0)
}

/// By building: standard error over photos of the roofs around, metres; `None` where they agree on no roof. Poses that are off show
/// in how much photos left out move the roofs around; a single roof may hide it by chance.
fn spreads_m(scene: &Scene, found: &[Option<FoundRoof>]) -> Vec<Option<f64>> {
    let middle = |prism: &Prism| prism.centre_at(0.0).truncate().as_dvec2().to_array();
    let known = found.iter().zip(&scene.prisms).filter_map(|(found, prism)| {
        let found = found.as_ref().filter(|found| found.is_one_surface)?;
        Some(GeomWithData::new(middle(prism), found.refined.sigma_m))
    });
    let known = RTree::bulk_load(known.collect());
    let around = |prism: &Prism| {
        let close = known.locate_within_distance(middle(prism), AROUND_M * AROUND_M).map(|near| near.data);
        stats::median(&close.collect::<Vec<f64>>())
    };
    scene.prisms.iter().map(around).collect()
}

/// The roof on which the photos look alike most.
#[derive(Debug, Clone, Copy)]
struct FoundRoof {
    /// As the priors have its height.
    roof: Roof,
    refined: Refined,
    /// Standard deviation of the height over roofs of other pitches and forms on which the photos look nearly as much alike, metres.
    form_m: f64,
    /// Agreement of the photos with it, place by place.
    agreement: PhotoAgreement,
    /// Whether they look alike on all of it, and not on its best part alone.
    is_one_surface: bool,
}

impl FoundRoof {
    /// Whether the photos agree on all of it, and on nothing else as well.
    fn is_clear(&self, settings: &RefinementConfig) -> bool {
        self.is_one_surface && self.refined.score >= settings.min_score && self.refined.lead >= settings.min_lead
    }
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

/// Photos with their cameras.
struct Album<'a> {
    settings: &'a RefinementConfig,
    cameras: &'a [PosedCamera],
    /// Reads a photo, by its position among the cameras.
    picture: &'a (dyn Fn(usize) -> Result<Arc<Picture>, String> + Sync),
    /// By photo: why it cannot be read.
    unread: &'a Mutex<BTreeMap<usize, String>>,
}

/// Roofs of a scene, and the photos that show them.
struct Roofs<'a> {
    scene: &'a Scene,
    /// Tracer through the scene with all roofs at their heights.
    tracer: &'a SceneTracer<'a>,
    album: &'a Album<'a>,
}

impl Roofs<'_> {
    /// By building: the roof on which the photos look alike most.
    fn refine_all(&self, heights: &[SolvedHeight]) -> Vec<Option<FoundRoof>> {
        self.for_each(&|b| self.refine(b, heights[b].roof.as_ref()))
    }

    /// Calls a function for each building, neighbours together so that they share photos.
    fn for_each<T: Send>(&self, of: &(dyn Fn(usize) -> Option<T> + Sync)) -> Vec<Option<T>> {
        let mut results: Vec<Option<T>> = self.scene.prisms.iter().map(|_| None).collect();
        for together in self.by_square().chunks(N_TOGETHER) {
            for (b, result) in together.par_iter().map(|&b| (b, of(b))).collect::<Vec<_>>() {
                results[b] = result;
            }
        }
        results
    }

    /// All buildings, neighbours together.
    fn by_square(&self) -> Vec<usize> {
        let square = |b: usize| {
            let at = self.scene.prisms[b].centre_at(0.0) / SQUARE_M;
            (at.y.floor() as i32, at.x.floor() as i32)
        };
        let mut order: Vec<usize> = (0..self.scene.prisms.len()).collect();
        order.sort_by_key(|&b| square(b));
        order
    }

    /// The roof on which the photos look alike most, at the height where they do.
    fn refine(&self, building: usize, roof: Option<&Roof>) -> Option<FoundRoof> {
        let (prism, settings, found) = (&self.scene.prisms[building], self.album.settings, roof?);
        // A step takes places away: none has more than the flat one, which comes first.
        let mut candidates = optimise::candidates(prism, found, settings.clear_m as f32, settings.n_points);
        candidates.retain(|(_, places)| places.len() >= MIN_PLACES);
        let (_, level) = candidates.first()?;
        let pictures = self.pictures(building, level)?;
        let pictures: Vec<&Picture> = pictures.iter().map(|picture| &**picture).collect();
        let refine = |(roof, places): &(Roof, Vec<Vec3>), every: usize| {
            let in_map = places.iter().step_by(every).map(|p| p.as_dvec3() + self.scene.origin.0);
            Some((*roof, photo_consistency::refine(&pictures, &in_map.collect::<Vec<_>>(), settings)?))
        };
        // Few places tell the better pitches of a form, all of them the form; of a few, what two photos share would be too few.
        let shows = |picture: &Picture, place: &Vec3| picture.shows(place.as_dvec3() + self.scene.origin.0);
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
        let forms = [RoofForm::Flat, RoofForm::Gable, RoofForm::Hip, RoofForm::Stepped];
        let fine = forms.into_iter().filter_map(best_of);
        let merit = |(roof, refined): &(Roof, Refined)| {
            refined.score - if roof.form == found.form { 0.0 } else { OTHER_FORM_SCORE }
        };
        let mut all: Vec<(usize, (Roof, Refined))> =
            fine.filter_map(|i| Some((i, refine(&candidates[i], 1)?))).collect();
        all.sort_by(|(_, a), (_, b)| merit(b).total_cmp(&merit(a)));
        // The next best where the photos' favourite leaves out what the priors have seen.
        let mut favourite = None;
        for (at, (roof, refined)) in all {
            let is_step_lost = found.terrace.is_some() && roof.terrace.is_none();
            let (agreement, is_one_surface) = self.is_one_surface(&pictures, &candidates[at].1, &refined, is_step_lost);
            let roof = FoundRoof { roof, refined, form_m, agreement, is_one_surface };
            if is_one_surface {
                return Some(roof);
            }
            favourite.get_or_insert(roof);
        }
        favourite
    }

    /// Agreement of the photos with a refined roof, place by place, and whether they look alike on all of it, and not on its best part
    /// alone.
    fn is_one_surface(
        &self,
        pictures: &[&Picture],
        places: &[Vec3],
        refined: &Refined,
        is_step_lost: bool,
    ) -> (PhotoAgreement, bool) {
        let settings = self.album.settings;
        let in_map = |raised_m: f64| -> Vec<DVec3> {
            let origin = self.scene.origin.0 + raised_m * DVec3::Z;
            places.iter().map(|p| p.as_dvec3() + origin).collect()
        };
        let raised = in_map(refined.raised_m);
        let agreement = photo_consistency::agreement(pictures, &raised, settings.min_score, settings.min_lead);
        let (min_known, min_same) =
            if is_step_lost { (MIN_KNOWN_OF_STEPPED, MIN_SAME_OF_STEPPED) } else { (0.0, MIN_SAME) };
        let is_one = agreement.known >= min_known
            && agreement.same >= min_same
            && photo_consistency::elsewhere_share(pictures, &in_map(0.0), refined, settings) <= MAX_ELSEWHERE_SHARE;
        (agreement, is_one)
    }

    /// The photos to compare on a roof: from all sides, those that nothing hides it from.
    fn pictures(&self, building: usize, level: &[Vec3]) -> Option<Vec<Arc<Picture>>> {
        let middle = (level.iter().sum::<Vec3>() / level.len() as f32).as_dvec3() + self.scene.origin.0;
        let Album { settings, cameras, picture, unread } = self.album;
        let sees = |photo: usize| self.sees(&cameras[photo], building, level);
        let choose = |flattest| photo_consistency::choose(cameras, middle, settings.n_photos, flattest, sees);
        let mut chosen = choose(FLATTEST);
        if chosen.len() < MIN_PHOTOS {
            chosen = choose(FLATTEST_OF_FEW);
        }
        // A photo that cannot be read is told of and left out: the others will do.
        let read = |&photo: &usize| match picture(photo) {
            Ok(picture) => Some(picture),
            Err(why) => {
                unread.lock().unwrap_or_else(PoisonError::into_inner).insert(photo, why);
                None
            }
        };
        let pictures: Vec<_> = chosen.iter().filter_map(read).collect();
        (pictures.len() >= MIN_PHOTOS).then_some(pictures)
    }

    /// Whether a photo shows a roof: half of it, and most of that with nothing before it.
    fn sees(&self, photo: &PosedCamera, building: usize, surface: &[Vec3]) -> bool {
        let origin = self.scene.origin.0;
        let eye = (photo.camera_from_map.centre() - origin).as_vec3();
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
    use super::*;

    #[test]
    fn roofs_on_which_the_photos_look_as_much_alike_leave_the_height_open() {
        let of = |roofs: &[(f64, f64)]| form_m(roofs.iter().copied());
        assert!((of(&[(10.0, 0.8), (12.0, 0.8)]) - 1.0).abs() < 1e-9);
        assert!(of(&[(10.0, 0.8), (12.0, 0.6)]) < 0.02, "by far the best");
        assert!(of(&[(10.0, 0.8)]) == 0.0);
    }

    /// Doubts that add up to a standard deviation, metres: views that differ.
    fn doubts_of(sigma_m: f64) -> Doubts {
        let of_a_metre = Doubts { views_m: 1.0, ..Doubts::default() };
        Doubts { views_m: sigma_m / of_a_metre.sigma_m(), ..of_a_metre }
    }

    fn solved(height_m: f64, sigma_m: f64) -> SolvedHeight {
        let roof = Some(Roof::flat(height_m));
        let doubts = doubts_of(sigma_m);
        SolvedHeight { height_m: Some(height_m), roof, sigma_m: Some(sigma_m), doubts, ..SolvedHeight::default() }
    }

    /// Photos that look alike most so far above a roof of 10 m, and find this share of its places there.
    fn unclear(raised_m: f64, share: f64) -> FoundRoof {
        FoundRoof {
            roof: Roof::flat(10.0),
            refined: Refined { raised_m, sigma_m: 0.05, score: 0.45, lead: 0.05 },
            form_m: 0.0,
            agreement: PhotoAgreement { known: 0.8, same: share / 0.8 },
            is_one_surface: false,
        }
    }

    #[test]
    fn photos_that_are_not_clear_are_weighed_against_the_priors() {
        let settings = RefinementConfig::default();
        let weigh = |sigma_m, found: &FoundRoof, around_m| weighed(&solved(10.0, sigma_m), found, around_m, &settings);
        let share = 0.64;
        let of_photos_m = UNCLEAR_M / 0.8;
        // Both as certain: half way, and the two part by more than both allow.
        let (roof, sigma_m) = weigh(of_photos_m, &unclear(1.0, share), 0.0).unwrap();
        assert!((roof.mean_m - 10.5).abs() < 1e-9, "{roof:?}");
        assert!((sigma_m - 0.5).abs() < 1e-9, "{sigma_m}: half of what lies between them");
        // They agree: more certain than either.
        let (roof, sigma_m) = weigh(of_photos_m, &unclear(0.0, share), 0.0).unwrap();
        assert!(roof.mean_m == 10.0 && (sigma_m - of_photos_m / 2.0_f64.sqrt()).abs() < 1e-9);
        let moved = |sigma_m, found: &FoundRoof, around_m| weigh(sigma_m, found, around_m).unwrap().0.mean_m - 10.0;
        let usual = moved(0.4, &unclear(1.0, share), 0.0);
        assert!(moved(0.2, &unclear(1.0, share), 0.0) < usual, "priors that are more certain");
        assert!(moved(0.4, &unclear(1.0, share / 2.0), 0.0) < usual, "less of the roof is found there");
        assert!(
            moved(0.4, &unclear(1.0, share), 0.5) < usual / 2.0,
            "photos move the roofs around, left out one by one"
        );
        assert!(weigh(0.4, &unclear(1.0, 0.0), 0.0).is_none(), "no place of the roof is found there");
        assert!(weigh(4.6, &unclear(1.0, share), 0.0).is_none(), "the photos were asked within 3 m");
    }

    #[test]
    fn photos_have_to_be_clear_to_be_believed() {
        let settings = RefinementConfig::default();
        let clear = FoundRoof {
            refined: Refined { raised_m: 0.3, sigma_m: 0.05, score: 0.8, lead: 0.4 },
            is_one_surface: true,
            ..unclear(0.3, 0.9)
        };
        let doubts = Doubts { views_m: 0.5, ..Doubts::default() };
        let priors = SolvedHeight { doubts, ..solved(10.0, 0.4) };
        let believe = |found: &FoundRoof| believed(&priors, found, 0.0, &settings).map(|(roof, _)| roof.mean_m);
        assert_eq!(believe(&clear), Some(10.3));
        assert_eq!(believe(&FoundRoof { is_one_surface: false, ..clear }), None);
        assert_eq!(believe(&FoundRoof { refined: Refined { score: 0.45, ..clear.refined }, ..clear }), None);
        assert_eq!(believe(&FoundRoof { refined: Refined { lead: 0.05, ..clear.refined }, ..clear }), None);
        assert_eq!(believe(&FoundRoof { form_m: 0.6, ..clear }), None, "less certain than the priors");
    }
}
