//! What the views say of each other's surfaces: a height stays where others, matched on their own, see it too.
//!
//! ```text
//! X = C + (z − C.z) / r.z · r       a pixel's place, r its ray, z its height
//! q = the pixel of another view that shows X,   z' = the height that this view has there
//! agrees:  |z' − z| ≤ tolerance,    fused z = mean of z and of the z' that agree
//! ```
//!
//! A false match is false in another way in every view: it agrees with none. Frame: the map, metres.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::levels::Levels;
use sizeup_heights::picture::PosedCamera;
use sizeup_heights::raster::Raster;
use sizeup_heights::stats::median;

/// A view's surface by its own matching.
#[derive(Debug)]
pub(super) struct MatchedSurface {
    /// Camera and pose of the map.
    pub ideal: PosedCamera,
    /// Heights, metres; `NaN` where it has none.
    pub heights_m: Raster<f32>,
    /// The planes that they were chosen from: from one to the next is a pixel of parallax, more or less.
    pub levels: Levels,
    /// Whether its neighbours had to be turned: the whole may then be a little off.
    pub is_turned: bool,
}

/// Views that have to agree on a place, however few have it in their picture.
const LEAST_AGREEING: usize = 2;
/// Heights as far apart as so many levels are the same.
const TOLERANCE_LEVELS: f64 = 1.5;
/// Where views were turned, their surfaces may lie so many levels apart as a whole.
const APART_LEVELS: f64 = 8.0;
/// Every how manieth pixel is asked for that.
const APART_STEP: usize = 61;

/// The heights of a view that `min_agreeing` others agree with, or half of those that have the place in their picture where
/// that is less (two at least, unless there is one other in all), fused with theirs; `NaN` elsewhere.
pub(super) fn agreed(view: &MatchedSurface, others: &[Arc<MatchedSurface>], min_agreeing: usize) -> Raster<f32> {
    let (width, height) = (view.heights_m.width(), view.heights_m.height());
    let seen = SurfacePlaces::of(view);
    let others: Vec<Projection<'_>> = others.iter().map(|other| Projection::of(other, view, &seen)).collect();
    let fused = |i: usize| {
        let Some(place) = seen.place(i) else { return f32::NAN };
        let n_looking = others.iter().filter(|other| other.pixel(place).is_some()).count();
        let min_agreeing = min_agreeing.min(n_looking.div_ceil(2).max(LEAST_AGREEING)).min(others.len());
        let agreeing = others.iter().filter_map(|other| other.look(place, TOLERANCE_LEVELS));
        let (sum, n) = agreeing.fold((place.z, 1), |(sum, n), theirs| (sum + theirs, n + 1));
        if n > min_agreeing { (sum / n as f64) as f32 } else { f32::NAN }
    };
    Raster::from_vec(width, height, (0..width * height).map(fused).collect()).expect("one value per pixel")
}

/// A surface's places on the map.
struct SurfacePlaces<'a> {
    heights_m: &'a Raster<f32>,
    centre: DVec3,
    map_from_pixel: DMat3,
}

impl<'a> SurfacePlaces<'a> {
    fn of(surface: &'a MatchedSurface) -> Self {
        let pose = &surface.ideal.camera_from_map;
        let map_from_pixel = pose.rotation.transpose() * surface.ideal.calibration().inverse();
        Self { heights_m: &surface.heights_m, centre: pose.centre(), map_from_pixel }
    }

    /// Place of a pixel; `None` without a height.
    fn place(&self, i: usize) -> Option<DVec3> {
        let width = self.heights_m.width();
        let z = f64::from(self.heights_m.data()[i]);
        let ray = self.map_from_pixel * DVec3::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5, 1.0);
        (!z.is_nan()).then(|| self.centre + (z - self.centre.z) / ray.z * ray)
    }
}

/// Another view's surface, looked up from places on the map.
struct Projection<'a> {
    surface: &'a MatchedSurface,
    centre: DVec3,
    pixel_from_map: DMat3,
    view_levels: Levels,
    /// Height above the view's surface as a whole, metres: 0 where poses are good.
    above_m: f64,
}

impl<'a> Projection<'a> {
    fn of(surface: &'a MatchedSurface, view: &MatchedSurface, seen: &SurfacePlaces<'_>) -> Self {
        let pose = &surface.ideal.camera_from_map;
        let pixel_from_map = surface.ideal.calibration() * pose.rotation;
        let view_levels = view.levels;
        let mut projection = Self { surface, centre: pose.centre(), pixel_from_map, view_levels, above_m: 0.0 };
        if view.is_turned || surface.is_turned {
            let apart = |i: usize| {
                let place = seen.place(i)?;
                Some(projection.look(place, APART_LEVELS)? - place.z)
            };
            let all: Vec<f64> = (0..seen.heights_m.data().len()).step_by(APART_STEP).filter_map(apart).collect();
            projection.above_m = median(&all).unwrap_or(0.0);
        }
        projection
    }

    /// Column and row of the first of the four pixels around a place; `None` where it is not in the picture.
    fn pixel(&self, place: DVec3) -> Option<[usize; 2]> {
        let p = self.pixel_from_map * (place + self.above_m * DVec3::Z - self.centre);
        let heights = &self.surface.heights_m;
        let (x, y) = (p.x / p.z - 0.5, p.y / p.z - 0.5);
        let is_inside = x >= 0.0 && y >= 0.0 && x < (heights.width() - 1) as f64 && y < (heights.height() - 1) as f64;
        (p.z > 0.0 && is_inside).then_some([x as usize, y as usize])
    }

    /// The height there that is closest to the place's, if it is close enough, metres: of the four pixels around, since a
    /// wall has many heights in one.
    fn look(&self, place: DVec3, within_levels: f64) -> Option<f64> {
        let tolerance_m = within_levels * self.view_levels.step_m(place.z).max(self.surface.levels.step_m(place.z));
        let heights = &self.surface.heights_m;
        let [col, row] = self.pixel(place)?;
        let around = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| f64::from(heights[(col + dx, row + dy)]));
        let off = |z: &f64| (z - self.above_m - place.z).abs();
        let nearest = around.into_iter().filter(|z| !z.is_nan()).min_by(|a, b| off(a).total_cmp(&off(b)));
        nearest.filter(|z| off(z) <= tolerance_m).map(|z| z - self.above_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;

    /// Straight down from 100 m above level ground, so far east: a pixel is a metre there.
    fn flat(east_m: f64, spot: Option<(usize, f32)>) -> MatchedSurface {
        let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let centre = DVec3::new(east_m, 0.0, 100.0);
        let ideal = PosedCamera {
            camera: Camera::pinhole(40, 20, 100.0),
            camera_from_map: Rigid::from_rotation_and_centre(rotation, centre),
        };
        let levels = Levels::every_metre(100.0);
        let mut heights_m = Raster::filled(40, 20, 0.0);
        spot.into_iter().for_each(|(i, z)| heights_m.data_mut()[i] = z);
        MatchedSurface { ideal, heights_m, levels, is_turned: false }
    }

    #[test]
    fn what_one_view_believes_alone_goes_and_what_others_have_too_is_fused() {
        let (middle, aside) = (10 * 40 + 20, 10 * 40 + 22);
        let mut view = flat(0.0, Some((middle, 12.0)));
        view.heights_m.data_mut()[aside] = 0.9;
        let others = [Arc::new(flat(5.0, None)), Arc::new(flat(-5.0, None))];
        let heights = agreed(&view, &others, 2);
        assert!(heights.data()[middle].is_nan());
        assert!((heights.data()[aside] - 0.3).abs() < 1e-6);
        assert_eq!(heights.data()[5 * 40 + 20], 0.0);
        // The first columns are seen by the western view alone: by chance it may believe the same.
        assert!(heights.data()[10 * 40 + 1].is_nan());
        assert_eq!(agreed(&view, &others[..1], 2).data()[10 * 40 + 30], 0.0, "there is no more than one");
    }

    #[test]
    fn who_does_not_have_a_place_in_the_picture_is_not_asked() {
        let view = flat(0.0, None);
        let at_the_border = 10 * 40 + 1;
        let others = |west: [f32; 2]| -> Vec<Arc<MatchedSurface>> {
            let raised = |(east_m, by_m): (f64, f32)| {
                let mut surface = flat(east_m, None);
                surface.heights_m = surface.heights_m.map(|z| z + by_m);
                Arc::new(surface)
            };
            [(-5.0, west[0]), (-4.0, west[1]), (30.0, 0.0), (31.0, 0.0), (32.0, 0.0), (33.0, 0.0)].map(raised).to_vec()
        };
        assert_eq!(agreed(&view, &others([0.0, 0.0]), 3).data()[at_the_border], 0.0, "both that see it agree");
        assert!(agreed(&view, &others([0.0, 12.0]), 3).data()[at_the_border].is_nan(), "one of two does not");
    }

    #[test]
    fn surfaces_of_turned_views_are_brought_together_first() {
        let view = flat(0.0, None);
        let mut raised = flat(5.0, None);
        raised.heights_m = raised.heights_m.map(|_| 4.0);
        raised.is_turned = true;
        let heights = agreed(&view, &[Arc::new(raised)], 1);
        assert_eq!(heights.data()[10 * 40 + 20], 0.0);
    }
}
