//! From a feature of a layer to footprints, or to a refusal that says why.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use geo::BoundingRect as _;
use geo_types::{Coord, Geometry, Polygon};
use serde_json::Value;

use super::clean::{self, CleaningRules, Defect, Repair};
use super::layer::MAX_AREA_CHANGE;
use super::{Footprint, FootprintConfig, FootprintLayer, RefusedFootprint, osm};
use sizeup_geo::crs::{CrsError, Transform};
use sizeup_geo::geodata::vector::{Feature, FeatureGeometry, plain_text};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::ids::BuildingId;

/// Where the ids of a layer's buildings come from.
#[derive(Debug, Clone, Copy)]
pub(super) enum Ids<'a> {
    /// Numbers that the layer gives its features.
    Numbers,
    /// Values of an attribute.
    Field(&'a str),
    /// OpenStreetMap's ids: ways and relations have numbers of their own.
    OpenStreetMap,
}

/// Turns features into footprints, one after the other.
pub(super) struct FeatureReader<'a> {
    ids_from: Ids<'a>,
    to_project: Transform,
    shift_m: [f64; 2],
    rules: CleaningRules,
    ids: HashSet<String>,
    layer: FootprintLayer,
    /// Features whose ids are not what their attribute says, as a reading of the whole layer found them.
    given: Option<&'a BTreeMap<u64, String>>,
    /// The same, as this reading finds them.
    renamed: BTreeMap<u64, String>,
    /// File of the layer, until it is told that its features are bodies.
    untold_of_bodies: Option<&'a Path>,
}

impl<'a> FeatureReader<'a> {
    /// Reads features by the settings of their layer.
    pub(super) fn new(config: &'a FootprintConfig, to_project: Transform) -> Self {
        let &FootprintConfig { grid_m, min_area_m2, shift_m, .. } = config;
        let rules = CleaningRules { grid_m, min_area_m2, max_area_change: MAX_AREA_CHANGE };
        Self {
            ids_from: osm::ids(config),
            to_project,
            shift_m,
            rules,
            ids: HashSet::new(),
            layer: FootprintLayer::default(),
            given: None,
            renamed: BTreeMap::new(),
            untold_of_bodies: Some(&config.path),
        }
    }

    /// For a part of a layer: ids are those of the whole.
    pub(super) fn with_ids(self, given: &'a BTreeMap<u64, String>) -> Self {
        Self { given: Some(given), ..self }
    }

    /// Layer of what was read since the last call.
    pub(super) fn take(&mut self) -> FootprintLayer {
        std::mem::take(&mut self.layer)
    }

    /// Features whose ids are not what their attribute says.
    pub(super) fn into_renamed(self) -> BTreeMap<u64, String> {
        self.renamed
    }

    pub(super) fn finish(self) -> FootprintLayer {
        self.layer
    }

    /// The feature at this position of the layer.
    pub(super) fn add(&mut self, position: usize, feature: &Feature) {
        let id = self.id(position, feature);
        if let Some(path) = self.untold_of_bodies.take_if(|_| feature.is_body) {
            self.layer.issues.push(Issue::new(
                Severity::Note,
                "footprints_of_bodies",
                Subject::Input(path.display().to_string()),
                format!(
                    "its features are bodies with walls, roofs or floors, {id} the first: footprints are their outlines in plan, \
                     and walls are left out"
                ),
            ));
        }
        let refusal = match &feature.geometry {
            FeatureGeometry::Missing => PartRefusal::new("footprint_without_geometry", "it has no geometry"),
            FeatureGeometry::Unsupported(kind) => PartRefusal::new(
                "footprint_unsupported_geometry",
                format!("its geometry is a {kind}, expected a polygon"),
            ),
            FeatureGeometry::Shape(shape) => match polygons(shape) {
                Some(parts) => return self.add_parts(&id, &parts, feature),
                None => PartRefusal::new("footprint_not_a_polygon", "its geometry is not a polygon"),
            },
        };
        self.refuse(Name::whole(id), refusal, feature);
    }

    /// The id from the attribute or the layer's number, made unique.
    fn id(&mut self, position: usize, feature: &Feature) -> String {
        if let Some(id) = self.given.zip(feature.fid).and_then(|(given, fid)| given.get(&fid)) {
            return id.clone();
        }
        let stated = self.stated_id(feature);
        let id = self.id_from(stated.clone(), position, feature);
        if let Some(fid) = feature.fid.filter(|_| stated.is_some_and(|stated| stated != id)) {
            self.renamed.insert(fid, id.clone());
        }
        id
    }

    fn stated_id(&self, feature: &Feature) -> Option<String> {
        match self.ids_from {
            Ids::Numbers => None,
            Ids::OpenStreetMap => Some(osm::id_of(feature)),
            Ids::Field(field) => Some(match feature.attributes.get(field) {
                Some(Value::Null) | None => String::new(),
                Some(value) => plain_text(value).trim().to_owned(),
            }),
        }
    }

    fn id_from(&mut self, stated: Option<String>, position: usize, feature: &Feature) -> String {
        let number = || feature.fid.map_or_else(|| position.to_string(), |fid| fid.to_string());
        match stated {
            None => self.unique(&number()),
            Some(id) if !id.is_empty() => self.unique(&id),
            Some(_) => {
                let id = self.unique(&format!("fid-{}", number()));
                self.layer.issues.push(Issue::new(
                    Severity::Warning,
                    "footprint_without_id",
                    Subject::Building(id.clone()),
                    "its id attribute is empty: it is named by its feature number",
                ));
                id
            }
        }
    }

    fn unique(&mut self, id: &str) -> String {
        let numbered = (2..).map(|n| format!("{id}~{n}"));
        let free = std::iter::once(id.to_owned()).chain(numbered).find(|id| !self.ids.contains(id));
        let free = free.expect("numbers do not run out");
        self.ids.insert(free.clone());
        if free != id {
            let issue = Issue::new(
                Severity::Warning,
                "footprint_id_repeated",
                Subject::Building(free.clone()),
                format!("the layer has several buildings with id {id}: this one is {free}"),
            );
            self.layer.issues.push(issue.hint("choose an `id_field` whose values are unique"));
        }
        free
    }

    fn add_parts(&mut self, id: &str, parts: &[&Polygon<f64>], feature: &Feature) {
        let [part] = parts else {
            self.layer.issues.push(Issue::new(
                Severity::Note,
                "footprint_split",
                Subject::Building(id.to_owned()),
                format!("it has {} parts, each with a height of its own: {id}#1, {id}#2, …", parts.len()),
            ));
            for (i, part) in parts.iter().enumerate() {
                let name = Name { id: self.unique(&format!("{id}#{}", i + 1)), part_of: Some(id.to_owned()) };
                self.add_part(name, part, feature);
            }
            return;
        };
        self.add_part(Name::whole(id.to_owned()), part, feature);
    }

    fn add_part(&mut self, name: Name, polygon: &Polygon<f64>, feature: &Feature) {
        let cleaned = self.project(polygon).and_then(|projected| {
            let middle = projected.bounding_rect().map(geo::Rect::center);
            clean::clean(&projected, self.rules).map(|c| (c, middle)).map_err(|defect| PartRefusal::of(defect, middle))
        });
        let (cleaned, middle) = match cleaned {
            Ok(cleaned) => cleaned,
            Err(refusal) => return self.refuse(name, refusal, feature),
        };
        let Name { id, part_of } = name;
        for repair in &cleaned.repairs {
            self.layer.issues.push(tell(repair, Subject::Building(id.clone()), middle));
        }
        let n_parts = cleaned.parts.len();
        for (i, polygon) in cleaned.parts.into_iter().enumerate() {
            let (id, part_of) = if n_parts > 1 {
                (self.unique(&format!("{id}#{}", i + 1)), Some(part_of.as_ref().unwrap_or(&id).clone()))
            } else {
                (id.clone(), part_of.clone())
            };
            let attributes = feature.attributes.clone();
            let part_of = part_of.map(BuildingId);
            self.layer.footprints.push(Footprint { id: BuildingId(id), part_of, polygon, attributes });
        }
    }

    fn project(&self, polygon: &Polygon<f64>) -> Result<Polygon<f64>, PartRefusal> {
        use geo::MapCoords as _;
        let projected = polygon.try_map_coords(|Coord { x, y }| {
            // What is no number is told apart later, as damage of the file and not as a wrong CRS.
            if !(x.is_finite() && y.is_finite()) {
                return Ok(Coord { x: f64::NAN, y: f64::NAN });
            }
            self.to_project.point(x, y).map(|(x, y)| Coord { x: x + self.shift_m[0], y: y + self.shift_m[1] })
        });
        projected.map_err(|error: CrsError| PartRefusal {
            code: "footprint_untransformable",
            message: error.to_string(),
            hint: Some("its coordinates lie where its CRS is not valid: is the CRS right, are the axes swapped?"),
            place: None,
        })
    }

    fn refuse(&mut self, Name { id, part_of }: Name, refusal: PartRefusal, feature: &Feature) {
        let mut issue = Issue::new(Severity::Refused, refusal.code, Subject::Building(id.clone()), refusal.message);
        issue.hint = refusal.hint.map(str::to_owned);
        issue.place = refusal.place.map(|c| [c.x, c.y]);
        self.layer.issues.push(issue);
        self.layer.refused.push(RefusedFootprint {
            id: BuildingId(id),
            part_of: part_of.map(BuildingId),
            reason: refusal.code.to_owned(),
            duplicate_of: None,
            attributes: feature.attributes.clone(),
        });
    }
}

/// Id of one part of a feature, and of the whole.
struct Name {
    id: String,
    part_of: Option<String>,
}

impl Name {
    /// Name of a feature in one piece.
    fn whole(id: String) -> Self {
        Self { id, part_of: None }
    }
}

/// Why one part of a feature has no usable footprint.
struct PartRefusal {
    code: &'static str,
    message: String,
    hint: Option<&'static str>,
    place: Option<Coord<f64>>,
}

impl PartRefusal {
    fn new(code: &'static str, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), hint: None, place: None }
    }

    fn of(defect: Defect, middle: Option<Coord<f64>>) -> Self {
        let (place, hint) = match defect {
            Defect::Crossing { place, .. } => (Some(place), Some("mend the footprint in a GIS")),
            Defect::TooSmall { .. } => (middle, Some("lower `min_area_m2` to keep it")),
            Defect::NotFinite => (None, None),
            Defect::NoArea => (middle, None),
        };
        Self { code: defect.code(), message: defect.to_string(), hint, place }
    }
}

/// The polygons of a geometry, `None` if any part is something else.
fn polygons(shape: &Geometry<f64>) -> Option<Vec<&Polygon<f64>>> {
    match shape {
        Geometry::Polygon(polygon) => Some(vec![polygon]),
        Geometry::MultiPolygon(parts) if !parts.0.is_empty() => Some(parts.0.iter().collect()),
        Geometry::GeometryCollection(parts) if !parts.0.is_empty() => {
            let nested: Option<Vec<_>> = parts.0.iter().map(polygons).collect();
            nested.map(|n| n.into_iter().flatten().collect())
        }
        _ => None,
    }
}

fn tell(repair: &Repair, subject: Subject, otherwise_at: Option<Coord<f64>>) -> Issue {
    let (severity, code, message, place) = match *repair {
        Repair::Rebuilt(at) => (
            Severity::Warning,
            "footprint_rebuilt",
            "its footprint crossed, touched or retraced itself and was rebuilt with the same area".to_owned(),
            Some(at),
        ),
        Repair::HolesDropped(n) => {
            (Severity::Note, "footprint_holes_dropped", format!("{n} holes without area were left out"), otherwise_at)
        }
        Repair::HoleDrawnIn(at) => (
            Severity::Note,
            "footprint_hole_drawn_in",
            "a courtyard touched another ring and was drawn in by a centimetre".to_owned(),
            Some(at),
        ),
        Repair::Narrow { place, n_corners, area_m2 } => (
            Severity::Note,
            "footprint_narrow_detail",
            format!(
                "it had slits, spikes or corners narrower than {} mm, which make solids invalid; they were closed: {}, \
                 area {area_m2:+.3} m²",
                1000.0 * clean::LEAST_CLEARANCE_M,
                match n_corners {
                    1 => "1 corner fewer".to_owned(),
                    2.. => format!("{n_corners} corners fewer"),
                    0 => "as many corners".to_owned(),
                    _ => format!("{} corners more", -n_corners),
                }
            ),
            Some(place),
        ),
    };
    let issue = Issue::new(severity, code, subject, message);
    match place {
        Some(at) => issue.at(at.x, at.y),
        None => issue,
    }
}
