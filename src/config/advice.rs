//! What to write instead: hints for mistakes in a configuration.

use super::ConfigError;

/// How an assignment looks.
pub(super) const FORM: &str = "write it as --set optimise.preset=paper or --set project.crs=EPSG:25832";

/// Where all keys of a run are listed.
pub(super) const KEYS_OF_RUN: &str = "`sizeup schema run` prints every key with its type, unit and default";
/// Where all keys of a simulated scene are listed.
pub(super) const KEYS_OF_SCENE: &str = "`sizeup-lab schema` prints every key with its type, unit and default";

/// Tables that a configuration has to have, and what to write into them.
const TABLES: [(&str, &str); 5] = [
    ("project", "add [project] with crs = \"EPSG:25832\", the projected CRS of the results"),
    ("survey", "add [survey] with path = \"sparse\", the poses of the photos"),
    ("footprints", "add [footprints] with path = \"buildings.gpkg\", the footprints of the buildings"),
    (
        "terrain",
        "add [terrain] with dtm = \"dtm.tif\", a terrain model, or constant_m = 12.0, one height of the ground",
    ),
    ("prior", "add [prior] with source = \"auto\", \"files\", \"network\" or \"stereo\""),
];

/// A better message for a mistake in a file, where there is one, and a hint.
pub(super) fn of_file(error: &toml::de::Error, text: &str, keys: &str) -> (Option<String>, String) {
    let Ok(table) = toml::from_str::<toml::Table>(text) else {
        return (None, super::escapes::hint_at(error, text).unwrap_or_else(|| keys.to_owned()));
    };
    let missing = error.message().strip_prefix("missing field `").and_then(|rest| rest.split('`').next());
    if let Some((name, hint)) = TABLES.iter().find(|(name, _)| missing == Some(*name) && !table.contains_key(*name)) {
        // The parser places it at the file's first line.
        return (Some(format!("the table [{name}] is missing")), (*hint).to_owned());
    }
    let prior = table.get("prior").and_then(toml::Value::as_table);
    if let (Some("source"), Some(prior)) = (missing, prior.filter(|prior| !prior.contains_key("source"))) {
        let misspelt = prior.keys().find(|key| nearest(key, ["source"].into_iter()).is_some());
        let meant = misspelt.map_or_else(String::new, |key| format!("did you mean `source` by `{key}`? "));
        let hint = "source is \"files\" (depth maps computed elsewhere), \"network\" (an ONNX file that you bring), \
                    \"stereo\" (no network: the photos are matched with each other) or \"auto\" (a network where one is in place, \
                    else stereo)";
        return (None, format!("{meant}{hint}"));
    }
    (None, of_word(error.message(), keys))
}

/// A mistake in one of several assignments, or in all of them together.
pub(super) fn of_assignments(
    error: &toml::de::Error,
    blamed: Option<&String>,
    assignments: &[String],
    keys: &str,
) -> ConfigError {
    let message = error.message().to_owned();
    let hint = of_word(&message, keys);
    let assignment = blamed.cloned().unwrap_or_else(|| assignments.join(" --set "));
    ConfigError::Set { assignment, message, hint }
}

/// Hint at a key or a value that there is none of: the word that was meant, and where all are listed.
fn of_word(message: &str, keys: &str) -> String {
    let Some((is_key, rest)) = message
        .strip_prefix("unknown field `")
        .map(|rest| (true, rest))
        .or_else(|| message.strip_prefix("unknown variant `").map(|rest| (false, rest)))
    else {
        return keys.to_owned();
    };
    let (word, expected) = rest.split_once("expected ").unwrap_or((rest, ""));
    let word = word.split('`').next().unwrap_or_default();
    let words: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
    let all = if is_key { keys.to_owned() } else { format!("it is one of {}", words.join(", ")) };
    match nearest(word, words.iter().copied()) {
        Some(meant) => format!("did you mean `{meant}`? {all}"),
        None => all,
    }
}

/// The expected word that a misspelt one was meant to be, where one is near enough. Case, and hyphens for underscores, do not count.
pub(crate) fn nearest<'a>(word: &str, expected: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    /// Least likeness, 0..1, by edits and by letters in common: half of a short word's letters, or most of a long one's.
    const BY_EDITS: f64 = 0.6;
    const BY_LETTERS: f64 = 0.8;
    let plain = |word: &str| word.to_lowercase().replace('-', "_");
    let word = plain(word);
    let likeness = |expected: &str| {
        let expected = plain(expected);
        let edits = strsim::normalized_damerau_levenshtein(&word, &expected);
        let letters = strsim::jaro(&word, &expected);
        (edits >= BY_EDITS || letters >= BY_LETTERS).then_some(edits.max(letters))
    };
    let near = expected.filter_map(|one| Some((likeness(one)?, one)));
    near.reduce(|best, one| if one.0 > best.0 { one } else { best }).map(|(_, one)| one)
}
