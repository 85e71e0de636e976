//! Pictures of a run: the map, the proxies drawn over photos, and one view's depth beside its prior.

use glam::{DVec3, Vec2};
use image::RgbImage;

use super::super::priors::PriorStore;
use super::super::scene::SceneStage;
use super::super::{HeightStage, PipelineError};
use sizeup_geo::template::name_among;
use sizeup_heights::raster::Raster;
use sizeup_heights::render::PlacedCamera;
use sizeup_heights::render::image::SceneTracer;
use sizeup_photos::prior::DepthPrior;
use sizeup_results::output::CityModel;
use sizeup_results::output::picture::colour::{ROOF, WALL};
use sizeup_results::output::picture::{self, MapConfig, OverlayConfig, PanelConfig, PanelDepths, Polyline, photo_of};
use sizeup_survey::{Survey, View};

/// Photos with the proxies drawn over them.
const N_OVERLAYS: usize = 3;
/// Longer side of the rendered depth beside the prior, pixels.
const PANEL_PX: u32 = 640;

/// Draws everything into `pictures/` beside the results.
pub(in crate::pipeline) fn write(
    folder: &std::path::Path,
    model: &CityModel<'_>,
    stage: &SceneStage,
    heights: &HeightStage,
    priors: &PriorStore,
) -> Result<(), PipelineError> {
    let folder = folder.join("pictures");
    picture::write_png(&folder.join("map.png"), &picture::map(model, &MapConfig::default()))?;
    let views = telling_views(model.survey, heights);
    let heights_m: Vec<f32> =
        heights.solution.heights.iter().map(|h| h.height_m.map_or(stage.scene.bounds.min_m, |h| h as f32)).collect();
    if let Some(&first) = views.first() {
        let prior = priors.load(first)?;
        let panel = panel(&model.survey.views[first], stage, &heights_m, &prior)?;
        picture::write_png(&folder.join("depth.png"), &panel)?;
    }
    let with_photo = views.iter().map(|&v| &model.survey.views[v]).filter(|view| view.image.is_some());
    for view in with_photo.take(N_OVERLAYS) {
        let name = format!("overlay-{}.png", name_among(&view.id.0, names(model.survey)));
        let lines = proxy_lines(view, stage, heights);
        let key = [("roof", ROOF), ("wall, ground", WALL)];
        let overlay = picture::overlay(&photo_of(view)?, &lines, &key, &OverlayConfig::default());
        picture::write_png(&folder.join(name), &overlay)?;
    }
    Ok(())
}

/// Names of all photos.
fn names(survey: &Survey) -> impl Iterator<Item = &str> {
    survey.views.iter().map(|view| view.id.0.as_str())
}

/// The views used for most buildings first; ties by position.
fn telling_views(survey: &Survey, heights: &HeightStage) -> Vec<usize> {
    let mut says = vec![0_usize; survey.views.len()];
    for &view in heights.solution.heights.iter().flat_map(|h| &h.views) {
        says[view] += 1;
    }
    let mut views: Vec<usize> = (0..says.len()).filter(|&v| says[v] > 0).collect();
    views.sort_by_key(|&v| (std::cmp::Reverse(says[v]), v));
    views
}

fn panel(view: &View, stage: &SceneStage, heights_m: &[f32], prior: &DepthPrior) -> Result<RgbImage, PipelineError> {
    let camera = view.camera.reduced_to(PANEL_PX);
    let placed = PlacedCamera::new(camera, view.camera_from_map, stage.scene.origin);
    let rendered = SceneTracer::new(&stage.scene, heights_m).render(&placed);
    panel_of(view, &rendered.depth, prior, &view.id.0)
}

/// Photo, rendered depth and prior side by side.
pub(in crate::pipeline) fn panel_of(
    view: &View,
    rendered_m: &Raster<f32>,
    prior: &DepthPrior,
    caption: &str,
) -> Result<RgbImage, PipelineError> {
    let depths = PanelDepths { rendered_m, prior: &prior.values, prior_kind: prior.kind };
    Ok(picture::depth_panel(&photo_of(view)?, &depths, caption, &PanelConfig::default()))
}

/// The edges of the proxies as a view sees them, hidden ones too.
fn proxy_lines(view: &View, stage: &SceneStage, heights: &HeightStage) -> Vec<Polyline> {
    let placed = PlacedCamera::new((*view.camera).clone(), view.camera_from_map, stage.scene.origin);
    let line = |points: [(Vec2, f32); 2], colour| {
        let project = |(at, z): (Vec2, f32)| placed.project(DVec3::new(at.x.into(), at.y.into(), z.into()));
        let ends: Option<Vec<[f64; 2]>> = points.into_iter().map(|p| project(p).map(|p| p.to_array())).collect();
        ends.map(|points_px| Polyline { points_px, colour })
    };
    let mut lines = Vec::new();
    for (prism, height) in stage.scene.prisms.iter().zip(&heights.solution.heights) {
        let Some(height_m) = height.height_m else { continue };
        let roof_z = prism.ground_z + height_m as f32;
        for (a, b) in prism.edges() {
            lines.extend(line([(a, prism.base_z), (b, prism.base_z)], WALL));
            lines.extend(line([(a, prism.base_z), (a, roof_z)], WALL));
            lines.extend(line([(a, roof_z), (b, roof_z)], ROOF));
        }
    }
    // Roofs on top.
    lines.sort_by_key(|line| line.colour == ROOF);
    lines
}
