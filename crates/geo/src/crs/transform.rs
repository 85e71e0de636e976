//! Horizontal transformation between two CRSs.

use super::{Crs, CrsError, spatial};

/// A horizontal transformation, easting before northing and longitude before latitude on both sides.
///
/// Neither `Send` nor `Sync`, and some 10 ms to make: one per thread.
pub struct Transform {
    /// `None` where source and target are the same.
    operation: Option<proj::Proj>,
    /// Greatest |x| and |y| of a geographic source: PROJ prints a line of its own about places beyond the poles.
    limits: Option<(f64, f64)>,
    from: Crs,
    to: Crs,
}

impl Transform {
    /// The best operation PROJ knows, or an error where it would only guess.
    ///
    /// # Errors
    /// [`CrsError::NoTransformation`] if only a ballpark transformation exists.
    pub fn new(from: &Crs, to: &Crs) -> Result<Self, CrsError> {
        let no_transformation = |reason: String| CrsError::NoTransformation {
            from: from.to_string(),
            to: to.to_string(),
            reason,
            base: to.geographic_base().map_or_else(|_| "its geographic base".to_owned(), |base| base.to_string()),
        };
        let same = from.horizontal_json() == to.horizontal_json();
        let operation = if same {
            None
        } else {
            let parse = |crs: &Crs| {
                // Only the plane is transformed here, so a compound takes part with its horizontal part.
                let definition = crs.horizontal_json().to_string();
                proj::Proj::new(&definition).map_err(|e| no_transformation(e.to_string()))
            };
            let (source, target) = (from.horizontal_json().to_string(), to.horizontal_json().to_string());
            if let Some(reason) = spatial::why_impossible(&source, &target) {
                return Err(no_transformation(reason));
            }
            let operation = parse(from)?
                .create_crs_to_crs_from_pj(&parse(to)?, None, Some(vec!["ALLOW_BALLPARK=NO"]))
                .map_err(|e| no_transformation(e.to_string()))?;
            Some(operation)
        };
        Ok(Self { operation, limits: from.angular_limits(), from: from.clone(), to: to.clone() })
    }

    /// Whether source and target share their plane.
    #[must_use]
    pub fn is_identity(&self) -> bool {
        self.operation.is_none()
    }

    /// PROJ's operation; `None` where there is nothing to do.
    pub(super) fn operation(&self) -> Option<&proj::Proj> {
        self.operation.as_ref()
    }

    /// CRS that positions are brought to.
    #[must_use]
    pub fn to(&self) -> &Crs {
        &self.to
    }

    /// CRS that positions come from.
    #[must_use]
    pub fn from(&self) -> &Crs {
        &self.from
    }

    /// Moves one point, `(easting, northing)` or `(longitude, latitude)` in the units of its CRS.
    ///
    /// # Errors
    /// [`CrsError::Point`] outside the operation's domain.
    pub fn point(&self, x: f64, y: f64) -> Result<(f64, f64), CrsError> {
        let Some(operation) = &self.operation else { return Ok((x, y)) };
        let swap =
            |first: f64, second: f64, north_first: bool| if north_first { (second, first) } else { (first, second) };
        let refuse =
            |reason: String| CrsError::Point { x, y, from: self.from.to_string(), to: self.to.to_string(), reason };
        if self.limits.is_some_and(|(limit_x, limit_y)| !(x.abs() <= limit_x && y.abs() <= limit_y)) {
            return Err(refuse("there is no such longitude and latitude".to_owned()));
        }
        let (first, second) =
            operation.convert(swap(x, y, self.from.is_north_first())).map_err(|e| refuse(e.to_string()))?;
        if !(first.is_finite() && second.is_finite()) {
            return Err(refuse("outside the transformation's domain".to_owned()));
        }
        Ok(swap(first, second, self.to.is_north_first()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn transform(from: &str, to: &str, x: f64, y: f64) -> (f64, f64) {
        Transform::new(&Crs::parse(from).unwrap(), &Crs::parse(to).unwrap()).unwrap().point(x, y).unwrap()
    }

    #[test]
    fn amersfoort_tower_is_the_origin_of_rd() {
        // EPSG:28992 has its false origin (155000, 463000) at Amersfoort, 52°09'22.178" N 5°23'15.500" E on the
        // Bessel ellipsoid (EPSG dataset, projection 19914): exact, no datum shift between 4289 and 28992.
        let (lon, lat) = (5.0 + 23.0 / 60.0 + 15.5 / 3600.0, 52.0 + 9.0 / 60.0 + 22.178 / 3600.0);
        let (e, n) = transform("EPSG:4289", "EPSG:28992", lon, lat);
        assert!((e - 155_000.0).abs() < 1e-3 && (n - 463_000.0).abs() < 1e-3, "{e} {n}");
    }

    #[test]
    fn published_utm_test_point_of_the_ordnance_survey_guide() {
        // OSGB36 worked example (A guide to coordinate systems in Great Britain, C.1-C.2):
        // 52°39'27.2531" N 1°43'4.5177" E (Airy) = TG 51409 13177, E 651409.903 N 313177.270.
        let (lon, lat) = (1.0 + 43.0 / 60.0 + 4.5177 / 3600.0, 52.0 + 39.0 / 60.0 + 27.2531 / 3600.0);
        let (e, n) = transform("EPSG:4277", "EPSG:27700", lon, lat);
        assert!((e - 651_409.903).abs() < 2e-3 && (n - 313_177.270).abs() < 2e-3, "{e} {n}");
    }

    #[test]
    fn northing_first_systems_are_turned_round() {
        // EPSG:2180 lists northing first; we never do.
        let (lon, lat) = transform("EPSG:2180", "EPSG:4326", 635_002.7, 485_469.1);
        assert!((lon - 20.97).abs() < 0.02 && (lat - 52.22).abs() < 0.02, "{lon} {lat}");
        let (e, n) = transform("EPSG:4326", "EPSG:2180", lon, lat);
        assert!((e - 635_002.7).abs() < 1e-3 && (n - 485_469.1).abs() < 1e-3, "{e} {n}");
    }

    #[test]
    fn systems_without_an_accurate_operation_are_refused_with_a_way_out() {
        // WGS 84 to CGCS2000: PROJ knows only a ballpark.
        let (from, to) = (Crs::parse("EPSG:4326").unwrap(), Crs::parse("EPSG:4547").unwrap());
        let refused = Transform::new(&from, &to).err().map(|e| e.to_string());
        assert!(refused.is_none_or(|text| text.contains("EPSG:4490")), "the target's own geographic system is named");
    }

    #[test]
    fn a_compound_and_its_plane_are_the_same_plane() {
        assert_eq!(transform("EPSG:7415", "EPSG:28992", 1.0, 2.0), (1.0, 2.0));
    }
}
