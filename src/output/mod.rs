//! Results on disk: one record per building, and one file per format that writes them.

mod record;

pub use record::{BuildingRecord, HeightReference, Status};
