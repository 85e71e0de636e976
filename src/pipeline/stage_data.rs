//! Results of the footprint stage and of the height stage.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::PhotoGround;
use sizeup_footprints::{DetectionSummary, FootprintLayer, Tracks};
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::GroundLevel;
use sizeup_heights::estimate::{Part, Split};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::ids::BuildingId;
use sizeup_heights::optimise::{LayerShift, LevelGain, LevelOff, Solution};

/// Footprints with their ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FootprintStage {
    /// The layer; footprints in its order.
    pub layer: FootprintLayer,
    /// Ground under each footprint of the layer; `None` where the terrain has none.
    pub ground: Vec<Option<GroundLevel>>,
    /// Issues of the ground.
    pub issues: Vec<Issue>,
    /// Roof contours as the photos show them, which move with the heights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracks: Option<Tracks>,
    /// Counts of what was found in photos; `None` for a layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detection: Option<DetectionSummary>,
    /// Buildings whose footprints were split, and why; filled while heights are found.
    #[serde(skip)]
    pub levels: Vec<(BuildingId, LevelGain)>,
    /// Terrain by the photos, which `ground` and the scene are corrected by; filled before heights are found, and kept with them.
    #[serde(skip)]
    pub photo_ground: PhotoGround,
}

impl FootprintStage {
    /// Stage of footprints that were not found in photos.
    #[must_use]
    pub fn of_layer(layer: FootprintLayer, ground: Vec<Option<GroundLevel>>, issues: Vec<Issue>) -> Self {
        Self {
            layer,
            ground,
            issues,
            tracks: None,
            detection: None,
            levels: Vec::new(),
            photo_ground: PhotoGround::default(),
        }
    }
}

/// Heights of the buildings whose ground is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeightStage {
    /// Where the local frame of the solution's roofs lies in the map.
    pub origin: LocalOrigin,
    /// Position in the layer of each building that was solved.
    pub solved: Vec<usize>,
    /// Buildings and parts of buildings, in the order of `solved`; their `building` counts the footprints with a ground, unsplit.
    pub parts: Vec<Part>,
    /// Footprints that were split, and why.
    #[serde(default)]
    pub splits: Vec<Split>,
    /// Footprints that were split and joined again, because the heights of their parts did not differ.
    #[serde(default)]
    pub joined: Vec<(usize, Vec<usize>)>,
    /// The solution, one height per building of `solved`; its views are positions in the survey.
    pub solution: Solution,
    /// Views whose photo could not be read where roofs were settled by photos, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unread_photos: Vec<(usize, String)>,
    /// Doubt of the ground about the priors' declared direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubt: Option<Issue>,
    /// Shift of the footprint layer against the photos: these were moved onto it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layer_shift: Option<LayerShift>,
    /// Terrain by the photos.
    #[serde(default)]
    pub ground: PhotoGround,
}

impl HeightStage {
    /// Without a single building.
    pub(super) fn empty() -> Self {
        Self {
            origin: LocalOrigin(DVec3::ZERO),
            solved: Vec::new(),
            parts: Vec::new(),
            splits: Vec::new(),
            joined: Vec::new(),
            solution: Solution::default(),
            unread_photos: Vec::new(),
            doubt: None,
            ground: PhotoGround::default(),
            layer_shift: None,
        }
    }

    /// Error of the terrain's level by depth alone, where no photo shows the ground: it is not corrected.
    pub(super) fn level_off(&self) -> Option<LevelOff> {
        self.solution.level_off.filter(|_| self.ground.off_m.is_empty())
    }

    /// How far the photos were moved onto the footprints, map frame, metres.
    pub(super) fn moved_m(&self) -> DVec3 {
        self.layer_shift.map_or(DVec3::ZERO, |shift| shift.on_ground())
    }
}
