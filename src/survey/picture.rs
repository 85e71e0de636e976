//! A map of the survey as a picture: cameras with a line to the ground they look at, nadir and oblique in two colours,
//! over the outlines of their photos on the ground.

use std::path::Path;

use glam::DVec2;
use image::{Rgb, RgbImage};

use super::{Survey, SurveyError, ViewKind, ground};
use crate::files::write_whole;
use crate::terrain::Terrain;

const PAPER: Rgb<u8> = Rgb([250, 250, 247]);
const FOOTPRINT: Rgb<u8> = Rgb([205, 208, 212]);
/// Blue and vermilion of the Okabe-Ito palette: told apart by colour-blind readers, and in print.
const NADIR: Rgb<u8> = Rgb([0, 114, 178]);
const OBLIQUE: Rgb<u8> = Rgb([213, 94, 0]);
/// Empty rim around the map, pixels.
const MARGIN_PX: f64 = 12.0;
/// Half the side of a camera's mark, pixels.
const MARK_PX: i64 = 2;
/// Outlines of more photos than this would only fill the map: every n-th is drawn.
const MAX_OUTLINES: usize = 400;

/// What part of the map the picture shows.
struct Frame {
    west_north: DVec2,
    px_per_m: f64,
}

impl Frame {
    fn at(&self, place: DVec2) -> DVec2 {
        let offset = (place - self.west_north) * self.px_per_m;
        DVec2::new(MARGIN_PX + offset.x, MARGIN_PX - offset.y)
    }
}

/// Draws the survey, `longest_px` on the longer side. North is up.
#[must_use]
pub fn draw(survey: &Survey, terrain: &Terrain, longest_px: u32) -> RgbImage {
    let fallback_m = terrain.range().map_or(0.0, |(low_m, high_m)| 0.5 * (low_m + high_m));
    let step = survey.views.len().div_ceil(MAX_OUTLINES).max(1);
    let outlines: Vec<Vec<DVec2>> = survey
        .views
        .iter()
        .step_by(step)
        .map(|view| {
            let centre = view.camera_from_map.centre();
            ground::outline(view, terrain.height_at(centre.x, centre.y).unwrap_or(fallback_m))
        })
        .collect();
    let cameras: Vec<DVec2> = survey.views.iter().map(|view| view.camera_from_map.centre().truncate()).collect();
    let all = || outlines.iter().flatten().chain(&cameras);
    let low = all().copied().reduce(DVec2::min).unwrap_or(DVec2::ZERO);
    let high = all().copied().reduce(DVec2::max).unwrap_or(DVec2::ONE);
    let extent_m = (high - low).max(DVec2::ONE);
    let inner_px = (f64::from(longest_px) - 2.0 * MARGIN_PX).max(1.0);
    let frame = Frame { west_north: DVec2::new(low.x, high.y), px_per_m: inner_px / extent_m.max_element() };
    let side = |length_m: f64| (length_m * frame.px_per_m + 2.0 * MARGIN_PX).ceil() as u32;
    let mut picture = RgbImage::from_pixel(side(extent_m.x), side(extent_m.y), PAPER);
    for outline in &outlines {
        for (i, corner) in outline.iter().enumerate() {
            line(&mut picture, frame.at(*corner), frame.at(outline[(i + 1) % outline.len()]), FOOTPRINT);
        }
    }
    for (view, camera) in survey.views.iter().zip(&cameras) {
        let colour = if view.kind() == ViewKind::Nadir { NADIR } else { OBLIQUE };
        let place = frame.at(*camera);
        if let Some(end) = ground::centre_on_ground(view, terrain) {
            line(&mut picture, place, frame.at(end), colour);
        }
        for dy in -MARK_PX..=MARK_PX {
            for dx in -MARK_PX..=MARK_PX {
                dot(&mut picture, place.x as i64 + dx, place.y as i64 + dy, colour);
            }
        }
    }
    picture
}

/// Draws the survey into a PNG file.
///
/// # Errors
/// [`SurveyError::File`] when it cannot be written.
pub fn write_picture(survey: &Survey, terrain: &Terrain, longest_px: u32, path: &Path) -> Result<(), SurveyError> {
    let picture = draw(survey, terrain, longest_px);
    let mut bytes = std::io::Cursor::new(Vec::new());
    let encoded = picture.write_to(&mut bytes, image::ImageFormat::Png).map_err(std::io::Error::other);
    write_whole(path, |file| {
        encoded?;
        file.write_all(bytes.get_ref())
    })?;
    Ok(())
}

fn dot(picture: &mut RgbImage, x: i64, y: i64, colour: Rgb<u8>) {
    if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
        && let Some(pixel) = picture.get_pixel_mut_checked(x, y)
    {
        *pixel = colour;
    }
}

fn line(picture: &mut RgbImage, from: DVec2, to: DVec2, colour: Rgb<u8>) {
    let n_steps = (to - from).abs().max_element().ceil().clamp(1.0, 1e5) as u32;
    for step in 0..=n_steps {
        let at = from.lerp(to, f64::from(step) / f64::from(n_steps));
        dot(picture, at.x as i64, at.y as i64, colour);
    }
}
