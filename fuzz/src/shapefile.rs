//! Shapefiles, of whose three files one is the input and the others are sound.

use std::error::Error;
use std::fs;
use std::path::Path;
use std::sync::Once;

use gdal::DriverManager;
use gdal::spatial_ref::SpatialRef;
use gdal::vector::{FieldDefn, Geometry, LayerAccess as _, LayerOptions, OGRFieldType, OGRwkbGeometryType};

/// The three that belong together.
pub const PARTS: [&str; 3] = ["shp", "shx", "dbf"];

/// Writes `a.shp` and what belongs to it into a folder: two footprints, one with a hole, and their names.
pub fn write(folder: &Path) -> Result<(), Box<dyn Error>> {
    let utm = SpatialRef::from_epsg(25832)?;
    let path = folder.join("a.shp");
    let mut dataset = DriverManager::get_driver_by_name("ESRI Shapefile")?.create_vector_only(&path)?;
    let ty = OGRwkbGeometryType::wkbPolygon;
    let layer = dataset.create_layer(LayerOptions { name: "a", srs: Some(&utm), ty, ..LayerOptions::default() })?;
    FieldDefn::new("id", OGRFieldType::OFTString)?.add_to_layer(&layer)?;
    FieldDefn::new("floors", OGRFieldType::OFTReal)?.add_to_layer(&layer)?;
    for (id, footprint) in [
        ("a", "POLYGON ((5e5 57e5, 500009 57e5, 500009 5700009, 5e5 57e5))"),
        (
            "b",
            "POLYGON ((500020 57e5, 500040 57e5, 500040 5700020, 500020 5700020, 500020 57e5), \
             (500025 5700005, 500025 5700010, 500030 5700010, 500025 5700005))",
        ),
    ] {
        let mut feature = gdal::vector::Feature::new(layer.defn())?;
        feature.set_geometry(Geometry::from_wkt(footprint)?)?;
        feature.set_field_string(0, id)?;
        feature.set_field_double(1, 2.5)?;
        feature.create(&layer)?;
    }
    Ok(())
}

/// Reads the layer that an input is part of.
pub fn read(input: &Path) {
    static BESIDE: Once = Once::new();
    BESIDE.call_once(|| {
        let place = tempfile::tempdir().expect("a folder can be made");
        write(place.path()).expect("a shapefile can be written");
        for part in PARTS.iter().map(|part| input.with_extension(part)).filter(|path| path != input) {
            fs::copy(place.path().join(part.file_name().expect("it has a name")), part).expect("it can be copied");
        }
    });
    super::layer(&input.with_extension("shp"));
}
