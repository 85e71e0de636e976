//! Pictures of an evaluation: where the errors are, and whether the stated uncertainty can be believed.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::heights::{BuildingError, HeightEvaluation};
use sizeup_heights::stats;
use sizeup_results::output::picture::{Chart, SERIES_COLOURS, Series, Stroke, chart, error_map, write_png};
use sizeup_results::output::{BuildingRecord, OutputError};

/// Buildings per point of the reliability curve, at least.
const LEAST_PER_BIN: usize = 8;
/// Points of the reliability curve, at most.
const MOST_BINS: usize = 8;
/// Share of normal errors within one standard deviation.
const ONE_SIGMA: f64 = 0.6827;

/// Writes `errors.png` and, where the result states sigmas, `reliability.png`; returns what was written.
///
/// # Errors
/// [`OutputError`] for files that cannot be written.
pub fn write_pictures(
    folder: &Path,
    evaluation: &HeightEvaluation,
    results: &[BuildingRecord],
) -> Result<Vec<PathBuf>, OutputError> {
    let error_of: HashMap<&str, f64> =
        evaluation.buildings.iter().map(|b| (b.result_id.as_str(), b.signed_error_m)).collect();
    let of_record = |r: &BuildingRecord| {
        let whole = r.part_of.as_deref().and_then(|whole| error_of.get(whole));
        error_of.get(r.id.as_str()).or(whole).copied()
    };
    let known: Vec<_> = results.iter().filter_map(|r| Some((r.footprint.as_ref()?, of_record(r)))).collect();
    let mut written = vec![folder.join("errors.png")];
    write_png(&written[0], &error_map("Error of the heights", &known, 1000))?;
    let curve = reliability(&evaluation.buildings);
    if !curve.is_empty() {
        let path = folder.join("reliability.png");
        write_png(&path, &chart(&reliability_chart(&curve), 760, 620))?;
        written.push(path);
    }
    Ok(written)
}

/// Points of the reliability curve: mean stated sigma of a group of buildings with like sigmas, and the error that 68 % of
/// the group stay below; on the diagonal, sigma is what it says.
#[must_use]
pub fn reliability(buildings: &[BuildingError]) -> Vec<[f64; 2]> {
    let mut stated: Vec<(f64, f64)> =
        buildings.iter().filter_map(|b| Some((b.sigma_m?, b.signed_error_m.abs()))).collect();
    stated.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n_bins = (stated.len() / LEAST_PER_BIN).min(MOST_BINS);
    let bin = |i: usize| {
        let of_bin = &stated[i * stated.len() / n_bins..(i + 1) * stated.len() / n_bins];
        let sigma = stats::mean(&of_bin.iter().map(|s| s.0).collect::<Vec<_>>())?;
        let error = stats::quantile(&of_bin.iter().map(|s| s.1).collect::<Vec<_>>(), ONE_SIGMA)?;
        Some([sigma, error])
    };
    (0..n_bins).filter_map(bin).collect()
}

fn reliability_chart(curve: &[[f64; 2]]) -> Chart {
    let end = curve.iter().flatten().copied().fold(0.0, f64::max);
    let series = |name: &str, points: Vec<[f64; 2]>, stroke: Stroke, colour: [u8; 3]| Series {
        name: name.to_owned(),
        points,
        stroke,
        colour,
    };
    Chart {
        title: "Stated against actual uncertainty".to_owned(),
        x_label: "stated sigma, m (mean of a group of like sigmas)".to_owned(),
        y_label: "error that 68 % stay below, m".to_owned(),
        series: vec![
            series("as it should be", vec![[0.0, 0.0], [end, end]], Stroke::Line, SERIES_COLOURS[2]),
            series("", curve.to_vec(), Stroke::Line, SERIES_COLOURS[0]),
            series("measured", curve.to_vec(), Stroke::Marks, SERIES_COLOURS[0]),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_results::output::Status;

    fn building(sigma_m: f64, error_m: f64) -> BuildingError {
        BuildingError {
            truth_id: String::new(),
            result_id: String::new(),
            height_m: 10.0 + error_m,
            truth_m: 10.0,
            signed_error_m: error_m,
            sigma_m: Some(sigma_m),
            status: Status::Measured,
            group: None,
            overlap_share: None,
            area_m2: None,
        }
    }

    #[test]
    fn honest_sigmas_lie_on_the_diagonal() {
        // Two groups of eight; the errors of each are spread evenly over 0..sigma / 0.6827, in an order of their own.
        let group = |sigma: f64| (0..8).map(move |i| building(sigma, -sigma / ONE_SIGMA * f64::from(i * 3 % 8) / 7.0));
        let curve = reliability(&group(2.0).chain(group(0.5)).collect::<Vec<_>>());
        assert_eq!(curve.len(), 2);
        for [sigma, error] in curve {
            assert!((sigma - error).abs() < 1e-12, "{sigma} {error}");
        }
    }

    #[test]
    fn too_few_buildings_make_no_curve() {
        let few: Vec<BuildingError> = (0..7).map(|_| building(1.0, 1.0)).collect();
        assert!(reliability(&few).is_empty());
    }
}
