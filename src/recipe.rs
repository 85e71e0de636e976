//! What an artefact was made from, and the one answer to whether, and why, it is stale.
//!
//! A stage, a tile, a merge and the plan itself each keep the recipe that they were made by. Whoever wants one makes the
//! recipe that would be followed now: where the two differ, the artefact is stale, and [`Recipe::why_stale`] says by what.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use sizeup_geo::hashes::sha256_hex;

/// Longest value of a setting that is kept as it is; longer ones are kept as their hash.
const LONGEST_VALUE: usize = 80;
/// Differences that are told one by one.
const N_TOLD: usize = 3;
/// Stand-in for a file that is not there.
pub const ABSENT: &str = "absent";
/// The program's name among the parts.
const PROGRAM: &str = "program";

/// The program that makes things now: version and commit, as `0.1.0+1a2b3c4d5e6f`.
#[must_use]
pub fn program() -> String {
    match commit() {
        Some(commit) => format!("{}+{commit}", env!("CARGO_PKG_VERSION")),
        None => env!("CARGO_PKG_VERSION").to_owned(),
    }
}

/// The commit that the program was built from, with a `+` where files differed from it; `None` where nobody knew.
#[must_use]
pub fn commit() -> Option<&'static str> {
    Some(env!("SIZEUP_COMMIT")).filter(|commit| !commit.is_empty())
}

/// Everything that decides what an artefact is.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recipe {
    /// Settings by their keys.
    settings: BTreeMap<String, String>,
    /// All else by name, as a hash or a version.
    parts: BTreeMap<String, String>,
}

impl Recipe {
    /// The recipe of this program with some settings, a table of tables.
    #[must_use]
    pub fn new(settings: &Value) -> Self {
        let mut flat = BTreeMap::new();
        flatten("", settings, &mut flat);
        Self { settings: flat, parts: BTreeMap::from([(PROGRAM.to_owned(), program())]) }
    }

    /// With one more part, by its hash.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, sha256: impl Into<String>) -> Self {
        self.add(name, sha256);
        self
    }

    /// As this program would follow it.
    #[must_use]
    pub fn by_this_program(self) -> Self {
        self.with(PROGRAM, program())
    }

    /// Adds a part by its hash.
    pub fn add(&mut self, name: impl Into<String>, sha256: impl Into<String>) {
        self.parts.insert(name.into(), sha256.into());
    }

    /// The program that it is of.
    #[must_use]
    pub fn program(&self) -> &str {
        self.parts.get(PROGRAM).map_or("an unknown program", String::as_str)
    }

    /// Hash of all of it, hexadecimal.
    ///
    /// # Panics
    /// Never: text is representable as JSON.
    #[must_use]
    pub fn sha256(&self) -> String {
        sha256_hex(&serde_json::to_vec(self).expect("text is representable as JSON"))
    }

    /// Why what was made by another recipe is not what this one makes; `None` where it is.
    #[must_use]
    pub fn why_stale(&self, made_by: &Self) -> Option<String> {
        let settings = differences(&self.settings, &made_by.settings).map(|(key, now, then)| match (now, then) {
            (Some(now), Some(then)) => format!("{key} is {now}, was {then}"),
            (Some(now), None) => format!("{key} is {now}, was not set"),
            (None, then) => format!("{key} is not set, was {}", then.unwrap_or_default()),
        });
        let parts = differences(&self.parts, &made_by.parts).map(|(name, now, then)| match (now, then) {
            (Some(now), Some(then)) if name == PROGRAM => format!("made by sizeup {then}, this is {now}"),
            (None | Some(ABSENT), Some(_)) => format!("{name} {} gone", if is_plural(name) { "are" } else { "is" }),
            (Some(_), None | Some(ABSENT)) => format!("{name} {} new", if is_plural(name) { "are" } else { "is" }),
            _ => format!("{name} {} changed", if is_plural(name) { "have" } else { "has" }),
        });
        let all: Vec<String> = settings.chain(parts).collect();
        let rest = all.len().saturating_sub(N_TOLD);
        let told = all[..all.len().min(N_TOLD)].join("; ");
        match rest {
            _ if all.is_empty() => None,
            0 => Some(told),
            _ => Some(format!("{told}; and {rest} more")),
        }
    }
}

/// Whether a part's name stands for several things: `its views`. A file's name stands for one, however it ends.
fn is_plural(name: &str) -> bool {
    name.starts_with("its ") && name.ends_with('s')
}

type RecipeDifference<'a> = (&'a str, Option<&'a str>, Option<&'a str>);

/// Entries that are not the same in both, by name.
fn differences<'a>(
    now: &'a BTreeMap<String, String>,
    then: &'a BTreeMap<String, String>,
) -> impl Iterator<Item = RecipeDifference<'a>> {
    let names: std::collections::BTreeSet<&String> = now.keys().chain(then.keys()).collect();
    let both = names
        .into_iter()
        .map(|name| (name.as_str(), now.get(name).map(String::as_str), then.get(name).map(String::as_str)));
    both.filter(|(_, now, then)| now != then)
}

fn flatten(prefix: &str, value: &Value, flat: &mut BTreeMap<String, String>) {
    if let Value::Object(table) = value {
        for (key, value) in table {
            let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
            flatten(&key, value, flat);
        }
    } else if !value.is_null() {
        let text = value.to_string();
        let text = if text.len() > LONGEST_VALUE { sha256_hex(text.as_bytes()) } else { text };
        flat.insert(prefix.to_owned(), text);
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn what_has_changed_is_named() {
        let made_by = Recipe::new(&json!({ "optimise": { "max_height_m": 150.0, "a": 1 } }))
            .with("views", "aa")
            .with("prior b.npy", "bb")
            .with("prior c.npy", ABSENT);
        assert_eq!(made_by.why_stale(&made_by), None);
        let wanted = Recipe::new(&json!({ "optimise": { "max_height_m": 12.0, "a": 1 } })).with("views", "aa");
        let why = wanted.why_stale(&made_by).unwrap();
        assert_eq!(why, "optimise.max_height_m is 12.0, was 150.0; prior b.npy is gone; prior c.npy is gone");
        let more = made_by.clone().with("prior c.npy", "cc").with("views", "ab");
        assert_eq!(more.why_stale(&made_by).unwrap(), "prior c.npy is new; views has changed");
        let of_tile = |sha256: &str| Recipe::new(&json!({})).with("its footprints", sha256).with("its terrain", sha256);
        let why = of_tile("aa").why_stale(&of_tile("bb")).unwrap();
        assert_eq!(why, "its footprints have changed; its terrain has changed");
        assert_ne!(wanted.sha256(), made_by.sha256());
    }

    #[test]
    fn another_program_makes_other_things() {
        let now = Recipe::new(&json!({}));
        let then = Recipe::new(&json!({})).with("program", "0.0.9+abc");
        let why = now.why_stale(&then).unwrap();
        assert_eq!(why, format!("made by sizeup 0.0.9+abc, this is {}", program()));
        assert!(program().starts_with(env!("CARGO_PKG_VERSION")));
    }

    #[test]
    fn a_long_list_of_changes_is_counted() {
        let wanted = (0..9).fold(Recipe::new(&json!({})), |recipe, i| recipe.with(format!("prior {i}"), "a"));
        let why = wanted.why_stale(&Recipe::new(&json!({}))).unwrap();
        assert_eq!(why, "prior 0 is new; prior 1 is new; prior 2 is new; and 6 more");
    }
}
