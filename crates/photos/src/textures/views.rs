//! Photos that may paint a surface: what each shows of it, how finely, and from which side.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3, Vec2};

use super::chart::{self, Chart};
use super::scene::SurfaceScene;
use super::{Choice, SurfaceKind, median_or};
use sizeup_geo::files::{FileError, Stored, UnnamedFile};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::render::PlacedCamera;
use sizeup_survey::View;

/// Least cosine between a surface's normal and the line of sight, 81° aslant: what stands 0.3 m off its surface is seen 2 m beside its
/// place there, and trees in front of a wall are drawn out to streaks.
const LEAST_FACING: f64 = 0.15;
/// Distance between the places of a surface at which photos are compared, metres: a photo is nearly as good all over it.
const SPACING_M: f32 = 10.0;
/// Photos whose visibility is looked at for each of these places, the best where nothing hides it.
const LOOKED_AT: usize = 6;
/// Weight of a cell in the choice of a photo by how many of those chosen already show it: of three photos a median tells which is wrong,
/// and a fourth stands in for one that something hides.
const WEIGHTS: [f64; 4] = [1.0, 0.3, 0.3, 0.1];
/// A photo that adds a smaller share than this is not kept.
const LEAST_GAIN: f64 = 0.03;
/// Distance over which a surface's image is measured, metres.
const STEP_M: f64 = 0.5;

/// A camera in the local frame, and which view it is of.
pub(super) struct PlacedView {
    pub view: usize,
    pub camera: PlacedCamera,
}

/// Extent to which a photo shows a cell.
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
    /// Worth at the places where photos are compared, if nothing hides them there, 0 to 1; by their positions.
    place_worth: BTreeMap<[i32; 2], f64>,
    /// Pixels per texel, geometric mean of both directions.
    pub pixels_per_texel: f64,
    /// One per cell.
    pub shown: Vec<Shown>,
    /// Colours on the chart, in the file of colours; filled when the photo is decoded.
    pub stored: Option<StoredColours>,
}

impl Candidate {
    /// Worth at a cell, 0 to 1.
    pub fn cell_worth(&self, chart: &Chart, cell: usize) -> f32 {
        let share = match self.shown[cell] {
            Shown::Hidden => return 0.0,
            Shown::Beside => 0.5,
            Shown::Clear => 1.0,
        };
        let of = self.place_worth.get(&Places::key(chart, cell)).copied().unwrap_or(0.0);
        (share * of) as f32
    }

    /// Position among the texels of the first one of each cell, and the end; equal ones for a cell without colours.
    pub fn first_texels(&self, chart: &Chart) -> Vec<u32> {
        // Colours run half a cell into those beside it, corners too.
        let is_shown = |at: usize| self.shown[at] != Shown::Hidden;
        let is_wanted = |cell: usize| {
            is_shown(cell) || chart.beside(cell).any(|near| is_shown(near) || chart.beside(near).any(is_shown))
        };
        let n_texels = |cell: usize| {
            if chart.cells[cell].n_texels > 0 && is_wanted(cell) { chart.n_texels_of(cell as u32) } else { 0 }
        };
        let end = |end: &mut u32, cell: usize| {
            *end += n_texels(cell);
            Some(*end)
        };
        std::iter::once(0).chain((0..chart.cells.len()).scan(0, end)).collect()
    }

    /// Reads back the mean over the texels of each cell that are on the surface; black in a cell without colours.
    pub fn means(&self, file: &UnnamedFile) -> Result<Vec<[f32; 3]>, FileError> {
        let Some(StoredColours { means, .. }) = self.stored else { return Ok(vec![[0.0; 3]; self.shown.len()]) };
        let values: Vec<f32> = file.get(means)?.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        Ok(values.as_chunks().0.to_vec())
    }

    /// Reads back the colours on the chart.
    pub fn colours(&self, chart: &Chart, file: &UnnamedFile) -> Result<Colours, FileError> {
        let texels = self.stored.map_or_else(|| Ok(Vec::new()), |stored| file.get(stored.texels))?;
        Ok(Colours { means: self.means(file)?, texels, first: self.first_texels(chart) })
    }
}

/// Colours of a photo on a chart.
#[derive(Debug)]
pub(super) struct Colours {
    /// Mean colour of each cell, as of [`Candidate::means`].
    pub means: Vec<[f32; 3]>,
    /// Red, green and blue of the texels of the cells that have colours, cell by cell and row by row.
    texels: Vec<u8>,
    /// Position of the first texel of each cell, as of [`Candidate::first_texels`].
    first: Vec<u32>,
}

/// Place of the colours of a photo on a chart in the file of colours: those of all photos together are most of what a textured town holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct StoredColours {
    means: Stored,
    texels: Stored,
}

impl StoredColours {
    /// Puts texels into the file, and their means; `first` as in [`Candidate::first_texels`].
    pub fn put(file: &UnnamedFile, chart: &Chart, first: &[u32], texels: &[[u8; 3]]) -> Result<Self, FileError> {
        let mean = |(range, cell): (&[u32], &chart::Cell)| {
            // Those beside the surface are black.
            let of_cell = &texels[range[0] as usize..range[1] as usize];
            let sum =
                of_cell.iter().fold([0_u32; 3], |sum, texel| std::array::from_fn(|c| sum[c] + u32::from(texel[c])));
            sum.map(|v| v as f32 / cell.n_texels.max(1) as f32)
        };
        let means = first.windows(2).zip(&chart.cells).flat_map(mean);
        let means: Vec<u8> = means.flat_map(f32::to_le_bytes).collect();
        Ok(Self { means: file.put(&means)?, texels: file.put(texels.as_flattened())? })
    }
}

impl Colours {
    /// Returns the colour of a texel, black in a cell without colours.
    pub fn at(&self, chart: &Chart, (x, y): (u32, u32)) -> [u8; 3] {
        let n = chart.cell_px;
        let (cx, cy) = (x / n, y / n);
        let cell = (cy * chart.cells_size.x + cx) as usize;
        let (first, end) = (self.first[cell], self.first[cell + 1]);
        let n_columns = n.min(chart.size.x - cx * n);
        let texel = first + (y - cy * n) * n_columns + (x - cx * n);
        if first == end { [0; 3] } else { self.texels.as_chunks().0[texel as usize] }
    }
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
        let seen =
            views.iter().filter(|view| view.camera.project(point).is_some_and(|p| view.camera.camera.contains(p)));
        seen.map(|view| view.camera.pixel_m_at(point)).reduce(f64::min)
    };
    let sizes: Vec<f64> = roofs.filter_map(|facet| best(facet.origin.as_dvec3())).collect();
    median_or(&sizes, 0.0)
}

/// The photos that may paint a surface: together they show as much of it as can be seen, most of it several times. The one that shows most
/// is the first.
pub(super) fn candidates(
    scene: &SurfaceScene,
    surface: usize,
    chart: &Chart,
    views: &[PlacedView],
    choice: Choice,
) -> Vec<Candidate> {
    let places = Places::of(chart);
    let qualities: Vec<Vec<Option<Quality>>> = places
        .at
        .iter()
        .map(|at| views.iter().map(|view| quality(scene, surface, chart, *at, view)).collect())
        .collect();
    let of_view = |view: usize| {
        let shown = shown(scene, surface, chart, &views[view], choice);
        let worth = |(place, of): (&[i32; 2], &Vec<Option<Quality>>)| Some((*place, of[view]?.worth));
        let place_worth = places.keys.iter().zip(&qualities).filter_map(worth).collect();
        let pixels: Vec<f64> = qualities.iter().filter_map(|of| Some(of[view]?.pixels_per_texel)).collect();
        let pixels_per_texel = median_or(&pixels, 1.0);
        let mut candidate =
            Candidate { view: views[view].view, worth: 0.0, place_worth, pixels_per_texel, shown, stored: None };
        let area_m2 = |cell: usize| f64::from(chart.cells[cell].n_texels) * f64::from(chart.texel_m).powi(2);
        let worth = |cell: usize| f64::from(candidate.cell_worth(chart, cell)) * area_m2(cell);
        candidate.worth = (0..chart.cells.len()).map(worth).sum();
        candidate
    };
    let found: Vec<Candidate> = best_of_each(&qualities).into_iter().map(of_view).filter(|c| c.worth > 0.0).collect();
    if choice == Choice::BestPerSurface {
        let best = found.into_iter().max_by(|a, b| a.worth.total_cmp(&b.worth).then(b.view.cmp(&a.view)));
        return best.into_iter().collect();
    }
    covering(found, chart)
}

/// Places of a surface at which photos are compared.
struct Places {
    /// Their positions, steps along both axes.
    keys: Vec<[i32; 2]>,
    /// Cells that they are in the middle of.
    at: Vec<usize>,
}

impl Places {
    fn of(chart: &Chart) -> Self {
        let is_open = |cell: &usize| chart.cells[*cell].n_texels > 0 && !chart.cells[*cell].is_party;
        let mut groups: BTreeMap<[i32; 2], Vec<usize>> = BTreeMap::new();
        (0..chart.cells.len())
            .filter(is_open)
            .for_each(|cell| groups.entry(Self::key(chart, cell)).or_default().push(cell));
        let middle = |cells: &Vec<usize>| {
            let mean = cells.iter().map(|cell| chart.cells[*cell].at).sum::<Vec2>() / cells.len() as f32;
            let off = |cell: &usize| chart.cells[*cell].at.distance(mean);
            cells.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b)).then(a.cmp(b)))
        };
        let (keys, at) = groups.iter().filter_map(|(key, cells)| Some((*key, middle(cells)?))).unzip();
        Self { keys, at }
    }

    /// Position of the place of a cell.
    fn key(chart: &Chart, cell: usize) -> [i32; 2] {
        (chart.cells[cell].at / SPACING_M).floor().to_array().map(|v| v as i32)
    }
}

/// Views that are among the best at some place, in their order.
fn best_of_each(qualities: &[Vec<Option<Quality>>]) -> BTreeSet<usize> {
    let best = |of: &Vec<Option<Quality>>| {
        let mut order: Vec<(f64, usize)> =
            of.iter().enumerate().filter_map(|(view, quality)| Some(((*quality)?.worth, view))).collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        order.into_iter().take(LOOKED_AT).map(|(_, view)| view).collect::<Vec<usize>>()
    };
    qualities.iter().flat_map(best).collect()
}

/// Photos that together show most, the one that adds most first.
fn covering(mut found: Vec<Candidate>, chart: &Chart) -> Vec<Candidate> {
    let mut n_shown = vec![0_usize; chart.cells.len()];
    let worth_of = |of: &Candidate| (0..chart.cells.len()).map(|cell| of.cell_worth(chart, cell)).collect();
    let mut cell_worths: Vec<Vec<f32>> = found.iter().map(worth_of).collect();
    let (mut kept, mut total): (Vec<Candidate>, f64) = (Vec::new(), 0.0);
    loop {
        let weight = |cell: usize| WEIGHTS.get(n_shown[cell]).copied().unwrap_or(0.0);
        let gain = |cell_worth: &Vec<f32>| {
            let of = |cell: usize| weight(cell) * f64::from(cell_worth[cell]) * f64::from(chart.cells[cell].n_texels);
            (0..n_shown.len()).map(of).sum::<f64>()
        };
        let gains = cell_worths.iter().map(gain).enumerate();
        // Of equals the first in the survey.
        let Some((best, gain)) = gains.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))) else { break };
        if gain <= LEAST_GAIN * total {
            break;
        }
        total += gain;
        let candidate = found.remove(best);
        cell_worths.remove(best);
        n_shown.iter_mut().zip(&candidate.shown).for_each(|(n, shown)| *n += usize::from(*shown == Shown::Clear));
        kept.push(candidate);
    }
    kept
}

/// How good a photo is at a place of a surface, if nothing hides it.
#[derive(Debug, Clone, Copy)]
struct Quality {
    worth: f64,
    pixels_per_texel: f64,
}

fn quality(scene: &SurfaceScene, surface: usize, chart: &Chart, cell: usize, view: &PlacedView) -> Option<Quality> {
    let facet = &scene.facets[surface];
    let point = facet.point(chart.cells[cell].at).as_dvec3();
    if !is_in_photo(view, point) {
        return None;
    }
    let footprint = footprint(&view.camera, point, [facet.right, facet.up, facet.normal].map(glam::Vec3::as_dvec3))?;
    let texel_m = f64::from(chart.texel_m);
    let worth = (footprint.scale[0] * texel_m).min(1.0) * footprint.facing;
    let pixels_per_texel = (footprint.scale[0] * footprint.scale[1]).sqrt() * texel_m;
    (footprint.facing >= LEAST_FACING && worth > 0.0).then_some(Quality { worth, pixels_per_texel })
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

/// Returns how far a photo shows each cell.
fn shown(scene: &SurfaceScene, surface: usize, chart: &Chart, view: &PlacedView, choice: Choice) -> Vec<Shown> {
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
        if !seen[cell] {
            Shown::Hidden
        } else if is_clear() {
            Shown::Clear
        } else {
            Shown::Beside
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
