//! What a reader hands over: poses in the file's own world, conventions already converted.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::angles::North;
use super::heights::FileUnits;
use super::names::NameStyle;
use sizeup_geo::crs::Crs;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::camera::Camera;

/// The world a file's poses live in.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum World {
    /// The file does not say: the configuration's CRS, else the project's.
    Unsaid,
    /// The file says it in a way that cannot be followed, and why: the configuration's CRS, or none.
    Unclear(String),
    /// A CRS the file names. Rotations refer to its grid; where it is geographic, to the local east, north, up; where
    /// it is geocentric, to its axes.
    Crs(Crs),
    /// East, north, up at longitude, latitude (degrees) and ellipsoidal height (metres) on WGS 84.
    Enu(DVec3),
}

/// Heights as a file describes them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FileHeights {
    /// Nothing: the project's reference unless declared.
    Unsaid,
    /// Heights above the ellipsoid.
    Ellipsoidal,
    /// Barometric or of unknown reference: must be declared.
    Unreliable,
}

/// One pose in the file's world.
#[derive(Debug, Clone)]
pub(crate) struct Pose {
    /// Name of the photo: as the file writes it while it is read, then what [`super::names`] makes of that.
    pub name: String,
    /// Camera of the photo, shared by all photos of it.
    pub camera: Arc<Camera>,
    /// From the world's axes to ours (x right, y down, z forward).
    pub camera_from_world: DMat3,
    /// Projection centre in the world, in its units.
    pub centre: DVec3,
}

/// All poses of a file.
#[derive(Debug, Clone)]
pub(crate) struct Poses {
    /// Frame of the poses.
    pub world: World,
    /// Which north the rotations count from.
    pub north: North,
    /// Kind of its heights.
    pub heights: FileHeights,
    /// How the format names photos.
    pub names: NameStyle,
    /// Names as the file writes them, by those that the photos have, where the two differ.
    pub written: BTreeMap<String, String>,
    /// Units of its positions.
    pub units: FileUnits,
    /// Poses in the file's order.
    pub poses: Vec<Pose>,
    /// Poses that the reader refused.
    pub issues: Vec<Issue>,
    /// Origin of the focal lengths, and the positioning quality, counted by name.
    pub counts: PropertyCounts,
}

/// Number of photos with each property, by name.
#[derive(Debug, Clone, Default)]
pub(crate) struct PropertyCounts {
    /// Source of the focal length.
    pub focal: BTreeMap<String, usize>,
    /// State of the satellite positioning.
    pub rtk: BTreeMap<String, usize>,
}

impl Poses {
    /// None yet, in a world the file does not name, over grid north.
    pub(crate) fn new() -> Self {
        Self {
            counts: PropertyCounts::default(),
            names: NameStyle::default(),
            written: BTreeMap::new(),
            world: World::Unsaid,
            north: North::Grid,
            heights: FileHeights::Unsaid,
            units: FileUnits::default(),
            poses: Vec::new(),
            issues: Vec::new(),
        }
    }

    /// The same world without its poses and issues.
    pub(crate) fn clone_empty(&self) -> Self {
        Self { world: self.world.clone(), north: self.north, heights: self.heights, units: self.units, ..Self::new() }
    }

    /// Records that a pose cannot be used.
    pub(crate) fn refuse(&mut self, code: &str, name: &str, message: impl Into<String>) {
        self.issues.push(refused(code, name, message));
    }
}

/// An issue of a view that cannot be used.
pub(crate) fn refused(code: &str, name: &str, message: impl Into<String>) -> Issue {
    Issue::new(Severity::Refused, code, Subject::View(name.to_owned()), message)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A pose of a name, somewhere.
    pub(crate) fn pose(name: &str) -> Pose {
        let camera = Arc::new(Camera::pinhole(400, 300, 500.0));
        Pose { name: name.to_owned(), camera, camera_from_world: DMat3::IDENTITY, centre: DVec3::ZERO }
    }
}
