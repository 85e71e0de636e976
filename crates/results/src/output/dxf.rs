//! DXF (release 12, which every CAD reads): 3D faces of all solids, outlines of the footprints on the ground, and ids.
//!
//! Layers: `FOOTPRINTS`, `IDS`, and the faces by kind: `GROUND`, `ROOF`, `WALL`. Coordinates are those of the map, in metres. Edges
//! between triangles of one plane are invisible. GDAL writes outlines, but no 3D faces, so this is our own.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;

use geo::InteriorPoint as _;
use geo_types::LineString;
use glam::DVec3;

use super::grid::{OutputGrid, SCALE_M};
use super::mesh::{TriangleSolid, cannot_write, kind_name, one_line};
use super::{BuildingRecord, CityModel, OutputError, Overview, Records};
use sizeup_geo::files::write_whole_or;

/// Layers and their colours, numbers of `AutoCAD`'s index.
const LAYERS: [(&str, u8); 5] = [("FOOTPRINTS", 7), ("IDS", 8), ("GROUND", 9), ("ROOF", 1), ("WALL", 254)];
/// Height of the ids' letters, metres: legible in a plan of 1 : 500.
const LETTER_M: f64 = 1.0;
/// Cosine of the angle up to which two triangles are of one plane: the grid bends faces by 1 mm, 0.06° over a metre.
const SAME_PLANE: f64 = 0.999_999;
/// Which edge of a `3DFACE` is invisible, in the order of its corners; a triangle has its last corner twice.
const INVISIBLE: [u8; 3] = [1, 2, 8];

/// Writes `path` (`….dxf`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, the file system.
pub fn write<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    write_whole_or(path, |out| {
        let failed = |e| cannot_write(path, e);
        head(out, &one_line(&model.crs.to_string())).map_err(failed)?;
        model.records.visit(&mut |record| building(out, record, &grid).map_err(failed))?;
        out.write_all(b"0\nENDSEC\n0\nEOF\n").map_err(failed)
    })?;
    Ok(overview)
}

fn head(out: &mut dyn Write, crs: &str) -> io::Result<()> {
    write!(out, "999\nsizeup: metres in {}\n0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n0\nENDSEC\n", ascii(crs))?;
    write!(out, "0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nLAYER\n70\n{}\n", LAYERS.len())?;
    for (name, colour) in LAYERS {
        write!(out, "0\nLAYER\n2\n{name}\n70\n0\n62\n{colour}\n6\nCONTINUOUS\n")?;
    }
    out.write_all(b"0\nENDTAB\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n")
}

fn building(out: &mut dyn Write, record: &BuildingRecord, grid: &OutputGrid) -> io::Result<()> {
    let ground_m = record.base_z_m.or(record.ground_z_m).unwrap_or(0.0);
    if let Some(footprint) = &record.footprint {
        for ring in std::iter::once(footprint.exterior()).chain(footprint.interiors()) {
            outline(out, ring, ground_m)?;
        }
        if let Some(at) = footprint.interior_point() {
            let id = ascii(&one_line(&record.id));
            write!(out, "0\nTEXT\n8\nIDS\n{}40\n{LETTER_M}\n1\n{id}\n", corner(1, [at.x(), at.y(), ground_m]))?;
        }
    }
    TriangleSolid::of(record, grid).map_or(Ok(()), |solid| faces(out, &solid, grid))
}

/// A closed line.
fn outline(out: &mut dyn Write, ring: &LineString<f64>, z_m: f64) -> io::Result<()> {
    // 66: corners follow; 70, 1: closed.
    write!(out, "0\nPOLYLINE\n8\nFOOTPRINTS\n66\n1\n70\n1\n{}", corner(1, [0.0, 0.0, z_m]))?;
    for at in ring.coords().skip(1) {
        write!(out, "0\nVERTEX\n8\nFOOTPRINTS\n{}", corner(1, [at.x, at.y, z_m]))?;
    }
    out.write_all(b"0\nSEQEND\n8\nFOOTPRINTS\n")
}

fn faces(out: &mut dyn Write, solid: &TriangleSolid, grid: &OutputGrid) -> io::Result<()> {
    let normal = |corners: &[[i64; 3]; 3]| {
        let [a, b, c] = corners.map(|p| DVec3::from_array(p.map(|step| step as f64)));
        (b - a).cross(c - a).normalize_or_zero()
    };
    let mut at_edge: HashMap<[[i64; 3]; 2], Vec<DVec3>> = HashMap::new();
    for (_, corners) in &solid.triangles {
        for edge in edges(corners) {
            at_edge.entry(edge).or_default().push(normal(corners));
        }
    }
    let is_flat = |edge: [[i64; 3]; 2]| matches!(at_edge[&edge].as_slice(), [a, b] if a.dot(*b) > SAME_PLANE);
    for (kind, corners) in &solid.triangles {
        let hidden: u8 =
            edges(corners).into_iter().zip(INVISIBLE).filter(|(edge, _)| is_flat(*edge)).map(|(_, bit)| bit).sum();
        let layer = kind_name(*kind).to_uppercase();
        write!(out, "0\n3DFACE\n8\n{layer}\n")?;
        let [a, b, c] = corners.map(|corner| grid.metres(corner));
        for (i, at) in (1..).zip([a, b, c, c]) {
            out.write_all(corner(i, at).as_bytes())?;
        }
        write!(out, "70\n{hidden}\n")?;
    }
    Ok(())
}

/// The edges of a triangle, each the same whichever way it is gone.
fn edges([a, b, c]: &[[i64; 3]; 3]) -> [[[i64; 3]; 2]; 3] {
    [[*a, *b], [*b, *c], [*c, *a]].map(|[from, to]| if from < to { [from, to] } else { [to, from] })
}

/// The number-th corner of an entity.
fn corner(number: u8, [x, y, z]: [f64; 3]) -> String {
    let n = number - 1;
    format!("1{n}\n{x:.3}\n2{n}\n{y:.3}\n3{n}\n{z:.3}\n")
}

/// A text in the letters of release 12; others by their numbers, as CAD writes them.
fn ascii(text: &str) -> String {
    let mut plain = String::new();
    for letter in text.chars() {
        if letter.is_ascii() {
            plain.push(letter);
        } else {
            let _ = write!(plain, "\\U+{:04X}", u32::from(letter));
        }
    }
    plain
}
