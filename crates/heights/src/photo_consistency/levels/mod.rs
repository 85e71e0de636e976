//! Several roof levels in one outline, from the photos alone: an annex, a set-back, a hall and a house.
//!
//! ```text
//! S(c, s)        agreement of the photos around cell c on surface s, 0..1
//! S(R, s)        sum of S(c, s) over the cells of a region R
//! gain(R = A+B)  max S(A, a) + max S(B, b) − max S(R, s)      a, b, s: surfaces
//! ```
//!
//! 1. The outline is divided into cells along its main direction. The photos are compared around each of them at all heights.
//! 2. A few surfaces are chosen that explain most cells: levels, and pitched roofs of several forms.
//! 3. The rectangle is found that gains most by one surface inside and another outside. It needs a step at its border, so that a
//!    gable is not cut into strips. Its sides move to corners of the outline that are near.
//! 4. Parts are cut again as long as that gains enough.
//!
//! Sweeps over heights compare photos as in Collins 1996 (space sweep). Heights are metres above the ground, positions in the map
//! frame.
//!
//! Constants without a measurement beside them are first choices: only the evidence (sides of the compass), the pitched roofs and
//! the least gain were compared on real roofs in simulated photos.

mod cut;
mod evidence;
mod grid;
mod surfaces;

use geo::{BooleanOps as _, MultiPolygon};
use geo_types::Polygon;
use glam::DVec3;

use cut::Cut;
use evidence::Evidence;
use grid::Grid;
use surfaces::{HeightSweep, RoofSurface};

use super::MIN_PHOTOS;
use crate::picture::Picture;
use crate::split::divide;

/// Most parts of an outline.
const MAX_PARTS: usize = 4;
/// Pieces smaller than this go to the other side of the cut, m².
const MIN_PIECE_M2: f64 = 2.0;
/// Least gain of a cut, m² of full agreement. Of 399 real roofs in simulated photos (Rotterdam, west; 0.2 m per pixel), 100 of them with
/// steps of 1 m and more, 2, 3 and 4 cut 94, 91 and 86 of these, and 43, 31 and 20 of the others.
const MIN_GAIN_M2: f64 = 3.0;
/// The same as a share of the smaller part, where that is less: parts below 12 m² cannot gain as much. With it 92 of the 100 are cut, and 34
/// of the others.
const MIN_GAIN_SHARE: f64 = 0.25;
/// Adjacent parts whose levels differ by less are one, metres.
const SAME_LEVEL_M: f64 = 0.3;

/// A part of an outline at a level of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelPart {
    /// Outline of the part, map frame.
    pub polygon: Polygon<f64>,
    /// Mean height of its roof above the ground, metres.
    pub height_m: f64,
    /// By how much more alike the photos look on its roof than on those of the other parts extended over it, 0..1.
    pub certainty: f64,
}

/// An outline divided into parts at different levels.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    /// Two to four parts, which share borders and cover the outline.
    pub parts: Vec<LevelPart>,
    /// Gain of each cut, m² of full agreement, in the order of the cuts.
    pub gains_m2: Vec<f64>,
}

/// A part in the making.
struct Region {
    /// Values of the cells, row by row.
    is_in: Vec<bool>,
    polygon: MultiPolygon<f64>,
    surface: RoofSurface,
    next: NextCut,
}

/// How a region is cut next.
enum NextCut {
    Unknown,
    /// No cut gains enough.
    None,
    /// The best cut, the surfaces on both sides, and its gain, m² of full agreement.
    Best(Cut, [RoofSurface; 2], f64),
}

/// Divides an outline (map frame) into parts at different levels; `None` if one roof, flat or pitched, explains the photos as well.
///
/// `ground_z_m`: ground of the building, map frame. `heights_m`: least and greatest height of a roof above it. `pictures`: those that
/// show the roof, from several sides.
#[must_use]
pub fn find_levels(
    outline: &Polygon<f64>,
    ground_z_m: f64,
    heights_m: [f64; 2],
    pictures: &[&Picture],
) -> Option<Levels> {
    let grid = Grid::new(outline);
    if pictures.len() < MIN_PHOTOS || grid.area_m2() < 2.0 * cut::MIN_PART_M2 {
        return None;
    }
    let mut evidence = Evidence::new(&grid, pictures, ground_z_m + 0.5 * (heights_m[0] + heights_m[1]));
    let sweep = HeightSweep::new(&mut evidence, ground_z_m, heights_m);
    let is_in = vec![true; grid.cells.len()];
    let surfaces = surfaces::choose(&mut evidence, &sweep, &is_in);
    let surface = surfaces::best(&surfaces, &is_in)?.clone();
    let next = next_cut(&grid, &is_in, &surfaces);
    let polygon = MultiPolygon::new(vec![outline.clone()]);
    let mut regions = vec![Region { is_in, polygon, surface, next }];
    let mut gains_m2 = Vec::new();
    while n_pieces(&regions) < MAX_PARTS {
        for region in regions.iter_mut().filter(|region| matches!(region.next, NextCut::Unknown)) {
            let surfaces = surfaces::choose(&mut evidence, &sweep, &region.is_in);
            region.next = next_cut(&grid, &region.is_in, &surfaces);
        }
        let gain_m2 = |region: &Region| if let NextCut::Best(.., gain_m2) = region.next { Some(gain_m2) } else { None };
        let known = regions.iter().enumerate().filter_map(|(at, region)| Some((at, gain_m2(region)?)));
        let Some((at, gain_m2)) = known.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        let n_others = n_pieces(&regions) - regions[at].polygon.0.len();
        match part(&grid, &regions[at], outline) {
            Some(parted) if n_others + n_pieces(&parted) <= MAX_PARTS => {
                gains_m2.push(gain_m2);
                regions.swap_remove(at);
                regions.extend(parted);
            }
            _ => regions[at].next = NextCut::None,
        }
    }
    join(&mut regions);
    (regions.len() > 1).then(|| Levels { parts: parts(&regions), gains_m2 })
}

fn n_pieces(regions: &[Region]) -> usize {
    regions.iter().map(|region| region.polygon.0.len()).sum()
}

/// The best cut of a region, if it gains enough.
fn next_cut(grid: &Grid, is_in: &[bool], surfaces: &[RoofSurface]) -> NextCut {
    let Some(cut) = cut::best(grid, is_in, surfaces) else { return NextCut::None };
    let cell_m2 = grid.cell_m.powi(2);
    let gain_m2 = cut.gain * cell_m2;
    if gain_m2 < MIN_GAIN_M2.min(MIN_GAIN_SHARE * cut.n_smaller * cell_m2) {
        return NextCut::None;
    }
    NextCut::Best(cut, cut.surfaces.map(|surface| surfaces[surface].clone()), gain_m2)
}

/// The two sides of a region's best cut.
fn part(grid: &Grid, region: &Region, outline: &Polygon<f64>) -> Option<[Region; 2]> {
    let NextCut::Best(cut, surfaces, _) = &region.next else { return None };
    let rectangle = cut::place(grid, &region.is_in, cut, surfaces, outline);
    let [inner, outer] = [true, false].map(|is_inner| {
        let is_on_side = |(&i, is_in): (&usize, &bool)| *is_in && rectangle.contains(grid, i) == is_inner;
        grid.cells.iter().zip(&region.is_in).map(is_on_side).collect::<Vec<bool>>()
    });
    if !inner.contains(&true) || !outer.contains(&true) {
        return None;
    }
    let [within, beyond] = divide(&region.polygon, &rectangle.polygon(grid), MIN_PIECE_M2)?;
    let [inside, outside] = surfaces.clone();
    Some([
        Region { is_in: inner, polygon: within, surface: inside, next: NextCut::Unknown },
        Region { is_in: outer, polygon: beyond, surface: outside, next: NextCut::Unknown },
    ])
}

/// Joins regions that lie side by side at the same level.
fn join(regions: &mut Vec<Region>) {
    let is_same = |a: &Region, b: &Region| {
        let (of_a, of_b) = (a.surface.level_m(), b.surface.level_m());
        of_a.zip(of_b).is_some_and(|(a, b)| (a - b).abs() < SAME_LEVEL_M)
            && a.polygon.union(&b.polygon).0.len() < a.polygon.0.len() + b.polygon.0.len()
    };
    while let Some((a, b)) =
        (0..regions.len()).flat_map(|b| (0..b).map(move |a| (a, b))).find(|&(a, b)| is_same(&regions[a], &regions[b]))
    {
        let other = regions.remove(b);
        let joined = &mut regions[a];
        joined.polygon = joined.polygon.union(&other.polygon);
        joined.is_in.iter_mut().zip(other.is_in).for_each(|(is_in, of_other)| *is_in |= of_other);
    }
}

/// The pieces of all regions.
fn parts(regions: &[Region]) -> Vec<LevelPart> {
    let mut parts = Vec::new();
    for (at, region) in regions.iter().enumerate() {
        let height_m = region.surface.mean_m(&region.is_in);
        let n_cells = region.is_in.iter().filter(|is_in| **is_in).count() as f64;
        let mean = |surface: &RoofSurface| surface.score(&region.is_in) / n_cells;
        let others =
            regions.iter().enumerate().filter(|(other, _)| *other != at).map(|(_, other)| mean(&other.surface));
        let certainty = (mean(&region.surface) - others.fold(0.0, f64::max)).max(0.0);
        let pieces = region.polygon.0.iter().cloned();
        parts.extend(pieces.map(|polygon| LevelPart { polygon, height_m, certainty }));
    }
    parts
}

/// A place at a height above a plane at ground level.
fn raised(place: DVec3, by_m: f64) -> DVec3 {
    place + by_m * DVec3::Z
}

#[cfg(test)]
mod tests {
    use crate::camera::Camera;
    use crate::frames::Rigid;
    use geo::{Area as _, BoundingRect as _};
    use geo_types::{Rect, coord};
    use glam::DVec2;

    use super::*;

    /// Range of heights that roofs are looked for in, metres.
    const RANGE_M: [f64; 2] = [2.0, 14.0];
    /// Where walls hide a low roof from several sides, its border is known to a cell.
    const A_CELL_M: f64 = 0.5;
    /// Rays that meet a surface go down in such steps, metres.
    const STEP_M: f64 = 0.05;

    fn texture(at: DVec3) -> f32 {
        let wave = |f: f64, g: f64| (f * at.x + g * at.y + at.z).sin();
        (60.0 * (wave(2.3, 1.1) + wave(-1.2, 3.1) + wave(4.3, -2.7))) as f32
    }

    fn outline(width_m: f64, depth_m: f64) -> Polygon<f64> {
        Rect::new(coord! { x: 0.0, y: 0.0 }, coord! { x: width_m, y: depth_m }).to_polygon()
    }

    /// Parts that eight photos of a building show; `roof_m`: its height at a place, 0 beside it.
    fn parts_of(
        outline: &Polygon<f64>,
        roof_m: impl Fn(DVec2) -> f64,
        brightness: impl Fn(DVec3) -> f32,
    ) -> Vec<LevelPart> {
        let seen = |centre: DVec3, ray: DVec3| {
            let at = |z: f64| centre + ray * ((z - centre.z) / ray.z);
            let mut z = RANGE_M[1];
            while z > 0.0 {
                let place = at(z);
                let below_m = roof_m(place.truncate()) - z;
                if below_m >= 0.0 {
                    // A wall, where the ray is far below the roof already.
                    let is_roof = below_m <= 3.0 * STEP_M;
                    return if is_roof { brightness(place) } else { 0.0 };
                }
                z -= STEP_M;
            }
            brightness(at(0.0))
        };
        let middle = outline.bounding_rect().unwrap().center();
        let aim = DVec3::new(middle.x, middle.y, 6.0);
        let eyes = [[40.0, 10.0], [-40.0, 5.0], [0.0, 45.0], [10.0, -40.0], [30.0, 30.0], [-30.0, -25.0], [5.0, 3.0]];
        let pictures = eyes.map(|[x, y]| {
            let pose = Rigid::looking_at(DVec3::new(aim.x + x, aim.y + y, 80.0), aim);
            Picture::seeing(Camera::pinhole(200, 200, 500.0), pose, seen)
        });
        let levels = find_levels(outline, 0.0, RANGE_M, &pictures.each_ref());
        let mut parts = levels.map_or(Vec::new(), |levels| levels.parts);
        let area_m2: f64 = parts.iter().map(|part| part.polygon.unsigned_area()).sum();
        assert!(parts.is_empty() || (area_m2 - outline.unsigned_area()).abs() < 1e-3, "{parts:?} do not cover it");
        parts.sort_by(|a, b| b.height_m.total_cmp(&a.height_m));
        parts
    }

    /// Heights of rectangles (west, south, east, north), the first that holds a place.
    fn blocks<const N: usize>(blocks: [([f64; 4], f64); N]) -> impl Fn(DVec2) -> f64 {
        move |p: DVec2| {
            let holds = |[west, south, east, north]: [f64; 4]| p.x > west && p.x < east && p.y > south && p.y < north;
            blocks.iter().find(|(block, _)| holds(*block)).map_or(0.0, |(_, height_m)| *height_m)
        }
    }

    fn bounds(part: &LevelPart) -> [f64; 4] {
        let bounds = part.polygon.bounding_rect().unwrap();
        [bounds.min().x, bounds.min().y, bounds.max().x, bounds.max().y]
    }

    /// Asserts bounds (west, south, east, north) and height of a part, metres.
    fn assert_near(part: &LevelPart, expected: [f64; 4], height_m: f64, within_m: f64) {
        assert!((part.height_m - height_m).abs() < 0.1, "{height_m} m expected: {part:?}");
        let off = bounds(part).into_iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < within_m, "{expected:?} expected: {part:?}");
    }

    #[test]
    fn two_levels_are_cut_at_their_step() {
        let roof_m = blocks([([0.0, 0.0, 9.3, 10.0], 10.0), ([9.3, 0.0, 16.0, 10.0], 6.0)]);
        let parts = parts_of(&outline(16.0, 10.0), roof_m, texture);
        assert_eq!(parts.len(), 2, "{parts:?}");
        assert_near(&parts[0], [0.0, 0.0, 9.3, 10.0], 10.0, 0.3);
        assert_near(&parts[1], [9.3, 0.0, 16.0, 10.0], 6.0, 0.3);
        assert!(parts.iter().all(|part| part.certainty > 0.3), "{parts:?}");
    }

    #[test]
    fn three_levels_are_cut_twice() {
        let roof_m =
            blocks([([0.0, 0.0, 7.0, 10.0], 11.0), ([7.0, 0.0, 18.0, 4.6], 4.0), ([7.0, 4.6, 18.0, 10.0], 7.5)]);
        let parts = parts_of(&outline(18.0, 10.0), roof_m, texture);
        assert_eq!(parts.len(), 3, "{parts:?}");
        assert_near(&parts[0], [0.0, 0.0, 7.0, 10.0], 11.0, A_CELL_M);
        assert_near(&parts[1], [7.0, 4.6, 18.0, 10.0], 7.5, A_CELL_M);
        assert_near(&parts[2], [7.0, 0.0, 18.0, 4.6], 4.0, A_CELL_M);
    }

    #[test]
    fn an_annex_of_eight_square_metres_is_found() {
        let annex = [12.0, 3.0, 14.9, 5.8];
        let [west, south, east, north] = annex;
        let ring = [
            (0.0, 0.0),
            (west, 0.0),
            (west, south),
            (east, south),
            (east, north),
            (west, north),
            (west, 9.0),
            (0.0, 9.0),
        ];
        let roof_m = blocks([(annex, 3.5), ([0.0, 0.0, 12.0, 9.0], 8.0)]);
        let parts = parts_of(&Polygon::new(ring.to_vec().into(), Vec::new()), roof_m, texture);
        assert_eq!(parts.len(), 2, "{parts:?}");
        assert_near(&parts[1], annex, 3.5, A_CELL_M);
    }

    #[test]
    fn one_roof_is_not_cut() {
        let flat = blocks([([0.0, 0.0, 14.0, 10.0], 8.0)]);
        assert_eq!(parts_of(&outline(14.0, 10.0), flat, texture), []);
        let gable = |p: DVec2| {
            let is_over = (0.0..14.0).contains(&p.x) && (0.0..10.0).contains(&p.y);
            if is_over { 10.0 - 0.8 * (p.y - 5.0).abs() } else { 0.0 }
        };
        assert_eq!(parts_of(&outline(14.0, 10.0), gable, texture), []);
    }

    #[test]
    fn roofs_without_texture_are_not_cut() {
        let roof_m = blocks([([0.0, 0.0, 9.0, 10.0], 10.0), ([9.0, 0.0, 16.0, 10.0], 6.0)]);
        assert_eq!(parts_of(&outline(16.0, 10.0), roof_m, |_| 0.0), []);
    }

    #[test]
    fn slanted_outlines_are_covered() {
        let ring = [(0.0, 0.0), (15.0, 1.0), (14.0, 10.0), (6.0, 11.0), (-0.5, 9.0)];
        let outline = Polygon::new(ring.to_vec().into(), Vec::new());
        let is_over = outline.clone();
        let roof_m = move |p: DVec2| {
            let is_over = geo::Contains::contains(&is_over, &geo_types::Point::new(p.x, p.y));
            match is_over {
                true if p.x < 8.0 => 9.0,
                true => 5.0,
                false => 0.0,
            }
        };
        let parts = parts_of(&outline, roof_m, texture);
        assert!((2..=MAX_PARTS).contains(&parts.len()), "{parts:?}");
        assert!((parts[0].height_m - 9.0).abs() < 0.1, "{parts:?}");
    }
}
