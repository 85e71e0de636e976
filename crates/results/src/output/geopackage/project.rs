//! A QGIS project beside a `GeoPackage`: opens all layers styled, in order, in the right place and extent.
//!
//! The 2D and 3D styles and the names of fields are those of the `GeoPackage`'s own tables, so both ways of opening it look the same. The 3D view
//! stands on the ground: a terrain model as terrain and hillshade, or a plane at the ground's level. A print layout has
//! map, legend, scale and sources. QGIS fills in everything that the file leaves out with its defaults;
//! `tests/qgis/project.py` opens one in a real QGIS.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Cursor, Write as _};
use std::path::Path;

use quick_xml::escape::escape;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use super::super::grid::Extent;
use super::super::{CityModel, Lineage, OutputError, Overview, Records};
use super::is_written;
use super::layers::columns_of;
use super::tables::STYLES;
use sizeup_geo::crs::{Crs, Transform};
use sizeup_geo::files::{FileError, write_whole};
use sizeup_geo::geodata::features::Column;
use sizeup_geo::geodata::qml::aliases;
use sizeup_geo::geodata::wkt_of;

/// Ground of a project's 3D view.
#[derive(Debug, Clone, Copy)]
pub enum ProjectGround<'a> {
    /// A plane at the lowest wall, where nothing else is known.
    LowestWall,
    /// A plane at this level, metres.
    Level(f64),
    /// A terrain model as a raster.
    Model {
        /// The raster, as seen from the project's folder.
        path: &'a Path,
        /// CRS; QGIS takes it to be the project's without.
        crs: Option<&'a Crs>,
        /// Metres per unit of its heights.
        unit_m: f64,
        /// Added to its heights, metres.
        offset_m: f64,
    },
}

/// Heights that QGIS takes for no value whatever the raster's own nodata tag names, metres: no ground has them.
const NO_GROUND_M: [(f64, f64); 2] = [(f64::NEG_INFINITY, -1000.0), (9000.0, f64::INFINITY)];

/// A layer of the legend: its name, whether it is drawn, and the group it is in.
type LegendEntry = (&'static str, bool, Option<&'static str>);

/// The group of what is about the photos, closed and not drawn: arrows lie over the town else.
const SURVEY_GROUP: &str = "survey";

/// Layers from the top of the legend down.
const LEGEND: [LegendEntry; 8] = [
    ("qa_issues", true, None),
    ("footprints_moved", true, None),
    ("buildings", true, None),
    ("buildings_lod1", false, None),
    ("buildings_lod13", false, None),
    ("buildings_lod2", true, None),
    ("cameras", true, Some(SURVEY_GROUP)),
    ("tiles", false, Some(SURVEY_GROUP)),
];

/// Titles of layers in the legend of the printed page, where their names tell a reader nothing.
const TITLES: [(&str, &str); 6] = [
    ("qa_issues", "To be looked at"),
    ("footprints_moved", "Where the photos show them"),
    ("buildings", "Height above ground"),
    ("cameras", "Photos"),
    ("tiles", "Tiles of the computation"),
    (TERRAIN, "Terrain"),
];

/// The terrain model's name in the legend, below all others.
const TERRAIN: &str = "terrain";

/// Before a layer's name in its id: QGIS takes short ids for damaged ones and makes up others.
const ID_PREFIX: &str = "sizeup_layer_";

/// Room around the buildings, as a share of their larger side.
const MARGIN_SHARE: f64 = 0.05;

/// The print layout, exported from QGIS by `tests/qgis/styles.py`, and what is put in place of its words.
const LAYOUT: &str = include_str!("styles/layout.xml");
const LAYOUT_TITLE: &str = "SIZEUP_TITLE";
const LAYOUT_PLACE: &str = "SIZEUP_PLACE";
const LAYOUT_SOURCES: &str = "SIZEUP_SOURCES";
/// Title of the layout; the project's name follows, unless it is the one that all results have.
const LAYOUT_HEADING: &str = "Heights of buildings";
const COMMON_NAME: &str = "city";
/// Width and height of the layout's map, millimetres.
const LAYOUT_MAP_MM: [f64; 2] = [210.0, 168.0];

/// Camera of the 3D view: so far from straight down and turned so far that walls and roofs show, degrees.
const CAMERA_PITCH_DEG: f64 = 50.0;
const CAMERA_YAW_DEG: f64 = 20.0;
/// Distance of the camera over the diagonal of the town: at half of the field of view of 45° it fills the picture.
const CAMERA_REACHES: f64 = 1.2;

/// Writes `path` (`….qgs`), and the same packed (`….qgz`), for a `GeoPackage` that lies in the same folder.
///
/// # Errors
/// [`OutputError`]: buildings that cannot be read, the file system.
pub fn write_project<R: Records + ?Sized>(
    path: &Path,
    geopackage: &str,
    model: &CityModel<'_, R>,
    ground: ProjectGround<'_>,
) -> Result<(), OutputError> {
    let overview = Overview::of(model.records)?;
    let title = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let project = QgisProject {
        title: escape(title.as_str()).into_owned(),
        geopackage: escape(geopackage).into_owned(),
        crs: spatial_reference(model.crs),
        layers: LEGEND.into_iter().filter(|(name, ..)| is_written(name, &overview)).collect(),
        columns: LEGEND.iter().map(|(name, ..)| (*name, columns_of(name, &overview))).collect(),
        extent: overview.extent,
        ground,
        place: escape(place(model.crs, overview.extent.as_ref(), model.lineage).as_str()).into_owned(),
        sources: escape(sources(model.lineage).as_str()).into_owned(),
    };
    let text = project.text();
    write_whole(path, |out| out.write_all(text.as_bytes()))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let packed_path = path.with_extension("qgz");
    let packed = packed(&name, &text).map_err(|e| FileError::on("cannot pack", &packed_path)(e.into()))?;
    write_whole(&packed_path, |out| out.write_all(&packed))?;
    Ok(())
}

/// The project in an archive, without a clock.
fn packed(name: &str, text: &str) -> zip::result::ZipResult<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    archive.start_file(name, SimpleFileOptions::default().last_modified_time(zip::DateTime::default()))?;
    archive.write_all(text.as_bytes())?;
    Ok(archive.finish()?.into_inner())
}

/// Sources that a map of the city has to name: inputs, program, frame and day.
fn sources(lineage: &Lineage) -> String {
    let mut text = String::new();
    // On paper folders of somebody's machine tell nothing; `lineage.json` has them.
    let name = |path: &'_ str| path.rsplit(['/', '\\']).next().unwrap_or_default().to_owned();
    for (role, word) in [("footprints", "Footprints"), ("survey", "Poses"), ("terrain", "Terrain"), ("city", "City")] {
        let names: Vec<String> =
            lineage.inputs.iter().filter(|input| input.role == role).map(|input| name(&input.path)).collect();
        match names.as_slice() {
            [] => {}
            [only] => drop(write!(text, "{word}: {only}. ")),
            [first, ..] => drop(write!(text, "{word}: {first} and {} more. ", names.len() - 1)),
        }
    }
    let _ = write!(
        text,
        "Heights: sizeup {}, {}. CRS: {}; levels: {}.",
        lineage.version, lineage.height_definition, lineage.crs, lineage.vertical_reference
    );
    text
}

/// Place of the town on the earth, where its CRS has one, and the day of the flight, where somebody or a photo told it.
fn place(crs: &Crs, extent: Option<&Extent>, lineage: &Lineage) -> String {
    let middle_deg = |Extent { min_m: [west, south, _], max_m: [east, north, _] }: &Extent| {
        let to_degrees = Transform::new(crs, &Crs::parse("EPSG:4326").ok()?).ok()?;
        to_degrees.point(f64::midpoint(*west, *east), f64::midpoint(*south, *north)).ok()
    };
    let in_words = |(lon_deg, lat_deg): (f64, f64)| {
        let side = |angle_deg: f64, [positive, negative]: [char; 2]| {
            format!("{:.4}° {}", angle_deg.abs(), if angle_deg < 0.0 { negative } else { positive })
        };
        format!("Place: {}, {}", side(lat_deg, ['N', 'S']), side(lon_deg, ['E', 'W']))
    };
    let day = lineage.reference_date.as_ref().map(|date| format!("Date: {date}"));
    let parts: Vec<String> = extent.and_then(middle_deg).map(in_words).into_iter().chain(day).collect();
    parts.join(" · ")
}

/// Parts of a project file; texts are escaped.
struct QgisProject<'a> {
    title: String,
    geopackage: String,
    crs: String,
    layers: Vec<LegendEntry>,
    /// Columns by layer, whose titles are the aliases.
    columns: BTreeMap<&'static str, Vec<Column>>,
    extent: Option<Extent>,
    ground: ProjectGround<'a>,
    /// Place and day of the town.
    place: String,
    sources: String,
}

// Writing to a String does not fail.
impl QgisProject<'_> {
    fn text(&self) -> String {
        let Self { title, crs, .. } = self;
        let mut text = format!(
            "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n\
             <qgis version=\"3.22.16\" projectname=\"{title}\">\n<title>{title}</title>\n<projectCrs>{crs}</projectCrs>\n"
        );
        self.legend(&mut text);
        if let Some(extent) = &self.extent {
            let _ = writeln!(
                text,
                "<mapcanvas name=\"theMapCanvas\"><units>meters</units>{}<destinationsrs>{crs}</destinationsrs></mapcanvas>",
                canvas(extent)
            );
        }
        self.scene(&mut text);
        self.data_sources(&mut text);
        self.layout(&mut text);
        // Paths relative to the project: the folder can be moved.
        text.push_str(
            "<properties><Paths><Absolute type=\"bool\">false</Absolute></Paths>\
             <SpatialRefSys><ProjectionsEnabled type=\"int\">1</ProjectionsEnabled></SpatialRefSys></properties>\n</qgis>\n",
        );
        text
    }

    /// The tree of layers, as QGIS lists them.
    fn legend(&self, text: &mut String) {
        let leaf = |name: &str, is_drawn: bool, provider: &str| {
            let checked = if is_drawn { "Qt::Checked" } else { "Qt::Unchecked" };
            let titled = TITLES.iter().find(|(layer, _)| *layer == name).map_or_else(String::new, |(_, title)| {
                let option = format!("<Option name=\"legend/title-label\" value=\"{title}\" type=\"QString\"/>");
                format!("<customproperties><Option type=\"Map\">{option}</Option></customproperties>")
            });
            format!(
                "<layer-tree-layer id=\"{ID_PREFIX}{name}\" name=\"{name}\" checked=\"{checked}\" expanded=\"{}\" \
                 providerKey=\"{provider}\">{titled}</layer-tree-layer>\n",
                u8::from(name == "buildings")
            )
        };
        text.push_str("<layer-tree-group>\n");
        for (name, is_drawn, _) in self.layers.iter().filter(|(_, _, group)| group.is_none()) {
            text.push_str(&leaf(name, *is_drawn, "ogr"));
        }
        let _ = writeln!(text, "<layer-tree-group name=\"{SURVEY_GROUP}\" checked=\"Qt::Unchecked\" expanded=\"0\">");
        for (name, is_drawn, _) in self.layers.iter().filter(|(_, _, group)| group.is_some()) {
            text.push_str(&leaf(name, *is_drawn, "ogr"));
        }
        text.push_str("</layer-tree-group>\n");
        if matches!(self.ground, ProjectGround::Model { .. }) {
            text.push_str(&leaf(TERRAIN, true, "gdal"));
        }
        text.push_str("</layer-tree-group>\n");
    }

    /// The 3D view, and the terrain that newer versions give to every new one.
    fn scene(&self, text: &mut String) {
        let Some(Extent { min_m: [west, south, lowest], max_m: [east, north, highest] }) = self.extent else { return };
        let layers = |names: &[&str]| -> String {
            names.iter().map(|name| format!("<layer id=\"{ID_PREFIX}{name}\"/>")).collect()
        };
        let (offset_m, exaggeration, generator, provider, shown) = match self.ground {
            ProjectGround::Model { offset_m, unit_m, .. } => (
                offset_m,
                unit_m,
                format!(
                    "<generator type=\"dem\" layer=\"{ID_PREFIX}{TERRAIN}\" resolution=\"16\" skirt-height=\"10\"/>"
                ),
                format!(
                    "<terrainProvider type=\"raster\"><TerrainProvider offset=\"{offset_m}\" scale=\"{unit_m}\" \
                     layer=\"{ID_PREFIX}{TERRAIN}\"/></terrainProvider>"
                ),
                layers(&["buildings", "buildings_lod2", TERRAIN]),
            ),
            ProjectGround::Level(_) | ProjectGround::LowestWall => {
                let level_m = if let ProjectGround::Level(level_m) = self.ground { level_m } else { lowest };
                (
                    level_m,
                    1.0,
                    format!(
                        "<generator type=\"flat\"><extent xmin=\"{west:.3}\" ymin=\"{south:.3}\" xmax=\"{east:.3}\" \
                         ymax=\"{north:.3}\"/></generator>"
                    ),
                    format!(
                        "<terrainProvider type=\"flat\"><TerrainProvider offset=\"{level_m}\" scale=\"1\"/></terrainProvider>"
                    ),
                    layers(&["buildings", "buildings_lod2"]),
                )
            }
        };
        let _ = writeln!(text, "<ElevationProperties>{provider}</ElevationProperties>");
        // Without point lights of its own QGIS adds one, and colours are brighter than the legend's.
        let _ = writeln!(
            text,
            "<mapViewDocks3D><view name=\"City\" isOpen=\"0\"><qgis3d>\
             <origin x=\"{:.3}\" y=\"{:.3}\" z=\"0\"/>\
             <camera field-of-view=\"45\" camera-navigation-mode=\"terrain-based-navigation\" projection-type=\"1\" \
             camera-movement-speed=\"5\"/><color background=\"207,224,238,255\" selection=\"255,255,0,255\"/>\
             <point-lights/><directional-lights><directional-light x=\"0.4\" y=\"-0.8\" z=\"-0.5\" color=\"255,255,255,255\" \
             intensity=\"0.4\"/><directional-light x=\"-0.7\" y=\"-0.5\" z=\"0.3\" color=\"255,255,255,255\" \
             intensity=\"0.2\"/></directional-lights>\
             <terrain exaggeration=\"{exaggeration}\" texture-size=\"512\" max-terrain-error=\"3\" max-ground-error=\"1\" \
             shading-enabled=\"0\" terrain-rendering-enabled=\"1\" map-theme=\"\" show-labels=\"0\" \
             elevation-offset=\"{offset_m}\"><layers>{shown}</layers>{generator}</terrain></qgis3d>\
             <camera x=\"0\" y=\"0\" elev=\"{:.3}\" dist=\"{:.3}\" pitch=\"{CAMERA_PITCH_DEG}\" yaw=\"{CAMERA_YAW_DEG}\"/>\
             </view></mapViewDocks3D>",
            f64::midpoint(west, east),
            f64::midpoint(south, north),
            f64::midpoint(lowest, highest),
            CAMERA_REACHES * (east - west).hypot(north - south).max(highest - lowest),
        );
    }

    /// The layers with their styles, and the order in which they are drawn.
    fn data_sources(&self, text: &mut String) {
        let Self { geopackage, crs, .. } = self;
        text.push_str("<projectlayers>\n");
        for (name, ..) in &self.layers {
            let _ = writeln!(
                text,
                "<maplayer type=\"vector\"><id>{ID_PREFIX}{name}</id><datasource>./{geopackage}|layername={name}</datasource>\
                 <layername>{name}</layername><srs>{crs}</srs><provider encoding=\"UTF-8\">ogr</provider>{}{}</maplayer>",
                style_of(name),
                aliases(self.columns.get(name).map_or(&[], Vec::as_slice))
            );
        }
        if let ProjectGround::Model { path, crs: own, unit_m, .. } = self.ground {
            let path = path.to_string_lossy();
            let void = |(low, high): (f64, f64)| {
                let in_units = |m: f64| (m / unit_m).clamp(-f64::from(f32::MAX), f64::from(f32::MAX));
                format!("<noDataRange min=\"{:e}\" max=\"{:e}\"/>", in_units(low), in_units(high))
            };
            let voids: String = NO_GROUND_M.into_iter().map(void).collect();
            let crs = own.map_or_else(|| crs.clone(), spatial_reference);
            let prefix = if path.starts_with(['/', '.']) { "" } else { "./" };
            let _ = writeln!(
                text,
                "<maplayer type=\"raster\"><id>{ID_PREFIX}{TERRAIN}</id><datasource>{prefix}{}</datasource>\
                 <layername>{TERRAIN}</layername><srs>{crs}</srs><provider>gdal</provider>\
                 <noData><noDataList bandNo=\"1\" useSrcNoData=\"1\">{voids}</noDataList></noData><pipe><rasterrenderer type=\"hillshade\" band=\"1\" \
                 azimuth=\"315\" angle=\"45\" zfactor=\"1\" multidirection=\"1\" opacity=\"0.5\" alphaBand=\"-1\"/></pipe>\
                 </maplayer>",
                escape(path.as_ref())
            );
        }
        text.push_str("</projectlayers>\n<layerorder>");
        for (name, ..) in &self.layers {
            let _ = write!(text, "<layer id=\"{ID_PREFIX}{name}\"/>");
        }
        if matches!(self.ground, ProjectGround::Model { .. }) {
            let _ = write!(text, "<layer id=\"{ID_PREFIX}{TERRAIN}\"/>");
        }
        text.push_str("</layerorder>\n");
    }

    /// The print layout around the buildings.
    fn layout(&self, text: &mut String) {
        let Some(Extent { min_m: [west, south, _], max_m: [east, north, _] }) = self.extent else { return };
        let Some(root) = LAYOUT.find("<Layouts") else { return };
        let heading = match self.title.as_str() {
            COMMON_NAME => LAYOUT_HEADING.to_owned(),
            name => format!("{LAYOUT_HEADING}: {name}"),
        };
        let filled = LAYOUT[root..]
            .replace(LAYOUT_TITLE, &heading)
            .replace(LAYOUT_PLACE, &self.place)
            .replace(LAYOUT_SOURCES, &self.sources);
        let (Some(start), [width_mm, height_mm]) = (filled.find("<Extent "), LAYOUT_MAP_MM) else { return };
        let Some(end) = filled[start..].find("/>").map(|end| start + end + 2) else { return };
        // As large as fits into the frame, with room around.
        let scale = ((east - west) / width_mm).max((north - south) / height_mm).max(f64::MIN_POSITIVE)
            * (1.0 + 2.0 * MARGIN_SHARE);
        let (x, y) = (f64::midpoint(west, east), f64::midpoint(south, north));
        let (half_x, half_y) = (scale * width_mm / 2.0, scale * height_mm / 2.0);
        let _ = writeln!(
            text,
            "{}<Extent xmin=\"{:.3}\" ymin=\"{:.3}\" xmax=\"{:.3}\" ymax=\"{:.3}\"/>{}",
            &filled[..start],
            x - half_x,
            y - half_y,
            x + half_x,
            y + half_y,
            &filled[end..]
        );
    }
}

/// The CRS by its code where it has one, else as a whole by its definition: QGIS takes what it understands of that (up to
/// 3.34 the horizontal part of a compound). QGIS looks at a code only beside a number in its own database, and then
/// trusts the code: any number will do.
fn spatial_reference(crs: &Crs) -> String {
    match (crs.epsg(), wkt_of(crs), crs.horizontal_epsg()) {
        (Some(code), ..) | (None, None, Some(code)) => {
            format!("<spatialrefsys><srsid>1</srsid><srid>{code}</srid><authid>EPSG:{code}</authid></spatialrefsys>")
        }
        (None, Some(wkt), _) => format!("<spatialrefsys><wkt>{}</wkt></spatialrefsys>", escape(wkt.as_str())),
        (None, None, None) => String::new(),
    }
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

/// Inside of the root element of a layer's style.
fn style_of(layer: &str) -> String {
    let qml = STYLES.iter().find(|(name, _)| *name == layer).map_or("", |(_, qml)| *qml);
    let inside = qml.find("<qgis").and_then(|start| qml[start..].find('>').map(|end| &qml[start + end + 1..]));
    let style = inside.and_then(|text| text.rfind("</qgis>").map(|end| &text[..end])).unwrap_or("");
    // The solids with roofs are what the 3D view shows, the footprints what the map does.
    match layer {
        "buildings" => without(style, "renderer-3d", ""),
        "buildings_lod2" => without(style, "renderer-v2", "<renderer-v2 type=\"nullSymbol\"/>"),
        _ => style.to_owned(),
    }
}

/// A style with another element in place of that of a name.
fn without(style: &str, element: &str, other: &str) -> String {
    let (opening, closing) = (format!("<{element}"), format!("</{element}>"));
    match (style.find(&opening), style.find(&closing)) {
        (Some(start), Some(end)) => format!("{}{other}{}", &style[..start], &style[end + closing.len()..]),
        _ => style.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::InputFile;

    #[test]
    fn a_printed_map_names_files_and_no_folders() {
        let input = |role: &str, path: &str| InputFile {
            role: role.to_owned(),
            path: path.to_owned(),
            size_bytes: 1,
            sha256: String::new(),
        };
        let lineage = Lineage {
            inputs: vec![
                input("footprints", "/home/somebody/block 7/footprints.gpkg"),
                input("survey", "sparse/cameras.txt"),
                input("survey", "sparse/images.txt"),
                input("terrain", "C:\\data\\dtm.tif"),
            ],
            ..Lineage::default()
        };
        let text = sources(&lineage);
        assert!(
            text.starts_with("Footprints: footprints.gpkg. Poses: cameras.txt and 1 more. Terrain: dtm.tif. "),
            "{text}"
        );
    }
}
