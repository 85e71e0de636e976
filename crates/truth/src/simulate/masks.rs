//! Footprint masks of nadir views: which building's footprint *on the ground* a pixel lies in, roofs notwithstanding, or
//! whose roof it shows.

use geo::{BoundingRect, Contains};
use geo_types::Point;
use glam::{DVec2, DVec3};

use sizeup_geo::terrain::Terrain;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

use super::building::SimulatedBuilding;

/// Most that the ground under one building is off its mean, metres.
const SLOPE_M: f64 = 10.0;

/// `H × W` of `building index + 1`, 0 = none. A pixel belongs to a footprint if its ray meets the terrain inside it.
#[must_use]
pub fn ground_contact(view: &View, buildings: &[SimulatedBuilding], terrain: &Terrain) -> Raster<u16> {
    let labelled: Vec<(u16, &SimulatedBuilding)> = (1..=u16::MAX).zip(buildings).collect();
    draw(view, &labelled, |_, centre, direction| terrain.meets(centre, direction).map(|p| (p.x, p.y)))
}

/// The same for flat roofs at each building's mean height: what a mask of roofs shows. Of two roofs in one pixel, the
/// higher one is seen.
#[must_use]
pub fn roofs(view: &View, buildings: &[SimulatedBuilding]) -> Raster<u16> {
    draw_at(view, buildings, &|_, b| b.ground_z_m + b.height_m)
}

/// Footprints laid at a level per building, the higher one in front.
pub(super) fn draw_at(
    view: &View,
    buildings: &[SimulatedBuilding],
    level: &dyn Fn(usize, &SimulatedBuilding) -> f64,
) -> Raster<u16> {
    let levels: Vec<f64> = buildings.iter().enumerate().map(|(i, b)| level(i, b)).collect();
    let mut order: Vec<usize> = (0..buildings.len()).collect();
    order.sort_by(|&a, &b| levels[b].total_cmp(&levels[a]).then(a.cmp(&b)));
    let order: Vec<(u16, &SimulatedBuilding)> = order.iter().map(|&i| (i as u16 + 1, &buildings[i])).collect();
    draw(view, &order, |label, centre, direction| {
        let s = (levels[usize::from(label) - 1] - centre.z) / direction.z;
        (s > 0.0).then(|| centre + s * direction).map(|p| (p.x, p.y))
    })
}

/// Labels every pixel whose ray meets a building's surface inside its footprint; the first building has it.
fn draw(
    view: &View,
    buildings: &[(u16, &SimulatedBuilding)],
    meets: impl Fn(u16, DVec3, DVec3) -> Option<(f64, f64)>,
) -> Raster<u16> {
    let (width, height) = (view.camera.width_px, view.camera.height_px);
    let mut mask = Raster::filled(width as usize, height as usize, 0);
    let centre = view.camera_from_map.centre();
    let map_from_camera = view.camera_from_map.rotation.transpose();
    for &(label, building) in buildings {
        let Some((low, high)) = pixel_bounds(view, building) else { continue };
        for row in low.1..high.1 {
            for col in low.0..high.0 {
                let pixel = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
                let Some(ray) = view.camera.unproject(pixel) else { continue };
                let direction = map_from_camera * ray;
                let cell = &mut mask[(col, row)];
                if *cell != 0 {
                    continue;
                }
                let Some((x, y)) = meets(label, centre, direction) else { continue };
                if building.footprint.contains(&Point::new(x, y)) {
                    *cell = label;
                }
            }
        }
    }
    mask
}

/// Columns and rows (first, and one after the last) that a footprint can touch, one pixel of margin included.
fn pixel_bounds(view: &View, building: &SimulatedBuilding) -> Option<((usize, usize), (usize, usize))> {
    building.footprint.bounding_rect()?;
    // From the ground under the footprint to its roof, and on a slope.
    let levels =
        [building.ground_z_m - SLOPE_M, building.ground_z_m + SLOPE_M, building.ground_z_m + building.height_m];
    let corners = building.footprint.exterior().points().flat_map(|p| levels.map(|z| (p, z))).map(|(p, z)| {
        let point = DVec3::new(p.x(), p.y(), z);
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
