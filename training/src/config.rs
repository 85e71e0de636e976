//! Configuration files: TOML in, with the place of a mistake; JSON Schema out.

use std::path::Path;

use serde::de::DeserializeOwned;
use sizeup_geo::files;

use crate::TrainError;

/// Reads a TOML file.
///
/// # Errors
/// [`TrainError::File`], or [`TrainError::Set`] with the line of the mistake.
pub fn read_toml<T: DeserializeOwned>(path: &Path) -> Result<T, TrainError> {
    let text = files::read_text(path)?;
    toml::from_str(&text).map_err(|e| {
        TrainError::set(
            path,
            e.to_string(),
            "`sizeup-train schema dataset` and `sizeup-train schema train` list all keys",
        )
    })
}
