//! Triangles of all solids: OBJ for modelling, STL for printers, DXF for CAD ([`super::dxf`]).
//!
//! A solid is the one with the roof (LOD 2.0) where there is one, else the block. Triangles have all corners of their faces, so each
//! solid is closed. OBJ and STL count from a corner of the city, as they have no CRS and their readers few digits.
//!
//! An OBJ of a textured city has its materials in a file beside it (`….mtl`) and the pictures in a folder (`…-textures`).

use std::collections::{BTreeSet, HashMap};
use std::fs;
use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use super::grid::{OutputGrid, SCALE_M};
use super::picture::colour::Rgb;
use super::prism::{FaceKind, GridFace, MIN_THICKNESS_M, SnappedPrism};
use super::roof_solid::{self, Detail};
use super::textured::{FacePaint, TexturedCity};
use super::triangles::keeping_corners;
use super::{BuildingRecord, CityModel, OutputError, Overview, Records};
use sizeup_geo::files::{FileError, write_whole, write_whole_or, write_whole_unflushed};

/// Triangles of a building's solid, outwards, on the grid.
#[derive(Debug)]
pub struct TriangleSolid {
    /// Kind and corners, counter-clockwise seen from outside.
    pub triangles: Vec<(FaceKind, [[i64; 3]; 3])>,
    /// Level of its ground face.
    pub base: i64,
}

impl TriangleSolid {
    /// The solid of a building; `None` where it has none.
    #[must_use]
    pub fn of(record: &BuildingRecord, grid: &OutputGrid) -> Option<Self> {
        let block = SnappedPrism::of(record, grid, MIN_THICKNESS_M).ok()?;
        let faces = roof_solid::faces(record, &block, grid, Detail::Slopes).unwrap_or_else(|| block.faces());
        let of_face = |face: &GridFace| triangles_of(face).map(|corners| (face.surface, corners)).collect::<Vec<_>>();
        Some(Self { triangles: faces.iter().flat_map(of_face).collect(), base: block.base() })
    }
}

fn triangles_of(face: &GridFace) -> impl Iterator<Item = [[i64; 3]; 3]> + use<> {
    let three = |face: GridFace| <[[i64; 3]; 3]>::try_from(face.rings.into_iter().next()?).ok();
    keeping_corners(face).into_iter().flatten().filter_map(three)
}

/// Writes `path` (`….obj`): an object per building, its triangles in the groups `ground`, `roof` and `wall`; x east, y north, z up.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, the file system.
pub fn write_obj<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    write_any_obj(path, model, None)
}

/// As [`write_obj`], with the textures of a city: its materials are beside it, in a file of the same name (`….mtl`), and the pictures in the
/// folder `…-textures`.
///
/// # Errors
/// As [`write_obj`], and for pictures that cannot be read.
pub fn write_textured_obj<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    textured: &TexturedCity,
) -> Result<Overview, OutputError> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let grid = Overview::of(model.records)?.grid(SCALE_M)?;
    let (mut pages, mut colours) = (BTreeSet::new(), BTreeSet::new());
    model.records.visit(&mut |record| {
        let solid = PaintedSolid::of(record, &grid, textured)?;
        for paint in solid.map(|solid| solid.paints).into_iter().flatten() {
            match paint {
                FacePaint::Picture { page, .. } => pages.insert(page),
                FacePaint::Plain(colour) => colours.insert(colour),
            };
        }
        Ok(())
    })?;
    let folder = path.with_file_name(format!("{stem}-textures"));
    fs::create_dir_all(&folder).map_err(FileError::on("cannot write", &folder))?;
    for page in &pages {
        let from = &textured.pictures[*page];
        let bytes = fs::read(from).map_err(FileError::on("cannot read", from))?;
        write_whole_unflushed(&folder.join(picture_name(*page)), |out| out.write_all(&bytes))?;
    }
    let of_page =
        |page: &usize| format!("newmtl photos-{page}\nKd 1 1 1\nmap_Kd {stem}-textures/{}\n", picture_name(*page));
    let of_colour = |colour: &Rgb| {
        let [r, g, b] = colour.map(|v| f64::from(v) / 255.0);
        format!("newmtl {}\nKd {r:.4} {g:.4} {b:.4}\n", plain_name(*colour))
    };
    let text: String = pages.iter().map(of_page).chain(colours.iter().map(of_colour)).collect();
    write_whole(&path.with_extension("mtl"), |out| out.write_all(text.as_bytes()))?;
    write_any_obj(path, model, Some((textured, &one_line(&format!("{stem}.mtl")))))
}

fn picture_name(page: usize) -> String {
    format!("atlas-{page}.jpg")
}

fn plain_name([r, g, b]: Rgb) -> String {
    format!("plain-{r:02x}{g:02x}{b:02x}")
}

fn write_any_obj<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    textured: Option<(&TexturedCity, &str)>,
) -> Result<Overview, OutputError> {
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
        if let Some((_, materials)) = textured {
            writeln!(out, "mtllib {materials}").map_err(failed)?;
        }
        let (mut n_before, mut n_places) = (0, 0);
        model.records.visit(&mut |record| {
            let painted = textured.map(|(textured, _)| PaintedSolid::of(record, &grid, textured)).transpose()?;
            match (painted.flatten(), TriangleSolid::of(record, &grid)) {
                (Some(painted), _) => {
                    painted_obj(out, &record.id, &painted, [&mut n_before, &mut n_places]).map_err(failed)
                }
                (None, Some(solid)) => obj(out, &record.id, &solid, &mut n_before).map_err(failed),
                (None, None) => Ok(()),
            }
        })
    })?;
    Ok(overview)
}

/// The faces of a building's solid with their looks.
struct PaintedSolid {
    faces: Vec<GridFace>,
    paints: Vec<FacePaint>,
}

impl PaintedSolid {
    fn of(record: &BuildingRecord, grid: &OutputGrid, textured: &TexturedCity) -> Result<Option<Self>, OutputError> {
        let Ok(block) = SnappedPrism::of(record, grid, MIN_THICKNESS_M) else { return Ok(None) };
        Ok(textured.solid(&record.id, &block, grid)?.map(|(faces, paints)| Self { faces, paints }))
    }
}

/// One object with materials. The counts are of the corners, and of the places on pictures, of those before it.
fn painted_obj(
    out: &mut dyn Write,
    id: &str,
    solid: &PaintedSolid,
    [n_corners, n_places]: [&mut usize; 2],
) -> io::Result<()> {
    writeln!(out, "o {}", one_line(id))?;
    let mut numbers: HashMap<[i64; 3], usize> = HashMap::new();
    for corner in solid.faces.iter().flat_map(triangles_of).flatten() {
        if !numbers.contains_key(&corner) {
            numbers.insert(corner, *n_corners + numbers.len() + 1);
            let [x, y, z] = corner.map(|step| step as f64 * SCALE_M);
            writeln!(out, "v {x:.3} {y:.3} {z:.3}")?;
        }
    }
    *n_corners += numbers.len();
    let (mut group, mut material) = (None, String::new());
    for (face, paint) in solid.faces.iter().zip(&solid.paints) {
        if group != Some(face.surface) {
            group = Some(face.surface);
            writeln!(out, "g {}", kind_name(face.surface))?;
        }
        let (name, places) = match paint {
            FacePaint::Picture { page, uv } => (format!("photos-{page}"), uv.concat()),
            FacePaint::Plain(colour) => (plain_name(*colour), Vec::new()),
        };
        if material != name {
            writeln!(out, "usemtl {name}")?;
            material = name;
        }
        // Places count from the lower left corner.
        for [u, v] in &places {
            writeln!(out, "vt {u:.6} {:.6}", 1.0 - v)?;
        }
        let corners: HashMap<[i64; 3], usize> = face.rings.iter().flatten().copied().zip(*n_places + 1..).collect();
        for triangle in triangles_of(face) {
            let corner = |corner: [i64; 3]| {
                let place = if places.is_empty() { String::new() } else { format!("/{}", corners[&corner]) };
                format!("{}{place}", numbers[&corner])
            };
            let [a, b, c] = triangle.map(corner);
            writeln!(out, "f {a} {b} {c}")?;
        }
        *n_places += places.len();
    }
    Ok(())
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
