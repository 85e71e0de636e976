//! A QGIS project beside a `GeoPackage`: opens all layers styled, in order, in the right place and extent.
//!
//! The 2D and 3D styles are those of the `GeoPackage`'s own table, so both ways of opening it look the same. QGIS fills
//! in everything that the file leaves out with its defaults; `tests/qgis/project.py` opens one in a real QGIS.

use std::fmt::Write as _;
use std::path::Path;

use quick_xml::escape::escape;

use super::super::grid::Extent;
use super::super::{CityModel, OutputError, Overview, Records};
use super::GeoPackageConfig;
use super::tables::STYLES;
use crate::crs::Crs;
use crate::files::write_whole;

/// Layers from the top of the legend down, and whether they are drawn.
const LEGEND: [(&str, bool); 5] =
    [("qa_issues", true), ("cameras", true), ("buildings", true), ("buildings_lod1", false), ("tiles", false)];

/// Before a layer's name in its id: QGIS takes short ids for damaged ones and makes up others.
const ID_PREFIX: &str = "sizeup_layer_";

/// Room around the buildings, as a share of their larger side.
const MARGIN_SHARE: f64 = 0.05;

/// Writes `path` (`….qgs`) for a `GeoPackage` that lies in the same folder.
///
/// # Errors
/// [`OutputError`]: buildings that cannot be read, the file system.
pub fn write_project<R: Records + ?Sized>(
    path: &Path,
    geopackage: &str,
    model: &CityModel<'_, R>,
    config: &GeoPackageConfig,
) -> Result<(), OutputError> {
    let overview = Overview::of(model.records)?;
    let layers: Vec<(&str, bool)> =
        LEGEND.into_iter().filter(|(name, _)| config.solids || *name != "buildings_lod1").collect();
    let crs = spatial_reference(model.crs);
    let mut text = String::from("<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n");
    let title = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let title = escape(&title);
    // Writing to a String does not fail.
    let _ = write!(
        text,
        "<qgis version=\"3.22.16\" projectname=\"{title}\">\n<title>{title}</title>\n<projectCrs>{crs}</projectCrs>\n"
    );
    text.push_str("<layer-tree-group>\n");
    for (name, is_drawn) in &layers {
        let checked = if *is_drawn { "Qt::Checked" } else { "Qt::Unchecked" };
        let _ = writeln!(
            text,
            "<layer-tree-layer id=\"{ID_PREFIX}{name}\" name=\"{name}\" checked=\"{checked}\" expanded=\"1\" providerKey=\"ogr\"/>"
        );
    }
    text.push_str("</layer-tree-group>\n");
    if let Some(extent) = &overview.extent {
        let _ = writeln!(
            text,
            "<mapcanvas name=\"theMapCanvas\"><units>meters</units>{}<destinationsrs>{crs}</destinationsrs></mapcanvas>",
            canvas(extent)
        );
    }
    text.push_str("<projectlayers>\n");
    for (name, _) in &layers {
        let _ = writeln!(
            text,
            "<maplayer type=\"vector\"><id>{ID_PREFIX}{name}</id><datasource>./{}|layername={name}</datasource>\
             <layername>{name}</layername><srs>{crs}</srs><provider encoding=\"UTF-8\">ogr</provider>{}</maplayer>",
            escape(geopackage),
            style_of(name)
        );
    }
    text.push_str("</projectlayers>\n<layerorder>");
    for (name, _) in &layers {
        let _ = write!(text, "<layer id=\"{ID_PREFIX}{name}\"/>");
    }
    // Paths relative to the project: the folder can be moved.
    text.push_str(
        "</layerorder>\n<properties><Paths><Absolute type=\"bool\">false</Absolute></Paths>\
         <SpatialRefSys><ProjectionsEnabled type=\"int\">1</ProjectionsEnabled></SpatialRefSys></properties>\n</qgis>\n",
    );
    write_whole(path, |out| out.write_all(text.as_bytes()))?;
    Ok(())
}

/// The CRS by its code, of its horizontal part where the whole has none. QGIS looks at the code only beside a number
/// in its own database, and then trusts the code: any number will do.
fn spatial_reference(crs: &Crs) -> String {
    let code = crs.epsg().or_else(|| crs.horizontal_epsg());
    code.map_or_else(String::new, |code| {
        format!("<spatialrefsys><srsid>1</srsid><srid>{code}</srid><authid>EPSG:{code}</authid></spatialrefsys>")
    })
}

fn canvas(extent: &Extent) -> String {
    let [west, south, _] = extent.min_m;
    let [east, north, _] = extent.max_m;
    let margin = MARGIN_SHARE * (east - west).max(north - south);
    let corner = |name: &str, value: f64| format!("<{name}>{value:.3}</{name}>");
    format!(
        "<extent>{}{}{}{}</extent>",
        corner("xmin", west - margin),
        corner("ymin", south - margin),
        corner("xmax", east + margin),
        corner("ymax", north + margin)
    )
}

/// What is inside the root element of a layer's style.
fn style_of(layer: &str) -> &'static str {
    let qml = STYLES.iter().find(|(name, _)| *name == layer).map_or("", |(_, qml)| *qml);
    let inside = qml.find("<qgis").and_then(|start| qml[start..].find('>').map(|end| &qml[start + end + 1..]));
    inside.and_then(|text| text.rfind("</qgis>").map(|end| &text[..end])).unwrap_or("")
}
