//! Tiles of rays and what they see: arrays per quantity, as vector registers load them.

use glam::Vec3;

use super::image::Face;
use crate::scene::Prism;

/// Rays of a packet, and packets of a tile.
pub(super) use crate::simd::LANES;
/// Rays of a tile.
pub const TILE: usize = LANES * LANES;

/// Up to 64 rays from one point, in packets of eight neighbours. Frame: [`crate::frames::Local`], metres.
#[derive(Debug, Clone)]
pub struct RayTile {
    pub(super) origin: Vec3,
    /// One array per axis; `NaN` = no ray.
    pub(super) direction: [[f32; TILE]; 3],
}

/// Sight of the rays of a tile.
#[derive(Debug, Clone)]
pub struct TileSeen {
    /// The ray parameter of the first thing met (z-depth in metres, for rays of a camera); `NaN` = nothing there.
    pub depth: [f32; TILE],
    /// Face that each ray meets first.
    pub face: [Face; TILE],
}

impl RayTile {
    /// From an origin and one finite direction of any length per ray, packet by packet; `None` = no ray.
    ///
    /// ```
    /// use glam::Vec3;
    /// use sizeup_heights::render::tile::RayTile;
    ///
    /// // Straight down and ever more aslant, but for the last one.
    /// let slopes = RayTile::new(Vec3::Z * 100.0, |k| (k < 63).then(|| Vec3::new(k as f32 / 64.0, 0.0, -1.0)));
    /// ```
    #[must_use]
    #[inline]
    pub fn new(origin: Vec3, mut direction_of: impl FnMut(usize) -> Option<Vec3>) -> Self {
        let mut tile = Self { origin, direction: [[f32::NAN; TILE]; 3] };
        for k in 0..TILE {
            let [x, y, z] = direction_of(k).unwrap_or(Vec3::NAN).to_array();
            tile.direction[0][k] = x;
            tile.direction[1][k] = y;
            tile.direction[2][k] = z;
        }
        tile
    }

    /// The direction of a ray; `None` = no ray.
    pub(super) fn direction_of(&self, k: usize) -> Option<Vec3> {
        let direction = Vec3::from_array(self.direction.map(|axis| axis[k]));
        (!direction.is_nan()).then_some(direction)
    }

    /// The first direction that footprints can be cut along.
    pub(super) fn first_slanted(&self) -> Option<Vec3> {
        (0..TILE).filter_map(|k| self.direction_of(k)).find(|d| !Prism::is_upright(d.truncate().length_squared()))
    }
}
