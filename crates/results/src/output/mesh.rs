//! Triangles of all solids: OBJ for modelling, STL for printers, DXF for CAD ([`super::dxf`]).
//!
//! A solid is the one with the roof (LOD 2.0) where there is one, else the block. Triangles have all corners of their faces, so each
//! solid is closed. OBJ and STL count from a corner of the city, as they have no CRS and their readers few digits.

use std::collections::HashMap;
use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use super::grid::{OutputGrid, SCALE_M};
use super::prism::{FaceKind, GridFace, MIN_THICKNESS_M, SnappedPrism};
use super::roof_solid::{self, Detail};
use super::triangles::keeping_corners;
use super::{BuildingRecord, CityModel, OutputError, Overview, Records};
use sizeup_geo::files::{FileError, write_whole_or};

/// Triangles of a building's solid, outwards, on the grid.
pub(super) struct TriangleSolid {
    /// Kind and corners, counter-clockwise seen from outside.
    pub triangles: Vec<(FaceKind, [[i64; 3]; 3])>,
    /// Level of its ground face.
    pub base: i64,
}

impl TriangleSolid {
    /// The solid of a building; `None` where it has none.
    pub fn of(record: &BuildingRecord, grid: &OutputGrid) -> Option<Self> {
        let block = SnappedPrism::of(record, grid, MIN_THICKNESS_M).ok()?;
        let faces = roof_solid::faces(record, &block, grid, Detail::Slopes).unwrap_or_else(|| block.faces());
        let three =
            |face: GridFace| Some((face.surface, <[[i64; 3]; 3]>::try_from(face.rings.into_iter().next()?).ok()?));
        let of_face = |face: &GridFace| keeping_corners(face).into_iter().flatten().filter_map(three);
        Some(Self { triangles: faces.iter().flat_map(of_face).collect(), base: block.base() })
    }
}

/// Writes `path` (`….obj`): an object per building, its triangles in the groups `ground`, `roof` and `wall`; x east, y north, z up.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, the file system.
pub fn write_obj<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    let [x, y, z] = grid.origin_m;
    write_whole_or(path, |out| {
        let failed = |e| cannot_write(path, e);
        writeln!(
            out,
            "# sizeup {}: buildings in metres, x east, y north, z up\n# add {x} {y} {z} for coordinates in {}",
            model.lineage.version,
            one_line(&model.crs.to_string())
        )
        .map_err(failed)?;
        let mut n_before = 0;
        model.records.visit(&mut |record| match TriangleSolid::of(record, &grid) {
            Some(solid) => obj(out, &record.id, &solid, &mut n_before).map_err(failed),
            None => Ok(()),
        })
    })?;
    Ok(overview)
}

/// One object. `n_before` counts the corners of those before it.
fn obj(out: &mut dyn Write, id: &str, solid: &TriangleSolid, n_before: &mut usize) -> io::Result<()> {
    writeln!(out, "o {}", one_line(id))?;
    let mut known: HashMap<[i64; 3], usize> = HashMap::new();
    let corners = solid.triangles.iter().flat_map(|(_, corners)| corners);
    for corner in corners {
        let n = *n_before + known.len() + 1;
        if !known.contains_key(corner) {
            known.insert(*corner, n);
            let [x, y, z] = corner.map(|step| step as f64 * SCALE_M);
            writeln!(out, "v {x:.3} {y:.3} {z:.3}")?;
        }
    }
    *n_before += known.len();
    let mut group = None;
    for (kind, corners) in &solid.triangles {
        if group != Some(*kind) {
            group = Some(*kind);
            writeln!(out, "g {}", kind_name(*kind))?;
        }
        let [a, b, c] = corners.map(|corner| known[&corner]);
        writeln!(out, "f {a} {b} {c}")?;
    }
    Ok(())
}

/// Writes `path` (`….stl`, binary) for printers: all solids reach down to the lowest ground of the city, so that they stand on one
/// plate. A unit is a metre; printers take it for a millimetre, so they print at 1 : 1000.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, the file system.
pub fn write_stl<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    /// Bytes of the head, which readers pass over.
    const HEAD: usize = 80;
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    let lowest = overview.extent.map_or(0, |extent| grid.level(extent.min_m[2]));
    let mut n_triangles = 0_u32;
    model.records.visit(&mut |record| {
        n_triangles += TriangleSolid::of(record, &grid).map_or(0, |solid| solid.triangles.len() as u32);
        Ok(())
    })?;
    write_whole_or(path, |out| {
        let failed = |e| cannot_write(path, e);
        let mut head = format!("sizeup {}: metres", model.lineage.version).into_bytes();
        head.resize(HEAD, b' ');
        out.write_all(&head).and_then(|()| out.write_all(&n_triangles.to_le_bytes())).map_err(failed)?;
        model.records.visit(&mut |record| match TriangleSolid::of(record, &grid) {
            Some(solid) => stl(out, &solid, lowest).map_err(failed),
            None => Ok(()),
        })
    })?;
    Ok(overview)
}

fn stl(out: &mut dyn Write, solid: &TriangleSolid, lowest: i64) -> io::Result<()> {
    for (_, corners) in &solid.triangles {
        let down = |[x, y, z]: [i64; 3]| [x, y, if z == solid.base { lowest } else { z }];
        let at = |corner: [i64; 3]| DVec3::from_array(down(corner).map(|step| step as f64 * SCALE_M));
        let [a, b, c] = corners.map(at);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let above_lowest = |p: DVec3| p - DVec3::Z * (lowest as f64 * SCALE_M);
        for value in [normal, above_lowest(a), above_lowest(b), above_lowest(c)].iter().flat_map(DVec3::to_array) {
            out.write_all(&(value as f32).to_le_bytes())?;
        }
        out.write_all(&[0; 2])?;
    }
    Ok(())
}

pub(super) fn kind_name(kind: FaceKind) -> &'static str {
    match kind {
        FaceKind::Ground => "ground",
        FaceKind::Roof => "roof",
        FaceKind::Wall => "wall",
    }
}

/// A text without line breaks.
pub(super) fn one_line(text: &str) -> String {
    text.split(['\n', '\r']).collect::<Vec<_>>().join(" ")
}

pub(super) fn cannot_write(path: &Path, error: io::Error) -> OutputError {
    FileError::on("cannot write", path)(error).into()
}
