//! Where the editions of `CityGML` differ: namespaces, order and names of elements.

use quick_xml::escape::escape;

/// Edition of `CityGML`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edition {
    /// `CityGML` 2.0 (OGC 12-019), on GML 3.1.
    V2,
    /// `CityGML` 3.0 (OGC 21-006r2), on GML 3.2.
    V3,
}

/// Property of a building, or several that belong together.
#[derive(Debug, Clone, Copy)]
pub(super) enum Property {
    RoofType,
    Height,
    Storeys,
    Lod1Solid,
    Lod2Solid,
    TerrainLine,
    Surfaces,
    Address,
}

const IN_2: &str = "xmlns:core=\"http://www.opengis.net/citygml/2.0\" xmlns:bldg=\"http://www.opengis.net/citygml/building/2.0\" \
     xmlns:gen=\"http://www.opengis.net/citygml/generics/2.0\" xmlns:gml=\"http://www.opengis.net/gml\" \
     xmlns:xlink=\"http://www.w3.org/1999/xlink\" xmlns:xAL=\"urn:oasis:names:tc:ciq:xsdschema:xAL:2.0\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
     xsi:schemaLocation=\"http://www.opengis.net/citygml/building/2.0 http://schemas.opengis.net/citygml/building/2.0/building.xsd \
     http://www.opengis.net/citygml/generics/2.0 http://schemas.opengis.net/citygml/generics/2.0/generics.xsd\"";

const IN_3: &str = "xmlns:core=\"http://www.opengis.net/citygml/3.0\" xmlns:con=\"http://www.opengis.net/citygml/construction/3.0\" \
     xmlns:bldg=\"http://www.opengis.net/citygml/building/3.0\" xmlns:gen=\"http://www.opengis.net/citygml/generics/3.0\" \
     xmlns:gml=\"http://www.opengis.net/gml/3.2\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" xmlns:xAL=\"urn:oasis:names:tc:ciq:xal:3\" \
     xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
     xsi:schemaLocation=\"http://www.opengis.net/citygml/building/3.0 http://schemas.opengis.net/citygml/building/3.0/building.xsd \
     http://www.opengis.net/citygml/generics/3.0 http://schemas.opengis.net/citygml/generics/3.0/generics.xsd\" gml:id=\"city\"";

impl Edition {
    pub(super) fn namespaces(self) -> &'static str {
        match self {
            Self::V2 => IN_2,
            Self::V3 => IN_3,
        }
    }

    /// Properties in the order of the schema.
    pub(super) fn properties(self) -> [Property; 8] {
        use Property::{Address, Height, Lod1Solid, Lod2Solid, RoofType, Storeys, Surfaces, TerrainLine};
        match self {
            Self::V2 => [RoofType, Height, Storeys, Lod1Solid, TerrainLine, Lod2Solid, Surfaces, Address],
            Self::V3 => [Surfaces, Lod1Solid, Lod2Solid, TerrainLine, Height, RoofType, Storeys, Address],
        }
    }

    /// The id of a geometry as an attribute; GML 3.2 wants one, GML 3.1 takes it only where it is referred to.
    pub(super) fn id_of_geometry(self, id: &str) -> String {
        match self {
            Self::V2 => String::new(),
            Self::V3 => format!(" gml:id=\"{id}\""),
        }
    }

    /// Namespace of the geometries of buildings and surfaces.
    pub(super) fn of_spaces(self) -> &'static str {
        match self {
            Self::V2 => "bldg",
            Self::V3 => "core",
        }
    }

    /// Namespace of roofs, walls and ground.
    pub(super) fn of_surfaces(self) -> &'static str {
        match self {
            Self::V2 => "bldg",
            Self::V3 => "con",
        }
    }

    /// Property of a building that holds a surface.
    pub(super) fn boundary(self) -> &'static str {
        match self {
            Self::V2 => "bldg:boundedBy",
            Self::V3 => "core:boundary",
        }
    }

    /// Property of a building that holds a part.
    pub(super) fn part(self) -> &'static str {
        match self {
            Self::V2 => "bldg:consistsOfBuildingPart",
            Self::V3 => "bldg:buildingPart",
        }
    }

    /// Outside of a solid.
    pub(super) fn shell(self) -> &'static str {
        match self {
            Self::V2 => "gml:CompositeSurface",
            Self::V3 => "gml:Shell",
        }
    }

    /// Where the terrain meets the walls.
    pub(super) fn terrain_line(self) -> &'static str {
        match self {
            Self::V2 => "bldg:lod1TerrainIntersection",
            Self::V3 => "core:lod1TerrainIntersectionCurve",
        }
    }

    /// Day of creation: 3.0 wants a time too.
    pub(super) fn creation(self, day: &str) -> String {
        let time = match self {
            Self::V2 => "",
            Self::V3 => "T00:00:00",
        };
        format!("<core:creationDate>{}{time}</core:creationDate>", escape(day))
    }

    /// A generic attribute; its kind is `int`, `double` or `string`, its text is escaped.
    pub(super) fn generic(self, kind: &str, name: &str, text: &str) -> String {
        match self {
            Self::V2 => {
                format!("<gen:{kind}Attribute name=\"{name}\"><gen:value>{text}</gen:value></gen:{kind}Attribute>")
            }
            Self::V3 => {
                let kind = kind[..1].to_uppercase() + &kind[1..];
                format!(
                    "<core:genericAttribute><gen:{kind}Attribute><gen:name>{name}</gen:name><gen:value>{text}</gen:value></gen:{kind}Attribute>\
                     </core:genericAttribute>"
                )
            }
        }
    }
}
