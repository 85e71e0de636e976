//! Photos that may paint a surface: what each shows of it, how finely, and from which side.

use glam::{DVec2, DVec3};
use image::RgbImage;

use super::chart::Chart;
use super::scene::SurfaceScene;
use super::{Choice, SurfaceKind, median_or};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::render::PlacedCamera;
use sizeup_survey::View;

/// Photos whose visibility is looked at for a surface, those of the greatest worth where nothing hides it.
const MOST_LOOKED_AT: usize = 12;
/// Photos of which a surface keeps the colours: enough for a median of those that do not show what stands in front.
const MOST_KEPT: usize = 5;
/// A photo of less worth than this share of the best one has no say.
const LEAST_WORTH: f64 = 0.25;
/// Distance over which a surface's image is measured, metres.
const STEP_M: f64 = 0.5;

/// A camera in the local frame, and which view it is of.
pub(super) struct PlacedView {
    pub view: usize,
    pub camera: PlacedCamera,
}

/// What a photo shows of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Shown {
    /// Nothing, or what is in front.
    Hidden,
    /// The cell, beside one that something hides: where that ends is known to some decimetres.
    Beside,
    /// The cell and what is around it.
    Clear,
}

/// A photo that may paint a surface.
#[derive(Debug)]
pub(super) struct Candidate {
    pub view: usize,
    /// Worth of the photo for the surface: m² of full quality.
    pub worth: f64,
    /// Pixels per texel, geometric mean of both directions.
    pub pixels_per_texel: f64,
    /// One per cell.
    pub shown: Vec<Shown>,
    /// Its colours on the whole chart, and their means over cells; filled when the photo is decoded.
    pub colours: Option<Colours>,
}

/// Colours of a photo on a chart.
#[derive(Debug)]
pub(super) struct Colours {
    /// One per texel.
    pub picture: RgbImage,
    /// Means over the texels of each cell that are on the surface.
    pub means: Vec<[f32; 3]>,
}

/// Image of a small step on a surface.
struct Footprint {
    /// Least and greatest pixels per metre over all directions.
    scale: [f64; 2],
    /// Cosine between normal and line of sight.
    facing: f64,
}

/// Cameras of the views that have a photo.
pub(super) fn place(views: &[View], with_photo: &[usize], origin: LocalOrigin) -> Vec<PlacedView> {
    let placed = |&view: &usize| {
        let of = &views[view];
        PlacedView { view, camera: PlacedCamera::new((*of.camera).clone(), of.camera_from_map, origin) }
    };
    with_photo.iter().map(placed).collect()
}

/// Median size of a pixel on the roofs, metres, over the photos that show each best.
pub(super) fn pixel_m(scene: &SurfaceScene, views: &[PlacedView]) -> f64 {
    let roofs = scene.facets.iter().filter(|facet| facet.kind == SurfaceKind::Roof);
    let best = |point: DVec3| {
        let seen = views.iter().filter(|view| view.camera.project(point).is_some_and(|p| view.camera.camera.contains(p)));
        seen.map(|view| view.camera.pixel_m_at(point)).reduce(f64::min)
    };
    let sizes: Vec<f64> = roofs.filter_map(|facet| best(facet.origin.as_dvec3())).collect();
    median_or(&sizes, 0.0)
}

/// The photos that may paint a surface, the best first.
pub(super) fn candidates(
    scene: &SurfaceScene,
    surface: usize,
    chart: &Chart,
    views: &[PlacedView],
    choice: Choice,
) -> Vec<Candidate> {
    let facet = &scene.facets[surface];
    let cells = || chart.cells.iter().filter(|cell| cell.n_texels > 0 && !cell.is_party);
    let n_cells = cells().count();
    if n_cells == 0 {
        return Vec::new();
    }
    // Looked at where a cell in its middle is: the mean may be beside a surface of another form than a rectangle.
    let mean = cells().map(|cell| cell.at).sum::<glam::Vec2>() / n_cells as f32;
    let middle = cells().map(|cell| cell.at).min_by(|a, b| a.distance(mean).total_cmp(&b.distance(mean)));
    let middle = facet.point(middle.unwrap_or(mean)).as_dvec3();
    let quality = |view: &PlacedView| {
        let footprint = footprint(&view.camera, middle, [facet.right, facet.up, facet.normal].map(glam::Vec3::as_dvec3))?;
        let texel_m = f64::from(chart.texel_m);
        let fineness = (footprint.scale[0] * texel_m).min(1.0);
        let pixels_per_texel = (footprint.scale[0] * footprint.scale[1]).sqrt() * texel_m;
        (footprint.facing > 0.0).then_some((fineness * footprint.facing, pixels_per_texel))
    };
    let mut facing: Vec<(f64, f64, &PlacedView)> =
        views.iter().filter_map(|view| quality(view).map(|(worth, pixels)| (worth, pixels, view))).collect();
    // The best first; ties by the order of the survey, so that threads do not matter.
    facing.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.2.view.cmp(&b.2.view)));
    facing.truncate(MOST_LOOKED_AT);
    let of_view = |(quality, pixels_per_texel, view): (f64, f64, &PlacedView)| {
        let shown = shown(scene, surface, chart, view, choice);
        let texel_m2 = f64::from(chart.texel_m).powi(2);
        let area_m2 = |(cell, shown): (&super::chart::Cell, &Shown)| match shown {
            _ if cell.is_party => 0.0,
            Shown::Hidden => 0.0,
            Shown::Beside => 0.5 * f64::from(cell.n_texels) * texel_m2,
            Shown::Clear => f64::from(cell.n_texels) * texel_m2,
        };
        let worth = quality * chart.cells.iter().zip(&shown).map(area_m2).sum::<f64>();
        (worth > 0.0).then(|| Candidate { view: view.view, worth, pixels_per_texel, shown, colours: None })
    };
    let mut found: Vec<Candidate> = facing.into_iter().filter_map(of_view).collect();
    found.sort_by(|a, b| b.worth.total_cmp(&a.worth).then(a.view.cmp(&b.view)));
    let least = found.first().map_or(0.0, |best| LEAST_WORTH * best.worth);
    found.retain(|candidate| candidate.worth >= least);
    found.truncate(if choice == Choice::BestPerSurface { 1 } else { MOST_KEPT });
    found
}

/// The image of a surface around a point, by the steps along its axes; `None` where a photo does not show the point.
fn footprint(camera: &PlacedCamera, point: DVec3, [right, up, normal]: [DVec3; 3]) -> Option<Footprint> {
    let at = camera.project(point)?;
    let facing = (camera.eye() - point).normalize_or_zero().dot(normal);
    let step = |along: DVec3| Some((camera.project(point + STEP_M * along)? - at) / STEP_M);
    let (a, b) = (step(right)?, step(up)?);
    // Singular values of the 2 × 2 matrix with columns a and b.
    let (sum, det) = (a.length_squared() + b.length_squared(), a.perp_dot(b).abs());
    let root = (sum * sum / 4.0 - det * det).max(0.0).sqrt();
    let scale = [(sum / 2.0 - root).max(0.0).sqrt(), (sum / 2.0 + root).sqrt()];
    Some(Footprint { scale, facing })
}

/// What a photo shows of each cell.
fn shown(
    scene: &SurfaceScene,
    surface: usize,
    chart: &Chart,
    view: &PlacedView,
    choice: Choice,
) -> Vec<Shown> {
    let eye = view.camera.eye().as_vec3();
    let is_seen = |cell: usize| {
        let of = &chart.cells[cell];
        if of.n_texels == 0 || of.is_party {
            return false;
        }
        let point = chart.in_front(scene, surface, cell);
        is_in_photo(view, point.as_dvec3()) && (choice == Choice::BestPerSurface || scene.is_seen(eye, point))
    };
    let seen: Vec<bool> = (0..chart.cells.len()).map(is_seen).collect();
    let of_cell = |cell: usize| {
        let is_part = |&other: &usize| chart.cells[other].n_texels > 0 && !chart.cells[other].is_party;
        let is_clear = || chart.beside(cell).filter(is_part).all(|other| seen[other]);
        match seen[cell] {
            false => Shown::Hidden,
            true if is_clear() => Shown::Clear,
            true => Shown::Beside,
        }
    };
    (0..chart.cells.len()).map(of_cell).collect()
}

/// Whether a photo shows a point, and a pixel around it.
fn is_in_photo(view: &PlacedView, point: DVec3) -> bool {
    let camera = &view.camera.camera;
    let size = DVec2::new(f64::from(camera.width_px), f64::from(camera.height_px));
    view.camera.project(point).is_some_and(|p| p.cmpge(DVec2::ONE).all() && p.cmple(size - 1.0).all())
}
