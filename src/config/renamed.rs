//! Keys of older configuration files: read for one version, each with a note.
//!
//! The heights that are looked for were three keys once, two of the solver and one of depth from the photos alone; photometric
//! refinement was a part of the solver's settings.

use sizeup_geo::issue::{Issue, Severity, Subject};

/// Old and new key, and why it changed.
type Renamed = (&'static str, &'static str, &'static str);

/// Keys of a run.
pub(super) const OF_RUN: [Renamed; 7] = [
    ("optimise.min_height_m", "heights.min_m", ONE_RANGE),
    ("optimise.max_height_m", "heights.max_m", ONE_RANGE),
    ("prior.max_height_m", "heights.max_m", ONE_RANGE),
    ("optimise.polish", "refinement", "it is a stage of its own, after the solver"),
    ("optimise.search.take_back_spill", "optimise.search.correct_edge_bleeding", "edge bleeding is the field's word"),
    ("footprints.outline", "footprints.contour", MASKS_CONTOUR),
    ("footprints.cadastre.outline_from", "footprints.cadastre.footprint_from", BUILDINGS_FOOTPRINT),
];
/// Keys of a simulated scene, and of benchmarks on such.
pub(super) const OF_SCENE: [Renamed; 2] = [
    ("masks.outline", "masks.contour", MASKS_CONTOUR),
    ("errors.outline_m", "errors.footprint_m", BUILDINGS_FOOTPRINT),
];
const ONE_RANGE: &str = "there is one range of heights now";
const MASKS_CONTOUR: &str = "what a mask draws is a contour";
const BUILDINGS_FOOTPRINT: &str = "a building's polygon is its footprint";

/// Puts the values of old keys where the new ones are. A new key that is set as well counts; of several old ones the least does, as
/// nothing was found above it.
pub(super) fn in_table(table: &mut toml::Table, renamed: &[Renamed]) -> Vec<Issue> {
    let mut notes = Vec::new();
    let has = |table: &toml::Table, key: &str| value(table, key).is_some();
    let given: Vec<bool> = renamed.iter().map(|(_, new, _)| has(table, new)).collect();
    for ((old, new, why), is_given) in renamed.iter().zip(given) {
        let Some(moved) = take(table, old) else { continue };
        notes.push(note(old, new, why, is_given));
        let is_less = |known: &toml::Value| number(&moved) < number(known);
        if !is_given && value(table, new).is_none_or(is_less) {
            set(table, new, moved);
        }
    }
    notes
}

/// An assignment `old.key=value` as one of the new key.
pub(super) fn in_assignment(assignment: &str, renamed: &[Renamed]) -> (String, Option<Issue>) {
    let found = assignment.split_once('=').and_then(|(key, value)| {
        let key = key.trim();
        let (rest, (old, new, why)) = renamed.iter().find_map(|of| {
            let rest = key.strip_prefix(of.0)?;
            (rest.is_empty() || rest.starts_with('.')).then_some((rest, of))
        })?;
        Some((format!("{new}{rest}={value}"), Some(note(old, new, why, false))))
    });
    found.unwrap_or_else(|| (assignment.to_owned(), None))
}

fn note(old: &str, new: &str, why: &str, is_given: bool) -> Issue {
    let does = if is_given { "does not count beside" } else { "is read as" };
    let message = format!("`{old}` {does} `{new}`: {why}");
    Issue::new(Severity::Note, "key_renamed", Subject::Input("configuration".to_owned()), message)
        .hint(format!("write `{new}`; the next version refuses `{old}`"))
}

fn value<'t>(table: &'t toml::Table, key: &str) -> Option<&'t toml::Value> {
    match key.split_once('.') {
        Some((head, rest)) => value(table.get(head)?.as_table()?, rest),
        None => table.get(key),
    }
}

fn take(table: &mut toml::Table, key: &str) -> Option<toml::Value> {
    match key.split_once('.') {
        Some((head, rest)) => take(table.get_mut(head)?.as_table_mut()?, rest),
        None => table.remove(key),
    }
}

fn set(table: &mut toml::Table, key: &str, value: toml::Value) {
    let Some((head, rest)) = key.split_once('.') else {
        table.insert(key.to_owned(), value);
        return;
    };
    let of = table.entry(head).or_insert_with(|| toml::Value::Table(toml::Table::new()));
    if let Some(of) = of.as_table_mut() {
        set(of, rest, value);
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_keys_are_read_under_their_new_names_however_deep_they_stand() {
        let text = "[optimise]\nmax_height_m = 40.0\n[optimise.polish]\nenabled = false\n[optimise.search]\ntake_back_spill = false\n";
        let mut table: toml::Table = text.parse().unwrap();
        let notes = in_table(&mut table, &OF_RUN);
        assert_eq!(notes.len(), 3, "{notes:?}");
        let new = "[optimise]\n[optimise.search]\ncorrect_edge_bleeding = false\n[heights]\nmax_m = 40.0\n[refinement]\nenabled = false\n";
        assert_eq!(table, new.parse::<toml::Table>().unwrap());
        let (assignment, note) = in_assignment("optimise.polish.n_photos=4", &OF_RUN);
        assert_eq!(assignment, "refinement.n_photos=4");
        assert!(note.unwrap().message.contains("`optimise.polish` is read as `refinement`"));
    }

    #[test]
    fn outlines_of_older_files_are_contours_of_masks_and_footprints_of_buildings() {
        let text =
            "[footprints]\nsource = \"masks\"\noutline = \"roof\"\n[footprints.cadastre]\noutline_from = \"photos\"\n";
        let mut table: toml::Table = text.parse().unwrap();
        assert_eq!(in_table(&mut table, &OF_RUN).len(), 2);
        let new = text.replace("outline_from", "footprint_from").replace("outline =", "contour =");
        assert_eq!(table, new.parse::<toml::Table>().unwrap());
        let mut scene: toml::Table = "[masks]\noutline = \"roof\"\n[errors]\noutline_m = 0.2\n".parse().unwrap();
        assert_eq!(in_table(&mut scene, &OF_SCENE).len(), 2);
        assert_eq!(scene, "[masks]\ncontour = \"roof\"\n[errors]\nfootprint_m = 0.2\n".parse::<toml::Table>().unwrap());
    }

    #[test]
    fn a_new_key_counts_beside_an_old_one() {
        let mut table: toml::Table = "[optimise]\nmax_height_m = 40.0\n[heights]\nmax_m = 60.0\n".parse().unwrap();
        assert!(in_table(&mut table, &OF_RUN)[0].message.contains("does not count beside"));
        assert_eq!(value(&table, "heights.max_m").and_then(toml::Value::as_float), Some(60.0));
    }
}
