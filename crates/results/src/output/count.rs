//! Buildings of the input by what became of them, apart from the parts that some of them have.

use std::collections::{BTreeMap, HashMap};

use super::{BuildingRecord, Status};

/// Counts buildings of the input: one in several parts counts once, as its worst part.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StatusCount {
    single: BTreeMap<Status, usize>,
    /// By building: the worst status of its parts.
    whole: HashMap<String, Status>,
    /// Parts by what became of them.
    pub parts: BTreeMap<Status, usize>,
}

impl StatusCount {
    /// Counts these records.
    #[must_use]
    pub fn of(records: &[BuildingRecord]) -> Self {
        let mut count = Self::default();
        for record in records {
            count.add(record);
        }
        count
    }

    /// Counts one more building, or part of one.
    pub fn add(&mut self, record: &BuildingRecord) {
        let Some(whole) = &record.part_of else {
            *self.single.entry(record.status).or_default() += 1;
            return;
        };
        *self.parts.entry(record.status).or_default() += 1;
        let worst = self.whole.entry(whole.clone()).or_insert(record.status);
        *worst = record.status.max(*worst);
    }

    /// Buildings of the input.
    #[must_use]
    pub fn n_buildings(&self) -> usize {
        self.single.values().sum::<usize>() + self.whole.len()
    }

    /// Parts of buildings that came in several pieces or were split.
    #[must_use]
    pub fn n_parts(&self) -> usize {
        self.parts.values().sum()
    }

    /// Buildings by what became of them; their sum is that of all.
    #[must_use]
    pub fn by_status(&self) -> BTreeMap<Status, usize> {
        self.whole.values().fold(self.single.clone(), |mut counts, status| {
            *counts.entry(*status).or_default() += 1;
            counts
        })
    }
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};

    use super::*;
    use crate::output::record::tests::record;

    #[test]
    fn a_building_in_parts_counts_once_as_its_worst_part() {
        let footprint = Rect::new(coord! { x: 0.0, y: 0.0 }, coord! { x: 9.0, y: 9.0 }).to_polygon();
        let of = |id: &str, whole: Option<&str>, status| BuildingRecord {
            part_of: whole.map(str::to_owned),
            status,
            ..record(id, footprint.clone(), 3.0, 2.0, 9.0)
        };
        let records = [
            of("a", None, Status::Measured),
            of("b#1", Some("b"), Status::Measured),
            of("b#2", Some("b"), Status::Doubtful),
            of("c", None, Status::Unknown),
        ];
        let count = StatusCount::of(&records);
        let expected = [(Status::Measured, 1), (Status::Doubtful, 1), (Status::Unknown, 1)];
        assert_eq!(count.by_status(), BTreeMap::from(expected));
        assert_eq!((count.n_buildings(), count.n_parts()), (3, 2));
        assert_eq!(count.parts, BTreeMap::from([(Status::Measured, 1), (Status::Doubtful, 1)]));
    }
}
