//! ISO well-known binary, little-endian (OGC 06-103r4, 8.2): the few shapes that are written here.

use geo_types::{LineString, MultiPolygon, Polygon};

const LITTLE_ENDIAN: u8 = 1;
const POINT: u32 = 1;
const POLYGON: u32 = 3;
const MULTI_POLYGON: u32 = 6;
/// Added to a type whose coordinates have a z.
const WITH_Z: u32 = 1000;

/// A point with x and y as WKB.
#[must_use]
pub fn point([x, y]: [f64; 2]) -> Vec<u8> {
    let mut wkb = header(POINT);
    coordinates(&mut wkb, &[x, y]);
    wkb
}

/// A point with x, y and z as WKB.
#[must_use]
pub fn point_z(position: [f64; 3]) -> Vec<u8> {
    let mut wkb = header(POINT + WITH_Z);
    coordinates(&mut wkb, &position);
    wkb
}

/// A 2D polygon, rings closed.
#[must_use]
pub fn polygon(polygon: &Polygon<f64>) -> Vec<u8> {
    let mut wkb = header(POLYGON);
    count(&mut wkb, 1 + polygon.interiors().len());
    let ring = |wkb: &mut Vec<u8>, ring: &LineString<f64>| {
        count(wkb, ring.0.len());
        ring.coords().for_each(|p| coordinates(wkb, &[p.x, p.y]));
    };
    ring(&mut wkb, polygon.exterior());
    polygon.interiors().iter().for_each(|hole| ring(&mut wkb, hole));
    wkb
}

/// A 2D multipolygon, rings closed.
#[must_use]
pub fn multi_polygon(polygons: &MultiPolygon<f64>) -> Vec<u8> {
    let mut wkb = header(MULTI_POLYGON);
    count(&mut wkb, polygons.0.len());
    polygons.iter().for_each(|part| wkb.extend(polygon(part)));
    wkb
}

/// A 3D multipolygon from faces of open rings.
#[must_use]
pub fn multi_polygon_z(faces: &[Vec<Vec<[f64; 3]>>]) -> Vec<u8> {
    let mut wkb = header(MULTI_POLYGON + WITH_Z);
    count(&mut wkb, faces.len());
    for rings in faces {
        wkb.extend(header(POLYGON + WITH_Z));
        count(&mut wkb, rings.len());
        for ring in rings {
            count(&mut wkb, ring.len() + 1);
            ring.iter().chain(ring.first()).for_each(|p| coordinates(&mut wkb, p));
        }
    }
    wkb
}

fn header(kind: u32) -> Vec<u8> {
    let mut wkb = vec![LITTLE_ENDIAN];
    wkb.extend(kind.to_le_bytes());
    wkb
}

fn count(wkb: &mut Vec<u8>, n: usize) {
    wkb.extend((n as u32).to_le_bytes());
}

fn coordinates(wkb: &mut Vec<u8>, values: &[f64]) {
    wkb.extend(values.iter().flat_map(|v| v.to_le_bytes()));
}
