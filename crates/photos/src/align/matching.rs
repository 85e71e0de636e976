//! Guided matching: a patch of one photo looked for in another, where its height and the poses let it be.
//!
//! A patch is taken to lie in a horizontal plane: its height says where the other photo shows it and how it is stretched there. It is
//! laid out on the other photo's pixels and compared by zero-mean normalised cross-correlation. Places between pixels come from
//! parabolas through the best one's neighbours.

use fearless_simd::{Level, Simd, dispatch, f32x8, prelude::*};
use glam::{DMat2, DVec2, DVec3};

use sizeup_heights::camera::Camera;
use sizeup_heights::frames::{Cam, Map, Rigid};
use sizeup_heights::raster::Raster;

/// Half the side of a patch, pixels.
const RADIUS: usize = 4;
const SIDE: usize = 2 * RADIUS + 1;
const N_PIXELS: usize = SIDE * SIDE;
/// Columns that are compared side by side.
const LANES: usize = SIDE - 1;
/// Variance below which a patch has no texture, grey levels².
const LEAST_VARIANCE: f32 = 4.0;
/// Greatest ratio of a patch's areas in two photos.
const LARGEST_RATIO: f64 = 3.0;
/// By how much the best place has to be better than any place that is not beside it.
const LEAST_LEAD: f32 = 0.06;
/// Distance at which a pixel is beside a place, pixels.
const BESIDE_PX: usize = 3;
/// Greatest distance of a match from where it started, and of the way back, pixels.
const RETURNS_WITHIN_PX: f64 = 1.0;
const BACK_REACH_PX: usize = 3;
/// Most heights that are tried.
const MAX_HEIGHTS: usize = 300;
/// Difference of steps by which a patch looks the same: a twentieth of a pixel at its border.
const SAME_STEPS: f64 = 0.05 / RADIUS as f64;

/// A photo at one size, free of distortion, with the pose as it is now.
#[derive(Debug, Clone, Copy)]
pub(super) struct PosedImage<'a> {
    pub grey: &'a Raster<f32>,
    pub camera: &'a Camera,
    pub pose: &'a Rigid<Cam, Map>,
}

impl PosedImage<'_> {
    /// Point where a pixel's ray meets a height.
    pub fn at_height(&self, pixel: DVec2, z_m: f64) -> Option<DVec3> {
        let centre = self.pose.centre();
        let ray = self.pose.rotation.transpose() * self.camera.unproject(pixel)?;
        let depth = (z_m - centre.z) / ray.z;
        (depth > 0.0 && depth.is_finite()).then(|| centre + depth * ray)
    }

    fn sees(&self, place: DVec3) -> Option<DVec2> {
        self.camera.project(self.pose.point(place))
    }
}

/// Area to look in.
#[derive(Debug, Clone, Copy)]
pub(super) enum Where {
    /// Anywhere between two heights, metres, and so far beside, pixels.
    Between { heights_m: [f64; 2], beside_px: f64 },
    /// Around a height, metres, so far in pixels.
    Around { height_m: f64, reach_px: usize },
}

/// Two photos; patches of the first are looked for in the second.
#[derive(Debug, Clone, Copy)]
pub(super) struct PhotoPair<'a> {
    pub here: PosedImage<'a>,
    pub there: PosedImage<'a>,
    pub min_score: f32,
}

/// A patch as the other photo would show it.
#[derive(Debug, Clone, Copy)]
struct Landing {
    place: DVec2,
    /// Steps there by steps here.
    steps: DMat2,
}

/// A pixel that may be the patch's.
#[derive(Debug, Clone, Copy)]
struct PixelCandidate {
    score: f32,
    pixel: [usize; 2],
    steps: DMat2,
}

impl PhotoPair<'_> {
    /// Place of a patch of the first photo in the second, pixels, if that is clear.
    pub fn find(&self, patch: DVec2, place: Where) -> Option<DVec2> {
        let candidates = match place {
            Where::Between { heights_m, beside_px } => self.between(patch, heights_m, beside_px),
            Where::Around { height_m, reach_px } => self.around(patch, height_m, reach_px)?,
        };
        let best = clear_best(&candidates)?;
        if best.score < self.min_score {
            return None;
        }
        let template = WarpedPatch::of(self.here.grey, patch, &best.steps.inverse())?;
        let found = template.between_pixels(self.there.grey, best.pixel)?;
        self.comes_back(patch, found, &best.steps).then_some(found)
    }

    fn landing(&self, patch: DVec2, z_m: f64) -> Option<Landing> {
        let through = |pixel: DVec2| self.there.sees(self.here.at_height(pixel, z_m)?);
        let place = through(patch)?;
        let steps = DMat2::from_cols(through(patch + DVec2::X)? - place, through(patch + DVec2::Y)? - place);
        let ratio = steps.determinant();
        (1.0 / LARGEST_RATIO..=LARGEST_RATIO).contains(&ratio).then_some(Landing { place, steps })
    }

    fn between(&self, patch: DVec2, [from_m, to_m]: [f64; 2], beside_px: f64) -> Vec<PixelCandidate> {
        let below = |z_m: f64| 1.0 / (self.here.pose.centre().z - z_m);
        let height =
            |share: f64| self.here.pose.centre().z - 1.0 / (below(from_m) + share * (below(to_m) - below(from_m)));
        let ends = [from_m, to_m].map(|z_m| self.there.sees(self.here.at_height(patch, z_m)?));
        let [Some(start), Some(end)] = ends else { return Vec::new() };
        let line = end - start;
        let n = (line.length().ceil() as usize + 1).min(MAX_HEIGHTS);
        let (along, across) = (line.normalize_or(DVec2::X), line.normalize_or(DVec2::X).perp());
        let beside = beside_px.ceil() as i32;
        let mut candidates = Vec::new();
        let ahead = |i: usize| {
            if i == 0 {
                -beside..=0
            } else if i == n {
                0..=beside
            } else {
                0..=0
            }
        };
        // A patch is laid out anew only where its shape has changed.
        let mut laid_out: Option<(DMat2, WarpedPatch)> = None;
        for i in 0..=n {
            let Some(landing) = self.landing(patch, height(i as f64 / n as f64)) else { continue };
            if laid_out.as_ref().is_none_or(|(steps, _)| !steps.abs_diff_eq(landing.steps, SAME_STEPS)) {
                let template = WarpedPatch::of(self.here.grey, patch, &landing.steps.inverse());
                laid_out = template.map(|template| (landing.steps, template));
            }
            let Some((steps, template)) = &laid_out else { continue };
            let places = ahead(i).flat_map(|ahead| {
                (-beside..=beside).map(move |side| landing.place + f64::from(ahead) * along + f64::from(side) * across)
            });
            self.compare(template, steps, places.filter_map(pixel_of), &mut candidates);
        }
        candidates
    }

    fn around(&self, patch: DVec2, height_m: f64, reach_px: usize) -> Option<Vec<PixelCandidate>> {
        let landing = self.landing(patch, height_m)?;
        let middle = pixel_of(landing.place)?;
        let span = |at: usize| at.saturating_sub(reach_px)..=at + reach_px;
        let pixels = span(middle[1]).flat_map(|row| span(middle[0]).map(move |col| [col, row]));
        let template = WarpedPatch::of(self.here.grey, patch, &landing.steps.inverse())?;
        let mut candidates = Vec::new();
        self.compare(&template, &landing.steps, pixels, &mut candidates);
        Some(candidates)
    }

    fn compare(
        &self,
        template: &WarpedPatch,
        steps: &DMat2,
        pixels: impl Iterator<Item = [usize; 2]>,
        candidates: &mut Vec<PixelCandidate>,
    ) {
        dispatch!(Level::new(), simd => for pixel in pixels {
            if let Some(score) = template.score_in(simd, self.there.grey, pixel) {
                candidates.push(PixelCandidate { score, pixel, steps: *steps });
            }
        });
    }

    /// Whether the place that was found leads back to the patch.
    fn comes_back(&self, patch: DVec2, found: DVec2, steps: &DMat2) -> bool {
        let Some(template) = WarpedPatch::of(self.there.grey, found, steps) else { return false };
        let Some(middle) = pixel_of(patch) else { return false };
        let span = |at: usize| at.saturating_sub(BACK_REACH_PX)..=at + BACK_REACH_PX;
        let pixels = span(middle[1]).flat_map(|row| span(middle[0]).map(move |col| [col, row]));
        let scored = pixels.filter_map(|pixel| Some((template.score(self.here.grey, pixel)?, pixel)));
        let best = scored.fold(None, |best: Option<(f32, [usize; 2])>, next| match best {
            Some(best) if best.0 >= next.0 => Some(best),
            _ => Some(next),
        });
        let back = best.and_then(|(_, pixel)| template.between_pixels(self.here.grey, pixel));
        back.is_some_and(|back| back.distance(patch) <= RETURNS_WITHIN_PX)
    }
}

/// The best one, where nothing that is not beside it comes near.
fn clear_best(candidates: &[PixelCandidate]) -> Option<PixelCandidate> {
    let mut best = *candidates.first()?;
    for candidate in candidates {
        if candidate.score > best.score {
            best = *candidate;
        }
    }
    let is_beside = |c: &PixelCandidate| (0..2).all(|axis| c.pixel[axis].abs_diff(best.pixel[axis]) <= BESIDE_PX);
    let has_rival = candidates.iter().any(|c| c.score > best.score - LEAST_LEAD && !is_beside(c));
    (!has_rival).then_some(best)
}

/// The pixel that holds a place; `None` left of or above the photo.
fn pixel_of(place: DVec2) -> Option<[usize; 2]> {
    place.cmpge(DVec2::ZERO).all().then_some([place.x as usize, place.y as usize])
}

/// A patch laid out on the pixels of another photo: mean 0, sum of squares 1.
struct WarpedPatch([f32; N_PIXELS]);

impl WarpedPatch {
    /// Around a place, with the photo's steps by steps of the other; `None` without texture, and at the border.
    fn of(grey: &Raster<f32>, middle: DVec2, steps: &DMat2) -> Option<Self> {
        let mut values = [0.0_f32; N_PIXELS];
        let offset = |i: usize| i as f64 - RADIUS as f64;
        let reach = RADIUS as f64 * (steps.x_axis.abs() + steps.y_axis.abs());
        let size = DVec2::new(grey.width() as f64, grey.height() as f64);
        if !((middle - reach).cmpge(DVec2::ZERO).all() && (middle + reach).cmple(size).all()) {
            return None;
        }
        for (i, value) in values.iter_mut().enumerate() {
            let at = middle + *steps * DVec2::new(offset(i % SIDE), offset(i / SIDE));
            *value = grey.bilinear(at.x, at.y);
        }
        let mean = values.iter().sum::<f32>() / N_PIXELS as f32;
        values.iter_mut().for_each(|v| *v -= mean);
        let squares: f32 = values.iter().map(|v| v * v).sum();
        (squares > LEAST_VARIANCE * N_PIXELS as f32).then(|| {
            let per_length = squares.sqrt().recip();
            Self(values.map(|v| v * per_length))
        })
    }

    /// Correlation with the window around a pixel; `None` at the border and without texture.
    fn score(&self, grey: &Raster<f32>, pixel: [usize; 2]) -> Option<f32> {
        dispatch!(Level::new(), simd => self.score_in(simd, grey, pixel))
    }

    /// Eight columns side by side, then the ninth, upright: the same sums in the same order in registers of every kind.
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined where the processor's registers are known is not made for them"
    )]
    #[inline(always)]
    fn score_in<S: Simd>(&self, simd: S, grey: &Raster<f32>, [col, row]: [usize; 2]) -> Option<f32> {
        let (width, height) = (grey.width(), grey.height());
        if col < RADIUS || row < RADIUS || col + RADIUS >= width || row + RADIUS >= height {
            return None;
        }
        let zero = f32x8::splat(simd, 0.0);
        let [mut sums, mut squares, mut products] = [zero; 3];
        let mut add = |seen: &[f32], patch: &[f32]| {
            let seen = f32x8::from_slice(simd, seen);
            sums += seen;
            squares += seen * seen;
            products += seen * f32x8::from_slice(simd, patch);
        };
        let first = (row - RADIUS) * width + col - RADIUS;
        let seen = &grey.data()[first..=first + (SIDE - 1) * (width + 1)];
        let [mut seen_last, mut patch_last] = [[0.0_f32; LANES]; 2];
        for (i, patch) in self.0.chunks_exact(SIDE).enumerate() {
            let seen = &seen[i * width..i * width + SIDE];
            add(&seen[..LANES], &patch[..LANES]);
            if i < LANES {
                (seen_last[i], patch_last[i]) = (seen[LANES], patch[LANES]);
            }
        }
        add(&seen_last, &patch_last);
        let (seen_corner, patch_corner) = (seen[seen.len() - 1], self.0[N_PIXELS - 1]);
        let total = |lanes: f32x8<S>, corner: f32| lanes.as_slice().iter().sum::<f32>() + corner;
        let sum = total(sums, seen_corner);
        let spread = total(squares, seen_corner * seen_corner) - sum * sum / N_PIXELS as f32;
        let product = total(products, seen_corner * patch_corner);
        (spread > LEAST_VARIANCE * N_PIXELS as f32).then(|| product / spread.sqrt())
    }

    /// The place of the best correlation around the best pixel.
    fn between_pixels(&self, grey: &Raster<f32>, [col, row]: [usize; 2]) -> Option<DVec2> {
        let at = self.score(grey, [col, row])?;
        let vertex = |before: Option<f32>, after: Option<f32>| {
            let (before, after) = (before?, after?);
            let bend = before - 2.0 * at + after;
            (bend < 0.0 && at >= before && at >= after).then(|| f64::from(0.5 * (before - after) / bend))
        };
        let x = vertex(self.score(grey, [col.checked_sub(1)?, row]), self.score(grey, [col + 1, row]))?;
        let y = vertex(self.score(grey, [col, row.checked_sub(1)?]), self.score(grey, [col, row + 1]))?;
        Some(DVec2::new(col as f64 + 0.5 + x, row as f64 + 0.5 + y))
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    /// Waves of many lengths over level ground, seen from 100 m.
    fn ground(at: DVec2) -> f32 {
        let waves = [(0.9, 0.31, 1.0), (0.37, -0.83, 2.0), (-0.52, 0.44, 3.0), (0.21, 0.17, 4.0)];
        waves.iter().map(|(x, y, phase)| 20.0 * (x * at.x + y * at.y + phase).sin()).sum::<f64>() as f32
    }

    fn photo(east_m: f64) -> (Raster<f32>, Camera, Rigid<Cam, Map>) {
        let camera = Camera::pinhole(160, 120, 200.0);
        let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let pose = Rigid::from_rotation_and_centre(rotation, DVec3::new(east_m, 0.0, 100.0));
        let value = |i: usize| {
            let pixel = DVec2::new((i % 160) as f64 + 0.5, (i / 160) as f64 + 0.5);
            let ray = rotation.transpose() * camera.unproject(pixel).unwrap();
            ground((pose.centre() - pose.centre().z / ray.z * ray).truncate())
        };
        (Raster::from_vec(160, 120, (0..160 * 120).map(value).collect()).unwrap(), camera, pose)
    }

    #[test]
    fn correlation_is_that_of_its_definition_in_registers_of_every_kind() {
        let (grey, ..) = photo(0.0);
        let patch = WarpedPatch::of(&grey, DVec2::new(61.2, 47.9), &DMat2::from_angle(0.3)).unwrap();
        let window = |[col, row]: [usize; 2]| -> Vec<f64> {
            let at = |i: usize| grey[(col + i % SIDE - RADIUS, row + i / SIDE - RADIUS)];
            (0..N_PIXELS).map(|i| f64::from(at(i))).collect()
        };
        for pixel in [[4, 4], [62, 48], [101, 77], [155, 115]] {
            let seen = window(pixel);
            let mean = seen.iter().sum::<f64>() / N_PIXELS as f64;
            let product: f64 = seen.iter().zip(patch.0).map(|(v, p)| (v - mean) * f64::from(p)).sum();
            let expected = product / seen.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
            for level in [Level::baseline(), Level::new()] {
                let found = dispatch!(level, simd => patch.score_in(simd, &grey, pixel)).unwrap();
                assert!((f64::from(found) - expected).abs() < 1e-4, "{pixel:?} {level:?}: {found} {expected}");
                assert_eq!(Some(found), patch.score(&grey, pixel), "{pixel:?} {level:?}");
            }
        }
        assert!(patch.score(&grey, [3, 40]).is_none() && patch.score(&grey, [60, 116]).is_none());
    }

    #[test]
    fn a_patch_is_found_to_a_fifth_of_a_pixel_from_near_and_from_anywhere() {
        let [here, there] = [photo(0.0), photo(11.3)];
        let [here, there] = [&here, &there].map(|(grey, camera, pose)| PosedImage { grey, camera, pose });
        let pair = PhotoPair { here, there, min_score: 0.8 };
        let patch = DVec2::new(90.5, 61.5);
        // 11.3 m at 100 m and 200 px: 22.6 px to the left.
        let expected = patch - DVec2::new(22.6, 0.0);
        let places =
            [Where::Around { height_m: 1.5, reach_px: 4 }, Where::Between { heights_m: [-5.0, 20.0], beside_px: 4.0 }];
        for place in places {
            let found = pair.find(patch, place).unwrap();
            assert!(found.distance(expected) < 0.2, "{place:?}: {found} {expected}");
        }
        assert!(pair.find(patch, Where::Around { height_m: 40.0, reach_px: 3 }).is_none());
    }
}
