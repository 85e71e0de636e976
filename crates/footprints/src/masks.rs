//! Masks that somebody else computed: one raster per view, or contours of all views in one COCO file.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cadastre::CadastreConfig;
use super::coco::{self, CocoFile};
use super::contours::{ContourFineness, ContourKind, ContourSource, ViewContours, ViewFault};
use super::georeference::InputAccuracy;
use super::layer::FootprintError;
use super::vectorise::{Contour, Instances, Vectorising, contours, contours_at_level};
use sizeup_geo::files::is_virtual;
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_geo::paths::{PathVisitor, visit_template};
use sizeup_geo::template;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Largest difference between a mask's shape and its photo's, pixels of the mask.
const ASPECT_TOLERANCE_PX: f64 = 1.5;

/// Meaning of a mask's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskKind {
    /// Above `above` there is a building; which one is not told, so row houses are one.
    Semantic,
    /// Probabilities or scores: the border lies where they reach `above`, between pixels too.
    Probability,
    /// Every building has its own number; 0 is none.
    Instance,
    /// Polygons or run-length masks of all photos in one COCO JSON file.
    Coco,
}

/// Where the masks are and what their numbers mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaskConfig {
    /// Mask files (PNG, GeoTIFF or anything else GDAL reads), with `{stem}` for the photo's name without extension and
    /// `{name}` for its whole name; for `kind = "coco"` the JSON file.
    pub path: String,
    /// Meaning of the numbers.
    pub kind: MaskKind,
    /// For semantic masks and probabilities: above this there is a building, in the file's own numbers.
    #[serde(default)]
    #[schemars(extend("x-expert" = true))]
    pub above: f32,
    /// For COCO: name or number of the category that is a building; all of them where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<String>,
    /// Least score of an instance, 0 to 1, where the masks have scores.
    #[serde(default)]
    #[schemars(extend("x-expert" = true))]
    pub min_score: f32,
    /// The contour that masks follow: "ground", where walls meet the ground, or "roof".
    #[serde(default)]
    pub contour: ContourKind,
    /// How accurate masks, poses and terrain are.
    #[serde(default)]
    pub accuracy: InputAccuracy,
    /// An existing layer whose ids and attributes are kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cadastre: Option<CadastreConfig>,
}

impl MaskConfig {
    /// Hands every path of these settings to `visit`, which may change it.
    pub(super) fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        visit_template(&mut self.path, visit);
        if let Some(cadastre) = &mut self.cadastre {
            cadastre.visit_paths(visit);
        }
    }
}

/// Masks that lie in files, one per photo, or all in a COCO file.
#[derive(Debug)]
pub struct MaskFiles {
    config: MaskConfig,
    coco: Option<CocoFile>,
}

impl MaskFiles {
    /// Gets ready; a COCO file is read now, masks when their view is looked at.
    ///
    /// # Errors
    /// [`FootprintError::Masks`] for a template or a COCO file that cannot be used.
    pub fn new(config: MaskConfig) -> Result<Self, FootprintError> {
        let refuse = |problem: String, hint: &str| FootprintError::Masks { problem, hint: hint.to_owned() };
        if !config.above.is_finite() || !(0.0..=1.0).contains(&config.min_score) {
            let problem = format!("above = {}, min_score = {}", config.above, config.min_score);
            return Err(refuse(problem, "`above` is a number, `min_score` a share from 0 to 1"));
        }
        let coco = match config.kind {
            MaskKind::Coco => Some(coco::read(Path::new(&config.path), config.category.as_deref())?),
            _ => {
                template::check(&config.path)
                    .map_err(|problem| refuse(problem, "use {stem} or {name} for the photo's name"))?;
                if !config.path.contains('{') {
                    let problem = format!("`path = {:?}` is the same file for all photos", config.path);
                    return Err(refuse(problem, "use {stem} or {name} for the photo's name, as in `masks/{stem}.png`"));
                }
                None
            }
        };
        Ok(Self { config, coco })
    }

    /// Whether there is a mask for a view; what it holds is not looked at.
    #[must_use]
    pub fn is_there(&self, view: &View) -> bool {
        match &self.coco {
            Some(coco) => coco.lists(view),
            None => self.path_of(view).is_some_and(|path| is_virtual(&path) || path.exists()),
        }
    }

    fn path_of(&self, view: &View) -> Option<PathBuf> {
        template::fill(&self.config.path, &view.id.0, None)
    }
}

impl ContourSource for MaskFiles {
    fn contours(&self, view: &View, look: ContourFineness) -> Result<ViewContours, ViewFault> {
        if let Some(coco) = &self.coco {
            return Ok(coco.contours(view, look, self.config.min_score)?.into());
        }
        let path = self.path_of(view).ok_or_else(|| ViewFault::Absent { path: self.config.path.clone().into() })?;
        if !self.is_there(view) {
            return Err(ViewFault::Absent { path });
        }
        let unreadable =
            |e: &dyn std::error::Error| ViewFault::Unreadable { path: path.clone(), reason: e.to_string() };
        let file = RasterFile::open(&path).map_err(|e| unreadable(&e))?;
        let (width, height) = file.size();
        let scale = scale_of((width, height), view, &path)?;
        let values = file.read(1).map_err(|e| unreadable(&e))?;
        let how = Vectorising {
            instances: if self.config.kind == MaskKind::Instance { Instances::ByLabel } else { Instances::ByContact },
            min_area_px2: look.min_area_px2 / (scale[0] * scale[1]),
            tolerance_px: look.tolerance_px / scale[0].max(scale[1]),
        };
        let found = match self.config.kind {
            MaskKind::Probability => contours_at_level(&values, self.config.above, how),
            MaskKind::Semantic => contours(&values.map(|v| u32::from(*v > self.config.above)), how),
            MaskKind::Instance | MaskKind::Coco => contours(&ids(&values, &path)?, how),
        };
        let found = found.map_err(|fault| ViewFault::Mask { path: path.clone(), fault })?;
        Ok(found.into_iter().map(|contour| scaled(contour, scale)).collect::<Vec<_>>().into())
    }

    fn file_of(&self, view: &View) -> Option<PathBuf> {
        if self.config.kind == MaskKind::Coco { Some(PathBuf::from(&self.config.path)) } else { self.path_of(view) }
    }
}

/// Instance numbers; missing values are no building.
fn ids(values: &Raster<f32>, path: &Path) -> Result<Raster<u32>, ViewFault> {
    /// Whole numbers above this are not exact as 32-bit floats.
    const LARGEST: f32 = 16_777_216.0;
    let is_id = |v: f32| v.is_nan() || ((0.0..LARGEST).contains(&v) && v.fract() == 0.0);
    if let Some(other) = values.data().iter().copied().find(|v| !is_id(*v)) {
        let reason = format!("its value {other} is no instance number: expected whole numbers from 0 to 2^24");
        return Err(ViewFault::Unreadable { path: path.to_owned(), reason });
    }
    Ok(values.map(|v| if v.is_nan() { 0 } else { *v as u32 }))
}

/// Pixels of the photo per pixel of the mask, columns and rows.
pub(super) fn scale_of(size: (usize, usize), view: &View, path: &Path) -> Result<[f64; 2], ViewFault> {
    let photo = [f64::from(view.camera.width_px), f64::from(view.camera.height_px)];
    let (width, height) = (size.0 as f64, size.1 as f64);
    // A mask with more than two pixels to the photo's one knows nothing more: it is another photo's, or damaged.
    let is_finer = width > 2.0 * photo[0] || height > 2.0 * photo[1];
    let fits = width > 0.0 && height > 0.0 && !is_finer && {
        // The photo's shape at the mask's width.
        (height - photo[1] * width / photo[0]).abs() <= ASPECT_TOLERANCE_PX
            || (width - photo[0] * height / photo[1]).abs() <= ASPECT_TOLERANCE_PX
    };
    if !fits {
        return Err(ViewFault::Size {
            path: path.to_owned(),
            mask: size,
            photo: (view.camera.width_px, view.camera.height_px),
        });
    }
    Ok([photo[0] / width, photo[1] / height])
}

/// A contour at the photo's own size.
fn scaled(mut contour: Contour, scale: [f64; 2]) -> Contour {
    use geo::MapCoordsInPlace as _;
    if scale != [1.0, 1.0] {
        contour.shape_px.map_coords_in_place(|c| geo_types::Coord { x: c.x * scale[0], y: c.y * scale[1] });
    }
    contour
}
