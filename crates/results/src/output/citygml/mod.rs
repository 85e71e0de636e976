//! `CityGML` 2.0 (OGC 12-019) and 3.0 (OGC 21-006r2) with blocks (LOD 1), roofs (LOD 2), heights, roof types and storeys, for databases and
//! agencies that take GML only.
//!
//! ```text
//! Building or BuildingPart
//!   gml:name                  the id of the input; gml:id is that in letters that an XML name may have
//!   generic attributes        all attributes, ours and the user's
//!   roofType                  code of the roof's form in ALKIS, as AdV's profile has it: 1000 flat, 3100 gable, 3200 hip, 5000 combined forms
//!   measuredHeight            height above ground of the highest place of the roof, metres; in 3.0 a Height with its references:
//!                             highestRoofEdge over lowestGroundPoint, or over generalGround where heights count from another level
//!   storeysAboveGround        estimated ([`super::attributes`])
//!   RoofSurface               one for each plane of the roof, with area, slope and aspect as generic attributes
//!   lod1Solid, lod2Solid      the second by reference to the faces of the thematic surfaces
//!   terrain intersection      outline of the ground face: where the walls of the solid end
//!   address                   xAL, where the input states one in OpenStreetMap's names ([`super::address`])
//! ```
//!
//! The elements are in the order of the schema of each [`Edition`].

mod edition;

use std::io::{self, Write};
use std::path::Path;

use quick_xml::escape::escape;
use serde_json::{Map as JsonMap, Value};

pub use edition::Edition;

use super::address::Address;
use super::attributes;
use super::buildings::Family;
use super::facts::SolidFacts;
use super::footprints::LIST_SEPARATOR;
use super::grid::{OutputGrid, SCALE_M};
use super::mesh::cannot_write;
use super::prism::{FaceKind, GridFace, MIN_THICKNESS_M};
use super::roof_solid::RoofSurface;
use super::{BuildingRecord, CityModel, Families, OutputError, Overview, Records, RoofForm, Status};
use edition::Property;
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_whole_or;

/// Writes `path` (`….gml`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, the file system.
pub fn write<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    edition: Edition,
) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    let day = model.lineage.reference_date.as_deref();
    let writer = GmlWriter { edition, grid: &grid, has_roofs: overview.has_roofs, day };
    write_whole_or(path, |out| {
        let failed = |e| cannot_write(path, e);
        writer.head(out, model.crs, &overview).map_err(failed)?;
        let mut families = Families::new(&overview);
        model.records.visit(&mut |record| match families.add(record) {
            Some(family) => writer.family(out, &family).map_err(failed),
            None => Ok(()),
        })?;
        writeln!(out, "</core:CityModel>").map_err(failed)
    })?;
    Ok(overview)
}

/// Name of the CRS; of a compound without a code, the names of its parts (OGC 07-092r2).
fn srs_name(crs: &Crs) -> Option<String> {
    match (crs.epsg(), crs.horizontal_epsg(), crs.vertical_epsg()) {
        (Some(code), ..) | (None, Some(code), None) => Some(format!("urn:ogc:def:crs:EPSG::{code}")),
        (None, Some(plane), Some(heights)) => Some(format!("urn:ogc:def:crs,crs:EPSG::{plane},crs:EPSG::{heights}")),
        (None, None, _) => None,
    }
}

/// Settings that objects are written with.
struct GmlWriter<'a> {
    edition: Edition,
    grid: &'a OutputGrid,
    has_roofs: bool,
    day: Option<&'a str>,
}

/// A building or a part of one, and its solid.
struct Object<'a> {
    id: String,
    record: &'a BuildingRecord,
    facts: SolidFacts,
    /// Faces of the block, where there is a solid.
    block: Option<Vec<GridFace>>,
}

impl Object<'_> {
    /// Faces of the solid with its roof; those of the block where that is none.
    fn roofed(&self) -> Option<&[GridFace]> {
        self.facts.roofed.as_deref().or(self.block.as_deref())
    }
}

impl GmlWriter<'_> {
    fn head(&self, out: &mut dyn Write, crs: &Crs, overview: &Overview) -> io::Result<()> {
        writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<core:CityModel {}>", self.edition.namespaces())?;
        if let Some(extent) = &overview.extent {
            let name = srs_name(crs).map_or_else(String::new, |name| format!(" srsName=\"{}\"", escape(name)));
            let corner = |[x, y, z]: [f64; 3]| format!("{x:.3} {y:.3} {z:.3}");
            writeln!(
                out,
                "<gml:boundedBy><gml:Envelope{name} srsDimension=\"3\"><gml:lowerCorner>{}</gml:lowerCorner>\
                 <gml:upperCorner>{}</gml:upperCorner></gml:Envelope></gml:boundedBy>",
                corner(extent.min_m),
                corner(extent.max_m)
            )?;
        }
        Ok(())
    }

    fn family(&self, out: &mut dyn Write, family: &Family<'_>) -> io::Result<()> {
        out.write_all(b"<core:cityObjectMember>\n")?;
        match family {
            Family::Single(record) => self.object(out, "Building", record)?,
            Family::Parts(whole, parts) => {
                let id = xml_id(whole);
                writeln!(out, "<bldg:Building gml:id=\"{id}\">")?;
                self.naming(out, whole)?;
                self.generics(out, &parts.iter().flat_map(attributes::carried).collect())?;
                let address = parts.iter().find_map(|part| Address::of(&part.attributes));
                if self.edition == Edition::V3 {
                    self.address(out, &id, address.as_ref())?;
                }
                for part in parts {
                    writeln!(out, "<{}>", self.edition.part())?;
                    self.object(out, "BuildingPart", part)?;
                    writeln!(out, "</{}>", self.edition.part())?;
                }
                if self.edition == Edition::V2 {
                    self.address(out, &id, address.as_ref())?;
                }
                out.write_all(b"</bldg:Building>\n")?;
            }
        }
        out.write_all(b"</core:cityObjectMember>\n")
    }

    fn naming(&self, out: &mut dyn Write, id: &str) -> io::Result<()> {
        writeln!(out, "<gml:name>{}</gml:name>", escape(id))?;
        self.day.map_or(Ok(()), |day| writeln!(out, "{}", self.edition.creation(day)))
    }

    fn object(&self, out: &mut dyn Write, kind: &str, record: &BuildingRecord) -> io::Result<()> {
        let (prism, facts) = SolidFacts::of(record, self.grid, MIN_THICKNESS_M);
        let block = prism.ok().map(|prism| prism.faces());
        let object = Object { id: xml_id(&record.id), record, facts, block };
        writeln!(out, "<bldg:{kind} gml:id=\"{}\">", object.id)?;
        self.naming(out, &record.id)?;
        let mut all = attributes::own(record, &object.facts);
        all.remove(attributes::MEASURED_HEIGHT);
        if record.part_of.is_none() {
            all.extend(attributes::carried(record));
        }
        self.generics(out, &all)?;
        self.edition.properties().into_iter().try_for_each(|property| self.property(out, property, &object))?;
        writeln!(out, "</bldg:{kind}>")
    }

    fn property(&self, out: &mut dyn Write, property: Property, object: &Object<'_>) -> io::Result<()> {
        let record = object.record;
        match property {
            Property::RoofType => record
                .roof
                .map_or(Ok(()), |roof| writeln!(out, "<bldg:roofType>{}</bldg:roofType>", roof_type(roof.form))),
            Property::Height => self.height(out, record),
            Property::Storeys => attributes::n_storeys(record)
                .map_or(Ok(()), |n| writeln!(out, "<bldg:storeysAboveGround>{n}</bldg:storeysAboveGround>")),
            Property::Lod1Solid => self.block(out, object),
            Property::Lod2Solid => self.solid_with_roof(out, object),
            Property::TerrainLine => self.terrain_line(out, object),
            Property::Surfaces => self.surfaces(out, object),
            // That of a part is its building's.
            Property::Address => {
                let address = Address::of(&record.attributes).filter(|_| record.part_of.is_none());
                self.address(out, &object.id, address.as_ref())
            }
        }
    }

    fn height(&self, out: &mut dyn Write, record: &BuildingRecord) -> io::Result<()> {
        let ridge_m = record.roof.map(|roof| roof.ridge_height_m);
        let Some(height_m) = record.height_m.map(|mean_m| ridge_m.map_or(mean_m, |ridge_m| ridge_m.max(mean_m))) else {
            return Ok(());
        };
        if self.edition == Edition::V2 {
            return writeln!(out, "<bldg:measuredHeight uom=\"m\">{height_m:.3}</bldg:measuredHeight>");
        }
        let from = if record.ground_z_m == record.base_z_m { "lowestGroundPoint" } else { "generalGround" };
        let status = match record.status {
            Status::Given | Status::Fallback | Status::Unknown | Status::Refused => "estimated",
            Status::Measured | Status::Reviewed | Status::Doubtful => "measured",
        };
        writeln!(
            out,
            "<con:height><con:Height><con:highReference>highestRoofEdge</con:highReference><con:lowReference>{from}</con:lowReference>\
             <con:status>{status}</con:status><con:value uom=\"m\">{height_m:.3}</con:value></con:Height></con:height>"
        )
    }

    fn block(&self, out: &mut dyn Write, object: &Object<'_>) -> io::Result<()> {
        let Some(faces) = &object.block else { return Ok(()) };
        self.solid(out, "lod1Solid", &object.id, |out| {
            faces.iter().enumerate().try_for_each(|(i, face)| {
                self.member(out, face, &self.edition.id_of_geometry(&format!("{}_block{i}", object.id)))
            })
        })
    }

    /// The solid with its roof, by reference to the faces of its surfaces.
    fn solid_with_roof(&self, out: &mut dyn Write, object: &Object<'_>) -> io::Result<()> {
        let Some(faces) = object.roofed().filter(|_| self.has_roofs) else { return Ok(()) };
        self.solid(out, "lod2Solid", &object.id, |out| {
            (0..faces.len())
                .try_for_each(|i| writeln!(out, "<gml:surfaceMember xlink:href=\"#{}_face{i}\"/>", object.id))
        })
    }

    fn solid(
        &self,
        out: &mut dyn Write,
        name: &str,
        id: &str,
        members: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        let (spaces, shell) = (self.edition.of_spaces(), self.edition.shell());
        let id = self.edition.id_of_geometry(&format!("{id}_{name}"));
        writeln!(out, "<{spaces}:{name}><gml:Solid{id}><gml:exterior><{shell}>")?;
        members(out)?;
        writeln!(out, "</{shell}></gml:exterior></gml:Solid></{spaces}:{name}>")
    }

    /// Where the walls end: the outlines of the ground face.
    fn terrain_line(&self, out: &mut dyn Write, object: &Object<'_>) -> io::Result<()> {
        let Some(faces) = &object.block else { return Ok(()) };
        let id = |part: &str| self.edition.id_of_geometry(&format!("{}_terrain{part}", object.id));
        writeln!(out, "<{}><gml:MultiCurve{}>", self.edition.terrain_line(), id(""))?;
        let ground = faces.iter().filter(|face| face.surface == FaceKind::Ground);
        for (i, ring) in ground.flat_map(|face| &face.rings).enumerate() {
            let (id, places) = (id(&i.to_string()), self.places(ring));
            writeln!(
                out,
                "<gml:curveMember><gml:LineString{id}><gml:posList srsDimension=\"3\">{places}</gml:posList></gml:LineString></gml:curveMember>"
            )?;
        }
        writeln!(out, "</gml:MultiCurve></{}>", self.edition.terrain_line())
    }

    /// The surfaces that the solid with its roof is made of: one for each plane of the roof and each wall.
    fn surfaces(&self, out: &mut dyn Write, object: &Object<'_>) -> io::Result<()> {
        let Some(faces) = object.roofed().filter(|_| self.has_roofs) else { return Ok(()) };
        let planes: Vec<RoofSurface> = object.facts.planes_of(object.record, faces, self.grid);
        let in_planes: Vec<usize> = planes.iter().flat_map(|plane| plane.faces.iter().copied()).collect();
        let alone = (0..faces.len()).filter(|i| !in_planes.contains(i)).map(|i| (vec![i], JsonMap::new()));
        let of_planes = planes.iter().map(|plane| (plane.faces.clone(), plane.facet.attributes()));
        let (spaces, boundary) = (self.edition.of_spaces(), self.edition.boundary());
        for (i, (members, attributes)) in alone.chain(of_planes).enumerate() {
            let kind = match faces[members[0]].surface {
                FaceKind::Ground => "GroundSurface",
                FaceKind::Roof => "RoofSurface",
                FaceKind::Wall => "WallSurface",
            };
            let (kind, id) = (format!("{}:{kind}", self.edition.of_surfaces()), format!("{}_surface{i}", object.id));
            writeln!(out, "<{boundary}><{kind} gml:id=\"{id}\">")?;
            self.generics(out, &attributes)?;
            let of_geometry = self.edition.id_of_geometry(&format!("{id}_faces"));
            writeln!(out, "<{spaces}:lod2MultiSurface><gml:MultiSurface{of_geometry}>")?;
            for i in members {
                self.member(out, &faces[i], &format!(" gml:id=\"{}_face{i}\"", object.id))?;
            }
            writeln!(out, "</gml:MultiSurface></{spaces}:lod2MultiSurface></{kind}></{boundary}>")?;
        }
        Ok(())
    }

    /// A polygon as a member of a surface; `id` is an attribute, or nothing.
    fn member(&self, out: &mut dyn Write, face: &GridFace, id: &str) -> io::Result<()> {
        write!(out, "<gml:surfaceMember><gml:Polygon{id}>")?;
        for (i, ring) in face.rings.iter().enumerate() {
            let role = if i == 0 { "exterior" } else { "interior" };
            let places = self.places(ring);
            write!(
                out,
                "<gml:{role}><gml:LinearRing><gml:posList srsDimension=\"3\">{places}</gml:posList></gml:LinearRing></gml:{role}>"
            )?;
        }
        writeln!(out, "</gml:Polygon></gml:surfaceMember>")
    }

    /// The corners of a ring, closed.
    fn places(&self, ring: &[[i64; 3]]) -> String {
        let corner = |at: &[i64; 3]| {
            let [x, y, z] = self.grid.metres(*at);
            format!("{x:.3} {y:.3} {z:.3}")
        };
        ring.iter().chain(ring.first()).map(corner).collect::<Vec<_>>().join(" ")
    }

    fn address(&self, out: &mut dyn Write, id: &str, address: Option<&Address>) -> io::Result<()> {
        let Some(address) = address else { return Ok(()) };
        let (id, details) = match self.edition {
            Edition::V2 => (String::new(), address.to_xal2()),
            Edition::V3 => (format!(" gml:id=\"{id}_address\""), address.to_xal3()),
        };
        writeln!(
            out,
            "<bldg:address><core:Address{id}><core:xalAddress>{details}</core:xalAddress></core:Address></bldg:address>"
        )
    }

    /// Attributes as generic ones, those without a value left out.
    fn generics(&self, out: &mut dyn Write, all: &JsonMap<String, Value>) -> io::Result<()> {
        for (name, value) in all {
            let (kind, text) = match value {
                Value::Null => continue,
                Value::Number(number) if number.is_i64() => ("int", number.to_string()),
                Value::Number(number) => ("double", number.to_string()),
                Value::String(text) => ("string", text.clone()),
                Value::Array(items) if items.is_empty() => continue,
                Value::Array(items) => {
                    let word = |item: &Value| item.as_str().map_or_else(|| item.to_string(), str::to_owned);
                    ("string", items.iter().map(word).collect::<Vec<_>>().join(LIST_SEPARATOR))
                }
                Value::Bool(_) | Value::Object(_) => ("string", value.to_string()),
            };
            let (name, text) = (escape(name.as_str()), escape(printable(&text)));
            writeln!(out, "{}", self.edition.generic(kind, &name, &text))?;
        }
        Ok(())
    }
}

/// A text without the letters that XML has no place for.
fn printable(text: &str) -> String {
    text.chars().filter(|letter| !letter.is_control() || matches!(letter, '\t' | '\n' | '\r')).collect()
}

/// Code of a roof's form in ALKIS ("Dachform").
fn roof_type(form: RoofForm) -> u32 {
    match form {
        RoofForm::Flat => 1000,
        RoofForm::Gable => 3100,
        RoofForm::Hip => 3200,
        RoofForm::Stepped => 5000,
    }
}

/// An id as an XML name may be: letters and digits as they are, all others by their number, so that no two become one.
fn xml_id(id: &str) -> String {
    let letter = |letter: char| match letter {
        'a'..='z' | 'A'..='Z' | '0'..='9' | '-' | '.' => letter.to_string(),
        other => format!("_{:x}_", u32::from(other)),
    };
    format!("b_{}", id.chars().map(letter).collect::<String>())
}
