//! Buildings in parts: footprints split where a roof has two levels, and joined again where the heights of the parts do not differ.

use std::collections::{BTreeMap, BTreeSet};

use geo::{Area as _, Contains as _, InteriorPoint as _};
use geo_types::{LineString, Polygon};

use super::task::{Building, LevelEvidence, Part, Split};
use crate::frames::LocalOrigin;
use crate::optimise::{LevelGain, OtherLevel, SolvedHeight};
use crate::split::{divide, with_corners_of};

/// Pieces of cuts by the priors smaller than this go to the other side, m².
const MIN_PIECE_M2: f64 = 12.0;
/// The step between two levels has to exceed this many standard deviations.
const CLEAR_SIGMAS: f64 = 2.0;

/// A building by its position, and the path of a part of it.
pub(super) type PartId = (usize, Vec<usize>);

/// Cut of one footprint.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cut {
    /// Part that is cut.
    id: PartId,
    /// Region at another level than the rest, map frame.
    other: Polygon<f64>,
    /// Gain of two levels over one.
    gain: LevelGain,
}

/// Buildings in parts, and the splits that led to them.
#[derive(Debug, Clone, Default)]
pub(super) struct Parts {
    pub parts: Vec<Part>,
    pub splits: Vec<Split>,
}

impl Parts {
    /// Buildings as single parts, not yet split.
    pub fn whole(buildings: &[Building]) -> Self {
        let part = |(building, of): (usize, &Building)| Part {
            building,
            path: Vec::new(),
            footprint: of.footprint.clone(),
            ground: of.ground,
        };
        Self { parts: buildings.iter().enumerate().map(part).collect(), splits: Vec::new() }
    }

    /// Cuts along the levels that a solution found.
    pub fn cuts(&self, origin: LocalOrigin, levels: &[OtherLevel]) -> Vec<Cut> {
        let of_level = |level: &OtherLevel| {
            let Part { building, path, .. } = &self.parts[level.building];
            let ring = level.corners.map(|[x, y]| (x + origin.0.x, y + origin.0.y));
            let other = Polygon::new(LineString::from(ring.to_vec()), Vec::new());
            Cut { id: (*building, path.clone()), other, gain: level.gain.clone() }
        };
        levels.iter().map(of_level).collect()
    }

    /// Replaces the parts that are cut by their pieces. Returns the former position of each part, `None` for pieces; `None` as a
    /// whole if nothing was cut.
    pub fn split(&mut self, cuts: &[Cut]) -> Option<Vec<Option<usize>>> {
        let by_id: BTreeMap<&PartId, &Cut> = cuts.iter().map(|cut| (&cut.id, cut)).collect();
        let before = std::mem::take(&mut self.parts);
        let n_before = before.len();
        let mut former = Vec::with_capacity(n_before);
        for (at, part) in before.into_iter().enumerate() {
            let cut = by_id.get(&(part.building, part.path.clone()));
            let sides = |cut: &Cut| divide(&part.footprint.clone().into(), &cut.other, MIN_PIECE_M2);
            let Some((cut, sides)) = cut.and_then(|cut| Some((cut, sides(cut)?))) else {
                self.parts.push(part);
                former.push(Some(at));
                continue;
            };
            let pieces: Vec<Polygon<f64>> = sides.into_iter().flatten().collect();
            let (building, path) = cut.id.clone();
            let evidence = LevelEvidence::Priors(cut.gain.clone());
            self.splits.push(Split { building, path, n_parts: pieces.len(), evidence });
            for (i, footprint) in pieces.into_iter().enumerate() {
                let path = part.path.iter().copied().chain([i + 1]).collect();
                self.parts.push(Part { path, footprint, ..part });
                former.push(None);
            }
        }
        self.share_corners(&former);
        (self.parts.len() > n_before).then_some(former)
    }

    /// By part, its position among others; `None` where it is not there, or has another outline.
    pub fn positions_in(&self, others: &Self) -> Vec<Option<usize>> {
        let by_id: BTreeMap<(usize, &[usize]), usize> =
            others.parts.iter().enumerate().map(|(at, part)| ((part.building, part.path.as_slice()), at)).collect();
        let position = |part: &Part| {
            let at = *by_id.get(&(part.building, part.path.as_slice()))?;
            (others.parts[at].footprint == part.footprint).then_some(at)
        };
        self.parts.iter().map(position).collect()
    }

    /// Gives parts of one building each other's corners where a part was split once more: the corners of its pieces lie on edges of
    /// the others.
    pub fn share_corners(&mut self, former: &[Option<usize>]) {
        let mut by_building: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (at, part) in self.parts.iter().enumerate().filter(|(_, part)| !part.path.is_empty()) {
            by_building.entry(part.building).or_default().push(at);
        }
        let is_new = |at: &usize| former[*at].is_none();
        for parts in by_building.values().filter(|parts| parts.iter().any(is_new) && !parts.iter().all(is_new)) {
            let joined = parts.iter().map(|&at| {
                let others: Vec<_> = parts.iter().filter(|&&o| o != at).map(|&o| &self.parts[o].footprint).collect();
                with_corners_of(&others, &self.parts[at].footprint)
            });
            for (&at, footprint) in parts.iter().zip(joined.collect::<Vec<_>>()) {
                self.parts[at].footprint = footprint;
            }
        }
    }

    /// The cuts that the heights of the parts contradict. Each part should be at the level that it was cut for: nearer to that than to
    /// the other's, and two standard deviations from the other part. Parts of parts count by their areas.
    pub fn contradicted(&self, heights: &[SolvedHeight], cuts: &[Vec<Cut>]) -> BTreeSet<PartId> {
        let is_confirmed = |cut: &Cut| {
            let of_cut = || self.parts.iter().zip(heights).filter(|(part, _)| part.is_within((cut.id.0, &cut.id.1)));
            let level_of = |is_inner: bool| {
                let is_in = |part: &Part| part.footprint.interior_point().is_some_and(|p| cut.other.contains(&p));
                let side = of_cut().filter(|(part, _)| is_in(part) == is_inner);
                PartLevel::mean(side.filter_map(|(part, solved)| PartLevel::of(part, solved)))
            };
            // A part without a height contradicts nothing.
            let Some((inner, outer)) = level_of(true).zip(level_of(false)) else { return true };
            let [inner_m, outer_m] = cut.gain.heights_m.map(f64::from);
            let half_step_m = 0.5 * (inner_m - outer_m).abs();
            let is_where_cut =
                (inner.height_m - inner_m).abs() <= half_step_m && (outer.height_m - outer_m).abs() <= half_step_m;
            let step_m = (inner.height_m - outer.height_m) * (inner_m - outer_m).signum();
            is_where_cut && step_m > CLEAR_SIGMAS * inner.sigma_m.hypot(outer.sigma_m)
        };
        cuts.iter().flatten().filter(|cut| !is_confirmed(cut)).map(|cut| cut.id.clone()).collect()
    }
}

/// Cuts without those of some parts and of their pieces.
pub(super) fn without(cuts: &[Cut], joined: &BTreeSet<PartId>) -> Vec<Cut> {
    let is_within =
        |cut: &Cut, (building, path): &PartId| cut.id.0 == *building && cut.id.1.starts_with(path.as_slice());
    cuts.iter().filter(|cut| !joined.iter().any(|id| is_within(cut, id))).cloned().collect()
}

/// Level of one or several parts.
#[derive(Debug, Clone, Copy)]
struct PartLevel {
    area_m2: f64,
    height_m: f64,
    sigma_m: f64,
}

impl PartLevel {
    fn of(part: &Part, solved: &SolvedHeight) -> Option<Self> {
        let height_m = solved.roof?.mean_m;
        Some(Self { area_m2: part.footprint.unsigned_area(), height_m, sigma_m: solved.sigma_m.unwrap_or(0.0) })
    }

    /// Mean by area; errors are taken to be common to all.
    fn mean(levels: impl Iterator<Item = Self>) -> Option<Self> {
        levels.reduce(|a, b| {
            let area_m2 = a.area_m2 + b.area_m2;
            let mean = |of: fn(&Self) -> f64| (a.area_m2 * of(&a) + b.area_m2 * of(&b)) / area_m2;
            Self { area_m2, height_m: mean(|level| level.height_m), sigma_m: mean(|level| level.sigma_m) }
        })
    }
}
