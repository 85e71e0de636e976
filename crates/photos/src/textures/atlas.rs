//! Pages that hold the pictures of all surfaces, those of one building on one page where they fit.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DVec2, UVec2, Vec2};
use guillotiere::{AllocId, AtlasAllocator, size2};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use rayon::prelude::*;

use super::TextureTask;
use super::chart::Chart;
use super::paint::Painted;
use super::scene::SurfaceScene;
use sizeup_geo::files::{FileError, Stored, UnnamedFile};

/// Greatest side of a page, pixels: twice what WebGL 2 promises; a first choice.
pub(super) const MOST_SIDE_PX: u32 = 4096;
/// Sides of pages are multiples of this, pixels, and their area so much more than that of their pictures; a first choice.
const SIDE_STEP_PX: u32 = 256;
const ROOM: f64 = 1.1;
/// Quality of the JPEG, 1 to 100: photos come at 85 to 95, and textures are not edited any more.
const JPEG_QUALITY: u8 = 85;

/// A picture of the atlas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Page {
    /// Columns of the picture.
    pub width: u32,
    /// Rows of the picture.
    pub height: u32,
    /// The picture as JPEG, in the file of all.
    pub(super) jpeg: Stored,
}

impl Page {
    /// Bytes of the picture as JPEG.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        self.jpeg.n_bytes()
    }
}

/// Where a surface is painted: on which page, and where its plane's origin is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PagePlace {
    pub page: usize,
    /// Pixels from the page's upper left corner.
    pub origin_px: Vec2,
    pub texel_m: f32,
}

impl PagePlace {
    /// Pixels of the page of a place in the surface's plane, metres.
    pub fn pixel(&self, place: Vec2) -> Vec2 {
        self.origin_px + Vec2::new(place.x, -place.y) / self.texel_m
    }
}

/// Surfaces of the buildings of a group, building by building.
pub(super) type Group = Vec<Range<usize>>;

/// Pages, and the place of each surface.
pub(super) struct Atlas {
    pub pages: Vec<Page>,
    pub places: Vec<Option<PagePlace>>,
    pub pictures: UnnamedFile,
}

impl Atlas {
    /// An atlas without pages; their pictures go to a file.
    pub fn empty(n_surfaces: usize, pictures: UnnamedFile) -> Self {
        Self { pages: Vec::new(), places: vec![None; n_surfaces], pictures }
    }

    /// Lays the painted surfaces of some groups out on pages of their own.
    pub fn add(
        &mut self,
        groups: &[Group],
        charts: &[Option<Chart>],
        painted: &[Option<Painted>],
    ) -> Result<(), FileError> {
        let size = |i: usize| painted[i].as_ref().map(|p| UVec2::new(p.picture.width(), p.picture.height()));
        let corners = corners(groups, self.pages.len(), &size);
        for &(i, corner) in &corners {
            let place = |chart: &Chart| PagePlace {
                page: corner.page,
                origin_px: corner.at.as_vec2() + chart.texels_at(Vec2::ZERO),
                texel_m: chart.texel_m,
            };
            self.places[i] = charts[i].as_ref().map(place);
        }
        let n_pages = corners.iter().map(|(_, corner)| corner.page + 1).max().unwrap_or(0);
        let page = |page: usize| {
            let on_page = || corners.iter().filter(|(_, corner)| corner.page == page);
            let pictures = || on_page().filter_map(|(i, corner)| Some((&painted[*i].as_ref()?.picture, corner.at)));
            let end = |(picture, at): (&RgbImage, UVec2)| at + UVec2::new(picture.width(), picture.height());
            let size = pictures().map(end).fold(UVec2::ONE, UVec2::max);
            let mut whole = RgbImage::new(size.x, size.y);
            for (picture, at) in pictures() {
                image::imageops::replace(&mut whole, picture, i64::from(at.x), i64::from(at.y));
            }
            (size, jpeg(&whole))
        };
        let pages: Vec<(UVec2, Vec<u8>)> = (self.pages.len()..n_pages).into_par_iter().map(page).collect();
        for (size, jpeg) in pages {
            self.pages.push(Page { width: size.x, height: size.y, jpeg: self.pictures.put(&jpeg)? });
        }
        Ok(())
    }

    /// Shares of the page for each corner of a surface.
    pub fn uv(&self, scene: &SurfaceScene, surface: usize) -> Vec<Vec<DVec2>> {
        let Some(place) = self.places[surface] else { return Vec::new() };
        let page = &self.pages[place.page];
        let size = DVec2::new(f64::from(page.width), f64::from(page.height));
        let ring = |ring: &Vec<Vec2>| ring.iter().map(|at| place.pixel(*at).as_dvec2() / size).collect();
        scene.facets[surface].rings.iter().map(ring).collect()
    }
}

/// Upper left corner of a picture on a page.
#[derive(Clone, Copy)]
struct Corner {
    page: usize,
    at: UVec2,
}

/// Pages that are being filled; only the last one takes more.
struct Shelf {
    open: AtlasAllocator,
    side_px: u32,
    n_pages: usize,
}

impl Shelf {
    /// Square pages that some pictures fit on, a single one where that is not too large; they follow `n_before` others.
    fn fitting(sizes: impl Iterator<Item = UVec2>, n_before: usize) -> Self {
        let (area, longest) = sizes.fold((0.0, 1), |(area, longest), size| {
            (area + f64::from(size.x) * f64::from(size.y), size.max_element().max(longest))
        });
        let side = ((ROOM * area).sqrt() as u32).max(longest).next_multiple_of(SIDE_STEP_PX);
        let side_px = side.min(MOST_SIDE_PX);
        Self { open: empty_page(side_px), side_px, n_pages: n_before + 1 }
    }

    /// A place for a picture on the last page.
    fn place(&mut self, size: UVec2) -> Option<(AllocId, Corner)> {
        let found = self.open.allocate(size2(size.x as i32, size.y as i32))?;
        let at = UVec2::new(found.rectangle.min.x as u32, found.rectangle.min.y as u32);
        Some((found.id, Corner { page: self.n_pages - 1, at }))
    }

    /// Places for several pictures on the last page, or none.
    fn place_all(&mut self, sizes: &[(usize, UVec2)]) -> Option<Vec<(usize, Corner)>> {
        let mut placed = Vec::with_capacity(sizes.len());
        for (surface, size) in sizes {
            match self.place(*size) {
                Some((id, corner)) => placed.push((id, (*surface, corner))),
                None => {
                    placed.iter().for_each(|(id, _)| self.open.deallocate(*id));
                    return None;
                }
            }
        }
        Some(placed.into_iter().map(|(_, corner)| corner).collect())
    }

    /// Places the surfaces of a building, on one page where they fit.
    fn add(
        &mut self,
        building: Range<usize>,
        size: &dyn Fn(usize) -> Option<UVec2>,
        corners: &mut Vec<(usize, Corner)>,
    ) {
        let mut sizes: Vec<(usize, UVec2)> = building.filter_map(|i| Some((i, size(i)?))).collect();
        sizes.sort_by_key(|(i, size)| (std::cmp::Reverse(size.max_element()), *i));
        let together = self.place_all(&sizes).or_else(|| {
            self.turn_over();
            self.place_all(&sizes)
        });
        if let Some(placed) = together {
            corners.extend(placed);
            return;
        }
        // A building too large for a page.
        for (i, size) in sizes {
            let placed = self.place(size).or_else(|| {
                self.turn_over();
                self.place(size)
            });
            corners.extend(placed.map(|(_, corner)| (i, corner)));
        }
    }

    fn turn_over(&mut self) {
        self.open = empty_page(self.side_px);
        self.n_pages += 1;
    }
}

fn empty_page(side_px: u32) -> AtlasAllocator {
    AtlasAllocator::new(size2(side_px as i32, side_px as i32))
}

/// Groups of the buildings of a task, in their order.
pub(super) fn groups(task: &TextureTask<'_>) -> Vec<Group> {
    let mut groups: BTreeMap<usize, Group> = BTreeMap::new();
    let mut first = 0;
    for of_building in task.surfaces.chunk_by(|a, b| a.building == b.building) {
        let group = task.groups.get(of_building[0].building).copied().unwrap_or(0);
        groups.entry(group).or_default().push(first..first + of_building.len());
        first += of_building.len();
    }
    groups.into_values().collect()
}

/// Places of the pictures of some groups, on pages that follow `n_before` others.
fn corners(groups: &[Group], n_before: usize, size: &dyn Fn(usize) -> Option<UVec2>) -> Vec<(usize, Corner)> {
    let (mut corners, mut n_pages) = (Vec::new(), n_before);
    for buildings in groups {
        let sizes = || buildings.iter().cloned().flatten().filter_map(size);
        if sizes().next().is_none() {
            continue;
        }
        let mut shelf = Shelf::fitting(sizes(), n_pages);
        buildings.iter().for_each(|building| shelf.add(building.clone(), size, &mut corners));
        n_pages = shelf.n_pages;
    }
    corners
}

/// A picture as JPEG.
///
/// # Panics
/// Never: memory takes every byte, and pages are smaller than the format's limit.
fn jpeg(picture: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(picture).expect("a page is a JPEG");
    bytes
}
