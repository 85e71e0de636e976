//! A photo with its camera and pose, and what it is for.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use sizeup_heights::camera::Camera;
use sizeup_heights::frames::{Cam, Map, Rigid};
use sizeup_heights::ids::ViewId;
use sizeup_heights::picture::PosedCamera;
pub use sizeup_heights::views::ViewKind;

/// A photo with a pose.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct View {
    /// The photo's name as the survey has it, unique in the survey.
    pub id: ViewId,
    /// Intrinsics, shared between the photos of one camera.
    pub camera: Arc<Camera>,
    /// Pose in the project's projected CRS and vertical reference.
    pub camera_from_map: Rigid<Cam, Map>,
    /// The photo's file, where it is known and exists.
    pub image: Option<PathBuf>,
}

impl View {
    /// The projection centre in the map frame.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        self.camera_from_map.centre()
    }

    /// The optical axis in the map frame, unit length.
    #[must_use]
    pub fn axis_in_map(&self) -> DVec3 {
        self.camera_from_map.axis_in_map()
    }

    /// Angle between the optical axis and the downward vertical, radians.
    #[must_use]
    pub fn off_nadir_rad(&self) -> f64 {
        self.camera_from_map.off_nadir_rad()
    }

    /// The same angle in degrees, for files and messages.
    #[must_use]
    pub fn off_nadir_deg(&self) -> f64 {
        self.off_nadir_rad().to_degrees()
    }

    /// Where the photo shows a place of the map, pixels; `None` where it does not.
    #[must_use]
    pub fn pixel_of(&self, place: DVec3) -> Option<DVec2> {
        self.camera.pixel_of(&self.camera_from_map, place)
    }

    /// Camera and pose.
    #[must_use]
    pub fn posed(&self) -> PosedCamera {
        PosedCamera { camera: (*self.camera).clone(), camera_from_map: self.camera_from_map }
    }

    /// Nadir, oblique or upward.
    #[must_use]
    pub fn kind(&self) -> ViewKind {
        ViewKind::of(self.off_nadir_rad())
    }
}
