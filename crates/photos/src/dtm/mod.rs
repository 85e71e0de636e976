//! A terrain model from the photos alone, for places that have no other.
//!
//! 1. Level squares of open ground, away from the footprints, are laid over the area.
//! 2. Photos that see a square are laid onto it at many heights; where they look alike is its height ([`patch`]).
//! 3. Squares that stand above their neighbours (trees, cars, what has no footprint) are left out, and a surface is laid
//!    through the others ([`surface`]).
//!
//! Frame: the map; heights in the vertical reference that the poses are in. Heights of buildings are measured from the same
//! photos, so a datum that the poses share cancels: this model fits them better than one that is exact elsewhere.

mod level;
mod patch;
mod surface;
mod trend;

use std::sync::Arc;

use geo::{BoundingRect as _, Distance as _, Euclidean};
use geo_types::{Point, Polygon};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::{GeomWithData, Rectangle};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::level::{GroundSurface, REACH_M};
use self::trend::GroundTrend;
use crate::prior::{Album, PriorError};
use sizeup_geo::terrain::{Dem, DemError, MapBox, Terrain};
use sizeup_heights::photo_consistency::{FLATTEST, choose};
use sizeup_heights::picture::{Picture, PosedCamera};
use sizeup_survey::{View, Viewpoints};
/// Side of a square, metres. Above 0.
pub(crate) const PATCH_M: f64 = 6.0;
/// Squares keep this far from footprints, metres. At least 0.
pub(crate) const CLEAR_M: f64 = 1.5;
/// Most photos that a square is seen in, at least 3.
pub(crate) const N_VIEWS: usize = 8;
/// Longer side that photos are reduced to, pixels.
pub const LONG_SIDE_PX: u32 = 2400;
/// Least correlation of a square that counts, 0..1.
pub(crate) const MIN_SCORE: f64 = 0.6;
/// By how much it has to be better than at any other height.
pub(crate) const MIN_MARGIN: f64 = 0.1;

/// How the ground is found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DtmConfig {
    /// The ground is somewhere within this of the rough level, metres. Above 0.
    pub within_m: f64,
    /// From one square to the next, metres. Above 0.
    #[serde(skip)]
    pub spacing_m: f64,
    /// Cells of the model, metres. Above 0.
    #[serde(skip)]
    pub cell_m: f64,
    /// How far beyond the footprints the model reaches, metres. At least 0.
    #[serde(skip)]
    pub margin_m: f64,
}

impl Default for DtmConfig {
    fn default() -> Self {
        Self { within_m: 15.0, spacing_m: 12.0, cell_m: 5.0, margin_m: 100.0 }
    }
}

/// Outcome of a square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SquareOutcome {
    /// Height of the ground, metres.
    Ground(f64),
    /// Something that its neighbours say is not ground, metres.
    Outlier(f64),
    /// The photos agree at no height, or at several.
    Unclear,
    /// Fewer than three photos see it.
    Unseen,
}

/// A square: its middle in the map, and what came of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundSquare {
    /// Middle of the square, map frame, metres.
    pub at: DVec2,
    /// Outcome of the search for ground there.
    pub outcome: SquareOutcome,
}

impl GroundSquare {
    /// Height at which the photos agree, whether that is ground or not, metres.
    fn height_m(&self) -> Option<f64> {
        match self.outcome {
            SquareOutcome::Ground(z_m) | SquareOutcome::Outlier(z_m) => Some(z_m),
            SquareOutcome::Unclear | SquareOutcome::Unseen => None,
        }
    }

    fn raised(self, by_m: f64) -> Self {
        let outcome = match self.outcome {
            SquareOutcome::Ground(z_m) => SquareOutcome::Ground(z_m + by_m),
            SquareOutcome::Outlier(z_m) => SquareOutcome::Outlier(z_m + by_m),
            outcome => outcome,
        };
        Self { outcome, ..self }
    }
}

/// A terrain model, and what it was made of.
#[derive(Debug, Clone)]
pub struct Dtm {
    /// The heights; no value where no ground was found within a few squares.
    pub dem: Dem,
    /// All squares that were tried.
    pub squares: Vec<GroundSquare>,
    /// Standard deviation of a square's height against its neighbours', metres.
    pub sigma_m: f64,
}

/// Why there is no model.
#[derive(Debug, thiserror::Error)]
pub enum DtmError {
    /// A setting out of range.
    #[error("terrain from photos: {field} is {value}, expected {expected}")]
    Config {
        /// Name of the setting.
        field: &'static str,
        /// The value that was set.
        value: f64,
        /// Values that are allowed, in words.
        expected: &'static str,
    },
    /// Too little ground was found.
    #[error(
        "terrain from photos: of {n_squares} squares of open ground, {n_unseen} are seen by fewer than three photos, \
         {n_unclear} look alike at no single height between {from_m:.1} and {to_m:.1} m, and only {n_ground} are left\n\
         hint: is the rough level right (terrain.constant_m)? --within widens the search"
    )]
    TooLittle {
        /// Number of squares tried.
        n_squares: usize,
        /// Those too few photos see.
        n_unseen: usize,
        /// Those without a height.
        n_unclear: usize,
        /// Number of squares with a height.
        n_ground: usize,
        /// Lowest height tried, metres.
        from_m: f64,
        /// Highest height tried, metres.
        to_m: f64,
    },
    /// The photos that see open ground were taken from one place.
    #[error(
        "terrain from photos: there is no baseline: of the {n_seen} squares of open ground that several photos see, {n_one_place} are \
         seen from one place only, and photos from one place show no depth\n\
         hint: take the photos from different places: fly around or past the buildings instead of turning the camera on the spot"
    )]
    NoBaseline {
        /// Number of squares that several photos see.
        n_seen: usize,
        /// Those of them that are seen from one place.
        n_one_place: usize,
    },
    /// A photo cannot be read.
    #[error(transparent)]
    Photo(#[from] PriorError),
    /// A grid that cannot be a terrain model.
    #[error(transparent)]
    Dem(#[from] DemError),
}

/// Memory for reduced photos, bytes: squares of one block are seen in much the same ones.
pub const PICTURE_BYTES: usize = 1 << 30;
/// Squares are looked at block by block of this side, metres, and so many together.
const BLOCK_M: f64 = 250.0;
const N_TOGETHER: usize = 64;
/// Squares off the trend of the ground are searched again within this of it, metres, in so many rounds, until a round finds
/// less than one in `FEW_SHARE`.
const NEAR_TREND_M: f64 = 3.0;
const MAX_ROUNDS: usize = 4;
const FEW_SHARE: usize = 50;
/// Fewer squares than this make no surface.
const MIN_SQUARES: usize = 12;

/// The area of a model around footprints (or under the cameras, where there are none).
#[must_use]
pub fn area(views: &[View], footprints: &[&Polygon<f64>], config: &DtmConfig) -> MapBox {
    let corners = footprints.iter().filter_map(|o| o.bounding_rect()).flat_map(|r| [r.min().x_y(), r.max().x_y()]);
    let eyes = views.iter().filter(|v| v.image.is_some()).map(|v| v.camera_from_map.centre()).map(|eye| (eye.x, eye.y));
    let around = MapBox::around(corners).or_else(|| MapBox::around(eyes));
    around.unwrap_or(MapBox { west_m: 0.0, south_m: 0.0, east_m: 0.0, north_m: 0.0 }).grown(config.margin_m)
}

/// Makes the model over an area, away from footprints. `rough` is what is known of the ground: a level, or a coarse or shifted
/// model, which the photos correct; where they show no ground a model is shifted as it is in the median. `progress` is told
/// how many squares of how many are done.
///
/// # Errors
/// [`DtmError`].
pub fn estimate(
    views: &[View],
    footprints: &[&Polygon<f64>],
    rough: &Terrain,
    config: &DtmConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Dtm, DtmError> {
    let area = area(views, footprints, config);
    let (squares, sigma_m) = off_by(views, footprints, rough, area, config, progress)?;
    let rough_m = |at: DVec2| rough.height_at(at.x, at.y).unwrap_or(f64::NAN);
    let count = |is: fn(&SquareOutcome) -> bool| squares.iter().filter(|s| is(&s.outcome)).count();
    let n_ground = count(|o| matches!(o, SquareOutcome::Ground(_)));
    if n_ground < MIN_SQUARES {
        let places = squares.iter().filter_map(|s| Some(s.at.extend(rough.height_at(s.at.x, s.at.y)?)));
        let seen: Vec<Viewpoints> =
            places.map(|place| Viewpoints::of(views, place)).filter(|seen| seen.n_views > 1).collect();
        let n_one_place = seen.iter().filter(|seen| seen.lack_baseline()).count();
        if 2 * n_one_place > seen.len() {
            return Err(DtmError::NoBaseline { n_seen: seen.len(), n_one_place });
        }
        let (low_m, high_m) = rough.range().unwrap_or((f64::NAN, f64::NAN));
        return Err(DtmError::TooLittle {
            n_squares: squares.len(),
            n_unseen: count(|o| matches!(o, SquareOutcome::Unseen)),
            n_unclear: count(|o| matches!(o, SquareOutcome::Unclear)),
            n_ground,
            from_m: low_m - config.within_m,
            to_m: high_m + config.within_m,
        });
    }
    let dem = surface::model(&squares, rough, area, config)?;
    let squares = squares.into_iter().map(|s| s.raised(rough_m(s.at))).collect();
    Ok(Dtm { dem, squares, sigma_m })
}

/// Error of a terrain by the photos, in squares of open ground of an area: those with [`SquareOutcome::Ground`] hold by how
/// much the ground lies above it, metres. Also their spread around their neighbours', metres. The squares lie where they do
/// whatever the area, so that areas side by side find what their union does, but for what neighbours say along the seam.
///
/// # Errors
/// [`DtmError`].
pub fn off_by(
    views: &[View],
    footprints: &[&Polygon<f64>],
    rough: &Terrain,
    area: MapBox,
    config: &DtmConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<(Vec<GroundSquare>, f64), DtmError> {
    check(config)?;
    let with_photo: Vec<&View> = views.iter().filter(|view| view.image.is_some()).collect();
    let cameras: Vec<PosedCamera> = with_photo.iter().map(|view| view.posed()).collect();
    let places: Vec<DVec3> = places(area, footprints, config)
        .into_iter()
        .filter_map(|at| Some(at.extend(rough.height_at(at.x, at.y)?)))
        .collect();
    let album = Album::new(LONG_SIDE_PX, PICTURE_BYTES);
    let n_done = std::sync::atomic::AtomicUsize::new(0);
    // A square with its position among the places, searched around a level above the rough terrain.
    let look = |i: usize, level_m: f64, within_m: f64| {
        let near = places[i] + level_m * DVec3::Z;
        let chosen = choose(&cameras, near, N_VIEWS, FLATTEST, |_| true);
        let seen_in: Vec<_> = chosen.iter().map(|&view| album.picture(with_photo[view])).collect::<Result<_, _>>()?;
        let seen_in: Vec<&Picture> = seen_in.iter().map(|picture: &Arc<Picture>| &**picture).collect();
        let outcome = patch::height(&seen_in, near, within_m);
        let square = GroundSquare { at: near.truncate(), outcome };
        Ok((i, square.raised(-places[i].z)))
    };
    let look_at_all = |wanted: &[(usize, f64)], within_m: f64, squares: &mut [GroundSquare], counts: bool| {
        for together in wanted.chunks(N_TOGETHER) {
            let looked: Vec<(usize, GroundSquare)> = together
                .par_iter()
                .map(|&(i, level_m)| look(i, level_m, within_m))
                .inspect(|_| {
                    if counts {
                        progress(n_done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, places.len());
                    }
                })
                .collect::<Result<_, PriorError>>()?;
            looked.into_iter().for_each(|(i, square)| squares[i] = square);
        }
        Ok::<(), DtmError>(())
    };
    let order = by_block(&places);
    let unseen = |at: &DVec3| GroundSquare { at: at.truncate(), outcome: SquareOutcome::Unseen };
    let mut squares: Vec<GroundSquare> = places.iter().map(unseen).collect();
    let all: Vec<(usize, f64)> = order.iter().map(|&i| (i, 0.0)).collect();
    look_at_all(&all, config.within_m, &mut squares, true)?;
    let mut trend = GroundTrend::of(&squares, config.spacing_m);
    for _ in 0..MAX_ROUNDS {
        // Ground beyond the range that was searched, or not clear within it, lies near the trend.
        let is_unclear = |i: &&usize| squares[**i].outcome == SquareOutcome::Unclear;
        let unclear = order.iter().filter(is_unclear);
        let again: Vec<(usize, f64)> = unclear.filter_map(|&i| Some((i, trend.at(squares[i].at)?))).collect();
        look_at_all(&again, NEAR_TREND_M, &mut squares, false)?;
        let n_new = again.iter().filter(|(i, _)| squares[*i].height_m().is_some()).count();
        trend = GroundTrend::of(&squares, config.spacing_m);
        if n_new * FEW_SHARE < squares.len() {
            break;
        }
    }
    let sigma_m = surface::leave_out_what_stands_above(&mut squares, &trend, config.spacing_m);
    Ok((squares, sigma_m))
}

/// Places in an order in which neighbours are together.
fn by_block(places: &[DVec3]) -> Vec<usize> {
    let block = |at: &DVec3| ((at.y / BLOCK_M).floor() as i64, (at.x / BLOCK_M).floor() as i64);
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&i| block(&places[i]));
    order
}

fn check(config: &DtmConfig) -> Result<(), DtmError> {
    let above_0 = [("within_m", config.within_m), ("spacing_m", config.spacing_m), ("cell_m", config.cell_m)];
    match above_0.into_iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
        None => Ok(()),
        Some((field, value)) => Err(DtmError::Config { field, value, expected: "above 0" }),
    }
}

/// Middles of squares that keep clear of all footprints, on a grid that depends on nothing but the spacing.
fn places(area: MapBox, footprints: &[&Polygon<f64>], config: &DtmConfig) -> Vec<DVec2> {
    let boxes = footprints.iter().enumerate().filter_map(|(i, footprint)| {
        let rect = footprint.bounding_rect()?;
        let rectangle = Rectangle::from_corners([rect.min().x, rect.min().y], [rect.max().x, rect.max().y]);
        Some(GeomWithData::new(rectangle, i))
    });
    let tree: RTree<GeomWithData<Rectangle<[f64; 2]>, usize>> = RTree::bulk_load(boxes.collect());
    let reach_m = PATCH_M * std::f64::consts::FRAC_1_SQRT_2 + CLEAR_M;
    let is_open = |at: &DVec2| {
        let mut close = tree.locate_within_distance([at.x, at.y], reach_m * reach_m);
        !close.any(|near| Euclidean.distance(footprints[near.data], &Point::new(at.x, at.y)) < reach_m)
    };
    let steps = |from: f64, to: f64| {
        let (first, last) = ((from / config.spacing_m).ceil() as i64, (to / config.spacing_m).floor() as i64);
        (first..=last).map(|i| i as f64 * config.spacing_m)
    };
    steps(area.south_m, area.north_m)
        .flat_map(|y| steps(area.west_m, area.east_m).map(move |x| DVec2::new(x, y)))
        .filter(is_open)
        .collect()
}
