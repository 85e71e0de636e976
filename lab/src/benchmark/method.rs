//! What is run on a scene.

use geo::Centroid as _;
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::baseline::{
    LiftConfig, Norm, SegmentedCloud, SlabConfig, constant, convex_hull, metric_lift, neighbourhood, percentile,
    regression, stacked_prisms,
};
use sizeup::config::RunConfig;
use sizeup_heights::optimise::{OptimiseConfig, Preset, Problem, Solution, solve};
use sizeup_heights::stats;
use sizeup_truth::evaluate::TruthBuilding;
use sizeup_truth::evaluate::solid::{Solid, UprightPrism};

/// A way from a scene's evidence to one height, or one body, per footprint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The optimiser of the publication, preset `paper`.
    Paper,
    /// The optimiser of this program, preset `robust`.
    Robust,
    /// Priors to metres on free ground, roofs lifted, medians taken.
    MetricLift,
    /// Absolute differences of normalised depth, made small as `paper` makes its loss small.
    RegressionL1,
    /// Squared differences of normalised depth, made small as `paper` makes its loss small.
    RegressionL2,
    /// Median of a point cloud inside each footprint.
    PointsP50,
    /// 70th percentile of a point cloud inside each footprint.
    PointsP70,
    /// 90th percentile of a point cloud inside each footprint.
    PointsP90,
    /// The median height of the truth for every building: what a guess of one number can do at best, or nearly so.
    Constant,
    /// The median of the true heights of the five nearest other buildings.
    Neighbourhood,
    /// Convex hull of a point cloud around each footprint.
    ConvexHull,
    /// Stacked prisms from slabs of a point cloud around each footprint.
    StackedPrisms,
}

/// Evidence of methods other than those from priors.
#[derive(Debug, Clone, Default)]
pub struct Aids {
    /// Point cloud, map frame.
    pub points: Vec<DVec3>,
    /// Centres and heights of known buildings, map frame.
    pub known: Vec<(DVec2, f64)>,
}

/// Answer: heights, and bodies where the method makes its own.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Heights with their standard deviations and reasons.
    pub solution: Solution,
    /// Bodies in place of extruded footprints.
    pub bodies: Option<Vec<Solid>>,
}

/// Neighbours whose heights are taken.
const N_NEIGHBOURS: usize = 5;
/// A known building whose centre is this near is the building itself, metres.
const SAME_M: f64 = 3.0;
/// Points this near to a footprint's border are left out of percentiles, metres.
const INSET_M: f64 = 0.5;
/// Points below which a cloud says nothing about a building.
const MIN_POINTS: usize = 5;

impl Method {
    /// Definition, in a line.
    #[must_use]
    pub fn definition(self) -> &'static str {
        match self {
            Self::Paper => "the publication's optimiser: ordinal hinge and Adam",
            Self::Robust => "local search over the correlation of rendered depth and prior",
            Self::MetricLift => "each view's prior to metres on free ground, roof pixels lifted, medians per building",
            Self::RegressionL1 => "absolute differences of normalised inverse depth made small, otherwise as `paper`",
            Self::RegressionL2 => "squared differences of normalised inverse depth made small, otherwise as `paper`",
            Self::PointsP50 => "median of a point cloud inside each footprint, minus the ground",
            Self::PointsP70 => "70th percentile of a point cloud inside each footprint, minus the ground",
            Self::PointsP90 => "90th percentile of a point cloud inside each footprint, minus the ground",
            Self::Constant => "the median of known heights for every building",
            Self::Neighbourhood => "the median height of the five nearest known buildings",
            Self::ConvexHull => "convex hull in space of a point cloud inside each footprint",
            Self::StackedPrisms => {
                "prisms from slabs of a point cloud, a new one where the hull grows (after ProxyRecon)"
            }
        }
    }

    /// All, in the order of the tables.
    pub const ALL: [Self; 12] = [
        Self::Paper,
        Self::Robust,
        Self::MetricLift,
        Self::RegressionL1,
        Self::RegressionL2,
        Self::PointsP50,
        Self::PointsP70,
        Self::PointsP90,
        Self::Constant,
        Self::Neighbourhood,
        Self::ConvexHull,
        Self::StackedPrisms,
    ];
    /// Those whose results people would use: what the accuracy matrix compares.
    pub const MAIN: [Self; 3] = [Self::Paper, Self::Robust, Self::MetricLift];

    /// The name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Robust => "robust",
            Self::MetricLift => "metric_lift",
            Self::RegressionL1 => "regression_l1",
            Self::RegressionL2 => "regression_l2",
            Self::PointsP50 => "points_p50",
            Self::PointsP70 => "points_p70",
            Self::PointsP90 => "points_p90",
            Self::Constant => "constant",
            Self::Neighbourhood => "neighbourhood",
            Self::ConvexHull => "convex_hull",
            Self::StackedPrisms => "stacked_prisms",
        }
    }

    /// The method of this name; `None` where there is none.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// Whether it needs a point cloud.
    #[must_use]
    pub fn needs_points(self) -> bool {
        use Method::{ConvexHull, PointsP50, PointsP70, PointsP90, StackedPrisms};
        matches!(self, PointsP50 | PointsP70 | PointsP90 | ConvexHull | StackedPrisms)
    }

    /// Whether it needs heights that are known.
    #[must_use]
    pub fn needs_known(self) -> bool {
        matches!(self, Self::Constant | Self::Neighbourhood)
    }

    /// Whether it is the publication's optimiser, or that with another loss.
    #[must_use]
    pub fn selects_as_paper(self) -> bool {
        matches!(self, Self::Paper | Self::RegressionL1 | Self::RegressionL2)
    }

    /// Sets what the method needs in a run's configuration.
    pub(super) fn configure(self, config: &mut RunConfig) {
        config.optimise.preset = if self.selects_as_paper() { Preset::Paper } else { Preset::Robust };
    }

    /// Heights, and bodies where it makes its own.
    #[must_use]
    pub fn answer(self, problem: &Problem<'_>, config: &OptimiseConfig, aids: &Aids) -> Answer {
        let cut = |inset_m: f64| SegmentedCloud::new(problem.scene, &aids.points, inset_m);
        let of_points = |percent: f64| percentile(problem, &cut(INSET_M), percent, MIN_POINTS);
        let by_regression = |norm: Norm| regression(problem, config, norm);
        let known_heights = || aids.known.iter().map(|k| k.1).collect::<Vec<f64>>();
        let solution = match self {
            Self::Paper | Self::Robust => solve(problem, config),
            Self::MetricLift => metric_lift(problem, &LiftConfig::default()),
            Self::RegressionL1 => by_regression(Norm::L1),
            Self::RegressionL2 => by_regression(Norm::L2),
            Self::PointsP50 => of_points(50.0),
            Self::PointsP70 => of_points(70.0),
            Self::PointsP90 => of_points(90.0),
            Self::Constant => constant(problem, stats::median(&known_heights()).unwrap_or(0.0)),
            Self::Neighbourhood => neighbourhood(problem, &aids.known, N_NEIGHBOURS, SAME_M),
            Self::ConvexHull | Self::StackedPrisms => return bodies(self, problem, &cut(0.0)),
        };
        Answer { solution, bodies: None }
    }
}

/// Hulls or stacked prisms; a body's height is its top minus the ground.
fn bodies(method: Method, problem: &Problem<'_>, cloud: &SegmentedCloud) -> Answer {
    let body = |(i, (points, ground_m)): (usize, (&Vec<DVec3>, &f64))| {
        if method == Method::ConvexHull {
            return convex_hull(points).ok().map(|hull| Solid::of_triangles(&i.to_string(), hull));
        }
        let slabs = stacked_prisms(points, *ground_m, &SlabConfig::default());
        let prisms = slabs.into_iter().map(|slab| UprightPrism { footprint: slab.footprint, levels_m: slab.levels_m });
        let solid = Solid::of_prisms(&i.to_string(), prisms.collect());
        (!solid.facets.is_empty()).then_some(solid)
    };
    let solids: Vec<Option<Solid>> = cloud.points.iter().zip(&cloud.ground_m).enumerate().map(body).collect();
    // The percentile 100 of the same points is the top of either body.
    let solution = percentile(problem, cloud, 100.0, MIN_POINTS);
    Answer { solution, bodies: Some(solids.into_iter().flatten().collect()) }
}

impl Aids {
    /// Known buildings from a reference.
    #[must_use]
    pub fn known_of(truth: &[TruthBuilding]) -> Vec<(DVec2, f64)> {
        let known = |b: &TruthBuilding| {
            let centre = b.footprint.as_ref()?.centroid()?;
            Some((DVec2::new(centre.x(), centre.y()), b.height_m?))
        };
        truth.iter().filter_map(known).collect()
    }
}
