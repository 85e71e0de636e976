//! Views that show a tile, and how far they see.

use geo::{ConvexHull as _, Intersects as _};
use geo_types::{Coord, MultiPoint, Point, Polygon, Rect};

use sizeup_geo::terrain::MapBox;
use sizeup_survey::{View, ground};

/// Where a building can stand that a view sees: places whose ground lies between `lowest_m` and `highest_m` and whose
/// roof is at most `tallest_m` above it; `None` where the view sees none.
#[must_use]
pub fn seen(view: &View, [lowest_m, highest_m]: [f64; 2], tallest_m: f64) -> Option<Polygon<f64>> {
    let centre = view.camera_from_map.centre();
    let mut places = ground::footprint(view, lowest_m);
    if places.is_empty() {
        return None;
    }
    let top_m = highest_m + tallest_m;
    if top_m < centre.z {
        places.extend(ground::footprint(view, top_m));
    } else {
        places.push(centre.truncate());
    }
    let points: Vec<Point<f64>> = places.iter().map(|p| Point::new(p.x, p.y)).collect();
    Some(MultiPoint(points).convex_hull())
}

/// Whether a view sees any place of a box.
#[must_use]
pub fn looks_at(view: &View, area: &MapBox, ground_m: [f64; 2], tallest_m: f64) -> bool {
    // Footprints end at 80° off the nadir: further away a view sees nothing.
    let centre = view.camera_from_map.centre();
    let furthest_m = (centre.z - ground_m[0]) * ground::MAX_OFF_NADIR_DEG.to_radians().tan();
    if area.distance_m((centre.x, centre.y)) > furthest_m {
        return false;
    }
    let corners = Rect::new(Coord { x: area.west_m, y: area.south_m }, Coord { x: area.east_m, y: area.north_m });
    seen(view, ground_m, tallest_m).is_some_and(|hull| hull.intersects(&corners.to_polygon()))
}

/// How far apart two places on the ground are that a view shows at once, metres.
#[must_use]
pub fn breadth_m(view: &View, ground_m: f64) -> f64 {
    let footprint = ground::footprint(view, ground_m);
    let farthest = |p: &glam::DVec2| footprint.iter().map(|q| p.distance(*q)).fold(0.0, f64::max);
    footprint.iter().map(farthest).fold(0.0, f64::max)
}
