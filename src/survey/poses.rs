//! What a reader hands over: poses in the file's own world, conventions already converted.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::angles::North;
use crate::camera::Camera;
use crate::crs::Crs;
use crate::issue::{Issue, Severity, Subject};

/// The world a file's poses live in.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum World {
    /// The file does not say: the configuration's CRS, else the project's.
    Unsaid,
    /// A CRS the file names. Rotations refer to its grid; where it is geographic, to the local east, north, up; where
    /// it is geocentric, to its axes.
    Crs(Crs),
}

/// One pose in the file's world.
#[derive(Debug, Clone)]
pub(crate) struct Pose {
    /// The photo's name.
    pub name: String,
    /// Its camera, shared.
    pub camera: Arc<Camera>,
    /// From the world's axes to ours (x right, y down, z forward).
    pub camera_from_world: DMat3,
    /// Projection centre in the world, in its units.
    pub centre: DVec3,
}

/// All poses of a file.
#[derive(Debug, Clone)]
pub(crate) struct Poses {
    /// Where they live.
    pub world: World,
    /// Which north the rotations count from.
    pub north: North,
    /// In the file's order.
    pub poses: Vec<Pose>,
    /// What the reader refused.
    pub issues: Vec<Issue>,
}

impl Poses {
    /// None yet, in a world the file does not name, over grid north.
    pub(crate) fn new() -> Self {
        Self { world: World::Unsaid, north: North::Grid, poses: Vec::new(), issues: Vec::new() }
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
