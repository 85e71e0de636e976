//! Keys of older configuration files: read for one version, each with a note.
//!
//! The heights that are looked for were three keys once: two of the solver, and one of depth from the photos alone. Now they
//! are `heights.min_m` and `heights.max_m`.

use crate::issue::{Issue, Severity, Subject};

/// Old and new keys.
const RENAMED: [(&str, &str); 3] = [
    ("optimise.min_height_m", "heights.min_m"),
    ("optimise.max_height_m", "heights.max_m"),
    ("prior.max_height_m", "heights.max_m"),
];

/// Puts the values of old keys where the new ones are. A new key that is set as well counts; of several old ones the least does, as
/// nothing was found above it.
pub(super) fn in_table(table: &mut toml::Table) -> Vec<Issue> {
    let mut notes = Vec::new();
    let has = |table: &toml::Table, key: &str| value(table, key).is_some();
    let given: Vec<bool> = RENAMED.iter().map(|(_, new)| has(table, new)).collect();
    for ((old, new), is_given) in RENAMED.iter().zip(given) {
        let Some((head, tail)) = old.split_once('.') else { continue };
        let Some(moved) = table.get_mut(head).and_then(|of| of.as_table_mut()?.remove(tail)) else { continue };
        notes.push(note(old, new, is_given));
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
        let (old, new) = RENAMED.iter().find(|(old, _)| *old == key.trim())?;
        Some((format!("{new}={value}"), Some(note(old, new, false))))
    });
    renamed.unwrap_or_else(|| (assignment.to_owned(), None))
}

fn note(old: &str, new: &str, is_given: bool) -> Issue {
    let does = if is_given { "does not count beside" } else { "is read as" };
    let message = format!("`{old}` {does} `{new}`: there is one range of heights now");
    Issue::new(Severity::Note, "key_renamed", Subject::Input("configuration".to_owned()), message)
        .hint(format!("write `{new}`; the next version refuses `{old}`"))
}

fn value<'t>(table: &'t toml::Table, key: &str) -> Option<&'t toml::Value> {
    let (head, tail) = key.split_once('.')?;
    table.get(head)?.as_table()?.get(tail)
}

fn set(table: &mut toml::Table, key: &str, value: toml::Value) {
    let Some((head, tail)) = key.split_once('.') else { return };
    let of = table.entry(head).or_insert_with(|| toml::Value::Table(toml::Table::new()));
    if let Some(of) = of.as_table_mut() {
        of.insert(tail.to_owned(), value);
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}
