//! Textures of buildings from the photos that show them.
//!
//! ```text
//! per surface       charts ([`chart`]): its plane cut into texels, and into cells of some half a metre
//! per photo         which cells it shows: buildings and terrain hide them ([`scene`], [`views`])
//! per photo         decoded once, its colours laid into the charts that it may paint, in a file ([`warp`])
//! per town          one gain per photo, by least squares over the surfaces that photos share ([`gains`])
//! per building      the photo of each surface; neighbours prefer the same one ([`choose`])
//! per texel         the surface's photo where it shows it and agrees with the others, else another; hidden texels are
//!                   filled from those beside them ([`paint`])
//! per town          pages that hold all charts ([`atlas`]), as JPEG
//! ```
//!
//! A photo's worth for a surface is
//!
//! ```text
//! worth = shown area · min(1, s_min · texel) · cos θ
//! ```
//!
//! `s_min`: pixels per metre on the surface in the direction that is seen worst; `θ`: angle between the line of sight and the surface's normal. A
//! surface that stands off by `δ` shifts its texture by `δ tan θ`, so views from the front are worth more.
//!
//! Sources: Waechter, Moehrle, Goesele, "Let There Be Color!", ECCV 2014 (photo per face, agreement of photos, colour
//! adjustment); Lempitsky and Ivanov, "Seamless Mosaicing of Image-Based Texture Maps", CVPR 2007 (neighbours prefer one photo).
//!
//! Frame: [`sizeup_heights::frames::Local`], metres; pictures have their origin in the upper left corner.

mod atlas;
mod chart;
mod choose;
mod eave;
mod gains;
mod misplaced;
mod paint;
mod render;
mod scene;
pub mod similarity;
mod views;
mod warp;

use std::path::Path;

use glam::{DVec2, DVec3};
use image::RgbImage;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_geo::files::{FileError, UnnamedFile};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::scene::LocalGround;
use sizeup_heights::stats;
use sizeup_survey::View;

pub use atlas::Page;
use chart::Chart;
pub use paint::fill_unknown;
pub use render::{Rendering, TexturedTown};
pub use scene::SurfaceScene;

/// Settings of the textures.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TextureConfig {
    /// Whether a textured city is written from the photos, into `textured/` beside the results.
    pub enabled: bool,
    /// Side of a texel, metres, 0.01 to 10; by default what a pixel of the photos shows of the buildings, and 0.1 at least.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texel_m: Option<f64>,
}

/// Sides of a texel that can be asked for, metres.
pub const TEXELS_M: std::ops::RangeInclusive<f64> = 0.01..=10.0;
/// Finest texel that is chosen without being asked for, metres: a building of 20 × 10 × 10 m has 80,000 of them.
const FINEST_TEXEL_M: f64 = 0.1;

/// Kind of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceKind {
    /// Bottom of a solid: never seen.
    Ground,
    /// Level or sloping top.
    Roof,
    /// Upright side of a building.
    Wall,
}

/// A planar surface of a building. Frame: the project's map, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Position of its building among all; surfaces of one building follow each other.
    pub building: usize,
    /// Kind of the surface.
    pub kind: SurfaceKind,
    /// Corners, not closed: exterior counter-clockwise seen from outside, then holes clockwise.
    pub rings: Vec<Vec<DVec3>>,
    /// Standard deviation of the roof's level, metres: so far below its upper edge a wall may show the roof.
    pub sigma_m: f64,
}

/// How the photo of a surface is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Choice {
    /// By all that this module does.
    #[default]
    Agreeing,
    /// The photo of the greatest worth per surface, as it is: what the other is measured against.
    BestPerSurface,
}

/// Everything that textures are made from.
pub struct TextureTask<'a> {
    /// Surfaces of all buildings, grouped by building.
    pub surfaces: &'a [Surface],
    /// Surfaces of other buildings, which hide these and have no textures.
    pub occluders: &'a [Surface],
    /// The ground in the local frame.
    pub ground: LocalGround,
    /// Origin of the local frame.
    pub origin: LocalOrigin,
    /// Photos with their poses.
    pub views: &'a [View],
    /// Reads a photo, or says why it cannot.
    pub decode: &'a (dyn Fn(&View) -> Result<RgbImage, String> + Sync),
    /// Side of a texel, metres; `None`: by the photos.
    pub texel_m: Option<f64>,
    /// Choice of photos.
    pub choice: Choice,
    /// Group of each building, by its position among all: a page has the surfaces of one group. Empty: all are one group.
    pub groups: &'a [usize],
    /// Folder for unnamed files of colours and pictures; it is made where there is none.
    pub scratch: &'a Path,
}

/// The texture of a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceTexture {
    /// Page of the atlas; `None`: no photo shows the surface.
    pub page: Option<usize>,
    /// For each corner of each ring its place on the page, 0 to 1 from the upper left corner; empty without a page.
    pub uv: Vec<Vec<DVec2>>,
    /// Position of the view whose photo shows most of it.
    pub photo: Option<usize>,
    /// Colour where there is no texture: the mean of the building's surfaces of that kind, or of the town's.
    pub plain: [u8; 3],
    /// Areas of the surface by where its colours come from.
    pub areas: TexturedArea,
    /// Place of its plane on the page.
    place: Option<atlas::PagePlace>,
}

/// Areas by where colours come from, m².
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TexturedArea {
    /// Shown by a photo.
    pub seen_m2: f64,
    /// Hidden in all photos, and filled from what is seen of the same surface.
    pub filled_m2: f64,
    /// On surfaces that no photo shows.
    pub plain_m2: f64,
    /// Against a neighbour: bare, and no part of the others.
    pub party_m2: f64,
}

impl TexturedArea {
    /// Adds another area.
    pub fn add(&mut self, other: &Self) {
        self.seen_m2 += other.seen_m2;
        self.filled_m2 += other.filled_m2;
        self.plain_m2 += other.plain_m2;
        self.party_m2 += other.party_m2;
    }

    /// Share of what can be seen that a photo shows, 0 to 1; `None` without such an area.
    #[must_use]
    pub fn seen_share(&self) -> Option<f64> {
        let all_m2 = self.seen_m2 + self.filled_m2 + self.plain_m2;
        (all_m2 > 0.0).then(|| self.seen_m2 / all_m2)
    }
}

/// Textures of a town.
#[derive(Debug)]
pub struct Textures {
    /// Pages of the atlas.
    pub pages: Vec<Page>,
    /// One per surface, in their order.
    pub surfaces: Vec<SurfaceTexture>,
    /// Side of a texel, metres.
    pub texel_m: f64,
    /// Photos that could not be read, and surfaces without a photo.
    pub issues: Vec<Issue>,
    /// The pages' pictures.
    pictures: UnnamedFile,
}

impl Textures {
    /// Reads back the picture of a page, JPEG.
    ///
    /// # Errors
    /// [`FileError`]: the file is lost.
    pub fn jpeg(&self, page: usize) -> Result<Vec<u8>, FileError> {
        self.pictures.get(self.pages[page].jpeg)
    }

    /// Areas of all surfaces of a kind.
    #[must_use]
    pub fn areas(&self, surfaces: &[Surface], kind: SurfaceKind) -> TexturedArea {
        let mut all = TexturedArea::default();
        surfaces.iter().zip(&self.surfaces).filter(|(s, _)| s.kind == kind).for_each(|(_, t)| all.add(&t.areas));
        all
    }
}

/// Groups of buildings that are painted at a time.
const GROUPS_AT_A_TIME: usize = 2;
/// Colour of walls and roofs in a town that no photo shows.
const NO_PHOTO: [u8; 3] = [200, 200, 200];

/// Makes the textures of a town.
///
/// # Errors
/// [`FileError`]: no file can be written into the folder for it.
pub fn bake(task: &TextureTask<'_>) -> Result<Textures, FileError> {
    let all: Vec<Surface> = task.surfaces.iter().chain(task.occluders).cloned().collect();
    let scene = SurfaceScene::new(&all, task.ground.clone(), task.origin);
    let with_photo: Vec<usize> = (0..task.views.len()).filter(|&v| task.views[v].image.is_some()).collect();
    let placed = views::place(task.views, &with_photo, task.origin);
    let texel_m = task.texel_m.unwrap_or_else(|| views::pixel_m(&scene, &placed).max(FINEST_TEXEL_M));
    let charts: Vec<Option<Chart>> = (0..task.surfaces.len())
        .into_par_iter()
        .map(|i| (task.surfaces[i].kind != SurfaceKind::Ground).then(|| Chart::of(&scene, i, texel_m)))
        .collect();
    let mut candidates: Vec<Vec<views::Candidate>> = (charts.par_iter().enumerate())
        .map(|(i, chart)| {
            chart.as_ref().map_or_else(Vec::new, |c| views::candidates(&scene, i, c, &placed, task.choice))
        })
        .collect();
    let file = UnnamedFile::new(task.scratch)?;
    let mut issues = warp::fill(task, &scene, &charts, &mut candidates, &file)?;
    let gains = match task.choice {
        Choice::Agreeing => {
            let gains = gains::solve(task.views.len(), &candidates, &file)?;
            let misplaced = misplaced::find(task.views.len(), &charts, &candidates, &gains, &file)?;
            for &(view, share) in &misplaced {
                let is_other = |candidate: &views::Candidate| candidate.view != view;
                candidates.iter_mut().for_each(|of_surface| of_surface.retain(is_other));
                issues.push(disagreement(&task.views[view], share));
            }
            if misplaced.is_empty() { gains } else { gains::solve(task.views.len(), &candidates, &file)? }
        }
        Choice::BestPerSurface => vec![1.0; task.views.len()],
    };
    let chosen = choose::photos(task.surfaces, &candidates, task.choice);
    let paint = |(i, candidates): (usize, Vec<views::Candidate>)| {
        let Some(chart) = &charts[i] else { return Ok((i, None)) };
        let colours: Result<Vec<_>, FileError> = candidates.iter().map(|of| of.colours(chart, &file)).collect();
        let eave_m = (task.surfaces[i].kind == SurfaceKind::Wall).then_some(task.surfaces[i].sigma_m);
        let palette =
            paint::Palette { candidates: &candidates, colours: &colours?, first: chosen[i], gains: &gains, eave_m };
        Ok((i, paint::paint(chart, &palette, task.choice)))
    };
    // A surface's photos are forgotten when it is painted, and its picture when it is on a page: together they are most of the memory.
    let mut painted: Vec<Option<paint::Painted>> = (0..task.surfaces.len()).map(|_| None).collect();
    let mut atlas = atlas::Atlas::empty(task.surfaces.len(), UnnamedFile::new(task.scratch)?);
    for groups in atlas::groups(task).chunks(GROUPS_AT_A_TIME) {
        let surfaces = || groups.iter().flatten().cloned().flatten();
        let of_groups: Vec<_> = surfaces().map(|i| (i, std::mem::take(&mut candidates[i]))).collect();
        let found: Result<Vec<_>, FileError> = of_groups.into_par_iter().map(paint).collect();
        found?.into_iter().for_each(|(i, of)| painted[i] = of);
        atlas.add(groups, &charts, &painted)?;
        for i in surfaces() {
            if let Some(painted) = &mut painted[i] {
                painted.picture = RgbImage::default();
            }
        }
    }
    let plain = plain_colours(task.surfaces, &painted);
    let surfaces: Vec<SurfaceTexture> = (0..task.surfaces.len())
        .map(|i| {
            let areas = charts[i].as_ref().map_or_else(TexturedArea::default, |c| paint::areas(c, painted[i].as_ref()));
            let photo = painted[i].as_ref().map(|painted| painted.photo);
            let place = atlas.places[i];
            SurfaceTexture {
                page: place.map(|at| at.page),
                uv: atlas.uv(&scene, i),
                photo,
                plain: plain[i],
                areas,
                place,
            }
        })
        .collect();
    issues.extend(without_photo(task.surfaces, &surfaces));
    Ok(Textures { pages: atlas.pages, surfaces, texel_m, issues, pictures: atlas.pictures })
}

/// Mean colours of the painted surfaces of the same building and kind, else of the town's, for those without a photo.
fn plain_colours(surfaces: &[Surface], painted: &[Option<paint::Painted>]) -> Vec<[u8; 3]> {
    let mean_of = |is_wanted: &dyn Fn(&Surface) -> bool| {
        let of_each = surfaces.iter().zip(painted).filter(|(surface, _)| is_wanted(surface));
        let means: Vec<[f32; 3]> = of_each.filter_map(|(_, painted)| Some(painted.as_ref()?.mean)).collect();
        let n = means.len() as f32;
        (n > 0.0).then(|| [0, 1, 2].map(|c| (means.iter().map(|mean| mean[c]).sum::<f32>() / n).round() as u8))
    };
    let of_town = [SurfaceKind::Ground, SurfaceKind::Roof, SurfaceKind::Wall]
        .map(|kind| mean_of(&|surface| surface.kind == kind).unwrap_or(NO_PHOTO));
    let mut colours = Vec::with_capacity(surfaces.len());
    for group in surfaces.chunk_by(|a, b| a.building == b.building) {
        let range = colours.len()..colours.len() + group.len();
        for surface in group {
            let own: Vec<[f32; 3]> = (group.iter().zip(&painted[range.clone()]))
                .filter(|(other, _)| other.kind == surface.kind)
                .filter_map(|(_, painted)| Some(painted.as_ref()?.mean))
                .collect();
            let n = own.len() as f32;
            let mean = [0, 1, 2].map(|c| (own.iter().map(|mean| mean[c]).sum::<f32>() / n).round() as u8);
            colours.push(if own.is_empty() { of_town[surface.kind as usize] } else { mean });
        }
    }
    colours
}

/// A warning of a photo that disagrees with the others.
fn disagreement(view: &View, share: f64) -> Issue {
    let message = format!(
        "no texture comes from it: {:.0} % of the places where its pose puts buildings have other colours there than in the other photos",
        100.0 * share
    );
    Issue::new(Severity::Warning, "photo_disagrees", Subject::View(view.id.0.clone()), message)
        .hint("its pose is wrong, or it was turned, exchanged or edited after the flight")
}

/// A note on surfaces without a texture; a warning where that is all of them.
fn without_photo(surfaces: &[Surface], textures: &[SurfaceTexture]) -> Option<Issue> {
    let outside = surfaces.iter().zip(textures).filter(|(surface, _)| surface.kind != SurfaceKind::Ground);
    let open: Vec<&SurfaceTexture> =
        outside.map(|(_, t)| t).filter(|t| t.areas.plain_m2 > 0.0 || t.page.is_some()).collect();
    let n_plain = open.iter().filter(|texture| texture.page.is_none()).count();
    let severity = if n_plain == open.len() { Severity::Warning } else { Severity::Note };
    let message = format!("no photo shows {n_plain} of {} walls and roofs; they have a plain colour", open.len());
    (n_plain > 0).then(|| {
        Issue::new(severity, "surfaces_without_photo", Subject::Input("photos".to_owned()), message)
            .hint("photos from all four sides show all walls; `survey.images` names the folder of the photos")
    })
}

/// Median of some values, or another one where there are none.
fn median_or(values: &[f64], otherwise: f64) -> f64 {
    stats::median(values).unwrap_or(otherwise)
}
