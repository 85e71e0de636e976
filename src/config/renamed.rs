//! Keys of older configuration files: read for one version, each with a note.
//!
//! The heights that are looked for were three keys once, two of the solver and one of depth from the photos alone; photometric
//! refinement was a part of the solver's settings.

use sizeup_geo::issue::{Issue, Severity, Subject};

/// Old and new keys, and why they changed.
const RENAMED: [(&str, &str, &str); 4] = [
    ("optimise.min_height_m", "heights.min_m", ONE_RANGE),
    ("optimise.max_height_m", "heights.max_m", ONE_RANGE),
    ("prior.max_height_m", "heights.max_m", ONE_RANGE),
    ("optimise.polish", "refinement", "it is a stage of its own, after the solver"),
];
const ONE_RANGE: &str = "there is one range of heights now";

/// Puts the values of old keys where the new ones are. A new key that is set as well counts; of several old ones the least does, as
/// nothing was found above it.
pub(super) fn in_table(table: &mut toml::Table) -> Vec<Issue> {
    let mut notes = Vec::new();
    let has = |table: &toml::Table, key: &str| value(table, key).is_some();
    let given: Vec<bool> = RENAMED.iter().map(|(_, new, _)| has(table, new)).collect();
    for ((old, new, why), is_given) in RENAMED.iter().zip(given) {
        let Some((head, tail)) = old.split_once('.') else { continue };
        let Some(moved) = table.get_mut(head).and_then(|of| of.as_table_mut()?.remove(tail)) else { continue };
        notes.push(note(old, new, why, is_given));
        let is_less = |known: &toml::Value| number(&moved) < number(known);
        if !is_given && value(table, new).is_none_or(is_less) {
            set(table, new, moved);
        }
    }
    notes
}

/// An assignment `old.key=value` as one of the new key.
pub(super) fn in_assignment(assignment: &str) -> (String, Option<Issue>) {
    let renamed = assignment.split_once('=').and_then(|(key, value)| {
        let key = key.trim();
        let (rest, (old, new, why)) = RENAMED.iter().find_map(|of| {
            let rest = key.strip_prefix(of.0)?;
            (rest.is_empty() || rest.starts_with('.')).then_some((rest, of))
        })?;
        Some((format!("{new}{rest}={value}"), Some(note(old, new, why, false))))
    });
    renamed.unwrap_or_else(|| (assignment.to_owned(), None))
}

fn note(old: &str, new: &str, why: &str, is_given: bool) -> Issue {
    let does = if is_given { "does not count beside" } else { "is read as" };
    let message = format!("`{old}` {does} `{new}`: {why}");
    Issue::new(Severity::Note, "key_renamed", Subject::Input("configuration".to_owned()), message)
        .hint(format!("write `{new}`; the next version refuses `{old}`"))
}

fn value<'t>(table: &'t toml::Table, key: &str) -> Option<&'t toml::Value> {
    match key.split_once('.') {
        Some((head, tail)) => table.get(head)?.as_table()?.get(tail),
        None => table.get(key),
    }
}

fn set(table: &mut toml::Table, key: &str, value: toml::Value) {
    let Some((head, tail)) = key.split_once('.') else {
        table.insert(key.to_owned(), value);
        return;
    };
    let of = table.entry(head).or_insert_with(|| toml::Value::Table(toml::Table::new()));
    if let Some(of) = of.as_table_mut() {
        of.insert(tail.to_owned(), value);
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}
