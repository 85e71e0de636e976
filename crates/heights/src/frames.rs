//! Coordinate frames, and rigid transforms whose names cancel when they compose.
//!
//! | frame | axes | unit, type |
//! |---|---|---|
//! | [`Map`] | easting, northing, up in the project's projected CRS | metres, `f64` |
//! | [`Local`] | `Map` minus a fixed origin: same axes, small numbers | metres, `f64`, `f32` inside `render` |
//! | [`Cam`] | x right, y down, z forward (OpenCV) | metres, `f64` |
//! | Image | pixels; the top-left pixel's *centre* is (0.5, 0.5) | pixels, `f64` |
//!
//! A [`Rigid<To, From>`] is read `to_from_from`: `camera_from_map` maps a point in [`Map`] to a point in
//! [`Cam`], and `camera_from_map * map_from_local` is a `Rigid<Cam, Local>`; anything else does not compile.

use std::marker::PhantomData;
use std::ops::Mul;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// The project's projected CRS: easting, northing, up, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Map;

/// [`Map`] minus a fixed origin, so that `f32` resolves a millimetre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Local;

/// One camera: x right, y down, z forward along the optical axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cam;

/// A rigid motion `p_to = R · p_from + t`, in metres.
#[derive(Debug, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Rigid<To, From> {
    /// `R`, orthonormal with determinant +1.
    pub rotation: DMat3,
    /// `t`: where the origin of `From` lies in `To`, metres.
    pub translation: DVec3,
    #[serde(skip)]
    frames: PhantomData<(To, From)>,
}

impl<To, From> Clone for Rigid<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<To, From> Copy for Rigid<To, From> {}

impl<To, From> PartialEq for Rigid<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.rotation == other.rotation && self.translation == other.translation
    }
}

impl<To, From> Rigid<To, From> {
    /// From `R` and `t` of `p_to = R · p_from + t`.
    #[must_use]
    pub fn new(rotation: DMat3, translation: DVec3) -> Self {
        Self { rotation, translation, frames: PhantomData }
    }

    /// From `R` and the position of `To`'s origin in `From` (a camera's projection centre `C`): `t = −R·C`.
    #[must_use]
    pub fn from_rotation_and_centre(rotation: DMat3, centre_in_from: DVec3) -> Self {
        Self::new(rotation, -(rotation * centre_in_from))
    }

    /// Origin of `To` in `From`: `C = −Rᵀ·t`. For a camera, its projection centre.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The same attitude from elsewhere: the centre moved, in the frame that is mapped from.
    #[must_use]
    pub fn moved(&self, by_in_from: DVec3) -> Self {
        Self::from_rotation_and_centre(self.rotation, self.centre() + by_in_from)
    }

    /// Moves a position from `From` to `To`.
    #[must_use]
    pub fn point(&self, point_in_from: DVec3) -> DVec3 {
        self.rotation * point_in_from + self.translation
    }

    /// Turns a direction from `From` to `To`.
    #[must_use]
    pub fn vector(&self, vector_in_from: DVec3) -> DVec3 {
        self.rotation * vector_in_from
    }

    /// The same motion the other way round.
    #[must_use]
    pub fn inverse(&self) -> Rigid<From, To> {
        let rotation = self.rotation.transpose();
        Rigid::new(rotation, -(rotation * self.translation))
    }
}

impl Rigid<Cam, Map> {
    /// The optical axis in the map frame, unit length.
    #[must_use]
    pub fn axis_in_map(&self) -> DVec3 {
        self.rotation.transpose() * DVec3::Z
    }

    /// Angle between the optical axis and the downward vertical, radians.
    #[must_use]
    pub fn off_nadir_rad(&self) -> f64 {
        (-self.axis_in_map().z).clamp(-1.0, 1.0).acos()
    }

    /// The pose of a camera at `eye` that looks at `target` with the horizon level; both in metres in the map frame. A camera
    /// that looks straight down has the top of its image in the north.
    ///
    /// ```
    /// use glam::DVec3;
    /// use sizeup_heights::frames::Rigid;
    /// let camera_from_map = Rigid::looking_at(DVec3::new(0.0, -50.0, 100.0), DVec3::new(0.0, 50.0, 0.0));
    /// let ahead = camera_from_map.point(DVec3::new(0.0, 50.0, 0.0));
    /// assert!((ahead - DVec3::new(0.0, 0.0, 20_000.0_f64.sqrt())).length() < 1e-9);
    /// assert!(camera_from_map.vector(DVec3::X).x > 0.999);
    /// ```
    #[must_use]
    pub fn looking_at(eye: DVec3, target: DVec3) -> Self {
        let forward = (target - eye).normalize_or(-DVec3::Z);
        let right = forward.cross(DVec3::Z).normalize_or(DVec3::X);
        let down = forward.cross(right);
        Self::from_rotation_and_centre(DMat3::from_cols(right, down, forward).transpose(), eye)
    }
}

impl<A, B, C> Mul<Rigid<B, C>> for Rigid<A, B> {
    type Output = Rigid<A, C>;

    fn mul(self, rhs: Rigid<B, C>) -> Rigid<A, C> {
        Rigid::new(self.rotation * rhs.rotation, self.rotation * rhs.translation + self.translation)
    }
}

/// The fixed offset between [`Map`] and [`Local`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LocalOrigin(pub DVec3);

impl LocalOrigin {
    /// From the map frame to the local one, `p_local = p_map − origin`.
    #[must_use]
    pub fn local_from_map(&self) -> Rigid<Local, Map> {
        Rigid::new(DMat3::IDENTITY, -self.0)
    }

    /// From the local frame to the map, `p_map = p_local + origin`.
    #[must_use]
    pub fn map_from_local(&self) -> Rigid<Map, Local> {
        Rigid::new(DMat3::IDENTITY, self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn composing_with_the_inverse_is_the_identity() {
        let camera_from_map: Rigid<Cam, Map> = Rigid::from_rotation_and_centre(
            DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1),
            DVec3::new(634_000.0, 485_000.0, 200.0),
        );
        let p = DVec3::new(634_100.0, 485_050.0, 110.0);
        let back = camera_from_map.inverse().point(camera_from_map.point(p));
        assert!((back - p).length() < 1e-9, "{back}");
        assert!((camera_from_map.centre() - DVec3::new(634_000.0, 485_000.0, 200.0)).length() < 1e-9);
    }

    #[test]
    fn local_origin_cancels() {
        let origin = LocalOrigin(DVec3::new(5e5, 4e6, 100.0));
        let map_from_map: Rigid<Map, Map> = origin.map_from_local() * origin.local_from_map();
        assert_eq!(map_from_map.point(DVec3::ONE), DVec3::ONE);
    }
}
