//! Tables whose keys depend on their `source`: an assignment of another source leaves out what the file says of its own.

use serde::de::DeserializeOwned;

use sizeup_footprints::FootprintSource;
use sizeup_photos::prior::PriorConfig;

/// Takes out of a file's table what another source, that an assignment such as `prior.source=stereo` names, has no keys for.
pub(super) fn make_room(table: &mut toml::Table, assignments: &[String]) {
    make_room_in::<PriorConfig>(table, "prior", assignments);
    make_room_in::<FootprintSource>(table, "footprints", assignments);
}

fn make_room_in<T: DeserializeOwned>(table: &mut toml::Table, name: &str, assignments: &[String]) {
    let source_of = |assignment: &String| {
        let (key, value) = assignment.split_once('=')?;
        let is_source = key.trim().strip_prefix(name).is_some_and(|rest| rest == ".source");
        is_source.then(|| value.trim().trim_matches(['"', '\'']).to_owned())
    };
    let Some(source) = assignments.iter().filter_map(source_of).next_back() else { return };
    let Some(own) = table.get_mut(name).and_then(toml::Value::as_table_mut) else { return };
    if own.get("source").and_then(toml::Value::as_str) == Some(&source) {
        return;
    }
    let mut left = own.clone();
    left.insert("source".to_owned(), source.into());
    // Each round takes out one key that the other source has no name for.
    while let Err(error) = left.clone().try_into::<T>() {
        let unknown = error.message().strip_prefix("unknown field `").and_then(|rest| rest.split('`').next());
        if unknown.and_then(|key| left.remove(key)).is_none() {
            break;
        }
    }
    own.retain(|key, _| key == "source" || left.contains_key(key));
}
