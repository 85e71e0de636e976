//! How well a transformation is known, and the better ones for which a grid file is missing. Source: PROJ's database, after
//! EPSG's "operation accuracy".

use super::{Crs, CrsError, GridFile, Transform, Transform3d, grids};

/// Accuracy of a transformation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Accuracy {
    /// Nothing but a projection: rounding.
    Exact,
    /// The database's accuracy, metres.
    Metres(f64),
    /// The database does not say.
    Unknown,
}

impl std::fmt::Display for Accuracy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Exact => f.write_str("exact"),
            Self::Metres(metres) => write!(f, "to {metres} m"),
            Self::Unknown => f.write_str("of unknown accuracy"),
        }
    }
}

impl Accuracy {
    /// Accuracy of an operation that has just moved a point.
    pub(super) fn of(operation: &proj::Proj) -> Self {
        let accuracy = operation.proj_info().accuracy;
        if accuracy >= 0.0 { Self::Metres(accuracy) } else { Self::Unknown }
    }
}

/// A better transformation that lacks its grid file.
#[derive(Debug, Clone, PartialEq)]
pub struct Better {
    /// Name of the operation.
    pub name: String,
    /// Accuracy of the operation as PROJ's database states it, metres.
    pub accuracy_m: f64,
    /// The file, and where to get it.
    pub grid: GridFile,
}

impl std::fmt::Display for Better {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} would give {} m by {}", self.name, self.accuracy_m, self.grid)
    }
}

impl Transform {
    /// Accuracy of the operation that moves a point of the source.
    ///
    /// # Errors
    /// [`CrsError::Point`] outside the operation's domain.
    pub fn accuracy_at(&self, x: f64, y: f64) -> Result<Accuracy, CrsError> {
        self.point(x, y)?;
        Ok(match self.operation() {
            Some(_) if self.from().has_datum_of(self.to()) => Accuracy::Exact,
            Some(operation) => Accuracy::of(operation),
            None => Accuracy::Exact,
        })
    }

    /// The best operation at a point of the source that PROJ knows of and whose grid file is missing, where it is better
    /// than the one in use.
    #[must_use]
    pub fn better_at(&self, x: f64, y: f64) -> Option<Better> {
        let used_m = match self.accuracy_at(x, y).ok()? {
            Accuracy::Exact => return None,
            Accuracy::Metres(metres) => metres,
            Accuracy::Unknown => f64::INFINITY,
        };
        let base = self.from().geographic_base().ok()?;
        let (lon_deg, lat_deg) = Self::new(self.from(), &base).ok()?.point(x, y).ok()?;
        let target = self.to().geographic_base().ok()?;
        let found = grids::of_planes(base.name(), target.name(), (lon_deg, lat_deg));
        found.into_iter().find(|better| better.accuracy_m < used_m)
    }
}

impl Transform3d {
    /// Accuracy of the operation that moves a place, by its longitude and latitude in the source.
    #[must_use]
    pub fn accuracy_at(&self, lon_deg: f64, lat_deg: f64) -> Accuracy {
        // GDAL, which moves points with their heights, does not tell; PROJ chooses the same operation.
        let ask = || -> Option<Accuracy> {
            // The `proj` crate panics where PROJ finds no operation: GDAL has to find one first.
            self.point(glam::DVec3::new(lon_deg, lat_deg, 0.0)).ok()?;
            let [from, to] = [self.from(), self.to()].map(Crs::definition);
            let to = proj::Proj::new(to).ok()?;
            let operation = proj::Proj::new(from)
                .ok()?
                .create_crs_to_crs_from_pj(&to, None, Some(vec!["ALLOW_BALLPARK=NO"]))
                .ok()?;
            let place = if self.from().is_north_first() { (lat_deg, lon_deg) } else { (lon_deg, lat_deg) };
            operation.convert(place).ok()?;
            Some(Accuracy::of(&operation))
        };
        ask().unwrap_or(Accuracy::Unknown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn transform(from: &str, to: &str) -> Transform {
        Transform::new(&Crs::parse(from).unwrap(), &Crs::parse(to).unwrap()).unwrap()
    }

    #[test]
    fn a_projection_alone_is_exact() {
        assert_eq!(transform("EPSG:4258", "EPSG:25832").accuracy_at(11.9, 52.0).unwrap(), Accuracy::Exact);
        assert_eq!(transform("EPSG:25832", "EPSG:25833").accuracy_at(699_000.0, 5_764_000.0).unwrap(), Accuracy::Exact);
        assert_eq!(transform("EPSG:25832", "EPSG:25832").accuracy_at(1.0, 2.0).unwrap(), Accuracy::Exact);
    }

    #[test]
    fn the_null_shift_from_wgs84_to_etrs89_is_known_to_a_metre() {
        // EPSG:1149, "ETRS89 to WGS 84 (1)": accuracy 1 m.
        assert_eq!(transform("EPSG:4326", "EPSG:25832").accuracy_at(11.9, 52.0).unwrap(), Accuracy::Metres(1.0));
    }

    #[test]
    fn without_ostn15_great_britain_is_metres_off_and_the_grid_is_named() {
        // EPSG:5622 (Helmert) is known to 2 m; EPSG:7709/7953 by OSTN15 to decimetres or a metre.
        let to_britain = transform("EPSG:4258", "EPSG:27700");
        let better = to_britain.better_at(-1.5, 52.5);
        match to_britain.accuracy_at(-1.5, 52.5).unwrap() {
            Accuracy::Metres(metres) if metres > 1.0 => {
                let better = better.unwrap();
                assert!(better.accuracy_m < 1.0 && better.grid.name.contains("OSTN15"), "{better}");
            }
            accuracy => assert!(better.is_none(), "the grid is installed: {accuracy}"),
        }
    }
}
