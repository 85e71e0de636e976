//! Single buildings for the report: which ones, in which photos, and what those show.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3, Vec2};
use image::RgbImage;
use rayon::prelude::*;

use super::super::HeightStage;
use super::super::priors::PriorStore;
use super::super::scene::SceneStage;
use super::super::settings::HeightSettings;
use sizeup_heights::optimise::{InspectedView, Inspection, Problem, Rays, SolvedHeight, inspect};
use sizeup_heights::raster::Raster;
use sizeup_heights::render::PlacedCamera;
use sizeup_heights::render::image::SceneTracer;
use sizeup_heights::scene::Prism;
use sizeup_heights::views::from_all_sides;
use sizeup_photos::prior::{DepthPrior, PriorKind};
use sizeup_results::output::picture::{PhotoCrop, depth_picture, photo_of};
use sizeup_results::report::{BuildingEvidence, ComparedPair, Crop, EdgeLine, LineKind};
use sizeup_survey::{Survey, View};

/// Buildings shown with photos, depths and score curves, at most: doubtful ones first, then the least certain. Each adds some
/// 100 kB to the page.
const EVIDENCE_BUILDINGS: usize = 40;
/// Photos of each of them, at most.
const EVIDENCE_VIEWS: usize = 4;
/// Width of their cut-outs, pixels, at most.
const PICTURE_PX: u32 = 320;

/// Photos whose priors are computed anew where neither file nor cache holds them, at most: a network takes seconds for each.
const MAX_COMPUTED_VIEWS: usize = 12;
/// Photos that are in memory at a time.
const PHOTOS_AT_A_TIME: usize = 4;
/// Depth pictures are this much smaller than photos: priors hold no more.
const DEPTH_SHARE: f64 = 0.5;
/// Other buildings further than this from the one shown are not drawn, metres.
const NEIGHBOURHOOD_M: f32 = 150.0;

/// Gathers what there is to see of the buildings that deserve it most.
pub(in crate::pipeline) fn gather(
    settings: &HeightSettings<'_>,
    survey: &Survey,
    stage: &SceneStage,
    heights: &HeightStage,
    priors: &PriorStore,
) -> Vec<BuildingEvidence> {
    let wanted = choose(&heights.solution.heights, |view| priors.is_at_hand(view));
    let problem = Problem {
        scene: &stage.scene,
        views: &settings.view_inputs(survey, &stage.scene),
        without_prior: &|_| None,
        load_prior: &|view| priors.load(view).map_err(|e| e.to_string()),
        seed: settings.seed,
        rays: &Rays::new(survey.views.len(), settings.method.optimise.stride_px),
        green: &|view| priors.green(view),
        former: None,
        progress: &|_, _, _| {},
    };
    let inspections = inspect(&problem, &settings.optimise(), &heights.solution, &wanted);
    let by_view = crops_by_view(&inspections, &problem, EVIDENCE_VIEWS);
    let solved = &heights.solution.heights;
    let heights_m: Vec<f32> =
        solved.iter().map(|h| h.height_m.map_or(stage.scene.bounds.min_m, |h| h as f32)).collect();
    let tracer = SceneTracer::new(&stage.scene, &heights_m);
    let crops = Studio { survey, stage, solved, tracer, priors }.shoot_all(&by_view, &inspections);
    let pairs = inspections.into_iter().zip(crops);
    pairs.map(|(inspection, crops)| evidence_of(heights.solved[inspection.building], inspection, crops)).collect()
}

/// Evidence shown of one building, the views that see most of it first.
fn evidence_of(building: usize, inspection: Inspection, mut crops: Vec<Crop>) -> BuildingEvidence {
    let n_rays = |view: usize| inspection.views.iter().find(|v| v.view == view).map_or(0, |v| v.n_rays);
    crops.sort_by_key(|crop| (std::cmp::Reverse(n_rays(crop.view)), crop.view));
    let scored = inspection.views.into_iter().filter(|v| !v.scores.is_empty());
    let scores = scored.map(|v| (v.view, v.scores)).collect();
    BuildingEvidence { building, heights_m: inspection.heights_m, scores, crops }
}

/// The buildings to show with the views to look at them in: doubtful ones first, then the least certain. Views whose
/// priors are at hand cost nothing; of the others there are only some.
fn choose(solved: &[SolvedHeight], is_at_hand: impl Fn(usize) -> bool) -> Vec<(usize, Vec<usize>)> {
    let mut ranked: Vec<usize> = (0..solved.len()).filter(|&b| !solved[b].views.is_empty()).collect();
    let sigma = |b: usize| solved[b].sigma_m.unwrap_or(f64::INFINITY);
    ranked.sort_by(|&a, &b| {
        let is_sure = |b: usize| solved[b].reasons.is_empty();
        is_sure(a).cmp(&is_sure(b)).then(sigma(b).total_cmp(&sigma(a))).then(a.cmp(&b))
    });
    let mut computed: BTreeSet<usize> = BTreeSet::new();
    let mut wanted = Vec::new();
    for b in ranked {
        if wanted.len() == EVIDENCE_BUILDINGS {
            break;
        }
        let (mut views, others): (Vec<usize>, Vec<usize>) =
            solved[b].views.iter().partition(|&&view| is_at_hand(view) || computed.contains(&view));
        for view in others {
            if views.len() < EVIDENCE_VIEWS && computed.len() < MAX_COMPUTED_VIEWS {
                computed.insert(view);
                views.push(view);
            }
        }
        if !views.is_empty() {
            views.sort_unstable();
            wanted.push((b, views));
        }
    }
    wanted
}

/// For every view, which buildings (positions in `inspections`) are shown in it: for each building the views that see
/// most of it, from each sector of azimuth in turn.
fn crops_by_view(inspections: &[Inspection], problem: &Problem<'_>, n_views: usize) -> BTreeMap<usize, Vec<usize>> {
    let mut by_view: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (at, inspection) in inspections.iter().enumerate() {
        let prism = &problem.scene.prisms[inspection.building];
        let centre = prism.centre_at(prism.ground_z).as_dvec3();
        let mut seeing: Vec<&InspectedView> = inspection.views.iter().filter(|v| v.n_rays > 0).collect();
        seeing.sort_by_key(|v| (std::cmp::Reverse(v.n_rays), v.view));
        let from = seeing.iter().map(|seen| (problem.views[seen.view].placed.eye() - centre).truncate());
        for rank in from_all_sides(from, n_views) {
            by_view.entry(seeing[rank].view).or_default().push(at);
        }
    }
    by_view
}

/// Maker of the report's pictures, with what they are rendered from.
struct Studio<'a> {
    survey: &'a Survey,
    stage: &'a SceneStage,
    solved: &'a [SolvedHeight],
    tracer: SceneTracer<'a>,
    priors: &'a PriorStore,
}

/// One view with what is known of it.
struct SeenView<'a> {
    view_idx: usize,
    view: &'a View,
    placed: PlacedCamera,
    photo: Option<RgbImage>,
    prior: Option<DepthPrior>,
}

impl Studio<'_> {
    /// All pictures, by inspection; some photos at a time.
    fn shoot_all(&self, by_view: &BTreeMap<usize, Vec<usize>>, inspections: &[Inspection]) -> Vec<Vec<Crop>> {
        let mut crops: Vec<Vec<Crop>> = vec![Vec::new(); inspections.len()];
        let by_view: Vec<(&usize, &Vec<usize>)> = by_view.iter().collect();
        for views in by_view.chunks(PHOTOS_AT_A_TIME) {
            let shot: Vec<Vec<(usize, Crop)>> =
                views.par_iter().map(|(view, shown)| self.shoot(**view, shown, inspections)).collect();
            for (at, crop) in shot.into_iter().flatten() {
                crops[at].push(crop);
            }
        }
        crops
    }

    /// The buildings that are shown in one view.
    fn shoot(&self, view_idx: usize, shown: &[usize], inspections: &[Inspection]) -> Vec<(usize, Crop)> {
        let view = &self.survey.views[view_idx];
        let seen = SeenView {
            view_idx,
            view,
            placed: PlacedCamera::new((*view.camera).clone(), view.camera_from_map, self.stage.scene.origin),
            photo: view.image.as_ref().and_then(|_| photo_of(view).ok()),
            prior: self.priors.load(view_idx).ok(),
        };
        shown.iter().filter_map(|&at| Some((at, self.crop(&seen, &inspections[at])?))).collect()
    }

    /// One building in one view.
    fn crop(&self, seen: &SeenView<'_>, inspection: &Inspection) -> Option<Crop> {
        let cut = self.cut(inspection.building, &seen.placed)?;
        let inspected = inspection.views.iter().find(|v| v.view == seen.view_idx)?;
        let size_px = Self::size_px(cut);
        let depth_px = size_px.map(|n| ((f64::from(n) * DEPTH_SHARE) as u32).max(1));
        let picture = |depth: &Raster<f32>, kind: PriorKind| depth_picture(depth, kind, depth_px[0], depth_px[1]);
        let prior = seen.prior.as_ref();
        Some(Crop {
            view: seen.view_idx,
            photo: seen.photo.as_ref().map(|photo| cut.cut_out(photo, seen.view, size_px)),
            rendered: picture(&self.rendered(&seen.placed, cut, depth_px), PriorKind::Depth),
            prior: prior.map(|prior| picture(&cut_prior(prior, seen.view, cut, depth_px), prior.kind)),
            lines: self.lines(inspection.building, &seen.placed, cut),
            pairs: pairs(inspected, seen.view, cut),
        })
    }

    /// The part of a photo that shows a building; `None` where it lies outside.
    fn cut(&self, building: usize, placed: &PlacedCamera) -> Option<PhotoCrop> {
        let prism = &self.stage.scene.prisms[building];
        let roof_z = prism.ground_z + self.solved[building].height_m? as f32;
        let corners = prism.edges().flat_map(|(a, _)| [a.extend(prism.base_z), a.extend(roof_z)]);
        let seen: Vec<DVec2> = corners.filter_map(|p| placed.project(p.as_dvec3())).collect();
        PhotoCrop::around(&seen, DVec2::new(f64::from(placed.camera.width_px), f64::from(placed.camera.height_px)))
    }

    /// Size of its picture: never larger than the part of the photo.
    fn size_px(cut: PhotoCrop) -> [u32; 2] {
        let scale = (f64::from(PICTURE_PX) / cut.size.x).min(1.0);
        (cut.size * scale).round().max(DVec2::ONE).to_array().map(|n| n as u32)
    }

    fn rendered(&self, placed: &PlacedCamera, cut: PhotoCrop, size_px: [u32; 2]) -> Raster<f32> {
        let mut scratch = Vec::new();
        sampled(cut, size_px, |pixel| placed.ray(pixel).map_or(f32::NAN, |ray| self.tracer.trace(&ray, &mut scratch).0))
    }

    /// Edges of the building and of the roofs around it.
    fn lines(&self, building: usize, placed: &PlacedCamera, cut: PhotoCrop) -> Vec<EdgeLine> {
        let prisms = &self.stage.scene.prisms;
        let middle = |prism: &Prism| prism.centre_at(0.0).truncate();
        let here = middle(&prisms[building]);
        let mut lines = Vec::new();
        for (i, prism) in prisms.iter().enumerate() {
            let Some(height_m) = self.solved[i].height_m else { continue };
            if i != building && middle(prism).distance(here) > NEIGHBOURHOOD_M {
                continue;
            }
            let roof_z = prism.ground_z + height_m as f32;
            for (a, b) in prism.edges() {
                let mut edge = |kind, from, to| lines.extend(line(placed, cut, kind, [from, to]));
                if i == building {
                    edge(LineKind::Wall, (a, prism.base_z), (b, prism.base_z));
                    edge(LineKind::Wall, (a, prism.base_z), (a, roof_z));
                }
                let kind = if i == building { LineKind::Roof } else { LineKind::Other };
                edge(kind, (a, roof_z), (b, roof_z));
            }
        }
        lines
    }
}

/// An edge as a picture shows it; `None` where it lies beside the picture.
fn line(placed: &PlacedCamera, cut: PhotoCrop, kind: LineKind, ends: [(Vec2, f32); 2]) -> Option<EdgeLine> {
    let place = |(at, z): (Vec2, f32)| {
        let pixel = placed.project(DVec3::new(at.x.into(), at.y.into(), z.into()))?;
        Some(cut.share_of(pixel).as_vec2())
    };
    let (a, b) = (place(ends[0])?, place(ends[1])?);
    let (low, high) = (a.min(b), a.max(b));
    let is_inside = (low.cmplt(Vec2::ONE) & high.cmpgt(Vec2::ZERO)).all();
    is_inside.then(|| EdgeLine { kind, ends: [a.to_array(), b.to_array()] })
}

/// Values at the middles of a picture's pixels.
fn sampled(cut: PhotoCrop, [width, height]: [u32; 2], mut value: impl FnMut(DVec2) -> f32) -> Raster<f32> {
    let (width, height) = (width as usize, height as usize);
    let size = DVec2::new(width as f64, height as f64);
    let at = |i: usize| cut.corner + (DVec2::new((i % width) as f64, (i / width) as f64) + 0.5) / size * cut.size;
    let values = (0..width * height).map(|i| value(at(i))).collect();
    Raster::from_vec(width, height, values).expect("one value per pixel")
}

fn cut_prior(prior: &DepthPrior, view: &View, cut: PhotoCrop, size_px: [u32; 2]) -> Raster<f32> {
    sampled(cut, size_px, |pixel| prior.value_at(&view.camera, pixel))
}

fn pairs(seen: &InspectedView, view: &View, cut: PhotoCrop) -> Vec<ComparedPair> {
    let camera = DVec2::new(f64::from(view.camera.width_px), f64::from(view.camera.height_px));
    let place = |end: [f32; 2]| cut.share_of(Vec2::from(end).as_dvec2() * camera).as_vec2();
    let is_inside = |p: Vec2| (p.cmpge(Vec2::ZERO) & p.cmple(Vec2::ONE)).all();
    let pair = |pair: &sizeup_heights::optimise::InspectedPair| {
        let ends = pair.ends.map(place);
        ends.iter().all(|&p| is_inside(p)).then(|| ComparedPair { ends: ends.map(|p| p.to_array()), cost: pair.cost })
    };
    seen.pairs.iter().filter_map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_heights::optimise::Reason;

    #[test]
    fn views_at_hand_are_all_looked_at_and_of_the_others_no_more_than_can_be_computed() {
        let solved = |b: usize| SolvedHeight {
            height_m: Some(9.0),
            sigma_m: Some(b as f64),
            views: (6 * b..6 * b + 6).collect(),
            reasons: if b == 2 { vec![Reason::TooFewViews] } else { Vec::new() },
            ..SolvedHeight::default()
        };
        let solved: Vec<SolvedHeight> = (0..50).map(solved).collect();
        let at_hand = choose(&solved, |_| true);
        assert_eq!(
            (at_hand.len(), &at_hand[0]),
            (EVIDENCE_BUILDINGS, &(2, (12..18).collect())),
            "the doubtful one first, in all its views"
        );
        assert_eq!(at_hand[1].0, 49, "then the least certain");
        let computed = choose(&solved, |_| false);
        assert_eq!(computed[0], (2, (12..16).collect()));
        assert_eq!(computed.iter().map(|(_, views)| views.len()).sum::<usize>(), MAX_COMPUTED_VIEWS);
    }
}
