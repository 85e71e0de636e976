//! Contours from masks: sub-pixel contours with holes, in pixels of the photo.
//!
//! Between two pixels of a label mask the border lies half way; in a map of probabilities it lies where the value between
//! them reaches the level. Buildings of a mask that tells no instances apart are what hangs together along sides: row
//! houses are one.

use geo::{Area as _, Contains as _};
use geo_types::{Coord, LineString, MultiPolygon, Polygon};

use super::partition::{self, LabelledRing};
use sizeup_heights::raster::Raster;

/// Share of pixels with a different neighbour from which on a mask is noise: real ones stay below a twentieth.
const NOISE_SHARE: f64 = 0.25;
/// Points this close to the line through their neighbours carry nothing, pixels.
const COLLINEAR_PX: f64 = 0.02;

/// One building in one photo.
#[derive(Debug, Clone, PartialEq)]
pub struct Contour {
    /// Parts; pixels of the photo, `y` down, the top-left pixel's centre at (0.5, 0.5).
    pub shape_px: MultiPolygon<f64>,
    /// Score by the segmenter, 0 to 1.
    pub score: f32,
    /// Whether the photo's border cuts it off.
    pub is_cut: bool,
    /// Label in the mask.
    pub label: u32,
}

/// Why a mask gives no contours.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MaskFault {
    /// A mask in which every pixel is a building.
    #[error("every pixel is a building")]
    AllBuilding,
    /// A mask whose labels change from pixel to pixel.
    #[error("{share:.0} % of its pixels lie on a border: it is noise, no mask of buildings", share = 100.0 * share)]
    Noise {
        /// Share of pixels with a different neighbour.
        share: f64,
    },
}

/// Settings for looking at a mask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vectorising {
    /// Whether equal labels are one building, or every part that hangs together is its own.
    pub instances: Instances,
    /// Parts and holes below this are left out, pixels².
    pub min_area_px2: f64,
    /// Tolerance of the contours, pixels.
    pub tolerance_px: f64,
}

/// Property that tells buildings apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Instances {
    /// Each label is one building, as instance networks write them.
    ByLabel,
    /// Each connected area of building pixels is a building: gaps part them.
    ByContact,
}

/// The contours of a label mask (0 = no building).
///
/// # Errors
/// [`MaskFault`] for masks without any information.
pub fn contours(labels: &Raster<u32>, how: Vectorising) -> Result<Vec<Contour>, MaskFault> {
    vectorise(labels, &partition::half_way, how)
}

/// The contours of a map of probabilities or scores at a level.
///
/// # Errors
/// [`MaskFault`] for maps without any information.
pub fn contours_at_level(values: &Raster<f32>, level: f32, how: Vectorising) -> Result<Vec<Contour>, MaskFault> {
    let labels = values.map(|v| u32::from(*v > level));
    let crossing = |[c0, r0]: [usize; 2], _: u32, [c1, r1]: [usize; 2], _: u32| {
        let (a, b) = (f64::from(values[(c0, r0)] - level), f64::from(values[(c1, r1)] - level));
        if a.is_nan() || b.is_nan() || a == b { 0.5 } else { a / (a - b) }
    };
    vectorise(&labels, &crossing, Vectorising { instances: Instances::ByContact, ..how })
}

fn vectorise(
    labels: &Raster<u32>,
    crossing: partition::Crossing<'_>,
    how: Vectorising,
) -> Result<Vec<Contour>, MaskFault> {
    if labels.data().iter().all(|&l| l == labels.data()[0]) {
        return match labels.data().first() {
            Some(&label) if label != 0 => Err(MaskFault::AllBuilding),
            _ => Ok(Vec::new()),
        };
    }
    let share = border_share(labels);
    if share > NOISE_SHARE && labels.data().len() > 4096 {
        return Err(MaskFault::Noise { share });
    }
    let size = [labels.width() as f64, labels.height() as f64];
    let rings: Vec<LabelledRing> = partition::rings(labels, crossing);
    let mut contours = Vec::new();
    let mut first = 0;
    while first < rings.len() {
        let label = rings[first].label;
        let after = first + rings[first..].partition_point(|r| r.label == label);
        let polygons = polygons(&rings[first..after], how);
        match how.instances {
            Instances::ByLabel if !polygons.is_empty() => contours.push(contour(label, polygons, size)),
            Instances::ByLabel => {}
            Instances::ByContact => contours.extend(polygons.into_iter().map(|p| contour(label, vec![p], size))),
        }
        first = after;
    }
    Ok(contours)
}

/// Share of pixels that differ from their right or lower neighbour.
fn border_share(labels: &Raster<u32>) -> f64 {
    let (data, width) = (labels.data(), labels.width());
    let rows = data.chunks_exact(width).map(|row| row.windows(2).filter(|w| w[0] != w[1]).count()).sum::<usize>();
    let columns = data.iter().zip(&data[width..]).filter(|(a, b)| a != b).count();
    (rows + columns) as f64 / data.len() as f64
}

/// Parts of one label with their holes, largest rings first considered as parts.
fn polygons(rings: &[LabelledRing], how: Vectorising) -> Vec<Polygon<f64>> {
    // Counter-clockwise on the screen, so clockwise by the numbers: parts have negative areas, holes positive ones.
    let closed = rings.iter().map(|ring| {
        let mut line = LineString::new(ring.points.clone());
        line.close();
        let area = Polygon::new(line.clone(), Vec::new()).signed_area();
        (line, area)
    });
    let (parts, holes): (Vec<_>, Vec<_>) =
        closed.filter(|(_, area)| area.abs() >= how.min_area_px2).partition(|(_, area)| *area < 0.0);
    let mut polygons: Vec<Polygon<f64>> = parts.into_iter().map(|(line, _)| Polygon::new(line, Vec::new())).collect();
    let boxes: Vec<_> = polygons.iter().map(geo::BoundingRect::bounding_rect).collect();
    for (hole, _) in holes {
        let corner = hole.0[0];
        let contains = |i: &usize| {
            let is_near = boxes[*i].is_some_and(|b| geo::Intersects::intersects(&b, &corner));
            is_near && Polygon::new(polygons[*i].exterior().clone(), Vec::new()).contains(&corner)
        };
        let around = (0..polygons.len()).filter(contains).min_by(|a, b| {
            let area = |i: usize| Polygon::new(polygons[i].exterior().clone(), Vec::new()).unsigned_area();
            area(*a).total_cmp(&area(*b))
        });
        if let Some(i) = around {
            polygons[i].interiors_push(hole);
        }
    }
    let thin = |ring: &LineString<f64>| thinned(ring, how.tolerance_px.max(COLLINEAR_PX));
    polygons.iter().map(|p| Polygon::new(thin(p.exterior()), p.interiors().iter().map(thin).collect())).collect()
}

/// A ring without points that carry nothing.
fn thinned(ring: &LineString<f64>, tolerance_px: f64) -> LineString<f64> {
    use geo::Simplify as _;
    let simple = ring.simplify(tolerance_px);
    if simple.0.len() >= 4 { simple } else { ring.clone() }
}

fn contour(label: u32, parts: Vec<Polygon<f64>>, [width, height]: [f64; 2]) -> Contour {
    let on_border = |c: &Coord<f64>| c.x <= 0.0 || c.y <= 0.0 || c.x >= width || c.y >= height;
    let is_cut = parts.iter().flat_map(|p| &p.exterior().0).any(on_border);
    Contour { shape_px: MultiPolygon::new(parts), score: 1.0, is_cut, label }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOW: Vectorising = Vectorising { instances: Instances::ByLabel, min_area_px2: 4.0, tolerance_px: 0.0 };

    fn disc(radius: f64) -> Raster<f32> {
        let value = |i: usize| {
            let (x, y) = ((i % 64) as f64 + 0.5 - 31.3, (i / 64) as f64 + 0.5 - 30.8);
            (radius - x.hypot(y)) as f32
        };
        Raster::from_vec(64, 64, (0..64 * 64).map(value).collect()).unwrap()
    }

    #[test]
    fn a_map_of_probabilities_gives_the_border_to_a_fiftieth_of_a_pixel() {
        let found = contours_at_level(&disc(20.0), 0.0, HOW).unwrap();
        assert_eq!(found.len(), 1);
        let ring = found[0].shape_px.0[0].exterior();
        assert!(ring.0.iter().all(|c| ((c.x - 31.3).hypot(c.y - 30.8) - 20.0).abs() < 0.02));
        assert!(!found[0].is_cut);
    }

    #[test]
    fn a_label_mask_gives_the_area_of_the_disc_to_a_hundredth() {
        let labels = disc(20.0).map(|v| 7 * u32::from(*v > 0.0));
        let found = contours(&labels, HOW).unwrap();
        let expected = std::f64::consts::PI * 400.0;
        assert!((found[0].shape_px.unsigned_area() / expected - 1.0).abs() < 0.01);
    }

    #[test]
    fn instances_in_parts_are_one_and_touching_buildings_without_ids_too() {
        let cells = |text: &str| text.chars().map(|c| c.to_digit(10).unwrap()).collect::<Vec<u32>>();
        let row = "0110022330110".to_owned();
        let labels = Raster::from_vec(13, 4, cells(&row.repeat(4))).unwrap();
        let by_label = contours(&labels, HOW).unwrap();
        assert_eq!(by_label.iter().map(|o| o.shape_px.0.len()).collect::<Vec<_>>(), [2, 1, 1]);
        assert!(by_label.iter().all(|o| o.is_cut));
        let semantic = labels.map(|l| u32::from(*l > 0));
        assert_eq!(contours(&semantic, Vectorising { instances: Instances::ByContact, ..HOW }).unwrap().len(), 3);
    }

    #[test]
    fn empty_full_and_noisy_masks_are_told_apart() {
        assert_eq!(contours(&Raster::filled(9, 9, 0), HOW), Ok(Vec::new()));
        assert_eq!(contours(&Raster::filled(9, 9, 3), HOW), Err(MaskFault::AllBuilding));
        let noise =
            Raster::from_vec(128, 128, (0..128 * 128_u32).map(|i| i.wrapping_mul(2_654_435_761) >> 31).collect());
        assert!(matches!(contours(&noise.unwrap(), HOW), Err(MaskFault::Noise { .. })));
    }

    #[test]
    fn thousands_of_specks_are_left_out() {
        let labels =
            Raster::from_vec(400, 400, (0..160_000).map(|i| u32::from(i % 400 % 8 == 0 && i / 400 % 8 == 0)).collect());
        assert!(contours(&labels.unwrap(), HOW).unwrap().is_empty());
    }

    #[test]
    fn contours_that_touch_themselves_come_apart() {
        // Two squares that meet in a corner are two parts; a hole that meets the outside in a corner is none.
        let text = ["110000", "110000", "001111", "001001", "001111", "000000"].concat();
        let labels = Raster::from_vec(6, 6, text.chars().map(|c| c.to_digit(10).unwrap()).collect()).unwrap();
        let how = Vectorising { min_area_px2: 0.0, ..HOW };
        let found = contours(&labels, how).unwrap();
        assert_eq!(found[0].shape_px.0.len(), 2);
        for part in &found[0].shape_px.0 {
            assert!(geo::Validation::is_valid(part), "{part:?}");
        }
    }
}
