//! Roofs with a form as the rays of other buildings meet them.

use glam::Vec2;

use crate::render::profile::RoofSurface;
use crate::roofs::Roof;
use crate::roofs::planes::RoofPlanes;
use crate::scene::{Prism, RoofForm};

/// A roof that is no level, over its building's ground.
pub(crate) struct FormedRoof {
    planes: RoofPlanes,
    ground_z: f32,
    /// Level beside all planes, above the ground, metres.
    beside_m: f64,
    /// Highest and lowest level above the ground, metres.
    range_m: [f64; 2],
}

impl FormedRoof {
    /// A building's roof; `None` where it is flat, or no planes describe it.
    pub fn of(prism: &Prism, roof: Option<Roof>) -> Option<Self> {
        let roof = roof.filter(|roof| roof.form != RoofForm::Flat)?;
        let planes = RoofPlanes::of(&roof, prism)?;
        let range_m = [roof.eave_m.max(roof.ridge_m), roof.eave_m.min(roof.ridge_m)];
        Some(Self { planes, ground_z: prism.ground_z, beside_m: roof.eave_m, range_m })
    }
}

impl RoofSurface for FormedRoof {
    fn level(&self, at: Vec2) -> f32 {
        self.ground_z + self.planes.height_m(at.as_dvec2()).unwrap_or(self.beside_m) as f32
    }

    fn range_z(&self) -> [f32; 2] {
        self.range_m.map(|level_m| self.ground_z + level_m as f32)
    }
}
