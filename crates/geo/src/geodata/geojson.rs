//! `GeoJSON` ([RFC 7946](https://www.rfc-editor.org/rfc/rfc7946)): features in longitude and latitude, for web maps and for
//! programs without GDAL.

use std::io;
use std::path::Path;

pub use geojson::{Feature, FeatureCollection, Geometry, GeometryValue, JsonObject, Position};

use crate::crs::{Crs, CrsError, Transform};
use crate::files::{FileError, write_whole_or};

/// Decimals of a degree: 1e-9° is 0.1 mm.
const DEGREE_DECIMALS: f64 = 1e9;
/// Decimals of a height in metres.
const HEIGHT_DECIMALS: f64 = 1e4;

/// Which way a ring runs, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Winding {
    /// Winding of outer rings.
    Counterclockwise,
    /// Winding of holes.
    Clockwise,
}

/// The way from a map to longitude and latitude.
pub struct LonLat(Transform);

impl LonLat {
    /// From a map to WGS 84, which the standard demands.
    ///
    /// # Errors
    /// [`CrsError::NoTransformation`] where there is no accurate way.
    pub fn wgs84(map: &Crs) -> Result<Self, CrsError> {
        Self::new(map, &Crs::parse("EPSG:4326")?)
    }

    /// From a map to another geographic CRS.
    ///
    /// # Errors
    /// [`CrsError::NoTransformation`] where there is no accurate way.
    pub fn new(map: &Crs, geographic: &Crs) -> Result<Self, CrsError> {
        Transform::new(map, geographic).map(Self)
    }

    /// A place of the map, metres; with a height where it has three coordinates.
    ///
    /// # Errors
    /// [`CrsError`] outside of the CRS.
    pub fn position(&self, place: &[f64]) -> Result<Position, CrsError> {
        let rounded = |value: f64, decimals: f64| (value * decimals).round() / decimals;
        let (lon_deg, lat_deg) = self.0.point(place[0], place[1])?;
        let (lon_deg, lat_deg) = (rounded(lon_deg, DEGREE_DECIMALS), rounded(lat_deg, DEGREE_DECIMALS));
        Ok(match place.get(2) {
            Some(z_m) => Position::from(vec![lon_deg, lat_deg, rounded(*z_m, HEIGHT_DECIMALS)]),
            None => Position::from([lon_deg, lat_deg]),
        })
    }

    /// Places one after the other.
    ///
    /// # Errors
    /// [`CrsError`] outside of the CRS.
    pub fn line<P: AsRef<[f64]>>(&self, places: impl IntoIterator<Item = P>) -> Result<Vec<Position>, CrsError> {
        places.into_iter().map(|place| self.position(place.as_ref())).collect()
    }

    /// A ring, closed, that runs as the standard wants it.
    ///
    /// # Errors
    /// [`CrsError`] outside of the CRS.
    pub fn ring<P: AsRef<[f64]>>(
        &self,
        places: impl IntoIterator<Item = P>,
        winding: Winding,
    ) -> Result<Vec<Position>, CrsError> {
        let mut ring = self.line(places)?;
        if ring.first() != ring.last() {
            ring.extend(ring.first().cloned());
        }
        let corner = |i: usize| [ring[i][0] - ring[0][0], ring[i][1] - ring[0][1]];
        let twice_area: f64 = (1..ring.len())
            .map(|i| {
                let ([x0, y0], [x1, y1]) = (corner(i - 1), corner(i));
                x0 * y1 - x1 * y0
            })
            .sum();
        if (twice_area > 0.0) != (winding == Winding::Counterclockwise) {
            ring.reverse();
        }
        Ok(ring)
    }

    /// A shape of the map: points, lines, polygons, and collections of such.
    ///
    /// # Errors
    /// [`CrsError`] outside of the CRS.
    pub fn geometry(&self, shape: &geo_types::Geometry<f64>) -> Result<GeometryValue, CrsError> {
        use geo_types::Geometry as Shape;
        let part = |part: &Shape<f64>| self.geometry(part).map(Geometry::from);
        Ok(match shape {
            Shape::Point(point) => GeometryValue::Point { coordinates: self.position(&[point.x(), point.y()])? },
            Shape::LineString(line) => {
                GeometryValue::LineString { coordinates: self.line(line.coords().map(|c| [c.x, c.y]))? }
            }
            Shape::Polygon(polygon) => self.polygon(polygon)?,
            Shape::MultiPolygon(parts) => {
                let rings = parts.iter().map(|part| match self.polygon(part)? {
                    GeometryValue::Polygon { coordinates } => Ok(coordinates),
                    _ => Ok(Vec::new()),
                });
                GeometryValue::MultiPolygon { coordinates: rings.collect::<Result<_, CrsError>>()? }
            }
            Shape::GeometryCollection(parts) => {
                GeometryValue::GeometryCollection { geometries: parts.iter().map(part).collect::<Result<_, _>>()? }
            }
            // No file gives any other.
            _ => GeometryValue::GeometryCollection { geometries: Vec::new() },
        })
    }

    /// A polygon of the map.
    ///
    /// # Errors
    /// [`CrsError`] outside of the CRS.
    pub fn polygon(&self, polygon: &geo_types::Polygon<f64>) -> Result<GeometryValue, CrsError> {
        let ring = |ring: &geo_types::LineString<f64>, winding| self.ring(ring.coords().map(|c| [c.x, c.y]), winding);
        let outer = std::iter::once(ring(polygon.exterior(), Winding::Counterclockwise));
        let holes = polygon.interiors().iter().map(|hole| ring(hole, Winding::Clockwise));
        Ok(GeometryValue::Polygon { coordinates: outer.chain(holes).collect::<Result<_, _>>()? })
    }
}

/// A feature with an id or none, and its attributes.
#[must_use]
pub fn feature(id: Option<&str>, geometry: Option<GeometryValue>, properties: JsonObject) -> Feature {
    Feature {
        bbox: None,
        geometry: geometry.map(Geometry::from),
        id: id.map(|id| geojson::feature::Id::String(id.to_owned())),
        properties: Some(properties),
        foreign_members: None,
    }
}

/// Writes a collection whole or not at all, feature by feature as `fill` hands them over; `members` come before the
/// features, as the name of a layer does.
///
/// # Errors
/// The error of `fill`, or [`FileError`] where it cannot be written.
pub fn write<E: From<FileError>>(
    path: &Path,
    members: &JsonObject,
    fill: impl FnOnce(&mut dyn FnMut(&Feature) -> Result<(), E>) -> Result<(), E>,
) -> Result<(), E> {
    let failed = |e: geojson::Error| E::from(FileError::on("cannot write", path)(io::Error::other(e)));
    write_whole_or(path, |out| {
        let mut writer = geojson::FeatureWriter::from_writer(out);
        members.iter().try_for_each(|(name, value)| writer.write_foreign_member(name, value)).map_err(failed)?;
        fill(&mut |feature| writer.write_feature(feature).map_err(failed))?;
        writer.finish().map_err(failed)
    })
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;

    #[test]
    fn places_are_those_of_proj_and_rings_run_as_the_standard_wants() {
        let lonlat = LonLat::wgs84(&Crs::parse("EPSG:25832").unwrap()).unwrap();
        // The central meridian's easting is 500 km by definition; `cs2cs EPSG:25832 EPSG:4326` gives the latitude.
        assert_eq!(lonlat.position(&[500_000.0, 0.0, 7.00004]).unwrap().as_slice(), [9.0, 0.0, 7.0]);
        let clockwise = polygon!(
            exterior: [(x: 5e5, y: 5e6), (x: 5e5, y: 5.001e6), (x: 5.01e5, y: 5.001e6), (x: 5.01e5, y: 5e6)],
            interiors: [[(x: 5.002e5, y: 5.0002e6), (x: 5.004e5, y: 5.0002e6), (x: 5.004e5, y: 5.0004e6)]]
        );
        let GeometryValue::Polygon { coordinates } = lonlat.polygon(&clockwise).unwrap() else { panic!() };
        let twice_area = |ring: &Vec<Position>| -> f64 {
            assert_eq!(ring.first(), ring.last());
            ring.windows(2).map(|pair| (pair[0][0] - 9.0) * pair[1][1] - (pair[1][0] - 9.0) * pair[0][1]).sum()
        };
        assert!(twice_area(&coordinates[0]) > 0.0 && twice_area(&coordinates[1]) < 0.0);
    }

    #[test]
    fn a_collection_is_whole_or_the_old_one_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.geojson");
        let mut members = JsonObject::new();
        members.insert("name".to_owned(), "a".into());
        let one = feature(Some("b1"), None, JsonObject::new());
        write::<FileError>(&path, &members, |push| push(&one)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let read: FeatureCollection = text.parse().unwrap();
        assert_eq!((read.features, read.foreign_members), (vec![one], Some(members.clone())));
        let no_more = |_: &mut dyn FnMut(&Feature) -> Result<(), FileError>| {
            Err(FileError::on("cannot read", Path::new("x"))(io::Error::other("no more")))
        };
        assert!(write(&path, &members, no_more).is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        write::<FileError>(&path, &JsonObject::new(), |_| Ok(())).unwrap();
        let none: FeatureCollection = std::fs::read_to_string(&path).unwrap().parse().unwrap();
        assert!(none.features.is_empty());
    }
}
