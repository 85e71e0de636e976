//! `changes.png`: a map of what changed.

use image::RgbImage;

use super::layer::colour;
use super::{ChangesReport, Class};
use crate::output::picture::{MapClass, MapHeadings, class_map};
use sizeup_geo::crs::Crs;

/// Draws the map: what has changed lies over what has not.
#[must_use]
pub fn changes_map(report: &ChangesReport, crs: &Crs) -> RgbImage {
    let of = |class: Class| MapClass {
        label: class.as_str().replace('_', " "),
        colour: colour(class),
        footprints: report
            .changes
            .iter()
            .filter(|change| change.class == class)
            .map(|change| &change.footprint)
            .collect(),
    };
    let classes: Vec<MapClass<'_>> = Class::ALL.into_iter().rev().map(of).collect();
    let dates =
        [&report.old, &report.new].map(|result| result.reference_date.clone().unwrap_or_else(|| result.path.clone()));
    let headings = MapHeadings {
        title: "What changed".to_owned(),
        below: format!(
            "{} of {} have changed · {} to {}",
            report.n_changed(),
            report.changes.len(),
            dates[0],
            dates[1]
        ),
    };
    class_map(&headings, &classes, crs)
}
