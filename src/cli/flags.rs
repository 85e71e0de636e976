//! Flags as the settings that they stand for: what a configuration file would say, so that there is one way to read it.

use std::path::{Path, PathBuf};

use super::Failure;
use toml::{Table, Value};

/// Configuration that commands take where none is named, as `sizeup init` writes it.
pub(super) const BY_DEFAULT: &str = "sizeup.toml";

/// Returns the configuration of a command: the one that is named, else the one in this folder.
///
/// # Errors
/// [`Failure`] where there is none.
pub fn config_file(named: Option<&Path>) -> Result<PathBuf, Failure> {
    match named {
        Some(path) => Ok(path.to_owned()),
        None if Path::new(BY_DEFAULT).is_file() => Ok(BY_DEFAULT.into()),
        None => {
            let hint = "`sizeup init FOLDER` writes one for a folder of photos; or name yours, as in `sizeup run town/sizeup.toml`";
            Err(Failure::from_text(
                2,
                format!("no configuration is named, and there is no {BY_DEFAULT} in this folder\nhint: {hint}"),
            ))
        }
    }
}

/// A setting that a flag stands for: table, key, value.
pub(super) type Flag = (&'static str, &'static str, Value);

/// A setting, where its flag was given.
pub(super) fn flag(table: &'static str, key: &'static str, value: Option<impl Into<Value>>) -> Option<Flag> {
    Some((table, key, value?.into()))
}

/// A path as the text of a setting.
pub(super) fn text_of(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Puts settings into the tables of a configuration; what stands there goes.
pub(super) fn put(config: &mut Table, flags: impl IntoIterator<Item = Flag>) {
    for (table, key, value) in flags {
        let entry = config.entry(table).or_insert_with(|| Table::new().into());
        if let Some(entry) = entry.as_table_mut() {
            entry.insert(key.to_owned(), value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_goes_before_the_file_and_an_absent_one_leaves_it() {
        let mut config: Table = "[survey]\npath = \"a\"\ncrs = \"EPSG:4326\"\n".parse().unwrap();
        put(&mut config, flag("survey", "path", Some("b")).into_iter().chain(flag("survey", "crs", None::<&str>)));
        put(&mut config, flag("terrain", "constant_m", Some(7.5)));
        assert_eq!(config["survey"]["path"].as_str(), Some("b"));
        assert_eq!(config["survey"]["crs"].as_str(), Some("EPSG:4326"));
        assert_eq!(config["terrain"]["constant_m"].as_float(), Some(7.5));
    }
}
