//! What to write instead: hints for mistakes in a configuration.

use super::ConfigError;

/// How an assignment looks.
pub(super) const FORM: &str = "write it as --set optimise.preset=paper or --set project.crs=EPSG:25832";

/// Where all keys of a run are listed.
pub(super) const KEYS_OF_RUN: &str = "`sizeup schema run` prints every key with its type, unit and default";
/// Where all keys of a simulated scene are listed.
pub(super) const KEYS_OF_SCENE: &str = "`sizeup schema simulate` prints every key with its type, unit and default";

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
    let table: toml::Table = toml::from_str(text).unwrap_or_default();
    let missing = error.message().strip_prefix("missing field `").and_then(|rest| rest.split('`').next());
    if let Some((name, hint)) = TABLES.iter().find(|(name, _)| missing == Some(*name) && !table.contains_key(*name)) {
        // The parser places it at the file's first line, whatever stands there.
        return (Some(format!("the table [{name}] is missing")), (*hint).to_owned());
    }
    let prior = table.get("prior").and_then(toml::Value::as_table);
    if missing == Some("source") && prior.is_some_and(|prior| !prior.contains_key("source")) {
        let hint = "source is \"files\" (depth maps computed elsewhere), \"network\" (an ONNX file that you bring), \
                    \"stereo\" (no network: the photos are matched with each other) or \"auto\" (a network where one is in place, \
                    else stereo)";
        return (None, hint.to_owned());
    }
    (None, values(error.message()).unwrap_or_else(|| keys.to_owned()))
}

/// A mistake in one of several assignments, or in all of them together.
pub(super) fn of_assignments(
    error: &toml::de::Error,
    blamed: Option<&String>,
    assignments: &[String],
    keys: &str,
) -> ConfigError {
    let message = error.message().to_owned();
    let hint = values(&message).unwrap_or_else(|| keys.to_owned());
    let assignment = blamed.cloned().unwrap_or_else(|| assignments.join(" --set "));
    ConfigError::Set { assignment, message, hint }
}

/// The words that are allowed where another stands.
fn values(message: &str) -> Option<String> {
    let expected = message.strip_prefix("unknown variant `")?.split_once("expected ")?.1;
    let words: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
    Some(format!("it is one of {}", words.join(", ")))
}
