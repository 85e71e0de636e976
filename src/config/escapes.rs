//! Paths of Windows in double quotes: in TOML their backslashes start escapes. Some of these are mistakes of the syntax (`\d`), others
//! are silently something else (`\n` is the end of a line).

use toml::Value;

/// Escapes of one letter, and their meaning.
const ESCAPES: [(char, char); 6] =
    [('\u{8}', 'b'), ('\t', 't'), ('\n', 'n'), ('\u{c}', 'f'), ('\r', 'r'), ('\u{1b}', 'e')];
/// Names of CRSs may be long texts of several lines.
const OF_LINES: &str = "crs";

/// Hint at a mistake of the syntax that lies in a text in double quotes with backslashes.
pub(super) fn hint_at(error: &toml::de::Error, text: &str) -> Option<String> {
    let at = error.span()?.start.min(text.len());
    let begin = text.get(..at)?.rfind('\n').map_or(0, |end| end + 1);
    let line = text.get(begin..)?.lines().next()?;
    // Between quotes as somebody means them who does not think of escapes: a last backslash does not hide the quote behind it.
    let (mut place, mut found) = (begin, None);
    for (i, part) in line.split('"').enumerate() {
        if i % 2 == 1 && part.contains('\\') && (found.is_none() || place <= at) {
            found = Some(part);
        }
        place += part.len() + 1;
    }
    found.map(hint)
}

/// The first text of a table that was written with an escape in it where a path was meant: its key, and how it was written in
/// one of `sources`. A text that is nothing but an escape, such as the tab between columns, was meant.
pub(super) fn unmeant(table: &toml::Table, sources: &[&str]) -> Option<(String, String)> {
    let is_written = |written: &str| sources.iter().any(|source| source.contains(&format!("\"{written}")));
    table.iter().find_map(|(key, value)| of_value(key, value, &is_written))
}

fn of_value(key: &str, value: &Value, is_written: &dyn Fn(&str) -> bool) -> Option<(String, String)> {
    match value {
        Value::String(text) if text.chars().count() > 1 && !key.ends_with(OF_LINES) => {
            let written = as_written(text)?;
            is_written(&written).then(|| (key.to_owned(), written))
        }
        Value::Table(table) => {
            table.iter().find_map(|(inner, value)| of_value(&format!("{key}.{inner}"), value, is_written))
        }
        Value::Array(values) => values.iter().find_map(|value| of_value(key, value, is_written)),
        _ => None,
    }
}

/// A text with control characters as it was written with escapes; `None` where it has none.
fn as_written(text: &str) -> Option<String> {
    let letter = |c: char| ESCAPES.iter().find(|(control, _)| *control == c).map(|(_, letter)| *letter);
    text.contains(|c| letter(c).is_some()).then(|| {
        let spelt = text.chars().map(|c| letter(c).map_or_else(|| c.to_string(), |letter| format!("\\{letter}")));
        spelt.collect()
    })
}

/// How to write a path with backslashes instead.
pub(super) fn hint(written: &str) -> String {
    let plain = written.replace("\\\\", "\\");
    format!(
        "a backslash in \"double quotes\" starts an escape: write \"{}\" with forward slashes, or '{plain}' in single quotes",
        plain.replace('\\', "/")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hint_of(text: &str) -> Option<String> {
        hint_at(&toml::from_str::<toml::Table>(text).unwrap_err(), text)
    }

    #[test]
    fn a_windows_path_that_is_no_toml_is_shown_as_it_should_be_written() {
        for (line, slashes, quotes) in [
            (r#"path = "D:\data\flight""#, "\"D:/data/flight\"", r"'D:\data\flight'"),
            (r#"path = "C:\Users\me""#, "\"C:/Users/me\"", r"'C:\Users\me'"),
            (r#"path = "D:\new\""#, "\"D:/new/\"", r"'D:\new\'"),
            (r#"paths = ["a.tif", "C:\x", "b.tif"]"#, "\"C:/x\"", r"'C:\x'"),
        ] {
            let hint = hint_of(&format!("[survey]\n{line}\nformat = \"csv\"\n")).unwrap();
            assert!(hint.contains(slashes) && hint.contains(quotes), "{line}: {hint}");
        }
        assert_eq!(hint_of("[survey]\npath = \n"), None);
        assert_eq!(hint_of("[survey]\npath = \"a\" \"b\"\n"), None);
    }

    #[test]
    fn a_windows_path_that_toml_reads_as_something_else_is_found() {
        let found = |text: &str| unmeant(&toml::from_str(text).unwrap(), &[text]);
        let expected = |key: &str, written: &str| Some((key.to_owned(), written.to_owned()));
        assert_eq!(found(r#"survey.path = "C:\flight\new""#), expected("survey.path", r"C:\flight\new"));
        assert_eq!(found(r#"a.b = ["x", "photos\temp"]"#), expected("a.b", r"photos\temp"));
        assert_eq!(found(r#"csv.delimiter = "\t""#), None, "a tab that is meant");
        assert_eq!(found("crs = \"\"\"PROJCRS[\n]\"\"\"\nname = \"\"\"two\nlines\"\"\""), None);
        assert_eq!(found(r"survey.path = 'C:\flight\new'"), None);
    }
}
