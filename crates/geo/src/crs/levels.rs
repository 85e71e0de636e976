//! Levels from one vertical reference to another, where PROJ knows how: by a grid, an offset or an inclined plane.

use glam::DVec3;

use super::{Crs, CrsError, Transform, Transform3d};

/// Vertical reference of a CRS.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VerticalReference {
    /// The ellipsoid of WGS 84 or GRS 1980, which differ by 0.1 mm.
    Ellipsoid,
    /// A vertical system, such as `NAP height`.
    System {
        /// PROJ's name of it.
        name: String,
        /// EPSG code, where it has one.
        epsg: Option<u32>,
    },
}

impl VerticalReference {
    /// Statement of a CRS; `None` where it says nothing, or counts from an ellipsoid of its own.
    #[must_use]
    pub fn of(crs: &Crs) -> Option<Self> {
        const COMMON_ELLIPSOIDS: [&str; 2] = ["WGS 84", "GRS 1980"];
        match crs.vertical_name() {
            Some(name) => Some(Self::System { name: name.to_owned(), epsg: crs.vertical_epsg() }),
            None if crs.is_ellipsoidal_3d() && COMMON_ELLIPSOIDS.contains(&crs.ellipsoid_name()?) => {
                Some(Self::Ellipsoid)
            }
            None => None,
        }
    }

    /// A geographic CRS with such heights.
    fn geographic(&self) -> Result<Crs, CrsError> {
        match self {
            Self::Ellipsoid => Crs::parse("EPSG:4979"),
            Self::System { epsg: Some(epsg), .. } => Crs::parse(&format!("EPSG:4326+{epsg}")),
            Self::System { name, epsg: None } => {
                let reason = "EPSG has no vertical system of this name, so no transformation leads to it".to_owned();
                Err(CrsError::Unknown { definition: name.clone(), reason })
            }
        }
    }
}

impl std::fmt::Display for VerticalReference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Ellipsoid => f.write_str("the ellipsoid"),
            Self::System { name, .. } => f.write_str(name),
        }
    }
}

/// A transformation of levels in metres at places of a map. Neither `Send` nor `Sync`.
pub struct LevelTransform {
    lon_lat: Transform,
    operation: Transform3d,
    /// Metres per unit of either reference.
    units_m: [f64; 2],
}

impl LevelTransform {
    /// From one reference to another, at places of `plane`. Its own datum stands in for WGS 84: a geoid does not change
    /// over the metres between two datums.
    ///
    /// # Errors
    /// [`CrsError::MissingGrid`], or [`CrsError::NoTransformation`] where PROJ would only guess.
    pub fn new(plane: &Crs, from: &VerticalReference, to: &VerticalReference) -> Result<Self, CrsError> {
        let (from, to) = (from.geographic()?, to.geographic()?);
        Ok(Self {
            lon_lat: Transform::new(plane, &plane.geographic_base()?)?,
            operation: Transform3d::new(&from, &to)?,
            units_m: [&from, &to].map(|crs| crs.height_unit_m().unwrap_or(1.0)),
        })
    }

    /// The level at a place of the map, metres.
    ///
    /// # Errors
    /// [`CrsError::MissingGrid`], or [`CrsError::Point`] outside the operation's domain.
    pub fn level_m(&self, at: DVec3) -> Result<f64, CrsError> {
        let (lon_deg, lat_deg) = self.lon_lat.point(at.x, at.y)?;
        Ok(self.operation.point(DVec3::new(lon_deg, lat_deg, at.z / self.units_m[0]))?.z * self.units_m[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level_m(plane: &str, from: &str, to: &str, at: [f64; 3]) -> Result<f64, CrsError> {
        let reference = |definition: &str| VerticalReference::of(&Crs::parse(definition).unwrap()).unwrap();
        let plane = Crs::parse(plane).unwrap();
        LevelTransform::new(&plane, &reference(from), &reference(to))?.level_m(DVec3::from(at))
    }

    #[test]
    fn worked_example_of_an_inclined_offset() {
        // EPSG Guidance Note 7-2, "Vertical Offset and Slope": LN02 to EVRF2000 at 47°20' N, 9°40' E, 473.000 m -> 472.690 m.
        let at = [9.0 + 40.0 / 60.0, 47.0 + 20.0 / 60.0, 473.0];
        let found = level_m("EPSG:4258", "EPSG:4258+5728", "EPSG:4258+5730", at).unwrap();
        assert!((found - 472.690).abs() < 1e-3, "{found}");
    }

    #[test]
    fn plain_offsets_of_the_epsg_dataset_both_ways() {
        // EPSG:5419, NGF IGN69 to EVRF2000: -0.486 m, from the plane of a map (Paris in Lambert 93).
        let paris = [652_000.0, 6_862_000.0, 35.0];
        let there = level_m("EPSG:2154", "EPSG:5698", "EPSG:4258+5730", paris).unwrap();
        assert!((there - (35.0 - 0.486)).abs() < 1e-9, "{there}");
        let back = level_m("EPSG:2154", "EPSG:4258+5730", "EPSG:5698", [paris[0], paris[1], there]).unwrap();
        assert!((back - 35.0).abs() < 1e-9, "{back}");
    }

    #[test]
    fn levels_above_the_geoid_from_ellipsoidal_ones() {
        // NGA's EGM96 test point in Mongolia: 46.874319° N, 102.448729° E, N = -43.575 m.
        let at = [102.448_729, 46.874_319, 1_500.0];
        let found = level_m("EPSG:4326", "EPSG:4979", "EPSG:4326+5773", at).unwrap();
        assert!((found - (1_500.0 + 43.575)).abs() < 0.06, "{found}");
    }

    #[test]
    fn feet_of_a_vertical_system_are_metres_here() {
        // EPSG:6360 is NAVD88 in US survey feet, EPSG:5703 the same in metres.
        let at = [583_960.0, 4_507_523.0, 10.0];
        let found = level_m("EPSG:32618", "EPSG:2263+6360", "EPSG:32618+5703", at).unwrap();
        assert!((found - 10.0).abs() < 1e-6, "{found}");
    }

    #[test]
    fn what_only_a_missing_grid_could_do_is_refused_by_its_name() {
        let outcome = level_m("EPSG:28992", "EPSG:4979", "EPSG:7415", [92_000.0, 437_000.0, 50.0]);
        match outcome {
            Ok(level) => assert!((50.0 - level - 43.5).abs() < 2.0, "with the grid: {level}"),
            Err(e) => assert!(e.to_string().contains("nl_nsgi_nlgeo2018"), "{e}"),
        }
    }

    #[test]
    fn a_plane_alone_says_nothing_of_levels() {
        let of = |definition: &str| VerticalReference::of(&Crs::parse(definition).unwrap());
        assert_eq!(of("EPSG:25832"), None);
        assert_eq!(of("EPSG:4979"), Some(VerticalReference::Ellipsoid));
        assert_eq!(of("EPSG:7415").unwrap().to_string(), "NAP height");
    }
}
