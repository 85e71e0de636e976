//! The buildings of a result as the writers want them: gone through twice, never all in memory at once.
//!
//! The first pass finds what a file's head needs ([`Overview`]), the second writes. Parts of one building of the input
//! are brought together by [`Families`], which holds only those whose other parts are still to come.

use std::collections::{HashMap, HashSet};

use indexmap::IndexMap;

use super::grid::{Extent, Grid};
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

/// What the head of a file says of all buildings. The ids are kept while they are checked, nothing else per building.
#[derive(Debug, Clone, Default)]
pub struct Overview {
    /// Buildings there are.
    pub n_buildings: usize,
    /// Buildings with a height.
    pub n_heights: usize,
    /// Of them, those without an outline.
    pub n_without_outline: usize,
    /// The box around all outlines, base to roof.
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
            overview.n_buildings += 1;
            overview.n_heights += usize::from(record.height_m.is_some());
            overview.n_without_outline += usize::from(record.footprint.is_none());
            Ok(())
        })?;
        match overview.n_parts.keys().filter(|whole| ids.contains(whole.as_str())).min() {
            Some(whole) => Err(OutputError::DuplicateId { id: whole.clone() }),
            None => Ok(overview),
        }
    }

    /// The output grid that holds all buildings.
    ///
    /// # Errors
    /// [`OutputError::TooFarApart`].
    pub fn grid(&self, scale_m: f64) -> Result<Grid, OutputError> {
        Grid::around(self.extent.as_ref(), scale_m)
    }
}

/// A building of the input with all its parts.
#[derive(Debug)]
pub enum Family<'a> {
    /// In one piece.
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
