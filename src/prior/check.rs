//! Does a prior's declared direction fit the calibrated cameras?
//!
//! In an oblique view of roughly level ground the ground gets farther up the image, and how far is known from the
//! pose. Buildings disturb this; they do not reverse it. So the rank correlation (Spearman's) between the prior's
//! farness and the depth of the bare ground says whether the tag can be right. It never sets the tag: it warns.

use glam::DVec2;

use super::DepthPrior;
use crate::ids::ViewId;
use crate::issue::{Issue, Severity, Subject};
use crate::stats;
use crate::survey::View;
use crate::terrain::Terrain;

/// Samples per side of the image: thousands of pixels say no more than hundreds.
const SAMPLES: usize = 32;
/// Least ratio of far to near ground in a view for its order to mean anything; a nadir view has almost none.
const LEAST_SPREAD: f64 = 1.1;
/// Fewest samples a correlation is taken from.
const FEWEST: usize = 50;
/// Median correlation below which a tag looks inverted.
const INVERTED_BELOW: f64 = -0.2;
/// Median correlation below which a prior seems to show something else than its photo.
const UNRELATED_BELOW: f64 = 0.2;

/// Rank correlation, −1 to 1, between a prior's farness and the calibrated depth of the bare ground; `None` where the
/// view does not tell (nadir, too little ground or prior).
#[must_use]
pub fn ground_correlation(prior: &DepthPrior, view: &View, terrain: &Terrain) -> Option<f64> {
    let camera = &view.camera;
    let (mut farness, mut depths) = (Vec::new(), Vec::new());
    for i in 0..SAMPLES * SAMPLES {
        let at = |i: usize, extent: u32| (i as f64 + 0.5) / SAMPLES as f64 * f64::from(extent);
        let pixel = DVec2::new(at(i % SAMPLES, camera.width_px), at(i / SAMPLES, camera.height_px));
        let value = prior.farness(prior.value_at(camera, pixel));
        if value.is_nan() {
            continue;
        }
        if let Some(depth) = ground_depth(view, pixel, terrain) {
            farness.push(f64::from(value));
            depths.push(depth);
        }
    }
    let spread = stats::quantile(&depths, 0.95)? / stats::quantile(&depths, 0.05)?;
    if farness.len() < FEWEST || spread < LEAST_SPREAD {
        return None;
    }
    correlation(&ranks(&farness), &ranks(&depths))
}

/// What the views together say about a tag; `None` where all is well or nothing can be said.
#[must_use]
pub fn judge_tag(correlations: &[(ViewId, f64)]) -> Option<Issue> {
    let values: Vec<f64> = correlations.iter().map(|(_, r)| *r).collect();
    let median = stats::median(&values)?;
    let about = Subject::Input("prior".to_owned());
    let found =
        format!("rank correlation with the calibrated ground depth {median:.2}, median of {} views", values.len());
    if median < INVERTED_BELOW {
        let message = format!("the prior looks inverted: {found}, expected it clearly positive");
        let hint = "the other `kind` (\"depth\" or \"inverse_depth\") may be the right one";
        return Some(Issue::new(Severity::Warning, "prior_looks_inverted", about, message).hint(hint));
    }
    if median < UNRELATED_BELOW {
        let message = format!("the prior does not follow the ground: {found}, expected it clearly positive");
        let hint = "is `kind` right, and `nodata` where holes are stored as a number? Do the files belong to these photos, in this order and orientation?";
        return Some(Issue::new(Severity::Warning, "prior_unrelated_to_ground", about, message).hint(hint));
    }
    None
}

/// Depth at which a pixel's ray meets the ground, by a few steps between height and place; metres.
fn ground_depth(view: &View, pixel: DVec2, terrain: &Terrain) -> Option<f64> {
    const STEPS: usize = 4;
    let centre = view.camera_from_map.centre();
    let ray = view.camera_from_map.rotation.transpose() * view.camera.unproject(pixel)?;
    let (lowest, highest) = terrain.range()?;
    let mut ground_z = f64::midpoint(lowest, highest);
    let mut depth = 0.0;
    for _ in 0..STEPS {
        depth = (ground_z - centre.z) / ray.z;
        let place = centre + depth * ray;
        ground_z = terrain.height_at(place.x, place.y).unwrap_or(ground_z);
    }
    (depth > 0.0 && depth.is_finite()).then_some(depth)
}

/// Ranks from 0; ties share their mean.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_unstable_by(|&a, &b| values[a].total_cmp(&values[b]).then(a.cmp(&b)));
    let mut ranks = vec![0.0; values.len()];
    for tied in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let first = order.partition_point(|&i| values[i] < values[tied[0]]);
        for &i in tied {
            ranks[i] = first as f64 + (tied.len() - 1) as f64 / 2.0;
        }
    }
    ranks
}

/// Pearson's; `None` where one of the two does not vary.
fn correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    let (mean_a, mean_b) = (stats::mean(a)?, stats::mean(b)?);
    let sum = |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(x, y)| f(x - mean_a, y - mean_b)).sum::<f64>();
    let (both, only_a, only_b) = (sum(&|x, y| x * y), sum(&|x, _| x * x), sum(&|_, y| y * y));
    (only_a > 0.0 && only_b > 0.0).then(|| both / (only_a * only_b).sqrt())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::camera::Camera;
    use crate::frames::Rigid;
    use crate::prior::{PriorGeometry, PriorKind};
    use crate::raster::Raster;

    /// Looks north, this far from straight down, 100 m above ground at 20 m.
    fn view(off_nadir_deg: f64) -> View {
        let (sin, cos) = off_nadir_deg.to_radians().sin_cos();
        // Rows are the camera's axes in the map: x east, y down the image, z forward.
        let forward = DVec3::new(0.0, sin, -cos);
        let rotation = DMat3::from_cols(DVec3::X, forward.cross(DVec3::X), forward).transpose();
        View {
            id: "a".into(),
            camera: Arc::new(Camera::pinhole(400, 300, 400.0)),
            camera_from_map: Rigid::from_rotation_and_centre(rotation, DVec3::new(0.0, 0.0, 120.0)),
            image: None,
        }
    }

    fn prior_of_bare_ground(view: &View, kind: PriorKind) -> DepthPrior {
        let terrain = Terrain::Constant(20.0);
        let cells = (0..75).flat_map(|row| (0..100).map(move |col| DVec2::new(col as f64 + 0.5, row as f64 + 0.5)));
        let depths = cells.map(|c| ground_depth(view, c * 4.0, &terrain).map_or(f32::NAN, |d| d as f32));
        let values = Raster::from_vec(100, 75, depths.collect()).unwrap();
        DepthPrior { values, kind, geometry: PriorGeometry::ZDepth }
    }

    #[test]
    fn a_right_tag_correlates_a_wrong_one_is_reported_and_nadir_says_nothing() {
        let terrain = Terrain::Constant(20.0);
        let oblique = view(40.0);
        let right = ground_correlation(&prior_of_bare_ground(&oblique, PriorKind::Depth), &oblique, &terrain).unwrap();
        let wrong =
            ground_correlation(&prior_of_bare_ground(&oblique, PriorKind::InverseDepth), &oblique, &terrain).unwrap();
        assert!((right - 1.0).abs() < 1e-3 && (wrong + 1.0).abs() < 1e-3, "{right} {wrong}");
        assert_eq!(judge_tag(&[("a".into(), right)]), None);
        assert_eq!(judge_tag(&[("a".into(), wrong)]).unwrap().code, "prior_looks_inverted");
        let nadir = view(0.0);
        assert_eq!(ground_correlation(&prior_of_bare_ground(&nadir, PriorKind::Depth), &nadir, &terrain), None);
    }

    #[test]
    fn ties_share_their_rank() {
        assert_eq!(ranks(&[5.0, 1.0, 5.0, 9.0]), [1.5, 0.0, 1.5, 3.0]);
    }
}
