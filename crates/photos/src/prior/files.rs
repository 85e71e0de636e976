//! Priors that somebody else computed, one file per photo or one stack for all.
//!
//! .npy, .npz (Depth Anything 3's export among them), GeoTIFF and TIFF, 16-bit PNG, PFM, EXR. What the numbers mean is
//! declared in [`FilePriorConfig`]; a file is taken as the whole photo, resized.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use zip::ZipArchive;

use super::array::{MapShape, most_values};
use super::{DepthPrior, PriorError, PriorGeometry, PriorKind, PriorSource, npy, pfm};
use sizeup_geo::files::is_virtual;
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_geo::paths::within;
use sizeup_geo::template;
use sizeup_heights::ids::ViewId;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Unit of depths in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DepthUnit {
    /// Any: scale and shift are found from the ground.
    #[default]
    Unknown,
    /// Metres of the poses.
    Metre,
}

/// Where prior files are and what their numbers mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilePriorConfig {
    /// Path of a photo's file: `{name}` is the photo's name as the survey has it, `{stem}` the same without its
    /// extension, `{index}` its position in the sorted survey, from 0. Without any of these, one stack for all.
    pub path: String,
    /// Meaning of the numbers: "depth" (higher is farther) or `inverse_depth` (higher is nearer). Never guessed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<PriorKind>,
    /// Unit of depths: `metre` where they are in metres of the poses as they stand (after `scale` and `offset`), as those that
    /// photogrammetry measures are; `unknown`, the default, where only their order or their ratios are to be trusted, as those of
    /// networks for one photo.
    #[serde(default)]
    pub unit: DepthUnit,
    /// Along which line depth is measured: `z_depth` (the optical axis, as networks do) or "range" (the pixel's ray).
    #[serde(default)]
    pub geometry: PriorGeometry,
    /// Name of the array in an .npz, or of the channel in an .exr; may be left out where it is the only one, "depth", or
    /// an .exr's "Z".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key: Option<String>,
    /// Text file with one photo name per line, in the order of the maps of a stack.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub names: Option<PathBuf>,
    /// Each stored number is multiplied by this before anything else. Not 0; negative turns the order round.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added to each number after `scale`, in the unit of the result.
    #[serde(default)]
    pub offset: f64,
    /// Stored number that means "no value", beside `NaN`, infinities and, for depth, everything up to 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nodata: Option<f64>,
    /// Name of an array of confidences in the same .npz, of the same shape ("conf" in Depth Anything 3's export).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub confidence_key: Option<String>,
    /// Values whose confidence is below this are left out. In the unit of that array.
    #[serde(default)]
    #[schemars(extend("x-expert" = true))]
    pub min_confidence: f64,
}

/// Sides of the patches that networks see photos in, pixels: maps come with both sides rounded to a multiple.
const PATCHES_PX: [usize; 2] = [14, 16];

fn one() -> f64 {
    1.0
}

impl FilePriorConfig {
    /// Files by template, of a kind, with all defaults.
    #[must_use]
    pub fn new(path: impl Into<String>, kind: PriorKind) -> Self {
        Self {
            path: path.into(),
            kind: Some(kind),
            unit: DepthUnit::default(),
            geometry: PriorGeometry::default(),
            key: None,
            names: None,
            scale: 1.0,
            offset: 0.0,
            nodata: None,
            confidence_key: None,
            min_confidence: 0.0,
        }
    }
}

/// Prior files of one survey.
#[derive(Debug, Clone)]
pub struct FilePriors {
    config: FilePriorConfig,
    kind: PriorKind,
    /// Position in the sorted survey, by photo.
    survey_order: HashMap<ViewId, usize>,
    /// Position in a stack, by photo.
    stack_order: Option<HashMap<String, usize>>,
}

impl FilePriors {
    /// Checks the settings and reads the list of names, but no prior yet.
    ///
    /// # Errors
    /// [`PriorError::Config`], above all without `kind`; [`PriorError::File`] for an unreadable list of names.
    pub fn new<'a>(config: FilePriorConfig, views: impl IntoIterator<Item = &'a ViewId>) -> Result<Self, PriorError> {
        let refuse = |problem: &str, hint: &str| PriorError::Config { problem: problem.into(), hint: hint.into() };
        let kind = config.kind.ok_or_else(|| {
            refuse(
                "`kind` is not set: a file does not tell which way its numbers run",
                "`kind = \"depth\"` where higher is farther (Depth Anything 3, Metric3D, MoGe, a point cloud's depth), \
                 `kind = \"inverse_depth\"` where higher is nearer (Depth Anything 2, MiDaS, DPT, a stereo disparity)",
            )
        })?;
        if config.unit == DepthUnit::Metre && kind == PriorKind::InverseDepth {
            return Err(refuse(
                "`unit = \"metre\"` with `kind = \"inverse_depth\"`: what is in metres is depth",
                "leave `unit` out, or bring depths with `kind = \"depth\"`",
            ));
        }
        if !(config.scale.is_finite() && config.scale != 0.0 && config.offset.is_finite()) {
            return Err(refuse("`scale` or `offset` is no number, or `scale` is 0", "`scale = 0.001` for millimetres"));
        }
        let folder = Path::new(&config.path);
        if folder.is_dir() {
            let example = folder.join("{stem}.npy");
            return Err(refuse(
                &format!("`path = {:?}` is a folder, expected the files in it", config.path),
                &format!("`path = {:?}`, with the extension that your files have", example.display().to_string()),
            ));
        }
        template::check(&config.path).map_err(|problem| refuse(&problem, "use {name}, {stem} or {index}"))?;
        let mut names: Vec<&ViewId> = views.into_iter().collect();
        names.sort_unstable();
        let survey_order = names.into_iter().enumerate().map(|(i, id)| (id.clone(), i)).collect();
        let stack_order = config.names.as_deref().map(read_names).transpose()?;
        Ok(Self { config, kind, survey_order, stack_order })
    }

    /// For a part of a survey: `positions` are those of the photos in the whole of it.
    pub(super) fn set_positions(&mut self, positions: HashMap<ViewId, usize>) {
        self.survey_order = positions;
    }

    /// The file of a photo.
    ///
    /// # Errors
    /// [`PriorError::Config`] for a photo outside the survey where the path asks for its position.
    pub fn path_of(&self, view: &ViewId) -> Result<PathBuf, PriorError> {
        let index = self.survey_order.get(view).copied();
        let filled = template::fill(&self.config.path, &view.0, index);
        filled.ok_or_else(|| match within(&view.0) {
            Some(_) => PriorError::Config {
                problem: format!("{view} is not a photo of the survey, so it has no {{index}}"),
                hint: "use {name} or {stem}".to_owned(),
            },
            None => PriorError::Photo {
                view: view.to_string(),
                problem: "its name would lead out of the folder of the priors".to_owned(),
                hint: "photos are named by file, or by folders and file below one folder".to_owned(),
            },
        })
    }

    /// The file of a photo, if there is one; in archives and on servers nothing is looked for.
    pub(super) fn present_path_of(&self, view: &ViewId) -> Result<PathBuf, PriorError> {
        let path = self.path_of(view)?;
        if !is_virtual(&path) && !path.exists() {
            return Err(PriorError::Absent { view: view.to_string(), path });
        }
        Ok(path)
    }

    /// Which map of a stack of `n` is the photo's.
    fn index_in_stack(&self, view: &ViewId, n: usize) -> Result<usize, String> {
        match &self.stack_order {
            None if n == 1 => Ok(0),
            None => Err(format!(
                "it is a stack of {n} maps, and nothing says which photo is which\n\
                 hint: set `names` to a text file with one photo name per line, in the order of the maps"
            )),
            Some(order) if order.len() != n => {
                Err(format!("it is a stack of {n} maps, but `names` lists {} photos", order.len()))
            }
            Some(order) => order
                .get(&view.0)
                .or_else(|| order.get(template::stem(&view.0)))
                .copied()
                .ok_or_else(|| format!("`names` does not list {view}")),
        }
    }

    fn read(&self, path: &Path, view: &View) -> Result<Raster<f32>, PriorError> {
        let most = most_values(view.camera.width_px, view.camera.height_px);
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let open = || {
            if is_virtual(path) {
                return Err("only .tif, .tiff and .png are read from archives and servers".to_owned());
            }
            File::open(path).map(BufReader::new).map_err(|e| e.to_string())
        };
        let values = match extension.as_str() {
            "npy" => open().and_then(|file| npy::read_map(file, most, |n| self.index_in_stack(&view.id, n))),
            "npz" => open().and_then(|file| self.read_npz(file, most, &view.id)),
            "pfm" => open().and_then(|file| pfm::read(file, most)),
            #[cfg(feature = "exr")]
            "exr" => open().and_then(|file| super::exr_map::read_map(file, most, self.config.key.as_deref())),
            #[cfg(not(feature = "exr"))]
            "exr" => Err("this program was built without OpenEXR (`cargo build --features full` has it)".to_owned()),
            "tif" | "tiff" | "png" => return Self::read_image(path, view),
            _ => Err("its format is unknown, expected .npy, .npz, .tif, .tiff, .png (16 bit), .pfm or .exr".to_owned()),
        };
        values.map_err(|problem| PriorError::File { path: path.to_owned(), problem })
    }

    fn read_npz(&self, file: BufReader<File>, most: u64, view: &ViewId) -> Result<Raster<f32>, String> {
        let mut archive = ZipArchive::new(file).map_err(|e| format!("it is no .npz archive: {e}"))?;
        let keys: Vec<String> =
            archive.file_names().filter_map(|name| Some(name.ok()?.strip_suffix(".npy")?.to_owned())).collect();
        let has = |key: &str| keys.iter().any(|k| k == key);
        let key = match (&self.config.key, keys.as_slice()) {
            (Some(key), _) => key.clone(),
            (None, [only]) => only.clone(),
            (None, _) if has("depth") => "depth".to_owned(),
            (None, _) => return Err(format!("it holds {}\nhint: set `key` to one of them", keys.join(", "))),
        };
        let mut map = |key: &str| {
            if !keys.iter().any(|k| k == key) {
                return Err(format!("it has no array {key:?}, but {}", keys.join(", ")));
            }
            let entry = archive.by_name(&format!("{key}.npy")).map_err(|e| e.to_string())?;
            npy::read_map(entry, most, |n| self.index_in_stack(view, n)).map_err(|e| format!("array {key:?}: {e}"))
        };
        let mut values = map(&key)?;
        if let Some(confidence_key) = &self.config.confidence_key {
            let confidences = map(confidence_key)?;
            if (confidences.width(), confidences.height()) != (values.width(), values.height()) {
                return Err(format!("arrays {key:?} and {confidence_key:?} differ in shape"));
            }
            for (value, confidence) in values.data_mut().iter_mut().zip(confidences.data()) {
                if f64::from(*confidence) < self.config.min_confidence || confidence.is_nan() {
                    *value = f32::NAN;
                }
            }
        }
        Ok(values)
    }

    /// GeoTIFF, TIFF or PNG with one band of at least 16 bits.
    fn read_image(path: &Path, view: &View) -> Result<Raster<f32>, PriorError> {
        let refuse = |problem: String| PriorError::File { path: path.to_owned(), problem };
        let file = RasterFile::open(path)?;
        let sample = file.sample_type(1)?;
        if file.n_bands() != 1 || sample.bits < 16 {
            return Err(refuse(format!(
                "it has {} bands of {} bits, expected one of at least 16: a picture of a depth map is no depth map",
                file.n_bands(),
                sample.bits
            )));
        }
        // Before any of it is read.
        let size = file.size();
        Self::check_shape(path, size, view)?;
        MapShape::of(&[1, size.1, size.0], most_values(view.camera.width_px, view.camera.height_px)).map_err(refuse)?;
        Ok(file.read(1)?)
    }

    fn check_shape(path: &Path, size: (usize, usize), view: &View) -> Result<(), PriorError> {
        let (width, height) = (size.0 as f64, size.1 as f64);
        let (photo_width, photo_height) = (f64::from(view.camera.width_px), f64::from(view.camera.height_px));
        let off_px = (width - photo_width * height / photo_height)
            .abs()
            .min((height - photo_height * width / photo_width).abs());
        let of_patches = |patch: &usize| size.0.is_multiple_of(*patch) && size.1.is_multiple_of(*patch);
        // Rounding to the nearest multiple moves a side by half of it.
        let rounded_px = PATCHES_PX.into_iter().find(of_patches).map_or(1.0, |patch| patch as f64 / 2.0);
        if off_px <= rounded_px {
            return Ok(());
        }
        Err(PriorError::Shape {
            path: path.to_owned(),
            view: view.id.to_string(),
            width: size.0,
            height: size.1,
            photo_width: view.camera.width_px,
            photo_height: view.camera.height_px,
        })
    }

    /// Scaled values with everything that is no value blanked.
    fn settle(&self, stored: f32) -> f32 {
        let is_nodata = self.config.nodata.is_some_and(|nodata| stored == nodata as f32);
        let value = (f64::from(stored) * self.config.scale + self.config.offset) as f32;
        let is_possible = self.kind == PriorKind::InverseDepth || value > 0.0;
        if !is_nodata && value.is_finite() && is_possible { value } else { f32::NAN }
    }
}

impl PriorSource for FilePriors {
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError> {
        let path = self.present_path_of(&view.id)?;
        let mut values = self.read(&path, view)?;
        Self::check_shape(&path, (values.width(), values.height()), view)?;
        values.data_mut().iter_mut().for_each(|value| *value = self.settle(*value));

        let mut present = values.data().iter().filter(|v| !v.is_nan());
        let problem = match present.next() {
            None => "it has no value at all".to_owned(),
            Some(first) if present.all(|v| v == first) => format!("it is {first} everywhere"),
            Some(_) => return Ok(DepthPrior { values, kind: self.kind, geometry: self.config.geometry }),
        };
        Err(PriorError::NoInformation { path, problem })
    }
}

/// Longest list of names that is read, bytes: some million photos.
const MAX_NAMES: u64 = 1 << 28;

fn read_names(path: &Path) -> Result<HashMap<String, usize>, PriorError> {
    let failed = |problem: String| PriorError::File { path: path.to_owned(), problem };
    let mut text = String::new();
    File::open(path)
        .and_then(|file| file.take(MAX_NAMES).read_to_string(&mut text))
        .map_err(|e| failed(format!("the list of names cannot be read: {e}")))?;
    let mut order = HashMap::new();
    for (i, name) in text.lines().map(str::trim).filter(|line| !line.is_empty()).enumerate() {
        if order.insert(name.to_owned(), i).is_some() {
            return Err(failed(format!("it lists {name} twice")));
        }
    }
    Ok(order)
}
