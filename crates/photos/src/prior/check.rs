//! Does a prior's declared direction fit the calibrated cameras?
//!
//! In an oblique view of roughly level ground the ground gets farther up the image, and how far is known from the
//! pose. Buildings disturb this; they do not reverse it. So the rank correlation (Spearman's) between the prior's
//! farness and the depth of the bare ground says whether the tag can be right. It never sets the tag: it warns.
//!
//! Holes stored as a number can hide a wrong tag: 0 in a map of depths is near everything, and read as inverse depth it
//! is far from everything, against all other values. So a tag is judged without a least or greatest value that many
//! pixels share, and whether the prior shows the photo at all, with it.

use glam::DVec2;

use super::{DepthPrior, DepthUnit, PriorGeometry, PriorKind};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::stats;
use sizeup_survey::View;

/// Samples per side of the image: thousands of pixels say no more than hundreds.
const SAMPLES: usize = 32;
/// Least ratio of far to near ground in a view for its order to mean anything; a nadir view has almost none.
const LEAST_SPREAD: f64 = 1.1;
/// Fewest samples a correlation is taken from.
const FEWEST: usize = 50;
/// Share of the samples above which the prior's least or greatest value, if they have it to the bit, is a hole's or one
/// where values were cut off.
const SHARED: f64 = 0.02;
/// Median correlation below which a tag looks inverted.
const INVERTED_BELOW: f64 = -0.2;
/// Correlation below which a view leaves no doubt that its tag is inverted. Priors of simulated towns (8 and 60 buildings, seen 25° to 60°
/// off the vertical) have 0.97 and more with the right tag, and as much below 0 with the other one.
const SURELY_INVERTED_BELOW: f64 = -0.5;
/// Fewest views that leave no doubt together.
const FEWEST_SURE: usize = 3;
/// Median correlation below which a prior seems to show something else than its photo.
const UNRELATED_BELOW: f64 = 0.2;

/// Depths in metres over those of the bare ground, median: buildings and trees stand nearer, by up to a third of the flight's height.
const METRES: std::ops::RangeInclusive<f64> = 0.65..=1.1;
/// So near to 1 is no chance.
const LIKE_METRES: std::ops::RangeInclusive<f64> = 0.93..=1.03;

/// Rank correlations, −1 to 1, between a prior's farness and the calibrated depth of the bare ground in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundCorrelation {
    /// Correlation of all samples.
    pub all: f64,
    /// Without the least and the greatest value of the prior where many samples share it; of all where too few are left.
    pub unshared: f64,
    /// Median of the prior's numbers over the depth of the bare ground, of depths along the optical axis.
    pub of_ground: Option<f64>,
}

/// Fit of a prior to the ground; `None` where the view does not tell (nadir, too little ground or prior).
#[must_use]
pub fn ground_correlation(prior: &DepthPrior, view: &View, terrain: &Terrain) -> Option<GroundCorrelation> {
    let camera = &view.camera;
    let mut samples = Vec::new();
    for i in 0..SAMPLES * SAMPLES {
        let at = |i: usize, extent: u32| (i as f64 + 0.5) / SAMPLES as f64 * f64::from(extent);
        let pixel = DVec2::new(at(i % SAMPLES, camera.width_px), at(i / SAMPLES, camera.height_px));
        let value = prior.farness(prior.value_at(camera, pixel));
        if value.is_nan() {
            continue;
        }
        if let Some(depth) = ground_depth(view, pixel, terrain) {
            samples.push([f64::from(value), depth]);
        }
    }
    let all = rank_correlation(&samples)?;
    let is_depth = prior.kind == PriorKind::Depth && prior.geometry == PriorGeometry::ZDepth;
    let ratios = || samples.iter().map(|[value, depth]| value / depth).collect::<Vec<f64>>();
    let of_ground = is_depth.then(|| stats::median(&ratios())).flatten();
    Some(GroundCorrelation { all, unshared: rank_correlation(&without_shared_ends(samples)).unwrap_or(all), of_ground })
}

/// Rank correlation of pairs of farness and depth, where these are enough and reach from near to far.
fn rank_correlation(samples: &[[f64; 2]]) -> Option<f64> {
    let [farness, depths]: [Vec<f64>; 2] = std::array::from_fn(|i| samples.iter().map(|sample| sample[i]).collect());
    let spread = stats::quantile(&depths, 0.95)? / stats::quantile(&depths, 0.05)?;
    if samples.len() < FEWEST || spread < LEAST_SPREAD {
        return None;
    }
    correlation(&ranks(&farness), &ranks(&depths))
}

fn without_shared_ends(mut samples: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let most = SHARED * samples.len() as f64;
    for end in [f64::min, f64::max] {
        let Some(value) = samples.iter().map(|[farness, _]| *farness).reduce(end) else { break };
        if samples.iter().filter(|[farness, _]| *farness == value).count() as f64 > most {
            samples.retain(|[farness, _]| *farness != value);
        }
    }
    samples
}

/// Verdict of the views together on a tag; `None` where all is well or nothing can be said.
#[must_use]
pub fn judge_tag(correlations: &[GroundCorrelation]) -> Option<Issue> {
    let median = |of: fn(&GroundCorrelation) -> f64| stats::median(&correlations.iter().map(of).collect::<Vec<_>>());
    let (all, unshared) = (median(|r| r.all)?, median(|r| r.unshared)?);
    let about = Subject::Input("prior".to_owned());
    let found = |median: f64| {
        let views = if correlations.len() == 1 { "view" } else { "views" };
        format!(
            "rank correlation with the calibrated ground depth {median:.2}, median of {} {views}, expected it clearly positive",
            correlations.len()
        )
    };
    if unshared < INVERTED_BELOW {
        let message = format!("the prior looks inverted: {}", found(unshared));
        let hint = "the other `kind` (\"depth\" or \"inverse_depth\") may be the right one";
        return Some(Issue::new(Severity::Warning, "prior_looks_inverted", about, message).hint(hint));
    }
    if all < UNRELATED_BELOW {
        let message = format!("the prior does not follow the ground: {}", found(all));
        let hint = "is `kind` right, and `nodata` where holes are stored as a number? Do the files belong to these photos, in this order and orientation?";
        return Some(Issue::new(Severity::Warning, "prior_unrelated_to_ground", about, message).hint(hint));
    }
    None
}

/// The median correlation of views that all, without one exception, say that the tag is inverted; `None` where there is any doubt.
#[must_use]
pub fn surely_inverted(correlations: &[GroundCorrelation]) -> Option<f64> {
    let is_sure = |r: &GroundCorrelation| r.all < SURELY_INVERTED_BELOW && r.unshared < SURELY_INVERTED_BELOW;
    let are_sure = correlations.len() >= FEWEST_SURE && correlations.iter().all(is_sure);
    are_sure.then(|| stats::median(&correlations.iter().map(|r| r.unshared).collect::<Vec<_>>())).flatten()
}

/// Doubt that the views together raise about the unit that depths are said to have, or not; `None` where that fits.
#[must_use]
pub fn judge_unit(correlations: &[GroundCorrelation], unit: DepthUnit) -> Option<Issue> {
    let ratios: Vec<f64> = correlations.iter().filter_map(|correlation| correlation.of_ground).collect();
    let ratio = stats::median(&ratios)?;
    let about = Subject::Input("prior".to_owned());
    match unit {
        DepthUnit::Metre if !METRES.contains(&ratio) => {
            let message = format!(
                "the prior does not seem to be in metres: its numbers are {ratio:.3} times the calibrated depth of the ground, \
                 expected a little less than 1"
            );
            let hint = "`scale = 0.001` for millimetres; leave `unit` out where the unit is not known";
            Some(Issue::new(Severity::Warning, "prior_not_in_metres", about, message).hint(hint))
        }
        DepthUnit::Unknown if LIKE_METRES.contains(&ratio) => {
            let message = format!(
                "the prior looks as if it were in metres: its numbers are {ratio:.3} times the calibrated depth of the ground"
            );
            let hint =
                "where it was measured from these photos with these poses, say `unit = \"metre\"`: heights get better";
            Some(Issue::new(Severity::Note, "prior_like_metres", about, message).hint(hint))
        }
        _ => None,
    }
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
    use crate::prior::{PriorGeometry, PriorKind};
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;
    use sizeup_heights::raster::Raster;

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
        assert!((right.all - 1.0).abs() < 1e-3 && (wrong.all + 1.0).abs() < 1e-3, "{right:?} {wrong:?}");
        assert_eq!(judge_tag(&[right]), None);
        assert_eq!(judge_tag(&[wrong]).unwrap().code, "prior_looks_inverted");
        assert_eq!(surely_inverted(&[wrong; 2]), None, "two views are few");
        assert!(surely_inverted(&[wrong; 3]).unwrap() < -0.99);
        assert_eq!(surely_inverted(&[wrong, wrong, wrong, right]), None, "one view disagrees");
        let weak = GroundCorrelation { unshared: -0.3, ..wrong };
        assert_eq!(surely_inverted(&[wrong, wrong, wrong, weak]), None, "one view is not sure");
        let nadir = view(0.0);
        assert_eq!(ground_correlation(&prior_of_bare_ground(&nadir, PriorKind::Depth), &nadir, &terrain), None);
    }

    /// Message on a prior of one view whose tag and values were spoilt.
    fn told(kind: PriorKind, spoil: impl Fn(usize, f32) -> f32) -> Option<String> {
        let oblique = view(40.0);
        let mut prior = prior_of_bare_ground(&oblique, kind);
        prior.values.data_mut().iter_mut().enumerate().for_each(|(i, value)| *value = spoil(i, *value));
        Some(judge_tag(&[ground_correlation(&prior, &oblique, &Terrain::Constant(20.0))?])?.code)
    }

    #[test]
    fn holes_stored_as_a_number_do_not_hide_a_wrong_tag() {
        let inverted = Some("prior_looks_inverted".to_owned());
        let unrelated = Some("prior_unrelated_to_ground".to_owned());
        // Blocks of 25 × 15 cells: every second one in the far half is a hole.
        let is_hole = |i: usize| i / 100 < 38 && (i % 100 / 25 + i / 1500).is_multiple_of(2);
        let holes = |i: usize, v: f32| if is_hole(i) { 0.0 } else { v };
        assert_eq!(told(PriorKind::InverseDepth, holes), inverted, "depth read as inverse depth");
        // Sound values among holes read as the farthest of all: no direction is wrong, and something is.
        let near_holes = |i: usize, v: f32| if is_hole(7499 - i) { 0.0 } else { 1.0 / v };
        assert_eq!(told(PriorKind::InverseDepth, near_holes), unrelated);
        // What a network cuts off at its far end is no hole.
        assert_eq!(told(PriorKind::InverseDepth, |i, v| if i / 100 < 15 { 0.0 } else { 1.0 / v }), None);
        // Neither are the steps of eight bits.
        assert_eq!(told(PriorKind::InverseDepth, |_, v| (8_000.0 / v).round()), None);
        // Noise has no direction.
        assert_eq!(told(PriorKind::Depth, |i, _| (i * 7919 % 1009) as f32 + 1.0), unrelated);
    }

    #[test]
    fn a_unit_is_held_against_the_ground() {
        let oblique = view(40.0);
        let told = |kind: PriorKind, unit: DepthUnit, scale: f32| {
            let mut prior = prior_of_bare_ground(&oblique, kind);
            prior.values.data_mut().iter_mut().for_each(|value| *value *= scale);
            let found = ground_correlation(&prior, &oblique, &Terrain::Constant(20.0)).unwrap();
            judge_unit(&[found], unit).map(|issue| issue.code)
        };
        assert_eq!(told(PriorKind::Depth, DepthUnit::Metre, 0.98), None);
        assert_eq!(told(PriorKind::Depth, DepthUnit::Metre, 1000.0).as_deref(), Some("prior_not_in_metres"));
        assert_eq!(told(PriorKind::Depth, DepthUnit::Unknown, 0.98).as_deref(), Some("prior_like_metres"));
        assert_eq!(told(PriorKind::Depth, DepthUnit::Unknown, 0.01), None);
        assert_eq!(told(PriorKind::InverseDepth, DepthUnit::Unknown, 1.0), None);
    }

    #[test]
    fn ties_share_their_rank() {
        assert_eq!(ranks(&[5.0, 1.0, 5.0, 9.0]), [1.5, 0.0, 1.5, 3.0]);
    }
}
