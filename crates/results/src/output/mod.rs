//! Results on disk: one record per building, and one file per format that writes them.
//!
//! | format | writer | for |
//! |---|---|---|
//! | CityJSON 2.0 | [`cityjson`] | exchange, 3DCityDB, validators |
//! | `CityGML` 2.0 and 3.0 | [`citygml`] | agencies and databases that take GML |
//! | CityJSONSeq 2.0 | [`cityjson::write_sequence`] | streams, tilers |
//! | GeoPackage 1.2 | [`geopackage`] | QGIS, any GIS |
//! | FlatCityBuf | `flatcitybuf`, with the feature of that name | solids over the web, one file |
//! | FlatGeobuf | [`flatgeobuf`] | footprints and heights over the web |
//! | GeoJSON | [`geojson`] | footprints and heights in longitude and latitude, for web maps |
//! | 3D Tiles 1.1 | [`tiles3d`] | Cesium, digital twins |
//! | KML | [`kml`] | blocks on a globe |
//! | CSV | [`csv`] | tables, with the meanings of their columns |
//! | OBJ, STL | [`mesh`] | modelling, printers |
//! | DXF | [`dxf`] | CAD |
//! | CityJSON and glTF with pictures | [`textured`] | viewers, Blender, game engines: the city with textures from the photos |
//! | PNG | [`picture`] | a first look |
//! | JSON | [`reports`] | pipelines |
//!
//! [`read`] brings results and references back, [`validate`] checks the solids of any `CityJSON` file. Solids
//! are blocks ([`prism`]), and beside them those with roofs ([`roof_solid`]).
//!
//! All of them take one [`CityModel`]; every building of the input is in every file, with a status and reasons. Only
//! `FlatGeobuf` has no place for those without a footprint, and 3D Tiles for those without a height. A model's buildings
//! may be in memory or come from a file one by one ([`Records`]).

mod address;
pub mod attributes;
mod buildings;
pub mod citygml;
pub mod cityjson;
mod count;
pub mod csv;
pub mod dxf;
mod error;
mod facts;
pub mod fallback;
#[cfg(feature = "flatcitybuf")]
pub mod flatcitybuf;
pub mod flatgeobuf;
pub mod footprint;
mod footprints;
pub mod geojson;
pub mod geopackage;
pub mod grid;
pub mod kml;
mod lineage;
pub mod mesh;
mod palette;
pub mod party_walls;
pub mod picture;
pub mod planar;
pub mod plausible;
pub mod prism;
pub mod read;
pub(crate) mod record;
pub mod reports;
pub mod reviews;
pub mod roof_solid;
mod summary;
pub mod textured;
pub mod tiles3d;
pub(crate) mod triangles;
pub mod unmeasured;
pub mod validate;
pub(crate) mod wkb;

use sizeup_geo::crs::Crs;
use sizeup_geo::issue::Issue;
use sizeup_survey::Survey;

pub use buildings::{Families, Family, Overview, Records};
pub use count::StatusCount;
pub use error::{MalformedFile, OutputError};
pub use footprints::FootprintRows;
pub use lineage::{InputFile, Lineage, sha256_hex};
pub use record::{BuildingRecord, RoofShape, Status};
pub use sizeup_heights::scene::{HeightReference, RoofForm};
pub use summary::{RunSummary, TilesSummary, n_photos_missing};

/// Everything a writer needs to know of a result.
#[derive(Debug)]
pub struct CityModel<'a, R: ?Sized = [BuildingRecord]> {
    /// Every building of the input, in the order in which it is to be written.
    pub records: &'a R,
    /// The project's CRS; may be a compound.
    pub crs: &'a Crs,
    /// Lineage of the result.
    pub lineage: &'a Lineage,
    /// Issues of single items of the input.
    pub issues: &'a [Issue],
    /// The photos and their poses.
    pub survey: &'a Survey,
}

impl<R: ?Sized> Clone for CityModel<'_, R> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<R: ?Sized> Copy for CityModel<'_, R> {}
