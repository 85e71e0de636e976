//! From the map to the earth's frame (EPSG:4978, WGS 84, earth-centred), and to a local frame in single precision.
//!
//! ```text
//! local = ENU(c) · (ecef(map point) − c)
//! ```
//!
//! `c`: a point in the middle of the city. The local axes are east, north and up at `c`; positions are exact in them,
//! not laid on a plane: the earth's curve stays.

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::super::OutputError;
use sizeup_geo::crs::{Crs, Geocentric, Transform, Transform3d, enu_from_geocentric};

/// How heights of the result become heights above the WGS 84 ellipsoid. Never guessed: a wrong choice lifts a city by
/// up to 107 m.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Heights {
    /// By the CRS's vertical part and PROJ's grids; refused where either is missing.
    #[default]
    Crs,
    /// They are ellipsoidal already.
    Ellipsoidal,
    /// One height of the geoid (or national zero) above the ellipsoid for the whole city, metres.
    GeoidHeight(f64),
}

/// The way from the map to the earth.
enum WayToEarth {
    Direct(Transform3d),
    Stated {
        lon_lat: Transform,
        geocentric: Box<Geocentric>,
        add_m: f64,
    },
    /// None: the picture stays in the map.
    Map,
}

/// The local frame of a city on the earth.
pub struct TilesetPlace {
    way: WayToEarth,
    centre: DVec3,
    enu_from_ecef: DMat3,
}

impl TilesetPlace {
    /// A frame around a map position (metres).
    ///
    /// # Errors
    /// [`OutputError::HeightsNotStated`], or [`OutputError::Crs`] where PROJ would only guess.
    pub fn new(crs: &Crs, heights: Heights, centre_m: DVec3) -> Result<Self, OutputError> {
        let geocentric = Geocentric::new()?;
        let stated = |add_m: f64, geocentric: Geocentric| -> Result<WayToEarth, OutputError> {
            let geocentric = Box::new(geocentric);
            Ok(WayToEarth::Stated { lon_lat: Transform::new(crs, &Crs::parse("EPSG:4326")?)?, geocentric, add_m })
        };
        let way = match heights {
            Heights::Crs if crs.vertical_name().is_some() || crs.is_ellipsoidal_3d() => {
                WayToEarth::Direct(Transform3d::new(crs, &Crs::parse("EPSG:4978")?)?)
            }
            Heights::Crs => return Err(OutputError::HeightsNotStated { crs: crs.to_string() }),
            Heights::Ellipsoidal => stated(0.0, geocentric)?,
            Heights::GeoidHeight(geoid_m) => stated(geoid_m, geocentric)?,
        };
        let mut at = [centre_m];
        way.to_ecef(&mut at)?;
        let [centre] = at;
        let geodetic = Geocentric::new()?.geodetic(centre)?;
        Ok(Self { way, centre, enu_from_ecef: enu_from_geocentric(geodetic.x, geodetic.y) })
    }

    /// The map itself around a position (metres), for pictures without a globe.
    pub fn in_map(origin_m: DVec3) -> Self {
        Self { way: WayToEarth::Map, centre: origin_m, enu_from_ecef: DMat3::IDENTITY }
    }

    /// Turns map positions into local ones: east, north, up of the centre, metres.
    ///
    /// # Errors
    /// [`OutputError::Crs`] for a position outside the CRS's domain.
    pub fn to_local(&self, points: &mut [DVec3]) -> Result<(), OutputError> {
        self.way.to_ecef(points)?;
        for point in points {
            *point = self.enu_from_ecef * (*point - self.centre);
        }
        Ok(())
    }

    /// The matrix `ecef_from_local` of a tileset, column by column.
    #[must_use]
    pub fn transform(&self) -> [f64; 16] {
        let [east, north, up] = self.enu_from_ecef.transpose().to_cols_array_2d();
        let c = self.centre;
        [
            east[0], east[1], east[2], 0.0, north[0], north[1], north[2], 0.0, up[0], up[1], up[2], 0.0, c.x, c.y, c.z,
            1.0,
        ]
    }
}

impl WayToEarth {
    fn to_ecef(&self, points: &mut [DVec3]) -> Result<(), OutputError> {
        match self {
            Self::Direct(transform) => transform.points(points)?,
            Self::Stated { lon_lat, geocentric, add_m } => {
                for point in points.iter_mut() {
                    let (lon, lat) = lon_lat.point(point.x, point.y)?;
                    *point = DVec3::new(lon, lat, point.z + add_m);
                }
                geocentric.geocentric_points(points)?;
            }
            Self::Map => {}
        }
        Ok(())
    }
}
