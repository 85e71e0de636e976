//! The footprints stage: footprints from a layer, or found in the nadir photos, and the ground under each.

use std::collections::BTreeMap;

use geo::line_measures::{Densify as _, Euclidean};
use geo_types::{Coord, Polygon};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use sizeup_geo::template::name_among;
use sizeup_results::output::picture::colour::Rgb;
use sizeup_results::output::picture::{self, OverlayConfig, Polyline, photo_of};

use super::checks::check_apart;
use super::scene::{correct_ground, load_terrain, on_ground};
use super::settings::{FootprintSettings, GroundSettings};
use super::{FootprintStage, HeightStage, PipelineError};
use sizeup_footprints::{ContourSource, Detection, FootprintSource, MaskFiles, Segmenter};
use sizeup_geo::issue::{Severity, Subject};
use sizeup_geo::terrain::{self, LoadedTerrain, MapBox, Terrain};
use sizeup_photos::prior::{PriorError, PriorSource};
use sizeup_survey::{Survey, View, ViewKind};

/// Movement below which roofs count as settled, metres.
const SETTLED_M: f64 = 0.02;
/// Nadir photos with their footprints drawn over them, at most: a city has thousands.
const MOST_FOOTPRINT_OVERLAYS: usize = 40;
/// Colour of footprints and of single photos' masks.
const FOOTPRINT: Rgb = [253, 231, 37];
const CANDIDATE: Rgb = [64, 190, 200];

/// Reads or finds the footprints.
pub(super) fn read(
    settings: &FootprintSettings<'_>,
    survey: &Survey,
) -> Result<(FootprintStage, Terrain), PipelineError> {
    let (mut terrain, crs) = (None, settings.ground.crs);
    let source: Box<dyn ContourSource> = match settings.source {
        FootprintSource::Layer(layer) => {
            let layer = sizeup_footprints::read(layer, crs)?;
            require_footprints(&layer)?;
            check_apart(&settings.places, survey, &layer)?;
            let terrain = load_terrain(&settings.ground, layer.footprints.iter().map(|f| &f.polygon), 0.0)?;
            require_bare_ground(&settings.ground, &layer, &terrain.terrain)?;
            return Ok((on_ground(&settings.ground, layer, &terrain), terrain.terrain));
        }
        FootprintSource::Masks(masks) => Box::new(MaskFiles::new(masks.clone())?),
        FootprintSource::Network(network) => {
            let below = terrain.insert(terrain_of_views(&settings.ground, survey)?);
            Box::new(Segmenter::with_depth(network.clone(), Some(&|| depth(settings, survey, &below.terrain)))?)
        }
    };
    let Some(detection) = settings.source.detection() else {
        unreachable!("masks and networks have detection settings");
    };
    let terrain = terrain.map_or_else(|| terrain_of_views(&settings.ground, survey), Ok)?;
    let ground = &terrain.terrain;
    let mut found = sizeup_footprints::detect(source.as_ref(), &survey.views, ground, detection, crs)?;
    sizeup_footprints::write(&settings.folder.join("footprints.gpkg"), &found, &survey.views, crs)?;
    if settings.draws_pictures {
        draw_footprints(settings.folder.path(), &found, survey, ground)?;
    }
    let mut stage = on_ground(&settings.ground, std::mem::take(&mut found.layer), &terrain);
    stage.tracks = found.tracks;
    found.summary.footprints_from = settings.source.in_words();
    stage.detection = Some(found.summary);
    Ok((stage, terrain.terrain))
}

/// The run's depth priors, for a network that takes depth.
fn depth(
    settings: &FootprintSettings<'_>,
    survey: &Survey,
    terrain: &Terrain,
) -> Result<Box<dyn PriorSource + Send + Sync>, PriorError> {
    let above = |view: &View| {
        let centre = view.camera_from_map.centre();
        terrain.height_at(centre.x, centre.y).map(|ground| centre.z - ground)
    };
    let lowest_m = survey.views.iter().filter_map(above).fold(f64::INFINITY, f64::min);
    let highest_m = settings.heights.bounds(if lowest_m.is_finite() { lowest_m } else { 0.0 }).max_m;
    Ok(Box::new(settings.prior.open(&survey.views, terrain, highest_m)?))
}

/// Says why, where none of a layer's features can be used: nothing else will.
fn require_footprints(layer: &sizeup_footprints::FootprintLayer) -> Result<(), PipelineError> {
    if !layer.footprints.is_empty() {
        return Ok(());
    }
    let mut n_by_reason: BTreeMap<&str, usize> = BTreeMap::new();
    for refused in &layer.refused {
        *n_by_reason.entry(&refused.reason).or_default() += 1;
    }
    let reasons: Vec<String> = n_by_reason.iter().map(|(reason, n)| format!("{n} {reason}")).collect();
    let first = layer.issues.iter().find(|issue| issue.severity == Severity::Refused);
    let first = first.map_or_else(String::new, |issue| match &issue.subject {
        Subject::Building(id) => format!("; the first, {id}: {}", issue.message),
        Subject::View(_) | Subject::Input(_) => format!("; the first: {}", issue.message),
    });
    let hint = match n_by_reason.iter().max_by_key(|(_, n)| **n) {
        Some((&("footprint_not_a_polygon" | "footprint_unsupported_geometry"), _)) => {
            "footprints have to be polygons; closed lines become polygons with `Lines to polygons` in QGIS"
        }
        Some((&"footprint_too_small", _)) => "are the layer's units metres? `footprints.min_area_m2` is the least area",
        _ => "mend the layer, or name another with `footprints.path`",
    };
    let n = layer.refused.len();
    let message = format!("none of the {n} footprints can be used: {}{first}", reasons.join(", "));
    Err(PipelineError::Mismatch { message: format!("[footprints] {message}"), hint })
}

/// Refuses a surface model given as terrain: ground would be taken from its roofs.
fn require_bare_ground(
    settings: &GroundSettings<'_>,
    layer: &sizeup_footprints::FootprintLayer,
    terrain: &Terrain,
) -> Result<(), PipelineError> {
    let polygons: Vec<_> = layer.footprints.iter().map(|f| &f.polygon).collect();
    let Some(found) = terrain::surface_model(terrain, &polygons) else { return Ok(()) };
    let path = settings.terrain.dtm.as_deref().unwrap_or_else(|| std::path::Path::new("terrain"));
    let message = format!(
        "[terrain] {} is a surface model, with roofs on it: inside {} of {} footprints it stands 2 m or more ({:.1} m in the median) above \
         the ground around them; expected bare ground (DTM)",
        path.display(),
        found.n_steps,
        found.n,
        found.step_m
    );
    let hint = "name a terrain model in `terrain.dtm`; without one, set `terrain.constant_m` to a rough level and photos find the ground";
    Err(PipelineError::Mismatch { message, hint })
}

/// The terrain that the nadir views see.
fn terrain_of_views(settings: &GroundSettings<'_>, survey: &Survey) -> Result<LoadedTerrain, PipelineError> {
    let nadir = || survey.views.iter().filter(|v| v.kind() == ViewKind::Nadir);
    let centres = nadir().map(|v| v.camera_from_map.centre()).map(|c| (c.x, c.y));
    let Some(below) = MapBox::around(centres) else { return Ok(Terrain::Constant(0.0).into()) };
    let first = terrain::load_with_issues(&settings.terrain, settings.crs, below)?;
    let (Terrain::Grid(_), Some((low, _))) = (&first.terrain, first.terrain.range()) else { return Ok(first) };
    // Where the images' corners meet the lowest ground under the cameras.
    let corners = nadir().flat_map(|view| corners_on(view, low));
    let Some(seen) = MapBox::around(corners) else { return Ok(first) };
    Ok(terrain::load_with_issues(&settings.terrain, settings.crs, seen)?)
}

fn corners_on(view: &View, level_m: f64) -> Vec<(f64, f64)> {
    let (width, height) = (f64::from(view.camera.width_px), f64::from(view.camera.height_px));
    let corners = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)];
    let level = Terrain::Constant(level_m);
    let meets = |(x, y): (f64, f64)| {
        let ray = view.camera.unproject(DVec2::new(x, y))?;
        let direction = view.camera_from_map.rotation.transpose() * ray;
        level.meets(view.camera_from_map.centre(), direction).map(|p| (p.x, p.y))
    };
    corners.into_iter().filter_map(meets).collect()
}

/// How often roofs are moved to their heights and heights are estimated again.
const ROOF_ROUNDS: usize = 2;

/// Whether roof contours wait for heights, and how often they may be moved.
pub(super) fn roof_rounds(source: &FootprintSource, footprints: &FootprintStage) -> usize {
    if footprints.tracks.is_some() && source.is_of_roofs() { ROOF_ROUNDS } else { 0 }
}

/// Moves roof contours to the heights found; whether any of them moved.
pub(super) fn move_roofs(
    source: &FootprintSource,
    ground: &GroundSettings<'_>,
    survey: &Survey,
    footprints: &mut FootprintStage,
    heights: &HeightStage,
) -> Result<bool, PipelineError> {
    let (Some(settings), Some(tracks)) = (source.detection(), &footprints.tracks) else { return Ok(false) };
    let mut roof_z_m = vec![None; footprints.layer.footprints.len()];
    for (&at, solved) in heights.solved.iter().zip(&heights.solution.heights) {
        roof_z_m[at] = footprints.ground[at].zip(solved.height_m).map(|(g, h)| g.reference_m + h);
    }
    let moved = sizeup_footprints::move_roofs(&mut footprints.layer, tracks, &roof_z_m, &survey.views, settings);
    let terrain = load_terrain(ground, footprints.layer.footprints.iter().map(|f| &f.polygon), 0.0)?;
    let layer = std::mem::take(&mut footprints.layer);
    let fresh = on_ground(ground, layer, &terrain);
    (footprints.layer, footprints.ground, footprints.issues) = (fresh.layer, fresh.ground, fresh.issues);
    let photo_ground = std::mem::take(&mut footprints.photo_ground);
    correct_ground(ground, footprints, photo_ground)?;
    Ok(moved.iter().any(|m| *m > SETTLED_M))
}

/// Draws the footprints over nadir photos, into `pictures/footprints-*.png`: over all of them, or where there are many over
/// some, evenly spread over the flight.
fn draw_footprints(
    folder: &std::path::Path,
    found: &Detection,
    survey: &Survey,
    terrain: &Terrain,
) -> Result<(), PipelineError> {
    let folder = folder.join("pictures");
    let nadir: Vec<usize> = (0..survey.views.len()).filter(|&i| survey.views[i].kind() == ViewKind::Nadir).collect();
    spread(&nadir, MOST_FOOTPRINT_OVERLAYS).into_par_iter().try_for_each(|i| {
        let view = &survey.views[i];
        let mut lines: Vec<Polyline> = Vec::new();
        let own = found.candidates.iter().filter(|c| c.view == i);
        for polygon in own.flat_map(|c| &c.shape.0) {
            lines.extend(ground_lines(view, polygon, terrain, CANDIDATE));
        }
        for footprint in &found.layer.footprints {
            lines.extend(ground_lines(view, &footprint.polygon, terrain, FOOTPRINT));
        }
        let name =
            format!("footprints-{}.png", name_among(&view.id.0, survey.views.iter().map(|view| view.id.0.as_str())));
        let key = [("footprint", FOOTPRINT), ("this photo's mask", CANDIDATE)];
        let overlay = picture::overlay(&photo_of(view)?, &lines, &key, &OverlayConfig::default());
        picture::write_png(&folder.join(name), &overlay).map_err(PipelineError::from)
    })
}

/// At most so many of a list, evenly spread, the first and the last among them.
fn spread(all: &[usize], most: usize) -> Vec<usize> {
    if all.len() <= most {
        return all.to_vec();
    }
    (0..most).map(|i| all[i * (all.len() - 1) / (most - 1).max(1)]).collect()
}

/// A polygon's rings as a view sees them on the ground; nothing where it lies outside the photo.
fn ground_lines(view: &View, polygon: &Polygon<f64>, terrain: &Terrain, colour: Rgb) -> Vec<Polyline> {
    /// Longest straight piece: beyond it the ground and the lens bend a line visibly, metres.
    const PIECE_M: f64 = 4.0;
    let project = |c: &Coord<f64>| {
        let z = terrain.height_at(c.x, c.y)?;
        view.camera.project(view.camera_from_map.point(DVec3::new(c.x, c.y, z)))
    };
    let rings = std::iter::once(polygon.exterior()).chain(polygon.interiors());
    let lines = rings.filter_map(|ring| {
        let dense = Euclidean.densify(ring, PIECE_M);
        let points: Vec<DVec2> = dense.0.iter().map(project).collect::<Option<_>>()?;
        let is_inside = points.iter().any(|p| view.camera.contains(*p));
        is_inside.then(|| Polyline { points_px: points.iter().map(DVec2::to_array).collect(), colour })
    });
    lines.collect()
}
