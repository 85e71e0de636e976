//! The survey report: what was read, whether it looks right, and if not, which option is the likeliest to be wrong.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use sizeup_geo::issue::{Issue, Severity, Subject};

/// Lowest, middle and highest of a set of values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Lowest of the values.
    pub min: f64,
    /// Median of the values.
    pub median: f64,
    /// Highest of the values.
    pub max: f64,
}

impl Spread {
    /// The spread of the finite values among these; `None` where there are none.
    #[must_use]
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let (min, max) = (*values.first()?, *values.last()?);
        Some(Self { min, median: values[values.len() / 2], max })
    }
}

/// Another reading of the same file that was tried because the declared one looks wrong.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Setting to declare, such as `csv.angles = "pok"`.
    pub change: String,
    /// Share of views that then look down, 0..1.
    pub looks_down: f64,
    /// Share of views that then look at the area, 0..1, where one is known.
    pub sees_area: Option<f64>,
    /// Share of cameras that then stand above the ground, 0..1, where the ground is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub above_ground: Option<f64>,
}

/// The content of a survey, and whether it looks right.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SurveyReport {
    /// File that it was read from.
    pub path: String,
    /// Name of the format.
    pub format: String,
    /// The CRS of the poses as they came.
    pub poses_crs: String,
    /// Definition of the project's CRS.
    pub project_crs: String,
    /// Way of heights to the project's vertical reference.
    pub heights: String,
    /// Way of positions to the project's plane, its accuracy, and what would be better.
    #[serde(default)]
    pub transform: String,
    /// Photos and poses in the file.
    pub n_poses: usize,
    /// Views that can be used.
    pub n_views: usize,
    /// Views with a photo file.
    pub n_photos: usize,
    /// Views within 15° of the vertical.
    pub n_nadir: usize,
    /// Views more than 15° off the vertical.
    pub n_oblique: usize,
    /// Number of different cameras.
    pub n_cameras: usize,
    /// Share of the views with a pose that look down, 0..1.
    pub looks_down: f64,
    /// Share of the views whose image centre lies in the area of interest, 0..1; absent without an area.
    pub sees_area: Option<f64>,
    /// Share of the area of interest that some photo shows, 0..1; absent without an area.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area_seen: Option<f64>,
    /// Heights of the cameras in the project, metres.
    pub height_m: Option<Spread>,
    /// Heights above the ground, metres; absent without terrain.
    pub above_ground_m: Option<Spread>,
    /// Turn applied for grid convergence, degrees clockwise.
    pub convergence_deg: Option<Spread>,
    /// Point scale between the poses' grid and the project's.
    pub point_scale: Option<Spread>,
    /// Satellite positioning: fixed, float, single, none; empty where the format does not tell.
    pub rtk: BTreeMap<String, usize>,
    /// Source of focal lengths; empty where the format brings complete cameras.
    pub focal: BTreeMap<String, usize>,
    /// Refused and noted items by code.
    pub issue_counts: BTreeMap<String, usize>,
    /// Whether poses that look wrong were accepted all the same (`survey.accept_unsound`).
    #[serde(default)]
    pub accepted: bool,
    /// Findings that look wrong; empty for a sound survey.
    pub findings: Vec<String>,
    /// Remarks that are not wrong but worth a look.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Readings that look better, the best first.
    pub trials: Vec<Trial>,
    /// Readings that these checks cannot tell from the declared one: a map of the image footprints can.
    pub equally_plausible: Vec<Trial>,
    /// Every item, with its reason.
    pub issues: Vec<Issue>,
}

impl SurveyReport {
    /// Whether nothing looks wrong.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.findings.is_empty()
    }

    /// Why items were refused or deserve a look: the first few of each kind, the rest counted.
    fn write_issues(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (code, &n) in &self.issue_counts {
            let of_code: Vec<&Issue> = self.issues.iter().filter(|issue| issue.code == *code).collect();
            for issue in of_code.iter().take(N_ISSUES_NAMED) {
                let name = match &issue.subject {
                    Subject::View(name) | Subject::Building(name) => format!("{name}: "),
                    Subject::Input(_) => String::new(),
                };
                writeln!(f, "  {}: {name}{}", word(issue.severity), issue.message)?;
            }
            if n > N_ISSUES_NAMED {
                writeln!(f, "    and {} more of {code} (--json lists them)", n - N_ISSUES_NAMED)?;
            }
            if let Some(hint) = of_code.iter().find_map(|issue| issue.hint.as_ref()) {
                writeln!(f, "    hint: {hint}")?;
            }
        }
        Ok(())
    }

    /// Items that could not be used.
    #[must_use]
    pub fn n_refused(&self) -> usize {
        self.issues.iter().filter(|issue| issue.severity == Severity::Refused).count()
    }
}

/// Issues of one kind that are written out.
const N_ISSUES_NAMED: usize = 3;

fn word(severity: Severity) -> &'static str {
    match severity {
        Severity::Note => "note",
        Severity::Warning => "warning",
        Severity::Refused => "refused",
    }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn counts(counts: &BTreeMap<String, usize>) -> String {
    let parts: Vec<String> = counts.iter().map(|(name, n)| format!("{n} {name}")).collect();
    parts.join(", ")
}

impl fmt::Display for Trial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "with {}, {} of the views look down", self.change, percent(self.looks_down))?;
        if let Some(share) = self.sees_area {
            write!(f, ", {} see the area", percent(share))?;
        }
        match self.above_ground {
            Some(share) => write!(f, ", {} stand above the ground", percent(share)),
            None => Ok(()),
        }
    }
}

impl Trial {
    /// The reading in words, with the lines of a configuration that declare it.
    #[must_use]
    pub fn advice(&self) -> String {
        match self.lines() {
            Some((table, lines)) => {
                let lines: Vec<String> = lines.iter().map(|line| format!("`{line}`")).collect();
                format!("{self}: write {} into [{table}] of the configuration", lines.join(" and "))
            }
            None => format!("{self}: no setting reads them so, export the poses again"),
        }
    }

    /// The lines of a configuration that declare it, and their table; `None` where no setting does. All settings of one reading
    /// belong to one table.
    fn lines(&self) -> Option<(String, Vec<String>)> {
        let mut table = String::new();
        let lines = self.change.split(", ").map(|setting| {
            let (key, value) = setting.split_once(" = ")?;
            let (of, key) = key.rsplit_once('.').map_or((None, key), |(of, key)| (Some(of), key));
            table = of.map_or_else(|| "survey".to_owned(), |of| format!("survey.{of}"));
            Some(format!("{key} = {value}"))
        });
        let lines = lines.collect::<Option<Vec<String>>>()?;
        Some((table, lines))
    }
}

impl fmt::Display for SurveyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |label: &str, value: &dyn fmt::Display| writeln!(f, "  {label:<24}{value}");
        row("survey", &self.path)?;
        row("format", &self.format)?;
        row("poses in", &self.poses_crs)?;
        row("project in", &self.project_crs)?;
        row("transformation", &self.transform)?;
        row("heights", &self.heights)?;
        row(
            "poses",
            &format!("{}, of which {} usable, {} refused items", self.n_poses, self.n_views, self.n_refused()),
        )?;
        row("photo files", &self.n_photos)?;
        row("cameras", &self.n_cameras)?;
        row("nadir / oblique", &format!("{} / {}", self.n_nadir, self.n_oblique))?;
        row("look down", &percent(self.looks_down))?;
        if let Some(share) = self.sees_area {
            row("see the area", &percent(share))?;
        }
        if let Some(share) = self.area_seen {
            row("area in photos", &percent(share))?;
        }
        let spreads = [
            ("height", self.height_m, "m", 1),
            ("height above ground", self.above_ground_m, "m", 1),
            ("grid convergence", self.convergence_deg, "°", 3),
            ("point scale", self.point_scale.filter(|s| s.min != 1.0 || s.max != 1.0), "", 6),
        ];
        for (label, spread, unit, digits) in spreads {
            if let Some(Spread { min, median, max }) = spread {
                let text = format!("{median:.digits$} {unit} ({min:.digits$} … {max:.digits$})");
                row(label, &text)?;
            }
        }
        for (label, map) in
            [("positioning", &self.rtk), ("focal length from", &self.focal), ("issues", &self.issue_counts)]
        {
            if !map.is_empty() {
                row(label, &counts(map))?;
            }
        }
        self.write_issues(f)?;
        for trial in &self.equally_plausible {
            writeln!(f, "  note: {trial} as well: compare the image footprints (survey convert) with a map")?;
        }
        for note in &self.notes {
            writeln!(f, "  note: {note}")?;
        }
        if self.is_sound() {
            return writeln!(f, "The poses look right.");
        }
        writeln!(f, "The poses look WRONG:")?;
        for finding in &self.findings {
            writeln!(f, "  - {finding}")?;
        }
        for trial in &self.trials {
            writeln!(f, "  hint: {}", trial.advice())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_that_looks_better_names_the_lines_to_write() {
        let told = |change: &str| {
            let (sees_area, above_ground) = (None, None);
            Trial { change: change.to_owned(), looks_down: 1.0, sees_area, above_ground }.advice()
        };
        let one = "with crs = \"EPSG:25833\", 100 % of the views look down: write `crs = \"EPSG:25833\"` into [survey] of the configuration";
        assert_eq!(told("crs = \"EPSG:25833\""), one);
        let two = told("height.reference = \"above_takeoff\", height.base = 12");
        assert!(two.contains("write `reference = \"above_takeoff\"` and `base = 12` into [survey.height]"), "{two}");
        assert!(told("camera axes x right, y up").ends_with("no setting reads them so, export the poses again"));
    }
}
