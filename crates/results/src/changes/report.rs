//! `changes.json`: the summary of a comparison, and every building with what became of it.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::read::{ResultFile, ResultPair};
use super::{Change, ChangesConfig, Class, CommonShift, Comparison, Shift, SigmaRule};
use crate::output::OutputError;
use crate::output::attributes::round_m;
use crate::output::reports::write_json;

/// A spread of so much is worth a line: below it, chance in a few hundred buildings.
const NOTED_SPREAD: f64 = 1.25;

/// One of the two results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ComparedResult {
    /// Path of the file.
    pub path: String,
    /// Size of the file, bytes.
    pub size_bytes: u64,
    /// SHA-256 of the content, hexadecimal.
    pub sha256: String,
    /// The result's own CRS.
    pub crs: String,
    /// The day that it stands for, where it says so.
    pub reference_date: Option<String>,
    /// Buildings, and parts of such.
    pub n_records: usize,
    /// Buildings with a height.
    pub n_heights: usize,
}

/// Changes between two results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ChangesReport {
    /// Version of sizeup that compared.
    pub version: String,
    /// Command line that compared.
    pub command: String,
    /// The earlier result: its file and what it holds.
    pub old: ComparedResult,
    /// The later result: its file and what it holds.
    pub new: ComparedResult,
    /// How they were compared.
    pub config: ChangesConfig,
    /// Vertical datum of both; `null`: only heights above ground were compared.
    pub level_reference: Option<String>,
    /// The shift common to all buildings, and whether it was taken off.
    pub common_shift: CommonShift,
    /// Scatter of the differences in stated sigmas: 1 where these are right; `null` for too few buildings.
    pub spread: Option<f64>,
    /// Buildings, or groups that stand for each other, by class.
    #[schemars(with = "BTreeMap<String, usize>")]
    pub counts: IndexMap<String, usize>,
    /// Notes that a reader of the counts has to know.
    pub notes: Vec<String>,
    /// Every building of both results, exactly once.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<Change>,
}

impl ChangesReport {
    /// Report of a comparison.
    #[must_use]
    pub fn new(
        pair: &ResultPair,
        comparison: Comparison,
        config: &ChangesConfig,
        version: &str,
        command: &str,
    ) -> Self {
        let count = |class: Class| comparison.changes.iter().filter(|change| change.class == class).count();
        Self {
            version: version.to_owned(),
            command: command.to_owned(),
            old: compared(&pair.old),
            new: compared(&pair.new),
            config: config.clone(),
            level_reference: pair.level_reference.clone(),
            common_shift: rounded(comparison.shift),
            spread: comparison.spread.map(round_m),
            counts: Class::ALL.into_iter().map(|class| (class.as_str().to_owned(), count(class))).collect(),
            notes: notes(pair, &comparison, config),
            changes: comparison.changes,
        }
    }

    /// The same without the buildings.
    #[must_use]
    pub fn summary(&self) -> Self {
        Self { changes: Vec::new(), ..self.clone() }
    }

    /// Buildings that have changed.
    #[must_use]
    pub fn n_changed(&self) -> usize {
        let of = |class: &Class| self.counts.get(class.as_str()).copied().unwrap_or(0);
        Class::ALL.iter().filter(|class| class.is_change()).map(of).sum()
    }

    /// Writes `changes.json`.
    ///
    /// # Errors
    /// [`OutputError::File`].
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        Ok(write_json(path, self)?)
    }
}

fn compared(result: &ResultFile) -> ComparedResult {
    ComparedResult {
        path: result.file.path.clone(),
        size_bytes: result.file.size_bytes,
        sha256: result.file.sha256.clone(),
        crs: result.crs.to_string(),
        reference_date: result.lineage.as_ref().and_then(|lineage| lineage.reference_date.clone()),
        n_records: result.records.len(),
        n_heights: result.records.iter().filter(|record| record.height_m.is_some()).count(),
    }
}

fn rounded(shift: CommonShift) -> CommonShift {
    let of = |s: Shift| Shift { value_m: round_m(s.value_m), sigma_m: round_m(s.sigma_m), ..s };
    let CommonShift { east, north, roof_z, height } = shift;
    CommonShift { east: of(east), north: of(north), roof_z: of(roof_z), height: of(height) }
}

fn notes(pair: &ResultPair, comparison: &Comparison, config: &ChangesConfig) -> Vec<String> {
    let mut notes = Vec::new();
    if pair.old.crs != pair.new.crs {
        notes.push(format!("footprints of the old result were brought from {} to {}", pair.old.crs, pair.new.crs));
    }
    if pair.level_reference.is_none() {
        notes.push(
            "heights above ground were compared, not levels of roofs: where the ground differs between the results, so do \
             heights"
                .to_owned(),
        );
    }
    let shifts = &comparison.shift;
    let named = [("east", shifts.east), ("north", shifts.north), ("roofs", shifts.roof_z), ("heights", shifts.height)];
    for (what, shift) in named.into_iter().filter(|(_, shift)| shift.is_taken_off) {
        let Shift { value_m, sigma_m, n_pairs, .. } = shift;
        notes.push(format!(
            "common to all, and taken off: {what} {value_m:+.2} m (sigma {sigma_m:.2} m, {n_pairs} pairs)"
        ));
    }
    if let Some(spread) = comparison.spread.filter(|spread| *spread >= NOTED_SPREAD) {
        let outcome = if config.sigmas == SigmaRule::Widen { "and were widened" } else { "and were left as stated" };
        notes.push(format!("stated sigmas are too small: differences scatter {spread:.1} times as much, {outcome}"));
    }
    notes
}

impl fmt::Display for ChangesReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (what, result) in [("old", &self.old), ("new", &self.new)] {
            let date = result.reference_date.as_deref().map(|date| format!(", {date}")).unwrap_or_default();
            writeln!(f, "{what}: {}{date}, {} buildings or parts", result.path, result.n_records)?;
        }
        for (class, n) in &self.counts {
            writeln!(f, "{n:>8}  {}", class.replace('_', " "))?;
        }
        self.notes.iter().try_for_each(|note| writeln!(f, "{note}"))
    }
}
