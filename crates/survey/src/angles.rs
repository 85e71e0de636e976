//! Rotation conventions: from the numbers a tool writes to `camera_from_world` in our axes.
//!
//! World: east, north, up. Camera: x right, y down, z forward (OpenCV). With the elementary rotations `Rx`, `Ry`, `Rz`
//! (right-handed, active) and angles ω about x, φ about y, κ about z:
//!
//! ```text
//! opk: world_from_camera = Rx(ω) Ry(φ) Rz(κ)      camera x right, y up, z backward  (Pix4D, Metashape, Inpho)
//! pok: world_from_camera = Ry(φ) Rx(ω) Rz(κ)
//! ypr: ned_from_body     = Rz(ψ) Ry(θ) Rx(ρ)      body x forward (the optical axis), y right, z down  (DJI gimbal)
//! ```
//!
//! Sequence, direction and camera axes can each be declared otherwise. Source of the golden vectors: computed once
//! from these definitions and cross-checked against `OpenSfM`'s and Bentley's own code.

use glam::{DMat3, DQuat, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kind of the rotation columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AngleKind {
    /// Omega, phi, kappa: rotations about x, y, z in that sequence.
    #[default]
    Opk,
    /// The same three angles with phi first.
    Pok,
    /// Yaw, pitch, roll of an aircraft or gimbal: yaw clockwise from north, pitch up, roll right.
    Ypr,
    /// A Hamilton quaternion w, x, y, z.
    Quaternion,
    /// A 3 × 3 matrix, row-major.
    Matrix,
}

/// Unit of the angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AngleUnit {
    /// Degrees, 360 to the turn.
    #[default]
    Deg,
    /// Gon (grads), 400 to the turn.
    Gon,
    /// Radians, 2π to the turn.
    Rad,
}

/// Direction of the rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// The rotation turns camera axes into world axes.
    CameraToWorld,
    /// The rotation turns world axes into camera axes.
    WorldToCamera,
}

/// Order of the elementary rotations in the matrix product, left to right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sequence {
    /// The product `Rx Ry Rz`.
    Xyz,
    /// The product `Rx Rz Ry`.
    Xzy,
    /// The product `Ry Rx Rz`.
    Yxz,
    /// The product `Ry Rz Rx`.
    Yzx,
    /// The product `Rz Rx Ry`.
    Zxy,
    /// The product `Rz Ry Rx`.
    Zyx,
}

/// Where a camera's axes point, seen by someone who looks at the photo upright. Names as in `BlocksExchange`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraAxes {
    /// x right, y down, z forward (OpenCV, COLMAP, OpenSfM): ours.
    XRightYDown,
    /// x right, y up, z backward (photogrammetry).
    XRightYUp,
    /// x left, y down, z backward.
    XLeftYDown,
    /// x left, y up, z forward.
    XLeftYUp,
    /// x down, y right, z backward.
    XDownYRight,
    /// x down, y left, z forward.
    XDownYLeft,
    /// x up, y left, z backward.
    XUpYLeft,
    /// x up, y right, z forward.
    XUpYRight,
}

/// Which way the camera looks at pitch 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PitchZero {
    /// To the horizon; straight down is −90° (DJI).
    #[default]
    Horizon,
    /// Straight down; the horizon is +90° (the `geo.txt` of ODM).
    Nadir,
}

/// Which north the rotation counts from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum North {
    /// The grid of the poses' CRS (geographic CRSs: true north).
    #[default]
    Grid,
    /// True north, as a drone's compass and RTK heading count; grid convergence is applied.
    True,
}

/// A declared rotation convention.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AngleConvention {
    /// Meaning of the numbers.
    pub angles: AngleKind,
    /// Their unit, where they are angles.
    pub unit: AngleUnit,
    /// Order of the product; `None` is the kind's own (`xyz`, `yxz`, `zyx`).
    pub sequence: Option<Sequence>,
    /// Direction of the rotation; `None` is the kind's own (angles: camera to world; quaternion, matrix: world to camera).
    pub direction: Option<Direction>,
    /// Camera axes; `None` is the kind's own (opk, pok: y up; quaternion, matrix: y down). Not used by `ypr`.
    pub camera_axes: Option<CameraAxes>,
    /// Where pitch counts from, for `ypr`.
    pub pitch_zero: PitchZero,
}

/// Builds a matrix from its rows.
pub(crate) const fn rows(x: [f64; 3], y: [f64; 3], z: [f64; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&[[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]])
}

/// `enu_from_ned`, which is its own inverse.
const ENU_FROM_NED: DMat3 = rows([0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]);
/// `body_from_camera`: the optical axis is the body's x, image right its y, image down its z.
const BODY_FROM_CAMERA: DMat3 = rows([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);

impl CameraAxes {
    /// Turns a vector in these axes into ours.
    #[must_use]
    pub const fn camera_from_axes(self) -> DMat3 {
        match self {
            Self::XRightYDown => DMat3::IDENTITY,
            Self::XRightYUp => rows([1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]),
            Self::XLeftYDown => rows([-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
            Self::XLeftYUp => rows([-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]),
            Self::XDownYRight => rows([0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]),
            Self::XDownYLeft => rows([0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            Self::XUpYLeft => rows([0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]),
            Self::XUpYRight => rows([0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
        }
    }
}

impl AngleUnit {
    /// Radians of an angle in this unit.
    #[must_use]
    pub fn to_radians(self, angle: f64) -> f64 {
        match self {
            Self::Deg => angle.to_radians(),
            Self::Gon => (angle * 0.9).to_radians(),
            Self::Rad => angle,
        }
    }
}

impl Sequence {
    /// All six, in alphabetical order.
    pub const ALL: [Self; 6] = [Self::Xyz, Self::Xzy, Self::Yxz, Self::Yzx, Self::Zxy, Self::Zyx];

    /// The product of the rotations about x, y and z in this order.
    fn product(self, about_x_rad: f64, about_y_rad: f64, about_z_rad: f64) -> DMat3 {
        let x = DMat3::from_rotation_x(about_x_rad);
        let y = DMat3::from_rotation_y(about_y_rad);
        let z = DMat3::from_rotation_z(about_z_rad);
        match self {
            Self::Xyz => x * y * z,
            Self::Xzy => x * z * y,
            Self::Yxz => y * x * z,
            Self::Yzx => y * z * x,
            Self::Zxy => z * x * y,
            Self::Zyx => z * y * x,
        }
    }
}

impl AngleKind {
    /// How many numbers a rotation of this kind has.
    #[must_use]
    pub fn n_values(self) -> usize {
        match self {
            Self::Opk | Self::Pok | Self::Ypr => 3,
            Self::Quaternion => 4,
            Self::Matrix => 9,
        }
    }
}

impl AngleConvention {
    /// `camera_from_world` of one row of numbers, or why there is none. World: the axes the numbers refer to, as
    /// east, north, up.
    ///
    /// # Errors
    /// A sentence: a number that is not finite, a zero quaternion, a matrix that is no rotation.
    pub fn camera_from_world(&self, values: &[f64]) -> Result<DMat3, String> {
        if values.len() != self.angles.n_values() {
            return Err(format!("{} rotation values: expected {}", values.len(), self.angles.n_values()));
        }
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            return Err(format!("a rotation value is {value}: expected a finite number"));
        }
        let angle = |i: usize| self.unit.to_radians(values[i]);
        match self.angles {
            AngleKind::Opk | AngleKind::Pok => {
                let own = if self.angles == AngleKind::Opk { Sequence::Xyz } else { Sequence::Yxz };
                let product = self.sequence.unwrap_or(own).product(angle(0), angle(1), angle(2));
                Ok(self.oriented(product, Direction::CameraToWorld, CameraAxes::XRightYUp))
            }
            AngleKind::Ypr => {
                let turn = match self.pitch_zero {
                    PitchZero::Horizon => 0.0,
                    PitchZero::Nadir => -std::f64::consts::FRAC_PI_2,
                };
                let product = self.sequence.unwrap_or(Sequence::Zyx).product(angle(2), angle(1) + turn, angle(0));
                let ned_from_body = match self.direction.unwrap_or(Direction::CameraToWorld) {
                    Direction::CameraToWorld => product,
                    Direction::WorldToCamera => product.transpose(),
                };
                Ok((ENU_FROM_NED * ned_from_body * BODY_FROM_CAMERA).transpose())
            }
            AngleKind::Quaternion => {
                let quaternion = DQuat::from_xyzw(values[1], values[2], values[3], values[0]);
                if quaternion.length() < 1e-6 {
                    return Err("the quaternion is zero: expected unit length".to_owned());
                }
                let rotation = DMat3::from_quat(quaternion.normalize());
                Ok(self.oriented(rotation, Direction::WorldToCamera, CameraAxes::XRightYDown))
            }
            AngleKind::Matrix => {
                let matrix = rows(
                    [values[0], values[1], values[2]],
                    [values[3], values[4], values[5]],
                    [values[6], values[7], values[8]],
                );
                let rotation = nearest_rotation(matrix)?;
                Ok(self.oriented(rotation, Direction::WorldToCamera, CameraAxes::XRightYDown))
            }
        }
    }

    fn oriented(self, rotation: DMat3, own_direction: Direction, own_axes: CameraAxes) -> DMat3 {
        let axes_from_world = match self.direction.unwrap_or(own_direction) {
            Direction::CameraToWorld => rotation.transpose(),
            Direction::WorldToCamera => rotation,
        };
        self.camera_axes.unwrap_or(own_axes).camera_from_axes() * axes_from_world
    }
}

/// Largest departure of a matrix from a rotation that is still rounding: files print 4 digits and more.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// The rotation nearest to a matrix that is one up to rounding, by polar decomposition `R ← (R + R⁻ᵀ) / 2`.
///
/// # Errors
/// A sentence, for a reflection or a matrix that is no rotation.
pub(crate) fn nearest_rotation(matrix: DMat3) -> Result<DMat3, String> {
    let departure = matrix * matrix.transpose() - DMat3::IDENTITY;
    let largest = departure.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
    if largest.is_nan() || largest > ROTATION_TOLERANCE {
        return Err(format!("the matrix is no rotation: its rows depart from orthonormal by {largest:.2e}"));
    }
    if matrix.determinant() < 0.0 {
        return Err("the matrix is a reflection (determinant −1): an axis is flipped".to_owned());
    }
    let mut rotation = matrix;
    for _ in 0..4 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    Ok(rotation)
}

/// ω, φ, κ in degrees of a rotation, in the `opk` convention.
#[must_use]
pub fn opk_deg(camera_from_world: DMat3) -> [f64; 3] {
    let world_from_axes = (CameraAxes::XRightYUp.camera_from_axes() * camera_from_world).transpose();
    let at = |row: usize, col: usize| world_from_axes.col(col)[row];
    let omega_rad = (-at(1, 2)).atan2(at(2, 2));
    let phi_rad = at(0, 2).clamp(-1.0, 1.0).asin();
    let kappa_rad = (-at(0, 1)).atan2(at(0, 0));
    [omega_rad, phi_rad, kappa_rad].map(f64::to_degrees)
}

/// The quaternion w, x, y, z of a rotation, with w ≥ 0.
#[must_use]
pub fn quaternion_wxyz(rotation: DMat3) -> [f64; 4] {
    let quaternion = DQuat::from_mat3(&rotation).normalize();
    let sign = if quaternion.w < 0.0 { -1.0 } else { 1.0 };
    [quaternion.w, quaternion.x, quaternion.y, quaternion.z].map(|part| part * sign)
}

/// `camera_from_world` of a camera that looks straight down from an aircraft at pitch and roll 0, the top of the photo to its
/// nose, by the aircraft's yaw, pitch and roll in degrees: `ned_from_body = Rz(ψ) Ry(θ) Rx(ρ)`.
///
/// Source: Pix4D, "Yaw, Pitch, Roll and Omega, Phi, Kappa angles"; `OpenSfM` computes the same.
#[must_use]
pub(crate) fn camera_below([yaw_deg, pitch_deg, roll_deg]: [f64; 3]) -> DMat3 {
    /// Image right is the body's y, image down the opposite of its x, the optical axis its z.
    const BODY_FROM_CAMERA_BELOW: DMat3 = rows([0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let ned_from_body = Sequence::Zyx.product(roll_deg.to_radians(), pitch_deg.to_radians(), yaw_deg.to_radians());
    (ENU_FROM_NED * ned_from_body * BODY_FROM_CAMERA_BELOW).transpose()
}

/// The rotation about an axis by its length in radians (angle-axis, Rodrigues).
#[must_use]
pub(crate) fn from_rotation_vector(vector: DVec3) -> DMat3 {
    DMat3::from_quat(DQuat::from_scaled_axis(vector))
}

#[cfg(test)]
mod tests;
