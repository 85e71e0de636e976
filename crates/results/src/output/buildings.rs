//! The buildings of a result as the writers want them: gone through twice, never all in memory at once.
//!
//! The first pass finds what a file's head needs ([`Overview`]), the second writes. Parts of one building of the input
//! are brought together by [`Families`], which holds only those whose other parts are still to come.

use std::collections::{HashMap, HashSet};

use indexmap::IndexMap;

use super::grid::{Extent, OutputGrid};
use super::{BuildingRecord, OutputError};
use sizeup_geo::geodata::features::ColumnKind;

/// Buildings that can be gone through again and again, in the same order.
pub trait Records {
    /// Hands every building to `visit`, until that fails.
    ///
    /// # Errors
    /// The error of `visit`, or [`OutputError`] where the buildings cannot be read.
    fn visit(&self, visit: &mut dyn FnMut(&BuildingRecord) -> Result<(), OutputError>) -> Result<(), OutputError>;
}

impl Records for [BuildingRecord] {
    fn visit(&self, visit: &mut dyn FnMut(&BuildingRecord) -> Result<(), OutputError>) -> Result<(), OutputError> {
        self.iter().try_for_each(visit)
    }
}

/// Overview of all buildings for the head of a file. The ids are kept while they are checked, nothing else per building.
#[derive(Debug, Clone, Default)]
pub struct Overview {
    /// Buildings of the input: one in parts counts once.
    pub n_buildings: usize,
    /// Buildings with a height in all their parts.
    pub n_heights: usize,
    /// Buildings without a footprint, or with a part without.
    pub n_without_footprint: usize,
    /// Whether the form of any roof is known.
    pub has_roofs: bool,
    /// Whether any footprint is known to be off.
    pub has_shifts: bool,
    /// The box around all footprints, base to roof or ridge.
    pub extent: Option<Extent>,
    /// Number of parts by the building they are parts of.
    pub n_parts: HashMap<String, usize>,
    /// The user's attributes in the order of their first appearance, with the narrowest type that holds all values;
    /// `None` where all are missing.
    pub attributes: IndexMap<String, Option<ColumnKind>>,
}

impl Overview {
    /// Goes through all buildings once, and checks what all formats rely on: one building per id.
    ///
    /// # Errors
    /// [`OutputError::DuplicateId`], [`OutputError::NotFinite`], or that of the source.
    pub fn of<R: Records + ?Sized>(records: &R) -> Result<Self, OutputError> {
        let mut overview = Self::default();
        let mut ids: HashSet<Box<str>> = HashSet::new();
        let (mut without_height, mut without_footprint) = (Wholes::default(), Wholes::default());
        records.visit(&mut |record| {
            if !ids.insert(record.id.as_str().into()) {
                return Err(OutputError::DuplicateId { id: record.id.clone() });
            }
            if let Some(part) = Extent::of(record)? {
                overview.extent = Some(overview.extent.map_or(part, |whole| whole.union(&part)));
            }
            if let Some(whole) = &record.part_of {
                *overview.n_parts.entry(whole.clone()).or_default() += 1;
            }
            for (name, value) in &record.attributes {
                match overview.attributes.get_mut(name) {
                    Some(kind) => *kind = ColumnKind::wider(*kind, value),
                    None => drop(overview.attributes.insert(name.clone(), ColumnKind::wider(None, value))),
                }
            }
            overview.has_roofs |= record.roof.is_some();
            overview.has_shifts |= record.footprint_in_photos().is_some();
            overview.n_buildings += usize::from(record.part_of.is_none());
            without_height.add_if(record.height_m.is_none(), record);
            without_footprint.add_if(record.footprint.is_none(), record);
            Ok(())
        })?;
        overview.n_buildings += overview.n_parts.len();
        overview.n_heights = overview.n_buildings - without_height.n();
        overview.n_without_footprint = without_footprint.n();
        match overview.n_parts.keys().filter(|whole| ids.contains(whole.as_str())).min() {
            Some(whole) => Err(OutputError::DuplicateId { id: whole.clone() }),
            None => Ok(overview),
        }
    }

    /// The output grid that holds all buildings.
    ///
    /// # Errors
    /// [`OutputError::TooFarApart`].
    pub fn grid(&self, scale_m: f64) -> Result<OutputGrid, OutputError> {
        OutputGrid::around(self.extent.as_ref(), scale_m)
    }
}

/// Buildings that something is said of, each once however many of its parts it is said of.
#[derive(Debug, Default)]
pub(super) struct Wholes {
    n_single: usize,
    in_parts: HashSet<String>,
}

impl Wholes {
    /// Adds the building of a record where the record is such.
    pub(super) fn add_if(&mut self, is_such: bool, record: &BuildingRecord) {
        match &record.part_of {
            _ if !is_such => {}
            None => self.n_single += 1,
            Some(whole) if self.in_parts.contains(whole) => {}
            Some(whole) => drop(self.in_parts.insert(whole.clone())),
        }
    }

    /// Number of buildings.
    pub(super) fn n(&self) -> usize {
        self.n_single + self.in_parts.len()
    }
}

/// A building of the input with all its parts.
#[derive(Debug)]
pub enum Family<'a> {
    /// A building in one piece.
    Single(&'a BuildingRecord),
    /// In several pieces: its id, and the pieces in the order in which they came.
    Parts(String, Vec<BuildingRecord>),
}

/// Brings parts of one building together.
#[derive(Debug)]
pub struct Families<'a> {
    overview: &'a Overview,
    waiting: HashMap<String, Vec<BuildingRecord>>,
}

impl<'a> Families<'a> {
    /// For the buildings of an overview.
    #[must_use]
    pub fn new(overview: &'a Overview) -> Self {
        Self { overview, waiting: HashMap::new() }
    }

    /// The building that this record completes, if it does.
    pub fn add<'r>(&mut self, record: &'r BuildingRecord) -> Option<Family<'r>> {
        let Some(whole) = &record.part_of else { return Some(Family::Single(record)) };
        let parts = self.waiting.entry(whole.clone()).or_default();
        parts.push(record.clone());
        if parts.len() < self.overview.n_parts.get(whole).copied().unwrap_or(0) {
            return None;
        }
        self.waiting.remove(whole).map(|parts| Family::Parts(whole.clone(), parts))
    }
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};

    use super::*;
    use crate::output::record::tests::record;

    #[test]
    fn a_building_in_parts_counts_once_and_lacks_what_one_of_its_parts_lacks() {
        let footprint = Rect::new(coord! { x: 0.0, y: 0.0 }, coord! { x: 9.0, y: 9.0 }).to_polygon();
        let of = |id: &str, whole: Option<&str>, height_m| BuildingRecord {
            part_of: whole.map(str::to_owned),
            height_m,
            ..record(id, footprint.clone(), 3.0, 2.0, 9.0)
        };
        let records = [
            of("a", None, Some(7.0)),
            of("b#1", Some("b"), Some(7.0)),
            of("b#2", Some("b"), None),
            of("b#3", Some("b"), None),
            of("c#1", Some("c"), Some(7.0)),
            of("c#2", Some("c"), Some(7.0)),
        ];
        let overview = Overview::of(records.as_slice()).unwrap();
        assert_eq!((overview.n_buildings, overview.n_heights, overview.n_without_footprint), (3, 2, 0));
    }
}
