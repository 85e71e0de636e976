//! Grid convergence and point scale, numerically: the meridian (or another grid's northing) seen in the target grid.
//!
//! ```text
//! (dE, dN) = T(p + h·north) − T(p − h·north),   α = atan2(dE, dN),   scale = |(dE, dN)| / 2h
//! ```
//!
//! `α` is the azimuth of the source's north in the target grid, clockwise. A camera that counted its rotation from the
//! source's north is turned by it: `target_from_source = Rz(−α)`.

use glam::{DMat3, DVec2};

use super::{Crs, CrsError, Transform};

/// Half the step of the central difference along a projected northing, metres: curvature over it is below 1e-8 rad,
/// rounding of the coordinates below 1e-10 rad.
const HALF_STEP_M: f64 = 50.0;
/// The same along a meridian, degrees.
const HALF_STEP_DEG: f64 = 0.0005;

/// Axes of the source in the target grid at one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridNorth {
    /// Azimuth of the source's north in the target grid, clockwise, radians.
    pub azimuth_rad: f64,
    /// Length of a metre of a projected source in the target grid (1 for geographic sources).
    pub scale: f64,
}

impl GridNorth {
    /// Axes that are the same in both CRSs.
    pub const SAME: Self = Self { azimuth_rad: 0.0, scale: 1.0 };

    /// Turns a direction (east, north, up) in the source's axes into the target's.
    #[must_use]
    pub fn target_from_source(&self) -> DMat3 {
        DMat3::from_rotation_z(-self.azimuth_rad)
    }
}

impl Transform {
    /// Direction of the source's north in the target grid at a point of the source.
    ///
    /// # Errors
    /// [`CrsError::Point`] outside the operation's domain.
    pub fn north_at(&self, x: f64, y: f64) -> Result<GridNorth, CrsError> {
        if self.is_identity() {
            return Ok(GridNorth::SAME);
        }
        let is_geographic = self.from().is_geographic();
        let half_step = if is_geographic { HALF_STEP_DEG } else { HALF_STEP_M };
        let step = |sign: f64| self.point(x, y + sign * half_step).map(DVec2::from);
        let difference = step(1.0)? - step(-1.0)?;
        let scale = if is_geographic { 1.0 } else { difference.length() / (2.0 * half_step) };
        Ok(GridNorth { azimuth_rad: difference.x.atan2(difference.y), scale })
    }
}

/// Rotation from true north to the grid of a projected CRS, at many points of it.
pub struct TrueNorth {
    geographic_from_grid: Transform,
    grid_from_geographic: Transform,
}

/// Radius of the equator, metres, and square of the eccentricity of WGS 84: other ellipsoids differ by less than 0.02 %.
const EARTH: (f64, f64) = (6_378_137.0, 0.006_694_380);

impl TrueNorth {
    /// Prepares the transforms to the CRS's own geographic system and back.
    ///
    /// # Errors
    /// [`CrsError::NoTransformation`] if the CRS has no geographic base.
    pub fn of(grid: &Crs) -> Result<Self, CrsError> {
        let geographic = grid.geographic_base()?;
        Ok(Self {
            geographic_from_grid: Transform::new(grid, &geographic)?,
            grid_from_geographic: Transform::new(&geographic, grid)?,
        })
    }

    /// Direction of true north in the grid at an easting and northing.
    ///
    /// # Errors
    /// [`CrsError::Point`] outside the projection's domain.
    pub fn at(&self, easting: f64, northing: f64) -> Result<GridNorth, CrsError> {
        let (lon_deg, lat_deg) = self.geographic_from_grid.point(easting, northing)?;
        self.grid_from_geographic.north_at(lon_deg, lat_deg)
    }

    /// Lengths in the grid of a metre on the ellipsoid, northwards and eastwards, and the longitude and latitude, degrees.
    ///
    /// # Errors
    /// [`CrsError::Point`] outside the projection's domain.
    pub fn scale_at(&self, easting: f64, northing: f64) -> Result<([f64; 2], (f64, f64)), CrsError> {
        let (lon, lat) = self.geographic_from_grid.point(easting, northing)?;
        let degrees = self.grid_from_geographic.from().angular_limits().map_or(1.0, |(_, pole)| 90.0 / pole);
        let (radius_m, e2) = EARTH;
        let (sin, cos) = (lat * degrees).to_radians().sin_cos();
        let w = (1.0 - e2 * sin * sin).sqrt();
        let (northwards_m, eastwards_m) = (radius_m * (1.0 - e2) / w.powi(3), radius_m / w * cos);
        let length = |step: DVec2, radius_m: f64| -> Result<f64, CrsError> {
            let end =
                |sign: f64| self.grid_from_geographic.point(lon + sign * step.x, lat + sign * step.y).map(DVec2::from);
            let there_m = 2.0 * (HALF_STEP_DEG * degrees).to_radians() * radius_m;
            Ok((end(1.0)? - end(-1.0)?).length() / there_m)
        };
        let scale = [length(DVec2::Y * HALF_STEP_DEG, northwards_m)?, length(DVec2::X * HALF_STEP_DEG, eastwards_m)?];
        Ok((scale, (lon * degrees, lat * degrees)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meridians_converge_east_of_the_central_meridian() {
        // EPSG:25832 at 11.9° E, 52° N: central meridian 9° E; series: (λ − λ0)·sin φ = 2.9°·0.788 = 2.285°.
        let wgs84 = Crs::parse("EPSG:4258").unwrap();
        let utm = Crs::parse("EPSG:25832").unwrap();
        let north = Transform::new(&wgs84, &utm).unwrap().north_at(11.9, 52.0).unwrap();
        assert!((north.azimuth_rad.to_degrees() + 2.286).abs() < 1e-3, "{}", north.azimuth_rad.to_degrees());
        let (e, n) = Transform::new(&wgs84, &utm).unwrap().point(11.9, 52.0).unwrap();
        let again = TrueNorth::of(&utm).unwrap().at(e, n).unwrap();
        assert!((again.azimuth_rad - north.azimuth_rad).abs() < 1e-9);
    }

    #[test]
    fn the_point_scale_is_one_in_grids_for_surveys_and_not_in_maps_of_the_world() {
        let scale = |definition: &str, lon: f64, lat: f64| {
            let crs = Crs::parse(definition).unwrap();
            let (e, n) = Transform::new(&Crs::parse("EPSG:4326").unwrap(), &crs).unwrap().point(lon, lat).unwrap();
            TrueNorth::of(&crs).unwrap().scale_at(e, n).unwrap().0
        };
        // On the central meridian of a UTM zone 0.9996 by definition; 1 / cos(latitude) on the spherical Mercator's ellipsoid.
        for found in scale("EPSG:32632", 9.0, 53.0) {
            assert!((found - 0.9996).abs() < 1e-5, "{found}");
        }
        for found in scale("EPSG:3395", 10.0, 53.5) {
            assert!((found - 1.6776).abs() < 1e-3, "{found}");
        }
        // Meridians of NTF (Paris) are counted in gon.
        for found in scale("EPSG:27572", 2.3, 46.8) {
            assert!((found - 1.0).abs() < 3e-3, "{found}");
        }
    }

    #[test]
    fn between_two_grids_only_their_difference_counts() {
        // The zone boundary at 12° E is symmetric: 32N and 33N lean by the same angle to opposite sides.
        let zones = ["EPSG:25832", "EPSG:25833"].map(|code| Crs::parse(code).unwrap());
        let wgs84 = Crs::parse("EPSG:4258").unwrap();
        let (e, n) = Transform::new(&wgs84, &zones[0]).unwrap().point(12.0, 52.0).unwrap();
        let north = Transform::new(&zones[0], &zones[1]).unwrap().north_at(e, n).unwrap();
        let lean = Transform::new(&wgs84, &zones[1]).unwrap().north_at(12.0, 52.0).unwrap();
        assert!((north.azimuth_rad - 2.0 * lean.azimuth_rad).abs() < 1e-6);
        assert!((north.scale - 1.0).abs() < 1e-6, "symmetric scale {}", north.scale);
    }
}
