//! How much higher or lower a building is: roof by roof where the two footprints overlap.
//!
//! ```text
//! d = Σ A_ij (v_j − v_i) / Σ A_ij        σ = Σ A_ij √(σ_i² + σ_j²) / Σ A_ij
//! ```
//!
//! `A_ij`: area that part `i` of the old result shares with part `j` of the new one; `v`: level of the roof, or height above
//! ground. Of footprints that agree that is the difference of the mean heights; an annex that was added does not lower the
//! mean. σ is as if all parts of a building erred the same way.

use std::collections::BTreeSet;

use super::building::{ComparedBuilding, ComparedPart, shared_m2};
use super::change::ChangeReason;
use crate::output::{BuildingRecord, Status};

/// Share of the common area whose heights must be known on both sides.
const MIN_KNOWN_SHARE: f64 = 0.5;
/// Two parts are the same one if they share so much of their union.
const SAME_PART_IOU: f64 = 0.7;

/// Which of the two results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Epoch {
    /// The earlier of the two results.
    Old,
    /// The later of the two results.
    New,
}

/// New minus old; metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// Difference of the heights above ground.
    pub height_m: f64,
    /// Difference of the levels of the roof, where both are known.
    pub roof_z_m: Option<f64>,
    /// One standard deviation of either.
    pub sigma_m: f64,
}

/// Heights of a group, as far as known.
#[derive(Debug, Clone, PartialEq)]
pub enum HeightEvidence {
    /// They can be compared.
    Known {
        /// Over the whole common area.
        mean: Difference,
        /// Differences of single parts, where both results have the same ones; else empty.
        parts: Vec<Difference>,
    },
    /// They cannot, and why.
    Missing(BTreeSet<ChangeReason>),
}

impl HeightEvidence {
    /// Over the whole common area, where that is known.
    pub fn mean(&self) -> Option<Difference> {
        match self {
            Self::Known { mean, .. } => Some(*mean),
            Self::Missing(_) => None,
        }
    }
}

/// Standard deviations of heights that state none, metres: of the old result and of the new one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Unstated {
    /// Sigma of the old result.
    pub old_m: Option<f64>,
    /// Sigma of the new result.
    pub new_m: Option<f64>,
}

impl Unstated {
    /// The height of a record and its sigma, if it is one to compare.
    ///
    /// # Errors
    /// Why not.
    pub fn height(&self, record: &BuildingRecord, epoch: Epoch) -> Result<(f64, f64), ChangeReason> {
        let of = |old: ChangeReason, new: ChangeReason| if epoch == Epoch::Old { old } else { new };
        match record.status {
            Status::Doubtful => return Err(of(ChangeReason::OldDoubtful, ChangeReason::NewDoubtful)),
            Status::Fallback => return Err(of(ChangeReason::OldNotMeasured, ChangeReason::NewNotMeasured)),
            Status::Measured | Status::Reviewed | Status::Given | Status::Unknown | Status::Refused => {}
        }
        let height_m = record.height_m.ok_or(of(ChangeReason::OldHeightUnknown, ChangeReason::NewHeightUnknown))?;
        let unstated_m = if epoch == Epoch::Old { self.old_m } else { self.new_m };
        let sigma_m = record
            .height_sigma_m
            .or(unstated_m)
            .ok_or(of(ChangeReason::OldSigmaUnknown, ChangeReason::NewSigmaUnknown))?;
        Ok((height_m, sigma_m))
    }
}

/// A pair of parts that overlap.
struct OverlappingParts<'p, 'a> {
    old: &'p ComparedPart<'a>,
    new: &'p ComparedPart<'a>,
    shared_m2: f64,
}

/// Compares the heights of buildings that stand for each other.
pub fn evidence(old: &[&ComparedBuilding<'_>], new: &[&ComparedBuilding<'_>], unstated: &Unstated) -> HeightEvidence {
    let pieces = pieces(old, new);
    let total_m2: f64 = pieces.iter().map(|piece| piece.shared_m2).sum();
    let mut reasons = BTreeSet::new();
    let mut known: Vec<(f64, Difference)> = Vec::new();
    for piece in &pieces {
        match difference(piece, unstated) {
            Ok(difference) => known.push((piece.shared_m2, difference)),
            Err(missing) => reasons.extend(missing),
        }
    }
    let known_m2: f64 = known.iter().map(|(area_m2, _)| area_m2).sum();
    if known.is_empty() || known_m2 < MIN_KNOWN_SHARE * total_m2 {
        return HeightEvidence::Missing(reasons);
    }
    let mean = |value: &dyn Fn(&Difference) -> f64| known.iter().map(|(a, d)| a * value(d)).sum::<f64>() / known_m2;
    let has_levels = known.iter().all(|(_, d)| d.roof_z_m.is_some());
    let mean = Difference {
        height_m: mean(&|d| d.height_m),
        roof_z_m: has_levels.then(|| mean(&|d| d.roof_z_m.unwrap_or(0.0))),
        sigma_m: mean(&|d| d.sigma_m),
    };
    let parts = if is_one_to_one(old, new, &pieces) { known.into_iter().map(|(_, d)| d).collect() } else { Vec::new() };
    HeightEvidence::Known { mean, parts }
}

fn pieces<'p, 'a>(old: &[&'p ComparedBuilding<'a>], new: &[&'p ComparedBuilding<'a>]) -> Vec<OverlappingParts<'p, 'a>> {
    let parts_of = |buildings: &[&'p ComparedBuilding<'a>]| -> Vec<&'p ComparedPart<'a>> {
        buildings.iter().flat_map(|building| building.parts.iter()).collect()
    };
    let (old, new) = (parts_of(old), parts_of(new));
    let mut pieces = Vec::new();
    for &part in &old {
        for &other in &new {
            let (Some(a), Some(b)) = (&part.footprint, &other.footprint) else { continue };
            let shared_m2 = shared_m2(a, b);
            if shared_m2 > 0.0 {
                pieces.push(OverlappingParts { old: part, new: other, shared_m2 });
            }
        }
    }
    pieces
}

/// Difference of two parts; why not, for each side that lacks something.
fn difference(piece: &OverlappingParts<'_, '_>, unstated: &Unstated) -> Result<Difference, Vec<ChangeReason>> {
    let old = unstated.height(piece.old.record, Epoch::Old);
    let new = unstated.height(piece.new.record, Epoch::New);
    let ((old_m, old_sigma_m), (new_m, new_sigma_m)) = match (old, new) {
        (Ok(old), Ok(new)) => (old, new),
        (old, new) => return Err([old.err(), new.err()].into_iter().flatten().collect()),
    };
    let roofs = piece.new.record.roof_z_m().zip(piece.old.record.roof_z_m());
    Ok(Difference {
        height_m: new_m - old_m,
        roof_z_m: roofs.map(|(new_z_m, old_z_m)| new_z_m - old_z_m),
        sigma_m: old_sigma_m.hypot(new_sigma_m),
    })
}

/// Whether both sides have the same parts, several of them: then each is compared by itself too.
fn is_one_to_one(
    old: &[&ComparedBuilding<'_>],
    new: &[&ComparedBuilding<'_>],
    pieces: &[OverlappingParts<'_, '_>],
) -> bool {
    let n_parts =
        |buildings: &[&ComparedBuilding<'_>]| buildings.iter().map(|building| building.parts.len()).sum::<usize>();
    let is_same = |piece: &&OverlappingParts<'_, '_>| {
        let area = |part: &ComparedPart<'_>| part.footprint.as_ref().map_or(0.0, geo::Area::unsigned_area);
        piece.shared_m2 >= SAME_PART_IOU * (area(piece.old) + area(piece.new) - piece.shared_m2)
    };
    let n = n_parts(old);
    n > 1 && n == n_parts(new) && pieces.len() == n && pieces.iter().filter(is_same).count() == n
}

#[cfg(test)]
mod tests {
    use super::super::building::{buildings, tests::house};
    use super::*;

    fn compared(old: &[BuildingRecord], new: &[BuildingRecord]) -> HeightEvidence {
        let (old, new) = (buildings(old, [0.0; 2]), buildings(new, [0.0; 2]));
        evidence(&old.iter().collect::<Vec<_>>(), &new.iter().collect::<Vec<_>>(), &Unstated::default())
    }

    #[test]
    fn a_split_house_is_compared_over_the_area() {
        let old = [house("a", [0.0, 0.0, 20.0, 10.0], 8.0)];
        let new = [house("b", [0.0, 0.0, 5.0, 10.0], 12.0), house("c", [5.0, 0.0, 15.0, 10.0], 8.0)];
        let found = compared(&old, &new).mean().unwrap();
        assert!((found.height_m - 1.0).abs() < 1e-9 && (found.roof_z_m.unwrap() - 1.0).abs() < 1e-9, "{found:?}");
        assert!((found.sigma_m - 0.25 * 2.0_f64.sqrt()).abs() < 1e-9, "as if all erred the same way");
    }

    #[test]
    fn an_annex_does_not_lower_the_house() {
        let old = [house("a", [0.0, 0.0, 10.0, 10.0], 9.0)];
        let part = |id: &str, west, height_m| BuildingRecord {
            part_of: Some("a".to_owned()),
            ..house(id, [west, 0.0, 10.0, 10.0], height_m)
        };
        let new = [part("a#1", 0.0, 9.0), part("a#2", 10.0, 3.0)];
        assert_eq!(compared(&old, &new).mean().unwrap().height_m, 0.0);
    }

    #[test]
    fn the_same_parts_are_compared_one_by_one_too() {
        let hall = |tower_m: f64| {
            let part = |id: &str, west, height_m| BuildingRecord {
                part_of: Some("a".to_owned()),
                ..house(id, [west, 0.0, 10.0, 10.0], height_m)
            };
            [part("a#1", 0.0, 8.0), part("a#2", 10.0, tower_m)]
        };
        let HeightEvidence::Known { mean, parts } = compared(&hall(20.0), &hall(26.0)) else { panic!("all is known") };
        assert_eq!((mean.height_m, parts.iter().map(|d| d.height_m).collect::<Vec<_>>()), (3.0, vec![0.0, 6.0]));
    }

    #[test]
    fn each_side_says_what_it_lacks() {
        let old = BuildingRecord { status: Status::Doubtful, ..house("a", [0.0, 0.0, 9.0, 9.0], 8.0) };
        let new = BuildingRecord { height_sigma_m: None, ..house("b", [0.0, 0.0, 9.0, 9.0], 8.0) };
        let missing =
            HeightEvidence::Missing(BTreeSet::from([ChangeReason::OldDoubtful, ChangeReason::NewSigmaUnknown]));
        assert_eq!(compared(&[old], std::slice::from_ref(&new)), missing);
        let unstated = Unstated { old_m: None, new_m: Some(0.4) };
        assert_eq!(unstated.height(&new, Epoch::New), Ok((8.0, 0.4)));
    }
}
