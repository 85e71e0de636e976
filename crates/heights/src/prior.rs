//! Depth prior: a map of one view whose *ordering* is trusted, not its scale (`SiZeUp`, "Depth prior").
//!
//! What a number means is declared, never guessed: [`PriorKind`] and [`PriorGeometry`] come from the configuration.
//!
//! | | values | far away is | disparity `1/d` | farness |
//! |---|---|---|---|---|
//! | [`PriorKind::Depth`] | `d > 0`, up to scale | high | `1/d` | `d` |
//! | [`PriorKind::InverseDepth`] | `a/d + b`, `a > 0` | low | the value | minus the value |

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::raster::Raster;

/// Meaning of a prior's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PriorKind {
    /// Depth up to scale: higher is farther (Depth Anything 3, `Metric3D`, MoGe).
    Depth,
    /// Inverse depth (disparity) up to scale and shift: higher is nearer (Depth Anything 2, MiDaS).
    #[serde(alias = "inverse-depth")]
    InverseDepth,
}

/// Along which line a prior measures depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PriorGeometry {
    /// Along the optical axis, as nearly all networks do.
    #[default]
    ZDepth,
    /// Along each pixel's ray, as laser scanners do.
    Range,
}

/// The prior of one view: of any size, same aspect as the photo.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthPrior {
    /// `H × W`, row-major; `NaN` = no value (sky, holes).
    pub values: Raster<f32>,
    /// Meaning of the numbers.
    pub kind: PriorKind,
    /// Along which line they are measured.
    pub geometry: PriorGeometry,
}

impl DepthPrior {
    /// Bilinear value at a position in the photo, given in pixels of an image `width_px × height_px` of it: the
    /// camera's own size or any other it was resized to. `NaN` outside, and beside missing values.
    #[must_use]
    pub fn value_at(&self, camera: &Camera, pixel: DVec2) -> f32 {
        let x = pixel.x * self.values.width() as f64 / f64::from(camera.width_px);
        let y = pixel.y * self.values.height() as f64 / f64::from(camera.height_px);
        self.values.bilinear(x, y)
    }

    /// A value of the prior as a number that grows away from the camera: depth itself, or minus inverse depth.
    #[must_use]
    pub fn farness(&self, value: f32) -> f32 {
        match self.kind {
            PriorKind::Depth => value,
            PriorKind::InverseDepth => -value,
        }
    }

    /// A value of the prior as inverse depth: `1/d` for depth (`NaN` at `d ≤ 0`), itself for inverse depth.
    #[must_use]
    pub fn disparity(&self, value: f32) -> f32 {
        match self.kind {
            PriorKind::Depth if value > 0.0 => 1.0 / value,
            PriorKind::Depth => f32::NAN,
            PriorKind::InverseDepth => value,
        }
    }

    /// All of it as [`Self::farness`], `H × W`, `NaN` = no value.
    #[must_use]
    pub fn to_farness(&self) -> Raster<f32> {
        self.values.map(|v| self.farness(*v))
    }

    /// All of it as [`Self::disparity`], `H × W`, `NaN` = no value.
    #[must_use]
    pub fn to_disparity(&self) -> Raster<f32> {
        self.values.map(|v| self.disparity(*v))
    }

    /// The same prior along the optical axis. With a pixel's ray `(x, y, 1)` of length `l`, `z = range / l`, and
    /// inverse depth grows by `l` (exact where it has no shift). `camera` is the photo's, of any size.
    #[must_use]
    pub fn to_z_depth(&self, camera: &Camera) -> Self {
        if self.geometry == PriorGeometry::ZDepth {
            return self.clone();
        }
        let camera = camera.resized(self.values.width() as u32, self.values.height() as u32);
        let mut values = self.values.clone();
        let width = values.width();
        for (i, value) in values.data_mut().iter_mut().enumerate() {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let length = camera.unproject(pixel).map_or(f32::NAN, |ray| ray.length() as f32);
            match self.kind {
                PriorKind::Depth => *value /= length,
                PriorKind::InverseDepth => *value *= length,
            }
        }
        Self { values, kind: self.kind, geometry: PriorGeometry::ZDepth }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prior(values: Vec<f32>, kind: PriorKind, geometry: PriorGeometry) -> DepthPrior {
        DepthPrior { values: Raster::from_vec(3, 1, values).unwrap(), kind, geometry }
    }

    #[test]
    fn farness_grows_and_disparity_falls_away_from_the_camera_for_both_kinds() {
        let depth = prior(vec![1.0, 2.0, 4.0], PriorKind::Depth, PriorGeometry::ZDepth);
        let inverse = prior(vec![1.0, 0.5, 0.25], PriorKind::InverseDepth, PriorGeometry::ZDepth);
        for prior in [&depth, &inverse] {
            assert!(prior.to_farness().data().is_sorted());
            assert_eq!(prior.to_disparity().data(), [1.0, 0.5, 0.25]);
        }
        assert!(depth.disparity(0.0).is_nan());
    }

    #[test]
    fn a_wall_across_the_view_has_one_z_depth() {
        // Range to the plane z = 10 grows towards the border: 10·|ray|.
        let camera = Camera::pinhole(3, 1, 1.5);
        let ranges: Vec<f32> =
            [0.5, 1.5, 2.5].iter().map(|x| 10.0 * (((x - 1.5_f32) / 1.5).powi(2) + 1.0).sqrt()).collect();
        let z = prior(ranges, PriorKind::Depth, PriorGeometry::Range).to_z_depth(&camera.resized(300, 100));
        assert!(z.values.data().iter().all(|d| (d - 10.0).abs() < 1e-5), "{z:?}");
        assert_eq!(z.geometry, PriorGeometry::ZDepth);
    }

    #[test]
    fn sampling_follows_the_image_whatever_its_size() {
        let depth = prior(vec![1.0, 2.0, 4.0], PriorKind::Depth, PriorGeometry::ZDepth);
        let photo = Camera::pinhole(600, 200, 500.0);
        assert_eq!(depth.value_at(&photo, DVec2::new(300.0, 100.0)), 2.0);
        assert_eq!(depth.value_at(&photo.resized(60, 20), DVec2::new(30.0, 10.0)), 2.0);
        assert!(depth.value_at(&photo, DVec2::new(601.0, 100.0)).is_nan());
    }
}
