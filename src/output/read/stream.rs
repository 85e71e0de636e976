//! A file's buildings one by one, for writers: memory does not grow with the file.
//!
//! `CityJSON` alone has to be read whole, because its vertices come after what refers to them.

use std::path::{Path, PathBuf};

use super::super::buildings::Records;
use super::super::cityjson::read::{CityFile, Sequence};
use super::super::{BuildingRecord, OutputError};
use super::{FoundBuilding, ReadError, ReadOptions, is_cityjson, is_sequence, open_layer, surfaces};
use crate::crs::Crs;

/// A file whose buildings can be gone through again and again.
#[derive(Debug)]
pub struct RecordFile<'a> {
    path: PathBuf,
    options: ReadOptions<'a>,
    crs: Option<Crs>,
    content: Content,
}

/// Where the buildings are.
#[derive(Debug)]
enum Content {
    Memory(Vec<BuildingRecord>),
    Sequence,
    Layer,
}

impl<'a> RecordFile<'a> {
    /// Opens `CityJSON`, `CityJSONSeq` or a vector layer; see [`super::FoundBuildings::read`].
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn open(path: &Path, options: ReadOptions<'a>) -> Result<Self, ReadError> {
        let (crs, content) = if is_sequence(path) {
            (Sequence::open(path)?.crs().cloned(), Content::Sequence)
        } else if is_cityjson(path)? {
            let city = CityFile::read(path)?;
            let records = surfaces::buildings(&city, options.lod).iter().map(FoundBuilding::to_record).collect();
            (city.crs, Content::Memory(records))
        } else {
            (open_layer(path, &options)?.0.crs()?, Content::Layer)
        };
        Ok(Self { path: path.to_owned(), options, crs, content })
    }

    /// Its CRS, where it states one.
    #[must_use]
    pub fn crs(&self) -> Option<&Crs> {
        self.crs.as_ref()
    }
}

impl Records for RecordFile<'_> {
    fn visit(&self, visit: &mut dyn FnMut(&BuildingRecord) -> Result<(), OutputError>) -> Result<(), OutputError> {
        match &self.content {
            Content::Memory(records) => records.visit(visit),
            Content::Sequence => Sequence::open(&self.path)?.try_for_each(|feature| {
                surfaces::buildings(&feature?, self.options.lod).iter().try_for_each(|found| visit(&found.to_record()))
            }),
            Content::Layer => {
                let read = |e| OutputError::Input(Box::new(e));
                let (mut layer, id_field) = open_layer(&self.path, &self.options).map_err(read)?;
                layer.features().try_for_each(|feature| {
                    visit(&FoundBuilding::from_feature(feature, id_field.as_deref()).to_record())
                })
            }
        }
    }
}
