//! What changed between two results: every building of both, exactly once, with a class, a reason and the figures.
//!
//! ```text
//! records ─ building ─ matching ─> groups that stand for each other, by place
//!           groups ─ shift ─────> what is common to all: plan, roofs, heights, and by how much sigmas are too small
//!           groups ─ heights, footprints ─ verdict ─ decide ─> Change
//! ```
//!
//! Frames: map frame of the new result, metres; levels in the vertical reference that both state. `d` is always new minus
//! old.

mod building;
mod change;
mod decide;
mod footprints;
mod heights;
mod layer;
mod matching;
mod page;
mod picture;
mod read;
mod report;
mod seen;
mod shift;
mod verdict;

use geo::Centroid as _;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::building::{ComparedBuilding, buildings};
use self::decide::ComparedScene;
use self::heights::{Difference, HeightEvidence, Unstated, evidence};
use self::matching::{Group, groups};
use self::seen::SeenArea;
use crate::output::BuildingRecord;

pub use change::{Change, ChangeReason, Class};
pub use layer::write as write_layer;
pub use page::changes_page;
pub use picture::changes_map;
pub use read::{ChangesError, ResultFile, ResultPair};
pub use report::{ChangesReport, ComparedResult};
pub use shift::{Shift, ShiftRule};
pub use verdict::{DecisionRules, Verdict};

/// Two buildings must share so much of their union to tell of a shift in plan.
const MIN_SHIFT_IOU: f64 = 0.5;

/// How two results are compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ChangesConfig {
    /// The least difference that is worth telling, up, down or sideways, metres, above 0. Below a storey (2.5 to 3 m), above
    /// what most heights of a flight are accurate to.
    pub least_m: f64,
    /// Standard deviations that a difference must reach to be a change, 1 to 10. At 3, three of a thousand unchanged
    /// buildings reach it where errors are normal.
    pub n_sigmas: f64,
    /// Standard deviation of old heights that state none, metres; without one they are not compared.
    pub old_sigma_m: Option<f64>,
    /// Standard deviation of new heights that state none, metres; without one they are not compared.
    pub new_sigma_m: Option<f64>,
    /// Standard deviation of the corners of footprints that state none, metres, 0 or more: those of a survey are accurate to
    /// decimetres.
    pub footprint_sigma_m: f64,
    /// How far beyond the hull of its footprints a result is taken to have looked, metres, 0 or more.
    pub margin_m: f64,
    /// Another area in which a result looked.
    pub area: AreaRule,
    /// Treatment of a shift that is common to all buildings.
    pub shift: ShiftRule,
    /// Treatment of sigmas that are smaller than differences scatter.
    pub sigmas: SigmaRule,
    /// Whether levels are compared.
    pub levels: LevelRule,
}

impl Default for ChangesConfig {
    fn default() -> Self {
        Self {
            least_m: 2.0,
            n_sigmas: 3.0,
            old_sigma_m: None,
            new_sigma_m: None,
            footprint_sigma_m: 0.3,
            margin_m: 25.0,
            area: AreaRule::Photos,
            shift: ShiftRule::TakeOff,
            sigmas: SigmaRule::Widen,
            levels: LevelRule::Compare,
        }
    }
}

/// Treatment of stated sigmas where the buildings' differences scatter more than these say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SigmaRule {
    /// They are widened until they fit.
    #[default]
    Widen,
    /// They are taken as stated.
    Stated,
}

/// Whether levels of roofs are compared, or heights above ground alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LevelRule {
    /// Levels, where both results count from the same zero; heights too.
    #[default]
    Compare,
    /// Heights above ground only.
    HeightsOnly,
}

/// Where a result looked, beside what lies around its footprints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AreaRule {
    /// Within the hull of its photos' projection centres, where it has them (its GeoPackage).
    #[default]
    Photos,
    /// Nowhere else: for layers of footprints that cover less than the flight.
    Footprints,
}

/// A setting outside its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} is {found}: expected {expected}")]
pub struct SettingError {
    /// Name of the setting.
    pub name: &'static str,
    /// The value that was set.
    pub found: f64,
    /// Values that are allowed, in words.
    pub expected: &'static str,
}

impl ChangesConfig {
    /// Checks every range.
    ///
    /// # Errors
    /// [`SettingError`] for the first setting out of range.
    pub fn validate(&self) -> Result<(), SettingError> {
        let length = "a length in metres, 0 or more, below 1000";
        let is_length = |found: f64| (0.0..1000.0).contains(&found);
        for (name, found, is_good, expected) in [
            ("least_m", self.least_m, self.least_m > 0.0 && is_length(self.least_m), "a length in metres, above 0"),
            ("n_sigmas", self.n_sigmas, (1.0..=10.0).contains(&self.n_sigmas), "1 to 10"),
            ("old_sigma_m", self.old_sigma_m.unwrap_or(0.0), is_length(self.old_sigma_m.unwrap_or(0.0)), length),
            ("new_sigma_m", self.new_sigma_m.unwrap_or(0.0), is_length(self.new_sigma_m.unwrap_or(0.0)), length),
            ("footprint_sigma_m", self.footprint_sigma_m, is_length(self.footprint_sigma_m), length),
            ("margin_m", self.margin_m, is_length(self.margin_m), length),
        ] {
            if !is_good {
                return Err(SettingError { name, found, expected });
            }
        }
        Ok(())
    }

    fn unstated(&self) -> Unstated {
        Unstated { old_m: self.old_sigma_m, new_m: self.new_sigma_m }
    }

    fn decision(&self) -> DecisionRules {
        DecisionRules { n_sigmas: self.n_sigmas, least_m: self.least_m }
    }

    fn compares_levels(&self) -> bool {
        self.levels == LevelRule::Compare
    }
}

/// The shift that all buildings have in common; new minus old.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct CommonShift {
    /// Shift of footprints, eastwards.
    pub east: Shift,
    /// Shift of footprints, northwards.
    pub north: Shift,
    /// Shift of levels of roofs; none where levels are not compared.
    pub roof_z: Shift,
    /// Shift of heights above ground.
    pub height: Shift,
}

/// Changes between two results, building by building, and what all have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Every building of both: those of the new result in its order, then what is gone in the old one's.
    pub changes: Vec<Change>,
    /// Shift and spread that all buildings have in common.
    pub shift: CommonShift,
    /// Scatter of the differences in stated sigmas, 1 where these are right; `None` for too few buildings.
    pub spread: Option<f64>,
}

/// One of two results, as it is compared.
#[derive(Debug, Clone, Copy)]
pub struct Compared<'a> {
    /// Buildings of the result, and parts of such.
    pub records: &'a [BuildingRecord],
    /// Projection centres of its photos (easting, northing), where they are known.
    pub cameras: &'a [[f64; 2]],
}

/// Compares two results whose footprints are in one frame and whose levels, if compared, count from one zero.
#[must_use]
pub fn compare(old: &Compared<'_>, new: &Compared<'_>, config: &ChangesConfig) -> Comparison {
    let new_buildings = buildings(new.records, [0.0; 2]);
    let (mut old_buildings, mut shift) = (buildings(old.records, [0.0; 2]), CommonShift::default());
    let mut matched = groups(&old_buildings, &new_buildings);
    (shift.east, shift.north) = plan_shift(&old_buildings, &new_buildings, &matched, config.shift);
    if shift.east.is_taken_off || shift.north.is_taken_off {
        old_buildings = buildings(old.records, [shift.east.taken_m(), shift.north.taken_m()]);
        matched = groups(&old_buildings, &new_buildings);
    }
    let unstated = config.unstated();
    let of_group = |group: &Group| {
        let old: Vec<&ComparedBuilding<'_>> = group.old.iter().map(|&o| &old_buildings[o]).collect();
        let new: Vec<&ComparedBuilding<'_>> = group.new.iter().map(|&n| &new_buildings[n]).collect();
        evidence(&old, &new, &unstated)
    };
    let known: Vec<HeightEvidence> = matched.par_iter().map(of_group).collect();
    let differences: Vec<Difference> = known.iter().filter_map(HeightEvidence::mean).collect();
    shift.height = Shift::of(&differences.iter().map(|d| d.height_m).collect::<Vec<_>>(), config.shift);
    if config.compares_levels() {
        shift.roof_z = Shift::of(&differences.iter().filter_map(|d| d.roof_z_m).collect::<Vec<_>>(), config.shift);
    }
    let spread = scatter(&differences, &shift, config);
    let widening = if config.sigmas == SigmaRule::Widen { spread.unwrap_or(1.0).max(1.0) } else { 1.0 };
    let area = |buildings: &[ComparedBuilding<'_>], cameras: &[[f64; 2]]| {
        SeenArea::of(buildings, config.margin_m, if config.area == AreaRule::Photos { cameras } else { &[] })
    };
    let scene = ComparedScene {
        old: &old_buildings,
        new: &new_buildings,
        old_area: area(&old_buildings, old.cameras),
        new_area: area(&new_buildings, new.cameras),
        config,
        shift,
        widening,
    };
    let changes = matched.par_iter().zip(&known).map(|(group, evidence)| scene.change(group, evidence)).collect();
    Comparison { changes, shift, spread }
}

/// Shifts of the footprints of single buildings, east and north.
fn plan_shift(
    old: &[ComparedBuilding<'_>],
    new: &[ComparedBuilding<'_>],
    groups: &[Group],
    rule: ShiftRule,
) -> (Shift, Shift) {
    let moved = groups.iter().filter_map(|group| {
        let ([o], [n]) = (group.old.as_slice(), group.new.as_slice()) else { return None };
        let (before, now) = (&old[*o].footprint, &new[*n].footprint);
        (footprints::iou(before, now) >= MIN_SHIFT_IOU).then_some(now.centroid()? - before.centroid()?)
    });
    let (east, north): (Vec<f64>, Vec<f64>) = moved.map(|by| (by.x(), by.y())).unzip();
    (Shift::of(&east, rule), Shift::of(&north, rule))
}

/// Scatter of the differences in their sigmas.
fn scatter(differences: &[Difference], shift: &CommonShift, config: &ChangesConfig) -> Option<f64> {
    let normalised = differences.iter().filter(|d| d.sigma_m > 0.0).map(|d| match d.roof_z_m {
        Some(roof_m) if config.compares_levels() => (roof_m - shift.roof_z.taken_m()) / d.sigma_m,
        _ => (d.height_m - shift.height.taken_m()) / d.sigma_m,
    });
    shift::spread(&normalised.collect::<Vec<_>>())
}
