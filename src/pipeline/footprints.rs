//! The footprints stage: footprints from a layer, or found in the nadir photos, and the ground under each.

use std::collections::BTreeMap;
use std::path::PathBuf;

use glam::DVec2;

use super::apart::check_apart;
use super::ground::{correct_ground, load_terrain, on_ground};
use super::settings::{FootprintSettings, GroundSettings};
use super::{FootprintStage, HeightStage, PipelineError, pictures};
use sizeup_footprints::{ContourSource, FootprintSource, MaskFiles, Segmenter};
use sizeup_geo::issue::{Severity, Subject};
use sizeup_geo::terrain::{self, LoadedTerrain, MapBox, Terrain};
use sizeup_photos::onnx::is_profile_file;
use sizeup_photos::prior::{PriorError, PriorSource};
use sizeup_survey::{Survey, View, ViewKind};

/// Movement below which roofs count as settled, metres.
const SETTLED_M: f64 = 0.02;

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
        pictures::footprints(settings.folder.path(), &found, survey, ground)?;
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

/// Whether roof contours wait for heights, and how often they may be moved.
pub(super) fn roof_rounds(source: &FootprintSource, footprints: &FootprintStage) -> usize {
    footprints.tracks.as_ref().map_or(0, |_| source.roof_rounds())
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

/// The files that footprints come from, for the lineage.
#[must_use]
pub fn files(source: &FootprintSource, survey: &Survey) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = source.file().into_iter().collect();
    if let FootprintSource::Network(network) = source {
        files.extend(network.backbones.values().cloned());
        files.extend(network.profile.iter().filter(|profile| is_profile_file(profile)).map(PathBuf::from));
    }
    if let FootprintSource::Masks(masks) = source
        && let Ok(masks) = MaskFiles::new(masks.clone())
    {
        let nadir = survey.views.iter().filter(|v| v.kind() == ViewKind::Nadir);
        files.extend(nadir.filter_map(|view| masks.file_of(view)));
    }
    if let Some(cadastre) = source.detection().and_then(|d| d.cadastre) {
        files.push(cadastre.path.clone());
    }
    files
}
