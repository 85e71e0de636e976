//! A file's buildings one by one, for writers: memory does not grow with the file.
//!
//! Of `CityJSON` the vertices are kept, 24 bytes each, because they come after what refers to them.

use std::path::{Path, PathBuf};

use super::super::buildings::Records;
use super::super::cityjson::CitySequence;
use super::super::cityjson::read::{CityFile, visit_objects};
use super::super::geopackage::LINEAGE_TABLE;
use super::super::{BuildingRecord, Lineage, OutputError};
use super::{
    FoundBuilding, ReadError, ReadOptions, is_cityjson, is_sequence, open_layer, require_metres, require_readable,
    surfaces,
};
use sizeup_geo::crs::Crs;

/// A file whose buildings can be gone through again and again.
#[derive(Debug)]
pub struct RecordFile<'a> {
    path: PathBuf,
    options: ReadOptions<'a>,
    crs: Option<Crs>,
    lineage: Option<Lineage>,
    content: RecordContent,
}

/// Buildings' part of the file.
#[derive(Debug)]
enum RecordContent {
    City { vertices: Vec<[f64; 3]> },
    Sequence,
    Layer,
}

impl<'a> RecordFile<'a> {
    /// Opens `CityJSON`, `CityJSONSeq` or a vector layer; see [`super::FoundBuildings::read`].
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn open(path: &Path, options: ReadOptions<'a>) -> Result<Self, ReadError> {
        require_readable(path)?;
        let of_metadata = |city: &CityFile| serde_json::from_value(city.metadata.get("sizeup")?.clone()).ok();
        let (crs, lineage, content) = if is_sequence(path) {
            let sequence = CitySequence::open(path)?;
            (sequence.header().crs.clone(), of_metadata(sequence.header()), RecordContent::Sequence)
        } else if is_cityjson(path)? {
            let city = CityFile::read_head(path)?;
            let lineage = of_metadata(&city);
            (city.crs, lineage, RecordContent::City { vertices: city.vertices })
        } else {
            let layer = open_layer(path, &options)?.0;
            let crs = layer.crs()?;
            let lineage = layer.into_text_of(&format!("SELECT lineage FROM {LINEAGE_TABLE}"));
            (crs, lineage.and_then(|json| serde_json::from_str(&json).ok()), RecordContent::Layer)
        };
        Ok(Self { path: path.to_owned(), options, crs, lineage, content })
    }

    /// Origin, where it is a file of ours.
    #[must_use]
    pub fn lineage(&self) -> Option<Lineage> {
        self.lineage.clone()
    }

    /// Holds the CRS of its buildings, its own or one that is stated for it, against what can be written: bodies are measured in its
    /// units. Layers have heights as attributes in metres.
    ///
    /// # Errors
    /// [`ReadError::HeightUnit`] and [`ReadError::Feet`] of `CityJSON` in feet.
    pub fn check_units(&self, crs: &Crs) -> Result<(), ReadError> {
        match self.content {
            RecordContent::City { .. } | RecordContent::Sequence => require_metres(&self.path, crs),
            RecordContent::Layer => Ok(()),
        }
    }

    /// CRS, where it states one.
    #[must_use]
    pub fn crs(&self) -> Option<&Crs> {
        self.crs.as_ref()
    }
}

impl Records for RecordFile<'_> {
    fn visit(&self, visit: &mut dyn FnMut(&BuildingRecord) -> Result<(), OutputError>) -> Result<(), OutputError> {
        match &self.content {
            RecordContent::City { vertices } => {
                let (mut gathering, lod) = (surfaces::BuildingGathering::default(), self.options.lod);
                visit_objects(&self.path, vertices, &mut |object| {
                    gathering.add(object, vertices, lod).iter().try_for_each(|found| visit(&found.to_record()))
                })?;
                gathering.rest(vertices, lod).iter().try_for_each(|found| visit(&found.to_record()))
            }
            RecordContent::Sequence => CitySequence::open(&self.path)?.try_for_each(|feature| {
                surfaces::buildings(&feature?, self.options.lod).iter().try_for_each(|found| visit(&found.to_record()))
            }),
            RecordContent::Layer => {
                let read = |e| OutputError::Input(Box::new(e));
                let (mut layer, id_field) = open_layer(&self.path, &self.options).map_err(read)?;
                layer.features().try_for_each(|feature| {
                    visit(&FoundBuilding::from_feature(feature, id_field.as_deref()).to_record())
                })
            }
        }
    }
}
