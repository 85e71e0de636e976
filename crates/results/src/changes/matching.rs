//! Which buildings of two results stand for each other: by place, never by id.
//!
//! An old building `o` and a new one `n` are linked if
//!
//! ```text
//! area(o ∩ n) >= 0.3 · min(area(o), area(n))    and  n shares the most with o, or o the most with n
//! ```
//!
//! Buildings that hang together by links are a group: a house split in two, two halves merged. The second condition keeps
//! row houses apart whose footprints lie a little askew. A group whose old and new footprints have less than a fifth of their
//! union in common is none: something else was built there.

use std::collections::BTreeMap;

use geo::{Area as _, BooleanOps as _};
use geo_types::Polygon;
use rayon::prelude::*;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::building::{ComparedBuilding, joined};
use super::footprints::iou;

/// Share of the smaller of two buildings that they have in common if they stand for each other.
const MIN_SHARED_SHARE: f64 = 0.3;
/// Intersection over union of the footprints of a group, at least.
const MIN_GROUP_IOU: f64 = 0.2;

/// Buildings that stand for each other; one side may be empty.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Group {
    /// Buildings of the old result, ascending.
    pub old: Vec<usize>,
    /// Buildings of the new result, ascending.
    pub new: Vec<usize>,
    /// Whether another building stands there in the other result.
    pub is_replaced: bool,
}

/// Every building of both results in exactly one group: those with a new one in the new result's order, then the rest in
/// the old one's.
pub fn groups(old: &[ComparedBuilding<'_>], new: &[ComparedBuilding<'_>]) -> Vec<Group> {
    let links = links(old, new);
    let mut groups: Vec<Group> = components(old.len(), new.len(), &links)
        .into_par_iter()
        .flat_map_iter(|group| sound(group, old, new))
        .collect();
    groups.sort_by_key(|group| (group.new.is_empty(), group.new.first().copied(), group.old.first().copied()));
    groups
}

/// Pairs of an old and a new building, and the area they share.
fn links(old: &[ComparedBuilding<'_>], new: &[ComparedBuilding<'_>]) -> Vec<(usize, usize)> {
    let boxes = old.iter().enumerate().filter_map(|(i, building)| {
        let bounds = building.bounds()?;
        Some(GeomWithData::new(Rectangle::from_corners(bounds.min().into(), bounds.max().into()), i))
    });
    let tree = RTree::bulk_load(boxes.collect::<Vec<GeomWithData<Rectangle<[f64; 2]>, usize>>>());
    let of_new = |n: usize| -> Vec<(usize, usize, f64)> {
        let Some(bounds) = new[n].bounds() else { return Vec::new() };
        let envelope = AABB::from_corners(bounds.min().into(), bounds.max().into());
        let mut near: Vec<usize> = tree.locate_in_envelope_intersecting(&envelope).map(|found| found.data).collect();
        near.sort_unstable();
        let shared = |o: usize| (o, n, old[o].footprint.intersection(&new[n].footprint).unsigned_area());
        near.into_iter().map(shared).filter(|(_, _, shared_m2)| *shared_m2 > 0.0).collect()
    };
    let shared: Vec<(usize, usize, f64)> = (0..new.len()).into_par_iter().flat_map_iter(of_new).collect();
    let (mut most_of_old, mut most_of_new) = (BTreeMap::new(), BTreeMap::new());
    for &(o, n, shared_m2) in &shared {
        keep_most(most_of_old.entry(o).or_insert((n, shared_m2)), n, shared_m2);
        keep_most(most_of_new.entry(n).or_insert((o, shared_m2)), o, shared_m2);
    }
    let is_link = |&&(o, n, shared_m2): &&(usize, usize, f64)| {
        let smaller_m2 = old[o].footprint.unsigned_area().min(new[n].footprint.unsigned_area());
        shared_m2 >= MIN_SHARED_SHARE * smaller_m2 && (most_of_old[&o].0 == n || most_of_new[&n].0 == o)
    };
    shared.iter().filter(is_link).map(|&(o, n, _)| (o, n)).collect()
}

/// The first of those that share the most.
fn keep_most(most: &mut (usize, f64), other: usize, shared_m2: f64) {
    if shared_m2 > most.1 {
        *most = (other, shared_m2);
    }
}

/// Groups of what hangs together. New buildings are numbered after the old ones.
fn components(n_old: usize, n_new: usize, links: &[(usize, usize)]) -> Vec<Group> {
    let mut head: Vec<usize> = (0..n_old + n_new).collect();
    let find = |head: &mut Vec<usize>, mut i: usize| {
        while head[i] != i {
            head[i] = head[head[i]];
            i = head[i];
        }
        i
    };
    for &(o, n) in links {
        let (a, b) = (find(&mut head, o), find(&mut head, n_old + n));
        head[a.max(b)] = a.min(b);
    }
    let mut groups: BTreeMap<usize, Group> = BTreeMap::new();
    for i in 0..n_old + n_new {
        let group = groups.entry(find(&mut head, i)).or_default();
        if i < n_old { group.old.push(i) } else { group.new.push(i - n_old) }
    }
    groups.into_values().collect()
}

/// The group, or its buildings one by one where they have too little in common.
fn sound(group: Group, old: &[ComparedBuilding<'_>], new: &[ComparedBuilding<'_>]) -> Vec<Group> {
    if group.old.is_empty() || group.new.is_empty() {
        return vec![group];
    }
    let footprint = |of: &[ComparedBuilding<'_>], members: &[usize]| {
        joined(members.iter().flat_map(|&i| of[i].footprint.iter()).collect::<Vec<&Polygon<f64>>>().into_iter())
    };
    let (before, now) = (footprint(old, &group.old), footprint(new, &group.new));
    if iou(&before, &now) >= MIN_GROUP_IOU {
        return vec![group];
    }
    let alone = |old: Vec<usize>, new: Vec<usize>| Group { old, new, is_replaced: true };
    let gone = group.old.into_iter().map(|o| alone(vec![o], Vec::new()));
    gone.chain(group.new.into_iter().map(|n| alone(Vec::new(), vec![n]))).collect()
}

#[cfg(test)]
mod tests {
    use super::super::building::{buildings, tests::house};
    use super::*;
    use crate::output::BuildingRecord;

    fn matched(old: &[BuildingRecord], new: &[BuildingRecord]) -> Vec<(Vec<usize>, Vec<usize>, bool)> {
        let found = groups(&buildings(old, [0.0; 2]), &buildings(new, [0.0; 2]));
        found.into_iter().map(|group| (group.old, group.new, group.is_replaced)).collect()
    }

    #[test]
    fn a_house_split_in_two_and_two_merged_are_groups() {
        let old = [
            house("whole", [0.0, 0.0, 20.0, 10.0], 8.0),
            house("left", [50.0, 0.0, 8.0, 10.0], 8.0),
            house("right", [58.0, 0.0, 8.0, 10.0], 8.0),
        ];
        let new = [
            house("merged", [50.0, 0.0, 16.0, 10.0], 8.0),
            house("a", [0.0, 0.0, 10.0, 10.0], 8.0),
            house("b", [10.0, 0.0, 10.0, 10.0], 8.0),
        ];
        assert_eq!(matched(&old, &new), [(vec![1, 2], vec![0], false), (vec![0], vec![1, 2], false)]);
    }

    #[test]
    fn row_houses_that_lie_askew_stay_apart() {
        let row = |askew_m: f64| -> Vec<BuildingRecord> {
            (0..5).map(|i| house(&i.to_string(), [5.0 * f64::from(i) + askew_m, 0.0, 5.0, 9.0], 6.0)).collect()
        };
        let pairs = matched(&row(0.0), &row(2.0));
        assert_eq!(pairs, (0..5).map(|i| (vec![i], vec![i], false)).collect::<Vec<_>>());
    }

    #[test]
    fn a_hall_where_a_shed_stood_is_another_building() {
        let old = [house("shed", [0.0, 0.0, 4.0, 4.0], 3.0), house("far", [300.0, 0.0, 9.0, 9.0], 3.0)];
        let new = [house("hall", [-10.0, -10.0, 40.0, 30.0], 12.0)];
        let expected = [(vec![], vec![0], true), (vec![0], vec![], true), (vec![1], vec![], false)];
        assert_eq!(matched(&old, &new), expected);
    }

    #[test]
    fn what_has_no_footprint_stands_alone() {
        let mut lost = house("lost", [0.0, 0.0, 9.0, 9.0], 3.0);
        lost.footprint = None;
        let old = [lost.clone()];
        assert_eq!(matched(&old, &[lost]), [(vec![], vec![0], false), (vec![0], vec![], false)]);
    }
}
