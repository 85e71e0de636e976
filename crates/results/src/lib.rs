//! Results of sizeup: one record per building, the files and pages that show it, and what changed between two of them.

pub mod changes;
pub mod output;
pub mod report;
