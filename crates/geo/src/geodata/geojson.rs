//! `GeoJSON` ([RFC 7946](https://www.rfc-editor.org/rfc/rfc7946)): features in longitude and latitude, for web maps and for
//! programs without GDAL.

use std::io;
use std::path::Path;

pub use geojson::{Feature, FeatureCollection, Geometry, GeometryValue, JsonObject, Position};

use super::antimeridian;
use crate::crs::{Crs, CrsError, Transform};
use crate::files::{FileError, write_whole_or};

/// Decimals of a degree: 1e-9° is 0.1 mm.
const DEGREE_DECIMALS: f64 = 1e9;
/// Decimals of a height in metres.
const HEIGHT_DECIMALS: f64 = 1e4;

/// Which way a ring runs, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Winding {
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
        let (lon_deg, lat_deg) = self.0.point(place[0], place[1])?;
        Ok(match place.get(2) {
            Some(z_m) => rounded(&Position::from([lon_deg, lat_deg, *z_m])),
            None => rounded(&Position::from([lon_deg, lat_deg])),
        })
    }

    /// Places one after the other, as a line; cut at 180°, as the standard wants it.
    ///
    /// # Errors
    /// [`CrsError`] outside of the CRS.
    pub fn line<P: AsRef<[f64]>>(&self, places: impl IntoIterator<Item = P>) -> Result<GeometryValue, CrsError> {
        let mut line = self.positions(places)?;
        let near_deg = line.first().map_or(0.0, |at| at[0]);
        antimeridian::run_on(&mut line, near_deg);
        let mut pieces = antimeridian::cut_line(line).into_iter().map(|piece| piece.iter().map(rounded).collect());
        Ok(match (pieces.next(), pieces.next()) {
            (Some(first), Some(second)) => {
                let coordinates = [first, second].into_iter().chain(pieces).collect();
                GeometryValue::MultiLineString { coordinates }
            }
            (only, _) => GeometryValue::LineString { coordinates: only.unwrap_or_default() },
        })
    }

    /// A polygon without holes by its ring, which need not be closed; cut at 180°, as the standard wants it.
    ///
    /// # Errors
    /// [`CrsError`] outside of the CRS.
    pub fn area<P: AsRef<[f64]>>(&self, places: impl IntoIterator<Item = P>) -> Result<GeometryValue, CrsError> {
        Ok(of_parts(cut(vec![self.ring(places, Winding::Counterclockwise, None)?])))
    }

    fn positions<P: AsRef<[f64]>>(&self, places: impl IntoIterator<Item = P>) -> Result<Vec<Position>, CrsError> {
        places.into_iter().map(|place| self.position(place.as_ref())).collect()
    }

    /// A ring, closed, that runs as the standard wants it. Its longitudes run on across 180°, and begin near one that is given.
    fn ring<P: AsRef<[f64]>>(
        &self,
        places: impl IntoIterator<Item = P>,
        winding: Winding,
        near_deg: Option<f64>,
    ) -> Result<Vec<Position>, CrsError> {
        let mut ring = self.positions(places)?;
        if ring.first() != ring.last() {
            ring.extend(ring.first().cloned());
        }
        let own_deg = ring.first().map_or(0.0, |at| at[0]);
        antimeridian::run_on(&mut ring, near_deg.unwrap_or(own_deg));
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
            Shape::LineString(line) => self.line(line.coords().map(|c| [c.x, c.y]))?,
            Shape::Polygon(polygon) => self.polygon(polygon)?,
            Shape::MultiPolygon(parts) => {
                let parts = parts.iter().map(|part| self.parts(part)).collect::<Result<Vec<_>, CrsError>>()?;
                GeometryValue::MultiPolygon { coordinates: parts.into_iter().flatten().collect() }
            }
            Shape::GeometryCollection(parts) => {
                GeometryValue::GeometryCollection { geometries: parts.iter().map(part).collect::<Result<_, _>>()? }
            }
            // No file gives any other.
            _ => GeometryValue::GeometryCollection { geometries: Vec::new() },
        })
    }

    /// A polygon of the map; cut at 180°, as the standard wants it.
    ///
    /// # Errors
    /// [`CrsError`] outside of the CRS.
    pub fn polygon(&self, polygon: &geo_types::Polygon<f64>) -> Result<GeometryValue, CrsError> {
        Ok(of_parts(self.parts(polygon)?))
    }

    /// The polygons that one of the map becomes, each its rings.
    fn parts(&self, polygon: &geo_types::Polygon<f64>) -> Result<Vec<Vec<Vec<Position>>>, CrsError> {
        let ring = |ring: &geo_types::LineString<f64>, winding, near_deg| {
            self.ring(ring.coords().map(|c| [c.x, c.y]), winding, near_deg)
        };
        let outer = ring(polygon.exterior(), Winding::Counterclockwise, None)?;
        let near_deg = outer.first().map(|at| at[0]);
        let holes = polygon.interiors().iter().map(|hole| ring(hole, Winding::Clockwise, near_deg));
        let rings = std::iter::once(Ok(outer)).chain(holes).collect::<Result<_, CrsError>>()?;
        Ok(cut(rings))
    }
}

/// Without digits that nobody needs.
fn rounded(at: &Position) -> Position {
    let to = |value: f64, decimals: f64| (value * decimals).round() / decimals;
    let (lon_deg, lat_deg) = (to(at[0], DEGREE_DECIMALS), to(at[1], DEGREE_DECIMALS));
    match at.as_slice().get(2) {
        Some(z_m) => Position::from([lon_deg, lat_deg, to(*z_m, HEIGHT_DECIMALS)]),
        None => Position::from([lon_deg, lat_deg]),
    }
}

/// A polygon whose longitudes run on, cut at 180°.
fn cut(rings: Vec<Vec<Position>>) -> Vec<Vec<Vec<Position>>> {
    let part = |part: Vec<Vec<Position>>| part.iter().map(|ring| ring.iter().map(rounded).collect()).collect();
    antimeridian::cut_polygon(rings).into_iter().map(part).collect()
}

fn of_parts(mut parts: Vec<Vec<Vec<Position>>>) -> GeometryValue {
    match (parts.pop(), parts.is_empty()) {
        (Some(only), true) => GeometryValue::Polygon { coordinates: only },
        (last, _) => GeometryValue::MultiPolygon { coordinates: parts.into_iter().chain(last).collect() },
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
    fn a_building_across_180_is_two_polygons_that_meet_there() {
        // Pacific Mercator around 150° E: half the circumference of the ellipsoid at 30° of longitude from it is 180°.
        let lonlat = LonLat::wgs84(&Crs::parse("EPSG:3832").unwrap()).unwrap();
        let x = 6_378_137.0 * 30_f64.to_radians();
        let house = polygon![(x: x - 5.0, y: 0.0), (x: x + 5.0, y: 0.0), (x: x + 5.0, y: 8.0), (x: x - 5.0, y: 8.0)];
        let GeometryValue::MultiPolygon { coordinates } = lonlat.polygon(&house).unwrap() else { panic!() };
        let limits = |part: &Vec<Vec<Position>>| {
            part[0].iter().fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at[0]), high.max(at[0])))
        };
        let [west, east] = [limits(&coordinates[0]), limits(&coordinates[1])];
        assert_eq!((coordinates.len(), west.1, east.0), (2, 180.0, -180.0));
        assert!(west.0 > 179.9999 && east.1 < -179.9999, "{west:?} {east:?}");
        let twice_area = |ring: &Vec<Position>| -> f64 {
            ring.windows(2)
                .map(|pair| {
                    (pair[0][0] - ring[0][0]) * (pair[1][1] - ring[0][1])
                        - (pair[1][0] - ring[0][0]) * (pair[0][1] - ring[0][1])
                })
                .sum()
        };
        assert!(coordinates.iter().all(|part| twice_area(&part[0]) > 0.0), "counter-clockwise");
        let way = [[x - 5.0, 0.0, 3.0], [x + 5.0, 0.0, 3.0]];
        assert!(matches!(lonlat.line(way).unwrap(), GeometryValue::MultiLineString { .. }));
        assert!(matches!(lonlat.line([[x - 5.0, 0.0], [x - 4.0, 0.0]]).unwrap(), GeometryValue::LineString { .. }));
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
