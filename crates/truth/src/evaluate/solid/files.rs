//! Bodies from files, brought into one CRS, and to OBJ.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use glam::DVec3;

use super::super::read::HEIGHT_FIELDS;
use super::{Facet, Solid, UprightPrism, triangulate};
use sizeup_geo::crs::{Crs, CrsError, Transform, VerticalReference};
use sizeup_geo::files::{self, FileError, write_whole};
use sizeup_geo::triangles::area_vector;
use sizeup_results::output::cityjson::read::{CityFile, CityObject, CitySurface};
use sizeup_results::output::prism::FaceKind;
use sizeup_results::output::read::{FoundBuildings, ReadError, ReadOptions, height_unit_m};

/// A roof is level if its corners differ by no more than this, metres.
const LEVEL_M: f64 = 0.01;
/// Attributes of a vector layer that hold the level of the ground.
const GROUND_FIELDS: [&str; 4] = ["base_z_m", "ground_z_m", "ground_z", "GROUND_Z"];

/// The bodies of a file.
#[derive(Debug, Clone, Default)]
pub struct Solids {
    /// One per building with a body, in the file's order.
    pub solids: Vec<Solid>,
    /// Buildings without one: no surfaces, no height, no thickness.
    pub n_without_body: usize,
    /// Zero of the levels, where the file's CRS says so.
    pub vertical: Option<VerticalReference>,
}

/// Why a file's bodies cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SolidError {
    /// Unreadable, or without CRS.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// CRS that cannot be brought to the project's.
    #[error("cannot bring {} to the project's CRS", path.display())]
    Crs {
        /// Path of the file of bodies.
        path: PathBuf,
        /// Why its positions cannot be brought there.
        #[source]
        source: CrsError,
    },
    /// The file cannot be opened.
    #[error(transparent)]
    File(#[from] FileError),
    /// A line of an OBJ file is wrong.
    #[error("{}, line {line}: {reason}", path.display())]
    Obj {
        /// Path of the OBJ file.
        path: PathBuf,
        /// Number of the line, counted from 1.
        line: usize,
        /// The problem with the line, in words.
        reason: String,
    },
    /// There is no body in it.
    #[error("{} has no bodies: {reason}\nhint: {hint}", path.display())]
    NoBodies {
        /// The file that was to hold bodies.
        path: PathBuf,
        /// Content of the file in their place, in words.
        reason: String,
        /// Advice to the user: what to change or to look at.
        hint: &'static str,
    },
}

/// Reads bodies. `stated` is the CRS of a file that has none, which an OBJ never has, or adds heights to the file's own.
/// Levels become metres, but count from what they counted from: see [`Solids::vertical`].
///
/// # Errors
/// [`SolidError`].
pub fn read_solids(
    path: &Path,
    lod: Option<&str>,
    stated: Option<&Crs>,
    project_crs: &Crs,
) -> Result<Solids, SolidError> {
    let is = |extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    let solids = if is("obj") {
        let from = stated.ok_or_else(|| ReadError::NoCrs { path: path.to_owned() })?;
        let transform = Transform::new(from, project_crs).map_err(|source| crs_error(path, source))?;
        let unit_m = height_unit_m(path, from)?;
        let solids = moved(read_obj(path)?, &transform, unit_m).map_err(|source| crs_error(path, source))?;
        Solids { solids, n_without_body: 0, vertical: VerticalReference::of(from) }
    } else {
        match CityFile::read(path) {
            Ok(city) if !city.objects.is_empty() => of_city(path, &city, lod, stated, project_crs)?,
            // Not CityJSON, or one without objects: GDAL tells what it is.
            Ok(_) | Err(_) => of_layer(path, stated, project_crs)?,
        }
    };
    if solids.solids.is_empty() {
        return Err(SolidError::NoBodies {
            path: path.to_owned(),
            reason: format!(
                "none of {} buildings has surfaces, or a footprint with ground and height",
                solids.n_without_body
            ),
            hint: "surfaces and volumes need levels: ground_z_m and height_m in a vector layer",
        });
    }
    Ok(solids)
}

fn crs_error(path: &Path, source: CrsError) -> SolidError {
    SolidError::Crs { path: path.to_owned(), source }
}

fn moved(mut solids: Vec<Solid>, transform: &Transform, unit_m: f64) -> Result<Vec<Solid>, CrsError> {
    for corner in solids.iter_mut().flat_map(|s| &mut s.facets).flat_map(|f| &mut f.corners) {
        (corner.x, corner.y) = transform.point(corner.x, corner.y)?;
        corner.z *= unit_m;
    }
    Ok(solids)
}

fn of_city(
    path: &Path,
    city: &CityFile,
    lod: Option<&str>,
    stated: Option<&Crs>,
    project_crs: &Crs,
) -> Result<Solids, SolidError> {
    let own = city.crs.clone().map(|own| own.with_heights_of(stated)).or_else(|| stated.cloned());
    let from = own.ok_or_else(|| ReadError::NoCrs { path: path.to_owned() })?;
    let failed = |source| crs_error(path, source);
    let transform = Transform::new(&from, project_crs).map_err(failed)?;
    let unit_m = height_unit_m(path, &from)?;
    let moved = |v: &[f64; 3]| transform.point(v[0], v[1]).map(|(x, y)| DVec3::new(x, y, unit_m * v[2]));
    let vertices: Vec<DVec3> = city.vertices.iter().map(moved).collect::<Result<_, _>>().map_err(failed)?;
    // Parts are counted to their parent.
    let mut order: Vec<&str> = Vec::new();
    let mut objects_of: BTreeMap<&str, Vec<&CityObject>> = BTreeMap::new();
    for object in city.objects.iter().filter(|o| o.kind == "Building" || o.kind == "BuildingPart") {
        let owner = if object.kind == "Building" { &object.id } else { object.parents.first().unwrap_or(&object.id) };
        let known = objects_of.entry(owner).or_insert_with(|| {
            order.push(owner);
            Vec::new()
        });
        known.push(object);
    }
    let bodies = order.iter().map(|id| of_objects(id, &objects_of[id], lod, &vertices));
    let (solids, empty): (Vec<Solid>, Vec<Solid>) = bodies.partition(|s| !s.facets.is_empty());
    Ok(Solids { solids, n_without_body: empty.len(), vertical: VerticalReference::of(&from) })
}

/// A building at one level of detail, or at its highest; its prisms are then its blocks, those of the lowest level made of such.
fn of_objects(id: &str, objects: &[&CityObject], lod: Option<&str>, vertices: &[DVec3]) -> Solid {
    let at = |lod: Option<&str>| -> Solid {
        let surfaces: Vec<&CitySurface> = objects.iter().flat_map(|object| object.surfaces(lod)).collect();
        of_surfaces(id, &surfaces, vertices)
    };
    let solid = at(lod);
    if lod.is_some() {
        return solid;
    }
    let lods: BTreeSet<&str> = objects.iter().flat_map(|o| &o.geometries).map(|g| g.lod.as_str()).collect();
    let prisms = lods.into_iter().map(|lod| at(Some(lod)).prisms).find(|prisms| !prisms.is_empty());
    Solid { prisms: prisms.unwrap_or_default(), ..solid }
}

fn of_surfaces(id: &str, surfaces: &[&CitySurface], vertices: &[DVec3]) -> Solid {
    let mut solid = Solid { id: id.to_owned(), ..Solid::default() };
    let mut base_m = f64::INFINITY;
    let mut roofs: Vec<Vec<Vec<DVec3>>> = Vec::new();
    for surface in surfaces {
        let rings: Vec<Vec<DVec3>> =
            surface.rings.iter().map(|ring| ring.iter().map(|&i| vertices[i as usize]).collect()).collect();
        let Some(exterior) = rings.first() else { continue };
        base_m = exterior.iter().map(|p| p.z).fold(base_m, f64::min);
        let cosine = area_vector(exterior).normalize_or_zero().z;
        let is_bottom = match surface.kind {
            Some(kind) => kind == FaceKind::Ground,
            None => cosine < -super::BOTTOM_COSINE,
        };
        if !is_bottom && cosine > super::BOTTOM_COSINE {
            roofs.push(rings.clone());
        }
        solid.facets.extend(triangulate(&rings).into_iter().map(|corners| Facet { corners, is_bottom }));
    }
    let prisms: Option<Vec<UprightPrism>> = roofs.iter().map(|roof| prism_under(roof, base_m)).collect();
    // Overhangs that are no ground face, or several bottoms, would make the body differ from prisms down to its base.
    let bottoms = solid.facets.iter().filter(|f| f.is_bottom);
    let is_level = bottoms.flat_map(|f| f.corners).all(|p| p.z - base_m <= LEVEL_M);
    solid.prisms = prisms.filter(|_| is_level).unwrap_or_default();
    solid
}

/// The prism between a level roof and the base; `None` if the roof is not level.
fn prism_under(rings: &[Vec<DVec3>], base_m: f64) -> Option<UprightPrism> {
    let (low, high) =
        rings.iter().flatten().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p.z), h.max(p.z)));
    let line = |ring: &Vec<DVec3>| ring.iter().map(|p| Coord { x: p.x, y: p.y }).collect::<LineString<f64>>();
    let footprint = Polygon::new(line(rings.first()?), rings[1..].iter().map(line).collect());
    (high - low <= LEVEL_M && low > base_m)
        .then_some(UprightPrism { footprint, levels_m: [base_m, 0.5 * (low + high)] })
}

fn of_layer(path: &Path, stated: Option<&Crs>, project_crs: &Crs) -> Result<Solids, SolidError> {
    let mut found = FoundBuildings::read(path, &ReadOptions::default())?;
    found.crs = found.crs.map(|own| own.with_heights_of(stated)).or_else(|| stated.cloned());
    let vertical = found.crs.as_ref().and_then(VerticalReference::of);
    let found = found.into_crs(project_crs)?;
    let mut solids = Vec::new();
    for building in &found.buildings {
        let number = |name: &&str| {
            let value = building.attributes.get(*name)?;
            value.as_f64().or_else(|| value.as_str().and_then(|text| text.trim().parse().ok()))
        };
        let roof_m = ["roof_z_m", "roof_z"].iter().find_map(number);
        let ground_m = ["ground_z_m", "ground_z"].iter().find_map(number);
        let base_m = GROUND_FIELDS.iter().find_map(number);
        let height_m = HEIGHT_FIELDS.iter().find_map(number);
        let top_m = ground_m.zip(height_m).map(|(ground, height)| ground + height).or(roof_m);
        let none = MultiPolygon::new(Vec::new());
        let footprint = building.footprint.as_ref().unwrap_or(&none);
        solids.extend(base_m.zip(top_m).and_then(|(base, top)| Solid::extruded(&building.id, footprint, [base, top])));
    }
    Ok(Solids { n_without_body: found.buildings.len() - solids.len(), solids, vertical })
}

/// Faces by object or group; faces before the first are a body of their own.
fn read_obj(path: &Path) -> Result<Vec<Solid>, SolidError> {
    let text = files::read_text(path)?;
    let mut vertices: Vec<DVec3> = Vec::new();
    let mut triangles: Vec<(String, Vec<[DVec3; 3]>)> = vec![("mesh".to_owned(), Vec::new())];
    for (i, line) in text.lines().enumerate() {
        let wrong = |reason: String| SolidError::Obj { path: path.to_owned(), line: i + 1, reason };
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Option<Vec<f64>> = words.take(3).map(|w| w.parse().ok()).collect();
                match numbers.as_deref() {
                    Some(&[x, y, z]) if x.is_finite() && y.is_finite() && z.is_finite() => {
                        vertices.push(DVec3::new(x, y, z));
                    }
                    _ => return Err(wrong("expected `v x y z`".to_owned())),
                }
            }
            Some("o" | "g") => triangles.push((words.collect::<Vec<_>>().join(" "), Vec::new())),
            Some("f") => {
                let corner = |word: &str| {
                    let index: i64 = word.split('/').next()?.parse().ok()?;
                    // Negative numbers count from the end.
                    let at = if index < 0 { i64::try_from(vertices.len()).ok()? + index } else { index - 1 };
                    vertices.get(usize::try_from(at).ok()?).copied()
                };
                let ring: Option<Vec<DVec3>> = words.map(corner).collect();
                let ring = ring.filter(|r| r.len() >= 3).ok_or_else(|| {
                    wrong(format!("expected a face of three or more of the {} vertices so far", vertices.len()))
                })?;
                triangles.last_mut().expect("never empty").1.extend(triangulate(&[ring]));
            }
            _ => {}
        }
    }
    let has_faces = triangles.into_iter().filter(|(_, faces)| !faces.is_empty());
    Ok(has_faces.map(|(name, faces)| Solid::of_triangles(&name, faces)).collect())
}

/// Writes bodies as OBJ, one object each, positions in millimetres.
///
/// # Errors
/// [`FileError`].
pub fn write_obj(path: &Path, solids: &[Solid]) -> Result<(), FileError> {
    let mut text = String::new();
    let mut n = 0;
    for solid in solids {
        let _ = writeln!(text, "o {}", solid.id);
        for facet in &solid.facets {
            for p in facet.corners {
                let _ = writeln!(text, "v {:.3} {:.3} {:.3}", p.x, p.y, p.z);
            }
            let _ = writeln!(text, "f {} {} {}", n + 1, n + 2, n + 3);
            n += 3;
        }
    }
    write_whole(path, |out| out.write_all(text.as_bytes()))
}
