//! Point clouds as reference: a real laser scan can be the truth.
//!
//! ```text
//! h* = percentile of the roof points' levels − ground
//! ```
//!
//! Roof points are those inside a footprint, away from its border; ground is the median of the ground points around it
//! (LAS class 2), or a level that the user states. A cloud with instance ids brings its own footprints (convex hulls in
//! plan); one without is cut by the footprints of the result, so that every footprint of the result has a truth by
//! construction: match rates then say nothing.

use geo::ConvexHull as _;
use geo_types::{MultiPoint, MultiPolygon, Point};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::TruthBuilding;
use sizeup_geo::cloud::{Cloud, GROUND, ground_near, points_in};
use sizeup_heights::stats;

/// Settings of heights from a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CloudTruthOptions {
    /// Percentile of the roof points' levels that counts, 0 to 100.
    pub roof_percentile: f64,
    /// Level of the ground, metres; absent: from the cloud's ground points.
    pub ground_m: Option<f64>,
    /// Points nearer than this to the footprint are left out: walls, eaves, neighbours. Metres.
    pub inset_m: f64,
    /// Ground points within this of a footprint's bounding box count, metres.
    pub ground_reach_m: f64,
    /// Fewer roof points than this give no height.
    pub min_points: usize,
}

impl Default for CloudTruthOptions {
    fn default() -> Self {
        Self { roof_percentile: 50.0, ground_m: None, inset_m: 0.5, ground_reach_m: 5.0, min_points: 10 }
    }
}

impl std::fmt::Display for CloudTruthOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "percentile {} of a building's points at least {} m inside its footprint, minus ",
            self.roof_percentile, self.inset_m
        )?;
        match self.ground_m {
            Some(ground_m) => write!(f, "the stated ground at {ground_m} m"),
            None => write!(f, "the median of ground points within {} m", self.ground_reach_m),
        }
    }
}

/// One building per footprint, in their order; one without enough points, or without ground, has no height.
#[must_use]
pub fn truth_under_footprints(
    cloud: &Cloud,
    footprints: &[(String, MultiPolygon<f64>)],
    options: &CloudTruthOptions,
) -> Vec<TruthBuilding> {
    let polygons: Vec<MultiPolygon<f64>> = footprints.iter().map(|(_, footprint)| footprint.clone()).collect();
    let roofs = points_in(&cloud.of_buildings(), &polygons, options.inset_m);
    let ground: Vec<DVec3> = cloud.of_class(GROUND).collect();
    let levels = match options.ground_m {
        Some(level) => vec![Some(level); polygons.len()],
        None => ground_near(&ground, &polygons, options.ground_reach_m),
    };
    let building = |(i, points): (usize, Vec<DVec3>)| {
        let ground_m = levels[i];
        let z: Vec<f64> = points.iter().map(|p| p.z).collect();
        let roof_m = stats::quantile(&z, options.roof_percentile / 100.0).filter(|_| z.len() >= options.min_points);
        TruthBuilding {
            id: footprints[i].0.clone(),
            footprint: Some(footprints[i].1.clone()),
            height_m: roof_m.zip(ground_m).map(|(roof, ground)| roof - ground),
            group: None,
        }
    };
    roofs.into_iter().enumerate().map(building).collect()
}

/// One building of a cloud that names them.
struct Instance {
    id: u32,
    points: Vec<DVec3>,
    hull: MultiPolygon<f64>,
    ground_m: Option<f64>,
}

/// One building per instance id, ascending. Ground is what is stated, else the ground points around it, else its lowest
/// point.
#[must_use]
pub fn truth_of_instances(cloud: &Cloud, options: &CloudTruthOptions) -> Vec<TruthBuilding> {
    let mut by_instance: std::collections::BTreeMap<u32, Vec<DVec3>> = std::collections::BTreeMap::new();
    for (&point, &instance) in cloud.points.iter().zip(&cloud.instances) {
        if let Some(instance) = instance {
            by_instance.entry(instance).or_default().push(point);
        }
    }
    let hull = |points: &Vec<DVec3>| {
        let plan: MultiPoint<f64> = points.iter().map(|p| Point::new(p.x, p.y)).collect();
        MultiPolygon::new(vec![plan.convex_hull()])
    };
    let hulls: Vec<MultiPolygon<f64>> = by_instance.values().map(hull).collect();
    let ground: Vec<DVec3> = cloud.of_class(GROUND).collect();
    let around = ground_near(&ground, &hulls, options.ground_reach_m);
    let instances = by_instance.into_iter().zip(hulls).zip(around).map(|(((id, points), hull), around)| Instance {
        id,
        points,
        hull,
        ground_m: options.ground_m.or(around),
    });
    let building = |Instance { id, points, hull, ground_m }: Instance| {
        let z: Vec<f64> = points.iter().map(|p| p.z).collect();
        let lowest_m = z.iter().copied().fold(f64::INFINITY, f64::min);
        let roof_m = stats::quantile(&z, options.roof_percentile / 100.0).filter(|_| z.len() >= options.min_points);
        TruthBuilding {
            id: id.to_string(),
            footprint: Some(hull),
            height_m: roof_m.map(|roof| roof - ground_m.unwrap_or(lowest_m)),
            group: None,
        }
    };
    instances.map(building).collect()
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;

    /// A flat roof at 12 m over 10 × 10 m on ground at 2 m, one point per half metre.
    fn lidar() -> Cloud {
        let mut cloud = Cloud::default();
        for i in 0..60 * 60 {
            let (x, y) = (f64::from(i % 60) / 2.0 - 10.0, f64::from(i / 60) / 2.0 - 10.0);
            let is_roof = (0.0..=10.0).contains(&x) && (0.0..=10.0).contains(&y);
            cloud.points.push(DVec3::new(x, y, if is_roof { 12.0 } else { 2.0 }));
            cloud.classes.push(if is_roof { 6 } else { 2 });
        }
        cloud
    }

    #[test]
    fn a_flat_roof_has_its_height_over_the_ground_around_it() {
        let square = polygon![(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)];
        let far = polygon![(x: 90.0, y: 0.0), (x: 99.0, y: 0.0), (x: 99.0, y: 10.0)];
        let footprints =
            [("a".to_owned(), MultiPolygon::new(vec![square])), ("b".to_owned(), MultiPolygon::new(vec![far]))];
        let truth = truth_under_footprints(&lidar(), &footprints, &CloudTruthOptions::default());
        assert_eq!((truth[0].height_m, truth[1].height_m), (Some(10.0), None));
        let stated = CloudTruthOptions { ground_m: Some(3.0), ..CloudTruthOptions::default() };
        assert_eq!(truth_under_footprints(&lidar(), &footprints, &stated)[0].height_m, Some(9.0));
    }

    #[test]
    fn instances_bring_their_own_footprints() {
        let mut cloud = lidar();
        cloud.instances = cloud.classes.iter().map(|c| Some(u32::from(*c)).filter(|c| *c == 6)).collect();
        let truth = truth_of_instances(&cloud, &CloudTruthOptions::default());
        assert_eq!(truth.len(), 1);
        assert_eq!((truth[0].id.as_str(), truth[0].height_m), ("6", Some(10.0)));
        assert!((geo::Area::unsigned_area(truth[0].footprint.as_ref().unwrap()) - 100.0).abs() < 1e-9);
        // Neither ground points nor a level: the roof is all there is, and its lowest point the ground.
        cloud.classes.clear();
        assert_eq!(truth_of_instances(&cloud, &CloudTruthOptions::default())[0].height_m, Some(0.0));
        let stated = CloudTruthOptions { ground_m: Some(3.0), ..CloudTruthOptions::default() };
        assert_eq!(truth_of_instances(&cloud, &stated)[0].height_m, Some(9.0));
    }
}
