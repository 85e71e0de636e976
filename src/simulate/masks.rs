//! Footprint masks of nadir views: which building's outline *on the ground* a pixel lies in, roofs notwithstanding.

use geo::{BoundingRect, Contains};
use geo_types::Point;
use glam::{DVec2, DVec3};

use crate::raster::Raster;
use crate::survey::View;

use super::building::Building;

/// `H × W` of `building index + 1`, 0 = none. A pixel belongs to an outline if its ray meets the outline's own ground
/// level inside it; where ground levels differ so much that two outlines overlap, the first one has it.
#[must_use]
pub fn ground_contact(view: &View, buildings: &[Building]) -> Raster<u16> {
    let (width, height) = (view.camera.width_px, view.camera.height_px);
    let mut mask = Raster::filled(width as usize, height as usize, 0);
    let centre = view.camera_from_map.centre();
    let map_from_camera = view.camera_from_map.rotation.transpose();
    for (building, label) in buildings.iter().zip(1..=u16::MAX) {
        let Some((low, high)) = pixel_bounds(view, building) else { continue };
        for row in low.1..high.1 {
            for col in low.0..high.0 {
                let pixel = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
                let Some(ray) = view.camera.unproject(pixel) else { continue };
                let direction = map_from_camera * ray;
                let s = (building.ground_z_m - centre.z) / direction.z;
                let p = centre + s * direction;
                let cell = &mut mask[(col, row)];
                if s > 0.0 && *cell == 0 && building.footprint.contains(&Point::new(p.x, p.y)) {
                    *cell = label;
                }
            }
        }
    }
    mask
}

/// Columns and rows (first, and one after the last) that an outline can touch, one pixel of margin included.
fn pixel_bounds(view: &View, building: &Building) -> Option<((usize, usize), (usize, usize))> {
    building.footprint.bounding_rect()?;
    let corners = building.footprint.exterior().points().map(|p| {
        let point = DVec3::new(p.x(), p.y(), building.ground_z_m);
        view.camera.project(view.camera_from_map.point(point))
    });
    let corners: Vec<DVec2> = corners.collect::<Option<_>>()?;
    let low = corners.iter().copied().fold(DVec2::INFINITY, DVec2::min) - DVec2::ONE;
    let high = corners.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max) + DVec2::splat(2.0);
    let size = DVec2::new(f64::from(view.camera.width_px), f64::from(view.camera.height_px));
    let low = low.clamp(DVec2::ZERO, size);
    let high = high.clamp(DVec2::ZERO, size);
    Some(((low.x as usize, low.y as usize), (high.x as usize, high.y as usize)))
}
