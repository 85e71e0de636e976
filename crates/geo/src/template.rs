//! Paths with `{name}`, `{stem}` and `{index}` in them.

use std::path::PathBuf;

use crate::paths;

/// A photo's name without its extension; folders in the name stay.
#[must_use]
pub fn stem(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, extension)) if !extension.contains('/') && !stem.is_empty() && !stem.ends_with('/') => stem,
        _ => name,
    }
}

/// A photo's name without folders and extension: what files about it are called.
#[must_use]
pub fn bare_stem(name: &str) -> &str {
    stem(paths::file_name(name))
}

/// Names files about one of several photos in one folder: by its bare stem, or by its stem with `-` for `/` where several share the
/// bare one.
#[must_use]
pub fn name_among<'a>(name: &str, all: impl IntoIterator<Item = &'a str>) -> String {
    let bare = bare_stem(name);
    let is_shared = all.into_iter().filter(|other| bare_stem(other) == bare).nth(1).is_some();
    if is_shared { stem(name).replace(['/', '\\'], "-") } else { bare.to_owned() }
}

/// Literal text, or a placeholder's name.
enum TemplatePiece<'a> {
    Text(&'a str),
    Placeholder(&'a str),
}

fn pieces(template: &str) -> Result<Vec<TemplatePiece<'_>>, String> {
    let mut pieces = Vec::new();
    let mut rest = template;
    while let Some((text, after)) = rest.split_once('{') {
        let (name, after) =
            after.split_once('}').ok_or_else(|| format!("`path = {template:?}` has a {{ without }}"))?;
        pieces.push(TemplatePiece::Text(text));
        pieces.push(TemplatePiece::Placeholder(name));
        rest = after;
    }
    pieces.push(TemplatePiece::Text(rest));
    Ok(pieces)
}

/// Says what is wrong with a template.
///
/// # Errors
/// A brace without its other half, or a placeholder that is not known.
pub fn check(template: &str) -> Result<(), String> {
    for piece in pieces(template)? {
        match piece {
            TemplatePiece::Text(_) | TemplatePiece::Placeholder("name" | "stem" | "index") => {}
            TemplatePiece::Placeholder(other) => {
                return Err(format!("`path = {template:?}`: {{{other}}} means nothing here"));
            }
        }
    }
    Ok(())
}

/// The path for one photo; `None` if the template is wrong, asks for an index that the photo does not have, or for a name
/// that would lead out of the template's folder.
pub fn fill(template: &str, name: &str, index: Option<usize>) -> Option<PathBuf> {
    let name = paths::within(name).map(|_| name);
    let filled: Option<String> = pieces(template)
        .ok()?
        .into_iter()
        .map(|piece| match piece {
            TemplatePiece::Text(text) => Some(text.to_owned()),
            TemplatePiece::Placeholder("name") => name.map(str::to_owned),
            TemplatePiece::Placeholder("stem") => name.map(|name| stem(name).to_owned()),
            TemplatePiece::Placeholder("index") => index.map(|i| i.to_string()),
            TemplatePiece::Placeholder(_) => None,
        })
        .collect();
    filled.map(PathBuf::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_are_filled_and_unknown_ones_named() {
        let filled = fill("d/{stem}_{index}.npy", "cam 1/a.b.jpg", Some(7));
        assert_eq!(filled, Some(PathBuf::from("d/cam 1/a.b_7.npy")));
        assert_eq!(fill("all.npz", "a.jpg", None), Some(PathBuf::from("all.npz")));
        assert_eq!(fill("d/{stem}.npy", "../../secret/x.jpg", None), None);
        assert_eq!(fill("d/{name}.npy", "/etc/x.jpg", None), None);
        assert_eq!(fill("d/{index}.npy", "/data/x.jpg", Some(1)), Some(PathBuf::from("d/1.npy")));
        assert!(check("d/{photo}.npy").unwrap_err().contains("{photo}"));
        assert!(check("d/{stem.npy").is_err());
    }

    #[test]
    fn photos_of_one_name_in_two_folders_have_files_of_their_own() {
        let all = ["left/1.jpg", "right/1.jpg", "right/2.jpg"];
        let names = all.map(|name| name_among(name, all));
        assert_eq!(names, ["left-1", "right-1", "2"]);
        let files = all.map(|name| fill("d/{stem}.npy", name, None).unwrap());
        assert_eq!(files.map(|file| file.display().to_string()), ["d/left/1.npy", "d/right/1.npy", "d/right/2.npy"]);
    }

    #[test]
    fn a_stem_keeps_folders_and_dots() {
        assert_eq!(stem("v1.2/photo"), "v1.2/photo");
        assert_eq!(stem("a/.hidden"), "a/.hidden");
        assert_eq!(stem("a.tar.gz"), "a.tar");
    }
}
