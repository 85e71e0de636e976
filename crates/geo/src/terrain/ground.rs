//! Ground level under a building: samples of the terrain along its footprint and inside.
//!
//! On a slope there is no *the* ground. Which level a height counts from is the user's choice
//! ([`GroundReference`]); the lowest one is kept as well, because walls go down to it.

use geo::line_measures::{Densify as _, Euclidean};
use geo::{Area as _, BoundingRect as _, Contains as _};
use geo_types::{Coord, Polygon};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::issue::{Issue, Severity, Subject};
use sizeup_heights::ids::BuildingId;
use sizeup_heights::stats;
use sizeup_heights::terrain::{GroundLevel, Terrain};

/// Distance between samples of the ground, metres; wider under very large buildings.
const SPACING_M: f64 = 1.0;
/// How far around a building to look for ground where the terrain has none under it, metres.
const SEARCH_M: f64 = 50.0;

/// Most samples one building takes: more change the levels by millimetres.
const MAX_SAMPLES: f64 = 4096.0;

/// Which ground level a building's height counts from.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroundReference {
    /// The lowest ground under the building (`measuredHeight` of `CityGML`).
    #[default]
    Lowest,
    /// The mean of the ground under it.
    Mean,
    /// A percentile of the ground under it, 0 to 100 (10 in 3dfier and 3DBAG: the lowest without outliers).
    Percentile(f64),
}

/// How ground levels are taken.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GroundConfig {
    /// Which level heights count from: "lowest", "mean" or { percentile = 10 }.
    pub reference: GroundReference,
}

/// Ground level under a footprint (map frame, metres), and what is to be said about it: a note where the terrain has
/// gaps under the building, a warning where the level comes from around it, a refusal where there is none.
#[must_use]
pub fn ground_under(
    terrain: &Terrain,
    id: &BuildingId,
    footprint: &Polygon<f64>,
    config: GroundConfig,
) -> (Option<GroundLevel>, Option<Issue>) {
    if let Terrain::Constant(z_m) = *terrain {
        return (Some(GroundLevel::flat(z_m)), None);
    }
    let heights =
        |points: &[Coord<f64>]| -> Vec<f64> { points.iter().filter_map(|p| terrain.height_at(p.x, p.y)).collect() };
    let spacing_m = SPACING_M.max((footprint.unsigned_area() / MAX_SAMPLES).sqrt());
    let mut points = along_outline(footprint, spacing_m);
    let outline = heights(&points);
    points.extend(inside(footprint, spacing_m));
    let found = heights(&points);
    let tell = |severity, code, message: String| {
        let issue = Issue::new(severity, code, Subject::Building(id.to_string()), message);
        match footprint.bounding_rect().map(geo::Rect::center) {
            Some(middle) => issue.at(middle.x, middle.y),
            None => issue,
        }
    };
    if let Some(level) = level(&found, config.reference) {
        let level = GroundLevel { outline_m: ends(&outline), ..level };
        let is_complete = found.len() == points.len();
        let gaps =
            format!("the terrain has no value at {} of {} places under it", points.len() - found.len(), points.len());
        let issue = (!is_complete).then(|| tell(Severity::Note, "ground_has_gaps", gaps));
        return (Some(level), issue);
    }
    if let Some((level, distance_m)) = around(terrain, footprint, config) {
        let message = format!("the terrain has no value under it: its ground is taken from {distance_m:.0} m around");
        return (Some(level), Some(tell(Severity::Warning, "ground_from_around", message)));
    }
    let message = format!("the terrain has no value under it, nor within {SEARCH_M} m");
    let hint = "use a terrain model that covers the building";
    (None, Some(tell(Severity::Refused, "ground_unknown", message).hint(hint)))
}

fn level(heights_m: &[f64], reference: GroundReference) -> Option<GroundLevel> {
    let lowest_m = heights_m.iter().copied().reduce(f64::min)?;
    let reference_m = match reference {
        GroundReference::Lowest => lowest_m,
        GroundReference::Mean => stats::mean(heights_m)?,
        GroundReference::Percentile(p) => stats::quantile(heights_m, p / 100.0)?,
    };
    Some(GroundLevel { reference_m, lowest_m, outline_m: None })
}

/// The lowest and the highest of some heights.
fn ends(heights_m: &[f64]) -> Option<[f64; 2]> {
    let end = |further: fn(f64, f64) -> f64| heights_m.iter().copied().reduce(further);
    Some([end(f64::min)?, end(f64::max)?])
}

/// Corners, and points along all rings.
fn along_outline(footprint: &Polygon<f64>, spacing_m: f64) -> Vec<Coord<f64>> {
    let rings = std::iter::once(footprint.exterior()).chain(footprint.interiors());
    rings.flat_map(|ring| Euclidean.densify(ring, spacing_m).into_inner().into_iter().skip(1)).collect()
}

/// A lattice inside.
fn inside(footprint: &Polygon<f64>, spacing_m: f64) -> Vec<Coord<f64>> {
    let Some(bounds) = footprint.bounding_rect() else { return Vec::new() };
    let count = |extent_m: f64| (extent_m / spacing_m).ceil().max(1.0) as usize;
    let (n_x, n_y) = (count(bounds.width()), count(bounds.height()));
    let middle = |i: usize, n: usize, extent_m: f64| (i as f64 + 0.5) / n as f64 * extent_m;
    let lattice = (0..n_y).flat_map(|j| (0..n_x).map(move |i| (i, j))).map(|(i, j)| Coord {
        x: bounds.min().x + middle(i, n_x, bounds.width()),
        y: bounds.min().y + middle(j, n_y, bounds.height()),
    });
    lattice.filter(|point| footprint.contains(point)).collect()
}

/// The nearest frame around the building's bounds that meets any terrain, and how far out it is.
fn around(terrain: &Terrain, footprint: &Polygon<f64>, config: GroundConfig) -> Option<(GroundLevel, f64)> {
    const FRAMES: usize = 10;
    let bounds = footprint.bounding_rect()?;
    (1..=FRAMES).find_map(|frame| {
        let distance_m = SEARCH_M * frame as f64 / FRAMES as f64;
        let wider = geo_types::Rect::new(
            bounds.min() - Coord { x: distance_m, y: distance_m },
            bounds.max() + Coord { x: distance_m, y: distance_m },
        );
        let ring = Euclidean.densify(wider.to_polygon().exterior(), SPACING_M.max(distance_m / 10.0));
        let heights: Vec<f64> = ring.0.iter().filter_map(|p| terrain.height_at(p.x, p.y)).collect();
        Some((level(&heights, config.reference)?, distance_m))
    })
}

#[cfg(test)]
mod tests {
    use geo::polygon;

    use super::*;
    use crate::terrain::Dem;
    use sizeup_heights::raster::Raster;

    /// 100 × 100 cells of 1 m from (0, 0), rising 1 m per 10 m eastwards; no value west of `first_col`.
    fn slope(first_col: usize) -> Terrain {
        let height = |col: usize| if col < first_col { f32::NAN } else { (col as f32 + 0.5) / 10.0 };
        let heights = (0..100).flat_map(|_| (0..100).map(height)).collect();
        Terrain::Grid(Dem::new(Raster::from_vec(100, 100, heights).unwrap(), 0.0, 100.0, 1.0, 1.0).unwrap())
    }

    fn house(west_m: f64) -> Polygon<f64> {
        polygon![
            (x: west_m, y: 40.0), (x: west_m + 20.0, y: 40.0), (x: west_m + 20.0, y: 50.0), (x: west_m, y: 50.0),
        ]
    }

    fn under(terrain: &Terrain, west_m: f64, reference: GroundReference) -> (Option<GroundLevel>, Option<Issue>) {
        ground_under(terrain, &"a".into(), &house(west_m), GroundConfig { reference })
    }

    #[test]
    fn a_house_on_a_slope_has_the_level_its_reference_asks_for() {
        let level = |reference| under(&slope(0), 30.0, reference).0.unwrap();
        assert!((level(GroundReference::Lowest).reference_m - 3.0).abs() < 1e-3);
        assert!((level(GroundReference::Mean).reference_m - 4.0).abs() < 0.05);
        assert!((level(GroundReference::Percentile(10.0)).reference_m - 3.2).abs() < 0.11);
        assert!((level(GroundReference::Mean).lowest_m - 3.0).abs() < 1e-3);
    }

    #[test]
    fn gaps_are_noted_missing_ground_is_looked_for_and_no_ground_is_refused() {
        let code = |first_col| under(&slope(first_col), 30.0, GroundReference::Lowest);
        assert_eq!(code(40).1.unwrap().code, "ground_has_gaps");
        let (level, issue) = code(60);
        assert_eq!(issue.unwrap().code, "ground_from_around");
        assert!((level.unwrap().reference_m - 6.0).abs() < 0.6);
        // Nothing within 50 m of the house's eastern wall at 20 m.
        let (level, issue) = under(&slope(90), 0.0, GroundReference::Lowest);
        assert_eq!((level, issue.unwrap().code.as_str()), (None, "ground_unknown"));
    }

    #[test]
    fn the_outline_has_its_own_ends_whatever_lies_inside() {
        let ends = |west_m| under(&slope(0), west_m, GroundReference::Mean).0.unwrap().outline_m.unwrap();
        let [low_m, high_m] = ends(30.0);
        assert!((low_m - 3.0).abs() < 1e-3 && (high_m - 5.0).abs() < 1e-3, "{low_m} {high_m}");
        // A pit of 3 m in a court that the outline does not touch is no ground at the walls, but walls end below it.
        let Terrain::Grid(dem) = slope(0) else { unreachable!() };
        let height = |i: usize, z_m: f32| {
            if (38..42).contains(&(i % 100)) && (53..57).contains(&(i / 100)) { z_m - 3.0 } else { z_m }
        };
        let dug = dem.heights_m().data().iter().enumerate().map(|(i, z_m)| height(i, *z_m)).collect();
        let dug = Terrain::Grid(Dem::new(Raster::from_vec(100, 100, dug).unwrap(), 0.0, 100.0, 1.0, 1.0).unwrap());
        let level = under(&dug, 30.0, GroundReference::Lowest).0.unwrap();
        assert_eq!(level.outline_m, Some([low_m, high_m]));
        assert!((level.lowest_m - 0.9).abs() < 0.06, "{}", level.lowest_m);
        // Ground from around says nothing of the walls.
        assert_eq!(under(&slope(60), 30.0, GroundReference::Lowest).0.unwrap().outline_m, None);
    }

    #[test]
    fn references_are_written_as_words() {
        let read = |text| serde_json::from_str::<GroundReference>(text).unwrap();
        assert_eq!(read("\"mean\""), GroundReference::Mean);
        assert_eq!(read("{\"percentile\": 10}"), GroundReference::Percentile(10.0));
    }
}
