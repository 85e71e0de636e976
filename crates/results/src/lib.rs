//! Results of sizeup: one record per building, and the files and pages that show it.

pub mod output;
pub mod report;
