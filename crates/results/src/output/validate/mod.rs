//! Geometric checks (and in `schema`, with the feature `cjval`, formal ones) of any `CityJSON` solid or surface, with val3dity's codes and the place of each fault.
//!
//! Definitions follow ISO 19107 as val3dity reads it (Ledoux 2018, doi:10.1186/s40965-018-0043-x). Each level is only
//! checked where the level below is sound: rings, then faces, then shells, then solids.
//!
//! | checked | not checked |
//! |---|---|
//! | 101, 102, 104, 201–208, 301–303, 305–307, 405, 902 | 401–404 between the shells of a solid, 501–503, templates |
//! | 601 of parts that are upright prisms | 601 of parts of another form |
//!
//! Vertices closer than the snap tolerance count as one. Within a face, positions are projected along the axis nearest
//! to its normal and rounded to a tenth of the tolerance; all further decisions there are exact.

#[cfg(feature = "cjval")]
mod document;
mod face;
#[cfg(feature = "cjval")]
mod granted;
#[cfg(feature = "cjval")]
mod merge;
mod parts;
#[cfg(feature = "cjval")]
pub mod schema;
mod shell;
mod snap;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::OutputError;
use super::cityjson::CitySequence;
use super::cityjson::read::{CityFile, CityGeometry, CityObject, CitySurface, visit_objects};
use super::grid::OutputGrid;
use super::prism;
use super::read::is_sequence;
use face::SoundFace;
use parts::PrismPart;
use snap::Snapped;

/// Tolerances of the checks; the defaults are val3dity's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ValidateConfig {
    /// Vertices closer than this are one, metres, above 0.
    pub snap_tolerance_m: f64,
    /// Largest distance of a vertex from its face's plane, metres.
    pub planarity_distance_m: f64,
    /// Largest angle between a face's normal and that of any triangle of it, degrees.
    pub planarity_normal_deg: f64,
}

impl Default for ValidateConfig {
    fn default() -> Self {
        Self { snap_tolerance_m: 0.001, planarity_distance_m: 0.01, planarity_normal_deg: 20.0 }
    }
}

/// A kind of fault, numbered as in val3dity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Code {
    /// 101: a ring of fewer than three distinct points.
    TooFewPoints = 101,
    /// 102: two consecutive points of a ring are the same.
    ConsecutivePointsSame = 102,
    /// 104: a ring crosses or touches itself.
    RingSelfIntersection = 104,
    /// 201: two rings of a face cross, or share a piece of an edge.
    IntersectionRings = 201,
    /// 202: two rings of a face are the same.
    DuplicatedRings = 202,
    /// 203: a vertex lies too far from the face's plane.
    NonPlanarPolygonDistancePlane = 203,
    /// 204: a part of the face is too far turned out of its plane.
    NonPlanarPolygonNormalsDeviation = 204,
    /// 205: rings touch so that they cut the face in two.
    PolygonInteriorDisconnected = 205,
    /// 206: a hole lies outside the exterior ring.
    InnerRingOutside = 206,
    /// 207: a hole lies in another hole.
    InnerRingsNested = 207,
    /// 208: a hole turns the same way as the exterior ring.
    OrientationRingsSame = 208,
    /// 301: a shell of fewer than four faces.
    TooFewPolygons = 301,
    /// 302: an edge with one face only.
    ShellNotClosed = 302,
    /// 303: an edge with more than two faces, or a vertex whose faces are not one fan.
    NonManifoldCase = 303,
    /// 305: a shell of several parts.
    MultipleConnectedComponents = 305,
    /// 306: two faces of a shell cross or overlap.
    ShellSelfIntersection = 306,
    /// 307: neighbouring faces turn against each other.
    PolygonWrongOrientation = 307,
    /// 405: an outer shell faces inwards, or an inner one outwards.
    WrongOrientationShell = 405,
    /// 601: two parts of one building share volume.
    BuildingPartsOverlap = 601,
    /// 902: a geometry without faces.
    EmptyPrimitive = 902,
}

impl Code {
    /// Number of the fault in val3dity's list.
    #[must_use]
    pub fn number(self) -> u16 {
        self as u16
    }
}

impl std::fmt::Display for Code {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = serde_json::to_value(self).unwrap_or_default();
        write!(f, "{} {}", self.number(), name.as_str().unwrap_or_default())
    }
}

/// One fault and its place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// Number of the fault in val3dity's list.
    pub number: u16,
    /// Name of the fault in val3dity's list.
    pub code: Code,
    /// Id of the city object.
    pub object: String,
    /// Level of detail of the geometry.
    pub lod: String,
    /// Solid, shell and surface within the geometry; the surface is missing where a whole shell is meant.
    pub solid: usize,
    /// Shell of the solid, 0 is the outer one.
    pub shell: usize,
    /// Surface of the shell.
    pub surface: Option<usize>,
    /// A point of the fault in the file's CRS.
    pub position: Option<[f64; 3]>,
}

/// The outcome for a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Number of geometries checked.
    pub n_geometries: usize,
    /// Those without faults among them.
    pub n_valid: usize,
    /// Objects without any surface geometry.
    pub n_without_geometry: usize,
    /// Template instances, which are not checked.
    #[serde(default)]
    pub n_templates: usize,
    /// Number of faults by code.
    pub n_by_code: BTreeMap<u16, usize>,
    /// All faults, in the file's order.
    pub faults: Vec<Fault>,
}

impl Validation {
    /// Whether no fault was found.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.faults.is_empty()
    }

    fn record(&mut self, faults: Vec<Fault>) {
        for fault in &faults {
            *self.n_by_code.entry(fault.number).or_default() += 1;
        }
        self.faults.extend(faults);
    }
}

/// Looks at objects one by one, and at the parts of a building when all of them were seen.
struct Checker<'a> {
    config: &'a ValidateConfig,
    outcome: Validation,
    /// Parts seen so far, by the building they are of.
    parts: BTreeMap<String, Vec<PrismPart>>,
}

impl<'a> Checker<'a> {
    fn new(config: &'a ValidateConfig) -> Self {
        Self { config, outcome: Validation::default(), parts: BTreeMap::new() }
    }

    fn object(&mut self, city: &CityFile, object: &CityObject) {
        self.outcome.n_without_geometry += usize::from(object.geometries.is_empty());
        for geometry in &object.geometries {
            let faults = check_geometry(city, object, geometry, self.config);
            self.outcome.n_geometries += 1;
            self.outcome.n_valid += usize::from(faults.is_empty());
            let building = object.parents.first().filter(|_| faults.is_empty() && geometry.is_solid);
            let part = building.and_then(|building| {
                let part = PrismPart::of(city, object, geometry, self.config)?;
                Some((building.clone(), part))
            });
            if let Some((building, part)) = part {
                self.parts.entry(building).or_default().push(part);
            }
            self.outcome.record(faults);
        }
    }

    /// Compares the parts seen so far: every building's are complete.
    fn compare_parts(&mut self) {
        for parts in std::mem::take(&mut self.parts).into_values() {
            self.outcome.record(parts::overlaps(&parts, self.config));
        }
    }
}

/// Checks every geometry of a city model.
#[must_use]
pub fn validate(city: &CityFile, config: &ValidateConfig) -> Validation {
    let mut checker = Checker::new(config);
    city.objects.iter().for_each(|object| checker.object(city, object));
    checker.compare_parts();
    Validation { n_templates: city.n_templates, ..checker.outcome }
}

/// Numbers of what is found in one of our own solids, each once, ascending.
#[must_use]
pub fn faults_of(faces: &[prism::GridFace], grid: &OutputGrid) -> Vec<u16> {
    let mut city = CityFile::default();
    let mut surfaces = Vec::new();
    for (i, face) in faces.iter().enumerate() {
        let ring = |ring: &Vec<[i64; 3]>| {
            let first = city.vertices.len() as u32;
            city.vertices.extend(ring.iter().map(|point| grid.metres(*point)));
            (first..city.vertices.len() as u32).collect()
        };
        surfaces.push(CitySurface { place: [0, 0, i], kind: None, rings: face.rings.iter().map(ring).collect() });
    }
    let geometry = CityGeometry { lod: String::new(), is_solid: true, surfaces };
    let object = CityObject {
        id: String::new(),
        kind: String::new(),
        parents: Vec::new(),
        children: Vec::new(),
        attributes: serde_json::Map::new(),
        geometries: Vec::new(),
    };
    let faults = check_geometry(&city, &object, &geometry, &ValidateConfig::default());
    faults.iter().map(|fault| fault.number).collect::<BTreeSet<_>>().into_iter().collect()
}

/// Checks every geometry of a file, object by object: of a `CityJSON` file only the vertices are in memory (and the footprints of
/// building parts), of a sequence one feature.
///
/// # Errors
/// [`OutputError`] where the file cannot be read.
pub fn validate_file(path: &Path, config: &ValidateConfig) -> Result<Validation, OutputError> {
    let mut checker = Checker::new(config);
    if is_sequence(path) {
        for feature in CitySequence::open(path)? {
            let feature = feature?;
            feature.objects.iter().for_each(|object| checker.object(&feature, object));
            checker.compare_parts();
            checker.outcome.n_templates += feature.n_templates;
        }
        return Ok(checker.outcome);
    }
    let head = CityFile::read_head(path)?;
    checker.outcome.n_templates = visit_objects(path, &head.vertices, &mut |object| {
        checker.object(&head, &object);
        Ok(())
    })?;
    checker.compare_parts();
    Ok(checker.outcome)
}

/// A fault within one shell, before it knows where the shell stands.
struct Found {
    code: Code,
    surface: Option<usize>,
    position: Option<[f64; 3]>,
}

fn check_geometry(
    city: &CityFile,
    object: &CityObject,
    geometry: &CityGeometry,
    config: &ValidateConfig,
) -> Vec<Fault> {
    let fault = |solid: usize, shell: usize, found: Found| Fault {
        number: found.code.number(),
        code: found.code,
        object: object.id.clone(),
        lod: geometry.lod.clone(),
        solid,
        shell,
        surface: found.surface,
        position: found.position,
    };
    if geometry.surfaces.is_empty() {
        let empty = Found { code: Code::EmptyPrimitive, surface: None, position: None };
        return vec![fault(0, 0, empty)];
    }
    let snapped = Snapped::new(city, geometry, config.snap_tolerance_m);
    let mut shells: BTreeMap<[usize; 2], Vec<SoundFace>> = BTreeMap::new();
    let mut faults = Vec::new();
    let mut is_face_sound = true;
    for surface in &geometry.surfaces {
        let [solid, shell, index] = surface.place;
        match SoundFace::new(surface, &snapped, config) {
            Ok(face) => shells.entry([solid, shell]).or_default().push(face),
            Err(found) => {
                is_face_sound = false;
                faults.extend(found.into_iter().map(|(code, position)| {
                    fault(solid, shell, Found { code, surface: Some(index), position: Some(position) })
                }));
            }
        }
    }
    if geometry.is_solid && is_face_sound {
        for ([solid, shell], faces) in &shells {
            let found = shell::check(faces, *shell, &snapped);
            faults.extend(found.into_iter().map(|found| fault(*solid, *shell, found)));
        }
    }
    faults
}
