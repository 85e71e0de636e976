//! Whether a terrain model has roofs on it: then it steps up at footprints, and ground would be taken from roofs.
//!
//! ```text
//! step = median terrain inside a footprint − median terrain around it      metres
//! ```
//!
//! On a slope both medians move alike, so hills have no steps.

use geo::line_measures::{Densify as _, Euclidean};
use geo::{BoundingRect as _, Buffer as _, Contains as _};
use geo_types::{Coord, Point, Polygon};
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use sizeup_heights::stats;
use sizeup_heights::terrain::Terrain;

/// A step up of this much is a roof, metres: more than built-up ground, less than a storey.
const STEP_M: f64 = 2.0;
/// Fewer footprints say nothing of the model.
const MIN_FOOTPRINTS: usize = 5;
/// Share of the footprints with a step from which on the model is one of surfaces.
const SURFACE_SHARE: f64 = 0.5;
/// Ground around a footprint is taken this far from it: cells, and metres beyond.
const CELLS_OUT: f64 = 1.0;
const METRES_OUT: f64 = 1.0;
/// Places are this far apart, metres.
const SPACING_M: f64 = 1.0;

/// Steps of a terrain model at footprints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceModel {
    /// Footprints inside which it stands at least 2 m above the ground around them.
    pub n_steps: usize,
    /// Footprints that were compared.
    pub n: usize,
    /// Median of these steps, metres.
    pub step_m: f64,
}

/// Steps of a model that has roofs on it; `None` for one of the bare ground, and for fewer than five footprints (map, metres).
#[must_use]
pub fn surface_model(terrain: &Terrain, footprints: &[&Polygon<f64>]) -> Option<SurfaceModel> {
    let Terrain::Grid(dem) = terrain else { return None };
    let out_m = METRES_OUT + CELLS_OUT * dem.cell_m().0.max(dem.cell_m().1);
    let boxes = footprints.iter().enumerate().filter_map(|(i, footprint)| {
        let rect = footprint.bounding_rect()?;
        let (min, max) = (rect.min(), rect.max());
        Some(GeomWithData::new(Rectangle::from_corners([min.x, min.y], [max.x, max.y]), i))
    });
    let tree: RTree<GeomWithData<Rectangle<[f64; 2]>, usize>> = RTree::bulk_load(boxes.collect());
    let is_open = |at: &Coord<f64>| {
        let here = AABB::from_point([at.x, at.y]);
        !tree.locate_in_envelope_intersecting(&here).any(|near| footprints[near.data].contains(&Point::from(*at)))
    };
    let heights = |places: Vec<Coord<f64>>| -> Vec<f64> {
        places.iter().filter_map(|at| terrain.height_at(at.x, at.y)).collect()
    };
    let step = |footprint: &&Polygon<f64>| {
        let around = footprint.buffer(out_m).into_iter().flat_map(|ring| on_ring(&ring)).filter(is_open).collect();
        Some(stats::median(&heights(inside(footprint)))? - stats::median(&heights(around))?)
    };
    let steps: Vec<f64> = footprints.iter().filter_map(step).collect();
    let up: Vec<f64> = steps.iter().copied().filter(|step_m| *step_m >= STEP_M).collect();
    if steps.len() < MIN_FOOTPRINTS || (up.len() as f64) < SURFACE_SHARE * steps.len() as f64 {
        return None;
    }
    Some(SurfaceModel { n_steps: up.len(), n: steps.len(), step_m: stats::median(&up)? })
}

fn on_ring(polygon: &Polygon<f64>) -> Vec<Coord<f64>> {
    Euclidean.densify(polygon.exterior(), SPACING_M).into_inner()
}

fn inside(footprint: &Polygon<f64>) -> Vec<Coord<f64>> {
    let Some(rect) = footprint.bounding_rect() else { return Vec::new() };
    let n = |extent_m: f64| (extent_m / SPACING_M).ceil().clamp(1.0, 64.0) as usize;
    let (n_x, n_y) = (n(rect.width()), n(rect.height()));
    let place = |i: usize, n: usize, extent_m: f64| (i as f64 + 0.5) / n as f64 * extent_m;
    let lattice = (0..n_x * n_y).map(|k| Coord {
        x: rect.min().x + place(k % n_x, n_x, rect.width()),
        y: rect.min().y + place(k / n_x, n_y, rect.height()),
    });
    lattice.filter(|at| footprint.contains(&Point::from(*at))).collect()
}

#[cfg(test)]
mod tests {
    use geo::Rect;

    use super::*;
    use crate::terrain::Dem;
    use sizeup_heights::raster::Raster;

    /// A slope of one in five with six houses, 1 m cells, on which some of them stand with a height.
    fn slope(heights_m: [f64; 6]) -> (Terrain, Vec<Polygon<f64>>) {
        let houses: Vec<Polygon<f64>> = (0..6)
            .map(|i| {
                let west = 10.0 + 30.0 * f64::from(i);
                Rect::new(Coord { x: west, y: 10.0 }, Coord { x: west + 12.0, y: 22.0 }).to_polygon()
            })
            .collect();
        let height = |k: usize| {
            let at = Point::new((k % 200) as f64 + 0.5, 39.5 - (k / 200) as f64);
            let on = houses.iter().position(|house| house.contains(&at)).map_or(0.0, |i| heights_m[i]);
            (0.2 * at.x() + on) as f32
        };
        let raster = Raster::from_vec(200, 40, (0..200 * 40).map(height).collect()).unwrap();
        (Terrain::Grid(Dem::new(raster, 0.0, 40.0, 1.0, 1.0).unwrap()), houses)
    }

    fn verdict(heights_m: [f64; 6]) -> Option<SurfaceModel> {
        let (terrain, houses) = slope(heights_m);
        surface_model(&terrain, &houses.iter().collect::<Vec<_>>())
    }

    #[test]
    fn a_model_with_roofs_on_it_is_told_from_bare_ground_on_a_slope() {
        assert_eq!(verdict([0.0; 6]), None);
        assert_eq!(verdict([8.0, 6.0, 0.0, 0.0, 0.0, 0.0]), None, "two roofs were forgotten in it");
        let found = verdict([8.0, 6.0, 7.0, 9.0, 8.0, 0.0]).expect("five of six houses stand on it");
        assert_eq!((found.n_steps, found.n), (5, 6));
        assert!((found.step_m - 8.0).abs() < 0.3, "{found:?}");
        assert_eq!(verdict([-8.0; 6]), None, "holes under houses are no roofs");
    }
}
