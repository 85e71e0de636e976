//! Transformation of points with height, through GDAL (the `proj` crate moves the plane only).
//!
//! Ballpark operations are refused: without its grid, PROJ would hand ellipsoidal heights through unchanged and call
//! that a success.

use std::path::Path;
use std::sync::LazyLock;

use gdal::spatial_ref::{AxisMappingStrategy, CoordTransform, CoordTransformOptions, SpatialRef};
use glam::{DMat3, DVec3};

use super::{Crs, CrsError, LONGEST_KEPT, MOST_KEPT, Transform, grids};
use crate::gdal_log::route_messages;
use crate::kept::Kept;

/// A transformation of easting or longitude, northing or latitude, height. Neither `Send` nor `Sync`.
pub struct Transform3d {
    operation: CoordTransform,
    from: Crs,
    to: Crs,
}

impl Transform3d {
    /// The best operation PROJ knows for plane and height.
    ///
    /// # Errors
    /// [`CrsError::MissingGrid`] naming the grid files the heights need, or [`CrsError::NoTransformation`].
    pub fn new(from: &Crs, to: &Crs) -> Result<Self, CrsError> {
        route_messages();
        let no_transformation = |e: gdal::errors::GdalError| {
            let (from, to) = (from.to_string(), to.to_string());
            let base = "its geographic base".to_owned();
            CrsError::NoTransformation { from, to, reason: reason_of(&e), base }
        };
        let reference = |crs: &Crs| -> Result<SpatialRef, gdal::errors::GdalError> {
            let mut reference = SpatialRef::from_definition(crs.definition())?;
            reference.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
            Ok(reference)
        };
        let build = || -> Result<CoordTransform, gdal::errors::GdalError> {
            let mut options = CoordTransformOptions::new()?;
            options.set_ballpark_allowed(false)?;
            CoordTransform::new_with_options(&reference(from)?, &reference(to)?, &options)
        };
        let operation = build().map_err(|e| match grids::of_heights(from, to, None) {
            grids if grids.is_empty() => no_transformation(e),
            grids => missing(from, to, &grids),
        })?;
        Ok(Self { operation, from: from.clone(), to: to.clone() })
    }

    /// CRS that positions come from.
    pub(super) fn from(&self) -> &Crs {
        &self.from
    }

    /// CRS that positions are brought to.
    pub(super) fn to(&self) -> &Crs {
        &self.to
    }

    /// Moves one point.
    ///
    /// # Errors
    /// [`CrsError::MissingGrid`] or [`CrsError::Point`]: GDAL looks for the operation only when it sees the place.
    pub fn point(&self, at: DVec3) -> Result<DVec3, CrsError> {
        let (mut x, mut y, mut z) = ([at.x], [at.y], [at.z]);
        let outcome = self.operation.transform_coords(&mut x, &mut y, &mut z);
        let moved = DVec3::new(x[0], y[0], z[0]);
        match outcome {
            Ok(()) if moved.is_finite() => Ok(moved),
            outcome => {
                let grids = grids::of_heights(&self.from, &self.to, self.place_deg(at));
                if !grids.is_empty() {
                    return Err(missing(&self.from, &self.to, &grids));
                }
                let reason = outcome.err().map_or_else(|| "outside its domain".to_owned(), |e| e.to_string());
                let (from, to) = (self.from.to_string(), self.to.to_string());
                Err(CrsError::Point { x: at.x, y: at.y, from, to, reason })
            }
        }
    }
}

impl Transform3d {
    /// Longitude and latitude of a point of the source, degrees.
    fn place_deg(&self, at: DVec3) -> Option<(f64, f64)> {
        let base = self.from.geographic_base().ok()?;
        Transform::new(&self.from, &base).ok()?.point(at.x, at.y).ok()
    }

    /// Moves many points at once, all of them or none.
    ///
    /// # Errors
    /// As [`Self::point`].
    pub fn points(&self, points: &mut [DVec3]) -> Result<(), CrsError> {
        let axis = |of: fn(&DVec3) -> f64| points.iter().map(of).collect::<Vec<f64>>();
        let (mut x, mut y, mut z) = (axis(|p| p.x), axis(|p| p.y), axis(|p| p.z));
        let is_done = self.operation.transform_coords(&mut x, &mut y, &mut z).is_ok();
        for (i, point) in points.iter_mut().enumerate() {
            let moved = DVec3::new(x[i], y[i], z[i]);
            // One by one where something is wrong, to say at which point and why.
            *point = if is_done && moved.is_finite() { moved } else { self.point(*point)? };
        }
        Ok(())
    }
}

fn missing(from: &Crs, to: &Crs, grids: &[grids::GridFile]) -> CrsError {
    let list: Vec<String> = grids.iter().map(ToString::to_string).collect();
    CrsError::MissingGrid { from: from.to_string(), to: to.to_string(), grids: list.join("; or ") }
}

/// Why there is no accurate operation between two definitions, if there is none. The `proj` crate cannot be asked: it
/// panics where PROJ finds nothing without calling that an error.
pub(super) fn why_impossible(from: &str, to: &str) -> Option<String> {
    static POSSIBLE: LazyLock<Kept<String, ()>> = LazyLock::new(|| Kept::up_to(MOST_KEPT));
    let ask = || why_impossible_anew(from, to).map_or(Ok(()), Err);
    let question = format!("{from}\n{to}");
    if question.len() > LONGEST_KEPT { ask().err() } else { POSSIBLE.get(&question, ask).err() }
}

fn why_impossible_anew(from: &str, to: &str) -> Option<String> {
    route_messages();
    let build = || -> Result<CoordTransform, gdal::errors::GdalError> {
        let mut options = CoordTransformOptions::new()?;
        options.set_ballpark_allowed(false)?;
        let (from, to) = (SpatialRef::from_definition(from)?, SpatialRef::from_definition(to)?);
        CoordTransform::new_with_options(&from, &to, &options)
    };
    build().err().map(|e| reason_of(&e))
}

/// Whether two definitions are of one CRS, whatever it is called.
pub(super) fn is_same(a: &str, b: &str) -> bool {
    route_messages();
    matches!((SpatialRef::from_definition(a), SpatialRef::from_definition(b)), (Ok(a), Ok(b)) if a == b)
}

/// The reason that GDAL gives, in words of people: where PROJ finds nothing it writes out both systems, around a null pointer.
fn reason_of(error: &gdal::errors::GdalError) -> String {
    let said = error.to_string();
    if said.contains("Cannot find coordinate operations") {
        "PROJ knows no way between their datums that is more than a guess".to_owned()
    } else {
        said
    }
}

/// Whether GDAL, and PROJ below it, can read a definition.
pub(super) fn is_known(definition: &str) -> bool {
    route_messages();
    is_definition(definition)
        && (is_address(definition) || is_strict(definition) && SpatialRef::from_definition(definition).is_ok())
}

/// OGC's addresses of CRS, which PROJ reads off: nobody is asked.
fn is_address(definition: &str) -> bool {
    ["http://www.opengis.net/", "https://www.opengis.net/", "http://opengis.net/", "https://opengis.net/"]
        .iter()
        .any(|start| definition.starts_with(start))
}

/// Whether a text is a definition by its looks. GDAL takes all others for the place of one: it fetches addresses and opens
/// files, among them such as `/vsicurl/…` and `/vsistdin/`, and a survey's file may hold any text.
fn is_definition(definition: &str) -> bool {
    let starts = |start: &str| definition.get(..start.len()).is_some_and(|found| found.eq_ignore_ascii_case(start));
    let is_word =
        |word: &str| !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
    let is_wkt = definition.split_once(['[', '(']).is_some_and(|(keyword, _)| is_word(keyword.trim_end()));
    let leads_away = ["/", "\\", ".", "DICT:", "ESRI::", "FILE:"].iter().any(|start| starts(start))
        || definition.contains("://")
        || definition.to_ascii_lowercase().contains("/vsi");
    let is_file = || Path::new(definition).exists();
    is_address(definition) || is_wkt || starts("+") || starts("{") || !(leads_away || is_file())
}

/// GDAL reads the number of `EPSG:25832 and more` and passes over the rest.
fn is_strict(definition: &str) -> bool {
    let Some((authority, codes)) = definition.split_once(':') else { return true };
    let is_number = |code: &str| !code.is_empty() && code.bytes().all(|byte| byte.is_ascii_digit());
    !authority.eq_ignore_ascii_case("EPSG") || codes.split('+').all(is_number)
}

/// Earth-centred coordinates and the local east, north, up at a place, on WGS 84.
pub struct Geocentric {
    geodetic_from_geocentric: Transform3d,
    geocentric_from_geodetic: Transform3d,
}

impl Geocentric {
    /// Prepares both directions.
    ///
    /// # Errors
    /// [`CrsError`] if PROJ's database lacks WGS 84, which no installation does.
    pub fn new() -> Result<Self, CrsError> {
        let (geodetic, geocentric) = (Crs::parse("EPSG:4979")?, Crs::parse("EPSG:4978")?);
        Ok(Self {
            geodetic_from_geocentric: Transform3d::new(&geocentric, &geodetic)?,
            geocentric_from_geodetic: Transform3d::new(&geodetic, &geocentric)?,
        })
    }

    /// Longitude, latitude (degrees) and ellipsoidal height (metres) of an earth-centred position (metres).
    ///
    /// # Errors
    /// [`CrsError::Point`] for positions near the earth's centre.
    pub fn geodetic(&self, geocentric: DVec3) -> Result<DVec3, CrsError> {
        self.geodetic_from_geocentric.point(geocentric)
    }

    /// Turns longitude, latitude (degrees) and ellipsoidal height (metres) into earth-centred positions.
    ///
    /// # Errors
    /// [`CrsError::Point`] for impossible latitudes.
    pub fn geocentric_points(&self, geodetic: &mut [DVec3]) -> Result<(), CrsError> {
        self.geocentric_from_geodetic.points(geodetic)
    }

    /// The earth-centred position of longitude, latitude (degrees), ellipsoidal height (metres).
    ///
    /// # Errors
    /// [`CrsError::Point`] for impossible latitudes.
    pub fn geocentric(&self, geodetic: DVec3) -> Result<DVec3, CrsError> {
        self.geocentric_from_geodetic.point(geodetic)
    }
}

/// Turns earth-centred directions into local east, north, up at a longitude and latitude in degrees.
#[must_use]
pub fn enu_from_geocentric(lon_deg: f64, lat_deg: f64) -> DMat3 {
    let (sin_lon, cos_lon) = lon_deg.to_radians().sin_cos();
    let (sin_lat, cos_lat) = lat_deg.to_radians().sin_cos();
    let east = DVec3::new(-sin_lon, cos_lon, 0.0);
    let north = DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
    let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
    DMat3::from_cols(east, north, up).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_datums_without_a_way_between_them_are_told_in_a_line() {
        let crs = |text: &str| Crs::parse(text).unwrap();
        let unknown = crs("+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs");
        let told = crate::crs::Transform::new(&crs("EPSG:25832"), &unknown).err().unwrap().to_string();
        let line = told.lines().next().unwrap();
        assert!(line.len() < 250 && line.contains("no way between their datums") && !line.contains("NULL"), "{line}");
    }

    #[test]
    fn a_definition_is_never_fetched_or_opened() {
        let server = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        server.set_nonblocking(true).unwrap();
        let place = server.local_addr().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("crs.txt");
        std::fs::write(&file, "EPSG:25832").unwrap();
        let file = file.display().to_string();
        let hostile = [
            format!("http://{place}/crs"),
            format!("HTTP://{place}/crs"),
            format!("hTTps://{place}/crs"),
            format!("http://{place}/crs[a(b"),
            format!("/vsicurl/http://{place}/crs"),
            format!("ESRI::HTTP://{place}/crs"),
            format!("ESRI::/vsicurl/http://{place}/crs"),
            format!("DICT:/vsicurl/http://{place}/crs,1"),
            "/vsistdin/".to_owned(),
            file.clone(),
            format!("ESRI::{file}"),
        ];
        for definition in hostile {
            assert!(!is_known(&definition), "{definition}");
            assert!(Crs::parse(&definition).is_err(), "{definition}");
            assert!(server.accept().is_err(), "{definition} was asked for");
        }
        for address in ["http://www.opengis.net/def/crs/EPSG/0/28992", "https://www.opengis.net/def/crs/EPSG/0/28992"] {
            assert_eq!(Crs::parse(address).unwrap().epsg(), Some(28992), "{address}");
        }
        for definition in ["urn:ogc:def:crs:EPSG::25832", "OGC:CRS84", "+proj=utm +zone=32 +type=crs"] {
            assert!(Crs::parse(definition).is_ok(), "{definition}");
        }
    }

    #[test]
    fn geocentric_coordinates_of_a_published_point() {
        // EPSG Guidance Note 7-2, "Geographic/Geocentric conversions": 53°48'33.820" N 2°7'46.380" E, 73.0 m.
        let geodetic = DVec3::new(2.0 + 7.0 / 60.0 + 46.38 / 3600.0, 53.0 + 48.0 / 60.0 + 33.82 / 3600.0, 73.0);
        let expected = DVec3::new(3_771_793.968, 140_253.342, 5_124_304.349);
        let geocentric = Geocentric::new().unwrap();
        let found = geocentric.geocentric(geodetic).unwrap();
        assert!((found - expected).length() < 2e-3, "{found}");
        let back = geocentric.geodetic(found).unwrap();
        assert!((back - geodetic).truncate().length() < 1e-9 && (back.z - 73.0).abs() < 1e-6, "{back}");
    }

    #[test]
    fn worked_example_of_the_ordnance_survey_guide() {
        // A guide to coordinate systems in Great Britain, annexe B: 52°39'27.2531" N 1°43'4.5177" E, 24.700 m on Airy.
        let from = Crs::parse("+proj=longlat +ellps=airy +type=crs").unwrap();
        let to = Crs::parse("+proj=geocent +ellps=airy +units=m +type=crs").unwrap();
        let at = DVec3::new(1.0 + 43.0 / 60.0 + 4.5177 / 3600.0, 52.0 + 39.0 / 60.0 + 27.2531 / 3600.0, 24.7);
        let found = Transform3d::new(&from, &to).unwrap().point(at).unwrap();
        let expected = DVec3::new(3_874_938.849, 116_218.624, 5_047_168.208);
        assert!((found - expected).length() < 2e-3, "{found}");
    }

    #[test]
    fn up_is_the_direction_of_greater_height() {
        let geocentric = Geocentric::new().unwrap();
        let (low, high) = (DVec3::new(4.5, 51.9, 0.0), DVec3::new(4.5, 51.9, 100.0));
        let up = geocentric.geocentric(high).unwrap() - geocentric.geocentric(low).unwrap();
        assert!((enu_from_geocentric(4.5, 51.9) * up - 100.0 * DVec3::Z).length() < 1e-6);
    }

    #[test]
    fn egm96_geoid_heights_as_published() {
        // NGA's EGM96 interpolation test points (INPUT.DAT/OUTPUT.DAT of the F477 program): N in metres.
        let published = [
            (269.779_155, 38.628_155, -31.628),
            (305.021_114, -14.621_217, -2.969),
            (102.448_729, 46.874_319, -43.575),
            (133.874_712, -23.617_446, 15.871),
            (359.9995, 38.625_473, 50.066),
            (0.0023, -0.466_744, 17.329),
        ];
        let from = Crs::parse("EPSG:4979").unwrap();
        let to = Crs::parse("EPSG:4326+5773").unwrap();
        let transform = Transform3d::new(&from, &to).unwrap();
        for (lon, lat, geoid) in published {
            let lon = if lon > 180.0 { lon - 360.0 } else { lon };
            let moved = transform.point(DVec3::new(lon, lat, 100.0)).unwrap();
            // The grid of 15' is interpolated bilinearly, by NGA's program with splines: some centimetres.
            assert!((100.0 - moved.z - geoid).abs() < 0.06, "{lon} {lat}: {} against {geoid}", 100.0 - moved.z);
        }
    }

    #[test]
    fn a_missing_grid_is_named_and_never_a_silent_no_op() {
        let from = Crs::parse("EPSG:4979").unwrap();
        let to = Crs::parse("EPSG:7415").unwrap();
        let outcome = Transform3d::new(&from, &to).and_then(|t| t.point(DVec3::new(4.35, 52.0, 50.0)));
        match outcome {
            // Where the grid is installed, heights in the Netherlands drop by 43 m (NAP, RDNAPTRANS documentation).
            Ok(moved) => assert!((50.0 - moved.z - 43.5).abs() < 2.0, "{moved}"),
            Err(e) => assert!(e.to_string().contains("nl_nsgi_nlgeo2018"), "{e}"),
        }
    }
}
