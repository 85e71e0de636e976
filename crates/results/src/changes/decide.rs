//! From what is known of a group of buildings to what became of it.
//!
//! | roof level | height above ground | class |
//! |---|---|---|
//! | up, down | the same way, or unsure | raised, lowered |
//! | up, down | same, or the other way | unsure: the ground has moved too |
//! | same | any | same; a height that differs is the ground's |
//! | unsure | any | unsure |
//!
//! Where levels are not compared the height decides alone. Another footprint makes `same` and `unsure` a `footprint_changed`.

use std::collections::BTreeSet;

use geo::Area as _;
use geo_types::{MultiPolygon, Polygon};

use super::building::{ComparedBuilding, joined};
use super::change::{Change, ChangeReason, Class};
use super::footprints::{FootprintDifference, LEAST_M2};
use super::heights::{Difference, Epoch, HeightEvidence};
use super::matching::Group;
use super::seen::SeenArea;
use super::verdict::{DecisionRules, Verdict};
use super::{ChangesConfig, CommonShift};
use crate::output::attributes::round_m;

/// Both results, and what counts for all buildings.
pub struct ComparedScene<'a> {
    pub old: &'a [ComparedBuilding<'a>],
    pub new: &'a [ComparedBuilding<'a>],
    pub old_area: SeenArea,
    pub new_area: SeenArea,
    pub config: &'a ChangesConfig,
    pub shift: CommonShift,
    /// Factor of sigmas, 1 or more.
    pub widening: f64,
}

/// Verdict of the heights, with its reasons and the difference that decided.
struct HeightFinding {
    verdict: Verdict,
    reasons: Vec<ChangeReason>,
    difference: Option<Difference>,
    ground_m: Option<f64>,
}

impl ComparedScene<'_> {
    /// Change of a group.
    pub fn change(&self, group: &Group, evidence: &HeightEvidence) -> Change {
        let old: Vec<&ComparedBuilding<'_>> = group.old.iter().map(|&o| &self.old[o]).collect();
        let new: Vec<&ComparedBuilding<'_>> = group.new.iter().map(|&n| &self.new[n]).collect();
        let mut change = blank(&old, &new);
        if old.is_empty() || new.is_empty() {
            let (class, reasons) = self.alone(group, &change.footprint, old.first().or(new.first()).copied());
            change.conclude(class, reasons);
        } else {
            self.compare(&old, &new, evidence, &mut change);
        }
        change
    }

    /// Decision on a building that none of the other result stands for.
    fn alone(
        &self,
        group: &Group,
        footprint: &MultiPolygon<f64>,
        building: Option<&ComparedBuilding<'_>>,
    ) -> (Class, Vec<ChangeReason>) {
        let (epoch, class, beyond, absent, other_area) = if group.old.is_empty() {
            (Epoch::New, Class::New, ChangeReason::OutsideOld, ChangeReason::NotInOld, &self.old_area)
        } else {
            (Epoch::Old, Class::Gone, ChangeReason::OutsideNew, ChangeReason::NotInNew, &self.new_area)
        };
        if footprint.0.is_empty() {
            return (Class::Unsure, vec![ChangeReason::NoFootprint]);
        }
        if !other_area.holds(footprint) {
            return (Class::Outside, vec![beyond]);
        }
        let first = if group.is_replaced { ChangeReason::Replaced } else { absent };
        let parts = building.into_iter().flat_map(|building| &building.parts);
        let lacks = parts.filter_map(|part| self.config.unstated().height(part.record, epoch).err());
        (class, std::iter::once(first).chain(lacks.collect::<BTreeSet<_>>()).collect())
    }

    /// Decision on buildings that stand for each other.
    fn compare(
        &self,
        old: &[&ComparedBuilding<'_>],
        new: &[&ComparedBuilding<'_>],
        evidence: &HeightEvidence,
        change: &mut Change,
    ) {
        let decision = self.config.decision();
        let heights = self.heights(evidence, &decision);
        let footprints = self.footprints(old, new, &decision);
        change.iou = Some(round_m(footprints.iou));
        change.gained_m2 = Some(round_m(footprints.gained_m2));
        change.lost_m2 = Some(round_m(footprints.lost_m2));
        if let Some(difference) = heights.difference {
            let decisive_m = difference.roof_z_m.unwrap_or(difference.height_m);
            change.d_height_m = Some(round_m(difference.height_m));
            change.d_roof_z_m = difference.roof_z_m.map(round_m);
            change.d_ground_z_m = heights.ground_m.map(round_m);
            change.sigma_m = Some(round_m(difference.sigma_m));
            change.z = (difference.sigma_m > 0.0).then(|| round_m(decisive_m / difference.sigma_m));
        }
        let footprint_reasons: Vec<ChangeReason> =
            [(footprints.gained_m2, ChangeReason::FootprintGrew), (footprints.lost_m2, ChangeReason::FootprintShrank)]
                .into_iter()
                .filter(|(area_m2, _)| *area_m2 >= LEAST_M2)
                .map(|(_, reason)| reason)
                .collect();
        let (class, first) = self.class(heights.verdict, !footprint_reasons.is_empty(), change);
        let mut reasons: Vec<ChangeReason> = first.into_iter().collect();
        let of_footprint = class == Class::FootprintChanged;
        let (before, after) =
            if of_footprint { (footprint_reasons, heights.reasons) } else { (heights.reasons, footprint_reasons) };
        reasons.extend(before.into_iter().chain(after));
        reasons.extend((new.len() > old.len()).then_some(ChangeReason::Split));
        reasons.extend((old.len() > new.len()).then_some(ChangeReason::Merged));
        change.conclude(class, reasons);
    }

    /// The class, and the reason that comes before all others where there is one.
    fn class(&self, verdict: Verdict, is_other_footprint: bool, change: &Change) -> (Class, Option<ChangeReason>) {
        let is_flat = |height_m: Option<f64>| height_m.is_some_and(|height_m| height_m < self.config.least_m);
        match verdict {
            Verdict::Up if is_flat(change.old_height_m) => (Class::New, Some(ChangeReason::FlatBefore)),
            Verdict::Down if is_flat(change.new_height_m) => (Class::Gone, Some(ChangeReason::FlatNow)),
            Verdict::Up => (Class::Raised, None),
            Verdict::Down => (Class::Lowered, None),
            Verdict::Same | Verdict::Unsure if is_other_footprint => (Class::FootprintChanged, None),
            Verdict::Same => (Class::Same, None),
            Verdict::Unsure => (Class::Unsure, None),
        }
    }

    fn heights(&self, evidence: &HeightEvidence, decision: &DecisionRules) -> HeightFinding {
        let (mean, parts) = match evidence {
            HeightEvidence::Known { mean, parts } => (mean, parts),
            HeightEvidence::Missing(reasons) => {
                let reasons = reasons.iter().copied().collect();
                return HeightFinding { verdict: Verdict::Unsure, reasons, difference: None, ground_m: None };
            }
        };
        let finding = |raw: &Difference, reason: Option<ChangeReason>| {
            let difference = self.common_taken_off(raw);
            let (verdict, own) = combined(&difference, decision);
            let ground_m = difference.roof_z_m.and(raw.roof_z_m).map(|roof_m| roof_m - raw.height_m);
            HeightFinding { verdict, reasons: vec![reason.unwrap_or(own)], difference: Some(difference), ground_m }
        };
        let whole = finding(mean, None);
        if matches!(whole.verdict, Verdict::Up | Verdict::Down) {
            return whole;
        }
        let moved = parts.iter().map(|part| finding(part, Some(ChangeReason::PartMoved)));
        let moved = moved.filter(|part| matches!(part.verdict, Verdict::Up | Verdict::Down));
        let size = |part: &HeightFinding| part.difference.map_or(0.0, |d| d.height_m.abs() / d.sigma_m);
        moved.max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(whole)
    }

    /// Without what is common to all buildings, with the sigma that belongs to it.
    fn common_taken_off(&self, raw: &Difference) -> Difference {
        let CommonShift { height, roof_z, .. } = &self.shift;
        let deciding = if self.config.compares_levels() { roof_z } else { height };
        let levels = raw.roof_z_m.filter(|_| self.config.compares_levels());
        Difference {
            height_m: raw.height_m - height.taken_m(),
            roof_z_m: levels.map(|roof_m| roof_m - roof_z.taken_m()),
            sigma_m: (self.widening * raw.sigma_m).hypot(deciding.added_sigma_m()),
        }
    }

    fn footprints(
        &self,
        old: &[&ComparedBuilding<'_>],
        new: &[&ComparedBuilding<'_>],
        decision: &DecisionRules,
    ) -> FootprintDifference {
        let sigma_m = |buildings: &[&ComparedBuilding<'_>]| {
            let each = buildings.iter().map(|building| building.footprint_sigma_m(self.config.footprint_sigma_m));
            each.fold(0.0, f64::max)
        };
        let tolerance_m = decision.reach_m(sigma_m(old).hypot(sigma_m(new)));
        FootprintDifference::of(&footprint_of(old), &footprint_of(new), tolerance_m)
    }
}

/// Verdict of roof and height together; see the module.
fn combined(difference: &Difference, decision: &DecisionRules) -> (Verdict, ChangeReason) {
    let of_height = decision.verdict(difference.height_m, difference.sigma_m);
    let of_roof = difference.roof_z_m.map_or(of_height, |roof_m| decision.verdict(roof_m, difference.sigma_m));
    match (of_roof, of_height) {
        (Verdict::Same, Verdict::Same) => (Verdict::Same, ChangeReason::WithinLeast),
        (Verdict::Same, _) => (Verdict::Same, ChangeReason::GroundDiffers),
        (Verdict::Unsure, _) => (Verdict::Unsure, ChangeReason::SigmasTooWide),
        (moved, other) if other == moved || other == Verdict::Unsure => (moved, ChangeReason::RoofMoved),
        _ => (Verdict::Unsure, ChangeReason::GroundMoved),
    }
}

fn footprint_of(buildings: &[&ComparedBuilding<'_>]) -> MultiPolygon<f64> {
    match buildings {
        [only] => only.footprint.clone(),
        several => joined(
            several.iter().flat_map(|building| building.footprint.iter()).collect::<Vec<&Polygon<f64>>>().into_iter(),
        ),
    }
}

/// Ids, heights and areas, before anything is decided.
fn blank(old: &[&ComparedBuilding<'_>], new: &[&ComparedBuilding<'_>]) -> Change {
    let ids = |of: &[&ComparedBuilding<'_>]| of.iter().map(|building| building.id.to_owned()).collect();
    let (old_footprint, new_footprint) = (footprint_of(old), footprint_of(new));
    let area = |footprint: &MultiPolygon<f64>| (!footprint.0.is_empty()).then(|| round_m(footprint.unsigned_area()));
    Change {
        class: Class::Unsure,
        reasons: Vec::new(),
        explanation: String::new(),
        new_ids: ids(new),
        old_ids: ids(old),
        d_height_m: None,
        d_roof_z_m: None,
        d_ground_z_m: None,
        sigma_m: None,
        z: None,
        old_height_m: mean_height_m(old).map(round_m),
        new_height_m: mean_height_m(new).map(round_m),
        old_area_m2: area(&old_footprint),
        new_area_m2: area(&new_footprint),
        iou: None,
        gained_m2: None,
        lost_m2: None,
        footprint: if new.is_empty() { old_footprint } else { new_footprint },
    }
}

/// Over the area of the buildings that have a height.
fn mean_height_m(buildings: &[&ComparedBuilding<'_>]) -> Option<f64> {
    if let [only] = buildings {
        return only.height_m();
    }
    let known = || buildings.iter().filter_map(|b| Some((b.footprint.unsigned_area(), b.height_m()?)));
    let known_m2: f64 = known().map(|(area_m2, _)| area_m2).sum();
    (known_m2 > 0.0).then(|| known().map(|(area_m2, height_m)| area_m2 * height_m).sum::<f64>() / known_m2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_roof_that_moves_with_its_ground_is_no_building_that_was_raised() {
        let decision = DecisionRules { n_sigmas: 3.0, least_m: 2.0 };
        let told = |roof_m: f64, height_m: f64| {
            combined(&Difference { height_m, roof_z_m: Some(roof_m), sigma_m: 0.3 }, &decision)
        };
        assert_eq!(told(3.0, 3.0), (Verdict::Up, ChangeReason::RoofMoved));
        assert_eq!(told(-3.0, -3.0), (Verdict::Down, ChangeReason::RoofMoved));
        assert_eq!(told(0.1, -3.0), (Verdict::Same, ChangeReason::GroundDiffers));
        assert_eq!(told(3.0, 0.1), (Verdict::Unsure, ChangeReason::GroundMoved));
        assert_eq!(told(3.0, -3.0), (Verdict::Unsure, ChangeReason::GroundMoved));
        let of_heights = Difference { height_m: 3.0, roof_z_m: None, sigma_m: 0.3 };
        assert_eq!(combined(&of_heights, &decision), (Verdict::Up, ChangeReason::RoofMoved));
    }
}
