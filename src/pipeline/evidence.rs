//! Single buildings for the report: which ones, in which photos, and what those show.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Mutex;

use glam::{DVec2, DVec3, Vec2};
use image::RgbImage;
use image::imageops::{FilterType, crop_imm, resize};
use rayon::prelude::*;

use super::heights::view_inputs;
use super::stages::SceneStage;
use super::{HeightStage, pictures};
use crate::config::RunConfig;
use crate::optimise::{InspectedView, Inspection, Problem, SolvedHeight, inspect};
use crate::output::picture::depth_picture;
use crate::prior::{DepthPrior, PriorKind, PriorSource as _, Priors};
use crate::raster::Raster;
use crate::render::PlacedCamera;
use crate::render::image::SceneTracer;
use crate::report::{Crop, Evidence, Line, LineKind, Pair, ReportConfig};
use crate::scene::Prism;
use crate::survey::{Survey, View};

/// Photos whose priors are computed anew where neither file nor cache holds them, at most: a network takes seconds for each.
const MAX_COMPUTED_VIEWS: usize = 12;
/// Photos that are in memory at a time.
const PHOTOS_AT_A_TIME: usize = 4;
/// Sectors of azimuth that a building's photos are chosen from.
const N_SECTORS: usize = 4;
/// What is shown around a building, shares of its own size in the photo, and at least, pixels of the photo.
const AROUND_SHARE: f64 = 0.45;
const LEAST_AROUND_PX: f64 = 12.0;
/// Width of a cut-out by its height.
const ASPECT: f64 = 4.0 / 3.0;
/// Depth pictures are this much smaller than photos: priors hold no more.
const DEPTH_SHARE: f64 = 0.5;
/// Other buildings further than this from the one shown are not drawn, metres.
const NEIGHBOURHOOD_M: f32 = 150.0;

/// Gathers what there is to see of the buildings that deserve it most.
pub(super) fn gather(
    config: &RunConfig,
    survey: &Survey,
    stage: &SceneStage,
    heights: &HeightStage,
    priors: &Priors,
) -> Vec<Evidence> {
    let wanted = choose(&config.output.report, heights, priors.are_at_hand());
    let store = PriorStore { survey, priors, kept: Mutex::default() };
    let problem = Problem {
        scene: &stage.scene,
        views: &view_inputs(config, survey, &stage.scene),
        load_prior: &|view| store.load(view),
        seed: config.seed,
        start_m: &[],
        progress: &|_, _, _| {},
    };
    let inspections = inspect(&problem, &config.optimise, &heights.solution, &wanted);
    let by_view = crops_by_view(&inspections, &problem, config.output.report.evidence_views);
    let heights_m: Vec<f32> =
        heights.solution.heights.iter().map(|h| h.height_m.map_or(stage.scene.bounds.min_m, |h| h as f32)).collect();
    let studio = Studio {
        config: &config.output.report,
        survey,
        stage,
        solved: &heights.solution.heights,
        tracer: SceneTracer::new(&stage.scene, &heights_m),
        store: &store,
    };
    let mut crops: Vec<Vec<Crop>> = vec![Vec::new(); inspections.len()];
    let by_view: Vec<(usize, Vec<usize>)> = by_view.into_iter().collect();
    for views in by_view.chunks(PHOTOS_AT_A_TIME) {
        let shot: Vec<Vec<(usize, Crop)>> =
            views.par_iter().map(|(view, shown)| studio.shoot(*view, shown, &inspections)).collect();
        for (at, crop) in shot.into_iter().flatten() {
            crops[at].push(crop);
        }
    }
    let evidence = inspections.into_iter().zip(crops).map(|(inspection, mut crops)| {
        let n_rays = |view: usize| inspection.views.iter().find(|v| v.view == view).map_or(0, |v| v.n_rays);
        crops.sort_by_key(|crop| (std::cmp::Reverse(n_rays(crop.view)), crop.view));
        let scored = inspection.views.into_iter().filter(|v| !v.scores.is_empty());
        Evidence {
            building: heights.solved[inspection.building],
            heights_m: inspection.heights_m,
            scores: scored.map(|v| (v.view, v.scores)).collect(),
            crops,
        }
    });
    evidence.collect()
}

/// The buildings to show with the views to look at them in: doubtful ones first, then the least certain.
fn choose(config: &ReportConfig, heights: &HeightStage, are_at_hand: bool) -> Vec<(usize, Vec<usize>)> {
    let solved = &heights.solution.heights;
    let mut ranked: Vec<usize> = (0..solved.len()).filter(|&b| !solved[b].views.is_empty()).collect();
    let sigma = |b: usize| solved[b].sigma_m.unwrap_or(f64::INFINITY);
    ranked.sort_by(|&a, &b| {
        let is_sure = |b: usize| solved[b].reasons.is_empty();
        is_sure(a).cmp(&is_sure(b)).then(sigma(b).total_cmp(&sigma(a))).then(a.cmp(&b))
    });
    if are_at_hand {
        return ranked.into_iter().take(config.evidence_buildings).map(|b| (b, solved[b].views.clone())).collect();
    }
    let mut chosen: BTreeSet<usize> = BTreeSet::new();
    let mut wanted = Vec::new();
    for b in ranked {
        if wanted.len() == config.evidence_buildings {
            break;
        }
        let mut views: Vec<usize> = solved[b].views.iter().copied().filter(|v| chosen.contains(v)).collect();
        for &view in &solved[b].views {
            if views.len() < config.evidence_views && chosen.len() < MAX_COMPUTED_VIEWS && chosen.insert(view) {
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
        let mut taken = [0_usize; N_SECTORS];
        let mut ranked: Vec<(usize, usize)> = Vec::new();
        for (rank, seen) in seeing.iter().enumerate() {
            let from = problem.views[seen.view].placed.eye() - centre;
            let turn = from.y.atan2(from.x) / std::f64::consts::TAU + 0.5;
            let sector = ((turn * N_SECTORS as f64) as usize).min(N_SECTORS - 1);
            ranked.push((taken[sector], rank));
            taken[sector] += 1;
        }
        ranked.sort_unstable();
        for (_, rank) in ranked.into_iter().take(n_views) {
            by_view.entry(seeing[rank].view).or_default().push(at);
        }
    }
    by_view
}

/// Priors along the optical axis; those that are computed are kept, as there are few of them.
struct PriorStore<'a> {
    survey: &'a Survey,
    priors: &'a Priors,
    kept: Mutex<HashMap<usize, DepthPrior>>,
}

impl PriorStore<'_> {
    fn load(&self, view: usize) -> Result<DepthPrior, String> {
        let kept = || self.kept.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(prior) = kept().get(&view) {
            return Ok(prior.clone());
        }
        let of = &self.survey.views[view];
        let prior = self.priors.load(of).map_err(|e| e.to_string())?.to_z_depth(&of.camera);
        if !self.priors.are_at_hand() {
            kept().insert(view, prior.clone());
        }
        Ok(prior)
    }
}

/// Takes the pictures.
struct Studio<'a> {
    config: &'a ReportConfig,
    survey: &'a Survey,
    stage: &'a SceneStage,
    solved: &'a [SolvedHeight],
    tracer: SceneTracer<'a>,
    store: &'a PriorStore<'a>,
}

/// A part of a photo, pixels of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cut {
    corner: DVec2,
    size: DVec2,
}

impl Studio<'_> {
    /// The buildings that are shown in one view.
    fn shoot(&self, view_idx: usize, shown: &[usize], inspections: &[Inspection]) -> Vec<(usize, Crop)> {
        let view = &self.survey.views[view_idx];
        let placed = PlacedCamera::new((*view.camera).clone(), view.camera_from_map, self.stage.scene.origin);
        let photo = view.image.as_ref().and_then(|_| pictures::photo_of(view).ok());
        let prior = self.store.load(view_idx).ok();
        let one = |&at: &usize| {
            let inspection = &inspections[at];
            let cut = self.cut(inspection.building, &placed)?;
            let seen = inspection.views.iter().find(|v| v.view == view_idx)?;
            let [width, height] = self.size_px(cut);
            let depth_px = [width, height].map(|n| ((f64::from(n) * DEPTH_SHARE) as u32).max(1));
            Some((
                at,
                Crop {
                    view: view_idx,
                    photo: photo.as_ref().map(|photo| cut_out(photo, view, cut, [width, height])),
                    rendered: depth_picture(
                        &self.rendered(&placed, cut, depth_px),
                        PriorKind::Depth,
                        depth_px[0],
                        depth_px[1],
                    ),
                    prior: prior.as_ref().map(|prior| {
                        depth_picture(&cut_prior(prior, view, cut, depth_px), prior.kind, depth_px[0], depth_px[1])
                    }),
                    lines: self.lines(inspection.building, &placed, cut),
                    pairs: pairs(seen, view, cut),
                },
            ))
        };
        shown.iter().filter_map(one).collect()
    }

    /// The part of a photo that shows a building; `None` where it lies outside.
    fn cut(&self, building: usize, placed: &PlacedCamera) -> Option<Cut> {
        let prism = &self.stage.scene.prisms[building];
        let roof_z = prism.ground_z + self.solved[building].height_m? as f32;
        let corners = prism.edges().flat_map(|(a, _)| [a.extend(prism.base_z), a.extend(roof_z)]);
        let seen: Vec<DVec2> = corners.filter_map(|p| placed.project(p.as_dvec3())).collect();
        let low = seen.iter().copied().reduce(DVec2::min)?;
        let high = seen.iter().copied().reduce(DVec2::max)?;
        let photo = DVec2::new(f64::from(placed.camera.width_px), f64::from(placed.camera.height_px));
        let around = ((high - low) * AROUND_SHARE).max(DVec2::splat(LEAST_AROUND_PX));
        let mut size = high - low + 2.0 * around;
        size = DVec2::new(size.x.max(size.y * ASPECT), size.y.max(size.x / ASPECT)).min(photo);
        let corner = (0.5 * (low + high) - 0.5 * size).clamp(DVec2::ZERO, photo - size).floor();
        let is_inside = (low.cmplt(photo) & high.cmpgt(DVec2::ZERO)).all();
        (is_inside && size.min_element() >= 1.0).then_some(Cut { corner, size: size.floor() })
    }

    /// Size of its picture: never larger than the part of the photo.
    fn size_px(&self, cut: Cut) -> [u32; 2] {
        let scale = (f64::from(self.config.picture_px.max(1)) / cut.size.x).min(1.0);
        (cut.size * scale).round().max(DVec2::ONE).to_array().map(|n| n as u32)
    }

    fn rendered(&self, placed: &PlacedCamera, cut: Cut, size_px: [u32; 2]) -> Raster<f32> {
        let mut scratch = Vec::new();
        sampled(cut, size_px, |pixel| placed.ray(pixel).map_or(f32::NAN, |ray| self.tracer.trace(&ray, &mut scratch).0))
    }

    /// Edges of the building and of the roofs around it.
    fn lines(&self, building: usize, placed: &PlacedCamera, cut: Cut) -> Vec<Line> {
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
fn line(placed: &PlacedCamera, cut: Cut, kind: LineKind, ends: [(Vec2, f32); 2]) -> Option<Line> {
    let place = |(at, z): (Vec2, f32)| {
        let pixel = placed.project(DVec3::new(at.x.into(), at.y.into(), z.into()))?;
        Some(((pixel - cut.corner) / cut.size).as_vec2())
    };
    let (a, b) = (place(ends[0])?, place(ends[1])?);
    let (low, high) = (a.min(b), a.max(b));
    let is_inside = (low.cmplt(Vec2::ONE) & high.cmpgt(Vec2::ZERO)).all();
    is_inside.then(|| Line { kind, ends: [a.to_array(), b.to_array()] })
}

/// Values at the middles of a picture's pixels.
fn sampled(cut: Cut, [width, height]: [u32; 2], mut value: impl FnMut(DVec2) -> f32) -> Raster<f32> {
    let (width, height) = (width as usize, height as usize);
    let size = DVec2::new(width as f64, height as f64);
    let at = |i: usize| cut.corner + (DVec2::new((i % width) as f64, (i / width) as f64) + 0.5) / size * cut.size;
    let values = (0..width * height).map(|i| value(at(i))).collect();
    Raster::from_vec(width, height, values).expect("one value per pixel")
}

fn cut_prior(prior: &DepthPrior, view: &View, cut: Cut, size_px: [u32; 2]) -> Raster<f32> {
    sampled(cut, size_px, |pixel| prior.value_at(&view.camera, pixel))
}

/// A part of the photo, which may be stored in another size than the camera's.
fn cut_out(photo: &RgbImage, view: &View, cut: Cut, [width, height]: [u32; 2]) -> RgbImage {
    let camera = DVec2::new(f64::from(view.camera.width_px), f64::from(view.camera.height_px));
    let stored = DVec2::new(f64::from(photo.width()), f64::from(photo.height()));
    let [x, y] = (cut.corner / camera * stored).to_array().map(|v| v as u32);
    let [w, h] = (cut.size / camera * stored).max(DVec2::ONE).to_array().map(|v| v as u32);
    resize(&crop_imm(photo, x, y, w, h).to_image(), width, height, FilterType::Triangle)
}

fn pairs(seen: &InspectedView, view: &View, cut: Cut) -> Vec<Pair> {
    let camera = DVec2::new(f64::from(view.camera.width_px), f64::from(view.camera.height_px));
    let place = |end: [f32; 2]| ((Vec2::from(end).as_dvec2() * camera - cut.corner) / cut.size).as_vec2();
    let is_inside = |p: Vec2| (p.cmpge(Vec2::ZERO) & p.cmple(Vec2::ONE)).all();
    let pair = |pair: &crate::optimise::InspectedPair| {
        let ends = pair.ends.map(place);
        ends.iter().all(|&p| is_inside(p)).then(|| Pair { ends: ends.map(|p| p.to_array()), cost: pair.cost })
    };
    seen.pairs.iter().filter_map(pair).collect()
}
