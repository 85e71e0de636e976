//! Issues of footprints that lie elsewhere than the photos show their buildings: the layer as a whole, and single ones.

use geo::Centroid as _;

use super::{FootprintStage, HeightStage};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::optimise::LayerShift;

/// A warning that the footprint layer lies elsewhere than the photos show its buildings.
pub(super) fn shifted_layer(shift: &LayerShift) -> Issue {
    let (east_m, north_m) = (shift.east_m, shift.north_m);
    let message = format!(
        "the footprints lie {:.1} m off, {} of where the photos show their buildings (± {:.1} m, by {} of them); heights \
         were measured with the photos moved there",
        east_m.hypot(north_m),
        east_and_north(east_m, north_m),
        shift.sigma_m,
        shift.n_buildings,
    );
    // As it would be written: no minus before a zero.
    let back = |way_m: f64| 0.0 - (way_m * 10.0).round() / 10.0;
    let hint = format!(
        "if the layer is off, `shift_m = [{:?}, {:?}]` under [footprints] moves it; if the photos are, their positions have another \
         datum or base station",
        back(east_m),
        back(north_m),
    );
    Issue::new(Severity::Warning, "footprints_shifted", Subject::Input("footprints".to_owned()), message).hint(hint)
}

/// A note on each footprint that lies elsewhere than the photos show its building, and a warning on all of them.
pub(super) fn moved_footprints(footprints: &FootprintStage, heights: &HeightStage) -> Vec<Issue> {
    let solved = heights.solved.iter().zip(&heights.solution.heights);
    let mut notes: Vec<Issue> = solved
        .filter_map(|(&at, solved)| {
            let (shift, footprint) = (solved.footprint_shift?, &footprints.layer.footprints[at]);
            let mut parts = Vec::new();
            if shift.is_moved() {
                let way = east_and_north(shift.east_m, shift.north_m);
                parts.push(format!("lies {way} of where the photos show the building (± {:.1} m)", shift.sigma_m));
            }
            if shift.too_large_m != 0.0 {
                let words = if shift.too_large_m > 0.0 { "farther out than" } else { "inside of" };
                let by_m = shift.too_large_m.abs();
                parts.push(format!(
                    "has walls that stand {by_m:.1} m {words} the edge of the roof that the photos show"
                ));
            }
            let message = format!("the footprint {}", parts.join(", and "));
            let note = Issue::new(Severity::Note, "footprint_off", Subject::Building(footprint.id.0.clone()), message);
            Some(match footprint.polygon.centroid() {
                Some(place) => note.at(place.x(), place.y()),
                None => note,
            })
        })
        .collect();
    if !notes.is_empty() {
        let message = format!(
            "{} of {} footprints lie elsewhere than the photos show their buildings, or are larger or smaller; heights were measured \
             where the photos show them",
            notes.len(),
            heights.solved.len(),
        );
        let hint = "the layer footprints_moved of the GeoPackage has them there; `footprints = \"in_photos\"` under [output] \
                    takes them for the given ones";
        notes.push(
            Issue::new(Severity::Warning, "footprints_off", Subject::Input("footprints".to_owned()), message)
                .hint(hint),
        );
    }
    notes
}

/// A way along the ground in words: `0.8 m west and 0.3 m south`.
fn east_and_north(east_m: f64, north_m: f64) -> String {
    let along = |way_m: f64, words: [&str; 2]| format!("{:.1} m {}", way_m.abs(), words[usize::from(way_m < 0.0)]);
    format!("{} and {}", along(east_m, ["east", "west"]), along(north_m, ["north", "south"]))
}
