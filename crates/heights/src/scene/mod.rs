//! The scene: footprints on the ground, extruded to one unknown height each.
//!
//! Frame: [`Local`](crate::frames::Local), metres, `f32` (a millimetre within 8 km of the origin).

mod ground;
mod prism;
mod range;

pub use ground::LocalGround;
pub use prism::{Prism, RayInterval};
pub use range::{HeightBounds, HeightsConfig};

use geo_types::Polygon;
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frames::LocalOrigin;
use crate::terrain::{GroundLevel, Terrain};

/// Which height of a pitched roof the stated height is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeightReference {
    /// Where the roof meets the walls; the lower level of a stepped roof.
    Eave,
    /// The mean height of the roof over its area.
    #[default]
    Mean,
    /// The highest line of the roof; the upper level of a stepped one.
    Ridge,
}

impl HeightReference {
    /// The name in files: `eave`, `mean` or `ridge`.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Eave => "eave",
            Self::Mean => "mean",
            Self::Ridge => "ridge",
        }
    }
}

/// The form of a roof.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RoofForm {
    /// One level; also where the photos support no other form.
    Flat,
    /// Two slopes that meet in a ridge.
    Gable,
    /// Slopes up from every wall.
    Hip,
    /// Two flat levels: a penthouse, a terrace, a lower annex.
    Stepped,
}

impl RoofForm {
    /// The name in files: `flat`, `gable`, `hip` or `stepped`.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Flat => "flat",
            Self::Gable => "gable",
            Self::Hip => "hip",
            Self::Stepped => "stepped",
        }
    }
}

/// Prisms of unknown height on known ground.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Origin of the local frame in the map.
    pub origin: LocalOrigin,
    /// One per building, in the order of the footprints.
    pub prisms: Vec<Prism>,
    /// Heights of the ground, local frame.
    pub ground: LocalGround,
    /// The range of heights of every building.
    pub bounds: HeightBounds,
}

impl Scene {
    /// Builds the scene around the middle of the footprints.
    ///
    /// `terrain` is cut to the footprints' bounding box grown by `margin_m`, which should cover what the views see.
    #[must_use]
    pub fn new(
        footprints: &[(&Polygon<f64>, GroundLevel)],
        terrain: &Terrain,
        bounds: HeightBounds,
        margin_m: f64,
    ) -> Self {
        let (low, high) = corners(footprints);
        let centre = if low.is_finite() { (0.5 * (low + high)).floor() } else { DVec3::ZERO };
        Self::at(LocalOrigin(centre), footprints, terrain, bounds, margin_m)
    }

    /// As [`Self::new`], around an origin that is given: the parts of a city share one, so that a building has the same
    /// local coordinates in all of them.
    #[must_use]
    pub fn at(
        origin: LocalOrigin,
        footprints: &[(&Polygon<f64>, GroundLevel)],
        terrain: &Terrain,
        bounds: HeightBounds,
        margin_m: f64,
    ) -> Self {
        let (low, high) = corners(footprints);
        let prisms = footprints.iter().map(|(polygon, ground)| Prism::new(polygon, *ground, origin)).collect();
        let ground = LocalGround::new(terrain, origin, low.truncate() - margin_m, high.truncate() + margin_m);
        Self { origin, prisms, ground, bounds }
    }

    /// Roof levels in the local frame for heights above ground, both metres, one per building.
    #[must_use]
    pub fn roofs(&self, heights_m: &[f32]) -> Vec<f32> {
        self.prisms.iter().zip(heights_m).map(|(prism, height_m)| prism.ground_z + height_m).collect()
    }
}

/// Low and high corner of the box around all footprints with their ground.
fn corners(footprints: &[(&Polygon<f64>, GroundLevel)]) -> (DVec3, DVec3) {
    let of_one = |(polygon, ground): &(&Polygon<f64>, GroundLevel)| {
        let z_m = ground.reference_m;
        polygon.exterior().coords().map(move |c| DVec3::new(c.x, c.y, z_m)).collect::<Vec<_>>()
    };
    let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    footprints.iter().flat_map(of_one).fold(start, |(low, high), p| (low.min(p), high.max(p)))
}
