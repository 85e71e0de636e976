//! Ground by the sparse points of a model: a rough level, where there is no terrain model.
//!
//! ```text
//! low      of the points in a square of CELL_M, the height that LOW of them lie below: roofs and trees are above it
//! level    the height that a quarter of the squares' lows lie below; the other squares are mostly roofs
//! relief   of that quarter, without the lowest LOWEST of all
//! ```
//!
//! Points are in the model's frame, views in the project's: what lies between is the median difference of the cameras' heights.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{binary, text};
use crate::{SurveyConfig, SurveyError, View};
use sizeup_heights::stats::{median, quantile};

/// Fewer photos may see a point by mistake.
const MIN_PHOTOS: usize = 3;
/// Side of a square, metres, and how many points tell its ground.
const CELL_M: f64 = 50.0;
const MIN_POINTS: usize = 15;
/// Share of a square's points that lie below its ground: false ones.
const LOW: f64 = 0.15;
/// Share of squares that are taken to be open, and of those that may lie in pits.
const OPEN: f64 = 0.25;
const LOWEST: f64 = 0.05;

/// Rough ground of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparseGround {
    /// Level of open squares, project's heights, metres.
    pub level_m: f64,
    /// Difference between open squares, metres: in a town on level ground what points are off by.
    pub relief_m: f64,
    /// Half of what lies between the lowest and the highest tenth of the squares' lows, metres: hills, roofs and trees.
    pub spread_m: f64,
    /// Number of squares.
    pub n: usize,
}

/// The ground that the sparse points of a COLMAP model tell; `None` of other surveys, without points, and where they are too few.
///
/// # Errors
/// [`SurveyError`]: the points or the poses cannot be read.
pub fn sparse_ground(config: &SurveyConfig, views: &[View]) -> Result<Option<SparseGround>, SurveyError> {
    let file = |extension: &str| config.path.join("points3D").with_extension(extension);
    let mut points = Vec::new();
    if file("bin").is_file() {
        binary::points(&file("bin"), MIN_PHOTOS as u64, |at| points.push(at))?;
    } else if file("txt").is_file() {
        text::points(&file("txt"), MIN_PHOTOS, |at| points.push(at))?;
    }
    if points.is_empty() {
        return Ok(None);
    }
    let in_project: BTreeMap<&str, f64> = views.iter().map(|view| (view.id.0.as_str(), view.centre().z)).collect();
    let model = super::read(config)?;
    // A world that nobody names is the project's, in metres.
    let unit_m = config.crs.as_ref().map_or(Ok(1.0), |world| model.units.height_unit_m(&config.height, world))?;
    points.iter_mut().for_each(|at| *at *= unit_m);
    let raised = model.poses.into_iter();
    let raised = raised.filter_map(|pose| Some(in_project.get(pose.name.as_str())? - unit_m * pose.centre.z));
    let Some(raised_m) = median(&raised.collect::<Vec<_>>()) else { return Ok(None) };
    Ok(level(&points).map(|ground| SparseGround { level_m: ground.level_m + raised_m, ..ground }))
}

/// The same in the model's frame.
fn level(points: &[DVec3]) -> Option<SparseGround> {
    let mut squares: BTreeMap<[i64; 2], Vec<f64>> = BTreeMap::new();
    for at in points.iter().filter(|at| at.is_finite()) {
        squares.entry([at.x, at.y].map(|c| (c / CELL_M).floor() as i64)).or_default().push(at.z);
    }
    let told = squares.values().filter(|heights| heights.len() >= MIN_POINTS);
    let lows: Vec<f64> = told.filter_map(|heights| quantile(heights, LOW)).collect();
    let level_m = quantile(&lows, OPEN)?;
    let spread_m = 0.5 * (quantile(&lows, 0.9)? - quantile(&lows, 0.1)?);
    Some(SparseGround { level_m, relief_m: level_m - quantile(&lows, LOWEST)?, spread_m, n: lows.len() })
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::*;

    /// A town of 400 m: a third of its squares are roofs of 12 m, and one point in 23 is false and deep below.
    fn town() -> Vec<DVec3> {
        let point = |i: usize| {
            let at = glam::DVec2::new((i * 7919 % 400) as f64, (i * 104_729 % 400) as f64);
            let is_roof = ((at.x / 50.0) as usize + (at.y / 50.0) as usize).is_multiple_of(3);
            let z_m = if i.is_multiple_of(23) {
                -40.0
            } else if is_roof {
                12.0
            } else {
                0.0
            };
            at.extend(z_m + 0.2 * (i as f64).sin())
        };
        (0..3000).map(point).collect()
    }

    #[test]
    fn the_level_of_a_town_is_its_streets_and_neither_roofs_nor_false_points() {
        let ground = level(&town()).unwrap();
        assert!(ground.level_m.abs() < 0.5 && ground.relief_m < 0.5, "{ground:?}");
        assert_eq!(ground.n, 64);
        assert_eq!(level(&town()[..50]), None);
        let on_a_slope: Vec<DVec3> = town().iter().map(|at| at + 0.05 * at.x * DVec3::Z).collect();
        assert!(level(&on_a_slope).unwrap().relief_m > 2.0, "20 m over the town");
    }

    #[test]
    fn a_model_in_feet_has_its_ground_in_metres() {
        const US_FOOT_M: f64 = 1200.0 / 3937.0;
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
        write("cameras.txt", "1 PINHOLE 400 300 300 300 200 150\n".to_owned());
        // 90 m above the streets of a town on 10 m.
        write("images.txt", format!("1 0 1 0 0 0 0 {} 1 a.jpg\n\n", 100.0 / US_FOOT_M));
        let mut points = String::new();
        for (i, at) in town().iter().enumerate() {
            let at = (at + 10.0 * DVec3::Z) / US_FOOT_M;
            writeln!(points, "{i} {} {} {} 0 0 0 0.5 1 0 2 0 3 0", at.x, at.y, at.z).unwrap();
        }
        write("points3D.txt", points);
        let config = SurveyConfig {
            crs: Some(sizeup_geo::crs::Crs::parse("EPSG:2263").unwrap()),
            offset: [984_250.0, 213_254.0, 0.0],
            ..SurveyConfig::at(folder.path())
        };
        let survey = crate::read(&config, &sizeup_geo::crs::Crs::parse("EPSG:32118").unwrap()).unwrap();
        assert!((survey.views[0].centre().z - 100.0).abs() < 1e-6);
        let ground = sparse_ground(&config, &survey.views).unwrap().unwrap();
        assert!((ground.level_m - 10.0).abs() < 0.5 && ground.n == 64, "{ground:?}");
    }

    #[test]
    fn text_and_binary_hold_the_same_points_and_those_of_two_photos_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let (as_text, as_bytes) = (folder.path().join("points3D.txt"), folder.path().join("points3D.bin"));
        let points = [(DVec3::new(1.5, -2.0, 30.25), 3_u32), (DVec3::new(4.0, 5.0, 6.0), 2), (DVec3::ONE, 7)];
        let (mut lines, mut bytes) = ("# comment\n".to_owned(), (points.len() as u64).to_le_bytes().to_vec());
        for (i, (at, n)) in points.iter().enumerate() {
            let track: String = (0..*n).map(|k| format!(" {k} 0")).collect();
            writeln!(lines, "{i} {} {} {} 10 20 30 0.5{track}", at.x, at.y, at.z).unwrap();
            bytes.extend((i as u64).to_le_bytes());
            at.to_array().iter().for_each(|c| bytes.extend(c.to_le_bytes()));
            bytes.extend([10, 20, 30]);
            bytes.extend(0.5_f64.to_le_bytes());
            bytes.extend(u64::from(*n).to_le_bytes());
            (0..*n).for_each(|k| bytes.extend([k.to_le_bytes(), [0; 4]].concat()));
        }
        std::fs::write(&as_text, lines).unwrap();
        std::fs::write(&as_bytes, &bytes).unwrap();
        let (mut of_text, mut of_bytes) = (Vec::new(), Vec::new());
        text::points(&as_text, MIN_PHOTOS, |at| of_text.push(at)).unwrap();
        binary::points(&as_bytes, MIN_PHOTOS as u64, |at| of_bytes.push(at)).unwrap();
        assert_eq!(of_text, [points[0].0, points[2].0]);
        assert_eq!(of_bytes, of_text);
        // Cut off in the middle: told, not half read.
        std::fs::write(&as_bytes, &bytes[..bytes.len() - 9]).unwrap();
        assert!(binary::points(&as_bytes, MIN_PHOTOS as u64, |_| ()).is_err());
    }
}
