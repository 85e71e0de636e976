//! Layers about views (camera points, view axes, image footprints) as a `GeoPackage`.

use std::path::Path;

use gdal::errors::GdalError;
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};
use gdal::vector::{Feature, FieldDefn, Geometry, LayerAccess as _, LayerOptions, OGRFieldType, OGRwkbGeometryType};
use gdal::{Dataset, DriverManager};
use glam::DVec3;

/// Appearance of a feature, in the layer's CRS with heights.
#[derive(Debug, Clone, PartialEq)]
pub enum FeatureShape {
    /// A point, in the layer's CRS with heights.
    Point(DVec3),
    /// A line through these points, in the layer's CRS with heights.
    Line(Vec<DVec3>),
    /// A polygon by its outer ring, whose first point is not repeated.
    Polygon(Vec<DVec3>),
}

/// Attributes of a feature.
#[derive(Debug, Clone, PartialEq)]
pub struct Attributes {
    /// Name of the view that the feature is of.
    pub name: String,
    /// Kind of the view: `nadir` or `oblique`.
    pub kind: &'static str,
    /// Named numbers, the same names for all features of a layer.
    pub numbers: Vec<(&'static str, f64)>,
}

/// A layer of one kind of shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Name of the table.
    pub name: &'static str,
    /// In the order of the views.
    pub features: Vec<(FeatureShape, Attributes)>,
}

impl Layer {
    /// A layer of this name without features.
    #[must_use]
    pub fn new(name: &'static str) -> Self {
        Self { name, features: Vec::new() }
    }
}

/// Writes all layers into a new file.
///
/// # Errors
/// GDAL's: a CRS that it does not know, a file that cannot be written.
pub fn write_geopackage(layers: &[Layer], crs: &str, path: &Path) -> Result<(), GdalError> {
    let mut srs = SpatialRef::from_definition(crs)?;
    srs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    let mut dataset = DriverManager::get_driver_by_name("GPKG")?.create_vector_only(path)?;
    for layer in layers {
        write_layer(&mut dataset, layer, &srs)?;
    }
    dataset.close()
}

fn write_layer(dataset: &mut Dataset, layer: &Layer, srs: &SpatialRef) -> Result<(), GdalError> {
    let ty = match layer.features.first() {
        Some((FeatureShape::Line(_), _)) => OGRwkbGeometryType::wkbLineString25D,
        Some((FeatureShape::Polygon(_), _)) => OGRwkbGeometryType::wkbPolygon25D,
        Some((FeatureShape::Point(_), _)) | None => OGRwkbGeometryType::wkbPoint25D,
    };
    let mut transaction = dataset.start_transaction()?;
    let table = transaction.create_layer(LayerOptions { name: layer.name, srs: Some(srs), ty, options: None })?;
    FieldDefn::new("name", OGRFieldType::OFTString)?.add_to_layer(&table)?;
    FieldDefn::new("kind", OGRFieldType::OFTString)?.add_to_layer(&table)?;
    for (name, _) in layer.features.first().map_or(&[][..], |(_, attributes)| &attributes.numbers) {
        FieldDefn::new(name, OGRFieldType::OFTReal)?.add_to_layer(&table)?;
    }
    for (shape, attributes) in &layer.features {
        let mut feature = Feature::new(table.defn())?;
        feature.set_geometry(geometry(shape)?)?;
        feature.set_field_string(0, &attributes.name)?;
        feature.set_field_string(1, attributes.kind)?;
        for (i, (_, number)) in attributes.numbers.iter().enumerate() {
            feature.set_field_double(i + 2, *number)?;
        }
        feature.create(&table)?;
    }
    transaction.commit()?;
    Ok(())
}

fn geometry(shape: &FeatureShape) -> Result<Geometry, GdalError> {
    let line = |ty, points: &mut dyn Iterator<Item = &DVec3>| {
        let mut line = Geometry::empty(ty)?;
        points.for_each(|p| line.add_point((p.x, p.y, p.z)));
        Ok::<Geometry, GdalError>(line)
    };
    match shape {
        FeatureShape::Point(p) => line(OGRwkbGeometryType::wkbPoint25D, &mut std::iter::once(p)),
        FeatureShape::Line(points) => line(OGRwkbGeometryType::wkbLineString25D, &mut points.iter()),
        FeatureShape::Polygon(ring) => {
            let mut polygon = Geometry::empty(OGRwkbGeometryType::wkbPolygon25D)?;
            polygon.add_geometry(line(OGRwkbGeometryType::wkbLinearRing, &mut ring.iter().chain(ring.first()))?)?;
            Ok(polygon)
        }
    }
}
