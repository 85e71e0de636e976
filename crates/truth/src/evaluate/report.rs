//! All measures of one evaluation, and what was left out and why.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::footprints::FootprintEvaluation;
use super::heights::HeightEvaluation;
use super::levels::LevelAgreement;
use super::surface::SurfaceEvaluation;
use super::volume::VolumeEvaluation;

/// Comparison and its outcome.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct EvaluationReport {
    /// Heights; `None` where one side has bodies only.
    #[serde(flatten)]
    pub heights: Option<HeightEvaluation>,
    /// Source of the reference's heights: an attribute, its surfaces or its points.
    pub truth_heights: Option<String>,
    /// Footprints; `None` where one side has none of its own.
    pub footprints: Option<FootprintEvaluation>,
    /// Way in which levels were brought together; `None` where none were compared.
    pub levels: Option<LevelAgreement>,
    /// Distances between surfaces; `None` where they were not measured.
    pub surface: Option<SurfaceEvaluation>,
    /// Volumes in common; `None` where they were not measured.
    pub volume: Option<VolumeEvaluation>,
    /// Measures that could not be computed, and why.
    pub left_out: Vec<String>,
}

impl fmt::Display for EvaluationReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(heights) = &self.heights {
            write!(f, "{heights}")?;
            if let Some(source) = &self.truth_heights {
                writeln!(f, "h*: {source}")?;
            }
        }
        if let Some(footprints) = &self.footprints {
            let gap = if self.heights.is_some() { "\n" } else { "" };
            write!(f, "{gap}{footprints}")?;
        }
        if let Some(levels) = &self.levels {
            writeln!(f, "\nLevels: {levels}")?;
        }
        if let Some(s) = &self.surface {
            let percent = |share: f64| format!("{:.1} %", 100.0 * share);
            writeln!(
                f,
                "\nSurface: error 90 % {:.2} m, 95 % {:.2} m, mean {:.2} m; completeness {} at 0.5 m, {} at 1 m",
                s.error_90_m,
                s.error_95_m,
                s.error_mean_m,
                percent(s.completeness_05),
                percent(s.completeness_1)
            )?;
            writeln!(
                f,
                "  distances from {} samples of the result to the reference, and (completeness) from {} of the reference to the\n  \
                 result; walls and roofs, {:.3} samples per m² on either side, exact to the nearest triangle",
                s.n_samples[0], s.n_samples[1], s.density_per_m2
            )?;
        }
        if let Some(v) = &self.volume {
            write!(f, "\nVolume:")?;
            let mut parts: Vec<String> = Vec::new();
            parts.extend(v.prism_iou.map(|iou| format!("prism IoU {:.1} % (exact)", 100.0 * iou)));
            let mean = |iou| format!("{:.1} % mean per building", 100.0 * iou);
            parts.extend(v.prism_iou_per_building.map(mean));
            parts.extend(v.voxel_iou.iter().map(|(size, iou)| format!("voxel IoU {:.1} % at {size} m", 100.0 * iou)));
            parts.push(format!("column IoU {:.1} %", 100.0 * v.column_iou));
            writeln!(f, " {}", parts.join(", "))?;
            writeln!(f, "  {:.0} m³ in the result, {:.0} m³ in the reference", v.volume_m3[0], v.volume_m3[1])?;
            for (name, text) in v.definitions.iter().filter(|(name, _)| name.ends_with("iou")) {
                writeln!(f, "  {name}: {text}")?;
            }
        }
        self.left_out.iter().try_for_each(|reason| writeln!(f, "\nNot computed: {reason}"))
    }
}
