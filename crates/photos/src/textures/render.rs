//! A textured town as a camera sees it.

use glam::DVec2;
use image::{Rgb, RgbImage};
use rayon::prelude::*;

use super::Textures;
use super::atlas::PagePlace;
use super::scene::SurfaceScene;
use super::warp::bilinear;
use sizeup_heights::render::PlacedCamera;

/// Rays of a pixel, as offsets from its upper left corner in pixels.
const RAYS: [DVec2; 4] =
    [DVec2::new(0.25, 0.25), DVec2::new(0.75, 0.25), DVec2::new(0.25, 0.75), DVec2::new(0.75, 0.75)];

/// A town with its textures, ready to be looked at.
pub struct TexturedTown<'a> {
    scene: &'a SurfaceScene,
    textures: &'a Textures,
    pages: Vec<RgbImage>,
}

/// Picture of a town.
#[derive(Debug, Clone)]
pub struct Rendering {
    /// Colours; black where there is no building.
    pub picture: RgbImage,
    /// For each pixel, row by row, the surface that fills it; `None` at the edges of buildings and beside them.
    pub surfaces: Vec<Option<usize>>,
}

impl<'a> TexturedTown<'a> {
    /// A town and its textures, as they are read back from their JPEG.
    ///
    /// # Errors
    /// A reason: a page that does not come back from its file, or is no JPEG.
    pub fn new(scene: &'a SurfaceScene, textures: &'a Textures) -> Result<Self, String> {
        let read = |page: usize| {
            let jpeg = textures.jpeg(page).map_err(|e| e.to_string())?;
            image::load_from_memory(&jpeg).map(image::DynamicImage::into_rgb8).map_err(|e| e.to_string())
        };
        let pages: Result<Vec<RgbImage>, String> = (0..textures.pages.len()).into_par_iter().map(read).collect();
        Ok(Self { scene, textures, pages: pages? })
    }

    /// Renders the buildings, four rays a pixel; where rays miss, `background` shows (its size is the camera's).
    #[must_use]
    pub fn render(&self, camera: &PlacedCamera, background: Option<&RgbImage>) -> Rendering {
        let (width, height) = (camera.camera.width_px, camera.camera.height_px);
        let pixel = |i: u32| {
            let (x, y) = (i % width, i / width);
            let behind = background.map_or([0.0; 3], |picture| picture.get_pixel(x, y).0.map(f32::from));
            let hits = RAYS.map(|ray| {
                let ray = camera.ray(DVec2::new(f64::from(x), f64::from(y)) + ray)?;
                let (surface, t) = self.scene.first(&ray)?;
                let place = self.scene.facets[surface].place(ray.at(t));
                Some((surface, self.colour(surface, place)))
            });
            let surface = hits[0].map(|(surface, _)| surface).filter(|_| hits.iter().all(Option::is_some));
            let colour =
                |c: usize| hits.iter().map(|hit| hit.map_or(behind[c], |(_, colour)| colour[c])).sum::<f32>() / 4.0;
            ([0, 1, 2].map(|c| (colour(c) + 0.5) as u8), surface)
        };
        let pixels: Vec<([u8; 3], Option<usize>)> = (0..width * height).into_par_iter().map(pixel).collect();
        let picture = RgbImage::from_fn(width, height, |x, y| Rgb(pixels[(y * width + x) as usize].0));
        Rendering { picture, surfaces: pixels.into_iter().map(|(_, surface)| surface).collect() }
    }

    fn colour(&self, surface: usize, place: glam::Vec2) -> [f32; 3] {
        let texture = &self.textures.surfaces[surface];
        let on_page = |at: PagePlace| {
            let pixel = at.pixel(place);
            bilinear(&self.pages[at.page], f64::from(pixel.x), f64::from(pixel.y))
        };
        texture.place.map_or_else(|| texture.plain.map(f32::from), on_page)
    }
}
