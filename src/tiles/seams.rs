//! Do neighbouring tiles agree? Buildings of a halo are solved by their own tile and by its neighbours.

use std::collections::HashMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::merged::visit_lines;
use super::run::HaloHeight;
use sizeup_heights::stats;
use sizeup_results::output::{BuildingRecord, OutputError};

/// Bounds of the classes of distance from the core, metres. Far out a halo has fewer of its views, and is not written.
const CLASSES_M: [f64; 5] = [25.0, 50.0, 100.0, 200.0, f64::INFINITY];
/// Heights that differ by less than this are the same in files, metres.
const SAME_M: f64 = 0.0005;

/// Buildings solved by two tiles, at some distance from the core of the one that does not write them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SeamClass {
    /// Up to this distance, metres; `None`: as far as there are any.
    pub up_to_m: Option<f64>,
    /// Number of pairs of heights.
    pub n: usize,
    /// Pairs among them that differ by less than half a millimetre.
    pub n_same: usize,
    /// Pairs where one tile knows the height and the other does not.
    pub n_one_unknown: usize,
    /// 95th percentile of |Δh|, metres.
    pub p95_m: f64,
    /// Greatest difference |Δh|, metres.
    pub max_m: f64,
}

/// How well neighbouring tiles agree, by distance from the seam.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SeamReport {
    /// Classes by distance, the nearest first.
    pub classes: Vec<SeamClass>,
    /// The building that the two tiles nearest to it disagree on most, within the first class.
    pub worst_near_seam: Option<String>,
}

/// Compares what tiles say of each other's buildings.
pub fn compare(buildings: &[PathBuf], halos: &[PathBuf]) -> Result<SeamReport, OutputError> {
    let mut own: HashMap<String, Option<f64>> = HashMap::new();
    for path in buildings {
        visit_lines(path, &mut |record: BuildingRecord| {
            own.insert(record.id, record.height_m);
            Ok(())
        })?;
    }
    let mut differences: Vec<Vec<f64>> = vec![Vec::new(); CLASSES_M.len()];
    let mut report = SeamReport::default();
    let mut n_one_unknown = [0; CLASSES_M.len()];
    let mut worst: Option<(f64, String)> = None;
    for path in halos {
        visit_lines(path, &mut |halo: HaloHeight| {
            // A building of a tile that is missing has nobody to disagree with.
            let Some(&height_m) = own.get(&halo.id) else { return Ok(()) };
            let class = CLASSES_M.iter().position(|limit| halo.distance_m <= *limit).unwrap_or(CLASSES_M.len() - 1);
            match (height_m, halo.height_m) {
                (Some(a), Some(b)) => {
                    let difference_m = (a - b).abs();
                    differences[class].push(difference_m);
                    if class == 0 && worst.as_ref().is_none_or(|(most, _)| difference_m > *most) {
                        worst = Some((difference_m, halo.id));
                    }
                }
                (None, None) => {}
                _ => n_one_unknown[class] += 1,
            }
            Ok(())
        })?;
    }
    report.worst_near_seam = worst.filter(|(m, _)| *m >= SAME_M).map(|(_, id)| id);
    report.classes = CLASSES_M.iter().zip(differences).zip(n_one_unknown).map(class_of).collect();
    Ok(report)
}

fn class_of(((limit_m, differences), n_one_unknown): ((&f64, Vec<f64>), usize)) -> SeamClass {
    SeamClass {
        up_to_m: limit_m.is_finite().then_some(*limit_m),
        n: differences.len(),
        n_same: differences.iter().filter(|d| **d < SAME_M).count(),
        n_one_unknown,
        p95_m: stats::quantile(&differences, 0.95).unwrap_or(0.0),
        max_m: differences.iter().copied().fold(0.0, f64::max),
    }
}
