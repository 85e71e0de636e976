//! `CityGML` 2.0 (OGC 12-019) with blocks (LOD 1), roofs (LOD 2), heights, roof types and storeys, for databases and agencies that take
//! GML only.
//!
//! ```text
//! Building or BuildingPart
//!   gml:name                  the id of the input; gml:id is that in letters that an XML name may have
//!   gen:…Attribute            all attributes, ours and the user's
//!   roofType                  code of the roof's form in ALKIS, as AdV's profile has it: 1000 flat, 3100 gable, 3200 hip, 5000 combined forms
//!   measuredHeight            height above ground of the highest place of the roof, metres
//!   storeysAboveGround        estimated ([`super::attributes`])
//!   RoofSurface               one for each plane of the roof, with area, slope and aspect as generic attributes
//!   lod1Solid, lod2Solid      the second by reference to the faces of the thematic surfaces
//!   lod1TerrainIntersection   outline of the ground face: where the walls of the solid end
//!   address                   xAL, where the input states one in OpenStreetMap's names ([`super::address`])
//! ```
//!
//! The elements are in the order of the schema.

use std::io::{self, Write};
use std::path::Path;

use quick_xml::escape::escape;
use serde_json::{Map as JsonMap, Value};

use super::address::Address;
use super::attributes;
use super::buildings::Family;
use super::facts::SolidFacts;
use super::footprints::LIST_SEPARATOR;
use super::grid::{OutputGrid, SCALE_M};
use super::mesh::cannot_write;
use super::prism::{FaceKind, GridFace, MIN_THICKNESS_M};
use super::roof_solid::RoofSurface;
use super::{BuildingRecord, CityModel, Families, OutputError, Overview, Records, RoofForm};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_whole_or;

const NAMESPACES: &str = "xmlns:core=\"http://www.opengis.net/citygml/2.0\" xmlns:bldg=\"http://www.opengis.net/citygml/building/2.0\" \
     xmlns:gen=\"http://www.opengis.net/citygml/generics/2.0\" xmlns:gml=\"http://www.opengis.net/gml\" \
     xmlns:xlink=\"http://www.w3.org/1999/xlink\" xmlns:xAL=\"urn:oasis:names:tc:ciq:xsdschema:xAL:2.0\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
     xsi:schemaLocation=\"http://www.opengis.net/citygml/building/2.0 http://schemas.opengis.net/citygml/building/2.0/building.xsd \
     http://www.opengis.net/citygml/generics/2.0 http://schemas.opengis.net/citygml/generics/2.0/generics.xsd\"";

/// Writes `path` (`….gml`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, the file system.
pub fn write<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    let day = model.lineage.reference_date.as_deref();
    let writer = GmlWriter { grid: &grid, has_roofs: overview.has_roofs, day };
    write_whole_or(path, |out| {
        let failed = |e| cannot_write(path, e);
        head(out, model.crs, &overview).map_err(failed)?;
        let mut families = Families::new(&overview);
        model.records.visit(&mut |record| match families.add(record) {
            Some(family) => writer.family(out, &family).map_err(failed),
            None => Ok(()),
        })?;
        writeln!(out, "</core:CityModel>").map_err(failed)
    })?;
    Ok(overview)
}

fn head(out: &mut dyn Write, crs: &Crs, overview: &Overview) -> io::Result<()> {
    writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<core:CityModel {NAMESPACES}>")?;
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
    grid: &'a OutputGrid,
    has_roofs: bool,
    day: Option<&'a str>,
}

impl GmlWriter<'_> {
    fn family(&self, out: &mut dyn Write, family: &Family<'_>) -> io::Result<()> {
        out.write_all(b"<core:cityObjectMember>\n")?;
        match family {
            Family::Single(record) => self.object(out, "Building", record)?,
            Family::Parts(id, parts) => {
                writeln!(out, "<bldg:Building gml:id=\"{}\">", xml_id(id))?;
                self.naming(out, id)?;
                let carried = parts.iter().flat_map(attributes::carried).collect();
                generics(out, &carried)?;
                for part in parts {
                    out.write_all(b"<bldg:consistsOfBuildingPart>\n")?;
                    self.object(out, "BuildingPart", part)?;
                    out.write_all(b"</bldg:consistsOfBuildingPart>\n")?;
                }
                address(out, parts.iter().find_map(|part| Address::of(&part.attributes)))?;
                out.write_all(b"</bldg:Building>\n")?;
            }
        }
        out.write_all(b"</core:cityObjectMember>\n")
    }

    fn naming(&self, out: &mut dyn Write, id: &str) -> io::Result<()> {
        writeln!(out, "<gml:name>{}</gml:name>", escape(id))?;
        match self.day {
            Some(day) => writeln!(out, "<core:creationDate>{}</core:creationDate>", escape(day)),
            None => Ok(()),
        }
    }

    fn object(&self, out: &mut dyn Write, kind: &str, record: &BuildingRecord) -> io::Result<()> {
        let id = xml_id(&record.id);
        let (prism, facts) = SolidFacts::of(record, self.grid, MIN_THICKNESS_M);
        writeln!(out, "<bldg:{kind} gml:id=\"{id}\">")?;
        self.naming(out, &record.id)?;
        let mut all = attributes::own(record, &facts);
        all.remove(attributes::MEASURED_HEIGHT);
        let storeys = all.get("storeys_estimated").and_then(Value::as_i64);
        if record.part_of.is_none() {
            all.extend(attributes::carried(record));
        }
        generics(out, &all)?;
        if let Some(roof) = record.roof {
            writeln!(out, "<bldg:roofType>{}</bldg:roofType>", roof_type(roof.form))?;
        }
        let ridge_m = record.roof.map(|roof| roof.ridge_height_m);
        if let Some(height_m) =
            record.height_m.map(|height_m| ridge_m.map_or(height_m, |ridge_m| ridge_m.max(height_m)))
        {
            writeln!(out, "<bldg:measuredHeight uom=\"m\">{height_m:.3}</bldg:measuredHeight>")?;
        }
        if let Some(storeys) = storeys {
            writeln!(out, "<bldg:storeysAboveGround>{storeys}</bldg:storeysAboveGround>")?;
        }
        if let Ok(prism) = prism {
            let block = prism.faces();
            out.write_all(b"<bldg:lod1Solid><gml:Solid><gml:exterior><gml:CompositeSurface>\n")?;
            block.iter().try_for_each(|face| self.member(out, face, None))?;
            out.write_all(b"</gml:CompositeSurface></gml:exterior></gml:Solid></bldg:lod1Solid>\n")?;
            self.terrain_intersection(out, &block)?;
            if self.has_roofs {
                let faces = facts.roofed.as_ref().unwrap_or(&block);
                self.thematic(out, &id, faces, &facts.planes_of(record, faces, self.grid))?;
            }
        }
        // That of a part is its building's.
        address(out, Address::of(&record.attributes).filter(|_| record.part_of.is_none()))?;
        writeln!(out, "</bldg:{kind}>")
    }

    /// Where the walls end: the outlines of the ground face.
    fn terrain_intersection(&self, out: &mut dyn Write, faces: &[GridFace]) -> io::Result<()> {
        out.write_all(b"<bldg:lod1TerrainIntersection><gml:MultiCurve>\n")?;
        for ring in faces.iter().filter(|face| face.surface == FaceKind::Ground).flat_map(|face| &face.rings) {
            let places = self.places(ring);
            writeln!(
                out,
                "<gml:curveMember><gml:LineString><gml:posList srsDimension=\"3\">{places}</gml:posList></gml:LineString></gml:curveMember>"
            )?;
        }
        out.write_all(b"</gml:MultiCurve></bldg:lod1TerrainIntersection>\n")
    }

    /// The solid with its roof, and the surfaces that it is made of: one for each plane of the roof and each wall.
    fn thematic(&self, out: &mut dyn Write, id: &str, faces: &[GridFace], planes: &[RoofSurface]) -> io::Result<()> {
        out.write_all(b"<bldg:lod2Solid><gml:Solid><gml:exterior><gml:CompositeSurface>\n")?;
        for i in 0..faces.len() {
            writeln!(out, "<gml:surfaceMember xlink:href=\"#{id}_face{i}\"/>")?;
        }
        out.write_all(b"</gml:CompositeSurface></gml:exterior></gml:Solid></bldg:lod2Solid>\n")?;
        let in_planes: Vec<usize> = planes.iter().flat_map(|plane| plane.faces.iter().copied()).collect();
        let alone = (0..faces.len()).filter(|i| !in_planes.contains(i)).map(|i| (vec![i], JsonMap::new()));
        let of_planes = planes.iter().map(|plane| (plane.faces.clone(), plane.facet.attributes()));
        for (i, (members, attributes)) in alone.chain(of_planes).enumerate() {
            let kind = match faces[members[0]].surface {
                FaceKind::Ground => "GroundSurface",
                FaceKind::Roof => "RoofSurface",
                FaceKind::Wall => "WallSurface",
            };
            writeln!(out, "<bldg:boundedBy><bldg:{kind} gml:id=\"{id}_surface{i}\">")?;
            generics(out, &attributes)?;
            writeln!(out, "<bldg:lod2MultiSurface><gml:MultiSurface>")?;
            members.iter().try_for_each(|i| self.member(out, &faces[*i], Some(&format!("{id}_face{i}"))))?;
            writeln!(out, "</gml:MultiSurface></bldg:lod2MultiSurface></bldg:{kind}></bldg:boundedBy>")?;
        }
        Ok(())
    }

    /// A polygon as a member of a surface.
    fn member(&self, out: &mut dyn Write, face: &GridFace, id: Option<&str>) -> io::Result<()> {
        let named = id.map_or_else(String::new, |id| format!(" gml:id=\"{id}\""));
        write!(out, "<gml:surfaceMember><gml:Polygon{named}>")?;
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
}

fn address(out: &mut dyn Write, address: Option<Address>) -> io::Result<()> {
    address.map_or(Ok(()), |address| writeln!(out, "{}", address.to_gml()))
}

/// Attributes as generic ones, those without a value left out.
fn generics(out: &mut dyn Write, all: &JsonMap<String, Value>) -> io::Result<()> {
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
        writeln!(out, "<gen:{kind}Attribute name=\"{name}\"><gen:value>{text}</gen:value></gen:{kind}Attribute>")?;
    }
    Ok(())
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
