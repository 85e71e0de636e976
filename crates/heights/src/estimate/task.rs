//! Input and output of the method.

use std::sync::Arc;

use geo_types::{Coord, Polygon};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::frames::LocalOrigin;
use crate::optimise::{LayerShift, LevelGain, OptimiseConfig, Preset, SearchConfig, Solution, SolvedHeight, Solving};
use crate::photo_consistency::RefinementConfig;
use crate::picture::{Picture, PosedCamera};
use crate::prior::DepthPrior;
use crate::raster::Raster;
use crate::scene::HeightBounds;
use crate::terrain::{GroundLevel, Terrain};
use crate::views::ViewKind;

/// A building whose height is wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct Building {
    /// Footprint in the map frame, metres.
    pub footprint: Polygon<f64>,
    /// Ground level under it, metres in the vertical datum of the map frame.
    pub ground: GroundLevel,
}

/// A photo by its name, camera and pose.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCamera {
    /// Name, unique among the photos: random choices about a photo depend on it, never on its place in the list.
    pub name: String,
    /// Intrinsics at the photo's own size, and pose.
    pub posed: PosedCamera,
}

impl NamedCamera {
    /// Nadir, oblique or upward.
    #[must_use]
    pub fn kind(&self) -> ViewKind {
        ViewKind::of(self.posed.camera_from_map.off_nadir_rad())
    }
}

/// Depth priors of the photos, by their positions in [`Task::views`].
pub trait Priors: Sync {
    /// Loads the prior of a photo, along the optical axis; the error says why there is none.
    ///
    /// # Errors
    /// Why the photo has no prior.
    fn load(&self, view: usize) -> Result<DepthPrior, String>;

    /// Why a photo is known to have no prior before anything is loaded or computed.
    fn absence(&self, _view: usize) -> Option<String> {
        None
    }

    /// Pixels of the photo that are as green as leaves, at any size; `None` where that is unknown.
    fn green(&self, _view: usize) -> Option<Arc<Raster<bool>>> {
        None
    }
}

/// The photos themselves, by their positions in [`Task::views`].
pub trait Photos: Sync {
    /// Whether there is a photo.
    fn has(&self, view: usize) -> bool;

    /// The photo, reduced for comparison with others.
    ///
    /// # Errors
    /// Why it cannot be read.
    fn picture(&self, view: usize) -> Result<Arc<Picture>, String>;
}

/// Local frame and range of heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    /// Origin of the local frame in the map.
    pub origin: LocalOrigin,
    /// Heights that a building can have.
    pub bounds: HeightBounds,
}

/// The local frame lies on multiples of this, metres: one more house at the rim of a town does not move it. Small enough for single
/// precision to resolve a tenth of a millimetre at a kilometre.
const ORIGIN_STEP_M: DVec3 = DVec3::new(1000.0, 1000.0, 100.0);

impl LocalFrame {
    /// Origin in the middle of a box (west, south, east, north, metres) at the height of the lowest photo, in round numbers.
    #[must_use]
    pub fn origin(cameras: impl Iterator<Item = DVec3>, [west, south, east, north]: [f64; 4]) -> LocalOrigin {
        let lowest_m = cameras.map(|centre| centre.z).reduce(f64::min).unwrap_or(0.0);
        let middle = DVec3::new(f64::midpoint(west, east), f64::midpoint(south, north), lowest_m);
        LocalOrigin((middle / ORIGIN_STEP_M).round() * ORIGIN_STEP_M)
    }
}

/// Input of the method.
pub struct Task<'a> {
    /// Buildings on their ground.
    pub buildings: &'a [Building],
    /// Ground around them.
    pub terrain: &'a Terrain,
    /// Local frame, and the range of heights.
    pub frame: LocalFrame,
    /// Every photo of the survey.
    pub views: &'a [NamedCamera],
    /// Their depth priors.
    pub priors: &'a dyn Priors,
    /// The photos themselves, where they refine roofs.
    pub photos: Option<&'a dyn Photos>,
    /// Root of every random choice.
    pub seed: u64,
    /// Progress callback: kind of work, items done, items in total.
    pub progress: &'a (dyn Fn(Solving, usize, usize) + Sync),
}

/// Settings of the method.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MethodSettings {
    /// Solver: preset and constants.
    pub optimise: OptimiseConfig,
    /// Refinement of roofs by the photos.
    pub refinement: RefinementConfig,
}

impl MethodSettings {
    /// Whether photos, where there are any, refine roofs.
    #[must_use]
    pub fn refines_roofs(&self) -> bool {
        self.refinement.enabled.unwrap_or(self.optimise.preset != Preset::Paper)
    }

    /// The same with other settings of the search.
    #[must_use]
    pub(super) fn search(&self, change: impl FnOnce(&mut SearchConfig)) -> OptimiseConfig {
        let mut optimise = self.optimise.clone();
        change(&mut optimise.search);
        optimise
    }
}

/// A building, or a part of one at a roof level of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Position of the building in [`Task::buildings`].
    pub building: usize,
    /// Place among its parts: empty for a whole building, `[2]` for the second part, `[2, 1]` for the first part of that.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub path: Vec<usize>,
    /// Footprint in the map frame, metres.
    pub footprint: Polygon<f64>,
    /// Ground level of the building.
    pub ground: GroundLevel,
}

impl Part {
    /// Whether it is a part of `other`, or that itself.
    pub(super) fn is_within(&self, (building, path): (usize, &[usize])) -> bool {
        self.building == building && self.path.starts_with(path)
    }
}

/// Evidence that a footprint holds roofs at several levels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LevelEvidence {
    /// Depth priors: two levels explain them better than one.
    Priors(LevelGain),
    /// Photos, which look alike on roofs at these heights above the ground, metres, and less so on one roof.
    Photos(Vec<f64>),
}

/// A footprint that was split because its roofs stand at several levels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Split {
    /// Position of the building in [`Task::buildings`].
    pub building: usize,
    /// The part that was split; empty for the whole building.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub path: Vec<usize>,
    /// Number of parts that it was split into.
    pub n_parts: usize,
    /// Evidence for it.
    pub evidence: LevelEvidence,
}

/// Result of the method.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Heights {
    /// The buildings, whole or in parts, in the order of the input.
    pub parts: Vec<Part>,
    /// One height per part; views are positions in [`Task::views`].
    pub solution: Solution,
    /// Footprints that were split.
    #[serde(default)]
    pub splits: Vec<Split>,
    /// Footprints that were split and joined again, because the heights of their parts did not differ: building and path.
    #[serde(default)]
    pub joined: Vec<(usize, Vec<usize>)>,
    /// Shift of the footprint layer against the photos; heights were measured with the photos moved onto it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layer_shift: Option<LayerShift>,
    /// Photos that could not be read for the refinement of roofs, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unread_photos: Vec<(usize, String)>,
}

impl Heights {
    /// Offset that the photos were moved by onto the footprints, map frame, metres.
    #[must_use]
    pub fn moved_m(&self) -> DVec3 {
        self.layer_shift.map_or(DVec3::ZERO, |shift| shift.on_ground())
    }

    /// The parts of a building with their heights.
    pub fn of_building(&self, building: usize) -> impl Iterator<Item = (&Part, &SolvedHeight)> {
        self.parts.iter().zip(&self.solution.heights).filter(move |(part, _)| part.building == building)
    }
}

/// Box around footprints: west, south, east, north, metres; `None` without any.
pub(super) fn extent<'a>(footprints: impl Iterator<Item = &'a Polygon<f64>>) -> Option<[f64; 4]> {
    let corners = footprints.flat_map(|footprint| &footprint.exterior().0);
    corners.fold(None, |extent, &Coord { x, y }| {
        let [west, south, east, north] = extent.unwrap_or([x, y, x, y]);
        Some([west.min(x), south.min(y), east.max(x), north.max(y)])
    })
}
