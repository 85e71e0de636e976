//! The pose formats: one line each, in the order in which a file is held against them. A format is a module with two
//! functions, `recognises(&FileMarks) -> bool` and `read(&SurveyConfig) -> Result<Poses, SurveyError>`.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::poses::Poses;
use super::{SurveyConfig, SurveyError, names, text};
use sizeup_geo::files::FileError;

/// Marks by which a file or folder is recognised.
pub(crate) struct FileMarks {
    /// The file or folder.
    pub path: PathBuf,
    /// The name, lower case.
    pub name: String,
    /// A file's first bytes; empty for a folder.
    pub head: String,
    /// Whether it is a folder.
    pub is_folder: bool,
}

/// So much of a file shows its format.
const HEAD_BYTES: u64 = 1 << 12;

impl FileMarks {
    /// Looks at a file or folder.
    pub(crate) fn of(path: &Path) -> Result<Self, SurveyError> {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_ascii_lowercase();
        let is_folder = path.is_dir();
        let mut head = Vec::new();
        if !is_folder {
            let file = File::open(path).map_err(FileError::on("cannot open", path))?;
            file.take(HEAD_BYTES).read_to_end(&mut head).map_err(FileError::on("cannot read", path))?;
        }
        let head = text::decode(&head);
        Ok(Self { path: path.to_owned(), name, head, is_folder })
    }

    /// Whether it is a file whose name ends in `.extension`.
    pub(crate) fn has_extension(&self, extension: &str) -> bool {
        !self.is_folder && self.name.rsplit_once('.').is_some_and(|(_, found)| found == extension)
    }
}

/// Recogniser and reader of a format.
struct Reader {
    recognises: fn(&FileMarks) -> bool,
    read: fn(&SurveyConfig) -> Result<Poses, SurveyError>,
}

/// From lines `/// what its path is`, `Name: module;` the enum and the table.
macro_rules! formats {
    ($($(#[doc = $about:literal])+ $name:ident: $module:ident;)+) => {
        /// The file format of the poses.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
        #[serde(rename_all = "snake_case")]
        pub enum Format {
            /// Found from the files' names and first bytes.
            #[default]
            Auto,
            $($(#[doc = $about])+ $name,)+
        }

        /// Every format with what its path is, in the order in which they are tried.
        const ABOUT: &[(Format, &str)] = &[$((Format::$name, concat!($($about),+))),+];

        impl Format {
            fn reader(self) -> Option<Reader> {
                match self {
                    Self::Auto => None,
                    $(Self::$name => {
                        Some(Reader { recognises: crate::$module::recognises, read: crate::$module::read })
                    })+
                }
            }
        }
    };
}

formats! {
    /// A COLMAP model folder, text or binary.
    Colmap: colmap;
    /// Bentley iTwin Capture / ContextCapture BlocksExchange, `.xml` or `.xmlz`.
    BlocksExchange: blocks_exchange;
    /// Agisoft Metashape's cameras.xml.
    Metashape: metashape;
    /// OpenSfM's reconstruction.json, topocentric or rewritten by ODM.
    Opensfm: opensfm;
    /// nerfstudio's transforms.json, or its folder.
    Nerfstudio: nerfstudio;
    /// Pix4D's calibrated camera files: the folder of params, or one of them.
    Pix4d: pix4d;
    /// Pix4D's Open Photogrammetry Format: a calibrated `project.opf`, or its folder.
    Opf: opf;
    /// Trimble INPHO's project, `.prj`.
    Inpho: inpho;
    /// STAC items of perspective imagery: an item, a page of items, or a folder of them.
    Stac: stac;
    /// ODM's geo.txt, with a declared camera.
    GeoTxt: geo_txt;
    /// ODM's shots.geojson, with cameras.json beside it.
    Odm: odm;
    /// Metashape's export of omega, phi, kappa, with a declared camera.
    MetashapeOpk: metashape_opk;
    /// A table with declared columns and conventions, see `[survey.csv]`.
    Csv: csv;
    /// Photos with EXIF and XMP: `path` is their folder.
    Photos: photo;
}

/// Extensions of files that may hold poses, lower case: `sizeup init` looks at no other file of a folder.
pub const POSE_EXTENSIONS: [&str; 9] = ["xml", "xmlz", "json", "geojson", "opf", "prj", "csv", "tsv", "txt"];

impl Format {
    /// The name by which the configuration knows it.
    #[must_use]
    pub fn name(self) -> String {
        serde_json::to_value(self).ok().and_then(|name| Some(name.as_str()?.to_owned())).unwrap_or_default()
    }

    /// Every format that can be read, with what its path is.
    pub fn all() -> impl Iterator<Item = (Self, &'static str)> {
        ABOUT.iter().map(|&(format, about)| (format, about.trim()))
    }
}

/// The format of a survey: declared, or the first whose recogniser knows the file.
pub(crate) fn format_of(config: &SurveyConfig) -> Result<Format, SurveyError> {
    if config.format != Format::Auto {
        return Ok(config.format);
    }
    if config.csv.is_some() {
        return Ok(Format::Csv);
    }
    recognised(&FileMarks::of(&config.path)?).ok_or_else(|| {
        let names: Vec<String> = Format::all().map(|(format, _)| format.name()).collect();
        let message = format!("the format of {} is not recognised", config.path.display());
        SurveyError::config(message, format!("set `format` to one of {}", names.join(", ")))
    })
}

/// The first format whose recogniser knows a file or folder.
pub(crate) fn recognised(marks: &FileMarks) -> Option<Format> {
    let is_it = |format: &Format| format.reader().is_some_and(|reader| (reader.recognises)(marks));
    ABOUT.iter().map(|&(format, _)| format).find(is_it)
}

/// The poses as the file has them, and the names of their photos.
pub(crate) fn read_poses(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let Some(reader) = format_of(config)?.reader() else {
        return Err(SurveyError::config("the format is not known", "set `format`"));
    };
    let mut poses = (reader.read)(config)?;
    names::settle(&mut poses);
    Ok(poses)
}
