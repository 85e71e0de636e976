//! `sizeup export`: a city in another format.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::ui::warn_of_unfinished;
use super::{Call, Failure, Global, Ui, counted, print_json};
use sizeup_geo::crs::Crs;
use sizeup_results::output::cityjson::{self, AttributeNames, CityJsonConfig};
#[cfg(feature = "flatcitybuf")]
use sizeup_results::output::flatcitybuf;
use sizeup_results::output::geopackage::{self, ProjectGround};
use sizeup_results::output::read::{LAYERED_RESULTS, RESULTS, ReadOptions, RecordFile, result_file};
use sizeup_results::output::textured::TexturedCity;
use sizeup_results::output::tiles3d::{self, Heights, Precision, Tiles3dConfig};
use sizeup_results::output::{CityModel, InputFile, Lineage, OutputError, Overview, Records};
use sizeup_results::output::{citygml, csv, dxf, flatgeobuf, geojson, kml, mesh};
use sizeup_survey::Survey;

/// Arguments of `sizeup export`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup export result city.gpkg
  sizeup export result/city.gpkg city.city.jsonl
  sizeup export result/city.gpkg city.geojson      longitude and latitude, for web maps
  sizeup export result/city.gpkg issues.geojson --layer qa_issues
  sizeup export result city.gml --to citygml3      CityGML 3.0; without --to it is 2.0
  sizeup export lod2.city.json lod1.city.json      anybody's file: blocks of the mean roof height
  sizeup export result/city.city.json tiles --to 3dtiles --geoid-height 45.5

An export has the buildings with all their attributes; cameras, issues and tiles go one by one, with --layer. OBJ and 3D Tiles have
the textures of a result that `sizeup texture` has painted.")]
pub struct ExportArgs {
    /// Folder of a result, or a file: CityJSON (.json), CityJSONSeq (.jsonl), GeoPackage or FlatGeobuf; ours, or anybody's with
    /// heights.
    pub input: PathBuf,
    /// File to write, or the folder of 3D Tiles.
    pub output: PathBuf,
    /// Format. By default the extension of the output says it.
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub to: Option<ExportFormat>,
    /// CRS, for an input that does not state one.
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,
    /// GeoJSON: another layer of the input than the buildings, such as `qa_issues`, cameras, or a city's tiles.
    #[arg(long, value_name = "LAYER")]
    pub layer: Option<String>,
    /// GeoPackage: also write a QGIS project beside it, with the extension .qgs.
    #[arg(long)]
    pub project: bool,
    /// Names of attributes in CityJSON; 3dbag adds those of the Dutch 3DBAG to ours.
    #[arg(long, value_enum, value_name = "NAMES", default_value = "sizeup")]
    pub names: NamesArg,
    /// CityJSON: where schemas/sizeup.ext.json is published, to declare our attributes as that extension.
    #[arg(long, value_name = "URL")]
    pub extension_url: Option<String>,
    /// 3D Tiles: what heights are. crs: what the CRS says, by PROJ's grids.
    #[arg(long, value_enum, value_name = "WHAT", default_value = "crs", conflicts_with = "geoid_height")]
    pub heights: HeightsArg,
    /// 3D Tiles: height of the geoid above the ellipsoid for the whole city, metres.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub geoid_height: Option<f64>,
    /// 3D Tiles: vertices in 16-bit steps, half the size.
    #[arg(long)]
    pub quantise: bool,
}

/// Formats that can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// CityJSON 2.0: .json.
    #[value(name = "cityjson")]
    CityJson,
    /// CityJSONSeq 2.0, a building a line: .jsonl.
    #[value(name = "cityjsonseq")]
    CityJsonSeq,
    /// FlatCityBuf, CityJSON in one file for the web: .fcb.
    #[cfg(feature = "flatcitybuf")]
    #[value(name = "flatcitybuf")]
    FlatCityBuf,
    /// GeoPackage, styled for QGIS: .gpkg.
    #[value(name = "geopackage")]
    GeoPackage,
    /// FlatGeobuf, footprints with all attributes: .fgb.
    #[value(name = "flatgeobuf")]
    FlatGeobuf,
    /// GeoJSON in longitude and latitude, footprints with all attributes: .geojson.
    #[value(name = "geojson")]
    GeoJson,
    /// CityGML 2.0, blocks and roofs with heights, roof types and storeys: .gml.
    #[value(name = "citygml")]
    CityGml,
    /// CityGML 3.0, the same by the newer standard; only where it is named.
    #[value(name = "citygml3")]
    CityGml3,
    /// OBJ, triangles of all solids for modelling; with an .mtl beside it where there are textures: .obj.
    #[value(name = "obj")]
    Obj,
    /// STL, closed solids on one plate for printers: .stl.
    #[value(name = "stl")]
    Stl,
    /// DXF, 3D faces and footprints for CAD: .dxf.
    #[value(name = "dxf")]
    Dxf,
    /// KML, blocks on a globe: .kml.
    #[value(name = "kml")]
    Kml,
    /// CSV, a table with the meanings of its columns beside it: .csv.
    #[value(name = "csv")]
    Csv,
    /// 3D Tiles 1.1, a folder.
    #[value(name = "3dtiles")]
    Tiles3d,
}

/// Names of attributes, on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum NamesArg {
    /// Names that sizeup defines.
    Sizeup,
    /// Ours and those of 3DBAG.
    #[value(name = "3dbag")]
    ThreeDBag,
}

/// Meaning of heights, on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum HeightsArg {
    /// Heights are what the CRS says.
    Crs,
    /// Heights are above the ellipsoid.
    Ellipsoidal,
}

pub(super) fn run(args: &ExportArgs, global: &Global) -> Result<u8, Failure> {
    let format = args.to.map_or_else(|| format_of(&args.output), Ok)?;
    let names = if args.layer.is_some() { LAYERED_RESULTS } else { RESULTS };
    let input = result_file(&args.input, names).map_err(|e| Failure::new(3, &e))?;
    let args = &ExportArgs { input, ..args.clone() };
    warn_of_unfinished(&args.input, global);
    if let Some(layer) = &args.layer {
        return export_layer(args, format, layer, global);
    }
    let file = RecordFile::open(&args.input, ReadOptions::default()).map_err(|e| Failure::new(3, &e))?;
    let crs = match (file.crs(), &args.crs) {
        (None, Some(definition)) => stated_crs(definition)?,
        (Some(crs), None) => crs.clone(),
        (Some(own), Some(_)) => {
            return Err(Failure::from_text(2, format!("{} is in {own}: leave --crs out", args.input.display())));
        }
        (None, None) => {
            let name = args.input.display();
            return Err(Failure::from_text(3, format!("{name} states no CRS\nhint: name it with --crs EPSG:…")));
        }
    };
    file.check_units(&crs).map_err(|e| Failure::new(3, &e))?;
    let lineage = lineage(args, &crs, file.lineage())?;
    let survey = Survey::default();
    let model = CityModel { records: &file, crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    let overview = write(format, args, &model).map_err(|e| Failure::new(e.exit_code(), &e))?;
    let Overview { n_buildings, n_heights, .. } = overview;
    let ui = Ui::new(global);
    if format == ExportFormat::FlatGeobuf && overview.n_without_footprint > 0 {
        ui.warn(format!("{} buildings have no footprint, and so no place in FlatGeobuf", overview.n_without_footprint));
    }
    ui.say(format!("{n_buildings} buildings, {n_heights} with a height, in {}", args.output.display()));
    if global.json {
        print_json(&serde_json::json!({ "n_buildings": n_buildings, "n_heights": n_heights, "output": args.output }))?;
    }
    Ok(0)
}

/// A CRS of the command line, in which buildings have positions.
fn stated_crs(definition: &str) -> Result<Crs, Failure> {
    let crs = Crs::parse(definition).map_err(|e| Failure::new(2, &e))?;
    if crs.is_vertical() {
        let text = format!("--crs {definition}: it is a system of heights, and says nothing of positions");
        return Err(Failure::from_text(2, format!("{text}\nhint: name both, as in EPSG:28992+5709")));
    }
    Ok(crs)
}

/// A layer beside the buildings, as GeoJSON.
fn export_layer(args: &ExportArgs, format: ExportFormat, layer: &str, global: &Global) -> Result<u8, Failure> {
    if format != ExportFormat::GeoJson {
        return Err(Failure::from_text(2, "--layer writes GeoJSON\nhint: name a file that ends with .geojson"));
    }
    let stated = args.crs.as_deref().map(stated_crs).transpose()?;
    let n_features = geojson::write_layer(&args.output, &args.input, layer, stated.as_ref())
        .map_err(|e| Failure::new(e.exit_code(), &e))?;
    Ui::new(global).say(format!("{} of {layer} in {}", counted(n_features, "feature"), args.output.display()));
    if global.json {
        print_json(&serde_json::json!({ "n_features": n_features, "output": args.output }))?;
    }
    Ok(0)
}

impl ExportFormat {
    /// Extension of its files, lower case; `None` for a folder, and where another format has it.
    fn extension(self) -> Option<&'static str> {
        match self {
            Self::CityJson => Some("json"),
            Self::CityJsonSeq => Some("jsonl"),
            #[cfg(feature = "flatcitybuf")]
            Self::FlatCityBuf => Some("fcb"),
            Self::GeoPackage => Some("gpkg"),
            Self::FlatGeobuf => Some("fgb"),
            Self::GeoJson => Some("geojson"),
            Self::CityGml => Some("gml"),
            Self::Obj => Some("obj"),
            Self::Stl => Some("stl"),
            Self::Dxf => Some("dxf"),
            Self::Kml => Some("kml"),
            Self::Csv => Some("csv"),
            Self::CityGml3 | Self::Tiles3d => None,
        }
    }
}

fn format_of(path: &Path) -> Result<ExportFormat, Failure> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let formats = ExportFormat::value_variants();
    if let Some(format) = formats.iter().find(|format| format.extension() == Some(&extension)) {
        return Ok(*format);
    }
    let name = path.display();
    let text = match extension.as_str() {
        "parquet" | "geoparquet" => format!(
            "cannot write {name}: Parquet is not among our formats\nhint: write .gpkg or .fgb, and convert it with ogr2ogr of a GDAL built with Arrow"
        ),
        "fcb" => format!(
            "cannot write {name}: this program was built without FlatCityBuf\nhint: `cargo build --release --features full` builds all in, as the packages have it"
        ),
        "" => format!("cannot tell the format of {name}\nhint: name it with --to, as in --to 3dtiles"),
        _ => {
            let known: Vec<String> = formats.iter().filter_map(|f| Some(format!(".{}", f.extension()?))).collect();
            format!("cannot write {name}\nhint: one of {}, or name the format with --to", known.join(", "))
        }
    };
    Err(Failure::from_text(2, text))
}

fn write<R: Records + ?Sized>(
    format: ExportFormat,
    args: &ExportArgs,
    model: &CityModel<'_, R>,
) -> Result<Overview, OutputError> {
    let path = &args.output;
    let cityjson = CityJsonConfig {
        names: match args.names {
            NamesArg::Sizeup => AttributeNames::Sizeup,
            NamesArg::ThreeDBag => AttributeNames::ThreeDBag,
        },
        extension_url: args.extension_url.clone(),
    };
    match format {
        ExportFormat::CityJson => cityjson::write(path, model, &cityjson),
        ExportFormat::CityJsonSeq => cityjson::write_sequence(path, model, &cityjson),
        #[cfg(feature = "flatcitybuf")]
        ExportFormat::FlatCityBuf => flatcitybuf::write(path, model, &cityjson),
        ExportFormat::GeoPackage => {
            let overview = geopackage::write(path, model)?;
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if args.project {
                let ground = ProjectGround::LowestWall;
                geopackage::write_project(&path.with_extension("qgs"), &name, model, ground)?;
            }
            Ok(overview)
        }
        ExportFormat::FlatGeobuf => flatgeobuf::write(path, model),
        ExportFormat::GeoJson => geojson::write(path, model),
        ExportFormat::CityGml => citygml::write(path, model, citygml::Edition::V2),
        ExportFormat::CityGml3 => citygml::write(path, model, citygml::Edition::V3),
        ExportFormat::Obj => match TexturedCity::of_result(&args.input)? {
            Some(textured) => mesh::write_textured_obj(path, model, &textured),
            None => mesh::write_obj(path, model),
        },
        ExportFormat::Stl => mesh::write_stl(path, model),
        ExportFormat::Dxf => dxf::write(path, model),
        ExportFormat::Kml => kml::write(path, model),
        ExportFormat::Csv => csv::write(path, model),
        ExportFormat::Tiles3d => {
            let heights = match (args.geoid_height, args.heights) {
                (Some(geoid_m), _) => Heights::GeoidHeight(geoid_m),
                (None, HeightsArg::Ellipsoidal) => Heights::Ellipsoidal,
                (None, HeightsArg::Crs) => Heights::Crs,
            };
            let precision = if args.quantise { Precision::Quantised } else { Precision::Float };
            let config = Tiles3dConfig { heights, precision, ..Tiles3dConfig::default() };
            tiles3d::write_textured(path, model, &config, TexturedCity::of_result(&args.input)?.as_ref())
        }
    }
}

/// The export's own origin; the input is named with its hash.
fn lineage(args: &ExportArgs, crs: &Crs, source: Option<Lineage>) -> Result<Lineage, Failure> {
    let stated = |of: fn(&Lineage) -> &String, otherwise: &str| {
        source.as_ref().map(of).filter(|text| !text.is_empty()).cloned().unwrap_or_else(|| otherwise.to_owned())
    };
    let input = InputFile::hash("city", &args.input).map_err(|e| Failure::new(3, &e))?;
    Ok(Lineage {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: crate::recipe::commit().map(str::to_owned),
        command: Call::this().line(),
        inputs: vec![input],
        crs: crs.definition().to_owned(),
        vertical_reference: stated(|l| &l.vertical_reference, crs.vertical_name().unwrap_or("as in the input")),
        height_definition: stated(
            |l| &l.height_definition,
            "as in the input; measured on its surfaces where it states none",
        ),
        reference_date: source.as_ref().and_then(|l| l.reference_date.clone()),
        source: source.map(Box::new),
        ..Lineage::default()
    })
}
