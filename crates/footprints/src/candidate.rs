//! Buildings as single views show them, on the ground.

use geo::BoundingRect as _;
use geo_types::{MultiPolygon, Polygon};
use rstar::AABB;

/// One building as one view shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct FootprintCandidate {
    /// Which view, as a position among the [`SeenGround`]s.
    pub view: usize,
    /// Footprint, in several parts where something stands before it; exteriors counter-clockwise, holes clockwise.
    /// Map frame, metres.
    pub shape: MultiPolygon<f64>,
    /// Weight: the inverse square of its footprint's standard deviation in metres.
    pub weight: f64,
    /// Score by the segmenter, 0 to 1; 1 where it gives nothing.
    pub score: f32,
    /// Whether the image's border cuts it off.
    pub is_cut: bool,
}

/// Ground that one view sees.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenGround {
    /// The image's border on the ground, counter-clockwise; map frame, metres. Beyond it the view says nothing.
    pub area: Polygon<f64>,
}

/// Low and high corner of a box.
pub(super) type Bounds = ([f64; 2], [f64; 2]);

/// Bounds of a shape.
pub(super) fn bounds(shape: &MultiPolygon<f64>) -> Option<Bounds> {
    let rect = shape.bounding_rect()?;
    Some((rect.min().into(), rect.max().into()))
}

/// Two boxes as one.
pub(super) fn joint(a: Bounds, b: Bounds) -> Bounds {
    let pick = |f: fn(f64, f64) -> f64, a: [f64; 2], b: [f64; 2]| [f(a[0], b[0]), f(a[1], b[1])];
    (pick(f64::min, a.0, b.0), pick(f64::max, a.1, b.1))
}

/// Area that two boxes share.
pub(super) fn shared_box_m2(a: Bounds, b: Bounds) -> f64 {
    let side = |i: usize| (a.1[i].min(b.1[i]) - a.0[i].max(b.0[i])).max(0.0);
    side(0) * side(1)
}

/// A box for the R-tree.
pub(super) fn envelope((low, high): Bounds) -> AABB<[f64; 2]> {
    AABB::from_corners(low, high)
}
