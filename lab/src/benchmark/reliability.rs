//! Whether stated uncertainties can be believed: errors of buildings with like sigmas, over many scenes.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::Method;
use sizeup_heights::stats;
use sizeup_truth::evaluate::BuildingError;

/// Upper limits of the classes of stated sigma, metres; the last class is above.
const CLASSES_M: [f64; 4] = [0.2, 0.4, 0.8, 1.6];
/// Share of normal errors within one standard deviation.
const ONE_SIGMA: f64 = 0.6827;
/// Fewer buildings than this tell no percentile.
const LEAST: usize = 8;

/// Buildings of one method and level whose stated sigmas are alike.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SigmaClass {
    /// Level of prior errors.
    pub level: String,
    /// Method that stated them.
    pub method: Method,
    /// Stated sigma, from (exclusive) and to; metres. No upper end in the last class.
    pub sigma_m: (f64, Option<f64>),
    /// Number of buildings.
    pub n: usize,
    /// Mean stated sigma, metres.
    pub mean_sigma_m: f64,
    /// Error that 68 % of them stay below, metres: sigma is what it says where the two are equal. `None` for few buildings.
    pub error_68_m: Option<f64>,
    /// Share of these buildings that is not flagged as doubtful.
    pub measured_share: f64,
}

/// The classes that have buildings, by rising sigma; nothing for a method that states none.
pub(super) fn sigma_classes(level: &str, method: Method, buildings: &[&BuildingError]) -> Vec<SigmaClass> {
    let ends = CLASSES_M.iter().copied().map(Some).chain([None]);
    let starts = std::iter::once(0.0).chain(CLASSES_M);
    let class = |(from, to): (f64, Option<f64>)| {
        let is_in = |b: &&&BuildingError| b.sigma_m.is_some_and(|s| s > from && to.is_none_or(|to| s <= to));
        let of_class: Vec<&BuildingError> = buildings.iter().filter(is_in).copied().collect();
        let errors: Vec<f64> = of_class.iter().map(|b| b.signed_error_m.abs()).collect();
        let n_measured = of_class.iter().filter(|b| b.status == sizeup_results::output::Status::Measured).count();
        Some(SigmaClass {
            level: level.to_owned(),
            method,
            sigma_m: (from, to),
            n: of_class.len(),
            mean_sigma_m: stats::mean(&of_class.iter().filter_map(|b| b.sigma_m).collect::<Vec<_>>())?,
            error_68_m: stats::quantile(&errors, ONE_SIGMA).filter(|_| errors.len() >= LEAST),
            measured_share: n_measured as f64 / of_class.len() as f64,
        })
    };
    starts.zip(ends).filter_map(class).collect()
}

/// A table of all classes, with what its columns mean; empty for none.
pub(super) fn to_markdown(classes: &[SigmaClass]) -> String {
    if classes.is_empty() {
        return String::new();
    }
    let mut text = "\nStated sigmas against errors:\n\n\
                    | level | method | stated sigma m | n | mean sigma m | error that 68 % stay below m | not flagged |\n\
                    |---|---|---|---:|---:|---:|---:|\n"
        .to_owned();
    for c in classes {
        let range = match c.sigma_m {
            (from, Some(to)) => format!("{from}–{to}"),
            (from, None) => format!("above {from}"),
        };
        let error = c.error_68_m.map_or_else(|| "–".to_owned(), |e| format!("{e:.2}"));
        let _ = writeln!(
            text,
            "| {} | `{}` | {range} | {} | {:.2} | {error} | {:.0} % |",
            c.level,
            c.method.name(),
            c.n,
            c.mean_sigma_m,
            100.0 * c.measured_share
        );
    }
    text.push_str(
        "\nA sigma is what it says where the error that 68 % of its class stay below is as large as the mean sigma.\n",
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_results::output::Status;

    #[test]
    fn a_class_holds_the_buildings_with_like_sigmas() {
        let building = |sigma_m: Option<f64>, error_m: f64| BuildingError {
            truth_id: String::new(),
            result_id: String::new(),
            height_m: 10.0 + error_m,
            truth_m: 10.0,
            signed_error_m: error_m,
            sigma_m,
            status: if error_m < -2.0 { Status::Doubtful } else { Status::Measured },
            group: None,
            overlap_share: None,
            area_m2: None,
        };
        // Nine of sigma 0.3 with errors 0.1 to 0.9; one of 5 m; one without.
        let mut all: Vec<BuildingError> = (1..=9).map(|i| building(Some(0.3), 0.1 * f64::from(i))).collect();
        all.extend([building(Some(5.0), -3.0), building(None, 1.0)]);
        let classes = sigma_classes("mid", Method::Robust, &all.iter().collect::<Vec<_>>());
        assert_eq!(classes.len(), 2);
        assert_eq!((classes[0].sigma_m, classes[0].n, classes[0].measured_share), ((0.2, Some(0.4)), 9, 1.0));
        // Linear interpolation: 0.1 + 0.6827 · 8 · 0.1.
        assert!((classes[0].error_68_m.unwrap() - (0.1 + 0.8 * ONE_SIGMA)).abs() < 1e-12);
        assert_eq!((classes[1].sigma_m, classes[1].error_68_m, classes[1].measured_share), ((1.6, None), None, 0.0));
        assert!(to_markdown(&classes).contains("| mid | `robust` | above 1.6 | 1 | 5.00 | – | 0 % |"));
        assert!(to_markdown(&[]).is_empty());
    }
}
